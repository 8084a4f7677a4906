"""The main job: solve the cracked plate of paper 000 and check it on the way."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd import __version__, gallery, plot
from jaxpd.problem import Problem, first_system
from jaxpd.run import Solution, peak_memory, solve_static
from jaxpd.solvers.krylov import KrylovInfo
from jaxpd.solvers.linear import METHODS, solve_system
from jaxpd.solvers.spectrum import extremes
from jaxpd.solvers.status import NotConverged, Status, describe

RTOL = 1e-6
COMPARED = {
    "CG": "pcg",
    "D-PCG": "d-pcg",
    "Spectral-PCG": "spectral",
    "Multigrid-PCG": "multigrid",
    "AMG-PCG": "amg",
}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m jaxpd",
        description="Solve the cracked plate of Jo & Ha (2021): 1 m square, central "
        "crack of 0.3 m, E = 30 GPa, nu = 1/3, plane stress, stretched by moving its "
        "top and bottom rows. Prints one table and writes cracked_plate.png.",
    )
    add = parser.add_argument
    add("--n", type=int, default=64, help="spacings a side, h = 1/n (default 64)")
    add("--m", type=float, default=8.0, help="horizon over spacing (default 8)")
    add(
        "--alpha",
        type=float,
        default=0.0,
        help="order of the kernel 1/r^(2+alpha), below 2 (default 0)",
    )
    add("--strain", type=float, default=1e-3, help="mean strain (default 1e-3)")
    add(
        "--solver",
        choices=("auto", *METHODS),
        default="auto",
        help="linear solver of Newton's method (default auto)",
    )
    add("--out", type=Path, default=Path(), help="folder for the picture (default .)")
    add("--json", action="store_true", help="print JSON instead of the table")
    add("--version", action="version", version=f"jaxpd {__version__}")
    return parser


def _refuse_absurd(parser: argparse.ArgumentParser, args: argparse.Namespace) -> None:
    if not 8 <= args.n <= 256:
        parser.error(f"--n: {args.n} must lie between 8 and 256")
    if not 2 <= args.m <= args.n / 2:
        parser.error(
            f"--m: {args.m:g} must lie between 2 and n / 2 = {args.n / 2:g}; "
            f"add --m {args.n // 4} or a larger --n"
        )
    bonds = args.n**2 * np.pi * args.m**2
    if bonds > 2e7:
        parser.error(
            f"--m: {args.m:g} with --n {args.n} makes {bonds:.1e} bonds, more than "
            "2e7 (about 3 GB with AMG); lower one of them"
        )
    if not args.alpha < 2:
        parser.error(
            f"--alpha: {args.alpha:g} must be below 2, where the energy diverges"
        )
    if args.alpha < -20:
        parser.error(f"--alpha: {args.alpha:g} must be at least -20")
    if not 0 < abs(args.strain) <= 0.2:
        parser.error(
            f"--strain: {args.strain:g} must be non-zero and at most 0.2 in size"
        )


@jax.jit
def _block_difference(problem: Problem, u: jax.Array) -> jax.Array:
    """Largest difference of AD and hand-derived blocks, relative to each block."""
    operator: Any = problem.build(problem.params)[0]
    ad = operator.tangent(u).parts
    hand = type(operator)(**{**vars(operator), "blocks": "hand"}).tangent(u).parts
    size = jnp.max(jnp.abs(hand), axis=1)
    apart = jnp.max(jnp.abs(ad - hand), axis=1)
    return jnp.max(apart / jnp.where(size > 0, size, 1.0))


def _compare(problem: Problem) -> dict[str, dict[str, Any]]:
    """Iterations and history of each solver on the first Newton system."""
    system = first_system(problem)
    found = {}
    for name, method in COMPARED.items():
        start = time.perf_counter()
        solver = problem.solver(method, RTOL)
        _, info = jax.block_until_ready(solve_system(solver, *system))
        found[name] = _summary(info) | {"seconds": time.perf_counter() - start}
        if hasattr(solver.hierarchy, "sizes"):
            found[name]["levels"] = len(solver.hierarchy.sizes)
    return found


def _summary(info: KrylovInfo) -> dict[str, Any]:
    count = int(info.iterations)
    residuals = np.asarray(info.residuals)[: count + 1]
    status = Status(int(info.status))
    if status is not Status.CONVERGED:
        raise NotConverged(status, residuals, "first linear system")
    return {"iterations": count, "residuals": residuals.tolist()}


def _condition(problem: Problem) -> float:
    K, constraints, b = first_system(problem)
    rng = np.random.default_rng(0)
    start = constraints.project(jnp.asarray(rng.normal(size=b.shape)))
    found = extremes(lambda v, K, P: P.project(K.mv(v)), start, K, constraints)
    return found.condition


def _printed(n: int, m: float, alpha: float) -> float | None:
    if m == 8 and n in gallery.PRINTED_CONDITION and alpha in gallery.ALPHAS:
        return gallery.PRINTED_CONDITION[n][gallery.ALPHAS.index(alpha)]
    return None


def _draw(path: Path, solution: Solution, report: dict[str, Any]) -> None:
    figure = plot.new_figure(1, 3, 14.0, 4.4)
    left, middle, right = figure.axes
    plot.deformed(solution, left)
    opening = report["opening over strain (m)"]
    left.set_xlabel(f"x (m); opening / strain = {opening:.4f} m")
    histories = {k: v["residuals"] for k, v in report["solvers"].items()}
    plot.residual_histories(histories, middle, RTOL)
    middle.set_title("linear solvers, first Newton system")
    newton = {report["solver"]: [1.0, *report["Newton residuals"]]}
    plot.residual_histories(newton, right, RTOL)
    right.set_title(f"Newton's method, strain {report['strain']:g}")
    figure.savefig(path, dpi=110)


def _table(report: dict[str, Any]) -> str:
    rows = []
    for key, value in report.items():
        if key == "solvers":
            for name, solver in value.items():
                levels = f", {solver['levels']} levels" if "levels" in solver else ""
                cold = f"{solver['seconds']:.1f} s cold{levels}"
                line = f"{solver['iterations']} ({cold})"
                rows.append((f"{name} iterations to {RTOL:g}", line))
        elif key == "Newton residuals":
            rows.append((key, ", ".join(f"{r:.1e}" for r in value)))
        elif isinstance(value, float):
            rows.append((key, f"{value:.4g}"))
        else:
            rows.append((key, "-" if value is None else str(value)))
    width = max(len(name) for name, _ in rows)
    return "\n".join(f"{name:<{width}}  {value}" for name, value in rows)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the main job; returns the exit status."""
    started = time.perf_counter()
    parser = _parser()
    args = parser.parse_args(argv)
    _refuse_absurd(parser, args)
    try:
        plot.pyplot()
        args.out.mkdir(parents=True, exist_ok=True)
    except (ModuleNotFoundError, OSError) as error:
        parser.error(str(error))
    jax.config.update("jax_enable_x64", True)
    scene = gallery.cracked_plate(args.n, args.m, args.alpha, args.strain)
    solution = solve_static(scene, solver=args.solver, rtol=RTOL)
    if solution.status is not Status.CONVERGED:
        print(describe(solution.status, solution.residuals, "Newton"), file=sys.stderr)
        return 1
    problem = solution.problem
    free = int((~np.asarray(problem.fixed)).sum())
    report: dict[str, Any] = {
        "n, m, alpha": f"{args.n}, {args.m:g}, {args.alpha:g}",
        "strain": args.strain,
        "points": solution.X.shape[0],
        "bonds": problem.family.n_bonds,
        "free unknowns": free,
        "condition number, printed": _printed(args.n, args.m, args.alpha),
        "condition number, ours": _condition(problem),
        "solvers": _compare(problem),
        "solver": problem.linear.method,
        "Newton steps": solution.iterations,
        "Newton residuals": solution.residuals.tolist(),
        "opening over strain (m)": solution.opening(gallery.CRACK) / args.strain,
        "AD against hand-derived blocks": float(_block_difference(problem, solution.u)),
        "prepare (s)": solution.seconds["prepare"],
        "solve, compilation included (s)": solution.seconds["solve"],
    }
    picture = args.out / "cracked_plate.png"
    _draw(picture, solution, report)
    report |= {
        "whole run (s)": time.perf_counter() - started,
        "peak memory (MB)": peak_memory() / 1e6,
        "picture": str(picture),
    }
    print(json.dumps(report, indent=1) if args.json else _table(report))
    return 0
