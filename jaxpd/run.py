"""From a scene to a solution: `solve_static` and what users ask of its result."""

from __future__ import annotations

import functools
import resource
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.checks import instance, number, whole
from jaxpd.compiling import quickly
from jaxpd.galerkin import GalerkinProblem, solve_galerkin
from jaxpd.geometry import Crack, Region
from jaxpd.nodal import NodalProblem
from jaxpd.prepare import prepare
from jaxpd.problem import Problem, first_system, first_tangent, host_system
from jaxpd.scene import Scene
from jaxpd.solvers.linear import LinearSolver, solve_system
from jaxpd.solvers.newton import NewtonInfo, one_solve
from jaxpd.solvers.status import NotConverged, Status

__all__ = [
    "Problem",
    "Solution",
    "equilibrium",
    "first_system",
    "first_tangent",
    "keep_compiled",
    "peak_memory",
    "prepare",
    "solve_static",
]

#: Points up to which compiling takes longer than solving: Newton's method, one solve.
QUICK_POINTS = {"finite": 50_000, "small": 200_000}


@dataclass(frozen=True, eq=False)
class Solution:
    """A solved scene.

    Attributes:
        scene: what was solved.
        problem: what it was prepared into, a `Problem` or `Stack`.
        u: displacements [n, d] (m).
        unknowns: what was solved for [n, d] (m): displacements too, but for kernels
            that do not interpolate (`jaxpd.GalerkinProblem`); methods of the problem
            ask for these.
        info: how the solve went.
        seconds: wall time of "prepare" and "solve", compilation included.
        peak_memory: highest resident memory of the process so far (bytes).
    """

    scene: Scene
    problem: Any
    u: PointVector
    unknowns: PointVector
    info: NewtonInfo
    seconds: dict[str, float]
    peak_memory: int

    @functools.cached_property
    def reaction(self) -> PointVector:
        """Forces of the supports on the body [n, d] (N)."""
        return self.problem.reaction(self.unknowns)

    @functools.cached_property
    def energy(self) -> PointScalar:
        """Stored energy of each point [n] (J); NaN for a law without one."""
        return self.problem.energy(self.unknowns)

    def __repr__(self) -> str:
        """One line: sizes, status and counts."""
        return (
            f"Solution({self.status.name}, {len(self.u)} points, "
            f"{self.iterations} Newton iterations, Krylov iterations "
            f"{self.linear_iterations.tolist()})"
        )

    @property
    def X(self) -> PointVector:
        """Reference positions [n, d] (m)."""
        return self.problem.X

    @property
    def energy_density(self) -> PointScalar:
        """Stored energy per volume [n] (J/m^3)."""
        return self.energy / self.problem.vol

    @property
    def status(self) -> Status:
        """How the solve ended."""
        return Status(int(self.info.status))

    @property
    def iterations(self) -> int:
        """Newton iterations, 1 for small displacements."""
        return int(self.info.iterations)

    @property
    def residuals(self) -> np.ndarray:
        """Relative residual after each Newton iteration."""
        return np.asarray(self.info.residuals)[: self.iterations]

    @property
    def linear_iterations(self) -> np.ndarray:
        """Krylov iterations of each Newton iteration; -1 where not counted."""
        return np.asarray(self.info.linear_iterations)[: self.iterations]

    def checked(self) -> Solution:
        """This solution, if it converged.

        Raises:
            NotConverged: with status, residual history and cure.
        """
        if self.status is not Status.CONVERGED:
            spec = self.problem.spec
            small = getattr(spec, "linear", spec.kinematics == "small")
            what = "linear solve" if small else "Newton's method"
            what += f" ({self.problem.linear.method}"
            what += f", load factor {float(self.info.load_factor):.3g})"
            raise NotConverged(self.status, self.residuals, what)
        return self

    def reaction_on(self, region: Region) -> np.ndarray:
        """Resultant [d] (N) of the supports' forces on the points in a region."""
        instance("region", region, Region, "above(..), below(..), box(..), ball(..)")
        inside = region.contains(np.asarray(self.X))
        if not inside.any():
            raise ValueError(f"region: no point lies in {region}")
        return np.asarray(self.reaction)[inside].sum(axis=0)

    def traction(self, layer: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Places of an interlayer's ghosts [q, d] (m) and its traction there (Pa).

        The traction [q, d] that a laminate's layer, counted from 0 below, passes on:
        along the axis positive in tension, across it the shear.

        Raises:
            ValueError: if there is no such interlayer.
        """
        glue = getattr(self.problem, "glue", ())
        layer = whole("layer", layer, 0)
        if not layer < len(glue):
            raise ValueError(f"layer: {layer} must lie in 0..{len(glue) - 1}")
        found = self.problem.traction(self.u)[layer]
        return glue[layer][0].places, np.asarray(found)

    def opening(self, crack: Crack, at: float = 0.5) -> float:
        """Opening (m) of a 2-D crack at the edge coordinate `at` in 0..1.

        The normal displacement of the nearest point above the crack minus that of the
        nearest below. The elastic strain over the spacing between the two is included.
        """
        u = np.asarray(self.u)
        instance("crack", crack, Crack, "a segment(..)")
        number("at", at, least=0, most=1)
        i, j = crack.faces(np.asarray(self.X), at)
        return float((u[i] - u[j]) @ crack.normal)


def peak_memory() -> int:
    """Highest resident memory of this process so far (bytes)."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def keep_compiled(folder: str | Path = "~/.cache/jaxpd") -> Path:
    """Keep compiled code in a folder and use it in later processes.

    Call it once, before anything is solved. JAX's own persistent cache, told to keep
    small and quickly compiled programs too: a solve of jaxpd is many of them. Code is
    kept per shape; delete the folder to be rid of it.

    Args:
        folder: made if it does not exist; "~" is the home.

    Returns:
        The folder.

    Raises:
        ValueError: if the folder cannot be made.
    """
    instance("folder", folder, str | Path, "the path of a folder")
    path = Path(folder).expanduser()
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"folder: {folder} cannot be made ({error})") from error
    jax.config.update("jax_compilation_cache_dir", str(path))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return path


