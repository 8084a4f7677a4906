"""RKPM with nodal integration (paper 004): its statements, and what they cost.

Parts, all or those that are named:

    paper        bar, cantilever and hole, regular and irregular, beside the findings
    refinement   the cantilever at one jitter: what converges, and how fast
    cost         error against places, pairs and seconds, beside finite elements
    size         10,000 nodes: seconds and memory, in a process of its own
    cylinder     elastoplastic, weak form against strong form on the same nodes
"""

from __future__ import annotations

import os

# one BLAS thread for every method: two of them wait for each other on a busy machine
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import json
import time

import jax

jax.config.update("jax_enable_x64", True)

from _report import asked_part  # noqa: E402
from _rkpm_cost import report_cost  # noqa: E402
from _rkpm_paper import report_paper, report_refinement  # noqa: E402
from _rkpm_ring import report_cylinder  # noqa: E402
from _rkpm_size import measure, report_size  # noqa: E402

PARTS = {
    "paper": report_paper,
    "refinement": report_refinement,
    "cost": report_cost,
    "size": report_size,
    "cylinder": report_cylinder,
}


def main() -> None:
    """The parts that were asked for."""
    part = asked_part()
    if part is not None:
        part.pop("part")
        print(json.dumps(measure(**part)))
        return
    first = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(description=first)
    parser.add_argument("parts", nargs="*", metavar="part", help=", ".join(PARTS))
    parser.add_argument("--quick", action="store_true", help="a part, under 45 s")
    asked = parser.parse_args()
    odd = set(asked.parts) - set(PARTS)
    if odd:
        parser.error(f"{sorted(odd)} must be of {sorted(PARTS)}")
    for name in asked.parts or (("paper",) if asked.quick else PARTS):
        print(f"-- {name}", flush=True)
        start = time.perf_counter()
        PARTS[name](asked.quick)
        print(f"({time.perf_counter() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
