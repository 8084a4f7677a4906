"""A scene of nodes in the weak form made ready for `jit`: `NodalProblem`'s twin.

Unknowns (`jaxpd.operators.essential`) are not displacements of nodes; those users see.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxpd._types import PointScalar, PointVector
from jaxpd.assembly import Params
from jaxpd.compiling import quickly
from jaxpd.discretize.layout import CellLayout
from jaxpd.discretize.rkpm import check_cover, cover_of, shape_functions
from jaxpd.discretize.sampling import sampling
from jaxpd.discretize.stabilised import stabilising
from jaxpd.nodal_spec import NodalSpec, check_params
from jaxpd.operators import Constraints
from jaxpd.operators.essential import essential
from jaxpd.operators.strong import untouched
from jaxpd.operators.weak import WeakForce, evenhanded
from jaxpd.solvers.amg import build_hierarchy
from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.linear import LinearSolver, linear_solver, methods
from jaxpd.solvers.newton import Newton, NewtonInfo


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class GalerkinProblem:
    """A scene of nodes in the weak form: index lists are leaves, numbers parameters.

    Attributes:
        params: defaults of everything that may be varied or differentiated: X [n, d]
            (m); law, a pytree with leaves [] or [n]; prescribed [q, n, d] (m), one for
            each history of the supports; and of each history of the loads traction
            [r, b, d] (Pa) and pressure [r, b] (Pa) at the places of the boundary, body
            [r, g, c, d] (N/m^3) at those of the rule; alpha [], of "NIS".
        layout: cells, covers and boundary, frozen.
        fixed: mask of prescribed displacement components [n, d].
        X: reference positions [n, d] (m), for looking up; those of `params` count.
        linear: the linear solver.
        spec: how it is modelled and solved.
    """

    params: Params
    layout: CellLayout
    fixed: Any
    X: Any
    linear: LinearSolver
    spec: NodalSpec = field(metadata={"static": True})

    @property
    def vol(self) -> PointScalar:
        """Volumes of the nodes [n] (m^d): of their cells, or shares of triangles."""
        return self._owned(operator_of(self).weights.w)

    def _owned(self, x: Any) -> PointScalar:
        """Sums [n] over the places [g, c] of a node's cell; thirds of triangles."""
        rule, out = self.layout.rule, jnp.sum(x, axis=0)
        if rule.kind != "triangles" or rule.dual is None:
            return out
        at = rule.dual.triangle
        return jnp.zeros(len(self.X)).at[at].add(out[:, None] / at.shape[1])

    def operator(self, params: Params, history: Any = None) -> WeakForce:
        """The weak form of some parameters, with a memory committed before."""
        weights = sampling(params["X"], self.layout)
        held, n = self.layout.held, len(self.X)
        rows = essential(held, weights.near[:, held], weights.value[:, held], n)
        law = jax.tree.map(self._sampled, params["law"])
        history = untouched(law, weights.q) if history is None else history
        t = params["traction"] - params["pressure"][..., None] * weights.normal[None]
        X, alpha, body = params["X"], params["alpha"], params["body"]
        penalty, more = stabilising(X, self.layout, params["law"], alpha, body)
        loads = jax.vmap(weights.traction)(t) + jax.vmap(weights.body_force)(body)
        how = self.spec.tangent
        return WeakForce(weights, rows, law, penalty, loads + more, history, how)

    def _sampled(self, x: Any) -> Any:
        """A leaf of the law [n] at the places [g c]: of their node, or the means."""
        x = jnp.asarray(x)
        if x.shape[:1] != (len(self.X),):
            return x
        rule = self.layout.rule
        if rule.kind == "triangles" and rule.dual is not None:
            x = x[rule.dual.triangle].mean(axis=1)
        return jnp.tile(x, self.layout.ends[0] // len(x))

    def build(
        self, params: Params, history: Any = None, now: Any = None
    ) -> tuple[WeakForce, Constraints, PointVector]:
        """Operator, constraints and loads of some parameters.

        Args:
            params: as `self.params`.
            history: memory committed before; that of an untouched body by default.
            now: factors of the conditions' histories; all 1 by default.
        """
        check_params(params, self.params)
        operator = self.operator(params, history)
        return operator, *self.conditions(params, now, operator)

    def conditions(
        self, params: Params, now: Any, operator: WeakForce
    ) -> tuple[Constraints, PointVector]:
        """Prescribed displacements and nodal forces at factors, 1 by default."""
        moved, pulled = jnp.asarray(params["prescribed"]), operator.loads
        if now is None:
            now = (jnp.ones(len(moved)), jnp.ones(len(pulled)))
        held = Constraints(self.fixed, jnp.einsum("q,qna->na", now[0], moved))
        return held, operator.load(now[1])

    def history0(self, params: Params | None = None) -> Any:
        """The memory of an untouched body."""
        return operator_of(self, params).history

    def solve(self, params: Params | None = None) -> tuple[PointVector, NewtonInfo]:
        """Displacements of the nodes [n, d] (m) after one step from rest.

        Pure, and differentiable in `params` by `jaxpd.solvers.implicit`. Triangles,
        covers, radii of kernels and which edges are held are frozen.
        """
        seen, _, info = solve_galerkin(self, params)
        return seen, info

    def unknowns(self, params: Params | None = None) -> tuple[PointVector, NewtonInfo]:
        """Unknowns [n, d] (m) after one step from rest: for `stress` and the others."""
        return solve_galerkin(self, params)[1:]

    def seen(
        self, operator: Any, u: PointVector, stress: jax.Array, load: PointVector
    ) -> tuple[PointVector, PointVector]:
        """Displacements of the nodes and forces of the supports, both [n, d]. Pure."""
        left = -operator.left(stress, u) - load
        return operator.field(u), jnp.where(self.fixed, left, 0.0)

    def stress(
        self, u: PointVector, params: Params | None = None, history: Any = None
    ) -> jax.Array:
        """Stresses at places [g c, s] (Pa) of unknowns, from a memory. Pure."""
        return _stress(operator_of(self, params), u, history)

    def strain(self, u: PointVector, params: Params | None = None) -> jax.Array:
        """Strains at places [g c, s] (-) of unknowns, engineering shear. Pure."""
        return _strain(operator_of(self, params), u)

    def reaction(
        self,
        u: PointVector,
        params: Params | None = None,
        history: Any = None,
        now: Any = None,
    ) -> PointVector:
        """Forces of the supports on the body [n, d] (N) of unknowns. Pure."""
        params = self.params if params is None else params
        operator = operator_of(self, params)
        load = self.conditions(params, now, operator)[1]
        return jnp.where(self.fixed, _reaction(operator, u, history, load), 0.0)

    def energy(self, u: PointVector, params: Params | None = None) -> PointScalar:
        """Elastic energy of each node [n] (J) of unknowns, without what stabilises.

        NaN for other laws than Hooke's and for tangents that are not symmetric.
        """
        operator = operator_of(self, params)
        return self._owned(operator.weights.w * _density(operator, u))

    def at(
        self, places: Any, u: PointVector, params: Params | None = None
    ) -> tuple[PointVector, jax.Array]:
        """Displacements [q, d] (m) and their gradients [q, d, d] (-) anywhere.

        Of unknowns, by the shape functions themselves, at places [q, d] in the body;
        component ab of a gradient is du_a / dx_b. Refuses places outside. Host only.
        """
        params = self.params if params is None else params
        X, radius = np.asarray(params["X"]), np.asarray(self.layout.cover.radius)
        cover = cover_of(np.asarray(places, float), X, radius)
        check_cover(np.asarray(places, float), X, cover, self.layout.degree)
        a = operator_of(self, params).essential.coefficients(jnp.asarray(u))[cover.nbr]
        at, degree = jnp.asarray(places), self.layout.degree
        psi, slope = _anywhere(at, params["X"], cover, degree, 1)
        return jnp.einsum("kq,kqa->qa", psi, a), jnp.einsum("bkq,kqa->qab", slope, a)

    def places(self) -> np.ndarray:
        """Reference positions of the places [g c, d] (m). Host only."""
        place = operator_of(self).weights.place
        return np.asarray(place).reshape(-1, np.shape(self.X)[1])

    def rough(self, u: PointVector) -> jax.Array:
        """Root mean square of (1 - Psi)^2 u over that of u, with the default X."""
        return _rough(operator_of(self), u)

    def solver(
        self, method: str, rtol: float = 1e-6, maxiter: int = 10_000
    ) -> LinearSolver:
        """A linear solver for this problem, hierarchy included. Host only.

        Raises:
            ValueError: on a method for lattices, or for what is symmetric alone.
        """
        if method in ("spectral", "multigrid"):
            raise ValueError(
                f"solver: {method!r} is for lattices of bonds; use 'direct' or 'amg'"
            )
        even = evenhanded(self.params["law"])
        symmetric = self.layout.scheme.symmetric and even
        general = ("direct", "gmres", "bicgstab")
        if not symmetric and method in methods() and method not in general:
            raise ValueError(
                f"solver: {method!r} is for symmetric tangents, and the "
                f"{'scheme' if even else 'material'} makes none; use one of {general}"
            )
        hierarchy: Any = None
        if method == "amg":
            X, fixed = np.asarray(self.X), np.asarray(self.fixed)
            K = first_tangent(operator_of(self))
            hierarchy = build_hierarchy(K.to_bsr(), X, fixed)
        return linear_solver(method, rtol, maxiter, hierarchy)

    def bare(self) -> GalerkinProblem:
        """This problem without its histories: another one compiles nothing anew."""
        spec = dataclasses.replace(self.spec, supports=(), loads=())
        return dataclasses.replace(self, spec=spec)

    def with_newton(self, **settings: Any) -> GalerkinProblem:
        """This problem with other settings of Newton's method."""
        return dataclasses.replace(self, spec=self.spec.with_newton(**settings))


def operator_of(problem: GalerkinProblem, params: Params | None = None) -> WeakForce:
    """The weak form of some parameters, compiled once for all that is asked."""
    params = problem.params if params is None else params
    check_params(params, problem.params)
    bare = dataclasses.replace(problem.bare(), params={}, linear=LinearSolver())
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((bare, params)))
    return (_compiled if traced else quickly(_operator))(bare, params)


