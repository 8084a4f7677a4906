"""Outlines: angles, moments, straight runs, rims."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize.quadrature import shares
from jaxpd.geometry import mapped, outlined
from jaxpd.geometry.outline import polygon_moments, straight_runs


def square(shape=(4, 3), keep=lambda at: np.ones(len(at), bool)):
    at = np.indices(shape).reshape(2, -1).T
    return at[keep(at)].astype(float)


def numbers(X, corners):
    """Nodes of a grid of spacing one around a polygon of corners."""
    loop = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        steps = int(np.abs(np.subtract(b, a)).max())
        for k in range(steps):
            at = a + np.subtract(b, a) * k / steps
            loop.append(int(np.argmin(np.abs(X - at).sum(axis=1))))
    return loop


def l_shape():
    X = square((5, 5), lambda at: (at[:, 0] <= 2) | (at[:, 1] <= 2))
    corners = np.array([[0, 0], [4, 0], [4, 2], [2, 2], [2, 4], [0, 4]])
    return outlined(X, [numbers(X, corners)]), corners


def plate():
    """A square of side 6 with a hole of side 2."""
    X = square((7, 7), lambda at: (at != 3).any(axis=1))
    outer = np.array([[0, 0], [6, 0], [6, 6], [0, 6]])
    inner = np.array([[2, 2], [2, 4], [4, 4], [4, 2]])
    return outlined(X, [numbers(X, outer), numbers(X, inner)])


def test_shares_of_a_full_angle():
    cloud, _ = l_shape()
    X = np.asarray(cloud.X)
    f = shares(cloud.X, cloud.rim.edge)
    assert np.allclose(f, shares(X, np.asarray(cloud.rim.edge)), rtol=0, atol=1e-15)
    at = {tuple(x): v for x, v in zip(X.astype(int), np.asarray(f), strict=True)}
    expected = {(0, 0): 0.25, (3, 0): 0.5, (2, 2): 0.75, (1, 1): 1.0, (2, 4): 0.25}
    for place, value in expected.items():
        assert at[place] == pytest.approx(value, abs=1e-14)
    box = mapped((4, 3), lambda s: s)
    f = np.asarray(shares(box.X, box.rim.edge))
    assert sorted(np.unique(f.round(12))) == [0.25, 0.5, 1.0]
    hole = plate()
    f = np.asarray(shares(hole.X, hole.rim.edge))
    corner = (np.abs(np.asarray(hole.X) - 3) == 1).all(axis=1)
    assert np.allclose(f[corner], 0.75, rtol=0, atol=1e-14)


def test_moments_of_polygons():
    cloud, _ = l_shape()
    X, edge = cloud.X, cloud.rim.edge
    # [0, 4] x [0, 2] and [0, 2] x [2, 4]
    exact = [12.0, 20.0, 20.0, 24.0, 28.0, 24.0]
    exact[3] = 0.5 * (4**3 / 3 * 2 + 2**3 / 3 * 2)
    exact[5] = exact[3]
    exact[4] = 8.0 * 2.0 + 2.0 * 6.0
    for x in (X, np.asarray(X)):
        got = polygon_moments(x, np.asarray(edge), 2)
        assert np.allclose(got, exact, rtol=1e-14)
    hole = plate()
    got = polygon_moments(np.asarray(hole.X), np.asarray(hole.rim.edge), 2)
    second = (6**4 - 2**4) / 12 + 32 * 9
    exact = [32.0, 96.0, 96.0, second / 2, 32 * 9.0, second / 2]
    assert np.allclose(got, exact, rtol=1e-14)


def test_rims_are_closed():
    for cloud in (l_shape()[0], plate()):
        rim = cloud.rim
        flux = np.asarray(rim.normal * rim.area[:, None])
        assert np.abs(flux.sum(axis=0)).max() < 1e-13
        x = np.asarray(cloud.X)[np.asarray(rim.node)]
        # halves of edges at their nodes: exact for what is linear along an edge
        area = polygon_moments(np.asarray(cloud.X), np.asarray(rim.edge), 0)[0]
        assert 0.5 * (flux * x).sum() == pytest.approx(area, rel=1e-12)
        assert float(cloud.vol.sum()) == pytest.approx(area, rel=1e-12)


def test_straight_runs():
    cloud, corners = l_shape()
    edge = np.asarray(cloud.rim.edge)
    runs = straight_runs(np.asarray(cloud.X), edge)
    assert sorted(np.concatenate(runs)) == list(range(len(edge)))
    assert sorted(map(len, runs)) == [2, 2, 2, 2, 4, 4]
    for run in runs:
        assert (edge[run[1:], 0] == edge[run[:-1], 1]).all()
    starts = {tuple(np.asarray(cloud.X)[edge[run[0], 0]]) for run in runs}
    assert starts == {tuple(map(float, c)) for c in corners}


def test_refused_loops():
    X = square((3, 3))
    around = [0, 3, 6, 7, 8, 5, 2, 1]
    assert float(outlined(X, [around]).vol.sum()) == pytest.approx(4.0)
    with pytest.raises(ValueError, match="counter-clockwise"):
        outlined(X, [around[::-1]])
    with pytest.raises(ValueError, match="twice"):
        outlined(X, [[*around, 0]])
    with pytest.raises(ValueError, match="beyond"):
        outlined(X, [[0, 3, 9]])
    with pytest.raises(ValueError, match="plane"):
        outlined(np.zeros((4, 3)), [around])
    X[1] = X[2]
    with pytest.raises(ValueError, match="coincide"):
        outlined(X, [around])
    assert jnp.isfinite(X).all()
