"""The cheapest resolution that meets a wanted accuracy or time, of those that can."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from jaxpd.geometry import Box, Cloud, HalfSpace
from jaxpd.laminate import Laminate
from jaxpd.physics import elastic as constants
from jaxpd.planner.laws import breaks, elastic, remembers
from jaxpd.resolution import MLS, RKPM, Bonds, fractional
from jaxpd.scene import Elastic, Scene

#: Spacings over the shortest side that are tried.
COUNTS = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384, 512)
#: Horizon ratios that are tried for bonds.
RATIOS = (3, 4, 6)


def theories(scene: Scene, job: str) -> tuple[list[str], str]:
    """Theories that can model a scene, and why, cheapest to state first.

    Raises:
        ValueError: naming the job, if it is load steps and the scene asks for bonds.
    """
    found, why = _theories(scene, job)
    nodes = [name for name in found if name != "bonds"]
    if job == "path" and not nodes:
        raise ValueError(
            f"job: 'path' is load steps of nodes, and this scene asks for bonds ({why})"
            ": 'static', 'motion' or 'fracture'"
        )
    return (nodes if job == "path" else found), why


def _theories(scene: Scene, job: str) -> tuple[list[str], str]:
    if isinstance(scene.body, Laminate):
        return ["bonds"], "plies joined by ghost interlayers are bonds"
    if job in ("motion", "fracture"):
        why = "motion" if job == "motion" else "cracks that grow"
        return ["bonds"], f"{why}: bonds break and have mass, nodes do not"
    if scene.cracks or scene.no_fail or scene.starts or scene.weak:
        return ["bonds"], "a crack is bonds that are absent"
    if remembers(scene.material):
        found = ["MLS", "RKPM"] if _weak(scene) else ["MLS"]
        return found, "a law of strain with a memory belongs to nodes"
    if not elastic(scene.material):
        return ["bonds"], "the law is one of a bond"
    if any(load.kind == "resultant" for load in scene.loads):
        return ["bonds"], "pull() spreads a force over the volumes of bonded points"
    nodes = ["RKPM", "MLS"] if _weak(scene) else ["MLS"]
    if scene.kinematics == "finite":
        if isinstance(scene.material, Elastic) and not _bonded(scene.material):
            raise ValueError(
                f"kinematics: 'finite' is for bonds, and nu = {scene.material.nu} is "
                "none of theirs; say kinematics='small', and nodes will do"
            )
        return ["bonds"], "finite displacements; kinematics='small' would let nodes do"
    if isinstance(scene.body, Cloud) and scene.body.rim is None:
        return ["bonds"], "a cloud without an outline"
    if any(load.kind == "pressure" for load in scene.loads):
        return nodes, "a pressure needs normals, which a rim of nodes has"
    if _bonded(scene.material):
        return [*nodes, "bonds"], "smooth and elastic: all three theories apply"
    return nodes, "Poisson's ratio is not that of a bond-based law"


def _weak(scene: Scene) -> bool:
    if isinstance(scene.body, Cloud):
        return scene.body.rim is not None and scene.d < 3
    return scene.d < 3


def _bonded(material: Any) -> bool:
    """Whether Poisson's ratio is the one that bonds have."""
    if not isinstance(material, Elastic):
        return False
    try:
        constants.check_bond_based(material.nu, material.state)
    except ValueError:
        return False
    return True


def candidates(scene: Scene, job: str, theory: str) -> Iterator[list[Any]]:
    """Resolutions of a theory, a list for each spacing, coarse to fine.

    Raises:
        ValueError: if no even lattice fits the body.
    """
    body = scene.body
    if isinstance(body, Cloud):
        yield [_on_cloud(scene, theory)]
        return
    for dx in spacings(scene, cells=theory == "bonds" and bool(scene.cracks)):
        if theory == "RKPM":
            yield [RKPM(dx=dx)]
        elif theory == "MLS":
            yield [MLS(dx=dx)]
        else:
            yield list(_bonds(scene, job, dx))


def _on_cloud(scene: Scene, theory: str) -> Any:
    body: Any = scene.body
    if theory != "bonds":
        return RKPM() if theory == "RKPM" else MLS()
    dx = float((np.asarray(body.vol).sum() / body.n) ** (1.0 / body.d))
    return Bonds(delta=3.015 * dx)


