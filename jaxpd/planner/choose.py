"""The door of the planner: `plan`, the cheapest adequate way to model a scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

from jaxpd.checks import instance, number, word
from jaxpd.geometry import Box
from jaxpd.geometry.crack import check_dimension
from jaxpd.path import check_times
from jaxpd.planner import error as errors
from jaxpd.planner.laws import follows, remembers
from jaxpd.planner.look import chosen, look
from jaxpd.planner.plan import Plan
from jaxpd.planner.planned import planned
from jaxpd.planner.trial import check_runs
from jaxpd.planner.wanted import candidates, theories
from jaxpd.resolution import NODES, Bonds
from jaxpd.scene import Scene

JOBS = ("static", "motion", "path", "fracture")
#: What a user may fix.
FIELDS = ("resolution", "kinematics", "operator", "solver", "dtype", "dt", "tangent")
#: Relative error that is aimed at where none is asked for.
ACCURACY = 0.01
#: Longest horizon over the smallest feature that is chosen.
LONGEST = 0.25
#: Seconds and bytes above which a plan warns.
LONG, LARGE = 1800.0, 16e9
#: Most points that are planned without being asked for.
MOST = 3_000_000


def plan(
    scene: Scene,
    job: str = "auto",
    *,
    accuracy: float | None = None,
    seconds: float | None = None,
    duration: float | None = None,
    times: Sequence[float] | None = None,
    **fixed: Any,
) -> Plan:
    """Choose the cheapest adequate way to model a scene, and say why.

    A resolution that the scene has is kept; one that was left out is chosen: of the
    theories that can model the scene, each at rising resolutions, the cheapest that
    meets the accuracy, or the most accurate that fits into the seconds.

    Args:
        scene: what to model.
        job: "static", "motion", "path" (load steps with a memory) or "fracture" (slow);
            "auto" is motion where a duration is given, a path where times are given or
            the law has a memory, else static.
        accuracy: wanted relative error of displacements; 0.01 where neither it nor
            seconds are given.
        seconds: most processor seconds, compilation included.
        duration: of a motion (s).
        times: of the load steps of a path.
        **fixed: fields that are decided already: resolution, kinematics, operator,
            solver, dtype, dt, tangent.

    Returns:
        A `Plan`: data, which prints as a table; `plan.run()` runs it, and
        `changed(plan, ..)` plans again with further fields fixed.

    Raises:
        ValueError: naming the argument, its value and the cure. That no resolution
            meets what is wanted is a warning of the best that there is.
    """
    instance("scene", scene, Scene, "a Scene(..); of a file load_scene(..).scene")
    _check(job, accuracy, seconds, duration, fixed)
    check_dimension(scene.cracks, scene.d)
    asked: dict[str, Any] = {
        "job": job,
        "accuracy": accuracy,
        "seconds": seconds,
        "duration": duration,
        "times": times,
        **fixed,
    }
    reasons: dict[str, str] = {}
    if times is not None:
        times = check_times(times)
    job = _job(scene, job, duration, times, reasons)
    steps = 10 if times is None else len(times)
    for name in ("resolution", "kinematics"):
        if name in fixed:
            scene = dataclasses.replace(scene, **{name: fixed.pop(name)})
            reasons[name] = "as asked"
    if chosen(scene.resolution):
        reasons.setdefault("resolution", "given by the scene")
        found = planned(scene, job, duration, steps, fixed, asked, reasons)
        check_runs(found.scene, job, found.options)
    else:
        wanted = (accuracy, seconds)
        found = _wanted(scene, job, duration, steps, fixed, asked, wanted, reasons)
    over, cost = [*found.warnings], found.cost
    missed = accuracy is not None and (found.error or 0.0) > accuracy
    if missed and chosen(scene.resolution):
        over.append(f"expected error {found.error:.2g} is above the {accuracy:g} asked")
    if seconds is not None and cost.seconds > seconds:
        over.append(f"predicted {cost.seconds:.2g} s are above the {seconds:g} asked")
    if cost.seconds > LONG or cost.bytes > LARGE:
        over.append(f"predicted {cost}: a coarser model, or less of it, may do")
    return dataclasses.replace(found, warnings=tuple(over))


def changed(found: Plan, **fields: Any) -> Plan:
    """A plan made again with further fields fixed, or other wishes.

    Args:
        found: the plan.
        **fields: any argument of `plan` but the scene; None gives a field back to the
            planner.

    Raises:
        ValueError: as `plan`; if what is given is no plan.
    """
    instance("found", found, Plan, "a Plan, as plan(scene) makes it")
    asked = found.asked | fields
    scene = asked.pop("scene")
    kept = {name: value for name, value in asked.items() if value is not None}
    return plan(scene, **kept)


def _check(
    job: str,
    accuracy: float | None,
    seconds: float | None,
    duration: float | None,
    fixed: dict[str, Any],
) -> None:
    word("job", job, ("auto", *JOBS))
    wishes = (("accuracy", accuracy), ("seconds", seconds), ("duration", duration))
    for name, value in wishes:
        if value is not None:
            number(name, value, above=0, cure="or leave it out")
            number(name, value, below=1 if name == "accuracy" else np.inf)
    for name in fixed:
        if name not in FIELDS:
            raise ValueError(f"{name}: is no field of a plan; they are {FIELDS}")


def _job(
    scene: Scene,
    job: str,
    duration: float | None,
    times: Sequence[float] | None,
    reasons: dict[str, str],
) -> str:
    if job != "auto":
        reasons["job"] = "as asked"
        return job
    if duration is not None:
        reasons["job"] = "a duration is given"
        return "motion"
    nodes = isinstance(scene.resolution, NODES)
    if remembers(scene.material) or times is not None or (nodes and follows(scene)):
        reasons["job"] = "the law has a memory, or conditions follow histories"
        return "path"
    if scene.starts:
        raise ValueError(
            "duration: None; a scene with starts moves: give the duration (s), or a job"
        )
    if scene.weak or scene.no_fail:
        raise ValueError(
            "job: 'auto' of a scene with weak or no_fail; say job='fracture', or a "
            "duration of motion"
        )
    reasons["job"] = "no duration, no memory: equilibrium"
    return "static"


def _wanted(
    scene: Scene,
    job: str,
    duration: float | None,
    steps: int,
    fixed: dict[str, Any],
    asked: dict[str, Any],
    wanted: tuple[float | None, float | None],
    reasons: dict[str, str],
) -> Plan:
    """The cheapest plan that meets what is wanted, over theories and resolutions."""
    accuracy, seconds = wanted
    if accuracy is None and seconds is None:
        accuracy = ACCURACY
    names, why = theories(scene, job)
    tried: list[Plan] = []
    for name in names:
        for level in candidates(scene, job, name):
            fine = [dataclasses.replace(scene, resolution=one) for one in level]
            if look(fine[0]).n > MOST:
                break
            fine = [one for one in fine if _resolved(one)]
            if not fine:
                continue
            new = [
                planned(one, job, duration, steps, fixed, asked, reasons)
                for one in fine
            ]
            tried += new
            # finer ones cost more
            if seconds is not None and min(p.cost.seconds for p in new) > seconds:
                break
            if accuracy is not None and any(_miss(p) <= accuracy for p in new):
                break
    if not tried:
        raise ValueError(
            "resolution: none fits: horizons are at most a quarter of the smallest "
            "side, crack, or what a crack leaves; is a length in another unit? Else "
            "say one, as Bonds(dx=.., m=..)"
        )

    enough = [p for p in tried if accuracy is None or _miss(p) <= accuracy]
    affordable = [p for p in enough if seconds is None or p.cost.seconds <= seconds]
    cheapest = accuracy is not None
    if affordable:
        key = (lambda p: p.cost.seconds) if cheapest else _miss
        best = _first_able(sorted(affordable, key=key), job)
        words = f"cheapest of {len(tried)} tried" if cheapest else "most accurate"
        words += f" for an error of {accuracy:g}" if accuracy else ""
        words += f" within {seconds:g} s" if seconds else ""
        doubts: tuple[str, ...] = ()
    else:
        pool = [p for p in tried if seconds is None or p.cost.seconds <= seconds]
        ranked = sorted(pool or tried, key=_miss if pool else lambda p: p.cost.seconds)
        best = _first_able(ranked, job)
        words = f"best of {len(tried)} tried"
        doubts = (
            f"none of {len(tried)} resolutions is expected to meet"
            + (f" an error of {accuracy:g}" if accuracy else "")
            + (f" within {seconds:g} s" if seconds else ""),
        )
    told = best.reasons | {"theory": why, "resolution": words}
    return dataclasses.replace(
        best,
        reasons=told,
        warnings=(*doubts, *best.warnings),
        asked={"scene": scene, **asked},
    )


def _first_able(ranked: list[Plan], job: str) -> Plan:
    """The first plan that its driver would not refuse.

    Raises:
        ValueError: what the first is refused for, if all are.
    """
    refusal: ValueError | None = None
    for one in ranked:
        try:
            check_runs(one.scene, job, one.options)
        except ValueError as error:
            refusal = refusal or error
        else:
            return one
    assert refusal is not None
    raise refusal


def _resolved(scene: Scene) -> bool:
    """Whether bonds are short beside a box: else nothing that was measured applies."""
    if not (isinstance(scene.resolution, Bonds) and isinstance(scene.body, Box)):
        return True
    seen = look(scene)
    return seen.m * seen.dx <= LONGEST * errors.feature(scene, seen) * (1 + 1e-9)


def _miss(one: Plan) -> float:
    return np.inf if one.error is None else one.error
