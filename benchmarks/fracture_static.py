"""Quasi-static fracture of brittle bonds, event by event, against what was measured.

Parts, each a function of (report, quick) that adds rows and claims and may draw:

    dcb     double cantilevers: release rates over G0 and force over beam theory
    notch   edge notches under stress: highest K over sqrt(E G0), and its limit
    scenes  every specimen of the gallery to its end, with its cost
    calibrated  release rates with the trapping of the lattice divided out
    softening   bilinear bonds: release rates, steps, ways out

and two reports of their own: the solvers' cost, and dynamic relaxation's.
"""

from __future__ import annotations

import time
from typing import Any

import jax
import numpy as np
from _fracture_cost import report_relaxation, report_solvers
from _fracture_soft import calibrated, softening
from _report import Report, is_quick

import jaxpd
from jaxpd import gallery, plot
from jaxpd.fracture.measures import cantilever_figures, straight_cuts, toughness
from jaxpd.geometry import box, segment

jax.config.update("jax_enable_x64", True)

HEAD = (
    "part", "case", "points", "states", "solves", "factorisations", "seconds",
    "balance", "G_bond", "G_diss", "G_env", "P/P_beam", "C/C_beam", "K/Kc", "peak",
    "broken", "end",
)  # fmt: skip
#: Of double cantilevers: arms over the horizon, length over an arm, columns of growth,
#: and (value, half width) of G_bond, G_diss, G_env and P / P_beam.
CANTILEVERS = {
    3: (4, 9, 20, (0.947, 0.0095), (1.15, 0.03), (1.30, 0.05), (1.21, 0.04)),
    4: (4, 9, 20, (0.951, 0.0095), (1.05, 0.02), (1.19, 0.03), (1.13, 0.02)),
    5: (3, 6, 15, (0.982, 0.0098), (1.037, 0.02), (1.154, 0.03), (1.085, 0.02)),
    6: (3, 6, 15, (0.978, 0.0098), (1.01, 0.02), (1.06, 0.03), (1.02, 0.02)),
}
NAMES = ("bonds", "dissipated", "envelope", "force")
#: Of edge notches: m, columns, states, K / Kc that was measured.
NOTCHES = (
    (3, 40, 15, 1.094), (4, 48, 30, 0.973), (6, 48, 60, 0.867), (3, 20, 15, None),
    (3, 80, 15, None), (4, 96, 30, None),
)  # fmt: skip


def run(report: Report, part: str, case: str, scene: Any, **how: Any) -> Any:
    """Break a scene, and add its row."""
    started = time.perf_counter()
    growth = jaxpd.solve_fracture(scene, **how)
    worst = float(np.abs(growth.balance).max())
    solves = {k: float(np.sum(v)) for k, v in growth.cost.items()}
    kept = dict.fromkeys(HEAD) | {
        "part": part,
        "case": case,
        "points": len(growth.X),
        "states": len(growth.factor),
        "seconds": time.perf_counter() - started,
        "balance": worst,
        "peak": float(growth.factor[growth.peak]),
        "broken": int(growth.broken.sum()),
        "end": growth.stopped.split(":")[0],
    }
    kept |= {k: int(solves[k]) for k in ("solves", "factorisations") if k in solves}
    report.rows.append(kept)
    report.claim(f"energy balance, {part} {case}", worst, 1e-10)
    return growth


def dcb(report: Report, quick: bool) -> Any:
    """Double cantilevers, m = 3 to 6."""
    drawn = None
    for m, (arm, length, columns, *bands) in CANTILEVERS.items():
        if quick and m > 3:
            break
        scene: Any = gallery.double_cantilever(m, arm, length)
        (L, H), h = scene.body.hi, scene.resolution.dx
        end = box((gallery.notch_of(scene) + columns * h, -H), (L, H))
        growth = run(report, "dcb", f"m = {m}", scene, end=end)
        found = cantilever_figures(growth)
        low, high = found["compliance"]
        row = report.rows[-1]
        row |= dict(
            zip(
                ("G_bond", "G_diss", "G_env", "P/P_beam"),
                (found[name] for name in NAMES),
                strict=True,
            )
        )
        row["C/C_beam"] = 0.5 * (low + high)
        for name, (value, width) in zip(NAMES, bands, strict=True):
            band = (value - width, value + width)
            report.claim(f"{name}, dcb m = {m}", found[name], band, "within")
        if arm == 4:
            off = max(abs(low - 1.0), abs(high - 1.0))
            report.claim(f"compliance off, dcb m = {m}", off, {3: 0.02, 4: 0.03}[m])
        drawn = drawn or (growth, found)
    return drawn


