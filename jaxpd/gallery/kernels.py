"""Bodies of kernels with their exact answers: paper 004's examples and patch tests.

Plane bodies are in plane stress, with E = 1 and nu = 0.3 where nothing else is said:
relative errors depend on nu alone.
"""

from __future__ import annotations

import itertools
import math
from typing import Any

import jax.numpy as jnp
import numpy as np

from jaxpd.checks import number, whole
from jaxpd.conditions import body_force, moves, traction
from jaxpd.geometry import Cloud, above, ball, below, box, mapped, outlined
from jaxpd.resolution import RKPM
from jaxpd.scene import Elastic, Scene

#: Everywhere.
ALL = box((-1e3, -1e3), (1e3, 1e3))


def _kernels(resolution: Any) -> Any:
    return RKPM() if resolution is None else resolution


def kernel_bar(
    n: int = 11, *, jitter: float = 0.0, seed: int = 0, resolution: Any = None
) -> Scene:
    """Paper 004's bar, section 5.1: both ends held, body force b = x, length 1, E = 1.

    Args:
        n: nodes; 11 in the paper.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        resolution: the recommended one by default.
    """
    whole("n", n, 2)
    line = box((-1e3,), (1e3,))
    return Scene(
        mapped((n,), lambda s: s, jitter=jitter, seed=seed),
        Elastic(1.0, None, "bar"),
        supports=[moves(below(x=0.0), x=0.0), moves(above(x=1.0), x=0.0)],
        loads=[body_force(line, x=lambda X: X[:, 0])],
        resolution=_kernels(resolution),
    )


def bar_exact(X: Any) -> np.ndarray:
    """Displacements [n, 1] of `kernel_bar`: (x - x^3) / 6."""
    x = np.asarray(X)
    return (x - x**3) / 6.0


def cantilever(
    shape: tuple[int, int] = (13, 7),
    *,
    nu: float = 0.3,
    state: str = "plane stress",
    jitter: float = 0.0,
    seed: int = 0,
    resolution: Any = None,
) -> Scene:
    """Timoshenko's cantilever, 2 by 1, under a parabolic shear at its end (P = 1).

    Paper 004, section 5.2; its dimensions are not printed. The left end is held as the
    exact solution moves it, at nodes; the other edges carry its tractions.

    Args:
        shape: nodes along and across; 5 x 3 and 13 x 7 fit the paper's 15 and 91.
        nu: Poisson's ratio.
        state: "plane stress" or "plane strain".
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        resolution: the recommended one by default.
    """

    def u(a):
        return lambda X: cantilever_exact(X, nu, state)[:, a]

    def shear(X):
        return -6.0 * (0.25 - (X[:, 1] - 0.5) ** 2)

    size = jnp.array([2.0, 1.0])
    return Scene(
        mapped(shape, lambda s: size * s, jitter=jitter, seed=seed),
        Elastic(1.0, nu, state),
        supports=[moves(below(x=0.0), x=u(0), y=u(1))],
        loads=[traction(above(x=2.0), y=shear)],
        resolution=_kernels(resolution),
    )


def cantilever_exact(
    X: Any, nu: float = 0.3, state: str = "plane stress"
) -> np.ndarray:
    """Displacements [n, 2] of `cantilever`, after Timoshenko and Goodier."""
    E = 1.0
    if state == "plane strain":
        E, nu = 1.0 / (1.0 - nu**2), nu / (1.0 - nu)
    x, y = np.asarray(X)[:, 0], np.asarray(X)[:, 1] - 0.5
    ux = 2.0 * y / E * ((12.0 - 3.0 * x) * x + (2.0 + nu) * (y**2 - 0.25))
    bend = 3.0 * nu * y**2 * (2.0 - x) + (4.0 + 5.0 * nu) * x / 4.0
    return np.stack([ux, -2.0 / E * (bend + (6.0 - x) * x**2)], axis=1)


