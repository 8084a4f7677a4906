"""Two dynamic fracture scenes against the bands of their figures, and what moves them.

The branching plate (soda-lime glass, sudden 2 MPa) and the Kalthoff-Winkler plate
(steel, 16.5 m/s), by the package's own measuring tools: damage above 0.35, the fork
extrapolated over 10 mm, the angle over radii of 10 to 30 mm. Beside them m- and
delta-convergence, volumes of the rim, load, and the cost of each.
"""

from __future__ import annotations

from typing import Any

import jax
import numpy as np
from _report import Report, is_quick

import jaxpd
from jaxpd import plot
from jaxpd.crack_path import branching, deflection
from jaxpd.gallery import FRACTURE_SAFETY, branching_plate, kalthoff_winkler

jax.config.update("jax_enable_x64", True)

HEAD = (
    "scene", "delta mm", "m", "rim", "dtype", "fork mm", "at us", "t90 us", "tips",
    "mean m/s", "peak m/s", "angle", "t40 us", "balance", "points", "steps", "s",
)  # fmt: skip


def branch(m: float, delta: float, dtype: str, until: float = 46e-6, **more: Any):
    """A branching run, a frame every 0.5 us, and its figures."""
    records = round(until / 0.5e-6)
    run = jaxpd.run_explicit(
        branching_plate(m, delta, **more), until, safety=FRACTURE_SAFETY,
        records=records, frames=records, dtype=dtype,
    ).checked()  # fmt: skip
    shape = (round(0.1 * m / delta), round(0.04 * m / delta))
    found = branching(
        np.asarray(run.X), shape, run.frames["damage"], run.frames["t"],
        notch_x=0.05, delta=delta, until=min(until, 43e-6),
    )  # fmt: skip
    return run, found


def strike(m: float, delta: float, dtype: str, **more: Any):
    """A Kalthoff-Winkler run, a frame every us, and the figures of both cracks."""
    run = jaxpd.run_explicit(
        kalthoff_winkler(m, delta, **more), 60e-6, safety=FRACTURE_SAFETY,
        records=60, frames=60, dtype=dtype,
    ).checked()  # fmt: skip
    shape = (round(0.1 * m / delta), round(0.2 * m / delta))
    found = [
        deflection(
            np.asarray(run.X), shape, run.frames["damage"], run.frames["t"],
            tip=(0.05, y), delta=delta,
        )
        for y in (-0.025, 0.025)
    ]  # fmt: skip
    return run, found


def draw(report: Report, glass: Any, steel: Any) -> None:
    """Damage of both scenes and the position of the tips."""
    figure = plot.new_figure(1, 3, 13.0, 4.0)
    panels = figure.axes
    for axes, run, when in ((panels[0], glass[0], 43e-6), (panels[1], steel[0], 60e-6)):
        k = int(np.argmin(np.abs(run.frames["t"] - when)))
        X, phi = np.asarray(run.X), run.frames["damage"][k]
        order = np.argsort(phi)
        dots = axes.scatter(*X[order].T, s=0.3, c=phi[order], vmin=0, vmax=0.6)
        axes.set(aspect="equal", xlabel="x (m)", ylabel="y (m)")
        axes.set_title(f"damage at {run.frames['t'][k] * 1e6:.0f} us")
    figure.colorbar(dots, ax=panels[:2], shrink=0.7)
    panels[2].plot(glass[0].frames["t"] * 1e6, 1e3 * glass[1].tip, label="glass, x")
    radius = steel[1][0].radius
    panels[2].plot(steel[0].frames["t"] * 1e6, 1e3 * radius, label="steel, radius")
    panels[2].set(xlabel="time (us)", ylabel="crack tip (mm)")
    panels[2].legend(frameon=False)
    figure.savefig(report.picture(), dpi=110)


