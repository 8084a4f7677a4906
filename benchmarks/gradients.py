"""The implicit gradient of a solve: its cost, against unrolled AD and differences.

A misfit of the cracked plate's displacements is differentiated in the nodal modulus E,
or in all parameters of the problem. Claimed are the time and the memory of value and
gradient over those of the value alone. Peers are the same CG with a fixed number of
iterations, every one of them differentiated, with all its states kept or computed again
(`jax.checkpoint`), and central differences. Errors are those of the whole gradient, of
differences along one direction, against a solve to 1e-12.

What is compared runs in turns, in one process; ratios are those of the minima. Memory
is what XLA allots: arguments, results and temporaries. Problems and parameters enter
`jit` as arguments.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from _report import Report, is_quick

from jaxpd import Problem, prepare
from jaxpd.gallery import cracked_plate
from jaxpd.solvers.krylov import point_jacobi
from jaxpd.solvers.status import Status

jax.config.update("jax_enable_x64", True)

RTOL, TIGHT, STRAIN = 1e-8, 1e-12, 1e-2
#: Rounds of a comparison: at least, at most, and seconds after which no other begins.
LEAST, MOST, ENOUGH = 3, 9, 6.0
STEPS = tuple(10.0 ** -np.arange(1, 8))
HEAD = (
    "plate",
    "operator",
    "solver",
    "rtol",
    "what",
    "iterations",
    "s",
    "cpu s",
    "wall ratio",
    "cpu ratio",
    "MB",
    "MB ratio",
    "temp ratio",
    "compile s",
    "error",
    "if even",
)


@dataclass(frozen=True)
class Case:
    """A plate and how it is solved.

    Attributes:
        kinematics, operator, solver, n, m: as in `prepare` and `cracked_plate`.
        every: whether the gradient in all parameters is measured too.
        peers: unrolled CG that is measured beside, of `PEERS`.
    """

    kinematics: str
    operator: str
    solver: str
    n: int
    m: int
    every: bool = False
    peers: tuple[str, ...] = ()


#: Peers, and whether their iterations are computed again backwards.
PEERS = {"unrolled": False, "unrolled, checkpoints": True}
BOTH = tuple(PEERS)
CASES = (
    Case("small", "fft", "multigrid", 64, 8, peers=("unrolled",)),
    Case("small", "fft", "d-pcg", 64, 8, every=True),
    Case("small", "stencil", "d-pcg", 64, 8, every=True, peers=("unrolled",)),
    Case("small", "gather", "d-pcg", 64, 4, every=True, peers=BOTH),
    Case("small", "fft", "multigrid", 128, 8),
    Case("small", "fft", "d-pcg", 128, 8),
    Case("small", "stencil", "d-pcg", 128, 8),
    Case("finite", "stencil", "multigrid", 64, 8),
    Case("finite", "stencil", "d-pcg", 64, 8, every=True),
    Case("finite", "gather", "d-pcg", 64, 4, every=True),
)
QUICK = (
    Case("small", "gather", "d-pcg", 16, 4, peers=("unrolled",)),
    Case("finite", "stencil", "d-pcg", 16, 4),
)
SWEEP, RTOLS = Case("small", "gather", "d-pcg", 32, 4), (1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
QUICK_SWEEP, QUICK_RTOLS = Case("small", "gather", "d-pcg", 16, 4), (1e-3, 1e-8)


# What is differentiated: some parameters come first, and take the place of others.


def misfit(u: jax.Array, measured: jax.Array) -> jax.Array:
    """Half of the squared misfit of displacements, relative."""
    return 0.5 * jnp.sum((u - measured) ** 2) / jnp.sum(measured**2)


def loss(some: Any, params: Any, problem: Problem, measured: jax.Array) -> Any:
    """The misfit of a solution, the solution, and how the solve went."""
    u, info = problem.solve(params | some)
    return misfit(u, measured), (u, info)


def unrolled(iterations: int, again: bool) -> Callable[..., Any]:
    """The same for small displacements, by plain CG that AD sees all of."""

    def loss(some: Any, params: Any, problem: Problem, measured: jax.Array) -> Any:
        operator, constraints, load = problem.force(params | some)
        K: Any = operator.tangent(jnp.zeros_like(load))
        project, gap = constraints.project, constraints.lift()
        if problem.linear.method == "d-pcg":
            M = point_jacobi(constraints.diagonal(K.diagonal()))
        else:
            M = lambda r: project(problem.linear.hierarchy.cycle(r))  # noqa: E731

        def step(state, _):
            x, r, p, before = state
            z = M(r)
            rz = jnp.sum(r * z)
            p = z + rz / before * p
            q = project(K.mv(p))
            length = rz / jnp.sum(p * q)
            return (x + length * p, r - length * q, p, rz), None

        b = project(load - K.mv(gap))
        zero = jnp.zeros_like(b)
        begin = (zero, b, zero, jnp.ones((), b.dtype))
        body = jax.checkpoint(step, prevent_cse=False) if again else step
        (x, r, _, _), _ = jax.lax.scan(body, begin, length=iterations)
        u, left = gap + x, jnp.sum(r**2) / jnp.sum(b**2)
        return misfit(u, measured), (u, left)

    return loss


def gradient(function: Callable[..., Any]) -> Callable[..., Any]:
    """Value and gradient in the parameters that come first."""
    return jax.value_and_grad(function, has_aux=True)


# How it is measured.


@dataclass(frozen=True)
class Run:
    """A compiled function with its arguments.

    Attributes:
        ready: the function.
        arguments: as compiled for; others may have other numbers.
        facts: seconds of compilation, and bytes.
    """

    ready: Callable[..., Any]
    arguments: tuple[Any, ...]
    facts: dict[str, float]

    def __call__(self) -> Any:
        """Run it and wait for the results."""
        return jax.block_until_ready(self.ready(*self.arguments))


def compiled(function: Callable[..., Any], *arguments: Any) -> Run:
    """Compile a function for some arguments."""
    wall, cpu = time.perf_counter(), time.process_time()
    ready = jax.jit(function).lower(*arguments).compile()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    memory: Any = ready.memory_analysis()
    temp = memory.temp_size_in_bytes
    rest = memory.argument_size_in_bytes + memory.output_size_in_bytes
    facts = {"compile s": wall, "compile cpu s": cpu}
    return Run(ready, arguments, facts | {"temp bytes": temp, "bytes": rest + temp})


def race(runs: dict[str, Run]) -> tuple[dict[str, Any], dict[str, dict[str, float]]]:
    """Run all in turns: results, and the least wall and processor seconds of each."""
    results = {name: run() for name, run in runs.items()}  # warm-up
    walls: dict[str, list[float]] = {name: [] for name in runs}
    cpus: dict[str, list[float]] = {name: [] for name in runs}
    begin = time.perf_counter()
    for turn in range(MOST):
        if turn >= LEAST and time.perf_counter() - begin > ENOUGH:
            break
        for name, run in runs.items():
            wall, cpu = time.perf_counter(), time.process_time()
            run()
            cpus[name].append(time.process_time() - cpu)
            walls[name].append(time.perf_counter() - wall)
    seconds = {
        name: {
            "seconds": min(walls[name]),
            "cpu seconds": min(cpus[name]),
            "rounds": len(walls[name]),
        }
        for name in runs
    }
    return results, seconds


def rows_of(case: Case, runs: dict[str, Run], rtol: float) -> tuple[list, dict]:
    """A row of every run, with ratios over the run "value" if there is one."""
    results, seconds = race(runs)
    rows = []
    for name, run in runs.items():
        row = {"what": name, "rtol": rtol} | dataclasses.asdict(case)
        row |= seconds[name] | run.facts
        if "value" in runs:
            for ratio, key in (
                ("wall ratio", "seconds"),
                ("cpu ratio", "cpu seconds"),
                ("memory ratio", "bytes"),
                ("temp ratio", "temp bytes"),
            ):
                one = seconds["value"] | runs["value"].facts
                row[ratio] = row[key] / one[key]
        rows.append(row)
    return rows, results


@dataclass(frozen=True)
class Setting:
    """A problem at its parameters, with measurements of a body a little stiffer."""

    problem: Problem
    params: Any
    measured: jax.Array
    direction: jax.Array

    def arguments(self, *names: str) -> tuple[Any, ...]:
        """Those of `loss`, with some parameters to differentiate."""
        some = {name: self.params[name] for name in names}
        return some, self.params, self.problem, self.measured

    def to(self, rtol: float) -> Setting:
        """The same, solved to another tolerance."""
        problem = self.problem
        newton = dataclasses.replace(problem.spec.newton, rtol=rtol)
        problem = dataclasses.replace(
            problem,
            spec=dataclasses.replace(problem.spec, newton=newton),
            linear=dataclasses.replace(problem.linear, rtol=rtol),
        )
        return dataclasses.replace(self, problem=problem)


def setting(case: Case) -> tuple[Setting, Run]:
    """Prepare a case, and compile its value alone.

    Small displacements are loaded by forces, finite ones by grips. The modulus varies
    by a tenth, so that nothing is symmetric: CG of a symmetric load never leaves the
    symmetric displacements, and unrolled it knows of no others. The data are those of
    a plate that is stiffer by up to another tenth beside the crack.
    """
    loading = "band" if case.kinematics == "small" else "displacement"
    plate = cracked_plate(
        case.n, case.m, strain=STRAIN, kinematics=case.kinematics, loading=loading
    )
    problem = prepare(plate, operator=case.operator, solver=case.solver, rtol=RTOL)
    x, y = np.asarray(problem.X).T
    E = np.asarray(problem.params["E"]) * (1 + 0.1 * np.sin(3 * x + 5 * y + 1))
    bump = 0.1 * E * np.exp(-((x - 0.2) ** 2 + (y - 0.1) ** 2) / 0.02)
    problem, params, bump, nothing = jax.device_put(
        (problem, problem.params | {"E": E}, bump, np.ones(problem.X.shape))
    )
    run = compiled(loss, *Setting(problem, params, nothing, bump).arguments())
    stiffer = params | {"E": params["E"] + bump}
    u, info = run.ready({}, stiffer, problem, nothing)[1]
    good(info)
    at = Setting(problem, params, u, bump)
    return at, dataclasses.replace(run, arguments=at.arguments())


def good(info: Any) -> None:
    """Stop at a solve that did not converge."""
    if int(info.status) != Status.CONVERGED:
        raise RuntimeError(f"status {Status(int(info.status)).name}")


def krylov(info: Any) -> list[int]:
    """Linear iterations of every Newton iteration."""
    return [int(k) for k in info.linear_iterations[: int(info.iterations)]]


def far(some: Any, other: Any, name: str) -> float:
    """Relative distance of two gradients in one parameter."""
    a, b = np.asarray(some[name]), np.asarray(other[name])
    return float(np.linalg.norm(a - b) / np.linalg.norm(b))


def reference(at: Setting, *names: str) -> Run:
    """The gradient by a solve to `TIGHT`."""
    return compiled(gradient(loss), *at.to(TIGHT).arguments(*names))


def gradient_of(run: Run, at: Setting | None = None) -> Any:
    """The gradient of a run, at other values of its parameters if they are given."""
    arguments = run.arguments
    if at is not None:
        some = {name: at.params[name] for name in arguments[0]}
        arguments = (some, at.params, *arguments[2:])
    (_, (_, how)), found = run.ready(*arguments)
    if hasattr(how, "status"):
        good(how)
    return found


# The parts.


def cost(case: Case) -> list[dict[str, Any]]:
    """Value alone, with gradients, and with those of the peers if asked for."""
    at, value = setting(case)
    runs = {"value": value}
    runs["gradient in E"] = compiled(gradient(loss), *at.arguments("E"))
    if case.every:
        some = at.arguments(*at.params)
        runs["gradient in all"] = compiled(gradient(loss), *some)
    info = value()[1][1]
    good(info)
    counts = krylov(info)
    for name in case.peers:
        peer = gradient(unrolled(counts[0], PEERS[name]))
        runs[name] = compiled(peer, *at.arguments("E"))
    rows, results = rows_of(case, runs, RTOL)
    for row in rows:
        row["iterations"] = counts
        row["newton"] = len(counts) if case.kinematics == "finite" else 0
    if not case.peers:
        return rows
    exact = reference(at, "E")
    E = jnp.full_like(at.params["E"], jnp.mean(at.params["E"]))
    even = dataclasses.replace(at, params=at.params | {"E": E})
    for row in rows[1:]:
        run = runs[row["what"]]
        row["error"] = far(results[row["what"]][1], gradient_of(exact), "E")
        found = gradient_of(run, even)
        row["error, even modulus"] = far(found, gradient_of(exact, even), "E")
    return rows


def differences(at: Setting, value: Run, exact: Any) -> dict[str, Any]:
    """Errors of central differences at all steps, in alpha and along one direction."""
    toward = {"alpha": jnp.ones(()), "E": 10.0 * at.direction}
    found: dict[str, Any] = {"steps": list(STEPS)}
    for name, way in toward.items():
        slope = float(jnp.sum(exact[name] * way))

        def along(h, name=name, way=way):
            moved = at.params | {name: at.params[name] + h * way}
            return float(value.ready({}, moved, at.problem, at.measured)[0])

        found[f"errors in {name}"] = [
            abs((along(h) - along(-h)) / (2 * h) / slope - 1.0) for h in STEPS
        ]
    return found


def sweep(case: Case, rtols: tuple[float, ...]) -> list[dict[str, Any]]:
    """Error of gradients against time, by the tolerance of the solve."""
    at, _ = setting(case)
    names = ("E", "alpha")
    exact = gradient_of(reference(at, *names))
    rows = []
    for rtol in rtols:
        now = at.to(rtol)
        arguments = now.arguments(*names)
        value = compiled(loss, *now.arguments())
        info = value()[1][1]
        good(info)
        count = krylov(info)
        peer = gradient(unrolled(count[0], False))
        runs = {
            "value": value,
            "implicit": compiled(gradient(loss), *arguments),
            "unrolled": compiled(peer, *arguments),
        }
        some, results = rows_of(case, runs, rtol)
        for row in some[1:]:
            found = results[row["what"]][1]
            row["error"] = far(found, exact, "E")
            row["error in alpha"] = far(found, exact, "alpha")
            slope, right = (
                float(jnp.sum(g["E"] * at.direction)) for g in (found, exact)
            )
            row["error along one direction"] = abs(slope / right - 1.0)
        row = {"what": "differences", "rtol": rtol} | dataclasses.asdict(case)
        row |= {key: 2 * some[0][key] for key in ("seconds", "cpu seconds")}
        row |= differences(now, value, exact)
        row["error in alpha"] = min(row["errors in alpha"])
        row["error along one direction"] = min(row["errors in E"])
        # of the whole gradient: computed, not run
        row["parameters"] = int(np.size(at.params["E"]))
        row["seconds of the whole"] = row["seconds"] * row["parameters"]
        rows += [r | {"iterations": count, "sweep": True} for r in (*some[1:], row)]
    return rows


def line(row: dict[str, Any]) -> list[Any]:
    """A row as the table shows it."""

    def number(key: str, form: str, scale: float = 1.0) -> str | None:
        return format(row[key] * scale, form) if key in row else None

    error = "error" if "error" in row else "error along one direction"
    return [
        f"{row['n']}, m = {row['m']}",
        f"{row['operator']}, {row['kinematics']}",
        row["solver"],
        f"{row['rtol']:.0e}",
        row["what"],
        "+".join(map(str, row["iterations"])),
        number("seconds", ".3f"),
        number("cpu seconds", ".3f"),
        number("wall ratio", ".2f"),
        number("cpu ratio", ".2f"),
        number("bytes", ".1f", 1e-6),
        number("memory ratio", ".2f"),
        number("temp ratio", ".2f"),
        number("compile s", ".1f"),
        number(error, ".1e"),
        number("error, even modulus", ".1e"),
    ]


def add_claims(report: Report) -> None:
    """The claims on the rows at hand."""
    costs = [r for r in report.rows if "sweep" not in r]

    def worst(what: str, kinematics: str, key: str) -> list[float]:
        return [
            r[key] for r in costs if r["what"] == what and r["kinematics"] == kinematics
        ]

    for kinematics, bound, name in (
        ("small", 2.6, "linear"),
        ("finite", 1.8, "Newton"),
    ):
        for what in ("gradient in E", "gradient in all"):
            for key, limit in (
                ("wall ratio", bound),
                ("cpu ratio", bound),
                ("memory ratio", 2.0),
            ):
                found = worst(what, kinematics, key)
                if found:
                    report.claim(
                        f"{name}, value and {what} over value, {key}, largest of "
                        f"{len(found)}",
                        max(found),
                        limit,
                    )
    steps = [r["newton"] for r in costs if r["kinematics"] == "finite"]
    report.claim("Newton iterations of those, most", max(steps), 3)
    by_case: dict[tuple[Any, ...], dict[str, Any]] = {}
    for r in costs:
        if r["peers"]:
            key = (r["operator"], r["solver"], r["n"])
            by_case.setdefault(key, {})[r["what"]] = r
    for peer in PEERS:
        for key in ("seconds", "bytes", "compile s"):
            ratio = [
                c[peer][key] / c["gradient in E"][key]
                for c in by_case.values()
                if peer in c
            ]
            if ratio:
                report.claim(
                    f"{peer} over implicit, {key}, least of {len(ratio)}",
                    min(ratio),
                    1.0,
                    ">=",
                )
    errors = [c["gradient in E"]["error"] for c in by_case.values()]
    report.claim(f"error of the implicit gradient at {RTOL:.0e}", max(errors), 1e-5)
    found = [
        r["error"] for r in report.rows if "sweep" in r and r["what"] == "unrolled"
    ]
    report.claim("unrolled CG at the tightest against implicit", min(found), 1e-6)
    rows = [r for r in report.rows if r["what"] == "differences"]
    best = min(r["error along one direction"] for r in rows)
    report.claim("differences and implicit along one direction, nearest", best, 1e-6)
    whole = next(r for r in rows if r["rtol"] == RTOL)
    implicit = next(
        r
        for r in report.rows
        if "sweep" in r and r["what"] == "implicit" and r["rtol"] == RTOL
    )
    report.claim(
        f"a gradient in {whole['parameters']} parameters by differences (computed, not "
        "run) over the implicit one, seconds",
        whole["seconds of the whole"] / implicit["seconds"],
        1000.0 if not report.quick else 1.0,
        ">=",
    )


def draw(report: Report) -> None:
    """Error of the gradient against seconds, and of differences against their step."""
    import matplotlib.pyplot as plt

    rows = [r for r in report.rows if "sweep" in r]
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.5), layout="constrained")
    direction = "error along one direction"
    for what, seconds, error, label, style in (
        ("implicit", "seconds", "error", "implicit", "C0o-"),
        ("unrolled", "seconds", "error", "unrolled CG", "C1s-"),
        ("differences", "seconds", direction, "differences, one direction", "C2^-"),
        (
            "differences",
            "seconds of the whole",
            direction,
            "differences, all of E (computed)",
            "C2^:",
        ),
    ):
        some = [r for r in rows if r["what"] == what]
        left.loglog([r[seconds] for r in some], [r[error] for r in some], style)
        left.lines[-1].set_label(label)
    left.set_xlabel("wall time, warm (s)")
    left.set_ylabel("relative error of the gradient")
    left.set_title("One point a tolerance of the solve")
    for k, r in enumerate(r for r in rows if r["what"] == "differences"):
        for name, style in (("E", "-"), ("alpha", "--")):
            right.loglog(r["steps"], r[f"errors in {name}"], f"C{k}{style}")
            right.lines[-1].set_label(f"{name}, rtol {r['rtol']:.0e}")
    right.set_xlabel("step (relative for E)")
    right.set_ylabel("relative error of the derivative")
    right.set_title("Central differences")
    for ax in (left, right):
        ax.grid(which="both", alpha=0.2)
        ax.legend(fontsize=8)
    path = report.picture()
    figure.savefig(path.with_name(path.name.replace("gradients", "gradient_precision")))
    plt.close(figure)


def main() -> None:
    """Every case, then the tolerances."""
    report = Report("gradients", is_quick(__doc__))
    for case in QUICK if report.quick else CASES:
        rows = cost(case)
        report.rows += rows
        jax.clear_caches()
        for row in rows if not report.quick else ():
            print(line(row), flush=True)
    chosen = (QUICK_SWEEP, QUICK_RTOLS) if report.quick else (SWEEP, RTOLS)
    report.rows += sweep(*chosen)
    add_claims(report)
    report.notes += [
        "ratios are over the value alone, of the same plate and tolerance; temp: "
        "temporaries without arguments and results",
        "iterations: of CG, one number a Newton iteration; unrolled CG takes as many",
        "differences: two solves, one direction, the step chosen with knowledge of the "
        "answer",
        "linear solves were aimed at a ratio of 2.2",
        "if even: the error with an even modulus, where the plate is symmetric and the "
        "gradient is not; unrolled CG of a symmetric load has then seen only half of "
        "the spectrum",
    ]
    draw(report)
    report.finish(HEAD, [line(row) for row in report.rows])


if __name__ == "__main__":
    main()
