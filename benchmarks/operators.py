"""One product with the stiffness: gather, stencil, FFT, and SciPy's CSR and BSR.

The stiffness of an undeformed body with a crack, on vectors in float64, with and
without surface correction. CSR is the reference of all errors, assembled from the
definition; where it would exceed 3 GB there is none and errors are against the stencil.
Operators enter `jit` as arguments. SciPy multiplies on one thread, XLA on all.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as in every benchmark with a peer

import time
from collections.abc import Callable
from typing import Any

import _peers
import jax
import numpy as np
from _report import Report, is_quick, median_seconds

from jaxpd import Bonds, Elastic, Problem, Scene, box, fractional, moves, prepare
from jaxpd.gallery import cracked_plate
from jaxpd.geometry import above, below, rectangle
from jaxpd.operators import convolution
from jaxpd.problem import first_tangent

jax.config.update("jax_enable_x64", True)

#: Largest matrix (bytes), and most bonds that the gather is tried with.
LARGEST, MOST_BONDS = 3e9, 40_000_000
KINDS = ("gather", "stencil", "fft", "csr", "bsr")
HEAD = (
    "d",
    "n",
    "m",
    "correction",
    "MB csr",
    *(f"{k} ms" for k in KINDS),
    "CSR/stencil",
    "CSR/FFT",
    "FFT error",
    "compile cpu s",
)


def cracked_box(n: int, m: float, correction: str, alpha: float = 0.0) -> Scene:
    """A cube of n spacings with a square crack, top and bottom moved apart."""
    return Scene(
        body=box((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)),
        material=Elastic(30e9, nu=1 / 4, state="solid"),
        supports=(
            moves(above(z=0.5), x=0.0, y=0.0, z=+5e-4),
            moves(below(z=-0.5), x=0.0, y=0.0, z=-5e-4),
        ),
        cracks=(rectangle((-0.15, -0.15, 0.0), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0)),),
        resolution=Bonds(
            dx=1.0 / n, m=m, kernel=fractional(alpha), correction=correction
        ),
        kinematics="small",
    )


def problem_of(d: int, n: int, m: float, correction: str, operator: str) -> Problem:
    """A scene with n points a side, prepared; layers of supports come on top."""
    if d == 2:
        scene = cracked_plate(n - 1, m, correction=correction, kinematics="small")
    else:
        scene = cracked_box(n - 1, m, correction)
    return prepare(scene, solver="d-pcg", operator=operator)


def device_product(K: Any, u: Any, repeats: int) -> dict[str, Any]:
    """Compilation and time of K.mv under jit, and the product."""
    K, u = jax.device_put((K, u))
    wall, cpu = time.perf_counter(), time.process_time()
    mv = jax.jit(lambda K, u: K.mv(u)).lower(K, u).compile()
    compiled = time.perf_counter() - wall, time.process_time() - cpu
    seconds, product = median_seconds(lambda: mv(K, u), repeats)
    return {
        "ms": 1e3 * seconds,
        "compile s": compiled[0],
        "compile cpu s": compiled[1],
        "product": np.asarray(product).ravel(),
    }


def host_product(problem: Problem, u: Any, kind: str, repeats: int) -> dict[str, Any]:
    """Assembly and time of SciPy's product, and the product."""
    start = time.perf_counter()
    A = _peers.assemble(problem, kind, constrained=False).matrix
    built = time.perf_counter() - start
    seconds, product = median_seconds(lambda: A @ u.ravel(), repeats)
    size = A.data.nbytes + A.indices.nbytes + A.indptr.nbytes
    return {"ms": 1e3 * seconds, "assembly s": built, "bytes": size, "product": product}


