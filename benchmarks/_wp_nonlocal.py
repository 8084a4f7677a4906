"""A manufactured field of the nonlocal operator itself: operators by solvers.

On the unit square, nu = 1/3, displacements are given, and the forces that belong to
them by the same bonds, gathered; a frame of the horizon is held. Fixed h and m, one
point a tolerance: the error is that of the solve alone. The classical solution under
the same forces stands beside, by finite elements: its error is what the nonlocal model
differs by.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from _wp import Job, Method, Problem, off
from _wp_fe import grid, lame, solve

from jaxpd import Bonds, Elastic, Scene, above, below, box, moves, prepare

NU, N, M = 1.0 / 3.0, 96, 4
FACES = (below(x=0.0), above(x=1.0), below(y=0.0), above(y=1.0))


def field(X: Any) -> np.ndarray:
    """Displacements [n, 2]: whole waves, and some that no grid of levels favours."""
    x, y = np.asarray(X).T
    u = np.sin(2 * np.pi * x) * np.cos(np.pi * y) + 0.1 * np.sin(17 * x + 11 * y)
    v = np.cos(3 * np.pi * x * y) + 0.1 * np.cos(13 * x - 19 * y)
    return 1e-3 * np.stack([u, v], 1)


def scene() -> Scene:
    """The square in its frame."""

    def u(a: int) -> Any:
        return lambda X: field(X)[:, a]

    return Scene(
        box((0.0, 0.0), (1.0, 1.0)),
        Elastic(1.0, NU, "plane stress"),
        supports=[moves(face, x=u(0), y=u(1)) for face in FACES],
        resolution=Bonds(
            dx=1.0 / N,
            m=M,
            layers=((M, M), (M, M)),
            correction="none",
            calibration="lattice",
        ),
        kinematics="small",
    )


@functools.cache
def forces() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, the forces that hold the field, which components are prescribed."""
    problem = prepare(scene(), operator="gather", solver="d-pcg")
    K = problem.stiffness()
    X = np.asarray(problem.X)
    return X, np.asarray(K.mv(field(X))), np.asarray(problem.fixed)


def bonds(operator: str, solver: str) -> Callable[[float], Job]:
    """An operator with a solver, by tolerance."""
    X, force, fixed = forces()
    load = np.where(fixed, 0.0, force)

    def job(rtol: float) -> Job:
        def call() -> Any:
            problem = prepare(scene(), operator=operator, solver=solver, rtol=rtol)
            return problem.solve(problem.params | {"load": load})

        def judge(found: Any) -> tuple[float, int]:
            u, info = found
            if info.status != 0:
                raise RuntimeError(f"{operator}, {solver}: status {int(info.status)}")
            free = ~fixed.any(axis=1)
            return off(np.asarray(u)[free], field(X)[free]), int((~fixed).sum())

        return Job(call, judge)

    return job


def elements(order: int) -> Callable[[int], Job]:
    """The classical square under the same forces, at the points of the lattice."""
    X, force, _ = forces()
    inside = ((X > -1e-9) & (X < 1 + 1e-9)).all(axis=1)
    table = force[inside].reshape(N + 1, N + 1, 2) * N**2  # rows along x

    def density(at: np.ndarray) -> np.ndarray:
        """Bilinear between the points."""
        i = np.clip((at * N).astype(int), 0, N - 1)
        s, t = (at * N - i).T[:, :, None]
        a, b = i.T
        low = (1 - s) * table[a, b] + s * table[a + 1, b]
        high = (1 - s) * table[a, b + 1] + s * table[a + 1, b + 1]
        return (1 - t) * low + t * high

    def call(n: int) -> Any:
        rim = lambda x: (np.minimum(x, 1 - x) < 1e-9).any(axis=0)  # noqa: E731
        held = [(rim, a, lambda X, a=a: field(X)[:, a]) for a in (0, 1)]
        return solve(
            grid((n, n)), order, lame(1.0, NU, "plane stress"), held, body=density
        )

    return lambda n: Job(lambda: call(n), lambda r: (off(r.u, field(r.X)), r.unknowns))


TIGHT = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
WAYS = (
    ("gather", "d-pcg"),
    ("stencil", "d-pcg"),
    ("fft", "d-pcg"),
    ("fft", "spectral"),
    ("fft", "multigrid"),
    ("gather", "amg"),
)
PROBLEM = Problem(
    "nonlocal",
    f"Manufactured field of bonds, h = 1/{N}, m = {M}",
    "error of the displacements, relative (-)",
    (
        *(Method(f"{o}, {s}", "bonds", bonds(o, s), TIGHT) for o, s in WAYS),
        Method("fft, direct", "bonds", bonds("fft", "direct"), (1e-6,)),
        Method(
            "FE, Q1, the local limit",
            "peer",
            elements(1),
            (12, 24, 48, 96),
            "another model: what is left is the difference of the two",
        ),
    ),
    None,
    ("sizes: tolerance of the solve; of elements, a side",),
)
