"""The stiffness of an undeformed lattice: one block an offset, times a factor a bond.

    K = sum over bonds  F_ij B_o (e_i - e_j)(e_i - e_j)^T,    j = i + o

The block B_o is the same for all bonds of an offset. What differs from bond to bond is
a factor made of nodal fields: the volume correction 2 / (v_i + v_j), v = V / V0, and
the mean of a relative modulus, (c_i + c_j) / 2. Missing bonds are taken out one by one.

The lattice is laid out as one long row with empty places between its lines, so that a
step along any axis is a shift of the row, and a step off the lattice meets an empty
place: there u = c = 0 and v = inf, hence F = 0. The offsets are swept in a `lax.scan`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from jax.core import Tracer
from jax.lax import dynamic_slice_in_dim
from numpy.typing import NDArray

from jaxpd._types import PointScalar, PointTensor, PointVector
from jaxpd.geometry.grid_family import GridFamily, offset_sums


def index_pairs(d: int, symmetric: bool = True) -> list[tuple[int, int]]:
    """Entries of a block that are kept: all, or the upper triangle, row by row."""
    return [(a, b) for a in range(d) for b in range(a if symmetric else 0, d)]


def full_blocks(parts: Any, d: int) -> Any:
    """Blocks [..., d, d] from their upper triangles [..., q]."""
    at = np.zeros((d, d), int)
    for q, (a, b) in enumerate(index_pairs(d)):
        at[a, b] = at[b, a] = q
    return parts[..., at]


def assemble_pairs(
    n: int, i: NDArray[np.integer], j: NDArray[np.integer], blocks: NDArray
) -> sp.bsr_matrix:
    """BSR matrix [n d, n d] of bonds (i, j) [b] with blocks [b, d, d], on the host."""
    d = blocks.shape[-1]
    ends, flat = np.concatenate([i, j]), blocks.reshape(-1, d * d)
    own = [np.bincount(ends, np.tile(entry, 2), n) for entry in flat.T]
    data = np.concatenate([np.stack(own, axis=1), -flat]).reshape(-1, d, d)
    here, bond = np.arange(n), n + np.arange(len(i))
    rows, cols = np.concatenate([here, ends]), np.concatenate([here, j, i])
    which = np.concatenate([here, bond, bond])
    order = sp.csr_matrix((which, (rows, cols)), shape=(n, n))
    order.sort_indices()
    data = data[order.data.astype(np.intp)]
    return sp.bsr_matrix((data, order.indices, order.indptr), shape=(n * d, n * d))


def whole(length: int) -> int:
    """Whole vectors: loops of other lengths may take several times as long on a CPU."""
    return -(-length // 64) * 64


class _Row:
    """The lattice as one row, lines apart by the reach of the bonds."""

    def __init__(self, family: GridFamily):
        self.shape, self.reach = family.shape, family.reach
        pitch = [n + int(r) for n, r in zip(self.shape, self.reach, strict=True)][1:]
        self.gaps = [(0, 0)] + [(0, int(r)) for r in self.reach[1:]]
        self.lines = (self.shape[0], *pitch)
        self.strides = np.cumprod((1, *pitch[::-1]))[::-1].astype(int)
        self.used = self.shape[0] * int(self.strides[0])
        self.length = whole(self.used)
        self.hops = (family.steps @ self.strides).astype(np.int32)
        self.margin = int(self.hops.max())

    def lay(self, values: jax.Array, empty: float) -> jax.Array:
        """Nodal values [..., n] along the row, with margins, `empty` in between."""
        lead = [(0, 0)] * (values.ndim - 1)
        grid = values.reshape(*values.shape[:-1], *self.shape)
        grid = jnp.pad(grid, lead + self.gaps, constant_values=empty)
        row = grid.reshape(*values.shape[:-1], self.used)
        ends = [*lead, (self.margin, self.margin + self.length - self.used)]
        return jnp.pad(row, ends, constant_values=empty)

    def shifted(self, row: jax.Array, hop: Any) -> jax.Array:
        """The part of a row with margins that starts `hop` places further on."""
        return dynamic_slice_in_dim(row, self.margin + hop, self.length)

    def pick(self, row: jax.Array) -> jax.Array:
        """Nodal values [..., n] from a row without margins."""
        grid = row[..., : self.used].reshape(*row.shape[:-1], *self.lines)
        return grid[(..., *map(slice, self.shape))].reshape(*row.shape[:-1], -1)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class LatticeTangent:
    """Stiffness of an undeformed lattice by shifted slices; no index lists.

    Attributes:
        parts: upper triangle of the weighted block of every offset [k, q] (N/m).
        v: neighbourhood volumes over V0 [n] (-), or None without correction.
        c: modulus relative to that of `parts` [n] (-), or None where it is 1.
        family: the bonds.
    """

    parts: Any
    v: PointScalar | None
    c: PointScalar | None
    family: GridFamily

    symmetric = True

    @property
    def d(self) -> int:
        """Space dimensions."""
        return len(self.family.shape)

    def factor(self, i: Any, j: Any) -> Any:
        """Factor F of the bonds between points i and j (index arrays or slices)."""
        f = 1.0
        if self.v is not None:
            f = 2.0 / (self.v[i] + self.v[j])
        if self.c is not None:
            f = f * 0.5 * (self.c[i] + self.c[j])
        return f

    def _cast(self, dtype: Any) -> LatticeTangent:
        """The same with JAX arrays as leaves, numbers in `dtype`."""
        parts, v, c = jax.tree.map(
            lambda leaf: jnp.asarray(leaf, dtype), (self.parts, self.v, self.c)
        )
        cut = jnp.asarray(self.family.cut)
        family = dataclasses.replace(self.family, cut=cut)
        return LatticeTangent(parts, v, c, family)

    def _factors(self, row: _Row, dtype: Any):
        """A function of a hop: factors [length] of the bonds ahead and behind."""
        v = None if self.v is None else row.lay(self.v, np.inf)
        c = None if self.c is None else row.lay(self.c, 0.0)
        on = row.lay(jnp.ones(self.family.n, dtype), 0.0)

        def factor(hop):
            def near(x):
                return row.shifted(x, 0)

            def far(x):
                return row.shifted(x, hop)

            if v is None:
                return 0.5 * (near(c) * far(on) + far(c) * near(on))
            if c is None:
                return 2.0 / (near(v) + far(v))
            return (near(c) + far(c)) / (near(v) + far(v))

        return lambda hop: (factor(hop), factor(-hop))

    def _missing(self) -> tuple[Any, Any, jax.Array]:
        """Ends [b] of the missing bonds and their weighted blocks [b, d, d]."""
        i, j = self.family.cut_ends()
        blocks = full_blocks(self.parts, self.d)[self.family.cut[1]]
        factor = jnp.broadcast_to(self.factor(i, j), i.shape)
        return i, j, blocks * factor[:, None, None].astype(blocks.dtype)

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N), in the precision of du."""
        K, row, d = self._cast(du.dtype), _Row(self.family), self.d
        plain = K.v is None and K.c is None
        factors = None if plain else K._factors(row, du.dtype)
        U = [row.lay(du[:, a], 0.0) for a in range(d)]
        here = [row.shifted(x, 0) for x in U]

        @partial(jax.checkpoint, prevent_cse=False)  # backwards, computed again
        def of(item):
            hop, block = item
            p = [row.shifted(x, hop) for x in U]
            q = [row.shifted(x, -hop) for x in U]
            if factors is None:
                e = [-(p[b] + q[b]) for b in range(d)]
            else:
                f, g = factors(hop)
                e = [f * (here[b] - p[b]) + g * (here[b] - q[b]) for b in range(d)]
            return tuple(
                sum((block[a, b] * e[b] for b in range(1, d)), start=block[a, 0] * e[0])
                for a in range(d)
            )

        def add(force, item):
            return tuple(f + p for f, p in zip(force, of(item), strict=True)), None

        zero = tuple(jnp.zeros_like(x) for x in here)
        items = row.hops, full_blocks(K.parts, d)
        force = jnp.stack(jax.lax.scan(add, zero, items, unroll=2)[0])
        force = row.pick(force)
        if plain:
            own = K._boxed_sums()
            for b in range(d):
                force = force + own[:, b] * du[:, b][None]
        force = force.T
        if self.family.cut.shape[1]:
            i, j, blocks = K._missing()
            pull = jnp.einsum("bpq,bq->bp", blocks, du[i] - du[j], precision="highest")
            force = force.at[i].add(-pull, indices_are_sorted=True).at[j].add(pull)
        return force

    def _boxed_sums(self) -> jax.Array:
        """Sums [d, d, n] of the blocks of all steps that stay on the lattice."""
        family = dataclasses.replace(self.family, cut=np.zeros((2, 0), np.int32))
        sums = offset_sums(family, full_blocks(self.parts, self.d))
        return jnp.moveaxis(sums.reshape(family.n, self.d, self.d), 0, -1)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m), exact."""
        dtype = jnp.result_type(
            *(leaf for leaf in (self.parts, self.v, self.c) if leaf is not None)
        )
        K, row, d = self._cast(dtype), _Row(self.family), self.d
        if K.v is None and K.c is None:
            own = K._boxed_sums()
        else:
            factors = K._factors(row, dtype)

            def add(total, item):
                hop, block = item
                f, g = factors(hop)
                return total + block[:, :, None] * (f + g)[None, None], None

            zero = jnp.zeros((d, d, row.length), dtype)
            items = row.hops, full_blocks(K.parts, d)
            own = row.pick(jax.lax.scan(add, zero, items)[0])
        own = jnp.moveaxis(own, -1, 0)
        if self.family.cut.shape[1]:
            i, j, blocks = K._missing()
            own = own.at[i].add(-blocks, indices_are_sorted=True).at[j].add(-blocks)
        return own

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of K; traced cuts appear as blocks that cancel."""
        family, traced = self.family, isinstance(self.family.cut, Tracer)
        if traced:
            family = dataclasses.replace(family, cut=np.zeros((2, 0), np.int32))
        i, j, slot = family.ends()
        own = self.diagonal()
        K = self._cast(own.dtype)
        factor = jnp.broadcast_to(K.factor(i, j), i.shape).astype(own.dtype)
        blocks = full_blocks(K.parts, self.d)[slot] * factor[:, None, None]
        here = jnp.arange(family.n, dtype=np.int32)
        rows, cols, off = [here, i, j], [here, j, i], [own, -blocks, -blocks]
        if traced:
            i, j, blocks = K._missing()
            rows, cols, off = [*rows, i, j], [*cols, j, i], [*off, blocks, blocks]
        return jnp.concatenate(rows), jnp.concatenate(cols), jnp.concatenate(off)

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix on the host, missing bonds absent."""
        K = jax.tree.map(np.asarray, self)
        i, j, slot = K.family.ends()
        factor = np.broadcast_to(K.factor(i, j), i.shape)
        blocks = full_blocks(K.parts, self.d)[slot] * factor[:, None, None]
        return assemble_pairs(self.family.n, i, j, blocks)
