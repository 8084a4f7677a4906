"""Paper 004's statements one by one, and refinement of irregular nodes."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from _report import Report
from _rkpm_core import CELLS, NAMES, Answer, answers, median, number

from jaxpd.gallery.kernels import (
    bar_exact,
    cantilever,
    cantilever_exact,
    kernel_bar,
    kirsch_exact,
    plate_under_tension,
)

BAR = ("NI", "NIS", "MNI", "GI", "QCNI")
SHAPES = tuple((2 * k + 1, k + 1) for k in (2, 4, 6, 8, 12, 16))
HOLES = ((7, 7), (9, 9), (13, 13), (17, 17), (25, 25))
FIVE, THREE = range(5), range(3)
REFINED = ("QCNI", "V2-MNI", "Q2-MNI", "VC-MNI", "SCNI", "QC3", "GI", "MNI")
#: Figures of the findings (a study in NumPy of the same schemes), not of this run: name
#: of a row, then of a scheme.
FINDINGS = {
    "bar, 2.1 h": {"NI": 0.13, "NIS": 3.3e-2, "MNI": 2.9e-4, "GI": 2.8e-4},
    "bar, 2.1 h, sawtooth": {"NI": 0.11, "NIS": 2.9e-2},
    "bar, jitter .35": {"NI": 0.28, "NIS": 7.7e-2, "MNI": 7.3e-2, "GI": 6.1e-4},
    "cantilever 15": {"GI": 1.1e-2, "NI": 0.289, "NIS": 0.299, "MNI": 2.9e-2,
        "SCNI": 0.158, "NSNI": 0.37, "VC-MNI": 2.8e-2, "Q2-MNI": 1e-2},
    "cantilever 45": {"GI": 2.3e-4, "NI": 0.104, "NIS": 0.105, "MNI": 4.6e-3,
        "SCNI": 5.4e-2, "NSNI": 0.143, "VC-MNI": 2.9e-3, "Q2-MNI": 3.4e-3},
    "cantilever 91": {"GI": 1.6e-4, "NI": 5.1e-2, "NIS": 5.2e-2, "MNI": 2e-3,
        "SCNI": 2.6e-2, "NSNI": 7.3e-2, "VC-MNI": 1.1e-3, "Q2-MNI": 1.8e-3},
    "cantilever 153": {"GI": 1.2e-4, "NI": 3e-2, "NIS": 3e-2, "MNI": 1.1e-3,
        "SCNI": 1.5e-2, "NSNI": 4.4e-2, "VC-MNI": 5.4e-4, "Q2-MNI": 1e-3},
    "cantilever 325": {"GI": 6.4e-5, "NI": 1.4e-2, "NIS": 1.4e-2, "MNI": 4.9e-4,
        "SCNI": 7e-3, "NSNI": 2e-2, "VC-MNI": 2.1e-4, "Q2-MNI": 4.7e-4},
    "cantilever 561": {"GI": 3.8e-5, "NI": 8e-3, "NIS": 8.1e-3, "MNI": 2.7e-4,
        "SCNI": 4e-3, "NSNI": 1.2e-2, "VC-MNI": 1.2e-4, "Q2-MNI": 2.6e-4},
    "cantilever 91, jitter .1": {"NI": 1.73e-2, "NIS": 3.4e-2, "MNI": 5.3e-3,
        "GI": 2.9e-4},
    "cantilever 91, jitter .3": {"NI": 0.193, "NIS": 1.4e-2, "MNI": 2.3e-2,
        "GI": 6.4e-4, "SCNI": 2.7e-2, "VC-MNI": 5.3e-3, "Q2-MNI": 1.7e-3,
        "V2-MNI": 9.2e-3},
    "hole 49": {"MNI": 1.55e-2, "NIS": 2.95e-2, "GI": 7.6e-3, "Q2-MNI": 1.6e-2},
    "hole 81": {"MNI": 1.38e-2, "NIS": 1.96e-2, "VC-MNI": 1.1e-2, "V2-MNI": 1.4e-2,
        "Q2-MNI": 9.9e-3},
    "hole 169": {"MNI": 1.31e-2, "NIS": 1.28e-2, "VC-MNI": 1.7e-2, "V2-MNI": 1.2e-2,
        "Q2-MNI": 6.3e-3},
    "hole 289": {"MNI": 1.27e-2, "NIS": 1.21e-2, "GI": 8.7e-4, "SCNI": 3.9e-3,
        "VC-MNI": 1.6e-2, "V2-MNI": 8.2e-3, "Q2-MNI": 4.6e-3},
    "hole 625": {"MNI": 1e-2, "NIS": 9.8e-3, "VC-MNI": 1.3e-2, "V2-MNI": 5.4e-3,
        "Q2-MNI": 3.4e-3},
    "hole 81, jitter .3": {"MNI": 7e-2, "VC-MNI": 8.7e-3, "V2-MNI": 6.5e-3,
        "Q2-MNI": 1.5e-2},
    "hole 289, jitter .3": {"MNI": 5.3e-2, "VC-MNI": 6.9e-3, "V2-MNI": 3.8e-3,
        "Q2-MNI": 8.8e-3},
    "hole 625, jitter .3": {"NI": 0.75, "NIS": 0.21, "MNI": 7.6e-2, "VC-MNI": 4.2e-3,
        "V2-MNI": 1.8e-3, "Q2-MNI": 4.6e-3},
    "hole 289, SCF": {"MNI": 3.33, "V2-MNI": 3.01},
    "hole 625, SCF": {"MNI": 2.54, "V2-MNI": 3.0},
    "hole 289, jitter .3, SCF": {"MNI": 1.33, "V2-MNI": 2.88},
    "hole 625, jitter .3, SCF": {"MNI": 2.0, "V2-MNI": 3.02, "Q2-MNI": 3.01},
    "refined 91": {"GI": 6.1e-4, "SCNI": 2.7e-2, "MNI": 2.3e-2, "VC-MNI": 4.8e-3,
        "Q2-MNI": 1.7e-3, "V2-MNI": 9.2e-3},
    "refined 153": {"GI": 7.3e-4, "SCNI": 1.7e-2, "MNI": 2.5e-2, "VC-MNI": 5.6e-3,
        "Q2-MNI": 1.5e-3},
    "refined 325": {"GI": 4.1e-4, "SCNI": 7.3e-3, "MNI": 3.1e-2, "VC-MNI": 2.8e-3,
        "Q2-MNI": 1.2e-3, "V2-MNI": 2.3e-3},
    "refined 561": {"GI": 2.1e-4, "SCNI": 5e-3, "MNI": 4.6e-2, "VC-MNI": 1.4e-3,
        "Q2-MNI": 4.4e-4, "V2-MNI": 1.7e-3},
}  # fmt: skip
Found = dict[str, dict[str, float]]
NOTE = "lines 'findings' are constants of an earlier study, beside those of this run"


def sawtooth(X: Any, found: Answer) -> float:
    """Largest quarter of a second difference of the error over the largest answer."""
    want = bar_exact(X)
    off = (found.u - want)[:, 0]
    return float(np.abs(np.diff(off, 2)).max() / 4.0 / np.abs(want).max())


def bars(found: Found, seeds: int) -> None:
    """The bar of section 5.1, 11 nodes."""
    for name in BAR:
        how = {"scheme": name, "support": 2.1}
        (one,) = answers(kernel_bar, bar_exact, [(0.0, 0)], **how)
        assert not isinstance(one, str)
        put(found, "bar, 2.1 h", name, one[1].error)
        put(found, "bar, 2.1 h, sawtooth", name, sawtooth(one[0].X, one[1]))
        cases = [(0.35, s) for s in range(seeds)]
        got = answers(kernel_bar, bar_exact, cases, scheme=name, support=3.0)
        put(found, "bar, jitter .35", name, median(got))


def put(found: Found, row: str, scheme: str, value: float) -> None:
    """Keep a figure."""
    found.setdefault(row, {})[scheme] = value


@lru_cache
def beams(name: str, shape: tuple[int, int]) -> dict[float, float]:
    """Median errors of the cantilever by its jitter; all of a shape compile once."""
    cases = {0.0: [0], 0.3: THREE}
    if shape == SHAPES[2]:
        cases |= {0.1: FIVE, 0.3: FIVE}
    every = [(jitter, s) for jitter, seeds in cases.items() for s in seeds]
    got = answers(partial(cantilever, shape), cantilever_exact, every, scheme=name)
    pairs = list(zip(every, got, strict=True))
    return {
        jitter: median([g for (j, _), g in pairs if j == jitter]) for jitter in cases
    }


def holes(found: Found, name: str, shape: tuple[int, int]) -> None:
    """Error and stress concentration, regular and jittered."""
    got = answers(
        partial(plate_under_tension, shape), kirsch_exact, [(0.0, 0), (0.3, 0)],
        scheme=name,
    )  # fmt: skip
    n = shape[0] * shape[1]
    for label, one in zip(("", ", jitter .3"), got, strict=True):
        put(found, f"hole {n}{label}", name, median([one]))
        if not isinstance(one, str):
            problem, done = one
            slope = np.asarray(problem.at([[0.0, 1.0]], done.unknowns)[1])[0]
            scf = (slope[0, 0] + 0.3 * slope[1, 1]) / (1.0 - 0.3**2)
            put(found, f"hole {n}{label}, SCF", name, float(scf))


def report_paper(quick: bool) -> None:
    """Every statement of the paper, beside the findings."""
    report, found = Report("paper_rkpm_paper", quick), {}
    bars(found, 2 if quick else 8)
    names = ("QCNI", "NI", "MNI") if quick else NAMES
    for name in names:
        for shape in (SHAPES[2],) if quick else SHAPES:
            got = beams(name, shape)
            n = shape[0] * shape[1]
            put(found, f"cantilever {n}", name, got[0.0])
            if shape == SHAPES[2]:
                for jitter in (0.1, 0.3):
                    row = f"cantilever {n}, jitter {jitter}".replace("0.", ".")
                    put(found, row, name, got[jitter])
        for shape in () if quick else HOLES:
            holes(found, name, shape)
        print(name, {k: f"{v[name]:.3g}" for k, v in found.items() if name in v})
    judge(report, found, quick)
    report.notes.append(NOTE)
    report.notes.append(
        "bars: 11 nodes, jitter .35 with supports of 3, medians of 8 seeds; sawtooth: "
        "largest quarter of a second difference of the error over the largest answer; "
        "cantilever under jitter: medians of 5 seeds; hole: graded, jitter of one seed"
    )
    write(report, found)
    if not quick:
        draw(report, found)


def judge(report: Report, found: Found, quick: bool) -> None:
    """The statements, as far as they hold."""
    bar, saw = found["bar, 2.1 h"], found["bar, 2.1 h, sawtooth"]
    report.claim("bar: NI oscillates", saw["NI"], 5e-2, ">=")
    report.claim("bar: sawtooth of NIS over NI's", saw["NIS"] / saw["NI"], 1 / 3)
    for name in ("MNI", "GI", "QCNI"):
        report.claim(f"bar: {name}, error", bar[name], 1e-3)
    one = found["cantilever 91"]
    report.claim("cantilever 91: MNI", one["MNI"], 4e-3)
    report.claim("cantilever 91: QCNI", one["QCNI"], 1e-3)
    report.claim("cantilever 91: NI", one["NI"], (3e-2, 8e-2), "within")
    one = found["cantilever 91, jitter .3"]
    report.claim("the same, jitter .3: MNI", one["MNI"], 4e-2)
    report.claim("the same, jitter .3: QCNI", one["QCNI"], 4e-3)
    if quick:
        return
    falls = found["cantilever 91"]["MNI"] / found["cantilever 561"]["MNI"]
    order = float(np.log(falls) / np.log(32 / 12))
    report.claim("cantilever regular: order of MNI, 91 to 561", order, 1.8, ">=")
    ratio = max(found[f"cantilever {n}"]["MNI"] / found[f"cantilever {n}"]["NIS"]
                for n in (15, 45, 91, 153, 325, 561))  # fmt: skip
    report.claim("cantilever regular: MNI over NIS, most", ratio, 0.15)
    one = found["cantilever 91, jitter .3"]
    text = "cantilever 91, jitter .3: MNI over NIS (the paper: below 1)"
    report.claim(text, one["MNI"] / one["NIS"], 1.0)
    report.claim("hole 289: GI", found["hole 289"]["GI"], 2e-3)
    report.claim("hole 289: MNI", found["hole 289"]["MNI"], 2e-2)
    ratio = found["hole 625"]["MNI"] / found["hole 289"]["MNI"]
    report.claim("hole 625: MNI over its error at 289 (stalls)", ratio, 0.6, ">=")
    one = found["hole 625, jitter .3"]
    report.claim("hole 625, jitter .3: MNI", one["MNI"], 3e-2, ">=")
    for name in ("QCNI", "V2-MNI", "Q2-MNI"):
        for row, most in (("hole 289", 1.2e-2), ("hole 625, jitter .3", 4e-3)):
            report.claim(f"{row}: {name}", found[row][name], most)
    for row in ("hole 625, SCF", "hole 625, jitter .3, SCF"):
        report.claim(f"{row}: QCNI off 3", abs(found[row]["QCNI"] / 3 - 1), 2e-2)


def write(report: Report, found: Found) -> None:
    """Tables of rows by schemes, findings beneath."""
    names = [n for n in NAMES if any(n in row for row in found.values())]
    lines = []
    for row, values in found.items():
        report.rows.append({"row": row} | {k: number(v) for k, v in values.items()})
        lines.append([row, *(values.get(n) for n in names)])
        known = FINDINGS.get(row)
        if known:
            report.rows[-1]["findings"] = known
            lines.append(["findings", *(known.get(n) for n in names)])
    report.finish(("error", *names), lines)


def draw(report: Report, found: Found) -> None:
    """Errors over the number of nodes."""
    figure, axes = plt.subplots(1, 3, figsize=(13, 4.2), layout="constrained")
    many = [s[0] * s[1] for s in SHAPES], [s[0] * s[1] for s in HOLES]
    for axis, body, n, end in (
        (axes[0], "cantilever", many[0], ""),
        (axes[1], "hole", many[1], ""),
        (axes[2], "hole", many[1], ", jitter .3"),
    ):
        for name in NAMES:
            y = [found[f"{body} {k}{end}"].get(name, np.nan) for k in n]
            style = "s--" if name in CELLS else "o-"
            axis.loglog(n, y, style, label=name, ms=4, lw=2 if name == "QCNI" else 1)
        axis.set(xlabel="nodes", ylabel="u error", title=f"{body}{end}")
        axis.grid(alpha=0.3)
    axes[0].legend(fontsize=7, ncols=2)
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)


def report_refinement(quick: bool) -> None:
    """Irregular nodes, refined at one jitter: what converges."""
    report, found = Report("paper_rkpm_refinement", quick), {}
    names = ("QCNI", "MNI") if quick else REFINED
    shapes = SHAPES[2:4] if quick else SHAPES[2:]
    size = [1.0 / (shape[1] - 1) for shape in shapes]
    order: dict[str, float] = {}
    for name in names:
        errors = [beams(name, shape)[0.3] for shape in shapes]
        for shape, error in zip(shapes, errors, strict=True):
            put(found, f"refined {shape[0] * shape[1]}", name, error)
        order[name] = float(np.polyfit(np.log(size), np.log(errors), 1)[0])
        put(found, "order", name, order[name])
        print(name, errors, order[name], flush=True)
    report.claim("order of QCNI in h", order["QCNI"], 1.5, ">=")
    report.claim("order of MNI in h: does not converge", order["MNI"], 0.5)
    for name in ("V2-MNI", "Q2-MNI", "VC-MNI"):
        if name in order:
            falls = found["refined 561"][name] / found["refined 91"][name]
            report.claim(f"{name}: error at 561 over that at 91", falls, 0.5)
    report.notes += [NOTE, "cantilever, jitter .3, medians of 3 seeds, 5 at 91"]
    figure, axis = plt.subplots(figsize=(5.5, 4.2), layout="constrained")
    for name in names:
        y = [found[f"refined {s[0] * s[1]}"][name] for s in shapes]
        style = "s--" if name in CELLS else "o-"
        axis.loglog(size, y, style, label=f"{name}, order {order[name]:.1f}")
    axis.set(xlabel="h (m)", ylabel="u error", title="cantilever, jitter .3")
    axis.legend(fontsize=8)
    figure.savefig(report.picture(), dpi=130)
    plt.close(figure)
    write(report, found)
