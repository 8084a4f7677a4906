"""Bonds with any memory, by index lists: the general road of explicit runs.

Any law with a memory (`jaxpd.physics.damage`), any points. Each direction of a bond has
a memory of its own, so that a law may break a bond from one side alone. Derivatives are
plain AD of the sweep, one slot at a time.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import BondScalar, PointTensor
from jaxpd.geometry.family import bond_vectors, gather
from jaxpd.operators.bonds import BondForce
from jaxpd.physics.bond import bond_block, bond_energy, bond_force


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class MemoryForce:
    """Bonds whose law has a memory; see `jaxpd.operators.protocol`.

    Attributes:
        bonds: the bonds; the law is one of `jaxpd.physics.damage`, or one like them.
        share: volume of a neighbour within the horizon [k, n] (m^d), for damage.
    """

    bonds: BondForce
    share: BondScalar

    def plain(self) -> MemoryForce:
        """Itself: its derivatives are plain AD."""
        return self

    def lay(self, values: Any) -> jax.Array:
        """Nodal values [n] or [n, d] as this operator keeps them: [n] or [d, n]."""
        return jnp.asarray(values).T

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of what this operator keeps."""
        return row.T

    def _sweep(self, measure: Any, u: jax.Array | None, history: Any, shape: tuple):
        """Sums [*shape, n] of measure(law, xi, eta, h) over the bonds of every point.

        The measure returns what is added (times the weight, if it says so) and the
        memory; `history` comes back with it.
        """
        per_bond, axes, of_slot = self.bonds.laws()
        each = jax.vmap(measure, in_axes=(axes, 0, 0, 0, 0, 0))
        X = self.bonds.X
        at = jnp.zeros_like(X) if u is None else u.T

        @partial(jax.checkpoint, prevent_cse=False)  # backwards, computed again
        def of(slot):
            nbr, weight, share, scanned, h, there = slot
            xi = bond_vectors(X, nbr, self.bonds.delta)
            law = of_slot(None, scanned, nbr)
            value, h = each(law, xi, gather(at, nbr) - at, h, weight, share)
            there = jnp.expand_dims(there, range(1, value.ndim))
            return jnp.where(there, value, 0.0), h

        def add(total, slot):
            value, h = of(slot)
            return total + value, h

        zero = jnp.zeros((X.shape[0], *shape), jnp.result_type(X, self.bonds.weight))
        memories, there = history
        slots = (self.bonds.nbr, self.bonds.weight, self.share, per_bond)
        total, memories = jax.lax.scan(add, zero, (*slots, memories, there))
        return jnp.moveaxis(total, 0, -1), (memories, there)

    def commit(self, u: jax.Array, history: Any) -> tuple[jax.Array, Any]:
        """Nodal forces [d, n] (N) at u [d, n] and the memories after it."""

        def measure(law, xi, eta, h, weight, share):
            h = law.advance(xi, eta, h)
            return weight * law.share(h) * bond_force(law.law, xi, eta), h

        return self._sweep(measure, u, history, (u.shape[0],))

    def energy(self, u: jax.Array, history: Any) -> jax.Array:
        """Stored energy of each point [n] (J), half of that of its bonds, or NaN."""
        if not hasattr(self.bonds.law.law, "energy"):
            return jnp.full(u.shape[1], jnp.nan, u.dtype)

        def measure(law, xi, eta, h, weight, share):
            return 0.5 * weight * law.share(h) * bond_energy(law.law, xi, eta), h

        return self._sweep(measure, u, history, ())[0]

    def intact(self, history: Any) -> jax.Array:
        """Volume of the bonds of each point, by the share that is left [n] (m^d)."""

        def measure(law, xi, eta, h, weight, share):
            return share * law.share(h), h

        return self._sweep(measure, None, history, ())[0]

    def released(self, history: Any, history0: Any) -> jax.Array:
        """Energy [] (J) spent by the memories since `history0`, or NaN."""
        if not hasattr(self.bonds.law, "spent"):
            return jnp.full((), jnp.nan)

        def measure(law, xi, eta, h, weight, share):
            return 0.5 * weight * law.spent(xi, h), h

        now, before = (
            jnp.sum(self._sweep(measure, None, h, ())[0]) for h in (history, history0)
        )
        return now - before

    def diagonal(self, history: Any) -> PointTensor:
        """Block diagonal [n, d, d] (N/m) of the stiffness at rest, of |blocks|."""
        d = self.bonds.X.shape[1]

        def measure(law, xi, eta, h, weight, share):
            block = bond_block(law.law, xi, 0.0 * eta)
            size, axes = jnp.linalg.eigh(0.5 * (block + block.T))
            return weight * law.share(h) * (axes * jnp.abs(size)[None]) @ axes.T, h

        return jnp.moveaxis(self._sweep(measure, None, history, (d, d))[0], -1, 0)
