"""The pressed ring of `paper_mls`: jitter, refinement, tangents, cost."""

from __future__ import annotations

import time
from functools import lru_cache
from itertools import pairwise
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from _mls_follow import Followed, follow
from _plastic_peer import STEEL, quarter_annulus, radial_cylinder, solve
from _report import Report

from jaxpd import MLS
from jaxpd.gallery import PAPER, pressed_ring

P, STEPS = 172.3, 6
FACTORS = np.arange(1, STEPS + 1) / STEPS
COARSE, MIDDLE, FINE = (11, 25), (21, 49), (31, 73)
JITTERS, SEEDS = (0.2, 0.3, 0.4), tuple(range(200, 210))
#: Pressure at which the bore yields, over P.
YIELD = 0.6026
#: Width of stars, all seeds of a form alike.
WIDTH = {"recommended": 72, "paper": 36}
FORMS = {"recommended": MLS(), "paper": PAPER}


@lru_cache
def wall() -> Any:
    """The cylinder on its radius."""
    return radial_cylinder(STEEL, P * FACTORS)


def exact(X: np.ndarray, step: int) -> np.ndarray:
    """Displacements [n, 2] (m) after a load step."""
    r = np.linalg.norm(X, axis=1)
    return wall().displacement(np.clip(r, 1.0, 2.0), step)[:, None] * X / r[:, None]


def measured(path: Followed) -> dict[str, Any]:
    """Error of the last frame, iterations, front."""
    row: dict[str, Any] = {
        "completed": path.stopped is None,
        "frames": len(path.u),
        "iterations": path.iterations,
        "failed": path.failed,
        "seconds": path.seconds,
    }
    if not len(path.u):
        return row
    want = exact(path.X, len(path.u) - 1)
    off = path.u[-1] - want
    r, peeq = np.linalg.norm(path.X, axis=1), path.peeq[-1]
    front = r[peeq > 1e-9].max(initial=1.0)
    return row | {
        "error": float(np.linalg.norm(off) / np.linalg.norm(want)),
        "worst": float(np.abs(off).max() / np.abs(want).max()),
        "front": float(front),
        "front exact": float(wall().front[len(path.u) - 1]),
    }


def ring(
    form: str, shape: tuple[int, int], jitter: float = 0.0, seed: int = 0
) -> dict[str, Any]:
    """One path of a form; the paper's is not halved: it would fail, only later."""
    scene = pressed_ring(shape, P, jitter=jitter, seed=seed, resolution=FORMS[form])
    halvings = 6 if form == "recommended" else 1
    path = follow(scene, FACTORS, width=WIDTH[form], halvings=halvings)
    of = {"form": form, "shape": list(shape), "jitter": jitter, "seed": seed}
    return of | measured(path)


def several(rows: list[dict[str, Any]]) -> list[Any]:
    """One line of a table: what many seeds came to."""
    done = [r for r in rows if r["completed"]]
    errors = [r["error"] for r in done]
    first = rows[0]
    most = max((max(r["iterations"]) for r in done), default=0)
    return [
        first["form"],
        "x".join(map(str, first["shape"])),
        first["jitter"],
        f"{len(done)}/{len(rows)}",
        float(np.median(errors)) if done else None,
        max(errors, default=None),
        most or None,
        sum(r["failed"] for r in rows),
        first.get("front") if len(rows) == 1 else None,
        sum(r["seconds"] for r in rows),
    ]


