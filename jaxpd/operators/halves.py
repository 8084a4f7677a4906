"""Breaking bonds on a lattice, made for explicit runs: each bond once, one bit a bond.

The lattice lies along one row with empty places between its lines, long enough for the
longest step, so that a step along any axis is a shift of the row. Of every pair of
opposite offsets one is swept. Offsets go in groups of up to 8, whose intact flags are
the bits of one byte a point. Of each group the pull F over the bond vector is made
first, NaN where a bond is broken, and kept by an inner `lax.scan`, the only barrier
that XLA respects; then both ends add up

    force_i += F y,    force_j -= F y,    F = k (|y| - r) / |y|,    y = xi + u_j - u_i

from it, and the bits are what is no NaN. Three things decide the speed on a CPU: the
row is whole vectors long (`row`); no quotient has a bare root below it (F =
k p / (|y|^2 + r |y|), p = |y|^2 - r^2, which is free of cancellation besides); and
whole rows, no pieces of them.

A bond is one bit: both ends agree whether it is intact. Laws where they need not, or
with other memories, go by `jaxpd.operators.memory`.
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
from jax import lax

from jaxpd._types import BondScalar, PointScalar, PointTensor, PointVector, Scalar
from jaxpd.geometry.grid_family import GridFamily
from jaxpd.operators.halves_rule import flags, pull_back, slice_of
from jaxpd.operators.lattice import full_blocks, index_pairs
from jaxpd.operators.row import Row, row_of


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class HalfForce:
    """Breaking microelastic bonds of a lattice; see `jaxpd.operators.protocol`.

    Attributes:
        stiff: weight times c omega(r) of every offset [k] (N/m).
        dx: spacing [] (m).
        s_crit: critical stretch [] or [n] (-), a bond takes the mean of its ends.
        c: relative modulus [n] (-), a bond takes the mean of its ends; None is 1.
        v: neighbourhood volumes over V0 [n] (-), a bond is 2 / (v_i + v_j) as stiff;
            None without correction.
        scale: factor of every bond [k, n] (-), at its first end, or None.
        share: share of a neighbour's volume within the horizon [k] (-), for damage.
        family: the bonds, none cut.
        breaks: whether bonds can break; else bits stay as they are, and where none is
            cut there is one a place instead of one a bond.
        reverse: whether reverse mode uses the hand-derived rule; forward mode and
            second derivatives need the plain path.
    """

    stiff: jax.Array
    dx: Scalar
    s_crit: Scalar | PointScalar
    c: PointScalar | None
    v: PointScalar | None
    scale: BondScalar | None
    share: jax.Array
    family: GridFamily
    breaks: bool = field(metadata={"static": True}, default=True)
    reverse: bool = field(metadata={"static": True}, default=True)

    @property
    def row(self) -> Row:
        """How the lattice is laid out."""
        return row_of(self.family.shape, self.family.offsets)

    def plain(self) -> Any:
        """The same without the hand-derived rule, for forward mode."""
        return dataclasses.replace(self, reverse=False)

    def lay(self, values: Any) -> jax.Array:
        """Nodal values [n] or [n, d] as this operator keeps them."""
        return self.row.lay(values)

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of what this operator keeps."""
        return self.row.pick(row)

    def commit(self, u: PointVector, bits: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Nodal forces [d, length] (N) at u [d, length] and the bits after it.

        Bonds that are too long break first and pull no more.
        """
        if self.reverse and self.scale is None:
            traced = (u, self.stiff, self.c, self.v)
            return _ruled(dataclasses.replace(self, stiff=None), traced, bits)
        return self._commit(u, bits)

    def items(self) -> Any:
        """What differs from offset to offset, in groups [groups, G, ...]."""
        row = self.row
        k, G = len(row.offsets), row.group
        more = -(-k // G) * G - k
        steps = np.asarray(row.offsets, float)
        dtype = jnp.result_type(self.stiff)

        def grouped(x, empty):
            x = jnp.asarray(x)
            rest = [(0, 0)] * (x.ndim - 1)
            x = jnp.pad(x, [(0, more), *rest], constant_values=empty)
            return x.reshape(-1, G, *x.shape[1:])

        dx = jnp.asarray(self.dx, dtype)
        r = jnp.asarray(np.sqrt((steps**2).sum(axis=1)), dtype) * dx
        scale = None
        if self.scale is not None:
            rows = jax.vmap(lambda x: row.lay(x))(jnp.asarray(self.scale, dtype))
            scale = grouped(jnp.pad(rows, [(0, 0), (row.margin, 0)]), 0.0)
        return (
            grouped(row.hops.astype(np.int32), 0),
            grouped(jnp.asarray(steps, dtype) * dx, 1.0),
            grouped(r, 1.0),
            grouped(self.stiff, 0.0),
            scale,
        )

    def fields(self, dtype: Any) -> tuple[Any, Any, Any]:
        """Nodal c, v and s_crit along the row with margins, or None."""
        S = self.row.margin

        def long(x: Any, empty: float) -> Any:
            if x is None:
                return None
            row = self.row.lay(jnp.asarray(x, dtype), empty)
            return jnp.pad(row, (S, S), constant_values=empty)

        s = None if jnp.ndim(self.s_crit) == 0 else self.s_crit
        return long(self.c, 0.0), long(self.v, 1.0), long(s, 0.0)

    def _commit(self, u: PointVector, bits: jax.Array) -> tuple[jax.Array, Any]:
        row, d, dtype = self.row, u.shape[0], u.dtype
        S, L, G = row.margin, row.length, row.group
        U = [jnp.pad(x, (S, S)) for x in u]
        c, v, s = self.fields(dtype)
        shared = jnp.asarray(self.s_crit, dtype)
        numbers = jnp.arange(G, dtype=jnp.uint8)
        words, there = flags(bits, row)

        def add(force, item):
            word, (hop, xi, r, k, scale) = item

            def pull(_, one):
                hop, xi, r, k, scale, number = one
                far = partial(slice_of, start=hop, size=S + L)
                eta = [far(x) - x[: S + L] for x in U]
                p = sum(e * (e + 2.0 * xi[a]) for a, e in enumerate(eta))
                live = there(word, number, hop)
                if self.breaks:
                    limit = shared if s is None else 0.5 * (far(s) + s[: S + L])
                    live &= p <= r * r * limit * (2.0 + limit)
                p = jnp.where(live, p, 0.0)  # no root of a loose pair
                l2 = r * r + p
                top, below = k * p, l2 + r * jnp.sqrt(l2)
                if c is not None:
                    top = top * (0.5 * (far(c) + c[: S + L]))
                if v is not None:
                    below = below * (0.5 * (far(v) + v[: S + L]))
                if scale is not None:
                    top = top * scale
                F = top / below
                return None, jnp.where(live, F, jnp.nan) if self.breaks else F

            kept: Any = lax.scan(pull, None, (hop, xi, r, k, scale, numbers))[1]
            # a second output would be made from the start: NaN marks what is broken
            F: Any = jnp.where(jnp.isnan(kept), 0.0, kept) if self.breaks else kept
            total = []
            for a in range(d):
                sum_, own = force[a], U[a][S : S + L]
                for g in range(G):
                    later = slice_of(U[a], S + hop[g], L)
                    before = slice_of(U[a], S - hop[g], L)
                    pulled = slice_of(F[g], S - hop[g], L)
                    sum_ = sum_ + F[g, S:] * (xi[g, a] + (later - own))
                    sum_ = sum_ - pulled * (xi[g, a] + (own - before))
                total.append(sum_)
            if not self.breaks:
                return tuple(total), None
            bits: Any = sum(
                (~jnp.isnan(kept[g])).astype(jnp.uint8) << g for g in range(G)
            )
            return tuple(total), bits

        zero = tuple(jnp.zeros(L, dtype) for _ in range(d))
        force, after = lax.scan(add, zero, (words, self.items()))
        return jnp.stack(force), after if self.breaks else bits

    def _sweep(self, bits: jax.Array, measure: Callable[..., Any], size: int) -> Any:
        """Sums over the bonds of every point of one measure: [size, length].

        Args:
            bits: bits of the bonds that count.
            measure: of one offset, called with far(x) (the row at the other end), near
                (a slice), xi, r, the stiffness of the bonds and the slot.
            size: how many.
        """
        row, S, L = self.row, self.row.margin, self.row.length
        dtype = jnp.result_type(self.stiff)
        c, v, _ = self.fields(dtype)

        def add(sums, item):
            word, number, hop, xi, r, k, scale, slot = item
            near = slice(0, S + L)
            far = partial(slice_of, start=hop, size=S + L)
            if c is not None:
                k = k * (0.5 * (far(c) + c[near]))
            if v is not None:
                k = k * 2.0 / (far(v) + v[near])
            k = k if scale is None else k * scale
            value = measure(far, near, xi, r, k, slot)
            value: Any = jnp.where(live(word, number, hop), value, 0.0)
            back = lax.dynamic_slice_in_dim(value, S - hop, L, axis=1)
            return sums + value[:, S:] + back, None

        items = jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), self.items())
        count = len(items[0])
        at = np.arange(count, dtype=np.uint8)
        every, live = flags(jnp.asarray(bits), row)
        words = every[at // row.group]
        slots = np.minimum(np.arange(count), len(row.offsets) - 1)
        xs = (words, at % row.group, *items, slots)
        return lax.scan(add, jnp.zeros((size, L), dtype), xs)[0]

    def energy(self, u: PointVector, bits: jax.Array) -> jax.Array:
        """Stored energy of each point [length] (J): half of that of its bonds."""
        S = self.row.margin
        U = [jnp.pad(x, (S, S)) for x in u]

        def measure(far, near, xi, r, k, slot):
            eta = [far(x) - x[near] for x in U]
            p = sum(e * (e + 2.0 * xi[a]) for a, e in enumerate(eta))
            e = p / (jnp.sqrt(r * r + p) + r)
            return (0.25 * k * e * e)[None]

        return self._sweep(bits, measure, 1)[0]

    def intact(self, bits: jax.Array) -> jax.Array:
        """Volume of the bonds of each point [length] (m^d)."""
        share = jnp.asarray(self.share, self.stiff.dtype) * self.dx**self.row.d
        one = jnp.ones((1, self.row.margin + self.row.length), share.dtype)
        return self._sweep(bits, lambda *at: share[at[-1]] * one, 1)[0]

    def released(self, bits: jax.Array, bits0: jax.Array) -> jax.Array:
        """Energy [] (J) of the bonds that have broken, each k (r s_crit)^2 / 2."""
        _, _, nodal = self.fields(self.stiff.dtype)
        shape = (1, self.row.margin + self.row.length)

        def measure(far, near, xi, r, k, slot):
            s = self.s_crit if nodal is None else 0.5 * (far(nodal) + nodal[near])
            return jnp.broadcast_to(0.25 * k * (r * s) ** 2, shape)

        return jnp.sum(self._sweep(bits0 & ~bits, measure, 1))

    def diagonal(self, bits: jax.Array) -> PointTensor:
        """Block diagonal [n, d, d] (N/m) of the stiffness at rest, of |k|."""
        d = self.row.d
        pairs = index_pairs(d)
        shape = self.row.margin + self.row.length

        def measure(far, near, xi, r, k, slot):
            k = jnp.broadcast_to(k, (shape,))
            k = jnp.abs(k)  # an upper bound where bonds push
            return jnp.stack([k * (xi[a] * xi[b] / (r * r)) for a, b in pairs])

        rows = self._sweep(bits, measure, len(pairs))
        return full_blocks(self.pick(rows), d)


@jax.custom_vjp
def _ruled(bare: HalfForce, traced: Any, bits: jax.Array) -> Any:
    u, stiff, c, v = traced
    return dataclasses.replace(bare, stiff=stiff, c=c, v=v)._commit(u, bits)


def _forward(bare: HalfForce, traced: Any, bits: jax.Array) -> Any:
    force, after = _ruled(bare, traced, bits)
    return (force, after), (bare, traced, after)


def _backward(kept: Any, cotangents: Any) -> Any:
    bare, traced, after = kept
    u, stiff, c, v = traced
    op = dataclasses.replace(bare, stiff=stiff, c=c, v=v)
    return None, pull_back(op, u, after, cotangents[0]), None


_ruled.defvjp(_forward, _backward)
