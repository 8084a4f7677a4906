"""Finite-element peer of the cracked-plate benchmark, built on scikit-fem.

The plate is ``[-0.5, 0.5]^2`` (metres), isotropic and linear elastic in plane
stress (``E = 30 GPa``, ``nu = 1/3``).  It holds a traction-free crack ``y = 0``,
``|x| <= 0.15``, and is pulled by ``u_y = +-strain / 2`` on ``y = +-0.5``; there
``u_x`` is either held at zero (``clamp_x=True``) or free.  The sides
``x = +-0.5`` are traction free.

How the peer is built:

* Mesh: a tensor-product grid of rectangles (Q1 or Q2) whose lines contain the
  crack tips, the crack line and the plate's two axes.  The mesh vertices of the
  open crack (tips excluded) are duplicated, so the crack is a true
  discontinuity and no stiffness is removed or weakened anywhere.
* Assembly: on rectangles the element stiffness is exactly
  ``(hy / hx) Kxx + (hx / hy) Kyy + Kxy`` with three matrices that scikit-fem
  integrates once, on the unit square.  All elements are then formed by one
  broadcast; there is no loop over elements or quadrature points.
* Solve: SuperLU in its symmetric mode (no pivoting off the diagonal), on
  unknowns numbered by geometric nested dissection.  For these grids that is
  1.3 to 2.3 times as fast as SuperLU's own minimum-degree ordering, and faster
  than conjugate gradients with a diagonal or a smoothed-aggregation (pyamg)
  preconditioner up to at least 80 000 unknowns.

Set ``OPENBLAS_NUM_THREADS=1`` in the environment for single-threaded timings.
Needs numpy, scipy and scikit-fem.  Example::

    plate = solve_plate(100, order=1, clamp_x=True)
    plate.opening_over_strain                  # 0.56586, m
    plate.displacement_jump(0.01)              # u_y(0, 0.01) - u_y(0, 0-), m
    plate.displacement(np.array([[0.2, 0.3]]))  # [[u_x, u_y]], m
    value, uncertainty = reference_opening(clamp_x=True)

Run as a script, ``python benchmarks/_fe_peer.py``, it prints opening, error and
time over a sequence of grids.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array
from scipy.sparse.linalg import splu
from skfem import Basis, BilinearForm, MeshQuad1
from skfem.assembly import Dofs
from skfem.element import ElementQuad1, ElementQuad2, ElementVector
from skfem.models.elasticity import plane_stress

__all__ = [
    "HALF_CRACK",
    "HALF_SIDE",
    "POISSON_RATIO",
    "YOUNG_MODULUS",
    "PlateFE",
    "grid_lines",
    "reference_opening",
    "solve_plate",
]

YOUNG_MODULUS = 30e9
"""Young's modulus, Pa."""
POISSON_RATIO = 1.0 / 3.0
"""Poisson's ratio."""
HALF_SIDE = 0.5
"""Half the side of the plate, m."""
HALF_CRACK = 0.15
"""Half the length of the crack, m."""

_SNAP = 1e-12  # points this close (m) above a grid line count as on it
_SMALLEST = 1e-9  # smallest cell allowed, m
_LEAF = 3  # nested dissection stops at boxes this many elements wide

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.intp]


