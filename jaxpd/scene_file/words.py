"""The words of a scene file: each is a function of Python and its arguments.

A file says what Python would. A call is a table with one key, the name of the function,
whose value is a table of its arguments:

    region = { above = { y = 0.5 } }          jaxpd.above(y=0.5)

Groups say which words may stand where; kinds what an argument has to be: a number, a
list of numbers, a word, a flag, or one of a group (in brackets: a list of them).
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jaxpd.conditions as conditions
import jaxpd.geometry as geometry
import jaxpd.resolution as resolution
from jaxpd.explicit import run_explicit
from jaxpd.fracture import solve_fracture
from jaxpd.laminate import adhesive, interlayer, laminate
from jaxpd.path import solve_path
from jaxpd.physics import Voce, von_mises
from jaxpd.relaxed import solve_relaxed
from jaxpd.run import solve_static
from jaxpd.scene import Elastic
from jaxpd.schedule import ramp, table


@dataclass(frozen=True)
class Word:
    """A function that a file may call.

    Attributes:
        call: the function.
        kinds: of its arguments by name; what is not here only Python can say.
        python: arguments that only Python can say, and how.
    """

    call: Callable[..., Any]
    kinds: dict[str, str]
    python: dict[str, str] = field(default_factory=dict)

    @property
    def needed(self) -> list[str]:
        """Arguments without a default."""
        known = inspect.signature(self.call).parameters
        return [
            name
            for name in self.kinds
            if name in known and known[name].default is inspect.Parameter.empty
        ]


XYZ = {"x": "number", "y": "number", "z": "number"}
UV = {a + b: "number" for a in "uv" for b in "xyz"}
BONDS = {
    "dx": "number",
    "m": "number",
    "delta": "number",
    "kernel": "kernel",
    "partial": "word",
    "correction": "word",
    "nodes": "word",
    "layers": "layers",
    "calibration": "word",
}
RATES = {"E": "number", "nu": "number", "state": "word"}
LAYER = {"G0": "number", "rho": "number", "delta": "number", "rule": "word"}
WORDS = {
    "above": Word(geometry.above, XYZ),
    "below": Word(geometry.below, XYZ),
    "box": Word(geometry.box, {"lo": "numbers", "hi": "numbers"}),
    "ball": Word(geometry.ball, {"centre": "numbers", "radius": "number"}),
    "union": Word(lambda parts: geometry.union(*parts), {"parts": "[region]"}),
    "segment": Word(geometry.segment, {"a": "numbers", "b": "numbers"}),
    "rectangle": Word(
        geometry.rectangle,
        {"corner": "numbers", "edge1": "numbers", "edge2": "numbers"},
    ),
    "laminate": Word(laminate, {"plies": "[box]", "interlayers": "layer"}),
    "interlayer": Word(
        interlayer, {"E": "number", "shear": "number", "one_way": "flag"} | LAYER
    ),
    "adhesive": Word(
        adhesive, {"E": "number", "nu": "number", "one_way": "flag"} | LAYER
    ),
    "mesh": Word(geometry.from_mesh, {"file": "file", "points": "word"}),
    "points": Word(geometry.read_points, {"file": "file"}),
    "Elastic": Word(Elastic, RATES | {"rho": "number", "G0": "number"}),
    "von_mises": Word(
        von_mises,
        RATES
        | {
            "sigma_y": "number",
            "h_iso": "number",
            "h_kin": "number",
            "hardening": "hardening",
        },
    ),
    "Voce": Word(
        Voce,
        dict.fromkeys(inspect.signature(Voce).parameters, "number"),
    ),
    "moves": Word(conditions.moves, {"region": "region", **XYZ, "time": "time"}),
    "holds": Word(conditions.holds, {"region": "region"}),
    "drives": Word(conditions.drives, {"region": "region", **XYZ}),
    "body_force": Word(
        conditions.body_force, {"region": "region", **XYZ, "time": "time"}
    ),
    "pull": Word(conditions.pull, {"region": "region", **XYZ, "time": "time"}),
    "traction": Word(conditions.traction, {"face": "region", **XYZ, "time": "time"}),
    "pressure": Word(
        conditions.pressure, {"region": "region", "p": "number", "time": "time"}
    ),
    "initially": Word(conditions.initially, {"region": "region", **UV}),
    "ramp": Word(ramp, {"rise": "number", "start": "number"}),
    "table": Word(table, {"times": "numbers", "factors": "numbers"}),
    "Bonds": Word(resolution.Bonds, BONDS),
    "MLS": Word(
        resolution.MLS,
        {
            "dx": "number",
            "degree": "count",
            "support": "number",
            "rim_support": "number",
            "tau": "number",
            "scheme": "word",
            "volume": "word",
        },
    ),
    "RKPM": Word(
        resolution.RKPM,
        {
            "dx": "number",
            "scheme": "word",
            "degree": "count",
            "support": "number",
            "alpha": "number",
        },
    ),
    "fractional": Word(resolution.fractional, {"alpha": "number"}),
    "constant": Word(resolution.constant, {}),
    "conical": Word(resolution.conical, {}),
    "gaussian": Word(resolution.gaussian, {"ratio": "number"}),
}
GROUPS = {
    "body": ("box", "laminate", "mesh", "points"),
    "box": ("box",),
    "region": ("above", "below", "box", "ball", "union"),
    "crack": ("segment", "rectangle"),
    "material": ("Elastic", "von_mises"),
    "hardening": ("Voce",),
    "layer": ("interlayer", "adhesive"),
    "support": ("moves", "holds", "drives"),
    "load": ("body_force", "pull", "traction", "pressure"),
    "start": ("initially",),
    "time": ("ramp", "table"),
    "resolution": ("Bonds", "MLS", "RKPM"),
    "kernel": ("fractional", "constant", "conical", "gaussian"),
}
#: Fields of a scene and what stands there.
SCENE = {
    "body": "body",
    "material": "material",
    "supports": "[support]",
    "loads": "[load]",
    "cracks": "[crack]",
    "resolution": "resolution",
    "kinematics": "word",
    "starts": "[start]",
    "no_fail": "[region]",
    "weak": "[crack]",
}
LINEAR = {
    "solver": "word",
    "operator": "word",
    "tangent": "word",
    "rtol": "number",
    "linear_rtol": "number",
    "max_iterations": "count",
    "linear_maxiter": "count",
}
#: Drivers and their options.
JOBS = {
    "static": Word(solve_static, LINEAR | {"load_steps": "count"}),
    "motion": Word(
        run_explicit,
        {
            "duration": "number",
            "dt": "number",
            "safety": "number",
            "records": "count",
            "frames": "count",
            "unstable_dt": "flag",
            "operator": "word",
            "dtype": "word",
            "softening": "number",
        },
    ),
    "path": Word(
        solve_path,
        {"times": "numbers"} | {k: LINEAR[k] for k in ("solver", "tangent", "rtol")},
    ),
    "fracture": Word(
        solve_fracture,
        {
            "factors": "numbers",
            "few": "count",
            "ties": "number",
            "toughness": "word",
            "softening": "number",
            "amount": "number",
            "solver": "word",
            "operator": "word",
            "rtol": "number",
            "maxiter": "count",
            "end": "region",
            "severed": "number",
            "max_factor": "number",
            "max_states": "count",
            "watch": "[region]",
        },
    ),
    "relaxed": Word(
        solve_relaxed,
        {
            name: "number"
            for name in inspect.signature(solve_relaxed).parameters
            if name in ("rtol", "max_steps")
        },
    ),
}
#: Other names of the same thing, as hints where a key is not known.
SAME = (
    ("face", "region"),
    ("E", "youngs_modulus", "young", "modulus"),
    ("nu", "poissons_ratio", "poisson"),
    ("rho", "density"),
    ("G0", "Gc", "fracture_energy", "toughness"),
    ("dx", "h", "spacing"),
    ("delta", "horizon"),
    ("duration", "time", "end_time", "t_end"),
    ("box", "rectangle_body", "domain"),
    ("cracks", "notches", "crack"),
    ("supports", "boundary_conditions", "bcs"),
    ("p", "pressure"),
)
#: What is planned, and how results are kept.
PLAN = {"accuracy": "number", "seconds": "number"}
OUTPUT = {"folder": "path", "picture": "flag", "vtu": "flag", "keep": "flag"}
