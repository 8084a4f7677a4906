"""Interpolation between the grids of multigrid. Host only, NumPy and SciPy.

Coarse points are some of the fine ones, and interpolation is linear along each axis.
But a point takes no value from a coarse point to which it has no live bond, across a
crack, and none where it is held itself.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.geometry.grid_family import GridFamily, inside

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
    P: Sparse = sp.csr_array([[1.0]])
    for h in hats:
        P = sp.csr_array(sp.kron(P, sp.csr_array(h)))
    coarse = np.ravel_multi_index(np.meshgrid(*nodes, indexing="ij"), shape).ravel()
    new: Sparse = P.copy()
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


def cut_keys(family: GridFamily) -> NDArray[np.int64]:
    """Pairs of points (i, j), both ways, whose bond is missing: sorted i n + j."""
    i, j = (np.asarray(a, np.int64) for a in family.cut_ends())
    return np.sort(np.append(i * family.n + j, j * family.n + i))


def apart(keys: NDArray[np.int64], n: int, i: Any, j: Any) -> NDArray[np.bool_]:
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
        for p, q in itertools.pairwise(way):
            i, j = (np.ravel_multi_index(tuple(x.T), shape) for x in (p, q))
            torn |= apart(keys, n, i, j)
        found.append(
            index[here].ravel()[torn] * index.size + index[there].ravel()[torn]
        )
    return np.sort(np.concatenate(found))
