"""Clouds of points that carry volume: regular lattices and points from elsewhere.

What lives here: where the points are and how much of the body each one stands for.
What does not: who is whose neighbour (`family`), what the points are made of.

In d < 3 dimensions volumes are lengths or areas (m^d), and every force and energy that
follows is per unit of what is left out: a plate has a thickness of 1 m.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.checks import number, real, vector, word
from jaxpd.geometry.rim import Rim

#: Most points of a lattice: with 8 neighbours each, bonds outgrow 32-bit numbers.
MOST = 2**28


@dataclass(frozen=True)
class Lattice:
    """The grid behind a regular cloud: host data, hashable.

    Point (i, j, ..) is number `ravel_multi_index((i, j, ..), shape)` of the cloud.

    Attributes:
        shape: points along each axis, layers included.
        dx: spacing (m), the same along every axis.
        origin: position of point (0, 0, ..) (m).
    """

    shape: tuple[int, ...]
    dx: float
    origin: tuple[float, ...]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Cloud:
    """Points and their volumes.

    Attributes:
        X: reference positions [n, d] (m).
        vol: volumes [n] (m^d), a leaf of its own: moving X does not change it.
        lattice: the grid that X lies on, or None.
        rim: the faces of nodes on the boundary, for methods that need them, or None.
    """

    X: PointVector
    vol: PointScalar
    lattice: Lattice | None = field(metadata={"static": True}, default=None)
    rim: Rim | None = None

    @property
    def regular(self) -> bool:
        """Whether points and volumes are still those of the lattice. Host only."""
        if self.lattice is None:
            return False
        grid, X, vol = self.lattice, np.asarray(self.X), np.asarray(self.vol)
        place = np.indices(grid.shape).reshape(len(grid.shape), -1).T
        slack = max(1e-9 * grid.dx, 8 * float(np.finfo(X.dtype).eps * np.abs(X).max()))
        near = np.abs(X - (np.asarray(grid.origin) + grid.dx * place)).max() <= slack
        even = np.abs(vol / grid.dx ** len(grid.shape) - 1.0).max() <= 1e-5
        return bool(near and even)

    @property
    def n(self) -> int:
        """Number of points."""
        return self.X.shape[0]

    @property
    def d(self) -> int:
        """Number of space dimensions."""
        return self.X.shape[1]


def check_layers(layers: Any, d: int) -> np.ndarray:
    """Layers outside a box [d, 2] as numbers; none if left out.

    Raises:
        ValueError: unless they are d pairs of whole numbers, none negative.
    """
    if layers is None:
        return np.zeros((d, 2), int)
    found = real(layers)
    if found is None or found.shape != (d, 2) or (found < 0).any() or (found % 1).any():
        raise ValueError(
            f"layers: {layers!r} must be {d} pairs (below, above) of whole numbers >= 0"
        )
    return found.astype(int)


def lattice(
    lo: Sequence[float],
    hi: Sequence[float],
    dx: float,
    *,
    layers: Sequence[tuple[int, int]] | None = None,
    nodes: str = "edge",
) -> Cloud:
    """A regular lattice over the box from `lo` to `hi`, every volume dx^d.

    Args:
        lo: lower corner of the box (m).
        hi: upper corner of the box (m).
        dx: spacing (m); must divide every side of the box.
        layers: (below, above) extra layers of points outside the box, per axis, for
            volume constraints; none by default.
        nodes: "edge" puts the outermost points on the faces of the box (n + 1 points
            on a side of n spacings), as paper 000 does; "cell" puts points in the
            middle of cells (n points), so that the volumes add up to the box.

    Raises:
        ValueError: if dx does not divide a side, or an argument is out of range.
    """
    lo_, hi_ = np.array(vector("lo", lo)), np.array(vector("hi", hi))
    if lo_.shape != hi_.shape:
        raise ValueError(f"lo, hi: {lo} and {hi} must be corners in as many dimensions")
    number("dx", dx, above=0, cure="in m")
    word("nodes", nodes, ("edge", "cell"))
    if not (hi_ > lo_).all():
        raise ValueError(f"hi: {hi} must be above lo = {lo} in every direction")
    cells = (hi_ - lo_) / dx
    if np.prod(cells) > MOST:
        raise ValueError(
            f"dx: {dx} makes {np.prod(cells):.2g} points, above {MOST:.2g}; make it "
            "larger, and look at the units of dx and of the body (m)"
        )
    n = np.rint(cells).astype(int)
    if (n < 1).any() or not np.allclose(cells, n, rtol=0, atol=1e-6):
        raise ValueError(
            f"dx: {dx} does not divide the sides {tuple(map(float, hi_ - lo_))} "
            f"({tuple(map(float, cells))} cells); choose dx = side / whole number"
        )
    extra = check_layers(layers, lo_.size)
    shape = tuple(map(int, n + (nodes == "edge") + extra.sum(1)))
    shift = 0.0 if nodes == "edge" else 0.5
    start = shift - extra[:, 0]
    # coordinates as lo + side * (i / n): the faces and the middle come out exactly
    axes = [
        lo_[a] + (hi_[a] - lo_[a]) * ((start[a] + np.arange(shape[a])) / n[a])
        for a in range(lo_.size)
    ]
    X = np.stack([g.ravel() for g in np.meshgrid(*axes, indexing="ij")], axis=1)
    grid = Lattice(shape, float(dx), tuple(float(axis[0]) for axis in axes))
    return Cloud(
        jnp.asarray(X), jnp.asarray(np.full(len(X), float(dx) ** lo_.size)), grid
    )


def from_points(X: PointVector, vol: PointScalar, rim: Rim | None = None) -> Cloud:
    """A cloud of given positions [n, d] (m) and volumes [n] or [] (m^d).

    Args:
        X: positions.
        vol: volumes.
        rim: the faces of nodes on the boundary, see `jaxpd.geometry.rim`; strong forms
            need it.

    Raises:
        ValueError: on wrong shapes, values that are not finite, or volumes that are not
            positive. Coincident points are refused where families are found.
    """
    if real(X) is None:
        raise ValueError(f"X: {X!r} must be an array of numbers [n, d]")
    X_ = np.asarray(X, float)
    if X_.ndim != 2 or not 1 <= X_.shape[1] <= 3 or len(X_) == 0:
        raise ValueError(f"X: shape {X_.shape} must be [n, d] with n >= 1, d = 1, 2, 3")
    if real(vol) is None:
        raise ValueError(f"vol: {vol!r} must be a volume, or one for each point")
    try:
        vol_ = np.broadcast_to(np.asarray(vol, float), (len(X_),))
    except ValueError:
        raise ValueError(
            f"vol: shape {np.shape(vol)} must be [] or [{len(X_)}], one volume a point"
        ) from None
    if not np.isfinite(X_).all():
        bad = int(np.argmin(np.isfinite(X_).all(axis=1)))
        raise ValueError(f"X: point {bad} at {X_[bad]} is not finite; remove it")
    if not (np.isfinite(vol_) & (vol_ > 0)).all():
        bad = int(np.argmin(np.isfinite(vol_) & (vol_ > 0)))
        raise ValueError(f"vol: point {bad} has volume {vol_[bad]}, which must be > 0")
    if rim is not None and (
        rim.normal.shape[1] != X_.shape[1] or int(rim.node.max(initial=0)) >= len(X_)
    ):
        raise ValueError(
            f"rim: its normals {rim.normal.shape} and nodes up to {int(rim.node.max())}"
            f" do not fit points of shape {X_.shape}"
        )
    return Cloud(jnp.asarray(X_), jnp.asarray(np.array(vol_)), None, rim)
