"""What the cracked plate converges to: opening with spacing and horizon, Newton.

(a) The crack opening over strain as the spacing h falls, with m = delta / h fixed and
with delta fixed, against finite elements on the same plate. The tips of the crack lie
at 0.15 n spacings; only where that is a whole number and a half does the lattice see a
crack of the right length, so limits are taken over such n, and n = 16 .. 128 are shown
beside them. (b) Newton's residuals with the exact tangent, by autodiff and by hand, and
with its axial part alone (the paper's eq. 20).
"""

from __future__ import annotations

import itertools
import math

import jax
import numpy as np
from _fe_peer import reference_opening, solve_plate
from _report import Report, is_quick

from jaxpd import Problem, prepare, solve_static
from jaxpd.gallery import CRACK, cracked_plate

jax.config.update("jax_enable_x64", True)

STRAIN = 1e-3
#: 0.15 n = k + 1/2: the tips midway between two columns of points.
MIDWAY = (30, 50, 90, 130, 170)
DOUBLED = (16, 32, 64, 128)
STRAINS = (1e-4, 1e-3, 1e-2, 5e-2)
#: Residuals below this are round-off and are not used for rates.
FLOOR = 1e-11
HEAD = ("case", "n", "m", "delta", "opening", "FE, gap h", "dev %", "to classical %")


def lattice_limit(m: int) -> float:
    """Opening of a wide cracked sheet with the lattice's stiffness, over isotropic.

    The bonds of a lattice sum to C1111 and C1122 = C1212, and C1111 / C1122 is 3 only
    for an infinite m. The opening of a crack in an orthotropic sheet under a given
    mean strain, u_x held, follows in closed form (G. C. Sih, P. C. Paris, G. R. Irwin,
    Int. J. Fract. Mech. 1 (1965) 189-203). alpha = 0, linear partial volumes.
    """
    x, y = np.meshgrid(np.arange(-m, m + 1), np.arange(-m, m + 1))
    r = np.hypot(x, y)
    r = np.where(r > 0, r, np.inf)
    weight = np.where(r <= m * (1 + 1e-9), np.clip(m - r + 0.5, 0, 1), 0) / r**4

    def opening(c11: float, c12: float, c66: float) -> float:
        a11, a12 = np.linalg.inv([[c11, c12], [c12, c11]])[0]
        return c11 * math.sqrt(2 * a11 * (a11 + a12 + 0.5 / c66))

    c11, c12 = float((weight * x**4).sum()), float((weight * x**2 * y**2).sum())
    return opening(c11, c12, c12) / opening(3.0, 1.0, 1.0)


