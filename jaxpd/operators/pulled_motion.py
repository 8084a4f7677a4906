"""Operators of motion on more points than move: P^T force(P u), see `pulled`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointTensor
from jaxpd.discretize.extension import Extension


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class PulledMotion:
    """An operator of motion on extended points, pulled back to the body's.

    Attributes:
        op: the operator on all points.
        P: the extension.
    """

    op: Any
    P: Extension

    def plain(self) -> PulledMotion:
        """The same without the hand-derived rule, for forward mode."""
        return PulledMotion(self.op.plain(), self.P)

    def lay(self, values: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of the body as they are kept: [n] or [d, n]."""
        return jnp.asarray(values).T

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of what is kept."""
        return row.T

    def _all(self, u: jax.Array) -> jax.Array:
        return self.op.lay(self.P(u.T))

    def commit(self, u: jax.Array, history: Any) -> tuple[jax.Array, Any]:
        """Nodal forces [d, n] (N) on the body and the memory after u."""
        force, history = self.op.commit(self._all(u), history)
        return self.P.transpose(self.op.pick(force)).T, history

    def energy(self, u: jax.Array, history: Any) -> jax.Array:
        """Stored energy of all points (J); the sum is that of the body."""
        return self.op.energy(self._all(u), history)

    def intact(self, history: Any) -> jax.Array:
        """As that of the operator, of the points of the body [n]."""
        volume = self.op.pick(self.op.intact(history))
        return volume[: len(volume) - len(self.P.sources)]

    def released(self, history: Any, history0: Any) -> jax.Array:
        """As that of the operator."""
        return self.op.released(history, history0)

    def diagonal(self, history: Any) -> PointTensor:
        """Blocks [n, d, d] (N/m) that bound the stiffness like its diagonal would.

        With a new point at sum w_k u_k the form of its block is at most sum |w| times
        sum |w_k| u_k . K u_k, so the blocks K_k + sum |w_k| (sum |w|) K_new bound
        u . P^T K P u as `jaxpd.solvers.explicit.stable_dt` asks.
        """
        blocks = self.op.diagonal(history)
        size = jnp.abs(self.P.weights)
        n = len(blocks) - len(size)
        new = blocks[n:] * jnp.sum(size, axis=1)[:, None, None]
        spread = Extension(self.P.sources, size).transpose(
            jnp.concatenate([jnp.zeros_like(blocks[:n]), new])
        )
        return blocks[:n] + spread