def measure(d: int, n: int, m: float, correction: str, repeats: int) -> dict[str, Any]:
    """All operators of one scene, one after the other."""
    problem = problem_of(d, n, m, correction, "fft")
    rest, bonds = problem.rest(), problem.family.n_bonds
    u = np.random.default_rng(0).normal(size=problem.X.shape)
    size = _peers.matrix_bytes(problem)
    tasks: dict[str, Callable[[], dict[str, Any]]] = {
        "stencil": lambda: device_product(rest, u, repeats),
        "fft": lambda: device_product(
            convolution(rest, problem.spec.pivots, problem.spec.patches), u, repeats
        ),
    }
    if bonds <= MOST_BONDS:
        gathered = lambda: first_tangent(problem_of(d, n, m, correction, "gather"))  # noqa: E731
        tasks["gather"] = lambda: device_product(gathered(), u, repeats)
    if size <= LARGEST:
        for kind in ("csr", "bsr"):
            tasks[kind] = lambda kind=kind: host_product(problem, u, kind, repeats)
    found = {kind: task() for kind, task in tasks.items()}
    exact = found.get("csr", found["stencil"])["product"]
    for kind in found:
        product = found[kind].pop("product")
        found[kind]["error"] = float(
            np.abs(product - exact).max() / np.abs(exact).max()
        )
    return {
        "d": d,
        "n": n,
        "m": m,
        "correction": correction,
        "points": len(problem.X),
        "bonds": bonds,
        "terms": max(1, len(problem.spec.pivots)),
        "csr bytes": size,
        "reference": "csr" if "csr" in found else "stencil",
        "operators": found,
    }


def line(row: dict[str, Any]) -> list[Any]:
    """A row as the table shows it."""
    found = row["operators"]
    ms = {k: found[k]["ms"] if k in found else None for k in KINDS}
    ratios = [ms["csr"] and ms["csr"] / ms[k] for k in ("stencil", "fft")]
    compiled = [found[k]["compile cpu s"] for k in KINDS[:3] if k in found]
    cells = [row["d"], row["n"], row["m"], row["correction"], row["csr bytes"] / 1e6]
    cells += [ms[k] for k in KINDS] + [r and f"{r:.1f}" for r in ratios]
    cells += [f"{found['fft']['error']:.1e}", "+".join(f"{c:.2f}" for c in compiled)]
    return cells


def add_claims(report: Report) -> None:
    """The claims on the rows at hand."""

    def faster(n: int, m: int, correction: str, kind: str, bound: float) -> None:
        for row in report.rows:
            key = (row["d"], row["n"], row["m"], row["correction"])
            found = row["operators"]
            if key == (2, n, m, correction) and "csr" in found:
                report.claim(
                    f"CSR over {kind}, n = {n}, m = {m}, correction {correction!r}",
                    found["csr"]["ms"] / found[kind]["ms"],
                    bound,
                    ">=",
                )

    faster(257, 8, "none", "fft", 20)
    faster(257, 16, "none", "fft", 25)
    faster(257, 8, "none", "stencil", 5)
    faster(257, 8, "lattice", "fft", 4)
    exact = [
        f["error"]
        for row in report.rows
        for kind, f in row["operators"].items()
        if kind in ("gather", "stencil", "bsr") or row["correction"] == "none"
    ]
    report.claim(
        "largest error but for the FFT's with surface correction, over max|K u|",
        max(exact),
        1e-13,
    )
    separated = [
        row["operators"]["fft"]["error"]
        for row in report.rows
        if row["correction"] != "none"
    ]
    report.claim(
        "largest error of the FFT with surface correction, over max|K u|",
        max(separated),
        1e-8,
    )


def main() -> None:
    """Every scene with and without correction."""
    report = Report("operators", is_quick(__doc__))
    scenes = [(2, n, m) for n in (129, 257, 513) for m in (4, 8, 16)]
    scenes += [(3, 33, 3), (3, 65, 3)]
    if report.quick:
        scenes = [(2, 65, 4), (2, 129, 8), (3, 17, 3)]
    for d, n, m in scenes:
        for correction in ("none", "lattice"):
            repeats = 7 if report.quick or n < 257 else 15
            report.rows.append(measure(d, n, m, correction, repeats))
            jax.clear_caches()
    add_claims(report)
    report.notes += [
        "n points a side, and m - 1 more rows of supports at top and at bottom",
        "compile cpu s: gather+stencil+FFT, processor seconds; assembly is in the JSON",
        "the FFT separates the volume correction of a bond to 1e-9 (relative)",
    ]
    report.finish(HEAD, [line(row) for row in report.rows])


if __name__ == "__main__":
    main()
