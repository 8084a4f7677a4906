"""The stiffness of a lattice with one stored block a bond: fast products, no indices.

    K = sum over bonds  B_ij (e_i - e_j)(e_i - e_j)^T,    j = i + o

Every bond is kept once, at the end from which its offset is positive, and the blocks of
an offset are a row of points. The force on a point is gathered from both sides, from
its own row and from the same row shifted back by the offset,

    K du (i) = -sum over o  B_o(i) (du(i + o) - du(i)) + B_o(i - o) (du(i - o) - du(i)),

where the shifted read finds in the cache what the other one has brought: the blocks
pass through memory once, which is what the product costs. A row starts with a margin of
zeros, as wide as the longest shift, and its length is a whole number of vectors.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.core import Tracer
from jax.lax import dynamic_slice, dynamic_slice_in_dim

from jaxpd._types import PointTensor, PointVector
from jaxpd.geometry.grid_family import GridFamily
from jaxpd.operators.lattice import assemble_pairs, index_pairs, whole


def hops(family: GridFamily) -> np.ndarray:
    """How far each offset moves the point number [k], int32."""
    return (family.steps @ family.strides).astype(np.int32)


def row_of(family: GridFamily) -> tuple[int, int]:
    """Width of the margin in front of a row of blocks, and length of what follows."""
    return whole(int(np.abs(hops(family)).max())), whole(family.n)


def missing_bits(family: GridFamily) -> jax.Array:
    """Mask [ceil(k / 32), n], uint32: a bit is set where a bond is missing."""
    i, slot = (jnp.asarray(x) for x in family.cut)
    bits = jnp.zeros((-(-len(family.offsets) // 32), family.n), jnp.uint32)
    bit = jnp.left_shift(jnp.uint32(1), (slot % 32).astype(jnp.uint32))
    return bits.at[slot // 32, i].add(bit)  # every bond is listed once: add is or


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class StencilBlocks:
    """Stiffness of a lattice by its blocks: the stencil with any mask or weight a bond.

    Attributes:
        parts: entries of the weighted block of every bond [k, q, margin + n + fill]
            (N/m), laid by `lay`: upper triangle row by row where blocks are symmetric,
            else all. Zero where a bond is missing or would leave the lattice.
        family: the bonds.
        symmetric: whether only the upper triangle is kept.
    """

    parts: Any
    family: GridFamily
    symmetric: bool = field(metadata={"static": True}, default=True)

    @classmethod
    def lay(cls, parts: Any, family: GridFamily, symmetric: bool = True):
        """From entries [k, q, n] without margins; zero where there is no bond."""
        front, size = row_of(family)
        ends = [(0, 0), (0, 0), (front, size - family.n)]
        return cls(jnp.pad(jnp.asarray(parts), ends), family, symmetric)

    @property
    def d(self) -> int:
        """Space dimensions."""
        return len(self.family.shape)

    @property
    def entries(self) -> Any:
        """Entries of the blocks [k, q, n] (N/m), without margins."""
        front = row_of(self.family)[0]
        return self.parts[:, :, front : front + self.family.n]

    def _full(self, entries: Any) -> Any:
        """Blocks [..., d, d] from the entries that are kept [..., q]."""
        at = np.zeros((self.d, self.d), int)
        for q, (a, b) in enumerate(index_pairs(self.d, self.symmetric)):
            at[a, b] = q
            if self.symmetric:
                at[b, a] = q
        return entries[..., at]

    @property
    def blocks(self) -> Any:
        """The weighted blocks in full [k, n, d, d] (N/m), at first ends of bonds."""
        return self._full(self.entries.swapaxes(1, 2))

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N), in the precision of du."""
        (front, size), n = row_of(self.family), self.family.n
        kept = index_pairs(self.d, self.symmetric)
        parts, hop = jnp.asarray(self.parts), hops(self.family)
        U = [jnp.pad(du[:, a], (front, front + size - n)) for a in range(self.d)]
        here = [x[front : front + size] for x in U]

        def pull(force, item):
            slot, hop = item
            rows = list(force)
            for start, to in (
                (np.int32(front), front + hop),
                (front - hop, front - hop),
            ):
                eta = [
                    dynamic_slice_in_dim(x, to, size) - y
                    for x, y in zip(U, here, strict=True)
                ]
                for q, (a, b) in enumerate(kept):
                    at = (slot, np.int32(q), start)
                    part = dynamic_slice(parts, at, (1, 1, size))[0, 0].astype(du.dtype)
                    rows[a] = rows[a] - part * eta[b]
                    if self.symmetric and a != b:
                        rows[b] = rows[b] - part * eta[a]
            return tuple(rows), None

        zero = tuple(jnp.zeros_like(x) for x in here)
        items = (jnp.arange(len(hop), dtype=jnp.int32), jnp.asarray(hop))
        force, _ = jax.lax.scan(pull, zero, items, unroll=2)
        return jnp.stack([row[:n] for row in force], axis=1)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m), exact."""
        front, size = row_of(self.family)

        def add(total, item):
            part, hop = item
            behind = dynamic_slice_in_dim(part, front - hop, size, axis=1)
            return total + part[:, front:] + behind, None

        parts = jnp.asarray(self.parts)
        zero = jnp.zeros((parts.shape[1], size), parts.dtype)
        total, _ = jax.lax.scan(add, zero, (parts, jnp.asarray(hops(self.family))))
        return self._full(total[:, : self.family.n].T)

    def _pairs(self, xp: Any) -> tuple[Any, Any, Any]:
        """Ends [b] of the bonds of the pattern and their blocks [b, d, d]."""
        family = self.family
        if isinstance(family.cut, Tracer):
            family = dataclasses.replace(family, cut=np.zeros((2, 0), np.int32))
        i, j, slot = family.ends()
        front = row_of(family)[0]
        return i, j, self._full(xp.asarray(self.parts)[slot, :, front + i])

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of K; traced cuts leave blocks of zeros."""
        i, j, blocks = self._pairs(jnp)
        here = jnp.arange(self.family.n, dtype=np.int32)
        return (
            jnp.concatenate([here, i, j]),
            jnp.concatenate([here, j, i]),
            jnp.concatenate([self.diagonal(), -blocks, -blocks]),
        )

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix on the host, missing bonds absent."""
        return assemble_pairs(self.family.n, *self._pairs(np))
