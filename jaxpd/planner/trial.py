"""What a driver would refuse before it starts, told by the plan. Host only.

Points are laid and conditions put on them, by the functions of the drivers; bonds are
not looked for, so pieces that a crack leaves loose are found by the run alone.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpd.body import (
    check_free,
    cloud_of,
    loads_on,
    starts_on,
    still,
    supports_on,
)
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.fracture.breaking import check_breaks
from jaxpd.fracture.live_iterative import METHODS
from jaxpd.laminate import Laminate
from jaxpd.launch import check_moves
from jaxpd.model import check_given, check_whole, correction_of, model_of
from jaxpd.nodes import check_forces, cloud_with_rim, law_of
from jaxpd.planner.laws import follows, remembers
from jaxpd.plies import ply_scenes
from jaxpd.resolution import MLS, NODES, RKPM
from jaxpd.scene import Scene
from jaxpd.solvers.linear import GENERAL, methods

LATTICES = ("spectral", "multigrid")


def check_runs(scene: Scene, job: str, options: dict[str, Any]) -> None:
    """Refuse a scene with a resolution that its job's driver would refuse.

    Args:
        scene: with a resolution.
        job: "static", "motion", "path" or "fracture".
        options: of the driver; solver and operator are looked at.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    nodes = isinstance(scene.resolution, NODES)
    _check_job(scene, job, nodes)
    solver = options.get("solver")
    if solver is not None:
        check_solver(scene, job, solver, options.get("operator"))
    if nodes:
        _check_nodes(scene, job)
        return
    each = ply_scenes(scene) if isinstance(scene.body, Laminate) else [scene]
    clouds = [cloud_of(one) for one in each]
    for one, cloud in zip(each, clouds, strict=True):
        check_given(one, np.asarray(cloud.X))
        correction_of(one, cloud)
        model_of(one)
    X = np.concatenate([np.asarray(cloud.X) for cloud in clouds])
    vol = np.concatenate([np.asarray(cloud.vol) for cloud in clouds])
    fixed, moved, times = supports_on(scene, X)
    pulled, courses = loads_on(scene, X, vol, fixed)
    if job == "motion":
        starts_on(scene, X)
        return
    still(moved, times, "supports")
    still(pulled, courses, "loads")
    check_free(X, np.zeros(len(X), int), fixed)


def _check_job(scene: Scene, job: str, nodes: bool) -> None:
    """Refuse a job that a scene cannot have."""
    if job == "path" and not nodes:
        raise ValueError(
            "job: 'path' is load steps of nodes, resolution=MLS(..) or RKPM(..), and "
            "this scene asks for bonds: 'static', 'motion' or 'fracture'"
        )
    if job == "motion":
        check_moves(scene)
    if job == "static" and nodes and (remembers(scene.material) or follows(scene)):
        raise ValueError(
            "job: 'static' of a law with a memory, or of histories; say job='path'"
        )
    if job == "static" and not nodes:
        check_whole(scene)
    if job == "fracture":
        check_breaks(scene)


def check_solver(scene: Scene, job: str, solver: str, operator: str | None) -> None:
    """Refuse a solver that the job, the theory or the points cannot have.

    Raises:
        ValueError: naming those that can.
    """
    able: tuple[str, ...] = methods()
    resolution = scene.resolution
    if isinstance(resolution, MLS):
        able = ("direct", *GENERAL)
    elif job == "fracture":
        able = ("direct", *METHODS)
    if not _lattice(scene, operator):
        able = tuple(name for name in able if name not in LATTICES)
    if solver != "auto" and solver not in able:
        raise ValueError(
            f"solver: {solver!r} is not for this scene as a {job}; use one of {able}"
        )


def _lattice(scene: Scene, operator: str | None) -> bool:
    """Whether bonds are alike and on one lattice, as hierarchies of lattices need."""
    resolution = scene.resolution
    if isinstance(resolution, NODES) or isinstance(scene.body, Laminate):
        return False
    alike = resolution.correction not in (*DIRECTIONAL, "fictitious")
    return alike and operator != "gather" and cloud_of(scene).regular


def _check_nodes(scene: Scene, job: str) -> None:
    cloud = cloud_with_rim(scene)
    if cloud.rim is None:
        raise ValueError(
            "body: a cloud without a rim; nodes need one: jaxpd.mapped(..), or "
            "from_points(X, vol, rim)"
        )
    if isinstance(scene.resolution, RKPM) and (
        scene.d > 2 or (scene.d == 2 and cloud.rim.edge is None)
    ):
        raise ValueError(
            "resolution: RKPM integrates over cells in 1-D, and in 2-D with an outline;"
            " use MLS(..)"
        )
    X = np.asarray(cloud.X)
    law_of(scene, len(X))
    rim = X[np.asarray(cloud.rim.node)]
    fixed, _, _ = supports_on(scene, X)
    check_free(X, np.zeros(len(X), int), fixed)
    check_forces(scene)
    for load in scene.loads:
        reached = X if load.kind == "density" else rim
        if not load.region.contains(reached).any():
            where = "inside the body" if load.kind == "density" else "on the rim"
            raise ValueError(
                f"loads: the {load.kind} in {load.region} does nothing: it meets no "
                f"node {where}; look at the region"
            )
