"""What a job needs once its resolution is known: operator, solver, memory, precision.

Each choice is the cheapest by `jaxpd.planner.cost` of those that are able, with the
reason in words. The words are also README's table of which method when.
"""

from __future__ import annotations

import inspect
import math
from typing import Any

import jax
import numpy as np

from jaxpd.checks import word
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.explicit import run_explicit
from jaxpd.laminate import Laminate
from jaxpd.planner import cost as costs
from jaxpd.planner.cost import Cost
from jaxpd.planner.laws import breaks, law_inside, remembers
from jaxpd.planner.look import Look
from jaxpd.planner.words import WHY
from jaxpd.resolution import NODES, RKPM, Bonds
from jaxpd.scene import Elastic, Scene
from jaxpd.solvers.linear import methods

#: Events over bonds: mirror images go together, and some bonds stay whole.
TIED = 0.6
#: Records of a run that names none: steps are a multiple of them.
RECORDS = inspect.signature(run_explicit).parameters["records"].default
Choices = dict[str, tuple[Any, str]]


def decide(
    scene: Scene,
    job: str,
    look: Look,
    duration: float | None,
    steps: int,
    fixed: dict[str, Any],
) -> tuple[dict[str, Any], Cost, Choices]:
    """Options of the driver, predicted cost, and each choice with its reason.

    Args:
        scene: with a resolution.
        job: what is to be done.
        look: its sizes.
        duration: of a motion (s).
        steps: load steps of a path.
        fixed: what the user decided.

    Raises:
        ValueError: on a fixed field that the job does not have.
    """
    known = {
        "static": ("operator", "solver", "tangent"),
        "motion": ("operator", "dtype", "dt"),
        "path": ("solver", "tangent"),
        "fracture": ("operator", "solver"),
    }[job]
    for name, value in fixed.items():
        if name not in known and value is not None:
            raise ValueError(f"{name}: {value!r} is no choice of a {job}; {known} are")
    kept = {name: value for name, value in fixed.items() if value is not None}
    if "solver" in kept:
        word("solver", kept["solver"], methods())
    if "operator" in kept and isinstance(scene.resolution, NODES):
        raise ValueError(
            f"operator: {kept['operator']!r}; nodes have one of their own, leave it out"
        )
    make = {"static": _static, "path": _path, "fracture": _fracture}
    if job == "motion":
        return _motion(scene, look, duration, kept)
    return make[job](scene, look, steps, kept)


def _cheapest(table: dict[Any, Cost]) -> tuple[Any, str]:
    """The cheapest entry, and what the next one would take."""
    ranked = sorted(table, key=lambda name: table[name].seconds)
    best = ranked[0]
    if len(ranked) == 1:
        return best, ""
    second = ranked[1]
    name = second if isinstance(second, str) else " with ".join(second)
    return best, f" ({name} would take {table[second].seconds:.2g} s)"


def _static(
    scene: Scene, look: Look, steps: int, kept: dict[str, Any]
) -> tuple[dict[str, Any], Cost, Choices]:
    nodes = isinstance(scene.resolution, NODES)
    operators, solvers = _able(scene, look)
    if "operator" in kept:
        operators = [kept["operator"]]
    solvers = [kept["solver"]] if "solver" in kept else solvers
    table = {
        (operator, solver): costs.at_rest(look, operator, scene.kinematics, solver)
        for operator in operators
        for solver in solvers
    }
    (operator, solver), other = _cheapest(table)
    word = "stack" if isinstance(scene.body, Laminate) else operator
    more: Choices = {
        "memory": ("none", "at rest and elastic: no flags, no history"),
        "operator": (word, WHY[word]),
        "solver": (solver, WHY.get(solver, "as asked") + other),
        "dtype": ("float64", "equilibrium is out of reach of float32"),
    }
    if isinstance(scene.resolution, RKPM):
        more["scheme"] = (scene.resolution.scheme, _scheme(scene.resolution, look))
    options = {
        "solver": solver,
        **({} if nodes or word == "stack" else {"operator": operator}),
    }
    if "tangent" in kept:
        options["tangent"] = kept["tangent"]
        more["tangent"] = (kept["tangent"], "as asked")
    return options, table[operator, solver], more


