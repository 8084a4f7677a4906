"""Preparing a scene to move: everything that is done once, on the host."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxpd.body import cloud_of, free_faces, loads_on, starts_on, supports_on
from jaxpd.course import Course
from jaxpd.discretize import beyond_faces
from jaxpd.discretize.extension import check_cracks
from jaxpd.geometry import Cloud, GridFamily, find, find_on_grid
from jaxpd.geometry.crack import check_dimension
from jaxpd.motion import Motion
from jaxpd.operators.pulled_motion import PulledMotion
from jaxpd.operators.row import row_of, start_bits
from jaxpd.operators.slots import curve
from jaxpd.physics.damage import Brittle, Softening
from jaxpd.prepare import correction_of, model_of
from jaxpd.problem import Problem, Spec
from jaxpd.scene import Elastic, Kernel, Scene
from jaxpd.solvers.explicit import largest_dt, stable_dt
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton

DTYPES = ("float32", "float64")


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
    real = jax.dtypes.canonicalize_dtype(float).name
    dtype = real if dtype is None else dtype
    if dtype not in DTYPES or (dtype == "float64" and real != dtype):
        raise ValueError(
            f"dtype: {dtype!r} must be one of {DTYPES}; 64 bits need "
            "jax.config.update('jax_enable_x64', True) before any array is made"
        )
    if softening is not None and not 0 < softening < 1:
        raise ValueError(f"softening: {softening} must lie between 0 and 1")
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
    model, params = model_of(scene)
    if not elastic and not hasattr(params["law"], "advance"):
        s_crit = np.where(_unbreakable(scene, X), np.inf, material.s_crit)
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
        no_fail = _unbreakable(scene, X)
    order = curve(points) if kind == "slots" else None
    course = Course(kind, breaks, softening, loads, moves, dtype)
    cut = _cut(scene, cloud, points, family, delta)
    law = params.get("law", Softening if softening is not None else Brittle)
    begin, untouched = (
        _memory(family, x, order, kind, law.start, dtype) for x in (cut, None)
    )
    return Motion(problem, params, fixed, begin, untouched, vol, no_fail, order, course)


def prepared(scene: Scene | Motion, options: dict[str, Any]) -> Motion:
    """The motion of a scene, or the one given, which takes no options any more."""
    if not isinstance(scene, Motion):
        return prepare_motion(scene, **options)
    if options:
        raise ValueError(f"{', '.join(options)}: are for prepare_motion, done already")
    return scene


def _unbreakable(scene: Scene, X: np.ndarray) -> np.ndarray:
    """Mask of the points whose bonds never break [n]."""
    found = np.zeros(len(X), bool)
    for region in scene.no_fail:
        inside = region.contains(X)
        if not inside.any():
            raise ValueError(f"no_fail: no point lies in {region}")
        found |= inside
    return found


def _kind(asked: str, regular: bool, elastic: bool, softening: float | None) -> str:
    plain = elastic and softening is None
    able = {"halves": plain and regular, "slots": plain, "memory": True}
    if asked == "auto":
        return next(kind for kind, can in able.items() if can)
    if asked not in able:
        raise ValueError(f"operator: {asked!r} must be 'auto' or one of {[*able]}")
    if not able[asked]:
        raise ValueError(
            f"operator: {asked!r} is for Elastic"
            f"{' on a lattice' if asked == 'halves' else ''} without softening or "
            "fictitious points; use "
            "'memory', or 'auto'"
        )
    return asked


def _cut(scene: Scene, cloud: Cloud, X: Any, family: Any, delta: float) -> Any:
    """Bonds that the cracks cut: (point, slot) [2, b], or a mask [k, n]."""
    if not scene.cracks:
        return None
    if isinstance(family, GridFamily):
        cracked = find_on_grid(
            cloud, delta, partial=family.partial, cracks=scene.cracks
        )
        return np.asarray(cracked.cut)
    nbr = np.asarray(family.nbr)
    here = np.arange(len(X), dtype=np.int32)
    cut = np.zeros(nbr.shape, bool)
    check_dimension(scene.cracks, X.shape[1])
    for crack in scene.cracks:
        for row, hit in zip(nbr, cut, strict=True):
            hit |= crack.cuts(X, here, row)
    return cut


def _memory(
    family: Any, cut: Any, order: Any, kind: str, start: Any, dtype: str
) -> Any:
    """The memory of the bonds at time 0, as the operator of that kind keeps it."""
    if kind == "halves":
        return jax.device_put(start_bits(row_of(family.shape, family.offsets), cut))
    nbr = np.asarray(family.nbr)
    there = nbr != np.arange(nbr.shape[1])
    if cut is not None:
        there &= ~cut
    if kind == "slots":
        return jax.device_put(there[:, order])
    real = bool if isinstance(start, bool) else dtype
    return jax.device_put((np.full(nbr.shape, start, real), there))


def longest_dt(motion: Motion) -> float:
    """A time step (s) that is stable, surface corrections included; host.

    See `jaxpd.solvers.explicit.stable_dt`: of the undeformed body. Large stretches, and
    laws that grow stiffer, shorten the true step. With fictitious points, whose bound
    is loose, 0.95 of the step that SciPy's Lanczos process finds, where that is longer.
    """
    op, drive = jax.jit(Motion.build)(motion, motion.params)
    diagonal = jax.jit(lambda op, history: op.diagonal(history))(op, motion.begin)
    dt = stable_dt(np.asarray(diagonal), np.asarray(op.pick(drive.mass)))
    if isinstance(op, PulledMotion):
        dt = max(dt, 0.95 * largest_dt(op.plain(), drive, motion.begin))
    return dt
