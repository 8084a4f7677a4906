"""Return to von Mises' yield surface: one scalar equation, in every state of a solid.

In the modes that elasticity and von Mises' norm share, nothing is coupled but by the
length of the step. With the trial relative stress z [r], scaled so that its length is
the equivalent stress q, backward Euler says

    z_i -> z_i Y / L_i,    L_i = Y(peeq + dgamma) + kappa_i dgamma,
    sum_i (z_i / L_i)^2 = 1,    strain_p += M^T (dgamma T z / L).

Where all kappa are equal (bar, plane strain, solid: the radial return) and hardening is
linear, dgamma is explicit. Otherwise, and always in plane stress, it is the root of one
equation. `jax.lax.custom_root` differentiates that equation, not the iterations.

    M      modes of a Voigt strain                        [r, s]  -
    share  of a mode's strain that is deviatoric          [r]     -
    T      scale of a mode's stress                       [r]     -
    k      stress per plastic strain of a mode / share    [r]     Pa
    kappa  T^2 k + h_kin                                  [r]     Pa

Sources: J. C. Simo, T. J. R. Hughes, Computational Inelasticity (1998), boxes 3.1-3.3;
J. C. Simo, R. L. Taylor, Int. J. Numer. Methods Eng. 22 (1986) 649-670 (plane stress).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import Scalar
from jaxpd.physics.elastic import shear_modulus

#: Steps of the local Newton iteration: bisection alone halves [0, 1] to round-off.
LIMIT = 60

_MEAN, _HALF = [1.0, 1.0, 0.0], [1.0, -1.0, 0.0]
_PLANE = np.array([_MEAN, _HALF, [0, 0, 2**0.5]]) / 2**0.5
_SOLID = np.zeros((5, 6))
_SOLID[0, :3] = np.array(_HALF) / 2**0.5
_SOLID[1, :3] = np.array([1.0, 1.0, -2.0]) / 6**0.5
_SOLID[2:, 3:] = np.eye(3)
#: M, share and T^2 of each state.
_MODES = {
    "bar": (np.eye(1), [1.0], [1.0]),
    "plane stress": (_PLANE, [1.0, 1.0, 1.0], [0.5, 1.5, 3.0]),
    "plane strain": (_PLANE, [1.0 / 3.0, 1.0, 1.0], [0.5, 1.5, 3.0]),
    "solid": (_SOLID, [1.0] * 5, [1.5, 1.5, 3.0, 3.0, 3.0]),
}


def modes(
    E: Scalar, nu: Scalar | None, state: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, Any]:
    """M [r, s], share [r], T [r] and k [r] (Pa) of a state.

    The zz of a plane is in them: its plastic strain is -(xx + yy), and in plane strain
    two thirds of (xx + yy) are volumetric.
    """
    M, share, square = _MODES[state]
    ratio: Any = nu
    G = shear_modulus(E, nu, state)
    if state == "bar":
        k = [E]
    elif state == "plane stress":
        k = [E / (1.0 - ratio), 2.0 * G, G]
    elif state == "plane strain":
        k = [6.0 * G, 2.0 * G, G]
    else:
        k = [2.0 * G, 2.0 * G, G, G, G]
    return M, np.array(share), np.sqrt(square), jnp.stack([jnp.asarray(v) for v in k])


def bracketed_newton(residual: Callable, start: Any) -> Any:
    """Root [] in [0, 1] of a residual [] that is negative below it, to round-off.

    Newton's step where it stays inside the bracket and the residual has halved, else
    the bracket's middle. A residual that is not finite counts as past the root. Whether
    it is a root is for the caller to check.
    """
    eps = jnp.finfo(start.dtype).eps

    def evaluate(x: Any) -> tuple[Any, Any]:
        return jax.jvp(residual, (x,), (jnp.ones_like(x),))

    def unfinished(carry: tuple) -> Any:
        count, _, _, _, value, _, _, moved = carry
        return (count < LIMIT) & moved & ~(jnp.abs(value) <= 2.0 * eps)

    def advance(carry: tuple) -> tuple:
        count, x, low, high, value, slope, poor, _ = carry
        low, high = jnp.where(value < 0, x, low), jnp.where(value < 0, high, x)
        y = x - value / slope
        y = jnp.where(poor | ~((y >= low) & (y <= high)), 0.5 * (low + high), y)
        new, slope = evaluate(y)
        poor = ~(jnp.abs(new) <= 0.5 * jnp.abs(value))
        return count + 1, y, low, high, new, slope, poor, y != x

    value, slope = evaluate(start)
    low, high, no = jnp.zeros_like(start), jnp.ones_like(start), jnp.asarray(False)
    first = (jnp.asarray(0), start, low, high, value, slope, no, ~no)
    return jax.lax.while_loop(unfinished, advance, first)[1]


def multiplier(
    z: Any, kappa: Any, hardening: Callable, peeq: Scalar
) -> tuple[Scalar, Any]:
    """Growth dgamma of `peeq` [] that returns z [r] (Pa) to the surface; if it did.

    The unknown is x = kappa dgamma / q, between 0 and 1 and without a unit. The inverse
    of the length of z / L is concave in it, and linear in a radial return, if the yield
    stress is: Newton's iteration from 0 then rises to the root and never passes it.

    Args:
        z: trial relative stress, outside the surface.
        kappa: [r] (Pa), positive.
        hardening: yield stress (Pa) of peeq.
        peeq: equivalent plastic strain before the step.
    """
    # a choice of units, on which the answer does not depend: no derivative
    scale = jax.lax.stop_gradient(jnp.sqrt((z * z).sum()) / kappa.min())

    def residual(x: Any) -> Any:
        dgamma = scale * x
        Y = hardening(peeq + dgamma)
        ratio = z / (Y + kappa * dgamma)
        value = 1.0 / jnp.sqrt((ratio * ratio).sum()) - 1.0
        # beyond a yield stress of nothing there is no surface: past the root
        return value + jnp.where(Y > 0, 0.0, jnp.nan)

    x = jax.lax.custom_root(
        residual, jnp.zeros_like(scale), bracketed_newton, lambda g, y: y / g(1.0)
    )
    left = jax.lax.stop_gradient(jnp.abs(residual(x)))
    return scale * x, left <= 1e3 * jnp.finfo(scale.dtype).eps
