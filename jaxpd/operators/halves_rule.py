"""The reverse-mode rule of breaking bonds on a lattice, by hand; see `halves`.

Plain AD of the sweep keeps every slice of every offset, many times the cost and memory
of a force. The rule is one sweep more.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpd._types import PointScalar, PointVector


def slice_of(row: jax.Array, start: Any, size: int) -> jax.Array:
    """The part [size] of a row that starts at a traced place."""
    return lax.dynamic_slice_in_dim(row, start, size)


def flags(bits: jax.Array, row: Any) -> tuple[jax.Array, Callable[..., jax.Array]]:
    """A word of each group of offsets, and which bonds of an offset there are.

    Args:
        bits: one a bond [groups, margin + length]; or, where none can break and none is
            cut, one a place that holds a point [margin + length + margin].
        row: how the lattice is laid out.
    """
    if bits.ndim == 2:
        return bits, lambda word, number, hop: (word >> number) & 1 != 0
    size = row.margin + row.length

    def there(word: Any, number: Any, hop: Any) -> jax.Array:
        both = bits[:size] & slice_of(bits, hop, size)
        return (both != 0) & (hop > 0)  # 0 fills the last group up

    groups = -(-len(row.offsets) // row.group)
    return jnp.zeros((groups, 1), jnp.uint8), there


def pull_back(
    op: Any, u: PointVector, bits: jax.Array, ct: jax.Array
) -> tuple[jax.Array, jax.Array, PointScalar | None, PointScalar | None]:
    """Derivatives of sum(ct * force) in u, stiff, c and v, at frozen bits.

    The power of a bond is F D . y with D = ct_i - ct_j; its derivative in eta is
    F D + B y, B = (D . y) k r / |y|^3, by hand. F and B are kept as one complex
    number, since XLA would otherwise make each from the start.
    """
    row, d, dtype = op.row, u.shape[0], u.dtype
    S, L, G = row.margin, row.length, row.group
    U, T = ([jnp.pad(x, (S, S)) for x in rows] for rows in (u, ct))
    c, v, _ = op.fields(dtype)
    numbers = jnp.arange(G, dtype=jnp.uint8)
    words, there = flags(bits, row)

    def add(sums, item):
        word, (hop, xi, r, k, _) = item

        def power_of(hop, xi):
            """D . y of the bonds of one offset."""
            far = partial(slice_of, start=hop, size=S + L)
            return sum(
                (t[: S + L] - far(t)) * (xi[a] + (far(x) - x[: S + L]))
                for a, (x, t) in enumerate(zip(U, T, strict=True))
            )

        def pull(_, one):
            hop, xi, r, k, number = one
            far = partial(slice_of, start=hop, size=S + L)
            eta = [far(x) - x[: S + L] for x in U]
            p = sum(e * (e + 2.0 * xi[a]) for a, e in enumerate(eta))
            live = there(word, number, hop)
            p = jnp.where(live, p, 0.0)  # no root of a loose pair
            l2 = r * r + p
            length = jnp.sqrt(l2)
            k: Any = jnp.where(live, k, 0.0)
            if v is not None:
                k = k * 2.0 / (far(v) + v[: S + L])
            if c is not None:
                k = k * (0.5 * (far(c) + c[: S + L]))
            # (l - r) / l and r / l^3 from one quotient, free of cancellation
            part = k / (l2 * (length + r))
            F = part * p * length
            B = part * power_of(hop, xi) * r * (1.0 + r / length)
            return None, lax.complex(F, B)

        _, both = lax.scan(pull, None, (hop, xi, r, k, numbers))
        F, B, (ubar, cbar, vbar) = both.real, both.imag, sums
        per_stiff = []
        for g in range(G):
            value = F[g] * power_of(hop[g], xi[g])
            some: Any = jnp.where(k[g] == 0.0, 1.0, k[g])
            per_stiff.append(jnp.sum(value) / some)
            back = partial(slice_of, start=S - hop[g], size=L)
            if v is not None:
                share = value / (slice_of(v, hop[g], S + L) + v[: S + L])
                vbar = vbar - (share[S:] + back(share))
            if c is not None:
                both_c = slice_of(c, hop[g], S + L) + c[: S + L]
                some = jnp.where(both_c > 0.0, both_c, 1.0)
                share = value / some
                cbar = cbar + (share[S:] + back(share))
        total = []
        for a in range(d):
            sum_, own, tied = ubar[a], U[a][S : S + L], T[a][S : S + L]
            for g in range(G):
                h = hop[g]
                y = xi[g, a] + (slice_of(U[a], S + h, L) - own)
                sum_ = (
                    sum_ - F[g, S:] * (tied - slice_of(T[a], S + h, L)) - B[g, S:] * y
                )
                y = xi[g, a] + (own - slice_of(U[a], S - h, L))
                F_, B_ = (slice_of(x[g], S - h, L) for x in (F, B))
                sum_ = sum_ + F_ * (slice_of(T[a], S - h, L) - tied) + B_ * y
            total.append(sum_)
        return (tuple(total), cbar, vbar), jnp.stack(per_stiff)

    zero = jnp.zeros(L, dtype)
    (ubar, cbar, vbar), per_stiff = lax.scan(
        add, ((zero,) * d, zero, zero), (words, op.items())
    )
    return (
        jnp.stack(ubar),
        per_stiff.reshape(-1)[: len(row.offsets)],
        None if c is None else row.pick(cbar),
        None if v is None else row.pick(vbar),
    )
