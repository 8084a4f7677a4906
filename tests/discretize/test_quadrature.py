"""Rules inside the body and on its boundary."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize.boundary import boundary, boundary_points
from jaxpd.discretize.moments import monomials
from jaxpd.discretize.quadrature import body_moments, places_of, quadrature, volumes_of
from jaxpd.geometry import mapped
from tests.discretize.weak import cloud
from tests.geometry.test_outline import l_shape, plate

places = jax.jit(places_of)
edges = jax.jit(boundary_points)
EVERY = [
    ("nodes", (1, 1)),
    ("circles", (1, 4)),
    ("triangles", (3, 0)),
    ("cells", (3, 0)),
]


def bodies(d):
    if d == 1:
        return [cloud(1)]
    return [cloud(2), l_shape()[0], plate()]


@pytest.mark.parametrize("d", [1, 2])
@pytest.mark.parametrize(("kind", "points"), EVERY)
def test_weights_fill_the_body(d, kind, points):
    for body in bodies(d):
        edge = body.rim.edge if d == 2 else None
        for exact in (False, True):
            rule = quadrature(body.X, edge, kind, points=points, exact=exact)
            place, w = places(body.X, rule)
            whole = body_moments(body.X, rule.edge, 2)
            assert float(w.sum()) == pytest.approx(float(whole[0]), rel=1e-14)
            if exact or kind in ("triangles", "cells"):  # degree 2
                got = jnp.einsum("gc,gck->k", w, monomials(place, 2))
                assert np.allclose(got, whole, rtol=1e-12)


@pytest.mark.parametrize(("number", "degree"), [(1, 1), (3, 2), (6, 4), (12, 6)])
def test_points_in_triangles(number, degree):
    body = cloud(2)
    rule = quadrature(body.X, body.rim.edge, "triangles", points=(number, 0))
    place, w = places(body.X, rule)
    assert place.shape[0] == number
    for i in range(degree + 1):
        got = (w * place[..., 0] ** i * place[..., 1] ** (degree - i)).sum()
        exact = 1.0 / ((i + 1) * (degree - i + 1))
        assert float(got) == pytest.approx(exact, rel=1e-11)


def test_volumes_of_paper_004():
    """Shares of a full angle times squares of local spacings (eq. 18)."""
    body = mapped((4, 3), lambda s: jnp.array([3.0, 2.0]) * s)
    rule = quadrature(body.X, body.rim.edge, "nodes")
    assert np.allclose(volumes_of(body.X, rule), body.vol, rtol=1e-14)
    body, _ = l_shape()
    X = np.array(body.X)
    inner = np.flatnonzero((X == [1, 1]).all(axis=1))[0]
    X[inner] += [0.2, 0.1]
    rule = quadrature(X, body.rim.edge, "nodes")
    got = np.asarray(volumes_of(jnp.asarray(X), rule))
    far = np.sort(np.linalg.norm(X - X[inner], axis=1))[1:5]
    corner = np.flatnonzero((X == [4, 0]).all(axis=1))[0]  # two neighbours at 1
    ratio = far.mean() ** 2 / 0.25
    assert got[inner] / got[corner] == pytest.approx(ratio, rel=1e-12)
    assert got.sum() == pytest.approx(12.0, rel=1e-14)


def test_circles():
    body = cloud(2)
    rule = quadrature(body.X, body.rim.edge, "circles", points=(2, 6))
    place, w = places(body.X, rule)
    assert place.shape == (12, 42, 2)
    volume = np.asarray(volumes_of(body.X, rule))
    assert np.allclose(w.sum(axis=0), volume, rtol=1e-13)
    assert ((place > 0) & (place < 1)).all()  # sectors stay inside
    radius = np.sqrt(volume / np.pi)
    inner = ((body.X > 0.01) & (body.X < 0.99)).all(axis=1)
    far = np.linalg.norm(place - body.X[None], axis=2)[:, inner] / radius[inner]
    assert far.max() < 1.0
    # second moment of a circle
    got = (np.asarray(w)[:, inner] * (far * radius[inner]) ** 2).sum(axis=0)
    assert np.allclose(got, volume[inner] * radius[inner] ** 2 / 2, rtol=1e-12)


def test_circles_of_a_bar():
    body = cloud(1)
    rule = quadrature(body.X, None, "circles", points=(2, 6))
    place, w = places(body.X, rule)
    volume = np.asarray(volumes_of(body.X, rule))
    assert np.allclose(w.sum(axis=0), volume, rtol=1e-13)
    assert (place >= 0).all()
    assert (place <= 1).all()


@pytest.mark.parametrize("kind", ["circles", "cells"])
def test_derivative_in_the_nodes(kind):
    body, _ = l_shape()
    X = np.array(body.X)
    inner = np.setdiff1d(np.arange(len(X)), np.asarray(body.rim.edge))
    X[inner] += np.random.default_rng(0).uniform(-0.2, 0.2, X[inner].shape)
    X = jnp.asarray(X)
    rule = quadrature(X, body.rim.edge, kind, points=(1, 4), exact=True)

    @jax.jit
    def total(X):
        place, w = places_of(X, rule)
        return jnp.sum(w * jnp.sin(place[..., 0]) * place[..., 1] ** 2)

    slope = jax.jit(jax.grad(total))(X)
    way = jnp.asarray(np.random.default_rng(1).normal(size=X.shape))
    h = 1e-6
    difference = (total(X + h * way) - total(X - h * way)) / (2 * h)
    assert float(jnp.sum(slope * way)) == pytest.approx(float(difference), rel=1e-6)


def test_boundary_rule():
    """Cubics over held straight edges of four nodes; Gauss elsewhere; closed."""
    body = mapped((6, 5), lambda s: s)
    X = np.array(body.X)
    left = X[:, 0] < 1e-9
    X[left, 1] = [0.0, 0.21, 0.55, 0.8, 1.0]
    line = boundary(X, body.rim.edge, left)
    at, middle, s, out = (np.asarray(x) for x in edges(jnp.asarray(X), line))
    assert np.abs((s[:, None] * out).sum(axis=0)).max() < 1e-14
    here = np.abs(at[:, 0]) < 1e-12
    held = np.asarray(line.size) > 0
    assert (held == here).all()
    for k in range(4):
        got = (s * at[:, 1] ** k)[here].sum()
        assert got == pytest.approx(1.0 / (k + 1), rel=1e-13)
        # what is cubic at nodes times what is linear
        got = (s * at[:, 1] ** k * middle[:, 1])[here].sum()
        assert got == pytest.approx(1.0 / (k + 2), rel=1e-13)
        top = np.abs(at[:, 1] - 1) < 1e-12
        top &= ~here
        assert (s * at[:, 0] ** k)[top].sum() == pytest.approx(1 / (k + 1), rel=1e-13)
    # half of an edge at each of its nodes, for cubics too
    cell, y = np.asarray(line.cell), np.sort(X[left, 1])
    for i in np.flatnonzero(left):
        own = here & (cell == i)
        j = int(np.searchsorted(y, X[i, 1]))
        low = 0.5 * (y[max(j - 1, 0)] + y[j])
        high = 0.5 * (y[min(j + 1, 4)] + y[j])
        got = (s * at[:, 1] ** 3)[own].sum()
        assert got == pytest.approx((high**4 - low**4) / 4, abs=1e-14)


def test_short_held_runs():
    """Runs of two and three nodes: exact to degree 1 and 2."""
    for size in (2, 3):
        body = mapped((6, size), lambda s: s)
        left = np.asarray(body.X)[:, 0] < 1e-9
        line = boundary(body.X, body.rim.edge, left)
        at, middle, s, _ = (np.asarray(x) for x in edges(body.X, line))
        here = np.abs(at[:, 0]) < 1e-12
        for k in range(size):
            got = (s * at[:, 1] ** k)[here].sum()
            assert got == pytest.approx(1.0 / (k + 1), rel=1e-13)
            got = (s * at[:, 1] ** k * middle[:, 1])[here].sum()
            assert got == pytest.approx(1.0 / (k + 2), rel=1e-13)
    # a part of a side, which meets its free part
    body = mapped((4, 8), lambda s: s)
    X = np.asarray(body.X)
    part = (X[:, 0] < 1e-9) & (X[:, 1] < 0.4)
    line = boundary(X, body.rim.edge, part)
    at, _, s, _ = (np.asarray(x) for x in edges(body.X, line))
    here = np.abs(at[:, 0]) < 1e-12
    assert (s * at[:, 1] ** 2)[here].sum() == pytest.approx(1 / 3, rel=1e-13)


def test_ends_of_a_bar():
    X = jnp.asarray([[0.4], [1.0], [0.0]])
    line = boundary(X, None, np.array([False, False, True]))
    at, _, s, out = edges(X, line)
    assert np.allclose(at[:, 0], [0.0, 1.0])
    assert np.allclose(s, 1.0)
    assert np.allclose(out[:, 0], [-1.0, 1.0])


def test_refusals():
    body = cloud(2)
    with pytest.raises(ValueError, match="must be one of"):
        quadrature(body.X, body.rim.edge, "squares")
    rule = quadrature(body.X, body.rim.edge, "triangles", points=(4, 0))
    with pytest.raises(ValueError, match="in a triangle"):
        places_of(body.X, rule)
