"""A scene laid on points: which points, what is prescribed, what pulls. Host only."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpd.checks import real
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
from jaxpd.laminate import Laminate
from jaxpd.resolution import NODES, check_horizon
from jaxpd.scene import Scene
from jaxpd.schedule import ALWAYS, Table


def values_at(what: str, value: Any, X: np.ndarray) -> np.ndarray:
    """A number, or a callable of the positions X [n, d], at each of them [n].

    Raises:
        ValueError: naming `what`, on values that are no finite numbers [] or [n].
    """
    given = value(X) if callable(value) else value
    out = real(given)
    if out is None or not np.isfinite(out).all() or out.shape not in ((), (len(X),)):
        raise ValueError(
            f"{what}: {value} must be finite numbers, one or one for each of the "
            f"{len(X)} points; it is no number, not finite or of another shape"
        )
    return np.broadcast_to(out.astype(float), (len(X),))


def check_bonds(scene: Scene, what: str) -> None:
    """Refuse a scene of nodes where bonds are needed.

    Raises:
        ValueError: naming the doors for nodes.
    """
    if isinstance(scene.resolution, NODES):
        raise ValueError(
            f"resolution: {scene.resolution!r}; {what} is for bonds, use resolution="
            "Bonds(..); nodes have solve_static and solve_path"
        )


def cloud_of(scene: Scene) -> Cloud:
    """The points of a scene: its own, or a lattice that fills its box."""
    if isinstance(scene.body, Cloud):
        grid, dx = scene.body.lattice, scene.resolution.dx
        if grid is not None and dx is not None and abs(dx / grid.dx - 1.0) > 1e-6:
            raise ValueError(f"dx: {dx} is not the spacing {grid.dx} of the body")
        return scene.body
    if not isinstance(scene.body, Box):
        if isinstance(scene.body, Laminate):
            raise ValueError("body: a laminate; take one ply here")
        raise ValueError(
            f"body: {scene.body!r} must be a box(), a cloud of points, or a laminate()"
        )
    resolution = scene.resolution
    if resolution.dx is None:
        raise ValueError("dx: None; a box needs a spacing, as in Bonds(dx=1/64, m=8)")
    check_horizon(resolution, scene.body)
    return lattice(
        scene.body.lo,
        scene.body.hi,
        resolution.dx,
        layers=scene.layers(),
        nodes=resolution.nodes,
    )


def check_axes(what: str, components: tuple[Any, ...], d: int) -> None:
    """Refuse components along axes that a body does not have."""
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
            raise ValueError(
                f"supports: no point lies in {support.region}; points are between "
                f"{X.min(axis=0)} and {X.max(axis=0)} (m): with nodes='cell' none lies "
                "on a face, and a roller needs a thicker region, or nodes='edge'"
            )
        check_axes("supports", support.components, scene.d)
        for axis, value in enumerate(support.components[: scene.d]):
            if value is not None:
                fixed[inside, axis] = True
                values[:, inside, axis] = 0.0
                row = values[tables.index(support.time)]
                row[inside, axis] = values_at("supports", value, X[inside])
    return fixed, values, tables


def loads_on(
    scene: Scene, X: np.ndarray, vol: np.ndarray, fixed: np.ndarray
) -> tuple[np.ndarray, tuple[Table, ...]]:
    """External nodal forces [q, n, d] (N) of q histories in time, and those."""
    tables = tuple(dict.fromkeys(load.time for load in scene.loads))
    total = np.zeros((len(tables), *X.shape))
    boxes = boxes_of(scene)
    body = np.any([box.contains(X) for box, _ in boxes], axis=0) if boxes else True
    for load in scene.loads:
        check_axes("loads", load.components, scene.d)
        if load.kind == "pressure":
            raise ValueError(
                "loads: a pressure needs a rim of nodes (MLS, RKPM); use pull()"
            )
        # layers outside the body carry no load
        parts = [(1.0, load.region.contains(X) & body)]
        if load.kind == "traction":
            parts = _faces(boxes, load.region, X)
        if not any(inside.any() for _, inside in parts):
            raise ValueError(f"loads: no point of the body lies in {load.region}")
        for axis, value in enumerate(load.components[: scene.d]):
            if not callable(value) and value == 0.0:
                continue
            row = total[tables.index(load.time)]
            for area, inside in parts:
                at = inside & ~fixed[:, axis] if load.kind == "resultant" else inside
                if not at.any():
                    raise ValueError(
                        f"loads: every point in {load.region} is held along "
                        f"{'xyz'[axis]}; nothing is left for the resultant to pull at"
                    )
                share = vol[at] / (1.0 if load.kind == "density" else vol[at].sum())
                row[at, axis] += area * share * values_at("loads", value, X[at])
    return total, tables


def boxes_of(scene: Scene) -> list[tuple[Box, float]]:
    """The boxes that a scene fills, and their horizons (m); none for a cloud."""
    if isinstance(scene.body, Cloud):
        return []
    boxes = (scene.body,) if isinstance(scene.body, Box) else scene.body.plies
    given = scene.resolution
    each = given if type(given) in (tuple, list) else [given] * len(boxes)
    return [(box, one.horizon) for box, one in zip(boxes, each, strict=True)]


def _faces(
    boxes: list[tuple[Box, float]], face: Region, X: np.ndarray
) -> list[tuple[float, np.ndarray]]:
    """Area (m^(d-1)) of a face of each box, and the points within a horizon of it."""
    if not (boxes and isinstance(face, HalfSpace)):
        raise ValueError(
            "loads: with bonds a traction needs a box and a half-space beyond one of "
            f"its faces, not {face}; use pull() elsewhere"
        )
    found, ends = [], []
    for box, delta in boxes:
        sides = np.subtract(box.hi, box.lo)
        at = (box.hi if face.sign > 0 else box.lo)[face.axis]
        ends.append(at)
        if abs(face.at - at) > 1e-9 * sides.max():
            continue
        depth = face.sign * (at - X[:, face.axis])
        near = (depth < delta * (1.0 - 1e-9)) & box.contains(X)
        if delta > 0.5 * (side := sides[face.axis]) * (1.0 + 1e-9):
            raise ValueError(
                f"delta: a traction is spread over a horizon, {delta:.6g} m, and {face}"
                f" ends a side of {side:.6g} m: take at most half of it, better a tenth"
            )
        found.append((float(np.delete(sides, face.axis).prod()), near))
    if not found:
        raise ValueError(
            f"loads: a traction acts on a face of the box, and {face} is none; the "
            f"face on that side is at {', '.join(map(str, dict.fromkeys(ends)))}"
        )
    return found


def starts_on(scene: Scene, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Displacements (m) and velocities (m/s) at time 0, both [n, d]."""
    u, v = np.zeros(X.shape), np.zeros(X.shape)
    for start in scene.starts:
        inside = start.region.contains(X)
        if not inside.any():
            raise ValueError(f"starts: no point lies in {start.region}")
        for what, components in ((u, start.u), (v, start.v)):
            check_axes("starts", components, scene.d)
            for axis, value in enumerate(components[: scene.d]):
                if value is not None:
                    what[inside, axis] = values_at("starts", value, X[inside])
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
    grid = isinstance(family, GridFamily)
    label = grid_pieces(family) if grid else pieces(np.asarray(family.nbr))
    check_free(X, label, fixed)
    check_loose(X, family, fixed)


def check_free(X: np.ndarray, label: np.ndarray, fixed: np.ndarray) -> None:
    """Refuse pieces, by their labels [n], that can still move freely."""
    if fixed.all():
        raise ValueError("supports: every displacement is prescribed; nothing to solve")
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


def check_loose(X: np.ndarray, family: Family | GridFamily, fixed: np.ndarray) -> None:
    """Refuse points whose bonds have no stiffness in some direction."""
    if isinstance(family, GridFamily):
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
