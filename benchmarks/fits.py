"""Fits from made-up measurements: scalars, a field with an inclusion, intervals.

A cracked plate is held below and pulled at by given forces. Its own displacements, with
seeded noise, are the measurements. Exact data: the modulus E (and with it the
micromodulus) and the order alpha of the kernel. Noise: a field of 65 x 65 moduli
with an inclusion five times softer, under a penalty that lets it jump; its weight is
the largest of a series that explains the data (Morozov's discrepancy principle).
Intervals: how many of 200 repeats hold the truth.
"""

from __future__ import annotations

import itertools
import time
from typing import Any

import jax
import numpy as np
from _report import Report, is_quick

import jaxpd
from jaxpd.fitting import Fit, fit
from jaxpd.inverse import Inverse, bounded, positive, smooth
from jaxpd.observe import displacements
from jaxpd.resample import refit

jax.config.update("jax_enable_x64", True)

E, ALPHA = 30e9, 0.7
RADIUS, CENTRE, SOFT = 0.2, (0.1, 0.05), 0.2
NOISES = (0.03, 0.01, 0.003, 0.001)
#: Weights of the penalty over (data / noise), tried from the largest.
WEIGHTS = (10.0, 3.0, 1.0, 0.3, 0.1, 0.03, 0.01)
HEAD = (
    "what",
    "noise",
    "steps",
    "evaluations s",
    "found",
    "error",
    "contour",
    "sum r^2 / N",
)


def plate(n: int, m: float, cracked: bool = True) -> jaxpd.Scene:
    """Held below; pulled upwards and sideways at the top."""
    return jaxpd.Scene(
        body=jaxpd.box((-0.5, -0.5), (0.5, 0.5)),
        material=jaxpd.Elastic(E, nu=1 / 3, state="plane stress"),
        supports=[jaxpd.holds(jaxpd.below(y=-0.5))],
        loads=[jaxpd.pull(jaxpd.above(y=0.45), x=4e5, y=1e6)],
        cracks=[jaxpd.segment((-0.15, 0.0), (0.15, 0.0))] if cracked else [],
        resolution=jaxpd.Bonds(dx=1 / n, m=m, kernel=jaxpd.fractional(ALPHA)),
        kinematics="small",
    )


def scalars(n: int) -> list[dict[str, Any]]:
    """Exact data: E alone, then E and alpha."""
    problem = jaxpd.prepare(plate(n, 4.2), rtol=1e-11)
    u, _ = problem.solve()
    seen, rows = [displacements(np.asarray(u))], []
    order = bounded(-0.5, -3.0, 1.95)
    for sought in ({"E": positive(0.4 * E)}, {"E": positive(0.4 * E), "alpha": order}):
        start = time.perf_counter()
        found = fit(problem, sought, seen)
        rows.append(
            {
                "what": " and ".join(sought),
                "steps": found.steps,
                "seconds": time.perf_counter() - start,
                "reason": found.reason,
                "E error": abs(float(found.values["E"]) / E - 1.0),
            }
        )
        if "alpha" in sought:
            rows[-1]["alpha error"] = abs(float(found.values["alpha"]) - ALPHA)
    return rows


def explained(
    problem: jaxpd.Problem, data: Any, sigma: float, noise: float, n: int, steps: int
) -> tuple[Fit, float, float]:
    """The fit with the largest weight that explains the data, it, and sum r^2 / N."""
    guess, weight, misfit = np.full(len(problem.X), 0.7 * E), 0.0, np.inf
    found: Any = None
    for over in WEIGHTS:
        weight = over / noise
        # slopes of a twentieth of z a spacing count as jumps
        penalty = smooth(problem, "E", weight, edges=0.05 * n)
        sought, seen = {"E": positive(guess)}, [displacements(data, sigma)]
        found = fit(problem, sought, seen, [penalty], steps=steps, rtol=1e-6)
        r = np.asarray(found.inverse.residuals(found.z))
        misfit = float(r @ r) / found.inverse.count
        if misfit <= 1.0 + 2.0 / found.inverse.count**0.5:
            break
    return found, weight, misfit


def field(n: int, noises: tuple[float, ...], steps: int) -> list[dict[str, Any]]:
    """An inclusion from noisy displacements of all points."""
    scene = plate(n, 4.2, cracked=False)
    problem = jaxpd.prepare(scene, operator="fft", solver="multigrid", rtol=1e-8)
    X = np.asarray(problem.X)
    inside = np.hypot(*(X - CENTRE).T) < RADIUS
    body = np.abs(X).max(axis=1) <= 0.5 + 1e-9
    truth = np.where(inside, SOFT * E, E)
    exact = np.asarray(problem.solve(problem.params | {"E": truth})[0])
    rows, rng = [], np.random.default_rng(0)
    for noise in noises:
        sigma = noise * np.abs(exact).max()
        data = exact + sigma * rng.normal(size=exact.shape)
        start = time.perf_counter()
        found, weight, misfit = explained(problem, data, sigma, noise, n, steps)
        value = found.values["E"]
        soft = value < SOFT**0.5 * E
        wrong = np.log(value / truth)[body]
        flat = np.log(0.7 * E / truth)[body]
        rows.append(
            {
                "what": f"field of {len(X)}",
                "noise": noise,
                "weight": weight,
                "steps": found.steps,
                "reason": found.reason,
                "seconds": time.perf_counter() - start,
                "misfit": misfit,
                "error": float(np.linalg.norm(wrong) / np.linalg.norm(flat)),
                "L2": float(
                    np.linalg.norm((value - truth)[body]) / np.linalg.norm(truth[body])
                ),
                "inclusion": float(np.median(value[inside]) / E),
                "contour": float((soft != inside)[body].mean()),
                "overlap": float((soft & inside).sum() / (soft | inside).sum()),
                "map": (value / E).reshape(n + 1, -1).round(3).tolist(),
            }
        )
    return rows


