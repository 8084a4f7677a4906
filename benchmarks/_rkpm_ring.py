"""The elastoplastic cylinder of `paper_rkpm`: weak form and strong form, same nodes."""

from __future__ import annotations

import time
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from _mls_follow import MAX_ITERATIONS, Followed, follow, walked
from _mls_ring import COARSE, FACTORS, WIDTH, P, exact
from _report import Report
from _rkpm_core import level

from jaxpd import MLS, RKPM, prepare
from jaxpd.gallery import pressed_ring

SEEDS = tuple(range(200, 205))
#: Schemes of the weak form that any law may be sampled in.
FORMS = ("QCNI", "SCNI", "V2-MNI", "MNI", "GI")


def weak(scheme: str, jitter: float, seeds: tuple[int, ...]) -> list[Followed | str]:
    """Paths of several seeds, lists of one width; why there is none."""
    problems: list[Any] = []
    for seed in seeds:
        body = pressed_ring(
            COARSE, P, jitter=jitter, seed=seed, resolution=RKPM(scheme=scheme)
        )
        problem = prepare(
            body,
            solver="direct",
            rtol=1e-10,
            linear_rtol=1e-8,
            max_iterations=MAX_ITERATIONS,
        )
        problems.append(
            problem.with_newton(max_cuts=0, max_halvings=0, max_total=MAX_ITERATIONS)
        )
    out: list[Followed | str] = []
    for problem in level(problems):
        out.append(walked(problem, FACTORS, 6))
    return out


def strong(jitter: float, seeds: tuple[int, ...]) -> list[Followed | str]:
    """The same by the MLS difference method."""
    out: list[Followed | str] = []
    for seed in seeds:
        body = pressed_ring(COARSE, P, jitter=jitter, seed=seed, resolution=MLS())
        out.append(follow(body, FACTORS, width=WIDTH["recommended"]))
    return out


def measured(path: Any) -> dict[str, Any]:
    """Error of the last frame, iterations, seconds."""
    row: dict[str, Any] = {"completed": path.stopped is None}
    row |= {"iterations": path.iterations, "failed": path.failed}
    row |= {"seconds": path.seconds, "frames": len(path.u)}
    if len(path.u):
        want = exact(path.X, len(path.u) - 1)
        off = path.u[-1] - want
        row["error"] = float(np.linalg.norm(off) / np.linalg.norm(want))
        row["worst"] = float(np.abs(off).max() / np.abs(want).max())
    return row


def report_cylinder(quick: bool) -> None:
    """The cylinder, jittered, against its radius."""
    report, lines = Report("paper_rkpm_cylinder", quick), []
    found: dict[tuple[str, float], list[dict[str, Any]]] = {}
    seeds = SEEDS[:2] if quick else SEEDS
    for form in ("MLS, strong", *(FORMS[:1] if quick else FORMS)):
        for jitter in (0.3,) if quick else (0.0, 0.3):
            some = seeds if jitter else seeds[:1]
            start = time.perf_counter()
            own = strong(jitter, some) if "MLS" in form else weak(form, jitter, some)
            rows = [measured(path) for path in own]
            found[form, jitter] = rows
            for seed, row in zip(some, rows, strict=True):
                kept = {"form": form, "jitter": jitter, "seed": seed}
                report.rows.append(kept | row)
            done = [r for r in rows if r["completed"]]
            errors = [r["error"] for r in done] or [np.nan]
            its = max((max(r["iterations"]) for r in done), default=None)
            whole = max((sum(r["iterations"]) for r in done), default=None)
            warm = [r["seconds"] for r in rows[1:]]
            last = float(np.median(warm)) if warm else None
            share = f"{len(done)}/{len(rows)}"
            line = [form, jitter, share, float(np.median(errors)), max(errors), its]
            line += [whole, sum(r["failed"] for r in rows), rows[0]["seconds"], last]
            lines.append(line)
            print(*lines[-1], f"({time.perf_counter() - start:.0f} s)", flush=True)
    ours, theirs = found["QCNI", 0.3], found["MLS, strong", 0.3]
    share = sum(r["completed"] for r in ours) / len(ours)
    report.claim("QCNI, jitter .3: share completed", share, 1.0, ">=")
    most = max(max(r["iterations"], default=99) for r in ours)
    report.claim("QCNI, jitter .3: iterations of a step", most, 7)
    a, b = (
        float(np.median([r.get("error", np.inf) for r in rows]))
        for rows in (ours, theirs)
    )
    report.claim("QCNI, jitter .3: median u error", a, 1e-2)
    report.claim("the same over that of the strong form", a / b, 1.0)
    report.notes += [
        "11 x 25 nodes, 6 load steps to the front at r = 1.5; u error: root mean "
        "square over all nodes, relative, against the cylinder on its radius",
        "1st: seconds of the first seed's load steps with compilation; warm: median of "
        "the others; the rim of the weak form is the polygon of its nodes",
    ]
    draw(report, found)
    head = ("form", "jitter", "done", "median", "worst", "its", "of path", "failed")
    report.finish((*head, "1st s", "warm s"), lines)


def draw(report: Report, found: dict[Any, list[dict[str, Any]]]) -> None:
    """Errors of all seeds, and their seconds."""
    figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
    for (form, jitter), rows in found.items():
        if jitter:
            x = [r["seconds"] for r in rows[1:]]
            y = [r.get("error", np.nan) for r in rows[1:]]
            axis.loglog(x, y, "D" if "MLS" in form else "o", label=form)
    axis.set(xlabel="seconds of the path, warm", ylabel="u error", title="jitter .3")
    axis.legend(fontsize=8)
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
