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
    d, shape = lattice.d, lattice.family.shape
    waves = [np.zeros((d, n, n)) for n in shape]
    inverse = np.zeros((d, *shape))
    for a, (symbol, numbers) in enumerate(symbols(lattice, fixed)):
        if not symbol.size:
            continue  # this component is prescribed everywhere
        for axis, (held, k) in enumerate(numbers):
            Q, span = _waves(held, k)
            waves[axis][a][span, : len(k)] = Q
        floor = symbol[symbol > 1e-9 * symbol.max()].min()
        symbol = np.maximum(symbol, 0.25 * floor)  # a translation has none
        inverse[a][tuple(slice(0, n) for n in symbol.shape)] = 1.0 / symbol
    return Spectral(tuple(w.astype(dtype) for w in waves), inverse.astype(dtype))


def symbols(lattice: LatticeTangent, fixed: NDArray[np.bool_]) -> list[Any]:
    """Symbol of each component (N/m); held planes and wave numbers of each axis."""
    family, d = lattice.family, lattice.d
    shape, steps, reach = family.shape, family.steps, family.reach
    every = np.asarray(fixed).T.reshape(d, *shape)
    parts, found = np.asarray(lattice.parts), []
    own = [q for q, (a, b) in enumerate(index_pairs(d)) if a == b]
    for a in range(d):
        numbers = []
        for axis in range(d):
            held = every[a].all(axis=tuple(b for b in range(d) if b != axis))
            numbers.append((held, _numbers(held)))
        table = np.zeros(tuple(2 * reach + 1))
        for sign in (1, -1):
            np.add.at(table, tuple((sign * steps + reach).T), parts[:, own[a]])
        for (_, k), r in zip(numbers, reach, strict=True):
            cosine = np.cos(np.outer(np.arange(-r, r + 1), k))
            table = np.tensordot(table, cosine, axes=(0, 0))
        found.append((2.0 * parts[:, own[a]].sum() - table, numbers))
    return found


def _ends(held: NDArray[np.bool_]) -> tuple[int, int, bool, bool]:
    """First and last free plane, and whether one is held before and behind them."""
    free = np.flatnonzero(~held)
    first, last = int(free[0]), int(free[-1])
    return first, last, first > 0, last < len(held) - 1


def _numbers(held: NDArray[np.bool_]) -> NDArray[np.floating]:
    """Wave numbers [N] (radians a spacing)."""
    if held.all():
        return np.zeros(0)
    first, last, low, high = _ends(held)
    N = last - first + 1
    i = np.arange(N)
    if low and high:
        return np.pi * (i + 1) / (N + 1)
    if low or high:
        return np.pi * (2 * i + 1) / (2 * N + 1)
    return np.pi * i / N


def _waves(
    held: NDArray[np.bool_], k: NDArray[np.floating]
) -> tuple[NDArray[np.floating], slice]:
    """Orthonormal waves [N, N] of the planes between held ones, and which these are."""
    first, last, low, high = _ends(held)
    i = np.arange(last - first + 1)
    if low or high:
        Q = np.sin(np.outer(i + 1, k))
        Q = Q if low else Q[::-1]
    else:
        Q = np.cos(np.outer(i + 0.5, k))
    return Q / np.linalg.norm(Q, axis=0), slice(first, last + 1)
