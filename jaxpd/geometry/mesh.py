"""Clouds from files: meshes by Gmsh, Abaqus and others (meshio), tables of points.

Peridynamics takes the cells of a mesh, one point in the middle of each with its volume;
methods of nodes take its nodes with the outline. What else is in the file, as groups of
cells, is not read: regions say where supports and loads are.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jaxpd.checks import instance
from jaxpd.geometry.cloud import Cloud, from_points
from jaxpd.geometry.outline import outlined

#: Dimension of the cells that are read, and how many of their nodes are corners.
CELLS = {
    "line": (1, 2),
    "line3": (1, 2),
    "triangle": (2, 3),
    "triangle6": (2, 3),
    "quad": (2, 4),
    "quad8": (2, 4),
    "quad9": (2, 4),
    "tetra": (3, 4),
    "tetra10": (3, 4),
    "hexahedron": (3, 8),
    "hexahedron20": (3, 8),
    "hexahedron27": (3, 8),
    "wedge": (3, 6),
    "pyramid": (3, 5),
}
#: Tetrahedra that fill a cell of 3-D.
SPLIT = {
    4: ((0, 1, 2, 3),),
    5: ((0, 1, 2, 4), (0, 2, 3, 4)),
    6: ((0, 1, 2, 3), (1, 2, 3, 4), (2, 3, 4, 5)),
    8: ((0, 1, 3, 4), (1, 2, 3, 6), (1, 3, 4, 6), (3, 4, 6, 7), (1, 4, 5, 6)),
}


def from_mesh(file: str | Path, points: str = "cells") -> Cloud:
    """A cloud from a mesh file, whatever meshio reads: .msh, .inp, .vtu and others.

    Args:
        file: of the mesh. Cells of the highest dimension count; a mesh whose z does not
            vary is plane.
        points: "cells", one point in the middle of each cell with its volume, for
            bonds; "nodes", the nodes of a plane mesh with its outline, for kernels.

    Raises:
        ValueError: if the file cannot be read, has no cells that are known, or cells
            without volume; for "nodes" if the mesh is not plane.
        ModuleNotFoundError: without meshio, with what to install.
    """
    if points not in ("cells", "nodes"):
        raise ValueError(f"points: {points!r} must be 'cells' or 'nodes'")
    file = instance("file", file, str | Path, "the path of a mesh")
    X, blocks = _read(Path(file))
    d = max(CELLS[kind][0] for kind, _ in blocks)
    blocks = [(kind, cells) for kind, cells in blocks if CELLS[kind][0] == d]
    flat = np.ptp(X, axis=0)
    if (flat[d:] > 1e-9 * flat.max()).any():
        raise ValueError(
            f"file: {file} is a surface in space; cells of {d}-D must lie in "
            f"{'the plane z = const' if d == 2 else 'a line along x'}"
        )
    corners = [cells[:, : CELLS[kind][1]] for kind, cells in blocks]
    if points == "nodes":
        return _outlined(X, corners, d)
    parts = [_middles(X[:, :d], cells) for cells in corners]
    middle, volume = (np.concatenate(column) for column in zip(*parts, strict=True))
    if not (volume > 0).all():
        bad = int(np.argmin(volume))
        raise ValueError(f"file: cell {bad} of {file} has volume {volume[bad]:.3g}")
    return from_points(middle, volume)


def read_points(file: str | Path) -> Cloud:
    """A cloud from a table: columns x, y, .. (m) and volume (m^d), comma separated.

    Args:
        file: .csv, a line of names allowed; or .npy of the same columns.

    Raises:
        ValueError: if it cannot be read or its numbers make no cloud.
    """
    path = Path(instance("file", file, str | Path, "the path of a table"))
    try:
        if path.suffix == ".npy":
            rows = np.load(path)
        else:
            rows = np.genfromtxt(path, delimiter=",", comments="#", ndmin=2)
            rows = rows[1:] if np.isnan(rows[0]).all() else rows
    except (OSError, ValueError) as error:
        raise ValueError(f"file: {path} cannot be read ({error})") from error
    if rows.ndim != 2 or not 2 <= rows.shape[1] <= 4:
        raise ValueError(
            f"file: {path} has shape {rows.shape}; columns must be x, (y, z,) volume"
        )
    return from_points(rows[:, :-1], rows[:, -1])


def _read(path: Path) -> tuple[NDArray[np.floating], list[tuple[str, Any]]]:
    """Nodes [n, 3] and cells by kind."""
    try:
        import meshio  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "meshes need meshio: pip install 'jaxpd[mesh]'"
        ) from error
    if not path.is_file():
        raise ValueError(f"file: there is no {path}")
    try:
        mesh = meshio.read(path)
    except (meshio.ReadError, SystemExit, KeyError, ValueError) as error:
        raise ValueError(f"file: meshio cannot read {path} ({error})") from error
    X = np.zeros((len(mesh.points), 3))
    X[:, : mesh.points.shape[1]] = mesh.points
    blocks = [(b.type, np.asarray(b.data)) for b in mesh.cells if b.type in CELLS]
    if not blocks:
        found = sorted({b.type for b in mesh.cells})
        raise ValueError(f"file: {path} holds {found}, of which none is {[*CELLS]}")
    return X, blocks


def _middles(
    X: NDArray[np.floating], cells: NDArray[np.integer]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Centroids [c, d] and volumes [c] of cells by their corners [c, q]."""
    d, q = X.shape[1], cells.shape[1]
    if d == 1:
        simplices: Any = ((0, 1),)
    elif d == 2:
        simplices = tuple((0, k, k + 1) for k in range(1, q - 1))
    else:
        simplices = SPLIT[q]
    volume, moment = np.zeros(len(cells)), np.zeros((len(cells), d))
    for simplex in simplices:
        at = X[cells[:, simplex]]
        size = np.linalg.det(at[:, 1:] - at[:, :1]) / (1, 2, 6)[d - 1]
        volume += size
        moment += size[:, None] * at.mean(axis=1)
    safe = np.where(volume == 0, 1.0, volume)
    return moment / safe[:, None], np.abs(volume)


def _outlined(X: NDArray[np.floating], corners: list[Any], d: int) -> Cloud:
    """Nodes of a plane mesh, those that cells use, with the edges that one cell has."""
    if d != 2:
        raise ValueError(f"points: 'nodes' are for plane meshes, and this is {d}-D")
    turned = []
    for cells in corners:
        a, b, c = (X[cells[:, k], :2] for k in range(3))
        u, v = b - a, c - a
        clockwise = u[:, 0] * v[:, 1] < u[:, 1] * v[:, 0]
        turned.append(np.where(clockwise[:, None], cells[:, ::-1], cells))
    edges = np.concatenate(
        [np.stack([t, np.roll(t, -1, axis=1)], -1).reshape(-1, 2) for t in turned]
    )
    key = {(int(a), int(b)) for a, b in edges}
    following = {a: b for a, b in key if (b, a) not in key}
    if len(following) != sum((b, a) not in key for a, b in key):
        raise ValueError("file: its outline touches itself at a node")
    used = np.unique(np.concatenate([t.ravel() for t in turned]))
    number = {int(node): k for k, node in enumerate(used)}
    loops = []
    while following:
        start = next(iter(following))
        loop, at = [], start
        while at in following:
            loop.append(number[at])
            at = following.pop(at)
        loops.append(loop)
    return outlined(X[used, :2], loops)
