"""A bar for what takes long, by tqdm where it is installed."""

from __future__ import annotations

import sys
from collections.abc import Iterator


def bar(
    steps: range, total: int, wanted: bool | None, unit: str = "step"
) -> Iterator[int]:
    """The steps, with a bar; None shows it on a terminal."""
    if wanted is None:
        wanted = sys.stderr.isatty()
    if not wanted:
        return iter(steps)
    try:
        from tqdm import tqdm  # noqa: PLC0415
    except ModuleNotFoundError:
        return iter(steps)
    return iter(tqdm(steps, total=total, initial=steps.start, unit=unit))
