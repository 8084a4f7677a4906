"""The path of springs that soften, step by step, with its ways out.

Under control by spent energy a step prescribes how much more energy is gone for good,
and the load factor follows, up or down: snap-back and snap-through are passed. Where no
spring is at its limit the body is linear, and the next state is where one comes to it.

Under control by load the factor is prescribed. Where Newton's method fails,

    line search   a step of Newton's method is shortened (counted where it happened)
    halved        the step of the load is halved
    dissipation   spent energy controls, through the snap-back, until the factor
                  exceeds that of the step
    relaxed       damped motion at the held factor, its memory committed at rest

and each is counted, of every state and of the path. "refined" counts the steps that
were halved although they converged, as the trapezoid of work missed too much; "direct"
the linear solves of an iterative solver that turned to factors. Host only.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from jaxpd.fracture.events import Limits
from jaxpd.fracture.soft import NEAR, SoftBody, Trial
from jaxpd.fracture.soft_rest import relaxed
from jaxpd.fracture.soft_states import SoftStates
from jaxpd.solvers.downdate import Singular

#: Iterations of a step that is neither too long nor too short.
WANTED = 7
#: Halvings of a step, one after the other, before it counts as hopeless.
HALVINGS = {"energy": 12, "factor": 4}
#: What the trapezoid of work may miss in a step, over the energies that change, and how
#: often a step is halved for it.
DRIFT, REFINED = 2e-3, 5
#: Ways out that are counted.
WAYS = ("line search", "halved", "dissipation", "relaxed", "refined", "direct")


@dataclass
class SoftWalk:
    """A path that is followed.

    Attributes:
        body: what softens.
        states: those so far.
        limits: where to end.
        amount: energy of a step to begin with (J).
        most: largest energy of a step (J).
        pause: called after each state.
        fallbacks: how often each way out was needed.
    """

    body: SoftBody
    states: SoftStates
    limits: Limits
    amount: float
    most: float
    pause: Callable[[], object] = lambda: None
    fallbacks: dict[str, int] = field(default_factory=lambda: dict.fromkeys(WAYS, 0))
    _row: dict[str, Any] = field(default_factory=dict)
    _first: float = 0.0
    _suited: float = 1.0
    _began: float = field(default_factory=time.perf_counter)

    def __post_init__(self):
        """The body at rest is the first state."""
        self.states.add()

    def _count(self, way: str) -> None:
        self.fallbacks[way] += 1
        self._row[way] = self._row.get(way, 0) + 1

    def _left(self, work: float) -> float:
        """Stiffness over that at first, of the work at the load factor 1 (J)."""
        if not self._first or not work:
            return 1.0 if not self._first else 0.0
        # held by moved supports a weaker body works less, under loads alone more
        share = work / self._first
        return share if self.body.lift.any() else 1.0 / share

    def _keep(self, trial: Trial, damped: bool = False) -> str | None:
        """Commit a trial and keep it; why the path ends there, or None."""
        body, limits, states = self.body, self.limits, self.states
        for _ in range(trial.cuts):
            self._count("line search")
        broken = states.rows[-1]["broken"]
        body.commit(trial)
        for _ in range(body.tangent.turned - self.fallbacks["direct"]):
            self._count("direct")
        inverse = body.tangent.inverse
        more: dict[str, float] = {
            "iterations": trial.iterations,
            "solves": inverse.solves,
        }
        more["factorisations"] = inverse.factorisations
        more["seconds"] = time.perf_counter() - self._began
        states.add(damped=damped, **more, **self._row)
        self._row = {}
        self.pause()
        row = states.rows[-1]
        if body.factor:
            stiff = row["force"] / body.factor
            self._first = self._first or stiff
            left = self._left(stiff)
            if left <= limits.severed:
                return f"severed: {max(left, 0.0):.1e} of the stiffness is left"
        if row["broken"] > broken:
            new = states.broken_at == len(states.rows) - 1
            if (limits.end & new).any():
                return "a bond in the region of the end broke"
        if body.factor >= limits.factor * (1.0 - NEAR):
            return f"load factor {limits.factor:.6g} reached"
        if len(states.rows) >= limits.states:
            return f"the limit of {limits.states} states"
        return None

    def by_energy(self, aim: float = np.inf) -> str | None:
        """Spend energy until the path ends, or a load factor is reached.

        Args:
            aim: that factor; a step that would exceed it ends at it, if it can.

        Returns:
            Why it ended, or None where the factor was reached.
        """
        why = None
        while why is None and self.body.factor < aim * (1.0 - NEAR):
            if self.body.moving().any():
                trial = self._spend()
                if trial is None:
                    return (
                        "stuck: no equilibrium was found that spends more energy, at "
                        f"the load factor {self.body.factor:.6g}"
                    )
                if trial.factor > min(aim, self.limits.factor):
                    trial = self._until(min(aim, self.limits.factor)) or trial
            else:
                trial = self._elastic()
                if trial is None and aim < np.inf:
                    trial = self._until(min(aim, self.limits.factor))
                if trial is None:
                    return "severed: no bond that may break is stretched any more"
                if trial.factor > min(aim, self.limits.factor):
                    trial = trial.scaled(min(aim, self.limits.factor))
            why = self._keep(trial)
        return why

    def _until(self, factor: float) -> Trial | None:
        return self.body.step(factor, "factor")

    def _elastic(self) -> Trial | None:
        """The next state at which a spring comes to its limit, if anything holds."""
        body = self.body
        try:
            trial = body.elastic()
        except Singular:
            return None
        if trial is not None:
            energy = body.stored(trial.u, trial.stretch, body.h) / trial.factor**2
            if self._left(2.0 * energy) <= self.limits.severed:
                return None
        return trial

    def _spend(self) -> Trial | None:
        """One step by energy, shortened until it converges."""
        amount = min(self.amount, self.most)
        left, finer = self.body.left(), 0
        for _ in range(HALVINGS["energy"]):
            # springs that come to their end together are met exactly there
            short = amount >= left * (1.0 - NEAR)
            trial = self.body.step(left if short else amount, "energy")
            if trial is not None:
                drift = self.body.drift(trial) / DRIFT
                if drift <= 1.0 or finer == REFINED:
                    grown = amount * self._suits(trial, drift)
                    self.amount = max(grown, self.amount) if short else grown
                    return trial
                finer += 1
            self._count("halved" if trial is None else "refined")
            amount = 0.5 * min(amount, left)
        return None

    def _suits(self, trial: Trial, drift: float) -> float:
        """How much longer the next step should be."""
        ratio = min(WANTED / trial.iterations, (0.5 / max(drift, 0.1)) ** 0.5)
        return float(np.clip(ratio, 0.5, 1.5))

    def by_load(self, factors: Sequence[float]) -> str:
        """Take load factors, one after the other, whatever it needs.

        Returns:
            Why the path ended.
        """
        for target in map(float, factors):
            while abs(target - self.body.factor) > NEAR * abs(target):
                why = self._towards(target)
                if why is not None:
                    return why
        return f"load factor {factors[-1]:.6g} reached"

    def by_rising_load(self, rise: float) -> str:
        """Raise the load from the first softening on, in steps that suit it.

        Args:
            rise: first step, over the factor at which softening begins.

        Returns:
            Why the path ended.
        """
        trial = self._elastic()
        if trial is None:
            return "severed: no bond that may break is stretched"
        why = self._keep(trial.scaled(min(trial.factor, self.limits.factor)))
        first = rise = rise * self.body.factor
        while why is None:
            start, ways = self.body.factor, dict(self.fallbacks)
            why = self._towards(min(start + rise, self.limits.factor))
            went = abs(self.body.factor - start)
            if self.fallbacks["dissipation"] > ways["dissipation"]:
                rise = first  # what was too long then says nothing of the way from here
            else:
                rise = went * self._suited
        return why

    def _towards(self, target: float) -> str | None:
        """To a factor, or part of the way; why the path ends there, or None."""
        body, start = self.body, self.body.factor
        failed = finer = 0
        while failed <= HALVINGS["factor"]:
            part = 0.5 ** (failed + finer)
            trial = body.step(start + (target - start) * part, "factor")
            if trial is not None:
                drift = self.body.drift(trial) / DRIFT
                if drift <= 1.0 or finer == REFINED:
                    self._suited = self._suits(trial, drift)
                    return self._keep(trial)
                finer += 1
                self._count("refined")
            else:
                failed += 1
                self._count("halved")
        if target > start:
            self._count("dissipation")
            why = self.by_energy(target)
            if why is None or not why.startswith("stuck"):
                return why
        self._count("relaxed")
        trial = relaxed(body, target)
        if trial is None:
            return f"stuck: no equilibrium was found at the load factor {target:.6g}"
        return self._keep(trial, damped=True)
