"""What the schemes of `paper_rkpm` cost for their errors, beside finite elements."""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial
from typing import Any

import jax
import matplotlib.pyplot as plt
import numpy as np
from _report import Report
from _rkpm_core import (
    CELLS,
    NAMES,
    RIVALS,
    assembled,
    finished,
    made,
    number,
)
from _rkpm_fe import elements

from jaxpd import RKPM, prepare
from jaxpd.gallery.kernels import cantilever, cantilever_exact
from jaxpd.solvers.direct import solve_free

FULL = (41, 21)
SIZES = ((13, 7), (17, 9), (25, 13), (33, 17), FULL)
SEEDS = range(3)
ELEMENTS = {"FE, 4-node": 1, "FE, 9-node": 2}


class Clock:
    """Wall and processor seconds of stages; least of repeats, for a busy machine."""

    def __init__(self):
        """With none."""
        self.spent: dict[str, float] = {}

    def __call__(self, stage: str, call: Callable[[], Any]) -> Any:
        """Run a stage."""
        wall, cpu = time.perf_counter(), time.process_time()
        out = jax.block_until_ready(call())
        for end, spent in (
            ("", time.perf_counter() - wall),
            (", cpu", time.process_time() - cpu),
        ):
            key = stage + end
            self.spent[key] = min(spent, self.spent.get(key, np.inf))
        return out


def stages(name: str, jitter: float, repeats: int) -> dict[str, Any]:
    """One scheme at the full size: sizes, error, seconds of what is done."""
    clock = Clock()

    def make() -> Any:
        resolution = RKPM(scheme=name)
        body = cantilever(FULL, jitter=jitter, resolution=resolution)
        return body, prepare(body, solver="direct")

    problem = clock("set-up, first", lambda: _ready(make()))
    u = clock("solve, first", problem.solve)[0]
    system: Any = None
    for _ in range(repeats):
        problem = clock("set-up", lambda: _ready(make()))
        clock("solve", problem.solve)
    clock("assembly, first", lambda: _numbers(assembled(problem)))
    for _ in range(repeats):
        clock("assembly", lambda: _numbers(assembled(problem)))
        system = assembled(problem)
        symmetric = problem.layout.scheme.symmetric
        clock("linear", partial(solve_free, *system[:3], symmetric=symmetric))
    want = cantilever_exact(problem.X)
    layout, cover = problem.layout, problem.layout.cover
    g, c = layout.ends[0] // layout.nodes_of.shape[1], layout.nodes_of.shape[1]
    error = float(np.linalg.norm(u - want) / np.linalg.norm(want))
    K = system[0]
    return {
        "scheme": name,
        "jitter": jitter,
        "error": number(error),
        "sampled": g * c,
        "places": layout.ends[-1],
        "pairs": int(np.asarray(cover.there).sum()),
        "blocks": len(K.indices),
    } | clock.spent


def _ready(made: Any) -> Any:
    jax.block_until_ready(made[1].params["X"])
    return made[1]


def _numbers(system: tuple[Any, ...]) -> np.ndarray:
    return system[0].data


def at_sizes(name: str, shape: tuple[int, int]) -> dict[str, Any]:
    """Median error of three seeds; seconds of set-up, assembly and solve, warm."""
    body = partial(cantilever, shape)
    cases = [(0.3, seed) for seed in SEEDS]
    problems = [p for p in made(body, cases, scheme=name) if not isinstance(p, str)]
    errors, spent = [], []
    for problem in [*problems, *problems[:1]]:
        start = time.perf_counter()
        system = assembled(problem)
        x = solve_free(*system[:3], symmetric=problem.layout.scheme.symmetric)
        spent.append(time.perf_counter() - start)
        errors.append(finished(problem, system, x, cantilever_exact).error)
    start = time.perf_counter()
    again = made(body, cases[:2], scheme=name)
    setup = (time.perf_counter() - start) / len(again)
    solve = min(spent[1:])
    return {
        "scheme": name,
        "n": shape[0] * shape[1],
        "error": number(float(np.median(errors[: len(problems)]))),
        "set-up": setup,
        "solve": solve,
        "seconds": setup + solve,
    }


def peers(shapes: Any, jitter: float) -> list[dict[str, Any]]:
    """Finite elements at equal nodes, the least of three runs after one."""
    out = []
    for name, order in ELEMENTS.items():
        for shape in shapes:
            runs = [elements(shape, order, jitter, seed) for seed in (0, 0, 1, 2)]
            row = {"scheme": name, "n": shape[0] * shape[1], "jitter": jitter}
            row["error"] = float(np.median([r["error"] for r in runs[1:]]))
            for key in ("assembly", "linear", "seconds"):
                row[key] = min(r[key] for r in runs[1:])
            out.append(row)
    return out


def front(rows: list[dict[str, Any]], own: str, others: tuple[str, ...]) -> int:
    """How many points of `own` are beaten in error and time by points of others."""
    return sum(
        any(
            (r["error"] or np.inf) <= mine["error"] and r["seconds"] <= mine["seconds"]
            for r in rows
            if r["scheme"] in others
        )
        for mine in rows
        if mine["scheme"] == own
    )


