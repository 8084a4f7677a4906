"""Algebraic multigrid through pyamg, for the dense stencils of nonlocal mechanics.

The stiffness of a long horizon defeats the usual measures of strength: every unknown is
coupled to hundreds, all alike. Here aggregates follow a graph of *near* live bonds
(about 1.5 spacings), carried down the levels as the aggregates' own graph; the finest
prolongator is smoothed with a Laplacian on that graph and not with the dense matrix;
coarse operators are Galerkin products with the true one. Rigid-body modes are the
near-nullspace. No lattice is assumed: matrix, positions and masks are all that is read.

The hierarchy is built once, on the host, and kept over Newton steps and parameters: it
preconditions, so an old one costs iterations and never accuracy.

This is the only module that imports pyamg.
"""

from __future__ import annotations

import collections
import itertools
import time
import weakref
from typing import Any

import jax
import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from jax.core import Tracer
from numpy.typing import NDArray
from pyamg.aggregation import fit_candidates, standard_aggregation
from pyamg.multilevel import MultilevelSolver
from pyamg.relaxation.smoothing import change_smoothers
from pyamg.util.linalg import approximate_spectral_radius
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree

from jaxpd.geometry.connectivity import rigid_modes

#: A SciPy sparse array, and what pyamg makes of one: neither is typed.
Sparse = Any
#: Bonds up to this many times the distance to the d-th nearest point are near.
NEAR = 1.5
#: Unknowns below which a level is solved by dense Cholesky.
MAX_COARSE = 400
#: Damping of the prolongator smoother, over the spectral radius.
DAMPING = 4.0 / 3.0
#: Aggregation that leaves more than this share of the points is helped along.
POOR_COARSENING = 0.3


class Hierarchy:
    """A multigrid hierarchy behind one symmetric W-cycle.

    A pytree whose one leaf is a number that the host knows it by: a new hierarchy is
    not compiled anew. The last two are kept; older ones as long as somebody holds them.

    Attributes:
        levels: number of levels.
        sizes: unknowns of each level.
        complexity: non-zeros of all levels over those of the finest (-).
        seconds: wall time of the set-up.
    """

    def __init__(self, multilevel: Any, dofs: NDArray[np.integer], seconds: float):
        self._multilevel, self._dofs = multilevel, dofs
        self.levels = len(multilevel.levels)
        self.sizes = [level.A.shape[0] for level in multilevel.levels]
        self.complexity = float(multilevel.operator_complexity())
        self.seconds = seconds
        self.number: Any = np.int32(next(_NUMBERS))
        _LIVE[int(self.number)] = self
        _RECENT.append(self)
        self._cycle = multilevel.aspreconditioner(cycle="W")

    def apply(self, r: NDArray[np.floating]) -> NDArray[np.floating]:
        """One W-cycle on a residual [n, d], on the host; zero on prescribed entries.

        NaN for a residual that is not finite: pyamg would raise.
        """
        if not np.isfinite(r).all():
            return np.full_like(r, np.nan)
        z = np.zeros(r.size, r.dtype)
        z[self._dofs] = self._cycle @ np.ascontiguousarray(np.ravel(r)[self._dofs])
        return z.reshape(r.shape)

    def cycle(self, r: jax.Array) -> jax.Array:
        """One W-cycle on a residual [n, d], inside a trace."""

        def on_host(number, r):
            return _LIVE[int(number)].apply(np.asarray(r))

        out = jax.ShapeDtypeStruct(r.shape, r.dtype)
        return jax.pure_callback(on_host, out, self.number, r, vmap_method="sequential")


#: Hierarchies by number, as long as somebody holds them.
_LIVE: weakref.WeakValueDictionary[int, Hierarchy] = weakref.WeakValueDictionary()
_NUMBERS = itertools.count()
#: A solve may still be running when its caller has let go of the solver.
_RECENT: collections.deque[Hierarchy] = collections.deque(maxlen=2)


def _unflatten(_: None, leaves: Any) -> Hierarchy:
    number = leaves[0]
    held = isinstance(number, np.generic | np.ndarray | jax.Array)
    if held and not isinstance(number, Tracer):
        return _LIVE[int(number)]
    traced = object.__new__(Hierarchy)  # knows its number, and so `cycle`, alone
    traced.number = number
    return traced


jax.tree_util.register_pytree_node(
    Hierarchy, lambda hierarchy: ((hierarchy.number,), None), _unflatten
)