def _scheme(resolution: RKPM, look: Look) -> str:
    """Why a scheme of integration, from how irregular the nodes are."""
    where = "even nodes" if look.spread < 0.02 else f"nodes uneven by {look.spread:.0%}"
    if resolution.scheme == "QCNI":
        return f"{where}: passes quadratic patch tests on any; none is cheaper for less"
    return f"{where}: given; QCNI errs less at the same cost on all that was measured"


def _able(scene: Scene, look: Look) -> tuple[list[str], list[str]]:
    """Operators and solvers that can, as `prepare` would take them."""
    resolution = scene.resolution
    if isinstance(resolution, NODES):
        if isinstance(resolution, RKPM):
            return ["weak"], ["direct", "amg", "d-pcg"]
        return ["strong"], ["direct"]
    if isinstance(scene.body, Laminate):
        return ["gather"], ["d-pcg"]
    assert isinstance(resolution, Bonds)
    law = law_inside(scene.material)
    leaves = [] if isinstance(law, Elastic) else jax.tree.leaves(law)
    shared = all(np.ndim(leaf) == 0 for leaf in leaves)
    correction = resolution.correction
    if not (look.regular and shared) or correction == "fictitious":
        return ["gather"], ["d-pcg", "amg", "direct"]
    if correction in DIRECTIONAL:
        return ["stencil"], ["d-pcg", "amg", "direct"]
    every = ["d-pcg", "spectral", "multigrid", "direct"]
    return (["fft"] if scene.kinematics == "small" else ["stencil"]), every


def _motion(
    scene: Scene, look: Look, duration: float | None, kept: dict[str, Any]
) -> tuple[dict[str, Any], Cost, Choices]:
    given = scene.material
    material = given[0] if isinstance(given, list | tuple) else given
    whole = isinstance(scene.body, Laminate)
    fictitious = getattr(scene.resolution, "correction", None) == "fictitious"
    plain = isinstance(material, Elastic)
    kind = "memory" if not plain else "slots"
    kind = "halves" if plain and look.regular and not fictitious else kind
    operator = kept.get("operator", kind)
    x64 = jax.dtypes.canonicalize_dtype(float) == np.float64
    broken = breaks(scene)
    dtype = kept.get("dtype") or ("float64" if x64 and not broken else "float32")
    stable = stable_step(scene, look)
    dt = kept.get("dt") or (None if stable is None else 0.8 * stable)
    count, known = 1000, False
    if duration is not None and dt is not None:
        each = math.ceil(duration / RECORDS / dt * (1.0 - 1e-12))
        count, known = RECORDS * max(1, each), True
    cost = costs.in_motion(look, operator, dtype, count)
    if broken:
        memory = "one bit a bond" if operator == "halves" else "one number a bond"
        why = "bonds break for good"
    else:
        memory, why = "none that matters", "nothing in the scene has a strength"
    precise = (
        "faster; the same bonds break but for a few"
        if broken
        else "energies and wave fronts to round-off"
    )
    word = "stack" if whole else operator
    more: Choices = {
        "memory": (memory, why),
        "operator": (word, WHY[word]),
        "dtype": (dtype, precise),
        "dt": (dt or "of the law", _steps(dt, count, known)),
    }
    options: dict[str, Any] = {"duration": duration, "dtype": dtype}
    if not whole or "operator" in kept:
        options["operator"] = operator
    if "dt" in kept:
        options["dt"] = kept["dt"]
    return options, cost, more