def main() -> None:
    """Measure, print, write."""
    quick = is_quick(__doc__)
    report, lines = Report("fracture", quick), []
    cases: list[tuple[float, float, str, dict[str, Any]]] = [
        (3, 1e-3, "float32", {}), (4, 1e-3, "float32", {}), (5, 1e-3, "float32", {}),
        (4, 1e-3, "float64", {}), (4, 2e-3, "float32", {}), (4, 0.5e-3, "float32", {}),
        (4, 1e-3, "float32", {"partial": "none"}),
        (3, 1e-3, "float32", {"stress": 1e6}),
        (4, 1e-3, "float32", {"stress": 12e6, "G0": 36 * 3.8}),
    ]  # fmt: skip
    glass: Any = None
    base: Any = None
    for m, delta, dtype, more in cases[:1] if quick else cases:
        run, found = branch(m, delta, dtype, **more)
        rim = more.get("partial", "continuous")
        name = "glass" + "".join(
            f", {k} {v:g}" for k, v in more.items() if k != "partial"
        )
        worst = float(np.abs(run.balance[10:]).max())
        lines.append((
            name, delta * 1e3, m, rim, dtype, found.xe * 1e3, found.tb * 1e6,
            found.times[1] * 1e6, found.tips, found.v_mean, found.v_peak, found.angle,
            None, worst, len(run.X), run.steps, run.seconds["steps"],
        ))  # fmt: skip
        report.rows.append(dict(zip(HEAD, _plain(lines[-1]), strict=True)))
        label = f"{name}, {delta * 1e3:g} mm, m = {m:g}, {rim}, {dtype}"
        report.claim(f"energy balance, {label}", worst, 0.005)
        if not more and delta == 1e-3:
            report.claim(f"fork mm, {label}", found.xe * 1e3, (63.7, 66.7), "within")
            report.claim(f"fork us, {label}", found.tb * 1e6, (19.3, 21.3), "within")
            speed = (1325 * 0.95, 1325 * 1.05)
            report.claim(f"mean m/s, {label}", found.v_mean, speed, "within")
            report.claim(f"tips, {label}", found.tips, (2, 2), "within")
        if "stress" in more and "G0" not in more:
            report.claim(f"tips, {label}", found.tips, (1, 1), "within")
        if "G0" in more:
            moved = abs(found.xe - base.xe) * 1e3
            report.claim("fork moved by sigma x 6, G0 x 36, mm", moved, 0.5)
        if m == 4 and delta == 1e-3 and dtype == "float32" and not more:
            base = found
        if glass is None or (m == 4 and dtype == "float64"):
            glass = (run, found)
    steel: Any = None
    struck = [
        (3, 3e-3, "float32"), (4, 4e-3, "float32"), (5, 5e-3, "float32"),
        (4, 2e-3, "float32"), (4, 2e-3, "float64"), (3, 1.5e-3, "float32"),
    ]  # fmt: skip
    for m, delta, dtype in struck[:1] if quick else struck:
        run, found = strike(m, delta, dtype)
        worst = float(np.abs(run.balance[5:]).max())
        one = found[0]
        lines.append((
            "steel", delta * 1e3, m, "continuous", dtype, None, None, None, None, one.v,
            None, one.angle, one.times[1] * 1e6, worst, len(run.X), run.steps,
            run.seconds["steps"],
        ))  # fmt: skip
        report.rows.append(dict(zip(HEAD, _plain(lines[-1]), strict=True)))
        label = f"steel, {delta * 1e3:g} mm, m = {m:g}, {dtype}"
        report.claim(f"angle, {label}", one.angle, (60.0, 68.0), "within")
        report.claim(f"t40 us, {label}", one.times[1] * 1e6, (45.5, 48.5), "within")
        report.claim(f"m/s, {label}", one.v, (1770 * 0.94, 1770 * 1.06), "within")
        report.claim(f"angles differ, {label}", abs(one.angle - found[1].angle), 1.0)
        report.claim(f"energy balance, {label}", worst, 0.01)
        steel = (run, found)
    draw(report, glass, steel)
    report.finish(HEAD, lines)


def _plain(row: tuple[Any, ...]) -> list[Any]:
    """Numbers that JSON can keep: NaN is none."""
    return [
        None if isinstance(x, float) and not np.isfinite(x) else x
        for x in (x.item() if hasattr(x, "item") else x for x in row)
    ]


if __name__ == "__main__":
    main()
