"""Galerkin coarsening of a lattice's stiffness. Host only, NumPy and SciPy.

Coarse points are some of the fine ones, interpolation is linear along each axis, and
the coarse stiffness is P^T K P. It is made of three parts:

- the uniform lattice: P is a product over the axes, hence so are the sums over points
  of every offset; they cost next to nothing;
- the irregular bonds: those that are missing, and those of points that interpolate in
  another way. A point takes no value from a coarse point to which it has no live bond
  (across a crack), and none where it is held itself;
- the nodal fields (volume correction, relative modulus): averaged over the hat functions
  they scale the coupling of two coarse points. The block diagonal is minus the sum of
  the couplings, so that a translation costs no energy.

Coarse couplings keep the symmetry of the bond blocks: P is the same for all components.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.geometry.grid_family import GridFamily, inside
from jaxpd.operators.lattice import LatticeTangent

Sparse = Any


@dataclass(frozen=True)
class Transfer:
    """Interpolation from a coarse grid to a fine one.

    Attributes:
        hats: linear interpolation along each axis [n_a, c_a].
        nodes: fine index of the coarse points along each axis.
        matrix: interpolation with its exceptions [n, c] CSR.
        change: its difference from the product of the hats [n, c] COO.
    """

    hats: list[NDArray[np.floating]]
    nodes: list[NDArray[np.integer]]
    matrix: Sparse
    change: Sparse

    @property
    def shape(self) -> tuple[int, ...]:
        """Coarse points along each axis."""
        return tuple(len(nodes) for nodes in self.nodes)


def axis_nodes(held: NDArray[np.bool_], ratio: int) -> list[NDArray[np.integer]]:
    """Coarse points along each axis: evenly spread over the part that is not held.

    Args:
        held: mask [*shape] of points whose components are all prescribed.
        ratio: fine spacings in a coarse one.
    """
    found = []
    for a in range(held.ndim):
        n = held.shape[a]
        free = np.flatnonzero(
            ~held.all(axis=tuple(b for b in range(held.ndim) if b != a))
        )
        first, last = max(0, free[0] - 1), min(n - 1, free[-1] + 1)
        pieces = max(1, -(-(last - first) // ratio))
        nodes = np.rint(np.linspace(first, last, pieces + 1)).astype(int)
        found.append(np.unique(nodes))
    return found


def hat(n: int, nodes: NDArray[np.integer]) -> NDArray[np.floating]:
    """Linear interpolation [n, c] from coarse points; constant beyond the outermost."""
    x = np.arange(n)
    return np.stack([np.interp(x, nodes, row) for row in np.eye(len(nodes))], axis=1)


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
        I, J = np.nonzero(there.any(axis=0) | here.any(axis=0))
        w = int(np.abs(J - I).max())
        bands = np.zeros((2, 2 * r + 1, c, 2 * w + 1))
        bands[0][:, I, J - I + w], bands[1][:, I, J - I + w] = (
            here[:, I, J],
            there[:, I, J],
        )
        width.append(w)
        # the front axis of offsets is summed; (coarse, width) come behind
        own = np.tensordot(own, bands[0], axes=(0, 0))
        far = np.tensordot(far, bands[1], axes=(0, 0))
    A = own - far  # [q, c_1, w_1, c_2, w_2, ..]
    shape = tuple(P.shape[1] for P in hats)
    index = np.arange(int(np.prod(shape))).reshape(shape)
    step = np.stack(
        [
            g.ravel()
            for g in np.meshgrid(*[np.arange(-w, w + 1) for w in width], indexing="ij")
        ],
        1,
    )
    A = np.moveaxis(A, [1 + 2 * a for a in range(d)], range(1, d + 1))
    A = A.reshape(len(A), *shape, -1)
    rows, cols, values = [], [], []
    for s, e in enumerate(step):
        at = tuple(
            slice(max(0, -k), max(0, min(n, n - k)))
            for k, n in zip(e, shape, strict=True)
        )
        to = tuple(
            slice(max(0, k), max(0, min(n, n + k)))
            for k, n in zip(e, shape, strict=True)
        )
        rows.append(index[at].ravel())
        cols.append(index[to].ravel())
        values.append(A[(slice(None), *at, s)].reshape(len(A), -1))
    row, col, value = (
        np.concatenate(rows),
        np.concatenate(cols),
        np.concatenate(values, axis=1),
    )
    c = index.size
    return [sp.csr_array((v, (row, col)), shape=(c, c)) for v in value]


def interpolation(
    shape: tuple[int, ...],
    nodes: list[NDArray[np.integer]],
    held: NDArray[np.bool_],
    torn: NDArray[np.int64],
) -> Transfer:
    """Interpolation that crosses no crack and leaves held points alone.

    Args:
        shape: fine points along each axis.
        nodes: coarse points along each axis.
        held: mask [n] of fine points whose components are all prescribed.
        torn: pairs of fine points without a live bond, sorted keys i n + j.
    """
    hats = [hat(n, at) for n, at in zip(shape, nodes, strict=True)]
    P = sp.csr_array([[1.0]])
    for h in hats:
        P = sp.csr_array(sp.kron(P, sp.csr_array(h)))
    coarse = np.ravel_multi_index(np.meshgrid(*nodes, indexing="ij"), shape).ravel()
    new = P.copy()
    if len(torn):
        row = np.repeat(np.arange(P.shape[0]), np.diff(P.indptr))
        data = np.where(apart(torn, len(held), row, coarse[P.indices]), 0.0, P.data)
        left = np.bincount(row, data, P.shape[0])
        # a point torn from all of them keeps them: it has to hang on something
        some = left[row] > 1e-12
        new.data = np.where(some, data / np.where(some, left[row], 1.0), P.data)
    loose = P @ (~held[coarse]).astype(float) > 1e-12
    ground = held & loose  # held, but a hat of a free coarse point covers it
    new = sp.csr_array(sp.diags_array((~ground).astype(float)) @ new)
    new.eliminate_zeros()
    change = sp.coo_array(new - P)
    return Transfer(hats, nodes, new, change)


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
        new = live.T @ sp.csr_array(sp.diags_array(parts[q, p]) @ live) if len(a) else 0
        old = (
            before.T @ sp.csr_array(sp.diags_array(parts[q, p]) @ before)
            if len(a)
            else 0
        )
        cut = lost.T @ sp.csr_array(sp.diags_array(parts[s, p]) @ lost) if len(i) else 0
        found.append(new - old - cut)
    return found


def scaled(
    matrices: list[Sparse], g: NDArray | None, c: NDArray | None
) -> list[Sparse]:
    """Couplings times g_I g_J (c_I + c_J) / 2, with the ground's share of the diagonal."""
    if g is None and c is None:
        return matrices
    found = []
    for A in matrices:
        coo = sp.coo_array(A)
        I, J = coo.coords
        f = 1.0
        if g is not None:
            f = f * g[I] * g[J]
        if c is not None:
            f = f * 0.5 * (c[I] + c[J])
        off = I != J
        n = A.shape[0]
        ground = np.asarray(A.sum(axis=1)).ravel()
        own = (1.0 if g is None else g**2) * (1.0 if c is None else c)
        B = sp.csr_array((np.where(off, coo.data * f, 0.0), (I, J)), shape=(n, n))
        diagonal = ground * own - np.asarray(B.sum(axis=1)).ravel()
        found.append(sp.csr_array(B + sp.diags_array(diagonal)))
    return found


