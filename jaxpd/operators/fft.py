"""Linear bonds of a lattice by zero-padded convolution: n log n, whatever the horizon.

The stiffness of `jaxpd.operators.lattice`, its block diagonal D apart from the rest,

    K u = D u - sum_t  left_t * (B convolved with right_t * u) + cut bonds,

a convolution for every term of the factor F_ij = sum_t left_t(i) right_t(j). A uniform
lattice has one term, left = right = 1; a modulus that bonds take the mean of has two.
The volume correction 2 / (v_i + v_j) is a Cauchy kernel: elimination at a few pivots t

    2 / (v + w) = sum_k f_k(v) f_k(w) + remainder,
    remainder   = 2 / (v + w) prod_t (t - v)(t - w) / ((t + v)(t + w)),

leaves less than `SEPARATION` of it after a few pivots. The first is the bulk's v:
its term is exact for all bonds with an end in the bulk, and the others vanish there, so
that patches along the rim are enough for them (`jaxpd.operators.patches`). Zero padding
by the reach of the offsets makes free surfaces exact. Missing bonds are a list, sorted
by row.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.special import ellipj, ellipk

from jaxpd._types import PointTensor, PointVector, namespace
from jaxpd.geometry.grid_family import add_at, offset_sums
from jaxpd.operators.lattice import LatticeTangent, full_blocks, index_pairs
from jaxpd.operators.patches import Box, Patches, convolve, padded, spectrum, stacked

#: Largest relative error of the factor of a bond through the separated correction.
SEPARATION = 1e-9
MOST_TERMS = 16


def pivots(
    v: Any, separation: float = SEPARATION, bulk: float = 1.0
) -> tuple[float, ...]:
    """Pivots that separate 2 / (v_i + v_j) over the range of v [n]. Host only.

    The value of the bulk comes first. The relative error of a bond is the geometric
    mean of what is tested here at its ends.
    """
    low, high = float(np.min(v)), max(float(np.max(v)), bulk)
    value, at = np.geomspace(low, high, 1000), np.array([bulk])
    for count in range(MOST_TERMS):
        at = np.append(bulk, _levelled(low, bulk, count))
        if np.exp(_log_error(at, value)).max() < separation:
            break
    return tuple(map(float, at))


def _levelled(low: float, bulk: float, count: int) -> Any:
    """Pivots [count] that with the bulk's leave errors of equal height between them.

    Zolotarev's points, known from the parameters of alternating directions (E. L.
    Wachspress), are the best for an interval. The last of them is moved to the bulk,
    and the others follow by Newton's method on the logarithms (Remez).
    """
    if count == 0 or low >= bulk:
        return np.full(count, bulk)
    modulus = 1.0 - (low / bulk) ** 2
    phase = (np.arange(count, -1, -1) + 0.5) / (count + 1) * ellipk(modulus)
    at = bulk * ellipj(phase, modulus)[2][:-1]
    for _ in range(10):
        knots = np.concatenate([[low], at, [bulk]])
        value = np.geomspace(knots[:-1], knots[1:], 99)
        error = _log_error(np.append(at, bulk), value)
        peak = value[error.argmax(axis=0), np.arange(count + 1)]
        slope = 4.0 * at * peak[:, None] / (at**2 - peak[:, None] ** 2)
        system = np.column_stack([slope, -np.ones(count + 1)])
        move = np.linalg.solve(system, -error.max(axis=0))[:count]
        at = at * np.exp(np.clip(move, -0.05, 0.05))
    return at


def _log_error(at: Any, value: Any) -> Any:
    """Logarithm of the error of bonds both ends of which have a value [...]."""
    t = at.reshape(-1, *(1,) * value.ndim)
    return 2.0 * np.log(np.abs((t - value) / (t + value)) + 1e-300).sum(axis=0)


def separated(v: Any, at: tuple[float, ...]) -> Any:
    """Fields f [k, n] with sum_k f_k(v_i) f_k(v_j) = 2 / (v_i + v_j) but for rounding.

    Elimination in closed form: f_k(v) = sqrt(1 / t_k) 2 t_k / (t_k + v) times
    (t - v) / (t + v) of the pivots t before it.
    """
    fields, left = [], 1.0
    for t in at:
        fields.append(left * (2.0 * t**0.5) / (t + v))
        left = left * (t - v) / (t + v)
    return namespace(v).stack(fields)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class FFTTangent:
    """Stiffness of an undeformed lattice by fast Fourier transforms.

    Attributes:
        lattice: the same stiffness by its definition.
        symbol: transforms of the block entries, shifted [d, d, *half]: row s holds
            entries (a, a - s), so that products need no stacking (N/m).
        left, right: fields of the terms [T, *shape], or None for the single term 1.
        own: upper triangles of the block diagonal [q, *shape] (N/m).
        lost: upper triangles of the missing bonds' blocks [q, 2b] (N/m), both
            directions of each.
        rows, cols: their points [2b], rows ascending.
        lengths: padded points along each axis.
        patches: the terms that vanish in the bulk, on boxes along the rim; without any,
            all terms are in `left` and `right`.
    """

    lattice: LatticeTangent
    symbol: Any
    left: Any
    right: Any
    own: Any
    lost: Any
    rows: Any
    cols: Any
    lengths: tuple[int, ...] = field(metadata={"static": True})
    patches: tuple[Patches, ...] = ()

    symmetric = True

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        shape = self.lattice.family.shape
        return self.apply(du.T.reshape(-1, *shape)).reshape(len(shape), -1).T

    def apply(self, u: jax.Array) -> jax.Array:
        """K u for components apart [d, *shape] (N)."""
        d, xp = self.lattice.d, namespace(u, self.own)
        u = xp.asarray(u)
        force = blocks_times(self.own, u, d)
        if self.left is None:
            force = force - self._convolve(u)
        else:
            terms = self.right[:, None] * u[None]
            force = force - xp.sum(self.left[:, None] * self._convolve(terms), axis=0)
        for patch in self.patches:
            force = patch.subtract(force, u)
        if self.rows.shape[0] == 0:
            return force
        flat = u.reshape(d, -1)
        pull = blocks_times(self.lost, flat[:, self.cols], d)
        back = add_at(xp, (flat.shape[1], d), self.rows, pull.T, ascending=True)
        return force + back.T.reshape(force.shape)

    def _convolve(self, u: jax.Array) -> jax.Array:
        """The off-diagonal blocks of all offsets times u [..., d, *shape]."""
        y = convolve(self.symbol, self.lengths, u)
        return y[(..., *(slice(0, n) for n in self.lattice.family.shape))]

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m)."""
        own = jnp.asarray(self.own).reshape(len(self.own), -1)
        return full_blocks(own.T, self.lattice.d)

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of K."""
        return self.lattice.coo()

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix on the host."""
        return self.lattice.to_bsr()