def _bonds(scene: Scene, job: str, dx: float) -> Iterator[Bonds]:
    """Bonds at a spacing: of each ratio, and with what surfaces ask for."""
    pmb = fractional(alpha=1.0 - scene.d)
    for m in RATIOS:
        plain = Bonds(dx=dx, m=m, nodes="cell" if _inside(scene) else "edge")
        if job == "motion":
            whole = "analytic" if not breaks(scene) else "none"
            yield dataclasses.replace(
                plain, kernel=pmb, partial="continuous", correction=whole
            )
        elif job == "fracture":
            yield dataclasses.replace(plain, kernel=pmb, calibration="lattice")
        else:
            yield dataclasses.replace(plain, calibration="lattice")
            yield dataclasses.replace(plain, correction="energy")
            if not scene.cracks and isinstance(scene.body, Box):
                yield dataclasses.replace(plain, correction="fictitious")


def _inside(scene: Scene) -> bool:
    """Whether points half a spacing from the faces meet all supports and loads.

    Rollers and forces that act on a face alone need points on it.
    """
    if not isinstance(scene.body, Box):
        return True
    given: list[tuple[Any, bool]] = [
        (s.region, None not in s.components[: scene.d]) for s in scene.supports
    ]
    given += [(load.region, load.kind == "traction") for load in scene.loads]
    thin = 0.5 * min(np.subtract(scene.body.hi, scene.body.lo)) / COUNTS[0]
    for region, reaches in given:
        if isinstance(region, Box) and _outside(region, scene.body, thin):
            return False
        if reaches or not isinstance(region, HalfSpace) or region.axis >= scene.d:
            continue
        lo, hi = scene.body.lo[region.axis], scene.body.hi[region.axis]
        depth = hi - region.at if region.sign > 0 else region.at - lo
        if depth < 0.5 * (hi - lo) / COUNTS[0]:
            return False
    return True


def _outside(region: Box, body: Box, thin: float) -> bool:
    """Whether a region takes no more of a body than a skin of one of its faces."""
    for a, b, lo, hi in zip(region.lo, region.hi, body.lo, body.hi, strict=True):
        if (b - lo < thin and a <= lo) or (hi - a < thin and b >= hi):
            return True
    return False


def spacings(scene: Scene, cells: bool = False) -> Iterator[float]:
    """Spacings that divide all sides of the boxes, coarse to fine.

    Args:
        scene: its body is a box or a laminate of them.
        cells: points lie in the middle of cells, so that planes of cracks at whole
            numbers of spacings lie between two rows.

    Raises:
        ValueError: if no spacing divides the sides.
    """
    body: Any = scene.body
    boxes = body.plies if isinstance(body, Laminate) else (body,)
    lengths = [hi - lo for b in boxes for lo, hi in zip(b.lo, b.hi, strict=True)]
    if cells:
        lengths += [x for crack in scene.cracks for x in _offsets(crack, body)]
    lengths = [x for x in lengths if x > 1e-9 * max(lengths)]
    unit = _common(lengths)
    least = min(hi - lo for b in boxes for lo, hi in zip(b.lo, b.hi, strict=True))
    if least / unit > 2 * COUNTS[-1]:
        raise ValueError(
            f"body: its sides (and cracks) {sorted(set(map(float, lengths)))} have no "
            "common spacing; round them, or say resolution=Bonds(dx=.., m=..)"
        )
    seen = set()
    for count in COUNTS:
        pieces = max(1, math.ceil(count * unit / least - 1e-9))
        if pieces not in seen:
            seen.add(pieces)
            yield unit / pieces


def _offsets(crack: Any, body: Any) -> list[float]:
    """Distances of a crack's plane from the body's corner, if it lies along an axis."""
    boxes = body.plies if isinstance(body, Laminate) else (body,)
    lo = np.min([b.lo for b in boxes], axis=0)
    moved = np.abs(np.asarray(crack.edges)).max(axis=0)
    flat = [a for a in range(len(lo)) if moved[a] <= 1e-12 * moved.max()]
    return [float(abs(crack.corner[a] - lo[a])) for a in flat]


def _common(lengths: list[float]) -> float:
    """The greatest length that divides all, to 1e-6 of the longest."""
    slack = 1e-6 * max(lengths)
    unit = lengths[0]
    for length in lengths[1:]:
        a, b = max(unit, length), min(unit, length)
        while b > slack:
            rest = a % b
            rest = 0.0 if min(rest, b - rest) < slack else rest
            a, b = b, rest
        unit = a
    return unit
