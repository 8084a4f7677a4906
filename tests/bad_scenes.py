"""Bad inputs that are written by hand: parts that are good and do not go together.

`CASES` as in `tests.bad_inputs`: a label, the name that must be told, a call.
"""

# wrong types are what is tried here
# pyright: reportArgumentType=false

import functools

import numpy as np

import jaxpd
from jaxpd import crack_path, fitting, gradcheck, inverse, observe
from tests.bad_inputs import (
    EDGE,
    FAR,
    GLASS,
    GRID,
    MID,
    NAN,
    PLIES,
    SQUARE,
    nodes,
    plate,
    prepared,
)

CUBE = jaxpd.box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
NOWHERE = jaxpd.box((7.0, 7.0), (8.0, 8.0))
GLUE = jaxpd.interlayer(1.0)
PAIR = np.array([[0.0, 0.0], [1.0, 0.0]])
SIDE = np.stack(np.meshgrid(*[np.arange(4.0)] * 2), -1).reshape(-1, 2)
DOUBLE = np.concatenate([SIDE, SIDE + 50.0])
MOVES = functools.partial(jaxpd.moves, EDGE)


def lone(X, delta=1.6, **changed):
    """A scene of given points, the left ones held."""
    made = {"loads": (), "resolution": jaxpd.Bonds(delta=delta)} | changed
    return plate_of(body=jaxpd.from_points(X, 1.0), **made)


def plate_of(**changed):
    """The small plate; not kept, as its parts may be arrays or functions."""
    return plate.__wrapped__(**changed)