def limit(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Value at h = 0 of the parabola through the three finest points, and its doubt.

    The doubt is the distance from the straight line through the two finest.
    """
    h, value = np.array(sorted(points)[:3]).T
    curve = float(np.polyval(np.polyfit(h, value, 2), 0.0))
    line = float(np.polyval(np.polyfit(h[:2], value[:2], 1), 0.0))
    return curve, abs(curve - line)


def line_limit(points: list[tuple[float, float]]) -> tuple[float, float]:
    """Value at h = 0 of the straight line along the four finest points, and its doubt.

    For a fixed delta: m and with it the lattice's anisotropy change from point to point
    and a parabola would follow them. The doubt is the distance from the line through
    the three finest.
    """
    h, value = np.array(sorted(points)[:4]).T
    line = float(np.polyval(np.polyfit(h, value, 1), 0.0))
    other = float(np.polyval(np.polyfit(h[:3], value[:3], 1), 0.0))
    return line, abs(line - other)


def opening_row(case: str, n: int, m: int, fine, classical: float) -> dict:
    """Opening over strain on one lattice, small displacements."""
    scene = cracked_plate(n, m, strain=STRAIN, kinematics="small")
    solution = solve_static(scene).checked()
    opening = solution.opening(CRACK) / STRAIN
    same_gap = fine.displacement_jump(1.0 / n) / STRAIN
    return {
        "case": case,
        "n": n,
        "m": m,
        "delta": m / n,
        "opening": opening,
        "FE same gap": same_gap,
        "deviation": opening / same_gap - 1.0,
        "to classical": opening / classical - 1.0,
        "linear iterations": int(solution.linear_iterations[0]),
        "seconds": solution.seconds["prepare"] + solution.seconds["solve"],
    }


def newton_rows(tangent: str, rtol: float, n: int) -> list[dict]:
    """Residual histories over strain with one kind of tangent."""
    solve = jax.jit(Problem.solve)
    rows = []
    for strain in STRAINS:
        scene = cracked_plate(n, 8, strain=strain)
        problem = prepare(scene, tangent=tangent, rtol=rtol, linear_rtol=rtol)
        _, info = solve(problem)
        # a load step that is halved starts a new history: keep the first
        whole = np.asarray(info.loads) == 1.0
        history = np.asarray(info.residuals)[whole].tolist()
        inside = [k + 1 for k, r in enumerate(history) if r <= 1e-6]
        rows.append(
            {
                "case": "newton",
                "n": n,
                "m": 8,
                "tangent": tangent,
                "rtol": rtol,
                "strain": strain,
                "residuals": history,
                "steps to 1e-6": inside[0] if inside else None,
                "linear iterations": np.asarray(info.linear_iterations)[
                    : int(info.iterations)
                ].tolist(),
                "status": int(info.status),
            }
        )
    return rows


def above_floor(history: list[float]) -> list[float]:
    """The residuals that are no round-off."""
    return [r for r in history if r > FLOOR]


def order(history: list[float]) -> float:
    """Order of convergence by the last three residuals above round-off."""
    a, b, c = above_floor(history)[-3:]
    return math.log(c / b) / math.log(b / a)


def factor(history: list[float]) -> float:
    """Mean factor of the residuals above round-off, the first step left out."""
    r = above_floor(history)[1:]
    return (r[-1] / r[0]) ** (1.0 / (len(r) - 1))


def main() -> None:
    """Run both parts."""
    report = Report("convergence", is_quick(__doc__))
    classical, doubt = reference_opening(clamp_x=True)
    fine = solve_plate(72 if report.quick else 144, order=2, grading=4.0, strain=STRAIN)
    cases = [("doubled", n, 8) for n in DOUBLED]
    cases += [("fixed m", n, m) for m in (3, 4, 8) for n in MIDWAY]
    cases += [("fixed delta", n, n // 10) for n in (30, 50, 70, 90, 110, 130)]
    cases += [("fixed delta", n, n // 5) for n in (30, 50, 70, 90)]
    if report.quick:
        cases = [("fixed m", 30, 4)]
    for case, n, m in cases:
        report.rows.append(opening_row(case, n, m, fine, classical))
    lines = [
        [
            r["case"],
            r["n"],
            r["m"],
            r["delta"],
            f"{r['opening']:.5f}",
            f"{r['FE same gap']:.5f}",
            f"{100 * r['deviation']:+.2f}",
            f"{100 * r['to classical']:+.2f}",
        ]
        for r in report.rows
    ]
    opening_claims(report, classical)
    report.notes.append(
        f"classical opening over strain, u_x held: {classical:.6f} +- {doubt:.0e} m"
    )
    report.notes.append(
        "fixed m: the limit is the classical plate with the slightly anisotropic "
        "stiffness of the lattice; fixed delta: the nonlocal plate, which opens less"
    )
    openings = list(report.rows)
    histories = []
    for tangent, rtol in (("ad", 1e-12), ("axial", 1e-12)):
        histories += newton_rows(tangent, rtol, 32)
    if not report.quick:
        histories += newton_rows("hand", 1e-12, 32) + newton_rows("ad", 1e-6, 32)
    report.rows += histories
    newton_claims(report, histories)
    for r in histories:
        if r["tangent"] == "hand" or r["rtol"] > 1e-7:
            continue
        shown = " ".join(f"{x:.0e}" for x in r["residuals"][:8])
        report.notes.append(
            f"Newton, tangent {r['tangent']}, strain {r['strain']:g}: "
            f"{r['steps to 1e-6']} steps to 1e-6, residuals {shown}"
        )
    draw(report, openings, histories, classical, fine)
    report.finish(HEAD, lines)


def opening_claims(report: Report, classical: float) -> None:
    """Claims of part (a)."""
    solution = solve_static(cracked_plate(32, 8, strain=STRAIN)).checked()
    value = solution.opening(CRACK) / STRAIN
    report.claim(
        "opening over strain, n = 32, m = 8, strain 1e-3, finite displacements",
        value,
        (0.5801, 0.5919),  # 0.586 +- 1 %
        "within",
    )
    for m in (3, 4, 8):
        found = [r for r in report.rows if r["case"] == "fixed m" and r["m"] == m]
        if len(found) < 3:
            continue
        value, doubt = limit([(1 / r["n"], r["opening"]) for r in found])
        expected = lattice_limit(m)
        report.claim(
            f"m = {m}: limit h -> 0 over the classical opening, {value / classical:.4f}"
            f" (doubt {doubt:.4f}), less {expected:.4f}, what the lattice's own "
            "anisotropy makes of it",
            abs(value / classical - expected),
            0.005,
        )
    fixed = [r for r in report.rows if r["case"] == "fixed delta"]
    for delta in sorted({round(r["delta"], 9) for r in fixed}):
        near = [r for r in fixed if abs(r["delta"] - delta) < 1e-9]
        value, doubt = line_limit([(1 / r["n"], r["opening"]) for r in near])
        report.claim(
            f"delta = {delta:g} m fixed: the limit h -> 0, {value:.4f} m (doubt "
            f"{doubt:.4f}), is not the classical opening; relative distance",
            1.0 - value / classical,
            0.01,
            ">=",
        )


def newton_claims(report: Report, histories: list[dict]) -> None:
    """Claims of part (b)."""
    small = [r for r in histories if r["strain"] <= 1e-2]
    report.claim(
        f"Newton steps to 1e-6, strains <= 1e-2, {len(small)} runs: most",
        max(r["steps to 1e-6"] or np.inf for r in small),
        3,
    )
    sharp = [r for r in histories if r["rtol"] < 1e-7]
    exact = [r for r in sharp if r["tangent"] == "ad"]
    pairs = [above_floor(r["residuals"]) for r in exact]
    report.claim(
        "exact tangent, all strains: largest r_next / r^2 after the first step",
        max(b / a**2 for h in pairs for a, b in itertools.pairwise(h)),
        1.0,
    )
    report.claim(
        f"exact tangent, strain {exact[-1]['strain']:g}: order of convergence",
        order(exact[-1]["residuals"]),
        1.7,
        ">=",
    )
    for r in sharp:
        if r["tangent"] == "axial" and r["strain"] >= 1e-2:
            report.claim(
                f"eq. 20 alone, strain {r['strain']:g}: linear factor over strain",
                factor(r["residuals"]) / r["strain"],
                (1.5, 3.0),
                "within",
            )
    hand = [r for r in sharp if r["tangent"] == "hand"]
    if hand:
        report.claim(
            "hand-derived against autodiff tangent: largest difference of residuals",
            max(
                abs(a - b)
                for x, y in zip(exact, hand, strict=True)
                for a, b in zip(x["residuals"], y["residuals"], strict=False)
            ),
            1e-10,
        )


def draw(report: Report, openings, histories, classical: float, fine) -> None:
    """Three panels: fixed m, fixed delta, Newton."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(15, 4.8), layout="constrained")
    gap = np.linspace(1e-4, 1 / 28, 50)
    jump = [fine.displacement_jump(float(h)) / STRAIN for h in gap]
    for ax, case in zip(axes[:2], ("fixed m", "fixed delta"), strict=True):
        ax.axhline(classical, color="k", lw=0.8, label="classical opening (FE)")
        ax.plot(gap, jump, "k--", lw=0.8, label="classical, pair h apart (FE)")
        key = "m" if case == "fixed m" else "delta"
        rows = [r for r in openings if r["case"] == case]
        for value in sorted({round(r[key], 9) for r in rows}):
            line = [r for r in rows if abs(r[key] - value) < 1e-9]
            name = "m" if key == "m" else r"$\delta$"
            unit = "" if key == "m" else " m"
            points = [(1 / r["n"], r["opening"]) for r in line]
            (drawn,) = ax.plot(
                *zip(*points, strict=True),
                "o-",
                label=f"{name} = {value:g}{unit}, tips midway",
            )
            if len(line) < 3:
                continue
            end = (limit if key == "m" else line_limit)(points)
            ax.errorbar(0, *end, fmt="*", ms=9, color=drawn.get_color(), clip_on=False)
            if key == "m":
                expected = classical * lattice_limit(round(value))
                ax.plot(0, expected, "_", ms=18, mew=2, color=drawn.get_color())
        if case == "fixed m":
            rows = [r for r in openings if r["case"] == "doubled" and r["n"] > 16]
            ax.plot(
                [1 / r["n"] for r in rows],
                [r["opening"] for r in rows],
                "x:",
                color="0.4",
                label="m = 8, n = 32, 64, 128",
            )
        ax.plot([], [], "k*", ms=9, label="extrapolated")
        if case == "fixed m":
            ax.plot([], [], "k_", ms=14, mew=2, label="anisotropy of the lattice alone")
        ax.set_xlim(-0.001, 1 / 28)
        ax.set_xlabel("spacing h (m)")
        ax.set_ylabel("crack opening over strain (m)")
        ax.set_title(
            r"$m = \delta / h$ fixed"
            if case == "fixed m"
            else r"$\delta$ fixed: the nonlocal solution"
        )
        ax.legend(fontsize=8, loc="upper left")
    ax = axes[2]
    colours = dict(zip(STRAINS, ("C0", "C1", "C2", "C3"), strict=True))
    for r in histories:
        if r["tangent"] == "hand" or r["rtol"] > 1e-7:
            continue
        exact = r["tangent"] == "ad"
        steps = range(len(r["residuals"]) + 1)
        ax.semilogy(
            steps,
            [1.0, *r["residuals"]],
            "o-" if exact else "s--",
            color=colours[r["strain"]],
            mfc=None if exact else "none",
            ms=5,
            label=f"strain {r['strain']:g}" if exact else None,
        )
    ax.plot([], [], "ko-", label="exact tangent (autodiff)")
    ax.plot([], [], "ks--", mfc="none", label="axial part alone (eq. 20)")
    ax.axhline(1e-6, color="0.6", lw=0.8)
    ax.set_xlabel("Newton step")
    ax.set_ylabel("relative residual")
    ax.set_title("Newton, n = 32, m = 8: quadratic and linear")
    ax.legend(fontsize=8)
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)


if __name__ == "__main__":
    main()
