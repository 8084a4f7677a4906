"""Load steps again, as one pure function of the parameters.

A path that was found (`jaxpd.path`) fixes which load steps there are. Taken again in
one trace they are differentiable, loading, unloading and reloading alike: each step by
the implicit rule, and from step to step through the memory. `Replay` looks like a
problem, so that `jaxpd.fit` and `jaxpd.gradcheck.taylor` take it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.assembly import Params
from jaxpd.nodal import NodalSpec
from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import NewtonInfo


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Frames:
    """What is looked at after load steps; leading axis [F].

    Attributes:
        u: displacements of the nodes [F, n, d] (m).
        unknowns: what was solved for [F, n, d] (m): the same but for kernels.
        strain: at stress points [F, q, s] (-), engineering shear.
        stress: at stress points [F, q, s] (Pa).
        reaction: forces of the supports [F, n, d] (N).
        history: memory of the stress points, leaves [F, q, ...].
    """

    u: jax.Array
    unknowns: jax.Array
    strain: jax.Array
    stress: jax.Array
    reaction: jax.Array
    history: Any


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Replay:
    """The load steps of a path as a function of the parameters.

    Attributes:
        problem: what is loaded, a `NodalProblem` or `GalerkinProblem`.
        supports: factors of their histories at each step [A, q].
        loads: factors of the loads' [A, r].
        floor: norm of a residual that is small, of each step [A].
        kept: which of the steps are frames [F], a tuple.
    """

    problem: Any
    supports: Any
    loads: Any
    floor: Any
    kept: tuple[int, ...] = field(metadata={"static": True})

    @property
    def params(self) -> Params:
        """Defaults of the parameters."""
        return self.problem.params

    @property
    def X(self) -> Any:
        """Reference positions [n, d] (m)."""
        return self.problem.X

    @property
    def fixed(self) -> Any:
        """Mask of prescribed displacement components [n, d]."""
        return self.problem.fixed

    @property
    def spec(self) -> NodalSpec:
        """How it is modelled and solved."""
        return self.problem.spec

    @property
    def linear(self) -> LinearSolver:
        """The linear solver."""
        return self.problem.linear

    def solve(self, params: Params | None = None) -> tuple[Frames, NewtonInfo]:
        """Frames, and how the worst step went. Pure and differentiable."""
        return solve_replay(self, self.params if params is None else params)


def one_step(
    problem: Any,
    params: Params,
    operator: Any,
    start: tuple[Any, Any],
    now: Any,
    floor: Any,
) -> tuple[tuple[Any, Any], Frames, NewtonInfo]:
    """One load step from displacements and memory to the next, committed.

    Args:
        problem: what is loaded.
        params: of its conditions.
        operator: of the same parameters, with any memory.
        start: displacements and memory before.
        now: factors of the conditions' histories.
        floor: norm of a residual that is small.

    Returns:
        Displacements and memory after, what is looked at, and how the solve went.
    """
    u0, history = start
    operator = operator.after(history)
    constraints, load = problem.conditions(params, now, operator)
    settings, linear = problem.spec.newton, problem.linear
    u, info = equilibrium(settings, operator, constraints, load, linear, u0, floor)
    stress, history = operator.update(u)
    moved, pulled = problem.seen(operator, u, stress, load)
    frame = Frames(moved, u, operator.strain(u), stress, pulled, history)
    return (u, history), frame, info


@jax.jit
def solve_replay(replay: Replay, params: Params) -> tuple[Frames, NewtonInfo]:
    """All load steps again, in one scan."""
    problem = replay.problem
    operator = problem.operator(params)
    start = (jnp.zeros(np.shape(problem.X)), operator.history)

    def take(state, item):
        *now, floor = item
        state, frame, info = one_step(problem, params, operator, state, now, floor)
        return state, (frame, info)

    items = (replay.supports, replay.loads, replay.floor)
    _, (frames, infos) = jax.lax.scan(take, start, jax.tree.map(jnp.asarray, items))
    kept = np.asarray(replay.kept)
    last = jax.tree.map(lambda x: x[-1], infos)
    info = dataclasses.replace(last, status=infos.status.max())
    return jax.tree.map(lambda x: x[kept], frames), info
