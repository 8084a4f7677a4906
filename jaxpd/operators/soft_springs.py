"""Springs that soften, behind the protocol of `jaxpd.operators.protocol`.

A pure function of displacements, memory and parameters: for taking a path again, and
for its derivatives.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointTensor, PointVector, Scalar
from jaxpd.operators.springs import Springs
from jaxpd.physics.bilinear import Bilinear

#: Stiffness of broken springs in the tangent, over that at first: points that came off
#: stay where they are. No force comes of it.
GHOST = 1e-10


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SpringTangent:
    """Stiffness of springs of any slopes; symmetric.

    Attributes:
        springs: whose ends and directions count.
        slope: derivative of each tension in the elongation [b] (N/m).
        count: number of points n.
    """

    springs: Springs
    slope: Any
    count: int = field(metadata={"static": True})

    symmetric = True

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        pull = self.slope * self.springs.elongation(du)
        return -self.springs.force(pull, self.count)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m)."""
        blocks = self._blocks()
        zero = jnp.zeros((self.count, *blocks.shape[1:]), blocks.dtype)
        return zero.at[self.springs.i].add(blocks).at[self.springs.j].add(blocks)

    def _blocks(self) -> Any:
        n = self.springs.n
        return self.slope[:, None, None] * n[:, :, None] * n[:, None, :]

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows and columns [4 b] and blocks of K; duplicates add up."""
        i, j, blocks = self.springs.i, self.springs.j, self._blocks()
        rows, columns = jnp.concatenate([i, j, i, j]), jnp.concatenate([i, j, j, i])
        return rows, columns, jnp.concatenate([blocks, blocks, -blocks, -blocks])

    def to_bsr(self) -> sp.csr_array:
        """K as a sparse matrix on the host."""
        B = self.springs.differences(self.count)
        return (B.T @ B.multiply(np.asarray(self.slope)[:, None]).tocsr()).tocsr()


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
