"""Two plies that face each other: their surface points, and how one sees the other's.

On the host. Faces are planes across the axis along which plies are stacked; lattices
need not match.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxpd.geometry.cloud import Lattice

Floats = NDArray[np.floating]
Indices = NDArray[np.integer]


@dataclass(frozen=True, eq=False)
class Face:
    """One side of an interlayer, on the host.

    Attributes:
        grid: the lattice of the ply.
        axis: along which plies are stacked.
        up: whether the interlayer lies above the ply.
        lo, hi: corners of the ply's box (m).
        first: number of its first point among all points.
        delta: horizon of the ghosts' bonds (m).
        partial: volume of neighbours at the rim of the horizon.
        corrected: whether bonds of the rule "paper" are surface corrected.
    """

    grid: Lattice
    axis: int
    up: bool
    lo: tuple[float, ...]
    hi: tuple[float, ...]
    first: int
    delta: float
    partial: str
    corrected: bool = False

    @property
    def X(self) -> Floats:
        """Reference positions of the ply [n, d] (m)."""
        places = np.indices(self.grid.shape).reshape(len(self.grid.shape), -1).T
        return np.asarray(self.grid.origin) + self.grid.dx * places

    @property
    def row(self) -> int:
        """Number of the outermost row of points, inside the box."""
        place = (self.plane - self.grid.origin[self.axis]) / self.grid.dx
        inside = math.floor(place + 1e-6) if self.up else math.ceil(place - 1e-6)
        return min(max(inside, 0), self.grid.shape[self.axis] - 1)

    @property
    def plane(self) -> float:
        """Where the box ends (m)."""
        return (self.hi if self.up else self.lo)[self.axis]

    @property
    def height(self) -> float:
        """Where the outermost row of points lies (m)."""
        return self.grid.origin[self.axis] + self.grid.dx * self.row

    @property
    def inset(self) -> float:
        """From the box's end to the outermost row of points (m)."""
        return abs(self.plane - self.height)


def places(
    fine: Face, faces: tuple[Face, Face], height: float
) -> tuple[Floats, Floats, tuple[int, ...]]:
    """The ghosts: at the surface points of the finer face, where both plies lie.

    Returns:
        Their places [q, d] (m), the area of each, its cell clipped to what both plies
        cover [q] (m^(d-1)), and their number along each axis.

    Raises:
        ValueError: if none lies where both plies are.
    """
    d, axis, grid = len(fine.lo), fine.axis, fine.grid
    lines, sizes = [], []
    for a in range(d):
        if a == axis:
            lines.append(np.array([height]))
            sizes.append(np.ones(1))
            continue
        ends = np.array([_covered(face, a) for face in faces])
        low, high = ends[:, 0].max(), ends[:, 1].min()
        line = grid.origin[a] + grid.dx * np.arange(grid.shape[a])
        half = 0.5 * grid.dx
        size = np.minimum(line + half, high) - np.maximum(line - half, low)
        some = size > 1e-6 * grid.dx
        lines.append(line[some])
        sizes.append(size[some])
    grids = np.meshgrid(*lines, indexing="ij")
    found = np.stack([g.ravel() for g in grids], axis=1)
    if not len(found):
        raise ValueError("plies: no surface point lies where they face each other")
    area = np.prod(np.meshgrid(*sizes, indexing="ij"), axis=0).ravel()
    return found, area, grids[0].shape


def _covered(face: Face, a: int) -> tuple[float, float]:
    """From where to where the cells of a ply's own points reach along an axis (m)."""
    grid = face.grid
    line = grid.origin[a] + grid.dx * np.arange(grid.shape[a])
    slack = 1e-6 * grid.dx
    own = line[(line >= face.lo[a] - slack) & (line <= face.hi[a] + slack)]
    return float(own[0] - 0.5 * grid.dx), float(own[-1] + 0.5 * grid.dx)


def interpolate(face: Face, ghosts: Floats) -> tuple[Indices, Floats]:
    """Surface points [q, w] and weights by which ghosts are interpolated on a face."""
    grid, shape = face.grid, np.asarray(face.grid.shape)
    across = [a for a in range(len(shape)) if a != face.axis]
    place = (ghosts - np.asarray(grid.origin)) / grid.dx
    base = np.floor(place + 1e-9).astype(int)
    base = np.clip(base, 0, np.maximum(shape - 2, 0))
    part = np.where(shape > 1, place - base, 0.0)
    part = np.where(np.abs(part - np.rint(part)) < 1e-6, np.rint(part), part)
    base[:, face.axis] = face.row
    indices, weights = [], []
    for corner in itertools.product((0, 1), repeat=len(across)):
        at, weight = base.copy(), np.ones(len(ghosts))
        for a, step in zip(across, corner, strict=True):
            at[:, a] = np.minimum(at[:, a] + step, shape[a] - 1)
            weight *= part[:, a] if step else 1.0 - part[:, a]
        indices.append(face.first + np.ravel_multi_index(at.T, grid.shape))
        weights.append(weight)
    index, weight = np.stack(indices, axis=1), np.stack(weights, axis=1)
    # the heaviest first, and no column without weight
    order = np.argsort(-np.abs(weight), axis=1, kind="stable")
    index = np.take_along_axis(index, order, axis=1)
    weight = np.take_along_axis(weight, order, axis=1)
    used = np.abs(weight).max(axis=0) > 0.0
    return index[:, used], weight[:, used]
