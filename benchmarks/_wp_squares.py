"""Squares of any order on a uniform grid, plane stress, in NumPy: the leanest peer.

All elements are one, so that assembly is an index list; SuperLU solves. What a general
finite-element package spends on meshes and mappings is left out.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu

Field = Callable[[np.ndarray], np.ndarray]


def beam(
    n: int, p: int, nu: float, exact: Field, shear: Field
) -> tuple[np.ndarray, np.ndarray, int]:
    """A body 2 by 1, E = 1: exact on the left, sheared on the right.

    Args:
        n: elements over the height.
        p: order.
        nu: Poisson's ratio.
        exact: displacements [n, 2] at places [n, 2].
        shear: traction along y at heights.

    Returns:
        Nodes [k, 2], displacements [k, 2], number of unknowns.
    """
    s, w = np.polynomial.legendre.leggauss(p + 1)
    s, w = 0.5 * (s + 1.0), 0.5 * w
    C = np.linalg.inv(np.vander(np.linspace(0, 1, p + 1), increasing=True))
    P = np.vander(s, p + 1, increasing=True) @ C
    D = np.stack([k * s ** max(k - 1, 0) for k in range(p + 1)], axis=1) @ C
    mass, stiff, mixed = (a.T * w @ b for a, b in ((P, P), (D, D), (D, P)))
    xx, yy, xy = (
        np.kron(a, b) for a, b in ((stiff, mass), (mass, stiff), (mixed, mixed.T))
    )
    c, mu = 1.0 / (1.0 - nu**2), 0.5 / (1.0 + nu)
    across = c * nu * xy + mu * xy.T
    block = np.block([[c * xx + mu * yy, across], [across.T, c * yy + mu * xx]])
    shape = 2 * n * p + 1, n * p + 1
    number = np.arange(shape[0] * shape[1], dtype=np.int32).reshape(shape)
    i, j = np.indices((p + 1, p + 1)).reshape(2, -1)
    a, b = p * np.indices((2 * n, n)).reshape(2, -1, 1)
    nodes = number[a + i, b + j]
    dofs = np.concatenate([nodes, nodes + number.size], axis=1)
    rows, columns = np.broadcast_arrays(dofs[:, :, None], dofs[:, None])
    values = np.broadcast_to(block, rows.shape).ravel()
    K = coo_array((values, (rows.ravel(), columns.ravel()))).tocsc()
    X = np.indices(shape).reshape(2, -1).T / (n * p)
    load, at = np.zeros((2, *shape)), np.arange(n)[:, None]
    pulled = shear((at + s) / n) @ (w[:, None] * P) / n
    np.add.at(load[1, -1], p * at + np.arange(p + 1), pulled)
    free = np.tile(X[:, 0] > 0.0, 2)
    u = np.where(free, 0.0, exact(X).T.ravel())
    factors = splu(
        K[free][:, free].tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    u[free] = factors.solve((load.ravel() - K @ u)[free])
    return X, u.reshape(2, -1).T, int(free.sum())
