"""The door of slow fracture: `solve_fracture`."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import jax
import numpy as np

from jaxpd.breaking import Fracture, prepare_fracture
from jaxpd.events import Limits, follow
from jaxpd.geometry import Region
from jaxpd.growth import Growth
from jaxpd.live import DirectLive
from jaxpd.run import peak_memory
from jaxpd.scene import Scene
from jaxpd.softening import check_softening, soften
from jaxpd.states import States


@jax.jit
def _numbers(fracture: Fracture) -> Any:
    params = fracture.params
    return fracture.springs(params), fracture.critical(params)


def solve_fracture(
    scene: Scene,
    *,
    toughness: str | float = "nominal",
    ties: float = 1e-7,
    end: Region | None = None,
    max_factor: float = np.inf,
    max_states: int = 20_000,
    severed: float = 1e-6,
    watch: Sequence[Region] = (),
    softening: float | None = None,
    control: str = "dissipation",
    factors: Sequence[float] | None = None,
    amount: float | None = None,
) -> Growth:
    """Break a scene slowly, from one equilibrium to the next."""
    started = time.perf_counter()
    check_softening(softening, control, factors, amount)
    fracture = prepare_fracture(scene, toughness)
    springs, s_crit = jax.tree.map(np.asarray, _numbers(fracture))
    X = np.asarray(fracture.X)
    fixed = np.asarray(fracture.fixed)
    prescribed, load = (np.asarray(fracture.params[k]) for k in ("prescribed", "load"))
    cut = np.asarray(fracture.cut)
    middle = 0.5 * (X[springs.i] + X[springs.j])
    last = np.zeros(len(cut), bool) if end is None else end.contains(middle)
    limits = Limits(max_states, max_factor, last, severed)
    seen = tuple(region.contains(X) for region in watch)
    if softening is not None:
        return soften(
            scene,
            fracture,
            (springs, s_crit),
            limits,
            seen,
            softening=softening,
            control=control,
            factors=factors,
            amount=amount,
            started=started,
        )
    live = DirectLive(springs, fixed, prescribed, load, ~cut)
    states = States(springs, fixed, load, cut, seen)
    states.add(0.0, live.u, live.intact)
    ready = time.perf_counter()
    stopped = follow(live, states, s_crit, ties, limits, lambda: False)
    seconds = {"prepare": ready - started, "path": time.perf_counter() - ready}
    return Growth(
        scene=scene,
        fracture=fracture,
        springs=springs,
        factor=states.column("factor"),
        force=states.column("force"),
        accepted=np.ones(len(states.rows), bool),
        held=states.held,
        reaction=np.array(states.reactions),
        watched=np.array(states.watched),
        stored=states.column("stored"),
        work=states.column("work"),
        released=states.column("released"),
        bonds=states.column("bonds"),
        broken_at=states.broken_at,
        u=states.rows[-1]["factor"] * live.u,
        floppy=live.floppy,
        cost={},
        fallbacks={},
        stopped=stopped,
        done=not stopped.startswith("the limit"),
        seconds=seconds,
        peak_memory=peak_memory(),
    )
