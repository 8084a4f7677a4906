"""Regions of space: boxes, half-spaces, balls and their unions.

A region answers one question, `contains(X)`: which of these points lie inside. Regions
are data, not callables, so that a scene made of them can be written to a file. Points
on a boundary belong to the region, within `ROUND_OFF` of the size of the coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxpd.checks import instance, number, vector

Points = NDArray[np.floating]

AXES = "xyz"
#: Relative tolerance of every "on the boundary" question; lattice coordinates carry
#: a few units of the last place, 1e-16 each.
ROUND_OFF = 1e-10


def _same_dimension(X: Points, place: tuple[float, ...], name: str) -> None:
    if X.shape[1] != len(place):
        raise ValueError(
            f"{name}: {place} is a point in {len(place)}-D and the points are in "
            f"{X.shape[1]}-D; give {X.shape[1]} coordinates"
        )


def _slack(X: Points) -> float:
    round_off = ROUND_OFF
    if X.dtype.kind == "f":
        round_off = max(ROUND_OFF, 8 * float(np.finfo(X.dtype).eps))
    return round_off * max(1e-300, float(np.max(np.abs(X), initial=0.0)))


@dataclass(frozen=True)
class Box:
    """Axis-parallel box `lo <= x <= hi`; `lo`, `hi` tuples of d numbers (m)."""

    lo: tuple[float, ...]
    hi: tuple[float, ...]

    def contains(self, X: Points) -> NDArray[np.bool_]:
        """Mask [n] of the points X [n, d] in the box, boundary included."""
        _same_dimension(X, self.lo, "lo")
        tol = _slack(X)
        inside = (np.asarray(self.lo) - tol <= X) & (np.asarray(self.hi) + tol >= X)
        return np.all(inside, axis=1)


@dataclass(frozen=True)
class HalfSpace:
    """Points with `sign * x[axis] >= sign * at`; `at` in m, `sign` +1 or -1."""

    axis: int
    at: float
    sign: int

    def contains(self, X: Points) -> NDArray[np.bool_]:
        """Mask [n] of the points X [n, d] in the half-space, plane included."""
        if self.axis >= X.shape[1]:
            raise ValueError(
                f"axis: {AXES[self.axis]!r} does not exist in {X.shape[1]}-D; use one "
                f"of {list(AXES[: X.shape[1]])}"
            )
        return self.sign * (X[:, self.axis] - self.at) >= -_slack(X)


@dataclass(frozen=True)
class Ball:
    """Points within `radius` (m) of `centre`, a tuple of d numbers (m)."""

    centre: tuple[float, ...]
    radius: float

    def contains(self, X: Points) -> NDArray[np.bool_]:
        """Mask [n] of the points X [n, d] in the ball, surface included."""
        _same_dimension(X, self.centre, "centre")
        r = np.linalg.norm(X - np.asarray(self.centre), axis=1)
        return r <= self.radius + _slack(X)


@dataclass(frozen=True)
class Union:
    """Points that lie in any of the `parts`."""

    parts: tuple[Region, ...]

    def contains(self, X: Points) -> NDArray[np.bool_]:
        """Mask [n] of the points X [n, d] in any part."""
        return np.logical_or.reduce([part.contains(X) for part in self.parts])


Region = Box | HalfSpace | Ball | Union


def box(lo: Sequence[float], hi: Sequence[float]) -> Box:
    """The box from corner `lo` to corner `hi` (m), in 1, 2 or 3 dimensions.

    Raises:
        ValueError: if the corners differ in dimension or `hi` is not above `lo`.
    """
    lo_, hi_ = vector("lo", lo, endless=True), vector("hi", hi, endless=True)
    if len(lo_) != len(hi_):
        raise ValueError(
            f"lo, hi: corners {lo_} and {hi_} must have the same dimension"
        )
    if not all(a < b for a, b in zip(lo_, hi_, strict=True)):
        raise ValueError(f"hi: {hi_} must be above lo = {lo_} in every direction")
    return Box(lo_, hi_)


def _half_space(sign: int, coordinate: dict[str, float]) -> HalfSpace:
    if len(coordinate) != 1 or (name := next(iter(coordinate))) not in tuple(AXES):
        raise ValueError(
            f"coordinate: {coordinate} must be one of x=, y= or z=, as in above(y=0.5)"
        )
    at = number(name, coordinate[name])
    return HalfSpace(AXES.index(name), float(at), sign)


def above(**coordinate: float) -> HalfSpace:
    """The half-space above a plane, plane included: `above(y=0.5)`."""
    return _half_space(+1, coordinate)


def below(**coordinate: float) -> HalfSpace:
    """The half-space below a plane, plane included: `below(y=-0.5)`."""
    return _half_space(-1, coordinate)


def ball(centre: Sequence[float], radius: float) -> Ball:
    """The ball of `radius` (m) about `centre` (m)."""
    number("radius", radius, above=0, cure="in m")
    return Ball(vector("centre", centre), float(radius))


def union(*parts: Region) -> Union:
    """The union of regions."""
    if not parts:
        raise ValueError("parts: a union needs at least one region")
    for part in parts:
        instance("parts", part, Region, "a region, as box(..): union(one, two)")
    return Union(parts)
