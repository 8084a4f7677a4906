"""Bond forces gathered over families: any cloud, any bond law.

Each point gathers the pull of its own bonds, so every bond is met twice, once from each
end, and nothing is scattered. The sum runs over the slots of the families in a
`lax.scan`: memory stays that of a few nodal arrays, whatever the size of the families.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import (
    BondIndex,
    BondScalar,
    BondTensor,
    PointScalar,
    PointTensor,
    PointVector,
    Scalar,
)
from jaxpd.discretize.surface import volumes_over
from jaxpd.geometry.family import Family, bond_vectors, gather, partial_volumes
from jaxpd.operators.lattice import index_pairs
from jaxpd.physics.bond import bond_block, bond_energy, bond_force


def bond_weights(
    X: PointVector,
    vol: PointScalar,
    family: Family,
    delta: Scalar,
    correction: str = "none",
) -> BondScalar:
    """Weights [k, n] (m^2d) that turn pair force densities into nodal forces.

    vol_i vol_j times the partial volume, times the surface correction when
    `correction` is "lattice" or "analytic" (see `jaxpd.discretize.surface`). Symmetric
    under exchange of the ends; zero where padded.
    """
    beta, v = partial_volumes(X, vol, family, delta), None
    if correction != "none":
        v = volumes_over(X, vol, family, beta, delta, correction)

    @partial(jax.checkpoint, prevent_cse=False)  # backwards, slot by slot too
    def of(slot):
        nbr, share = slot
        weight = share * vol * gather(vol, nbr)
        return weight if v is None else weight * 2.0 / (v + gather(v, nbr))

    return jax.lax.map(of, (family.nbr, beta))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class BondTangent:
    """Stiffness of bonds as weighted blocks, one a bond; no matrix is assembled.

    Attributes:
        nbr: neighbour indices [k, n].
        parts: entries of the blocks [k, q, n] (N/m): the upper triangle row by row
            where blocks are symmetric, else all of them; zero where padded.
        d: space dimensions.
        symmetric: whether only the upper triangle is kept.
    """

    nbr: BondIndex
    parts: jax.Array
    d: int = field(metadata={"static": True})
    symmetric: bool = field(metadata={"static": True})

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N) by gathering over the families."""
        pairs = index_pairs(self.d, self.symmetric)

        # columns apart, made once: gathers then read memory in order
        columns = jax.lax.optimization_barrier(tuple(du[:, a] for a in range(self.d)))

        def pull(force, slot):
            nbr, parts = slot
            eta = [gather(column, nbr) - column for column in columns]
            rows = list(force)
            for q, (a, b) in enumerate(pairs):
                rows[a] = rows[a] - parts[q] * eta[b]
                if self.symmetric and a != b:
                    rows[b] = rows[b] - parts[q] * eta[a]
            return tuple(rows), None

        zero = tuple(jnp.zeros_like(column) for column in columns)
        force, _ = jax.lax.scan(pull, zero, (self.nbr, self.parts), unroll=2)
        return jnp.stack(force, axis=1)

    @property
    def blocks(self) -> BondTensor:
        """The weighted blocks in full [k, n, d, d] (N/m)."""
        columns: dict[tuple[int, int], jax.Array] = {}
        for q, (a, b) in enumerate(index_pairs(self.d, self.symmetric)):
            columns[a, b] = self.parts[:, q]
            if self.symmetric:
                columns[b, a] = self.parts[:, q]
        rows = [
            jnp.stack([columns[a, b] for b in range(self.d)], axis=-1)
            for a in range(self.d)
        ]
        return jnp.stack(rows, axis=-2)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m), exact."""
        zero = jnp.zeros_like(self.parts[0])
        total, _ = jax.lax.scan(
            lambda sum_, part: (sum_ + part, None), zero, self.parts
        )
        own = BondTangent(self.nbr[:1], total[None], self.d, self.symmetric)
        return own.blocks[0]

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns [k n + n] and blocks of K; padding appears as zero blocks."""
        here = jnp.arange(self.nbr.shape[1], dtype=self.nbr.dtype)
        rows = jnp.broadcast_to(here, self.nbr.shape).ravel()
        off = -self.blocks.reshape(-1, self.d, self.d)
        return (
            jnp.concatenate([here, rows]),
            jnp.concatenate([here, self.nbr.ravel()]),
            jnp.concatenate([self.diagonal(), off]),
        )

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix on the host, padding removed."""
        return assemble(np.asarray(self.nbr), np.asarray(self.parts), self.d)


def assemble(nbr: np.ndarray, parts: np.ndarray, d: int) -> sp.bsr_matrix:
    """BSR matrix [n d, n d] from neighbour indices and block entries, on the host.

    Args:
        nbr: neighbour indices [k, n], the point itself where padded.
        parts: block entries [k, q, n]; q = d (d + 1) / 2 for symmetric blocks, or d^2.
        d: space dimensions.
    """
    n = nbr.shape[1]
    here = np.arange(n, dtype=nbr.dtype)
    slot, row = np.nonzero(nbr != here)
    order = np.lexsort((nbr[slot, row], row))
    slot, row = slot[order], row[order]
    col = nbr[slot, row]
    indptr = np.zeros(n + 1, np.int32)
    # each row gets its own block on top, placed first
    count = np.bincount(row, minlength=n)
    indptr[1:] = np.cumsum(count + 1)
    at = np.arange(len(row)) + row + 1
    indices = np.empty(indptr[-1], np.int32)
    data = np.zeros((int(indptr[-1]), d, d))
    indices[at], indices[indptr[:-1]] = col, here
    pairs = index_pairs(d, parts.shape[1] != d * d)
    for q, (a, b) in enumerate(pairs):
        total = parts[:, q].sum(axis=0)
        for r, c in {(a, b)} | ({(b, a)} if len(pairs) < d * d else set()):
            data[at, r, c] = -parts[slot, q, row]
            data[indptr[:-1], r, c] = total
    matrix = sp.bsr_matrix((data, indices, indptr), shape=(n * d, n * d))
    matrix.sort_indices()
    return matrix


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class BondForce:
    """Nodal forces of bonds, behind the protocol of `jaxpd.operators.protocol`.

    Attributes:
        X: reference positions [n, d] (m).
        nbr: neighbour indices [k, n].
        weight: bond weights [k, n] (m^2d), from `bond_weights`.
        law: bond law, a pytree; leaves are [], [n] or [k, n].
        delta: horizon [] (m); sets the length of padded bonds alone.
        blocks: "ad" (default), "hand" or "axial": where tangent blocks come from.
        symmetric: whether blocks are symmetric, as they are if an energy exists.
    """

    X: PointVector
    nbr: BondIndex
    weight: BondScalar
    law: Any
    delta: Scalar
    blocks: str = field(metadata={"static": True}, default="ad")
    symmetric: bool = field(metadata={"static": True}, default=True)

    unit, linear = "N", False

    def exact(self) -> BondForce:
        """The same with tangent blocks by `jax.jacfwd`."""
        return dataclasses.replace(self, blocks="ad")

    def laws(self) -> tuple[Any, Any, Callable[[Any, Any, jax.Array], Any]]:
        """Split the law: leaves per bond (scanned), the rest, and a lookup of a slot.

        The lookup returns the law with leaves [] or [n], one an end of each bond, and
        the `in_axes` to map it over the bonds of a slot.
        """
        leaves, tree = jax.tree.flatten(self.law)
        shapes = [jnp.shape(leaf) for leaf in leaves]
        for shape in shapes:
            if shape not in ((), (self.nbr.shape[1],), self.nbr.shape):
                raise ValueError(
                    f"law: a leaf of {type(self.law).__name__} has shape {shape}; it "
                    f"must be [], [n] = [{self.nbr.shape[1]}] or [k, n] = "
                    f"{list(self.nbr.shape)}"
                )
        per_bond = [x for x, s in zip(leaves, shapes, strict=True) if len(s) == 2]
        axes = jax.tree.unflatten(tree, [0 if shape else None for shape in shapes])

        def of_slot(_, scanned, nbr):
            scanned = iter(scanned)
            local = []
            for leaf, shape in zip(leaves, shapes, strict=True):
                if len(shape) == 2:
                    local.append(next(scanned))
                elif len(shape) == 1:
                    local.append(0.5 * (leaf + gather(leaf, nbr)))
                else:
                    local.append(leaf)
            return jax.tree.unflatten(tree, local)

        return per_bond, axes, of_slot

    def _sum(self, measure: Callable[..., jax.Array], u: PointVector, shape):
        """Sum weight * measure(law, xi, eta) over the bonds of every point."""
        per_bond, axes, of_slot = self.laws()
        each = jax.vmap(measure, in_axes=(axes, 0, 0))

        @partial(jax.checkpoint, prevent_cse=False)  # backwards, computed again
        def of(slot):
            nbr, weight, scanned = slot
            xi = bond_vectors(self.X, nbr, self.delta)
            value = each(of_slot(None, scanned, nbr), xi, gather(u, nbr) - u)
            return jnp.expand_dims(weight, range(1, value.ndim)) * value

        def add(total, slot):
            return total + of(slot), None

        dtype = jnp.result_type(u, self.weight)
        zero = jnp.zeros((u.shape[0], *shape), dtype)
        return jax.lax.scan(add, zero, (self.nbr, self.weight, per_bond))[0]

    def respond(self, u: PointVector, history: None = None) -> PointVector:
        """Internal force [n, d] (N) on every point; minus the gradient of `energy`."""
        return self._sum(bond_force, u, u.shape[1:])

    def energy_per_point(self, u: PointVector, history: None = None) -> PointScalar:
        """Stored energy of each point [n] (J): half of that of its bonds."""
        return 0.5 * self._sum(bond_energy, u, ())

    def energy(self, u: PointVector, history: None = None) -> Scalar:
        """Stored energy [] (J); each bond is counted once."""
        return jnp.sum(self.energy_per_point(u))

    def advance(self, u: PointVector, history: None = None) -> None:
        """Elastic bonds remember nothing."""

    def history0(self) -> None:
        """Elastic bonds remember nothing."""

    def tangent(self, u: PointVector, history: None = None) -> BondTangent:
        """Stiffness at u from blocks by `jax.jacfwd`, by hand, or the axial part."""
        per_bond, axes, of_slot = self.laws()
        pairs = index_pairs(u.shape[1], self.symmetric)

        def entries(law, xi, eta):
            block = bond_block(law, xi, eta, self.blocks)
            return jnp.stack([block[a, b] for a, b in pairs])

        each = jax.vmap(entries, in_axes=(axes, 0, 0), out_axes=1)

        def of(slot):
            nbr, weight, scanned = slot
            xi = bond_vectors(self.X, nbr, self.delta)
            return weight[None, :] * each(
                of_slot(None, scanned, nbr), xi, gather(u, nbr) - u
            )

        parts = jax.lax.map(of, (self.nbr, self.weight, per_bond))
        return BondTangent(self.nbr, parts, u.shape[1], self.symmetric)
