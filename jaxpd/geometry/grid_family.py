"""Families of a lattice without index lists: offsets that all points share, less cuts.

Every bond is kept once, at the end from which its offset is lexicographically positive.
What is stored is the offsets, a few hundred triples of integers, and the list of bonds
that are missing inside the body: cut by a crack, or broken. A plate of a million points
has 98 offsets at m = 8 and not 98 million indices.

    offsets  steps from a point to its later neighbours   [k, d]  in spacings
    cut      (point, slot) of every missing bond          [2, b]  sorted by point

The same bonds as `jaxpd.geometry.family.find`, to the last one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from numpy.typing import NDArray

from jaxpd._types import namespace
from jaxpd.geometry.cloud import Cloud, Lattice
from jaxpd.geometry.crack import Crack, check_dimension
from jaxpd.geometry.family import HORIZON_TOLERANCE, PARTIAL_RULES, partial_volume


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class GridFamily:
    """Bonds of a lattice by offsets.

    Attributes:
        cut: point number and slot of every missing bond [2, b], int32, sorted.
        grid: the lattice.
        offsets: steps of the later neighbours of a point far from every boundary, k
            tuples of d integers.
        partial: rule of `jaxpd.geometry.family.partial_volume`.
    """

    cut: Any
    grid: Lattice = field(metadata={"static": True})
    offsets: tuple[tuple[int, ...], ...] = field(metadata={"static": True})
    partial: str = field(metadata={"static": True}, default="none")

    @property
    def shape(self) -> tuple[int, ...]:
        """Points along each axis."""
        return self.grid.shape

    @property
    def n(self) -> int:
        """Number of points."""
        return math.prod(self.shape)

    @property
    def steps(self) -> NDArray[np.int64]:
        """The offsets as an array [k, d]."""
        return np.asarray(self.offsets, int)

    @property
    def strides(self) -> NDArray[np.int64]:
        """How far a step along each axis moves the point number [d]."""
        return np.cumprod((1, *self.shape[:0:-1]))[::-1].astype(int)

    @property
    def reach(self) -> NDArray[np.int64]:
        """Longest step along each axis [d]."""
        return np.abs(self.steps).max(axis=0)

    @property
    def n_bonds(self) -> int:
        """Number of bonds, each counted once."""
        room = np.maximum(np.asarray(self.shape) - np.abs(self.steps), 0)
        return int(room.prod(axis=1).sum()) - self.cut.shape[1]

    def cut_ends(self) -> tuple[Any, Any]:
        """Point numbers of both ends of the missing bonds [b], [b]."""
        hop = (self.steps @ self.strides).astype(np.int32)
        i, slot = self.cut[0], self.cut[1]
        return i, i + (hop[slot] if isinstance(slot, np.ndarray) else _take(hop, slot))

    def ends(self, slots: NDArray[np.integer] | None = None):
        """Point numbers of both ends and slot of all bonds, or of some slots. Host."""
        here = np.arange(self.n, dtype=np.int32).reshape(self.shape)
        hop = self.steps @ self.strides
        chosen = range(len(self.offsets)) if slots is None else slots
        i = [here[inside(self.shape, self.offsets[s])].ravel() for s in chosen]
        slot = np.repeat(np.asarray(chosen, np.int32), [len(a) for a in i])
        i = np.concatenate(i)
        missing = np.asarray(self.cut)
        key = missing[0].astype(np.int64) * len(self.offsets) + missing[1]
        live = ~np.isin(i.astype(np.int64) * len(self.offsets) + slot, key)
        i, slot = i[live], slot[live]
        return i, (i + hop[slot]).astype(np.int32), slot


def _take(table: NDArray, index: Any) -> Any:
    return jax.numpy.asarray(table)[index]


def inside(shape: tuple[int, ...], step: Sequence[int]) -> tuple[slice, ...]:
    """The points whose neighbour at `step` lies on the lattice, as slices."""
    return tuple(
        slice(max(0, -s), max(0, min(n, n - s)))
        for n, s in zip(shape, step, strict=True)
    )


def half_offsets(d: int, m: float, partial: str) -> tuple[tuple[int, ...], ...]:
    """Lexicographically positive steps no longer than m spacings."""
    m = m * (1 + HORIZON_TOLERANCE) + 0.5 * (partial == "continuous")
    reach = math.floor(m)
    span = np.arange(-reach, reach + 1)
    steps = np.stack([g.ravel() for g in np.meshgrid(*[span] * d, indexing="ij")], 1)
    length = np.sqrt((steps**2).sum(axis=1))
    later = np.arange(len(steps)) > len(steps) // 2  # the middle is no step at all
    return tuple(map(tuple, steps[later & (length <= m)].tolist()))


def find_on_grid(
    cloud: Cloud, delta: float, *, partial: str = "none", cracks: Sequence[Crack] = ()
) -> GridFamily:
    """Find all bonds of a lattice shorter than the horizon that no crack cuts. Host.

    Args:
        cloud: the points, made by `jaxpd.geometry.lattice`.
        delta: horizon (m).
        partial: as in `jaxpd.geometry.family.find`.
        cracks: bonds that they cut are missing.

    Raises:
        ValueError: on a cloud that is no lattice, a horizon that is not positive or
            shorter than the spacing, or an unknown rule.
    """
    grid = cloud.lattice
    if grid is None:
        raise ValueError("cloud: not a lattice; use find() for points from elsewhere")
    if not (np.isfinite(delta) and delta > 0):
        raise ValueError(f"delta: {delta} must be a positive number")
    if partial not in PARTIAL_RULES:
        raise ValueError(f"partial: {partial!r} must be one of {PARTIAL_RULES}")
    offsets = half_offsets(len(grid.shape), delta / grid.dx, partial)
    fits = (np.abs(offsets).reshape(-1, len(grid.shape)) < grid.shape).all(axis=1)
    if not fits.any():
        raise ValueError(
            f"delta: no point has a bond with the horizon {delta:g}; make it larger "
            f"than the spacing {grid.dx:g}"
        )
    family = GridFamily(np.zeros((2, 0), np.int32), grid, offsets, partial)
    X = np.asarray(cloud.X).reshape(*grid.shape, -1)
    found = [_cut_by(crack, X, family) for crack in cracks]
    return without(family, np.concatenate(found, axis=1)) if found else family


def without(family: GridFamily, bonds: NDArray[np.integer]) -> GridFamily:
    """The family less more bonds, (point, slot) [2, b]. Host."""
    k = len(family.offsets)
    point, slot = np.asarray(bonds)
    to = np.stack(np.unravel_index(point, family.shape), axis=1) + family.steps[slot]
    if not ((to >= 0) & (to < family.shape)).all():
        raise ValueError("bonds: some lead off the lattice; take them from ends()")
    every = np.concatenate([np.asarray(family.cut), bonds], axis=1).astype(np.int64)
    key = np.unique(every[0] * k + every[1])
    cut = np.stack([key // k, key % k]).astype(np.int32)
    return GridFamily(cut, family.grid, family.offsets, family.partial)


def _cut_by(crack: Crack, X: NDArray, family: GridFamily) -> NDArray[np.int32]:
    """(point, slot) of the bonds that a crack cuts; looks near its plane alone."""
    shape, d = family.shape, len(family.shape)
    check_dimension([crack], d)
    reach = np.sqrt((family.steps**2).sum(axis=1).max()) * family.grid.dx * 1.001
    flat = X.reshape(-1, d)
    corners = np.asarray(crack.corner) + [
        np.asarray(t) @ np.asarray(crack.edges)
        for t in np.ndindex(*[2] * len(crack.edges))
    ]
    low, high = corners.min(axis=0) - reach, corners.max(axis=0) + reach
    box = []
    for a in range(d):
        axis = np.moveaxis(X[..., a], a, 0).reshape(shape[a], -1)[:, 0]
        at = np.flatnonzero((axis >= low[a]) & (axis <= high[a]))
        box.append(slice(at[0], at[-1] + 1) if len(at) else slice(0, 0))
    here = np.arange(family.n, dtype=np.int32).reshape(shape)[tuple(box)].ravel()
    height = (flat[here] - np.asarray(crack.corner)) @ crack.normal
    here = here[np.abs(height) <= reach]
    at = np.stack(np.unravel_index(here, shape), axis=1)
    above, found = crack.above(flat), [np.zeros((2, 0), np.int32)]
    for slot, step in enumerate(family.offsets):
        to = at + step
        ok = ((to >= 0) & (to < shape)).all(axis=1)
        i = here[ok]
        j = i + np.int32(step @ family.strides)
        across = above[i] != above[j]
        i, j = i[across], j[across]
        hit = i[crack.crosses(flat[i], flat[j])]
        found.append(np.stack([hit, np.full_like(hit, slot)]))
    return np.concatenate(found, axis=1)


def offset_lengths(family: GridFamily, dx: Any) -> Any:
    """Lengths of the bonds of every offset [k] (m)."""
    return np.sqrt((family.steps**2).sum(axis=1)) * dx


def offset_shares(family: GridFamily, delta: Any, dx: Any) -> Any:
    """Shares beta [k] (-) of a neighbour's volume inside the horizon."""
    return partial_volume(offset_lengths(family, dx), delta, dx, family.partial)


