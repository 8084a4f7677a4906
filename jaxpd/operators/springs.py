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

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointTensor, PointVector, namespace
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
    xi, blocks = _blocks(bonds, slot, i)
    length = jnp.sqrt(jnp.sum(xi * xi, axis=1))
    stiff = bonds.weight[slot, i] * jnp.trace(blocks, axis1=1, axis2=2)
    return Springs(i, bonds.nbr[slot, i], xi / length[:, None], length, stiff)


def across(bonds: BondForce, slot: Any, i: Any) -> jax.Array:
    """Largest resistance of bonds across themselves over that along them [] (-). Pure.

    0 of bonds that are springs.
    """
    xi, blocks = _blocks(bonds, slot, i)
    n = xi / jnp.sqrt(jnp.sum(xi * xi, axis=1))[:, None]
    along = jnp.einsum("ba,bac,bc->b", n, blocks, n)
    rest = blocks - along[:, None, None] * n[:, :, None] * n[:, None, :]
    return jnp.max(jnp.abs(rest)) / jnp.max(jnp.abs(along))


def _blocks(bonds: BondForce, slot: Any, i: Any) -> tuple[jax.Array, jax.Array]:
    """Bond vectors [b, d] (m), and blocks at rest [b, d, d], without weights."""
    j = bonds.nbr[slot, i]
    xi = bonds.X[j] - bonds.X[i]

    def of(leaf):
        leaf = jnp.asarray(leaf)
        if leaf.ndim == 2:
            return leaf[slot, i]
        return 0.5 * (leaf[i] + leaf[j]) if leaf.ndim == 1 else leaf

    law = jax.tree.map(of, bonds.law)
    axes = jax.tree.map(lambda leaf: 0 if leaf.ndim else None, law)
    return xi, jax.vmap(bond_block, (axes, 0, 0, None))(law, xi, 0.0 * xi, "ad")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SpringTangent:
    """Stiffness of springs.

    Attributes:
        springs: all of them.
        k: stiffness of each [b] (N/m), 0 of those that are gone.
        count: number of points.
    """

    springs: Springs
    k: Any
    count: int = field(metadata={"static": True})

    symmetric = True

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        return -self.springs.force(self.k * self.springs.elongation(du), self.count)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m), exact."""
        s, d = self.springs, self.springs.n.shape[1]
        blocks = self.k[:, None, None] * s.n[:, :, None] * s.n[:, None, :]
        total = jnp.zeros((self.count, d, d), blocks.dtype)
        return total.at[s.i].add(blocks).at[s.j].add(blocks)

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns [4 b] and blocks of K; duplicates add up."""
        s = self.springs
        blocks = self.k[:, None, None] * s.n[:, :, None] * s.n[:, None, :]
        rows, columns = (
            jnp.concatenate([s.i, s.j, a, b]) for a, b in ((s.i, s.j), (s.j, s.i))
        )
        return rows, columns, jnp.concatenate([blocks, blocks, -blocks, -blocks])

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix; on the host, of NumPy arrays."""
        live = np.flatnonzero(self.k)
        B = self.springs.differences(self.count)[live]
        K = sp.csr_matrix(B.T @ B.multiply(np.asarray(self.k)[live, None]))
        d = self.springs.n.shape[1]
        return sp.bsr_matrix(K, blocksize=(d, d))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SpringForce:
    """Linear forces of springs, of which some are gone.

    Attributes:
        springs: all of them.
        share: of the stiffness of each that is left [b] (-).
        count: number of points.
    """

    springs: Springs
    share: Any
    count: int = field(metadata={"static": True})

    unit, linear, symmetric = "N", True, True

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal force -K u [n, d] (N)."""
        return -self.tangent(u).mv(u)

    def tangent(self, u: PointVector, history: Any = None) -> SpringTangent:
        """K, whatever u."""
        return SpringTangent(self.springs, self.share * self.springs.k, self.count)

    def exact(self) -> SpringForce:
        """Itself: K is its derivative."""
        return self
