"""A laminate made ready for `jit`: plies and interlayers as one problem of statics.

A `Stack` is to solvers, fits and gradient checks what a `Problem` is. Its parameters
are nested: those of each ply, of each interlayer, and what is common,

    plies         one dict a ply: E, delta, dx, alpha ..; see `Problem`
    interlayers   one `Interlayer` each: E, shear (Pa), [] or one a ghost
    prescribed, load   [n, d] (m, N), of all points
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.assembly import Params, Spec
from jaxpd.glue import Glue, glue_force
from jaxpd.laminate import Interlayer
from jaxpd.operators import Constraints
from jaxpd.operators.rest import LinearForce
from jaxpd.operators.sum import Sum, SumTangent
from jaxpd.problem import Problem, energy_of, first_tangent, reaction_of, solve_problem
from jaxpd.solvers.amg import build_hierarchy
from jaxpd.solvers.linear import LinearSolver, linear_solver
from jaxpd.solvers.newton import NewtonInfo

#: What a ply has, and the stack instead of it.
COMMON = ("prescribed", "load", "u0", "v0")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Stack:
    """A laminate made ready for `jit`.

    Attributes:
        params: defaults of everything that may be varied, see the module.
        plies: the problem of each ply.
        glue: ghosts and calibration of each interlayer, which is that of the defaults
            of the plies.
        fixed: mask of prescribed displacement components [n, d].
        X: reference positions [n, d] (m).
        linear: the linear solver.
        spec: how it is modelled and solved.
    """

    params: Params
    plies: tuple[Problem, ...]
    glue: tuple[Glue, ...]
    fixed: Any
    X: Any
    linear: LinearSolver
    spec: Spec = field(metadata={"static": True})

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of points of the plies."""
        return tuple(len(ply.X) for ply in self.plies)

    @property
    def vol(self) -> PointScalar:
        """Volumes [n] (m^d)."""
        return jnp.concatenate([jnp.asarray(ply.vol) for ply in self.plies])

    def _of_plies(self, params: Params) -> list[Params]:
        counts = [len(params.get(k, ())) for k in ("plies", "interlayers")]
        if set(params) != set(self.params) or counts != [
            len(self.plies),
            len(self.glue),
        ]:
            raise ValueError(
                f"params: {sorted(params)} must be {sorted(self.params)}, with a dict "
                "a ply and an Interlayer a gap"
            )
        return [
            dict(p) | {name: x for name, x in ply.params.items() if name in COMMON}
            for ply, p in zip(self.plies, params["plies"], strict=True)
        ]

    def _joints(self, params: Params) -> tuple[Any, ...]:
        pairs = zip(self.glue, params["interlayers"], strict=True)
        return tuple(glue_force(glue, layer) for glue, layer in pairs)

    def build(self, params: Params) -> tuple[Sum, Constraints, PointVector]:
        """Operator, constraints and external load (N) of the given parameters."""
        each = zip(self.plies, self._of_plies(params), strict=True)
        plies = tuple(ply.build(p)[0] for ply, p in each)
        constraints = Constraints(self.fixed, params["prescribed"])
        operator = Sum(plies, self._joints(params), self.sizes)
        return operator, constraints, params["load"]

    def force(self, params: Params) -> tuple[Any, Constraints, PointVector]:
        """`build`, with the operator that is solved: linear where strains are small."""
        operator, constraints, load = self.build(params)
        if self.spec.kinematics == "finite":
            return operator, constraints, load
        return LinearForce(self.stiffness(params)), constraints, load

    def stiffness(self, params: Params | None = None) -> SumTangent:
        """Stiffness of the undeformed body, a `Tangent`."""
        params = self.params if params is None else params
        each = zip(self.plies, self._of_plies(params), strict=True)
        joints = self._joints(params)
        return SumTangent(
            tuple(ply.stiffness(p) for ply, p in each),
            tuple(op.tangent(jnp.zeros(op.joint.X.shape)) for op in joints),
            self.sizes,
        )

    def solve(self, params: Params | None = None) -> tuple[PointVector, NewtonInfo]:
        """Displacements [n, d] (m) in equilibrium; see `Problem.solve`."""
        return solve_problem(self, self.params if params is None else params)

    def reaction(self, u: PointVector, params: Params | None = None) -> PointVector:
        """Forces of the supports on the body [n, d] (N). Pure."""
        return reaction_of(self, u, self.params if params is None else params)

    def energy(self, u: PointVector, params: Params | None = None) -> PointScalar:
        """Stored energy of each point [n] (J), interlayers' at their faces. Pure."""
        return energy_of(self, u, self.params if params is None else params)

    def traction(
        self, u: PointVector, params: Params | None = None
    ) -> tuple[jax.Array, ...]:
        """Traction that each interlayer passes on, at its ghosts [q, d] (Pa). Pure.

        Along the axis positive in tension; see `GhostForce.traction`.
        """
        params = self.params if params is None else params
        joints = self._joints(params)
        parts = [jnp.asarray(u)[op.joint.points] for op in joints]
        if self.spec.kinematics == "small":
            at = [jnp.zeros_like(part) for part in parts]
            each = zip(joints, at, parts, strict=True)
            found = [jax.jvp(op.traction, (x,), (du,))[1] for op, x, du in each]
        else:
            found = [op.traction(x) for op, x in zip(joints, parts, strict=True)]
        return tuple(t.T for t in found)

    def __repr__(self) -> str:
        """One line: plies, points, interlayers, solver."""
        sizes = " + ".join(map(str, self.sizes))
        layers = f"{len(self.glue)} interlayers"
        return f"Stack({sizes} points, {layers}, {self.spec.kinematics})"

    def solver(
        self, method: str, rtol: float = 1e-6, maxiter: int = 10_000
    ) -> LinearSolver:
        """A linear solver for this laminate, hierarchy included. Host only.

        Raises:
            ValueError: on a method for lattices, or one that an interlayer without
                reaction, whose stiffness is not symmetric, cannot have.
        """
        hierarchy: Any = None
        if method in ("spectral", "multigrid"):
            raise ValueError(
                f"solver: {method!r} is for one lattice, not for a laminate; use "
                "'d-pcg', 'amg' or 'direct'"
            )
        if method != "direct" and not self.spec.symmetric:
            raise ValueError(
                f"solver: {method!r} needs a symmetric stiffness, and one_way=True, or "
                "a law without an energy, has none; use 'direct'"
            )
        if method == "amg":
            K = first_tangent(self).to_bsr()
            hierarchy = build_hierarchy(K, np.asarray(self.X), np.asarray(self.fixed))
        return linear_solver(method, rtol, maxiter, hierarchy)


