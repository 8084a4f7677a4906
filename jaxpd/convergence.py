"""Orders of convergence: what values on finer and finer models tell, and what not.

Orders are those of |value - limit| in dx, between levels from three values that follow
one another (Roache, J. Fluids Eng. 116 (1994) 405-413), or from two where the limit is
known. Where the values do not approach a limit in one way no order is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

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
