"""Structured quadratic meshes of the plastic peer, with named sides."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from skfem import MeshQuad1, MeshQuad2

FloatArray = NDArray[np.float64]
Chart = Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]


def mapped(nx: int, ny: int, chart: Chart, sides: dict[str, str]) -> MeshQuad2:
    """Map a grid of the unit square, nodes at mid-edges and centres included.

    Args:
        nx: Elements along the first parameter.
        ny: Elements along the second parameter.
        chart: From the parameters ``s`` and ``t`` to ``x`` and ``y``.
        sides: Names of the sides ``s0``, ``s1``, ``t0`` and ``t1``; a name given
            twice joins two sides.

    Returns:
        The mesh with its sides as named boundaries.
    """
    square = MeshQuad1.init_tensor(
        np.linspace(0.0, 1.0, nx + 1), np.linspace(0.0, 1.0, ny + 1)
    )
    grid = MeshQuad2.from_mesh(square)
    middle = square.p[:, square.facets].mean(axis=1)
    where = {
        "s0": middle[0] < 1e-9,
        "s1": middle[0] > 1.0 - 1e-9,
        "t0": middle[1] < 1e-9,
        "t1": middle[1] > 1.0 - 1e-9,
    }
    named: dict[str, NDArray[np.intp]] = {}
    for side, name in sides.items():
        facets = np.flatnonzero(where[side])
        named[name] = np.union1d(named[name], facets) if name in named else facets
    points = np.stack(chart(*np.asarray(grid.doflocs)))
    return MeshQuad2(points, grid.t, _boundaries=named)


def rectangle(nx: int, ny: int, width: float = 1.0, height: float = 1.0) -> MeshQuad2:
    """Rectangle from the origin; sides ``left``, ``right``, ``bottom``, ``top``."""
    names = {"s0": "left", "s1": "right", "t0": "bottom", "t1": "top"}
    return mapped(nx, ny, lambda s, t: (width * s, height * t), names)


def quarter_annulus(nr: int, nt: int, a: float = 1.0, b: float = 2.0) -> MeshQuad2:
    """Quarter of a ring; sides ``inner``, ``outer``, ``bottom`` and ``left``.

    Args:
        nr: Elements over the radius.
        nt: Elements over the quarter turn.
        a: Inner radius.
        b: Outer radius.
    """

    def chart(s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        r, angle = a + (b - a) * s, 0.5 * np.pi * t
        return r * np.cos(angle), r * np.sin(angle)

    names = {"s0": "inner", "s1": "outer", "t0": "bottom", "t1": "left"}
    return mapped(nr, nt, chart, names)


def quarter_hole(
    nr: int, nt: int, a: float = 0.3, b: float = 1.0, grading: float = 1.5
) -> MeshQuad2:
    """Quarter of a square plate with a round hole at the origin.

    Sides ``hole``, ``right``, ``top``, and ``bottom`` and ``left`` on the axes.

    Args:
        nr: Elements from the hole to the edges.
        nt: Elements around the quarter, even: the corner is a vertex.
        a: Radius of the hole.
        b: Half the side of the plate.
        grading: Distances from the hole go as ``s ** grading``.

    Raises:
        ValueError: If ``nt`` is odd.
    """
    if nt % 2:
        raise ValueError(f"nt must be even, got {nt}")

    def chart(s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        angle = 0.5 * np.pi * t
        far = (
            b * np.minimum(np.tan(0.5 * np.pi * (0.5 - np.abs(t - 0.5))), 1.0),
            np.full_like(t, b),
        )
        edge = np.where(t <= 0.5, far[::-1], far)
        arc = a * np.stack([np.cos(angle), np.sin(angle)])
        x, y = arc + (edge - arc) * s**grading
        return x, y

    names = {"s0": "hole", "s1": "edge", "t0": "bottom", "t1": "left"}
    mesh = mapped(nr, nt, chart, names)
    tags = dict(mesh.boundaries or {})
    edge = np.asarray(tags.pop("edge"))
    on_top = np.asarray(mesh.p)[1, np.asarray(mesh.facets)[:, edge]].min(axis=0) > b * (
        1 - 1e-9
    )
    tags |= {"top": edge[on_top], "right": edge[~on_top]}
    return MeshQuad2(mesh.doflocs, mesh.t, _boundaries=tags)


def cook(nx: int, ny: int) -> MeshQuad2:
    """Cook's panel (0, 0), (48, 44), (48, 60), (0, 44).

    Sides ``left``, ``right``, ``bottom`` and ``top``.
    """

    def chart(s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        return 48.0 * s, 44.0 * (s + t) - 28.0 * s * t

    names = {"s0": "left", "s1": "right", "t0": "bottom", "t1": "top"}
    return mapped(nx, ny, chart, names)
