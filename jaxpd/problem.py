"""A scene made ready for `jit`: host work once, then one pure function.

`prepare(scene)` builds what does not change (points, bonds, masks, hierarchy) into a
`Problem`, a pytree whose floating-point defaults are `problem.params`. `build` makes
operator, constraints and load of any such parameters; `Problem.solve` is what `jit`
sees. Index lists are leaves of the problem, so they enter a trace as arguments.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointVector
from jaxpd.body import check_held, cloud_of, loads_on, supports_on
from jaxpd.geometry import Family, find
from jaxpd.operators import BondForce, BondTangent, Constraints, bond_weights
from jaxpd.physics import Microelastic, bond_block, elastic, micromodulus
from jaxpd.scene import Elastic, Kernel, Scene
from jaxpd.solvers.amg import build_hierarchy
from jaxpd.solvers.linear import METHODS, LinearSolver
from jaxpd.solvers.newton import Newton, NewtonInfo, solve_linear, solve_newton

Params = dict[str, Any]
TANGENTS = ("ad", "hand", "axial")


@dataclass(frozen=True)
class Spec:
    """What of a problem is known when it is traced; hashable."""

    material: str
    nu: float | None
    state: str
    kernel: str
    correction: str
    tangent: str
    kinematics: str
    symmetric: bool
    linear: LinearSolver
    newton: Newton


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Problem:
    """A scene made ready for `jit`: index lists are leaves, numbers are parameters.

    Attributes:
        params: defaults of everything that may be varied or differentiated:
            X [n, d] (m), vol [n] (m^d), delta [] (m), prescribed [n, d] (m),
            load [n, d] (N), and E [] or [n] (Pa) with alpha, ratio or omega of the
            influence function; or `law`, the user's own.
        family: bonds, frozen.
        fixed: mask of prescribed displacement components [n, d].
        spec: how it is modelled and solved.
    """

    params: Params
    family: Family
    fixed: jax.Array
    spec: Spec = field(metadata={"static": True})

    def build(self, params: Params) -> tuple[BondForce, Constraints, PointVector]:
        """Operator, constraints and external load (N) of the given parameters."""
        spec, X = self.spec, params["X"]
        d, delta = X.shape[1], params["delta"]
        if spec.material == "law":
            law = params["law"]
        else:
            if spec.kernel == "own":
                omega = params["omega"]
            else:
                number = params.get("alpha", params.get("ratio", 0.0))
                omega = Kernel(spec.kernel, number).influence(d, delta)
            c = micromodulus(params["E"], spec.nu, spec.state, d, delta, omega)
            law = Microelastic(c, omega)
        weight = bond_weights(X, params["vol"], self.family, delta, spec.correction)
        operator = BondForce(
            X, self.family.nbr, weight, law, delta, spec.tangent, spec.symmetric
        )
        return operator, Constraints(self.fixed, params["prescribed"]), params["load"]

    def solve(self, params: Params | None = None) -> tuple[PointVector, NewtonInfo]:
        """Displacements [n, d] (m) in equilibrium, and how the solve went. Pure."""
        params = self.params if params is None else params
        operator, constraints, load = self.build(params)
        method = solve_newton if self.spec.kinematics == "finite" else solve_linear
        u0 = jnp.zeros_like(load)
        return method(
            operator, constraints, load, u0, self.spec.linear, self.spec.newton
        )

    def solver(self, method: str, rtol: float = 1e-6) -> LinearSolver:
        """A linear solver for this problem, hierarchy included. Host only."""
        if method != "amg":
            return LinearSolver(method, rtol)
        K, fixed = first_tangent(self), np.asarray(self.fixed)
        hierarchy = build_hierarchy(K.to_bsr(), np.asarray(self.params["X"]), fixed)
        return LinearSolver(method, rtol, hierarchy=hierarchy)


@jax.jit
def first_tangent(problem: Problem) -> BondTangent:
    """Stiffness of the undeformed body."""
    operator, _, load = problem.build(problem.params)
    return operator.tangent(jnp.zeros_like(load))


@jax.jit
def first_system(
    problem: Problem,
) -> tuple[BondTangent, Constraints, PointVector]:
    """Tangent, constraints and right-hand side of the first Newton iteration."""
    operator, constraints, load = problem.build(problem.params)
    K = operator.tangent(jnp.zeros_like(load))
    return K, constraints, constraints.project(load - K.mv(constraints.lift()))


def prepare(
    scene: Scene,
    *,
    solver: str = "d-pcg",
    tangent: str = "ad",
    rtol: float = 1e-6,
    linear_rtol: float | None = None,
    load_steps: int = 1,
    max_iterations: int = 20,
    linear_maxiter: int = 10_000,
) -> Problem:
    """Do the host work of a scene once. Everything after this is traced.

    Args:
        scene: what to solve.
        solver: linear solver, one of `jaxpd.solvers.linear.METHODS`.
        tangent: "ad" by `jax.jacfwd` of the bond force; "hand", the law's own
            derivation, the same numbers; "axial", its axial part alone.
        rtol: relative tolerance of the residual, Newton's and the solution's.
        linear_rtol: that of each linear solve; `rtol` by default.
        load_steps: load steps to begin with.
        max_iterations: Newton iterations of a load step before it is halved.
        linear_maxiter: most Krylov iterations of a linear solve.

    Raises:
        ValueError: naming the argument, its value and the cure: a Poisson's ratio out
            of reach, points without bonds, rigid-body motion left free, an unknown
            word, a tolerance that float32 cannot reach.
    """
    _check_words(solver, tangent, rtol, load_steps)
    for name, number in (
        ("max_iterations", max_iterations),
        ("linear_maxiter", linear_maxiter),
        ("linear_rtol", 1 if linear_rtol is None else linear_rtol),
    ):
        if not number > 0:
            raise ValueError(f"{name}: {number} must be positive")
    cloud = cloud_of(scene)
    if cloud.X.dtype == jnp.float32 and rtol < 1e-3:
        raise ValueError(
            f"rtol: {rtol} is out of reach of the body's float32 positions; make the "
            "cloud after jax.config.update('jax_enable_x64', True)"
        )
    X, vol = np.asarray(cloud.X), np.asarray(cloud.vol)
    delta, resolution = scene.resolution.horizon, scene.resolution
    if cloud.lattice is not None and scene.d > 1 and delta < 1.4 * cloud.lattice.dx:
        raise ValueError(
            f"m: {delta / cloud.lattice.dx:g} bonds no diagonal neighbours, and such a "
            "lattice resists no shear; use m of at least 1.5, 3 to 8 is common"
        )
    family = find(cloud, delta, partial=resolution.partial, cracks=scene.cracks)
    fixed, values = supports_on(scene, X)
    check_held(X, np.asarray(family.nbr), fixed)
    params: Params = {
        "X": cloud.X,
        "vol": cloud.vol,
        "delta": jnp.asarray(delta),
        "prescribed": jnp.asarray(values),
        "load": jnp.asarray(loads_on(scene, X, vol, fixed)),
    }
    correction = resolution.correction
    if correction is None:
        correction = "lattice" if cloud.lattice is not None else "analytic"
    if correction not in ("none", "lattice", "analytic"):
        raise ValueError(
            f"correction: {correction!r} must be 'none', 'lattice' or 'analytic'"
        )
    material = scene.material
    if isinstance(material, Elastic):
        if elastic.DIMENSIONS[material.state] != scene.d:
            raise ValueError(
                f"state: {material.state!r} is {elastic.DIMENSIONS[material.state]}-D "
                f"and the body is {scene.d}-D; see jaxpd.physics.elastic"
            )
        elastic.check_bond_based(material.nu, material.state)
        params |= _elastic_params(material, resolution.kernel)
        model = ("elastic", material.nu, material.state)
    else:
        if not (hasattr(material, "energy") or hasattr(material, "force")):
            raise ValueError(
                f"material: {material!r} must be Elastic, or a law with a method "
                "energy(xi, eta) or force(xi, eta); see jaxpd.physics.bond"
            )
        params["law"] = _floats("material", material)
        model = ("law", None, "")
    kernel = resolution.kernel
    spec = Spec(
        *model,
        kernel=kernel.name if isinstance(kernel, Kernel) else "own",
        correction=correction,
        tangent=tangent,
        kinematics=scene.kinematics,
        symmetric=_is_symmetric(params.get("law"), scene.d),
        linear=LinearSolver("d-pcg", linear_rtol or rtol, linear_maxiter),
        newton=Newton(
            rtol,
            max_iterations,
            load_steps,
            max_total=max(200, load_steps * max_iterations),
        ),
    )
    problem = Problem(params, family, jnp.asarray(fixed), spec)
    _check_stiff(problem)
    linear = problem.solver(solver, linear_rtol or rtol)
    linear = LinearSolver(solver, linear.rtol, linear_maxiter, linear.hierarchy)
    spec = Spec(**{**vars(spec), "linear": linear})
    return Problem(params, family, problem.fixed, spec)


def _check_words(solver: str, tangent: str, rtol: float, load_steps: int) -> None:
    if solver not in METHODS:
        raise ValueError(f"solver: {solver!r} must be one of {METHODS}")
    if tangent not in TANGENTS:
        raise ValueError(f"tangent: {tangent!r} must be one of {TANGENTS}")
    if not 0 < rtol < 1:
        raise ValueError(f"rtol: {rtol} must lie between 0 and 1; 1e-6 is common")
    if load_steps < 1:
        raise ValueError(f"load_steps: {load_steps} must be at least 1")
    if jnp.zeros(()).dtype != jnp.float64 and rtol < 1e-3:
        raise ValueError(
            f"rtol: {rtol} is out of reach of float32; put this line before any array "
            "is made: jax.config.update('jax_enable_x64', True)"
        )


def _floats(name: str, tree: Any) -> Any:
    try:
        return jax.tree.map(lambda x: jnp.asarray(x, float), tree)
    except TypeError as error:
        raise ValueError(
            f"{name}: {tree!r} must be Elastic, a Kernel or a frozen dataclass of "
            "numbers registered with jax.tree_util.register_dataclass"
        ) from error


def _is_symmetric(law: Any, d: int) -> bool:
    """Whether tangent blocks are symmetric: by energy, or looked at on random bonds."""
    if law is None or hasattr(law, "energy"):
        return True
    one = jax.tree.map(lambda x: jnp.ravel(x)[0], law)
    xi, eta = np.random.default_rng(0).normal(size=(2, 8, d))
    B = np.asarray(jax.vmap(lambda x, e: bond_block(one, x, 0.01 * e))(xi, eta))
    return bool(np.abs(B - B.transpose(0, 2, 1)).max() <= 1e-8 * np.abs(B).max())


@jax.jit
def _first_diagonal(problem: Problem) -> jax.Array:
    return first_tangent(problem).diagonal()


def _check_stiff(problem: Problem) -> None:
    """Refuse a kernel or law without positive stiffness in the undeformed body."""
    blocks = np.asarray(_first_diagonal(problem))
    trace = np.trace(blocks, axis1=1, axis2=2)
    if not (np.isfinite(trace) & (trace > 0)).all():
        bad = int(np.argmin(np.isfinite(trace) & (trace > 0)))
        raise ValueError(
            f"kernel: the undeformed body has no positive stiffness at point {bad} "
            f"(trace of its block {trace[bad]:.3g}); check the influence function's "
            "moment, the law, and that bonds inside the horizon have weight"
        )


def _elastic_params(material: Elastic, kernel: Any) -> Params:
    params: Params = {"E": jnp.asarray(material.E, float)}
    if not isinstance(kernel, Kernel):
        params["omega"] = _floats("kernel", kernel)
    elif kernel.name == "fractional":
        params["alpha"] = jnp.asarray(kernel.parameter, float)
    elif kernel.name == "gaussian":
        params["ratio"] = jnp.asarray(kernel.parameter, float)
    return params
