"""Second derivatives beside nodal strains."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize.quadrature import volumes_of
from jaxpd.discretize.stabilised import (
    natural,
    residual,
    residual_load,
    second_moments,
)
from jaxpd.physics.elastic import stiffness
from tests.discretize.weak import cloud, layout

E, ALPHA = 5.0, 0.05


@functools.partial(jax.jit, static_argnums=(2,))
def made(X, lay, name):
    d = X.shape[1]
    C = stiffness(E, 0.3, "bar" if d == 1 else "plane stress")
    if name == "natural":
        return natural(X, lay, C)
    return residual(X, lay, C, E, ALPHA)


def rows(penalty, nodes_of, u):
    return jnp.einsum("mbkgc,kcb->mgc", penalty.R, u[nodes_of])


def energy(penalty, nodes_of, u):
    return 0.5 * float(jnp.sum(penalty.v * rows(penalty, nodes_of, u) ** 2))


def quadratic(X):
    """u = (x^2 + x y, 2 y^2 - x y), in 1-D x^2."""
    if X.shape[1] == 1:
        return X**2
    x, y = X.T
    return jnp.stack([x * x + x * y, 2 * y * y - x * y], axis=1)


@pytest.mark.parametrize("d", [1, 2])
@pytest.mark.parametrize("name", ["natural", "residual"])
def test_energy(d, name):
    X, lay = cloud(d).X, layout(d, "nodes")
    penalty = made(X, lay, name)
    n, nodes_of = len(X), lay.nodes_of
    linear = 0.3 + X @ jnp.arange(1.0, 1 + d * d).reshape(d, d)
    scale = energy(penalty, nodes_of, quadratic(X))
    assert energy(penalty, nodes_of, linear) < 1e-18 * scale
    waves = jnp.asarray(np.random.default_rng(0).normal(size=(n, d)))
    assert energy(penalty, nodes_of, waves) > 0
    assert float(penalty.v.min()) > 0
    v = volumes_of(X, lay.rule)
    M = second_moments(X, lay)
    nu = 0.3
    if name == "residual":
        if d == 1:
            r, length = jnp.asarray([2 * E]), 1.0 / n
        else:
            k, G = E / (1 - nu**2), E / 2 / (1 + nu)
            # strains: xx = 2 x + y, yy = 4 y - x, xy = x - y
            r = jnp.asarray([k * (2 - nu) - G, k * (4 + nu) + G])
            length = (1.0 / n) ** 0.5
        expected = ALPHA * length**2 / E * float(v.sum() * (r**2).sum())
    elif d == 1:
        expected = 0.5 * float(M.sum()) * E * 4.0
    else:
        C = np.asarray(stiffness(E, nu, "plane stress"))
        along_x, along_y = np.array([2.0, -1.0, 1.0]), np.array([1.0, 4.0, -1.0])
        each = [a @ C @ a for a in (along_x, along_y)]
        expected = 0.5 * float(M[0].sum() * each[0] + M[1].sum() * each[1])
    assert scale == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("d", [1, 2])
def test_load_of_body_forces(d):
    """Rows and load vanish together where div(C eps) + b = 0."""
    X, lay = cloud(d).X, layout(d, "nodes")
    penalty = made(X, lay, "residual")
    u, n = quadratic(X), len(X)
    r = rows(penalty, lay.nodes_of, u)  # [d, 1, n]
    b = -jnp.moveaxis(r, 0, -1)
    load = residual_load(penalty, lay.nodes_of, b, n)
    through = jnp.einsum("mgc,mbkgc->kcb", penalty.v * r, penalty.R)
    internal = jnp.zeros((n, d)).at[lay.nodes_of].add(through)
    assert np.allclose(internal, load, rtol=0, atol=1e-12 * np.abs(load).max())
    assert float(jnp.abs(load).max()) > 0


def test_second_moments():
    X, lay = cloud(2).X, layout(2, "nodes")
    M = np.asarray(second_moments(X, lay))
    v = np.asarray(volumes_of(X, lay.rule))
    inner = ((X > 0.01) & (X < 0.99)).all(axis=1)
    assert np.allclose(M[:, inner], v[inner] ** 2 / (4 * np.pi), rtol=1e-12)
    # a half circle has half the moments of a circle of its radius, a quarter a quarter
    rim = ~np.asarray(inner)
    f = np.where(np.asarray(((X < 0.01) | (X > 0.99)).all(axis=1)), 0.25, 0.5)[rim]
    assert np.allclose(M[:, rim], v[rim] ** 2 / (4 * np.pi * f), rtol=1e-12)


def test_other_rules_are_refused():
    lay = layout(2, "circles")
    with pytest.raises(ValueError, match="plain nodal integration"):
        natural(cloud(2).X, lay, np.eye(3))
