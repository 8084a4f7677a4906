"""The plan of a scene whose resolution is known."""

from __future__ import annotations

from typing import Any

from jaxpd.planner import error as errors
from jaxpd.planner.duty import decide
from jaxpd.planner.less import warnings_of
from jaxpd.planner.look import look
from jaxpd.planner.plan import Plan
from jaxpd.resolution import MLS, NODES, RKPM
from jaxpd.scene import Scene


def planned(
    scene: Scene,
    job: str,
    duration: float | None,
    steps: int,
    fixed: dict[str, Any],
    asked: dict[str, Any],
    reasons: dict[str, str],
) -> Plan:
    """The plan of a scene with a resolution.

    Args:
        scene: with a resolution.
        job: what is to be done.
        duration: of a motion (s).
        steps: load steps of a path.
        fixed: fields that the user decided.
        asked: all that the user asked for.
        reasons: those that are known before.

    Raises:
        ValueError: on a fixed field that the job does not have, and on constants that
            the theory cannot have.
    """
    seen = look(scene)
    reasons = dict(reasons)
    choice: dict[str, Any] = {
        "theory": _theory(scene.resolution),
        "resolution": scene.resolution,
        "kinematics": _kinematics(scene, job),
    }
    options, cost, more = decide(scene, job, seen, duration, steps, fixed)
    if job == "path" and asked.get("times") is not None:
        options["times"] = asked["times"]
    for name, (value, why) in more.items():
        choice[name] = value
        reasons[name] = "as asked" if fixed.get(name) is not None else why
    reasons.setdefault("kinematics", _why_kinematics(scene, job))
    error, basis = errors.of_scene(scene, job, seen)
    choice["points"] = seen.n
    return Plan(
        scene=scene,
        job=job,
        choice=choice,
        options=options,
        cost=cost,
        error=error,
        basis=basis,
        reasons=reasons,
        warnings=tuple(warnings_of(scene, seen, job)),
        asked={"scene": scene, **asked},
    )


def _theory(resolution: Any) -> str:
    one = resolution[0] if isinstance(resolution, list | tuple) else resolution
    if isinstance(one, RKPM):
        return "kernels, weak form"
    return "MLS difference, strong form" if isinstance(one, MLS) else "bonds"


def _kinematics(scene: Scene, job: str) -> str:
    """What displacements are, whatever the scene says."""
    if job == "motion":
        return "finite"
    return "small" if job == "fracture" else scene.kinematics


def _why_kinematics(scene: Scene, job: str) -> str:
    if job == "motion":
        return "motion is always of finite displacements"
    if isinstance(scene.resolution, NODES) or job == "fracture":
        return "its theory is of small displacements"
    if scene.kinematics == "small":
        return "one linear solve, no Newton loop"
    return "Newton's method; where strains are below 1e-3, 'small' saves the loop"
