"""Preparing a scene to move: everything that is done once, on the host."""

from __future__ import annotations

import inspect
from typing import Any

import jax
import numpy as np

from jaxpd.body import (
    check_bonds,
    cloud_of,
    free_faces,
    loads_on,
    starts_on,
    supports_on,
)
from jaxpd.checks import instance, number, option, word
from jaxpd.course import Course
from jaxpd.cuts import cut_bonds, memory_of, unbreakable
from jaxpd.discretize import beyond_faces
from jaxpd.discretize.extension import check_cracks
from jaxpd.geometry import find, find_on_grid
from jaxpd.glue import glue_of
from jaxpd.laminate import Laminate
from jaxpd.model import check_given, correction_of, model_of, stiffening_of
from jaxpd.motion import Motion
from jaxpd.operators.ghosts import start
from jaxpd.operators.pulled_motion import PulledMotion
from jaxpd.operators.slots import curve
from jaxpd.operators.sum_motion import SumMotion
from jaxpd.physics.damage import Brittle, Softening
from jaxpd.plies import ply_scenes
from jaxpd.problem import Problem, Spec
from jaxpd.resolution import Kernel
from jaxpd.scene import Elastic, Scene
from jaxpd.solvers.explicit import largest_dt, stable_dt
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton
from jaxpd.stack import own, stacked

DTYPES = ("float32", "float64")
KINDS = ("halves", "slots", "memory")


def check_moves(scene: Scene) -> None:
    """Refuse a scene of nodes, or with surfaces that only slow fracture knows.

    Raises:
        ValueError: naming the argument and its door.
    """
    check_bonds(scene, "motion")
    if scene.weak:
        raise ValueError("weak: is for solve_fracture; say no_fail here")


