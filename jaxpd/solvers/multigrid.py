"""Multigrid on a lattice: Galerkin levels, Chebyshev smoothing, one V-cycle on the device.

The hierarchy is built on the host, in NumPy, from the stiffness of the undeformed
lattice, its live bonds and its supports; the cycle runs in float32 inside float64
conjugate gradients. It preconditions: an old hierarchy, or one of another modulus, costs
iterations and never accuracy. Levels:

    finest       the stiffness by convolution, its volume correction replaced by the
                 nearest product, 2 / (v_i + v_j) ~ (v_i v_j)^-1/2
    in between   couplings with the points around, [w, q, *shape]
    coarsest     factors of a block-tridiagonal matrix, a few rows of points a block

Coarse spacings are half a horizon wide: the smoother damps whatever is shorter, however
many fine spacings that is. `jaxpd.operators.coarsen` says how couplings come about.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.operators.coarsen import (
    Transfer,
    axis_nodes,
    cut_keys,
    interpolation,
    irregular,
    scaled,
    torn_pairs,
    uniform,
)
from jaxpd.operators.fft import FFTTangent, blocks_times, convolution
from jaxpd.operators.lattice import LatticeTangent, index_pairs

#: Unknowns up to which a level is factorised.
MAX_COARSE = 2500
#: Steps of the Chebyshev smoother before and after the coarse correction.
DEGREE = 3
#: The smoother damps the spectrum from its upper end down to a share of it: that of the
#: waves that the coarse level cannot carry, within these limits.
SPANS = (4.0, 12.0)
#: A longer span than this asks for a smaller ratio of the spacings.
WIDEST = 16.0


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Couplings:
    """A coarse stiffness: blocks between every point and the points around.

    Attributes:
        blocks: upper triangles [w, q, *shape] of the blocks to the points at `steps`.
        steps: their offsets [w, d].
        own: upper triangles of the block diagonal [q, *shape].
    """

    blocks: jax.Array
    steps: jax.Array
    own: jax.Array
    width: tuple[int, ...] = field(metadata={"static": True})

    def apply(self, u: jax.Array) -> jax.Array:
        """K u for components apart [d, *shape]."""
        d, shape = u.shape[0], u.shape[1:]
        padded = jnp.pad(u, ((0, 0), *((w, w) for w in self.width)))

        def add(total, slot):
            blocks, step = slot
            start = jnp.concatenate([jnp.zeros(1, step.dtype), step])
            seen = jax.lax.dynamic_slice(padded, start, (d, *shape))
            return total + blocks_times(blocks, seen, d), None

        own = blocks_times(self.own, u, d)
        return jax.lax.scan(add, own, (self.blocks, self.steps))[0]


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
    inverse: jax.Array
    weights: jax.Array
    hats: tuple[jax.Array, ...]
    change: tuple[jax.Array, jax.Array]
    free: jax.Array

    def prolong(self, coarse: jax.Array) -> jax.Array:
        """Interpolate [d, *coarse] to the points of this level."""
        fine = coarse
        for hat in self.hats:  # the front axis of points goes behind the others
            fine = jnp.moveaxis(jnp.tensordot(fine, hat, axes=(1, 1)), -1, -1)
        weight, (i, j) = self.change
        if weight.shape[0] == 0:
            return fine
        d = coarse.shape[0]
        flat = fine.reshape(d, -1)
        value = weight * coarse.reshape(d, -1)[:, j]
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
        value = weight * fine.reshape(d, -1)[:, i]
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

    inverse: jax.Array
    down: jax.Array

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
    unit: jax.Array

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


def _chebyshev(degree: int, top: float, span: float) -> list[list[float]]:
    """Coefficients of d <- alpha d + beta D^-1 r, before and after the coarse step.

    Chebyshev iteration on [top / span, top], Y. Saad (2003), algorithm 12.1.
    """
    theta, delta = 0.5 * (top + top / span), 0.5 * (top - top / span)
    alpha, beta, rho = [0.0], [1.0 / theta], delta / theta
    for _ in range(degree - 1):
        new = 1.0 / (2.0 * theta / delta - rho)
        alpha.append(new * rho)
        beta.append(2.0 * new / delta)
        rho = new
    return [alpha + [0.0] + alpha, beta + [0.0] + beta]


def build_multigrid(
    lattice: LatticeTangent,
    fixed: NDArray[np.bool_],
    *,
    degree: int = DEGREE,
    ratio: int | None = None,
    dtype: Any = np.float32,
) -> Multigrid:
    """Set a hierarchy up. Host only, NumPy.

    Args:
        lattice: stiffness of the undeformed lattice, in NumPy arrays.
        fixed: mask of prescribed entries [n, d].
        degree: steps of the Chebyshev smoother on either side.
        ratio: fine spacings in a coarse one, from the horizon by default: half of it.
        dtype: of the cycle.
    """
    family, d = lattice.family, lattice.d
    fixed, shape = np.asarray(fixed), family.shape
    unit = float(np.abs(lattice.parts).sum(axis=0).max())
    lattice = LatticeTangent(
        np.asarray(lattice.parts) / unit, lattice.v, lattice.c, family
    )
    g = None if lattice.v is None else np.asarray(lattice.v) ** -0.5
    c = None if lattice.c is None else np.asarray(lattice.c)
    fine: Any = convolution(lattice)
    values, wave = _symbol(fine)
    top = float(values.max())
    m = float(np.sqrt((family.steps**2).sum(axis=1).max()))
    ratio = ratio or max(2, 2 ** int(np.log2(max(m / 2, 1.0) + 1e-9)))
    while True:
        span = top / float(values[wave >= (1 - 1e-9) * np.pi / ratio].min())
        if ratio == 2 or span <= WIDEST:
            break
        ratio //= 2
    torn_apart = len(family.cut[0]) > 0.02 * family.n_bonds
    own = np.asarray(fine.own).reshape(len(fine.own), -1)
    torn, reach = cut_keys(family), int(m / d**0.5 + 1e-9)
    apply: Any = fine.apply
    plain: list[Any] = []
    levels = []
    while True:
        held = fixed.all(axis=1)
        nodes = axis_nodes(held.reshape(shape), ratio)
        move = interpolation(shape, nodes, held, torn)
        diagonal = own[_diagonal(d)].T
        inverse = np.where(fixed, 0.0, 1.0 / np.where(fixed, 1.0, diagonal))
        if levels or torn_apart:
            top = _top(apply, inverse.T.reshape(d, *shape))
        span = float(np.clip(1.5 * span, *SPANS)) if not levels else SPANS[0]
        # coarse levels are cheap, and what they leave is felt on all finer ones
        weights = _chebyshev(degree + (2 if levels else 0), 1.1 * top, span)
        coarse = np.ravel_multi_index(np.meshgrid(*nodes, indexing="ij"), shape).ravel()
        levels.append((fine, inverse, weights, move, ~fixed[coarse]))
        if not plain:
            change = irregular(lattice, move)
            plain = [
                sp.csr_array(a + b)
                for a, b in zip(
                    uniform(family, lattice.parts, move.hats), change, strict=True
                )
            ]
        else:
            plain = [sp.csr_array(move.matrix.T @ a @ move.matrix) for a in plain]
        P = move.matrix
        weight = np.asarray(P.sum(axis=0)).ravel()
        weight = np.where(weight > 0, weight, 1.0)
        g = None if g is None else (P.T @ g) / weight
        c = None if c is None else (P.T @ c) / weight
        matrices = scaled(plain, g, c)
        torn = torn_pairs(torn, shape, nodes, max(1, reach))
        shape, fixed, ratio, reach = move.shape, fixed[coarse], 2, 1
        if (~fixed).sum() <= MAX_COARSE or len(fixed) >= 0.8 * len(held):
            break
        fine = _couplings(matrices, shape)
        own = np.stack([a.diagonal() for a in matrices])
        apply = functools.partial(_times, matrices)
    return Multigrid(
        tuple(_level(*level, d, dtype) for level in levels),
        _factors(matrices, shape, fixed, dtype),
        np.asarray(unit),
    )


def _level(
    fine: Any, inverse: Any, weights: Any, move: Transfer, free: Any, d: int, dtype: Any
) -> Level:
    shape = tuple(len(hat) for hat in move.hats)
    cast = lambda x: x.astype(dtype) if x.dtype.kind == "f" else x  # noqa: E731
    return Level(
        jax.tree.map(cast, fine),
        inverse.T.reshape(d, *shape).astype(dtype),
        np.asarray(weights, dtype),
        tuple(hat.astype(dtype) for hat in move.hats),
        (move.change.data.astype(dtype), np.stack(move.change.coords).astype(np.int32)),
        free.T.reshape(d, *move.shape).astype(dtype),
    )


def _couplings(matrices: list[Any], shape: tuple[int, ...]) -> Couplings:
    """CSR matrices by components as couplings of every point."""
    d = len(shape)
    every = [sp.coo_array(a) for a in matrices]
    steps = [
        np.stack(np.unravel_index(a.coords[1], shape))
        - np.stack(np.unravel_index(a.coords[0], shape))
        for a in every
    ]
    width = np.max([np.abs(e).max(axis=1) for e in steps], axis=0)
    size = tuple(2 * width + 1)
    codes = [np.ravel_multi_index(tuple(e + width[:, None]), size) for e in steps]
    kinds = np.unique(np.concatenate(codes))
    blocks = np.zeros((len(kinds), len(matrices), int(np.prod(shape))))
    for q, (a, code) in enumerate(zip(every, codes, strict=True)):
        blocks[np.searchsorted(kinds, code), q, a.coords[0]] = a.data
    blocks = blocks.reshape(*blocks.shape[:2], *shape)
    around = np.stack(np.unravel_index(kinds, size), axis=1).astype(np.int32)
    own = (around == width).all(axis=1)
    return Couplings(blocks[~own], around[~own], blocks[own][0], tuple(map(int, width)))


def _factors(
    matrices: list[Any], shape: tuple[int, ...], fixed: NDArray[np.bool_], dtype: Any
) -> Tridiagonal:
    """Factors of a stiffness on its free entries; units on the prescribed ones.

    A piece that floats is held by a spring of a millionth of the stiffness.
    """
    d, n = len(shape), len(fixed)
    slot = {ab: q for q, ab in enumerate(index_pairs(d))}
    every = []
    for a in range(d):
        for b in range(d):
            part = sp.coo_array(matrices[slot[min(a, b), max(a, b)]])
            i, j = part.coords
            live = ~fixed[i, a] & ~fixed[j, b]
            every.append((part.data[live], i[live] * d + a, j[live] * d + b))
    value, i, j = (np.concatenate(x) for x in zip(*every, strict=True))
    size = float(np.abs(value).max())
    row = n // shape[0] * d  # unknowns of one plane of points
    width = int(np.abs(i // row - j // row).max())
    b = row * max(1, width)
    s = -(-n * d // b)
    blocks = np.zeros((s, 3, b, b))  # to the block before, own, to the one behind
    np.add.at(blocks, (i // b, j // b - i // b + 1, i % b, j % b), value)
    own = np.ones(s * b)
    own[: n * d] = np.where(fixed.ravel(), 1.0, 1e-6) * size
    blocks[:, 1, np.arange(b), np.arange(b)] += own.reshape(s, b)
    inverse, down = np.zeros((2, s, b, b))
    for k in range(s):
        S = blocks[k, 1]
        if k:
            down[k] = blocks[k, 0] @ inverse[k - 1]
            S = S - down[k] @ blocks[k, 0].T
        inverse[k] = la.inv(S)
    return Tridiagonal(inverse.astype(dtype), down.astype(dtype))


def _times(matrices: list[Any], u: NDArray[np.floating]) -> NDArray[np.floating]:
    """A stiffness by components times u [d, *shape]."""
    flat, out = u.reshape(len(u), -1), np.zeros((len(u), u[0].size))
    for (a, b), matrix in zip(index_pairs(len(u)), matrices, strict=True):
        out[a] += matrix @ flat[b]
        if a != b:
            out[b] += matrix @ flat[a]
    return out.reshape(u.shape)


def _top(apply: Any, inverse: NDArray[np.floating], steps: int = 12) -> float:
    """Upper end of the spectrum of inverse times stiffness, by power iteration."""
    x = np.random.default_rng(0).normal(size=inverse.shape) * (inverse > 0)
    size = 1.0
    for _ in range(steps):
        x = x / np.linalg.norm(x)
        x = inverse * apply(x)
        size = float(np.linalg.norm(x))
    return size


def _symbol(fine: FFTTangent) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Spectrum [.., d] of the scaled uniform lattice and its largest wave number [..].

    Wave numbers are in radians a spacing, the largest among the axes; every axis is
    thinned out to some 128.
    """
    d, lengths = fine.lattice.d, fine.lengths
    thin = tuple(slice(None, None, -(-n // 128)) for n in fine.symbol.shape[2:])
    symbol = np.asarray(fine.symbol)[(..., *thin)]
    whole = 2.0 * np.asarray(fine.lattice.parts).sum(axis=0)
    size = np.sqrt(whole[_diagonal(d)])
    K = np.empty((*symbol.shape[2:], d, d))
    for q, (a, b) in enumerate(index_pairs(d)):
        K[..., a, b] = K[..., b, a] = whole[q] - symbol[(a - b) % d, a]
    waves = [np.abs(np.fft.fftfreq(n)) for n in lengths[:-1]] + [
        np.fft.rfftfreq(lengths[-1])
    ]
    waves = [w[s] for w, s in zip(waves, thin, strict=True)]
    largest = np.max(np.meshgrid(*waves, indexing="ij"), axis=0)
    return np.linalg.eigvalsh(K / np.outer(size, size)), 2.0 * np.pi * largest


def _diagonal(d: int) -> list[int]:
    """Positions of the diagonal entries in an upper triangle."""
    return [q for q, (a, b) in enumerate(index_pairs(d)) if a == b]