def plate_under_tension(
    shape: tuple[int, int] = (17, 17),
    *,
    nu: float = 0.3,
    grading: float = 2.0,
    jitter: float = 0.0,
    seed: int = 0,
    resolution: Any = None,
) -> Scene:
    """A quarter of a plate with a hole in a field of tension along x (Kirsch).

    Paper 004, section 5.3: the square 4 by 4 around a hole of radius 1, tractions of
    the infinite plate on its outer edges, symmetry on the axes. The hole is the
    polygon of its nodes.

    Args:
        shape: nodes away from the hole and along it.
        nu: Poisson's ratio.
        grading: spacings grow by exp(grading) from the hole outwards.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        resolution: the recommended one by default.
    """
    number("grading", grading, above=0, cure="2 is the default")

    def place(s):
        angle = 0.5 * math.pi * s[1]
        hole = jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        edge = 4.0 * jnp.stack(
            [jnp.minimum(1.0, 2.0 - 2.0 * s[1]), jnp.minimum(1.0, 2.0 * s[1])]
        )
        out = jnp.expm1(grading * s[0]) / math.expm1(grading)
        return hole + out * (edge - hole)

    def stress(*k):
        return lambda X: kirsch_stress(X)[(slice(None), *k)]

    return Scene(
        mapped(shape, place, jitter=jitter, seed=seed),
        Elastic(1.0, nu, "plane stress"),
        supports=[moves(below(x=1e-9), x=0.0), moves(below(y=1e-9), y=0.0)],
        loads=[
            traction(above(x=4.0 - 1e-9), x=stress(0), y=stress(2)),
            traction(above(y=4.0 - 1e-9), x=stress(2), y=stress(1)),
        ],
        resolution=_kernels(resolution),
    )


def kirsch_stress(X: Any) -> np.ndarray:
    """Stresses xx, yy, xy [n, 3] around a hole of radius 1 under tension 1 along x.

    Paper 004, eq. 36 to 38.
    """
    x, y = np.asarray(X).T
    square, t = 1.0 / (x**2 + y**2), np.arctan2(y, x)
    two, four = np.cos(2 * t), np.cos(4 * t)
    xx = 1.0 - square * (1.5 * two + four) + 1.5 * square**2 * four
    yy = -square * (0.5 * two - four) - 1.5 * square**2 * four
    xy = -square * (0.5 * np.sin(2 * t) + np.sin(4 * t))
    return np.stack([xx, yy, xy + 1.5 * square**2 * np.sin(4 * t)], axis=1)


def kirsch_exact(X: Any, nu: float = 0.3) -> np.ndarray:
    """Displacements [n, 2] of the infinite plate, E = 1, plane stress."""
    x, y = np.asarray(X).T
    r, t, k = np.hypot(x, y), np.arctan2(y, x), (3.0 - nu) / (1.0 + nu)
    c3, s3 = np.cos(3 * t), np.sin(3 * t)
    ux = r * (k + 1) * np.cos(t) + 2 / r * ((1 + k) * np.cos(t) + c3) - 2 / r**3 * c3
    uy = r * (k - 3) * np.sin(t) + 2 / r * ((1 - k) * np.sin(t) + s3) - 2 / r**3 * s3
    return np.stack([ux, uy], axis=1) * (1.0 + nu) / 4.0