def prepare_motion(
    scene: Scene,
    *,
    operator: str = "auto",
    dtype: str | None = None,
    softening: float | None = None,
) -> Motion:
    """Do the host work of a moving scene once. Everything after this is traced.

    Bonds that cracks cut are broken from the start; surface corrections are those of
    the body before, so that the faces of old and new cracks are alike.

    Args:
        scene: what moves. Its material needs a density: `Elastic(.., rho=..)` or
            `Solid(law, rho)`.
        operator: "halves" for elastic bonds on a lattice, "slots" for those of any
            points, "memory" for any law; "auto" takes the first of them that will do.
        dtype: "float32" or "float64"; the default is that of JAX's arrays.
        softening: width of the smoothed law over the critical stretch (-), 0 to 1, for
            derivatives in G0; None breaks bonds at once.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    instance("scene", scene, Scene, "a Scene(..)")
    word("operator", operator, ("auto", *KINDS))
    check_moves(scene)
    real = jax.dtypes.canonicalize_dtype(float).name
    dtype = real if dtype is None else dtype
    word("dtype", dtype, DTYPES)
    if dtype == "float64" and real != dtype:
        raise ValueError(
            f"dtype: {dtype!r} needs 64 bits: "
            "jax.config.update('jax_enable_x64', True) before any array is made"
        )
    if softening is not None:
        number("softening", softening, above=0, below=1, cure="or None")
    if isinstance(scene.body, Laminate):
        return _laminated(scene, operator, dtype, softening)
    material, resolution = scene.material, scene.resolution
    rho = getattr(material, "rho", None)
    if rho is None:
        raise ValueError(
            "material: motion needs a density: Elastic(.., rho=2440.0), or "
            "Solid(law, rho) around a law"
        )
    elastic = isinstance(material, Elastic)
    breaks = elastic and material.G0 is not None
    if softening is not None and not breaks:
        raise ValueError("softening: is for Elastic with a fracture energy G0")
    cloud = cloud_of(scene)
    X, vol, delta = np.asarray(cloud.X), np.asarray(cloud.vol), resolution.horizon
    check_given(scene, X)
    model, params = model_of(scene)
    if not elastic and not hasattr(params["law"], "advance"):
        s_crit = np.where(unbreakable(scene, X), np.inf, material.s_crit)
        s_crit = s_crit if scene.no_fail else np.asarray(material.s_crit)
        params["law"] = Brittle(params["law"], s_crit.astype(X.dtype))
    elif not elastic and scene.no_fail:
        raise ValueError(
            "no_fail: a law with a memory of its own says what fails; give it nodal "
            "numbers [n], of which a bond takes the mean of its ends"
        )
    elif not elastic and np.isfinite(material.s_crit):
        raise ValueError(
            f"s_crit: {material.s_crit} is for laws without memory; leave it out"
        )
    correction = correction_of(scene, cloud)
    beyond = correction == "fictitious"
    kind = _kind(operator, cloud.regular and not beyond, elastic, softening)
    fixed, moved, moves = supports_on(scene, X)
    pulled, loads = loads_on(scene, X, vol, fixed)
    u0, v0 = starts_on(scene, X)
    names: dict[str, Any] = {"delta": np.asarray(delta, X.dtype)}
    search: dict[str, Any] = {"partial": resolution.partial}
    if kind == "halves":
        assert cloud.lattice is not None
        family: Any = find_on_grid(cloud, delta, **search)
        names["dx"] = np.asarray(cloud.lattice.dx, X.dtype)
    else:
        family = find(cloud, delta, **search)
        names |= {"X": cloud.X, "vol": cloud.vol}
    points, extension = X, None
    if beyond:
        free = free_faces(scene)
        family, extension = beyond_faces(cloud, delta, free=free, **search)
        grid: Any = cloud.lattice
        check_cracks(grid, delta, scene.cracks, np.asarray(free, bool))
        points = np.asarray(extension(cloud.X))
    kernel = resolution.kernel
    spec = Spec(
        *model,
        kernel=kernel.name if isinstance(kernel, Kernel) else "own",
        correction=correction,
        tangent="ad",
        kinematics="finite",
        symmetric=True,
        newton=Newton(),
        operator="stencil" if kind == "halves" else "gather",
        stiffening=stiffening_of(scene, cloud),
    )
    known = params | names
    problem = Problem(known, family, fixed, X, LinearSolver(), spec, extension)
    params |= {
        "rho": np.asarray(rho, X.dtype),
        "u0": u0.astype(X.dtype),
        "v0": v0.astype(X.dtype),
        "load": pulled.astype(X.dtype),
        "prescribed": moved.astype(X.dtype),
    }
    if breaks:
        params["G0"] = np.asarray(material.G0, X.dtype)
    no_fail = None
    if scene.no_fail and breaks:
        no_fail = unbreakable(scene, X)
    order = curve(points) if kind == "slots" else None
    course = Course(kind, breaks, softening, loads, moves, dtype)
    cut = cut_bonds(scene, cloud, points, family, delta)
    law = params.get("law", Softening if softening is not None else Brittle)
    begin, untouched = (
        memory_of(family, x, order, kind, law.start, dtype, cut is None and not breaks)
        for x in (cut, None)
    )
    return Motion(problem, params, fixed, begin, untouched, vol, no_fail, order, course)


def _laminated(
    scene: Scene, operator: str, dtype: str, softening: float | None
) -> Motion:
    """The motion of a laminate: those of its plies, and what is common."""
    soft = [getattr(ply.material, "G0", None) for ply in ply_scenes(scene)]
    if softening is not None and not any(soft):
        raise ValueError(
            "softening: is for plies of Elastic with a fracture energy G0; interlayers "
            "break at once"
        )
    plies = tuple(
        prepare_motion(
            ply,
            operator=operator,
            dtype=dtype,
            softening=softening if getattr(ply.material, "G0", None) else None,
        )
        for ply in ply_scenes(scene)
    )
    problems = [ply.problem for ply in plies]
    X, vol = (
        np.concatenate([np.asarray(getattr(p, name)) for p in plies])
        for name in ("X", "vol")
    )
    fixed, moved, moves = supports_on(scene, X)
    pulled, loads = loads_on(scene, X, vol, fixed)
    u0, v0 = (x.astype(X.dtype) for x in starts_on(scene, X))
    body: Any = scene.body
    glue = glue_of(scene, problems)
    conditions = (fixed, moved.astype(X.dtype), pulled.astype(X.dtype))
    stack = stacked(problems, glue, body.layers, conditions)
    strong = unbreakable(scene, X)
    no_fail = tuple(
        strong[joint.points[joint.sources]].any(axis=1) if scene.no_fail else None
        for joint, _ in glue
    )
    joints, whole = (
        [jax.device_put(start(joint, cut).astype(dtype)) for joint, _ in glue]
        for cut in (True, False)
    )
    course = Course(
        kind="stack",
        breaks=any(ply.course.breaks for ply in plies),
        softening=softening,
        loads=loads,
        moves=moves,
        dtype=dtype,
    )
    own_params = tuple(own(ply.params) for ply in plies)
    return Motion(
        problem=stack,
        params=stack.params | {"plies": own_params, "u0": u0, "v0": v0},
        fixed=fixed,
        begin=(*(ply.begin for ply in plies), *joints),
        untouched=(*(ply.untouched for ply in plies), *whole),
        vol=vol,
        no_fail=no_fail,
        order=None,
        course=course,
        plies=plies,
    )


def prepared(scene: Scene | Motion, options: dict[str, Any]) -> Motion:
    """The motion of a scene, or the one given, which takes no options any more."""
    instance("scene", scene, Scene | Motion, "a Scene(..), or of prepare_motion")
    known = list(inspect.signature(prepare_motion).parameters)[1:]
    for name in options:
        option(name, known, "a motion, beyond those of run_explicit")
    if not isinstance(scene, Motion):
        return prepare_motion(scene, **options)
    if options:
        raise ValueError(f"{', '.join(options)}: are for prepare_motion, done already")
    return scene


def _kind(asked: str, regular: bool, elastic: bool, softening: float | None) -> str:
    plain = elastic and softening is None
    able: dict[str, bool] = dict(
        zip(KINDS, (plain and regular, plain, True), strict=True)
    )
    if asked == "auto":
        return next(kind for kind, can in able.items() if can)
    if not able[asked]:
        raise ValueError(
            f"operator: {asked!r} is for Elastic"
            f"{' on a lattice' if asked == 'halves' else ''} without softening or "
            "fictitious points; use "
            "'memory', or 'auto'"
        )
    return asked


_built = jax.jit(Motion.build)


@jax.jit
def _diagonal(op: Any, history: Any) -> jax.Array:
    return op.diagonal(history)


def longest_dt(motion: Motion) -> float:
    """A time step (s) that is stable, surface corrections included; host.

    See `jaxpd.solvers.explicit.stable_dt`: of the undeformed body. Large stretches, and
    laws that grow stiffer, shorten the true step. With fictitious points, whose bound
    is loose, 0.95 of the step that SciPy's Lanczos process finds, where that is longer.
    """
    op, drive = _built(motion, motion.params)
    diagonal = _diagonal(op, motion.begin)
    dt = stable_dt(np.asarray(diagonal), np.asarray(op.pick(drive.mass)))
    plies = op.plies if isinstance(op, SumMotion) else (op,)
    if any(isinstance(ply, PulledMotion) for ply in plies):
        dt = max(dt, 0.95 * largest_dt(op.plain(), drive, motion.begin))
    return dt
