"""Pay for what you use: lean scenes beside the same with more in them.

Each pair is one program compiled twice: its floating-point operations and the bytes
that it reads and writes (XLA's own analysis, a loop's body counted once), the memory of
its arguments and temporaries, and its time, measured in turn.
"""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np
from _report import Report, is_quick

import jaxpd
from jaxpd import gallery
from jaxpd.physics import Hooke

jax.config.update("jax_enable_x64", True)

HEAD = (
    "what is left out",
    "lean",
    "full",
    "operations",
    "bytes",
    "memory",
    "time",
    "state, bytes a point",
)


@dataclass(frozen=True)
class Program:
    """A compiled program and its arguments.

    Attributes:
        name: what it is.
        call: compiled.
        arguments: of the call.
        state: bytes of memory (history) that its scene carries.
        points: of the scene.
    """

    name: str
    call: Any
    arguments: tuple[Any, ...]
    state: int
    points: int

    def costs(self) -> dict[str, float]:
        """Operations, bytes read and written, memory."""
        told: Any = self.call.cost_analysis()
        told = told[0] if isinstance(told, list) else told
        held: Any = self.call.memory_analysis()
        return {
            "operations": float(told["flops"]),
            "bytes": float(told["bytes accessed"]),
            "memory": float(held.temp_size_in_bytes + held.argument_size_in_bytes),
        }

    def once(self) -> float:
        """Processor seconds of one call."""
        start = time.process_time()
        jax.block_until_ready(self.call(*self.arguments))
        return time.process_time() - start


def bytes_of(tree: Any) -> int:
    """Bytes of the arrays of a pytree."""
    return sum(np.asarray(leaf).nbytes for leaf in jax.tree.leaves(tree))


def compiled(f: Callable[..., Any], *arguments: Any) -> Any:
    """A function compiled for its arguments."""
    return jax.jit(f).lower(*arguments).compile()


def step(name: str, scene: Any, **options: Any) -> Program:
    """One evaluation of forces of a motion, with its memory."""
    motion = jaxpd.prepare_motion(scene, dtype="float64", **options)
    op, _ = jax.jit(lambda m: m.build(m.params))(motion)
    state = motion.first(op, motion.params)
    call = compiled(lambda op, u, h: op.commit(u, h), op, state.u, state.history)
    given = (op, state.u, state.history)
    return Program(name, call, given, bytes_of(state.history), len(motion.X))


def static(name: str, scene: Any, **options: Any) -> Program:
    """A whole solve."""
    problem = jaxpd.prepare(scene, solver="d-pcg", **options)
    call = compiled(type(problem).solve, problem)
    return Program(name, call, (problem,), 0, len(problem.X))


def load_step(name: str, scene: Any) -> Program:
    """Force, memory and consistent tangent of nodes at given displacements."""
    problem = jaxpd.prepare(scene, solver="direct")

    def respond(operator: Any, u: Any, history: Any) -> Any:
        force, after = operator.respond(u, history), operator.advance(u, history)
        return force, after, operator.tangent(u, history)

    operator = jax.jit(lambda p: p.operator(p.params))(problem)
    history = problem.history0()
    u = jax.numpy.zeros(problem.X.shape)
    call = compiled(respond, operator, u, history)
    given = (operator, u, history)
    return Program(name, call, given, bytes_of(history), len(problem.X))


def pairs(quick: bool) -> list[tuple[str, Program, Program]]:
    """What is left out, the lean program and the full one."""
    delta, n = (4e-3, 24) if quick else (1e-3, 96)
    glass = gallery.branching_plate(4, delta)
    free = dataclasses.replace(
        glass, material=dataclasses.replace(glass.material, G0=None)
    )
    whole = dataclasses.replace(free, cracks=[])
    small, finite = (
        gallery.cracked_plate(n, 4, kinematics=kind) for kind in ("small", "finite")
    )
    bare, corrected = (
        gallery.cracked_plate(n, 4, kinematics="small", correction=word)
        for word in ("none", "lattice")
    )
    shape = (11, 25) if quick else (31, 73)
    hooke = Hooke(2.1e5, 0.3, "plane strain")
    ring, plastic = (gallery.pressed_ring(shape, law=law) for law in (hooke, None))
    glued = gallery.gaussian_wave(height=10.0 if quick else 35.0)
    stack: Any = glued.body
    one = dataclasses.replace(
        glued,
        body=stack.plies[0],
        material=_first(glued.material),
        resolution=_first(glued.resolution),
    )
    breaking = step("bonds break", glass)
    return [
        ("damage", step("elastic", free), breaking),
        ("damage and crack", step("elastic, whole", whole), breaking),
        (
            "a memory of one's own",
            breaking,
            step("number a bond", glass, operator="memory"),
        ),
        (
            "Newton's loop",
            static("small", small, operator="stencil"),
            static("finite", finite),
        ),
        ("surface correction", static("none", bare), static("lattice", corrected)),
        (
            "index lists",
            static("fft", small),
            static("gather", small, operator="gather"),
        ),
        ("plasticity", load_step("Hooke", ring), load_step("von Mises", plastic)),
        ("interlayer and second ply", step("one ply", one), step("laminate", glued)),
    ]


def _first(given: Any) -> Any:
    return given[0] if isinstance(given, list | tuple) else given


def main() -> None:
    """Measure every pair."""
    report, lines = Report("lean", is_quick(__doc__)), []
    for name, lean, full in pairs(report.quick):
        costs = [program.costs() for program in (lean, full)]
        ratio = {key: costs[0][key] / costs[1][key] for key in costs[0]}
        times: list[list[float]] = [[], []]
        for _ in range(4 if report.quick else 12):  # in turn: both see the same machine
            for program, seconds in zip((lean, full), times, strict=True):
                seconds.append(program.once())
        a, b = (statistics.median(t[1:]) for t in times)
        states = [p.state / p.points for p in (lean, full)]
        report.rows.append(
            {"left out": name, "lean": lean.name, "full": full.name}
            | ratio
            | {"time": a / b, "state": states}
        )
        cells = [f"{ratio[key]:.2f}" for key in ratio]
        state = f"{states[0]:.3g} / {states[1]:.3g}"
        lines.append([name, lean.name, full.name, *cells, f"{a / b:.2f}", state])
    by = {r["left out"]: r for r in report.rows}
    report.claim("operations of a step without damage", by["damage"]["operations"], 0.8)
    report.claim("state without plasticity", by["plasticity"]["state"][0], 0.0)
    if not report.quick:
        for name in ("damage", "Newton's loop", "index lists", "plasticity"):
            report.claim(f"time without: {name}", by[name]["time"], 1.0)
        report.claim(
            "time without interlayer and second ply",
            by["interlayer and second ply"]["time"],
            0.7,
        )
    report.notes.append("lean over full; a loop's body counts once in operations")
    report.finish(HEAD, lines)


if __name__ == "__main__":
    main()
