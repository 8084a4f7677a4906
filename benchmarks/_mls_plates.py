"""Plates of `paper_mls` against finite elements; elastic, nearly incompressible."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from _mls_follow import Followed, follow
from _plastic_peer import STEEL, Material, cook, quarter_hole, solve
from _report import Report
from scipy.interpolate import griddata

from jaxpd import MLS, prepare
from jaxpd.gallery import cook_panel, plate_with_hole, pressed_ring
from jaxpd.nodal import rough_of
from jaxpd.physics import Hooke, von_mises

#: Of the plate's quarter: shape, stretch (m); of the bodies that harden.
SHAPE, STRETCH = (17, 25), 0.004
#: Of the elastic ones.
GRIDS = ((11, 17), (13, 21), (15, 25), (17, 25), (21, 33))
HARD = Material(2.1e5, 0.3, 240.0, h_iso=2e3, h_kin=1e3)
PANEL = Material(70.0, 1 / 3, 0.243, h_iso=0.135, h_kin=0.015)
#: Shear of the panel; towards its limit load (some 1.9) displacements grow without
#: bound and say little.
FORCE = 1.2
POISSON = (0.3, 0.49, 0.499, 0.4999)


def begun(body: str, shape: tuple[int, int], tau: float, path: Followed) -> Any:
    """A row: how far a path came, and whether its displacements alternate."""
    row: dict[str, Any] = {
        "body": body,
        "shape": list(shape),
        "tau": tau,
        "completed": path.stopped is None,
        "iterations": path.iterations,
        "failed": path.failed,
        "seconds": path.seconds,
        "frames": len(path.u),
    }
    if len(path.u):
        row["rough"] = float(rough_of(path.problem.bare(), path.u[-1]))
    return row


def against(path: Followed, run: Any) -> dict[str, float]:
    """Displacements and peeq of the last frame beside finite elements."""
    last = len(path.u) - 1
    want = run.displacement(path.X, last)
    peeq = griddata(run.points, run.peeq[last], path.X)
    inside = np.isfinite(peeq)
    off = np.linalg.norm((path.peeq[-1] - peeq)[inside])
    scale = np.linalg.norm(peeq[inside])
    return {
        "u error": float(np.linalg.norm(path.u[-1] - want) / np.linalg.norm(want)),
        "peeq error": float(off / scale) if scale else 0.0,
        "peeq max": float(path.peeq[-1].max()),
        "peeq max FE": float(run.peeq[last].max()),
    }


def law_of(m: Material) -> Any:
    """The same in plane stress."""
    return von_mises(m.E, m.nu, m.sigma_y, m.h_iso, m.h_kin, state="plane stress")


def hole(
    shape: tuple[int, int], m: Material, tau: float, factors: np.ndarray, run: Any
) -> tuple[dict[str, Any], np.ndarray]:
    """The plate with a hole; and its load over gross width and yield stress [F]."""
    scene = plate_with_hole(shape, STRETCH, law=law_of(m), resolution=MLS(tau=tau))
    path = follow(scene, factors, halvings=3 if tau else 1)
    load = path.pull(path.X[:, 1] > 1 - 1e-9, 1) / m.sigma_y
    section = -path.pull(path.X[:, 1] < 1e-9, 1) / m.sigma_y
    row = begun("hole" if m is STEEL else "hole, hardening", shape, tau, path)
    if len(path.u):
        row |= {
            "load": float(load[-1]),
            "section": float(section[-1]),
            "load FE": float(run.reaction("top")[len(path.u) - 1, 1] / m.sigma_y),
        } | against(path, run)
    return row, load


def elastic(report: Report) -> None:
    """Elastic plates with a hole: roughness by grid, width of stars, and grading."""
    law = Hooke(STEEL.E, STEEL.nu, "plane stress")
    for name, grading in (("graded", 1.3), ("even", 0.0)):
        most = {}
        for shape in GRIDS:
            for width in (4.1, 5.1):
                how = MLS(rim_support=width)
                scene = plate_with_hole(
                    shape, 2e-4, grading=grading, law=law, resolution=how
                )
                path = follow(scene, [1.0], halvings=0)
                row = begun(f"hole, elastic, {name}", shape, how.tau, path)
                row |= {"rim support": width}
                row["load"] = float(path.pull(path.X[:, 1] > 1 - 1e-9, 1)[-1])
                row["section"] = float(-path.pull(path.X[:, 1] < 1e-9, 1)[-1])
                report.rows.append(row)
                most[width] = max(most.get(width, 0.0), row["rough"])
        if grading:
            report.claim("hole, elastic, graded: rough", most[4.1], 1e-3)
        text = ", ".join(f"{r:.2g} with rim_support {w}" for w, r in most.items())
        report.notes.append(f"elastic, {name} cells: most rough {text}")


def panel(shape: tuple[int, int], run: Any) -> dict[str, Any]:
    """Cook's panel, hardening, plane stress: the corner (48, 60)."""
    shares = [1 / 3, 2 / 3, 1.0]
    path = follow(cook_panel(shape, FORCE, law=law_of(PANEL)), shares, halvings=3)
    row = begun("Cook", shape, MLS().tau, path)
    if len(path.u):
        last = len(path.u) - 1
        tip = int(np.argmin(((path.X - [48.0, 60.0]) ** 2).sum(axis=1)))
        force = path.pull(path.X[:, 0] < 1e-9, 1)[-1]
        row |= {
            "load": float(-force / (FORCE * shares[last])),
            "load FE": 1.0,
            "tip": float(path.u[-1, tip, 1]),
            "tip FE": float(run.displacement([[48.0, 60.0]], last)[0, 1]),
        } | against(path, run)
    return row