def notch(report: Report, quick: bool) -> None:
    """Edge notches under stress, only bonds across the plane of the notch may fail."""
    weak = {}
    for m, columns, states, known in NOTCHES[:1] if quick else NOTCHES:
        scene: Any = gallery.notched_plate(m, columns)
        E, G0, W = scene.material.E, scene.material.G0, scene.body.hi[0]
        case = f"m = {m}, W/h = {columns}"
        a0, h = gallery.notch_of(scene), scene.resolution.dx
        growth = run(report, "notch", case, scene, max_states=states)
        K = gallery.edge_notch_K(1e6 * growth.factor, a0, W) / np.sqrt(E * G0)
        report.rows[-1]["K/Kc"] = weak[m, columns] = float(K.max())
        if known is not None:
            band = (0.85 * known, 1.15 * known)
            report.claim(f"peak K / Kc, {case}", K.max(), band, "within")
        if known is None or quick or m > 4:
            continue
        # release rates along the ligament
        end = box((a0 + 12 * h, -W), (W, W))
        growth = run(report, "notch", f"{case}, on", scene, end=end)
        lengths = a0 + h * np.arange(0, 19, 2)
        curve = straight_cuts(growth, segment((0.0, 0.0), (W, 0.0)), lengths)
        found = toughness(growth, curve, G0, h, (a0 + 3 * h, a0 + 11 * h))
        report.rows[-1] |= {
            "G_bond": found.bonds,
            "G_diss": found.dissipated,
            "G_env": found.envelope,
        }
    if not quick:
        for m, coarse in ((3, 40), (4, 48)):
            # K^-2 is linear in h / a
            limit = 2.0 * weak[m, 2 * coarse] ** -2 - weak[m, coarse] ** -2
            report.notes.append(
                f"m = {m}: peak K / Kc for notches long against h, extrapolated: "
                f"{limit**-0.5:.3f}"
            )


def scenes(report: Report, quick: bool) -> dict[str, Any]:
    """Specimens of the gallery to their ends."""
    size = 20 if quick else 40
    cases = {
        "plate, stress": gallery.notched_plate(3, size),
        "plate, grips": gallery.notched_plate(3, size, "grips", straight=False),
        "compact tension": gallery.compact_tension(3, size),
        "bent beam": gallery.bent_beam(3, 12 if quick else 24),
        "sheared plate": gallery.sheared_plate(3, size),
        "L-panel": gallery.l_panel(3, size // 2),
        "plate of paper 000": gallery.breaking_plate(size + 1),
    }
    if quick:
        some = ("plate, grips", "compact tension", "L-panel")
        cases = {case: cases[case] for case in some}
    else:
        cases = {"double cantilever": gallery.double_cantilever(3)} | cases
        cases["L-panel, n = 40"] = gallery.l_panel(3, 40)
        cases["sheared plate, m = 4"] = gallery.sheared_plate(4, 60)
    found = {}
    for case, scene in cases.items():
        growth = run(report, "scenes", case, scene, end=gallery.end_of(scene))
        report.claim(f"came to its end, {case}", growth.done, 1.0, ">=")
        found[case] = growth
    return found


PARTS = {
    "dcb": dcb,
    "notch": notch,
    "scenes": scenes,
    "calibrated": calibrated,
    "softening": softening,
}


def draw(report: Report, beam: Any, grown: dict[str, Any]) -> None:
    """Load against opening of a double cantilever, and broken bonds of the scenes."""
    growth, found = beam
    scene = growth.scene
    H, E, G0 = scene.body.hi[1], scene.material.E, scene.material.G0
    columns = 5
    rows = -(-(len(grown) + 1) // columns)
    figure = plot.new_figure(rows, columns, 3.2 * columns, 3.4 * rows)
    panels = iter(figure.axes)
    axes = next(panels)
    mm, P = 1e3 * found["opening"], 1e-3 * found["P"]
    axes.plot(mm, P, lw=0.6, label="events")
    best = growth.envelope
    axes.plot(mm[best], P[best], ".", ms=3, label="monotone")
    some = np.linspace(0.7, 1.0, 50) * found["opening"].max()
    for G, label in ((G0, "beam, G0"), (G0 * found["envelope"], "beam, G_env")):
        force = 1e-3 * gallery.beam_force(some, H, E, G)
        axes.plot(1e3 * some, force, "--", lw=1.0, label=label)
    axes.set(xlabel="opening (mm)", ylabel="force (kN/m)", title="double cantilever")
    axes.legend(frameon=False, fontsize=7)
    for (case, one), axes in zip(grown.items(), panels, strict=False):
        axes.scatter(*one.X.T, s=0.2, c="0.85")
        middle = one.places()
        axes.scatter(*middle.T, s=1.5, c=np.arange(len(middle)))
        axes.set(aspect="equal", title=case)
        axes.tick_params(labelsize=6)
    for axes in panels:
        axes.set_axis_off()
    figure.savefig(report.picture(), dpi=110)


def main() -> None:
    """Measure, print, write."""
    quick = is_quick(__doc__)
    if not quick:
        report_solvers(quick)
        report_relaxation(quick)
    report = Report("fracture_static", quick)
    found: dict[str, Any] = {name: part(report, quick) for name, part in PARTS.items()}
    draw(report, found["dcb"], found["scenes"])
    report.notes.append("compliance by beams 3 horizons high is not claimed")
    lines = [[row.get(name) for name in HEAD] for row in report.rows]
    report.finish(HEAD, lines)


if __name__ == "__main__":
    main()
