"""Load steps of brittle springs: freeze the bonds, solve, break, until none breaks.

At each load factor the bonds above their strength go, all of them or the few that are
stretched most, and the body is solved again. Every pass is a state of its own, so that
work and release stay exact; a state in which no bond is above its strength is accepted.
Between steps the elastic way is skipped: the next factor is at least that of the next
event.

Measured (double cantilever, m = 3): with failure confined to a plane all at once and
few at a time end at the same crack; free to fail anywhere, all at once in coarse steps
destroys the arms, one tied group at a time does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxpd.fracture.events import SLACK, Limits, ended, over_critical, rigid
from jaxpd.fracture.live import Live
from jaxpd.fracture.states import States


def most_stretched(ratio: Any, factor: float, few: int | None, ties: float) -> Any:
    """Numbers of the bonds that go at a load factor: all, or about the `few` first."""
    over = np.flatnonzero(factor * ratio >= 1.0 - ties)
    if few is None or len(over) <= few:
        return over
    least = np.partition(ratio[over], -few)[-few]
    return over[ratio[over] >= least * (1.0 - ties)]


def march(
    live: Live,
    states: States,
    s_crit: Any,
    factors: Sequence[float] | float,
    few: int | None,
    ties: float,
    limits: Limits,
    pause: Any,
) -> str:
    """Take load steps; states are added on the way.

    Args:
        live: the body.
        states: those before; one at rest at least.
        s_crit: critical stretch of each spring [b] (-), inf where it never breaks.
        factors: load factors, or one number: the step over the first breaking factor.
        few: how many bonds go in a pass, those that tie with the last too; None is all.
        ties: relative distance from the strength that is none.
        limits: where to end.
        pause: called after each pass; returns whether to stop there.

    Returns:
        Why it ended.
    """
    first = states.rows[0].get("first", 0.0)
    share: Any = factors  # or the factors themselves
    given = None if np.ndim(share) == 0 else np.asarray(share, float)
    target = states.rows[-1]["factor"]
    open_ = len(states.rows) > 1 and bool(states.rows[-1]["open"])
    while len(states.rows) < limits.states:
        ratio = over_critical(live, states, s_crit)
        top = float(ratio.max(initial=0.0))
        if len(states.rows) == 1 and rigid(live, states):
            return "severed: no bond is stretched"
        first = first or top
        states.rows[0]["first"] = first
        if not open_:
            if states.rows[-1]["factor"] >= limits.factor:
                return f"load factor {limits.factor:.6g} reached"
            if given is None:
                if not top > SLACK * first:
                    return "severed: no bond that may break is stretched any more"
                target = max(target + float(share) / first, 1.0 / top)
            else:
                later = given[given > target * (1.0 + 1e-12)]
                if not len(later):
                    return "all load steps are done"
                target = float(later[0])
            target = min(target, limits.factor)
        go = most_stretched(ratio, target, few, ties)
        open_ = len(go) > 0
        # a bond just at its strength stands in equilibrium, and goes
        calm = target * top <= 1.0 + ties
        more = {"accepted": calm, "open": open_, "critical": -1, **live.cost}
        states.add(target, live.u, live.intact, **more)
        if open_:
            live.lose(go)
            why = ended(live, states, s_crit, target, go, limits)
            if why:
                return why
        if pause():
            return "paused"
    return f"the limit of {limits.states} states"
