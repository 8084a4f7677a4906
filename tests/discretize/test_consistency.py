"""Gradients in equilibrium: the divergence theorem, discrete."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize.consistency import consistent, missed
from jaxpd.discretize.moments import monomials
from jaxpd.discretize.projection import projected
from tests.discretize.weak import cloud, layout, of_nodes, parts, sampled

RULES = [("nodes", "direct"), ("circles", "direct"), ("triangles", "direct")]
how = {"nodes": (1, 1), "circles": (1, 4), "triangles": (3, 0)}


def at_rule(d, kind, gradient="direct", exact=True):
    return layout(d, kind, gradient, how.get(kind), exact)


@functools.partial(jax.jit, static_argnums=(2, 3))
def mended(X, lay, degree, symmetric):
    """Gradients mended, and what they miss."""
    radius, nodes_of, places, rim = parts(X, lay)
    mend = projected if symmetric else consistent
    T = mend(X, radius, nodes_of, places, rim, degree)
    after = (places[0], places[1], T, places[3])
    order = degree - 1 if symmetric else degree
    return T, missed(X, radius, nodes_of, after, rim, order)


@pytest.mark.parametrize("d", [1, 2])
@pytest.mark.parametrize(("kind", "gradient"), RULES)
def test_consistent_tests(d, kind, gradient):
    X, lay = cloud(d).X, at_rule(d, kind, gradient, False)
    assert np.abs(mended(X, lay, 1, False)[1]).max() < 1e-12


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.parametrize("d", [1, 2])
@pytest.mark.parametrize(("kind", "gradient"), RULES)
def test_quadratic_projection(d, kind, gradient):
    X, lay = cloud(d).X, at_rule(d, kind, gradient)
    T, left = mended(X, lay, 2, True)
    assert np.abs(left).max() < (1e-11 if kind == "nodes" else 1e-12)
    _, nodes_of, (place, _, B, _), _ = sampled(X, lay)
    assert float(jnp.abs(T - B).max()) > 1e-3
    p, q = monomials(X, 2), monomials(place, 2)
    assert np.abs(T.sum(axis=1)).max() < 1e-9
    for k in range(1, p.shape[1]):
        got = of_nodes(T, nodes_of, p[:, k])
        first = {0: [q[..., 0]]}
        if d == 1:
            exact = [first[0], [place[..., 0]]][k - 1]
        else:
            one, x, y, zero = q[..., 0], q[..., 1], q[..., 2], 0 * q[..., 0]
            exact = [[one, zero], [zero, one], [x, zero], [y, x], [zero, y]][k - 1]
        assert np.abs(got - jnp.stack(exact, axis=-1)).max() < 1e-9


def test_linear_projection():
    X, lay = cloud(2).X, at_rule(2, "circles")
    T, left = mended(X, lay, 1, True)
    assert np.abs(left).max() < 1e-12
    for a in range(2):
        got = of_nodes(T, lay.nodes_of, X[:, a])
        assert np.abs(got - jnp.eye(2)[a][None, None]).max() < 1e-10


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_projection_in_the_nodes():
    """Its derivative in the positions, through the solution on the host."""
    X, lay = cloud(2).X, at_rule(2, "circles")
    goal = jnp.asarray(np.random.default_rng(0).normal(size=(2, *X.shape)))

    @jax.jit
    def total(X):
        radius, nodes_of, places, rim = parts(X, lay)
        T = projected(X, radius, nodes_of, places, rim, 2)
        u = jnp.sin(3.0 * X[:, 0]) * X[:, 1] ** 2
        g = of_nodes(T, nodes_of, u)
        return jnp.sum(places[1][..., None] * g**2) + jnp.sum(T**2) / 1e4

    slope = jax.jit(jax.grad(total))(X)
    assert np.isfinite(slope).all()
    h = 1e-6
    for way in goal:
        difference = (total(X + h * way) - total(X - h * way)) / (2 * h)
        assert float(jnp.sum(slope * way)) == pytest.approx(float(difference), rel=1e-5)


@pytest.mark.parametrize("d", [1, 2])
@pytest.mark.parametrize("gradient", ["constant", "linear"])
def test_cells_are_consistent(d, gradient):
    X = cloud(d).X
    lay = at_rule(d, "cells", gradient, False)
    radius, nodes_of, places, rim = sampled(X, lay)
    order = 1 if gradient == "linear" else 0
    assert np.abs(missed(X, radius, nodes_of, places, rim, order)).max() < 1e-14
    degree = 2 if gradient == "linear" else 1
    p, place = monomials(X, degree), places[0]
    assert np.abs(places[2].sum(axis=1)).max() < 1e-12
    for a in range(d):
        got = of_nodes(places[2], nodes_of, p[:, 1 + a])
        assert np.abs(got - jnp.eye(d)[a][None, None]).max() < 1e-12
    if degree == 2:
        got = of_nodes(places[2], nodes_of, p[:, 1 + d])[..., 0]
        assert np.abs(got - place[..., 0]).max() < 1e-12


@pytest.mark.parametrize("gradient", ["constant", "linear"])
def test_cells_mended_once_more(gradient):
    """Nodes that reach a cell's faces alone count, too."""
    X, lay = cloud(2).X, at_rule(2, "cells", gradient, False)
    assert np.abs(mended(X, lay, 1, False)[1]).max() < 1e-12


@pytest.mark.parametrize("kind", ["circles", "cells"])
def test_divergence_theorem(kind):
    """Linear stresses do the work of their tractions less that of their divergence."""
    X = cloud(2).X
    lay = at_rule(2, kind, "linear" if kind == "cells" else "direct")
    _, nodes_of, places, rim = sampled(X, lay)
    place, w, B, psi = places
    if kind == "circles":
        B = mended(X, lay, 2, True)[0]
    rng = np.random.default_rng(4)
    A, slope = rng.normal(size=(2, 2)), rng.normal(size=(2, 2, 2))
    u = jnp.asarray(rng.normal(size=X.shape))

    def stress(x):
        return A + jnp.einsum("abc,...c->...ab", slope, x)

    at, flux, nbr, value = rim
    G = jnp.einsum("bkgc,kca->gcab", B, u[nodes_of])
    inner = jnp.einsum("gc,gcab,gcab->", w, stress_of(stress, place), G)
    div = jnp.einsum("abb->a", slope)
    inner += jnp.einsum("gc,kgc,kca,a->", w, psi, u[nodes_of], div)
    outer = jnp.einsum("kb,kba,bac,bc->", value, u[nbr], stress_of(stress, at), flux)
    assert float(inner) == pytest.approx(float(outer), abs=1e-11)


def stress_of(stress, x):
    flat = jax.vmap(stress)(x.reshape(-1, 2))
    return flat.reshape(*x.shape[:-1], 2, 2)
