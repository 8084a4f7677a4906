"""Timoshenko's cantilever, nu = 1/3, plane stress: bonds, nodes, elements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from _wp import Job, Method, Problem, off
from _wp_fe import grid, lame, solve
from _wp_squares import beam

from jaxpd import (
    MLS,
    RKPM,
    Bonds,
    Elastic,
    Scene,
    above,
    below,
    body_force,
    box,
    gallery,
    moves,
    solve_static,
)

NU = 1.0 / 3.0


def exact(X: Any) -> np.ndarray:
    """Displacements [n, 2]."""
    return gallery.cantilever_exact(X, NU)


def shear(y: Any) -> np.ndarray:
    """Traction along y at the end."""
    return -6.0 * (0.25 - (y - 0.5) ** 2)


def nodes(resolution: MLS | RKPM, **options: Any) -> Callable[[int], Job]:
    """Nodes with differences or kernels."""

    def job(n: int) -> Job:
        scene = gallery.cantilever((2 * n + 1, n + 1), nu=NU, resolution=resolution)
        return Job(lambda: solve_static(scene, **options).checked(), judge)

    return job


def bonds(m: int, correction: str) -> Callable[[int], Job]:
    """Bonds in cells; m - 1 columns or more beyond the left end move as exact."""

    def job(n: int) -> Job:
        dx = 1.0 / n

        def u(a: int) -> Any:
            return lambda X: exact(X)[:, a]

        scene = Scene(
            box((0.0, 0.0), (2.0, 1.0)),
            Elastic(1.0, NU, "plane stress"),
            supports=[moves(below(x=0.0), x=u(0), y=u(1))],
            loads=[body_force(above(x=2.0 - dx), y=lambda X: shear(X[:, 1]) / dx)],
            resolution=Bonds(
                dx=dx, m=m, correction=correction, nodes="cell", layers=((m, 0), (0, 0))
            ),
            kinematics="small",
        )
        return Job(lambda: solve_static(scene, rtol=1e-7).checked(), judge)

    return job


def judge(found: Any) -> tuple[float, int]:
    """Error of the points on the beam."""
    X, u = np.asarray(found.X), np.asarray(found.u)
    inside = X[:, 0] > -1e-9
    return off(u[inside], exact(X[inside])), 2 * int((X[:, 0] > 1e-9).sum())


def elements(order: int) -> Callable[[int], Job]:
    """Quadrilaterals."""

    def call(n: int) -> Any:
        return solve(
            grid((2 * n, n), (2.0, 1.0)),
            order,
            lame(1.0, NU, "plane stress"),
            [(lambda x: x[0] < 1e-9, a, lambda X, a=a: exact(X)[:, a]) for a in (0, 1)],
            [
                (
                    lambda x: x[0] > 2.0 - 1e-9,
                    lambda X: np.stack([0 * X[:, 1], shear(X[:, 1])], 1),
                )
            ],
        )

    return lambda n: Job(lambda: call(n), lambda r: (off(r.u, exact(r.X)), r.unknowns))


def squares(order: int) -> Callable[[int], Job]:
    """Quadrilaterals without a package."""
    return lambda n: Job(
        lambda: beam(n, order, NU, exact, shear),
        lambda r: (off(r[1], exact(r[0])), r[2]),
    )


SIZES = (6, 12, 24, 48)
FINE = (12, 24, 48, 96)
SPANS = "the exact solution, a cubic, is within its reach"
PROBLEM = Problem(
    "cantilever",
    "Cantilever under an end shear",
    "error of the displacements, relative (-)",
    (
        Method("bonds, m = 3, lattice", "bonds", bonds(3, "lattice"), FINE),
        Method("bonds, m = 3, analytic", "bonds", bonds(3, "analytic"), FINE),
        Method("bonds, m = 3, energy", "bonds", bonds(3, "energy"), FINE),
        Method("bonds, m = 3, density", "bonds", bonds(3, "force density"), FINE),
        Method("bonds, m = 3, fictitious", "bonds", bonds(3, "fictitious"), FINE),
        Method("bonds, m = 6, analytic", "bonds", bonds(6, "analytic"), FINE),
        Method("MLS, degree 2", "MLS", nodes(MLS(scheme="double")), SIZES),
        Method(
            "MLS, degree 3", "MLS", nodes(MLS(degree=3, scheme="double")), SIZES, SPANS
        ),
        Method("MLS, direct", "MLS", nodes(MLS(scheme="direct")), SIZES),
        Method("RKPM, QCNI", "RKPM", nodes(RKPM()), SIZES),
        Method("RKPM, SCNI", "RKPM", nodes(RKPM(scheme="SCNI")), SIZES),
        Method("RKPM, GI", "RKPM", nodes(RKPM(scheme="GI")), SIZES),
        Method("FE, Q1, scikit-fem", "peer", elements(1), (2, *SIZES, 96, 192)),
        Method("FE, Q2, scikit-fem", "peer", elements(2), (1, 3, *SIZES)),
        Method("FE, Q1, bare NumPy", "peer", squares(1), (2, *SIZES, 96)),
        Method("FE, Q2, bare NumPy", "peer", squares(2), (1, 3, *SIZES)),
    ),
    True,
    (
        "nu = 1/3, what bonds have in plane stress; bonds carry the end shear as a "
        "body force on the last column",
    ),
)
