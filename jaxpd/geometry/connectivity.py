"""What hangs together and what can still move freely. Host only.

A static solve needs every connected piece of the body held against translation and
rotation, and every point held by bonds in more than one direction.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from jaxpd.geometry.grid_family import GridFamily, offset_sums

#: Directions whose share of a point's bonds is below this count as unheld.
FLAT = 1e-10


def pieces(nbr: NDArray[np.integer]) -> NDArray[np.integer]:
    """Label [n] of the connected piece of every point, from neighbours [k, n]."""
    n = nbr.shape[1]
    slot, row = np.nonzero(nbr > np.arange(n))  # each bond once
    graph = sp.coo_matrix(
        (np.ones(len(row), np.int8), (row, nbr[slot, row])), shape=(n, n)
    )
    return connected_components(graph, directed=False)[1]


def rigid_modes(X: NDArray[np.floating]) -> NDArray[np.floating]:
    """Translations and infinitesimal rotations [n d, r]: r = 1, 3, 6 in 1, 2, 3-D.

    Rotations are about the centroid and scaled by the size of the cloud, so that all
    columns have entries of order one.
    """
    n, d = X.shape
    x = X - X.mean(axis=0)
    x = x / max(float(np.abs(x).max(initial=0.0)), 1e-300)
    modes = [np.tile(np.eye(d)[a], (n, 1)) for a in range(d)]
    for a in range(d):
        for b in range(a):
            turn = np.zeros((n, d))
            turn[:, a], turn[:, b] = -x[:, b], x[:, a]
            modes.append(turn)
    return np.stack([mode.ravel() for mode in modes], axis=1)


def free_modes(
    X: NDArray[np.floating], fixed: NDArray[np.bool_], label: NDArray[np.integer]
) -> list[tuple[int, int]]:
    """Pieces that are not held: (label, number of rigid-body modes left free).

    Args:
        X: positions [n, d] (m).
        fixed: mask of prescribed displacement components [n, d].
        label: piece of every point [n].
    """
    found = []
    order = np.argsort(label, kind="stable")
    for points in np.split(order, np.cumsum(np.bincount(label))[:-1]):
        # a lone point has no rotation to hold
        modes = rigid_modes(X[points])[:, : None if len(points) > 1 else X.shape[1]]
        held = modes[fixed[points].ravel()]
        size = np.linalg.svd(held, compute_uv=False) if len(held) else np.zeros(0)
        rank = int((size > 1e-8 * np.sqrt(len(points))).sum())
        whole = modes.shape[1]
        if len(points) > 1 and X.shape[1] == 3:
            # a straight row of points does not feel the turn about its own axis
            whole = int(np.linalg.matrix_rank(modes))
        if rank < whole:
            found.append((int(label[points[0]]), whole - rank))
    return found


def loose_points(
    X: NDArray[np.floating], nbr: NDArray[np.integer], fixed: NDArray[np.bool_]
) -> NDArray[np.integer]:
    """Indices of points whose bonds leave a free direction without stiffness.

    For small displacements a bond resists along itself alone; all bonds of such a
    point are collinear (2-D) or coplanar (3-D).
    """
    n, d = X.shape
    total = np.zeros((n, d, d))
    for row in nbr:
        xi = X[row] - X
        length = np.linalg.norm(xi, axis=1)
        xi /= np.where(length > 0, length, 1.0)[:, None]
        total += xi[:, :, None] * xi[:, None, :]
    return np.flatnonzero(_unheld(total, fixed))


def _unheld(total: NDArray[np.floating], fixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Mask [n]: the sum of n n^T over the bonds [n, d, d] leaves a direction free."""
    n, d = fixed.shape
    both = fixed[:, :, None] | fixed[:, None, :]
    held = np.where(both, 0.0, total) + fixed[:, :, None] * np.eye(d) * n
    return np.linalg.eigvalsh(held)[:, 0] <= FLAT


def grid_pieces(family: GridFamily) -> NDArray[np.integer]:
    """Label [n] of the connected piece of every point of a lattice.

    Without missing bonds there is one. With some, bonds to the next points decide, and
    all bonds where those leave more than one piece.
    """
    label = np.zeros(family.n, int)
    if not family.cut.shape[1]:
        return label
    near = np.flatnonzero(np.abs(family.steps).max(axis=1) <= 1)
    for slots in (near, None):
        i, j, _ = family.ends(slots)
        graph = sp.coo_matrix((np.ones(len(i), np.int8), (i, j)), (family.n,) * 2)
        count, label = connected_components(graph, directed=False)
        if count == 1:
            break
    return label


def grid_loose_points(
    family: GridFamily, fixed: NDArray[np.bool_]
) -> NDArray[np.integer]:
    """`loose_points` of a lattice: looks at corners and at ends of missing bonds."""
    unit = family.steps / np.linalg.norm(family.steps, axis=1)[:, None]
    total = offset_sums(family, unit[:, :, None] * unit[:, None, :])
    corners = np.ravel_multi_index(
        np.meshgrid(*[(0, n - 1) for n in family.shape], indexing="ij"), family.shape
    )
    some = np.unique(np.concatenate([corners.ravel(), *family.cut_ends()]))
    if min(family.shape) == 1:  # a row or a sheet: nothing holds it across
        some = np.arange(family.n)
    weak = _unheld(total.reshape(family.n, *total.shape[-2:])[some], fixed[some])
    return some[weak]
