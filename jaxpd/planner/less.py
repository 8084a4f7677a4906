"""What a scene models that it does not need: dimensions, strengths, plies, mass."""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpd.conditions import Support
from jaxpd.geometry import Ball, Box, Crack, HalfSpace, Region, Union
from jaxpd.laminate import Laminate
from jaxpd.planner.laws import breaks, follows
from jaxpd.planner.look import Look
from jaxpd.resolution import Bonds
from jaxpd.scene import Scene

#: Length over width from which held ends are small beside the rest.
SLENDER = 20.0


def warnings_of(scene: Scene, look: Look, job: str) -> list[str]:
    """What could be left out of a scene, and what it is likely to have wrong."""
    found = [_superfluous(scene, look, axis) for axis in range(scene.d)]
    found += [_thin(scene, look), _strength(scene, job), _layers(scene, look)]
    found += [_turning(scene)] if job == "fracture" else []
    if job == "static" and follows(scene):
        found.append("histories of loads and supports count in motion and paths alone")
    resolution = scene.resolution
    if isinstance(resolution, Bonds):
        if look.m < 2.9:
            found.append(
                f"m = {look.m:.3g}: below 3 a lattice has few directions, and cracks "
                "run along them"
            )
        if look.m * look.dx > 0.25 * look.least:
            found.append(
                f"the horizon {look.m * look.dx:.3g} is more than a quarter of the "
                f"body's shortest side {look.least:.3g}: surfaces are everywhere"
            )
    if scene.d > 1 and look.spread > 0.3:
        found.append(
            f"distances to the nearest neighbour vary by {look.spread:.0%}: check the "
            "points, nearly coincident ones spoil every scheme"
        )
    return [one for one in found if one]


def _superfluous(scene: Scene, look: Look, axis: int) -> str:
    """The warning that nothing depends on an axis, or an empty one."""
    if scene.d == 1 or not isinstance(scene.body, Box):
        return ""
    supports = [s for s in scene.supports if not _pins(s, look.dx)]
    conditions = (*supports, *scene.loads)
    if not conditions or scene.starts:
        return ""
    if any(_varies(c.region, scene.body, axis) for c in conditions):
        return ""
    if any(_callable(c.components) or _along(c.components, axis) for c in conditions):
        return ""
    if any(_cuts(crack, scene.body, axis) for crack in scene.cracks):
        return ""
    held = [s for s in supports if s.components[axis] is not None]
    name = "xyz"[axis]
    if not all(_covers(s.region, scene.body) for s in held):
        # an edge that is held keeps its neighbourhood from contracting
        lengths = np.subtract(scene.body.hi, scene.body.lo)
        slender = lengths[axis] * SLENDER <= np.delete(lengths, axis).min()
        if scene.d == 2 and slender:
            return (
                f"but for its held ends nothing depends on {name}, and the body is "
                f"{lengths.max() / lengths[axis]:.0f} times as long as wide: a bar in "
                "1-D will do"
            )
        return ""
    if scene.d == 3:
        plane = "plane strain" if held else "plane stress, if the body is thin there"
        return f"nothing depends on {name}: a plane model will do ({plane})"
    one = "a bar confined across" if held else "a bar"
    return f"nothing depends on {name}: {one} in 1-D will do"


def _pins(support: Support, dx: float) -> bool:
    """Whether a support holds a point or two, which stops the body from floating."""
    region = support.region
    still = all(value in (None, 0.0) for value in support.components)
    if isinstance(region, Ball):
        return still and region.radius <= dx
    if isinstance(region, Box):
        return still and all(np.subtract(region.hi, region.lo) <= 2.0 * dx)
    return False


def _varies(region: Region, body: Box, axis: int) -> bool:
    """Whether what a region takes of a box depends on an axis."""
    if isinstance(region, Union):
        return any(_varies(part, body, axis) for part in region.parts)
    if isinstance(region, HalfSpace):
        return region.axis == axis
    if isinstance(region, Box):
        return not (
            region.lo[axis] <= body.lo[axis] and region.hi[axis] >= body.hi[axis]
        )
    return True


def _covers(region: Region, body: Box) -> bool:
    """Whether a region holds all of a box."""
    corners = np.array(np.meshgrid(*zip(body.lo, body.hi, strict=True)))
    return bool(region.contains(corners.reshape(len(body.lo), -1).T).all())


def _callable(components: tuple[Any, ...]) -> bool:
    return any(callable(value) for value in components)


def _along(components: tuple[Any, ...], axis: int) -> bool:
    value = components[axis]
    return value is not None and value != 0.0


def _cuts(crack: Crack, body: Box, axis: int) -> bool:
    """Whether a crack varies along an axis: unless it runs through the body."""
    corners = [np.asarray(crack.corner)]
    for edge in crack.edges:
        corners += [corner + np.asarray(edge) for corner in corners]
    along = np.array(corners)[:, axis]
    through = along.min() <= body.lo[axis] and along.max() >= body.hi[axis]
    slanted = sum(abs(np.asarray(edge)[axis]) > 0 for edge in crack.edges) > 1
    return slanted or not through


def _thin(scene: Scene, look: Look) -> str:
    if scene.d == 3 and look.least * 20 < sorted(look.sides)[1]:
        return (
            f"the body is {look.least:.3g} thin and {sorted(look.sides)[1]:.3g} wide: "
            "loaded in its plane it is a plate in plane stress, in 2-D"
        )
    return ""


def _strength(scene: Scene, job: str) -> str:
    if job == "static" and breaks(scene):
        return (
            "a strength is given, and bonds of a static solve do not break: "
            "job='fracture' lets them, duration=.. does in motion"
        )
    return ""


def _turning(scene: Scene) -> str:
    """The warning that a crack is sheared, leaves its plane, and how long is open."""
    if scene.weak:
        return ""
    for crack in scene.cracks:
        edges = np.asarray(crack.edges)
        along = edges / np.linalg.norm(edges, axis=1, keepdims=True)
        for support in scene.supports:
            if _callable(support.components):
                continue
            move = np.array([c or 0.0 for c in support.components[: scene.d]])
            share = np.linalg.norm(along @ move)
            if share > 0.7 * np.linalg.norm(move) > 0.0:
                return (
                    "supports move along a crack: it leaves its plane and what is left "
                    "may be crushed; states, and with them the time, are a lower bound"
                )
    return ""


def _layers(scene: Scene, look: Look) -> str:
    """Plies thinner than a horizon, which a ghost interlayer would replace."""
    if not isinstance(scene.body, Laminate) or len(scene.body.plies) < 3:
        return ""
    axis = scene.body.axis
    thin = [
        number
        for number, ply in enumerate(scene.body.plies)
        if ply.hi[axis] - ply.lo[axis] < look.m * look.dx
        and 0 < number < len(scene.body.plies) - 1
    ]
    if not thin:
        return ""
    return (
        f"plies {thin} are thinner than a horizon: an interlayer(..) in a gap carries "
        "them by ghost points, at a longer stable step"
    )
