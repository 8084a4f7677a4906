"""Bonds at rest as a list of springs, each once: what fracture at small strains needs.

    i, j    ends                                  [b]     int32
    n       direction from i to j                 [b, d]  -
    length  |xi|                                  [b]     m
    k       force over elongation                 [b]     N/m
    e       elongation n . (u_j - u_i)            [b]     m

A spring pulls its ends together with the tension k e. All are pure: on NumPy arrays the
host's, on JAX's traced and differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointVector, namespace
from jaxpd.operators.bonds import BondForce
from jaxpd.physics.bond import bond_block


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Springs:
    """Springs between points; see the module."""

    i: Any
    j: Any
    n: Any
    length: Any
    k: Any

    def elongation(self, u: PointVector) -> Any:
        """Elongations [b] (m) at displacements [n, d] (m)."""
        return ((u[self.j] - u[self.i]) * self.n).sum(axis=1)

    def stretch(self, u: PointVector) -> Any:
        """Stretches [b] (-) at displacements [n, d] (m)."""
        return self.elongation(u) / self.length

    def force(self, tension: Any, count: int) -> PointVector:
        """Forces [count, d] (N) on the points of springs under tensions [b] (N)."""
        pull = tension[:, None] * self.n
        if namespace(pull) is np:
            total = np.zeros((count, self.n.shape[1]))
            np.add.at(total, self.i, pull)
            np.subtract.at(total, self.j, pull)
            return total
        total = jnp.zeros((count, self.n.shape[1]), pull.dtype)
        return total.at[self.i].add(pull).at[self.j].add(-pull)

    def differences(self, count: int) -> sp.csr_array:
        """Map of displacements [count d] to elongations [b]; on the host."""
        b, d = self.n.shape
        columns = np.concatenate(
            [d * np.asarray(end)[:, None] + np.arange(d) for end in (self.i, self.j)], 1
        )
        entries = np.concatenate([-np.asarray(self.n), np.asarray(self.n)], axis=1)
        starts = 2 * d * np.arange(b + 1)
        shape = (b, count * d)
        return sp.csr_array((entries.ravel(), columns.ravel(), starts), shape=shape)


def springs_of(bonds: BondForce, slot: Any, i: Any) -> Springs:
    """The bonds (slot, i) [b] of an operator, linear about the undeformed body. Pure.

    Args:
        bonds: the operator.
        slot: number of each bond's slot at its end i.
        i: that end.
    """
    j = bonds.nbr[slot, i]
    xi = bonds.X[j] - bonds.X[i]
    length = jnp.sqrt(jnp.sum(xi * xi, axis=1))

    def of(leaf):
        leaf = jnp.asarray(leaf)
        if leaf.ndim == 2:
            return leaf[slot, i]
        return 0.5 * (leaf[i] + leaf[j]) if leaf.ndim == 1 else leaf

    law = jax.tree.map(of, bonds.law)
    axes = jax.tree.map(lambda leaf: 0 if leaf.ndim else None, law)
    blocks = jax.vmap(bond_block, (axes, 0, 0, None))(law, xi, 0.0 * xi, "ad")
    stiff = bonds.weight[slot, i] * jnp.trace(blocks, axis1=1, axis2=2)
    return Springs(i, j, xi / length[:, None], length, stiff)
