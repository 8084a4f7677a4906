"""Peers in NumPy, SciPy and pyamg: the assembled matrix and solvers that know it alone.

The matrix is assembled in sorted order by passes over a few thousand rows at a time,
as fast as NumPy allows, for its time counts against the peer. The stiffness of every
offset, the relative volumes and the list of cut bonds come from the prepared problem;
no operator and no solver of jaxpd is used.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pyamg
import scipy.sparse as sp
from numpy.typing import NDArray
from pyamg.relaxation.smoothing import change_smoothers
from scipy.sparse.linalg import LinearOperator, cg

from jaxpd import Problem

#: Points of one pass of the assembly.
CHUNK = 1024

Vector = NDArray[np.floating]


@dataclass(frozen=True)
class System:
    """The constrained linear system of a lattice problem.

    Attributes:
        matrix: CSR or BSR on the free points.
        b: right-hand side of the free points, flat (N).
        points: numbers of the free points.
        X: their positions [f, d] (m).
    """

    matrix: Any
    b: Vector
    points: NDArray[np.integer]
    X: Vector

    def pick(self, u: Any) -> Vector:
        """The free entries of nodal values [n, d], flat."""
        return np.asarray(u)[self.points].ravel()

    def residual(self, x: Vector) -> float:
        """True relative residual of a flat solution."""
        return float(np.linalg.norm(self.b - self.matrix @ x) / np.linalg.norm(self.b))


def matrix_bytes(problem: Problem, kind: str = "csr") -> int:
    """Bytes that the whole matrix of a problem takes, about."""
    family, d = problem.family, problem.X.shape[1]
    blocks = 2 * family.n_bonds + len(problem.X)
    return int(blocks * (8 * d * d + (4 * d * d if kind == "csr" else 4)))


def assemble(problem: Problem, kind: str = "csr", constrained: bool = True) -> System:
    """Assemble a lattice problem with small displacements.

    Args:
        problem: prepared on a lattice without index lists.
        kind: "csr" or "bsr".
        constrained: leave the prescribed points out, else all are in and b is the load.

    Raises:
        ValueError: if a point is prescribed in some components only.
    """
    rest, params = problem.rest(), problem.params
    family, d = rest.family, rest.d
    n, shape = family.n, family.shape
    mask = np.asarray(problem.fixed) & constrained
    held: NDArray[np.bool_] = np.asarray(mask.all(axis=1))
    if (mask.any(axis=1) != held).any():
        raise ValueError("problem: its points must be held in all components or none")
    given = np.where(mask, np.asarray(params["prescribed"]), 0.0)
    load = np.asarray(params["load"], float)

    # all steps in the order of their columns: behind, own, ahead
    later = family.steps
    steps = np.concatenate([-later[::-1], np.zeros((1, d), int), later])
    k, own = len(later), len(later)
    hop = (steps @ family.strides).astype(np.int32)
    at = np.empty((d, d), int)
    at[np.triu_indices(d)] = np.arange(d * (d + 1) // 2)
    at = np.where(np.tri(d, k=-1, dtype=bool), at.T, at)
    one = np.asarray(rest.parts)[:, at]
    blocks = np.concatenate([one[::-1], np.zeros((1, d, d)), one])  # [2k + 1, d, d]
    stays = [
        ((to := np.arange(s)[:, None] + steps[:, a]) >= 0) & (to < s)
        for a, s in enumerate(shape)
    ]
    v = None if rest.v is None else np.asarray(rest.v)
    c = None if rest.c is None else np.asarray(rest.c)
    cut_i, cut_slot = np.asarray(family.cut)
    cut_j = cut_i + hop[own + 1 + cut_slot]
    cut_at = np.concatenate([cut_i, cut_j])
    cut_step = np.concatenate([own + 1 + cut_slot, k - 1 - cut_slot])
    order = np.argsort(cut_at, kind="stable")
    cut_at, cut_step = cut_at[order], cut_step[order]

    points = np.flatnonzero(~held).astype(np.int32)
    number = np.cumsum(~held, dtype=np.int32) - np.int32(1)
    room = max(1, 2 * family.n_bonds + n)  # an upper bound: some columns are held
    entries = np.empty(room * d * d)
    columns = np.empty(room * (d * d if kind == "csr" else 1), np.int32)
    rows = [np.zeros(1, np.int64)]
    b, filled = np.empty((len(points), d)), 0
    for first in range(0, len(points), CHUNK):
        i = points[first : first + CHUNK]
        where = np.unravel_index(i, shape)
        live = stays[0][where[0]]
        for a in range(1, d):
            live = live & stays[a][where[a]]
        low, high = np.searchsorted(cut_at, (i[0], i[-1] + 1))
        gone = np.searchsorted(i, cut_at[low:high])
        ours = i[gone] == cut_at[low:high]
        live[gone[ours], cut_step[low:high][ours]] = False
        live[:, own] = False
        j = i[:, None] + hop
        np.clip(j, 0, n - 1, out=j)
        f = live.astype(float)
        if v is not None:
            f *= 2.0 / (v[i][:, None] + v[j])
        if c is not None:
            f *= 0.5 * (c[i][:, None] + c[j])
        diagonal = (f @ blocks.reshape(len(blocks), -1)).reshape(-1, d, d)
        right = load[i]
        if constrained:
            moved = held[j] & live
            r, s = np.nonzero(moved)
            pull = f[r, s, None] * np.einsum("qab,qb->qa", blocks[s], given[j[r, s]])
            for a in range(d):
                right[:, a] += np.bincount(r, pull[:, a], len(i))
            live &= ~moved
        b[first : first + len(i)] = right
        live[:, own] = True
        columns_here = number[j]
        if kind == "csr":  # [point, row of the block, step, column of the block]
            value = -f[:, None, :, None] * blocks.transpose(1, 0, 2)[None]
            value[:, :, own] = diagonal
            wide = np.broadcast_to(live[:, None, :, None], value.shape)
            column = d * columns_here[:, None, :, None] + np.arange(d, dtype=np.int32)
            column = np.broadcast_to(column, value.shape)[wide]
            value = value[wide]
            rows.append(np.repeat(live.sum(axis=1) * d, d))
        else:
            value = (
                -f[live][:, None] * blocks.reshape(len(blocks), -1)[np.nonzero(live)[1]]
            )
            start = np.cumsum(live.sum(axis=1)) - live.sum(axis=1)
            value[start + live[:, :own].sum(axis=1)] = diagonal.reshape(len(i), -1)
            value, column = value.ravel(), columns_here[live]
            rows.append(live.sum(axis=1))
        entries[filled : filled + len(value)] = value
        share = 1 if kind == "csr" else d * d
        columns[filled // share : filled // share + len(column)] = column
        filled += len(value)
    pointers = np.cumsum(np.concatenate(rows))
    pointers = pointers.astype(np.int32 if filled < 2**31 else np.int64)
    size = len(points) * d
    if kind == "csr":
        parts = (entries[:filled], columns[:filled], pointers)
        matrix: Any = sp.csr_array(parts, shape=(size, size))
    else:
        data = entries[:filled].reshape(-1, d, d)
        parts = (data, columns[: len(data)], pointers)
        matrix = sp.bsr_array(parts, shape=(size, size))
    matrix.has_sorted_indices = True
    return System(matrix, b.ravel(), points, np.asarray(problem.X)[points])


@dataclass(frozen=True)
class Solved:
    """What a peer did: flat solution, iterations, seconds, and status (0 is good)."""

    x: Vector
    iterations: int
    setup: float
    seconds: float
    status: int


def _iterate(system: System, M: Any, setup: float, rtol: float) -> Solved:
    """SciPy's CG, begun again where its recursion was wrong about the residual."""
    count = 0

    def tick(_: Any) -> None:
        nonlocal count
        count += 1

    start, x, status = time.perf_counter(), None, 0
    for _ in range(5):
        atol = 0.999 * rtol * float(np.linalg.norm(system.b))
        x, status = cg(system.matrix, system.b, x, rtol=0.0, atol=atol, M=M,
                       callback=tick, maxiter=20_000)  # fmt: skip
        if status or system.residual(x) <= rtol:
            break
    assert x is not None
    return Solved(x, count, setup, time.perf_counter() - start, int(status))


