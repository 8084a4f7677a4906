"""One call for every linear solve of a constrained tangent.

| method      | preconditioner, where it runs                             |
|-------------|-----------------------------------------------------------|
| "cg"        | none; `jax.scipy.sparse.linalg.cg`, no counts             |
| "pcg"       | none; instrumented                                        |
| "d-pcg"     | diagonal entries                                          |
| "block-pcg" | inverses of the d x d diagonal blocks                     |
| "amg"       | a pyamg hierarchy, frozen when the solver was prepared    |
| "direct"    | sparse LU of every tangent, on the host                   |
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax

from jaxpd.operators.constraints import Constraints
from jaxpd.solvers.amg import Hierarchy
from jaxpd.solvers.direct import direct
from jaxpd.solvers.krylov import KrylovInfo, block_jacobi, cg, pcg, point_jacobi

METHODS = ("cg", "pcg", "d-pcg", "block-pcg", "amg", "direct")


@dataclass(frozen=True)
class LinearSolver:
    """A method and its settings; hashable, so that it may be static under `jit`.

    Attributes:
        method: one of `METHODS`.
        rtol: relative tolerance on the true residual.
        maxiter: most iterations.
        hierarchy: of method "amg".
    """

    method: str = "d-pcg"
    rtol: float = 1e-6
    maxiter: int = 10_000
    hierarchy: Hierarchy | None = None

    def __post_init__(self):
        """Refuse an unknown method early."""
        if self.method not in METHODS:
            raise ValueError(f"method: {self.method!r} must be one of {METHODS}")
        if self.method == "amg" and self.hierarchy is None:
            raise ValueError("hierarchy: method 'amg' needs one; see jaxpd.solvers.amg")

    def __call__(
        self, tangent: Any, constraints: Constraints, b: jax.Array
    ) -> tuple[jax.Array, KrylovInfo]:
        """Solve P K P x = b, with x and b [n, d] zero on prescribed entries.

        Raises:
            ValueError: if CG is asked of a tangent that is not symmetric.
        """
        if self.method == "direct":
            return direct(tangent, constraints.fixed, b, rtol=self.rtol)
        if not tangent.symmetric:
            raise ValueError(
                f"method: {self.method!r} is for symmetric tangents and this one is "
                "not; use 'direct'"
            )

        def mv(v):
            return constraints.project(tangent.mv(v))

        limits = {"rtol": self.rtol, "maxiter": self.maxiter}
        if self.method == "cg":
            return cg(mv, b, **limits)
        if self.method == "pcg":
            return pcg(mv, b, **limits)
        if self.method == "amg":
            assert self.hierarchy is not None
            return pcg(mv, b, precondition=self.hierarchy.cycle, **limits)
        make = point_jacobi if self.method == "d-pcg" else block_jacobi
        blocks = constraints.diagonal(tangent.diagonal())
        return pcg(mv, b, precondition=make(blocks), **limits)