def _steps(dt: float | None, count: int, known: bool) -> str:
    """Where the time step comes from, and how many there are."""
    if dt is None:
        return f"known when the law is prepared; cost is of {count} steps"
    told = f"{count} steps" if known else f"cost is of {count} steps"
    return f"0.8 of the stable step, roughly: {told}"


def stable_step(scene: Scene, look: Look) -> float | None:
    """The stable time step (s) of bonds, roughly; the run makes sure of it.

    None of a law of one's own, which is asked when it is prepared.

    Raises:
        ValueError: if nothing has a density.
    """
    given = scene.material
    every = given if isinstance(given, list | tuple) else [given]
    if any(getattr(material, "rho", None) is None for material in every):
        raise ValueError("material: motion needs a density: Elastic(.., rho=2440.0)")
    stiff = [getattr(law_inside(material), "E", None) for material in every]
    if any(E is None for E in stiff):
        return None
    speeds = [
        math.sqrt(float(np.max(np.asarray(E))) / float(np.min(np.asarray(m.rho))))
        for E, m in zip(stiff, every, strict=True)
    ]
    return look.step / max(speeds)


def _path(
    scene: Scene, look: Look, steps: int, kept: dict[str, Any]
) -> tuple[dict[str, Any], Cost, Choices]:
    weak = isinstance(scene.resolution, RKPM)
    plastic = remembers(scene.material)
    solver = kept.get("solver", "direct")
    cost = costs.along_a_path(look, weak, steps, plastic, solver)
    word = "weak" if weak else "strong"
    history = "plastic strain at stress points" if plastic else "none"
    why = "the law has a memory" if plastic else "the law is elastic: no history"
    more: Choices = {
        "memory": (history, why),
        "operator": (word, WHY[word]),
        "solver": (solver, WHY.get(solver, "as asked")),
        "dtype": ("float64", "equilibrium is out of reach of float32"),
    }
    if weak:
        more["scheme"] = (scene.resolution.scheme, _scheme(scene.resolution, look))
    options: dict[str, Any] = {"times": None, "solver": solver}
    if "tangent" in kept:
        options["tangent"] = kept["tangent"]
        more["tangent"] = (kept["tangent"], "as asked")
    return options, cost, more


def _fracture(
    scene: Scene, look: Look, steps: int, kept: dict[str, Any]
) -> tuple[dict[str, Any], Cost, Choices]:
    states = states_of(scene, look)
    able = (
        ["direct", "d-pcg", "multigrid", "amg"] if look.regular else ["direct", "amg"]
    )
    solvers = [kept["solver"]] if "solver" in kept else able
    table = {name: costs.breaking(look, name, states) for name in solvers}
    solver, other = _cheapest(table)
    more: Choices = {
        "memory": ("one flag a bond", "bonds break for good"),
        "operator": ("springs", WHY["springs"]),
        "solver": (
            solver,
            "factors corrected bond by bond" + other
            if solver == "direct"
            else WHY[solver] + other,
        ),
        "dtype": ("float64", "equilibrium is out of reach of float32"),
    }
    options = {"solver": solver}
    if "operator" in kept:
        options["operator"] = kept["operator"]
    cost = table[solver]
    return (
        options,
        cost,
        more | {"states": (states, "bonds across the ligament, roughly")},
    )


def states_of(scene: Scene, look: Look) -> int:
    """Events until a body is in two, roughly: bonds across what cracks have left."""
    rows = look.m * look.neighbours / 5.0
    columns = (look.least / look.dx) ** (look.d - 1)
    surfaces = scene.weak or scene.cracks
    if surfaces and look.d == 2:
        edge = np.abs(np.asarray(surfaces[0].edges[0]))
        axis = int(np.argmax(edge))
        whole = edge[axis] if scene.weak else look.sides[axis]
        left = whole - sum(np.abs(np.asarray(c.edges[0]))[axis] for c in scene.cracks)
        columns = min(max(left, look.dx), look.sides[axis]) / look.dx
    return max(10, round(TIED * rows * columns))
