"""A preconditioner by sines and cosines: little to compile, no levels.

On a box whose faces are held or free the waves

    held, held  sin(pi k (i + 1) / (N + 1))            k = 1 .. N
    free, free  cos(pi k (i + 1/2) / N)                k = 0 .. N - 1
    held, free  sin(pi (2 k + 1) (i + 1) / (2 N + 1))  k = 0 .. N - 1

along the N free planes of an axis diagonalise the stiffness of the uniform lattice but
for the coupling of its components and what a surface takes away. Their products,
divided by the symbol of each component, are the preconditioner. Cracks, surfaces, the
volume correction and a modulus that varies are left to the iteration: counts grow
slowly with the size, where multigrid's do not, but there is little to compile.

Transforms are products with matrices of waves: at a thousand points a side they take no
longer than the stiffness itself, and any number of points and mix of supports will do.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxpd.operators.lattice import LatticeTangent, index_pairs


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Spectral:
    """Waves along the axes and the inverse symbol.

    Attributes:
        waves: orthonormal waves of each axis [d, n_a, n_a]: component, point, wave.
        inverse: of the symbol [d, *shape] (m/N).
    """

    waves: tuple[Any, ...]
    inverse: Any

    def cycle(self, r: jax.Array) -> jax.Array:
        """The preconditioned residual [n, d], zero on prescribed planes."""
        d, size = r.shape[1], jnp.max(jnp.abs(r))
        size = jnp.where(size > 0, size, 1.0)
        z = (r / size).astype(self.inverse.dtype).T.reshape(self.inverse.shape)
        z = self._transform(z, 1) * self.inverse
        z = self._transform(z, 2).reshape(d, -1).T
        return z.astype(r.dtype) * size

    def _transform(self, u: jax.Array, summed: int) -> jax.Array:
        for waves in self.waves:  # the front axis of points goes behind the others
            u = jax.lax.dot_general(u, waves, (((1,), (summed,)), ((0,), (0,))))
        return u


def build_spectral(
    lattice: LatticeTangent, fixed: NDArray[np.bool_], *, dtype: Any = np.float32
) -> Spectral:
    """Set the waves up. Host only, NumPy.

    Args:
        lattice: stiffness of the undeformed lattice, in NumPy arrays.
        fixed: mask of prescribed entries [n, d].
        dtype: of the preconditioner.
    """
    family, d = lattice.family, lattice.d
    shape, steps = family.shape, family.steps
    held = np.asarray(fixed).T.reshape(d, *shape)
    parts = np.asarray(lattice.parts)
    own = [q for q, (a, b) in enumerate(index_pairs(d)) if a == b]
    waves = [np.zeros((d, n, n)) for n in shape]
    inverse = np.zeros((d, *shape))
    for a in range(d):
        number = []
        for axis in range(d):
            others = tuple(b for b in range(d) if b != axis)
            Q, k, span = _waves(held[a].all(axis=others))
            waves[axis][a][span, : len(k)] = Q
            number.append(k)
        symbol = np.full([len(k) for k in number], 2.0 * parts[:, own[a]].sum())
        reach = family.reach
        table = np.zeros(tuple(2 * reach + 1))
        for sign in (1, -1):
            np.add.at(table, tuple((sign * steps + reach).T), parts[:, own[a]])
        for k, r in zip(number, reach, strict=True):
            cosine = np.cos(np.outer(np.arange(-r, r + 1), k))
            table = np.tensordot(table, cosine, axes=(0, 0))
        symbol = symbol - table
        floor = symbol[symbol > 1e-9 * symbol.max()].min()
        symbol = np.maximum(symbol, 0.25 * floor)  # a translation has none
        inverse[a][tuple(slice(0, len(k)) for k in number)] = 1.0 / symbol
    return Spectral(tuple(w.astype(dtype) for w in waves), inverse.astype(dtype))


def _waves(held: NDArray[np.bool_]) -> tuple[NDArray, NDArray, slice]:
    """Orthonormal waves [N, N] of the free planes, their wave numbers, and which."""
    free = np.flatnonzero(~held)
    if not len(free):
        return np.zeros((0, 0)), np.zeros(0), slice(0, 0)
    first, last = int(free[0]), int(free[-1])
    N, i = last - first + 1, np.arange(last - first + 1)
    low, high = first > 0, last < len(held) - 1
    if low and high:
        k = np.pi * (i + 1) / (N + 1)
        Q = np.sin(np.outer(i + 1, k))
    elif not low and not high:
        k = np.pi * i / N
        Q = np.cos(np.outer(i + 0.5, k))
    else:
        k = np.pi * (2 * i + 1) / (2 * N + 1)
        Q = np.sin(np.outer(i + 1, k))
        Q = Q if low else Q[::-1]
    return Q / np.linalg.norm(Q, axis=0), k, slice(first, last + 1)
