"""Finite elements for `work_precision`: plane elasticity, scikit-fem."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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

Field = Callable[[np.ndarray], np.ndarray]


def lame(E: float, nu: float, state: str) -> tuple[float, float]:
    """Lame's constants of plane stress or plane strain."""
    mu = E / (2.0 * (1.0 + nu))
    if state == "plane stress":
        return E * nu / (1.0 - nu**2), mu
    return E * nu / ((1.0 + nu) * (1.0 - 2.0 * nu)), mu


@dataclass(frozen=True)
class Elements:
    """A solved plane: nodes' places [n, 2], displacements [n, 2], unknowns."""

    X: np.ndarray
    u: np.ndarray
    unknowns: int


def solve(
    mesh: Any,
    order: int,
    constants: tuple[float, float],
    held: Sequence[tuple[Callable[[Any], Any], int, Field]],
    pulled: Sequence[tuple[Callable[[Any], Any], Field]] = (),
    body: Field | None = None,
) -> Elements:
    """Quadrilaterals of order 1 or 2.

    Args:
        mesh: scikit-fem's; curved if it is quadratic.
        order: of the elements.
        constants: Lame's.
        held: places (of x [2, n]) with a component, and its values at places [n, 2].
        pulled: facets, by their middles, and tractions [n, 2] at places [n, 2].
        body: body force [n, 2] at places [n, 2].
    """
    element: Any = ElementVector(ElementQuad1() if order == 1 else ElementQuad2())
    basis: Any = Basis(mesh, element, intorder=2 * order + 1)
    stiffness: Any = linear_elasticity(*constants).assemble(basis)
    K = stiffness.tocsc()

    def work(force: Field) -> Any:
        def form(v, w):
            f = force(w.x.reshape(2, -1).T).T.reshape(w.x.shape)
            return f[0] * v[0] + f[1] * v[1]

        return LinearForm(form)

    b = work(body).assemble(basis) if body else np.zeros(K.shape[0])
    for where, force in pulled:
        face = FacetBasis(
            mesh, element, facets=mesh.facets_satisfying(where), intorder=2 * order + 2
        )
        b = b + work(force).assemble(face)
    places: Any = basis.doflocs
    part = np.zeros(places.shape[1], int)
    for rows in (basis.nodal_dofs, basis.facet_dofs, basis.interior_dofs):
        part[np.asarray(rows)[1::2].ravel()] = 1
    u, fixed = np.zeros(len(part)), np.zeros(len(part), bool)
    for where, axis, values in held:
        some = np.flatnonzero(where(places) & (part == axis))
        u[some], fixed[some] = values(places[:, some].T), True
    free = np.flatnonzero(~fixed)
    rest = (b - K @ u)[free]
    factors = splu(
        K[free][:, free].tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    u[free] = factors.solve(rest)
    return Elements(
        places[:, part == 0].T, np.stack([u[part == 0], u[part == 1]], 1), len(free)
    )


def grid(cells: tuple[int, int], size: tuple[float, float] = (1.0, 1.0)) -> Any:
    """Rectangles from the origin."""
    lines = [np.linspace(0.0, s, n + 1) for s, n in zip(size, cells, strict=True)]
    return MeshQuad.init_tensor(*lines)


def straight(mesh: Any) -> Any:
    """The mesh with the same corners and straight edges."""
    return MeshQuad(np.asarray(mesh.p), mesh.t)
