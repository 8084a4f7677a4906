"""A scene laid on points: which points, what is prescribed, what pulls. Host only."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.discretize.surface import CORRECTIONS
from jaxpd.geometry import (
    Box,
    Cloud,
    Family,
    GridFamily,
    HalfSpace,
    Region,
    free_modes,
    grid_loose_points,
    grid_pieces,
    lattice,
    loose_points,
    pieces,
)
from jaxpd.scene import Elastic, Kernel, Scene
from jaxpd.schedule import ALWAYS, Table


def _values(value: Any, X: np.ndarray) -> np.ndarray:
    out = np.asarray(value(X) if callable(value) else value, float)
    if not np.isfinite(out).all():
        raise ValueError(f"value: {value} gives numbers that are not finite")
    return np.broadcast_to(out, (len(X),))


def cloud_of(scene: Scene) -> Cloud:
    """The points of a scene: its own, or a lattice that fills its box."""
    if isinstance(scene.body, Cloud):
        grid, dx = scene.body.lattice, scene.resolution.dx
        if grid is not None and dx is not None and abs(dx / grid.dx - 1.0) > 1e-6:
            raise ValueError(f"dx: {dx} is not the spacing {grid.dx} of the body")
        return scene.body
    if not isinstance(scene.body, Box):
        raise ValueError(f"body: {scene.body!r} must be a box() or a cloud of points")
    resolution = scene.resolution
    if resolution.dx is None:
        raise ValueError("dx: None; a box needs a spacing, as in Bonds(dx=1/64, m=8)")
    return lattice(
        scene.body.lo,
        scene.body.hi,
        resolution.dx,
        layers=scene.layers(),
        nodes=resolution.nodes,
    )


def _check_axes(what: str, components: tuple[Any, ...], d: int) -> None:
    for name, value in zip("xyz"[d:], components[d:], strict=True):
        if value is not None and (callable(value) or value != 0.0):
            raise ValueError(
                f"{what}: {name}={value} does not exist in {d}-D; leave it"
            )


def supports_on(
    scene: Scene, X: np.ndarray
) -> tuple[np.ndarray, np.ndarray, tuple[Table, ...]]:
    """Mask of prescribed displacements [n, d], values (m) and their tables.

    Returns:
        The mask, the values [q, n, d] of q histories in time, and those.
    """
    tables = tuple(dict.fromkeys(support.time for support in scene.supports))
    fixed, values = np.zeros(X.shape, bool), np.zeros((len(tables), *X.shape))
    for support in scene.supports:
        inside = support.region.contains(X)
        if not inside.any():
            raise ValueError(f"supports: no point lies in {support.region}")
        _check_axes("supports", support.components, scene.d)
        for axis, value in enumerate(support.components[: scene.d]):
            if value is not None:
                fixed[inside, axis] = True
                values[:, inside, axis] = 0.0
                row = values[tables.index(support.time)]
                row[inside, axis] = _values(value, X[inside])
    return fixed, values, tables


def loads_on(
    scene: Scene, X: np.ndarray, vol: np.ndarray, fixed: np.ndarray
) -> tuple[np.ndarray, tuple[Table, ...]]:
    """External nodal forces [q, n, d] (N) of q histories in time, and those."""
    tables = tuple(dict.fromkeys(load.time for load in scene.loads))
    total = np.zeros((len(tables), *X.shape))
    body = scene.body.contains(X) if isinstance(scene.body, Box) else True
    for load in scene.loads:
        _check_axes("loads", load.components, scene.d)
        # layers outside the body are there for the supports and carry no load
        area, inside = 1.0, load.region.contains(X) & body
        if load.kind == "traction":
            area, inside = _face(scene, load.region, X)
            inside &= body
        if not inside.any():
            raise ValueError(f"loads: no point of the body lies in {load.region}")
        for axis, value in enumerate(load.components[: scene.d]):
            if not callable(value) and value == 0.0:
                continue
            at = inside & ~fixed[:, axis] if load.kind == "resultant" else inside
            if not at.any():
                raise ValueError(
                    f"loads: every point in {load.region} is held along {'xyz'[axis]}; "
                    "nothing is left for the resultant to pull at"
                )
            share = vol[at] / (1.0 if load.kind == "density" else vol[at].sum())
            row = total[tables.index(load.time)]
            row[at, axis] += area * share * _values(value, X[at])
    return total, tables


def _face(scene: Scene, face: Region, X: np.ndarray) -> tuple[float, np.ndarray]:
    """Area (m^(d-1)) of a face of a box and the points within a horizon of it."""
    body = scene.body
    if not (isinstance(body, Box) and isinstance(face, HalfSpace)):
        raise ValueError("loads: a traction needs a box; use pull() on other bodies")
    sides = np.subtract(body.hi, body.lo)
    at = (body.hi if face.sign > 0 else body.lo)[face.axis]
    if abs(face.at - at) > 1e-9 * sides.max():
        raise ValueError(
            f"loads: a traction acts on a face of the box, and {face} is none; the "
            f"face on that side is at {at}"
        )
    depth = face.sign * (at - X[:, face.axis])
    delta = scene.resolution.horizon
    return float(np.delete(sides, face.axis).prod()), depth < delta * (1.0 - 1e-9)


def starts_on(scene: Scene, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (m) and velocities (m/s) at time 0, both [n, d]."""
    u, v = np.zeros(X.shape), np.zeros(X.shape)
    for start in scene.starts:
        inside = start.region.contains(X)
        if not inside.any():
            raise ValueError(f"starts: no point lies in {start.region}")
        for what, components in ((u, start.u), (v, start.v)):
            _check_axes("starts", components, scene.d)
            for axis, value in enumerate(components[: scene.d]):
                if value is not None:
                    what[inside, axis] = _values(value, X[inside])
    return u, v


