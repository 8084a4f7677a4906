"""Error against time: what every problem of `work_precision` shares.

A problem has methods, a method has sizes. A job is timed whole, set-up and solve, warm;
what the first call takes beyond that is compilation. The error of a size counts as the
largest from that size on: one that changes sign is small by chance.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import numpy as np
from _report import Report

#: Errors at which the cheapest method is named.
LEVELS = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: Colours of a family, from the first method on; the peer is black.
COLOURS = {
    "bonds": (
        "#1f5f99",
        "#4f9bd9",
        "#123a5e",
        "#7fb6e6",
        "#2a86c7",
        "#0b2239",
        "#5f7f9f",
    ),
    "MLS": ("#c0392b", "#e67e22", "#8e2a20", "#f0a35e"),
    "RKPM": ("#2e8b57", "#79c267", "#14532d", "#a3b939"),
    "ghosts": ("#8e5ea2", "#c39bd3", "#5b2c6f"),
    "peer": ("#111111", "#777777", "#444444", "#aaaaaa"),
}
MARKERS, DASHES = "osD^vPX", ("-", "--", "-.", ":")
#: Seconds after which a job is not repeated, and most repeats.
ENOUGH, MOST = 1.5, 9


@dataclass(frozen=True)
class Job:
    """One method at one size.

    Attributes:
        call: set-up and solve; returns what `judge` takes.
        judge: error (-) and number of unknowns.
    """

    call: Callable[[], Any]
    judge: Callable[[Any], tuple[float, int]]


@dataclass(frozen=True)
class Method:
    """A way to solve a problem.

    Attributes:
        name: for the legend.
        family: of `COLOURS`; "peer" is not of this package.
        job: from a size to a `Job`.
        sizes: from coarse to fine.
        apart: why it is drawn but left out of the front and of the claims; "" is not.
        runs: how often the job would have to be run; its seconds are multiplied.
    """

    name: str
    family: str
    job: Callable[[Any], Job]
    sizes: Sequence[Any]
    apart: str = ""
    runs: int = 1


@dataclass(frozen=True)
class Problem:
    """A problem with a known answer.

    Attributes:
        name: of the files.
        title: for the figure.
        quantity: what the error is of.
        methods: all ways.
        peer_wins: whether the peer is expected to be cheaper at equal error; None where
            there is no peer of the same model.
        notes: what a reader must know.
        timed: what the time is of.
    """

    name: str
    title: str
    quantity: str
    methods: Sequence[Method]
    peer_wins: bool | None
    notes: Sequence[str] = ()
    timed: str = "set-up and solve"


def timed(job: Job) -> dict[str, float]:
    """Least wall and processor seconds, warm; seconds of compilation beyond."""
    begin = time.perf_counter()
    result = jax.block_until_ready(job.call())
    cold = time.perf_counter() - begin
    error, unknowns = job.judge(result)
    wall, cpu, begin = [], [], time.perf_counter()
    while len(wall) < MOST and (not wall or time.perf_counter() - begin < ENOUGH):
        start, ticks = time.perf_counter(), time.process_time()
        jax.block_until_ready(job.call())
        wall.append(time.perf_counter() - start)
        cpu.append(time.process_time() - ticks)
    seconds = min(wall)  # other jobs may run beside: what they take is left out
    return {
        "unknowns": int(unknowns),
        "error": float(error),
        "seconds": seconds,
        "cpu seconds": min(cpu),
        "compile s": max(0.0, cold - seconds),
    }


def measure(problem: Problem, quick: bool) -> Report:
    """Run all methods, say who wins, write the file."""
    report = Report(f"work_precision_{problem.name}", quick)
    for method in problem.methods:
        rows = []
        for size in method.sizes[:2] if quick else method.sizes:
            row = {"method": method.name, "family": method.family}
            row |= {"size": text_of(size), "apart": method.apart}
            row |= timed(method.job(size))
            for key in ("seconds", "cpu seconds"):
                row[key] *= method.runs
            rows.append(row)
            print(f"{problem.name}: {method.name}, {size}: ", end="", flush=True)
            print(f"{rows[-1]['error']:.2e}, {rows[-1]['seconds']:.3f} s", flush=True)
        report.rows += rows
        jax.clear_caches()
    finish(report, problem)
    return report


def text_of(size: Any) -> str:
    """A size in words."""
    return " x ".join(map(str, size)) if isinstance(size, tuple) else f"{size:g}"


def finish(report: Report, problem: Problem) -> None:
    """Settle the errors, claim who wins, write."""
    settle(report.rows)
    report.notes += problem.notes
    report.notes += [
        f"{m.name}: {m.apart}; not compared" for m in problem.methods if m.apart
    ]
    report.notes += [
        f"error: {problem.quantity}; counted as the largest from a size on",
        f"s: wall, {problem.timed}, warm, least of up to 9; cpu s: of all threads",
    ]
    name_winners(report, problem)
    head = ("method", "size", "unknowns", "error", "settled", "s", "cpu s", "compile s")
    keys = ("method", "size", "unknowns", "error", "settled", "seconds", "cpu seconds")
    lines = [[*(r[k] for k in keys), r["compile s"]] for r in report.rows]
    report.finish(head, lines)


def picture(problem: Problem, rows: list[dict[str, Any]], path: Path) -> None:
    """The figure of one problem."""
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(9.5, 5.2), layout="constrained")
    draw(axis, rows)
    axis.set(
        xlabel=f"wall time, {problem.timed}, warm (s)",
        ylabel=problem.quantity,
        title=problem.title,
    )
    figure.legend(
        *axis.get_legend_handles_labels(), loc="outside right upper", fontsize=9
    )
    figure.savefig(path, dpi=110)
    plt.close(figure)


def settle(rows: list[dict[str, Any]]) -> None:
    """Add the largest error of a method from a size on, and who is on the front."""
    for k, row in enumerate(rows):
        later = [r["error"] for r in rows[k:] if r["method"] == row["method"]]
        row["settled"] = max(later)
    fair = [r for r in rows if not r["apart"]]
    for row in rows:
        row["front"] = row in fair and not any(
            r["seconds"] < row["seconds"] and r["settled"] <= row["settled"]
            for r in fair
        )


def cheapest(rows: list[dict[str, Any]], level: float) -> dict[str, Any] | None:
    """The row of least time whose settled error is at most `level`."""
    enough = [r for r in rows if r["settled"] <= level and not r["apart"]]
    return min(enough, key=lambda r: r["seconds"], default=None)


def name_winners(report: Report, problem: Problem) -> None:
    """The cheapest method at each level, and the package beside its peer."""
    ours = [r for r in report.rows if r["family"] != "peer"]
    peers = [r for r in report.rows if r["family"] == "peer"]
    for level in LEVELS:
        mine, peer = cheapest(ours, level), cheapest(peers, level)
        text = [
            f"{r['method']} ({r['size']}) {r['seconds']:.3g} s" if r else "none"
            for r in (mine, peer)
        ]
        if mine or peer:
            best = f"error <= {level:g}: here {text[0]}"
            report.notes.append(best + (f"; peer {text[1]}" if peers else ""))
        if mine and peer and problem.peer_wins is not None:
            report.claim(
                f"error <= {level:g}: time of {mine['method']} over {peer['method']}",
                mine["seconds"] / peer["seconds"],
                1.0,
                ">=" if problem.peer_wins else "<=",
            )


def draw(axis: Any, rows: list[dict[str, Any]], size: float = 5.0) -> None:
    """Curves of all methods, a family a colour, and the front as a band."""
    front = sorted((r for r in rows if r["front"]), key=lambda r: r["seconds"])
    x, y = ([r[k] for r in front] for k in ("seconds", "settled"))
    axis.step(
        x, y, "-", where="post", color="#f7d64a", lw=3 * size / 2, alpha=0.7, zorder=1,
        label="Pareto front",
    )  # fmt: skip
    seen: dict[str, int] = {}
    for name in dict.fromkeys(r["method"] for r in rows):
        some = [r for r in rows if r["method"] == name]
        family = some[0]["family"]
        k = seen[family] = seen.get(family, -1) + 1
        colours = COLOURS[family]
        axis.plot(
            [r["seconds"] for r in some],
            [r["error"] for r in some],
            marker=MARKERS[k % len(MARKERS)],
            ls=DASHES[k % len(DASHES)],
            color=colours[k % len(colours)],
            ms=size,
            lw=0.3 * size,
            label=name + (" (not compared)" if some[0]["apart"] else ""),
            alpha=0.45 if some[0]["apart"] else 1.0,
            zorder=3 if family == "peer" else 2,
        )
    axis.set(xscale="log", yscale="log")
    axis.grid(which="major", alpha=0.3)


def off(found: Any, exact: Any) -> float:
    """Root mean square error over that of the exact values."""
    found, exact = np.asarray(found), np.asarray(exact)
    return float(np.linalg.norm(found - exact) / np.linalg.norm(exact))