def solve_static(scene: Scene, **options: Any) -> Solution:
    """Solve a scene: `prepare`, `Problem.solve` and what users ask of the result.

    Args:
        scene: what to solve.
        **options: those of `prepare`: solver, tangent, rtol, linear_rtol, load_steps,
            max_iterations, linear_maxiter, operator.

    Returns:
        A `Solution`; call its `checked()` to be sure that it converged.
    """
    start = time.perf_counter()
    problem = prepare(scene, **options)
    if isinstance(problem, NodalProblem | GalerkinProblem):
        problem.spec.check_static()
    ready = time.perf_counter()
    u, unknowns, info = jax.block_until_ready(_solved(problem))
    solved = time.perf_counter()
    seconds = {"prepare": ready - start, "solve": solved - ready}
    return Solution(scene, problem, u, unknowns, info, seconds, peak_memory())


def _solved(problem: Any) -> tuple[PointVector, PointVector, NewtonInfo]:
    """Displacements of the points, unknowns, and how the solve went."""
    if isinstance(problem, GalerkinProblem):
        return solve_galerkin(problem)
    u, info = equilibrium(problem)
    return u, u, info


def equilibrium(problem: Any) -> tuple[PointVector, NewtonInfo]:
    """`Problem.solve` of the defaults, in the way that compiles least.

    On a lattice with small displacements everything but the iteration is done in NumPy.
    """
    few = len(problem.X) <= QUICK_POINTS[problem.spec.kinematics]
    if problem.spec.operator != "fft":
        return quickly(type(problem).solve)(problem) if few else problem.solve()
    K, constraints, b = host_system(problem)
    solve = quickly(LinearSolver.__call__) if few else solve_system
    x, krylov = solve(problem.linear, K, constraints, b)
    u = np.where(constraints.fixed, constraints.values, np.asarray(x))
    record = jax.tree.map(np.asarray, krylov)
    return jnp.asarray(u), one_solve(record, problem.spec.newton)