def blocks_times(blocks: Any, u: Any, d: int) -> Any:
    """Symmetric blocks by their upper triangles [q, ...] times u [d, ...]."""
    at = {ab: q for q, ab in enumerate(index_pairs(d))}
    total, xp = 0.0, namespace(u)
    for s in range(d):
        pairs = [(a, (a - s) % d) for a in range(d)]
        entry = [at[min(ab), max(ab)] for ab in pairs]
        total = total + blocks[np.asarray(entry)] * (xp.roll(u, s, axis=0) if s else u)
    return total


def convolution(
    lattice: LatticeTangent,
    at: tuple[float, ...] = (),
    boxes: tuple[Box, ...] = (),
) -> FFTTangent:
    """Make a lattice's stiffness ready for transforms.

    In NumPy if its arrays are NumPy's, on the host and without any compilation; in the
    trace otherwise.

    Args:
        lattice: the stiffness.
        at: pivots of the volume correction, from `pivots`; without any it is replaced
            by the nearest product, (v_i v_j)^-1/2, which is good for preconditioning.
        boxes: disjoint boxes that cover the rim, from `jaxpd.operators.patches`, where
            the first pivot is the bulk's v; without any, all terms are for all points.
    """
    family, parts = lattice.family, lattice.parts
    d, shape = lattice.d, family.shape
    xp = namespace(parts, lattice.v, lattice.c, family.cut)
    lengths = padded(tuple((0, n) for n in shape), family)
    entries = spectrum(family, parts, lengths)
    axes = tuple(range(1, d + 1))
    symbol = entries[_order(d)]
    patches: list[Patches] = []
    left = right = None
    if lattice.v is None and lattice.c is None:
        own = xp.moveaxis(offset_sums(family, parts), -1, 0)
    else:
        left, right = _terms(lattice, at, xp)
        some: list[Any] = []
        if boxes and len(at) > 1:
            first = np.arange(len(left)) % len(at) == 0
            some = stacked(family, boxes, left[~first], right[~first])
            left, right = left[first], right[first]
        back = tuple(slice(0, n) for n in shape)

        def share(entries, f, g):
            spread = xp.fft.rfftn(g, lengths, axes=tuple(range(d)))
            sums = xp.fft.irfftn(entries * spread[None], lengths, axes=axes)
            return f[None] * sums[(slice(None), *back)]

        # backwards, the transforms of a term are computed again and not kept
        share = share if xp is np else jax.checkpoint(share)
        own: Any = 0.0
        for f, g in zip(left, right, strict=True):
            own = own + share(entries, f, g)
        for size, pairs, out, near in some:
            table = spectrum(family, parts, size)
            patch = Patches(table[_order(d)], out, near, pairs, size)
            patches.append(patch)
            own = patch.sums(table, own)
    i, j = family.cut_ends()
    lost = parts[family.cut[1]].T
    if left is not None:
        lost = lost * lattice.factor(i, j)[None]
    if left is not None and family.cut.shape[1]:
        gone = [add_at(xp, (family.n, len(lost)), e, lost.T) for e in (i, j)]
        own = own - xp.moveaxis(gone[0] + gone[1], 1, 0).reshape(own.shape)
    rows, cols = xp.concatenate([i, j]), xp.concatenate([j, i])
    order = xp.argsort(rows, stable=True)
    lost = xp.concatenate([lost, lost], axis=1)[:, order]
    rows, cols = rows[order], cols[order]
    return FFTTangent(
        lattice, symbol, left, right, own, lost, rows, cols, lengths, tuple(patches)
    )


def _order(d: int) -> Any:
    """Places [d, d] of entries (a, a - s), row s, among the upper triangle's."""
    slot = {ab: q for q, ab in enumerate(index_pairs(d))}
    return np.array(
        [
            [slot[min(a, (a - s) % d), max(a, (a - s) % d)] for a in range(d)]
            for s in range(d)
        ]
    )


def _terms(lattice: LatticeTangent, at: tuple[float, ...], xp: Any) -> tuple[Any, Any]:
    """Left and right fields [T, *shape] of the factor of a bond."""
    shape = lattice.family.shape
    f = xp.ones((1, lattice.family.n), lattice.parts.dtype)
    if lattice.v is not None:
        f = separated(lattice.v, at) if at else (lattice.v**-0.5)[None]
    if lattice.c is None:
        f = f.reshape(-1, *shape)
        return f, f
    half, whole = 0.5 * lattice.c[None] * f, f
    left = xp.concatenate([half, whole]).reshape(-1, *shape)
    right = xp.concatenate([whole, half]).reshape(-1, *shape)
    return left, right
