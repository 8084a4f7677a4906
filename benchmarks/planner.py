"""The planner against the clock: is its choice the best, and its time the true one?

Every scene is run in every way that would do, each in a fresh process; processor
seconds, compilation included. A prediction counts where no constant was fitted to the
scene. Paths of slow fracture are compared over 40 states by each solver, and predicted
whole.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np
from _plan_cases import CASES, Case
from _report import Report, asked_part, fresh, is_quick

import jaxpd

jax.config.update("jax_enable_x64", True)

HEAD = (
    "scene",
    "job",
    "choice",
    "s",
    "best way",
    "s",
    "over best",
    "predicted s",
    "over measured",
    "MB",
    "predicted MB",
)
QUICK = ("cracked plate 48, m = 4, small",)


def run(case: Case, way: dict[str, Any]) -> Any:
    """One scene in one way."""
    scene, how = case.make(), dict(case.how)
    if case.job == "static":
        return jaxpd.solve_static(scene, **how, **way).checked()
    if case.job == "motion":
        return jaxpd.run_explicit(scene, how.pop("duration"), **how, **way).checked()
    if case.job == "path":
        return jaxpd.solve_path(scene, how.pop("times"), **how, **way).checked()
    return jaxpd.solve_fracture(scene, **how, **way)


def measured(scene: str, way: dict[str, Any]) -> dict[str, Any]:
    """Seconds and memory of one scene in one way, in this process."""
    jax.block_until_ready(jax.numpy.ones(3) + 1)
    wall, cpu = time.perf_counter(), time.process_time()
    try:
        run(CASES[scene], way)
        failed = None
    except (jaxpd.NotConverged, ValueError) as error:  # a way that is not open
        failed = str(error)
    return {
        "wall": time.perf_counter() - wall,
        "cpu": time.process_time() - cpu,
        "bytes": highest_memory(),
        "failed": failed,
    }


def highest_memory() -> int | None:
    """Highest resident memory of this process alone (bytes), where Linux tells it.

    `ru_maxrss` is no use here: a fresh process begins with that of its parent.
    """
    status = Path("/proc/self/status")
    if not status.exists():
        return None
    lines = status.read_text().splitlines()
    (found,) = [line.split()[1] for line in lines if line.startswith("VmHWM")]
    return int(found) * 1024


def planned(case: Case) -> Any:
    """The plan of a case."""
    asked = {k: v for k, v in case.how.items() if k in ("duration", "times")}
    return jaxpd.plan(case.make(), case.job, **asked)


def main() -> None:
    """Run every scene in every way, compare with the plans."""
    quick = is_quick(__doc__)
    report, lines = Report("planner", quick), []
    for name, case in CASES.items():
        if quick and name not in QUICK:
            continue
        plan = planned(case)
        runs: list[Any] = [
            {"way": way} | fresh(__file__, "run", scene=name, way=way)
            for way in case.ways
        ]
        runs = [r for r in runs if r["failed"] is None]
        best = min(runs, key=lambda r: r["cpu"])
        same = [r for r in runs if _agrees(plan, r["way"])]
        ours = min(same, key=lambda r: r["cpu"]) if same else None
        row = {
            "scene": name,
            "job": case.job,
            "gallery": case.gallery,
            "held back": case.held_back,
            "choice": plan.as_dict()["choice"],
            "predicted": plan.cost.seconds,
            "predicted bytes": plan.cost.bytes,
            "runs": runs,
            "over best": ours["cpu"] / best["cpu"] if ours else None,
            "over measured": plan.cost.seconds / (ours or best)["cpu"],
            "memory over measured": _ratio(plan.cost.bytes, (ours or best)["bytes"]),
        }
        report.rows.append(row)
        cut = "max_states" in case.how
        lines.append(
            [
                name,
                case.job,
                _way(ours["way"]) if ours else "not among them",
                (ours or best)["cpu"],
                _way(best["way"]),
                best["cpu"],
                row["over best"],
                None if cut else plan.cost.seconds,
                None if cut else row["over measured"],
                _mega((ours or best)["bytes"]),
                plan.cost.bytes / 2**20,
            ]
        )
    add_claims(report)
    report.finish(HEAD, lines)


def _agrees(plan: Any, way: dict[str, Any]) -> bool:
    return all(plan.options.get(name, value) == value for name, value in way.items())


def _ratio(predicted: float, size: int | None) -> float | None:
    return None if size is None else predicted / size


def _mega(size: int | None) -> float | None:
    return None if size is None else size / 2**20


def _way(way: dict[str, Any]) -> str:
    return " ".join(map(str, way.values()))


def add_claims(report: Report) -> None:
    """Claims of the issue: choices near the best, predictions near the truth."""
    choices = [r["over best"] for r in report.rows if r["gallery"]]
    near = np.mean([x is not None and x <= 1.5 for x in choices])
    report.claim(
        f"share of {len(choices)} scenes of the gallery whose choice takes at most 1.5 "
        "times the best way",
        float(near),
        0.9,
        ">=",
    )
    ratios = [
        r["over measured"]
        for r in report.rows
        if r["held back"] and "40 states" not in r["scene"]
    ]
    if ratios:
        off = [max(x, 1 / x) for x in ratios]
        report.claim(
            f"predicted over measured time of {len(off)} scenes that calibrated "
            "nothing, worst factor",
            max(off),
            3.0,
        )
        report.claim("the same, median factor", float(np.median(off)), 1.5)
    found = [r["memory over measured"] for r in report.rows if r["held back"]]
    sizes = [max(x, 1 / x) for x in found if x is not None]
    if sizes:
        text = f"predicted over measured memory of {len(sizes)} of them, worst factor"
        report.claim(text, max(sizes), 1.6)
    report.notes.append(
        "processor seconds of fresh processes, imports apart, compilation included"
    )


if __name__ == "__main__":
    part = asked_part()
    if part is None:
        main()
    else:
        print(json.dumps(measured(part["scene"], part["way"])))
