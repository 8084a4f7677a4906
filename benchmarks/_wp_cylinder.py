"""Lame's thick cylinder, a quarter of the ring in plane strain: nodes and elements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from _plastic_meshes import quarter_annulus
from _wp import Job, Method, Problem, off
from _wp_fe import lame, solve, straight

from jaxpd import MLS, RKPM, gallery, prepare
from jaxpd.physics import Hooke

E, NU, P = 2.1e5, 0.3, 60.0
Shape = tuple[int, int]


def exact(X: Any) -> np.ndarray:
    """Displacements [n, 2] under pressure inside, radii 1 and 2."""
    r = np.linalg.norm(X, axis=1, keepdims=True)
    return P / 3.0 * (1 + NU) / E * ((1 - 2 * NU) * r + 4.0 / r) * X / r


def nodes(resolution: MLS | RKPM) -> Callable[[Shape], Job]:
    """Nodes with differences or kernels."""

    def job(shape: Shape) -> Job:
        law = Hooke(E, NU, "plane strain")
        scene = gallery.pressed_ring(shape, P, law=law, resolution=resolution)

        def call() -> Any:
            problem = prepare(scene)
            u, info = problem.solve()
            return problem, u, info.status

        return Job(call, judge)

    return job


def judge(found: Any) -> tuple[float, int]:
    """Error at the nodes."""
    problem, u, status = found
    if status != 0:
        raise RuntimeError(f"status {int(status)}")
    return off(u, exact(np.asarray(problem.X))), int((~problem.fixed).sum())


def elements(order: int) -> Callable[[Shape], Job]:
    """Quadrilaterals, curved if they are quadratic."""

    def call(shape: Shape) -> Any:
        mesh: Any = quarter_annulus(*shape)
        if order == 1:
            mesh = straight(mesh)
        hole = lambda x: np.hypot(*x) < 1.0 + 0.2 / shape[0]  # noqa: E731
        return solve(
            mesh,
            order,
            lame(E, NU, "plane strain"),
            [
                (lambda x, k=k: np.abs(x[k]) < 1e-9, k, lambda X: 0 * X[:, 0])
                for k in (0, 1)
            ],
            [(hole, lambda X: P * X / np.linalg.norm(X, axis=1, keepdims=True))],
        )

    return lambda n: Job(lambda: call(n), lambda r: (off(r.u, exact(r.X)), r.unknowns))


GRIDS = ((8, 18), (11, 25), (16, 37), (21, 49), (31, 73))
CELLS = ((2, 4), (4, 8), (8, 16), (16, 32), (32, 64))
PROBLEM = Problem(
    "cylinder",
    "Thick cylinder under pressure inside",
    "error of the displacements, relative (-)",
    (
        Method("MLS, degree 2", "MLS", nodes(MLS(scheme="double")), GRIDS),
        Method("MLS, degree 3", "MLS", nodes(MLS(degree=3, scheme="double")), GRIDS),
        Method("MLS, direct", "MLS", nodes(MLS(scheme="direct")), GRIDS),
        Method("RKPM, QCNI", "RKPM", nodes(RKPM()), GRIDS),
        Method("RKPM, V2-MNI", "RKPM", nodes(RKPM(scheme="V2-MNI")), GRIDS),
        Method("RKPM, MNI", "RKPM", nodes(RKPM(scheme="MNI")), GRIDS),
        Method("RKPM, GI", "RKPM", nodes(RKPM(scheme="GI")), GRIDS),
        Method("FE, Q1", "peer", elements(1), (*CELLS, (64, 128))),
        Method("FE, Q2", "peer", elements(2), CELLS),
    ),
    True,
    ("nu = 0.3 in plane strain, out of reach of bonds, whose nu is 1/4",),
)
