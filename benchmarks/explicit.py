"""The explicit step against NumPy, numba and C; its gradient; a million points in 3-D.

Rates are directed bond updates per second of processor time, all threads counted, with
irreversible breaking on; the least time of several repeats, peers interleaved. C is one
thread over the whole neighbourhood, or half of it, built with -O3 -march=native
-fno-math-errno -fno-trapping-math. Peers that need numba or gcc are left out where
those are missing.
"""

from __future__ import annotations

import resource
import time
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from _explicit_peers import (
    PEERS,
    Case,
    make_case,
    numba_cloud,
    numpy_neighbour_list,
)
from _report import Report, asked_part, fresh, is_quick

import jaxpd
from jaxpd.geometry import find, find_on_grid, from_points, lattice
from jaxpd.geometry.grid_family import inside
from jaxpd.launch import longest_dt
from jaxpd.operators.halves import HalfForce
from jaxpd.operators.row import start_bits
from jaxpd.operators.slots import SlotForce, curve
from jaxpd.solvers.explicit import Drive, State, begin, verlet

jax.config.update("jax_enable_x64", True)

HEAD = ("case", "dtype", "peer", "G bonds/s", "ours over it", "compile cpu-s", "error")


def idle(steps: int) -> Any:
    """No loads, no moves."""
    return (np.zeros((steps, 0)),) * 4


class Ours:
    """A step of jaxpd, compiled for a number of steps."""

    def __init__(self, op: Any, u0: Any, v0: Any, mass: Any, bits: Any, dt: float):
        dtype = u0.dtype
        masses: Any = op.lay(np.broadcast_to(mass, len(u0)))
        masses = jnp.asarray(jnp.where(masses > 0, masses, 1.0), dtype)
        drive = Drive(masses, jnp.zeros((0, u0.shape[1], 1), dtype), None, None)
        self.op = op

        @jax.jit
        def start(op: Any, u: Any, v: Any, bits: Any) -> State:
            return begin(op, op.lay(u), op.lay(v), bits)

        self.args = (op, drive, start(op, u0, v0, bits), dt)

    def compile(self, steps: int) -> float:
        """Compile for so many steps; processor seconds."""
        before = time.process_time()
        lowered = jax.jit(verlet).lower(*self.args, idle(steps))
        self.compiled, self.steps = lowered.compile(), steps
        return time.process_time() - before

    def run(self) -> tuple[float, Any]:
        """Processor seconds of the steps, and the displacements."""
        before = time.process_time()
        state = jax.block_until_ready(self.compiled(*self.args, idle(self.steps)))
        return time.process_time() - before, np.asarray(self.op.pick(state.u))


def on_lattice(case: Case) -> Ours:
    """The half-neighbourhood operator of a case."""
    d, real = len(case.shape), case.dtype
    high = [n * case.dx for n in case.shape]
    cloud = lattice([0.0] * d, high, case.dx, nodes="cell")
    family = find_on_grid(cloud, case.m * case.dx)
    number = {tuple(o): k for k, o in enumerate(np.asarray(case.offsets).tolist())}
    rows = [number[o] for o in family.offsets]
    points, cut = np.arange(family.n).reshape(family.shape), []
    for slot, step in enumerate(family.offsets):
        at = points[inside(family.shape, step)].ravel()
        at = at[~case.alive0[rows[slot]][at]]
        cut.append(np.stack([at, np.full_like(at, slot)]))
    stiff = np.asarray(case.w)[rows] / np.asarray(case.r)[rows]
    op = HalfForce(
        stiff=jnp.asarray(stiff, real),
        dx=jnp.asarray(case.dx, real),
        s_crit=jnp.asarray(case.s_crit, real),
        c=None,
        v=None,
        scale=None,
        share=jnp.ones(len(rows), real),
        family=family,
    )
    bits = jnp.asarray(start_bits(op.row, np.concatenate(cut, axis=1)))
    return Ours(op, case.u0, case.v0, case.mass, bits, case.dt)


