"""Adaptive dynamic relaxation: equilibrium by damped motion, without any tangent.

Masses are fictitious, as small as a unit time step allows, and the damping follows the
lowest frequency that is still moving, a Rayleigh quotient of the last increment,

    omega^2 = -du . df / (du . M du),
    v (2 + 2 omega) = (2 - 2 omega) v_old + 2 M^-1 (force + load)

(P. Underwood, Dynamic relaxation, 1983; B. Kilic, E. Madenci, Theor. Appl. Fract. Mech.
53 (2010), with the quotient of increments for that of displacements).
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

#: Fictitious masses over the least that a unit step is stable with.
SPARE = 1.1
#: Residuals kept in the record.
KEPT = 200


def relax(
    op: Any,
    mass: jax.Array,
    load: jax.Array,
    fixed: jax.Array | None,
    u: jax.Array,
    history: Any,
    rtol: Any,
    max_steps: Any,
) -> tuple[Any, ...]:
    """Displacements in equilibrium; the bonds may break on the way.

    Args:
        op: operator with `commit(u, history) -> force, history`.
        mass: fictitious masses [L].
        load: external forces [d, L] (N).
        fixed: mask of prescribed entries [d, L], or None.
        u: where to begin, prescribed entries at their values [d, L] (m).
        history: the operator's memory.
        rtol: relative tolerance of the residual, over the load or the reactions.
        max_steps: most steps.

    Returns:
        u, history, steps, the last relative residual, and up to `KEPT` of them, evenly
        spread over `max_steps`, NaN where none was taken.
    """
    mass = mass[None]
    free = 1.0 if fixed is None else jnp.where(fixed, 0.0, 1.0).astype(u.dtype)
    stride = jnp.maximum(1, max_steps // KEPT)

    def residual(force):
        pull = force + load
        held = jnp.linalg.norm((1.0 - free) * pull)
        scale = jnp.maximum(jnp.linalg.norm(free * load), held)
        size = jnp.linalg.norm(free * pull)
        return size / jnp.where(scale > 0.0, scale, 1.0)

    def going(carry):
        step, *_, rest, _ = carry
        return (step < max_steps) & (rest > rtol) & jnp.isfinite(rest)

    def move(carry):
        step, u, v, force, history, omega, rest, log = carry
        pull = free * (force + load) / mass
        v = ((2.0 - 2.0 * omega) * v + 2.0 * pull) / (2.0 + 2.0 * omega)
        after, history = op.commit(u + v, history)
        stiff = -jnp.sum(v * (after - force) * free)
        heavy = jnp.sum(mass * v * v)
        omega = jnp.sqrt(jnp.clip(stiff / jnp.where(heavy > 0.0, heavy, 1.0), 0.0, 1.0))
        rest = residual(after)
        at = jnp.minimum(step // stride, KEPT - 1)
        return step + 1, u + v, v, after, history, omega, rest, log.at[at].set(rest)

    force, history = op.commit(u, history)
    log = jnp.full(KEPT, jnp.nan, u.dtype)
    zero = jnp.zeros((), u.dtype)
    begin = (0, u, jnp.zeros_like(u), force, history, zero, residual(force), log)
    step, u, _, _, history, _, rest, log = jax.lax.while_loop(going, move, begin)
    return u, history, step, rest, log
