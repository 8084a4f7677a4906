"""Convergence of a scene: finer lattices at a fixed ratio or at a fixed horizon.

    what = "delta"   delta and dx fall together, m = delta / dx fixed: towards the
                     classical body
    what = "m"       dx falls, delta fixed: towards the nonlocal body
    what = "h"       dx falls, of nodes

Orders are those of |value - limit| in dx, between levels from three values that follow
one another (Roache, J. Fluids Eng. 116 (1994) 405-413), or from two where the limit is
known. Where the values do not approach a limit in one way no order is stated.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.geometry import Box
from jaxpd.resolution import NODES, Bonds
from jaxpd.run import solve_static
from jaxpd.scene import Scene

#: Safety of the uncertainty that three grids give (Roache).
SAFETY = 1.25
#: Values this close, relatively, are one value.
SAME = 1e-12


@dataclass(frozen=True)
class Refinement:
    """Values of a quantity on finer and finer models.

    Attributes:
        what: "delta", "m" or "h".
        dx: spacings [k] (m).
        delta: horizons [k] (m), NaN of nodes.
        points: numbers of points [k].
        values: of the quantity [k].
        seconds: wall time of each solve [k], compilation included.
        exact: the limit, where it is known.
        notes: what spoils orders, in words.
    """

    what: str
    dx: tuple[float, ...]
    delta: tuple[float, ...]
    points: tuple[int, ...]
    values: tuple[float, ...]
    seconds: tuple[float, ...]
    exact: float | None = None
    notes: tuple[str, ...] = ()

    @property
    def orders(self) -> tuple[float | None, ...]:
        """Order at each level [k], None where none can be stated.

        With a known limit of each level and the one before; else of each three.
        """
        if self.exact is not None:
            return (None, *map(self._known, range(1, len(self.dx))))
        return (None, None, *map(self._observed, range(2, len(self.dx))))

    def _known(self, k: int) -> float | None:
        """Order of the errors of levels k - 1 and k."""
        assert self.exact is not None
        before, now = (abs(self.values[q] - self.exact) for q in (k - 1, k))
        if min(before, now) <= SAME * max(abs(self.exact), abs(self.values[k])):
            return None
        return math.log(before / now) / math.log(self.dx[k - 1] / self.dx[k])

    def _observed(self, k: int) -> float | None:
        """Order of three values that tend to one limit from one side."""
        coarse, middle, fine = self.values[k - 2 : k + 1]
        first, second = middle - coarse, fine - middle
        size = max(map(abs, (coarse, middle, fine)))
        if abs(second) <= SAME * size or first * second <= 0:
            return None
        a, b = (math.log(self.dx[q - 1] / self.dx[q]) for q in (k - 1, k))
        return _order(first / second, a, b)

    @property
    def order(self) -> float | None:
        """The order of the last level where one can be stated."""
        told = [p for p in self.orders if p is not None]
        return told[-1] if told and self.orders[-1] is not None else None

    @property
    def limit(self) -> float | None:
        """The exact limit, or what the last three values extrapolate to."""
        if self.exact is not None:
            return self.exact
        p = self.order
        if p is None or p <= 0:
            return None
        ratio = (self.dx[-2] / self.dx[-1]) ** p
        return self.values[-1] + (self.values[-1] - self.values[-2]) / (ratio - 1.0)

    @property
    def error(self) -> float | None:
        """Error of the last value: known, or 1.25 times what is extrapolated."""
        limit = self.limit
        if limit is None:
            return None
        off = abs(self.values[-1] - limit)
        return off if self.exact is not None else SAFETY * off

    def converged(self, rtol: float) -> bool:
        """Whether the last value is within `rtol` of the limit, as far as is known."""
        error = self.error
        return error is not None and error <= rtol * abs(self.values[-1])

    @property
    def verdict(self) -> str:
        """What the values say, in words."""
        if self.order is not None and self.order > 0:
            words = f"order {self.order:.2f}"
            if self.exact is None:
                words += f", limit {self.limit:.6g} +- {self.error:.1g}"
            else:
                words += f", error {self.error:.2g} of the limit {self.exact:.6g}"
            return words
        steps = np.diff(self.values)
        if (np.abs(steps) <= SAME * max(map(abs, self.values))).all():
            return "the value does not change"
        if self.exact is None and len(steps) < 2:
            return "two levels tell no order: take three or more"
        if self.order is not None:
            return f"order {self.order:.2f}: the values move away from the limit"
        if np.any(steps[:-1] * steps[1:] < 0):
            return "no order: the values go to and fro"
        return "no order: the steps between values do not shrink"

    def __str__(self) -> str:
        """A table of the levels, and the verdict."""
        head = ("dx", "m", "points", "value", "order", "s")
        rows: list[tuple[str, ...]] = [head]
        for k, order in enumerate(self.orders):
            m = self.delta[k] / self.dx[k]
            rows.append(
                (
                    f"{self.dx[k]:.4g}",
                    "-" if math.isnan(m) else f"{m:.3g}",
                    str(self.points[k]),
                    f"{self.values[k]:.8g}",
                    "-" if order is None else f"{order:.2f}",
                    f"{self.seconds[k]:.2f}",
                )
            )
        width = [max(len(row[c]) for row in rows) for c in range(len(head))]
        lines = [
            "  ".join(cell.rjust(w) for cell, w in zip(row, width, strict=True))
            for row in rows
        ]
        return "\n".join([*lines, self.verdict, *self.notes])


def _order(ratio: float, a: float, b: float) -> float | None:
    """The p of (1 - e^(-p a)) / (1 - e^(-p b)) e^(p (a + b)) e^(-p a) = ratio."""
    if ratio <= a / b * (1.0 + 1e-9):
        return None  # the steps do not shrink: no positive order
    if abs(a - b) <= 1e-9 * a:
        return math.log(ratio) / a
    low, high = 1e-6, 40.0

    def excess(p: float) -> float:
        return math.exp(p * b) * math.expm1(p * a) / math.expm1(p * b) - ratio

    if excess(high) < 0:
        return None
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) < 0 else (low, middle)
    return 0.5 * (low + high)


def stored(solution: Any) -> float:
    """The energy that a solution stores (J), the default quantity."""
    return float(np.asarray(solution.energy).sum())


def refine(
    scene: Scene | Callable[[float], Scene],
    what: str | None = None,
    *,
    quantity: Callable[[Any], float] = stored,
    exact: float | None = None,
    sizes: Sequence[float] | None = None,
    levels: int = 4,
    ratio: float = 2.0,
    solve: Callable[[Scene], Any] = solve_static,
) -> Refinement:
    """Solve a scene on finer and finer models, and say how its answer converges.

    Args:
        scene: a box with a resolution, the coarsest; or a function that makes a scene
            of a spacing (m), for bodies that are made of nodes.
        what: "delta", "m" or "h", see above; None is "delta" of bonds, "h" of nodes.
        quantity: number of a solution; by default its stored energy (J).
        exact: the limit, where it is known.
        sizes: spacings (m), falling; by default `levels` of them from the scene's own,
            each the one before over `ratio`, as far as they divide the box.
        levels: how many.
        ratio: of a spacing to the next.
        solve: what solves, as `jaxpd.solve_static` or a function of yours that returns
            anything that `quantity` understands.

    Returns:
        A `Refinement`, which prints as a table.

    Raises:
        ValueError: naming the argument, its value and the cure.
        NotConverged: if a solve fails.
    """
    make = scene if callable(scene) else _maker(scene, what)
    if isinstance(scene, Scene):
        what = what or ("h" if isinstance(scene.resolution, NODES) else "delta")
        sizes = _spacings(scene, ratio, levels) if sizes is None else sizes
    if sizes is None:
        raise ValueError("sizes: None; a function of a spacing needs a list of them")
    h = np.asarray(sizes, float)
    if h.ndim != 1 or len(h) < 2 or not (np.diff(h) < 0).all() or not (h > 0).all():
        raise ValueError(f"sizes: {sizes} must be two or more, positive and falling")
    rows, notes = [], []
    for dx in h.tolist():
        level = make(dx)
        notes += _off_rows(level)
        started = time.perf_counter()
        solution = solve(level)
        if hasattr(solution, "checked"):
            solution.checked()
        value = float(quantity(solution))
        if not math.isfinite(value):
            raise ValueError(f"quantity: {value} at dx = {dx}; it must be finite")
        resolution = level.resolution
        delta = resolution.horizon if isinstance(resolution, Bonds) else math.nan
        points = len(solution.X) if hasattr(solution, "X") else 0
        rows.append((dx, delta, points, value, time.perf_counter() - started))
    spacings, horizons, points, values, seconds = zip(*rows, strict=True)
    told = tuple(dict.fromkeys(notes))
    return Refinement(
        what or "h", spacings, horizons, points, values, seconds, exact, told
    )


def _maker(scene: Scene, what: str | None) -> Callable[[float], Scene]:
    """Scenes with another spacing."""
    resolution = scene.resolution
    if not isinstance(scene.body, Box):
        raise ValueError(
            "scene: its body is no box, whose nodes are as far apart as they are; give "
            "a function of the spacing that makes a scene, and sizes"
        )
    bonds = isinstance(resolution, Bonds)
    known = ("delta", "m") if bonds else ("h",)
    if what is not None and what not in known:
        raise ValueError(f"what: {what!r} must be one of {known} here")
    if resolution.dx is None:
        raise ValueError("scene: its resolution needs a spacing dx, the coarsest")
    if not bonds:
        return lambda dx: dataclasses.replace(
            scene, resolution=dataclasses.replace(resolution, dx=dx)
        )
    m, delta = resolution.horizon / resolution.dx, resolution.horizon
    fixed = {"m": m, "delta": None} if what != "m" else {"m": None, "delta": delta}
    return lambda dx: dataclasses.replace(
        scene, resolution=dataclasses.replace(resolution, dx=dx, **fixed)
    )


def _spacings(scene: Scene, ratio: float, levels: int) -> list[float]:
    """Spacings near a geometric row that divide all sides of a box."""
    if not ratio > 1 or levels < 2:
        raise ValueError(
            f"ratio: {ratio} must be above 1, levels: {levels} at least 2, better 4"
        )
    body: Any = scene.body
    sides = np.asarray(body.hi) - np.asarray(body.lo)
    cells = np.rint(sides / scene.resolution.dx).astype(int)
    common = int(np.gcd.reduce(cells))
    unit = float(sides[0]) / (cells[0] // common)
    pieces = [max(1, round(common * ratio**k)) for k in range(levels)]
    if len(set(pieces)) < levels:
        raise ValueError(
            f"ratio: {ratio} gives the same lattice twice; take 2, or a finer start"
        )
    return [unit / k for k in pieces]


def _off_rows(scene: Scene) -> list[str]:
    """Notes on cracks that lie otherwise than midway between rows of points."""
    if not scene.cracks or not isinstance(scene.body, Box):
        return []
    dx, lo = scene.resolution.dx, np.asarray(scene.body.lo)
    shift = 0.5 if scene.resolution.nodes == "cell" else 0.0
    found = []
    for crack in scene.cracks:
        edges = np.abs(np.asarray(crack.edges))
        for axis in range(scene.d):
            ends = [crack.corner[axis]]
            if edges[:, axis].max() > 0:
                ends.append(ends[0] + float(np.asarray(crack.edges)[:, axis].sum()))
            row = (np.asarray(ends) - lo[axis]) / dx - shift
            inside = (row > 0) & (row < (scene.body.hi[axis] - lo[axis]) / dx)
            away = np.abs(row - np.floor(row) - 0.5)[inside]
            if (away > 1e-6).any():
                found.append(
                    "a crack's plane or tip is not always midway between rows: "
                    "its length jumps from level to level, and orders with it"
                )
    return found
