"""Prescribed displacements, eliminated by projection.

Vectors keep their full shape [n, d]; a mask says which entries are prescribed. The
operator of the free entries, P K P with P zero on prescribed ones, acts on the same
arrays as K does: nothing is renumbered inside a trace.
"""

from __future__ import annotations

from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointTensor, PointVector


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Constraints:
    """Which displacements are prescribed, and their values at full load.

    Attributes:
        fixed: mask [n, d], True where prescribed.
        values: prescribed displacements [n, d] (m); read where `fixed` alone.
    """

    fixed: jax.Array
    values: PointVector

    def project(self, v: PointVector) -> PointVector:
        """Set prescribed entries of v to zero; idempotent and symmetric."""
        return jnp.where(self.fixed, 0.0, v)

    def lift(self, load_factor: jax.Array | float = 1.0) -> PointVector:
        """The prescribed displacements times `load_factor`, zero elsewhere."""
        return jnp.where(self.fixed, load_factor * self.values, 0.0)

    def diagonal(self, blocks: PointTensor) -> PointTensor:
        """Block diagonal [n, d, d] of P K P with units on the prescribed rows."""
        free = ~self.fixed
        kept = jnp.where(free[:, :, None] & free[:, None, :], blocks, 0.0)
        eye = jnp.eye(blocks.shape[-1], dtype=blocks.dtype)
        return kept + jnp.where(self.fixed[:, :, None], eye[None], 0.0)


def fix(mask: np.ndarray, values: np.ndarray | float = 0.0) -> Constraints:
    """Constraints from a mask [n, d] and values [n, d] or [] (m)."""
    fixed = jnp.asarray(np.asarray(mask, bool))
    return Constraints(fixed, jnp.broadcast_to(jnp.asarray(values, float), fixed.shape))
