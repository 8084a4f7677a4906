"""The path of softening bonds again, as one pure function of the parameters.

The path that was found (`soft_walk`) fixes the load factors. Taken again in one
trace the states are differentiable in whatever the springs and their strength depend
on: each by the implicit rule, and from state to state through the memory. Newton's
method begins at the displacements that were found. At a limit point of the load there
is no derivative at a fixed factor; beyond it there is again.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.assembly import Params, Spec
from jaxpd.fracture.breaking import Fracture
from jaxpd.operators.constraints import Constraints
from jaxpd.operators.soft_springs import SoftSprings
from jaxpd.physics.bilinear import Bilinear
from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton, NewtonInfo

#: Tolerance of a residual over that of the first iteration, and over the forces.
RTOL = 1e-10
NEWTON = Newton(rtol=RTOL, max_iterations=30)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SoftFrames:
    """What is looked at of states of a softening body; leading axis [F].

    Attributes:
        u: displacements [F, n, d] (m).
        reaction: forces of the supports [F, n, d] (N).
        force: work of the load factor's growth by 1 [F] (J), as of `Growth`.
        h: largest stretch of each bond so far [F, b] (-).
        share: share of its stiffness that is left [F, b] (-).
        stored: energy of all bonds [F] (J).
        spent: energy that softening has taken since rest [F] (J).
    """

    u: jax.Array
    reaction: jax.Array
    force: jax.Array
    h: jax.Array
    share: jax.Array
    stored: jax.Array
    spent: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SoftReplay:
    """The states of a path as a function of the parameters.

    Attributes:
        fracture: what breaks.
        ratio: stretch without force over that of the largest [] (-).
        factors: load factor of each state from the first after rest on [A].
        start: displacements that were found in each [A, n, d] (m).
        floor: norm of a residual that is small, of each [A] (N).
        kept: which of the states are frames [F], counted from that after rest.
    """

    fracture: Fracture
    ratio: Any
    factors: Any
    start: Any
    floor: Any
    kept: tuple[int, ...] = field(metadata={"static": True})

    @property
    def params(self) -> Params:
        """Defaults of the parameters."""
        return self.fracture.params

    @property
    def X(self) -> Any:
        """Reference positions [n, d] (m)."""
        return self.fracture.X

    @property
    def fixed(self) -> Any:
        """Mask of prescribed displacement components [n, d]."""
        return self.fracture.fixed

    @property
    def spec(self) -> Spec:
        """How it is modelled."""
        return self.fracture.problem.spec

    @property
    def linear(self) -> LinearSolver:
        """The linear solver."""
        return self.fracture.problem.linear

    def operator(self, params: Params) -> SoftSprings:
        """The springs of the given parameters, untouched. Pure."""
        springs = self.fracture.springs(params)
        k: Any = jnp.where(self.fracture.cut, 0.0, springs.k)
        springs = dataclasses.replace(springs, k=k)
        law = Bilinear(None, self.fracture.critical(params), self.ratio)
        return SoftSprings(springs, law, jnp.zeros_like(k))

    def solve(self, params: Params | None = None) -> tuple[SoftFrames, NewtonInfo]:
        """Frames, and how the worst state went. Pure and differentiable."""
        return solve_again(self, self.params if params is None else params)


def replay_of(
    fracture: Fracture, softened: Any, factors: Any, kept: Any = None
) -> SoftReplay:
    """A path to take again.

    Args:
        fracture: what broke.
        softened: memory and displacements of its states, a `Softened`.
        factors: their load factors [F].
        kept: numbers of the states to look at, all but rest by default.

    Raises:
        ValueError: on a number that is no state's after rest.
    """
    count = len(factors)
    chosen = list(range(1, count) if kept is None else kept)
    if not chosen or not all(0 < k < count for k in chosen):
        raise ValueError(
            f"kept: {kept} must be numbers of states from 1 to {count - 1}; the state "
            "0 is at rest"
        )
    upto = slice(1, max(chosen) + 1)
    return SoftReplay(
        fracture,
        np.asarray(softened.law.ratio, float),
        np.asarray(factors, float)[upto],
        softened.u[upto],
        RTOL * softened.scale[upto],
        tuple(int(k) - 1 for k in chosen),
    )


@jax.jit
def solve_again(replay: SoftReplay, params: Params) -> tuple[SoftFrames, NewtonInfo]:
    """All states again, in one scan."""
    fixed, linear = replay.fixed, replay.linear
    untouched = replay.operator(params)
    moved, pull = (jnp.asarray(params[name]) for name in ("prescribed", "load"))

    def take(h, item):
        factor, start, floor = item
        operator = untouched.after(h)
        constraints = Constraints(fixed, factor * moved)
        load = factor * pull
        u, info = equilibrium(NEWTON, operator, constraints, load, linear, start, floor)
        h = operator.advance(u)
        operator = operator.after(h)
        pulled: Any = jnp.where(fixed, -(operator.respond(u) + load), 0.0)
        frame = SoftFrames(
            u=u,
            reaction=pulled,
            force=jnp.sum(pulled * moved) + jnp.sum(pull * u),
            h=h,
            share=operator.law.share(h),
            stored=operator.energy(u),
            spent=operator.spent(),
        )
        return h, (frame, info)

    items = jax.tree.map(jnp.asarray, (replay.factors, replay.start, replay.floor))
    _, (frames, infos) = jax.lax.scan(take, untouched.history0(), items)
    kept = np.asarray(replay.kept)
    last = jax.tree.map(lambda x: x[-1], infos)
    info = dataclasses.replace(last, status=infos.status.max())
    return jax.tree.map(lambda x: x[kept], frames), info
