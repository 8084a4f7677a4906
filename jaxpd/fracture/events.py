"""The exact path of brittle springs: from one breaking bond to the next.

Springs are linear, so the load factor at which the most stretched bond stands at its
critical stretch follows from one solution. That bond goes, with those that tie with it,
and the next factor may be higher or lower: snap-back and snap-through are followed as
they are. The monotone envelope, what a testing machine sees, is the running maximum of
the factor (`jaxpd.fracture.growth`).

Mirror images tie: broken one by one they put cracks of symmetric bodies off their
plane.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxpd.fracture.live import Live
from jaxpd.fracture.states import NEVER, States

#: Stretch over the critical one, of what was there at first, that is nothing.
SLACK = 1e-9


@dataclass(frozen=True)
class Limits:
    """Where a path ends.

    Attributes:
        states: most states.
        factor: load factor at which it ends.
        end: mask of bonds [b]: it ends when one of them has gone.
        severed: it ends when the stiffness against the load has fallen to this share.
    """

    states: int
    factor: float
    end: NDArray[np.bool_]
    severed: float


def over_critical(live: Live, states: States, s_crit: Any) -> Any:
    """Stretch over the critical one at the load factor 1 [b] (-), 0 where gone."""
    springs = states.springs
    ratio = (states.map @ live.u.ravel()) / (springs.length * s_crit)
    return np.where(live.intact, ratio, 0.0)


def follow(
    live: Live, states: States, s_crit: Any, ties: float, limits: Limits, pause: Any
) -> str:
    """Follow the path; states are added on the way.

    Args:
        live: the body.
        states: those before; one at rest at least.
        s_crit: critical stretch of each spring [b] (-), inf where it never breaks.
        ties: relative distance from the most stretched within which bonds go together.
        limits: where to end.
        pause: called after each event; returns whether to stop there.

    Returns:
        Why it ended.
    """
    first = states.rows[0].get("first", 0.0)
    while len(states.rows) < limits.states:
        ratio = over_critical(live, states, s_crit)
        top = float(ratio.max(initial=0.0))
        top = 0.0 if len(states.rows) == 1 and rigid(live, states) else top
        first = first or top
        if not top > SLACK * first:
            return "severed: no bond that may break is stretched any more"
        factor = 1.0 / top
        if factor > limits.factor:
            end = {"accepted": True, "critical": -1, **live.cost}
            states.add(limits.factor, live.u, live.intact, **end)
            return f"load factor {limits.factor:.6g} reached"
        states.rows[0]["first"] = first
        worst = int(np.argmax(ratio))
        states.add(
            factor, live.u, live.intact, accepted=True, critical=worst, **live.cost
        )
        go = np.flatnonzero(ratio >= top * (1.0 - ties))
        live.lose(go)
        why = ended(live, states, s_crit, factor, go, limits)
        if why:
            return why
        if pause():
            return "paused"
    return f"the limit of {limits.states} states"


def ended(
    live: Live,
    states: States,
    s_crit: Any,
    factor: float,
    go: NDArray,
    limits: Limits,
) -> str | None:
    """Why a path ends after the bonds `go` went at a factor, or None."""
    if live.torn:
        lost = go[states.broken_at[go] == NEVER]
        states.broken_at[lost] = len(states.rows)  # after the last state
        return "torn: a load pulls at a piece that nothing holds"
    stiff = states.rows[1]["force"] / states.rows[1]["factor"]
    now, why = force_of(live, states), None
    if now <= limits.severed * stiff:
        why = f"severed: {max(now, 0.0) / stiff:.1e} of the stiffness is left"
    elif limits.end[go].any():
        why = "a bond in the region of the end broke"
    if why:
        calm = factor * over_critical(live, states, s_crit).max() <= 1.0 + SLACK
        end = {"accepted": calm, "critical": -1, **live.cost}
        states.add(factor, live.u, live.intact, **end)
    return why


def force_of(live: Live, states: States) -> float:
    """Work of the factor's growth by 1 at the factor 1 (J): twice the energy there."""
    e = states.map @ live.u.ravel()
    return float(np.where(live.intact, states.springs.k * e * e, 0.0).sum())


def rigid(live: Live, states: States) -> bool:
    """Whether the body at the load factor 1 moves, if at all, without strain."""
    e = np.abs(states.map @ live.u.ravel())[live.intact].max(initial=0.0)
    return bool(e <= 1e-10 * np.abs(live.u).max())


def check_loaded(rows: Any, stopped: str) -> None:
    """Refuse a path that never began.

    Raises:
        ValueError: naming the cure.
    """
    if len(rows) == 1 and stopped.startswith("severed"):
        raise ValueError(
            "supports, loads: nothing stretches a bond that may break at a positive "
            "load factor; prescribe displacements that are not zero, or loads, and "
            "mind their signs"
        )
