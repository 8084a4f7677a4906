"""Ten thousand nodes for `paper_rkpm`: seconds and memory, in a process of its own."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import jax
import matplotlib.pyplot as plt
import numpy as np
from _report import Report, fresh

from jaxpd import RKPM, prepare
from jaxpd.gallery.kernels import cantilever, cantilever_exact
from jaxpd.run import peak_memory

#: Seconds that 10,000 nodes may take, set up and solved.
AIM = 20.0


def measure(k: int, solver: str, scheme: str) -> dict[str, Any]:
    """Set-up, first and second solve of (2 k + 1) (k + 1) nodes."""
    marks = [(time.perf_counter(), time.process_time())]

    def mark() -> None:
        marks.append((time.perf_counter(), time.process_time()))

    body = cantilever((2 * k + 1, k + 1), jitter=0.3, resolution=RKPM(scheme=scheme))
    problem = prepare(body, solver=solver)
    mark()
    info: Any = None
    u: Any = None
    for _ in range(2):
        u, info = jax.block_until_ready(problem.solve())
        mark()
    peak = peak_memory()
    jax.block_until_ready(prepare(body, solver=solver).params["X"])
    mark()
    want = cantilever_exact(problem.X)
    names = ("set-up", "first solve", "second solve", "second set-up")
    row: dict[str, Any] = {"solver": solver, "scheme": scheme}
    for j, name in enumerate(names):
        row[name] = marks[j + 1][0] - marks[j][0]
        row[name + ", cpu"] = marks[j + 1][1] - marks[j][1]
    return row | {
        "nodes": len(problem.X),
        "status": int(info.status),
        "krylov": int(np.maximum(info.linear_iterations, 0).sum()),
        "error": float(np.linalg.norm(u - want) / np.linalg.norm(want)),
        "peak GB": peak / 1e9,
    }


def report_size(quick: bool) -> None:
    """10,000 nodes by AMG and by LU."""
    report, lines = Report("paper_rkpm_size", quick), []
    script = str(Path(__file__).with_name("paper_rkpm.py"))
    cases = [("QCNI", "amg"), ("QCNI", "direct")]
    if not quick:
        cases += [("V2-MNI", "direct"), ("MNI", "direct"), ("GI", "direct")]
    for scheme, solver in cases:
        row = fresh(script, "size", k=20 if quick else 70, solver=solver,
                    scheme=scheme)  # fmt: skip
        report.rows.append(row)
        whole = row["set-up"] + row["first solve"]
        cpu = row["set-up, cpu"] + row["first solve, cpu"]
        keys = ("set-up", "first solve", "second solve", "second set-up")
        line = [scheme, solver, row["nodes"], row["error"], *(row[k] for k in keys)]
        lines.append([*line, whole, cpu, row["krylov"], row["peak GB"]])
        print(*lines[-1], flush=True)
    whole = min(line[8] for line in lines[:2])
    report.claim("QCNI: set up and solved in a fresh process (s)", whole, AIM)
    report.claim("peak memory (GB)", min(line[-1] for line in lines[:2]), 4.0)
    report.notes.append(
        "each in a fresh process; set-up and first solve with compilation; cpu: "
        "processor seconds of both over all threads; cantilever, 141 x 71 nodes, "
        "jitter .3"
    )
    figure, axis = plt.subplots(figsize=(5.5, 4), layout="constrained")
    bottom = np.zeros(len(lines))
    for k, name in ((4, "set-up"), (5, "first solve")):
        y = np.array([line[k] for line in lines], float)
        axis.bar([f"{x[0]}\n{x[1]}" for x in lines], y, bottom=bottom, label=name)
        bottom += y
    axis.axhline(AIM, c="0.5", ls=":")
    axis.set(ylabel="seconds, fresh process", title="10,000 nodes")
    axis.legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    head = ("scheme", "solver", "nodes", "u error", "set-up", "1st solve", "2nd solve")
    report.finish((*head, "2nd set-up", "total", "cpu", "Krylov", "GB"), lines)
