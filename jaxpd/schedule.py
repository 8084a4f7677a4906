"""Histories in time: ramps and tables that loads and supports follow.

A table is data, so that a scene stays data: linear between its points, constant before
the first, and after the last it goes on at a constant rate, 0 unless said.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jaxpd.checks import number, numbers


@dataclass(frozen=True)
class Table:
    """A piecewise linear factor (-) over time.

    Attributes:
        times: rising (s).
        factors: at those times (-).
        rate: slope after the last time (1/s).
    """

    times: tuple[float, ...]
    factors: tuple[float, ...]
    rate: float = 0.0

    def __call__(self, t: ArrayLike) -> NDArray[np.float64]:
        """The factor at times t (s), of any shape."""
        t = np.asarray(t, float)
        after = np.maximum(t - self.times[-1], 0.0)
        return np.interp(t, self.times, self.factors) + self.rate * after

    def at_start(self) -> tuple[float, float]:
        """Factor (-) and its slope (1/s) just after time 0."""
        here = int(np.searchsorted(self.times, 0.0, side="right"))
        slope = self.rate if here == len(self.times) else 0.0
        if 0 < here < len(self.times):
            rise = self.factors[here] - self.factors[here - 1]
            slope = rise / (self.times[here] - self.times[here - 1])
        return float(self(0.0)), slope


#: There from the start and for good.
ALWAYS = Table((0.0,), (1.0,))
#: Grows by 1 a second: what is prescribed is a velocity.
STEADY = Table((0.0,), (0.0,), 1.0)


def table(times: Sequence[float], factors: Sequence[float]) -> Table:
    """A table of factors over time, constant before and after.

    Args:
        times: strictly rising (s).
        factors: one a time (-).

    Raises:
        ValueError: naming what is wrong with them.
    """
    t = np.asarray(numbers("times", times, cure="in s"), float)
    f = np.asarray(numbers("factors", factors), float)
    if t.ndim != 1 or t.shape != f.shape or len(t) == 0:
        raise ValueError(
            f"times, factors: {t.shape} and {f.shape} must be as many, one at least"
        )
    if not (np.diff(t) > 0).all():
        raise ValueError(f"times: {times} must rise strictly")
    return Table(tuple(t.tolist()), tuple(f.tolist()))


def ramp(rise: float, start: float = 0.0) -> Table:
    """A factor that grows from 0 at `start` to 1 within `rise` (s), and stays.

    Raises:
        ValueError: if the rise is not positive.
    """
    number("rise", rise, above=0, cure="in s")
    number("start", start)
    return table([start, start + rise], [0.0, 1.0])
