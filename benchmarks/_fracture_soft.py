"""Calibrated toughness and softening bonds; parts of `fracture_static`."""

from __future__ import annotations

from typing import Any

import numpy as np
from _report import Report

import jaxpd
from jaxpd import gallery
from jaxpd.fracture.measures import cantilever_figures
from jaxpd.geometry import box


def beam(m: int, columns: int, **how: Any) -> tuple[Any, Any]:
    """A double cantilever whose crack grows by some columns, and its figures."""
    scene: Any = gallery.double_cantilever(m)
    (L, H), h = scene.body.hi, scene.resolution.dx
    end = box((gallery.notch_of(scene) + columns * h, -H), (L, H))
    growth = jaxpd.solve_fracture(scene, end=end, **how)
    return growth, cantilever_figures(growth)


def calibrated(report: Report, quick: bool) -> None:
    """G / G0 once the trapping that a strip of the lattice shows is divided out."""
    for m in (3,) if quick else (3, 4):
        scene = gallery.double_cantilever(m)
        trapped = jaxpd.trapping(scene)
        _, found = beam(m, 12 if quick else 20, toughness=trapped.dissipated)
        report.rows.append(
            {"part": "calibrated", "case": f"m = {m}", "G_diss": found["dissipated"],
             "G_env": found["envelope"], "G_bond": found["bonds"]}
        )  # fmt: skip
        report.claim(
            f"G_diss, dcb m = {m}, calibrated on a strip ({trapped.dissipated:.3f})",
            found["dissipated"],
            (0.97, 1.03),
            "within",
        )


def softening(report: Report, quick: bool) -> None:
    """Bilinear bonds: G over the lattice's own, steps twice and half as long."""
    for m in (3,) if quick else (3, 4):
        growth, found = beam(m, 12 if quick else 20, softening=10.0)
        lattice = {3: 0.947, 4: 0.951}[m]
        _row(report, "softening", f"dcb, m = {m}", growth, found)
        off = found["dissipated"] / lattice - 1.0
        report.claim(f"G over the lattice's, softening dcb m = {m}, off",
                     abs(off), 0.02)  # fmt: skip
        if quick or m > 3:
            continue
        amount = float(np.median(np.diff(growth.released)[5:-1]))
        G = []
        for share in (0.5, 1.0, 2.0):
            one, figures = beam(m, 20, softening=10.0, amount=share * amount)
            _row(report, "softening", f"dcb, m = {m}, {share:g} x", one, figures)
            G.append(figures["dissipated"])
        report.claim("G of softening dcb, steps halved and doubled, apart",
                     max(G) / min(G) - 1.0, 0.01)  # fmt: skip
    if quick:
        return
    scene = gallery.notched_plate(3, 40, "grips")
    for factors in (None, 0.05, 0.2):
        growth = jaxpd.solve_fracture(scene, softening=10.0, factors=factors)
        _row(report, "softening", f"plate, factors {factors}", growth, {})
        steps = len(growth.factor) - 1
        ways = ", ".join(f"{k} {v}" for k, v in growth.fallbacks.items() if v)
        report.notes.append(
            f"softening plate, factors {factors}: {steps} steps, {ways or 'no way out'}"
        )
        report.claim(f"came to its end, softening plate, factors {factors}",
                     growth.done, 1.0, ">=")  # fmt: skip


def _row(report: Report, part: str, case: str, growth: Any, found: Any) -> None:
    worst = float(np.abs(growth.balance).max())
    report.rows.append(
        {"part": part, "case": case, "points": len(growth.X),
         "states": len(growth.factor), "seconds": growth.seconds["path"],
         "solves": int(growth.cost["solves"].sum()),
         "factorisations": int(growth.cost["factorisations"].sum()),
         "balance": worst, "peak": float(growth.factor[growth.peak]),
         "broken": int(growth.broken.sum()), "end": growth.stopped.split(":")[0],
         "G_diss": found.get("dissipated"), "G_env": found.get("envelope"),
         "P/P_beam": found.get("force")}
    )  # fmt: skip
    report.claim(f"energy balance, {part} {case}", worst, 0.01)
