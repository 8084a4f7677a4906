"""Solvers: they know the protocol of the operators and no physics."""

from jaxpd.solvers.implicit import equilibrium
from jaxpd.solvers.krylov import KrylovInfo, block_jacobi, cg, pcg, point_jacobi
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton, NewtonInfo, solve_linear, solve_newton
from jaxpd.solvers.spectrum import Spectrum, extremes
from jaxpd.solvers.status import NotConverged, Status

__all__ = [
    "KrylovInfo",
    "LinearSolver",
    "Newton",
    "NewtonInfo",
    "NotConverged",
    "Spectrum",
    "Status",
    "block_jacobi",
    "cg",
    "equilibrium",
    "extremes",
    "pcg",
    "point_jacobi",
    "solve_linear",
    "solve_newton",
]
