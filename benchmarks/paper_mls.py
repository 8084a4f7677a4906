"""MLS difference elastoplasticity (paper 001): its tests, and bodies it does not have.

Parts, all or those that are named:

    derivatives  Fig. 1: second derivatives, and what the double derivative cannot see
    bars         the bars of sections 4.2 and 4.3 against their closed forms
    ring         a cylinder under pressure: jitter, refinement, the paper's form
    tangents     iterations of consistent and continuum tangents
    plates       plate with a hole and Cook's panel against finite elements
    volume       elastic, nearly incompressible: volumes at nodes or projected
    cost         time of the ring beside finite elements
"""

from __future__ import annotations

import os

# one BLAS thread for every method: two of them wait for each other on a busy machine
os.environ["OPENBLAS_NUM_THREADS"] = "1"

import argparse
import time

import jax

jax.config.update("jax_enable_x64", True)

from _mls_bars import report_bars, report_derivatives  # noqa: E402
from _mls_plates import report_plates, report_volume  # noqa: E402
from _mls_ring import report_cost, report_ring, report_tangents  # noqa: E402

PARTS = {
    "derivatives": report_derivatives,
    "bars": report_bars,
    "ring": report_ring,
    "tangents": report_tangents,
    "plates": report_plates,
    "volume": report_volume,
    "cost": report_cost,
}


def main() -> None:
    """The parts that were asked for."""
    first = (__doc__ or "").splitlines()[0]
    parser = argparse.ArgumentParser(description=first)
    parser.add_argument("parts", nargs="*", metavar="part", help=", ".join(PARTS))
    parser.add_argument("--quick", action="store_true", help="a part, under 45 s")
    asked = parser.parse_args()
    odd = set(asked.parts) - set(PARTS)
    if odd:
        parser.error(f"{sorted(odd)} must be of {sorted(PARTS)}")
    quick = ("derivatives", "ring")
    for name in asked.parts or (quick if asked.quick else PARTS):
        print(f"-- {name}", flush=True)
        start = time.perf_counter()
        PARTS[name](asked.quick)
        print(f"({time.perf_counter() - start:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
