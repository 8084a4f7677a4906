"""Running a scene in time: progress, records, frames, checkpoints; on the host.

Steps are integrated in chunks, one a record, by compiled code. Between them the host
takes energies and momenta down, keeps frames, writes a checkpoint, and looks whether
the run still makes sense.
"""

from __future__ import annotations

import dataclasses
import math
import time
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd import io
from jaxpd.checks import flag, number, whole
from jaxpd.launch import longest_dt, prepared
from jaxpd.motion import Motion
from jaxpd.progress import bar
from jaxpd.record import Run, amiss
from jaxpd.run import peak_memory
from jaxpd.scene import Scene
from jaxpd.solvers.explicit import Drive, State, verlet


@jax.jit
def _chunk(op: Any, drive: Drive, state: State, dt: float, factors: Any) -> State:
    return verlet(op, drive, state, dt, factors)


@jax.jit
def _record(op: Any, drive: Drive, state: State, history0: Any, x0: Any) -> Any:
    """Energies and momenta of a state, NaN if it is nowhere finite."""
    # empty places have mass 1 but never move
    p = drive.mass[None] * state.v
    x = x0 + state.u
    pairs = [(a, b) for a in range(len(p)) for b in range(a + 1, len(p))]
    spin = [jnp.sum(x[a] * p[b] - x[b] * p[a]) for a, b in pairs]
    return {
        "kinetic": 0.5 * jnp.sum(p * state.v),
        "elastic": jnp.sum(op.energy(state.u, state.history)),
        "released": op.released(state.history, history0),
        "work": state.work,
        "momentum": jnp.sum(p, axis=1),
        "spin": jnp.stack(spin) if spin else jnp.zeros(0),
    }


@jax.jit
def _first(motion: Motion) -> tuple[Any, ...]:
    """Operator, drive, state, volume of whole neighbourhoods, positions."""
    op, drive = motion.build(motion.params)
    state = motion.first(op, motion.params)
    dtype = jnp.dtype(motion.course.dtype)
    x0 = op.lay(jnp.asarray(motion.X, dtype))
    volume = op.intact(motion.untouched)
    return op, drive, state, volume, x0


@jax.jit
def _frame(op: Any, state: State, volume: jax.Array) -> tuple[jax.Array, ...]:
    left = op.intact(state.history) / jnp.where(volume > 0.0, volume, 1.0)
    left = jnp.where(volume > 0.0, left, 1.0)
    return op.pick(state.u), op.pick(state.v), 1.0 - op.pick(left)


