"""Tables 1 to 7 of the cracked-plate paper, printed and ours.

Condition numbers by Lanczos, iterations of CG and of diagonally preconditioned CG for
the first Newton step: at the tolerance that reproduces the print (body force in a band,
4e-5) and at an honest 1e-6 under both loadings; beside them CG with multigrid (Tables 4
and 7) and with algebraic multigrid. The tolerance and the loading were found by
comparison: the paper states 1e-6, which does not give its counts.

All products are by convolution; residuals of multigrid are confirmed by the stencil.
"""

from __future__ import annotations

import time
from typing import Any

import jax
import numpy as np
from _report import Report, is_quick

from jaxpd import prepare
from jaxpd.gallery import (
    ALPHAS,
    PRINTED_CG,
    PRINTED_CG_BY_M,
    PRINTED_CONDITION,
    PRINTED_DPCG,
    PRINTED_DPCG_BY_M,
    PRINTED_MG,
    PRINTED_MG_BY_M,
    PRINTED_RTOL,
    RATIOS,
    cracked_plate,
)
from jaxpd.operators import Constraints
from jaxpd.problem import host_system
from jaxpd.solvers import extremes
from jaxpd.solvers.linear import linear_solver, solve_system

jax.config.update("jax_enable_x64", True)

RTOL = 1e-6
#: Ratios to the print at 1/32 without surface correction, from the study of the tables.
WITHOUT_CORRECTION = (1.025, 1.012, 0.979, 0.827, 0.750, 0.710)
LOADINGS = ("band", "displacement")
HEAD = (
    "n",
    "m",
    "alpha",
    "unknowns",
    "kappa:print",
    "ours",
    "dev %",
    "uncorrected",
    "CG:print",
    "4e-5",
    "1e-6 band",
    "displ",
    "D-PCG:print",
    "4e-5",
    "1e-6 band",
    "displ",
    "MG:print",
    "4e-5",
    "1e-6 band",
    "displ",
    "AMG:band",
    "displ",
    "levels",
    "complexity",
)


def count(info, rtol: float) -> int:
    """Iterations until the relative residual was first within `rtol`; -1 if never."""
    inside = np.flatnonzero(np.asarray(info.residuals) <= rtol)
    return int(inside[0]) if info.status == 0 and len(inside) else -1


def condition(K: Any, constraints: Constraints) -> float:
    """Condition number of the stiffness of the free unknowns."""
    start = jax.random.normal(jax.random.key(0), constraints.fixed.shape)
    mv = lambda v, K, P: P.project(K.mv(v))  # noqa: E731
    return extremes(mv, constraints.project(start), K, constraints).condition


product = jax.jit(lambda K, u: K.mv(u))


def confirmed(K: Any, constraints: Constraints, b: Any, x: Any) -> float:
    """Relative residual by the exact stencil."""
    left = np.where(constraints.fixed, 0.0, b - product(K.lattice, x))
    return float(np.linalg.norm(left) / np.linalg.norm(b))


def printed(n: int, m: int, alpha: float) -> dict[str, float | None]:
    """What the paper prints for a case."""
    if m == 8:
        at = ALPHAS.index(alpha)
        tables = (PRINTED_CONDITION[n], PRINTED_CG[n], PRINTED_DPCG[n], PRINTED_MG[n])
    elif m in RATIOS:
        at = RATIOS.index(m)
        tables = (
            None,
            PRINTED_CG_BY_M[n],
            PRINTED_DPCG_BY_M[n],
            PRINTED_MG_BY_M[n],
        )
    else:
        at, tables = 0, (None,) * 4
    names = ("kappa", "cg", "d-pcg", "mg")
    return {k: t[at] if t else None for k, t in zip(names, tables, strict=True)}


