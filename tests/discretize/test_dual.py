"""Cells of nodes: Voronoi inside, the outline outside."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import Voronoi

from jaxpd.discretize.dual import cell_moments, dual, face_points, triangulate
from jaxpd.geometry import mapped, outlined
from jaxpd.geometry.outline import polygon_moments
from tests.geometry.test_outline import l_shape, plate

moments = jax.jit(cell_moments)


def ring(s):
    """A quarter of a ring, nodes closer to each other at its hole."""
    r = 1.0 + 3.0 * s[0] ** 1.5
    angle = 0.5 * jnp.pi * s[1]
    return r * jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def ring_(s):
    return ring(jnp.stack([0.05 + 0.95 * s[0], s[1]]))


def moved(cloud, seed, size=0.25):
    """A cloud of an outline, its inner nodes moved."""
    X, rim = np.array(cloud.X), np.asarray(cloud.rim.edge)
    inner = np.setdiff1d(np.arange(len(X)), rim)
    shift = np.random.default_rng(seed).uniform(-size, size, X[inner].shape)
    X[inner] += shift
    return X, rim


@functools.lru_cache
def bodies():
    box = mapped((9, 7), lambda s: s, jitter=0.3, seed=2)
    quarter = mapped((8, 9), ring_, jitter=0.2, seed=1)
    out = [(np.asarray(c.X), np.asarray(c.rim.edge)) for c in (box, quarter)]
    out += [moved(l_shape()[0], 1), moved(plate(), 2)]
    return out


@pytest.mark.parametrize("body", range(4))
def test_cells_fill_the_body(body):
    X, edge = bodies()[body]
    cells = dual(X, edge)
    volume, centroid, spread = map(np.asarray, moments(jnp.asarray(X), cells))
    whole = polygon_moments(X, edge, 2)
    assert volume.min() > 0
    assert volume.sum() == pytest.approx(whole[0], rel=1e-13)
    first = (volume[:, None] * centroid).sum(axis=0)
    assert np.allclose(first, whole[1:3], rtol=1e-12, atol=1e-13 * whole[0])
    second = spread + centroid[:, :, None] * centroid[:, None]
    second = (volume[:, None, None] * second).sum(axis=0)
    exact = [2 * whole[3], whole[4], 2 * whole[5]]
    got = second[[0, 0, 1], [0, 1, 1]]
    assert np.allclose(got, exact, rtol=1e-12)
    assert np.linalg.eigvalsh(spread).min() > 0


@pytest.mark.parametrize("body", range(4))
def test_faces_close_each_cell(body):
    X, edge = bodies()[body]
    cells, n = dual(X, edge), len(X)
    normal = np.asarray(face_points(jnp.asarray(X), cells)[1].sum(axis=0))
    flux, face = np.zeros((n, 2)), np.asarray(cells.face)
    np.add.at(flux, face[:, 2], normal)
    np.add.at(flux, face[:, 3], -normal)
    # what is missing are the halves of the edges of the outline
    half = 0.5 * (X[edge[:, 1]] - X[edge[:, 0]]) @ [[0.0, -1.0], [1.0, 0.0]]
    missing = np.zeros((n, 2))
    np.add.at(missing, edge[:, 0], half)
    np.add.at(missing, edge[:, 1], half)
    assert np.allclose(flux, -missing, rtol=0, atol=1e-12)


def test_inner_cells_are_voronoi():
    X, edge = bodies()[0]
    volume = np.asarray(moments(jnp.asarray(X), dual(X, edge))[0])
    found = Voronoi(X)
    depth = np.min([X, 1 - X], axis=(0, 2))
    inner = np.flatnonzero(depth > 0.3)
    assert len(inner) > 5
    for i in inner:
        at = found.vertices[found.regions[found.point_region[i]]]
        at = at[np.argsort(np.arctan2(*(at - X[i]).T[::-1]))]
        a, b = at, np.roll(at, -1, axis=0)
        area = 0.5 * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()
        assert volume[i] == pytest.approx(area, rel=1e-11)


def test_derivative_in_the_nodes():
    X, edge = bodies()[2]
    cells = dual(X, edge)

    @jax.jit
    def total(X):
        volume, centroid, spread = cell_moments(X, cells)
        return jnp.sum(volume**2) + jnp.sum(centroid**3) + jnp.sum(spread**2)

    slope = jax.jit(jax.grad(total))(jnp.asarray(X))
    way = np.random.default_rng(0).normal(size=X.shape)
    h = 1e-6
    difference = (total(X + h * way) - total(X - h * way)) / (2 * h)
    assert float(jnp.sum(slope * way)) == pytest.approx(float(difference), rel=1e-6)


def test_a_bar():
    X = np.array([[0.3], [1.0], [0.0], [0.55]])
    volume, centroid, spread = moments(jnp.asarray(X), dual(X, None))
    assert np.allclose(volume, [0.275, 0.225, 0.15, 0.35], rtol=0, atol=1e-15)
    assert np.allclose(centroid[:, 0], [0.2875, 0.8875, 0.075, 0.6], atol=1e-15)
    assert np.allclose(spread[:, 0, 0], volume**2 / 12, rtol=1e-12)


def test_refusals():
    # a node so near to the outline that an edge is no longer Delaunay's
    at = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, -0.3], [0.5, 0.5]], float)
    with pytest.raises(ValueError, match="edges of the outline are none of theirs"):
        dual(at, np.array([[0, 1], [1, 2], [2, 3], [3, 0]]))
    # a slit so thin that triangles bridge it
    X = np.array([[0, 0], [4, 0], [4, 3], [2.2, 3], [2, 0.2], [1.8, 3], [0, 3]], float)
    X = np.concatenate([X, [[1.0, 1.0], [3.0, 1.0]]])
    cloud = outlined(X, [range(7)])
    with pytest.raises(ValueError, match="nearer to each other"):
        triangulate(X, np.asarray(cloud.rim.edge))
