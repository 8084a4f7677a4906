"""The levels of multigrid on a lattice, made on the host in NumPy.

Coarse spacings are half a horizon wide: the smoother damps whatever is shorter, however
many fine spacings that is. The span of its Chebyshev polynomial is read off the symbol
of the uniform lattice: from the waves that the coarse level cannot carry upwards.

A hierarchy preconditions: an old one, or one of another modulus, costs iterations and
never accuracy. It knows the stiffness of the undeformed lattice, its live bonds, the
supports and the nodal fields; `jaxpd.operators.coarsen` says how couplings come about.
"""

from __future__ import annotations

import functools
from typing import Any

import jax
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.operators.coarsen import carried, irregular, scaled, uniform
from jaxpd.operators.fft import FFTTangent, convolution
from jaxpd.operators.lattice import LatticeTangent, index_pairs, whole
from jaxpd.operators.transfer import (
    axis_nodes,
    cut_keys,
    interpolation,
    torn_pairs,
)
from jaxpd.solvers.multigrid import Couplings, Level, Multigrid, Tridiagonal

#: Unknowns up to which a level is factorised.
MAX_COARSE = 2500
#: Steps of the Chebyshev smoother before and after the coarse correction.
DEGREE = 3
#: The smoother damps the spectrum from its upper end down to a share of it: that of the
#: waves that the coarse level cannot carry, within these limits.
SPANS = (4.0, 12.0)
#: A point that has lost more than this share of its stiffness is smoothed with care.
LOOSE = 0.6
#: A longer span than this asks for a smaller ratio of the spacings.
WIDEST = 16.0


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
    return [[*alpha, 0.0, *alpha], [*beta, 0.0, *beta]]


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
    held: Any
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
    # the stiffness of the level: of the uniform lattice, and of what is irregular in it
    smooth: list[Any] = []
    rough: list[Any] = []
    hats: list[Any] = []
    levels: list[Any] = []
    while True:
        held = fixed.all(axis=1)
        nodes = axis_nodes(held.reshape(shape), ratio)
        move = interpolation(shape, nodes, held, torn)
        diagonal = own[_diagonal(d)].T
        inverse = np.where(fixed, 0.0, 1.0 / np.where(fixed, 1.0, diagonal))
        if levels or torn_apart:
            top = _top(apply, inverse.T.reshape(d, *shape))
        elif len(family.cut[0]):
            # a point on few long bonds exceeds the symbol, by 2 d at most
            loose = _lost_share(lattice, own) > LOOSE
            inverse = np.where(loose[:, None], 0.5 * top / d * inverse, inverse)
        span = float(np.clip(1.5 * span, *SPANS)) if not levels else SPANS[0]
        # coarse levels are cheap, and what they leave is felt on all finer ones
        weights = _chebyshev(degree + (2 if levels else 0), 1.1 * top, span)
        coarse = np.ravel_multi_index(np.meshgrid(*nodes, indexing="ij"), shape).ravel()
        levels.append((fine, inverse, weights, move, ~fixed[coarse]))
        hats = [h @ g for h, g in zip(hats, move.hats, strict=False)] or move.hats
        rough = carried(smooth, rough, move) if smooth else irregular(lattice, move)
        smooth = uniform(family, lattice.parts, hats)
        plain = [sp.csr_array(a + b) for a, b in zip(smooth, rough, strict=True)]
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
        fine = _couplings(matrices, shape, dtype)
        own = np.stack([a.diagonal() for a in matrices])
        apply = functools.partial(_times, matrices)
    return Multigrid(
        tuple(_level(level, d, dtype) for level in levels),
        _factors(matrices, shape, fixed, dtype),
        np.asarray(unit),
    )


def _level(made: tuple[Any, ...], d: int, dtype: Any) -> Level:
    fine, inverse, weights, move, free = made
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


def _couplings(matrices: list[Any], shape: tuple[int, ...], dtype: Any) -> Couplings:
    """CSR matrices by components as couplings of every point."""
    n, found = matrices[0].shape[0], []
    place = np.stack(np.unravel_index(np.arange(n), shape))
    for q, a in enumerate(matrices):
        row = np.repeat(np.arange(n), np.diff(a.indptr))
        later = a.indices > row
        i, j = row[later], a.indices[later]
        found.append((np.full(len(i), q), i, place[:, j] - place[:, i], a.data[later]))
    q, i, step, value = (np.concatenate(x, axis=-1) for x in zip(*found, strict=True))
    width = np.abs(step).max(axis=1, keepdims=True)
    size = tuple(2 * width[:, 0] + 1)
    kinds, slot = np.unique(
        np.ravel_multi_index(tuple(step + width), size), return_inverse=True
    )
    stride = np.cumprod((1, *shape[:0:-1]))[::-1]
    hops = (np.stack(np.unravel_index(kinds, size), axis=1) - width.T) @ stride
    margin, length = whole(int(hops.max())), whole(n)
    parts = np.zeros((len(kinds), len(matrices), margin + length), dtype)
    parts[slot, q, margin + i] = value
    own = np.zeros((len(matrices), length))
    own[:, :n] = [a.diagonal() for a in matrices]
    return Couplings(parts, hops.astype(np.int32), own, margin)


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


def _lost_share(
    lattice: LatticeTangent, own: NDArray[np.floating]
) -> NDArray[np.floating]:
    """Share [n] of every point's stiffness that went with its missing bonds."""
    kept = _diagonal(lattice.d)
    i, j = lattice.family.cut_ends()
    size = np.asarray(lattice.parts)[:, kept].sum(axis=1)[lattice.family.cut[1]]
    n = lattice.family.n
    lost = np.bincount(i, size, n) + np.bincount(j, size, n)
    return lost / (lost + own[kept].sum(axis=0))


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