#: What of the small plate is changed, the name that must be told, by which door.
STATIC = {
    "support nowhere": ("supports", {"supports": [jaxpd.holds(NOWHERE)]}),
    "support along z": ("supports", {"supports": [MOVES(x=0, y=0, z=0.1)]}),
    "support in 3-D": ("lo", {"supports": [jaxpd.holds(CUBE)]}),
    "ball in 3-D": ("centre", {"supports": [jaxpd.holds(jaxpd.ball((0, 0, 0), 1.0))]}),
    "plane of z": ("axis", {"supports": [jaxpd.holds(jaxpd.below(z=0.0))]}),
    "no support": ("supports", {"supports": ()}),
    "free to turn": ("supports", {"supports": [MOVES(x=0.0)], "resolution": GRID}),
    "all held": ("supports", {"supports": [jaxpd.holds(SQUARE)], "loads": ()}),
    "support NaN": ("supports", {"supports": [MOVES(x=lambda X: NAN * X[:, 0], y=0)]}),
    "support shape": ("supports", {"supports": [MOVES(x=lambda X: X[:2], y=0.0)]}),
    "support text": ("supports", {"supports": [MOVES(x=lambda X: "left", y=0.0)]}),
    "support ramp": (
        "supports",
        {"supports": [MOVES(x=0.0, y=0.0, time=jaxpd.ramp(1.0))]},
    ),
    "drives": ("supports", {"supports": [jaxpd.drives(EDGE, x=1.0, y=0.0)]}),
    "load nowhere": ("loads", {"loads": [jaxpd.pull(NOWHERE, x=1.0)]}),
    "load along z": ("loads", {"loads": [jaxpd.pull(FAR, z=1.0)]}),
    "load in 3-D": ("lo", {"loads": [jaxpd.body_force(CUBE, x=1.0)]}),
    "load NaN": ("loads", {"loads": [jaxpd.body_force(FAR, x=lambda X: NAN)]}),
    "load shape": ("loads", {"loads": [jaxpd.body_force(FAR, x=lambda X: X.T)]}),
    "load on held": ("loads", {"loads": [jaxpd.pull(EDGE, x=1.0)]}),
    "load ramp": ("loads", {"loads": [jaxpd.pull(FAR, x=1.0, time=jaxpd.ramp(1.0))]}),
    "traction inside": ("loads", {"loads": [jaxpd.traction(jaxpd.above(x=0.5), x=1)]}),
    "traction on ball": (
        "loads",
        {"loads": [jaxpd.traction(jaxpd.ball(MID, 0.3), x=1)]},
    ),
    "pressure": ("loads", {"loads": [jaxpd.pressure(FAR, 1.0)]}),
    "starts": ("starts", {"starts": [jaxpd.initially(FAR, ux=0.1)]}),
    "no_fail": ("no_fail", {"no_fail": [FAR]}),
    "weak": ("weak", {"weak": [jaxpd.segment((0, 0.4), (1, 0.4))]}),
    "crack in 3-D": (
        "cracks",
        {"cracks": [jaxpd.rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))]},
    ),
    "crack outside": ("cracks", {"cracks": [jaxpd.segment((5.0, 5.1), (6.0, 5.1))]}),
    "crack far below": ("cracks", {"cracks": [jaxpd.segment((0, -9.1), (1, -9.1))]}),
    "crack apart": (
        "supports",
        {"cracks": [jaxpd.segment((0.6, -9.0), (0.6, 9.0))]},
    ),
    "no diagonals": ("m", {"resolution": jaxpd.Bonds(dx=0.25, m=1)}),
    "horizon beyond body": ("m", {"resolution": jaxpd.Bonds(dx=0.25, m=400)}),
    "long horizon": ("delta", {"resolution": jaxpd.Bonds(dx=0.25, delta=1e9)}),
    "m and delta": ("m", {"resolution": jaxpd.Bonds(dx=0.25, m=2, delta=0.5)}),
    "no horizon": ("m", {"resolution": jaxpd.Bonds(dx=0.25)}),
    "no spacing": ("dx", {"resolution": jaxpd.Bonds(delta=0.5)}),
    "spacing does not divide": ("dx", {"resolution": jaxpd.Bonds(dx=0.3, m=2)}),
    "spacing above body": ("m", {"resolution": jaxpd.Bonds(dx=2.0, m=2)}),
    "spacing in nm": ("dx", {"resolution": jaxpd.Bonds(dx=1e-9, m=3)}),
    "body in nm": ("dx", {"body": jaxpd.box((0, 0), (1e9, 1e9))}),
    "endless body": ("lo|hi", {"body": jaxpd.box((0, 0), (1, float("inf")))}),
    "state of solids": ("state", {"material": jaxpd.Elastic(1.0, 0.25)}),
    "state of bars": ("state", {"material": jaxpd.Elastic(1.0, None, "bar")}),
    "nu of bonds": ("nu", {"material": jaxpd.Elastic(1.0, 0.3, "plane stress")}),
    "E of three points": ("E", {"material": GLASS(E=np.ones(3))}),
    "E of rows": ("E", {"material": GLASS(E=np.ones((5, 5)))}),
    "law of nodes": ("material", {"material": nodes().material}),
    "node method, crack": (
        "cracks",
        {
            "resolution": jaxpd.MLS(dx=0.25),
            "cracks": [jaxpd.segment((0, 0.4), (1, 0.4))],
        },
    ),
    "nodes without spacing": ("dx", {"resolution": jaxpd.MLS()}),
    "kernels without spacing": ("dx", {"resolution": jaxpd.RKPM()}),
}
ROWS = [
    (f"prepare, {label}", name, lambda c=changed: jaxpd.prepare(plate_of(**c)))
    for label, (name, changed) in STATIC.items()
]
MOVING = {
    "no density": ("material", {"material": jaxpd.Elastic(1.0, 1 / 3, "plane stress")}),
    "start nowhere": ("starts", {"starts": [jaxpd.initially(NOWHERE, ux=0.1)]}),
    "start along z": ("starts", {"starts": [jaxpd.initially(FAR, uz=0.1)]}),
    "start NaN": ("starts", {"starts": [jaxpd.initially(FAR, ux=lambda X: NAN)]}),
    "no_fail nowhere": ("no_fail", {"no_fail": [NOWHERE]}),
    "weak": ("weak", {"weak": [jaxpd.segment((0, 0.4), (1, 0.4))]}),
    "nodes": ("resolution", {"resolution": jaxpd.MLS(dx=0.25)}),
    "support nowhere": ("supports", {"supports": [jaxpd.holds(NOWHERE)]}),
    "crack outside": ("cracks", {"cracks": [jaxpd.segment((5.0, 5.1), (6.0, 5.1))]}),
    "E of three points": ("E", {"material": GLASS(E=np.ones(3))}),
    "rho of three points": ("rho", {"material": GLASS(rho=np.ones(3))}),
    "G0 of three points": ("G0", {"material": GLASS(G0=np.ones(3))}),
    "long horizon": ("delta", {"resolution": jaxpd.Bonds(dx=0.25, delta=1e9)}),
}
ROWS += [
    (f"motion, {label}", name, lambda c=changed: jaxpd.prepare_motion(plate_of(**c)))
    for label, (name, changed) in MOVING.items()
]
SLOW = {
    "no G0": ("material", {"material": GLASS()}),
    "weak nowhere": ("weak", {"weak": [jaxpd.segment((5.0, 5.1), (6.0, 5.1))]}),
    "no_fail all": ("no_fail", {"no_fail": [jaxpd.box((-9, -9), (9, 9))]}),
    "starts": ("starts", {"starts": [jaxpd.initially(FAR, ux=0.1)]}),
    "nodes": ("resolution", {"resolution": jaxpd.MLS(dx=0.25)}),
    "laminate": ("body", {"body": jaxpd.laminate(PLIES, GLUE)}),
}
ROWS += [
    (f"fracture, {label}", name, lambda c=changed: jaxpd.solve_fracture(plate_of(**c)))
    for label, (name, changed) in SLOW.items()
]
ROWS += [
    (
        f"fracture, {label}",
        name,
        functools.partial(jaxpd.solve_fracture, plate(), **how),
    )
    for label, name, how in (
        ("falling factors", "factors", {"factors": [0.2, 0.1]}),
        ("negative factors", "factors", {"factors": [-0.2, 0.1]}),
        ("NaN factors", "factors", {"factors": [NAN]}),
        ("text factors", "factors", {"factors": "all"}),
        ("no factors", "factors", {"factors": []}),
        ("few without factors", "few", {"few": 2}),
        ("amount without softening", "amount", {"amount": 1.0}),
        ("softening below 1", "softening", {"softening": 0.5}),
        ("end nowhere", "end", {"end": NOWHERE}),
        ("watch nowhere", "watch", {"watch": [NOWHERE]}),
        ("watch a region", "watch", {"watch": FAR}),
    )
]
CLOUDS = {
    "pieces": ("supports", lambda: lone(DOUBLE)),
    "coincident": ("X", lambda: lone(np.concatenate([SIDE, SIDE[:1]]))),
    "no bonds": ("delta", lambda: lone(SIDE, 0.1)),
    "a single point": ("delta", lambda: lone(SIDE[:1])),
    "all in a line": ("supports|delta", lambda: lone(SIDE[:4])),
    "traction": ("loads", lambda: lone(SIDE, loads=[jaxpd.traction(FAR, x=1.0)])),
    "stencil": ("operator", lambda: lone(SIDE)),
    "dx of a cloud": (
        "dx",
        lambda: plate_of(body=jaxpd.lattice((0, 0), (1, 1), 0.5)),
    ),
}
ROWS += [
    (
        f"cloud, {label}",
        name,
        lambda f=f, o="stencil" if label == "stencil" else "auto": jaxpd.prepare(
            f(), operator=o
        ),
    )
    for label, (name, f) in CLOUDS.items()
]
BAR = jaxpd.box((0.0,), (1.0,))
ROWS += [
    ("from_points, 4-D", "X", lambda: jaxpd.from_points(np.zeros((3, 4)), 1.0)),
    ("from_points, a row", "X", lambda: jaxpd.from_points([0.0, 1.0], 1.0)),
    ("from_points, ragged", "X", lambda: jaxpd.from_points([[0.0], [1.0, 2.0]], 1.0)),
    ("from_points, three vol", "vol", lambda: jaxpd.from_points(PAIR, [1, 2, 3])),
    ("from_points, zero vol", "vol", lambda: jaxpd.from_points(PAIR, [1, 0])),
    ("from_points, inf X", "X", lambda: jaxpd.from_points([[np.inf]], 1.0)),
    ("box, 4-D", "lo", lambda: jaxpd.box((0, 0, 0, 0), (1, 1, 1, 1))),
    ("box, upside down", "hi", lambda: jaxpd.box((0, 1), (1, 0))),
    ("box, flat", "hi", lambda: jaxpd.box((0, 0), (1, 0))),
    ("box, mixed", "lo, hi", lambda: jaxpd.box((0, 0), (1, 1, 1))),
    ("segment, a point", "b", lambda: jaxpd.segment(MID, MID)),
    ("segment, 3-D", "a", lambda: jaxpd.segment((0, 0, 0), (1, 0, 0))),
    (
        "rectangle, slanted",
        "edge2",
        lambda: jaxpd.rectangle((0, 0, 0), (1, 0, 0), (1, 1, 0)),
    ),
    (
        "rectangle, no edge1",
        "edge1",
        lambda: jaxpd.rectangle((0, 0, 0), (0, 0, 0), (0, 1, 0)),
    ),
    (
        "rectangle, no edge2",
        "edge2",
        lambda: jaxpd.rectangle((0, 0, 0), (1, 0, 0), (0, 0, 0)),
    ),
    ("union, of none", "parts", lambda: jaxpd.union()),
    ("union, of text", "parts", lambda: jaxpd.union("left", "right")),
    ("above, nothing", "coordinate", lambda: jaxpd.above()),
    ("above, two", "coordinate", lambda: jaxpd.above(x=0.0, y=0.0)),
    ("above, w", "coordinate", lambda: jaxpd.above(w=0.0)),
    ("above, NaN", "x", lambda: jaxpd.above(x=NAN)),
    ("below, text", "y", lambda: jaxpd.below(y="low")),
    ("below, True", "y", lambda: jaxpd.below(y=True)),
    ("table, falling", "times", lambda: jaxpd.table([1.0, 0.5], [0.0, 1.0])),
    ("table, twice", "times", lambda: jaxpd.table([1.0, 1.0], [0.0, 1.0])),
    ("table, lengths", "factors", lambda: jaxpd.table([0.0, 1.0], [1.0])),
    ("table, NaN", "factors", lambda: jaxpd.table([0.0, 1.0], [1.0, NAN])),
    ("moves, nothing", "x", lambda: jaxpd.moves(EDGE)),
    ("drives, nothing", "x", lambda: jaxpd.drives(EDGE)),
    ("initially, nothing", "ux", lambda: jaxpd.initially(EDGE)),
    ("mapped, folds", "place", lambda: jaxpd.mapped((3, 3), lambda s: -s[::-1] * s)),
    ("mapped, no function", "place", lambda: jaxpd.mapped((3, 3), 3.0)),
    ("mapped, one node", "shape", lambda: jaxpd.mapped((1, 3), lambda s: s)),
    ("outlined, text", "loops", lambda: jaxpd.outlined(SIDE, "around")),
    ("outlined, beyond", "loops", lambda: jaxpd.outlined(SIDE, [[0, 3, 99]])),
    ("outlined, clockwise", "loops", lambda: jaxpd.outlined(SIDE, [[0, 12, 15, 3]])),
    ("outlined, twice", "loops", lambda: jaxpd.outlined(SIDE, [[0, 3, 3, 15]])),
    ("outlined, NaN", "loops", lambda: jaxpd.outlined(SIDE, [[0, NAN, 3]])),
    ("outlined, empty", "loops", lambda: jaxpd.outlined(SIDE, [])),
    ("lattice, layers", "layers", lambda: jaxpd.lattice((0,), (1,), 0.5, layers=[1])),
    (
        "lattice, text layers",
        "layers",
        lambda: jaxpd.lattice((0,), (1,), 0.5, layers="all"),
    ),
    (
        "Bonds, text layers",
        "layers",
        lambda: jaxpd.Bonds(dx=0.25, m=2, layers="all"),
    ),
    (
        "Bonds, horizon within spacing",
        "delta",
        lambda: jaxpd.Bonds(dx=0.25, delta=0.1),
    ),
    ("Bonds, layers", "layers", lambda: jaxpd.Bonds(dx=0.25, m=2, layers=((1, -1),))),
    ("Solid, text", "law", lambda: jaxpd.Solid("glass", 1.0)),
    ("Solid, Elastic", "law", lambda: jaxpd.Solid(GLASS(), 1.0)),
    ("Scene, class", "material", lambda: jaxpd.Scene(SQUARE, jaxpd.Elastic)),
    (
        "Scene, two materials",
        "material",
        lambda: jaxpd.Scene(SQUARE, [GLASS(), GLASS()]),
    ),
    (
        "Scene, two resolutions",
        "resolution",
        lambda: jaxpd.Scene(SQUARE, GLASS(), resolution=[GRID, GRID]),
    ),
    (
        "Scene, NaN law",
        "material",
        lambda: jaxpd.Scene(
            SQUARE, jaxpd.physics.Microelastic(NAN, jaxpd.physics.Constant())
        ),
    ),
    (
        "von_mises, NaN hardening",
        "hardening",
        lambda: jaxpd.von_mises(
            1.0,
            0.3,
            state="solid",
            hardening=jaxpd.Voce(1.0, 1.0, NAN, 0.0),
        ),
    ),
    (
        "von_mises, negative yield",
        "hardening",
        lambda: jaxpd.von_mises(
            1.0, 0.3, state="solid", hardening=jaxpd.Voce(-1.0, 1.0, 1.0, 0.0)
        ),
    ),
    (
        "von_mises, no hardening",
        "hardening",
        lambda: jaxpd.von_mises(1.0, 0.3, state="solid", hardening=3.0),
    ),
    (
        "von_mises, no yield",
        "sigma_y",
        lambda: jaxpd.von_mises(1.0, 0.3, state="solid"),
    ),
    (
        "von_mises, collapse",
        "h_iso",
        lambda: jaxpd.von_mises(1.0, None, 0.1, h_iso=-9.0, state="bar"),
    ),
    ("laminate, one ply", "plies", lambda: jaxpd.laminate(PLIES[:1], GLUE)),
    ("laminate, upside down", "plies", lambda: jaxpd.laminate(PLIES[::-1], GLUE)),
    ("laminate, no gap", "plies", lambda: jaxpd.laminate([PLIES[0]] * 2, GLUE)),
    ("laminate, mixed", "plies", lambda: jaxpd.laminate([PLIES[0], CUBE], GLUE)),
    (
        "laminate, apart",
        "plies",
        lambda: jaxpd.laminate([PLIES[0], jaxpd.box((5, 0.5), (6, 1))], GLUE),
    ),
    (
        "laminate, two layers",
        "interlayers",
        lambda: jaxpd.laminate(PLIES, [GLUE, GLUE]),
    ),
    ("interlayer, paper", "shear", lambda: jaxpd.interlayer(1, shear=1, rule="paper")),
    ("adhesive, shear", "shear", lambda: jaxpd.adhesive(1.0, 0.3, shear=0.1)),
    (
        "run_explicit, frames",
        "frames",
        lambda: jaxpd.run_explicit(plate(), 1.0, records=10, frames=3),
    ),
    (
        "run_explicit, text scene",
        "scene",
        lambda: jaxpd.run_explicit("branching_plate", 1.0),
    ),
    (
        "prepare_motion, softening",
        "softening",
        lambda: jaxpd.prepare_motion(plate_of(material=GLASS()), softening=0.1),
    ),
    (
        "prepare_motion, halves",
        "operator",
        lambda: jaxpd.prepare_motion(plate(), operator="halves", softening=0.1),
    ),
    (
        "solve_relaxed, drives",
        "supports",
        lambda: jaxpd.solve_relaxed(plate_of(supports=[jaxpd.drives(EDGE, x=1, y=0)])),
    ),
    ("solve_path, bonds", "resolution", lambda: jaxpd.solve_path(plate(), [1.0])),
    ("solve_path, falling", "times", lambda: jaxpd.solve_path(nodes(), [1.0, 0.5])),
    ("solve_path, zero", "times", lambda: jaxpd.solve_path(nodes(), [0.0, 0.5])),
    ("solve_path, a number", "times", lambda: jaxpd.solve_path(nodes(), 1.0)),
    (
        "solve_path, halvings",
        "max_halvings",
        lambda: jaxpd.solve_path(nodes(), [1.0], max_halvings=-1),
    ),
    (
        "solve_path, rtol",
        "rtol",
        lambda: jaxpd.solve_path(nodes(), [1.0], rtol="small"),
    ),
    (
        "prepare, fft of finite",
        "operator",
        lambda: jaxpd.prepare(plate(), operator="fft"),
    ),
    (
        "prepare, operator of nodes",
        "operator",
        lambda: jaxpd.prepare(nodes(), operator="stencil"),
    ),
    ("audit, of a law", "material", lambda: jaxpd.audit(nodes_law())),
    ("audit, unknown", "corrections", lambda: jaxpd.audit(plate(), ["none", "all"])),
    ("audit, none", "corrections", lambda: jaxpd.audit(plate(), [])),
    ("trapping, 1-D", "scene", lambda: jaxpd.trapping(nodes())),
    ("plan, unknown field", "colour", lambda: jaxpd.plan(plate(), colour="red")),
    ("keep_compiled", "folder", lambda: jaxpd.keep_compiled("/proc/none/here")),
    ("bounded, ends", "start", lambda: inverse.bounded(3.0, 0.0, 1.0)),
    ("free, scale", "scale", lambda: inverse.free(1.0, -1.0)),
    ("smooth, weight", "weight", lambda: inverse.smooth(prepared(), "E", -1.0)),
    ("smooth, text", "weight", lambda: inverse.smooth(prepared(), "E", "strong")),
    ("smooth, edges", "edges", lambda: inverse.smooth(prepared(), "E", 1.0, -1.0)),
    (
        "displacements, points",
        "points",
        lambda: observe.displacements([[0.0, 0.0]], points=[-1]),
    ),
    (
        "displacements, rows",
        "points",
        lambda: observe.displacements([[0.0, 0.0]], points=[1, 2]),
    ),
    (
        "displacements, sigma",
        "sigma",
        lambda: observe.displacements([[0.0, 0.0]], sigma=[1, 2, 3]),
    ),
    (
        "reaction_curve, axis",
        "axis",
        lambda: observe.reaction_curve(prepared(), EDGE, 2, [1.0], [1.0]),
    ),
    (
        "reaction_curve, region",
        "region",
        lambda: observe.reaction_curve(prepared(), NOWHERE, 0, [1.0], [1.0]),
    ),
    (
        "reaction_curve, rows",
        "data",
        lambda: observe.reaction_curve(prepared(), EDGE, 0, [1.0], [1.0, 2.0]),
    ),
    ("check, names", "names", lambda: gradcheck.check(prepared(), ["modulus"])),
]
SEEN = observe.displacements(np.ones((25, 2)))
ROWS += [
    (
        f"fit, {label}",
        name,
        functools.partial(
            fitting.fit,
            **{
                "problem": None,
                "variables": {"E": inverse.positive(1.0)},
                "observations": [SEEN],
            }
            | how,
        ),
    )
    for label, name, how in (
        ("method", "method", {"method": "newton"}),
        ("steps", "steps", {"steps": 0}),
        ("steps text", "steps", {"steps": "many"}),
        ("rate", "rate", {"rate": -1.0}),
        ("rate NaN", "rate", {"rate": NAN}),
        ("every", "every", {"every": 0.5}),
        ("gtol", "gtol", {"gtol": "small"}),
        ("no variables", "variables", {"variables": {}}),
        ("variable", "variables", {"variables": {"E": 3.0}}),
        ("no observations", "observations", {"observations": []}),
        ("observation", "observations", {"observations": [3.0]}),
        ("penalty", "penalties", {"penalties": [3.0]}),
        ("problem", "problem", {"problem": "plate"}),
    )
]
GRID_X, DAMAGE = SIDE[:, ::-1], np.zeros((2, 16))
ROWS += [
    (
        f"tips, {label}",
        name,
        functools.partial(
            crack_path.tips,
            **{"X": GRID_X, "shape": (4, 4), "phi": DAMAGE, "margin": 0.0} | how,
        ),
    )
    for label, name, how in (
        ("shape", "shape", {"shape": (3, 4)}),
        ("shape text", "shape", {"shape": "square"}),
        ("phi", "phi", {"phi": DAMAGE[0]}),
        ("phi NaN", "phi", {"phi": DAMAGE * NAN}),
        ("phi text", "phi", {"phi": "all"}),
        ("threshold", "threshold", {"threshold": 2.0}),
        ("threshold text", "threshold", {"threshold": "half"}),
        ("margin", "margin", {"margin": 9.0}),
        ("uneven", "X", {"X": GRID_X**2}),
    )
]


def nodes_law():
    """The plate of a law that is not Elastic."""
    law = jaxpd.physics.pmb(1.0, 1 / 3, "plane stress", 2, 0.5)
    return plate_of(material=law)


CASES = ROWS