def l_shape(n: int = 5, *, jitter: float = 0.0, seed: int = 0) -> Cloud:
    """Nodes of the square 2 by 2 less its upper right quarter, for patch tests.

    Args:
        n: spacings along a side of the quarter: 3 n^2 cells.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
    """
    whole("n", n)
    whole("seed", seed, 0)
    number("jitter", jitter, least=0, below=0.5)
    i, j = np.indices((2 * n + 1, 2 * n + 1)).reshape(2, -1)
    kept = (i <= n) | (j <= n)
    numbering = np.cumsum(kept) - 1
    corners = [(0, 0), (2 * n, 0), (2 * n, n), (n, n), (n, 2 * n), (0, 2 * n), (0, 0)]
    loop = []
    for (a, b), (c, d) in itertools.pairwise(corners):
        steps = max(abs(c - a), abs(d - b))
        for k in range(steps):
            at = (a + (c - a) * k // steps) * (2 * n + 1) + b + (d - b) * k // steps
            loop.append(numbering[at])
    X = np.stack([i[kept], j[kept]], axis=1) / n
    inner = np.ones(len(X), bool)
    inner[loop] = False
    moved = np.random.default_rng(seed).uniform(-jitter, jitter, X.shape) / n
    return outlined(X + np.where(inner[:, None], moved, 0.0), [loop])


#: Coefficients of 1, x, y, x^2, xy, y^2 in the fields of patch tests [2, 6].
PATCHES = {
    "linear": ((0.1, 0.2, 0.3, 0.0, 0.0, 0.0), (-0.2, 0.1, -0.25, 0.0, 0.0, 0.0)),
    "quadratic": ((0.1, 0.2, 0.3, 0.1, 0.2, -0.15), (-0.2, 0.1, -0.25, 0.2, -0.1, 0.3)),
}


def patch_exact(X: Any, field: str = "quadratic") -> np.ndarray:
    """Displacements [n, 2] of `patch`."""
    x, y = np.asarray(X).T
    return np.stack(
        [np.ones_like(x), x, y, x * x, x * y, y * y], axis=1
    ) @ np.transpose(PATCHES[field])


def patch_stress(X: Any, field: str = "quadratic", nu: float = 0.3) -> np.ndarray:
    """Stresses xx, yy, xy [n, 3] of `patch`."""
    x, y = np.asarray(X).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    a, b = np.array(PATCHES[field])
    dx = np.stack([zero, one, zero, 2 * x, y, zero], axis=1)
    dy = np.stack([zero, zero, one, zero, x, 2 * y], axis=1)
    xx, yy, xy = dx @ a, dy @ b, dy @ a + dx @ b
    return np.stack([xx + nu * yy, yy + nu * xx, 0.5 * (1.0 - nu) * xy], axis=1) / (
        1.0 - nu**2
    )


def patch(
    body: Cloud, held: str = "", field: str = "quadratic", *, resolution: Any = None
) -> Scene:
    """A body in which a polynomial field solves the equations: the patch test.

    Args:
        body: nodes with straight edges along the axes, as `l_shape` and boxes.
        held: outermost edges with the field's displacements, letters of "lrbt" (left,
            right, bottom, top); all others have its tractions. "" holds two nodes
            against rigid motion.
        field: "linear" or "quadratic".
        resolution: the recommended one by default.
    """
    X = np.asarray(body.X)
    lo, hi = X.min(axis=0), X.max(axis=0)
    edge = {
        "l": below(x=float(lo[0])), "r": above(x=float(hi[0])),
        "b": below(y=float(lo[1])), "t": above(y=float(hi[1])),
    }  # fmt: skip

    def u(a):
        return lambda X: patch_exact(X, field)[:, a]

    def pull(k, sign):
        return lambda X: sign * patch_stress(X, field)[:, k]

    supports = [moves(edge[name], x=u(0), y=u(1)) for name in held]
    if not held:
        here, there = (ball(tuple(at), 1e-9) for at in ((lo[0], lo[1]), (hi[0], lo[1])))
        supports = [moves(here, x=u(0), y=u(1)), moves(there, y=u(1))]
    loads = []
    for axis, (a, b) in enumerate(((0, 2), (2, 1))):
        for sign, letter in ((-1.0, "lb"[axis]), (1.0, "rt"[axis])):
            for at in np.unique(X[:, axis][_on_edge(body, axis, sign)]):
                outermost = at in (lo[axis], hi[axis])
                if outermost and letter in held:
                    continue
                size = 1e-9 * (hi - lo).max()
                low, high = lo - size, hi + size
                low[axis], high[axis] = at - size, at + size
                face = box(tuple(map(float, low)), tuple(map(float, high)))
                loads.append(traction(face, x=pull(a, sign), y=pull(b, sign)))
    bx, by = patch_body(field)
    forces = [body_force(ALL, x=bx, y=by)] if field == "quadratic" else []
    return Scene(
        body,
        Elastic(1.0, 0.3, "plane stress"),
        supports=supports,
        loads=loads + forces,
        resolution=_kernels(resolution),
    )


def _on_edge(body: Cloud, axis: int, sign: float) -> np.ndarray:
    """Nodes on edges that look along an axis."""
    rim: Any = body.rim
    hit = sign * np.asarray(rim.normal)[:, axis] > 0.999
    return np.asarray(rim.node)[hit]


def patch_body(field: str, nu: float = 0.3) -> tuple[float, float]:
    """Body force x, y that balances the stresses of `patch`."""
    here = np.zeros((1, 2))
    step = np.eye(2)
    slope = [
        (patch_stress(here + e, field, nu) - patch_stress(here, field, nu))[0]
        for e in step
    ]
    return float(-slope[0][0] - slope[1][2]), float(-slope[0][2] - slope[1][1])
