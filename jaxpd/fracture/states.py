"""What is kept of a slow fracture: states in equilibrium, one after the other.

Between two states the springs that went fade, their tension falling to nothing in
proportion to the way, and everything else follows on straight lines. So work and
release are exact, whatever the states are:

    work      of supports (R_t + R_t+1) / 2 . dU, of loads (f_t + f_t+1) / 2 load . du
    released  by each spring that goes at t: T_t e_t+1 / 2, its tension then and its
              elongation in the next state, free ends and all

Where the factor rises after a loss, a spring that goes at once frees less than one that
fades on the way: T_t e_t+1 f_t / (2 f_t+1).

Source: two straight lines of load against displacement enclose that area; for the sum
over springs, work of the fading tension plus what the spring held.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxpd.operators.springs import Springs

Floats = NDArray[np.floating]


@dataclass
class States:
    """A growing list of states; `add` computes all that is kept of one.

    Attributes:
        springs: all springs.
        fixed: mask of prescribed components [n, d].
        load: forces at the load factor 1 [n, d] (N).
        rows: a dictionary of numbers a state.
        reactions: forces of the supports on the points [q] of `held`, [q, d] a state.
        broken_at: number of the state from which on each spring is gone [b]; -1 before
            any, `NEVER` if it stands.
    """

    springs: Springs
    fixed: NDArray[np.bool_]
    load: Floats
    cut: NDArray[np.bool_]
    watch: tuple[NDArray[np.bool_], ...] = ()
    rows: list[dict[str, float]] = field(default_factory=list)
    reactions: list[Floats] = field(default_factory=list)
    watched: list[Floats] = field(default_factory=list)
    broken_at: Any = None
    _last: Any = None
    _began: float = field(default_factory=time.perf_counter)

    def __post_init__(self):
        """Find the supported points."""
        self.held = np.flatnonzero(self.fixed.any(axis=1))
        self.map = self.springs.differences(len(self.fixed))
        self.broken_at = np.where(self.cut, -1, NEVER)

    def add(self, factor: float, u: Floats, intact: Any, **more: float) -> None:
        """Append the state f u, in which `intact` springs stand.

        Args:
            factor: load factor f.
            u: displacements at the factor 1 [n, d] (m).
            intact: mask of springs [b].
            **more: what else to keep of it.
        """
        springs = self.springs
        e: Any = factor * (self.map @ u.ravel())
        tension = np.where(intact, springs.k * e, 0.0)
        inner = (self.map.T @ tension).reshape(u.shape)
        reaction = np.where(self.fixed, inner - factor * self.load, 0.0)
        here = factor * u
        row = {
            "factor": factor,
            "stored": 0.5 * float(tension @ e),
            "work": 0.0,
            "released": 0.0,
            "bonds": 0.0,
            "broken": 0.0,
            "seconds": time.perf_counter() - self._began,
        }
        # conjugate to the factor: what its growth by 1 would do of work
        row["pull"] = float((self.load * here).sum())
        row["force"] = float((reaction * u)[self.fixed].sum()) + row["pull"]
        if self.rows:
            old, (u0, r0, t0, stood) = self.rows[-1], self._last
            lost = stood & ~intact
            du = here - u0
            moved = 0.5 * (r0 + reaction) * du
            between = 0.5 * (old["factor"] + factor)
            row["work"] = old["work"] + float(
                moved[self.fixed].sum() + between * (self.load * du).sum()
            )
            row["released"] = old["released"] + 0.5 * float(t0[lost] @ e[lost])
            # what each held when it went
            own = 0.5 * float((t0[lost] ** 2 / springs.k[lost]).sum())
            row["bonds"] = old["bonds"] + own
            row["broken"] = old["broken"] + int(lost.sum())
            self.broken_at[lost] = len(self.rows)
        self.rows.append(row | more)
        self.reactions.append(reaction[self.held])
        self.watched.append(np.array([here[w].mean(axis=0) for w in self.watch]))
        self._last = (here, reaction, tension, intact.copy())

    @property
    def last_u(self) -> Floats:
        """Displacements in the last state [n, d] (m)."""
        return self._last[0]

    def column(self, name: str) -> Floats:
        """One number of every state [F], 0 where it was not kept."""
        return np.array([row.get(name, 0.0) for row in self.rows])

    def pack(self) -> dict[str, Any]:
        """Everything, as arrays, for a file."""
        names = sorted({name for row in self.rows for name in row})
        return {
            "names": np.array(names),
            "rows": np.array([[r.get(k, np.nan) for k in names] for r in self.rows]),
            "reactions": np.array(self.reactions),
            "watched": np.array(self.watched),
            "broken_at": self.broken_at,
            "last": self._last,
        }

    def unpack(self, kept: dict[str, Any]) -> None:
        """Take up what `pack` gave."""
        names = [str(name) for name in kept["names"]]
        self.rows = [
            {k: float(x) for k, x in zip(names, row, strict=True) if not np.isnan(x)}
            for row in kept["rows"]
        ]
        self.reactions, self.watched = list(kept["reactions"]), list(kept["watched"])
        self.broken_at, self._last = kept["broken_at"], tuple(kept["last"])
        self._began = time.perf_counter() - self.rows[-1]["seconds"]


#: Number of a state that never comes.
NEVER = np.iinfo(np.int32).max
