"""A strip in tension: effective modulus over its width, with every correction.

Plane stress, nu = 1/3, the sides free. Both ends are gripped over a horizon (the axial
displacement prescribed, the lateral one free); the middle section is far enough from
them to be evenly strained along the axis. There 2 W / e^2 is the effective modulus of
each row, from the stored energy density W and the axial strain e that was found; its
mean over the width is that of the pull of the grips over width and strain.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import matplotlib.pyplot as plt
import numpy as np
from _report import Report, is_quick
from scipy.sparse.linalg import eigsh

from jaxpd import (
    Bonds,
    Elastic,
    Scene,
    box,
    fractional,
    moves,
    prepare,
    solve_static,
)
from jaxpd.body import cloud_of
from jaxpd.discretize import CORRECTIONS, beyond_faces
from jaxpd.problem import first_tangent

jax.config.update("jax_enable_x64", True)

DX, STRAIN = 0.02, 1e-5
#: Columns of the table: rows from the face.
DEEP = (0, 1, 2, 3, 4, 5)
HEAD = (
    "m",
    "alpha",
    "correction",
    *(f"row {k}" for k in DEEP),
    "middle",
    "mean",
    "pull",
    "rim/middle",
    "largest eigenvalue",
    "CG",
)


def strip(rows: int, columns: int, m: int, alpha: float, correction: str) -> Scene:
    """A strip of rows across and columns along x, pulled by both ends."""
    half = 0.5 * DX * np.array([columns - 1, rows - 1])
    grip = (m - 0.5) * DX
    ends = [
        box((-half[0], -half[1]), (-half[0] + grip, half[1])),
        box((half[0] - grip, -half[1]), (half[0], half[1])),
    ]
    middle = box((-DX / 4, -DX / 4), (DX / 4, DX / 4))
    return Scene(
        body=box(tuple(-half), tuple(half)),
        material=Elastic(1.0, nu=1 / 3, state="plane stress"),
        supports=[
            *(moves(end, x=lambda X: STRAIN * X[:, 0]) for end in ends),
            moves(middle, y=0.0),
        ],
        resolution=Bonds(dx=DX, m=m, kernel=fractional(alpha), correction=correction),
        kinematics="small",
    )


def measure(rows: int, columns: int, m: int, alpha: float, correction: str) -> Any:
    """Solve one strip and look at its middle section."""
    scene = strip(rows, columns, m, alpha, correction)
    solution = solve_static(scene, rtol=1e-9).checked()
    mid = columns // 2
    u = np.asarray(solution.u).reshape(columns, rows, 2)
    strain = (u[mid + 1, :, 0] - u[mid - 1, :, 0]) / (2 * DX)
    W = np.asarray(solution.energy_density).reshape(columns, rows)[mid]
    E = 2.0 * W / strain[rows // 2] ** 2
    pull = solution.reaction_on(scene.supports[1].region)[0]
    half = rows // 2 + 1
    return {
        "m": m,
        "alpha": alpha,
        "correction": correction,
        "points": rows * columns,
        "E": E[:half].tolist(),
        "asymmetry": float(np.abs(E - E[::-1]).max()),
        "strain_spread": float(np.ptp(strain) / strain.mean()),
        "middle": float(E[rows // 2]),
        "mean": float(E.mean()),
        "pull": float(pull / (rows * DX * strain.mean())),
        "rim": float(np.abs(E[: m + 1] - 1).max()),
        "rim over middle": float(np.abs(E[: m + 1] / E[rows // 2] - 1).max()),
        "largest eigenvalue": top_of(solution.problem),
        "operator": solution.problem.spec.operator,
        "iterations": int(solution.linear_iterations[0]),
    }


def top_of(problem: Any) -> float:
    """Largest eigenvalue of the stiffness of the undeformed body (N/m)."""
    matrix = jax.jit(first_tangent)(problem).to_bsr().tocsr()
    return float(eigsh(matrix, k=1, return_eigenvectors=False)[0])


def by_rows(size: tuple[int, int], m: int, alpha: float, none: float) -> dict[str, Any]:
    """Largest eigenvalue with fictitious points on lines through more or fewer rows."""
    scene = strip(*size, m, alpha, "fictitious")
    problem, cloud = prepare(scene), cloud_of(scene)
    found = {}
    for rows in (2, m, 3 * m // 2 + m % 2, 2 * m):
        delta = scene.resolution.horizon
        family, P = beyond_faces(cloud, delta, partial="linear", rows=rows)
        other = dataclasses.replace(problem, family=family, extension=P)
        found[str(rows)] = top_of(other) / none
    return {"m": m, "alpha": alpha, "eigenvalue by rows": found}


def line(row: dict[str, Any], none: dict[str, Any]) -> list[Any]:
    """A row as the table shows it, beside the one without correction."""
    cells = [row["m"], row["alpha"], row["correction"]]
    cells += [f"{row['E'][k]:.4f}" for k in DEEP]
    cells += [f"{row[name]:.4f}" for name in ("middle", "mean", "pull")]
    cells += [f"{row['rim over middle']:.4f}"]
    cells += [f"{row['largest eigenvalue'] / none['largest eigenvalue']:.3f}"]
    return [*cells, row["iterations"]]


def draw(report: Report, cases: list[tuple[int, float]]) -> None:
    """Effective modulus over the distance from the face."""
    figure, axes = plt.subplots(
        1, len(cases), figsize=(5.0 * len(cases), 4.2), sharey=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis, (m, alpha) in zip(axes[0], cases, strict=True):
        axis.axhspan(0.98, 1.02, color="0.9")
        for row in report.rows:
            if (row["m"], row["alpha"]) == (m, alpha):
                depth = np.arange(len(row["E"])) / m
                axis.plot(depth, row["E"], "o-", ms=3, label=row["correction"])
        axis.set(
            title=f"m = {m}, alpha = {alpha:g}",
            xlabel="distance from the outermost row / horizon",
            xlim=(-0.05, 2.5),
        )
    axes[0, 0].set_ylabel("2 W / (E strain^2)")
    axes[0, 0].legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)


def add_claims(report: Report) -> None:
    """The claims on the rows at hand."""

    def worst(name: str, correction: str) -> float:
        return max(row[name] for row in report.rows if row["correction"] == correction)

    names = dict.fromkeys(row["correction"] for row in report.rows)
    best = min(names, key=lambda correction: worst("rim", correction))
    report.claim(
        f"best of all, {best!r}: largest |E - 1| within a horizon of the face",
        worst("rim", best),
        0.02,
    )
    report.claim(
        f"{best!r}: the same, against the middle of the strip",
        worst("rim over middle", best),
        0.01,
    )
    for correction in sorted(names.keys() & {"energy", "force density"}):
        report.claim(
            f"{correction!r}: largest deviation from the middle within a horizon",
            worst("rim over middle", correction),
            0.09,
        )
    gap = max(abs(row["mean"] / row["pull"] - 1) for row in report.rows)
    report.claim("mean of 2 W / e^2 over the width against the pull, -1", gap, 1e-3)
    uneven = max(max(row["asymmetry"], row["strain_spread"]) for row in report.rows)
    report.claim("asymmetry, and spread of the strain over the width", uneven, 1e-4)
    for row in report.rows:
        if row["correction"] == "fictitious":
            none = next(
                r
                for r in report.rows
                if r["correction"] == "none"
                and (r["m"], r["alpha"]) == (row["m"], row["alpha"])
            )
            ratio = row["largest eigenvalue"] / none["largest eigenvalue"]
            report.claim(
                f"largest eigenvalue, 'fictitious' over 'none', m = {row['m']}, "
                f"alpha = {row['alpha']:g}",
                ratio,
                1.5,
            )


def main() -> None:
    """Every correction on every strip."""
    report = Report("surfaces", is_quick(__doc__))
    cases, size, names = [(3, 0.0), (4, 0.0), (4, -1.0)], (25, 151), CORRECTIONS
    if report.quick:
        cases, size = [(3, 0.0)], (17, 101)
        names = ("none", "lattice", "energy", "fictitious")
    lines = []
    for m, alpha in cases:
        rows = [measure(*size, m, alpha, correction) for correction in names]
        report.rows += rows
        lines += [line(row, rows[0]) for row in rows]
        jax.clear_caches()
    draw(report, cases)
    add_claims(report)
    m, alpha = cases[-1]
    none = report.rows[-len(names)]["largest eigenvalue"]
    trials = by_rows(size, m, alpha, none)
    shown = ", ".join(f"{k}: {v:.3g}" for k, v in trials["eigenvalue by rows"].items())
    report.notes.append(
        f"m = {m}, alpha = {alpha:g}: largest eigenvalue with fictitious points on "
        f"lines through so many rows, over that without correction: {shown}"
    )
    report.rows.append(trials)
    report.notes += [
        f"{size[0]} rows across, {size[1]} along; row 0 is the outermost",
        "all moduli over Young's modulus; largest eigenvalue over that without "
        "correction; CG: iterations to 1e-9 with the diagonal",
        "alpha = -1 is the PMB material in 2-D; partial volumes are linear",
    ]
    report.finish(HEAD, lines)


if __name__ == "__main__":
    main()
