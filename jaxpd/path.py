"""Quasi-static paths: load steps of bodies with a memory, on the host.

Supports and loads follow their histories (`jaxpd.ramp`, `jaxpd.table`) in a pseudo-time
t. Each step is solved by Newton's method from the last, and its memory is committed
once it has converged. A step that fails is halved; where halving does not help, it is
tried again with a line search.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path as File
from typing import Any

import numpy as np

from jaxpd import io
from jaxpd.checks import instance, numbers, whole
from jaxpd.geometry import Region
from jaxpd.prepare import prepare
from jaxpd.progress import bar
from jaxpd.replay import Replay
from jaxpd.resolution import NODES
from jaxpd.run import peak_memory
from jaxpd.scene import Scene
from jaxpd.solvers.status import NotConverged, Status
from jaxpd.walk import CUTS, Step, Walk


@dataclass(frozen=True, eq=False)
class Path:
    """A path that was followed; frames [F] are at `t`.

    Attributes:
        scene: what was loaded.
        problem: what it was prepared into.
        t: times of the frames [F] that were reached.
        u: displacements of the nodes [F, n, d] (m).
        unknowns: what was solved for [F, n, d] (m), for the methods of `problem`: the
            same but for kernels, which do not interpolate.
        strain: at stress points [F, q, s] (-), Voigt with engineering shear.
        stress: there [F, q, s] (Pa), Voigt.
        reaction: forces of the supports on the body [F, n, d] (N).
        history: memory of the stress points, leaves [F, q, ...].
        steps: every attempt, failed ones included.
        floor: norm of a residual that counted as rest, of each accepted step.
        stopped: why it did not go to the end, or None.
        seconds: wall time of "prepare" and "steps", compilation included.
        peak_memory: highest resident memory of the process so far (bytes).
    """

    scene: Scene
    problem: Any
    t: np.ndarray
    u: np.ndarray
    unknowns: np.ndarray
    strain: np.ndarray
    stress: np.ndarray
    reaction: np.ndarray
    history: Any
    steps: tuple[Step, ...]
    floor: tuple[float, ...]
    stopped: str | None
    seconds: dict[str, float]
    peak_memory: int

    def __repr__(self) -> str:
        """One line: sizes, steps, end."""
        end = self.stopped or "to the end"
        return (
            f"Path({len(self.problem.X)} nodes, {len(self.t)} frames, "
            f"{len(self.accepted)} load steps of at most "
            f"{max((s.iterations for s in self.accepted), default=0)} iterations, "
            f"{len(self.steps) - len(self.accepted)} failed, {end})"
        )

    @property
    def X(self) -> np.ndarray:
        """Reference positions of the nodes [n, d] (m)."""
        return np.asarray(self.problem.X)

    @property
    def accepted(self) -> tuple[Step, ...]:
        """The steps that converged."""
        return tuple(s for s in self.steps if s.status is Status.CONVERGED)

    @property
    def iterations(self) -> np.ndarray:
        """Newton iterations of each accepted step."""
        return np.array([s.iterations for s in self.accepted])

    @property
    def peeq(self) -> np.ndarray:
        """Equivalent plastic strain at stress points [F, q] (-).

        Raises:
            ValueError: if the law has none.
        """
        if not hasattr(self.history, "peeq"):
            raise ValueError(
                f"peeq: {type(self.problem.params['law']).__name__} has none"
            )
        return self.history.peeq

    @functools.cached_property
    def rough(self) -> np.ndarray:
        """Share of displacements that alternate from node to node [F] (-).

        Root mean square of (1 - Phi)^2 u over that of u, Phi the fit of the value. A
        sound body has some 1e-2 and less; loads may look right where it is more, see
        `tests/stability/test_mls.py`. NaN at rest.
        """
        return np.array([self.problem.rough(u) for u in self.u])

    def reaction_on(self, region: Region) -> np.ndarray:
        """Resultants [F, d] (N) of the supports' forces on the nodes in a region."""
        return self.reaction[:, region.contains(self.X)].sum(axis=1)

    def checked(self) -> Path:
        """This path, if it went to the end.

        Raises:
            NotConverged: with status, residual history and cure.
        """
        if self.stopped:
            last = self.steps[-1]
            what = f"load step to t = {last.t:.6g} ({self.stopped})"
            raise NotConverged(last.status, np.array(last.residuals), what)
        return self

    def replay(self, kept: Sequence[int] | None = None) -> Replay:
        """The accepted load steps as one differentiable function of the parameters.

        Args:
            kept: which frames to look at, all by default.

        Raises:
            NotConverged: if the path did not go to the end.
        """
        self.checked()
        times = [s.t for s in self.accepted]
        at = [times.index(t) for t in self.t]
        supports, loads = zip(
            *[self.problem.spec.factors(t) for t in times], strict=True
        )
        chosen = tuple(at if kept is None else [at[k] for k in kept])
        floor = np.asarray(self.floor)
        problem = self.problem.bare()
        if any(s.searched for s in self.accepted):
            problem = problem.with_newton(max_cuts=CUTS)
        return Replay(problem, np.array(supports), np.array(loads), floor, chosen)

    def write(self, folder: str | File) -> list[File]:
        """VTU files of the frames, and a .pvd that names them; needs meshio."""
        if not len(self.t):
            raise ValueError("t: no load step came to an end, there is no frame")
        fields = {"u": self.u, "reaction": self.reaction}
        if self.stress.shape[1] == len(self.X):
            fields |= {
                f"stress_{k}": x for k, x in enumerate(self.stress.transpose(2, 0, 1))
            }
            if hasattr(self.history, "peeq"):
                fields["peeq"] = self.peeq
        return io.write_series(folder, self.X, self.t, fields)


