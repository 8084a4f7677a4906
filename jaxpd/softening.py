"""Slow fracture of bonds that soften: from what was prepared to a `Growth`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxpd.breaking import Fracture
from jaxpd.events import Limits
from jaxpd.growth import Growth
from jaxpd.operators.springs import Springs
from jaxpd.physics.bilinear import Bilinear, checked_ratio
from jaxpd.run import peak_memory
from jaxpd.scene import Scene
from jaxpd.soft import SoftBody
from jaxpd.soft_states import SoftStates
from jaxpd.soft_walk import WAYS, SoftWalk

#: Energy of the first step and largest, over the middle one of the bonds that soften.
FIRST, LARGEST = 1.0, 8.0


def check_softening(
    softening: float | None,
    amount: float | None,
    brittle: tuple[Any, ...],
    solver: str,
) -> None:
    """Refuse settings of a softening path that mean nothing.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    if softening is not None:
        checked_ratio(softening)
        if any(x is not None for x in brittle) or solver not in ("auto", "direct"):
            raise ValueError(
                "few, ties, folder, solver: are for brittle bonds; leave them out with "
                f"softening={softening}"
            )
    elif amount is not None:
        raise ValueError(f"amount: {amount} is for softening bonds; leave it out")
    if amount is not None and not (np.isfinite(amount) and amount > 0):
        raise ValueError(f"amount: {amount} must be a positive energy (J), or None")


def soften(
    scene: Scene,
    fracture: Fracture,
    numbers: tuple[Springs, NDArray[np.floating]],
    limits: Limits,
    watch: tuple[NDArray[np.bool_], ...],
    *,
    softening: float,
    factors: Sequence[float] | float | None,
    amount: float | None,
    started: float,
) -> Growth:
    """Follow the path of softening bonds.

    Args:
        scene: what breaks.
        fracture: what it was prepared into.
        numbers: its springs and their critical stretches, on the host.
        limits: where to end.
        watch: masks of points [n].
        softening: stretch without force over that of the largest force.
        factors: load factors, in their order; a number raises the load by that share
            of the first softening factor to begin with; None is control by energy.
        amount: largest energy that a step spends (J).
        started: when preparation began, of `time.perf_counter`.
    """
    springs, s_crit = numbers
    fixed, cut = np.asarray(fracture.fixed), np.asarray(fracture.cut)
    prescribed, load = (np.asarray(fracture.params[k]) for k in ("prescribed", "load"))
    law = Bilinear(None, s_crit, float(softening))
    body = SoftBody(springs, law, fixed, prescribed, load, ~cut)
    states = SoftStates(body, watch)
    largest = LARGEST * float(np.median(body.most)) if amount is None else amount
    walk = SoftWalk(body, states, limits, FIRST / LARGEST * largest, largest)
    ready = time.perf_counter()
    if factors is None:
        stopped = walk.by_energy() or ""
    elif isinstance(factors, float | int):
        stopped = walk.by_rising_load(float(factors))
    else:
        stopped = walk.by_load(factors)
    counted = {k: states.column(k) for k in ("iterations", *WAYS)}
    for name in ("solves", "factorisations", "seconds"):
        counted[name] = np.diff(states.column(name), prepend=0.0)
    return Growth(
        scene=scene,
        fracture=fracture,
        springs=springs,
        factor=states.column("factor"),
        force=states.column("force"),
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
