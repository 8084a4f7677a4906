"""Bond forces on a lattice at finite displacements: any law, no index lists.

The offsets of `GridFamily` are swept in a `lax.scan`. All bonds of an offset share xi,
so that whatever of a law depends on the length alone is computed once, and the
neighbours of all points are the row of points, shifted. Every bond is met once,

    force_i += w f(xi, u_j - u_i),    force_j -= the same,    j = i + o,

with w = weight_o * 2 / (v_i + v_j) * scale. A point whose neighbour would lie off the
lattice, and a missing bond, see eta = 0 and w = 0: no force, and none in a derivative.
Missing bonds are one bit each of a mask [ceil(k / 32), n], made from their short list.
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
from jax.lax import dynamic_slice_in_dim, dynamic_update_slice_in_dim

from jaxpd._types import BondScalar, PointScalar, PointTensor, PointVector, Scalar
from jaxpd.geometry.grid_family import GridFamily
from jaxpd.operators.lattice import LatticeTangent, index_pairs, whole
from jaxpd.operators.stored import (
    StencilBlocks,
    hops,
    missing_bits,
    row_of,
)
from jaxpd.physics.bond import Microelastic, bond_block, bond_energy, bond_force


def _axes(law: Any) -> Any:
    return jax.tree.map(lambda leaf: 0 if jnp.ndim(leaf) else None, law)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class StencilForce:
    """Nodal forces of the bonds of a lattice, behind the protocol of operators.

    Attributes:
        family: the bonds.
        dx: spacing [] (m).
        weight: vol_i vol_j times the partial share, of every offset [k] (m^2d).
        v: neighbourhood volumes over V0 [n] (-), or None without correction.
        scale: factor of every bond [k, n] (-), at its first end, or None.
        law: bond law, a pytree; leaves are [], [n] (a bond takes the mean of its ends)
            or [k, n] (at the first end of a bond).
        blocks: "ad" (default), "hand" or "axial": where tangent blocks come from.
        symmetric: whether blocks are symmetric, as they are if an energy exists.
        stored: whether a tangent keeps its blocks: fast, but k d (d + 1) / 2 numbers a
            point; else every product computes them again.
    """

    family: GridFamily
    dx: Scalar
    weight: jax.Array
    v: PointScalar | None
    scale: BondScalar | None
    law: Any
    blocks: str = field(metadata={"static": True}, default="ad")
    symmetric: bool = field(metadata={"static": True}, default=True)
    stored: bool = field(metadata={"static": True}, default=True)

    unit, linear = "N", False

    def exact(self) -> StencilForce:
        """The same with tangent blocks by `jax.jacfwd`."""
        return dataclasses.replace(self, blocks="ad")

    def _check(self) -> None:
        k, n = len(self.family.offsets), self.family.n
        for leaf in jax.tree.leaves(self.law):
            if jnp.shape(leaf) not in ((), (n,), (k, n)):
                raise ValueError(
                    f"law: a leaf of {type(self.law).__name__} has shape "
                    f"{jnp.shape(leaf)}; it must be [], [n] = [{n}] or [k, n] = "
                    f"[{k}, {n}]"
                )

    def _offsets(self, measure: Callable[..., Any], fields: tuple):
        """What is done for one offset, and the items of a sweep over all of them.

        Returns:
            A function of an item, w * measure [..., whole(n)] at the
            first ends of the bonds of an offset, and the items.
        """
        self._check()
        family, n = self.family, self.family.n
        hop, size = hops(family), whole(n)
        tail = size - n + max(0, int(hop.max()))
        point = jnp.arange(size, dtype=jnp.int32)
        at = jnp.stack(jnp.unravel_index(point, family.shape))
        room = jnp.asarray(family.shape, jnp.int32)
        bits = None
        if family.cut.shape[1]:
            bits = jnp.pad(missing_bits(family), [(0, 0), (0, size - n)])
        leaves, tree = jax.tree.flatten(self.law)
        leaves = [jnp.asarray(leaf) for leaf in leaves]
        nodal = [leaf for leaf in leaves if leaf.ndim == 1]
        per_bond = [leaf for leaf in leaves if leaf.ndim == 2]
        axes = (_axes(self.law), None, *[1] * len(fields))
        each = jax.vmap(measure, in_axes=axes, out_axes=-1)

        def stretched(x):
            return jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, tail)], mode="edge")

        long_fields = [stretched(x.T) for x in fields]
        long_nodal = [stretched(x) for x in nodal]
        long_v = None if self.v is None else stretched(self.v)
        steps = jnp.asarray(family.steps, jnp.int32)
        slots = jnp.arange(len(hop), dtype=jnp.int32)

        @partial(jax.checkpoint, prevent_cse=False)  # backwards, computed again
        def of(item):
            slot, hop, step, weight, scale, scanned = item
            to = at + step[:, None]
            live = ((to >= 0) & (to < room[:, None])).all(axis=0) & (point < n)
            if bits is not None:
                word = bits[slot // 32] >> (slot % 32).astype(jnp.uint32)
                live &= (word & 1) == 0

            def far(x):
                return dynamic_slice_in_dim(x, hop, size, axis=x.ndim - 1)

            def filled(x):
                return jnp.pad(x, (0, size - n), mode="edge")

            means = iter([0.5 * (x[:size] + far(x)) for x in long_nodal])
            local = {1: means, 2: iter([filled(x) for x in scanned])}
            law = jax.tree.unflatten(
                tree, [next(local[x.ndim]) if x.ndim else x for x in leaves]
            )
            eta = [jnp.where(live, far(x) - x[:, :size], 0.0) for x in long_fields]
            w = weight
            if long_v is not None:
                w = w * 2.0 / (long_v[:size] + far(long_v))
            if scale is not None:
                w = w * filled(scale)
            value = each(law, step * self.dx, *eta)
            zero = jnp.zeros(size, w.dtype)
            w = jax.lax.select(live, w + zero, zero)
            return jnp.expand_dims(w, range(value.ndim - 1)) * value

        return of, (slots, jnp.asarray(hop), steps, self.weight, self.scale, per_bond)

    def _sweep(self, measure: Callable[..., Any], fields: tuple, shape: tuple, sign):
        """Sum of w * measure(law, xi, *differences) over the bonds of every point.

        Args:
            measure: of one bond, [*shape].
            fields: nodal fields [n, d] whose differences along bonds are passed on.
            shape: shape of the measure.
            sign: of the share of the second end, 1 or -1.

        Returns:
            Sums [*shape, n].
        """
        of, items = self._offsets(measure, fields)
        (front, size), axis = row_of(self.family), len(shape)

        def add(totals, item):
            own, others = totals
            value, hop = of(item), item[1]
            there = dynamic_slice_in_dim(others, hop, size, axis=axis)
            others = dynamic_update_slice_in_dim(
                others, there + sign * value, hop, axis=axis
            )
            return (own + value, others), None

        dtype = jnp.result_type(*fields, self.weight, self.dx)
        own, others = (jnp.zeros((*shape, m), dtype) for m in (size, front + size))
        own, others = jax.lax.scan(add, (own, others), items)[0]
        return (own + others[..., :size])[..., : self.family.n]

    def respond(self, u: PointVector, history: None = None) -> PointVector:
        """Internal force [n, d] (N) on every point; minus the gradient of `energy`."""
        return self._sweep(bond_force, (u,), u.shape[1:], -1).T

    def energy_per_point(self, u: PointVector, history: None = None) -> PointScalar:
        """Stored energy of each point [n] (J): half of that of its bonds."""
        return 0.5 * self._sweep(bond_energy, (u,), (), 1)

    def energy(self, u: PointVector, history: None = None) -> Scalar:
        """Stored energy [] (J); each bond is counted once."""
        return jnp.sum(self.energy_per_point(u))

    def advance(self, u: PointVector, history: None = None) -> None:
        """Elastic bonds remember nothing."""

    def history0(self) -> None:
        """Elastic bonds remember nothing."""

    def tangent(
        self, u: PointVector, history: None = None
    ) -> StencilBlocks | StencilTangent:
        """Stiffness at u, with blocks that are stored or computed where needed."""
        return self.stored_tangent(u) if self.stored else StencilTangent(self, u)

    def stored_tangent(self, u: PointVector) -> StencilBlocks:
        """Stiffness at u with its blocks: [k, q, n] numbers, for many products."""
        front, kept = row_of(self.family)[0], index_pairs(u.shape[1], self.symmetric)

        def entries(law, xi, eta):
            block = bond_block(law, xi, eta, self.blocks)
            return jnp.stack([block[a, b] for a, b in kept])

        of, items = self._offsets(entries, (u,))
        parts = jax.lax.map(lambda it: jnp.pad(of(it), [(0, 0), (front, 0)]), items)
        return StencilBlocks(parts, self.family, self.symmetric)

    def rest(self) -> LatticeTangent:
        """Stiffness of the undeformed lattice: one block an offset.

        Where the law has a method `rest(xi)` and all arrays are NumPy's, so are those
        of the result, and nothing is compiled.

        Raises:
            ValueError: if a bond of an offset differs from the next by more than nodal
                volumes and the modulus c of a `Microelastic` law, or with blocks that
                are not symmetric.
        """
        law, c = self.law, None
        if not self.symmetric:
            raise ValueError("symmetric: a lattice tangent keeps symmetric blocks only")
        if self.scale is not None:
            raise ValueError("scale: bonds of an offset differ; use tangent(u)")
        if isinstance(law, Microelastic) and jnp.shape(law.c) == (self.family.n,):
            law, c = dataclasses.replace(law, c=1.0), law.c
        if any(jnp.ndim(leaf) for leaf in jax.tree.leaves(law)):
            raise ValueError(
                f"law: bonds of an offset differ by leaves of {type(law).__name__}; "
                "only a nodal c [n] of Microelastic may vary; use operator='gather'"
            )
        arrays = (law, self.dx, self.weight)
        host = not any(isinstance(x, jax.Array) for x in jax.tree.leaves(arrays))
        quick = host and callable(getattr(law, "rest", None))
        of = _rest_parts if quick else _compiled_rest_parts
        parts = of(law, self.family.steps * self.dx, self.weight, self.blocks)
        return LatticeTangent(parts, self.v, c, self.family)


def _rest_parts(law: Any, xi: Any, weight: Any, how: str) -> Any:
    """Upper triangles [k, q] of the weighted blocks at rest of bonds xi [k, d]."""
    if callable(getattr(law, "rest", None)):
        blocks = law.rest(xi)
    else:
        blocks = jax.vmap(lambda x: bond_block(law, x, jnp.zeros_like(x), how))(xi)
    return weight[:, None] * blocks[:, *np.triu_indices(xi.shape[1])]


_compiled_rest_parts = jax.jit(_rest_parts, static_argnums=3)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class StencilTangent:
    """Stiffness of a lattice at a displacement, matrix-free.

    Attributes:
        op: the operator.
        u: the displacement [n, d] (m) about which it is linear.
    """

    op: StencilForce
    u: PointVector

    @property
    def symmetric(self) -> bool:
        """Whether K is symmetric."""
        return self.op.symmetric

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N): a derivative of the force along du, or blocks times du."""

        def change(law, xi, eta, deta):
            if self.op.blocks == "ad":
                return jax.jvp(lambda e: bond_force(law, xi, e), (eta,), (deta,))[1]
            return bond_block(law, xi, eta, self.op.blocks) @ deta

        return -self.op._sweep(change, (self.u, du), self.u.shape[1:], -1).T

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m), exact."""
        d = self.u.shape[1]
        block = partial(bond_block, how=self.op.blocks)
        return jnp.moveaxis(self.op._sweep(block, (self.u,), (d, d), 1), -1, 0)

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of K; traced cuts leave blocks of zeros."""
        return self.op.stored_tangent(self.u).coo()

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix on the host, missing bonds absent."""
        return jax.jit(StencilForce.stored_tangent)(self.op, self.u).to_bsr()
