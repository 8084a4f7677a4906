"""Reading a scene from a TOML file; strict: what is not known is refused by name."""

from __future__ import annotations

import dataclasses
import difflib
import inspect
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from jaxpd.checks import instance
from jaxpd.scene import Scene
from jaxpd.scene_file.words import GROUPS, JOBS, OUTPUT, PLAN, SAME, SCENE, WORDS, Word

#: What only Python can say, by the key under which one would look for it.
PYTHON = {
    "Solid": "a law of your own: material=jaxpd.Solid(law, rho)",
    "mapped": "a body by a function: body=jaxpd.mapped(shape, map)",
    "outlined": "a body by its loops: body=jaxpd.outlined(X, loops)",
    "from_points": "arrays: body=jaxpd.from_points(X, vol); a file may hold them, as "
    'body = { points = { file = "points.csv" } }',
    "lattice": "a lattice by hand: body=jaxpd.lattice(..); a box with dx is one",
    "law": "a law of your own: material=jaxpd.Solid(law, rho)",
}


@dataclass(frozen=True, eq=False)
class SceneFile:
    """What a scene file holds.

    Attributes:
        scene: what to solve.
        job: "static", "motion", "path", "fracture" or "relaxed".
        options: of the driver.
        wish: accuracy and seconds for the planner.
        output: folder, picture, vtu.
        path: of the file.
    """

    scene: Scene
    job: str
    options: dict[str, Any]
    wish: dict[str, Any] = field(default_factory=dict)
    output: dict[str, Any] = field(default_factory=dict)
    path: Path = Path()


