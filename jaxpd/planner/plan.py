"""A plan: what a scene is modelled with, what that costs and errs, and why. Data."""

from __future__ import annotations

import dataclasses
import inspect
import textwrap
from dataclasses import dataclass, field
from typing import Any

from jaxpd.checks import option
from jaxpd.explicit import run_explicit
from jaxpd.fracture import solve_fracture
from jaxpd.launch import prepare_motion
from jaxpd.path import solve_path
from jaxpd.planner.cost import Cost
from jaxpd.prepare import prepare
from jaxpd.run import solve_static
from jaxpd.scene import Scene

#: What runs each job, and the name of its second argument, if it has one.
DRIVERS = {
    "static": (solve_static, None),
    "motion": (run_explicit, "duration"),
    "path": (solve_path, "times"),
    "fracture": (solve_fracture, None),
}


def options_of(job: str) -> list[str]:
    """Names of the options of a job's driver, those that it hands on included."""
    driver, _ = DRIVERS[job]
    known = list(inspect.signature(driver).parameters)[1:]
    if "options" in known:
        handed = prepare_motion if job == "motion" else prepare
        known.remove("options")
        known += list(inspect.signature(handed).parameters)[1:]
    return known


@dataclass(frozen=True, eq=False)
class Plan:
    """How a scene is to be modelled and solved, and why: data that prints as a table.

    Attributes:
        scene: the scene, its resolution and kinematics decided.
        job: "static", "motion", "path" or "fracture".
        choice: what was decided, by field: theory, resolution, kinematics, memory,
            operator, solver, dtype, dt, and whatever the user fixed.
        options: of the driver that runs it.
        cost: predicted compilation, time and memory.
        error: expected relative error, or None where nothing measured tells it.
        basis: what that error is taken from.
        reasons: why, by field, in words.
        warnings: what the scene models that it does not need, and other doubts.
        asked: what the user asked for, for `changed`.
    """

    scene: Scene
    job: str
    choice: dict[str, Any]
    options: dict[str, Any]
    cost: Cost
    error: float | None
    basis: str
    reasons: dict[str, str]
    warnings: tuple[str, ...] = ()
    asked: dict[str, Any] = field(default_factory=dict)

    def run(self, **more: Any) -> Any:
        """Run it: a `Solution`, `Run`, `Path` or `Growth`.

        Args:
            **more: further options of the driver, as folder= or records=; they
                override those of the plan.

        Raises:
            ValueError: if the driver needs what is not there: a duration of a motion,
                times of a path; on an option that it does not have.
        """
        driver: Any
        driver, needed = DRIVERS[self.job]
        known = options_of(self.job)
        for name in more:
            option(name, known, f"a {self.job}")
        options = self.options | more
        if needed is None:
            return driver(self.scene, **options)
        if options.get(needed) is None:
            raise ValueError(f"{needed}: a {self.job} needs one: run({needed}=..)")
        return driver(self.scene, options.pop(needed), **options)

    def __str__(self) -> str:
        """A table: field, choice, reason; then cost, error and warnings."""
        rows = [("job", self.job, self.reasons.get("job", ""))]
        rows += [
            (name, _words(value), self.reasons.get(name, ""))
            for name, value in self.choice.items()
        ]
        error = "not known" if self.error is None else f"about {self.error:.1g}"
        rows += [
            ("time", str(self.cost), self.reasons.get("cost", "")),
            ("error", error, self.basis),
        ]
        left = max(len(row[0]) for row in rows)
        middle = min(34, max(len(row[1]) for row in rows))
        lines = []
        for name, value, why in rows:
            cells = textwrap.wrap(value, middle) or [""]
            words = textwrap.wrap(why, 52) or [""]
            for i in range(max(len(cells), len(words))):
                head = name if i == 0 else ""
                cell = cells[i] if i < len(cells) else ""
                word = words[i] if i < len(words) else ""
                lines.append(f"{head:<{left}}  {cell:<{middle}}  {word}".rstrip())
        lines += [
            line
            for warning in self.warnings
            for line in textwrap.wrap(f"warning: {warning}", 88, subsequent_indent="  ")
        ]
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Names, numbers and words alone, for JSON."""
        return {
            "job": self.job,
            "choice": {name: _words(value) for name, value in self.choice.items()},
            "cost": dataclasses.asdict(self.cost),
            "error": self.error,
            "basis": self.basis,
            "reasons": dict(self.reasons),
            "warnings": list(self.warnings),
        }


def _words(value: Any) -> str:
    """A choice in few words: of data only what differs from the defaults."""
    if isinstance(value, list | tuple):
        return "; ".join(map(_words, value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        parts = [
            f"{f.name}={_words(getattr(value, f.name))}"
            for f in dataclasses.fields(value)
            if getattr(value, f.name) != f.default
        ]
        return f"{type(value).__name__}({', '.join(parts)})"
    return f"{value:.4g}" if isinstance(value, float) else str(value)
