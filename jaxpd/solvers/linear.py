"""One call for every linear solve of a constrained tangent.

| method       | preconditioner, where it runs                                     |
|--------------|-------------------------------------------------------------------|
| "cg"         | none; `jax.scipy.sparse.linalg.cg`, no counts                     |
| "pcg"        | none; instrumented                                                |
| "d-pcg"      | diagonal entries                                                  |
| "block-pcg"  | inverses of the d x d diagonal blocks                             |
| "spectral"   | sines and cosines of a box; lattices, on the device               |
| "multigrid"  | Galerkin V-cycle; lattices, on the device                         |
| "amg"        | a pyamg hierarchy; any points, on the host                        |
| "direct"     | sparse LU of every tangent, on the host; not symmetric ones too   |
| "gmres"      | inverses of diagonal blocks; for tangents that are not symmetric  |
| "bicgstab"   | the same                                                          |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax

from jaxpd.operators.constraints import Constraints
from jaxpd.solvers.direct import direct
from jaxpd.solvers.krylov import (
    KrylovInfo,
    block_jacobi,
    cg,
    general,
    pcg,
    point_jacobi,
)

Preconditioner = Callable[[Any, Constraints], Callable[[jax.Array], jax.Array] | None]


def _diagonal(tangent: Any, constraints: Constraints) -> Any:
    return point_jacobi(constraints.diagonal(tangent.diagonal()))


def _blocks(tangent: Any, constraints: Constraints) -> Any:
    return block_jacobi(constraints.diagonal(tangent.diagonal()))


#: Preconditioners of CG by the name of the method: functions of tangent and constraints
#: that give a symmetric positive definite map of residuals [n, d], or None. A method of
#: your own is one more entry.
PRECONDITIONERS: dict[str, Preconditioner] = {
    "pcg": lambda tangent, constraints: None,
    "d-pcg": _diagonal,
    "block-pcg": _blocks,
}
#: Methods that need a hierarchy, made when the solver is prepared and then frozen.
PREPARED = ("spectral", "multigrid", "amg")
#: Methods for tangents that are not symmetric.
GENERAL = ("gmres", "bicgstab")
METHODS = ("cg", *PRECONDITIONERS, *PREPARED, "direct", *GENERAL)


def methods() -> tuple[str, ...]:
    """Names of all methods, those added to `PRECONDITIONERS` included."""
    return (*METHODS, *(name for name in PRECONDITIONERS if name not in METHODS))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class LinearSolver:
    """A method, its settings and what was prepared for it: a pytree.

    Attributes:
        hierarchy: of the methods in `PREPARED`: anything with `cycle(r)`, a symmetric
            positive definite map of residuals [n, d].
        method: one of `methods()`.
        rtol: relative tolerance on the true residual.
        maxiter: most iterations.
    """

    hierarchy: Any = None
    method: str = field(metadata={"static": True}, default="d-pcg")
    rtol: float = field(metadata={"static": True}, default=1e-6)
    maxiter: int = field(metadata={"static": True}, default=10_000)

    def __call__(
        self,
        tangent: Any,
        constraints: Constraints,
        b: jax.Array,
        *,
        transpose: bool = False,
    ) -> tuple[jax.Array, KrylovInfo]:
        """Solve P K P x = b, or P K^T P x = b, with x and b [n, d] zero where held.

        Raises:
            ValueError: if CG is asked of a tangent that is not symmetric.
        """
        if self.method == "direct":
            transpose = transpose and not tangent.symmetric
            return direct(tangent, constraints, b, rtol=self.rtol, transpose=transpose)
        limits: dict[str, Any] = {"rtol": self.rtol, "maxiter": self.maxiter}
        if self.method in GENERAL:
            blocks = constraints.diagonal(tangent.diagonal())
            turned = transpose and not tangent.symmetric
            # JAX transposes a scan that was linearised, and no other
            _, product = jax.linearize(tangent.mv, jax.numpy.zeros_like(b))
            back = jax.linear_transpose(product, b)

            def forth(v):
                return constraints.project(back(v)[0] if turned else product(v))

            near = block_jacobi(blocks.swapaxes(1, 2) if turned else blocks)
            return general(self.method, forth, b, precondition=near, **limits)
        if not tangent.symmetric:
            raise ValueError(
                f"method: {self.method!r} is for symmetric tangents and this one is "
                "not; use 'direct', 'gmres' or 'bicgstab'"
            )

        def mv(v):
            return constraints.project(tangent.mv(v))

        if self.method == "cg":
            return cg(mv, b, **limits)
        if self.method in PREPARED:
            if self.hierarchy is None:
                raise ValueError(f"hierarchy: method {self.method!r} needs one")

            def cycle(r):  # a cycle may not know of every prescribed entry
                return constraints.project(self.hierarchy.cycle(r))

            return pcg(mv, b, precondition=cycle, **limits)
        make = PRECONDITIONERS.get(self.method)
        if make is None:
            raise ValueError(f"method: {self.method!r} must be one of {methods()}")
        return pcg(mv, b, precondition=make(tangent, constraints), **limits)


def linear_solver(
    method: str, rtol: float = 1e-6, maxiter: int = 10_000, hierarchy: Any = None
) -> LinearSolver:
    """A linear solver, checked.

    Raises:
        ValueError: on an unknown method, or one that lacks its hierarchy.
    """
    if method not in methods():
        raise ValueError(f"method: {method!r} must be one of {methods()}")
    if method in PREPARED and hierarchy is None:
        raise ValueError(
            f"hierarchy: method {method!r} needs one; see jaxpd.solvers, or "
            "Problem.solver(), which builds it"
        )
    return LinearSolver(hierarchy, method, rtol, maxiter)


#: A linear solve under `jit`; a new hierarchy of the same sizes is not compiled anew.
solve_system = jax.jit(LinearSolver.__call__)
