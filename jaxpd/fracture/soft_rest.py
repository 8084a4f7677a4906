"""Equilibrium of softening springs at a held load, by motion that is damped.

Masses are fictitious, as small as a unit time step allows. Kinetic damping: where the
kinetic energy has passed its maximum the velocity is set to zero. The trial memory is
that of the displacements alone, so that an overshoot breaks nothing; what is found at
rest is polished by Newton's method.

Source: M. R. Barnes, Int. J. Space Struct. 14 (1999), dynamic relaxation with kinetic
damping. Host only.
"""

from __future__ import annotations

import numpy as np

from jaxpd.fracture.soft import SoftBody, Trial

#: Fictitious masses over the least that a unit step is stable with.
SPARE = 1.1
#: Residuals over the forces at which Newton's method is tried, and most time steps.
TRIES, STEPS = (1e-3, 1e-5, 1e-7), 40_000


def relaxed(body: SoftBody, factor: float) -> Trial | None:
    """The state that motion comes to rest in at a load factor.

    Args:
        body: in its committed state, which is left as it is.
        factor: load factor, held.

    Returns:
        None if it does not come to rest.
    """
    held = body.fixed.ravel()
    u = np.where(held, factor * body.lift, body.u)
    mass = 0.25 * SPARE * body.row_sums()
    v = np.zeros_like(u)
    kinetic = 0.0
    tries = list(TRIES)
    for step in range(STEPS):
        s = body.stretch(u)
        inner = body.inner(u, s, body.h)
        pull = np.where(held, 0.0, factor * body.load - inner)
        scale = np.linalg.norm(factor * body.load) + np.linalg.norm(inner[held])
        if np.linalg.norm(pull) <= tries[0] * max(scale, body.scale):
            trial = body.step(factor, "factor", Trial(u, factor, s, step))
            if trial is not None:
                return trial
            tries.pop(0)
            if not tries:
                return None
        v += pull / mass
        now = 0.5 * float(mass @ (v * v))
        if now < kinetic:
            v[:], now = 0.0, 0.0
        kinetic = now
        u = u + v
    return None
