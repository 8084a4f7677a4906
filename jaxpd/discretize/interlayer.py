"""Ghost interlayers: points between two plies, bonded to both.

A ghost has no mass and no freedom of its own: it is the average of the points of both
faces around it, half from each side,

    u_I = sum_k w_k u_k,    sum_A w = sum_B w = 1/2,

the nearest one of each face on matching lattices, a (multi)linear interpolation on
others. It is bonded to all points of the two plies within a horizon. The energy is that
of these bonds, so what pulls at a ghost is handed on to the points that make it: both
momenta are kept, since y_I = sum w y, and the stiffness is symmetric. Paper 002, eq. 13
leaves that reaction out. A second, central spring of each ghost joins the averages of
the two faces, where a shear modulus is asked for.

    unit     stiffness of the bonds, 1 N/m^3 between rigid plies on each side [k, q] m^2
    area     of the interlayer that a ghost stands for [q] m^(d-1)

Source: Y. D. Ha (2019), paper 002, sections 2.2 and 3; the variational form is ours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from jaxpd.discretize.facing import Face, interpolate, places
from jaxpd.discretize.surface import relative_volumes
from jaxpd.geometry.cloud import Cloud
from jaxpd.geometry.crack import Crack
from jaxpd.geometry.family import HORIZON_TOLERANCE, partial_volume
from jaxpd.geometry.grid_family import find_on_grid, offset_shares

Floats = NDArray[np.floating]
Indices = NDArray[np.integer]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Joint:
    """The ghosts of one interlayer, and the points that they touch.

    Attributes:
        points: numbers of the touched points [p] among all points.
        X: their reference positions [p, d] (m).
        ends: at the other end of each ghost's bonds [k, q], among the p; 0 if padded.
        xi: bond vectors from ghost to end [k, d, q] (m); never zero.
        unit: stiffness of the bonds, see the module [k, q]; 0 where padded.
        share: volume of a ghost within the horizon of the end [k, q] (m^d).
        sources: points that a ghost is the average of [q, w], among the p.
        weights: of that average [q, w] (-).
        arms: y_B - y_A is the sum of arms times positions [q, w] (-).
        across: reference value of y_B - y_A [d, q] (m).
        area: of the interlayer [q] (m^(d-1)).
        intact: ghosts that no crack cuts [q].
        rigid: normal stiffness between rigid plies at `unit` [q] (N/m^3).
        beside: the ghosts before and after each, along the axes of the layer, itself
            where there is none [d - 1, 2, q].
    """

    points: Indices
    X: Floats
    ends: Indices
    xi: Floats
    unit: Floats
    share: Floats
    sources: Indices
    weights: Floats
    arms: Floats
    across: Floats
    area: Floats
    intact: NDArray[np.bool_]
    rigid: Floats
    beside: Indices

    @property
    def places(self) -> Floats:
        """Reference positions of the ghosts [q, d] (m); host."""
        return np.einsum("qw,qwd->qd", self.weights, self.X[self.sources])


def join(
    below: Face,
    above: Face,
    *,
    paper: float | None = None,
    cracks: Sequence[Crack] = (),
) -> Joint:
    """The ghosts between two plies. Host only.

    There is one for each surface point of the finer face where both faces lie.

    Args:
        below: the lower ply.
        above: the upper ply.
        paper: micromodulus over modulus (m^-(d+1)) of the rule "paper": bonds of that
            stiffness times the ghost's volume, thickness times area, corrected by eq.
            7 where the faces say so; else the bonds of each ghost are scaled,
            side by side, to 1 N/m^3 between rigid plies.
        cracks: bonds that they cut are missing, ghosts that they part are broken.

    Raises:
        ValueError: if a horizon does not reach across half the gap.
    """
    axis, faces = below.axis, (below, above)
    fine = below if below.grid.dx <= above.grid.dx * (1 + 1e-9) else above
    across = above.height - below.height
    for face in faces:
        if 0.5 * across > face.delta * (1 + HORIZON_TOLERANCE):
            raise ValueError(
                f"delta: {face.delta:g} reaches from a ghost in the middle of the gap "
                f"to no point of the ply at {0.5 * across:g}; a layer as thick as that "
                "is a ply: mesh it, or give interlayer(delta=..)"
            )
    middle = 0.5 * (above.height + below.height)
    ghosts, area, shape = places(fine, faces, middle)
    q, d = ghosts.shape
    made = [interpolate(face, ghosts) for face in faces]
    sources = np.concatenate([index for index, _ in made], axis=1)
    weights = np.concatenate([0.5 * weight for _, weight in made], axis=1)
    signs = [sign * weight for sign, (_, weight) in zip((-1, 1), made, strict=True)]
    arms = np.concatenate(signs, axis=1)
    volume = (above.plane - below.plane) * area
    sides = [_side(face, ghosts, area, volume, paper) for face in faces]
    numbers = np.concatenate([sources.ravel(), *(s.end.ravel() for s in sides)])
    points = np.unique(numbers)
    X = np.empty((len(points), d))
    for face in faces:
        own = (points >= face.first) & (points < face.first + len(face.X))
        X[own] = face.X[points[own] - face.first]
    ghost, end, unit, share = (
        np.concatenate([getattr(side, name) for side in sides])
        for name in ("ghost", "end", "unit", "share")
    )
    xi = X[np.searchsorted(points, end)] - ghosts[ghost]
    slope = (xi[:, axis] ** 2) / (xi**2).sum(axis=1)
    rigid = np.bincount(ghost, 0.25 * unit * slope, q) / area
    intact = np.ones(q, bool)
    keep = np.ones(len(end), bool)
    for crack in cracks:
        intact &= ~_parts(crack, X, np.searchsorted(points, sources), arms)
        both = np.concatenate([ghosts, X])
        keep &= ~crack.cuts(both, ghost, q + np.searchsorted(points, end))
    ghost, end, unit, share, xi = (x[keep] for x in (ghost, end, unit, share, xi))
    order = np.lexsort((end, ghost))
    count = np.bincount(ghost, minlength=q)
    slot = np.arange(len(order)) - np.repeat(np.cumsum(count) - count, count)

    def table(values: Any, empty: Any) -> Any:
        """Values of the bonds as [k, .., q], `empty` where padded."""
        shape = (int(count.max(initial=1)), q, *values.shape[1:])
        found = np.broadcast_to(empty, shape).astype(values.dtype)
        at: Any = (slot, ghost[order])
        found[at] = values[order]
        return np.moveaxis(found, 1, -1)

    padded = np.eye(d)[axis] * across
    local = np.searchsorted(points, sources).astype(np.int32)
    return Joint(
        points=points.astype(np.int32),
        X=X,
        ends=table(np.searchsorted(points, end).astype(np.int32), 0),
        xi=table(xi, padded),
        unit=table(unit, 0.0),
        share=table(share, 0.0),
        sources=local,
        weights=weights,
        arms=arms,
        across=np.einsum("qw,qwd->dq", arms, X[local]),
        area=area,
        intact=intact,
        rigid=rigid,
        beside=_beside(shape, axis),
    )


def _beside(shape: tuple[int, ...], axis: int) -> Indices:
    """Numbers of the ghosts before and after each along the axes of the layer."""
    number = np.arange(np.prod(shape), dtype=np.int32).reshape(shape)
    found = np.zeros((len(shape) - 1, 2, number.size), np.int32)
    for row, a in enumerate(x for x in range(len(shape)) if x != axis):
        last = shape[a] - 1
        for side, step in enumerate((-1, 1)):
            at = np.clip(np.arange(shape[a]) + step, 0, last)
            found[row, side] = number.take(at, axis=a).ravel()
    return found


def _parts(crack: Crack, X: Floats, sources: Indices, arms: Floats) -> NDArray:
    """Mask of the ghosts whose two faces a crack parts [q]."""
    sides = [
        np.einsum("qw,qwd->qd", np.maximum(sign * arms, 0.0), X[sources])
        / np.maximum(sign * arms, 0.0).sum(axis=1)[:, None]
        for sign in (-1, 1)
    ]
    here = np.arange(len(arms))
    return crack.cuts(np.concatenate(sides), here, len(arms) + here)


@dataclass(frozen=True, eq=False)
class _Side:
    """Bonds of all ghosts to one ply [b]: ghost, end, stiffness, share of a ghost."""

    ghost: Indices
    end: Indices
    unit: Floats
    share: Floats


def _side(
    face: Face, ghosts: Floats, area: Floats, volume: Floats, paper: float | None
) -> _Side:
    dx, delta, X = face.grid.dx, face.delta, face.X
    depth = np.abs(X[:, face.axis] - ghosts[0, face.axis])
    near = np.flatnonzero(depth <= delta + dx)
    rim = 0.5 * dx if face.partial == "continuous" else 0.0
    pairs = KDTree(ghosts).sparse_distance_matrix(
        KDTree(X[near]),
        delta * (1 + HORIZON_TOLERANCE) + rim,
        output_type="coo_matrix",
    )
    size: Any = dx
    beta: Any = partial_volume(pairs.data, delta, size, face.partial)
    alive = beta > 0.0
    ghost, end, r, beta = (
        x[alive] for x in (pairs.row, near[pairs.col], pairs.data, beta)
    )
    share = beta * volume[ghost]
    if paper is not None:
        unit = paper * share * dx ** X.shape[1] / r
        if face.corrected:
            # 2 V0 / (V + V_I): ghosts count in V, a ghost's own V_I is a whole one, and
            # V0 is that of the lattice (found by comparison)
            family = find_on_grid(
                Cloud(X, np.ones(len(X)), face.grid), delta, partial=face.partial
            )
            size = 1.0 + 2.0 * offset_shares(family, delta, dx).sum()
            v = np.asarray(relative_volumes(family, delta, dx, "lattice"))
            v = v + np.bincount(end, share, len(X)) / (size * dx ** X.shape[1])
            unit = unit * 2.0 / (v[end] + 1.0)
    else:
        held = beta / r * ((X[end] - ghosts[ghost])[:, face.axis] / r) ** 2
        total = np.bincount(ghost, held, len(ghosts))
        unit = 2.0 * area[ghost] * beta / r / total[ghost]
    return _Side(ghost, face.first + end, unit, share)
