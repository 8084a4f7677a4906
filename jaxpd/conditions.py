"""What acts on a body: supports, loads, and how it starts.

Values are numbers, or callables of the positions X [n, d] through Python alone; all may
follow a history in time (`jaxpd.schedule`), which statics does not know.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.checks import instance, number
from jaxpd.geometry import Region
from jaxpd.schedule import ALWAYS, STEADY, Table

Value = float | Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Support:
    """Prescribed displacement components of the points in a region.

    Attributes:
        region: where.
        components: displacement (m) per axis; None leaves that component free.
        time: factor over time of motion.
    """

    region: Region
    components: tuple[Value | None, ...]
    time: Table = ALWAYS


@dataclass(frozen=True)
class Load:
    """External force on the points in a region.

    Attributes:
        region: where; of a traction the half-space beyond a face of the box.
        components: per axis, what `kind` says.
        kind: force "density" (N/m^3), "resultant" (N), spread evenly by volume,
            "traction" (Pa), spread over the points within a horizon of the face, or on
            the rim of a body of nodes, or "pressure" (Pa) on a rim.
        time: factor over time of motion.
    """

    region: Region
    components: tuple[Value, ...]
    kind: str = "density"
    time: Table = ALWAYS


def _components(names: str, values: tuple[Any, ...], free: bool) -> tuple[Any, ...]:
    """Values by name, numbers or callables; None only where a component may be free."""
    for name, value in zip(names.split(), values, strict=True):
        if not (callable(value) or (free and value is None)):
            number(name, value, cure="or a callable of X")
    return values


def _check(region: Any, time: Any = ALWAYS, name: str = "region") -> None:
    instance(name, region, Region, "a region, as above(y=0.02)")
    instance("time", time, Table, "a ramp(..) or a table(..)")


def moves(
    region: Region,
    *,
    x: Value | None = None,
    y: Value | None = None,
    z: Value | None = None,
    time: Table = ALWAYS,
) -> Support:
    """Prescribe displacements (m) in a region; components left out stay free."""
    _check(region, time)
    parts = _components("x y z", (x, y, z), free=True)
    if parts == (None, None, None):
        raise ValueError("x: moves() needs at least one of x, y, z")
    return Support(region, parts, time)


def drives(
    region: Region,
    *,
    x: Value | None = None,
    y: Value | None = None,
    z: Value | None = None,
) -> Support:
    """Prescribe velocities (m/s) from time 0 on; components left out stay free."""
    _check(region)
    parts = _components("x y z", (x, y, z), free=True)
    if parts == (None, None, None):
        raise ValueError("x: drives() needs at least one of x, y, z")
    return Support(region, parts, STEADY)


def holds(region: Region) -> Support:
    """Hold a region: all displacement components are zero."""
    _check(region)
    return Support(region, (0.0, 0.0, 0.0))


def body_force(
    region: Region,
    *,
    x: Value = 0.0,
    y: Value = 0.0,
    z: Value = 0.0,
    time: Table = ALWAYS,
) -> Load:
    """A body force density (N/m^3) in a region."""
    _check(region, time)
    return Load(region, _components("x y z", (x, y, z), free=False), "density", time)


def pull(
    region: Region,
    *,
    x: float = 0.0,
    y: float = 0.0,
    z: float = 0.0,
    time: Table = ALWAYS,
) -> Load:
    """A resultant force (N), spread over a region in proportion to volume."""
    _check(region, time)
    return Load(region, _components("x y z", (x, y, z), free=False), "resultant", time)


def traction(
    face: Region,
    *,
    x: Value = 0.0,
    y: Value = 0.0,
    z: Value = 0.0,
    time: Table = ALWAYS,
) -> Load:
    """A traction (Pa) on a face of a box, spread over the points within a horizon.

    Args:
        face: the half-space beyond the face, as in `above(y=0.02)`. A body of nodes
            (`MLS`) may have any region: of its rim the nodes inside, and of a
            half-space those faces alone that look along its axis.
        x: component of the force per area (Pa), as y and z.
        y: see x.
        z: see x.
        time: factor over time of motion.
    """
    _check(face, time, "face")
    parts = _components("x y z", (x, y, z), free=False)
    return Load(face, parts, "traction", time)


def pressure(region: Region, p: Value, *, time: Table = ALWAYS) -> Load:
    """A pressure p (Pa) against the rim of a body of nodes, where it lies in a region.

    Of a half-space those faces alone that look along its axis, as with `traction`.

    Raises:
        ValueError: if p is no finite number, or `region` none.
    """
    _check(region, time)
    _components("p", (p,), free=False)
    return Load(region, (p, 0.0, 0.0), "pressure", time)


@dataclass(frozen=True)
class Start:
    """State at time 0 of the points in a region; None leaves what was there.

    Attributes:
        region: where.
        u: displacement (m) per axis.
        v: velocity (m/s) per axis.
    """

    region: Region
    u: tuple[Value | None, ...]
    v: tuple[Value | None, ...]


def initially(
    region: Region,
    *,
    ux: Value | None = None,
    uy: Value | None = None,
    uz: Value | None = None,
    vx: Value | None = None,
    vy: Value | None = None,
    vz: Value | None = None,
) -> Start:
    """Displacements (m) and velocities (m/s) at time 0; those left out are 0."""
    _check(region)
    u = _components("ux uy uz", (ux, uy, uz), free=True)
    v = _components("vx vy vz", (vx, vy, vz), free=True)
    if u == v == (None, None, None):
        raise ValueError("ux: initially() needs at least one component of u or v")
    return Start(region, u, v)
