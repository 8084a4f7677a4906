"""Writing a scene to a TOML file, if it is data."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np

from jaxpd.checks import instance, word
from jaxpd.conditions import Load, Start, Support
from jaxpd.geometry import Ball, Box, Cloud, Crack, HalfSpace, Region, Union
from jaxpd.laminate import Interlayer, Laminate
from jaxpd.physics import Voce
from jaxpd.physics.hardening import Linear
from jaxpd.physics.plasticity import VonMises
from jaxpd.planner.look import chosen
from jaxpd.resolution import Kernel
from jaxpd.scene import Elastic, Scene
from jaxpd.scene_file.words import JOBS
from jaxpd.schedule import ALWAYS, STEADY, Table

KINDS = {"density": "body_force", "resultant": "pull", "traction": "traction"}


def save_scene(
    path: str | Path,
    scene: Scene,
    job: str = "auto",
    options: dict[str, Any] | None = None,
) -> Path:
    """Write a scene to a TOML file that `load_scene` reads back.

    Args:
        path: of the file. The points of a cloud are written beside it, as .csv.
        scene: what to write.
        job: "static", "motion", "path", "fracture", "relaxed"; "auto" leaves it out.
        options: of the driver.

    Returns:
        The path.

    Raises:
        ValueError: naming what only Python can say: functions, laws of one's own,
            bodies with an outline, numbers of their own a point; a path that cannot be
            written.
    """
    instance("scene", scene, Scene, "a Scene(..)")
    word("job", job, ("auto", *JOBS))
    path = Path(instance("path", path, str | Path, "the path of a file"))
    if not path.parent.is_dir():
        raise ValueError(f"path: there is no folder {path.parent}; make it first")
    data: dict[str, Any] = {
        "kinematics": scene.kinematics,
        "body": _body(scene.body, path),
        "material": _each(scene.material, _material),
    }
    if chosen(scene.resolution):
        data["resolution"] = _each(scene.resolution, _resolution)
    for name, words in (
        ("supports", _support),
        ("loads", _load),
        ("cracks", _crack),
        ("starts", _start),
        ("no_fail", _region),
        ("weak", _crack),
    ):
        given = getattr(scene, name)
        if given:
            data[name] = [words(one) for one in given]
    if job != "auto":
        told = {k: _option(k, v) for k, v in (options or {}).items() if v is not None}
        data["job"] = {job: told}
    try:
        path.write_text(_toml(data))
    except OSError as error:
        raise ValueError(f"path: {path} cannot be written ({error})") from error
    return path


def _toml(data: dict[str, Any]) -> str:
    """One line a field, and one an entry of a list."""
    lines = []
    for key, value in data.items():
        if isinstance(value, list):
            rows = ",\n".join(f"    {_inline(one)}" for one in value)
            lines.append(f"{key} = [\n{rows},\n]")
        else:
            lines.append(f"{key} = {_inline(value)}")
    return "\n".join(lines) + "\n"


def _inline(value: Any) -> str:
    if isinstance(value, dict):
        inner = ", ".join(f"{k} = {_inline(v)}" for k, v in value.items())
        return f"{{ {inner} }}" if inner else "{}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_inline, value)) + "]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    return str(value) if isinstance(value, int) else json.dumps(value)


def _number(value: Any, place: str) -> float:
    if callable(value):
        raise ValueError(
            f"{place}: a function of the positions only Python can say; give a number"
        )
    if np.ndim(value):
        raise ValueError(
            f"{place}: numbers of their own a point, {np.shape(value)}, only Python "
            "can say; give one number"
        )
    return float(value)


def _each(given: Any, words: Any) -> Any:
    return (
        [words(x) for x in given] if isinstance(given, list | tuple) else words(given)
    )


def _body(body: Any, path: Path) -> dict[str, Any]:
    if isinstance(body, Box):
        return _region(body)
    if isinstance(body, Laminate):
        layers = [_layer(one) for one in body.interlayers]
        same = all(one == layers[0] for one in layers)
        if not same or layers[0] is None:
            raise ValueError("body: interlayers that differ only Python can say")
        plies = [_region(ply) for ply in body.plies]
        return {"laminate": {"plies": plies, "interlayers": layers[0]}}
    assert isinstance(body, Cloud)
    if body.rim is not None or body.lattice is not None:
        raise ValueError(
            "body: a cloud with an outline or lattice of its own only Python can say, "
            "as mapped(..); give a box() or points without"
        )
    beside = path.with_suffix(".csv")
    rows = np.column_stack([np.asarray(body.X), np.asarray(body.vol)])
    np.savetxt(beside, rows, delimiter=",", fmt="%.17g")
    return {"points": {"file": beside.name}}


def _layer(layer: Interlayer | None) -> dict[str, Any] | None:
    if layer is None:
        return None
    told = {
        f.name: getattr(layer, f.name)
        for f in dataclasses.fields(layer)
        if getattr(layer, f.name) is not None
    }
    return {
        "interlayer": {
            k: v if isinstance(v, str | bool) else _number(v, f"interlayers: {k}")
            for k, v in told.items()
        }
    }


def _material(material: Any) -> dict[str, Any]:
    if isinstance(material, Elastic):
        return {"Elastic": _fields(material, "material")}
    if isinstance(material, VonMises):
        told = {"E": material.E, "nu": material.nu, "h_kin": material.h_kin}
        numbers: dict[str, Any] = {
            k: _number(v, f"material: {k}") for k, v in told.items() if v is not None
        }
        law = material.hardening
        if isinstance(law, Linear):
            numbers |= {
                "sigma_y": _number(law.sigma_y, "material: sigma_y"),
                "h_iso": _number(law.h_iso, "material: h_iso"),
            }
        elif isinstance(law, Voce):
            numbers["hardening"] = {"Voce": _fields(law, "hardening")}
        else:
            raise ValueError("hardening: a function only Python can say")
        return {"von_mises": numbers | {"state": material.state}}
    raise ValueError(
        f"material: {type(material).__name__}, a law of your own, only Python can say; "
        "a file knows Elastic and von_mises"
    )


def _fields(data: Any, place: str) -> dict[str, Any]:
    """Fields that are not at their defaults."""
    told = {}
    for f in dataclasses.fields(data):
        value = getattr(data, f.name)
        if value is None or (
            f.default is not dataclasses.MISSING and value == f.default
        ):
            continue
        plain = isinstance(value, str | bool | int)
        told[f.name] = value if plain else _number(value, f"{place}: {f.name}")
    return told


def _resolution(resolution: Any) -> dict[str, Any]:
    told: dict[str, Any] = {}
    for f in dataclasses.fields(resolution):
        value = getattr(resolution, f.name)
        if value is None or value == f.default:
            continue
        if f.name == "kernel":
            if not isinstance(value, Kernel):
                raise ValueError("kernel: one of your own only Python can say")
            names = {"fractional": "alpha", "gaussian": "ratio"}
            inner = {names[value.name]: value.parameter} if value.name in names else {}
            value = {value.name: inner}
        told[f.name] = value
    return {type(resolution).__name__: told}


def _region(region: Region) -> dict[str, Any]:
    if isinstance(region, HalfSpace):
        name = "above" if region.sign > 0 else "below"
        return {name: {"xyz"[region.axis]: region.at}}
    if isinstance(region, Box):
        return {"box": {"lo": list(region.lo), "hi": list(region.hi)}}
    if isinstance(region, Ball):
        return {"ball": {"centre": list(region.centre), "radius": region.radius}}
    assert isinstance(region, Union)
    return {"union": [_region(part) for part in region.parts]}


def _crack(crack: Crack) -> dict[str, Any]:
    corner = list(crack.corner)
    if len(crack.edges) == 1:
        end = [a + b for a, b in zip(corner, crack.edges[0], strict=True)]
        return {"segment": {"a": corner, "b": end}}
    edge1, edge2 = map(list, crack.edges)
    return {"rectangle": {"corner": corner, "edge1": edge1, "edge2": edge2}}


def _parts(components: tuple[Any, ...], place: str, names: str = "xyz") -> dict:
    return {
        name: _number(value, f"{place}: {name}")
        for name, value in zip(names, components, strict=False)
        if value is not None
    }


def _time(time: Table) -> dict[str, Any]:
    if time == ALWAYS:
        return {}
    if time.rate:
        raise ValueError("time: a table that goes on rising only Python can say")
    told = {"times": list(time.times), "factors": list(time.factors)}
    return {"time": {"table": told}}


def _support(support: Support) -> dict[str, Any]:
    region = {"region": _region(support.region)}
    told = region | _parts(support.components, "supports")
    if support.time == STEADY:
        return {"drives": told}
    if support == Support(support.region, (0.0, 0.0, 0.0)):
        return {"holds": region}
    return {"moves": told | _time(support.time)}


def _load(load: Load) -> dict[str, Any]:
    time = _time(load.time)
    if load.kind == "pressure":
        p = _number(load.components[0], "loads: p")
        return {"pressure": {"region": _region(load.region), "p": p} | time}
    where = "face" if load.kind == "traction" else "region"
    told = {k: v for k, v in _parts(load.components, "loads").items() if v}
    return {KINDS[load.kind]: {where: _region(load.region)} | told | time}


def _start(start: Start) -> dict[str, Any]:
    told = {f"u{k}": v for k, v in _parts(start.u, "starts").items()}
    told |= {f"v{k}": v for k, v in _parts(start.v, "starts").items()}
    return {"initially": {"region": _region(start.region)} | told}


def _option(name: str, value: Any) -> Any:
    if isinstance(value, Region):
        return _region(value)
    if isinstance(value, list | tuple) and value and isinstance(value[0], Region):
        return [_region(one) for one in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, str | bool | int | float | list | tuple):
        return value
    raise ValueError(f"{name}: {value!r} only Python can say")