def report_cost(quick: bool) -> None:
    """Error against cost of every scheme, at equal nodes and at equal time."""
    report = Report("paper_rkpm_cost", quick)
    names = ("QCNI", "MNI") if quick else NAMES
    lines, sizes = [], SIZES[:2] if quick else SIZES
    for name in names:
        for jitter in (0.3,) if quick else (0.0, 0.3):
            row = stages(name, jitter, 1 if quick else 3)
            report.rows.append({"part": "stages"} | row)
            keys = ("scheme", "jitter", "error", "sampled", "places", "pairs")
            keys += ("set-up, first", "solve, first", "set-up", "solve")
            lines.append([row[k] for k in (*keys, "assembly", "linear", "solve, cpu")])
            print(*lines[-1], flush=True)
    same = [at_sizes(name, shape) for name in names for shape in sizes]
    beside = peers(sizes, 0.3)
    report.rows += [{"part": "sizes"} | row for row in same]
    report.rows += [{"part": "elements"} | row for row in beside]
    for row in [*same, *beside]:
        head = [row["scheme"], f"n {row['n']}", row["error"], None, None, None]
        tail = [row.get("assembly"), row.get("linear"), None]
        setup, solve = row.get("set-up"), row.get("solve", row["seconds"])
        lines.append([*head, None, None, setup, solve, *tail])
    for row in peers((FULL,), 0.0):
        report.rows.append({"part": "elements"} | row)
    judge(report, same, beside, quick)
    draw(report, same, beside)
    report.notes += [
        "places: where shape functions are evaluated, faces, boundary and nodes "
        "included; pairs: of places and nodes that reach them; blocks of K in the rows",
        "seconds: set-up is `prepare`; solve is `problem.solve`, of which assembly and "
        "linear are parts (run again on the host); 'first' with compilation; least of "
        "three; cpu: processor seconds of the solve, over all threads",
        "lines n: jitter .3, medians of 3 seeds, seconds of set-up and solve, warm",
        "elements: corners moved by .3 of an element, seconds of all but imports",
    ]
    head = ("scheme", "jitter", "u error", "sampled", "places", "pairs")
    head += ("set-up 1st", "solve 1st", "set-up", "solve", "assembly", "linear")
    report.finish((*head, "solve cpu"), lines)


def judge(
    report: Report, same: list[dict[str, Any]], beside: list[Any], quick: bool
) -> None:
    """Where the default stands."""
    beaten = front(same, "QCNI", RIVALS[1:])
    text = "QCNI on the front of error and time among V2-MNI, Q2-MNI: points beaten"
    report.claim(text, beaten, 0)
    if quick:
        return
    by_cells = front(same, "QCNI", CELLS)
    every = front(same, "QCNI", tuple(n for n in NAMES if n != "QCNI"))
    elements = front([*same, *beside], "QCNI", tuple(ELEMENTS))
    report.notes.append(
        f"of the {len(SIZES)} points of QCNI {by_cells} are beaten by cells (GI, QC3), "
        f"{every} by any other scheme, {elements} by finite elements"
    )
    own, other = (
        next(r for r in rows if r["scheme"] == name and r["n"] == 861)
        for rows, name in ((same, "QCNI"), (beside, "FE, 9-node"))
    )
    ratio = own["seconds"] / other["seconds"]
    report.claim("861 nodes: seconds of QCNI over 9-node elements", ratio, 1.0, ">=")
    ratio = own["error"] / other["error"]
    report.claim("861 nodes, jitter .3: u error of QCNI over theirs", ratio, 1.0)


def draw(report: Report, same: list[dict[str, Any]], beside: list[Any]) -> None:
    """Error against seconds, and against places."""
    figure, axes = plt.subplots(1, 3, figsize=(14, 4.5), layout="constrained")
    colours = {n: f"C{k}" if k < 10 else "k" for k, n in enumerate(NAMES)}
    for name in dict.fromkeys(r["scheme"] for r in [*same, *beside]):
        rows = [r for r in [*same, *beside] if r["scheme"] == name]
        x, y = ([r[k] for r in rows] for k in ("seconds", "error"))
        style = {"marker": "o", "ls": "-"}
        if name in CELLS:
            style = {"marker": "s", "ls": "--", "mfc": "none"}
        if name in ELEMENTS:
            style = {"marker": "^", "ls": ":"}
        thick = 2.2 if name == "QCNI" else 1.0
        colour = colours.get(name, "0.5")
        axes[0].loglog(x, y, label=name, c=colour, lw=thick, ms=4, **style)
    axes[0].set(xlabel="set-up and solve, warm (s)", title="91 to 861 nodes, jitter .3")
    axes[0].legend(fontsize=7, ncols=2)
    for axis, key in ((axes[1], "places"), (axes[2], "solve")):
        for row in report.rows:
            if row["part"] != "stages":
                continue
            name = row["scheme"]
            mark = "s" if name in CELLS else "o"
            full = colours[name] if row["jitter"] else "none"
            axis.loglog(row[key], row["error"], mark, c=colours[name], mfc=full)
            axis.annotate(name, (row[key], row["error"]), fontsize=6)
        label = "places evaluated" if key == "places" else "solve, warm (s)"
        axis.set(xlabel=label, title="861 nodes; filled: jitter .3; squares: cells")
    axes[0].set(ylabel="u error")
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