def report_ring(quick: bool) -> None:
    """The cylinder against its radius."""
    report, lines = Report("paper_mls_ring", quick), []
    found: dict[Any, list[dict[str, Any]]] = {}

    def add(form: str, shape: tuple[int, int], jitter: float, seeds: Any) -> None:
        rows = [ring(form, shape, jitter, seed) for seed in seeds]
        found[form, shape, jitter] = rows
        report.rows.extend(rows)
        lines.append(several(rows))
        print(*lines[-1], flush=True)

    add("recommended", COARSE, 0.0, (0,))
    add("recommended", COARSE, 0.3, SEEDS[: 2 if quick else 10])
    if not quick:
        for jitter in (0.2, 0.4):
            add("recommended", COARSE, jitter, SEEDS)
        add("paper", COARSE, 0.0, (0,))
        for jitter in JITTERS:
            add("paper", COARSE, jitter, SEEDS[:4])
        add("recommended", MIDDLE, 0.0, (0,))
        add("recommended", MIDDLE, 0.3, SEEDS)
        add("recommended", FINE, 0.0, (0,))
    (row,) = found["recommended", COARSE, 0.0]
    report.claim("regular 11 x 25: u error", row["error"], 1e-2)
    report.claim("regular 11 x 25: iterations", max(row["iterations"]), 6)
    report.claim("regular 11 x 25: front off (m)", abs(row["front"] - 1.5), 0.1)
    for (form, shape, jitter), rows in found.items():
        if form == "recommended" and jitter:
            share = sum(r["completed"] for r in rows) / len(rows)
            name = f"jitter {jitter}, {shape[0]} x {shape[1]}"
            report.claim(f"{name}: share completed", share, 1.0, ">=")
            worst = max(r.get("error", np.inf) for r in rows)
            report.claim(f"{name}: worst u error", worst, 2e-2)
    if not quick:
        orders(report, found)
        failing = [r for k, rows in found.items() if k[0] == "paper" for r in rows]
        failing = [r for r in failing if r["jitter"]]
        share = sum(r["completed"] for r in failing) / len(failing)
        report.claim("the paper's form under jitter: share completed", share, 0.0)
    draw(report, found)
    report.notes.append(
        "u error: root mean square over all nodes, relative, against the cylinder on "
        "its radius on the same load steps; front: farthest node that has yielded"
    )
    report.notes.append(
        "paper: 4 seeds, load steps halved once at most, then a line search; ours: six "
        "times at most"
    )
    head = ("form", "nodes", "jitter", "done", "median", "worst", "its", "failed")
    report.finish((*head, "front", "s"), lines)


def orders(report: Report, found: Any) -> None:
    """Error falling with h."""
    for jitter in (0.0, 0.3):
        size, error = [], []
        for shape in (COARSE, MIDDLE, FINE):
            rows = found.get(("recommended", shape, jitter))
            if rows:
                size.append(1.0 / (shape[0] - 1))
                error.append(np.median([r.get("error", np.inf) for r in rows]))
        order = float(np.polyfit(np.log(size), np.log(error), 1)[0])
        falls = max(b / a for a, b in pairwise(error))
        report.claim(f"jitter {jitter}: u error over that at the h before", falls, 1.0)
        report.notes.append(f"jitter {jitter}: order {order:.2f} of the median u error")
    coarse, middle = (found["recommended", s, 0.3] for s in (COARSE, MIDDLE))
    pairs = [
        middle[k].get("error", np.inf) / coarse[k].get("error", np.inf)
        for k in range(len(SEEDS))
    ]
    better = sum(ratio < 1.0 for ratio in pairs)
    report.notes.append(
        f"jitter 0.3: {better} of {len(pairs)} seeds have a smaller u error on 21 x 49 "
        f"than on 11 x 25; ratios {min(pairs):.2g} to {max(pairs):.2g}, median "
        f"{np.median(pairs):.2g}; another size draws other moves for a seed"
    )
    report.notes.append(
        "nodes lie at r = 1.5 on every grid: the front is resolved to h, no better"
    )


def draw(report: Report, found: Any) -> None:
    """Errors of all seeds over the jitter, and over h."""
    figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    for (form, shape, jitter), rows in found.items():
        y = [r.get("error", np.nan) for r in rows]
        done = [r["completed"] for r in rows]
        colour = "C0" if form == "recommended" else "C3"
        if shape == COARSE:
            for e, good in zip(y, done, strict=True):
                axes[0].semilogy(jitter, e, "o" if good else "x", c=colour)
        if form == "recommended":
            axes[1].loglog([1 / (shape[0] - 1)] * len(y), y, "o" if jitter else "s")
    axes[0].set(xlabel="jitter", ylabel="u error", title="11 x 25; x: did not finish")
    axes[1].set(xlabel="h (m)", ylabel="u error", title="squares: regular")
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)