def check_times(times: Any) -> list[float]:
    """Times of load steps, which rise strictly from above 0.

    Raises:
        ValueError: if they do not.
    """
    targets = np.asarray(numbers("times", times, cure="a list, in s"), float)
    rising = targets.ndim == 1 and len(targets) > 0
    if not (rising and (np.diff(targets, prepend=0.0) > 0).all()):
        raise ValueError(f"times: {times} must rise strictly, from above 0")
    return targets.tolist()


def solve_path(
    scene: Scene,
    times: Sequence[float],
    *,
    solver: str = "auto",
    tangent: str = "ad",
    rtol: float = 1e-10,
    linear_rtol: float = 1e-8,
    max_iterations: int = 25,
    max_halvings: int = 6,
    folder: str | File | None = None,
    progress: bool | None = None,
) -> Path:
    """Load a scene of nodes step by step.

    Args:
        scene: with `MLS` or `RKPM`, and supports and loads that follow histories, as
            `time=jaxpd.ramp(1.0)`; what has none acts in full from the first step on.
        times: rising, above 0, where the body is unloaded; a load step to each, and a
            frame there.
        solver: "direct", "gmres" or "bicgstab"; "auto" is "direct".
        tangent: of the law, "ad", "hand" or "continuum".
        rtol: tolerance of each step's residual over its first one; linear elasticity
            has one linear solve instead.
        linear_rtol: that of each linear solve; 1e-8 by default, above which a direct
            solve counts as failed. Newton's residual is the true one whatever it is.
        max_iterations: Newton iterations of a load step before it is halved.
        max_halvings: how often a load step is halved, and again with a line search.
        folder: keeps a checkpoint after each load step, made if need be. A path that
            was killed goes on from it, to the same end, bit by bit.
        progress: a bar, by tqdm; None shows it on a terminal.

    Returns:
        A `Path`; call its `checked()` to be sure that it went to the end.

    Raises:
        ValueError: as `prepare`, on times that do not rise, or a folder of another
            path.
    """
    started = time.perf_counter()
    instance("scene", scene, Scene, "a Scene(..)")
    if not isinstance(scene.resolution, NODES):
        raise ValueError(
            "resolution: load steps with a memory are for nodes, resolution=MLS(..) or "
            "RKPM(..); solve_static and run_explicit are for bonds"
        )
    targets = np.asarray(check_times(times))
    max_halvings = whole("max_halvings", max_halvings, 0)
    problem = prepare(
        scene,
        solver=solver,
        tangent=tangent,
        rtol=rtol,
        linear_rtol=linear_rtol,
        max_iterations=max_iterations,
    ).with_newton(max_cuts=0, max_halvings=0, max_total=max_iterations)
    file, mark = None, ""
    if folder is not None:
        file = io.make_folder(folder) / "path.npz"
        mark = f"a path of {len(problem.X)} nodes, "
        mark += io.digest(problem, targets.tolist(), max_halvings)
    walk = Walk(problem, max_halvings)
    if file is not None and file.exists():
        walk.load(file, mark)
    ready = time.perf_counter()
    for k in bar(range(len(walk.frames), len(targets)), len(targets), progress):
        while walk.t < targets[k] and not walk.stopped:
            walk.go(float(targets[k]))
            if file is not None:
                walk.save(file, mark)
        if walk.stopped:
            break
    frames: Any = walk.columns()
    return Path(
        scene=scene,
        problem=problem,
        t=targets[: len(walk.frames)],
        u=frames.u,
        unknowns=frames.unknowns,
        strain=frames.strain,
        stress=frames.stress,
        reaction=frames.reaction,
        history=frames.history,
        steps=tuple(walk.steps),
        floor=tuple(walk.floor),
        stopped=walk.stopped,
        seconds={"prepare": ready - started, "steps": time.perf_counter() - ready},
        peak_memory=peak_memory(),
    )
