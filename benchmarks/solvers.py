"""Linear solvers to a true residual of 1e-6: warm, cold, and against SciPy and pyamg.

The cracked plate with small displacements. Warm: set-up, compilation, and repeated
solves apart. Cold: everything from the scene to the displacements in a fresh process,
imports alone left out, which for jaxpd is mostly compilation; once more in a second
process that finds the code of the first kept. Peers assemble a CSR or BSR matrix from
the definition. Residuals are those of the assembled matrix or of the exact stencil,
never of the solver's own operator.
"""

from __future__ import annotations

import os

os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as in every benchmark with a peer

import json
import statistics
import tempfile
import time
from pathlib import Path
from typing import Any

import _peers
import jax
import numpy as np
from _report import Report, asked_part, fresh, is_quick, median_seconds

from jaxpd import Problem, prepare, solve_static
from jaxpd.gallery import cracked_plate
from jaxpd.problem import host_system
from jaxpd.run import keep_compiled, peak_memory
from jaxpd.solvers.linear import solve_system
from jaxpd.solvers.status import Status

jax.config.update("jax_enable_x64", True)

RTOL, M, SLACK = 1e-6, 8, 1.01
#: Largest n of the methods that need a matrix for their hierarchy.
AMG_MOST = 128
#: From this n on these methods are left out, for time.
LARGE, SLOW = 512, {"pcg", "d-pcg", "scipy d-pcg"}
#: What a quick run tries.
QUICK = ("spectral", "auto", "scipy d-pcg", "pyamg")
OURS = ("pcg", "d-pcg", "spectral", "multigrid", "auto", "amg")
#: Those whose cold time is compared with that of the automatic choice.
LATTICE = ("d-pcg", "spectral", "multigrid")
HEAD = (
    "n",
    "alpha",
    "correction",
    "method",
    "set-up",
    "compile",
    "warm s",
    "iterations",
    "residual",
    "peak MB",
    "cold s",
    "cold cpu",
    "kept s",
    "kept cpu",
)


def scene_of(n: int, alpha: float, correction: str):
    """The plate with small displacements."""
    return cracked_plate(n, M, alpha, correction=correction, kinematics="small")


def residual(problem: Problem, x: Any) -> float:
    """True relative residual of nodal displacements [n, d], by the exact stencil."""
    rest = jax.device_put(problem.rest())
    fixed, given = np.asarray(problem.fixed), np.asarray(problem.params["prescribed"])
    mv = jax.jit(lambda K, u: K.mv(u))
    load = np.asarray(problem.params["load"])
    b = load - np.asarray(mv(rest, np.where(fixed, given, 0.0)))
    r = load - np.asarray(mv(rest, np.where(fixed, given, np.asarray(x))))
    return float(np.linalg.norm(r[~fixed]) / np.linalg.norm(b[~fixed]))


def warm(method: str, repeats: int, **scene: Any) -> dict[str, Any]:
    """Set-up, compilation and repeated solves of one method, in this process."""
    base = peak_memory()
    if method in _peers.PEERS:
        return warm_peer(method, repeats, base, **scene)
    start = time.perf_counter()
    asked = "auto" if method == "auto" else "d-pcg"
    problem = prepare(scene_of(**scene), solver=asked, rtol=RTOL)
    prepared = time.perf_counter()
    parts = jax.device_put(host_system(problem))
    solver = problem.linear
    if method != "auto":
        solver = problem.solver(method, RTOL)
    solver = jax.device_put(solver)
    ready = time.perf_counter()
    run: Any = solve_system.lower(solver, *parts).compile()
    compiled = time.perf_counter()
    if solver.method == "amg":  # a hierarchy on the host changes its type in a trace
        run = solve_system
    seconds, (x, info) = median_seconds(lambda: run(solver, *parts), repeats)
    peak = peak_memory()
    return {
        "chosen": solver.method,
        "unknowns": int((~np.asarray(problem.fixed)).sum()),
        "prepare": prepared - start,
        "setup": ready - start,
        "compile": compiled - ready,
        "warm": seconds,
        "iterations": int(info.iterations),
        "status": Status(int(info.status)).name,
        "residual": residual(problem, x),
        "peak bytes": peak,
        "bytes before": base,
    }