@dataclass(frozen=True)
class PlateFE:
    """A finite-element solution of the cracked plate.

    Attributes:
        n: Elements per side.
        order: Polynomial order of the elements, 1 (Q1) or 2 (Q2).
        strain: Prescribed elongation of the plate over its height.
        dofs: Number of unknowns solved for, prescribed ones excluded.
        opening: Relative opening ``u_y(0, 0+) - u_y(0, 0-)`` of the crack at its
            centre, m.
        seconds_assembly: Wall time of mesh, numbering, assembly and boundary
            conditions, s.
        seconds_solve: Wall time of factorisation and triangular solves, s.
        x_lines: x-coordinates of the grid lines, m, shape ``[n + 1]``.
        y_lines: y-coordinates of the grid lines, m, shape ``[n + 1]``.
        element_dofs: Global degrees of freedom of each element, shape
            ``[2 (order + 1)^2, n^2]``; element ``(i, j)`` is column ``j n + i``.
        solution: Displacement at every degree of freedom, m, shape ``[ndof]``.
    """

    n: int
    order: int
    strain: float
    dofs: int
    opening: float
    seconds_assembly: float
    seconds_solve: float
    x_lines: FloatArray = field(repr=False)
    y_lines: FloatArray = field(repr=False)
    element_dofs: NDArray[np.integer] = field(repr=False)
    solution: FloatArray = field(repr=False)

    @property
    def opening_over_strain(self) -> float:
        """Opening at the crack's centre divided by the prescribed strain, m."""
        return self.opening / self.strain

    def displacement(
        self, points: ArrayLike, *, upper_face: bool = False
    ) -> FloatArray:
        """Evaluate the displacement at arbitrary points of the plate.

        Args:
            points: Coordinates ``(x, y)``, m, shape ``[npoints, 2]``.
            upper_face: Take the upper instead of the lower face of the crack for
                points on the crack line ``y = 0`` (to 1e-12 m).

        Returns:
            Displacements ``(u_x, u_y)``, m, shape ``[npoints, 2]``.

        Raises:
            ValueError: If ``points`` has another shape or a point lies outside
                of the plate.
        """
        xy = np.asarray(points, dtype=float)
        if xy.ndim != 2 or xy.shape[1] != 2:
            raise ValueError(f"points must have shape [n, 2], got {xy.shape}")
        if not np.all(np.abs(xy) <= HALF_SIDE + _SNAP):
            raise ValueError("a point lies outside of the plate")
        snap = np.array([_SNAP, -_SNAP if upper_face else _SNAP])
        col, row = (
            np.searchsorted(lines[1:-1], xy[:, axis] - snap[axis])
            for axis, lines in enumerate((self.x_lines, self.y_lines))
        )
        local = np.stack(
            [
                (xy[:, 0] - self.x_lines[col]) / np.diff(self.x_lines)[col],
                (xy[:, 1] - self.y_lines[row]) / np.diff(self.y_lines)[row],
            ]
        )
        elem = _scalar_element(self.order)
        nodal = self.solution[self.element_dofs[:, row * self.n + col]]
        u = np.zeros_like(xy)
        for k in range(nodal.shape[0] // 2):
            shape, _ = elem.lbasis(local, k)
            u += (nodal[2 * k : 2 * k + 2] * shape).T
        return u

    def displacement_jump(self, gap: float) -> float:
        """Difference of ``u_y`` between a point above the crack and its lower face.

        This is the peridynamic measure of the opening, taken between the node
        ``(0, gap)`` and the node ``(0, 0)``, which belongs to the lower face.

        Args:
            gap: Distance of the upper point from the crack line, m; usually the
                peridynamic node spacing.  Zero gives the opening itself.

        Returns:
            ``u_y(0, gap) - u_y(0, 0-)``, m.
        """
        upper = self.displacement([[0.0, gap]], upper_face=True)
        lower = self.displacement([[0.0, 0.0]])
        return float(upper[0, 1] - lower[0, 1])

    pair_opening = displacement_jump


def grid_lines(n: int, grading: float | None = None) -> tuple[FloatArray, FloatArray]:
    """Place the grid lines of an n-by-n mesh.

    Ungraded, the y-lines are uniform and the x-lines piecewise uniform: the
    crack gets the even number of cells closest to ``0.3 n`` and each ligament
    half of the others, so ``x = 0``, ``x = +-0.15`` and ``y = 0`` are always mesh
    lines.  The mesh is exactly uniform when ``n`` is a multiple of 20.

    Graded, cells shrink toward the crack tips and the plate's corners: distances
    from these follow ``s ** grading``, ``s`` uniform on (0, 1].  Exponents up to 5
    are safe; beyond, round-off reaches the opening's sixth digit.

    Args:
        n: Cells per side, even; at least 4, or at least 8 if graded.
        grading: Exponent of the grading, at least 1; None for no grading.

    Returns:
        The x-lines and the y-lines, m, ascending, each of shape ``[n + 1]``.

    Raises:
        ValueError: If ``n`` is odd or too small, ``grading`` is below 1, or the
            smallest cell would be below 1e-9 m.
    """
    if n % 2 or n < (4 if grading is None else 8):
        raise ValueError(f"n must be even and at least 4 (graded: 8), got {n}")
    if grading is None:
        inside = 2 * round(HALF_CRACK * n)
        outside = (n - inside) // 2
        x = np.concatenate(
            [
                np.linspace(-HALF_SIDE, -HALF_CRACK, outside + 1)[:-1],
                np.linspace(-HALF_CRACK, HALF_CRACK, inside + 1),
                np.linspace(HALF_CRACK, HALF_SIDE, outside + 1)[1:],
            ]
        )
        x[n // 2] = 0.0
        y = np.linspace(-HALF_SIDE, HALF_SIDE, n + 1)
        y[n // 2] = 0.0
        return x, y
    if grading < 1:
        raise ValueError(f"grading must be at least 1, got {grading}")

    def away(start: float, end: float, cells: int) -> FloatArray:
        """Lines from ``start``, where cells are smallest, to ``end``."""
        return start + (end - start) * np.linspace(0.0, 1.0, cells + 1) ** grading

    def mirrored(half: FloatArray) -> FloatArray:
        half[0] = 0.0
        return np.concatenate([-half[:0:-1], half])

    half = n // 2
    third, quarter = max(half // 3, 1), half // 2
    middle_x = 0.5 * (HALF_CRACK + HALF_SIDE)
    middle_y = 0.5 * HALF_SIDE
    x = mirrored(
        np.concatenate(
            [
                away(HALF_CRACK, 0.0, half - 2 * third)[::-1],
                away(HALF_CRACK, middle_x, third)[1:],
                away(HALF_SIDE, middle_x, third)[-2::-1],
            ]
        )
    )
    y = mirrored(
        np.concatenate(
            [
                away(0.0, middle_y, half - quarter),
                away(HALF_SIDE, middle_y, quarter)[-2::-1],
            ]
        )
    )
    if min(np.diff(x).min(), np.diff(y).min()) < _SMALLEST:
        raise ValueError(f"grading {grading} makes cells below {_SMALLEST} m")
    return x, y


def solve_plate(
    n: int,
    *,
    order: int = 1,
    strain: float = 1e-3,
    clamp_x: bool = True,
    grading: float | None = None,
    cracked: bool = True,
) -> PlateFE:
    """Solve the plate with n-by-n Q1 or Q2 elements.

    Args:
        n: Elements per side; even, at least 4 (8 if graded).
        order: Polynomial order of the elements, 1 (Q1) or 2 (Q2).
        strain: Prescribed elongation over the plate's height;
            ``u_y = +-strain / 2`` (m) on ``y = +-0.5``.
        clamp_x: Hold ``u_x`` at zero on ``y = +-0.5``.  If false, ``u_x`` is free
            there, and fixed at ``(0, -0.5)`` alone against rigid translation.
        grading: Exponent of the refinement toward the crack tips and the
            corners, see `grid_lines`; None for the regular mesh.
        cracked: Open the crack; false leaves the plate whole, on the same grid.

    Returns:
        The solution, with its timings.

    Raises:
        ValueError: If an argument is out of range.
    """
    if order not in (1, 2):
        raise ValueError(f"order must be 1 or 2, got {order}")
    start = time.perf_counter()
    x, y = grid_lines(n, grading)
    mesh = _plate_mesh(x, y, cracked=cracked)
    dofs = Dofs(mesh, ElementVector(_scalar_element(order)))
    element_dofs, total = dofs.element_dofs, int(dofs.N)
    prescribed, values, number = _number_dofs(
        element_dofs, total, n, order, strain, clamp_x
    )
    free = total - prescribed.size

    # Stiffness of all elements, scattered straight into the solver's numbering, in
    # which the prescribed degrees of freedom come last.
    along, across, mixed = _reference_stiffness(order)
    aspect = (np.diff(y)[:, None] / np.diff(x)[None, :]).reshape(-1, 1, 1)
    local = aspect * along + across / aspect + mixed
    index = np.ascontiguousarray(number.astype(np.int32)[element_dofs].T)
    rows = np.broadcast_to(index[:, :, None], local.shape).ravel()
    columns = np.broadcast_to(index[:, None, :], local.shape).ravel()
    entries = local.ravel()
    inner = (rows < free) & (columns < free)
    stiffness = coo_array(
        (entries[inner], (rows[inner], columns[inner])), shape=(free, free)
    ).tocsc()
    outer = (rows < free) & (columns >= free)
    load = -np.bincount(
        rows[outer], entries[outer] * values[columns[outer] - free], minlength=free
    )

    assembled = time.perf_counter()
    factor = splu(
        stiffness,
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    unknown = factor.solve(load)
    solved = time.perf_counter()

    solution = np.concatenate([unknown, values])[number]
    fields = {
        "n": n,
        "order": order,
        "strain": strain,
        "dofs": free,
        "seconds_assembly": assembled - start,
        "seconds_solve": solved - assembled,
        "x_lines": x,
        "y_lines": y,
        "element_dofs": element_dofs,
        "solution": solution,
    }
    opening = PlateFE(opening=0.0, **fields).displacement_jump(0.0)
    return PlateFE(opening=opening, **fields)


@lru_cache(maxsize=2)
def reference_opening(clamp_x: bool = True) -> tuple[float, float]:
    """Converged opening of the crack's centre per unit strain.

    Three graded Q2 meshes (36, 72 and 144 elements per side, exponent 4) are
    extrapolated at the rate they show (Aitken's formula).

    Args:
        clamp_x: Whether ``u_x`` is held at zero on ``y = +-0.5``.

    Returns:
        The extrapolated ``opening / strain``, m, and its uncertainty, m: the
        distance from the value on the finest mesh.
    """
    coarse, middle, fine = (
        solve_plate(n, order=2, clamp_x=clamp_x, grading=4.0).opening_over_strain
        for n in (36, 72, 144)
    )
    step, last = middle - coarse, fine - middle
    value = fine + last**2 / (step - last)
    return value, abs(value - fine)


def _scalar_element(order: int) -> ElementQuad1 | ElementQuad2:
    return ElementQuad1() if order == 1 else ElementQuad2()


def _plate_mesh(x: FloatArray, y: FloatArray, *, cracked: bool) -> MeshQuad1:
    """Mesh the grid, with the vertices of the open crack duplicated.

    Args:
        x: x-lines, m, shape ``[nx + 1]``.
        y: y-lines, m, shape ``[ny + 1]``, with 0 in the middle.
        cracked: Whether to open the crack.

    Returns:
        The mesh; element ``(i, j)`` is number ``j nx + i`` and its local axes are
        the global ones.
    """
    nx, ny = x.size - 1, y.size - 1
    vertex = np.arange((nx + 1) * (ny + 1), dtype=np.int32).reshape(ny + 1, nx + 1)
    points = np.stack([np.tile(x, ny + 1), np.repeat(y, nx + 1)])
    lower, upper = vertex[:-1], vertex[1:]
    if cracked:
        lower = lower.copy()
        faces = np.flatnonzero(np.abs(x) < HALF_CRACK - _SNAP)
        lower[ny // 2, faces] = vertex.size + np.arange(faces.size)
        zeros = np.zeros(faces.size)
        points = np.hstack([points, np.stack([x[faces], zeros])])
    corners = (lower[:, :-1], lower[:, 1:], upper[:, 1:], upper[:, :-1])
    return MeshQuad1(points, np.stack([c.ravel() for c in corners]))


@lru_cache(maxsize=2)
def _reference_stiffness(order: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Integrate the three parts of the element stiffness on the unit square.

    Args:
        order: Polynomial order of the element.

    Returns:
        The parts that multiply ``hy / hx``, ``hx / hy`` and 1, Pa, each of shape
        ``[2 (order + 1)^2, 2 (order + 1)^2]``.
    """
    lam, mu = plane_stress(YOUNG_MODULUS, POISSON_RATIO)
    normal = lam + 2.0 * mu

    def along(u, v, _):
        return normal * u.grad[0, 0] * v.grad[0, 0] + mu * u.grad[1, 0] * v.grad[1, 0]

    def across(u, v, _):
        return normal * u.grad[1, 1] * v.grad[1, 1] + mu * u.grad[0, 1] * v.grad[0, 1]

    def mixed(u, v, _):
        return lam * (
            u.grad[0, 0] * v.grad[1, 1] + u.grad[1, 1] * v.grad[0, 0]
        ) + mu * (u.grad[0, 1] * v.grad[1, 0] + u.grad[1, 0] * v.grad[0, 1])

    basis = Basis(
        MeshQuad1(), ElementVector(_scalar_element(order)), intorder=2 * order
    )
    kxx, kyy, kxy = (
        BilinearForm(form).elemental(basis).tolocal()[0]
        for form in (along, across, mixed)
    )
    return kxx, kyy, kxy


def _number_dofs(
    element_dofs: NDArray[np.integer],
    total: int,
    n: int,
    order: int,
    strain: float,
    clamp_x: bool,
) -> tuple[IntArray, FloatArray, IntArray]:
    """Number the degrees of freedom for the solver and find the prescribed ones.

    Args:
        element_dofs: Global degrees of freedom, shape ``[2 (order + 1)^2, n^2]``.
        total: Number of degrees of freedom, ``ndof``.
        n: Elements per side.
        order: Polynomial order of the elements.
        strain: Prescribed elongation over the plate's height.
        clamp_x: Whether ``u_x`` is held at zero on ``y = +-0.5``.

    Returns:
        The prescribed degrees of freedom and their values, m, both of shape
        ``[nprescribed]``, and the position of every degree of freedom in the
        solver's numbering, shape ``[ndof]``: free ones by nested dissection, then
        the prescribed ones in the order given.
    """
    # Position of every degree of freedom on the grid of nodes.
    side = order * n + 1
    offset = np.rint(order * _scalar_element(order).doflocs).astype(int)
    first = order * np.arange(n)
    column = np.empty(total, dtype=int)
    row = np.empty(total, dtype=int)
    for k, (dx, dy) in enumerate(offset):
        pair = element_dofs[2 * k : 2 * k + 2]
        column[pair] = np.tile(first + dx, n)
        row[pair] = np.repeat(first + dy, n)
    component = np.empty(total, dtype=int)
    component[element_dofs[0::2]] = 0
    component[element_dofs[1::2]] = 1

    held = (row == 0) | (row == side - 1)
    if not clamp_x:
        pin = (component == 0) & (row == 0) & (column == side // 2)
        held = (held & (component == 1)) | pin
    prescribed = np.flatnonzero(held)
    values = np.where(row[prescribed] == 0, -0.5 * strain, 0.5 * strain)
    values *= component[prescribed]

    rank = np.empty(side * side, dtype=int)
    rank[_dissect(side, order)] = np.arange(side * side)
    key = rank[row * side + column]
    key[prescribed] = side * side
    number = np.empty(total, dtype=int)
    number[np.argsort(key, kind="stable")] = np.arange(total)
    return prescribed, values, number


def _dissect(side: int, order: int) -> IntArray:
    """Order the nodes of a square grid by geometric nested dissection.

    Args:
        side: Nodes per side.
        order: Order of the elements; separators run along element edges, that is
            along every ``order``-th line of nodes.

    Returns:
        Node numbers ``row * side + column`` in elimination order, shape
        ``[side^2]``.
    """
    grid = np.arange(side * side).reshape(side, side)
    pieces: list[IntArray] = []

    def visit(box: IntArray, row: int, column: int) -> None:
        """Order the nodes of ``box``, whose first node is ``(row, column)``."""
        if box.size == 0:
            return
        height, width = box.shape
        if max(height, width) <= _LEAF * order:
            pieces.append(box.ravel())
            return
        if height >= width:
            cut = height // 2 - (row + height // 2) % order
            visit(box[:cut], row, column)
            visit(box[cut + 1 :], row + cut + 1, column)
            pieces.append(box[cut])
        else:
            cut = width // 2 - (column + width // 2) % order
            visit(box[:, :cut], row, column)
            visit(box[:, cut + 1 :], row, column + cut + 1)
            pieces.append(box[:, cut])

    visit(grid, 0, 0)
    return np.concatenate(pieces)


def main() -> None:
    """Print opening, error and time over grids, for both edge conditions."""
    grids = {1: (20, 40, 80, 160, 320), 2: (20, 40, 80, 160)}
    for clamp_x in (True, False):
        value, uncertainty = reference_opening(clamp_x)
        edge = "clamped" if clamp_x else "free"
        print(f"u_x {edge} on the loaded edges")
        print(f"reference opening/strain: {value:.9f} +- {uncertainty:.1e} m")
        print(" order    n     dofs  opening/strain  rel. error  assembly    solve")
        for order, sizes in grids.items():
            for n in sizes:
                plate = solve_plate(n, order=order, clamp_x=clamp_x)
                error = plate.opening_over_strain / value - 1.0
                print(
                    f"    Q{order} {n:4d} {plate.dofs:8d}"
                    f"  {plate.opening_over_strain:14.6f}  {error:+10.2e}"
                    f"  {plate.seconds_assembly:6.3f} s  {plate.seconds_solve:5.3f} s"
                )
        print()


if __name__ == "__main__":
    main()
