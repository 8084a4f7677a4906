"""Convergence of a scene: finer lattices at a fixed ratio or at a fixed horizon.

With "delta", delta and dx fall together at a fixed m = delta / dx, towards the
classical body; with "m", dx falls at a fixed delta, towards the nonlocal one; with "h",
dx falls, of nodes. What the values tell is said by `jaxpd.convergence`.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from jaxpd.checks import instance, number, numbers, whole
from jaxpd.convergence import Refinement
from jaxpd.geometry import Box
from jaxpd.resolution import NODES, Bonds
from jaxpd.run import solve_static
from jaxpd.scene import Scene


def stored(solution: Any) -> float:
    """The energy that a solution stores (J), the default quantity."""
    energy = float(np.asarray(solution.energy).sum())
    if math.isnan(energy):
        raise ValueError(
            "quantity: None; this theory, scheme or law has no stored energy: give a "
            "function of the solution, as lambda s: float(abs(s.u).max())"
        )
    return energy


def refine(
    scene: Scene | Callable[[float], Scene],
    what: str | None = None,
    *,
    quantity: Callable[[Any], float] = stored,
    exact: float | None = None,
    sizes: Sequence[float] | None = None,
    levels: int = 4,
    ratio: float = 2.0,
    solve: Callable[[Scene], Any] = solve_static,
) -> Refinement:
    """Solve a scene on finer and finer models, and say how its answer converges.

    Args:
        scene: a box with a resolution, the coarsest; or a function that makes a scene
            of a spacing (m), for bodies that are made of nodes.
        what: "delta", "m" or "h", see above; None is "delta" of bonds, "h" of nodes.
        quantity: number of a solution; by default its stored energy (J).
        exact: the limit, where it is known.
        sizes: spacings (m), falling; by default `levels` of them from the scene's own,
            each the one before over `ratio`, as far as they divide the box.
        levels: how many.
        ratio: of a spacing to the next.
        solve: what solves, as `jaxpd.solve_static` or a function of yours that returns
            anything that `quantity` understands.

    Returns:
        A `Refinement`, which prints as a table.

    Raises:
        ValueError: naming the argument, its value and the cure.
        NotConverged: if a solve fails.
    """
    if not callable(scene):
        instance("scene", scene, Scene, "a Scene(..), or a function of a spacing")
    for name, given in (("quantity", quantity), ("solve", solve)):
        if not callable(given):
            raise ValueError(f"{name}: {given!r} must be a function")
    if exact is not None:
        number("exact", exact)
    make = scene if callable(scene) else _maker(scene, what)
    if isinstance(scene, Scene):
        what = what or ("h" if isinstance(scene.resolution, NODES) else "delta")
        sizes = _spacings(scene, ratio, levels) if sizes is None else sizes
    if sizes is None:
        raise ValueError("sizes: None; a function of a spacing needs a list of them")
    h = np.asarray(numbers("sizes", sizes, above=0, cure="in m"), float)
    if h.ndim != 1 or len(h) < 2 or not (np.diff(h) < 0).all() or not (h > 0).all():
        raise ValueError(f"sizes: {sizes} must be two or more, positive and falling")
    rows, notes = [], []
    for dx in h.tolist():
        level = make(dx)
        notes += _off_rows(level)
        started = time.perf_counter()
        solution = solve(level)
        if hasattr(solution, "checked"):
            solution.checked()
        value = float(number("quantity", quantity(solution), cure=f"at dx = {dx:g}"))
        resolution = level.resolution
        delta = resolution.horizon if isinstance(resolution, Bonds) else math.nan
        points = len(solution.X) if hasattr(solution, "X") else 0
        rows.append((dx, delta, points, value, time.perf_counter() - started))
    spacings, horizons, points, values, seconds = zip(*rows, strict=True)
    told = tuple(dict.fromkeys(notes))
    return Refinement(
        what or "h", spacings, horizons, points, values, seconds, exact, told
    )


def _maker(scene: Scene, what: str | None) -> Callable[[float], Scene]:
    """Scenes with another spacing."""
    resolution = scene.resolution
    if not isinstance(scene.body, Box):
        raise ValueError(
            "scene: its body is no box, whose nodes are as far apart as they are; give "
            "a function of the spacing that makes a scene, and sizes"
        )
    bonds = isinstance(resolution, Bonds)
    known = ("delta", "m") if bonds else ("h",)
    if what is not None and what not in known:
        raise ValueError(f"what: {what!r} must be one of {known} here")
    if resolution.dx is None:
        raise ValueError(
            "scene: its resolution needs a spacing dx, the coarsest, as in "
            "Bonds(dx=1/16, m=4)"
        )
    if not bonds:
        return lambda dx: dataclasses.replace(
            scene, resolution=dataclasses.replace(resolution, dx=dx)
        )
    m, delta = resolution.horizon / resolution.dx, resolution.horizon
    fixed = {"m": m, "delta": None} if what != "m" else {"m": None, "delta": delta}
    return lambda dx: dataclasses.replace(
        scene, resolution=dataclasses.replace(resolution, dx=dx, **fixed)
    )


def _spacings(scene: Scene, ratio: float, levels: int) -> list[float]:
    """Spacings near a geometric row that divide all sides of a box."""
    number("ratio", ratio, above=1, cure="2 is common")
    levels = whole("levels", levels, 2, "better 4")
    body: Any = scene.body
    sides = np.asarray(body.hi) - np.asarray(body.lo)
    cells = np.rint(sides / scene.resolution.dx).astype(int)
    common = int(np.gcd.reduce(cells))
    unit = float(sides[0]) / (cells[0] // common)
    pieces = [max(1, round(common * ratio**k)) for k in range(levels)]
    if len(set(pieces)) < levels:
        raise ValueError(
            f"ratio: {ratio} gives the same lattice twice; take 2, or a finer start"
        )
    return [unit / k for k in pieces]


def _off_rows(scene: Scene) -> list[str]:
    """Notes on cracks that lie otherwise than midway between rows of points."""
    if not scene.cracks or not isinstance(scene.body, Box):
        return []
    dx, lo = scene.resolution.dx, np.asarray(scene.body.lo)
    shift = 0.5 if scene.resolution.nodes == "cell" else 0.0
    found = []
    for crack in scene.cracks:
        edges = np.abs(np.asarray(crack.edges))
        for axis in range(scene.d):
            ends = [crack.corner[axis]]
            if edges[:, axis].max() > 0:
                ends.append(ends[0] + float(np.asarray(crack.edges)[:, axis].sum()))
            row = (np.asarray(ends) - lo[axis]) / dx - shift
            inside = (row > 0) & (row < (scene.body.hi[axis] - lo[axis]) / dx)
            away = np.abs(row - np.floor(row) - 0.5)[inside]
            if (away > 1e-6).any():
                found.append(
                    "a crack's plane or tip is not always midway between rows: "
                    "its length jumps from level to level, and orders with it"
                )
    return found
