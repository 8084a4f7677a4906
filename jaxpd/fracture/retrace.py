"""States of a slow fracture again, as one pure function of the parameters.

A path that was found says which bonds are gone in each state, and which bond stands at
its strength. With these frozen a state is one linear solve,

    K u = load,    f = s_crit / s(u) of the critical bond,

and its load factor f, reactions and displacements f u have derivatives: of the peak
load in G0, E, a field of moduli, nodes. States of load steps keep their factor.

Where the derivative does not exist: the factor of an event is the least of those of all
intact bonds. Mirror images tie; a change that tells them apart has a derivative to one
side only, that of the bond that it weakens, and here the change of the first of them
is seen, whichever that is. A change large enough to break other bonds leaves the path.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd.assembly import Params, Spec
from jaxpd.fracture.breaking import Fracture
from jaxpd.operators import Constraints
from jaxpd.operators.springs import SpringForce
from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import NewtonInfo


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Traced:
    """What is looked at in each state; leading axis [F].

    Attributes:
        factor: load factor [F].
        force: work of its growth by 1 [F] (J), see `jaxpd.fracture.growth.Growth`.
        u: displacements [F, n, d] (m).
        reaction: forces of the supports on the body [F, n, d] (N).
        stretch: of the most stretched bonds over the critical one [F] (-): 1 in states
            of events, which is what makes them.
    """

    factor: jax.Array
    force: jax.Array
    u: jax.Array
    reaction: jax.Array
    stretch: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Retrace:
    """Some states of a path as a function of the parameters.

    It looks like a problem, so that `jaxpd.fit` and `jaxpd.gradcheck.taylor` take it.

    Attributes:
        fracture: what broke.
        gone: which bonds are gone in each state [F, b].
        critical: number of the bond at its strength [F]; -1 where `factor` counts.
        factor: load factors [F].
        linear: the linear solver.
    """

    fracture: Fracture
    gone: Any
    critical: Any
    factor: Any
    linear: LinearSolver = field(
        default_factory=lambda: LinearSolver(method="direct", rtol=1e-6)
    )

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

    def solve(self, params: Params | None = None) -> tuple[Traced, NewtonInfo]:
        """The states, and how the worst solve went. Pure and differentiable."""
        return solve_retrace(self, self.params if params is None else params)


@jax.jit
def solve_retrace(trace: Retrace, params: Params) -> tuple[Traced, NewtonInfo]:
    """All states again, one after the other."""
    fracture = trace.fracture
    fixed, n = fracture.fixed, len(fracture.X)
    springs, s_crit = fracture.springs(params), fracture.critical(params)
    constraints = Constraints(fixed, jnp.asarray(params["prescribed"]))
    load = jnp.asarray(params["load"])
    newton = fracture.problem.spec.newton

    def of(state):
        gone, bond, factor = state
        force = SpringForce(springs, jnp.where(gone, 0.0, 1.0), n)
        start = jnp.zeros_like(load)
        u, info = equilibrium(newton, force, constraints, load, trace.linear, start)
        s = springs.stretch(u)
        at = jnp.maximum(bond, 0)
        # a bond that is not there divides by nothing
        own: Any = jnp.where(bond < 0, 1.0, s[at])
        strength: Any = jnp.where(bond < 0, 1.0, s_crit[at])
        f: Any = jnp.where(bond < 0, factor, strength / own)
        pull: Any = jnp.where(fixed, -(force.respond(u) + load), 0.0)
        work = jnp.sum(pull * u) + jnp.sum(load * u)
        stretched: Any = jnp.where(gone, 0.0, s / s_crit)
        most = f * jnp.max(stretched)
        return Traced(f, f * work, f * u, f * pull, most), info

    states = (jnp.asarray(trace.gone), trace.critical, jnp.asarray(trace.factor))
    seen, infos = jax.lax.map(of, jax.tree.map(jnp.asarray, states))
    worst = jnp.argmax(infos.status)
    return seen, jax.tree.map(lambda x: x[worst], infos)
