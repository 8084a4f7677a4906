"""Equilibrium with its implicit derivative: no iteration is ever differentiated.

In equilibrium r(p, u) = P (respond(u) + load) = 0 on the free unknowns, P the projector
on them. A change dp of operator, load and prescribed displacements g moves u by

    du = dg + x,    P K P x = P (d respond + d load - K dg),    K = -d respond / du,

one linear solve with the solver, and the preconditioner, of the forward one. Backwards
it is one solve with the transpose. The rule calls `equilibrium` again and solves by
`jax.lax.custom_linear_solve`, so it may be differentiated in turn: `grad`, `jacfwd`,
`jacrev`, Hessian-vector products, `vmap`.

What enters:

- d respond is a derivative of the force itself, whatever blocks the tangent has;
- K multiplies as a derivative of the force, and is solved with blocks by `jax.jacfwd`;
- topology (families, cracks, which entries are prescribed) is frozen.

The derivative of a solve that did not converge is NaN; so is one whose own linear solve
fails. The status says why.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.custom_derivatives import SymbolicZero

from jaxpd.operators.constraints import Constraints
from jaxpd.operators.protocol import ForceOperator
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton, NewtonInfo, solve_linear, solve_newton
from jaxpd.solvers.status import Status


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def equilibrium(
    settings: Newton,
    operator: ForceOperator,
    constraints: Constraints,
    load: jax.Array,
    linear: LinearSolver,
    u0: jax.Array,
    floor: jax.Array | float = 0.0,
) -> tuple[jax.Array, NewtonInfo]:
    """Static equilibrium, differentiable in operator, constraints and load.

    Args:
        settings: tolerances and limits; static.
        operator: internal forces and their tangents.
        constraints: prescribed displacements at full load.
        load: external nodal forces [n, d] (N).
        linear: the linear solver, for the derivative too.
        u0: displacements to start from [n, d] (m); the solution does not depend on it.
        floor: norm of a residual that is small whatever the first was.

    Returns:
        Displacements [n, d] (m) and a `NewtonInfo`, which has no derivative.
    """
    if operator.linear:
        K = operator.tangent(u0)
        return solve_linear(K, constraints, load, linear, settings)
    return solve_newton(operator, constraints, load, u0, linear, settings, floor)


def _rule(settings: Newton, primals: Any, tangents: Any) -> Any:
    operator, constraints, load, linear, _, _ = primals
    u, info = equilibrium(settings, *primals)
    project = constraints.project

    def residual(operator, load):
        return project(operator.respond(u) + load)

    def slope(v):  # K v on the free unknowns, by differentiating the force
        change = jax.jvp(operator.respond, (u,), (project(v),))[1]
        return -project(change)

    def solve(b, transpose):
        # never differentiated: custom_linear_solve looks at `slope` alone
        exact, at = jax.lax.stop_gradient((operator.exact(), u))
        K = exact.tangent(at)
        x, krylov = linear(K, constraints, project(b), transpose=transpose)
        return jnp.where(krylov.status == Status.CONVERGED, project(x), jnp.nan)

    b = _along(residual, (operator, load), (tangents[0], tangents[2]))
    lift = _along(Constraints.lift, (constraints,), (tangents[1],))
    if lift is not None:
        pull = project(jax.jvp(operator.respond, (u,), (lift,))[1])
        b = pull if b is None else b + pull
    if b is None:
        du = jnp.zeros_like(u)
    else:
        du = jax.lax.custom_linear_solve(
            slope,
            b,
            lambda _, b: solve(b, False),
            lambda _, b: solve(b, not operator.symmetric),
            symmetric=operator.symmetric,
        )
    du = du if lift is None else du + lift
    # a factor, not a choice: backwards it has to be NaN too
    trust = jnp.where(info.status == Status.CONVERGED, 1.0, jnp.nan).astype(u.dtype)
    return (u, info), (trust * du, jax.tree.map(_nothing, info))


equilibrium.defjvp(_rule, symbolic_zeros=True)


def _along(function: Callable[..., Any], at: Any, tangents: Any) -> Any:
    """Derivative of a function along tangents that are not all zero, else None."""
    leaves, tree = jax.tree.flatten(at)
    moves = jax.tree.leaves(tangents, is_leaf=lambda t: isinstance(t, SymbolicZero))
    moved = [k for k, t in enumerate(moves) if not isinstance(t, SymbolicZero)]
    if not moved:
        return None

    def of(some):
        every = list(leaves)
        for k, leaf in zip(moved, some, strict=True):
            every[k] = leaf
        return function(*jax.tree.unflatten(tree, every))

    return jax.jvp(of, ([leaves[k] for k in moved],), ([moves[k] for k in moved],))[1]


def _nothing(x: jax.Array) -> Any:
    """The tangent of what has none."""
    if jnp.issubdtype(x.dtype, jnp.floating):
        return jnp.zeros_like(x)
    return np.zeros(jnp.shape(x), jax.dtypes.float0)
