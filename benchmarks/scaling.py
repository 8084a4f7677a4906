"""Multigrid up to a million points: iterations, time per unknown and memory.

The cracked plate (m = 8, two kernels) and a cube with a square crack (m = 3), small
displacements, to a true residual of 1e-6 by the exact stencil. Every row is measured in
a fresh process, so that its peak of memory is its own; the peak is taken before the
residual is checked.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as in every benchmark with a peer

import json
import time
from typing import Any

import jax
import numpy as np
from _report import Report, asked_part, fresh, is_quick, median_seconds
from operators import cracked_box
from solvers import residual

from jaxpd import prepare
from jaxpd.gallery import cracked_plate
from jaxpd.problem import host_system
from jaxpd.run import peak_memory
from jaxpd.solvers.linear import solve_system
from jaxpd.solvers.status import Status

jax.config.update("jax_enable_x64", True)

RTOL, SLACK, GIB = 1e-6, 1.01, 2**30
HEAD = (
    "d",
    "n",
    "alpha",
    "unknowns",
    "levels",
    "iterations",
    "residual",
    "set-up s",
    "compile s",
    "solve s",
    "us/unknown",
    "peak GiB",
    "bytes/unknown",
)


def measure(d: int, n: int, alpha: float, repeats: int) -> dict[str, Any]:
    """One body by multigrid, in this fresh process."""
    base, start = peak_memory(), time.perf_counter()
    if d == 2:
        scene = cracked_plate(n, 8, alpha, kinematics="small")
    else:
        scene = cracked_box(n, 3, "lattice", alpha)
    problem = prepare(scene, solver="multigrid", rtol=RTOL)
    prepared = time.perf_counter()
    sizes = problem.linear.hierarchy.sizes
    solver, parts = jax.device_put((problem.linear, host_system(problem)))
    ready = time.perf_counter()
    run = solve_system.lower(solver, *parts).compile()
    compiled = time.perf_counter()
    seconds, (x, info) = median_seconds(lambda: run(solver, *parts), repeats)
    peak, unknowns = peak_memory(), int((~np.asarray(problem.fixed)).sum())
    return {
        "unknowns": unknowns,
        "bonds": problem.family.n_bonds,
        "levels": sizes,
        "iterations": int(info.iterations),
        "status": Status(int(info.status)).name,
        "residual": residual(problem, x),
        "prepare": prepared - start,
        "setup": ready - start,
        "compile": compiled - ready,
        "solve": seconds,
        "microseconds": 1e6 * seconds / unknowns,
        "peak bytes": peak,
        "bytes before": base,
        "bytes per unknown": (peak - base) / unknowns,
    }


def line(row: dict[str, Any]) -> list[Any]:
    """A row as the table shows it."""
    cells = [row["d"], row["n"], row["alpha"], row["unknowns"]]
    cells += [len(row["levels"]), row["iterations"], f"{row['residual']:.1e}"]
    cells += [f"{row[key]:.2f}" for key in ("setup", "compile")]
    cells += [f"{row['solve']:.3f}", f"{row['microseconds']:.2f}"]
    return [*cells, f"{row['peak bytes'] / GIB:.2f}", round(row["bytes per unknown"])]


def add_claims(report: Report) -> None:
    """The claims on the rows at hand."""
    at = {(row["d"], row["n"], row["alpha"]): row for row in report.rows}
    bad = [row for row in report.rows if row["status"] != "CONVERGED"]
    report.claim("solves that did not converge", len(bad), 0)
    worst = max(row["residual"] for row in report.rows) / RTOL
    report.claim("largest true residual over 1e-6", worst, SLACK)
    for (d, n, alpha), row in at.items():
        peak = row["peak bytes"] / GIB
        if (d, n) == (2, 1024):
            report.claim(f"n = {n}, alpha = {alpha:g}: peak (GiB)", peak, 8)
            report.claim(
                f"time per unknown at {n} over that at 256, alpha = {alpha:g}",
                row["microseconds"] / at[2, 256, alpha]["microseconds"],
                1.5,
            )
        if (d, n) == (3, 64):
            report.claim(f"64^3: peak (GiB), alpha = {alpha:g}", peak, 12)
            report.claim(
                f"64^3: iterations more than at 32^3, alpha = {alpha:g}",
                row["iterations"] - at[3, 32, alpha]["iterations"],
                2,
            )


def draw(report: Report) -> None:
    """Time per unknown and memory against unknowns."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    kinds = sorted({(row["d"], row["alpha"]) for row in report.rows})
    for (d, alpha), marker in zip(kinds, "osd^", strict=False):
        rows = [r for r in report.rows if (r["d"], r["alpha"]) == (d, alpha)]
        x = [r["unknowns"] for r in rows]
        m = 8 if d == 2 else 3
        label = f"{d}-D, m = {m}, alpha = {alpha:g}"
        axes[0].plot(x, [r["microseconds"] for r in rows], marker=marker, label=label)
        axes[1].plot(x, [r["peak bytes"] / GIB for r in rows], marker=marker)
    axes[0].set(ylabel="solve, microseconds per unknown", ylim=(0, None))
    axes[1].set(ylabel="peak memory of the process, GiB", yscale="log")
    axes[0].legend(fontsize=8)
    for ax in axes:
        ax.set(xlabel="unknowns", xscale="log")
        ax.grid(alpha=0.3)
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)


def main() -> None:
    """Every size in a process of its own."""
    report = Report("scaling", is_quick(__doc__))
    cases = [(2, n, alpha) for alpha in (0.0, 1.9) for n in (128, 256, 512, 1024)]
    cases += [(3, n, 0.0) for n in (32, 64, 96)]
    if report.quick:
        cases = [(2, 32, 1.9), (2, 64, 1.9), (3, 16, 0.0)]
    for d, n, alpha in cases:
        case = {"d": d, "n": n, "alpha": alpha}
        repeats = 2 if n >= 1024 or (d == 3 and n >= 64) else 5
        row = fresh(__file__, "measure", repeats=repeats, **case)
        report.rows.append(case | row)
        print(line(report.rows[-1]), flush=True)
    add_claims(report)
    draw(report)
    report.notes += [
        "set-up: preparation, hierarchy, transfer to the device; solve: warm median; "
        "compilation apart",
        "bytes/unknown: the peak less what was resident before anything was prepared",
    ]
    report.finish(HEAD, [line(row) for row in report.rows])


if __name__ == "__main__":
    asked = asked_part()
    if asked is None:
        main()
    else:
        asked.pop("part")
        print(json.dumps(measure(**asked)))
