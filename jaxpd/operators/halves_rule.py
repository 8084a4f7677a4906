"""The reverse-mode rule of breaking bonds on a lattice, by hand; see `halves`.

Plain AD of the sweep keeps every slice of every offset: some 50 times the cost of a
force and as many times its memory. The rule is one sweep more.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax

from jaxpd._types import PointScalar, PointVector


def slice_of(row: jax.Array, start: Any, size: int) -> jax.Array:
    """The part [size] of a row that starts at a traced place."""
    return lax.dynamic_slice_in_dim(row, start, size)


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

    def add(sums, item):
        word, (hop, xi, r, k, _) = item

        def pull(_, one):
            hop, xi, r, k, number = one
            far = partial(slice_of, start=hop, size=S + L)
            eta = [far(x) - x[: S + L] for x in U]
            p = sum(e * (e + 2.0 * xi[a]) for a, e in enumerate(eta))
            live = (word >> number) & 1 != 0
            p = jnp.where(live, p, 0.0)  # no root of a loose pair
            l2 = r * r + p
            length = jnp.sqrt(l2)
            power = sum(
                (x[: S + L] - far(x)) * (xi[a] + eta[a]) for a, x in enumerate(T)
            )
            factor = jnp.where(live, 1.0, 0.0).astype(dtype)
            if v is not None:
                factor = factor * 2.0 / (far(v) + v[: S + L])
            plain = factor * p / (l2 + r * length)
            if c is not None:
                factor = factor * (0.5 * (far(c) + c[: S + L]))
            F = factor * p / (l2 + r * length)
            B = factor * power * (r / (l2 * length))
            return None, (k * lax.complex(F, B), jnp.sum(F * power), plain * power)

        _, (both, per_stiff, per_c) = lax.scan(pull, None, (hop, xi, r, k, numbers))
        F, B, (ubar, cbar, vbar) = both.real, both.imag, sums
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
        for g in range(G if c is not None or v is not None else 0):
            value = k[g] * per_c[g]
            back = partial(slice_of, start=S - hop[g], size=L)
            if c is not None:
                cbar = cbar + 0.5 * (value[S:] + back(value))
                far_c = slice_of(c, hop[g], S + L)
                value = value * (0.5 * (far_c + c[: S + L]))
            if v is not None:
                value = value / (slice_of(v, hop[g], S + L) + v[: S + L])
                vbar = vbar - (value[S:] + back(value))
        return (tuple(total), cbar, vbar), per_stiff

    zero = jnp.zeros(L, dtype)
    (ubar, cbar, vbar), per_stiff = lax.scan(
        add, ((zero,) * d, zero, zero), (bits, op.items())
    )
    return (
        jnp.stack(ubar),
        per_stiff.reshape(-1)[: len(row.offsets)],
        None if c is None else row.pick(cbar),
        None if v is None else row.pick(vbar),
    )