def jacobi_cg(system: System, rtol: float = 1e-6, block: bool = False) -> Solved:
    """CG by SciPy with the inverse diagonal, or inverses of diagonal blocks."""
    start, A = time.perf_counter(), system.matrix
    d = system.X.shape[1]
    if block:
        blocks: Any = sp.bsr_array(A, blocksize=(d, d)) if A.format != "bsr" else A
        at = np.repeat(np.arange(len(system.points)), np.diff(blocks.indptr))
        inverse = np.linalg.inv(blocks.data[blocks.indices == at])
        here = np.arange(len(inverse) + 1)
        M: Any = sp.bsr_array((inverse, here[:-1], here), shape=A.shape)
    else:
        inverse = 1.0 / A.diagonal()
        make: Any = LinearOperator
        M = make(A.shape, matvec=lambda r: inverse * r, dtype=inverse.dtype)
    return _iterate(system, M, time.perf_counter() - start, rtol)


def rigid_modes(X: Vector) -> Vector:
    """Translations and rotations of points X [n, d], as columns [n d, modes]."""
    n, d = X.shape
    at = X - X.mean(axis=0)
    modes = [np.tile(np.eye(d)[a], n) for a in range(d)]
    for a in range(d):
        for b in range(a + 1, d):
            turn = np.zeros((n, d))
            turn[:, a], turn[:, b] = -at[:, b], at[:, a]
            modes.append(turn.ravel())
    return np.stack(modes, axis=1)


def amg_cg(system: System, rtol: float = 1e-6) -> Solved:
    """CG by SciPy with pyamg's smoothed aggregation, from a BSR matrix.

    Aggregates need the blocks; sweeps and products are 2.5 times as fast in CSR, so
    that the levels are turned to it once they stand.
    """
    start = time.perf_counter()
    smoother = ("gauss_seidel", {"sweep": "symmetric"})
    make: Any = pyamg.smoothed_aggregation_solver
    hierarchy = make(
        system.matrix,
        B=rigid_modes(system.X),
        strength=("symmetric", {"theta": 0.0}),
        presmoother=smoother,
        postsmoother=smoother,
    )
    for level in hierarchy.levels[:-1]:
        level.A = sp.csr_array(level.A)
    change_smoothers(hierarchy, smoother, smoother)
    fast = replace(system, matrix=hierarchy.levels[0].A)
    M = hierarchy.aspreconditioner(cycle="V")
    return _iterate(fast, M, time.perf_counter() - start, rtol)


#: Peers by name: the kind of matrix, and the solver.
PEERS: dict[str, tuple[str, Callable[..., Solved]]] = {
    "scipy d-pcg": ("csr", jacobi_cg),
    "pyamg": ("bsr", amg_cg),
}