def measure(n: int, m: int, alpha: float, kappa: bool, plain: bool, amg: bool) -> dict:
    """One row: a case of the tables."""
    start = time.perf_counter()
    row: dict = {"n": n, "m": m, "alpha": alpha, "printed": printed(n, m, alpha)}
    hierarchies: dict[str, Any] = {}
    for loading in LOADINGS:
        scene = cracked_plate(n, m, alpha, loading=loading, kinematics="small")
        problem = prepare(scene, solver="pcg")
        K, constraints, b = host_system(problem)
        row["unknowns"] = int((~np.asarray(constraints.fixed)).sum())
        if kappa and loading == "band":
            row["kappa"] = condition(K, constraints)
        wanted = {"cg": "pcg", "d-pcg": "d-pcg"} if plain else {}
        for label, method in (wanted | {"mg": "multigrid"}).items():
            if method == "multigrid" and method not in hierarchies:
                begin = time.perf_counter()
                hierarchies[method] = problem.solver(method).hierarchy
                row["mg setup seconds"] = time.perf_counter() - begin
            solver = linear_solver(method, RTOL, hierarchy=hierarchies.get(method))
            x, info = solve_system(solver, K, constraints, b)
            row[f"{label} {loading}"] = count(info, RTOL)
            # the first residual within the looser tolerance of the same iteration
            row[f"{label} {loading} printed rtol"] = count(info, PRINTED_RTOL)
            if label == "mg":
                row[f"residual {loading}"] = confirmed(K, constraints, b, x)
        if amg:
            # K is the same for both loads: one hierarchy serves both
            if "amg" not in hierarchies:
                hierarchies["amg"] = problem.solver("amg").hierarchy
            solver = linear_solver("amg", RTOL, hierarchy=hierarchies["amg"])
            _, info = solve_system(solver, K, constraints, b)
            row[f"amg {loading}"] = count(info, RTOL)
    if amg:
        hierarchy = hierarchies["amg"]
        row["levels"] = hierarchy.levels
        row["sizes"] = [int(size) for size in hierarchy.sizes]
        row["complexity"] = hierarchy.complexity
        row["amg setup seconds"] = hierarchy.seconds
    row["seconds"] = time.perf_counter() - start
    return row


def deviation(row: dict) -> float | None:
    """Relative deviation of the condition number from the print."""
    if row.get("kappa") is None or row["printed"]["kappa"] is None:
        return None
    return row["kappa"] / row["printed"]["kappa"] - 1.0


def line(row: dict) -> list:
    """A row as the table shows it."""
    p, dev = row["printed"], deviation(row)
    tail = " printed rtol"
    cells = [row["n"], row["m"], row["alpha"], row["unknowns"], p["kappa"]]
    cells += [row.get("kappa"), None if dev is None else f"{100 * dev:+.2f}"]
    cells += [f"{row['control'] / p['kappa']:.3f}" if "control" in row else None]
    for label in ("cg", "d-pcg", "mg"):
        cells += [p[label], row.get(f"{label} band{tail}")]
        cells += [row.get(f"{label} {loading}") for loading in LOADINGS]
    cells += [row.get(f"amg {loading}") for loading in LOADINGS]
    return [*cells, row.get("levels"), row.get("complexity")]


