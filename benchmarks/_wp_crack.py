"""The cracked plate: error of the crack opening, bonds by solver, and elements.

Small displacements, u_x held on the loaded edges; the answer is that of the classical
plate, extrapolated finite elements. Bonds of a fixed m carry a model error that no
solver removes. 0.15 n = k + 1/2: the tips lie midway between columns of points, where
the lattice sees a crack of the right length; see convergence.py.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from _fe_peer import reference_opening, solve_plate
from _wp import Job, Method, Problem

from jaxpd import solve_static
from jaxpd.gallery import cracked_plate

STRAIN = 1e-3


def bonds(m: int, solver: str) -> Callable[[int], Job]:
    """Bond-based peridynamics with horizon m h and one of the linear solvers."""

    def job(n: int) -> Job:
        scene = cracked_plate(n, m, strain=STRAIN, kinematics="small")
        return Job(
            lambda: solve_static(scene, solver=solver, rtol=1e-6).checked(),
            lambda found: judge(found, n),
        )

    return job


def judge(found: Any, n: int) -> tuple[float, int]:
    """Error of the opening; the row on the crack is its lower face."""
    X, u = np.asarray(found.X), np.asarray(found.u)
    upper, lower = (
        np.argmin(((X - place) ** 2).sum(axis=1)) for place in ([0.0, 1.0 / n], [0, 0])
    )
    opening = float(u[upper, 1] - u[lower, 1]) / STRAIN
    return wrong(opening), int((~np.asarray(found.problem.fixed)).sum())


def wrong(opening: float) -> float:
    """Relative error of an opening over strain."""
    return abs(opening / reference_opening(clamp_x=True)[0] - 1.0)


def elements(order: int, grading: float | None = None) -> Callable[[int], Job]:
    """The classical plate by rectangles with nested dissection (`_fe_peer`)."""
    return lambda n: Job(
        lambda: solve_plate(n, order=order, strain=STRAIN, grading=grading),
        lambda plate: (wrong(plate.opening_over_strain), plate.dofs),
    )


SIZES = (30, 50, 90, 130)
PROBLEM = Problem(
    "crack",
    "Centre crack",
    "error of the crack opening, relative (-)",
    (
        Method("bonds, m = 4, D-PCG", "bonds", bonds(4, "d-pcg"), SIZES),
        Method("bonds, m = 4, spectral", "bonds", bonds(4, "spectral"), SIZES),
        Method("bonds, m = 4, multigrid", "bonds", bonds(4, "multigrid"), SIZES),
        Method("bonds, m = 4, sparse LU", "bonds", bonds(4, "direct"), SIZES[:2]),
        Method("bonds, m = 8, spectral", "bonds", bonds(8, "spectral"), SIZES),
        Method("bonds, m = 8, multigrid", "bonds", bonds(8, "multigrid"), SIZES),
        Method("FE, Q1", "peer", elements(1), (20, 40, 80, 160)),
        Method("FE, Q2", "peer", elements(2), (20, 40, 80, 160)),
        Method("FE, Q2, graded", "peer", elements(2, 3.0), (8, 12, 16, 24, 36, 48)),
    ),
    True,
    (
        "m = 8: the error changes sign between n = 70 and 90; -0.5 % is left at "
        "n = 130 and beyond (convergence.py)",
    ),
)
