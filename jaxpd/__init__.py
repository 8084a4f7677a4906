"""Differentiable nonlocal mechanics in JAX.

The rooms, in the order in which data walks through them: `geometry`, `physics`,
`discretize`, `operators`, `solvers`; then the front desk: `laminate`, `scene`,
`gallery`, `prepare` and `run` for statics, `fracture` for bodies that break slowly,
`path` for load steps with a memory, `motion`, `launch` and `explicit` for motion,
`planner` for the least that will do, `io`, `plot`; and what looks back: `audit`,
`crack_path`, `gradcheck`, `observe`, `inverse`, `descent`, `fitting`, `uncertainty`,
`resample`.
Importing does nothing; statics needs 64-bit floats, which the user turns on:

    jax.config.update("jax_enable_x64", True)
"""

from jaxpd import (
    crack_path,
    discretize,
    fitting,
    fracture,
    gallery,
    geometry,
    gradcheck,
    inverse,
    observe,
    operators,
    physics,
    planner,
    plot,
    resample,
    solvers,
    uncertainty,
)
from jaxpd.audit import Audit, audit
from jaxpd.conditions import (
    body_force,
    drives,
    holds,
    initially,
    moves,
    pressure,
    pull,
    traction,
)
from jaxpd.convergence import Refinement
from jaxpd.explicit import run_explicit
from jaxpd.fitting import Fit, fit
from jaxpd.fracture import Fracture, Growth, Trapping, solve_fracture, trapping
from jaxpd.galerkin import GalerkinProblem
from jaxpd.geometry import (
    above,
    ball,
    below,
    box,
    from_mesh,
    from_points,
    lattice,
    mapped,
    outlined,
    rectangle,
    segment,
    union,
)
from jaxpd.laminate import Interlayer, Laminate, adhesive, interlayer, laminate
from jaxpd.launch import prepare_motion
from jaxpd.motion import Motion
from jaxpd.nodal import NodalProblem
from jaxpd.path import Path, solve_path
from jaxpd.physics import Voce, von_mises
from jaxpd.picture import picture
from jaxpd.planner import Plan, plan
from jaxpd.prepare import prepare
from jaxpd.problem import Problem
from jaxpd.record import Diverged, Run
from jaxpd.refinement import refine
from jaxpd.relaxed import Relaxed, solve_relaxed
from jaxpd.resolution import MLS, RKPM, Bonds, conical, constant, fractional, gaussian
from jaxpd.run import Solution, keep_compiled, solve_static
from jaxpd.scene import Elastic, Scene, Solid
from jaxpd.scene_file import SceneFile, load_scene, save_scene
from jaxpd.schedule import Table, ramp, table
from jaxpd.solvers.status import NotConverged, Status
from jaxpd.stack import Stack

__version__ = "0.1.0"

__all__ = [
    "MLS",
    "RKPM",
    "Audit",
    "Bonds",
    "Diverged",
    "Elastic",
    "Fit",
    "Fracture",
    "GalerkinProblem",
    "Growth",
    "Interlayer",
    "Laminate",
    "Motion",
    "NodalProblem",
    "NotConverged",
    "Path",
    "Plan",
    "Problem",
    "Refinement",
    "Relaxed",
    "Run",
    "Scene",
    "SceneFile",
    "Solid",
    "Solution",
    "Stack",
    "Status",
    "Table",
    "Trapping",
    "Voce",
    "above",
    "adhesive",
    "audit",
    "ball",
    "below",
    "body_force",
    "box",
    "conical",
    "constant",
    "crack_path",
    "discretize",
    "drives",
    "fit",
    "fitting",
    "fractional",
    "fracture",
    "from_mesh",
    "from_points",
    "gallery",
    "gaussian",
    "geometry",
    "gradcheck",
    "holds",
    "initially",
    "interlayer",
    "inverse",
    "keep_compiled",
    "laminate",
    "lattice",
    "load_scene",
    "mapped",
    "moves",
    "observe",
    "operators",
    "outlined",
    "physics",
    "picture",
    "plan",
    "planner",
    "plot",
    "prepare",
    "prepare_motion",
    "pressure",
    "pull",
    "ramp",
    "rectangle",
    "refine",
    "resample",
    "run_explicit",
    "save_scene",
    "segment",
    "solve_fracture",
    "solve_path",
    "solve_relaxed",
    "solve_static",
    "solvers",
    "table",
    "traction",
    "trapping",
    "uncertainty",
    "union",
    "von_mises",
]
