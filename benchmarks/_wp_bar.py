"""Paper 004's bar, held at both ends, body force b = x: bonds, nodes, elements."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from _wp import Job, Method, Problem, off
from scipy.linalg import solveh_banded

from jaxpd import MLS, RKPM, Bonds, box, gallery, solve_static


def nodes(resolution: MLS | RKPM, **options: Any) -> Callable[[int], Job]:
    """Nodes with differences or kernels."""

    def job(n: int) -> Job:
        scene = gallery.kernel_bar(n + 1, resolution=resolution)
        return Job(lambda: solve_static(scene, **options).checked(), judge)

    return job


def bonds(m: int, **how: Any) -> Callable[[int], Job]:
    """Bonds on a lattice; m - 1 points beyond each end are held too."""

    def job(n: int) -> Job:
        scene = dataclasses.replace(
            gallery.kernel_bar(3),
            body=box((0.0,), (1.0,)),
            resolution=Bonds(dx=1.0 / n, m=m, **how),
            kinematics="small",
        )
        return Job(lambda: solve_static(scene, rtol=1e-10).checked(), judge)

    return job


def judge(found: Any) -> tuple[float, int]:
    """Error on the bar, of the points in it."""
    X, u = np.asarray(found.X), np.asarray(found.u)
    inside = ((X > -1e-9) & (X < 1 + 1e-9))[:, 0]
    return off(u[inside], gallery.bar_exact(X[inside])), int(inside.sum()) - 2


def elements(order: int) -> Callable[[int], Job]:
    """Finite elements of order 1 (tridiagonal) or 2 (five bands), load of 3 points."""

    def call(n: int) -> tuple[np.ndarray, np.ndarray]:
        x = np.linspace(0.0, 1.0, n * order + 1)
        h = 1.0 / n
        K = np.array([[1.0, -1.0], [-1.0, 1.0]])
        if order == 2:
            K = np.array([[7, -8, 1], [-8, 16, -8], [1, -8, 7]]) / 3.0
        at, w = np.polynomial.legendre.leggauss(3)
        s = 0.5 * (at + 1.0)
        P = (
            np.stack([1 - s, s])
            if order == 1
            else np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)])
        )
        left = h * np.arange(n)[:, None]
        force = (left + h * s) @ (0.5 * h * w * P).T
        bands, load = np.zeros((order + 1, len(x))), np.zeros(len(x))
        first = order * np.arange(n)
        for i in range(order + 1):
            np.add.at(load, first + i, force[:, i])
            for j in range(i + 1):
                np.add.at(bands[i - j], first + j, K[i, j] / h)
        u = np.zeros(len(x))
        inner = np.s_[1:-1]
        u[inner] = solveh_banded(bands[:, inner], load[inner], lower=True)
        return x, u

    def judge(result: tuple[np.ndarray, np.ndarray]) -> tuple[float, int]:
        x, u = result
        return between(x, u, order), len(x) - 2

    return lambda n: Job(lambda: call(n), judge)


def between(x: np.ndarray, u: np.ndarray, order: int) -> float:
    """Error at ten points an element: at the nodes elements are exact here."""
    s = np.linspace(0.0, 1.0, 10, endpoint=False)
    step = x[order] - x[0]
    at = (x[:-1:order, None] + step * s).ravel()
    if order == 1:
        found = np.interp(at, x, u)
    else:
        P = np.stack([(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)])
        found = (np.stack([u[:-1:2], u[1::2], u[2::2]], 1) @ P).ravel()
    return off(found, gallery.bar_exact(at))


SIZES = (10, 40, 160, 640, 2560)
SPANS = "the exact solution, a cubic, is within its reach"
PROBLEM = Problem(
    "bar",
    "Bar held at both ends under a body force",
    "error of the displacement, relative (-)",
    (
        Method("bonds, m = 3", "bonds", bonds(3), SIZES),
        Method("bonds, m = 3, energy", "bonds", bonds(3, correction="energy"), SIZES),
        Method(
            "bonds, m = 3, calibrated on the lattice",
            "bonds",
            bonds(3, correction="none", calibration="lattice"),
            SIZES,
        ),
        Method("bonds, m = 8", "bonds", bonds(8), SIZES[1:]),
        Method("MLS, midpoint", "MLS", nodes(MLS()), SIZES[:-1], SPANS),
        Method("MLS, double", "MLS", nodes(MLS(scheme="double")), SIZES[:-1]),
        Method("MLS, direct", "MLS", nodes(MLS(scheme="direct")), SIZES[:-1]),
        Method("RKPM, QCNI", "RKPM", nodes(RKPM()), SIZES[:-1]),
        Method("RKPM, GI", "RKPM", nodes(RKPM(scheme="GI")), SIZES[:-1]),
        Method("FE, linear", "peer", elements(1), (*SIZES, 10240)),
        Method("FE, quadratic", "peer", elements(2), SIZES),
    ),
    True,
    (
        "elements are judged at ten points each, as they are exact at their nodes; "
        "all others at their points",
        "bonds hold the m - 1 points beyond an end at zero, an error of first order in "
        "the horizon",
    ),
)
