"""Plane J2 plasticity by finite elements, on scikit-fem, for the plastic peer.

Quadratic quadrilaterals of eight nodes with 2 x 2 Gauss points (the reduced rule does
not lock where plastic flow keeps the volume), consistent tangents and Newton's method
with backtracking, backward Euler over the load steps.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from _plastic_law import FloatArray, Material, State, plane_map
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import splu
from scipy.spatial import KDTree
from skfem import Basis, ElementQuadS2, ElementVector, FacetBasis, LinearForm, MeshQuad2

Fixed = tuple[str, int, float | Callable[[FloatArray], ArrayLike]]
Traction = tuple[str, float | Sequence[float] | Callable[[FloatArray], ArrayLike]]

_GAUSS = 0.5 + np.array([[-1, 1, 1, -1], [-1, -1, 1, 1]]) / np.sqrt(12.0)
_NEAR = 12  # elements tried for each probed point
_SLACK = 0.05  # a point this far outside of an element's square is still its own


@dataclass(frozen=True)
class Solution:
    """History of a body, one entry of the first axes for each load step.

    Attributes:
        factors: Load factors, shape ``[nstep]``.
        u: Displacement at the degrees of freedom, ``[nstep, ndof]``.
        forces: Reactions there: internal minus applied, ``[nstep, ndof]``.
        points: Gauss points, ``[npoint, 2]``, four an element in turn.
        weights: Areas that the Gauss points stand for, ``[npoint]``.
        stress: Components ``xx, yy, zz, xy`` there, ``[nstep, npoint, 4]``.
        peeq: Equivalent plastic strain there, ``[nstep, npoint]``.
        plastic: Plastic strain there, engineering shear, ``[nstep, npoint, 4]``.
        iterations: Newton iterations of each step, ``[nstep]``.
        basis: The scikit-fem basis; ``basis.doflocs`` are the nodes.
    """

    factors: FloatArray
    u: FloatArray = field(repr=False)
    forces: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    weights: FloatArray = field(repr=False)
    stress: FloatArray = field(repr=False)
    peeq: FloatArray = field(repr=False)
    plastic: FloatArray = field(repr=False)
    iterations: NDArray[np.intp] = field(repr=False)
    basis: Basis = field(repr=False)

    def reaction(self, boundary: str) -> FloatArray:
        """Resultant of the reactions on a named boundary, ``[nstep, 2]``.

        A node shared by two boundaries counts for both.
        """
        held = _side_dofs(self.basis, boundary)
        return np.stack([self.forces[:, dofs].sum(axis=1) for dofs in held], axis=1)

    def probe(self, points: ArrayLike) -> tuple[FloatArray, NDArray[np.intp]]:
        """Shape functions ``[n, 8]`` and dofs ``[n, 2, 8]`` at points ``[n, 2]``.

        Raises:
            ValueError: If a point lies outside of the body, beyond the small gap
                between its curved sides and the elements' parabolas.
        """
        xy = np.atleast_2d(np.asarray(points, dtype=float))
        centres = self.points.reshape(-1, 4, 2).mean(axis=1)
        near = min(_NEAR, len(centres))
        tried = KDTree(centres).query(xy, k=near)[1].reshape(-1)
        goal = np.repeat(xy, near, axis=0).T[:, :, None]
        local = np.full_like(goal, 0.5)
        mapping = self.basis.mapping
        for _ in range(25):
            miss = goal - mapping.F(local, tind=tried)
            step = np.einsum("ijkl,jkl->ikl", mapping.invDF(local, tind=tried), miss)
            local = np.clip(local + step, -0.5, 1.5)
        miss = np.abs(goal - mapping.F(local, tind=tried))[..., 0].max(axis=0)
        away = np.abs(local[..., 0] - 0.5).max(axis=0) - 0.5
        away[miss > 1e-9 * np.ptp(centres, axis=0).max(initial=1e-300)] = np.inf
        away = away.reshape(-1, near)
        choice = np.arange(len(xy)) * near + away.argmin(axis=1)
        if np.any(away.min(axis=1) > _SLACK):
            raise ValueError("a point lies outside of the body")
        at, element = local[:, choice, 0], ElementQuadS2()
        shape = np.stack([element.lbasis(at, k)[0] for k in range(8)], axis=1)
        dofs = self.basis.element_dofs[:, tried[choice]].T.reshape(-1, 8, 2)
        return shape, np.swapaxes(dofs, 1, 2)

    def displacement(self, points: ArrayLike, step: int = -1) -> FloatArray:
        """Displacement ``[n, 2]`` at any points ``[n, 2]`` of the body."""
        shape, dofs = self.probe(points)
        return np.einsum("nk,nck->nc", shape, self.u[step][dofs])


def solve(
    mesh: MeshQuad2,
    material: Material,
    fixed: Sequence[Fixed],
    tractions: Sequence[Traction],
    factors: ArrayLike,
    *,
    plane: str = "strain",
    tolerance: float = 1e-10,
    most: int = 40,
) -> Solution:
    """Take a plane body through a history of loads, per unit thickness.

    Args:
        mesh: Quadratic mesh with named boundaries.
        material: The material.
        fixed: Prescribed displacements ``(boundary, component, value)``, the value a
            number or a function of the nodes ``[2, n]``, at factor one.
        tractions: Loads ``(boundary, traction)`` at factor one: a pressure (one
            number), a vector ``(t_x, t_y)`` or a function of the points ``[2, ...]``
            that gives the vectors ``[2, ...]``.
        factors: Factor of all values and tractions at each step's end; they may
            fall and rise again.
        plane: ``"strain"`` or ``"stress"``.
        tolerance: Largest norm of the residual over the largest norm of the internal
            forces so far.
        most: Newton iterations allowed in a step.

    Returns:
        The history.

    Raises:
        ValueError: If ``plane`` is neither of the two.
        RuntimeError: If a step does not converge, above the limit load say.
    """
    if plane not in ("strain", "stress"):
        raise ValueError(f"plane must be 'strain' or 'stress', got {plane!r}")
    factors = np.atleast_1d(np.asarray(factors, dtype=float))
    element = ElementVector(ElementQuadS2())
    basis = Basis(mesh, element, quadrature=(_GAUSS, np.full(4, 0.25)))
    size, count = int(basis.N), mesh.nelements
    load = np.zeros(size)
    for boundary, traction in tractions:
        load += _load(mesh, element, boundary, traction)
    target, held = np.zeros(size), np.zeros(size, dtype=bool)
    for boundary, component, value in fixed:
        dofs = _side_dofs(basis, boundary)[component]
        target[dofs] = value(basis.doflocs[:, dofs]) if callable(value) else value
        held[dofs] = True
    free = np.flatnonzero(~held)

    # Strains xx, yy, 2 xy of every element and Gauss point: [nelement, 4, 3, 16].
    grad = np.stack([np.asarray(basis.basis[k][0].grad) for k in range(16)])
    grad = grad.transpose(3, 4, 1, 2, 0)
    strains = np.stack(
        [grad[:, :, 0, 0], grad[:, :, 1, 1], grad[:, :, 0, 1] + grad[:, :, 1, 0]],
        axis=2,
    ).reshape(count, 12, 16)
    turned = np.ascontiguousarray(np.swapaxes(strains, 1, 2))
    area = np.asarray(basis.dx)  # [nelement, 4]
    index = np.ascontiguousarray(basis.element_dofs.T)
    rows = np.repeat(index, 16, axis=1).ravel()
    columns = np.tile(index, (1, 16)).ravel()

    def internal(u: FloatArray, state: State):
        strain = (strains @ u[index][:, :, None]).reshape(-1, 3)
        stress, new, tangent = plane_map(material, strain, state, plane)
        flux = (stress[:, [0, 1, 3]] * area.reshape(-1, 1)).reshape(count, 12, 1)
        force = np.bincount(index.ravel(), (turned @ flux).ravel(), size)
        return force, tangent, stress, new

    def stiffness(tangent: FloatArray):
        weighted = tangent.reshape(count, 4, 3, 3) * area[:, :, None, None]
        flux = (weighted @ strains.reshape(count, 4, 3, 16)).reshape(count, 12, 16)
        entries = (turned @ flux).ravel()
        matrix = csc_array((entries, (rows, columns)), shape=(size, size))[free]
        inner = csc_array(matrix[:, free])
        return matrix, splu(
            inner,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.001,
            options={"SymmetricMode": True},
        )

    u, state, scale = np.zeros(size), State.virgin(4 * count), 1e-300
    force, tangent, stress, new = internal(u, state)
    elastic, start = stiffness(tangent)
    kept: list[tuple[FloatArray, FloatArray, FloatArray, State]] = []
    spent: list[int] = []
    earlier = before = 0.0
    for factor in factors:
        # First guess: an elastic step that brings the prescribed displacements, or
        # the last step once more if that leaves less out of balance.
        step = np.where(held, factor * target - u, 0.0)
        residual = (factor * load - force)[free]
        step[free] = start.solve(residual - elastic @ step)
        guesses = [u + step]
        if len(kept) > 1 and (factor - before) * (before - earlier) > 0.0:
            ratio = (factor - before) / (before - earlier)
            again = u + ratio * (u - kept[-2][0])
            guesses.append(np.where(held, factor * target, again))
        out = [(internal(g, state)[0] - factor * load)[free] for g in guesses]
        u = guesses[int(np.argmin([np.linalg.norm(part) for part in out]))]
        earlier, before = before, factor
        now = internal(u, state)
        for solves in range(1, most + 1):  # noqa: B007
            force, tangent, stress, new = now
            residual = (factor * load - force)[free]
            scale = max(scale, float(np.linalg.norm(force)))
            if np.linalg.norm(residual) <= tolerance * scale:
                break
            step = np.zeros(size)
            step[free] = stiffness(tangent)[1].solve(residual)
            begin = float(step[free] @ residual)
            # Backtrack where the step overshoots the minimum of its energy.
            for _ in range(8):
                now = internal(u + step, state)
                slope = float(step @ (now[0] - factor * load))
                if slope <= 0.5 * begin:
                    break
                cut = float(np.clip(begin / (slope + begin), 0.1, 0.7))
                step, begin = cut * step, cut * begin
            else:
                now = internal(u + step, state)
            u = u + step
        else:
            raise RuntimeError(f"factor {factor}: no convergence in {most} iterations")
        state = new
        kept.append((u, force - factor * load, stress, new))
        spent.append(solves)
    points = np.asarray(basis.global_coordinates()).transpose(1, 2, 0).reshape(-1, 2)
    return Solution(
        factors=factors,
        u=np.stack([step[0] for step in kept]),
        forces=np.stack([step[1] for step in kept]),
        points=points,
        weights=area.ravel(),
        stress=np.stack([step[2] for step in kept]),
        peeq=np.stack([step[3].peeq for step in kept]),
        plastic=np.stack([step[3].plastic for step in kept]),
        iterations=np.array(spent),
        basis=basis,
    )


def _side_dofs(basis: Basis, boundary: str) -> list[NDArray[np.intp]]:
    """Degrees of freedom of a named boundary, for each of the two components."""
    dofs = np.asarray(basis.get_dofs(boundary).flatten())
    return [np.intersect1d(dofs, basis.element_dofs[i::2]) for i in range(2)]


def _load(
    mesh: MeshQuad2, element: ElementVector, boundary: str, traction
) -> FloatArray:
    """Nodal forces of a traction on a named boundary."""
    facets = FacetBasis(mesh, element, facets=boundary, intorder=6)

    def work(v, w):
        if callable(traction):
            t = np.asarray(traction(np.asarray(w.x)))
        elif np.ndim(traction) == 0:
            t = -traction * np.asarray(w.n)
        else:
            t = np.asarray(traction, dtype=float).reshape(2, 1, 1)
        return t[0] * v[0] + t[1] * v[1]

    return np.asarray(LinearForm(work).assemble(facets))
