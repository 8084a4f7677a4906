"""Statics of a scene by adaptive dynamic relaxation: no tangent, no linear solver."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointVector
from jaxpd.checks import number, whole
from jaxpd.launch import prepared
from jaxpd.motion import Motion
from jaxpd.physics.damage import Brittle
from jaxpd.scene import Scene
from jaxpd.solvers.relaxation import SPARE, relax
from jaxpd.solvers.status import NotConverged, Status
from jaxpd.stack import own


@dataclass(frozen=True, eq=False)
class Relaxed:
    """A body at rest.

    Attributes:
        motion: what was relaxed.
        u: displacements [n, d] (m).
        damage: damage index [n] (-), pre-cracks included.
        steps: taken.
        residuals: relative residuals, evenly spread over the steps.
        status: whether it came to rest.
    """

    motion: Motion
    u: PointVector
    damage: np.ndarray
    steps: int
    residuals: np.ndarray
    status: Status

    def checked(self) -> Relaxed:
        """This, if it came to rest.

        Raises:
            NotConverged: with status, residual history and cure.
        """
        if self.status is not Status.CONVERGED:
            what = f"dynamic relaxation ({self.steps} steps)"
            raise NotConverged(self.status, self.residuals, what)
        return self


def solve_relaxed(
    scene: Scene | Motion,
    *,
    rtol: float = 1e-6,
    max_steps: int = 20_000,
    **options: Any,
) -> Relaxed:
    """Bring a scene to rest by adaptive dynamic relaxation.

    Loads and prescribed displacements are those at the end of their histories. No bond
    of an elastic material breaks: on the way stretches are far above those at rest. A
    law with a memory of its own remembers the way. Bonds that cracks cut are missing as
    in `prepare_motion`, with the surface correction of the body before; `solve_static`
    corrects the faces of cracks too.

    Args:
        scene: what to relax, or what `prepare_motion` made of it; its material needs a
            density, which does not matter.
        rtol: relative tolerance of the residual.
        max_steps: most steps.
        **options: those of `prepare_motion`.

    Raises:
        ValueError: on arguments out of range, a support that never stops, smoothed
            damage, or a tolerance that float32 cannot reach.
    """
    number("rtol", rtol, above=0, below=1, cure="1e-6 is common")
    max_steps = whole("max_steps", max_steps)
    motion = prepared(scene, options)
    motion = _unbroken(motion)
    course = motion.course
    if course.dtype == "float32" and rtol < 1e-5:
        raise ValueError(
            f"rtol: {rtol} is out of reach of float32; take 1e-5, or 64 bits by "
            "jax.config.update('jax_enable_x64', True) before any array is made"
        )
    if any(table.rate != 0.0 for table in (*course.loads, *course.moves)):
        raise ValueError("supports: one of them never stops; use moves(), not drives()")
    end = [[t.factors[-1] for t in tables] for tables in (course.loads, course.moves)]
    tolerance = (rtol, max_steps)
    u, damage, steps, rest, log = _relax(motion, *map(tuple, end), *tolerance)
    residuals = np.asarray(log)[np.isfinite(np.asarray(log))]
    good = float(rest) <= rtol
    status = Status.CONVERGED if good else Status.MAX_ITERATIONS
    if not (np.isfinite(float(rest)) and np.isfinite(np.asarray(u)).all()):
        status = Status.NOT_FINITE
    return Relaxed(motion, u, np.asarray(damage), int(steps), residuals, status)


def _unbroken(motion: Motion) -> Motion:
    """The same motion with bonds that do not break."""
    course, params = motion.course, dict(motion.params)
    plies = tuple(map(_unbroken, motion.plies))
    if plies:
        params["plies"] = tuple(own(ply.params) for ply in plies)
        params["interlayers"] = tuple(
            dataclasses.replace(layer, G0=None) for layer in params["interlayers"]
        )
    if course.softening is not None:
        raise ValueError("softening: smoothed damage is for runs in time; leave it out")
    if isinstance(params.get("law"), Brittle):
        s_crit = np.full_like(params["law"].s_crit, np.inf)
        params["law"] = dataclasses.replace(params["law"], s_crit=s_crit)
    course = dataclasses.replace(course, breaks=False)
    return dataclasses.replace(motion, course=course, params=params, plies=plies)


@jax.jit
def _relax(motion, loads, moves, rtol, max_steps):
    params, history = motion.params, motion.begin
    op, drive = motion.build(params)
    dtype = jnp.dtype(motion.course.dtype)
    load = sum((f * x for f, x in zip(loads, drive.loads, strict=True)), start=0.0)
    load = jnp.broadcast_to(load, drive.loads.shape[1:]).astype(dtype)
    u: Any = op.lay(jnp.asarray(params["u0"], dtype))
    if drive.fixed is not None:
        to = sum(f * x for f, x in zip(moves, drive.moves, strict=True))
        u = jnp.where(drive.fixed, to, u)
    blocks = op.diagonal(history)
    # u.K u <= 2 sum u_i.K_ii u_i, and the trace is above the largest eigenvalue
    trace = jnp.trace(blocks, axis1=1, axis2=2)
    mass: Any = op.lay(0.5 * SPARE * trace).astype(dtype)
    mass = jnp.where(mass > 0.0, mass, 1.0)
    u, history, steps, rest, log = relax(
        op, mass, load, drive.fixed, u, history, rtol, max_steps
    )
    volume = op.intact(motion.untouched)
    left = op.intact(history) / jnp.where(volume > 0.0, volume, 1.0)
    damage = 1.0 - op.pick(jnp.where(volume > 0.0, left, 1.0))
    return op.pick(u), damage, steps, rest, log
