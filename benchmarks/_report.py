"""What every benchmark shares: claims, one table, one JSON and one picture a script.

A full run writes `results/NAME.json`; `--quick` writes `NAME.quick.json`, which is not
kept. Times are medians of repeats after a warm-up, with results waited for.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"
PACKAGES = ("jax", "jaxlib", "numpy", "scipy", "pyamg", "jaxpd")

Bound = float | tuple[float, float]


def is_quick(description: str | None) -> bool:
    """Read the command line: whether `--quick` was asked for."""
    first = (description or "").strip().splitlines()[0]
    parser = argparse.ArgumentParser(description=first)
    parser.add_argument("--quick", action="store_true", help="a part, under 45 s")
    return parser.parse_args().quick


def asked_part() -> dict[str, Any] | None:
    """The part and the arguments that a fresh process was started for, if it was."""
    return json.loads(sys.argv[2]) if sys.argv[1:2] == ["--part"] else None


def fresh(script: str, part: str, **arguments: Any) -> dict[str, Any]:
    """Run one part of a script in a fresh process, alone; it prints JSON.

    What the process says on stderr is shown only if it fails: with kept code JAX may
    print long harmless lines.
    """
    asked = json.dumps({"part": part} | arguments)
    done = subprocess.run(
        [sys.executable, script, "--part", asked],
        capture_output=True,
        text=True,
    )
    if done.returncode:
        raise RuntimeError(
            f"{asked} ended with {done.returncode}:\n{done.stderr[-2000:]}"
        )
    return json.loads(done.stdout.strip().splitlines()[-1])


def median_seconds(call: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    """Median wall time (s) of repeated calls after one warm-up, and the last result."""
    result = jax.block_until_ready(call())
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = jax.block_until_ready(call())
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def table(head: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    """A plain table, columns aligned to the right; None is a dash."""
    cells = [list(head), *([_text(x) for x in row] for row in rows)]
    width = [max(len(row[c]) for row in cells) for c in range(len(head))]
    return "\n".join(
        "  ".join(x.rjust(w) for x, w in zip(row, width, strict=True)).rstrip()
        for row in cells
    )


def _text(x: Any) -> str:
    if x is None:
        return "-"
    return f"{x:.4g}" if isinstance(x, float) else str(x)


@dataclass
class Report:
    """Claims and rows of one benchmark.

    Attributes:
        name: of the script; names the files.
        quick: whether this is a quick run.
        claims: what was claimed, and whether it holds.
        rows: the measurements.
        notes: what a reader must know to judge the rows.
    """

    name: str
    quick: bool
    claims: list[dict[str, Any]] = field(default_factory=list)
    rows: list[dict[str, Any]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    load: float = field(default_factory=lambda: os.getloadavg()[0])

    def claim(self, claim: str, value: float, bound: Bound, sense: str = "<=") -> None:
        """Add a claim.

        Args:
            claim: what is claimed, in words.
            value: what was measured.
            bound: the limit; (low, high) for "within".
            sense: "<=", ">=" or "within".
        """
        value = float(value)
        if isinstance(bound, tuple):
            holds = sense == "within" and bound[0] <= value <= bound[1]
        else:
            holds = value <= bound if sense == "<=" else value >= bound
        self.claims.append(
            {
                "claim": claim,
                "value": value if math.isfinite(value) else None,
                "bound": list(bound) if isinstance(bound, tuple) else bound,
                "sense": sense,
                "holds": holds,
            }
        )

    def picture(self) -> Path:
        """Path of the picture."""
        RESULTS.mkdir(exist_ok=True)
        return RESULTS / f"{self.name}{'.quick' if self.quick else ''}.png"

    def finish(self, head: Sequence[str], lines: Sequence[Sequence[Any]]) -> None:
        """Print the table and the claims, and write the JSON."""
        print(table(head, lines))
        for note in self.notes:
            print(f"note: {note}")
        for c in self.claims:
            mark = "holds  " if c["holds"] else "DOES NOT HOLD"
            value = "nan" if c["value"] is None else f"{c['value']:.4g}"
            print(f"{mark} {c['claim']}: {value} ({c['sense']} {c['bound']})")
        kept = {
            "name": self.name,
            "quick": self.quick,
            "claims": self.claims,
            "rows": self.rows,
            "notes": self.notes,
            "versions": versions(),
            "commit": commit(),
            "machine": machine() | {"load_before": round(self.load, 2)},
        }
        RESULTS.mkdir(exist_ok=True)
        ending = ".quick.json" if self.quick else ".json"
        path = RESULTS / (self.name + ending)
        path.write_text(json.dumps(kept, indent=1, allow_nan=False) + "\n")


def versions() -> dict[str, str]:
    """Versions of Python and of the packages that matter."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def commit() -> str:
    """The commit that was run, "-dirty" if files had changed, or "unknown"."""

    def git(*words: str) -> str:
        return subprocess.run(
            ["git", *words], cwd=HERE, capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        head = git("rev-parse", "--verify", "HEAD")
        return head + ("-dirty" if git("status", "--porcelain") else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def machine() -> dict[str, Any]:
    """Processors, memory and platform; nothing that names the machine."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return {
        "processors": len(os.sched_getaffinity(0)),
        "memory_GiB": round(memory, 1),
        "platform": f"{platform.system()} {platform.machine()}",
        "device": jax.devices()[0].platform,
    }
