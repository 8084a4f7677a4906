"""The largest plate of the paper, h = 1/256 and m = 8, by gathering over index lists.

Newton's method with diagonally preconditioned CG to 1e-6, its time and memory; counts
of the first linear solve against the printed ones; and one linear solve against SciPy's
CG on the assembled CSR matrix, same preconditioner, in the same run. Each part runs in
a process of its own, so that a peak of memory is that part's.
"""

from __future__ import annotations

import multiprocessing
import time
from typing import Any

import jax
import numpy as np
import scipy.sparse as sp
from _report import Report, is_quick, median_seconds
from scipy.sparse.linalg import cg

from jaxpd import Problem, prepare
from jaxpd.gallery import PRINTED_CG, PRINTED_DPCG, PRINTED_RTOL, cracked_plate
from jaxpd.run import first_system, peak_memory
from jaxpd.solvers.linear import linear_solver, solve_system

jax.config.update("jax_enable_x64", True)

M, STRAIN, RTOL = 8, 1e-3, 1e-6
MB = 2**20
HEAD = ("what", "Newton", "Krylov", "seconds", "to peer", "peak MB", "matrix MB")


def newton(n: int) -> dict[str, Any]:
    """The whole nonlinear solve, compilation apart; then the counts of the tables."""
    base, start = peak_memory(), time.perf_counter()
    problem = jax.block_until_ready(
        prepare(cracked_plate(n, M, strain=STRAIN), solver="d-pcg", operator="gather")
    )
    prepared = time.perf_counter()
    solve = jax.jit(Problem.solve).lower(problem).compile()
    compiled = time.perf_counter()
    _, info = jax.block_until_ready(solve(problem))
    solved = time.perf_counter()
    steps, peak = int(info.iterations), peak_memory()
    return {
        "unknowns": int((~np.asarray(problem.fixed)).sum()),
        "bonds": problem.family.n_bonds,
        "status": int(info.status),
        "newton steps": steps,
        "krylov iterations": np.asarray(info.linear_iterations)[:steps].tolist(),
        "residuals": np.asarray(info.residuals)[:steps].tolist(),
        "seconds prepare": prepared - start,
        "seconds compile": compiled - prepared,
        "seconds solve": solved - compiled,
        "peak bytes": peak,
        "bytes before": base,
        "printed rtol": counts(n),
    }


def counts(n: int) -> dict[str, Any]:
    """Iterations at the tolerance and load that reproduce the print."""
    problem = prepare(
        cracked_plate(n, M, strain=STRAIN, loading="band"),
        solver="d-pcg",
        operator="gather",
    )
    found: dict[str, Any] = {}
    for method, label in (("pcg", "cg"), ("d-pcg", "d-pcg")):
        _, info = solve_system(
            linear_solver(method, PRINTED_RTOL), *first_system(problem)
        )
        found[label] = int(info.iterations)
    return found


def linear(n: int, repeats: int) -> dict[str, Any]:
    """One linear solve by D-PCG: matrix-free, and by SciPy on the CSR matrix."""
    problem = prepare(
        cracked_plate(n, M, strain=STRAIN), solver="d-pcg", operator="gather"
    )
    K, constraints, b = jax.block_until_ready(first_system(problem))
    seconds_tangent, _ = median_seconds(lambda: first_system(problem), repeats)
    solver = linear_solver("d-pcg", RTOL)
    seconds, (x, info) = median_seconds(
        lambda: solve_system(solver, K, constraints, b), repeats
    )
    ours = peak_memory()

    start = time.perf_counter()
    free = np.flatnonzero(~np.asarray(constraints.fixed).ravel())
    A = sp.csr_matrix(K.to_bsr())[free][:, free]
    seconds_assembly = time.perf_counter() - start
    rhs, inverse = np.asarray(b).ravel()[free], 1.0 / A.diagonal()
    jacobi = sp.diags_array(inverse).tocsr()
    iterations = 0

    def tick(_: Any) -> None:
        nonlocal iterations
        iterations += 1

    times, x_peer = [], rhs
    for _ in range(repeats):
        iterations, start = 0, time.perf_counter()
        x_peer, status = cg(A, rhs, rtol=RTOL, M=jacobi, callback=tick)
        times.append(time.perf_counter() - start)
        if status != 0:
            raise RuntimeError(f"the peer stopped with status {status}")
    difference = np.linalg.norm(np.asarray(x).ravel()[free] - x_peer)
    return {
        "iterations": int(info.iterations),
        "peer iterations": iterations,
        "seconds tangent": seconds_tangent,
        "seconds solve": seconds,
        "peer seconds assembly": seconds_assembly,
        "peer seconds solve": float(np.median(times)),
        "difference": float(difference / np.linalg.norm(x_peer)),
        "peak bytes": ours,
        "peer peak bytes": peak_memory(),
        "matrix bytes": K.nbr.nbytes + K.parts.nbytes,
        "peer matrix bytes": A.data.nbytes + A.indices.nbytes + A.indptr.nbytes,
    }