def still(values: np.ndarray, tables: tuple[Table, ...], what: str) -> np.ndarray:
    """Values [n, d] of statics, which knows no time.

    Raises:
        ValueError: if any of them has a history.
    """
    if any(table != ALWAYS for table in tables):
        raise ValueError(
            f"{what}: a history in time is for run_explicit; statics has load steps"
        )
    return values.sum(axis=0)


def check_held(X: np.ndarray, family: Family | GridFamily, fixed: np.ndarray) -> None:
    """Refuse a body that can still move freely, or has points without stiffness."""
    if fixed.all():
        raise ValueError("supports: every displacement is prescribed; nothing to solve")
    grid = isinstance(family, GridFamily)
    label = grid_pieces(family) if grid else pieces(np.asarray(family.nbr))
    moving = free_modes(X, fixed, label)
    if moving:
        piece, modes = moving[0]
        points = np.flatnonzero(label == piece)
        raise ValueError(
            f"supports: {modes} rigid-body mode(s) of a piece of {len(points)} points "
            f"(among them point {points[0]} at {X[points[0]]}) are left free, and "
            f"{len(moving) - 1} more pieces likewise; prescribe displacements that "
            "stop every translation and rotation of each piece"
        )
    if grid:
        loose = grid_loose_points(family, fixed)
    else:
        loose = loose_points(X, np.asarray(family.nbr), fixed)
    if len(loose):
        raise ValueError(
            f"delta: {len(loose)} points have all their bonds in one line or plane (the"
            f" first is point {loose[0]} at {X[loose[0]]}) and no stiffness across; "
            "make the horizon larger, or prescribe the component across"
        )


def free_faces(scene: Scene) -> tuple[tuple[bool, bool], ...]:
    """Whether each face (below, above) of the lattice is without supports' layers."""
    if isinstance(scene.body, Cloud):
        return ((True, True),) * scene.d
    return tuple((below == 0, above == 0) for below, above in scene.layers())


def check_correction(
    correction: str, scene: Scene, cloud: Cloud, operator: str
) -> None:
    """Refuse a surface correction that the scene or the operator cannot have.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    if correction not in CORRECTIONS:
        raise ValueError(f"correction: {correction!r} must be one of {CORRECTIONS}")
    if correction in DIRECTIONAL:
        if not isinstance(scene.material, Elastic):
            raise ValueError(
                f"correction: {correction!r} compares with classical elasticity and "
                "needs an Elastic material; use 'lattice' or 'analytic' with own laws"
            )
        kernel = scene.resolution.kernel
        steep = isinstance(kernel, Kernel) and kernel.name == "fractional"
        alpha = float(getattr(kernel, "parameter", 0.0))
        if correction == "force density" and steep and alpha >= 1:
            raise ValueError(
                f"alpha: {alpha:g} must be below 1 with the correction 'force density',"
                " whose pull of a half neighbourhood diverges from there on; use "
                "correction='energy'"
            )
        if operator == "fft":
            raise ValueError(
                f"operator: 'fft' needs bonds that are alike, and the correction "
                f"{correction!r} makes each its own; use 'stencil' or 'gather'"
            )
    if correction == "fictitious":
        if operator not in ("auto", "gather"):
            raise ValueError(
                f"operator: {operator!r} does not know of the correction 'fictitious';"
                " use 'gather'"
            )
        if np.ndim(getattr(scene.material, "E", 0.0)):
            raise ValueError(
                "E: a modulus of every point cannot be continued beyond the body by "
                "the correction 'fictitious'; use correction='energy'"
            )
        if not any(map(any, free_faces(scene))):
            raise ValueError(
                "correction: 'fictitious' finds no free face; use 'none' or 'lattice'"
            )
