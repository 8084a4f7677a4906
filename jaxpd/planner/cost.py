"""What a choice costs: processor seconds and bytes, from counts. A model, calibrated.

Seconds are of processor time, which two free cores turn into some 0.7 of it on the
clock: the constants are fits to the calibration scenes of `benchmarks/planner.py`,
which prints how well they predict others. They rank methods anywhere, and are right in
size on machines like the one that they were measured on.

    compilation   of a driver's programs, by what they hold, hardly by size
    work          products with the stiffness, factors, steps: counts times constants
"""

from __future__ import annotations

from dataclasses import dataclass

from jaxpd.planner.look import Look


@dataclass(frozen=True)
class Cost:
    """Predicted cost.

    Attributes:
        compile: processor seconds to trace and compile, once a shape.
        seconds: processor seconds in all, compilation and set-up included.
        bytes: highest resident memory of the process.
    """

    compile: float
    seconds: float
    bytes: float

    def __str__(self) -> str:
        """Seconds and memory in words."""
        return (
            f"{self.seconds:.2g} s ({self.compile:.2g} s compiling), "
            f"{self.bytes / 2**20:.0f} MB"
        )


#: Memory of the code of each further ply (bytes).
PLY_CODE = 30e6
#: Memory of a process that has compiled what a job needs (bytes).
BASE = {"bonds": 320e6, "nodes": 430e6, "motion": 350e6, "laminate": 460e6}
#: Processor seconds of compilation and set-up of small scenes at rest.
COMPILE = {
    ("fft", "small"): 0.45,
    ("stencil", "small"): 0.9,
    ("gather", "small"): 1.4,
    ("stencil", "finite"): 1.9,
    ("gather", "finite"): 2.2,
    ("weak", "small"): 4.5,
    ("strong", "small"): 1.5,
}
#: Further seconds of each further ply, with its interlayer.
PLIES = {"small": 1.15, "finite": 2.6}
#: Further seconds of a solver's own programs.
SOLVER = {
    "direct": 0.0,
    "d-pcg": 0.25,
    "pcg": 0.25,
    "cg": 0.25,
    "block-pcg": 0.3,
    "spectral": 0.3,
    "multigrid": 1.0,
    "amg": 1.0,
    "gmres": 0.5,
    "bicgstab": 0.4,
}
#: Seconds of a product with the stiffness, per direction of a bond; of an FFT per
#: unknown and term of the surface correction.
PRODUCT = {"fft": 5e-8, "stencil": 4.3e-9, "gather": 8e-9, "weak": 4e-9, "strong": 4e-9}
#: Seconds to find bonds and lay them out, per direction of a bond.
LAYOUT = {
    "fft": 1e-8,
    "stencil": 2e-8,
    "gather": 2.5e-7,
    "weak": 2.2e-5,
    "strong": 1e-5,
}
#: Of an algebraic hierarchy, per entry of the matrix.
HIERARCHY = 2.5e-7
#: Of sparse factors of differences in 3-D: seconds over unknowns^2.5, entries over
#: unknowns^1.5.
STARS = (3.4e-9, 80.0)
#: Of sparse factors, over unknowns^1.5 m^1.4 in 2-D; unknowns^2 m^2 in 3-D.
FACTORS = {1: 1e-6, 2: 7e-8, 3: 4e-9}


def iterations(look: Look, solver: str, weak: bool = False) -> float:
    """Krylov iterations to 1e-6, roughly."""
    root = look.condition**0.5
    return {
        "direct": 1.0,
        "spectral": 5.0 * look.condition ** (1 / 6),
        "multigrid": 6.0,
        "amg": 20.0 if weak else 8.0,
    }.get(solver, (2.4 if weak else 4.4) * root)


def factors(look: Look, strong: bool = False) -> float:
    """Seconds of one sparse LU; stars of differences in 3-D leave hardly a zero."""
    N = look.unknowns
    if strong and look.d == 3:
        return STARS[0] * N**2.5
    if look.d == 1:
        return FACTORS[1] * N * look.m
    if look.d == 2:
        return FACTORS[2] * N**1.5 * look.m**1.4
    return FACTORS[3] * N**2 * look.m**2


def at_rest(look: Look, operator: str, kinematics: str, solver: str) -> Cost:
    """Cost of a static solve, compilation and set-up included.

    Args:
        look: sizes.
        operator: "fft", "stencil", "gather"; of nodes "weak" or "strong".
        kinematics: "small", one solve, or "finite", Newton's method.
        solver: of the linear systems.
    """
    compiling = COMPILE.get((operator, kinematics), 2.0) + SOLVER.get(solver, 0.3)
    compiling += PLIES[kinematics] * (look.plies - 1)
    solves = 2 if kinematics == "finite" else 1
    count = iterations(look, solver, operator == "weak")
    each = product(look, operator)
    if solver == "direct":
        work = factors(look, operator == "strong")
    elif solver == "amg":
        work = HIERARCHY * look.bonds * look.d**2 + count * 3.0 * each
    elif solver == "multigrid":
        work = 3e-6 * look.n + count * 8.0 * each
    elif solver == "spectral":
        work = count * (each + 1.5e-7 * look.unknowns)
    else:
        work = count * each
    seconds = compiling + LAYOUT[operator] * look.bonds + solves * work
    return Cost(compiling, seconds, memory(look, operator, solver))


