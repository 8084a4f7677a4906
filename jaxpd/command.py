"""Scenes from the command line: scene files, the gallery, plans; results on disk."""

from __future__ import annotations

import importlib.util
import inspect
import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from jaxpd import gallery, io
from jaxpd.checks import near
from jaxpd.explicit import run_explicit
from jaxpd.fracture import solve_fracture
from jaxpd.path import solve_path
from jaxpd.picture import picture
from jaxpd.planner import Plan, plan
from jaxpd.planner.look import chosen
from jaxpd.relaxed import solve_relaxed
from jaxpd.run import solve_static
from jaxpd.scene import Scene
from jaxpd.scene_file import SceneFile, load_scene

#: What runs each job.
DRIVERS: dict[str, Any] = {
    "static": solve_static,
    "motion": run_explicit,
    "path": solve_path,
    "fracture": solve_fracture,
    "relaxed": solve_relaxed,
}
#: Energies over the balance from which a motion is doubted; sound ones miss it by less
#: than 1 % (tests/test_fracture.py).
BALANCE = 0.02
#: Scenes shipped with the package.
EXAMPLES = Path(__file__).parent / "examples"
#: Gallery scenes that move or follow a path, and how they are run from here.
HOW: dict[str, tuple[str, dict[str, Any]]] = {
    "branching_plate": ("motion", {"duration": 43e-6, "records": 43, "frames": 43}),
    "kalthoff_winkler": ("motion", {"duration": 90e-6, "records": 45, "frames": 45}),
    "bar_wave": ("motion", {"duration": 1.0, "records": 20, "frames": 20}),
    "gaussian_wave": ("motion", {"duration": 30.0, "records": 10, "frames": 10}),
    "struck_laminate": ("motion", {"duration": 20e-6, "records": 20, "frames": 20}),
    "peeled_beam": ("motion", {"duration": 60.0, "records": 20, "frames": 20}),
    **{
        name: ("path", {"times": (np.arange(1, 7) / 6).tolist()})
        for name in ("plastic_bar", "plastic_beam", "pressed_ring", "cook_panel")
    },
    "plate_with_hole": ("path", {"times": (np.arange(1, 13) / 12).tolist()}),
    **{
        name: ("fracture", {})
        for name in (
            "double_cantilever",
            "notched_plate",
            "compact_tension",
            "bent_beam",
            "sheared_plate",
            "l_panel",
            "breaking_plate",
        )
    },
}


def scenes() -> dict[str, Any]:
    """Functions of the gallery that make a scene, by name."""
    return {
        name: make
        for name in gallery.__all__
        if callable(make := getattr(gallery, name))
        and inspect.signature(make).return_annotation in (Scene, "Scene")
        and all(
            p.default is not inspect.Parameter.empty
            for p in inspect.signature(make).parameters.values()
        )
    }


def listed() -> str:
    """Names of the gallery's scenes and of the shipped files, with a line each."""
    lines = ["scenes of the gallery: python -m jaxpd NAME [key=value ..]", ""]
    for name, make in scenes().items():
        job = HOW.get(name, ("static", {}))[0]
        words = (inspect.getdoc(make) or "").splitlines()[0]
        lines.append(f"  {name:<22} {job:<9} {words}")
    lines += ["", "scene files: python -m jaxpd FILE.toml [--plan]", ""]
    for path in sorted(EXAMPLES.glob("*.toml")):
        head = path.read_text().splitlines()[0].lstrip("# ")
        lines.append(f"  {path.stem + '.toml':<22} {'':<9} {head}")
    return "\n".join(lines)


def find(name: str, words: list[str]) -> SceneFile:
    """A scene by the name of a file or of the gallery.

    Args:
        name: of a file that ends in .toml, given or shipped; or of the gallery.
        words: arguments of the gallery's function, as "m=3".

    Raises:
        ValueError: naming what is not known, and the nearest that is.
    """
    if name.endswith(".toml"):
        if words:
            raise ValueError(f"{words[0]}: a file takes no arguments; edit the file")
        path = Path(name)
        shipped = EXAMPLES / name
        if not path.exists() and shipped.exists():
            path = shipped
        if not path.exists():
            files = [*Path().glob("*.toml"), *EXAMPLES.glob("*.toml")]
            meant = near(name, [f.name for f in files])
            raise ValueError(f"name: there is no file {name!r}; {meant}".rstrip("; "))
        return load_scene(path)
    known = scenes()
    if name not in known:
        raise ValueError(
            f"name: {name!r} is no scene; {near(name, known)}"
            "`python -m jaxpd --gallery` lists them"
        )
    make = known[name]
    scene = make(**_arguments(make, words))
    job, options = HOW.get(name, ("static", {}))
    if job == "fracture":
        options = {"end": gallery.end_of(scene)}
    return SceneFile(scene, job, options, path=Path(f"{name}.toml"))


def _arguments(make: Any, words: list[str]) -> dict[str, Any]:
    """Arguments of a function from words."""
    known = inspect.signature(make).parameters
    found = {}
    for word in words:
        name, equals, text = word.partition("=")
        if not equals or name not in known:
            raise ValueError(
                f"{word}: {near(name, known)}arguments are {[*known]}, written as "
                "name=value"
            )
        try:
            found[name] = json.loads(text)
        except json.JSONDecodeError:
            found[name] = text
        if isinstance(found[name], list):
            found[name] = tuple(found[name])
    return found


