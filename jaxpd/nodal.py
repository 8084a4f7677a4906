"""A scene of nodes made ready for `jit`: `Problem`'s twin for laws of strain.

Nodes with weights in the place of bonds, a law with a memory at each stress point, and
conditions that may follow a history. `NodalProblem.solve` is one step from an untouched
body; `jaxpd.path` takes many.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.assembly import Params
from jaxpd.discretize.collocate import Layout, collocation, second_derivatives
from jaxpd.geometry import Rim
from jaxpd.nodal_spec import NodalSpec, check_params
from jaxpd.operators import Constraints, NavierForce, StrongForce, navier
from jaxpd.operators.strong import untouched
from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.linear import LinearSolver, linear_solver
from jaxpd.solvers.newton import NewtonInfo


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class NodalProblem:
    """A scene of nodes: index lists are leaves, numbers are parameters.

    Attributes:
        params: defaults of everything that may be varied or differentiated: X [n, d]
            (m); law, a pytree with leaves [] or [n]; tau [], of the filter; prescribed
            [q, n, d] (m) and load [r, n, d], one for each history of the conditions:
            N/m^3, under traction Pa over the row's h, and where a component is
            prescribed the force (N) that loads put on that node.
        layout: stars and rows, frozen.
        rim: faces of nodes, frozen.
        fixed: mask of prescribed displacement components [n, d].
        X: reference positions [n, d] (m), for looking up; those of `params` count.
        vol: volumes [n] (m^d).
        linear: the linear solver.
        spec: how it is modelled and solved.
    """

    params: Params
    layout: Layout
    rim: Rim
    fixed: Any
    X: Any
    vol: PointScalar
    linear: LinearSolver
    spec: NodalSpec = field(metadata={"static": True})

    def operator(
        self, params: Params, history: Any = None
    ) -> StrongForce | NavierForce:
        """The strong form of some parameters, with a memory committed before."""
        weights = collocation(params["X"], self.layout)
        n, law = len(self.X), params["law"]
        shear = law.shear
        if self.layout.scheme == "midpoint":  # halfway between two nodes

            def between(x):
                x = jnp.asarray(x)
                return x[weights.nodes_of].mean(axis=0) if x.shape[:1] == (n,) else x

            law = jax.tree.map(between, law)
        history = untouched(law, weights.q) if history is None else history
        how = self.spec.tangent
        force = StrongForce(weights, law, shear, params["tau"], history, how)
        if self.layout.scheme != "direct":
            return force
        second = second_derivatives(params["X"], self.layout)
        return navier(force, second, self.layout.pulled)

    def build(
        self, params: Params, history: Any = None, now: Any = None
    ) -> tuple[StrongForce | NavierForce, Constraints, PointVector]:
        """Operator, constraints and loads of some parameters.

        Args:
            params: as `self.params`.
            history: memory committed before; that of an untouched body by default.
            now: factors of the conditions' histories, as `factors` makes them; all 1 by
                default.
        """
        check_params(params, self.params)
        constraints, load = self.conditions(params, now)
        return self.operator(params, history), constraints, load

    def conditions(
        self, params: Params, now: Any = None, operator: Any = None
    ) -> tuple[Constraints, PointVector]:
        """Prescribed displacements and right-hand sides at factors, 1 by default."""
        if now is None:
            now = tuple(jnp.ones(len(params[k])) for k in ("prescribed", "load"))
        moved, pulled = (
            jnp.einsum("q,qna->na", f, jnp.asarray(params[k]))
            for f, k in zip(now, ("prescribed", "load"), strict=True)
        )
        return Constraints(self.fixed, moved), pulled

    def history0(self, params: Params | None = None) -> Any:
        """The memory of an untouched body."""
        return history0_of(self, self.params if params is None else params)

    def solve(self, params: Params | None = None) -> tuple[PointVector, NewtonInfo]:
        """Displacements [n, d] (m) after one step from rest, and how it went.

        Pure, and differentiable in `params` by `jaxpd.solvers.implicit`. Stars, their
        radii, the normals of the rim and the scale h of tractions are frozen.
        """
        return solve_nodal(self, self.params if params is None else params)

    def stress(
        self, u: PointVector, params: Params | None = None, history: Any = None
    ) -> jax.Array:
        """Stresses at stress points [q, s] (Pa) at u, from a committed memory. Pure."""
        return stress_of(self, u, self.params if params is None else params, history)

    def strain(self, u: PointVector, params: Params | None = None) -> jax.Array:
        """Strains at stress points [q, s] (-), engineering shear. Pure."""
        return strain_of(self, u, self.params if params is None else params)

    def places(self) -> np.ndarray:
        """Reference positions of the stress points [q, d] (m). Host only."""
        X = np.asarray(self.X)
        if self.layout.scheme != "midpoint":
            return X
        x = X[np.asarray(self.layout.order)]
        return 0.5 * (x[1:] + x[:-1])

    def reaction(
        self,
        u: PointVector,
        params: Params | None = None,
        history: Any = None,
        now: Any = None,
    ) -> PointVector:
        """Forces of the supports on the body [n, d] (N). Pure.

        Stress times normal and area where a prescribed component lies on the rim, what
        balance leaves times volume inside.
        """
        params = self.params if params is None else params
        return nodal_reaction(self, u, params, history, now)

    def energy(self, u: PointVector, params: Params | None = None) -> PointScalar:
        """NaN [n]: a strong form has no energy that its forces follow from."""
        return jnp.full(len(u), jnp.nan)

    def solver(
        self, method: str, rtol: float = 1e-6, maxiter: int = 10_000
    ) -> LinearSolver:
        """A linear solver for this problem: "direct", "gmres" or "bicgstab".

        Raises:
            ValueError: on another method; all others need a symmetric tangent.
        """
        if method not in ("direct", "gmres", "bicgstab"):
            raise ValueError(
                f"solver: {method!r} is for symmetric tangents, and a strong form's is "
                "not; use 'direct', 'gmres' or 'bicgstab'"
            )
        return linear_solver(method, rtol, maxiter)

    def bare(self) -> NodalProblem:
        """This problem without its histories: another one compiles nothing anew."""
        spec = dataclasses.replace(self.spec, supports=(), loads=())
        return dataclasses.replace(self, spec=spec)

    def with_newton(self, **settings: Any) -> NodalProblem:
        """This problem with other settings of Newton's method."""
        return dataclasses.replace(self, spec=self.spec.with_newton(**settings))

    def seen(
        self, operator: Any, u: PointVector, stress: jax.Array, load: PointVector
    ) -> tuple[PointVector, PointVector]:
        """Displacements of the nodes and forces of the supports, both [n, d]. Pure."""
        return u, support_forces(self, operator, stress, u, load)

    def rough(self, u: PointVector) -> jax.Array:
        """Root mean square of (1 - Phi)^2 u over that of u, with the default X."""
        return rough_of(self.bare(), u)