def offset_sums(family: GridFamily, values: Any) -> Any:
    """Sum over the live bonds of every point of one value an offset: [*shape, ...].

    Args:
        family: the bonds.
        values: [k, ...], the same for both directions of an offset.

    Each axis is summed on its own: a box of points sees a box of offsets.
    """
    xp = namespace(values, family.cut)
    reach, steps = family.reach, family.steps
    size = tuple(2 * reach + 1)
    both = np.concatenate([steps, -steps]) + reach
    flat = np.ravel_multi_index(both.T, size)
    rest = values.shape[1:]
    table = add_at(xp, (int(np.prod(size)), *rest), flat, xp.concatenate([values] * 2))
    table = table.reshape(*size, *rest)
    for n, r in zip(family.shape, reach, strict=True):
        at = np.arange(n)[:, None] + np.arange(-r, r + 1)
        seen = ((at >= 0) & (at < n)).astype(float)
        # the front axis is summed and comes back behind the other axes of points
        table = xp.moveaxis(xp.tensordot(seen, table, axes=(1, 0)), 0, len(size) - 1)
    if family.cut.shape[1] == 0:
        return table
    i, j = family.cut_ends()
    lost = values[family.cut[1]]
    ends, lost = xp.concatenate([i, j]), xp.concatenate([lost, lost])
    return table - add_at(xp, (family.n, *rest), ends, lost).reshape(table.shape)


def add_at(
    xp: Any, shape: tuple[int, ...], at: Any, values: Any, ascending: bool = False
) -> Any:
    """Zeros with values [b, ...] added at the rows `at` [b]."""
    total = xp.zeros(shape, values.dtype)
    if isinstance(total, np.ndarray):
        np.add.at(total, at, values)
        return total
    return total.at[at].add(
        values, indices_are_sorted=ascending, mode="promise_in_bounds"
    )
