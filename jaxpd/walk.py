"""Where a quasi-static path is: attempts, halvings, what is committed and kept."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd import io
from jaxpd.compiling import quickly
from jaxpd.replay import Frames, one_step
from jaxpd.solvers.status import Status

#: A residual this small over rtol times the first ones of all steps so far is rest.
REST = 1e-2
#: Round-off of a residual over |K| |u|, and over the first ones of all steps so far.
ROUND = float(np.finfo(float).eps)
#: Halvings of a Newton step by the line search, where halving of load steps has failed.
CUTS = 8
#: Differences of displacements over the size of a body that end a path.
LARGE = 0.6
#: Nodes up to which compiling takes longer than solving.
FEW = 20_000


def _operator(problem: Any, params: Any) -> Any:
    return problem.operator(params)


@dataclass(frozen=True)
class Step:
    """One attempt at a load step.

    Attributes:
        t: where it goes.
        size: how far.
        status: how it ended.
        residuals: relative residual after each iteration.
        searched: whether with a line search.
    """

    t: float
    size: float
    status: Status
    residuals: tuple[float, ...]
    searched: bool

    @property
    def iterations(self) -> int:
        """Newton iterations."""
        return len(self.residuals)


class Walk:
    """State of the driver; `go` changes it, `save` and `load` keep it."""

    def __init__(self, problem: Any, max_halvings: int):
        """At rest, before the first step."""
        self.problem, self.max_halvings = problem, max_halvings
        self.bare = problem.bare()
        self.params = jax.tree.map(jnp.asarray, problem.params)
        self.u = jnp.zeros(np.shape(problem.X))
        self.operator = quickly(_operator)(self.bare, self.params)
        self.history = self.operator.history
        self.t, self.size, self.total = 0.0, np.inf, 0.0
        self.stiff = self.operator.bound()
        self.stopped: str | None = None
        self.frames: list[Frames] = []
        self.steps: list[Step] = []
        self.floor: list[float] = []
        self._take = quickly(one_step) if len(problem.X) < FEW else jax.jit(one_step)

    def go(self, target: float) -> None:
        """One accepted step towards the target, or the end of the path."""
        whole = target - self.t
        for searched in (False, True):
            size = min(self.size, whole)
            for _ in range(self.max_halvings + 1):
                last = size >= whole * (1.0 - 1e-9)
                if self._attempt(target if last else self.t + size, last, searched):
                    # only steps that failed hold later ones back
                    self.size = np.inf if size == whole else 2.0 * size
                    return
                size *= 0.5
        self.stopped = (
            f"the step from t = {self.t:.6g} fails after {self.max_halvings} halvings, "
            "without and with a line search; the commonest cause is a limit load or "
            "softening under prescribed loads: prescribe displacements instead, or let "
            "the material harden"
        )

    def _attempt(self, t: float, keep: bool, searched: bool) -> bool:
        """One load step to t, committed if it converges."""
        problem = self.bare.with_newton(max_cuts=CUTS) if searched else self.bare
        floor = self._floor()
        now, start = self.problem.spec.factors(t), (self.u, self.history)
        (u, history), frame, info = self._take(
            problem, self.params, self.operator, start, now, floor
        )
        status = Status(int(info.status))
        seen = np.asarray(info.residuals)[: int(info.iterations)].tolist()
        self.steps.append(Step(t, t - self.t, status, tuple(seen), searched))
        if status is not Status.CONVERGED:
            return False
        self.total += float(np.nan_to_num(info.scale))
        self.floor.append(floor)
        self.u, self.history, self.t = u, history, t
        if keep:
            self.frames.append(jax.tree.map(np.asarray, frame))
        moved, extent = (
            float(np.ptp(u, axis=0).max()),
            float(np.ptp(problem.X, axis=0).max()),
        )
        if moved > LARGE * extent:
            self.stopped = (
                f"at t = {t:.6g} displacements differ by {moved:.3g} m on a body of "
                f"{extent:.3g} m: beyond its limit load, or no small strains any more"
            )
        return True

    def _floor(self) -> float:
        """Norm of a residual that is rest: small beside the load, or round-off.

        Small steps have small first residuals, and round-off is that of all that acts:
        relative to a step's own residual it could never be reached.
        """
        rtol = self.problem.spec.newton.rtol
        rest = max(REST * rtol, 100 * ROUND) * self.total
        return float(max(rest, ROUND * self.stiff * np.linalg.norm(self.u)))

    def columns(self) -> Frames:
        """Frames with a leading axis [F]; of length 0 if there are none."""
        if not self.frames:
            now, start = self.problem.spec.factors(0.0), (self.u, self.history)
            shapes = jax.eval_shape(
                one_step, self.problem, self.params, self.operator, start, now, 0.0
            )[1]
            return jax.tree.map(lambda x: np.zeros((0, *x.shape), x.dtype), shapes)
        return jax.tree.map(lambda *x: np.stack(x), *self.frames)

    def _state(self, steps: int) -> dict[str, Any]:
        """All that is kept, as arrays; residuals in rows of one length."""
        width = self.problem.spec.newton.max_total
        rows = [np.pad(s.residuals, (0, width - s.iterations)) for s in self.steps]
        return {
            "u": self.u,
            "history": self.history,
            "numbers": np.array([self.t, self.size, self.total]),
            "floor": np.array(self.floor),
            "frames": self.columns(),
            "steps": np.array(
                [(s.t, s.size, s.status, s.iterations, s.searched) for s in self.steps]
            ).reshape(steps, 5),
            "residuals": np.array(rows).reshape(steps, width),
        }

    def save(self, file: Path, mark: str) -> None:
        """Keep the state; a walk that has stopped is not kept, but tries again."""
        if not self.stopped:
            io.save_state(file, self._state(len(self.steps)), mark)

    def load(self, file: Path, mark: str) -> None:
        """Go on from a state that was kept.

        Raises:
            ValueError: if it is of another path.
        """
        kept = io.load_state(file, self._state(0), mark)
        self.u, self.history = jax.tree.map(jnp.asarray, (kept["u"], kept["history"]))
        self.t, self.size, self.total = kept["numbers"].tolist()
        self.floor = kept["floor"].tolist()
        count = len(kept["frames"].u)
        self.frames = [
            jax.tree.map(lambda x, f=f: x[f], kept["frames"]) for f in range(count)
        ]
        self.steps = [
            Step(t, size, Status(int(status)), tuple(row[: int(k)].tolist()), bool(s))
            for (t, size, status, k, s), row in zip(
                kept["steps"], kept["residuals"], strict=True
            )
        ]