def race(case: Case, peers: dict[str, Any], repeats: int, work: float) -> Any:
    """Rates of ours and the peers, compile time, and the largest difference from C."""
    ours = on_lattice(case)
    steps = max(4, round(work / case.bonds))
    cost = ours.compile(steps)
    seconds: dict[str, float] = {}
    u = np.zeros(0)
    for repeat in range(repeats):
        for name, peer in peers.items():
            few = steps if name.startswith("c") else max(1, steps // 8)
            if repeat >= 2 and not name.startswith("c"):
                continue
            ran = peer.run(few)
            took = ran.seconds / few
            seconds[name] = min(seconds.get(name, np.inf), took)
        took, u = ours.run()
        seconds["jaxpd"] = min(seconds.get("jaxpd", np.inf), took / steps)
    error = np.nan
    if "c" in peers:
        exact = peers["c"].run(steps).u
        error = np.abs(u - exact).max() / np.abs(exact).max()
    rates = {name: case.bonds / s / 1e9 for name, s in seconds.items()}
    return rates, cost, float(error)


def jittered(n: int, delta: float, dtype: Any, seed: int = 0) -> dict[str, Any]:
    """A cloud of n^2 points in the unit square, sorted, as a pre-strained glass."""
    rng = np.random.default_rng(seed)
    X = (np.indices((n, n)).reshape(2, -1).T + rng.uniform(-0.3, 0.3, (n * n, 2))) / n
    X = X[curve(X)]
    cloud = from_points(X, 1 / n**2)
    nbr = np.asarray(find(cloud, delta).nbr)
    here = np.arange(n * n)
    xi = X[nbr] - X
    r = np.maximum(np.sqrt((xi**2).sum(axis=2)), 1e-30)
    there = nbr != here
    c = 9 * 72e9 / (np.pi * delta**3)
    weight = np.where(there, c / n**4, 0.0)
    mass = 2440.0 / n**2
    stiff = weight / np.where(there, r, 1.0)
    dt = 0.5 * (2 * mass / stiff.sum(axis=0).max()) ** 0.5
    u0 = (X * np.array([0.0, 0.01])).astype(dtype)
    v0 = rng.normal(scale=20.0, size=X.shape).astype(dtype)
    return {
        "X": X, "nbr": nbr, "xi": xi, "weight": weight, "stiff": stiff, "dt": dt,
        "there": there, "mass": mass, "u0": u0, "v0": v0, "s_crit": 0.012,
        "delta": delta,
    }  # fmt: skip


def cloud_race(k: int, dtype: Any, repeats: int, n: int) -> Any:
    """Rates of ours and of numba on a cloud with some k neighbours a point."""
    case = jittered(n, (k / np.pi) ** 0.5 / n, dtype)
    order = jnp.arange(n * n, dtype=jnp.int32)
    pad = np.where(case["there"][..., None], case["xi"], np.array([case["delta"], 0.0]))
    op = SlotForce(
        nbr=jnp.asarray(case["nbr"]),
        xi=jnp.asarray(np.moveaxis(pad, 2, 1), dtype),
        r=jnp.asarray(np.linalg.norm(pad, axis=2), dtype),
        stiff=jnp.asarray(case["stiff"], dtype),
        s_crit=jnp.asarray(case["s_crit"], dtype),
        share=jnp.asarray(case["there"], dtype),
        order=order,
        place=order,
    )
    flags = jnp.asarray(case["there"])
    ours = Ours(op, case["u0"], case["v0"], case["mass"], flags, case["dt"])
    bonds = int(case["there"].sum())
    steps = max(4, round(1e8 / bonds))
    cost = ours.compile(steps)
    turned = [np.ascontiguousarray(case[name].T) for name in ("nbr", "weight", "there")]
    peer: Any = numba_cloud(
        case["X"], turned[0], turned[1], case["s_crit"], case["mass"], case["dt"],
        case["u0"], case["v0"], turned[2],
    )  # fmt: skip
    seconds = {"jaxpd": np.inf, "numba": np.inf}
    error = np.nan
    for _ in range(repeats):
        took, u = ours.run()
        seconds["jaxpd"] = min(seconds["jaxpd"], took / steps)
        if peer is not None:
            ran = peer.run(steps)
            seconds["numba"] = min(seconds["numba"], ran.seconds / steps)
            error = float(np.abs(u - ran.u).max() / np.abs(ran.u).max())
    rates = {name: bonds / s / 1e9 for name, s in seconds.items() if np.isfinite(s)}
    return rates, cost, error


def million(side: int) -> dict[str, Any]:
    """A block of side^3 points, m = 3, with a crack: step time and peak memory."""
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0,) * 3, (1.0,) * 3),
        material=jaxpd.Elastic(200e9, nu=1 / 4, rho=7800.0, G0=1e3),
        cracks=[jaxpd.rectangle((0.0, 0.0, 0.5), (0.5, 0.0, 0.0), (0.0, 1.0, 0.0))],
        loads=[jaxpd.traction(jaxpd.above(z=1.0), z=1e6)],
        resolution=jaxpd.Bonds(dx=1 / side, m=3, nodes="cell", correction="none"),
    )
    start = time.perf_counter()
    motion = jaxpd.prepare_motion(scene)
    ready = time.perf_counter() - start
    dt = 0.5 * longest_dt(motion)
    steps = 8
    run = jaxpd.run_explicit(motion, steps * dt, dt=dt, records=2).checked()
    again = time.process_time()
    jaxpd.run_explicit(motion, steps * dt, dt=dt, records=2)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    return {
        "points": side**3,
        "bonds": motion.problem.family.n_bonds,
        "prepare": ready,
        "step": run.seconds["steps"] / steps,
        "all": time.process_time() - again,
        "peak": peak,
    }