def _operator(problem: GalerkinProblem, params: Params) -> WeakForce:
    return problem.operator(params)


def solve_galerkin(
    problem: GalerkinProblem, params: Params | None = None
) -> tuple[PointVector, PointVector, NewtonInfo]:
    """Displacements of the nodes and unknowns after one step of an untouched body."""
    params = problem.params if params is None else params
    operator = operator_of(problem, params)
    constraints, load = problem.conditions(params, None, operator)
    traced = any(isinstance(x, Tracer) for x in jax.tree.leaves((operator, load)))
    solve = _balance if traced else quickly(_balanced, static_argnums=0)
    newton = problem.spec.newton
    return solve(newton, operator, constraints, load, problem.linear)


def _balanced(
    newton: Newton, operator: WeakForce, constraints: Any, load: Any, linear: Any
) -> tuple[PointVector, PointVector, NewtonInfo]:
    u0 = jnp.zeros_like(load)
    u, info = equilibrium(newton, operator, constraints, load, linear, u0)
    return operator.field(u), u, info


def first_tangent(operator: WeakForce) -> Any:
    """The stiffness of the untouched body in NumPy arrays. Host only."""
    return jax.tree.map(np.asarray, quickly(_tangent)(operator))


def _tangent(operator: WeakForce) -> Any:
    return operator.tangent(jnp.zeros_like(operator.loads[0]))


_compiled = jax.jit(_operator)
_balance = jax.jit(_balanced, static_argnums=0)
_anywhere = jax.jit(shape_functions, static_argnums=(3, 4))


@jax.jit
def _stress(operator: WeakForce, u: Any, history: Any) -> jax.Array:
    return operator.update(u, history)[0]


@jax.jit
def _strain(operator: WeakForce, u: Any) -> jax.Array:
    return operator.strain(u)


@jax.jit
def _reaction(operator: WeakForce, u: Any, history: Any, load: Any) -> PointVector:
    return -operator.left(operator.update(u, history)[0], u) - load


@jax.jit
def _density(operator: WeakForce, u: Any) -> jax.Array:
    return operator.density(u).reshape(operator.weights.w.shape)


@jax.jit
def _rough(operator: WeakForce, u: Any) -> Any:
    left = u - operator.weights.field(u)
    return jnp.linalg.norm(left - operator.weights.field(left)) / jnp.linalg.norm(u)