def add_claims(report: Report) -> None:
    """The claims on the rows at hand."""
    rows = report.rows
    for n, bound in ((32, 0.015), (64, 0.01), (128, 0.01)):
        found = [abs(d) for r in rows if r["n"] == n and (d := deviation(r))]
        if found:
            report.claim(
                f"Table 1, n = {n}, {len(found)} alphas: largest relative deviation",
                max(found),
                bound,
            )
    control = [r for r in rows if "control" in r]
    if control:
        off = [
            abs(
                r["control"] / r["printed"]["kappa"]
                - WITHOUT_CORRECTION[ALPHAS.index(r["alpha"])]
            )
            for r in control
        ]
        report.claim(
            "control, n = 32 without surface correction: largest distance of the "
            "ratios to the print from those of the study (1.025 .. 0.710)",
            max(off),
            0.002,
        )
    for n, bound in ((32, 1), (64, 5), (128, None), (256, None)):
        for label in ("cg", "d-pcg"):
            name = f"{label} band printed rtol"
            gaps = [
                abs(r[name] - r["printed"][label])
                for r in rows
                if r["n"] == n and name in r and r["printed"][label]
            ]
            if gaps and bound is not None:
                report.claim(
                    f"{label.upper()} counts at 4e-5, n = {n}, {len(gaps)} cases: "
                    "largest distance from the print",
                    max(gaps),
                    bound,
                )
            elif gaps:
                report.notes.append(
                    f"{label.upper()} counts at 4e-5, n = {n}, were not fitted: largest"
                    f" distance from the print {max(gaps)} over {len(gaps)} cases"
                )
    for loading in LOADINGS:
        known = [r for r in rows if r["printed"]["mg"]]
        report.claim(
            f"multigrid to a true 1e-6, {loading}, {len(known)} cases: most iterations "
            "beyond the printed ones",
            max(
                r[f"mg {loading}"] - r["printed"]["mg"]
                if r[f"mg {loading}"] >= 0
                else np.inf
                for r in known
            ),
            0,
        )
        over = [
            f"n = {r['n']}, m = {r['m']}, alpha = {r['alpha']:g}: {r[f'mg {loading}']} "
            f"for {r['printed']['mg']}"
            for r in known
            if r[f"mg {loading}"] > r["printed"]["mg"]
        ]
        if over:
            report.notes.append(f"beyond the print, {loading}: {'; '.join(over)}")
    report.claim(
        "multigrid, band load, at the tolerance of the printed counts, 4e-5: most "
        "iterations beyond the printed ones",
        max(
            r["mg band printed rtol"] - r["printed"]["mg"]
            for r in rows
            if r["printed"]["mg"]
        ),
        0,
    )
    report.claim(
        "largest residual of multigrid by the exact stencil",
        max(r[f"residual {loading}"] for r in rows for loading in LOADINGS),
        1.1e-6,
    )
    amg = [r for r in rows if "levels" in r]
    if amg:
        counts = [r[f"amg {loading}"] for r in amg for loading in LOADINGS]
        worst = max(counts) if min(counts) >= 0 else np.inf
        report.claim(f"AMG-PCG to 1e-6, {len(amg)} cases, both loads", worst, 10)
        report.claim(
            "AMG levels where n = 64",
            min(r["levels"] for r in amg if r["n"] >= 64),
            3,
            ">=",
        )


def main() -> None:
    """Run the tables."""
    report = Report("paper_statics", is_quick(__doc__))
    #       n    m   alphas            kappa  plain  amg
    cases = [
        (32, 8, ALPHAS, True, True, True),
        (32, 4, (0.0,), False, True, True),
        (32, 16, (0.0,), False, True, True),
    ]
    if report.quick:
        cases = [(32, 8, (1.9,), True, True, True)]
        cases += [(64, 8, (0.0,), False, True, True)]
    else:
        cases += [
            (64, 8, ALPHAS, True, True, True),
            (64, 3, (0.0,), False, True, True),
            (64, 4, (0.0,), False, True, True),
            (64, 16, (0.0,), False, True, True),
            (128, 8, ALPHAS, True, True, False),
            (128, 4, (0.0,), False, True, False),
            (128, 16, (0.0,), False, True, False),
            (256, 8, ALPHAS, False, True, False),
            (256, 4, (0.0,), False, True, False),
            (256, 16, (0.0,), False, True, False),
        ]
    for n, m, alphas, kappa, plain, amg in cases:
        for alpha in alphas:
            row = measure(n, m, alpha, kappa, plain, amg)
            if (n, m) == (32, 8):
                scene = cracked_plate(
                    n, m, alpha, correction="none", kinematics="small"
                )
                row["control"] = condition(*host_system(prepare(scene))[:2])
            report.rows.append(row)
    add_claims(report)
    report.notes += [
        "printed counts: band load, 4e-5 (found by comparison, the paper states 1e-6); "
        "not identified: the load's width, the tolerance, n = 128 at alpha = -3",
        f"{sum(r['seconds'] for r in report.rows):.0f} s in all",
    ]
    report.finish(HEAD, [line(row) for row in report.rows])


if __name__ == "__main__":
    main()