def gradient(n: int, steps: int) -> dict[str, float]:
    """Cost and memory of a value and gradient of a run over the run alone."""
    every = round(steps**0.5)
    glass = jaxpd.Elastic(72e9, nu=1 / 3, state="plane stress", rho=2440.0, G0=3.8)
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (1.0, 1.0)),
        material=glass,
        starts=[jaxpd.initially(jaxpd.above(x=-1.0), vx=lambda X: np.sin(9 * X[:, 1]))],
        resolution=jaxpd.Bonds(dx=1 / n, m=4, nodes="cell", correction="none"),
    )
    motion = jaxpd.prepare_motion(scene)
    at = jax.tree.map(jnp.asarray, motion.params)
    at["E"] = jnp.full(n * n, 72e9)
    motion = jaxpd.Motion(**{**vars(motion), "params": at})
    dt = 0.5 * longest_dt(motion)

    def loss(params: Any, motion: Any, every: int) -> Any:
        u, _, _ = motion.march(params, dt=dt, every=every, records=steps // every)
        return jnp.sum(u * u)

    found: dict[str, float] = {}
    whole = partial(loss, every=every)
    for name, function in (
        ("run", whole),
        ("field", jax.value_and_grad(whole)),
        ("stored", jax.value_and_grad(partial(loss, every=steps))),
    ):
        before = time.process_time()
        compiled = jax.jit(function).lower(at, motion).compile()
        found[f"{name} compile"] = time.process_time() - before
        best = np.inf
        for _ in range(3):
            before = time.process_time()
            jax.block_until_ready(compiled(at, motion))
            best = min(best, time.process_time() - before)
        found[name] = best
        memory: Any = compiled.memory_analysis()
        found[f"{name} bytes"] = memory.temp_size_in_bytes
    return found


def main() -> None:
    """Measure, print, write."""
    asked = asked_part()
    if asked is not None:
        import json

        print(json.dumps(million(asked["side"])))
        return
    quick = is_quick(__doc__)
    report, lines = Report("explicit", quick), []
    report.notes.append(
        "numpy: half the neighbourhood, in pieces that fit the cache; numpy lists: "
        "arrays [n, k, d] of all bonds; numba: neighbour lists; C: shifted rows"
    )
    shapes = [((257, 257), 3), ((257, 257), 8), ((64, 64, 64), 3)]
    for shape, m in shapes[:1] if quick else shapes:
        for real in (np.float64, np.float32):
            case = make_case(shape, m, real, 0)
            makers = PEERS | {"numpy lists": numpy_neighbour_list}
            made = {name: make(case) for name, make in makers.items()}
            peers = {name: peer for name, peer in made.items() if peer is not None}
            work = 5e7 if quick else 3e8
            rates, cost, error = race(case, peers, 2 if quick else 5, work)
            label, word = f"{'x'.join(map(str, shape))}, m = {m}", np.dtype(real).name
            for name, rate in rates.items():
                mine = name == "jaxpd"
                over = rates["jaxpd"] / rate
                more = (cost, error) if mine else (None, None)
                lines.append((label, word, name, rate, over, *more))
                row = {"case": label, "dtype": word, "peer": name, "rate": rate}
                report.rows.append(row | {"ours over it": over})
            flat, single = len(shape) == 2, word == "float32"
            ours = rates["jaxpd"]
            ratios = {name: ours / rate for name, rate in rates.items()}
            if flat:
                report.claim(
                    f"times NumPy on lists, {label}, {word}",
                    ratios["numpy lists"], 20, ">=",
                )  # fmt: skip
                report.claim(
                    f"times NumPy in pieces, {label}, {word}", ratios["numpy"], 20, ">="
                )
                report.claim(f"compile cpu-s, {label}, {word}", cost, 2.0)
                if "numba" in ratios:
                    report.claim(
                        f"times numba, {label}, {word}",
                        ratios["numba"], 5 if single else 3, ">=",
                    )  # fmt: skip
            if "c" in ratios:
                bound = 1.75 if single else (1.25 if flat else 2.0)
                report.claim(f"C over ours, {label}, {word}", 1 / ratios["c"], bound)
            if not single:
                report.claim(f"difference from C, {label}", error, 1e-12)
    for k, n in ((28, 60),) if quick else ((28, 244), (200, 244)):
        for real in (np.float64, np.float32):
            rates, cost, error = cloud_race(k, real, 2 if quick else 4, n)
            label, word = f"cloud of {n * n}, k = {k}", np.dtype(real).name
            for name, rate in rates.items():
                over = rates["jaxpd"] / rate
                more = (cost, error) if name == "jaxpd" else (None, None)
                lines.append((label, word, name, rate, over, *more))
                row = {"case": label, "dtype": word, "peer": name, "rate": rate}
                report.rows.append(row | {"ours over it": over})
            if "numba" in rates:
                over = rates["jaxpd"] / rates["numba"]
                report.claim(f"times numba, {label}, {word}", over, 1.0, ">=")
    block = fresh(__file__, "million", side=30 if quick else 100)
    report.rows.append(block)
    report.notes.append(
        f"3-D, {block['points']} points, {block['bonds']} bonds, float64: prepared in "
        f"{block['prepare']:.1f} s, {block['step']:.2f} s a step (records included)"
    )
    report.claim("peak GiB of the block in 3-D", block["peak"] / 2**30, 8.0)
    cost = gradient(33 if quick else 65, 196 if quick else 1024)
    report.rows.append(cost)
    report.claim(
        "value and gradient over the run, time", cost["field"] / cost["run"], 3
    )
    most = f"{cost['stored bytes'] / 1e6:.0f} MB with every state kept "
    report.notes.append(
        f"gradient in a field, {cost['field'] / cost['run']:.2f} times the run, "
        f"{cost['field bytes'] / 1e6:.0f} MB against {most}"
        f"({cost['stored'] / cost['run']:.2f} times the run) and "
        f"{cost['run bytes'] / 1e6:.1f} MB of the run; compiled in "
        f"{cost['field compile']:.1f} cpu-s"
    )
    report.finish(HEAD, lines)


if __name__ == "__main__":
    main()
