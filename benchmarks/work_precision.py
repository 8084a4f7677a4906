"""Error against wall time on problems with exact answers: every method, and its peer.

`work_precision.py [PROBLEM ...] [--quick]` runs the problems named, or all (`--quick`:
the bar), and draws all figures from the files of what was run at any time. Each problem
is a module `_wp_NAME`. Set-up and solve are timed together, warm; compilation apart.
"""

from __future__ import annotations

import os

# one BLAS thread for every method: two of them wait for each other on a busy machine
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import importlib
import json
from typing import Any

import jax
from _report import RESULTS
from _wp import draw, measure, picture

jax.config.update("jax_enable_x64", True)

NAMES = (
    "bar",
    "cantilever",
    "hole",
    "cylinder",
    "nonlocal",
    "crack",
    "layer",
    "gradient",
)


def main() -> None:
    """Run what was asked for, then the overview."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("problem", nargs="*", help=f"of {', '.join(NAMES)}; all")
    parser.add_argument(
        "--quick", action="store_true", help="the bar, two sizes a method"
    )
    given = parser.parse_args()
    for name in given.problem:
        if name not in NAMES:
            parser.error(f"problem: {name!r} must be one of {NAMES}")
    for name in given.problem or (NAMES[:1] if given.quick else NAMES):
        measure(importlib.import_module(f"_wp_{name}").PROBLEM, given.quick)
        jax.clear_caches()
    overview(given.quick)


def overview(quick: bool) -> None:
    """The figures, from the files, and one panel a problem."""
    import matplotlib.pyplot as plt

    ending = ".quick" if quick else ""
    kept: dict[str, Any] = {}
    for name in NAMES:
        path = RESULTS / f"work_precision_{name}{ending}.json"
        if path.exists():
            kept[name] = json.loads(path.read_text())["rows"]
    figure, axes = plt.subplots(2, 4, figsize=(16, 12), layout="constrained")
    for axis, (name, rows) in zip(axes.flat, kept.items(), strict=False):
        problem = importlib.import_module(f"_wp_{name}").PROBLEM
        picture(problem, rows, RESULTS / f"work_precision_{name}{ending}.png")
        draw(axis, rows, size=4.0)
        axis.set_title(problem.title, fontsize=10)
        axis.set_ylabel(problem.quantity, fontsize=8)
        axis.tick_params(labelsize=8)
        axis.set_xlabel(f"wall time, {problem.timed}, warm (s)", fontsize=8)
        axis.legend(
            fontsize=7,
            ncols=2,
            loc="upper center",
            bbox_to_anchor=(0.5, -0.14),
            frameon=False,
        )
    for axis in axes.flat[len(kept) :]:
        axis.set_axis_off()
    figure.savefig(RESULTS / f"work_precision{ending}.png", dpi=90)
    plt.close(figure)


if __name__ == "__main__":
    main()
