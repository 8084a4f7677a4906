"""A scene made ready for `jit`: one pure function of its parameters.

`jaxpd.prepare` builds what does not change (points, bonds, masks, hierarchy) into a
`Problem`, a pytree whose floating-point defaults are `problem.params`. `build` makes
operator, constraints and load of any such parameters; `Problem.solve` is what `jit`
sees. Index lists are leaves of the problem, so they enter a trace as arguments.

On a lattice the parameters are NumPy's, and so is everything that `stiffness` makes of
them outside a trace: such a solve compiles its iteration and nothing else.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.assembly import Params, Spec, bond_operator, separate
from jaxpd.body import check_held
from jaxpd.discretize import Extension
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.geometry import Family
from jaxpd.geometry.grid_family import GridFamily, without
from jaxpd.operators import (
    BondForce,
    Constraints,
    FFTTangent,
    LatticeTangent,
    Pulled,
    StencilForce,
    convolution,
)
from jaxpd.operators.rest import BondsAtRest, LinearForce
from jaxpd.physics import Microelastic, micromodulus
from jaxpd.resolution import Kernel
from jaxpd.solvers.amg import build_hierarchy
from jaxpd.solvers.hierarchy import build_multigrid
from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.linear import LinearSolver, linear_solver
from jaxpd.solvers.newton import NewtonInfo
from jaxpd.solvers.spectral import build_spectral

OPERATORS = ("gather", "stencil", "fft")
__all__ = ["OPERATORS", "Params", "Problem", "Spec", "separate"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Problem:
    """A scene made ready for `jit`: index lists are leaves, numbers are parameters.

    Attributes:
        params: defaults of everything that may be varied or differentiated:
            X [n, d] (m) and vol [n] (m^d), or dx [] (m) on a lattice without index
            lists; delta [] (m), prescribed [n, d] (m), load [n, d] (N), and E [] or [n]
            (Pa) with alpha, ratio or omega of the influence function; or `law`, the
            user's own.
        family: bonds, frozen.
        fixed: mask of prescribed displacement components [n, d].
        X: reference positions [n, d] (m), for looking up; those of `params` count.
        linear: the linear solver with its hierarchy.
        spec: how it is modelled and solved.
        extension: of the correction "fictitious"; `family` is then that of all points.
    """

    params: Params
    family: Family | GridFamily
    fixed: Any
    X: Any
    linear: LinearSolver
    spec: Spec = field(metadata={"static": True})
    extension: Extension | None = None

    @property
    def vol(self) -> PointScalar:
        """Volumes [n] (m^d)."""
        if "vol" in self.params:
            return self.params["vol"]
        d = self.X.shape[1]
        return np.full(len(self.X), self.params["dx"] ** d)

    def law(self, params: Params, d: int) -> Any:
        """The bond law of the given parameters."""
        if self.spec.material == "law":
            return params["law"]
        if self.spec.kernel == "own":
            omega = params["omega"]
        else:
            number = params.get("alpha", params.get("ratio", 0.0))
            omega = Kernel(self.spec.kernel, number).influence(d, params["delta"])
        spec = self.spec
        c = micromodulus(params["E"], spec.nu, spec.state, d, params["delta"], omega)
        return Microelastic(spec.stiffening * c, omega)

    def build(
        self, params: Params
    ) -> tuple[BondForce | StencilForce | Pulled, Constraints, PointVector]:
        """Operator, constraints and external load (N) of the given parameters."""
        if set(params) != set(self.params):
            unknown = sorted(set(params) - set(self.params))
            missing = sorted(set(self.params) - set(params))
            raise ValueError(
                f"params: {unknown} must be absent and {missing} given, as in "
                f"`problem.params | {{name: value}}`, with the operator "
                f"{self.spec.operator!r}; X and vol are parameters of 'gather'"
            )
        constraints = Constraints(self.fixed, params["prescribed"])
        return self.bonds(params), constraints, params["load"]

    def bonds(self, params: Params) -> BondForce | StencilForce | Pulled:
        """The operator of the given parameters, at finite displacements."""
        spec, d, one = self.spec, self.X.shape[1], None
        if spec.material == "elastic":
            one = self.law(params | {"E": 1.0}, d)
        law = self.law(params, d)
        return bond_operator(spec, self.family, self.extension, params, law, one)

    def force(self, params: Params) -> tuple[Any, Constraints, PointVector]:
        """`build`, with the operator that is solved: linear where strains are small."""
        operator, constraints, load = self.build(params)
        if self.spec.kinematics == "finite":
            return operator, constraints, load
        if not isinstance(operator, StencilForce):
            return BondsAtRest(operator), constraints, load
        return LinearForce(self._at_rest(operator)), constraints, load

    def stiffness(self, params: Params | None = None) -> Any:
        """Stiffness of the undeformed body, a `Tangent`."""
        operator, _, load = self.build(self.params if params is None else params)
        if not isinstance(operator, StencilForce):
            return operator.tangent(jnp.zeros_like(load))
        return self._at_rest(operator)

    def _at_rest(self, operator: StencilForce) -> Any:
        if operator.scale is not None:  # every bond is another: blocks a bond
            return operator.tangent(jnp.zeros(self.X.shape, operator.scale.dtype))
        rest = operator.rest()
        self._check_separation()
        if self.spec.operator == "stencil" and self.spec.kinematics == "small":
            return rest
        return convolution(rest, self.spec.pivots, self.spec.patches)

    def solve(self, params: Params | None = None) -> tuple[PointVector, NewtonInfo]:
        """Displacements [n, d] (m) in equilibrium, and how the solve went.

        Pure, and differentiable in `params` by `jaxpd.solvers.implicit`: `jax.grad`,
        `jacfwd`, `jacrev`, Hessian-vector products, `vmap`. Topology is frozen: bonds
        are those found within the horizon of `prepare`, and another `delta` changes
        weights and calibration alone; with partial="continuous" that is exact for a
        shorter one. A shape derivative in X leaves the volumes `vol` as they are,
        unless they are moved too. A small misfit needs an `rtol` well below its size.
        """
        return solve_problem(self, self.params if params is None else params)

    def reaction(self, u: PointVector, params: Params | None = None) -> PointVector:
        """Forces of the supports on the body [n, d] (N). Pure."""
        return reaction_of(self, u, self.params if params is None else params)

    def energy(self, u: PointVector, params: Params | None = None) -> PointScalar:
        """Stored energy of each point [n] (J), NaN for a law without one. Pure."""
        return energy_of(self, u, self.params if params is None else params)

    def solver(
        self, method: str, rtol: float = 1e-6, maxiter: int = 10_000
    ) -> LinearSolver:
        """A linear solver for this problem, hierarchy included. Host only.

        Raises:
            ValueError: on an unknown method, or a lattice method without a lattice.
        """
        hierarchy: Any = None
        if method in ("spectral", "multigrid"):
            rest = self.rest()
            make = build_spectral if method == "spectral" else build_multigrid
            hierarchy = jax.device_put(make(rest, np.asarray(self.fixed)))
        elif method == "amg":
            K = first_tangent(self).to_bsr()
            hierarchy = build_hierarchy(K, np.asarray(self.X), np.asarray(self.fixed))
        return linear_solver(method, rtol, maxiter, hierarchy)

    def _check_separation(self) -> None:
        assert isinstance(self.family, GridFamily)
        if self.family.cut.shape[1] != self.spec.cuts:
            raise ValueError(
                f"family: it misses {self.family.cut.shape[1]} bonds and the problem "
                f"was made for {self.spec.cuts}; use problem.without(bonds)"
            )

    def without(self, bonds: Any) -> Problem:
        """This problem less some bonds, (point, slot) [2, b] of its family. Host only.

        The linear solver is kept; `solver` makes one that knows of the loss.

        Raises:
            ValueError: if the bonds are index lists, or a piece comes loose.
        """
        if not isinstance(self.family, GridFamily):
            raise ValueError("bonds: only families of a lattice lose bonds by slot yet")
        family = without(self.family, np.asarray(bonds))
        check_held(np.asarray(self.X), family, np.asarray(self.fixed))
        separation = separate(family, self.params, self.spec.correction)
        spec = dataclasses.replace(self.spec, **separation)
        return dataclasses.replace(self, family=family, spec=spec)

    def rest(self) -> LatticeTangent:
        """Stiffness of the undeformed lattice in NumPy arrays. Host only.

        Raises:
            ValueError: if the points are no lattice, or its bonds are index lists.
        """
        if not isinstance(self.family, GridFamily):
            raise ValueError(
                "solver: 'spectral' and 'multigrid' are for lattices with the operator "
                f"'stencil' or 'fft', not {self.spec.operator!r}; use 'amg'"
            )
        if self.spec.correction in DIRECTIONAL:
            raise ValueError(
                "solver: 'spectral' and 'multigrid' need bonds that are alike, and the "
                f"correction {self.spec.correction!r} makes each its own; use 'd-pcg', "
                "'amg' or 'direct', or correction='lattice'"
            )
        operator, _, _ = self.build(jax.tree.map(np.asarray, self.params))
        assert isinstance(operator, StencilForce)
        return jax.tree.map(np.asarray, operator.rest())


# compiled even where the caller is not: operation by operation each would be
@jax.jit
def solve_problem(problem: Any, params: Params) -> tuple[PointVector, NewtonInfo]:
    """Displacements in equilibrium of a problem, or of a stack of them."""
    operator, constraints, load = problem.force(params)
    newton, linear, u0 = problem.spec.newton, problem.linear, jnp.zeros_like(load)
    return equilibrium(newton, operator, constraints, load, linear, u0)


@jax.jit
def reaction_of(problem: Any, u: PointVector, params: Params) -> PointVector:
    """Forces of the supports of a problem, or of a stack of them."""
    operator, constraints, load = problem.force(params)
    return jnp.where(constraints.fixed, -(operator.respond(u) + load), 0.0)


@jax.jit
def energy_of(problem: Any, u: PointVector, params: Params) -> PointScalar:
    """Stored energy of the points of a problem, or of a stack of them."""
    operator, _, _ = problem.build(params)
    if not hasattr(operator.law, "energy"):
        return jnp.full(len(u), jnp.nan)
    return operator.energy_per_point(u)


@jax.jit
def first_tangent(problem: Any) -> Any:
    """Stiffness of the undeformed body."""
    return problem.stiffness()


@jax.jit
def first_system(problem: Problem) -> tuple[Any, Constraints, PointVector]:
    """Tangent, constraints and right-hand side of the first Newton iteration."""
    _, constraints, load = problem.build(problem.params)
    K = problem.stiffness()
    return K, constraints, constraints.project(load - K.mv(constraints.lift()))


def host_system(problem: Problem) -> tuple[FFTTangent, Constraints, Any]:
    """The same by convolution, on the host and without any compilation."""
    params = jax.tree.map(np.asarray, problem.params)
    fixed: Any = np.asarray(problem.fixed)
    constraints = Constraints(fixed, params["prescribed"])
    spec = problem.spec
    problem._check_separation()
    K = convolution(problem.rest(), spec.pivots, spec.patches)
    lift = np.where(constraints.fixed, constraints.values, 0.0)
    b = np.where(constraints.fixed, 0.0, params["load"] - K.mv(lift))
    return K, constraints, b