def cut_keys(family: GridFamily) -> NDArray[np.int64]:
    """Pairs of points (i, j), both ways, whose bond is missing: sorted i n + j."""
    i, j = (np.asarray(a, np.int64) for a in family.cut_ends())
    return np.sort(np.append(i * family.n + j, j * family.n + i))


def apart(
    keys: NDArray[np.int64], n: int, i: NDArray[np.integer], j: NDArray[np.integer]
) -> NDArray[np.bool_]:
    """Mask of the pairs (i, j) that are among the sorted keys i n + j."""
    if not len(keys):
        return np.zeros(np.shape(i), bool)
    key = np.asarray(i, np.int64) * n + j
    at = np.minimum(np.searchsorted(keys, key), len(keys) - 1)
    return keys[at] == key


def torn_pairs(
    keys: NDArray[np.int64],
    shape: tuple[int, ...],
    nodes: list[NDArray[np.integer]],
    reach: int,
) -> NDArray[np.int64]:
    """Adjacent coarse points that are torn from each other, as keys of the coarse grid.

    They are if a step is torn on the straight way from one to the other, in steps of at
    most `reach` fine spacings along each axis.

    Args:
        keys: pairs of fine points that are torn from each other, sorted.
        shape: fine points along each axis.
        nodes: coarse points along each axis.
        reach: how far apart along each axis fine points may be to be known by `keys`.
    """
    if not len(keys):
        return keys
    n, d = int(np.prod(shape)), len(shape)
    coarse = tuple(len(at) for at in nodes)
    place = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1)
    index = np.arange(int(np.prod(coarse)), dtype=np.int64).reshape(coarse)
    found = []
    for e in np.ndindex(*[3] * d):
        step = [k - 1 for k in e]
        if not any(step):
            continue
        here = inside(coarse, step)
        there = inside(coarse, [-k for k in step])
        a, b = place[here].reshape(-1, d), place[there].reshape(-1, d)
        if not len(a):
            continue
        count = max(1, -(-int(np.abs(b - a).max()) // reach))
        torn = np.zeros(len(a), bool)
        way = [np.rint(a + (b - a) * (t / count)).astype(int) for t in range(count + 1)]
        for p, q in zip(way[:-1], way[1:], strict=True):
            i, j = (np.ravel_multi_index(tuple(x.T), shape) for x in (p, q))
            torn |= apart(keys, n, i, j)
        found.append(
            index[here].ravel()[torn] * index.size + index[there].ravel()[torn]
        )
    return np.sort(np.concatenate(found))
