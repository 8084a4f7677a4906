"""What is kept of a path of springs that soften; beside `jaxpd.fracture.states`.

    work      of supports (R_t + R_t+1) / 2 . dU, of loads (f_t + f_t+1) / 2 load . du
    stored    share k e^2 / 2 of all springs, exactly
    bonds     what softening has spent, exactly, by the law
    released  that, and what relaxations at a held factor took by their damping

Work is exact where the path between two states is straight.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxpd.fracture.soft import SoftBody
from jaxpd.fracture.states import NEVER
from jaxpd.operators.springs import Springs
from jaxpd.physics.bilinear import Bilinear

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Softened:
    """What the states of a path of softening springs are besides their numbers.

    Attributes:
        law: softening of the springs in `soft`, without an elastic law inside.
        soft: numbers of the springs that may soften [q].
        h: their largest stretch so far [F, q] (-).
        u: displacements [F, n, d] (m).
        scale: size of the forces in each state, the largest so far [F] (N).
    """

    law: Bilinear
    soft: NDArray[np.integer]
    h: Floats
    u: Floats
    scale: Floats

    def share(self, state: int, count: int) -> Floats:
        """Share of the stiffness that is left of `count` springs in a state."""
        share = np.ones(count)
        share[self.soft] = self.law.share(self.h[state])
        return share


class SoftStates:
    """A growing list of states; `add` computes all that is kept of one.

    Attributes:
        rows: a dictionary of numbers a state.
        reactions: forces of the supports on the points [q] of `held`, [q, d] a state.
        watched: mean displacements in regions [w, d] (m) a state.
        broken_at: number of the state from which on each spring is gone [b].
        floppy: points of pieces that came loose [n].
    """

    def __init__(self, body: SoftBody, watch: tuple[NDArray[np.bool_], ...] = ()):
        """At rest.

        Args:
            body: what is followed.
            watch: masks of points [n] to look at.
        """
        self.body, self.watch = body, watch
        self.springs: Springs = body.springs
        self.held = np.flatnonzero(body.fixed.any(axis=1))
        self.rows: list[dict[str, float]] = []
        self.reactions: list[Floats] = []
        self.watched: list[Floats] = []
        self.broken_at = np.where(body.intact, NEVER, -1)
        self.floppy = np.zeros(len(body.fixed), bool)
        self._u: list[Floats] = []
        self._h: list[Floats] = []
        self._scale: list[float] = []
        self._last: Any = None

    def add(self, damped: bool = False, **more: float) -> None:
        """Append the committed state of the body.

        Args:
            damped: whether it was come to at a held factor, by motion that was damped.
            **more: what else to keep of it.
        """
        body = self.body
        u, h, f = body.u, body.h, body.factor
        s = body.stretch(u)
        inner = body.inner(u, s, h)
        held = body.fixed.ravel()
        reaction = np.where(held, inner - f * body.load, 0.0)
        gone = body.gone()
        row = {
            "factor": f,
            "stored": body.stored(u, s, h),
            "bonds": body.spent(h),
            "work": 0.0,
            "released": 0.0,
            # conjugate to the factor: what its growth by 1 would do of work
            "force": float(reaction @ body.lift + body.load @ u),
            "pull": float(body.load @ u),
            "broken": float(gone.sum()),
        }
        if self.rows:
            old, (u0, r0) = self.rows[-1], self._last
            mean = 0.5 * (old["factor"] + f)
            du = u - u0
            step = float(0.5 * (r0 + reaction) @ du + mean * (body.load @ du))
            row["work"] = old["work"] + step
            spent = row["bonds"] - old["bonds"]
            if damped:
                spent = step - (row["stored"] - old["stored"])
            row["released"] = old["released"] + spent
        shape = body.fixed.shape
        new = body.soft[gone]
        new = new[self.broken_at[new] == NEVER]
        self.broken_at[new] = len(self.rows)
        self.rows.append(row | more)
        self.reactions.append(reaction.reshape(shape)[self.held])
        here = u.reshape(shape)
        self.watched.append(np.array([here[w].mean(axis=0) for w in self.watch]))
        self._u.append(here)
        self._h.append(h)
        self._scale.append(max(float(body.scale), float(np.linalg.norm(reaction))))
        self._last = (u, reaction)

    def column(self, name: str) -> Floats:
        """One number of every state [F], 0 where it was not kept."""
        return np.array([row.get(name, 0.0) for row in self.rows])

    def softened(self) -> Softened:
        """What the states are besides their numbers."""
        body = self.body
        scale = np.maximum.accumulate(self._scale)
        h, u = np.array(self._h), np.array(self._u)
        return Softened(body.law, body.soft, h, u, scale)
