"""Bodies of kernels for `paper_rkpm`: solved on the host, lists padded to compile once.

Jittered bodies of one shape differ in the widths of their lists alone; padded to the
widest they share compiled code. Slots added carry no weight.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd import RKPM, prepare
from jaxpd.discretize.layout import CellLayout, Slots
from jaxpd.discretize.schemes import SCHEMES
from jaxpd.galerkin import GalerkinProblem, first_tangent, operator_of
from jaxpd.scene import Scene
from jaxpd.solvers.direct import solve_free

NAMES = tuple(SCHEMES)
#: Background cells; all others are made from nodes and outline alone.
CELLS = ("GI", "QC3")
#: Nodes alone, and the quadratic patch test passed.
RIVALS = ("QCNI", "V2-MNI", "Q2-MNI")
Case = tuple[float, int]


@dataclass(frozen=True)
class Answer:
    """A linear body, solved.

    Attributes:
        u: displacements of the nodes [n, d] (m).
        unknowns: [n, d] (m).
        error: root mean square over the nodes, relative.
    """

    u: np.ndarray
    unknowns: np.ndarray
    error: float


def widths(layout: CellLayout) -> tuple[int, int]:
    """Of the lists of places and of cells."""
    return layout.cover.nbr.shape[0], layout.nodes_of.shape[0]


def padded(problem: GalerkinProblem, width: tuple[int, int]) -> GalerkinProblem:
    """The problem with lists of given widths."""
    layout = problem.layout
    k, K = widths(layout)
    more, cells = width[0] - k, width[1] - K
    if more <= 0 and cells <= 0:
        return problem

    def wider(x: jax.Array, rows: int) -> jax.Array:
        return jnp.concatenate([x, *[x[:1]] * rows])

    def slots(s: Slots) -> Slots:
        slot = jnp.where(s.slot >= K, K + cells, s.slot)
        slot = jnp.pad(slot, ((0, more), (0, 0)), constant_values=K + cells)
        return dataclasses.replace(s, slot=slot)

    cover = dataclasses.replace(
        layout.cover,
        nbr=wider(layout.cover.nbr, more),
        there=jnp.pad(layout.cover.there, ((0, more), (0, 0))),
    )
    layout = dataclasses.replace(
        layout,
        cover=cover,
        nodes_of=wider(layout.nodes_of, cells),
        within=slots(layout.within),
        beside=tuple(slots(s) for s in layout.beside),
        along=None if layout.along is None else slots(layout.along),
    )
    return dataclasses.replace(problem, layout=layout)


def level(problems: Sequence[GalerkinProblem]) -> list[GalerkinProblem]:
    """All of them with the widths of the widest."""
    every = [widths(p.layout) for p in problems]
    most = (max(k for k, _ in every), max(K for _, K in every))
    return [padded(p, most) for p in problems]


def answer(problem: GalerkinProblem, exact: Callable[[Any], np.ndarray]) -> Answer:
    """Assembled and factorised on the host."""
    system = assembled(problem)
    x = solve_free(*system[:3], symmetric=problem.layout.scheme.symmetric)
    return finished(problem, system, x, exact)


def assembled(problem: GalerkinProblem) -> tuple[Any, ...]:
    """Stiffness, held components, right side, prescribed values, operator."""
    operator: Any = operator_of(problem, problem.params)
    K = first_tangent(operator).to_bsr()
    operator = jax.tree.map(np.asarray, operator)
    moved = np.asarray(problem.params["prescribed"]).sum(axis=0)
    held = np.asarray(problem.fixed)
    g = np.where(held, moved, 0.0)
    load = operator.loads.sum(axis=0)
    back = rows(operator, g.shape)
    load = load if back is None else (back.T @ load.ravel()).reshape(g.shape)
    b = np.where(held, 0.0, load - (K @ g.ravel()).reshape(g.shape))
    return K, held, b, g, operator


def rows(operator: Any, shape: tuple[int, ...]) -> Any:
    """Unknowns to coefficients, a matrix; None where they are the same."""
    n, d = shape
    return operator.essential.matrix(n, d) if len(operator.essential.held) else None


def finished(
    problem: GalerkinProblem, system: tuple[Any, ...], x: np.ndarray, exact: Any
) -> Answer:
    """What came of a solution x."""
    g, operator = system[3:]
    unknowns = g + x
    E = rows(operator, g.shape)
    a = unknowns if E is None else (E @ unknowns.ravel()).reshape(g.shape)
    w = operator.weights
    u = np.einsum("kn,kna->na", w.value, a[w.near])
    want = exact(problem.X)
    return Answer(u, unknowns, float(np.linalg.norm(u - want) / np.linalg.norm(want)))


def made(
    scene: Callable[..., Scene], cases: Sequence[Case], **how: Any
) -> list[GalerkinProblem | str]:
    """Problems of jitters and seeds, of one width; or why there is none."""
    resolution, out = RKPM(**how), []
    for jitter, seed in cases:
        try:
            body = scene(jitter=jitter, seed=seed, resolution=resolution)
            out.append(prepare(body, solver="direct"))
        except ValueError as why:
            out.append(str(why))
    good = [p for p in out if not isinstance(p, str)]
    wide = iter(level(good) if good else [])
    return [p if isinstance(p, str) else next(wide) for p in out]


def answers(
    scene: Callable[..., Scene], exact: Any, cases: Sequence[Case], **how: Any
) -> list[tuple[GalerkinProblem, Answer] | str]:
    """The same, solved."""
    out: list[tuple[GalerkinProblem, Answer] | str] = []
    for problem in made(scene, cases, **how):
        if isinstance(problem, str):
            out.append(problem)
        else:
            out.append((problem, answer(problem, exact)))
    return out


def median(found: Sequence[tuple[GalerkinProblem, Answer] | str]) -> float:
    """Of the errors; infinite where one broke down."""
    errors = [np.inf if isinstance(f, str) else f[1].error for f in found]
    return float(np.median(np.nan_to_num(errors, nan=np.inf)))


def number(x: float | None) -> float | None:
    """For JSON, which knows no infinity."""
    return x if x is not None and np.isfinite(x) else None
