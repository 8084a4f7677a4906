"""Small displacements: operators whose force is linear, respond(u) = -K u."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointVector
from jaxpd.operators.bonds import BondForce
from jaxpd.operators.protocol import Tangent
from jaxpd.operators.pulled import Pulled


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class LinearForce:
    """The force of a stiffness.

    Attributes:
        K: a `Tangent` with a product that may be differentiated in its leaves.
    """

    K: Any

    unit, linear = "N", True

    @property
    def symmetric(self) -> bool:
        """Whether K is symmetric."""
        return self.K.symmetric

    def respond(self, u: PointVector, history: None = None) -> PointVector:
        """Internal force -K u [n, d] (N)."""
        return -self.K.mv(u)

    def tangent(self, u: PointVector, history: None = None) -> Tangent:
        """K, whatever u."""
        return self.K

    def exact(self) -> LinearForce:
        """Itself: K is its derivative."""
        return self


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class BondsAtRest:
    """Bond forces, linear about the undeformed body.

    The same force as that of the stiffness at rest, but without its blocks: what is
    differentiated in weights and laws is a sweep over the bonds, with no array of
    blocks and none of their derivatives.

    Attributes:
        bonds: the bonds, on more points than the body's where pulled.
    """

    bonds: BondForce | Pulled

    unit, linear = "N", True

    @property
    def symmetric(self) -> bool:
        """Whether tangents are symmetric."""
        return self.bonds.symmetric

    def respond(self, u: PointVector, history: None = None) -> PointVector:
        """Internal force [n, d] (N): the derivative at rest along u."""
        return jax.jvp(self.bonds.respond, (jnp.zeros_like(u),), (u,))[1]

    def tangent(self, u: PointVector, history: None = None) -> Tangent:
        """Stiffness at rest, whatever u."""
        return self.bonds.tangent(jnp.zeros_like(u))

    def exact(self) -> BondsAtRest:
        """The same with blocks by `jax.jacfwd`."""
        return dataclasses.replace(self, bonds=self.bonds.exact())