def stacked(
    plies: Sequence[Problem],
    glue: tuple[Glue, ...],
    layers: Sequence[Interlayer],
    conditions: tuple[Any, Any, Any],
) -> Stack:
    """A laminate of prepared plies; its linear solver is still that of the first.

    Args:
        plies: their problems.
        glue: what is between them.
        layers: the interlayers' moduli.
        conditions: mask of prescribed displacements, their values (m), loads (N).
    """
    fixed, prescribed, load = conditions
    params = {
        "plies": tuple(own(ply.params) for ply in plies),
        "interlayers": tuple(map(numbers, layers)),
        "prescribed": prescribed,
        "load": load,
    }
    symmetric = all(p.spec.symmetric for p in plies)
    symmetric &= not any(layer.one_way for layer in layers)
    bare: dict[str, Any] = {"cuts": 0, "pivots": (), "patches": ()}
    spec = dataclasses.replace(
        plies[0].spec, symmetric=symmetric, operator="stack", **bare
    )
    X = np.concatenate([np.asarray(ply.X) for ply in plies])
    return Stack(params, tuple(plies), glue, fixed, X, plies[0].linear, spec)


def own(params: Params) -> Params:
    """The parameters of a ply that are not the stack's."""
    return {name: x for name, x in params.items() if name not in COMMON}


def numbers(layer: Interlayer) -> Interlayer:
    """The same interlayer with numbers as arrays."""
    real = jax.dtypes.canonicalize_dtype(float)
    return jax.tree.map(lambda x: np.asarray(x, real), layer)
