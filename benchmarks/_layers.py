"""Layers against exact ones: rules, thicknesses, moduli, mass; ghosts, points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from _plane_waves import Body, errors
from _report import Report

from jaxpd import interlayer

RULES = ("calibrated", "rigid", "paper")
RATIOS = (1e-3, 1e-2, 1e-1, 1.0)
GAPS = (0.5, 1.5, 3.0)


def sweep(
    body: Body, pairs: list[tuple[float, float]], rho: float, rules: Any
) -> list[dict[str, Any]]:
    """All rules on pairs of modulus and thickness over the spacing."""
    whole = body.record(body.scene(None, None), 0.0, body.dx, 2)
    E, rows = whole.modulus, []
    for ratio, gap in pairs:
        h = gap * body.dx
        exact = whole.exact(E, ratio, rho, h)
        row: dict[str, Any] = {
            "d": body.d,
            "a": body.a / body.dx,
            "rho": rho,
            "E_l": ratio,
            "h": gap,
            "modulus": E,
            "exact": "slab" if rho else "spring",
            "kh": np.sqrt(2 * rho / ratio) * h / body.a,
            "rules": {},
        }
        for rule in rules:
            try:
                scene = body.scene(h, interlayer(ratio, rule=rule, rho=rho))
                track = body.record(scene, h, body.dx, 2)
            except ValueError as refusal:
                row["rules"][rule] = {"refused": str(refusal)}
                continue
            row["rules"][rule] = errors(track, whole, exact)
        rows.append(row)
    return rows


def compare_layers(quick: bool) -> None:
    """Reflection and transmission for the three rules."""
    report = Report("paper_waves_layers", quick)
    bar = Body(1, 1.0, 40.0, away=60.0)
    pairs = [(ratio, gap) for gap in GAPS for ratio in RATIOS]
    if quick:
        report.rows += sweep(bar, [(0.01, 1.5), (0.1, 1.5)], 0.0, ("calibrated",))
    else:
        report.rows += sweep(bar, pairs, 0.0, RULES)
        report.rows += sweep(bar, pairs, 1.0, RULES[:1])
        middle = [(ratio, 1.5) for ratio in RATIOS[1:]]
        for a in (20.0, 80.0):
            report.rows += sweep(replace(bar, a=a), middle, 0.0, RULES[:2])
        plate = Body(2, 1.0, 20.0, half=120.5, away=10.0)
        report.rows += sweep(plate, middle, 0.0, RULES)
        report.rows += sweep(plate, middle[1:], 1.0, RULES[:1])
        draw(report, bar)
    lines = []
    for row in report.rows:
        cells = [row[k] for k in ("d", "a", "rho", "E_l", "h", "kh")]
        some = next((r for r in row["rules"].values() if "T error" in r), {})
        cells += [some.get("T exact"), some.get("R exact")]
        for rule in RULES:
            found = row["rules"].get(rule, {})
            cells += [
                f"{found[k]:.1e}" if k in found else "refused" if found else None
                for k in ("T error", "R error")
            ]
        lines.append(cells)

    def worst(rule: str, **of: Any) -> float:
        return max(
            max(row["rules"][rule].get(k, np.nan) for k in ("T error", "R error"))
            for row in report.rows
            if rule in row["rules"] and all(row[k] == v for k, v in of.items())
        )

    def check(what: str, rule: str, bound: float, **of: Any) -> None:
        report.claim(f"{what}, {rule}: largest error", worst(rule, **of), bound)

    one = {"d": 1, "a": 40.0, "rho": 0.0}
    for rule in RULES[: 1 if quick else 3]:
        check("bars without mass, a = 40", rule, 2e-3, **one)
    if not quick:
        for rule in RULES:
            check("plates without mass, a = 20", rule, 5e-3, d=2, rho=0.0)
        report.claim(
            "with mass, k h below 0.1, calibrated: largest error",
            max(
                max(row["rules"]["calibrated"][k] for k in ("T error", "R error"))
                for row in report.rows
                if row["rho"] and row["kh"] < 0.1
            ),
            5e-3,
        )
        check("with mass, any k h", "calibrated", 1e-2, rho=1.0)
    moduli = {row["d"]: row["modulus"] for row in report.rows}
    report.notes += [
        "T and R: largest of the exact signals over the incident peak; errors are the "
        "largest of |signal - exact| over the incident peak; lengths over dx, m = 3",
        "rho = 0 against the exact spring E_l / h, rho = 1 against the exact slab; k h "
        "= sqrt(2) h / a times c / c_l, the layer against the pulse in it",
        "modulus of the lattice for long waves, which the exact ones have: "
        + ", ".join(f"{d}-D {E:.6f}" for d, E in moduli.items())
        + "; classical 1 and 9/8",
    ]
    head = ["d", "a", "rho", "E_l", "h", "k h", "T", "R"]
    report.finish((*head, *(x for rule in RULES for x in (f"{rule}: T", "R"))), lines)


def draw(report: Report, bar: Body) -> None:
    """Largest of the transmitted and the reflected signal, a panel a rule."""
    whole = bar.record(bar.scene(None, None), 0.0, bar.dx, 2)
    peak, thick = whole.u[:, 1].max(), np.geomspace(0.4, 3.6, 30)
    figure, axes = plt.subplots(
        1, 3, figsize=(12.0, 4.2), sharey=True, layout="constrained"
    )
    for axis, rule in zip(axes, RULES, strict=True):
        for k, ratio in enumerate(RATIOS):
            lines = np.array(
                [
                    [np.abs(x).max() / peak for x in whole.exact(1.0, ratio, 0.0, h)]
                    for h in thick
                ]
            )
            axis.plot(thick, lines[:, 1], f"C{k}-", lw=1, label=f"E_l / E = {ratio:g}")
            axis.plot(thick, lines[:, 0], f"C{k}:", lw=1)
        for row in report.rows:
            found = row["rules"].get(rule, {})
            if (row["d"], row["a"], row["rho"]) == (1, 40.0, 0.0) and "T peak" in found:
                k = RATIOS.index(row["E_l"])
                axis.plot(row["h"], found["T peak"], f"C{k}o", ms=5)
                axis.plot(row["h"], found["R peak"], f"C{k}s", ms=5, mfc="none")
        axis.set(xscale="log", xlabel="thickness / dx", title=rule)
        axis.set_xticks(GAPS, map(str, GAPS))
        axis.minorticks_off()
    axes[0].set_ylabel("largest signal / incident")
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside right center",
        title="lines: exact\nfull: T\ndotted, hollow: R",
    )
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)


def compare_meshed(quick: bool) -> None:
    """A ghost interlayer two spacings thick, and the layer resolved by points."""
    report, lines = Report("paper_waves_meshed", quick), []
    h, ratio = 0.04, 0.01
    cases = [
        (1, 0.8, 0.0, (3, 6, 12)),
        (1, 3.2, 0.0, (3, 6, 12)),
        (2, 0.8, 0.6, (3,)),
    ]
    if quick:
        cases = [(1, 0.8, 0.0, (3,))]
    for d, a, half, meshes in cases:
        ghost: dict[str, Any] = {}
        runs = [(n, mean) for n in meshes for mean in ("arithmetic", "harmonic")]
        for points, mean in [(0, ""), *runs]:
            dx = h / points if points else 0.02
            body = Body(d, dx, a, half, 0.2)
            whole = body.record(body.scene(None, None), 0.0, a / 8)
            E = whole.modulus
            what = None if points else interlayer(ratio * E, rho=1.0)
            scene = body.scene(h, what, ratio, mean)
            track = body.record(scene, h, a / 8)
            assert track.dt == whole.dt
            row = {
                "d": d,
                "a": a,
                "points in layer": points,
                "mean": mean,
                "dx": dx,
                "points": len(track.motion.X),
                "dt": track.longest,
                "steps": round(len(track.u) * track.every),
                "seconds": track.seconds,
                "kh": np.sqrt(2 / ratio) * h / a,
            }
            row |= errors(track, whole, whole.exact(E, ratio * E, 1.0, h))
            ghost = ghost or row
            row["cost"] = track.seconds["steps"] / ghost["seconds"]["steps"]
            report.rows.append(row)
            name = f"{points} points, {mean}" if points else "ghosts"
            lines.append([
                d, a / 0.02, row["kh"], name, row["points"], row["dt"], row["steps"],
                track.seconds["compile"], track.seconds["steps"], row["cost"],
                row["T exact"], row["R exact"], f"{row['T error']:.1e}",
                f"{row['R error']:.1e}",
            ])  # fmt: skip
    for d, a, *_ in cases:
        worst = {
            (row["points in layer"], row["mean"]): max(row["T error"], row["R error"])
            for row in report.rows
            if (row["d"], row["a"]) == (d, a)
        }
        what = f"ghosts over 3 points in series, {d}-D, a = {a / 0.02:g} dx: error"
        report.claim(what, worst[0, ""] / worst[3, "harmonic"], 1.0)
    report.notes += [
        "h = 0.04, E_l / E = 0.01, rho_l = rho; ghosts dx = h / 2; points: one lattice "
        "as fine everywhere, a modulus for each point; bonds take the arithmetic mean "
        "of their ends, as Elastic has it, or the harmonic, springs in series",
        "exact: the slab; errors over the incident peak, against an unbroken body as "
        "fine; dt: longest stable one, of which at most 0.8 is taken; s: of all steps",
    ]
    head = ("d", "a / dx", "k h", "layer", "points", "dt", "steps", "compile s", "s")
    report.finish((*head, "cost", "T", "R", "T error", "R error"), lines)