def report_tangents(quick: bool) -> None:
    """Iterations of consistent and continuum tangents over the size of load steps."""
    report, lines = Report("paper_mls_tangents", quick), []
    counts = (1, 4) if quick else (1, 2, 4, 8, 16)
    figure, axis = plt.subplots(figsize=(5, 4), layout="constrained")
    worst = {}
    for tangent in ("ad", "continuum"):
        most = []
        for n in counts:
            times = [YIELD, *(YIELD + (1 - YIELD) * np.arange(1, n + 1) / n)]
            scene = pressed_ring(COARSE, P)
            path = follow(scene, times, tangent=tangent, width=WIDTH["recommended"])
            row = {"tangent": tangent, "steps": n, "iterations": path.iterations[1:]}
            row |= {"failed": path.failed, "completed": path.stopped is None}
            report.rows.append(row)
            most.append(path.most)
            its = " ".join(map(str, row["iterations"]))
            lines.append([tangent, n, path.most, path.failed, its])
        worst[tangent] = most
        axis.semilogx(counts, most, "o-", base=2, label=tangent)
    report.claim("consistent: iterations at most", max(worst["ad"]), 7)
    fewer = min(c / a for a, c in zip(worst["ad"], worst["continuum"], strict=True))
    report.claim("continuum over consistent, least", fewer, 1.0, ">=")
    axis.set(xlabel="load steps from the elastic limit to p", ylabel="iterations")
    axis.legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    report.finish(("tangent", "steps", "most", "failed", "iterations"), lines)


def report_cost(quick: bool) -> None:
    """Time of the ring's path, warm, beside finite elements."""
    report, lines = Report("paper_mls_cost", quick), []

    def add(name: str, nodes: int, error: float, seconds: float) -> None:
        row = {"method": name, "nodes": nodes, "error": error, "seconds": seconds}
        report.rows.append(row)
        lines.append([name, nodes, error, seconds])

    cases = [(COARSE, "direct"), (COARSE, "bicgstab"), (MIDDLE, "direct")]
    for shape, solver in cases[: 1 if quick else 3]:
        follow(pressed_ring(shape, P), FACTORS, solver=solver)  # to compile
        path = follow(pressed_ring(shape, P), FACTORS, solver=solver)
        name = f"MLS, {solver}"
        add(name, len(path.X), measured(path)["error"], path.seconds)
    fixed = [("bottom", 1, 0.0), ("left", 0, 0.0)]
    for n in ((2, 4), (4, 8)) if quick else ((2, 4), (4, 8), (5, 14), (10, 28)):
        start = time.perf_counter()
        run = solve(quarter_annulus(*n), STEEL, fixed, [("inner", P)], FACTORS)
        seconds = time.perf_counter() - start
        s, angle = np.meshgrid(np.linspace(1, 2, 11), np.linspace(0, np.pi / 2, 25))
        X = np.stack([s * np.cos(angle), s * np.sin(angle)], axis=-1).reshape(-1, 2)
        u, want = run.displacement(X), exact(X, STEPS - 1)
        error = float(np.linalg.norm(u - want) / np.linalg.norm(want))
        add("FE, 8-node", run.u.shape[1] // 2, error, seconds)
    ours, peer = report.rows[0], report.rows[-1 if quick else -2]
    ratio = ours["seconds"] / peer["seconds"]
    text = f"time of 275 MLS nodes over that of {peer['nodes']} of finite elements"
    report.claim(text, ratio, 1.0, ">=")
    rivals = [r for r in report.rows if r["method"][:2] == "FE"]
    equal = [r["seconds"] for r in rivals if r["error"] <= ours["error"]]
    if equal:
        ratio = ours["seconds"] / min(equal)
        report.claim("the same at no larger error", ratio, 1.0, ">=")
    figure, axis = plt.subplots(figsize=(5, 4), layout="constrained")
    for name in dict.fromkeys(r["method"] for r in report.rows):
        rows = [r for r in report.rows if r["method"] == name]
        x, y = ([r[k] for r in rows] for k in ("seconds", "error"))
        axis.loglog(x, y, "o-", label=name)
    axis.set(xlabel="seconds, warm", ylabel="u error")
    axis.legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    report.notes.append(
        "both with the set-up of the path but without compilation; the ratios are "
        "claimed as at least 1: finite elements are the cheaper method here"
    )
    report.finish(("method", "nodes", "u error", "s"), lines)