def main() -> None:
    """Run the three parts one after the other and report."""
    report = Report("large_plate", is_quick(__doc__))
    n, repeats = (64, 3) if report.quick else (256, 2)
    spawn = multiprocessing.get_context("spawn")
    found = []
    for part, arguments in ((newton, (n,)), (linear, (n, repeats))):
        with spawn.Pool(1) as pool:
            found.append(pool.apply(part, arguments))
    whole, one = found
    printed = whole["printed rtol"]
    for part, row in zip(("newton", "linear"), found, strict=True):
        report.rows.append({"part": part, "n": n, "m": M, "alpha": 0.0} | row)

    report.claim("Newton converged (status 0)", whole["status"], 0)
    report.claim("Newton steps to 1e-6 at strain 1e-3", whole["newton steps"], 3)
    report.claim("peak memory of the whole solve (GiB)", whole["peak bytes"] / 2**30, 4)
    for label, table in (("cg", PRINTED_CG), ("d-pcg", PRINTED_DPCG)):
        want = table[n][3]
        report.claim(
            f"{label.upper()} count at 4e-5, band load, held out: "
            f"{printed[label]}, printed {want}; relative distance",
            abs(printed[label] / want - 1.0),
            0.05,
        )
    report.claim(
        "D-PCG iterations less those of SciPy's",
        abs(one["iterations"] - one["peer iterations"]),
        2,
    )
    report.claim("displacements less SciPy's, relative", one["difference"], 1e-4)
    ratio = one["seconds solve"] / one["peer seconds solve"]
    total = (one["seconds tangent"] + one["seconds solve"]) / (
        one["peer seconds assembly"] + one["peer seconds solve"]
    )
    size = one["matrix bytes"] / one["peer matrix bytes"]
    if not report.quick:  # small matrices live in the cache
        what = "time of one linear solve over SciPy's on CSR (one thread)"
        report.claim(what, ratio, 1.25)
        report.claim("the same with tangent and assembly", total, 1.25)
        report.claim("bytes of the tangent over those of the CSR matrix", size, 0.7)
    report.notes += [
        f"n = {n}: {whole['unknowns']} unknowns, {whole['bonds']} bonds; "
        f"{whole['bytes before'] / MB:.0f} MB are resident before anything is solved",
        "seconds leave out compilation "
        f"({whole['seconds compile']:.1f} s for the whole solve)",
        "the peer's peak includes the tangent that its matrix is assembled from",
    ]
    krylov = "+".join(map(str, whole["krylov iterations"]))
    lines = [
        ["prepare", None, None, whole["seconds prepare"], None, None, None],
        [
            "Newton, D-PCG, 1e-6",
            whole["newton steps"],
            krylov,
            whole["seconds solve"],
            None,
            f"{whole['peak bytes'] / MB:.0f}",
            None,
        ],
        [
            "one linear solve",
            None,
            one["iterations"],
            one["seconds solve"],
            f"{ratio:.2f}",
            f"{one['peak bytes'] / MB:.0f}",
            f"{one['matrix bytes'] / MB:.0f}",
        ],
        ["its tangent", None, None, one["seconds tangent"], None, None, None],
        [
            "peer: SciPy CG on CSR",
            None,
            one["peer iterations"],
            one["peer seconds solve"],
            "1",
            f"{one['peer peak bytes'] / MB:.0f}",
            f"{one['peer matrix bytes'] / MB:.0f}",
        ],
        ["its assembly", None, None, one["peer seconds assembly"], None, None, None],
        ["CG to 4e-5, band", None, printed["cg"], None, None, None, None],
        ["D-PCG to 4e-5, band", None, printed["d-pcg"], None, None, None, None],
    ]
    report.finish(HEAD, lines)


if __name__ == "__main__":
    main()
