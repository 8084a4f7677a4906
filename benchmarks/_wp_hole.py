"""Kirsch's plate with a hole, nu = 1/3, plane stress: bonds, nodes, elements."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
from _plastic_meshes import mapped
from _wp import Job, Method, Problem, off
from _wp_fe import lame, solve, straight

from jaxpd import (
    MLS,
    RKPM,
    Bonds,
    above,
    below,
    from_points,
    gallery,
    moves,
    solve_static,
)

NU, SIDE = 1.0 / 3.0, 4.0


def exact(X: Any) -> np.ndarray:
    """Displacements [n, 2]."""
    return gallery.kirsch_exact(X, NU)


def nodes(resolution: MLS | RKPM) -> Callable[[int], Job]:
    """Nodes with differences or kernels, spacings that grow from the hole."""

    def job(n: int) -> Job:
        shape = (n + 1, n + 1)
        scene = gallery.plate_under_tension(shape, nu=NU, resolution=resolution)
        return Job(lambda: solve_static(scene).checked(), judge)

    return job


def bonds(m: int, correction: str) -> Callable[[int], Job]:
    """Cells of a square grid outside the hole; exact in a frame of m cells around."""

    def job(n: int) -> Job:
        def call() -> Any:
            dx = SIDE / n
            at = dx * (np.arange(-m, n + m) + 0.5)
            X = np.stack(np.meshgrid(at, at, indexing="ij"), -1).reshape(-1, 2)
            # the frame beyond the axes is the plate itself, hole and all
            X = X[np.hypot(*X.T) > 1.0]

            def u(a: int) -> Any:
                return lambda X: exact(X)[:, a]

            frame = [below(x=0.0), below(y=0.0), above(x=SIDE), above(y=SIDE)]
            scene = dataclasses.replace(
                gallery.plate_under_tension((3, 3), nu=NU),
                body=from_points(X, np.full(len(X), dx * dx)),
                supports=[moves(f, x=u(0), y=u(1)) for f in frame],
                loads=[],
                resolution=Bonds(delta=m * dx, correction=correction),
                kinematics="small",
            )
            return solve_static(scene).checked()

        return Job(call, judge)

    return job


def judge(found: Any) -> tuple[float, int]:
    """Error of the points in the quarter."""
    X, u = np.asarray(found.X), np.asarray(found.u)
    inside = ((X > -1e-9) & (X < SIDE + 1e-9)).all(axis=1)
    return off(u[inside], exact(X[inside])), 2 * int(inside.sum())


def elements(order: int) -> Callable[[int], Job]:
    """Quadrilaterals of the same grid, curved if they are quadratic."""

    def chart(s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        angle = 0.5 * np.pi * t
        hole = np.stack([np.cos(angle), np.sin(angle)])
        ends = np.minimum(1.0, 2.0 - 2.0 * t), np.minimum(1.0, 2.0 * t)
        edge = SIDE * np.stack(ends)
        x, y = hole + np.expm1(2.0 * s) / np.expm1(2.0) * (edge - hole)
        return x, y

    sides = {"s0": "hole", "s1": "edge", "t0": "bottom", "t1": "left"}

    def pull(*k: int) -> Any:
        return lambda X: gallery.kirsch_stress(X)[:, list(k)]

    def call(n: int) -> Any:
        mesh: Any = mapped(n, n, chart, sides)
        if order == 1:
            mesh = straight(mesh)
        return solve(
            mesh,
            order,
            lame(1.0, NU, "plane stress"),
            [
                (lambda x, k=k: np.abs(x[k]) < 1e-9, k, lambda X: 0 * X[:, 0])
                for k in (0, 1)
            ],
            [
                (lambda x: x[0] > SIDE - 1e-9, pull(0, 2)),
                (lambda x: x[1] > SIDE - 1e-9, pull(2, 1)),
            ],
        )

    return lambda n: Job(lambda: call(n), lambda r: (off(r.u, exact(r.X)), r.unknowns))


SIZES = (8, 16, 24, 36)
FINE = (16, 32, 64, 96)
PROBLEM = Problem(
    "hole",
    "Plate with a hole under tension",
    "error of the displacements, relative (-)",
    (
        Method("bonds, m = 3, none", "bonds", bonds(3, "none"), FINE),
        Method("bonds, m = 3, analytic", "bonds", bonds(3, "analytic"), FINE),
        Method("bonds, m = 3, energy", "bonds", bonds(3, "energy"), FINE),
        Method("bonds, m = 6, analytic", "bonds", bonds(6, "analytic"), FINE[:3]),
        Method("MLS, degree 2", "MLS", nodes(MLS(scheme="double")), SIZES),
        Method("MLS, degree 3", "MLS", nodes(MLS(degree=3, scheme="double")), SIZES),
        Method("RKPM, QCNI", "RKPM", nodes(RKPM()), SIZES),
        Method("RKPM, MNI", "RKPM", nodes(RKPM(scheme="MNI")), SIZES),
        Method("RKPM, GI", "RKPM", nodes(RKPM(scheme="GI")), SIZES),
        Method("FE, Q1", "peer", elements(1), (4, *SIZES, 64, 128)),
        Method("FE, Q2", "peer", elements(2), (2, 4, *SIZES, 64)),
    ),
    True,
    (
        "bonds: square cells outside the hole, the exact displacements in a frame m "
        "cells wide around the quarter, so that the hole alone is a free surface; all "
        "others: symmetry on the axes, tractions on the outer edges",
    ),
)