def build_hierarchy(
    matrix: sp.bsr_matrix, X: NDArray[np.floating], fixed: NDArray[np.bool_]
) -> Hierarchy:
    """Set a hierarchy up for the free part of a stiffness matrix. Host only.

    Args:
        matrix: stiffness [n d, n d] in d x d blocks, symmetric.
        X: positions of its points [n, d] (m).
        fixed: mask of prescribed entries [n, d].
    """
    start = time.perf_counter()
    d = X.shape[1]
    kept = np.flatnonzero(~fixed.all(axis=1))
    dofs = (kept[:, None] * d + np.arange(d)).ravel()
    free = ~fixed[kept]
    A = sp.csr_array(sp.csr_array(matrix)[dofs][:, dofs])
    if not free.all():  # partly held points: units on their held entries
        live = free.ravel().astype(float)
        scale = A.diagonal().max()
        A = sp.csr_array(
            sp.diags_array(live) @ A @ sp.diags_array(live)
            + sp.diags_array((1.0 - live) * scale)
        )
    multilevel = _multilevel(A, X[kept], free)
    return Hierarchy(multilevel, dofs, time.perf_counter() - start)


def _near_graph(
    A: Sparse, X: NDArray[np.floating]
) -> tuple[NDArray[np.integer], NDArray[np.integer], NDArray[np.floating]]:
    """Live near bonds (i, j, length), both directions, sorted.

    Candidates are the 3^d - 1 nearest points; a point left without any takes its one
    shortest live bond.
    """
    n, d = X.shape
    k = min(3**d, n)
    r, j = (np.reshape(a, (n, k)) for a in KDTree(X).query(X, k=k))
    i = np.repeat(np.arange(n), k).reshape(n, k)
    reach = NEAR * (1 + 1e-9) * r[:, min(d, k - 1)]
    near = (r <= reach[:, None]) & (j != i)
    i, j = i[near], j[near]
    position = sp.csr_array(
        (np.arange(1, A.indices.size + 1), A.indices, A.indptr), shape=(n, n)
    )
    stored = np.asarray(position[i, j]).ravel()
    live = (stored > 0) & np.abs(A.data[stored - 1]).any(axis=(1, 2))
    i, j = i[live], j[live]
    lonely = np.flatnonzero(np.bincount(np.append(i, j), minlength=n) == 0)
    for a in lonely:
        row = slice(A.indptr[a], A.indptr[a + 1])
        c = A.indices[row][np.abs(A.data[row]).any(axis=(1, 2))]
        c = c[c != a]
        if c.size:
            nearest = c[np.argmin(((X[c] - X[a]) ** 2).sum(axis=1))]
            i, j = np.append(i, a), np.append(j, nearest)
    i, j = i.astype(np.int64), j.astype(np.int64)
    key = np.unique(np.append(i * n + j, j * n + i))
    i, j = key // n, key % n
    return i, j, np.sqrt(((X[i] - X[j]) ** 2).sum(axis=1))


def _near_laplacian(
    A: Sparse,
    i: NDArray[np.integer],
    j: NDArray[np.integer],
    r: NDArray[np.floating],
    free: NDArray[np.bool_],
) -> Sparse:
    """D^-1 S with S a scalar Laplacian of the near bonds per component (weights r^-2).

    Its diagonal grows by the share of the stiffness that goes to prescribed entries,
    without which a prolongator ignores the supports.
    """
    n, d = free.shape
    w = (free[i] & free[j]) / (r**2)[:, None]
    degree = np.stack([np.bincount(i, w[:, a], n) for a in range(d)], axis=1).ravel()
    diagonal = A.diagonal()
    row_sum = np.empty((n, d))
    for a in range(d):
        ones = np.zeros((n, d))
        ones[:, a] = free[:, a]
        row_sum[:, a] = (A @ ones.ravel()).reshape(n, d)[:, a]
    share = row_sum.ravel() / np.where(diagonal > 0, diagonal, 1.0)
    full = degree * (1.0 + np.clip(share, 0.0, 1.0) * free.ravel())
    a = np.arange(d)
    rows, cols = (i[:, None] * d + a).ravel(), (j[:, None] * d + a).ravel()
    S = sp.csr_array(sp.coo_array((-w.ravel(), (rows, cols)), shape=A.shape))
    inverse = np.where(full > 0, 1.0 / np.where(full > 0, full, 1.0), 0.0)
    return sp.csr_array(sp.diags_array(inverse) @ (S + sp.diags_array(full)))


