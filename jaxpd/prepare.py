"""Preparing a scene: everything that is done once, on the host.

Points, bonds, supports, loads, checks with their cures, operator and linear solver.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.body import (
    check_held,
    cloud_of,
    free_faces,
    loads_on,
    still,
    supports_on,
)
from jaxpd.checks import instance, number, whole, word
from jaxpd.discretize import beyond_faces
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.geometry import Cloud, GridFamily, find, find_on_grid
from jaxpd.geometry.grid_family import offset_sums
from jaxpd.glue import glue_of
from jaxpd.laminate import Laminate
from jaxpd.model import (
    check_given,
    check_whole,
    correction_of,
    is_symmetric,
    model_of,
    stiffening_of,
)
from jaxpd.nodes import nodal_problem
from jaxpd.operators.lattice import index_pairs
from jaxpd.operators.patches import share
from jaxpd.plies import check_stack, ply_scenes
from jaxpd.problem import OPERATORS, Params, Problem, Spec, first_tangent, separate
from jaxpd.resolution import MLS, NODES, Kernel
from jaxpd.scene import Scene
from jaxpd.solvers.choice import cheapest
from jaxpd.solvers.linear import LinearSolver, methods
from jaxpd.solvers.newton import Newton
from jaxpd.stack import Stack, stacked
from jaxpd.weak_nodes import galerkin_problem

#: Tangents of bonds, and of laws of nodes.
TANGENTS = (("ad", "hand", "axial"), ("ad", "hand", "continuum"))


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
) -> Any:
    """Do the host work of a scene once; everything after this is traced.

    Args:
        scene: what to solve.
        solver: linear solver, one of `jaxpd.solvers.linear.methods()`, or "auto", the
            one that `jaxpd.solvers.choice` expects to be ready first.
        operator: "gather" by index lists, for any points; on lattices also "stencil" by
            shifted slices and, for small displacements, "fft" by convolution. "auto"
            takes the last of them that will do.
        tangent: "ad" by `jax.jacfwd` of the bond force; "hand", the law's own
            derivation, the same numbers; "axial", its axial part alone; of a law of
            nodes also "continuum", that of infinitely small steps.
        rtol: relative tolerance of the residual, Newton's and the solution's.
        linear_rtol: that of each linear solve; `rtol` by default.
        load_steps: load steps to begin with.
        max_iterations: Newton iterations of a load step before it is halved.
        linear_maxiter: most Krylov iterations of a linear solve.

    Returns:
        A `Problem`; of a laminate a `Stack`, whose parameters are nested; of nodes a
        `NodalProblem` or `GalerkinProblem`. They have the same methods, as far as they
        make sense.

    Raises:
        ValueError: naming the argument, its value and the cure: a Poisson's ratio out
            of reach, points without bonds, rigid-body motion left free, an unknown
            word, a tolerance that float32 cannot reach.
    """
    instance("scene", scene, Scene, "a Scene(..)")
    known = TANGENTS[isinstance(scene.resolution, NODES)]
    _check_words(solver, operator, (tangent, known), rtol, linear_rtol)
    load_steps = whole("load_steps", load_steps)
    max_iterations = whole("max_iterations", max_iterations)
    linear_maxiter = whole("linear_maxiter", linear_maxiter)
    if isinstance(scene.resolution, NODES):
        if operator != "auto":
            raise ValueError(f"operator: {operator!r} is for bonds; leave it out here")
        settings = _newton(rtol, max_iterations, load_steps)
        limits = (linear_rtol or rtol, linear_maxiter)
        make = nodal_problem if isinstance(scene.resolution, MLS) else galerkin_problem
        return make(scene, solver, tangent, settings, limits)
    check_whole(scene)
    if isinstance(scene.body, Laminate):
        newton = (rtol, max_iterations, load_steps)
        stack = _stack(scene, operator, tangent, newton)
        solver = solver if solver != "auto" else _solver(stack)
        linear = stack.solver(solver, linear_rtol or rtol, linear_maxiter)
        return dataclasses.replace(stack, linear=linear)
    problem = _body(scene, operator, tangent, (rtol, max_iterations, load_steps))
    _check_stiff(problem)
    solver = _solver(problem) if solver == "auto" else solver
    linear = problem.solver(solver, linear_rtol or rtol, linear_maxiter)
    return dataclasses.replace(problem, linear=linear)


def _body(
    scene: Scene,
    operator: str,
    tangent: str,
    newton: tuple[float, int, int],
    held: bool = True,
) -> Problem:
    """The problem of one body, checked to be held or not; without a linear solver."""
    rtol = newton[0]
    cloud = cloud_of(scene)
    if cloud.X.dtype == jnp.float32 and rtol < 1e-3:
        raise ValueError(
            f"rtol: {rtol} is out of reach of the body's float32 positions; make the "
            "cloud after jax.config.update('jax_enable_x64', True)"
        )
    X, vol = np.asarray(cloud.X), np.asarray(cloud.vol)
    delta, resolution = scene.resolution.horizon, scene.resolution
    check_given(scene, X)
    if cloud.lattice is not None and scene.d > 1 and delta < 1.4 * cloud.lattice.dx:
        raise ValueError(
            f"m: {delta / cloud.lattice.dx:g} bonds no diagonal neighbours, and such a "
            "lattice resists no shear; use m of at least 1.5, 3 to 8 is common"
        )
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
    symmetric = is_symmetric(params.get("law"), scene.d)
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
    if held:
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
        newton=_newton(*newton),
        operator=operator,
        stiffening=stiffening_of(scene, cloud),
        **separation,
    )
    return Problem(params, family, fixed, X, LinearSolver(), spec, extension)


def _newton(rtol: float, max_iterations: int, load_steps: int) -> Newton:
    total = max(200, load_steps * max_iterations)
    return Newton(rtol, max_iterations, load_steps, max_total=total)


def _stack(
    scene: Scene, operator: str, tangent: str, newton: tuple[float, int, int]
) -> Stack:
    """The problem of a laminate; without a linear solver."""
    plies = [
        _body(ply, operator, tangent, newton, held=False) for ply in ply_scenes(scene)
    ]
    X, vol = (
        np.concatenate([np.asarray(getattr(p, name)) for p in plies])
        for name in ("X", "vol")
    )
    fixed, moved, times = supports_on(scene, X)
    pulled, courses = loads_on(scene, X, vol, fixed)
    prescribed, load = still(moved, times, "supports"), still(pulled, courses, "loads")
    glue = glue_of(scene, plies)
    check_stack(X, plies, [joint for joint, _ in glue], fixed)
    for ply in plies:
        _check_stiff(ply)
    body: Any = scene.body
    conditions = (fixed, prescribed.astype(X.dtype), load.astype(X.dtype))
    return stacked(plies, glue, body.layers, conditions)


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


def _solver(problem: Problem | Stack) -> str:
    """The linear solver that is ready first."""
    if isinstance(problem, Stack):
        return "d-pcg" if problem.spec.symmetric else "direct"
    each = problem.spec.correction in DIRECTIONAL
    if each or not isinstance(problem.family, GridFamily):
        return "d-pcg" if problem.spec.symmetric else "direct"
    finite = problem.spec.kinematics == "finite"
    later = max(0, len(problem.spec.pivots) - 1)
    terms = round(1 + later * share(problem.family, problem.spec.patches))
    return cheapest(problem.rest(), problem.fixed, 3 if finite else 1, terms)


def _check_words(
    solver: str,
    operator: str,
    tangent: tuple[str, tuple[str, ...]],
    rtol: float,
    linear_rtol: float | None,
) -> None:
    word("solver", solver, ("auto", *methods()))
    word("operator", operator, ("auto", *OPERATORS))
    word("tangent", *tangent)
    number("rtol", rtol, above=0, below=1, cure="1e-6 is common")
    if linear_rtol is not None:
        number("linear_rtol", linear_rtol, above=0, below=1, cure="None is rtol")
    if jax.dtypes.canonicalize_dtype(float) != np.float64 and rtol < 1e-3:
        raise ValueError(
            f"rtol: {rtol} is out of reach of float32; put this line before any array "
            "is made: jax.config.update('jax_enable_x64', True)"
        )


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
