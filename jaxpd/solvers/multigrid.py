"""Multigrid on a lattice: one V-cycle on the device.

Galerkin levels, Chebyshev smoothing, in float32 inside float64 conjugate gradients. The
levels are made on the host by `jaxpd.solvers.hierarchy`:

    finest       the stiffness by convolution, its volume correction replaced by the
                 nearest product, 2 / (v_i + v_j) ~ (v_i v_j)^-1/2
    in between   couplings with the points around
    coarsest     factors of a block-tridiagonal matrix, a few rows of points a block

Arrays are NumPy's where they are made and JAX's where they are used.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.lax import dynamic_slice, dynamic_slice_in_dim

from jaxpd.operators.fft import blocks_times
from jaxpd.operators.lattice import index_pairs


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Couplings:
    """A coarse stiffness: blocks between every point and the points around.

    Points are one row, with a margin of zeros in front; a coupling is kept once, at its
    first end, and read twice, as in `jaxpd.operators.stored`.

    Attributes:
        parts: upper triangles of the blocks [w, q, margin + n + fill].
        hops: how far they reach along the row [w].
        own: upper triangles of the block diagonal [q, n + fill].
        margin: in front of a row.
    """

    parts: Any
    hops: Any
    own: Any
    margin: int = field(metadata={"static": True})

    def apply(self, u: jax.Array) -> jax.Array:
        """K u for components apart [d, *shape]."""
        d, size = u.shape[0], self.own.shape[1]
        flat, front = u.reshape(d, -1), self.margin
        n = flat.shape[1]
        rows = [jnp.pad(x, (front, front + size - n)) for x in flat]
        kept = index_pairs(d)

        def add(force, item):
            slot, hop = item
            force = list(force)
            for start, to in ((front, front + hop), (front - hop, front - hop)):
                seen = [dynamic_slice_in_dim(x, to, size) for x in rows]
                for q, (a, b) in enumerate(kept):
                    at = (slot, np.int32(q), jnp.asarray(start, hop.dtype))
                    part = dynamic_slice(self.parts, at, (1, 1, size))[0, 0]
                    force[a] = force[a] + part * seen[b]
                    if a != b:
                        force[b] = force[b] + part * seen[a]
            return tuple(force), None

        here = jnp.stack([x[front : front + size] for x in rows])
        begin = tuple(blocks_times(self.own, here, d))
        items = (jnp.arange(len(self.hops), dtype=self.hops.dtype), self.hops)
        force, _ = jax.lax.scan(add, begin, items, unroll=2)
        return jnp.stack([x[:n] for x in force]).reshape(u.shape)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Level:
    """A level above the coarsest.

    Attributes:
        stiffness: `FFTTangent` or `Couplings`, with `apply`.
        inverse: of the diagonal [d, *shape], zero on prescribed entries.
        weights: of the Chebyshev steps [2, 2 degree + 1].
        hats: interpolation from the next level along each axis.
        change: its exceptions, weights [b], with fine and coarse points [2, b].
        free: one where the next level is free, zero where prescribed [d, *coarse].
    """

    stiffness: Any
    inverse: Any
    weights: Any
    hats: tuple[Any, ...]
    change: tuple[Any, Any]
    free: Any

    def prolong(self, coarse: jax.Array) -> jax.Array:
        """Interpolate [d, *coarse] to the points of this level."""
        fine = coarse
        for hat in self.hats:  # the front axis of points goes behind the others
            fine = jnp.tensordot(fine, hat, axes=(1, 1))
        weight, (i, j) = self.change
        if weight.shape[0] == 0:
            return fine
        d = coarse.shape[0]
        flat = fine.reshape(d, -1)
        value = weight[None] * coarse.reshape(d, -1)[:, j]
        return flat.at[:, i].add(value, mode="promise_in_bounds").reshape(fine.shape)

    def restrict(self, fine: jax.Array) -> jax.Array:
        """The transpose of `prolong`."""
        coarse = fine
        for hat in self.hats:
            coarse = jnp.tensordot(coarse, hat, axes=(1, 0))
        weight, (i, j) = self.change
        if weight.shape[0] == 0:
            return coarse
        d = fine.shape[0]
        flat = coarse.reshape(d, -1)
        value = weight[None] * fine.reshape(d, -1)[:, i]
        return flat.at[:, j].add(value, mode="promise_in_bounds").reshape(coarse.shape)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Tridiagonal:
    """Inverse of a symmetric block-tridiagonal matrix by its factors.

    With S_k = A_kk - A_k,k-1 S_k-1^-1 A_k-1,k:

    Attributes:
        inverse: S_k^-1 [s, b, b].
        down: A_k,k-1 S_k-1^-1 [s, b, b], zero for the first.
    """

    inverse: Any
    down: Any

    def solve(self, r: jax.Array) -> jax.Array:
        """A^-1 r for the leading unknowns r [c] of the s b."""
        s, b = self.inverse.shape[:2]
        rows = jnp.pad(r, (0, s * b - r.shape[0])).reshape(s, b)

        def forward(y, slot):
            down, row = slot
            y = row - down @ y
            return y, y

        def backward(x, slot):
            up, row = slot
            x = row - x @ up
            return x, x

        zero = jnp.zeros(b, r.dtype)
        y = jax.lax.scan(forward, zero, (self.down, rows))[1]
        y = jnp.einsum("sab,sb->sa", self.inverse, y)
        up = jnp.concatenate([self.down[1:], jnp.zeros_like(self.down[:1])])
        x = jax.lax.scan(backward, zero, (up, y), reverse=True)[1]
        return x.ravel()[: r.shape[0]]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Multigrid:
    """A hierarchy behind one symmetric V-cycle.

    Attributes:
        levels: from the finest, without the coarsest.
        coarsest: factors of the coarsest stiffness, point by point.
        unit: stiffness by which all levels are divided [] (N/m).
    """

    levels: tuple[Level, ...]
    coarsest: Tridiagonal
    unit: Any

    @property
    def sizes(self) -> list[int]:
        """Unknowns of each level, prescribed ones included."""
        return [x.inverse.size for x in self.levels] + [self.levels[-1].free.size]

    def cycle(self, r: jax.Array) -> jax.Array:
        """One V-cycle on a residual [n, d], zero on prescribed entries."""
        first = self.levels[0].inverse
        size = jnp.max(jnp.abs(r))
        size = jnp.where(size > 0, size, 1.0)
        b = jnp.moveaxis(r / size, 1, 0).astype(first.dtype).reshape(first.shape)
        z = self._correct(0, b).reshape(r.shape[1], -1)
        return jnp.moveaxis(z, 0, 1).astype(r.dtype) * (size / self.unit)

    def _correct(self, at: int, b: jax.Array) -> jax.Array:
        if at == len(self.levels):
            d = b.shape[0]
            x = self.coarsest.solve(b.reshape(d, -1).T.ravel())
            return x.reshape(-1, d).T.reshape(b.shape)
        level = self.levels[at]
        last = level.weights.shape[1] - 1
        alpha, beta = level.weights

        def coarse(r, d):
            return level.prolong(level.free * self._correct(at + 1, level.restrict(r)))

        def turn(k, carry):
            z, r, d = carry
            smooth = lambda r, d: alpha[k] * d + beta[k] * level.inverse * r  # noqa: E731
            d = jax.lax.cond(k == last // 2, coarse, smooth, r, d)
            d = jnp.where(level.inverse > 0, d, 0.0)
            r = jax.lax.cond(
                k < last,
                lambda r, d: r - level.stiffness.apply(d),
                lambda r, d: r,
                r,
                d,
            )
            return z + d, r, d

        zero = jnp.zeros_like(b)
        return jax.lax.fori_loop(0, last + 1, turn, (zero, b, zero))[0]
