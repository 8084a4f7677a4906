"""The outline of a plane body: directed edges between boundary nodes, body on the left.

An outline is a polygon with its nodes; curved boundaries are its chords. It is what
integration over a body of nodes needs: area and moments, the share of a full angle
inside the body at each node, straight runs of edges.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxpd._types import PointScalar, namespace
from jaxpd.checks import numbers, real
from jaxpd.geometry.cloud import Cloud, from_points
from jaxpd.geometry.rim import Rim, rim

#: Sine of the angle between edges up to which a run is straight.
STRAIGHT = 1e-9


def loop_edges(loops: Sequence[ArrayLike]) -> NDArray[np.integer]:
    """Edges [s, 2] of closed loops of numbers of nodes."""
    every = [np.asarray(loop, int) for loop in loops]
    return np.concatenate([np.stack([at, np.roll(at, -1)], 1) for at in every])


def outlined(X: ArrayLike, loops: Sequence[ArrayLike]) -> Cloud:
    """A plane cloud of nodes with its outline, for methods that need only nodes.

    Args:
        X: positions [n, 2] (m).
        loops: numbers of the nodes around the body counter-clockwise, and of those
            around each hole clockwise.

    Returns:
        A cloud with a rim. Volumes are shares of the area by angle inside the body and
        local spacing squared (paper 004, eq. 18).

    Raises:
        ValueError: on loops that repeat nodes or run the wrong way round, and on nodes
            outside.
    """
    nodes = np.asarray(numbers("X", X, cure="positions [n, 2]"), float)
    if nodes.ndim != 2 or nodes.shape[1] != 2:
        raise ValueError(f"X: shape {nodes.shape} must be [n, 2]; outlines are plane")
    for loop in loops if isinstance(loops, list | tuple) else [None]:
        found = real(loop)
        if found is None or found.ndim != 1 or found.dtype.kind == "f":
            raise ValueError(
                f"loops: {loop!r} must be numbers of nodes, in a list of loops"
            )
    if not len(loops):
        raise ValueError("loops: none; give at least the outer one")
    edge = loop_edges(loops)
    if not ((edge >= 0) & (edge < len(nodes))).all():
        raise ValueError(f"loops: they name nodes beyond 0..{len(nodes) - 1}")
    if len(np.unique(edge[:, 0])) != len(edge):
        raise ValueError("loops: a node appears twice; loops may not touch")
    area = float(polygon_moments(nodes, edge, 0)[0])
    if not area > 0:
        raise ValueError(
            f"loops: they enclose {area:.3g} m^2; the outer one must run "
            "counter-clockwise, holes clockwise"
        )
    _check_loops(nodes, loops, edge)
    return dataclasses.replace(
        from_points(nodes, np.full(len(nodes), area / len(nodes))),
        rim=outline_rim(nodes, edge),
    )


def _check_loops(X: np.ndarray, loops: Sequence[ArrayLike], edge: np.ndarray) -> None:
    """Refuse loops that run the wrong way round, and nodes outside the body."""
    every = [loop_edges([loop]) for loop in loops]
    for k, own in enumerate(every):
        size = float(polygon_moments(X, own, 0)[0])
        others = [e for m, e in enumerate(every) if m != k]
        start = X[own[:1, 0]]
        hole = bool(others) and bool(inside(start, X, np.concatenate(others))[0])
        if len(own) < 3 or not (size < 0 if hole else size > 0):
            raise ValueError(
                f"loops: number {k} of {len(own)} nodes encloses {size:.3g} m^2 as "
                f"{'a hole' if hole else 'an outer loop'}; outer ones must run "
                "counter-clockwise, holes clockwise, with three nodes or more"
            )
    within = inside(X, X, edge)
    within[edge[:, 0]] = True
    if not within.all():
        bad = int(np.argmin(within))
        raise ValueError(
            f"X: node {bad} at {X[bad]} lies outside the loops; leave it out, or put "
            "it on one of them"
        )


def inside(
    at: np.ndarray, X: np.ndarray, edge: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """Whether places [q, 2] lie in an outline: an odd number of edges above. Host."""
    out = np.zeros(len(at), bool)
    for a, b in X[edge]:
        if a[0] == b[0]:
            continue
        between = (at[:, 0] < max(a[0], b[0])) & (at[:, 0] >= min(a[0], b[0]))
        height = a[1] + (at[:, 0] - a[0]) * ((b[1] - a[1]) / (b[0] - a[0]))
        out ^= between & (at[:, 1] < height)
    return out


def outline_rim(X: NDArray[np.floating], edge: NDArray[np.integer]) -> Rim:
    """The rim of directed edges: half of each edge belongs to either end.

    Halves of a straight run make one entry of its inner nodes.
    """
    along = X[edge[:, 1]] - X[edge[:, 0]]
    length = np.linalg.norm(along, axis=1)
    if not (length > 0).all():
        bad = edge[int(np.argmin(length))]
        raise ValueError(f"loops: nodes {bad[0]} and {bad[1]} coincide")
    normal = np.stack([along[:, 1], -along[:, 0]], axis=1) / length[:, None]
    after = np.full(len(X), -1)
    after[edge[:, 0]] = np.arange(len(edge))
    follow = after[edge[:, 1]]
    turn = normal[:, 0] * normal[follow, 1] - normal[:, 1] * normal[follow, 0]
    smooth = (np.abs(turn) <= STRAIGHT) & ((normal * normal[follow]).sum(axis=1) > 0)
    node, normals, areas = [], [], []
    for s, (_, b) in enumerate(edge):
        t = follow[s]
        if smooth[s]:
            node.append(b)
            normals.append(normal[s])
            areas.append(0.5 * (length[s] + length[t]))
        else:
            node += [b, b]
            normals += [normal[s], normal[t]]
            areas += [0.5 * length[s], 0.5 * length[t]]
    made = rim(np.array(node), np.array(normals), np.array(areas))
    return dataclasses.replace(made, edge=jnp.asarray(edge.astype(np.int32)))


def angles(X: Any, edge: Any) -> tuple[PointScalar, PointScalar]:
    """Where the body begins at each node and how far it goes round [n] (rad).

    Angles from the edge that leaves a node counter-clockwise to the one that arrives,
    in (0, 2 pi); 0 and 2 pi at inner nodes. Traced in X. Paper 004's eq. 32 has cos^-1
    of |dx|, which loses the side: straight edges would have no body at all.
    """
    xp = namespace(X)
    n = X.shape[0]
    away, back = xp.zeros((n, 2)), xp.zeros((n, 2))
    along = X[edge[:, 1]] - X[edge[:, 0]]
    if xp is np:
        away[edge[:, 0]], back[edge[:, 1]] = along, -along
        on = np.zeros(n, bool)
        on[np.asarray(edge).ravel()] = True
    else:
        away = away.at[edge[:, 0]].set(along)
        back = back.at[edge[:, 1]].set(-along)
        on = jnp.zeros(n, bool).at[edge.ravel()].set(True)
    one = xp.asarray([1.0, 0.0])[None]
    away, back = xp.where(on[:, None], away, one), xp.where(on[:, None], back, one)
    start = xp.arctan2(away[:, 1], away[:, 0])
    sweep = xp.mod(xp.arctan2(back[:, 1], back[:, 0]) - start, 2.0 * np.pi)
    return xp.where(on, start, 0.0), xp.where(on, sweep, 2.0 * np.pi)


def polygon_moments(X: Any, edge: Any, degree: int = 2) -> Any:
    """Integrals of 1, x, y, x^2 / 2, x y, y^2 / 2 over the body, up to a degree.

    By the divergence theorem, exact; in the order and with the factorials of
    `jaxpd.discretize.moments`. Traced in X.
    """
    xp = namespace(X)
    a, b = X[edge[:, 0]], X[edge[:, 1]]
    cross = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    c, e = a - a[:1], b - a[:1]  # far from the origin the area would be lost
    out = [0.5 * (c[:, 0] * e[:, 1] - c[:, 1] * e[:, 0]).sum()]
    if degree > 0:
        out += [(cross * (a[:, k] + b[:, k])).sum() / 6.0 for k in (0, 1)]
    if degree > 1:
        for k, m in ((0, 0), (0, 1), (1, 1)):
            mixed = a[:, k] * a[:, m] + b[:, k] * b[:, m]
            mixed = 2.0 * mixed + a[:, k] * b[:, m] + b[:, k] * a[:, m]
            out.append((cross * mixed).sum() / (48.0 if k == m else 24.0))
    return xp.stack(out)


def straight_runs(
    X: NDArray[np.floating], edge: NDArray[np.integer]
) -> list[NDArray[np.integer]]:
    """Edges of each straight run in order, as numbers of `edge`. Host only."""
    along = X[edge[:, 1]] - X[edge[:, 0]]
    along = along / np.linalg.norm(along, axis=1)[:, None]
    after = {int(e[0]): s for s, e in enumerate(edge)}
    follow = np.array([after[int(e[1])] for e in edge])
    turn = along[:, 0] * along[follow, 1] - along[:, 1] * along[follow, 0]
    on = (np.abs(turn) <= STRAIGHT) & ((along * along[follow]).sum(axis=1) > 0)
    first = np.flatnonzero(~on[np.argsort(follow)])  # nobody goes straight on to these
    runs = []
    for s in first:
        run = [int(s)]
        while on[run[-1]]:
            run.append(int(follow[run[-1]]))
        runs.append(np.array(run))
    return runs
