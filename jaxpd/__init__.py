"""Differentiable nonlocal mechanics in JAX.

The rooms, in the order in which data walks through them: `geometry`, `physics`,
`discretize`, `operators`, `solvers`; then the front desk: `scene`, `gallery`, `run`,
`audit`,
`io`, `plot`; and what looks back: `gradcheck`, `observe`, `inverse`, `descent`,
`fitting`, `uncertainty`, `resample`. Importing does nothing; statics needs 64-bit
floats, which the user turns on:

    jax.config.update("jax_enable_x64", True)
"""

from jaxpd import (
    discretize,
    fitting,
    gallery,
    geometry,
    gradcheck,
    inverse,
    observe,
    operators,
    physics,
    resample,
    solvers,
    uncertainty,
)
from jaxpd.audit import Audit, audit
from jaxpd.fitting import Fit, fit
from jaxpd.geometry import (
    above,
    ball,
    below,
    box,
    from_points,
    lattice,
    rectangle,
    segment,
    union,
)
from jaxpd.prepare import prepare
from jaxpd.problem import Problem
from jaxpd.run import Solution, keep_compiled, solve_static
from jaxpd.scene import (
    Bonds,
    Elastic,
    Scene,
    body_force,
    conical,
    constant,
    fractional,
    gaussian,
    holds,
    moves,
    pull,
)
from jaxpd.solvers.status import NotConverged, Status

__version__ = "0.1.0"

__all__ = [
    "Audit",
    "Bonds",
    "Elastic",
    "Fit",
    "NotConverged",
    "Problem",
    "Scene",
    "Solution",
    "Status",
    "above",
    "audit",
    "ball",
    "below",
    "body_force",
    "box",
    "conical",
    "constant",
    "discretize",
    "fit",
    "fitting",
    "fractional",
    "from_points",
    "gallery",
    "gaussian",
    "geometry",
    "gradcheck",
    "holds",
    "inverse",
    "keep_compiled",
    "lattice",
    "moves",
    "observe",
    "operators",
    "physics",
    "prepare",
    "pull",
    "rectangle",
    "resample",
    "segment",
    "solve_static",
    "solvers",
    "uncertainty",
    "union",
]
