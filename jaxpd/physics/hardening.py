"""Isotropic hardening: the yield stress of a metal as it has been strained.

A hardening is a frozen pytree, called with the equivalent plastic strain peeq [] (-) to
give the yield stress [] (Pa). Any that JAX can differentiate will do; the return is
sure to converge where it is concave.

Source: E. Voce, J. Inst. Met. 74 (1948) 537-562.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from jaxpd._types import Scalar


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Linear:
    """Yield stress sigma_y + h_iso peeq.

    Attributes:
        sigma_y: initial yield stress [] (Pa), positive.
        h_iso: isotropic hardening modulus [] (Pa).
    """

    sigma_y: Scalar
    h_iso: Scalar

    def __call__(self, peeq: Scalar) -> Scalar:
        """Yield stress [] (Pa)."""
        return self.sigma_y + self.h_iso * peeq


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Voce:
    """Yield stress sigma_y + rise (1 - exp(-rate peeq)) + h_iso peeq, saturating.

    Attributes:
        sigma_y: initial yield stress [] (Pa), positive.
        rise: what saturation adds [] (Pa).
        rate: how soon [] (-).
        h_iso: hardening modulus after saturation [] (Pa).
    """

    sigma_y: Scalar
    rise: Scalar
    rate: Scalar
    h_iso: Scalar

    def __call__(self, peeq: Scalar) -> Scalar:
        """Yield stress [] (Pa)."""
        rise = -self.rise * jnp.expm1(-self.rate * peeq)
        return self.sigma_y + rise + self.h_iso * peeq
