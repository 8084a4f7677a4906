"""Cells of nodes, made from the nodes alone: the dual of their Delaunay triangles.

The cell of a node is the polygon of the centres of its triangles: circumcentres, which
makes Voronoi cells, and centroids where a circumcentre would fall over the boundary.
Cells of boundary nodes end at the outline. In 1-D cells end halfway between nodes.

Which triangles there are is found on the host and frozen; positions of corners, areas
and moments are traced in the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import Delaunay

from jaxpd._types import PointScalar, PointVector, namespace
from jaxpd.geometry.outline import inside, polygon_moments

#: Share of a triangle's height above the boundary that its centre keeps.
INSIDE = 0.05


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Dual:
    """Cells of nodes and the faces between them; topology, frozen.

    Attributes:
        triangle: nodes of each triangle [t, 3], counter-clockwise; in 1-D of each
            interval [t, 2], from left to right.
        middle: whether the centre of a triangle is its centroid [t].
        edge: nodes of each edge of the outline [s, 2].
        face: of each face between two cells its ends and those cells [f, 4]: corner
            where it begins and ends, the cell on its left and on its right. Corners are
            centres [t], then midpoints of edges [s]. In 1-D the corner counts twice.
    """

    triangle: jax.Array
    middle: jax.Array
    edge: jax.Array
    face: jax.Array


def triangulate(X: ArrayLike, edge: ArrayLike) -> NDArray[np.integer]:
    """Delaunay triangles [t, 3] of nodes inside an outline. Host only.

    Raises:
        ValueError: if an edge of the outline is not one of theirs, or they do not fill
            the body.
    """
    nodes, rim = np.asarray(X, float), np.asarray(edge, int)
    found = Delaunay(nodes).simplices
    a, b, c = (nodes[found[:, k]] for k in range(3))
    double = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    found = np.where((double < 0)[:, None], found[:, ::-1], found)
    size = np.abs(double)
    longest = np.max([((b - a) ** 2).sum(1), ((c - b) ** 2).sum(1)], axis=0)
    kept = (size > 1e-9 * longest) & inside((a + b + c) / 3.0, nodes, rim)
    found, area = found[kept], 0.5 * size[kept].sum()
    whole = float(polygon_moments(nodes, rim, 0)[0])
    n = len(nodes)
    sides = np.concatenate([found[:, [k, (k + 1) % 3]] for k in range(3)])
    missing = ~np.isin(rim[:, 0] * n + rim[:, 1], sides[:, 0] * n + sides[:, 1])
    if missing.any() or abs(area - whole) > 1e-9 * whole:
        bad = rim[np.argmax(missing)] if missing.any() else rim[0]
        raise ValueError(
            f"X: Delaunay's triangles fill {area:.6g} of {whole:.6g} m^2, and "
            f"{missing.sum()} edges of the outline are none of theirs"
            + (f" (the first from node {bad[0]} to {bad[1]})" if missing.any() else "")
            + "; put nodes of the boundary nearer to each other, or inner nodes farther"
            " from it"
        )
    return found


def dual(X: ArrayLike, edge: Any) -> Dual:
    """The cells of nodes [n, d] (m) in an outline [s, 2], None in 1-D. Host only."""
    nodes = np.asarray(X, float)
    if nodes.shape[1] == 1:
        order = np.argsort(nodes[:, 0], kind="stable")
        pair = np.stack([order[:-1], order[1:]], axis=1)
        corner = np.arange(len(pair))
        face = np.stack([corner, corner, pair[:, 0], pair[:, 1]], axis=1)
        none = np.zeros((0, 2), int)
        return _frozen(pair, np.ones(len(pair), bool), none, face)
    rim = np.asarray(edge, int)
    triangle = triangulate(nodes, rim)
    n, t = len(nodes), np.arange(len(triangle))
    side = np.concatenate([triangle[:, [k, (k + 1) % 3]] for k in range(3)])
    of, across = (
        np.tile(t, 3),
        np.concatenate([triangle[:, (k + 2) % 3] for k in range(3)]),
    )
    key = side[:, 0] * n + side[:, 1]
    order = np.argsort(key)
    # inner edges: the same from the other side
    back = side[:, 1] * n + side[:, 0]
    at = np.minimum(np.searchsorted(key[order], back), len(key) - 1)
    other = np.where(key[order][at] == back, order[at], -1)
    once = (other >= 0) & (side[:, 0] < side[:, 1])
    # seen from its first node an edge is crossed from the right triangle to the left
    inner = np.stack([of[other[once]], of[once], side[once, 0], side[once, 1]], axis=1)
    at = order[np.searchsorted(key[order], rim[:, 0] * n + rim[:, 1])]
    mid = len(triangle) + np.arange(len(rim))
    outer = np.stack([mid, of[at], rim[:, 0], rim[:, 1]], axis=1)
    share = barycentric(nodes, triangle)
    middle = np.zeros(len(triangle), bool)
    height = share[of[at], np.argmax(triangle[of[at]] == across[at][:, None], axis=1)]
    middle[of[at[height < INSIDE]]] = True
    return _frozen(triangle, middle, rim, np.concatenate([inner, outer]))


def _frozen(*arrays: np.ndarray) -> Dual:
    kind = [np.int32, bool, np.int32, np.int32]
    return Dual(*(jnp.asarray(x.astype(k)) for x, k in zip(arrays, kind, strict=True)))


def barycentric(X: Any, triangle: Any) -> Any:
    """Barycentric coordinates [t, 3] of the circumcentres of triangles."""
    xp = namespace(X)
    corner = X[triangle]
    squares = []
    for k in range(3):
        far = corner[:, (k + 1) % 3] - corner[:, (k + 2) % 3]
        squares.append((far * far).sum(axis=1))
    square = xp.stack(squares, axis=1)
    share = square * (square.sum(axis=1, keepdims=True) - 2.0 * square)
    return share / share.sum(axis=1, keepdims=True)


def corners(X: PointVector, dual: Dual) -> PointVector:
    """Positions of the corners of cells [c, d] (m). Traced."""
    at = X[dual.triangle]
    if X.shape[1] == 1:
        return at.mean(axis=1)
    share = jnp.where(dual.middle[:, None], 1.0 / 3.0, barycentric(X, dual.triangle))
    centre = jnp.einsum("tk,tka->ta", share, at)
    return jnp.concatenate([centre, X[dual.edge].mean(axis=1)])


#: Gauss's points of a face, over its length.
FACE = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)


def face_points(X: PointVector, dual: Dual) -> tuple[jax.Array, jax.Array]:
    """Places [p, f, d] on the faces of cells, and normals times weights. Traced.

    Normals point from the cell on the left to the one on the right.
    """
    corner = corners(X, dual)
    begin, end = corner[dual.face[:, 0]], corner[dual.face[:, 1]]
    if X.shape[1] == 1:
        return begin[None], jnp.ones_like(begin)[None]
    along = end - begin
    place = begin[None] + jnp.asarray(FACE)[:, None, None] * along[None]
    normal = 0.5 * jnp.stack([along[:, 1], -along[:, 0]], axis=1)
    return place, jnp.broadcast_to(normal, place.shape)


def cell_moments(X: PointVector, dual: Dual) -> tuple[PointScalar, Any, Any]:
    """Volume [n], centroid [n, d] and covariance [n, d, d] of each cell. Traced.

    From the pyramids over its faces with their tips at the node; edges of the outline
    pass through it and have none.
    """
    n, d = X.shape
    corner = corners(X, dual)
    begin, end = corner[dual.face[:, 0]], corner[dual.face[:, 1]]
    volume: Any = jnp.zeros(n)
    first, second = jnp.zeros((n, d)), jnp.zeros((n, d, d))
    for column, sign in ((2, 1.0), (3, -1.0)):
        cell = dual.face[:, column]
        a, b = begin - X[cell], end - X[cell]
        if d == 1:
            size = sign * a[:, 0]
            one, two = a / 2.0, a[:, :, None] * a[:, None, :] / 3.0
        else:
            size = 0.5 * sign * (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
            one = (a + b) / 3.0
            two = a[:, :, None] * a[:, None] + b[:, :, None] * b[:, None]
            both = (a + b)[:, :, None] * (a + b)[:, None]
            two = (two + both) / 12.0
        volume = volume.at[cell].add(size)
        first = first.at[cell].add(size[:, None] * one)
        second = second.at[cell].add(size[:, None, None] * two)
    mean = first / volume[:, None]
    spread = second / volume[:, None, None] - mean[:, :, None] * mean[:, None, :]
    return volume, X + mean, spread
