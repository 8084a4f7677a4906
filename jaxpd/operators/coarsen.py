"""Galerkin coarsening of a lattice's stiffness. Host only, NumPy and SciPy.

The coarse stiffness is P^T K P, made of three parts:

- the uniform lattice: P is a product over the axes, hence so are the sums over points
  of every offset; they cost next to nothing;
- the irregular bonds: those that are missing, and those of points whose interpolation
  is an exception (`jaxpd.operators.transfer`);
- the nodal fields (volume correction, relative modulus): averaged over the hats they
  scale the coupling of two coarse points. The block diagonal is minus the sum of
  the couplings, so that a translation costs no energy.

Coarse couplings keep the symmetry of the bond blocks: P is the same for all components.
Without fields the result is P^T K P to round-off.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.geometry.grid_family import GridFamily
from jaxpd.operators.lattice import LatticeTangent
from jaxpd.operators.transfer import Transfer

Sparse = Any


def uniform(
    family: GridFamily, parts: NDArray[np.floating], hats: list[NDArray[np.floating]]
) -> list[Sparse]:
    """P^T K P of a lattice without missing bonds and fields, by products over the axes.

    K is the sum over all offsets o, both directions, of B_o (e_i e_i^T - e_i e_j^T)
    with i and j = i + o on the lattice.

    Returns:
        One CSR matrix [c, c] for every entry of the upper triangle of the blocks.
    """
    reach, d = family.reach, len(family.shape)
    size = tuple(2 * reach + 1)
    table = np.zeros((*size, parts.shape[1]))
    for sign in (1, -1):
        np.add.at(table, tuple((sign * family.steps + reach).T), parts)
    own, far, width = table, table, []
    for P, r in zip(hats, reach, strict=True):
        n, c = P.shape
        here, there = np.zeros((2, 2 * r + 1, c, c))
        for o in range(-min(r, n - 1), min(r, n - 1) + 1):
            i = slice(max(0, -o), min(n, n - o))
            j = slice(max(0, o), min(n, n + o))
            here[o + r] = P[i].T @ P[i]
            there[o + r] = P[i].T @ P[j]
        row, col = np.nonzero(there.any(axis=0) | here.any(axis=0))
        w = int(np.abs(col - row).max())
        bands = np.zeros((2, 2 * r + 1, c, 2 * w + 1))
        bands[0][:, row, col - row + w] = here[:, row, col]
        bands[1][:, row, col - row + w] = there[:, row, col]
        width.append(w)
        # the front axis of offsets is summed; (coarse, width) come behind
        own = np.tensordot(own, bands[0], axes=(0, 0))
        far = np.tensordot(far, bands[1], axes=(0, 0))
    A = own - far  # [q, c_1, w_1, c_2, w_2, ..]
    shape = tuple(P.shape[1] for P in hats)
    A = np.moveaxis(A, [1 + 2 * a for a in range(d)], range(1, d + 1))
    # one pattern for all components, its columns ascending as they come
    wide = np.indices([2 * w + 1 for w in width]).reshape(d, -1).T - width
    place = np.indices(shape).reshape(d, -1).T
    to = place[:, None, :] + wide[None]
    on = ((to >= 0) & (to < shape)).all(axis=2)
    c = len(place)
    stride = np.cumprod((1, *shape[:0:-1]))[::-1]
    cols = (np.arange(c)[:, None] + (wide @ stride)[None])[on].astype(np.int32)
    rows = np.append(0, np.cumsum(on.sum(axis=1))).astype(np.int32)
    A = A.reshape(len(A), c, -1)
    return [sp.csr_array((x[on], cols, rows), shape=(c, c)) for x in A]


def irregular(lattice: LatticeTangent, move: Transfer) -> list[Sparse]:
    """P^T K P less that of the uniform lattice, on the finest level."""
    family, parts = lattice.family, np.asarray(lattice.parts)
    n, k = family.n, len(family.offsets)
    changed = np.zeros(n, bool)
    changed[move.change.coords[0]] = True
    i, s = (np.asarray(a) for a in family.cut)
    _, j = family.cut_ends()
    hop = family.steps @ family.strides
    at = np.stack(np.unravel_index(np.flatnonzero(changed), family.shape), axis=1)
    node = np.flatnonzero(changed)
    first, slot = [], []
    for q, step in enumerate(family.offsets):
        for sign in (1, -1):
            to = at + sign * np.asarray(step)
            ok = ((to >= 0) & (to < family.shape)).all(axis=1)
            first.append(node[ok] - (hop[q] if sign < 0 else 0))
            slot.append(np.full(ok.sum(), q))
    key = (
        np.unique(np.concatenate(first) * k + np.concatenate(slot))
        if len(node)
        else np.zeros(0, int)
    )
    gone = i.astype(np.int64) * k + s
    key = key[~np.isin(key, gone)]
    a, q = key // k, key % k
    P0 = sp.csr_array(move.matrix - sp.csr_array(move.change))
    live = sp.csr_array(move.matrix[a] - move.matrix[a + hop[q]])
    before = sp.csr_array(P0[a] - P0[a + hop[q]])
    lost = sp.csr_array(P0[i] - P0[j])
    found = []
    for p in range(parts.shape[1]):
        # a lattice without cracks has nothing irregular, and no rows here
        mine, theirs = sp.diags_array(parts[q, p]), sp.diags_array(parts[s, p])
        new = live.T @ sp.csr_array(mine @ live)
        old = before.T @ sp.csr_array(mine @ before)
        cut = lost.T @ sp.csr_array(theirs @ lost)
        found.append(sp.csr_array(new - old - cut))
    return found


def carried(smooth: list[Sparse], rough: list[Sparse], move: Transfer) -> list[Sparse]:
    """The irregular part of the next level: P^T (K + L) P less what K has by its hats.

    Args:
        smooth: K, of the uniform lattice on this level.
        rough: L, the irregular part on this level.
        move: P.
    """
    P = move.matrix
    change = sp.csr_array(move.change)
    hats = sp.csr_array(P - change)
    rows = np.flatnonzero(np.diff(change.indptr))
    some = sp.csr_array(change[rows].T)
    found = []
    for K, L in zip(smooth, rough, strict=True):
        pulled = some @ sp.csr_array(K[rows])
        cross = pulled @ hats
        found.append(P.T @ L @ P + cross + cross.T + pulled @ change)
    return found


def scaled(
    matrices: list[Sparse], g: NDArray | None, c: NDArray | None
) -> list[Sparse]:
    """Couplings times g_I g_J (c_I + c_J) / 2, and the diagonal that goes with them."""
    if g is None and c is None:
        return matrices
    found = []
    for A in matrices:
        coo = sp.coo_array(A)
        row, col = coo.coords
        f = 1.0
        if g is not None:
            f = f * g[row] * g[col]
        if c is not None:
            f = f * 0.5 * (c[row] + c[col])
        off = row != col
        n = A.shape[0]
        ground = np.asarray(A.sum(axis=1)).ravel()
        own = (1.0 if g is None else g**2) * (1.0 if c is None else c)
        B = sp.csr_array((np.where(off, coo.data * f, 0.0), (row, col)), shape=(n, n))
        diagonal = ground * own - np.asarray(B.sum(axis=1)).ravel()
        found.append(sp.csr_array(B + sp.diags_array(diagonal)))
    return found
