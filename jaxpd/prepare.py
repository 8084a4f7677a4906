"""Preparing a scene: everything that is done once, on the host.

Points, bonds, supports and loads, the checks with their cures, the operator and the
linear solver. What comes out is a `Problem`; everything after this may be traced.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.body import (
    check_correction,
    check_held,
    cloud_of,
    free_faces,
    loads_on,
    still,
    supports_on,
)
from jaxpd.discretize import beyond_faces
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.geometry import Cloud, GridFamily, find, find_on_grid
from jaxpd.geometry.grid_family import offset_sums
from jaxpd.operators.lattice import index_pairs
from jaxpd.operators.patches import share
from jaxpd.physics import bond_block, elastic
from jaxpd.problem import (
    OPERATORS,
    Params,
    Problem,
    Spec,
    first_tangent,
    separate,
)
from jaxpd.scene import Elastic, Kernel, Scene, Solid
from jaxpd.solvers.choice import cheapest
from jaxpd.solvers.linear import METHODS, LinearSolver
from jaxpd.solvers.newton import Newton

TANGENTS = ("ad", "hand", "axial")


def prepare(
    scene: Scene,
    *,
    solver: str = "auto",
    operator: str = "auto",
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
        solver: linear solver, one of `jaxpd.solvers.linear.METHODS`, or "auto", the one
            that `jaxpd.solvers.choice` expects to be ready first.
        operator: "gather" by index lists, for any points; on lattices also "stencil" by
            shifted slices and, for small displacements, "fft" by convolution. "auto"
            takes the last of them that will do.
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
    _check_words(solver, operator, tangent, rtol, load_steps)
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
    if scene.starts or scene.no_fail:
        raise ValueError("starts, no_fail: are for run_explicit, not for statics")
    fixed, moved, times = supports_on(scene, X)
    pulled, courses = loads_on(scene, X, vol, fixed)
    params: Params = {
        "delta": np.asarray(delta, X.dtype),
        "prescribed": still(moved, times, "supports").astype(X.dtype),
        "load": still(pulled, courses, "loads").astype(X.dtype),
    }
    correction = correction_of(scene, cloud, operator)
    model, more = model_of(scene)
    if hasattr(more.get("law"), "advance"):
        raise ValueError(
            "material: a law with a memory is for motion; see run_explicit"
        )
    params |= more
    kernel = resolution.kernel
    symmetric = _is_symmetric(params.get("law"), scene.d)
    if correction == "fictitious":
        operator = "gather"
    elif correction in DIRECTIONAL and operator == "auto" and cloud.regular:
        operator = "stencil"
    operator = _operator(operator, scene, cloud, params.get("law"), symmetric)
    how: dict[str, Any] = {"partial": resolution.partial, "cracks": scene.cracks}
    if operator == "gather":
        family = find(cloud, delta, **how)
        params |= {"X": cloud.X, "vol": cloud.vol}
    else:
        assert cloud.lattice is not None
        family = find_on_grid(cloud, delta, **how)
        params["dx"] = np.asarray(cloud.lattice.dx, X.dtype)
    check_held(X, family, fixed)
    extension = None
    if correction == "fictitious":
        family, extension = beyond_faces(cloud, delta, free=free_faces(scene), **how)
    separation = {}
    if isinstance(family, GridFamily):
        separation = separate(family, params, correction)
    spec = Spec(
        *model,
        kernel=kernel.name if isinstance(kernel, Kernel) else "own",
        correction=correction,
        tangent=tangent,
        kinematics=scene.kinematics,
        symmetric=symmetric,
        newton=Newton(
            rtol,
            max_iterations,
            load_steps,
            max_total=max(200, load_steps * max_iterations),
        ),
        operator=operator,
        **separation,
    )
    problem = Problem(params, family, fixed, X, LinearSolver(), spec, extension)
    _check_stiff(problem)
    if solver == "auto":
        solver = _solver(problem)
    linear = problem.solver(solver, linear_rtol or rtol, linear_maxiter)
    return dataclasses.replace(problem, linear=linear)


def correction_of(scene: Scene, cloud: Cloud, operator: str = "auto") -> str:
    """The surface correction asked for, or the default; checked."""
    correction = scene.resolution.correction
    if correction is None:
        correction = "lattice" if cloud.lattice is not None else "analytic"
    check_correction(correction, scene, cloud, operator)
    return correction


def model_of(scene: Scene) -> tuple[tuple[str, float | None, str], Params]:
    """What the bonds are: "elastic" or "law" with nu and state, and their numbers."""
    material = scene.material
    if isinstance(material, Elastic):
        if elastic.DIMENSIONS[material.state] != scene.d:
            raise ValueError(
                f"state: {material.state!r} is {elastic.DIMENSIONS[material.state]}-D "
                f"and the body is {scene.d}-D; see jaxpd.physics.elastic"
            )
        elastic.check_bond_based(material.nu, material.state)
        kernel = scene.resolution.kernel
        model = ("elastic", material.nu, material.state)
        return model, _elastic_params(material, kernel)
    law = material.law if isinstance(material, Solid) else material
    inside = getattr(law, "law", law) if hasattr(law, "advance") else law
    if not (hasattr(inside, "energy") or hasattr(inside, "force")):
        raise ValueError(
            f"material: {material!r} must be Elastic, or a law with a method "
            "energy(xi, eta) or force(xi, eta); see jaxpd.physics.bond"
        )
    return ("law", None, ""), {"law": _floats("material", law)}


def _operator(asked: str, scene: Scene, cloud: Cloud, law: Any, symmetric: bool) -> str:
    """The operator asked for, or the fastest that will do."""
    shared = all(np.ndim(leaf) == 0 for leaf in jax.tree.leaves(law)) and symmetric
    if asked == "auto":
        if not (shared and cloud.regular):
            return "gather"
        return "fft" if scene.kinematics == "small" else "stencil"
    if asked != "gather" and not cloud.regular:
        raise ValueError(
            f"operator: {asked!r} needs a lattice of even spacing and volumes; use "
            "'gather'"
        )
    if asked != "gather" and not shared:
        raise ValueError(
            f"operator: {asked!r} is for laws with shared numbers and an energy; use "
            "'gather'"
        )
    if asked == "fft" and scene.kinematics == "finite":
        raise ValueError(
            "operator: 'fft' is for kinematics='small'; use 'stencil' or 'gather'"
        )
    return asked


def _solver(problem: Problem) -> str:
    """The linear solver that is ready first."""
    each = problem.spec.correction in DIRECTIONAL
    if each or not isinstance(problem.family, GridFamily):
        return "d-pcg" if problem.spec.symmetric else "direct"
    finite = problem.spec.kinematics == "finite"
    later = max(0, len(problem.spec.pivots) - 1)
    terms = round(1 + later * share(problem.family, problem.spec.patches))
    return cheapest(problem.rest(), problem.fixed, 3 if finite else 1, terms)


def _check_words(
    solver: str, operator: str, tangent: str, rtol: float, load_steps: int
) -> None:
    for name, word, known in (
        ("solver", solver, METHODS),
        ("operator", operator, OPERATORS),
    ):
        if word not in ("auto", *known):
            raise ValueError(f"{name}: {word!r} must be 'auto' or one of {known}")
    if tangent not in TANGENTS:
        raise ValueError(f"tangent: {tangent!r} must be one of {TANGENTS}")
    if not 0 < rtol < 1:
        raise ValueError(f"rtol: {rtol} must lie between 0 and 1; 1e-6 is common")
    if load_steps < 1:
        raise ValueError(f"load_steps: {load_steps} must be at least 1")
    if jax.dtypes.canonicalize_dtype(float) != np.float64 and rtol < 1e-3:
        raise ValueError(
            f"rtol: {rtol} is out of reach of float32; put this line before any array "
            "is made: jax.config.update('jax_enable_x64', True)"
        )


def _floats(name: str, tree: Any) -> Any:
    real = jax.dtypes.canonicalize_dtype(float)
    try:
        return jax.tree.map(lambda x: np.asarray(x, real), tree)
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
    each = problem.spec.correction in DIRECTIONAL
    if isinstance(problem.family, GridFamily) and not each:
        rest = problem.rest()
        own = [q for q, (a, b) in enumerate(index_pairs(rest.d)) if a == b]
        trace = offset_sums(rest.family, rest.parts[:, own].sum(axis=1)).ravel()
    else:
        trace = np.trace(np.asarray(_first_diagonal(problem)), axis1=1, axis2=2)
    if not (np.isfinite(trace) & (trace > 0)).all():
        bad = int(np.argmin(np.isfinite(trace) & (trace > 0)))
        raise ValueError(
            f"kernel: the undeformed body has no positive stiffness at point {bad} "
            f"(trace of its block {trace[bad]:.3g}); check the influence function's "
            "moment, the law, and that bonds inside the horizon have weight"
        )


def _elastic_params(material: Elastic, kernel: Any) -> Params:
    params: Params = {"E": _floats("E", material.E)}
    if not isinstance(kernel, Kernel):
        params["omega"] = _floats("kernel", kernel)
    elif kernel.name == "fractional":
        params["alpha"] = _floats("kernel", kernel.parameter)
    elif kernel.name == "gaussian":
        params["ratio"] = _floats("kernel", kernel.parameter)
    return params
