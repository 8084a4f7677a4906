"""Reproducing kernels: what they reproduce, their derivatives, their covers."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize.moments import monomials, powers
from jaxpd.discretize.rkpm import find_cover, radii, shape_functions
from jaxpd.geometry import mapped

functions = jax.jit(shape_functions, static_argnums=(3, 4))


def share_of_grid(shape):
    at = np.indices(shape)
    ends = [(a == 0) | (a == n - 1) for a, n in zip(at, shape, strict=True)]
    return np.prod([np.where(e, 0.5, 1.0) for e in ends], axis=0).ravel()


@functools.lru_cache
def made(d, jitter, degree=2):
    shape = {1: (11,), 2: (8, 6), 3: (5, 5, 5)}[d]
    X = mapped(shape, lambda s: s, jitter=jitter, seed=3).X
    rng = np.random.default_rng(1)
    places = jnp.concatenate([jnp.asarray(rng.uniform(0, 1, (9, d))), X[:9]])
    radius = radii(X, share_of_grid(shape), 2.6, degree)
    return X, places, find_cover(places, X, radius, degree)


def polynomial(x):
    """A value [..] with its gradient and second derivatives."""
    d = x.shape[-1]
    g = jnp.arange(1.0, 1 + d)
    H = jnp.arange(1.0, 1 + d * d).reshape(d, d)
    H = H + H.T
    value = 0.3 + jnp.einsum("...a,a->...", x, g)
    value = value + 0.5 * jnp.einsum("...a,ab,...b->...", x, H, x)
    return value, g[None] + x @ H, H


@pytest.mark.parametrize("d", [1, 2, 3])
def test_quadratics_are_reproduced(d):
    X, places, cover = made(d, 0.3 if d < 3 else 0.2)
    psi, first, second = functions(places, X, cover, 2, 2)
    u = polynomial(X)[0][cover.nbr]
    value, slope, bend = polynomial(places)
    got = jnp.einsum("kq,kq->q", psi, u)
    assert np.allclose(got, value, rtol=0, atol=1e-11)
    got = jnp.einsum("akq,kq->qa", first, u)
    assert np.allclose(got, slope, rtol=0, atol=1e-11 * 100)
    scale = float(jnp.abs(second).max())
    got = jnp.einsum("abkq,kq->qab", second, u)
    assert np.abs(got - bend[None]).max() <= 1e-10 * max(1.0, scale / 100)
    assert not np.asarray(psi)[~np.asarray(cover.there)].any()


def test_linear_basis():
    X, places, cover = made(2, 0.3, 1)
    psi, first = functions(places, X, cover, 1, 1)
    p = monomials(X, 1)[cover.nbr]
    got = jnp.einsum("kq,kqi->qi", psi, p)
    assert np.allclose(got, monomials(places, 1), rtol=0, atol=1e-12)
    got = jnp.einsum("akq,kqi->aqi", first, p)
    assert np.allclose(got[:, :, 1:], np.eye(2)[:, None], rtol=0, atol=1e-11)
    with pytest.raises(ValueError, match="no second derivatives"):
        shape_functions(places, X, cover, 1, 2)


@pytest.mark.parametrize("d", [1, 2])
def test_derivatives_against_differences(d):
    X, places, cover = made(d, 0.3)
    _, first, second = functions(places, X, cover, 2, 2)
    h = 1e-6
    for a in range(d):
        step = h * jnp.eye(d)[a][None]
        up, down = (functions(places + s * step, X, cover, 2, 2) for s in (1, -1))
        got = (up[0] - down[0]) / (2 * h)
        assert np.abs(got - first[a]).max() <= 1e-6 * float(jnp.abs(first).max())
        got = (up[1] - down[1]) / (2 * h)
        assert np.abs(got - second[a]).max() <= 1e-6 * float(jnp.abs(second).max())


def test_derivative_in_the_nodes():
    X, places, cover = made(2, 0.3)
    way = jnp.asarray(np.random.default_rng(0).normal(size=X.shape))
    goal = jnp.asarray(np.random.default_rng(1).normal(size=cover.nbr.shape))

    @jax.jit
    def total(X):
        psi, first = shape_functions(places, X, cover, 2, 1)
        return jnp.sum(goal * psi) + jnp.sum(goal[None] * first)

    slope = jax.jit(jax.grad(total))(X)
    assert np.isfinite(slope).all()  # also where places are nodes
    h = 1e-6
    difference = (total(X + h * way) - total(X - h * way)) / (2 * h)
    assert float(jnp.sum(slope * way)) == pytest.approx(float(difference), rel=1e-6)


def test_radii_guard_irregular_nodes():
    shape = (9, 9)
    for seed in range(3):
        X = np.asarray(mapped(shape, lambda s: s, jitter=0.45, seed=seed).X)
        radius = radii(X, share_of_grid(shape), 2.6, 2)
        cover = find_cover(X, X, radius, 2)
        assert (np.asarray(cover.radius) >= radius).all()
        there = np.asarray(cover.there)
        assert there.sum(axis=0).min() >= len(powers(2, 2))
        far = np.linalg.norm(X[np.asarray(cover.nbr)] - X[None], axis=2)
        inside = far < np.asarray(cover.radius)[np.asarray(cover.nbr)]
        assert (inside | ~there).all()
        # nobody is forgotten: count all pairs
        every = np.linalg.norm(X[:, None] - X[None], axis=2)
        every = every < np.asarray(cover.radius)[None] * (1 - 1e-12)
        assert (every.sum(axis=1) == there.sum(axis=0)).all()


def test_supports_that_reach_one_line_grow():
    x, y = np.meshgrid(np.arange(7) / 6, np.arange(7) / 3, indexing="ij")
    X = np.stack([x.ravel(), y.ravel()], axis=1)
    cover = find_cover(X, X, 0.32, 2)
    psi = shape_functions(jnp.asarray(X), jnp.asarray(X), cover, 2, 0)[0]
    got = np.einsum("kq,kq->q", psi, (X[:, 1] ** 2)[np.asarray(cover.nbr)])
    assert np.allclose(got, X[:, 1] ** 2, rtol=0, atol=1e-11)


def test_refusals():
    line = np.stack([np.linspace(0, 1, 12), np.zeros(12)], axis=1)
    with pytest.raises(ValueError, match="not determined"):
        find_cover(line, line, 0.5, 2)
    with pytest.raises(ValueError, match="must be positive"):
        find_cover(line, line, -1.0, 2)
    with pytest.raises(ValueError, match="too few"):
        radii(line[:3], np.ones(3), 2.6, 2)
    line[3] = line[4]
    with pytest.raises(ValueError, match="coincides"):
        radii(np.tile(line, (2, 1)), np.ones(24), 2.6, 2)
