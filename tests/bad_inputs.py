"""The one table of bad inputs: public doors, their arguments, what may be wrong.

A row is a door, arguments that are good, and the kind of each argument. A kind is what
may be wrong with any argument of it; every case spoils one argument. `CASES` has all of
them, and those that are written by hand, as (label, name that must be told, call).
"""

import functools
import math

import numpy as np

import jaxpd
from jaxpd import gallery, gradcheck, inverse, observe, physics

NAN, INF = math.nan, math.inf
NO_NUMBER = {"nan": NAN, "text": "one", "bool": True, "list": [1.0, 2.0]}
NO_FIELD = {"nan": NAN, "text": "one", "bool": True, "some nan": [1.0, NAN]}
KINDS = {
    "finite": NO_NUMBER | {"inf": INF, "none": None},
    "value": NO_NUMBER | {"inf": INF},  # None is free
    "positive": NO_NUMBER | {"inf": INF, "zero": 0.0, "negative": -1.0, "none": None},
    "positive or none": NO_NUMBER | {"inf": INF, "zero": 0.0, "negative": -1.0},
    "positive or inf": NO_NUMBER | {"zero": 0.0, "negative": -1.0},
    "not negative": NO_NUMBER | {"inf": INF, "negative": -1.0, "none": None},
    "share": NO_NUMBER | {"zero": 0.0, "negative": -0.5, "two": 2.0},
    "layer": NO_NUMBER | {"half": 0.5, "negative": -0.1, "none": None},
    "data": {"empty": [], "text": "abc", "none": None, "missing": [NAN], "inf": [INF]},
    "modulus": NO_FIELD | {"inf": INF, "below": -9.0, "none": None},
    "field": NO_FIELD | {"zero": 0.0, "negative": -1.0, "some": [1.0, -1.0]},
    "poisson": NO_FIELD | {"below": -1.5, "above": 1.5},
    "count": NO_NUMBER | {"half": 2.5, "negative": -3, "none": None},
    "count or none": NO_NUMBER | {"half": 2.5, "negative": -3},
    "ratio": {"unknown": "nonsense", "zero": 0.0, "nan": NAN, "list": ["nominal"]},
    "word": {"unknown": "nonsense", "number": 3, "empty": "", "list": ["auto"]},
    "flag": {"text": "yes", "number": 1, "none": None},
    "point": {
        "nan": (NAN, 0.5),
        "text": ("a", "b"),
        "word": "no",
        "number": 3.0,
        "none": None,
        "empty": (),
        "nested": ((0.0, 1.0),),
    },
    "region": {"text": "left", "number": 3.0, "none": None, "tuple": (0.0, 1.0)},
    "table": {"text": "ramp", "number": 3.0, "none": None},
    "list": {"text": "all", "number": 3, "wrong": [3.0], "none": None},
    "scene": {"text": "plate", "none": None, "dict": {"E": 1.0}},
    "array": {"empty": [], "text": "abc", "none": None, "nan": [[NAN, 0.0]]},
}
IN_2D = {"state": "plane stress", "nu": 1 / 3}
GLASS = functools.partial(jaxpd.Elastic, E=1.0, rho=1.0, **IN_2D)
SQUARE = jaxpd.box((0.0, 0.0), (1.0, 1.0))
EDGE, FAR, MID = jaxpd.below(x=0.0), jaxpd.above(x=1.0), (0.5, 0.5)
GRID = jaxpd.Bonds(dx=0.25, m=2)


@functools.cache
def plate(**changed):
    """A small plate that every driver takes."""
    given = {
        "body": SQUARE,
        "material": GLASS(G0=1.0),
        "supports": (jaxpd.holds(EDGE),),
        "loads": (jaxpd.pull(FAR, x=1e-6),),
        "resolution": GRID,
    }
    return jaxpd.Scene(**(given | changed))


@functools.cache
def nodes(**changed):
    """A small bar of nodes for load steps."""
    bar = jaxpd.box((0.0,), (1.0,))
    given = {
        "body": bar,
        "material": jaxpd.von_mises(1.0, None, 0.1, state="bar"),
        "supports": (jaxpd.holds(EDGE), jaxpd.moves(FAR, x=0.01, time=jaxpd.ramp(1.0))),
        "resolution": jaxpd.MLS(dx=0.125),
    }
    return jaxpd.Scene(**(given | changed))


@functools.cache
def prepared():
    """A problem, for doors that take one."""
    return jaxpd.prepare(plate(kinematics="small"), solver="d-pcg")


