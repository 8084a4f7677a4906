"""How a motion is modelled, and the course of its loads and supports over time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.schedule import Table

#: Kinds of operators of motion, see `jaxpd.operators.protocol`.
KINDS = ("halves", "slots", "memory", "stack")


@dataclass(frozen=True)
class Course:
    """What of a motion is known when it is traced; hashable.

    Attributes:
        kind: one of `KINDS`.
        breaks: whether bonds of an elastic material have a critical stretch.
        softening: width of the smoothed law over s_crit, or None.
        loads: histories of the loads.
        moves: histories of the prescribed displacements.
        dtype: "float32" or "float64".
    """

    kind: str
    breaks: bool
    softening: float | None
    loads: tuple[Table, ...]
    moves: tuple[Table, ...]
    dtype: str

    def factors(self, dt: float, first: int, steps: int) -> tuple[Any, ...]:
        """Factors of `jaxpd.solvers.explicit.verlet`, in 64 bits on the host."""
        t = dt * (first + np.arange(steps + 1))
        load, move = (
            np.stack([table(t) for table in tables], axis=1)
            if tables
            else np.zeros((len(t), 0))
            for tables in (self.loads, self.moves)
        )
        return load[:-1], load[1:], np.diff(move, axis=0), move[1:]
