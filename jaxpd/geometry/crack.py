"""Cracks: segments in 2-D, plane rectangles in 3-D, and the bonds that they cut.

The convention for points on the crack surface: every point has a side, and a point in
the plane of the crack (within round-off) belongs to the *lower* side, the one that the
normal points away from. A bond is cut if its ends lie on different sides and it crosses
the plane inside the crack, tips and rim included. So no bond runs along a crack uncut,
none is cut by touching a crack from its own side, and a crack along a row of points
leaves that row on the lower face.

Normals: a segment from a to b has its normal to the left of b - a (for a crack along +x
that is +y); a rectangle (corner, edge1, edge2) has edge1 x edge2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxpd.checks import vector
from jaxpd.geometry.region import ROUND_OFF


@dataclass(frozen=True)
class Crack:
    """A flat crack in d dimensions: a corner and d - 1 orthogonal edges (m)."""

    corner: tuple[float, ...]
    edges: tuple[tuple[float, ...], ...]

    @property
    def normal(self) -> NDArray[np.floating]:
        """Unit normal [d], from the lower to the upper side."""
        e = np.asarray(self.edges)
        normal = np.array([-e[0, 1], e[0, 0]]) if len(e) == 1 else np.cross(*e)
        return normal / np.linalg.norm(normal)

    def point(self, *t: float) -> NDArray[np.floating]:
        """The point [d] at edge coordinates t in 0..1, one an edge."""
        return np.asarray(self.corner) + np.asarray(t) @ np.asarray(self.edges)

    def above(self, X: NDArray[np.floating]) -> NDArray[np.bool_]:
        """Mask [n]: points on the upper side; points in the plane are not."""
        height = (X - np.asarray(self.corner)) @ self.normal
        return height > ROUND_OFF * max(1e-300, float(np.abs(X).max(initial=0.0)))

    def faces(self, X: NDArray[np.floating], *t: float) -> tuple[int, int]:
        """Points nearest to `point(*t)`: the one above the crack, the one below."""
        upper = self.above(X)
        distance = np.linalg.norm(X - self.point(*t), axis=1)
        i = np.argmin(np.where(upper, distance, np.inf))
        j = np.argmin(np.where(upper, np.inf, distance))
        return int(i), int(j)

    def cuts(
        self, X: NDArray[np.floating], i: NDArray[np.integer], j: NDArray[np.integer]
    ) -> NDArray[np.bool_]:
        """Mask of the bonds from points i to points j of X [n, d] that are cut."""
        side = self.above(X)
        cut = side[i] != side[j]
        across = np.flatnonzero(cut)  # the few that change side are looked at closely
        np.put(
            cut, across, self.crosses(X[np.ravel(i)[across]], X[np.ravel(j)[across]])
        )
        return cut

    def crosses(
        self, a: NDArray[np.floating], b: NDArray[np.floating]
    ) -> NDArray[np.bool_]:
        """Mask [b]: lines from a to b [b, d] meet the plane inside the crack.

        The ends are on different sides, see `above`.
        """
        ha = (a - np.asarray(self.corner)) @ self.normal
        hb = (b - np.asarray(self.corner)) @ self.normal
        crossing = a + (b - a) * (ha / (ha - hb))[:, None]
        inside = np.ones(len(a), bool)
        for edge in np.asarray(self.edges):
            t = (crossing - np.asarray(self.corner)) @ edge / (edge @ edge)
            inside &= (t >= -ROUND_OFF) & (t <= 1 + ROUND_OFF)
        return inside


def check_dimension(cracks: Sequence[Crack], d: int) -> None:
    """Refuse cracks of another dimension than the points.

    Raises:
        ValueError: naming the crack and the cure.
    """
    for crack in cracks:
        if len(crack.corner) != d:
            raise ValueError(
                f"cracks: {crack} is in {len(crack.corner)}-D and the points are in "
                f"{d}-D; use segment() in 2-D, rectangle() in 3-D"
            )


def beside(crack: Crack, X: NDArray[np.floating]) -> bool:
    """Whether a crack lies wholly outside the box around the points X [n, d]."""
    sides = np.ndindex(*(2,) * len(crack.edges))
    corners = np.array([crack.point(*t) for t in sides])
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool((high < X.min(axis=0)).any() or (low > X.max(axis=0)).any())


def check_inside(cracks: Sequence[Crack], X: NDArray[np.floating]) -> None:
    """Refuse cracks that lie wholly beside the points X [n, d].

    Raises:
        ValueError: naming the crack and where the points are.
    """
    check_dimension(cracks, X.shape[1])
    for crack in cracks:
        if beside(crack, X):
            raise ValueError(
                f"cracks: {crack} lies beside the body, whose points are between "
                f"{X.min(axis=0)} and {X.max(axis=0)} (m); move it, or leave it out"
            )


def segment(a: Sequence[float], b: Sequence[float]) -> Crack:
    """A crack in 2-D from tip `a` to tip `b` (m).

    Raises:
        ValueError: if a tip is not two numbers or the tips coincide.
    """
    a_, b_ = np.array(vector("a", a, (2,))), np.array(vector("b", b, (2,)))
    if not np.linalg.norm(b_ - a_) > 0:
        raise ValueError(f"b: tips {a} and {b} coincide; a crack needs a length")
    return Crack(tuple(map(float, a_)), (tuple(map(float, b_ - a_)),))


def rectangle(
    corner: Sequence[float], edge1: Sequence[float], edge2: Sequence[float]
) -> Crack:
    """A plane crack in 3-D: a corner and two orthogonal edge vectors (m).

    Raises:
        ValueError: if the vectors are not in 3-D, vanish, or are not orthogonal.
    """
    given = (("corner", corner), ("edge1", edge1), ("edge2", edge2))
    c, e, f = (np.array(vector(name, value, (3,))) for name, value in given)
    size = np.linalg.norm(e) * np.linalg.norm(f)
    if not np.linalg.norm(e) > 0:
        raise ValueError(f"edge1: {edge1} must not be zero; a crack needs an area")
    if not size > 0 or abs(e @ f) > 1e-9 * size:
        raise ValueError(
            f"edge2: {edge2} must be non-zero and orthogonal to edge1 = {edge1}"
        )
    edges = (tuple(map(float, e)), tuple(map(float, f)))
    return Crack(tuple(map(float, c)), edges)
