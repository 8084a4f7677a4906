"""Topology of a weak form on nodes: which nodes reach which cells. Host only.

A weak form is sampled at g places in each of c cells (`jaxpd.discretize.quadrature`).
Shape functions are evaluated at all places of interest in one sweep: those of the
rule, the faces between cells where gradients are smoothed, the boundary, the nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.compiling import quickly
from jaxpd.discretize.boundary import Boundary, boundary, boundary_points
from jaxpd.discretize.dual import face_points
from jaxpd.discretize.quadrature import Rule, places_of, quadrature, shares
from jaxpd.discretize.rkpm import Cover, find_cover, radii
from jaxpd.discretize.schemes import Scheme
from jaxpd.geometry import Cloud

#: Lists of nodes are padded to multiples of this: bodies alike compile once.
ROUND = 8


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Slots:
    """Where the nodes that reach some places are in the list of a cell.

    Attributes:
        cell: of each place [q].
        slot: of each of its nodes [k, q]; out of range where padded.
    """

    cell: jax.Array
    slot: jax.Array

    def put(self, values: jax.Array, shape: tuple[int, int]) -> jax.Array:
        """Sums [.., K, c] by cell of values [.., k, q] at the places of cells."""
        out = jnp.zeros((*values.shape[:-2], *shape), values.dtype)
        return out.at[..., self.slot, self.cell[None]].add(values, mode="drop")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class CellLayout:
    """Topology of a weak form, frozen.

    Attributes:
        rule: where it is sampled.
        boundary: its quadrature.
        cover: of all places, those of the rule cell by cell [g c] first, then of the
            faces between cells, of the boundary and of the nodes.
        nodes_of: nodes that reach each cell [K, c], int32, padded with the first.
        within: slots of the places of the rule.
        beside: slots of the places on faces in the cells on their left and right.
        along: slots of the places of the boundary in the cells of their nodes.
        held: nodes with a prescribed component [h], int32.
        ends: where the places of the rule, faces, boundary and nodes end.
        degree: of the basis.
        scheme: how gradients are made.
    """

    rule: Rule
    boundary: Boundary
    cover: Cover
    nodes_of: jax.Array
    within: Slots
    beside: tuple[Slots, ...]
    along: Slots | None
    held: jax.Array
    ends: tuple[int, ...] = field(metadata={"static": True})
    degree: int = field(metadata={"static": True})
    scheme: Scheme = field(metadata={"static": True})


def lay_out_cells(
    cloud: Cloud, held: np.ndarray, scheme: Scheme, degree: int, support: float
) -> CellLayout:
    """Cells, covers and boundary of a cloud with an outline.

    Args:
        cloud: nodes with a rim; in 2-D with its edges.
        held: mask of nodes with a prescribed component [n].
        scheme: of integration.
        degree: of the basis.
        support: radius of a kernel over the local spacing.

    Raises:
        ValueError: beyond 2-D or without an outline; from triangles, covers and rules.
    """
    X = np.asarray(cloud.X)
    n, d = X.shape
    edge = None if cloud.rim is None else cloud.rim.edge
    if d > 2 or (d == 2 and edge is None):
        raise ValueError(
            f"body: {d}-D; weak forms are sampled in 1-D, and in 2-D inside an outline:"
            " use a box, jaxpd.mapped(..) or jaxpd.outlined(X, loops)"
        )
    rule = quadrature(
        X,
        edge,
        scheme.rule,
        points=scheme.points,
        volumes=scheme.volumes,
        exact=scheme.exact,
    )
    line = boundary(X, edge, held)
    smooth = scheme.gradient != "direct"
    places, faces, rim = (
        np.asarray(x)
        for x in quickly(_places, static_argnames="smooth")(
            cloud.X, rule, line, smooth=smooth
        )
    )
    g, c = places.shape[:2]
    if not np.isfinite(places).all():  # only cells of nodes, whose covariances it takes
        bad = int(np.argmin(np.isfinite(places).all(axis=(0, 2))))
        raise ValueError(
            f"X: the cell of node {bad} at {X[bad]} folds; move its neighbours apart, "
            "or farther from the boundary, or use the scheme 'MNI'"
        )
    spots = [places.reshape(-1, d), faces.reshape(-1, d), rim, X]
    radius = radii(X, shares(X, np.asarray(rule.edge)), support, degree)
    cover = find_cover(np.concatenate(spots), X, radius, degree)
    ends = tuple(np.cumsum([len(x) for x in spots]).tolist())
    owner, span = [np.tile(np.arange(c), g)], [(0, ends[0])]
    if smooth:
        assert rule.dual is not None
        face = np.asarray(rule.dual.face)
        rows = len(spots[1]) // len(face)
        owner += [np.tile(face[:, 2], rows), np.tile(face[:, 3], rows)]
        owner += [np.asarray(line.cell)]
        span += [ends[:2], ends[:2], ends[1:3]]
    nodes_of, slots = _gather(cover, span, owner, n, c)
    at = np.flatnonzero(held).astype(np.int32)
    along = slots[3] if smooth else None
    beside, here = tuple(slots[1:3]), jnp.asarray(at)
    return CellLayout(
        rule, line, cover, nodes_of, slots[0], beside, along, here, ends, degree, scheme
    )


def _places(X: Any, rule: Rule, line: Boundary, smooth: bool) -> tuple[Any, Any, Any]:
    """Places of the rule [g, c, d], on faces [p, f, d], on the boundary [b, d]."""
    none = jnp.zeros((0, 0, X.shape[1]))
    faces = face_points(X, rule.dual)[0] if smooth and rule.dual is not None else none
    return places_of(X, rule)[0], faces, boundary_points(X, line)[0]


def _gather(
    cover: Cover, span: list[Any], owner: list[np.ndarray], n: int, c: int
) -> tuple[jax.Array, list[Slots]]:
    """The nodes of each cell [K, c], and where those of some places are among them."""
    nbr, there = np.asarray(cover.nbr, np.int64), np.asarray(cover.there)
    keys = [
        np.where(there[:, a:b], own[None] * n + nbr[:, a:b], -1)
        for (a, b), own in zip(span, owner, strict=True)
    ]
    pairs = np.sort(np.concatenate([key[key >= 0] for key in keys]))
    pairs = pairs[np.append(True, np.diff(pairs) > 0)]
    of, node = np.divmod(pairs, n)
    first = np.searchsorted(of, np.arange(c))
    rank = np.arange(len(pairs)) - first[of]
    K = -(-int(rank.max() + 1) // ROUND) * ROUND
    nodes_of = np.tile(node[first], (K, 1))
    nodes_of[rank, of] = node
    slots = []
    for key, own in zip(keys, owner, strict=True):
        at = np.searchsorted(pairs, np.maximum(key, pairs[0]))
        slot = np.where(key >= 0, rank[at], K)
        slots.append(
            Slots(jnp.asarray(own.astype(np.int32)), jnp.asarray(slot.astype(np.int32)))
        )
    return jnp.asarray(nodes_of.astype(np.int32)), slots
