"""One quadrature of the boundary, for consistency, tractions and supports alike.

Each half of an edge of the outline belongs to the cell of its node and has points of
its own: two of Gauss where it is free; where it is held the nearest nodes of its
straight run, four or as many as there are. Shape functions are taken there and between
them interpolated; what multiplies them, a traction or a stress, is taken at the centre
of the interpolating polynomial, which is exact for linear ones. Test functions vanish
at held nodes, so that nothing is left of the unknown tractions there: a linear stress
does no work at the support, which is what a quadratic patch test asks. It asks for runs
of three nodes, too: a held edge alone, as on the chords of a curve, has two, where
linear fields are as good as exact and quadratic ones are not.

In 1-D the boundary is two points.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike

from jaxpd._types import PointScalar, PointVector
from jaxpd.geometry.outline import straight_runs

#: Nodes of a held edge's rule.
NODES = 4


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Boundary:
    """Points on the boundary; topology, frozen.

    Attributes:
        edge: ends of the edge that a point lies on [b, 2]; in 1-D the node twice.
        cell: node whose half it lies on [b].
        share: of the way along the edge [b]; NaN where the point is a node.
        node: the nodes of its rule [b, 4], of which it is the first where it is one;
            the same node again where the rule has fewer.
        size: of the rule, how many nodes [b]; 0 for Gauss.
        weight: of Gauss's rule, over the edge [b].
        outward: sign of the normal of a bar's end [b]; 0 beyond 1-D.
    """

    edge: jax.Array
    cell: jax.Array
    share: jax.Array
    node: jax.Array
    size: jax.Array
    weight: jax.Array
    outward: jax.Array


def boundary(X: ArrayLike, edge: Any, held: ArrayLike) -> Boundary:
    """The quadrature of an outline [s, 2]; edges between held nodes [n] take nodes.

    Host only. In 1-D `edge` is not read: the ends are where the nodes end.
    """
    nodes, mask = np.asarray(X, float), np.asarray(held, bool)
    if nodes.shape[1] == 1:
        ends = np.array([np.argmin(nodes[:, 0]), np.argmax(nodes[:, 0])])
        return _frozen(
            np.stack([ends, ends], 1), ends, np.full(2, np.nan),
            np.tile(ends[:, None], (1, NODES)), np.ones(2, int), np.ones(2),
            np.array([-1.0, 1.0]),
        )  # fmt: skip
    rim = np.asarray(edge, int)
    gauss = 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)
    rows: list[tuple[Any, ...]] = []
    stays: Any = mask[rim].all(axis=1)
    for run in straight_runs(nodes, rim):
        for at in _stretches(run, stays[run]):
            path = np.append(rim[at, 0], rim[at[-1], 1])
            if stays[at[0]]:
                size = min(NODES, len(path))
                for k, s in enumerate(at):
                    first = int(np.clip(k + 1 - size // 2, 0, len(path) - size))
                    rule = path[first : first + size]
                    for half in (0, 1):
                        for j in range(size):
                            own = np.roll(rule, -j)
                            own = np.append(own, [own[0]] * (NODES - size))
                            row = (np.nan, own, size, 0.0 if half == 0 else 0.5)
                            rows.append((rim[s], rim[s, half], *row))
                continue
            for s in at:
                none = np.full(NODES, rim[s, 0])
                for half in (0, 1):
                    for g in gauss:
                        row = (0.5 * (half + g), none, 0, 0.25)
                        rows.append((rim[s], rim[s, half], *row))
    edges, cell, share, rule, size, weight = map(np.array, zip(*rows, strict=True))
    return _frozen(edges, cell, share, rule, size, weight, np.zeros(len(rows)))


def _stretches(run: np.ndarray, stays: np.ndarray) -> list[np.ndarray]:
    """A run cut where held and free edges meet."""
    return np.split(run, np.flatnonzero(np.diff(stays.astype(int))) + 1)


def _frozen(*arrays: np.ndarray) -> Boundary:
    kind = [np.int32, np.int32, float, np.int32, np.int32, float, float]
    return Boundary(
        *(jnp.asarray(x.astype(k)) for x, k in zip(arrays, kind, strict=True))
    )


def boundary_points(
    X: PointVector, rule: Boundary
) -> tuple[PointVector, PointVector, PointScalar, PointVector]:
    """Points of the boundary. Traced.

    Returns:
        Places of the shape functions [b, d] (m), places of what multiplies them, which
        lie in the same half edge [b, d] (m), weights [b] (m^(d-1)) and outward normals
        [b, d].
    """
    begin, end = X[rule.edge[:, 0]], X[rule.edge[:, 1]]
    if X.shape[1] == 1:
        return begin, begin, jnp.ones(len(begin)), rule.outward[:, None]
    along = end - begin
    square = jnp.sum(along * along, axis=1)
    length = jnp.sqrt(square)
    normal = jnp.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    at_node = rule.size > 0
    share = jnp.where(at_node, 0.0, rule.share)
    place = begin + share[:, None] * along
    place = jnp.where(at_node[:, None], X[rule.node[:, 0]], place)
    # the weight of the first node of a rule: the integral over a half of the polynomial
    # that is one there and zero at the others
    t = jnp.einsum("bja,ba->bj", X[rule.node] - begin[:, None], along)
    t = t / square[:, None]
    used = jnp.arange(NODES)[None] < rule.size[:, None]
    low = jnp.where(at_node, rule.weight, 0.0)
    poly = jnp.zeros((len(t), NODES)).at[:, 0].set(1.0)  # coefficients, rising
    for j in range(1, NODES):
        gap = jnp.where(used[:, j], t[:, 0] - t[:, j], 1.0)
        times = jnp.roll(poly, 1, axis=1).at[:, 0].set(0.0) - t[:, j : j + 1] * poly
        poly = jnp.where(used[:, j : j + 1], times / gap[:, None], poly)
    up = jnp.arange(1, NODES + 1)[None]
    ends = (low[:, None] + 0.5) ** up - low[:, None] ** up
    nodal = jnp.sum(poly * ends / up, axis=1)
    # its centre: it keeps its sign between two nodes of the rule
    more = (low[:, None] + 0.5) ** (up + 1) - low[:, None] ** (up + 1)
    first = jnp.sum(poly * more / (up + 1), axis=1)
    safe = jnp.where(at_node, nodal, 1.0)
    share = jnp.where(at_node, first / safe, rule.share)
    middle = begin + share[:, None] * along
    return place, middle, length * jnp.where(at_node, nodal, rule.weight), normal