def run_explicit(
    scene: Scene | Motion,
    duration: float,
    *,
    dt: float | None = None,
    safety: float = 0.8,
    records: int = 100,
    frames: int = 0,
    folder: str | Path | None = None,
    progress: bool | None = None,
    unstable_dt: bool = False,
    **options: Any,
) -> Run:
    """Move a scene for a time.

    Args:
        scene: what moves, or what `prepare_motion` made of it.
        duration: how long (s).
        dt: longest time step (s); shortened so that steps divide the records.
        safety: without `dt`, the step over the stable one of `longest_dt`.
        records: how many times energies and momenta are taken down; also the chunks
            between which progress, frames and checkpoints are.
        frames: how many frames are kept, a divisor of `records`; 0 keeps none.
        folder: keeps checkpoint and frames, made if need be. A run that was killed goes
            on from there, to the same bits as one that was not.
        progress: a bar, by tqdm; None shows it on a terminal.
        unstable_dt: take a `dt` above the stable one all the same.
        **options: those of `prepare_motion`.

    Returns:
        A `Run`; call its `checked()` to be sure that it reached its end.

    Raises:
        ValueError: on arguments out of range, a time step above the stable one, or a
            folder of another run.
    """
    started = time.perf_counter()
    number("duration", duration, above=0, cure="in s")
    records, frames = whole("records", records), whole("frames", frames, 0)
    number("safety", safety, above=0, most=1)
    flag("unstable_dt", unstable_dt)
    if dt is not None:
        number("dt", dt, above=0, cure="in s")
    if frames and records % frames:
        raise ValueError(f"frames: {frames} must divide records = {records}, or be 0")
    motion = prepared(scene, options)
    longest = longest_dt(motion)
    if dt is None:
        dt = safety * min(longest, duration)
    if dt > longest * (1.0 + 1e-9) and not unstable_dt:
        raise ValueError(
            f"dt: {dt:.6g} s is above the stable step {longest:.6g} s; leave it out, "
            "or say unstable_dt=True to see what happens"
        )
    every = max(1, math.ceil(duration / records / dt * (1.0 - 1e-12)))
    dt = duration / (records * every)
    file = _keep(folder)
    mark = _mark(motion, dt, every, records, frames) if file else ""
    history0 = motion.begin
    op, drive, state, volume, x0 = _first(motion)
    ready = time.perf_counter()
    chunk = _chunk.lower(op, drive, state, dt, motion.course.factors(dt, 0, every))
    compiled = chunk.compile()
    seconds = {"prepare": ready - started, "compile": time.perf_counter() - ready}

    log: dict[str, list[Any]] = {"t": []}
    kept: list[tuple[Any, ...]] = []
    done, stopped = 0, None
    if file is not None and file.exists():
        like = (
            state,
            np.zeros((), int),
            _row(0.0, _record(op, drive, state, history0, x0)),
        )
        state, at, log = io.load_state(file, like, mark)
        state, done = jax.device_put(state), int(at)
        log = {name: list(rows) for name, rows in log.items()}
        kept = [_read(file, r) for r in range(done + 1) if _framed(r, records, frames)]
    damage0 = np.asarray(
        _frame(op, dataclasses.replace(state, history=history0), volume)[2]
    )

    def take(r: int) -> None:
        row = _row(r * every * dt, _record(op, drive, state, history0, x0))
        if log["t"]:  # work is added up here, in 64 bits
            row["work"] = row["work"] + log["work"][-1]
        for name, value in row.items():
            log.setdefault(name, []).append(value)
        if _framed(r, records, frames):
            u, v, phi = map(np.asarray, _frame(op, state, volume))
            kept.append((np.float64(r * every * dt), u, v, phi))
            if file is not None:
                io.save_state(_frame_file(file, r), kept[-1], "a frame of jaxpd")
        if file is not None:
            rows = {name: np.asarray(values) for name, values in log.items()}
            io.save_state(file, (state, np.asarray(r), rows), mark)

    if not log["t"]:
        take(0)
    stopped = amiss(log, op, state, motion, dt, longest)
    if stopped:
        records = done
    idle = jnp.zeros_like(state.work)
    for r in bar(range(done, records), records, progress, "record"):
        factors = motion.course.factors(dt, r * every, every)
        state = dataclasses.replace(state, work=idle)
        state = jax.block_until_ready(compiled(op, drive, state, dt, factors))
        take(r + 1)
        stopped = amiss(log, op, state, motion, dt, longest)
        if stopped:
            break
    seconds["steps"] = time.perf_counter() - started - sum(seconds.values())
    u, v, phi = map(np.asarray, _frame(op, state, volume))
    glued = state.history[len(motion.plies) :] if motion.plies else ()
    columns = [np.asarray(x) for x in zip(*kept, strict=True)] or [np.zeros(0)] * 4
    return Run(
        motion=motion,
        dt=dt,
        steps=every * (len(log["t"]) - 1),
        u=u,
        v=v,
        **{name: np.asarray(values) for name, values in log.items()},
        frames=dict(zip(("t", "u", "v", "damage"), columns, strict=True)),
        damage0=damage0,
        stopped=stopped,
        seconds=seconds,
        peak_memory=peak_memory(),
        last_damage=phi,
        glued=tuple(np.asarray(h) < 0.0 for h in glued),
    )


def _row(t: float, found: dict[str, Any]) -> dict[str, Any]:
    return {"t": np.float64(t)} | {
        name: np.asarray(x, float) for name, x in found.items()
    }


def _framed(r: int, records: int, frames: int) -> bool:
    return bool(frames) and r % (records // frames) == 0


def _keep(folder: str | Path | None) -> Path | None:
    if folder is None:
        return None
    return io.make_folder(folder) / "state.npz"


def _frame_file(file: Path, r: int) -> Path:
    return file.with_name(f"frame_{r:06d}.npz")


def _read(file: Path, r: int) -> tuple[Any, ...]:
    return io.load_state(_frame_file(file, r), (0, 0, 0, 0), "a frame of jaxpd")


def _mark(motion: Motion, *numbers: float) -> str:
    """Whose checkpoint it is: a digest of all that the run depends on."""
    dt, every, records, frames = numbers
    size = f"{len(motion.X)} points, {records * every} steps of {dt:.6g} s"
    kept = f"{records} records, {frames} frames"
    return f"a run of {size}, {kept}, {io.digest(motion, *numbers)}"