def warm_peer(method: str, repeats: int, base: int, **scene: Any) -> dict[str, Any]:
    """The same of a peer; set-up is preparation, assembly and preconditioner."""
    kind, solve = _peers.PEERS[method]
    start = time.perf_counter()
    problem = prepare(scene_of(**scene), solver="d-pcg", rtol=RTOL)
    system = _peers.assemble(problem, kind)
    assembled = time.perf_counter() - start
    runs = [solve(system, RTOL) for _ in range(repeats)]
    return {
        "chosen": method,
        "unknowns": len(system.b),
        "setup": assembled + statistics.median(run.setup for run in runs),
        "assembly": assembled,
        "compile": 0.0,
        "warm": statistics.median(run.seconds for run in runs),
        "iterations": runs[-1].iterations,
        "status": Status(runs[-1].status and 1).name,
        "residual": system.residual(runs[-1].x),
        "peak bytes": peak_memory(),
        "bytes before": base,
    }


def cold(method: str, folder: str | None = None, **scene: Any) -> dict[str, Any]:
    """From the scene to the displacements, once, in this fresh process."""
    if folder is not None:
        keep_compiled(folder)
    wall, cpu = time.perf_counter(), time.process_time()
    chosen = method
    if method in _peers.PEERS:
        kind, solve = _peers.PEERS[method]
        problem = prepare(scene_of(**scene), solver="d-pcg", rtol=RTOL)
        good = solve(_peers.assemble(problem, kind), RTOL).status == 0
    else:
        solution = solve_static(scene_of(**scene), solver=method, rtol=RTOL)
        good = solution.status is Status.CONVERGED
        chosen = solution.problem.linear.method
    return {
        "wall": time.perf_counter() - wall,
        "cpu": time.process_time() - cpu,
        "chosen": chosen,
        "good": good,
    }


PARTS = {"warm": warm, "cold": cold}


def measure(method: str, scene: dict[str, Any], repeats: int, times: int) -> dict:
    """One method on one scene, every part in a process of its own."""
    row = {"method": method} | scene
    row |= fresh(__file__, "warm", method=method, repeats=repeats, **scene)
    runs = [fresh(__file__, "cold", method=method, **scene) for _ in range(times)]
    for clock in ("wall", "cpu"):
        row[f"cold {clock}"] = statistics.median(run[clock] for run in runs)
    row["good"] = all(run["good"] for run in runs)
    if method == "auto":
        with tempfile.TemporaryDirectory() as folder:
            ask = {"method": method, "folder": str(Path(folder) / "code")} | scene
            fresh(__file__, "cold", **ask)
            kept = [fresh(__file__, "cold", **ask) for _ in range(times)]
        for clock in ("wall", "cpu"):
            row[f"kept {clock}"] = statistics.median(run[clock] for run in kept)
    return row


def line(row: dict[str, Any]) -> list[Any]:
    """A row as the table shows it."""
    name = row["method"]
    if name == "auto":
        name += f" ({row['chosen']})"
    cells = [row["n"], row["alpha"], row["correction"], name]
    cells += [f"{row[key]:.3f}" for key in ("setup", "compile", "warm")]
    cells += [row["iterations"], f"{row['residual']:.1e}"]
    cells += [round(row["peak bytes"] / 2**20)]
    clocks = ("cold wall", "cold cpu", "kept wall", "kept cpu")
    return cells + [f"{row[k]:.2f}" if k in row else None for k in clocks]


def scenes(rows: list[dict[str, Any]]) -> dict[tuple[Any, ...], dict[str, Any]]:
    """Rows by scene and method."""
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows:
        scene = (row["n"], row["alpha"], row["correction"])
        found.setdefault(scene, {})[row["method"]] = row
    return found


