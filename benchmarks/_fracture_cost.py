"""What slow fracture costs, by solver and by relaxation; for `fracture_static`."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from _report import Report

import jaxpd
from jaxpd.gallery.slow import notched_plate

#: Most that iterations may grow over those of the intact plate.
GROWTH = 2.0
#: Times that dynamic relaxation should take at least.
AIM = 5.0
#: Iterative ways through the same path.
WAYS = (
    ("multigrid", "stencil"),
    ("multigrid", "fft"),
    ("amg", "gather"),
    ("d-pcg", "stencil"),
)


def _counts(growth: Any) -> dict[str, Any]:
    """Iterations a solve until nine tenths of what breaks are broken."""
    broken = np.array([growth.broken_by(k).sum() for k in range(len(growth.factor))])
    some = broken[1:] - broken[0] <= 0.9 * (broken[-1] - broken[0])
    each = growth.cost["iterations"][1:][some]
    first = growth.cost["iterations"][0]
    return {
        "first": int(first),
        "median": float(np.median(each[each > 0])),
        "most": int(each.max()),
        "set-ups": int(growth.cost["factorisations"].sum()),
        "direct": growth.fallbacks["direct"],
    }


def _intact(scene: Any, solver: str, operator: str) -> int:
    """Iterations to 1e-10 for random forces on the plate without its notch.

    Its own load, which bends nothing, would take a quarter of that.
    """
    bare = dataclasses.replace(scene, cracks=(), no_fail=(), kinematics="small")
    problem = jaxpd.prepare(bare, solver=solver, operator=operator, rtol=1e-10)
    b = np.random.default_rng(0).normal(size=problem.X.shape)
    load = np.where(np.asarray(problem.fixed), 0.0, b)
    still = {"load": load, "prescribed": np.zeros_like(load)}
    _, info = problem.solve(problem.params | still)
    return int(info.linear_iterations[0])


def _warm(scene: Any, **how: Any) -> Any:
    """A path whose code has been compiled by a short one before."""
    short: dict[str, Any] = how | {"max_states": 3}
    jaxpd.solve_fracture(scene, **short)
    return jaxpd.solve_fracture(scene, **how)


def report_solvers(quick: bool) -> None:
    """The same exact path by each solver: iterations, seconds, agreement."""
    report, lines = Report("fracture_static_solvers", quick), []
    for columns in (20,) if quick else (40, 80):
        scene = notched_plate(3, columns, "grips", straight=False)
        exact = _warm(scene, solver="direct")
        seconds, made = exact.seconds["path"], exact.cost["factorisations"].sum()
        lines.append(["direct", "-", len(exact.X), len(exact.factor), 0, 0, 0, 0,
                      int(made), seconds, 1.0, 0.0])  # fmt: skip
        for solver, operator in WAYS[:2] if quick else WAYS:
            whole = _intact(scene, solver, operator)
            found = _warm(scene, solver=solver, operator=operator)
            count = _counts(found)
            n = min(len(found.factor), len(exact.factor))
            gap = np.abs(found.factor[1:n] / exact.factor[1:n] - 1.0).max()
            path = found.seconds["path"]
            lines.append([solver, operator, len(found.X), len(found.factor), whole,
                          count["first"], count["median"], count["most"],
                          count["set-ups"], path,
                          path / seconds, gap])  # fmt: skip
            report.rows.append(
                {"solver": solver, "operator": operator, "columns": columns,
                 "whole": int(whole), "seconds": path, "gap": float(gap)} | count
            )  # fmt: skip
            if solver in ("multigrid", "amg"):
                report.claim(
                    f"{solver}, {operator}, {columns} columns: most iterations over "
                    "those before any bond broke, until 90 % are broken",
                    count["most"] / count["first"],
                    GROWTH,
                )
            print(*lines[-1], flush=True)
    report.notes.append(
        "notched plate between grips, m = 3, free to fail anywhere, pulled apart; "
        "residuals to 1e-10, each solve from the last displacements; 'gap': load "
        "factors against the direct path; whole: iterations without the notch, under "
        "random forces; first: with it; ratio: seconds over the direct path's; code "
        "compiled before"
    )
    head = (
        "solver",
        "operator",
        "points",
        "states",
        "whole",
        "first",
        "median",
        "most",
    )
    report.finish([*head, "set-ups", "s", "ratio", "gap"], lines)


def report_relaxation(quick: bool) -> None:
    """The same load steps by dynamic relaxation, in the same run."""
    report, lines = Report("fracture_static_relaxation", quick), []
    for columns in (20,) if quick else (40, 80):
        scene = notched_plate(3, columns, "grips", straight=False)
        how: dict[str, Any] = {"factors": 0.02, "few": 1}
        if not quick:
            how["max_states"] = 400 if columns == 40 else 200
        ways: list[tuple[str, dict[str, Any]]] = [
            ("direct", {"solver": "direct"}),
            ("multigrid", {"solver": "multigrid", "operator": "stencil", "rtol": 1e-6}),
            (
                "relaxation",
                {
                    "solver": "relaxation",
                    "operator": "stencil",
                    "rtol": 1e-6,
                    "maxiter": 50_000,
                },
            ),
        ]
        found = {name: _warm(scene, **how, **way) for name, way in ways}
        last = found["relaxation"].seconds["path"]
        for name, growth in found.items():
            path = growth.seconds["path"]
            peak = growth.force[growth.accepted].max()
            peak /= found["direct"].force[found["direct"].accepted].max()
            solves = growth.cost["solves"].sum()
            each = growth.cost["iterations"].sum() / solves
            lines.append([name, len(growth.X), len(growth.factor),
                          int(solves), each, path, last / path,
                          np.abs(growth.balance).max(), peak - 1.0])  # fmt: skip
            report.rows.append(
                {"solver": name, "columns": columns, "states": len(growth.factor),
                 "seconds": path, "peak": float(peak)}
            )  # fmt: skip
            print(*lines[-1], flush=True)
            if name != "relaxation":
                report.claim(
                    f"{columns} columns: seconds of relaxation over those of {name}",
                    last / path,
                    AIM,
                    ">=",
                )
    report.notes.append(
        "load steps of 2 % of the first breaking factor, a tied group of bonds a pass; "
        "the same stiffness, residuals to 1e-6, each solve from the last displacements;"
        " the first states of the path; code compiled before. each: iterations a solve"
    )
    head = ("solver", "points", "states", "solves", "each", "s", "times faster")
    report.finish([*head, "balance", "peak off"], lines)
