"""Work and error on Lame's ring, for methods that know no cracks: nodes, elements.

Internal pressure, plane strain, a quarter; error of the displacements, root mean square
over the nodes, against the closed form. Times are warm, compilation apart.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import matplotlib.pyplot as plt
import numpy as np
from _plastic_peer import Material, quarter_annulus, solve
from _report import Report, median_seconds

from jaxpd import MLS, RKPM, prepare
from jaxpd.gallery import pressed_ring
from jaxpd.physics import Hooke

E, NU, P = 2.1e5, 0.3, 60.0
Shape = tuple[int, int]


@dataclass(frozen=True)
class Sample:
    """One method at one size.

    Attributes:
        unknowns: size of the linear system.
        error: of the displacements, relative.
        setup: warm seconds of everything that is done once a scene.
        solve: warm seconds of the solve; of elements set-up and solve together.
        compile: seconds of the first run beyond that.
    """

    unknowns: int
    error: float
    setup: float
    solve: float
    compile: float


def error_of(X: np.ndarray, u: np.ndarray) -> float:
    """Root mean square error of u [n, 2], relative."""
    r = np.linalg.norm(X, axis=1, keepdims=True)
    exact = P / 3.0 * (1 + NU) / E * ((1 - 2 * NU) * r + 4.0 / r) * X / r
    return float(np.linalg.norm(u - exact) / np.linalg.norm(exact))


def nodes(resolution: MLS | RKPM) -> Callable[[Shape, int], Sample]:
    """Nodes in the strong or the weak form; sparse LU."""

    def run(shape: Shape, repeats: int) -> Sample:
        law = Hooke(E, NU, "plane strain")
        scene = pressed_ring(shape, P, law=law, resolution=resolution)

        def make() -> Any:
            problem = prepare(scene, solver="direct")
            return jax.block_until_ready(problem.params["X"]) is not None, problem

        start = time.perf_counter()
        _, problem = make()
        jax.block_until_ready(problem.solve()[0])
        cold = time.perf_counter() - start
        start = time.perf_counter()
        for _ in range(repeats):
            _, problem = make()
        setup = (time.perf_counter() - start) / repeats
        seconds, (u, info) = median_seconds(problem.solve, repeats)
        if info.status != 0:
            raise RuntimeError(f"ring {shape}: status {int(info.status)}")
        error = error_of(np.asarray(problem.X), np.asarray(u))
        unknowns = int((~np.asarray(problem.fixed)).sum())
        spent = setup + seconds
        return Sample(unknowns, error, setup, seconds, max(0.0, cold - spent))

    return run


def elements(shape: Shape, repeats: int) -> Sample:
    """Quadrilaterals of eight nodes (scikit-fem), one elastic step."""
    law, fixed = Material(E, NU), [("bottom", 1, 0.0), ("left", 0, 0.0)]
    mesh = quarter_annulus(*shape)
    times, run = [], None
    for _ in range(repeats + 1):
        start = time.perf_counter()
        run = solve(mesh, law, fixed, [("inner", P)], [1.0])
        times.append(time.perf_counter() - start)
    assert run is not None
    X = run.basis.doflocs[:, ::2].T
    u = np.stack([run.u[-1, ::2], run.u[-1, 1::2]], axis=1)
    held = run.u.shape[1] - len(X[:, 0][X[:, 0] < 1e-9]) - len(X[X[:, 1] < 1e-9])
    return Sample(held, error_of(X, u), 0.0, float(np.median(times[1:])), 0.0)


#: Stresses of derivatives, derived again.
STRONG = {k: nodes(MLS(degree=k, scheme="double")) for k in (2, 3)}
#: The default, one that is not symmetric, paper 004's, and background cells.
WEAK = ("QCNI", "V2-MNI", "MNI", "GI")
GRIDS = ((11, 25), (16, 37), (21, 49), (31, 73))
METHODS: dict[str, tuple[Callable[[Shape, int], Sample], tuple[Shape, ...]]] = {
    "MLS, degree 2": (STRONG[2], GRIDS),
    "MLS, degree 3": (STRONG[3], GRIDS),
    **{f"RKPM, {name}": (nodes(RKPM(scheme=name)), GRIDS) for name in WEAK},
    "FE, 8-node": (elements, ((2, 4), (4, 8), (8, 16), (16, 32), (32, 64))),
}


def compare_ring(quick: bool) -> None:
    """Run every method on the ring, draw the chart."""
    report, lines = Report("work_precision_ring", quick), []
    figure, axis = plt.subplots(figsize=(6, 4.5), layout="constrained")
    for name, (run, sizes) in METHODS.items():
        rows = []
        for shape in sizes[:1] if quick and name[:2] != "FE" else sizes:
            s = run(shape, 2)
            row = {"method": name, "shape": list(shape)} | vars(s)
            rows.append(row | {"seconds": s.setup + s.solve})
            size = "x".join(map(str, shape))
            cells = [s.unknowns, s.error, s.setup, s.solve, s.compile]
            lines.append([name, size, *cells])
        report.rows += rows
        x, y = ([r[k] for r in rows] for k in ("seconds", "error"))
        axis.loglog(x, y, "o-", label=name)
    add_claims(report, quick)
    axis.set(xlabel="wall time, set-up and solve, warm (s)", ylabel="u error")
    axis.set_title("Lame's ring, work and error")
    axis.grid(which="both", alpha=0.2)
    axis.legend()
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    head = ("method", "size", "unknowns", "u error", "set-up s", "solve s", "compile s")
    report.finish(head, lines)


def add_claims(report: Report, quick: bool) -> None:
    """Orders, and time beside that of finite elements at no larger error."""
    ours = [r for r in report.rows if "MLS" in r["method"]]
    peer = [r for r in report.rows if r["method"][:2] == "FE"]
    ratios = []
    for r in ours:
        equal = [q["seconds"] for q in peer if q["error"] <= r["error"]]
        if equal:
            ratios.append(r["seconds"] / min(equal))
    text = "time over that of finite elements at no larger error, least"
    report.claim(text, min(ratios, default=np.nan), 1.0, ">=")
    if quick:
        return
    for degree in (2, 3):
        rows = [r for r in ours if r["method"].endswith(str(degree))]
        h = [1.0 / (r["shape"][0] - 1) for r in rows]
        fit = np.polyfit(np.log(h), np.log([r["error"] for r in rows]), 1)
        report.claim(f"degree {degree}: order of the u error", fit[0], 1.7, ">=")