def product(look: Look, operator: str) -> float:
    """Seconds of one product with the stiffness."""
    if operator == "fft":
        return PRODUCT["fft"] * look.unknowns * (1.0 + 0.1 * look.terms)
    blocks = look.d**2 / 4 if operator in ("weak", "strong") else look.d / 2
    return PRODUCT[operator] * look.bonds * blocks


def fill(look: Look, operator: str) -> float:
    """Entries of sparse factors, roughly."""
    if operator == "strong" and look.d == 3:
        return STARS[1] * look.unknowns**1.5
    if look.d == 2:
        return 8.0 * look.unknowns**1.2 * look.m**1.5
    return 8.0 * look.bonds * look.d**2


def memory(look: Look, operator: str, solver: str) -> float:
    """Highest resident memory (bytes)."""
    entries = look.bonds * look.d**2
    held = (
        BASE["nodes" if operator in ("weak", "strong") else "bonds"]
        + PLY_CODE * (look.plies - 1)
        + 400.0 * look.unknowns
    )
    held += {"fft": 0.0, "stencil": 4.0, "gather": 40.0}.get(operator, 60.0) * (
        look.bonds
    )
    if solver == "amg":
        held += 60.0 * entries
    if solver == "direct":
        held += 16.0 * (entries + fill(look, operator))
    return held


#: Processor seconds of compilation of a motion, by operator.
MOTION = {"halves": 1.8, "slots": 2.2, "memory": 2.2}  # in 1-D
MORE_DIMENSIONS = 1.5
#: Of each further ply, with its interlayer.
PLY = 4.5
#: Seconds of a step, per direction of a bond, by operator and precision.
STEP = {
    ("halves", "float32"): 1.8e-9,
    ("halves", "float64"): 3.0e-9,
    ("slots", "float32"): 1.4e-8,
    ("slots", "float64"): 1.6e-8,
    ("memory", "float32"): 5e-8,
    ("memory", "float64"): 6e-8,
}


def in_motion(look: Look, operator: str, dtype: str, steps: int) -> Cost:
    """Cost of an explicit run of so many steps."""
    compiling = MOTION[operator] * (MORE_DIMENSIONS if look.d > 1 else 1.0)
    compiling += PLY * (look.plies - 1)
    each = STEP[operator, dtype] * look.bonds * (1.0 + 0.3 * (look.d == 3))
    each += 1e-8 * look.unknowns + 2e-6
    each += 2e-7 * look.ghosts * look.m**look.d
    laid = 2.5e-7 * look.bonds if operator != "halves" else 0.0
    size = 8 if dtype == "float64" else 4
    kept = {"halves": 0.1, "slots": 12.0, "memory": 16.0 + 2 * size}[operator]
    return Cost(
        compiling,
        compiling + laid + steps * each,
        BASE["laminate" if look.plies > 1 else "motion"]
        + kept * look.bonds
        + 60.0 * size * look.unknowns,
    )


def along_a_path(
    look: Look, weak: bool, steps: int, plastic: bool, solver: str = "direct"
) -> Cost:
    """Cost of load steps of nodes."""
    compiling = (6.0 if weak else 3.5) if look.d > 1 else 2.0
    newton = steps * (3.5 if plastic else 1.0)
    each = factors(look, not weak) + 2.5e-7 * look.bonds * look.d**2
    each *= 1.0 if solver == "direct" else 4.0
    return Cost(
        compiling,
        compiling + LAYOUT["weak"] * look.bonds + newton * each,
        BASE["nodes"] + 100.0 * look.bonds * look.d**2,
    )


def breaking(look: Look, solver: str, states: int) -> Cost:
    """Cost of a path from one breaking bond to the next."""
    compiling = 3.2 if solver == "direct" else 4.0
    if solver == "direct":
        each = 4e-7 * look.unknowns * look.m + 2e-8 * look.bonds
        anew = factors(look) * (1 + states / 60)
        work = anew + states * each
    else:
        count = iterations(look, solver)
        factor = {"multigrid": 8.0, "amg": 3.0}.get(solver, 1.0)
        work = states * (0.1 + 1.7 * count * factor * product(look, "stencil"))
        work += (1 + states / 40) * (1.5 if solver == "multigrid" else 0.3)
    bytes_ = memory(look, "stencil", solver) + 16.0 * states * look.unknowns
    return Cost(compiling, compiling + LAYOUT["stencil"] * look.bonds + work, bytes_)