def report_plates(quick: bool) -> None:
    """Perfectly plastic and hardening plates."""
    report = Report("paper_mls_plates", quick)
    steps = 5 if quick else 20
    factors = np.arange(1, steps + 1) / steps
    fixed = [("bottom", 1, 0.0), ("left", 0, 0.0), ("top", 1, STRETCH)]
    mesh = quarter_hole(12, 24)
    run = solve(mesh, STEEL, fixed, [], factors, plane="stress")
    figure, axis = plt.subplots(figsize=(5, 4), layout="constrained")
    axis.plot(factors, run.reaction("top")[:, 1] / STEEL.sigma_y, "k", label="FE")
    for tau in (0.3,) if quick else (0.3, 0.0):
        row, load = hole(SHAPE, STEEL, tau, factors, run)
        report.rows.append(row)
        axis.plot(factors[: len(load)], load, "o-", ms=3, label=f"tau = {tau}")
        name = f"hole, tau = {tau}"
        if tau:
            report.claim(f"{name}: completed", row["completed"], 1.0, ">=")
            for key in ("load", "section"):
                value = row.get(key, np.nan)
                report.claim(f"{name}: limit, {key}", value, (0.69, 0.71), "within")
            report.claim(f"{name}: rough", row.get("rough", np.nan), 0.05)
            report.claim(f"{name}: iterations", max(row["iterations"], default=0), 10)
    if not quick:
        elastic(report)
        held = [("left", 0, 0.0), ("left", 1, 0.0)]
        load = [("right", (0.0, FORCE / 16.0))]
        run = solve(cook(24, 24), PANEL, held, load, [1 / 3, 2 / 3, 1], plane="stress")
        few = np.arange(1, 6) / 5
        hard = solve(mesh, HARD, fixed, [], few, plane="stress")
        for shape in ((11, 17), (15, 25)):
            report.rows.append(hole(shape, HARD, 0.3, few, hard)[0])
        for shape in ((13, 13), (21, 21)):
            report.rows.append(panel(shape, run))
        for body in ("hole, hardening", "Cook"):
            rows = [r for r in report.rows if r["body"] == body]
            errors = [r.get("u error", np.nan) for r in rows]
            report.claim(f"{body}: u error, finer nodes", errors[-1], 2e-2)
            report.claim(f"{body}: finer over coarser", errors[1] / errors[0], 1.0)
            off = abs(rows[-1].get("load", np.nan) / rows[-1].get("load FE", 1.0) - 1)
            report.claim(f"{body}: load, finer nodes, relative", off, 2e-2)
    axis.axhline(0.7, ls=":", c="k")
    axis.set(xlabel="share of the stretch", ylabel="load over gross width, sigma_y")
    axis.legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    report.notes.append(
        "load: of a hole the pull at the top over gross width and yield stress, of "
        "Cook's panel the clamped edge's over what was applied; u, peeq errors: root "
        "mean square over nodes, relative to finite elements (8-node, 12 x 24; 24 x "
        "24); rough: rms of (1 - Phi)^2 u over that of u; elastic, even: all cells as "
        "long, more than twice as long as wide at the hole; load and section in N"
    )
    keys = ("body", "shape", "tau", "rim support", "frames", "failed", "load")
    keys = (
        *keys,
        "section",
        "load FE",
        "tip",
        "tip FE",
        "rough",
        "u error",
        "peeq error",
        "peeq max",
    )
    keys = (*keys, "peeq max FE", "seconds")
    lines = [
        [max(r["iterations"], default=0), *(r.get(k) for k in keys)]
        for r in report.rows
    ]
    report.finish(("its", *keys), lines)


def report_volume(quick: bool) -> None:
    """Lame's ring where it is nearly incompressible."""
    report, lines = Report("paper_mls_volume", quick), []
    figure, axis = plt.subplots(figsize=(5, 4), layout="constrained")
    for volume in ("nodal", "projected"):
        for jitter in (0.0,) if quick else (0.0, 0.3):
            made = pressed_ring(
                (11, 25),
                60.0,
                jitter=jitter,
                seed=200,
                law=Hooke(2.1e5, 0.3, "plane strain"),
                resolution=MLS(volume=volume),
            )
            problem = prepare(made)
            X = np.asarray(problem.X)
            r = np.linalg.norm(X, axis=1, keepdims=True)
            errors = []
            for nu in POISSON:
                law = Hooke(2.1e5, nu, "plane strain")
                u, info = problem.solve(problem.params | {"law": law})
                radial = 60.0 / 3 * (1 + nu) / 2.1e5 * ((1 - 2 * nu) * r + 4 / r)
                want = radial * X / r
                off = np.asarray(u) - want
                errors.append(float(np.linalg.norm(off) / np.linalg.norm(want)))
                row = {"volume": volume, "jitter": jitter, "nu": nu}
                row |= {"u error": errors[-1], "status": int(info.status)}
                report.rows.append(row)
            lines.append([volume, jitter, *errors])
            axis.loglog(
                [0.5 - nu for nu in POISSON],
                errors,
                "o-" if volume == "projected" else "s--",
                label=f"{volume}, jitter {jitter}",
            )
            if volume == "projected":
                text = f"projected, jitter {jitter}: worst u error"
                report.claim(text, max(errors), 2e-2)
    axis.set(xlabel="1/2 - nu", ylabel="u error")
    axis.legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    report.finish(("volume", "jitter", *(f"nu = {nu}" for nu in POISSON)), lines)