PLIES = [jaxpd.box((0.0, 0.0), (1.0, 0.4)), jaxpd.box((0.0, 0.5), (1.0, 1.0))]
XY = dict.fromkeys("xyz", "value")
#: (door, good arguments, kind of each argument that is spoilt)
ROWS = [
    (jaxpd.box, {"lo": (0.0, 0.0), "hi": (1.0, 1.0)}, {"lo": "point", "hi": "point"}),
    (
        jaxpd.ball,
        {"centre": MID, "radius": 1.0},
        {"centre": "point", "radius": "positive"},
    ),
    (jaxpd.segment, {"a": (0.0, 0.0), "b": MID}, {"a": "point", "b": "point"}),
    (
        jaxpd.rectangle,
        {
            "corner": (0.0, 0.0, 0.0),
            "edge1": (1.0, 0.0, 0.0),
            "edge2": (0.0, 1.0, 0.0),
        },
        {"corner": "point", "edge1": "point", "edge2": "point"},
    ),
    (
        jaxpd.lattice,
        {"lo": (0.0, 0.0), "hi": (1.0, 1.0), "dx": 0.5},
        {
            "lo": "point",
            "hi": "point",
            "dx": "positive",
            "nodes": "word",
        },
    ),
    (
        jaxpd.from_points,
        {"X": [[0.0, 0.0], [1.0, 0.0]], "vol": 1.0},
        {"X": "array", "vol": "field"},
    ),
    (
        jaxpd.mapped,
        {"shape": (3, 3), "place": lambda s: s},
        {"shape": "point", "jitter": "not negative", "seed": "count"},
    ),
    (
        jaxpd.outlined,
        {"X": [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]], "loops": [[0, 1, 2]]},
        {"X": "array"},
    ),
    (
        jaxpd.Elastic,
        {"E": 1.0, "nu": 0.25},
        {
            "E": "field",
            "nu": "poisson",
            "state": "word",
            "rho": "field",
            "G0": "field",
        },
    ),
    (
        jaxpd.Solid,
        {"law": physics.pmb(1.0, 0.25, "solid", 3, 1.0), "rho": 1.0},
        {"rho": "field", "s_crit": "field"},
    ),
    (
        jaxpd.von_mises,
        {"E": 1.0, "nu": 0.25, "state": "solid", "sigma_y": 0.1},
        {
            "E": "field",
            "nu": "poisson",
            "state": "word",
            "sigma_y": "field",
            "h_iso": "modulus",
            "h_kin": "modulus",
        },
    ),
    (jaxpd.fractional, {"alpha": 0.0}, {"alpha": "finite"}),
    (jaxpd.gaussian, {"ratio": 0.3}, {"ratio": "positive"}),
    (
        jaxpd.Bonds,
        {"dx": 0.25, "m": 2},
        {
            "dx": "positive or none",
            "m": "positive or none",
            "partial": "word",
            "correction": "word",
            "nodes": "word",
            "calibration": "word",
            "kernel": "word",
        },
    ),
    (jaxpd.Bonds, {"dx": 0.25, "delta": 0.5}, {"delta": "positive or none"}),
    (
        jaxpd.RKPM,
        {"dx": 0.25},
        {
            "dx": "positive or none",
            "scheme": "word",
            "degree": "count",
            "support": "positive",
            "alpha": "not negative",
        },
    ),
    (
        jaxpd.MLS,
        {"dx": 0.25},
        {
            "dx": "positive or none",
            "degree": "count",
            "support": "positive or none",
            "rim_support": "positive or none",
            "tau": "not negative",
            "scheme": "word",
            "volume": "word",
        },
    ),
    (
        jaxpd.moves,
        {"region": EDGE, "x": 1.0},
        XY | {"region": "region", "time": "table"},
    ),
    (jaxpd.drives, {"region": EDGE, "x": 1.0}, XY | {"region": "region"}),
    (jaxpd.holds, {"region": EDGE}, {"region": "region"}),
    (
        jaxpd.body_force,
        {"region": EDGE},
        dict.fromkeys("xyz", "finite") | {"region": "region", "time": "table"},
    ),
    (
        jaxpd.pull,
        {"region": EDGE},
        dict.fromkeys("xyz", "finite") | {"region": "region", "time": "table"},
    ),
    (
        jaxpd.traction,
        {"face": FAR},
        dict.fromkeys("xyz", "finite") | {"face": "region", "time": "table"},
    ),
    (
        jaxpd.pressure,
        {"region": EDGE, "p": 1.0},
        {"p": "finite", "region": "region", "time": "table"},
    ),
    (
        jaxpd.initially,
        {"region": EDGE, "ux": 0.0},
        dict.fromkeys(("ux", "uy", "uz", "vx", "vy", "vz"), "value")
        | {"region": "region"},
    ),
    (jaxpd.ramp, {"rise": 1.0}, {"rise": "positive", "start": "finite"}),
    (
        jaxpd.table,
        {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
        {"times": "point", "factors": "point"},
    ),
    (
        jaxpd.interlayer,
        {"E": 1.0},
        {
            "E": "positive",
            "shear": "positive or none",
            "G0": "positive or none",
            "rho": "not negative",
            "delta": "positive or none",
            "rule": "word",
            "one_way": "flag",
        },
    ),
    (jaxpd.adhesive, {"E": 1.0, "nu": 0.3}, {"E": "positive", "nu": "layer"}),
    (
        jaxpd.laminate,
        {"plies": PLIES, "interlayers": jaxpd.interlayer(1.0)},
        {"plies": "list", "interlayers": "word"},
    ),
    (
        jaxpd.Scene,
        {"body": SQUARE, "material": GLASS()},
        {
            "body": "scene",
            "material": "scene",
            "supports": "list",
            "loads": "list",
            "cracks": "list",
            "starts": "list",
            "no_fail": "list",
            "weak": "list",
            "kinematics": "word",
            "resolution": "word",
        },
    ),
    (
        jaxpd.prepare,
        {"scene": plate()},
        {
            "scene": "scene",
            "solver": "word",
            "operator": "word",
            "tangent": "word",
            "rtol": "share",
            "linear_rtol": "share",
            "load_steps": "count",
            "max_iterations": "count",
            "linear_maxiter": "count",
        },
    ),
    (
        jaxpd.solve_static,
        {"scene": plate()},
        {"scene": "scene", "solver": "word", "operator": "word", "rtol": "share"},
    ),
    (
        jaxpd.prepare_motion,
        {"scene": plate()},
        {
            "scene": "scene",
            "operator": "word",
            "dtype": "word",
            "softening": "share",
        },
    ),
    (
        jaxpd.run_explicit,
        {"scene": plate(), "duration": 1e-3},
        {
            "scene": "scene",
            "duration": "positive",
            "dt": "positive or none",
            "safety": "share",
            "records": "count",
            "frames": "count",
            "unstable_dt": "flag",
        },
    ),
    (
        jaxpd.solve_relaxed,
        {"scene": plate()},
        {"scene": "scene", "rtol": "share", "max_steps": "count"},
    ),
    (
        jaxpd.solve_path,
        {"scene": nodes(), "times": [0.5, 1.0]},
        {
            "scene": "scene",
            "times": "array",
        },
    ),
    (
        jaxpd.solve_fracture,
        {"scene": plate()},
        {
            "scene": "scene",
            "few": "count or none",
            "ties": "share",
            "solver": "word",
            "operator": "word",
            "rtol": "share",
            "severed": "share",
            "max_states": "count",
            "max_factor": "positive or inf",
            "toughness": "ratio",
            "softening": "positive or none",
            "amount": "positive or none",
            "maxiter": "count",
            "watch": "list",
            "end": "word",
        },
    ),
    (jaxpd.audit, {"scene": plate()}, {"scene": "scene", "corrections": "word"}),
    (jaxpd.trapping, {"scene": plate()}, {"scene": "scene"}),
    (
        jaxpd.plan,
        {"scene": plate()},
        {
            "scene": "scene",
            "job": "word",
            "accuracy": "positive or none",
            "seconds": "positive or none",
            "duration": "positive or none",
        },
    ),
    (
        inverse.positive,
        {"start": 1.0},
        {"start": "field"},
    ),
    (
        inverse.bounded,
        {"start": 1.0, "low": 0.0, "high": 2.0},
        {"start": "field", "low": "finite", "high": "finite"},
    ),
    (
        inverse.free,
        {"start": 1.0, "scale": 1.0},
        {"scale": "positive", "start": "array"},
    ),
    (
        observe.observation,
        {"data": [1.0], "predict": lambda problem, params, u: u},
        {"data": "data", "sigma": "field", "predict": "region"},
    ),
    (
        gradcheck.taylor,
        {"function": lambda x: x, "at": 1.0, "directions": {"x": 1.0}},
        {"mode": "word", "order": "count", "noise": "positive"},
    ),
    (
        gallery.cracked_plate,
        {},
        {
            "n": "count",
            "m": "positive",
            "alpha": "finite",
            "strain": "finite",
            "loading": "word",
            "kinematics": "word",
            "partial": "word",
            "correction": "word",
        },
    ),
    (
        gallery.branching_plate,
        {},
        {
            "m": "positive",
            "delta": "positive",
            "stress": "finite",
            "G0": "field",
            "partial": "word",
        },
    ),
    (
        gallery.kalthoff_winkler,
        {},
        {"m": "positive", "delta": "positive", "speed": "finite"},
    ),
    (
        gallery.bar_wave,
        {},
        {
            "n": "count",
            "m": "positive",
            "width": "positive",
            "amplitude": "finite",
            "alpha": "finite",
        },
    ),
]


def call(door, good, name, value):
    """Call a door with one argument spoilt."""
    return door(**(good | {name: value}))


def _table():
    for door, good, kinds in ROWS:
        for name, kind in kinds.items():
            for label, value in KINDS[kind].items():
                told = f"{door.__module__}.{door.__name__}({name}: {label})"
                if door in (jaxpd.Elastic, jaxpd.Solid) and label == "some nan":
                    value = np.array(value)
                if good.get(name, 0) is None and value is None:
                    continue
                yield told, name, functools.partial(call, door, good, name, value)


CASES = [*_table()]
