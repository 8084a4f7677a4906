"""More bad inputs: results and what is asked of them, files, refinement, the gallery.

Rows as in `tests.bad_inputs`; those of the gallery are made from its signatures.
"""

import functools
import inspect
import math

import numpy as np

import jaxpd
from jaxpd import command, fracture, observe, physics
from jaxpd.planner import changed
from tests.bad_inputs import EDGE, KINDS, call, plate

CRACK = jaxpd.segment((0.25, 0.5), (0.75, 0.5))
FAR_AWAY = jaxpd.above(y=50.0)
PATHS = {"number": 3, "none": None, "nowhere": "/nowhere/at/all/x.toml"}
OBJECTS = {"text": "found", "number": 3.0, "none": None, "array": np.ones(3)}
KINDS = KINDS | {
    "path": PATHS,
    "object": OBJECTS,
    "function": {"number": 3.0, "text": "largest", "wrong": lambda s: "one"},
    "spacings": {
        "text": "abc",
        "nan": [math.nan, 0.5],
        "flat": 3.0,
        "zero": [1.0, 0.0],
    },
    "hardening": {"nan": math.nan, "text": "one", "bool": True, "inf": math.inf},
    "numbers": {"text": "abc", "nan": [math.nan, 0.5], "none": None, "flat": 3.0},
    "position": {"nan": math.nan, "text": "mid", "below": -0.5, "above": 1.5},
    "level": {"nan": math.nan, "text": "high", "zero": 0.0, "one": 1.0},
}


@functools.cache
def solved():
    """A solution with a crack in it."""
    fine = jaxpd.Bonds(dx=0.1, m=3, nodes="cell")
    cracked = plate(cracks=(CRACK,), resolution=fine, loads=())
    return jaxpd.solve_static(cracked)


def opening(**given):
    """The opening of a solution's crack."""
    return solved().opening(**given)


def reaction_on(**given):
    """The resultant of a solution's supports."""
    return solved().reaction_on(**given)


def layer_traction(**given):
    """The traction of a layer that is not there."""
    return solved().traction(**given)


def changed_plan(**given):
    """A plan changed."""
    return changed(jaxpd.plan(plate()), **given)


def run_plan(**given):
    """A plan run."""
    return jaxpd.plan(plate()).run(**given)


def hardened(**given):
    """A law that hardens after Voce."""
    law = physics.Voce(**given)
    return jaxpd.von_mises(1.0, 0.25, state="solid", hardening=law)


def openings(**given):
    """Openings as observations."""
    return observe.openings(solved().problem, **given)


def refine(**given):
    """A refinement of a small plate."""
    return jaxpd.refine(**({"scene": plate(), "levels": 2} | given))


def save_scene(**given):
    """A scene written to nowhere that is left behind."""
    return jaxpd.save_scene(**({"path": "/dev/null", "scene": plate()} | given))


def run_explicit(**given):
    """A short motion."""
    moving = plate(resolution=jaxpd.Bonds(dx=0.1, m=3))
    return jaxpd.run_explicit(moving, 1e-3, **given)


FOLDERS = {"number": 3, "nowhere": "/nowhere/at/all", "file": __file__}
KINDS |= {"folder": FOLDERS, "region here": KINDS["region"] | {"far": FAR_AWAY}}
ROWS = [
    (run_explicit, {}, {"folder": "folder", "toll": "object"}),
    (
        refine,
        {},
        {
            "scene": "object",
            "what": "word",
            "quantity": "function",
            "exact": "value",
            "sizes": "spacings",
            "levels": "count",
            "ratio": "positive",
        },
    ),
    (jaxpd.picture, {"found": 0}, {"found": "object"}),
    (save_scene, {}, {"path": "path", "scene": "object", "job": "word"}),
    (jaxpd.load_scene, {"path": "x.toml"}, {"path": "path"}),
    (jaxpd.from_mesh, {"file": "x.msh"}, {"file": "path", "points": "word"}),
    (jaxpd.geometry.read_points, {"file": "x.csv"}, {"file": "path"}),
    (changed_plan, {}, {"accuracy": "positive or none", "job": "word"}),
    (changed, {"found": 0}, {"found": "object"}),
    (run_plan, {}, {"rtol": "share", "solver": "word", "toll": "object"}),
    (
        fracture.prepare_fracture,
        {"scene": plate()},
        {"scene": "scene", "toughness": "ratio"},
    ),
    (opening, {"crack": CRACK}, {"crack": "object", "at": "position"}),
    (reaction_on, {"region": EDGE}, {"region": "region here"}),
    (layer_traction, {}, {"layer": "count"}),
    (
        openings,
        {"crack": CRACK, "at": [0.5], "data": [0.0]},
        {"crack": "object", "at": "numbers", "data": "data"},
    ),
    (
        hardened,
        {"sigma_y": 1.0, "rise": 1.0, "rate": 1.0, "h_iso": 0.0},
        dict.fromkeys(("sigma_y", "rise", "rate", "h_iso"), "hardening"),
    ),
    (
        physics.pmb,
        {"E": 1.0, "nu": 1 / 3, "state": "plane stress", "d": 2, "delta": 0.3},
        {"nu": "poisson", "state": "word", "d": "count", "delta": "positive"},
    ),
]
#: What the arguments of the gallery's scenes are, by the type of their default.
GALLERY = {
    float: {"nan": math.nan, "text": "one", "list": [1.0, 2.0]},
    int: {"nan": math.nan, "text": "one", "half": 2.5, "negative": -3},
    str: {"unknown": "nonsense", "number": 3},
}
#: Fields may be lists, and the default of a ratio may be a whole number.
FREE = {("E", "list"), ("G0", "list"), ("m", "half")}
#: Fields of a wrong length.
UNCACHED = plate.__wrapped__
WRONG_LENGTH = {
    f"{name} on {type(resolution).__name__}": (
        name,
        functools.partial(
            jaxpd.prepare, UNCACHED(material=material, resolution=resolution, loads=())
        ),
    )
    for name, material in {
        "E": jaxpd.Elastic(np.ones(50), 1 / 3, "plane stress"),
        "rho": jaxpd.Elastic(1.0, 1 / 3, "plane stress", rho=np.ones(50)),
    }.items()
    for resolution in (
        jaxpd.Bonds(dx=0.1, m=3),
        jaxpd.MLS(dx=0.125),
        jaxpd.RKPM(dx=0.125),
    )
    if name == "E" or isinstance(resolution, jaxpd.Bonds)
}


def _cases():
    for door, good, kinds in ROWS:
        for name, kind in kinds.items():
            for label, value in KINDS[kind].items():
                if good.get(name, 0) is None and value is None:
                    continue
                spoilt = functools.partial(call, door, good, name, value)
                yield f"{door.__name__}({name}: {label})", name, spoilt
    for made, make in command.scenes().items():
        for name, p in inspect.signature(make).parameters.items():
            for label, value in GALLERY.get(type(p.default), {}).items():
                if (name, label) in FREE:
                    continue
                spoilt = functools.partial(call, make, {}, name, value)
                yield f"gallery.{made}({name}: {label})", name, spoilt
    for label, (name, spoilt) in WRONG_LENGTH.items():
        yield f"wrong length({label})", name, spoilt


CASES = [*_cases()]
