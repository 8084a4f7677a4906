"""Load paths of nodes for the benchmarks: stars padded, so that code is compiled once.

The same walk as `jaxpd.solve_path`, of bodies whose stars differ in width from seed to
seed; the padding carries no weight.
"""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpd import prepare
from jaxpd.nodal import NodalProblem
from jaxpd.scene import Scene
from jaxpd.walk import Walk

MAX_ITERATIONS = 25


@dataclass(frozen=True)
class Followed:
    """What came of a path.

    Attributes:
        problem: that was solved, a `NodalProblem` or `GalerkinProblem`.
        X: nodes [n, d] (m).
        u: displacements of the frames reached [F, n, d] (m).
        stress: [F, q, s] (Pa).
        peeq: [F, q], or None of an elastic body.
        reaction: [F, n, d] (N).
        iterations: of each accepted step.
        failed: attempts that did not converge.
        stopped: why it did not go to the end, or None.
        seconds: of the load steps, compilation included.
    """

    problem: Any
    X: np.ndarray
    u: np.ndarray
    stress: np.ndarray
    peeq: Any
    reaction: np.ndarray
    iterations: list[int]
    failed: int
    stopped: str | None
    seconds: float

    @property
    def most(self) -> int:
        """Most iterations of an accepted step."""
        return max(self.iterations, default=0)

    def pull(self, where: np.ndarray, axis: int) -> np.ndarray:
        """Resultant [F] (N) of the supports on some nodes."""
        return self.reaction[:, where, axis].sum(axis=1)


def padded(problem: NodalProblem, width: int) -> NodalProblem:
    """The problem with stars of a width, slots without weight added."""
    layout = problem.layout
    more = width - layout.stars.nbr.shape[0]
    if more <= 0:
        return problem
    stars = dataclasses.replace(
        layout.stars,
        nbr=jnp.concatenate([layout.stars.nbr, *[layout.stars.nbr[:1]] * more]),
        there=jnp.pad(layout.stars.there, ((0, more), (0, 0))),
    )
    back = jnp.pad(layout.back, ((0, more), (0, 0)), constant_values=-1)
    layout = dataclasses.replace(layout, stars=stars, back=back)
    return dataclasses.replace(problem, layout=layout)


def follow(
    scene: Scene,
    times: Sequence[float] | np.ndarray,
    *,
    width: int = 0,
    halvings: int = 6,
    tangent: str = "ad",
    solver: str = "auto",
) -> Followed:
    """Take a scene through load steps.

    Args:
        scene: of nodes.
        times: of the frames.
        width: of the stars at least, to share compiled code.
        halvings: of a load step that fails, as `solve_path`.
        tangent: of the law.
        solver: of the linear systems.
    """
    problem = prepare(
        scene,
        solver=solver,
        tangent=tangent,
        rtol=1e-10,
        linear_rtol=1e-8,
        max_iterations=MAX_ITERATIONS,
    ).with_newton(max_cuts=0, max_halvings=0, max_total=MAX_ITERATIONS)
    return walked(padded(problem, width), times, halvings)


def walked(
    problem: Any, times: Sequence[float] | np.ndarray, halvings: int
) -> Followed:
    """Take a problem of nodes through load steps."""
    start = time.perf_counter()
    walk = Walk(problem, halvings)
    for target in np.asarray(times, float).tolist():
        while walk.t < target and not walk.stopped:
            walk.go(target)
        if walk.stopped:
            break
    frames: Any = walk.columns()
    good = [s for s in walk.steps if s.status == 0]
    return Followed(
        problem=problem,
        X=np.asarray(problem.X),
        u=frames.u,
        stress=frames.stress,
        peeq=getattr(frames.history, "peeq", None),
        reaction=frames.reaction,
        iterations=[s.iterations for s in good],
        failed=len(walk.steps) - len(good),
        stopped=walk.stopped,
        seconds=time.perf_counter() - start,
    )
