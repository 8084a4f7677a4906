"""Springs that soften, behind the protocol of `jaxpd.operators.protocol`.

A pure function of displacements, memory and parameters: for taking a path again, and
for its derivatives.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointVector, Scalar
from jaxpd.operators.springs import Springs, SpringTangent
from jaxpd.physics.bilinear import Bilinear

#: Stiffness of broken springs in the tangent, over that at first: points that came off
#: stay where they are. No force comes of it.
GHOST = 1e-10


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SoftSprings:
    """Forces of springs that soften.

    Attributes:
        springs: all of them; k is zero where a crack has cut one.
        law: softening of each, `s_crit` [b] inf where it never does.
        h: largest stretch of each so far [b] (-).
    """

    springs: Springs
    law: Bilinear
    h: Any

    unit, symmetric, linear = "N", True, False

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal force [n, d] (N)."""
        springs = self.springs
        s = springs.stretch(u)
        pull = springs.k * springs.length * self.law.tension(s, self.h)
        return springs.force(pull, len(u))

    def tangent(self, u: PointVector, history: Any = None) -> SpringTangent:
        """Stiffness at u, by hand."""
        slope = self.law.slope(self.springs.stretch(u), self.h)
        slope = self.springs.k * jnp.where(slope == 0.0, GHOST, slope)
        return SpringTangent(self.springs, slope, len(u))

    def exact(self) -> SoftSprings:
        """Itself: the tangent is the derivative."""
        return self

    def history0(self) -> Any:
        """The memory of untouched springs [b]."""
        return jnp.zeros_like(self.springs.k)

    def advance(self, u: PointVector, history: Any = None) -> Any:
        """The memory after u [b]."""
        return jnp.maximum(self.h, self.springs.stretch(u))

    def after(self, h: Any) -> SoftSprings:
        """This with another memory."""
        return dataclasses.replace(self, h=h)

    def energy(self, u: PointVector, history: Any = None) -> Scalar:
        """Stored energy [] (J)."""
        e = self.springs.elongation(u)
        left = self.law.share(self.advance(u))
        return 0.5 * jnp.sum(self.springs.k * left * e * e)

    def spent(self) -> Scalar:
        """Energy [] (J) that is gone for good by the memory."""
        s_crit: Any = self.law.s_crit
        safe = jnp.where(jnp.isfinite(s_crit), s_crit, 0.0) * self.springs.length
        return 0.5 * jnp.sum(self.springs.k * safe * safe * self.law.used(self.h))
