r"""Influence functions: how the stiffness of a bond depends on its length.

The influence function `omega(|xi|)` multiplies the *extension* e = |xi + eta| - |xi| of
a bond, f = c omega e M (paper 000, eqs. 7, 9). Written with the stretch s = e / |xi| it
is c omega |xi| s: the constant micromodulus of the PMB material, f = c s, is omega =
1 / |xi|, the fractional kernel at alpha = 1 - d.

What a law needs for its calibration is one moment,

    I = int_0^delta omega(r) r^(d+1) dr.

An influence function is a frozen pytree with `__call__(r)`; a `moment(d, delta)` in
closed form is optional. Every leaf may be traced and differentiated.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jax.scipy.special import gammainc, gammaln

from jaxpd._types import Scalar
from jaxpd.checks import number


@runtime_checkable
class Influence(Protocol):
    """Anything that maps bond lengths (m) to weights."""

    def __call__(self, r: Scalar) -> Scalar:
        """Weight of a bond of reference length r > 0."""
        ...


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Fractional:
    """Fractional-Laplacian kernel omega = 1 / r^(d + alpha) (paper 000, eq. 9).

    Attributes:
        alpha: order of the kernel [] (-), below 2, where the calibration exists.
        d: space dimensions.
    """

    alpha: Scalar
    d: int = field(metadata={"static": True})

    def __call__(self, r: Scalar) -> Scalar:
        """Weight (m^-(d + alpha)) of a bond of length r > 0 (m)."""
        return r ** -(self.d + self.alpha)

    def moment(self, d: int, delta: Scalar) -> Scalar:
        """I = delta^(2 - alpha) / (2 - alpha) (paper 000, eq. 12)."""
        power = 2.0 - self.alpha + (d - self.d)
        return delta**power / power


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Constant:
    """omega = 1: the force follows the extension, whatever the length."""

    def __call__(self, r: Scalar) -> Scalar:
        """Weight 1 (-)."""
        return jnp.ones_like(r)

    def moment(self, d: int, delta: Scalar) -> Scalar:
        """I = delta^(d + 2) / (d + 2)."""
        return delta ** (d + 2) / (d + 2.0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Conical:
    """omega = 1 - r / delta: falls linearly to zero at the horizon.

    Attributes:
        delta: horizon [] (m).
    """

    delta: Scalar

    def __call__(self, r: Scalar) -> Scalar:
        """Weight (-) of a bond of length r (m), zero beyond the horizon."""
        return jnp.maximum(1.0 - r / self.delta, 0.0)

    def moment(self, d: int, delta: Scalar) -> Scalar:
        """I over the cone, or up to the horizon `delta` where that is smaller."""
        R = jnp.minimum(delta, self.delta)
        return R ** (d + 2) * (1.0 / (d + 2) - R / self.delta / (d + 3))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Gaussian:
    """omega = exp(-(r / length)^2).

    Attributes:
        length: decay length [] (m), positive; a third of the horizon is common.
    """

    length: Scalar

    def __call__(self, r: Scalar) -> Scalar:
        """Weight (-) of a bond of length r (m)."""
        return jnp.exp(-((r / self.length) ** 2))

    def moment(self, d: int, delta: Scalar) -> Scalar:
        """I through the incomplete gamma function."""
        a = 0.5 * (d + 2)
        whole = jnp.exp(gammaln(a)) * gammainc(a, (delta / self.length) ** 2)
        return 0.5 * self.length ** (d + 2) * whole


def check_order(alpha: float) -> None:
    """Refuse an order of the fractional kernel without a calibration.

    Raises:
        ValueError: if alpha >= 2, where the moment diverges.
    """
    diverges = "the energy of 1/r^(d+alpha) diverges from there on (paper 000, eq. 12)"
    number("alpha", alpha, below=2, cure=diverges)


def moment(omega: Influence, d: int, delta: Scalar) -> Scalar:
    """I = int_0^delta omega(r) r^(d+1) dr: closed form, or 64-point Gauss-Legendre."""
    closed = getattr(omega, "moment", None)
    if closed is not None:
        return closed(d, delta)
    x, w = np.polynomial.legendre.leggauss(64)
    r = 0.5 * delta * jnp.asarray(x + 1.0)
    values = jax.vmap(omega)(r)
    return 0.5 * delta * jnp.sum(jnp.asarray(w) * values * r ** (d + 1))