def _aggregate(C: Sparse, A: Sparse, block: int, finest: bool) -> Sparse:
    """Aggregates [points, groups] of the graph C.

    On the finest level a lone point is left to the smoother; below it is a group that
    must be carried on.
    """

    def group(graph: Sparse) -> Sparse:
        found: Sparse = sp.csr_array(standard_aggregation(graph)[0])
        alone = np.flatnonzero((np.diff(found.indptr) == 0) & (not finest))
        one = sp.csr_array(
            (np.ones(alone.size), (alone, np.arange(alone.size))),
            shape=(found.shape[0], alone.size),
        )
        return sp.csr_array(sp.hstack([found, one])) if alone.size else found

    groups: Sparse = group(C)
    if not finest and groups.shape[1] > POOR_COARSENING * groups.shape[0]:
        # torn regions: add the strongest coupling of each point
        blocks: Any = sp.bsr_array(A, blocksize=(block, block))
        size = np.abs(blocks.data).max(axis=(1, 2))
        n = C.shape[0]
        at = np.repeat(np.arange(n), np.diff(blocks.indptr))
        size = np.where(at == blocks.indices, 0.0, size)
        order = np.lexsort((-size, at))
        first = np.unique(at[order], return_index=True)[1]
        best = order[first]
        best = best[size[best] > 0]
        link = sp.csr_array(
            (np.ones(best.size), (at[best], blocks.indices[best])), shape=(n, n)
        )
        helped = sp.csr_array(C + link + link.T)
        helped.data[:] = 1.0
        groups = group(helped)
    return groups


def _coarse_solver(A: Sparse) -> Any:
    if A.shape[0] > 5 * MAX_COARSE:  # only where coarsening stalled
        factor = splu(sp.csc_array(A))
        return lambda _, b: factor.solve(np.ravel(b))
    dense = A.toarray()
    try:
        cholesky = la.cho_factor(dense)
    except la.LinAlgError:  # a floating piece: leave its rigid modes alone
        inverse = la.pinvh(dense)
        return lambda _, b: inverse @ np.ravel(b)
    return lambda _, b: la.cho_solve(cholesky, np.ravel(b))


def _multilevel(
    A: Sparse, X: NDArray[np.floating], free: NDArray[np.bool_]
) -> MultilevelSolver:
    n, d = X.shape
    blocks: Any = sp.bsr_array(A, blocksize=(d, d))
    blocks.sort_indices()
    i, j, r = _near_graph(blocks, X)
    C: Sparse = sp.csr_array((np.ones(i.size), (i, j)), shape=(n, n))
    B = rigid_modes(X) * free.ravel()[:, None]
    S: Sparse = _near_laplacian(A, i, j, r, free)
    size, levels = d, []
    while True:
        level: Any = MultilevelSolver.Level()
        level.A = A
        levels.append(level)
        if A.shape[0] <= MAX_COARSE:
            break
        C = sp.csr_array(C + sp.eye_array(C.shape[0]))
        C.data[:] = 1.0
        groups: Sparse = _aggregate(C, A, size, finest=len(levels) == 1)
        if groups.shape[1] == 0 or groups.shape[1] > 0.7 * groups.shape[0]:
            break
        T, B = fit_candidates(groups.astype(np.int8), B)
        start = np.random.default_rng(0).normal(size=(A.shape[0], 1))
        rho: Any = approximate_spectral_radius(S, maxiter=10, initial_guess=start)
        smoother: Sparse = sp.bsr_array(S, blocksize=(size, size))
        P = sp.bsr_array(T - (DAMPING / rho) * (smoother @ T), blocksize=T.blocksize)
        size = T.blocksize[1]
        R = sp.bsr_array(P.T, blocksize=T.blocksize[::-1])
        blocks = sp.bsr_array(R @ (blocks @ P), blocksize=(size, size))
        level.P, level.R = sp.csr_array(P), sp.csr_array(R)
        A = sp.csr_array(blocks)
        diagonal = A.diagonal()
        dead = diagonal <= 1e-13 * diagonal.max()
        if dead.any():  # rigid modes that a small aggregate cannot carry
            A = sp.csr_array(A + sp.diags_array(dead * diagonal.max()))
            blocks = sp.bsr_array(A, blocksize=(size, size))
            diagonal = A.diagonal()
        C = sp.csr_array(groups.T @ C @ groups)
        S = sp.csr_array(sp.diags_array(1.0 / diagonal) @ A)
    multilevel = MultilevelSolver(levels, coarse_solver=_coarse_solver(levels[-1].A))
    change_smoothers(
        multilevel,
        ("gauss_seidel", {"sweep": "forward"}),
        ("gauss_seidel", {"sweep": "backward"}),
    )
    return multilevel
