"""Finite elements for `paper_rkpm`: the cantilever by quadrilaterals of scikit-fem."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.sparse.linalg import splu
from skfem import (
    Basis,
    ElementQuad1,
    ElementQuad2,
    ElementVector,
    FacetBasis,
    LinearForm,
    MeshQuad,
)
from skfem.models.elasticity import linear_elasticity

from jaxpd.gallery.kernels import cantilever_exact

E, NU = 1.0, 0.3
#: Lame's constants of plane stress.
LAME = E * NU / (1.0 - NU**2), E / (2.0 * (1.0 + NU))


def mesh_of(shape: tuple[int, int], order: int, jitter: float, seed: int) -> Any:
    """Quadrilaterals with as many nodes as a grid of this shape, corners moved."""
    cells = [(n - 1) // order for n in shape]
    mesh = MeshQuad.init_tensor(
        *(
            np.linspace(0.0, size, k + 1)
            for size, k in zip((2.0, 1.0), cells, strict=True)
        )
    )
    inner = ~np.isin(np.arange(mesh.p.shape[1]), mesh.boundary_nodes())
    size = np.array([[2.0 / cells[0]], [1.0 / cells[1]]])
    moved = np.random.default_rng(seed).uniform(-jitter, jitter, mesh.p.shape) * size
    return MeshQuad(mesh.p + np.where(inner, moved, 0.0), mesh.t)


def elements(
    shape: tuple[int, int], order: int, jitter: float = 0.0, seed: int = 0
) -> dict[str, float]:
    """Error at the nodes, seconds of assembly and solution; order 1 or 2."""
    start = time.perf_counter()
    mesh = mesh_of(shape, order, jitter, seed)
    element = ElementVector(ElementQuad1() if order == 1 else ElementQuad2())
    basis: Any = Basis(mesh, element, intorder=2 * order)
    K = linear_elasticity(*LAME).assemble(basis).tocsc()
    right = mesh.facets_satisfying(lambda x: x[0] > 2.0 - 1e-9)
    end = FacetBasis(mesh, element, facets=right, intorder=4)
    load: Any = LinearForm(
        lambda v, w: -6.0 * (0.25 - (w.x[1] - 0.5) ** 2) * v[1]
    ).assemble(end)
    places = basis.doflocs.T
    held = np.flatnonzero(places[:, 0] < 1e-9)
    vertical = np.zeros(len(places), int)
    vertical[np.unique(basis.element_dofs[1::2])] = 1
    u = np.zeros(len(places))
    want = cantilever_exact(places)[np.arange(len(places)), vertical]
    u[held] = want[held]
    free = np.setdiff1d(np.arange(len(places)), held)
    b = (load - K @ u)[free]
    ready = time.perf_counter()
    factors = splu(
        K[free][:, free].tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    u[free] = factors.solve(b)
    done = time.perf_counter()
    return {
        "nodes": len(places) // 2,
        "error": float(np.linalg.norm(u - want) / np.linalg.norm(want)),
        "assembly": ready - start,
        "linear": done - ready,
        "seconds": done - start,
    }