def add_claims(report: Report) -> None:
    """The claims on the rows at hand."""
    by_scene = scenes(report.rows)
    bad = [r for r in report.rows if r["status"] != "CONVERGED" or not r["good"]]
    report.claim("solves that did not converge", len(bad), 0)
    worst = max(row["residual"] for row in report.rows) / RTOL
    report.claim("largest true residual over 1e-6", worst, SLACK)

    def least(claim: str, n: int, bound: float, ratio: Any, sense: str = ">=") -> None:
        found = [ratio(s) for key, s in by_scene.items() if key[0] == n]
        if found:
            value = min(found) if sense == ">=" else max(found)
            report.claim(f"{claim}, n = {n}, {len(found)} scenes", value, bound, sense)

    def faster(s: dict[str, Any], peer: str) -> float:
        return s[peer]["warm"] / min(s[k]["warm"] for k in ("spectral", "multigrid"))

    def colder(s: dict[str, Any], peer: str) -> float:
        return s[peer]["cold cpu"] / s["auto"]["cold cpu"]

    warm_of = "warm solve of {} over the faster of spectral and multigrid"
    cold_of = "cold processor seconds of {} over the automatic choice"
    for peer, n, hot, cool in (
        ("scipy d-pcg", 128, 20, 2),
        ("pyamg", 128, 30, 5),
        ("scipy d-pcg", 256, None, 10),
    ):
        if hot is not None:
            least(warm_of.format(peer), n, hot, lambda s, p=peer: faster(s, p))
        least(cold_of.format(peer), n, cool, lambda s, p=peer: colder(s, p))
    kept = [row["kept wall"] for row in report.rows if "kept wall" in row]
    report.claim("second process, kept code: wall seconds, the slowest", max(kept), 0.5)
    for n in (32, 128, 512):
        least(
            "cold processor seconds of the automatic choice over the best method's",
            n,
            1.3,
            lambda s: (
                s["auto"]["cold cpu"] / min(s[k]["cold cpu"] for k in LATTICE if k in s)
            ),
            "<=",
        )


def methods(n: int, alpha: float) -> list[str]:
    """Methods tried on a scene."""
    left = set() if n <= AMG_MOST else {"amg", "pyamg", "pcg"}
    if n >= LARGE:
        left |= SLOW
    return [name for name in (*OURS, *_peers.PEERS) if name not in left]


def main() -> None:
    """Every method on every scene."""
    report = Report("solvers", is_quick(__doc__))
    sizes, kinds = (32, 128, 256, 512), ("none", "lattice")
    alphas: tuple[float, ...] = (0.0, 1.9)
    if report.quick:
        sizes, alphas, kinds = (32,), (1.9,), ("lattice",)
    for n in sizes:
        for alpha in alphas:
            for correction in kinds if n == 128 else ("lattice",):
                scene = {"n": n, "alpha": alpha, "correction": correction}
                for method in QUICK if report.quick else methods(n, alpha):
                    repeats, times = (2, 1) if n > 128 else (3, 1)
                    report.rows.append(measure(method, scene, repeats, times))
                    print(line(report.rows[-1]), flush=True)
    add_claims(report)
    report.notes += [
        "set-up: prepare, operator and preconditioner, for a peer assembly; warm: "
        "medians; cold: everything after the imports, in a fresh process",
        "kept: a second process that finds the compiled code of the first",
        f"algebraic multigrid and plain CG up to n = {AMG_MOST}; from n = {LARGE} on "
        f"without {sorted(SLOW)}; cold times are of one process each",
    ]
    report.finish(HEAD, [line(row) for row in report.rows])


if __name__ == "__main__":
    asked = asked_part()
    if asked is None:
        main()
    else:
        print(json.dumps(PARTS[asked.pop("part")](**asked)))
