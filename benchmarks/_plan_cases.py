"""Scenes of the planner's benchmark: how each is run, and what else would do.

Some calibrate the constants of `jaxpd.planner.cost`; the others are held back.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import jaxpd
from jaxpd import MLS, RKPM, gallery

Options = dict[str, Any]


@dataclass(frozen=True)
class Case:
    """A scene and the ways in which it can be done.

    Attributes:
        make: the scene.
        ways: options of the driver, one set a way.
        job: of the planner.
        how: options of the driver that all ways share.
        held_back: whether no constant was fitted to it.
        gallery: name of the gallery's scene at its own size, counted in the claim.
    """

    make: Callable[[], Any]
    ways: list[Options]
    job: str = "static"
    how: Options = field(default_factory=dict)
    held_back: bool = False
    gallery: str | None = None


def pairs(*given: tuple[str, str]) -> list[Options]:
    """Operators with solvers."""
    return [{"operator": a, "solver": b} for a, b in given]


def solvers(*names: str) -> list[Options]:
    """Solvers alone."""
    return [{"solver": name} for name in names]


FFT = ("d-pcg", "spectral", "multigrid", "direct")
SMALL = pairs(*(("fft", s) for s in FFT), ("stencil", "d-pcg"), ("gather", "d-pcg"))
FINITE = pairs(*(("stencil", s) for s in FFT), ("gather", "d-pcg"))
CLOUD = pairs(("gather", "d-pcg"), ("gather", "amg"), ("gather", "direct"))
WEAK = solvers("direct", "amg", "d-pcg")
STACK = solvers("d-pcg", "amg", "direct")
BREAK = solvers("direct", "d-pcg", "multigrid")
LOAD_STEPS = [
    {"solver": s, "tangent": t} for s in ("direct", "gmres") for t in ("ad", "hand")
]
MOTION = [
    {"operator": o, "dtype": t}
    for o in ("halves", "slots", "memory")
    for t in ("float32", "float64")
]


def times(n: int) -> dict[str, Any]:
    """Load steps to 1."""
    return {"times": (np.arange(1, n + 1) / n).tolist()}


def cloud_plate(n: int) -> Any:
    """A plate of scattered points, pulled."""
    rng = np.random.default_rng(1)
    g = (np.arange(n) + 0.5) / n
    X = np.stack(np.meshgrid(g, g, indexing="ij"), -1).reshape(-1, 2)
    X += rng.uniform(-0.2, 0.2, X.shape) / n
    return jaxpd.Scene(
        body=jaxpd.from_points(X, np.full(n * n, 1 / n**2)),
        material=jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress"),
        supports=[jaxpd.holds(jaxpd.below(y=3 / n))],
        loads=[jaxpd.pull(jaxpd.above(y=1 - 1 / n), y=1e-3)],
        kinematics="small",
        resolution=jaxpd.Bonds(delta=3.2 / n),
    )


def block(n: int) -> Any:
    """A solid cube, pulled."""
    return jaxpd.Scene(
        body=jaxpd.box((0, 0, 0), (1, 1, 1)),
        material=jaxpd.Elastic(1.0, nu=0.25, state="solid"),
        supports=[jaxpd.holds(jaxpd.below(z=0.0))],
        loads=[jaxpd.pull(jaxpd.above(z=1 - 1.5 / n), z=1e-3)],
        kinematics="small",
        resolution=jaxpd.Bonds(dx=1 / n, m=3),
    )


def stack(plies: int, d: int, kinematics: str) -> Any:
    """Plies with interlayers, held on the left and bent."""
    boxes = [
        jaxpd.box(
            (0.0, *[0.0] * (d - 2), 0.12 * i), (1.0, *[0.2] * (d - 2), 0.12 * i + 0.1)
        )
        for i in range(plies)
    ]
    state, nu, name = (("plane stress", 1 / 3, "y"), ("solid", 0.25, "z"))[d - 2]
    force: Any = {name: 1e-5}
    return jaxpd.Scene(
        body=jaxpd.laminate(boxes, jaxpd.interlayer(0.1)),
        material=jaxpd.Elastic(1.0, nu, state),
        supports=[jaxpd.holds(jaxpd.below(x=0.06))],
        loads=[jaxpd.pull(jaxpd.above(x=0.94), **force)],
        kinematics=kinematics,
        resolution=jaxpd.Bonds(dx=0.02, m=3, nodes="cell"),
    )


def bent(state: str, sides: tuple[float, ...], **more: Any) -> Any:
    """A body clamped on the left and bent by a traction on the right; no resolution."""
    across = "xyz"[len(sides) - 1]
    material = more.pop("material", None)
    nu = 0.25 if state == "solid" else 1 / 3
    return jaxpd.Scene(
        body=jaxpd.box((0.0,) * len(sides), sides),
        material=material or jaxpd.Elastic(1.0, nu, state),
        supports=[jaxpd.holds(jaxpd.below(x=0.0))],
        loads=[jaxpd.traction(jaxpd.above(x=sides[0]), **{across: 1e-4}, **more)],
        kinematics="small",
    )


def pane() -> Any:
    """A notched pane of glass, pulled suddenly; no resolution."""
    return jaxpd.Scene(
        body=jaxpd.box((0.0, -0.03), (0.08, 0.03)),
        material=jaxpd.Elastic(72e9, 1 / 3, "plane stress", rho=2440.0, G0=3.8),
        cracks=[jaxpd.segment((0.0, 0.0), (0.04, 0.0))],
        loads=[
            jaxpd.traction(jaxpd.above(y=0.03), y=1e6),
            jaxpd.traction(jaxpd.below(y=-0.03), y=-1e6),
        ],
    )


def chosen(scene: Any, **asked: Any) -> Callable[[], Any]:
    """A scene with the resolution that the planner takes."""
    return lambda: jaxpd.plan(scene, **asked).scene


g = gallery
SOME = [MOTION[i] for i in (0, 1, 3)]


def cracked(*size: Any, small: bool = True) -> Callable[[], Any]:
    """The cracked plate."""
    kind = "small" if small else "finite"
    return lambda: g.cracked_plate(*size, kinematics=kind)


#: What the constants were fitted to.
FITTED = {
    "cracked plate 48, m = 4, small": Case(cracked(48, 4), SMALL),
    "cracked plate 128, m = 8, alpha = 1, small": Case(
        cracked(128, 8, 1.0), SMALL[:3] + SMALL[4:]
    ),
    "cracked plate 48, m = 4": Case(cracked(48, 4, small=False), FINITE),
    "cracked plate 96, m = 6, alpha = 1": Case(
        cracked(96, 6, 1.0, small=False), FINITE[:3] + FINITE[4:]
    ),
    "scattered plate 40": Case(lambda: cloud_plate(40), CLOUD),
    "scattered plate 120": Case(lambda: cloud_plate(120), CLOUD),
    "cantilever 25 x 13": Case(lambda: g.cantilever((25, 13), jitter=0.3), WEAK),
    "cantilever 81 x 41": Case(lambda: g.cantilever((81, 41), jitter=0.3), WEAK),
    "branching plate, m = 4, 2 mm": Case(
        lambda: g.branching_plate(4, 2e-3),
        MOTION,
        "motion",
        {"duration": 20e-6, "records": 20},
    ),
    "bar wave": Case(
        g.bar_wave, MOTION, "motion", {"duration": 1.0, "records": 10}, False,
        "bar_wave",
    ),
    "peeled beam": Case(
        g.peeled_beam, SOME, "motion", {"duration": 20.0, "records": 10}, False,
        "peeled_beam",
    ),
    "plastic beam": Case(
        g.plastic_beam, LOAD_STEPS, "path", times(6), False, "plastic_beam"
    ),
    "pressed ring 21 x 49": Case(
        lambda: g.pressed_ring((21, 49)), LOAD_STEPS[:2], "path", times(6)
    ),
    "pressed ring, kernels": Case(
        lambda: g.pressed_ring(resolution=RKPM()), LOAD_STEPS[:2], "path", times(6)
    ),
    "three plies": Case(lambda: stack(3, 2, "small"), STACK),
    "two plies, finite": Case(lambda: stack(2, 2, "finite"), STACK),
    "double cantilever": Case(
        g.double_cantilever, solvers("direct"), "fracture", {}, False
    ),
    "double cantilever, 40 states": Case(
        g.double_cantilever, BREAK, "fracture", {"max_states": 40}, False,
        "double_cantilever",
    ),
    "notched plate": Case(g.notched_plate, solvers("direct"), "fracture"),
}  # fmt: skip


def held(
    make: Any, ways: list[Options], job: str, how: Options, name: Any = None
) -> Case:
    """A case that calibrated nothing."""
    return Case(make, ways, job, how, True, name)


def slow(name: str) -> dict[str, Case]:
    """A scene of slow fracture: 40 states by every solver, and whole by factors."""
    make = getattr(g, name)
    return {
        f"{name}, 40 states": held(make, BREAK, "fracture", {"max_states": 40}, name),
        name: held(make, solvers("direct"), "fracture", {}),
    }


HELD_BACK = {
    "cracked plate": held(g.cracked_plate, FINITE, "static", {}, "cracked_plate"),
    "cracked plate, small": held(cracked(), SMALL, "static", {}),
    "cracked plate 256, m = 4, alpha = 1.9, small": held(
        cracked(256, 4, 1.9), SMALL[:3], "static", {}
    ),
    "block 16": held(lambda: block(16), SMALL[:3] + SMALL[4:], "static", {}),
    "kernel bar": held(g.kernel_bar, WEAK, "static", {}, "kernel_bar"),
    "cantilever": held(g.cantilever, WEAK, "static", {}, "cantilever"),
    "cantilever, strong form": held(
        lambda: g.cantilever((33, 17), resolution=MLS()),
        solvers("direct", "gmres", "bicgstab"), "static", {},
    ),
    "plate under tension": held(
        g.plate_under_tension, WEAK, "static", {}, "plate_under_tension"
    ),
    "patch of an L": held(
        lambda: g.patch(g.l_shape(5, jitter=0.3), "l"), WEAK, "static", {}, "l_shape"
    ),
    "branching plate": held(
        g.branching_plate, MOTION[:4], "motion", {"duration": 10e-6, "records": 10},
        "branching_plate",
    ),
    "Kalthoff and Winkler": held(
        g.kalthoff_winkler, MOTION[:4], "motion", {"duration": 20e-6, "records": 10},
        "kalthoff_winkler",
    ),
    "Gaussian wave": held(
        g.gaussian_wave, SOME, "motion", {"duration": 10.0, "records": 5},
        "gaussian_wave",
    ),
    "struck laminate": held(
        g.struck_laminate, SOME, "motion", {"duration": 5e-6, "records": 5},
        "struck_laminate",
    ),
    "four plies, finite": held(
        lambda: stack(4, 2, "finite"), STACK, "static", {}
    ),
    "two plies in 3-D": held(lambda: stack(2, 3, "small"), STACK, "static", {}),
    "beam, 0.3 %, chosen": held(
        chosen(bent("plane stress", (3.0, 1.0)), accuracy=0.003), WEAK, "static", {}
    ),
    "block, 10 %, chosen": held(
        chosen(bent("solid", (2.0, 1.0, 1.0)), accuracy=0.1),
        solvers("direct", "d-pcg", "amg"), "static", {},
    ),
    "pane, 15 %, chosen": held(
        chosen(pane(), accuracy=0.15, duration=15e-6), MOTION[:4], "motion",
        {"duration": 15e-6, "records": 10},
    ),
    "plastic beam, 5 %, chosen": held(
        chosen(
            bent(
                "plane strain", (3.0, 1.0), time=jaxpd.ramp(1.0),
                material=jaxpd.von_mises(1.0, 0.3, 1e-3, 0.1, state="plane strain"),
            ),
            accuracy=0.05, times=times(4)["times"],
        ),
        LOAD_STEPS[:2], "path", times(4),
    ),
    "plastic bar": held(g.plastic_bar, LOAD_STEPS, "path", times(8), "plastic_bar"),
    "pressed ring": held(g.pressed_ring, LOAD_STEPS, "path", times(6), "pressed_ring"),
    "plate with a hole": held(
        lambda: g.plate_with_hole((9, 13), 0.002), LOAD_STEPS[:2], "path", times(8),
        "plate_with_hole",
    ),
    "Cook's panel": held(g.cook_panel, LOAD_STEPS[:2], "path", times(6), "cook_panel"),
    "notched plate, 40 states": held(
        g.notched_plate, BREAK, "fracture", {"max_states": 40}, "notched_plate"
    ),
    **slow("compact_tension"),
    **slow("bent_beam"),
    **slow("sheared_plate"),
    **slow("l_panel"),
    **slow("breaking_plate"),
}  # fmt: skip
CASES = FITTED | HELD_BACK
