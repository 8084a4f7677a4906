"""Slow fracture of bonds that soften: from what was prepared to a `Growth`."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxpd.fracture.breaking import Fracture
from jaxpd.fracture.events import Limits, check_loaded
from jaxpd.fracture.growth import Growth
from jaxpd.fracture.soft import SoftBody
from jaxpd.fracture.soft_states import SoftStates
from jaxpd.fracture.soft_walk import WAYS, SoftWalk
from jaxpd.operators.springs import Springs
from jaxpd.physics.bilinear import Bilinear, checked_ratio
from jaxpd.run import peak_memory
from jaxpd.scene import Scene

#: Linear solvers of the tangent; "auto" is direct.
SOLVERS = ("auto", "direct", "d-pcg")
#: Energy of the first step and largest, over the middle one of the bonds that soften.
FIRST, LARGEST = 1.0, 8.0


@dataclass(frozen=True)
class Soft:
    """How bonds soften and what is controlled.

    Attributes:
        ratio: stretch without force over that of the largest force.
        factors: load factors, in their order; a number raises the load from the first
            softening on, by that share at first; None is control by spent energy.
        amount: largest energy that a step under control by energy spends (J).
        solver: "d-pcg" iterates; any other is direct.
        pause: called after each state.
    """

    ratio: float
    factors: Sequence[float] | float | None
    amount: float | None
    solver: str
    pause: Callable[[], object]


def check_softening(
    softening: float | None,
    amount: float | None,
    solver: str,
    brittle: Mapping[str, object],
) -> None:
    """Refuse settings that mean nothing to a softening path.

    Args:
        softening: the ratio, or None.
        amount: largest energy of a step (J), or None.
        solver: of the tangent.
        brittle: what only brittle bonds know, by name, None where it was not given.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    if softening is None:
        if amount is not None:
            raise ValueError(f"amount: {amount} is for softening bonds; give softening")
        return
    checked_ratio(softening)
    if amount is not None and not (np.isfinite(amount) and amount > 0):
        raise ValueError(f"amount: {amount} must be a positive energy (J), or None")
    if solver not in SOLVERS:
        raise ValueError(f"solver: {solver!r} must be one of {SOLVERS} with softening")
    for name, value in brittle.items():
        if value is not None:
            raise ValueError(f"{name}: {value} is for brittle bonds; leave it out")


def soften(
    scene: Scene,
    fracture: Fracture,
    numbers: tuple[Springs, NDArray[np.floating]],
    limits: Limits,
    watch: tuple[NDArray[np.bool_], ...],
    how: Soft,
    started: float,
) -> Growth:
    """Follow the path of softening bonds.

    Args:
        scene: what breaks.
        fracture: what it was prepared into.
        numbers: its springs and their critical stretches, on the host.
        limits: where to end.
        watch: masks of points [n].
        how: softening and control.
        started: when preparation began, of `time.perf_counter`.
    """
    springs, s_crit = numbers
    fixed, cut = np.asarray(fracture.fixed), np.asarray(fracture.cut)
    prescribed, load = (np.asarray(fracture.params[k]) for k in ("prescribed", "load"))
    law = Bilinear(None, s_crit, float(how.ratio))
    solver = "d-pcg" if how.solver == "d-pcg" else "direct"
    body = SoftBody(springs, law, fixed, prescribed, load, ~cut, solver)
    states = SoftStates(body, watch)
    largest = (
        LARGEST * float(np.median(body.most)) if how.amount is None else how.amount
    )
    first = FIRST / LARGEST * largest
    walk = SoftWalk(body, states, limits, first, largest, how.pause)
    ready = time.perf_counter()
    if how.factors is None:
        stopped = walk.by_energy() or ""
    elif np.ndim(how.factors):
        stopped = walk.by_load(np.asarray(how.factors, float).tolist())
    else:
        stopped = walk.by_rising_load(float(np.asarray(how.factors)))
    check_loaded(states.rows, stopped)
    counted = {k: states.column(k) for k in ("iterations", *WAYS)}
    for name in ("solves", "factorisations", "seconds"):
        counted[name] = np.diff(states.column(name), prepend=0.0)
    return Growth(
        scene=scene,
        fracture=fracture,
        springs=springs,
        factor=states.column("factor"),
        force=states.column("force"),
        pull=states.column("pull"),
        critical=np.full(len(states.rows), -1),
        accepted=np.ones(len(states.rows), bool),
        held=states.held,
        reaction=np.array(states.reactions),
        watched=np.array(states.watched),
        stored=states.column("stored"),
        work=states.column("work"),
        released=states.column("released"),
        bonds=states.column("bonds"),
        broken_at=states.broken_at,
        u=body.u.reshape(fixed.shape),
        floppy=np.zeros(len(fixed), bool),
        cost=counted,
        fallbacks=walk.fallbacks,
        stopped=stopped,
        done=not stopped.startswith(("the limit", "stuck")),
        seconds={"prepare": ready - started, "path": time.perf_counter() - ready},
        peak_memory=peak_memory(),
        softened=states.softened(),
    )