def planned(file: SceneFile) -> Plan:
    """The plan of a scene file: what it leaves out is chosen.

    Raises:
        ValueError: of the job "relaxed", which has nothing to choose.
    """
    if file.job == "relaxed":
        raise ValueError("job: 'relaxed' is not planned; it has one way")
    names = ("duration", "times", "operator", "solver", "dtype", "dt", "tangent")
    asked = {k: v for k, v in file.options.items() if k in names}
    return plan(file.scene, file.job, **asked, **file.wish)


def execute(file: SceneFile, out: Path, resume: bool) -> tuple[Any, str, list[str]]:
    """Run a scene file: the result, checked where it can be; job; warnings of its plan.

    Args:
        file: what to run.
        out: folder of checkpoints and pictures.
        resume: go on from checkpoints that are there.

    Raises:
        ValueError: if checkpoints are there and `resume` is not said, or the job keeps
            none.
        NotConverged: if it failed, with status and history.
    """
    job, scene, options = file.job, file.scene, dict(file.options)
    doubts: list[str] = []
    if not chosen(scene.resolution) or file.wish or job == "auto":
        made = planned(file)
        job, scene, doubts = made.job, made.scene, list(made.warnings)
        options = made.options | options
    _check_vtu(file, job, options)
    keeps = "folder" in inspect.signature(DRIVERS[job]).parameters
    keeps = keeps and not (job == "fracture" and "softening" in options)
    folder = _kept(file, out)
    if resume and not keeps:
        raise ValueError(f"--resume: a {job} job keeps no checkpoints; run it again")
    if keeps:
        held = folder.is_dir() and any(folder.iterdir())
        if held and not resume:
            raise ValueError(
                f"--resume: {folder} holds checkpoints; say --resume to go on from "
                "them, or remove the folder to start anew"
            )
        options["folder"] = folder
    needed = {"motion": "duration", "path": "times"}.get(job)
    if needed is None:
        return DRIVERS[job](scene, **options).checked(), job, doubts
    first = options.pop(needed, None)
    if first is None:
        raise ValueError(f"{needed}: is missing; a {job} job needs it, in [job.{job}]")
    return DRIVERS[job](scene, first, **options).checked(), job, doubts


def doubts_of(found: Any, job: str) -> list[str]:
    """What is amiss with a result that came to its end."""
    if job != "motion" or not abs(found.balance[-1]) > BALANCE:
        return []
    return [
        f"the energies miss the balance by {found.balance[-1]:.1%}: supports that jump "
        "do, a time=ramp(..) lets them start; a smaller dt helps elsewhere"
    ]


def _kept(file: SceneFile, out: Path) -> Path:
    """The folder of a scene's checkpoints."""
    return out / f"{file.path.stem}.checkpoints"


def clear(file: SceneFile, out: Path) -> None:
    """Remove the checkpoints of a run that came to its end, unless they are kept."""
    if file.output.get("keep", False):
        return
    folder = _kept(file, out)
    for kept in folder.glob("*.npz"):
        kept.unlink()
    if folder.is_dir() and not any(folder.iterdir()):
        folder.rmdir()


def _check_vtu(file: SceneFile, job: str, options: dict[str, Any]) -> None:
    """Refuse frames for ParaView, before a run, of what will have none."""
    if not file.output.get("vtu", False):
        return
    if importlib.util.find_spec("meshio") is None:
        raise ValueError("vtu: needs meshio; pip install 'jaxpd[mesh]'")
    if job == "relaxed":
        raise ValueError("vtu: a relaxed job has no frames; leave it out")
    if job == "motion" and not options.get("frames"):
        raise ValueError("vtu: needs frames; say frames = 10 in [job.motion]")


def placed(error: ValueError, file: SceneFile) -> str:
    """What a driver or the planner refused, with the file that asked for it."""
    words = str(error)
    if not file.path.exists() or words.startswith("--"):
        return words
    at = next(
        (
            f"{table}.{name}: "
            for table, names in ((f"job.{file.job}", file.options), ("plan", file.wish))
            for name in names
            if words.startswith(f"{name}:")
        ),
        "",
    )
    return f"{file.path.name}: {at}{words}"


def report(found: Any, job: str, file: SceneFile, out: Path, started: float) -> dict:
    """Figures of a result, its picture and files."""
    told: dict[str, Any] = {"job": job, "result": repr(found)}
    if file.output.get("picture", True):
        path = out / f"{file.path.stem}.png"
        picture(found).savefig(path, dpi=110)
        told["picture"] = str(path)
    if file.output.get("vtu", False):
        told["vtu"] = str(_vtu(found, job, out / file.path.stem))
    told["seconds"] = round(time.perf_counter() - started, 2)
    return told


def _vtu(found: Any, job: str, folder: Path) -> Path:
    """Frames for ParaView, of what has them."""
    if job == "motion":
        found.write_vtu(folder)
    elif job == "path":
        folder.mkdir(parents=True, exist_ok=True)
        found.write(folder / "path")
    elif job == "static":
        u, force = np.asarray(found.u), np.asarray(found.reaction)
        fields = {"u": u[None], "reaction": force[None]}
        io.write_series(folder, np.asarray(found.X), np.zeros(1), fields)
    else:
        found.write(folder)
    return folder