@jax.jit
def solve_nodal(
    problem: NodalProblem, params: Params
) -> tuple[PointVector, NewtonInfo]:
    """Displacements after one step of an untouched body."""
    operator, constraints, load = problem.build(params)
    newton, u0 = problem.spec.newton, jnp.zeros_like(load)
    return equilibrium(newton, operator, constraints, load, problem.linear, u0)


@jax.jit
def history0_of(problem: NodalProblem, params: Params) -> Any:
    """The memory of an untouched body."""
    return problem.operator(params).history


@jax.jit
def stress_of(problem: NodalProblem, u: Any, params: Params, history: Any) -> Any:
    """Stresses at stress points."""
    return problem.operator(params, history).update(u)[0]


@jax.jit
def strain_of(problem: NodalProblem, u: Any, params: Params) -> Any:
    """Strains at stress points."""
    return collocation(params["X"], problem.layout).strain(u)


@jax.jit
def rough_of(problem: NodalProblem, u: Any) -> Any:
    """Root mean square of (1 - Phi)^2 u over that of u, with the default X."""
    weights = collocation(jnp.asarray(problem.params["X"]), problem.layout)
    return jnp.linalg.norm(weights.rough(u)) / jnp.linalg.norm(u)


@jax.jit
def nodal_reaction(
    problem: NodalProblem, u: Any, params: Params, history: Any, now: Any
) -> Any:
    """Forces of the supports."""
    operator, _, load = problem.build(params, history, now)
    stress, _ = operator.update(u)
    return support_forces(problem, operator, stress, u, load)


def support_forces(
    problem: NodalProblem, operator: Any, stress: Any, u: Any, load: Any
) -> Any:
    """Forces of the supports [n, d] (N) at known stresses."""
    rim, n = problem.rim, len(problem.X)
    at = problem.layout.point[rim.node]
    tensor = operator.tensor(stress)[at]
    flux = jnp.einsum("eab,eb->ea", tensor, rim.normal) * rim.area[:, None]
    on = jnp.zeros((n, 1), bool).at[rim.node].set(True)
    inside = -operator.left(stress, u) * jnp.asarray(problem.vol)[:, None]
    total: Any = jnp.zeros_like(u).at[rim.node].add(flux)
    pulled = jnp.where(on, total, inside) - load  # less what loads put there
    return jnp.where(problem.fixed, pulled, 0.0)
