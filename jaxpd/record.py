"""What a run in time leaves behind: `Run`, and whether it made sense."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jaxpd import io
from jaxpd._types import PointVector
from jaxpd.motion import Motion
from jaxpd.solvers.explicit import State

#: Energy from nowhere, over the work and the energy given at the start, that stops a
#: run; more at stable steps, where Verlet's own energy swings.
CREATED = 0.5


class Diverged(RuntimeError):
    """A run that was stopped; the message says when, where and why."""


@dataclass(frozen=True, eq=False)
class Run:
    """A scene that has moved.

    Attributes:
        motion: what moved.
        dt: time step (s).
        steps: taken so far.
        u: displacements at the end [n, d] (m).
        v: velocities at the end [n, d] (m/s).
        t: times of the records [R] (s).
        kinetic: energy of motion [R] (J).
        elastic: stored energy [R] (J).
        released: energy of broken bonds, c omega (r s_crit)^2 / 2 each [R] (J); NaN for
            a law that does not say.
        work: of loads and supports [R] (J).
        momentum: linear momentum [R, d] (kg m/s).
        spin: angular momentum about the origin [R, 0, 1 or 3] (kg m^2/s).
        frames: "t" [F] (s), "u", "v" [F, n, d] (m, m/s), "damage" [F, n] (-), which
            counts the pre-cracks.
        damage0: damage by the pre-cracks alone [n] (-).
        stopped: why the run was stopped early, or None.
        seconds: wall time of "prepare", "compile" and "steps" of this process.
        peak_memory: highest resident memory of the process so far (bytes).
        last_damage: damage index at the end [n] (-), pre-cracks included.
        glued: of a laminate, which ghosts of each interlayer are intact [q] at the end.
    """

    motion: Motion
    dt: float
    steps: int
    u: PointVector
    v: PointVector
    t: np.ndarray
    kinetic: np.ndarray
    elastic: np.ndarray
    released: np.ndarray
    work: np.ndarray
    momentum: np.ndarray
    spin: np.ndarray
    frames: dict[str, np.ndarray]
    damage0: np.ndarray
    stopped: str | None
    seconds: dict[str, float]
    peak_memory: int
    last_damage: np.ndarray
    glued: tuple[np.ndarray, ...] = ()

    def __repr__(self) -> str:
        """One line: size, time, balance, and why it stopped."""
        end = f", stopped: {self.stopped}" if self.stopped else ""
        return (
            f"Run({len(self.X)} points, {self.steps} steps to {self.t[-1]:.4g} s, "
            f"energy balance {self.balance[-1]:.1e}{end})"
        )

    @property
    def X(self) -> PointVector:
        """Reference positions [n, d] (m)."""
        return self.motion.X

    @property
    def balance(self) -> np.ndarray:
        """Kinetic + elastic + released - work - that at time 0, over the scale [R].

        The scale is the largest work or change of energy so far. NaN for a law without
        an energy.
        """
        return balance(self.kinetic, self.elastic, self.released, self.work)

    def damage(self, precracks: bool = False) -> np.ndarray:
        """Damage index [n] (-), the lost share of the bonds (paper 002, eq. 11).

        Args:
            precracks: count bonds that were cut from the start.
        """
        if precracks:
            return self.last_damage
        # 1 - intact now / intact at the start, where anything was
        left = np.maximum(1.0 - self.damage0, 1e-6)
        return np.where(left > 1e-6, 1.0 - (1.0 - self.last_damage) / left, 0.0)

    def delaminated(self, layer: int = 0) -> tuple[np.ndarray, np.ndarray, float]:
        """Where an interlayer of a laminate has come apart, notches included.

        Args:
            layer: which one, from 0 below.

        Returns:
            Places of its ghosts [q, d] (m), a mask of the broken ones [q], and the area
            (m^(d-1)) that these stand for.

        Raises:
            ValueError: if there is no such interlayer.
        """
        if not 0 <= layer < len(self.glued):
            raise ValueError(f"layer: {layer} must lie in 0..{len(self.glued) - 1}")
        joint, _ = self.motion.problem.glue[layer]
        broken = ~self.glued[layer]
        return joint.places, broken, float(joint.area[broken].sum())

    def checked(self) -> Run:
        """This run, if it reached its end.

        Raises:
            Diverged: with time, place and likely cause.
        """
        if self.stopped:
            raise Diverged(self.stopped)
        return self

    def write_vtu(self, folder: str | Path) -> list[Path]:
        """Write the frames as a series of VTU files with a .pvd that names them."""
        fields = {k: x for k, x in self.frames.items() if k != "t"}
        return io.write_series(folder, np.asarray(self.X), self.frames["t"], fields)


def balance(kinetic: Any, elastic: Any, released: Any, work: Any) -> Any:
    """Energy from nowhere over the largest work or change of energy so far [R] (-)."""
    gain = elastic + released
    gain = gain - gain[0]
    parts = np.abs(np.stack([work, kinetic, gain])).max(axis=0)
    scale = np.fmax.accumulate(parts)
    left = kinetic - kinetic[0] + gain - work
    return left / np.where(scale > 0.0, scale, 1.0)


def amiss(
    log: dict[str, list[Any]],
    op: Any,
    state: State,
    motion: Motion,
    dt: float,
    longest: float,
) -> str | None:
    """Why the run should stop, or None: time, place and likely cause."""
    names = ("kinetic", "elastic", "released", "work")
    kinetic, *energies = (np.asarray(log[name], float) for name in names)
    # a law without an energy, or that does not say what it spends, has no balance
    known = np.isfinite([x[0] for x in energies]).all()
    finite = np.isfinite(kinetic[-1]) and (
        not known or all(np.isfinite(x[-1]) for x in energies)
    )
    created = 0.0
    if known:
        elastic, released, work = energies
        with np.errstate(all="ignore"):
            left = kinetic + elastic + released - work
            # what there was: energy of motion, and stored energy that has been given
            source = kinetic[0] + max(elastic[0] - elastic.min(), np.abs(work).max())
            created = (left[-1] - left[0]) / (source if source > 0.0 else 1.0)
    # Verlet's own energy swings by 1 / (1 - (omega dt)^2 / 4); a step too long grows
    # without bound, but where all bonds break on the way
    swing = 1.0 / (1.0 - min(dt / longest, 0.9) ** 2) - 1.0
    if dt > longest and np.nan_to_num(energies[1][-1]) > 0.0:
        swing = 0.0
    if finite and not created > CREATED + swing:
        return None
    u, v = (np.asarray(op.pick(x), float) for x in (state.u, state.v))
    bad = ~np.isfinite(u).all(axis=1) | ~np.isfinite(v).all(axis=1)
    worst = int(np.argmax(np.where(bad, np.inf, np.abs(v).max(axis=1))))
    what = (
        f"energy from nowhere, {created:.2g} of what there is"
        if finite
        else "numbers that are not finite"
    )
    why = (
        f"dt = {dt:.4g} s is {dt / longest:.3g} of the stable step {longest:.4g} s"
        if dt > longest
        else "the time step is within the stable one at rest; likely bonds that grow "
        "stiffer when strained, points driven through each other, or float32 too coarse"
        " for the displacements: take a shorter dt, milder loads, or float64"
    )
    X = np.asarray(motion.X)[worst]
    return (
        f"{what} by t = {log['t'][-1]:.6g} s, worst at point {worst} at "
        f"{tuple(map(float, X))}; {why}"
    )