def load_scene(path: str | Path) -> SceneFile:
    """Read a scene file.

    Args:
        path: a TOML file, see `jaxpd.scene_file.words` and `jaxpd/examples`.

    Raises:
        ValueError: naming the file, the place in it, the value and the cure.
    """
    path = Path(instance("path", path, str | Path, "the path of a file"))
    try:
        with open(path, "rb") as file:
            data = tomllib.load(file)
    except OSError as error:
        raise ValueError(f"path: {path} cannot be read ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ValueError(f"path: {path} is no TOML file: {error}") from error
    return parse_scene(data, path)


def parse_scene(data: dict[str, Any], path: Path = Path("scene.toml")) -> SceneFile:
    """The scene that a table says; see `load_scene`."""
    reader = _Reader(path)
    top = {*SCENE, "job", "plan", "output"}
    reader.only(data, top, "", {})
    for name in ("body", "material"):
        if name not in data:
            raise reader.error("", f"{name}: is missing; a scene needs a [{name}]")
    fields = {
        name: reader.value(data[name], _kind(name, data), name)
        for name in SCENE
        if name in data
    }
    scene = reader.made(Scene, fields, "")
    job, options = reader.job(data.get("job"))
    wish = reader.arguments(data.get("plan", {}), PLAN, "plan")
    output = reader.arguments(data.get("output", {}), OUTPUT, "output")
    return SceneFile(scene, job, options, wish, output, path)


def _kind(name: str, data: dict[str, Any]) -> str:
    """The kind of a field; of a laminate material and resolution may be lists."""
    kind = SCENE[name]
    listed = name in ("material", "resolution") and isinstance(data[name], list)
    return f"[{kind}]" if listed else kind


class _Reader:
    """Reads values of a file and says where they are."""

    def __init__(self, path: Path):
        self.path = path

    def error(self, place: str, words: str) -> ValueError:
        """An error that says where it is."""
        where = f"{self.path.name}: {place}: " if place else f"{self.path.name}: "
        return ValueError(where + words)

    def only(self, table: Any, known: Any, place: str, python: dict[str, str]) -> None:
        """Refuse what is no table, and unknown keys with the nearest known one."""
        if not isinstance(table, dict):
            raise self.error(place, f"{table!r} must be a table of {sorted(known)}")
        for key in table:
            if key in known:
                continue
            only = python.get(key) or PYTHON.get(key)
            if only:
                raise self.error(place, f"{key}: only Python can say {only}")
            near = difflib.get_close_matches(key, sorted(known), 1, 0.5)
            folded = [k for k in known if k.lower() == key.lower()]
            alike = [k for names in SAME if key in names for k in names if k in known]
            meant = (folded or alike or near)[:1]
            hint = f"did you mean {meant[0]!r}?" if meant else "leave it out:"
            raise self.error(
                place, f"{key}: is no key here; {hint} keys are {sorted(known)}"
            )

    def job(self, table: Any) -> tuple[str, dict[str, Any]]:
        """Name and options of the driver; the planner's automatic one without."""
        if table is None:
            return "auto", {}
        self.only(table, JOBS, "job", {})
        if len(table) != 1:
            raise self.error("job", f"{sorted(table)}: must be one of {sorted(JOBS)}")
        name = next(iter(table))
        options = self.called(JOBS[name], table[name], f"job.{name}", JOBS[name].kinds)
        for needed in JOBS[name].needed:
            if needed not in options:
                raise self.error(f"job.{name}", f"{needed}: is missing")
        return name, options

    def value(self, given: Any, kind: str, place: str) -> Any:
        """A value of a kind."""
        if kind.startswith("["):
            if not isinstance(given, list):
                raise self.error(place, f"{given!r} must be a list, as [[{place}]]")
            return [
                self.value(one, kind[1:-1], f"{place}[{number}]")
                for number, one in enumerate(given)
            ]
        if kind in GROUPS:
            return self.call(given, GROUPS[kind], place)
        return self.plain(given, kind, place)

    def call(self, stated: Any, group: tuple[str, ...], place: str) -> Any:
        """The result of a word of a group."""
        given: dict[str, Any] = stated
        self.only(given, group, place, {})
        if len(given) != 1:
            raise self.error(
                place, f"{sorted(given)}: must be exactly one of {sorted(group)}"
            )
        name: str = next(iter(given))
        word = WORDS[name]
        inner = f"{place}.{name}"
        table = given[name]
        if name == "union" and isinstance(table, list):
            table = {"parts": table}
        arguments = self.called(word, table, inner, word.kinds)
        return self.made(word.call, arguments, inner)

    def called(
        self, word: Word, table: Any, place: str, kinds: dict[str, str]
    ) -> dict[str, Any]:
        """Arguments of a word."""
        return self.arguments(table, kinds, place, word.python)

    def arguments(
        self,
        table: Any,
        kinds: dict[str, str],
        place: str,
        python: dict[str, str] | None = None,
    ) -> dict[str, Any]:
        """Values of a table whose keys are known."""
        self.only(table, kinds, place, python or {})
        return {
            name: self.value(given, kinds[name], f"{place}.{name}")
            for name, given in table.items()
        }

    def made(self, call: Any, arguments: dict[str, Any], place: str) -> Any:
        """The result of a call; what it refuses is told with the place."""
        known = inspect.signature(call).parameters
        plain = {p.kind for p in known.values()}
        if inspect.Parameter.VAR_KEYWORD not in plain:
            for name, p in known.items():
                if p.default is inspect.Parameter.empty and name not in arguments:
                    if _has_default(call, name):
                        continue
                    raise self.error(place, f"{name}: is missing")
        try:
            return call(**arguments)
        except ValueError as error:
            raise self.error(place, str(error)) from error

    def plain(self, given: Any, kind: str, place: str) -> Any:
        """A number, a list of numbers, a word, a flag, a path."""
        number = isinstance(given, int | float) and not isinstance(given, bool)
        if kind == "number" and number:
            return float(given)
        if kind == "number" and isinstance(given, str):
            raise self.error(
                place, f"{given!r} must be a number; functions are for Python alone"
            )
        if kind == "count" and isinstance(given, int) and number:
            return given
        if kind == "flag" and isinstance(given, bool):
            return given
        if kind in ("word", "path") and isinstance(given, str):
            return given
        if kind == "file" and isinstance(given, str):
            return self.path.parent / given
        if kind == "layers" and isinstance(given, list):
            return tuple(tuple(pair) for pair in given)
        if kind == "word" and number:  # a toughness may be a number too
            return given
        if kind == "numbers":
            if number:
                return float(given)
            if isinstance(given, list) and all(
                isinstance(x, int | float) and not isinstance(x, bool) for x in given
            ):
                return [float(x) for x in given]
        what = {
            "number": "a number",
            "count": "a whole number",
            "numbers": "a list of numbers",
            "flag": "true or false",
            "layers": "a list of pairs (below, above)",
        }.get(kind, "a text in quotes")
        raise self.error(place, f"{given!r} must be {what}")


def _has_default(call: Any, name: str) -> bool:
    """Whether a field of a dataclass has a default made by a factory."""
    if not dataclasses.is_dataclass(call):
        return False
    return any(
        f.name == name and f.default_factory is not dataclasses.MISSING
        for f in dataclasses.fields(call)
    )
