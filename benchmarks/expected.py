"""Errors that the planner expects, beside those that are made.

Rectangles of four shapes, clamped or on a roller, bent, pulled, heavy or hanging, at
Poisson's ratios up to 0.499, in every theory that can and at two spacings; quadratic
elements on 32 cells across are the truth. The error is the root mean square over the
points, over that of the displacements. Some scenes set the constants of
`jaxpd.planner.error`, others are held back: shapes and ratios that none was fitted to,
though their errors were seen.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from _report import Report, is_quick
from _wp_fe import grid, lame, solve
from scipy.interpolate import RegularGridInterpolator

import jaxpd

jax.config.update("jax_enable_x64", True)

FORCE = 1e-6
#: Cells of the elements over the shorter side.
ACROSS = 32
#: Length and height; clamped on the left, of length x.
SHAPES = ((2.0, 1.0), (1.0, 4.0), (1.0, 1.0), (6.0, 0.5))
#: Supports and loads. A roller's pin carries nothing: displacements under a point's
#: force are infinite.
HOW = (
    ("clamped", "bent"),
    ("clamped", "pulled"),
    ("clamped", "heavy"),
    ("roller", "hanging"),
)
CONSTANTS = (
    (1 / 3, "plane stress"),
    (0.45, "plane strain"),
    (0.49, "plane strain"),
    (0.499, "plane strain"),
)
#: What no constant was fitted to.
HELD_SHAPES, HELD_CONSTANTS = ((1.0, 1.0), (6.0, 0.5)), ((0.49, "plane strain"),)
HEAD = (
    "theory",
    "fitted or held back",
    "models",
    "worst error over expected",
    "95 %",
    "median",
    "least",
)


def loads_of(shape: tuple[float, float], load: str) -> list[Any]:
    """The loads of a case."""
    right = jaxpd.above(x=shape[0])
    if load == "bent":
        return [jaxpd.traction(right, y=FORCE)]
    if load == "pulled":
        return [jaxpd.traction(right, x=FORCE)]
    axis: Any = {"x" if load == "hanging" else "y": FORCE}
    return [jaxpd.body_force(jaxpd.below(x=shape[0] + 1.0), **axis)]


def scene_of(
    shape: tuple[float, float],
    support: str,
    load: str,
    constants: tuple[float, str],
    resolution: Any,
) -> Any:
    """A rectangle, held on the left."""
    held = [jaxpd.holds(jaxpd.below(x=0.0))]
    if support == "roller":
        pin = jaxpd.ball((0.0, 0.0), 1e-6)
        held = [jaxpd.moves(jaxpd.below(x=0.0), x=0.0), jaxpd.moves(pin, y=0.0)]
    return jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), shape),
        material=jaxpd.Elastic(1.0, *constants),
        supports=held,
        loads=loads_of(shape, load),
        resolution=resolution,
        kinematics="small",
    )


@functools.cache
def truth(
    shape: tuple[float, float], support: str, load: str, constants: tuple[float, str]
) -> Any:
    """Displacements at places, by quadratic elements."""
    h = min(shape) / ACROSS
    cells = (round(shape[0] / h), round(shape[1] / h))
    zero = lambda X: np.zeros(len(X))  # noqa: E731
    held: list[Any] = [(lambda x: x[0] < 1e-9, 0, zero)]
    if support == "clamped":
        held.append((lambda x: x[0] < 1e-9, 1, zero))
    else:
        held.append((lambda x: x[0] + x[1] < 1e-9, 1, zero))
    axis = 0 if load in ("pulled", "hanging") else 1

    def force(X: np.ndarray) -> np.ndarray:
        return FORCE * (np.arange(2) == axis) * np.ones((len(X), 1))

    found = solve(
        grid(cells, shape),
        2,
        lame(1.0, *constants),
        held,
        [] if load[0] == "h" else [(lambda x: x[0] > shape[0] - 1e-9, force)],
        force if load[0] == "h" else None,
    )
    axes = [np.linspace(0.0, s, 2 * n + 1) for s, n in zip(shape, cells, strict=True)]
    at = np.rint(found.X / (0.5 * h)).astype(int)
    u = np.full((2 * cells[0] + 1, 2 * cells[1] + 1, 2), np.nan)
    u[at[:, 0], at[:, 1]] = found.u
    assert np.isfinite(u).all()
    return RegularGridInterpolator(axes, u, method="linear")


def resolutions(
    shape: tuple[float, float], support: str, constants: tuple[float, str]
) -> Iterator[tuple[str, Any]]:
    """Theories and what is tried of each."""
    side = min(shape)
    for n in (4, 8):
        yield "kernels", jaxpd.RKPM(dx=side / n)
    for n in (8, 16):
        yield "MLS difference", jaxpd.MLS(dx=side / n)
    if constants[1] == "plane stress" and support == "clamped":
        one = {"dx": side / 16, "m": 3, "nodes": "cell"}
        for correction in ("energy", "fictitious"):
            yield f"bonds, {correction}", jaxpd.Bonds(correction=correction, **one)
        yield "bonds, lattice", jaxpd.Bonds(calibration="lattice", **one)


def measured(case: Any, resolution: Any) -> tuple[float, float] | None:
    """The error made and that expected; None if the solve failed."""
    plan = jaxpd.plan(scene_of(*case, resolution=resolution))
    solution = plan.run()
    if solution.status is not jaxpd.Status.CONVERGED:
        return None
    X, u = np.asarray(solution.X), np.asarray(solution.u)
    inside = ((X > -1e-9) & (np.array(case[0]) + 1e-9 > X)).all(axis=1)
    exact = truth(*case)(np.clip(X[inside], 0.0, case[0]))
    assert plan.error is not None
    error = np.linalg.norm(u[inside] - exact) / np.linalg.norm(exact)
    return float(error), plan.error


def main() -> None:
    """Measure all and print the ratios by theory."""
    quick = is_quick(__doc__)
    report = Report("expected", quick)
    cases = [(a, *b, c) for a, b, c in itertools.product(SHAPES, HOW, CONSTANTS)]
    cases = cases[:1] if quick else cases
    for case in cases:
        shape, support, load, constants = case
        held = shape in HELD_SHAPES or constants in HELD_CONSTANTS
        for theory, resolution in resolutions(shape, support, constants):
            found = measured(case, resolution)
            report.rows.append(
                {
                    "shape": shape,
                    "support": support,
                    "load": load,
                    "constants": constants,
                    "theory": theory,
                    "cells": round(min(shape) / resolution.dx),
                    "held back": held,
                    "error": found and found[0],
                    "expected": found and found[1],
                }
            )
    lines = []
    for theory in dict.fromkeys(r["theory"] for r in report.rows):
        for held in (False, True):
            ratios = over_expected(report, held, theory)
            if ratios:
                line = [theory, "held back" if held else "fitted", len(ratios)]
                line += [float(np.max(ratios)), float(np.percentile(ratios, 95))]
                line += [float(np.median(ratios)), float(np.min(ratios))]
                lines.append(line)
    add_claims(report)
    report.finish(HEAD, lines)


def over_expected(report: Report, held: bool, theory: str = "") -> list[float]:
    """Errors over those expected, of a theory or of all."""
    return [
        r["error"] / r["expected"]
        for r in report.rows
        if r["held back"] == held and r["error"] and theory in ("", r["theory"])
    ]


def add_claims(report: Report) -> None:
    """Errors are bounded, of what was held back too."""
    for held in (False, True):
        ratios = over_expected(report, held)
        if not ratios:
            continue
        kind = "that were held back" if held else "that set the constants"
        text = (
            f"share of {len(ratios)} models {kind} whose error is at most the expected"
        )
        report.claim(text, float(np.mean(np.array(ratios) <= 1.0)), 0.9, ">=")
        report.claim("the worst of them, error over expected", max(ratios), 2.0)
    failed = sum(r["error"] is None for r in report.rows)
    report.claim("solves that failed", failed, 0)


if __name__ == "__main__":
    main()