def coverage(repeats: int) -> dict[str, Any]:
    """Shares of the intervals of E and alpha that hold the truth."""
    problem = jaxpd.prepare(plate(8, 3.3), rtol=1e-10)
    u = np.asarray(problem.solve()[0])
    sigma = 0.02 * np.abs(u).max()
    rng = np.random.default_rng(1)
    data = u + sigma * rng.normal(size=(repeats, *u.shape))
    guess = {"E": positive(0.9 * E), "alpha": bounded(0.5, -3.0, 1.95)}
    inverse = Inverse(problem, guess, (displacements(u, sigma),))
    start = time.perf_counter()
    z, covariance, _ = refit(
        jax.device_put(inverse), inverse.start(), (data,), iterations=5
    )
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    share = (0.5 + 3.0) / 4.95
    truth = [np.log(1 / 0.9), np.log((ALPHA + 3) / (1.95 - ALPHA) * (1 / share - 1))]
    held = (np.abs(np.asarray(z) - truth) <= 1.959964 * deviation).mean(axis=0)
    return {
        "what": f"{repeats} intervals",
        "noise": 0.02,
        "seconds": time.perf_counter() - start,
        "E": float(held[0]),
        "alpha": float(held[1]),
    }


def draw(report: Report, rows: list[dict[str, Any]]) -> None:
    """The fields beside each other."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        1, len(rows), figsize=(3.2 * len(rows), 3.0), sharey=True, layout="constrained"
    )
    shown: Any = None
    turn = np.linspace(0.0, 2.0 * np.pi, 100)
    for ax, row in zip(np.atleast_1d(axes), rows, strict=True):
        grid = np.asarray(row["map"]).T
        n = grid.shape[1] - 1
        low = 0.5 - (grid.shape[0] - 1) / n
        shown = ax.imshow(
            grid, origin="lower", extent=(-0.5, 0.5, low, 0.5), vmin=0.0, vmax=1.2
        )
        x, y = CENTRE
        ax.plot(x + RADIUS * np.cos(turn), y + RADIUS * np.sin(turn), "w--", lw=1)
        ax.set_ylim(-0.5, 0.5)
        ax.set_xticks([-0.4, 0.0, 0.4])
        ax.set_title(f"noise {100 * row['noise']:g} %, L2 {100 * row['L2']:.0f} %")
    figure.colorbar(shown, ax=axes, shrink=0.8, label="E / E of the plate")
    figure.savefig(report.picture(), dpi=110)


def main() -> None:
    """Run, print, keep."""
    quick = is_quick(__doc__)
    report = Report("fits", quick)
    one, two = scalars(8 if quick else 32)
    fields = field(
        16 if quick else 64, NOISES[1:2] if quick else NOISES, 30 if quick else 150
    )
    cover = coverage(50 if quick else 200)
    report.rows = [one, two, *fields, cover]
    report.claim("E from exact data, relative error", one["E error"], 1e-6)
    report.claim("E from exact data, steps", one["steps"], 30)
    report.claim("alpha from exact data, error", two["alpha error"], 1e-4)
    if not quick:
        errors = [row["L2"] for row in fields]
        report.claim(
            "field: largest ratio of the error to that at the next larger noise",
            max(b / a for a, b in itertools.pairwise(errors)),
            1.0,
        )
        for name in ("E", "alpha"):
            report.claim(
                f"95 % intervals of {name} that hold the truth",
                cover[name],
                (0.90, 0.98),
                "within",
            )
    lines: list[list[Any]] = [
        [
            one["what"],
            None,
            one["steps"],
            one["seconds"],
            None,
            one["E error"],
            None,
            None,
        ],
        [
            two["what"],
            None,
            two["steps"],
            two["seconds"],
            None,
            two["alpha error"],
            None,
            None,
        ],
    ]
    lines += [
        [
            row["what"],
            row["noise"],
            row["steps"],
            row["seconds"],
            row["inclusion"],
            row["L2"],
            row["contour"],
            row["misfit"],
        ]
        for row in fields
    ]
    shown = f"{cover['E']:.3f}, {cover['alpha']:.3f}"
    lines.append([cover["what"], 0.02, None, cover["seconds"], shown, None, None, None])
    report.notes += [
        "found: median modulus in the inclusion over the plate's (0.2 is right), or "
        "the shares of the intervals of E, alpha that hold the truth",
        "error: of E; of alpha; of the field, L2 relative; contour: share of points on "
        "the wrong side of the geometric mean of both moduli",
    ]
    draw(report, fields)
    for row in fields:
        del row["map"]
    report.finish(HEAD, lines)


if __name__ == "__main__":
    main()
