"""Static equilibrium by load steps of Newton's method, all of it inside the trace.

The residual on the free unknowns is R(u) = P (respond(u) + load). The first iteration
of a load step moves the prescribed unknowns and the free ones together: it solves
P K P du = R - P K g for the increment g of the prescribed displacements, so that no
layer of bonds next to a support is ever stretched alone.

Fallbacks, in this order: the step is shortened until the residual falls (line search,
from the second iteration on); the load step is halved and the last equilibrium taken up
again. Every iteration is recorded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple, cast

import jax
import jax.numpy as jnp

from jaxpd._types import namespace
from jaxpd.operators.constraints import Constraints
from jaxpd.operators.protocol import ForceOperator, Tangent
from jaxpd.solvers.krylov import KrylovInfo
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.status import Status


@dataclass(frozen=True)
class Newton:
    """Settings of the nonlinear solve; hashable, static under `jit`.

    Attributes:
        rtol: tolerance on the residual relative to that of the first iteration.
        max_iterations: most iterations of a load step, before it is halved.
        load_steps: load steps to begin with.
        max_halvings: most halvings of load steps, of all together.
        max_cuts: most halvings of one Newton step by the line search; with 0 there is
            none, and the residual may rise on its way down.
        max_total: most iterations of all load steps; the length of the history.
    """

    rtol: float = 1e-6
    max_iterations: int = 20
    load_steps: int = 1
    max_halvings: int = 6
    max_cuts: int = 5
    max_total: int = 200


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class NewtonInfo:
    """What a nonlinear solve did; histories are NaN or -1 beyond `iterations`.

    Attributes:
        status: `Status` code [] of the whole.
        linear_status: `Status` code [] of the worst linear solve.
        iterations: Newton iterations, failed load steps included [].
        load_factor: share of the load in equilibrium [], 1 at the end.
        residuals: relative residual after each iteration [max_total].
        loads: load factor of each iteration [max_total].
        linear_iterations: Krylov iterations of each iteration [max_total].
        linear_residuals: true relative residual of each linear solve [max_total].
        halvings: halvings of the load step [].
        cuts: halvings of Newton steps by the line search [].
        scale: norm of the first residual of the last load step [], which the others are
            relative to; NaN of a single linear solve.
    """

    status: jax.Array
    linear_status: jax.Array
    iterations: jax.Array
    load_factor: jax.Array
    residuals: jax.Array
    loads: jax.Array
    linear_iterations: jax.Array
    linear_residuals: jax.Array
    halvings: jax.Array
    cuts: jax.Array
    scale: jax.Array


class _State(NamedTuple):
    u: jax.Array
    force: jax.Array
    u_done: jax.Array
    force_done: jax.Array
    done: jax.Array  # load factor in equilibrium
    target: jax.Array  # load factor that is worked on
    size: jax.Array  # load step
    it: jax.Array  # iteration within the load step
    ref: jax.Array
    running: jax.Array
    info: NewtonInfo


def solve_linear(
    K: Tangent,
    constraints: Constraints,
    load: jax.Array,
    linear: LinearSolver,
    settings: Newton,
) -> tuple[jax.Array, NewtonInfo]:
    """Equilibrium for small displacements: one linear solve, no Newton loop."""
    gap = constraints.lift()
    x, krylov = linear(K, constraints, constraints.project(load - K.mv(gap)))
    return gap + constraints.project(x), one_solve(krylov, settings)


def one_solve(krylov: KrylovInfo, settings: Newton) -> NewtonInfo:
    """The record of a solve that took one linear solve; NumPy's of a NumPy record."""
    xp = namespace(krylov.residuals)
    k = krylov.iterations  # jax.scipy's CG: -1, and the second entry is the last
    last = krylov.residuals[xp.where(k < 0, 1, k)]
    zero, one = xp.zeros((), xp.int32), xp.ones((), xp.int32)

    def first(value, rest):
        value = xp.reshape(value, (1,))
        left = xp.full(settings.max_total - 1, rest, dtype=value.dtype)
        return xp.concatenate([value, left])

    return NewtonInfo(
        status=krylov.status,
        linear_status=krylov.status,
        iterations=one,
        load_factor=xp.where(krylov.status == 0, xp.ones_like(last), 0.0),
        residuals=first(last, xp.nan),
        loads=first(xp.ones_like(last), xp.nan),
        linear_iterations=first(k, -1),
        linear_residuals=first(last, xp.nan),
        halvings=zero,
        cuts=zero,
        scale=xp.full_like(last, xp.nan),
    )


def solve_newton(
    operator: ForceOperator,
    constraints: Constraints,
    load: jax.Array,
    u0: jax.Array,
    linear: LinearSolver,
    settings: Newton,
    floor: jax.Array | float = 0.0,
) -> tuple[jax.Array, NewtonInfo]:
    """Equilibrium under `load` and the prescribed displacements, from u0.

    Args:
        operator: internal forces and their tangents.
        constraints: prescribed displacements at full load.
        load: external nodal forces at full load [n, d] (N).
        u0: displacements at load zero [n, d] (m), in equilibrium there.
        linear: the linear solver.
        settings: tolerances and limits.
        floor: norm of a residual that is small whatever the first was.

    Returns:
        The last displacements in equilibrium [n, d] if all load steps converged, else
        those of the last iteration, and a `NewtonInfo`.
    """
    project, size0 = constraints.project, 1.0 / settings.load_steps

    def residual(force, factor):
        return project(force + factor * load)

    def iterate(s: _State) -> _State:
        first = s.it == 0
        K = operator.tangent(s.u)
        prescribed = s.u - project(s.u)
        gap = jnp.where(first, constraints.lift(s.target) - prescribed, 0.0)
        b = residual(s.force, s.target) - project(K.mv(gap))
        norm = jnp.linalg.norm(b)
        ref = cast(jax.Array, jnp.where(first, norm, s.ref))
        over = cast(jax.Array, jnp.where(ref > 0, ref, 1.0))
        x, krylov = linear(K, constraints, b)
        du = project(x) + gap

        def attempt(length):
            u = s.u + length * du
            force = operator.respond(u)
            return u, force, jnp.linalg.norm(residual(force, s.target))

        def too_long(carry):
            cut, _, _, new = carry
            falls = new <= (1.0 - 1e-4 * 0.5**cut) * norm
            near = new <= jnp.maximum(settings.rtol * ref, floor)
            return ~first & ~falls & ~near & (cut < settings.max_cuts)

        def shorten(carry):
            cut = carry[0] + 1
            return cut, *attempt(0.5**cut)

        # one trace of the force serves the full step and every shorter one
        begin = (
            jnp.asarray(-1, jnp.int32),
            s.u,
            s.force,
            jnp.asarray(jnp.inf, norm.dtype),
        )
        cut, u, force, new = jax.lax.while_loop(
            lambda c: (c[0] < 0) | too_long(c), shorten, begin
        )
        near = new <= jnp.maximum(settings.rtol * ref, floor)
        converged = near & (krylov.status == Status.CONVERGED)
        stuck = ~first & ~(new < norm) & (settings.max_cuts > 0)
        failed = ~converged & (
            ~jnp.isfinite(new)
            | (krylov.status != Status.CONVERGED)
            | stuck
            | (s.it + 1 >= settings.max_iterations)
        )
        i, halvings = s.info.iterations, s.info.halvings + failed
        info = NewtonInfo(
            status=s.info.status,
            linear_status=jnp.maximum(s.info.linear_status, krylov.status),
            iterations=i + 1,
            load_factor=jnp.where(converged, s.target, s.done),
            residuals=s.info.residuals.at[i].set(new / over),
            loads=s.info.loads.at[i].set(s.target),
            linear_iterations=s.info.linear_iterations.at[i].set(krylov.iterations),
            linear_residuals=s.info.linear_residuals.at[i].set(_last(krylov)),
            halvings=halvings,
            cuts=s.info.cuts + cut,
            scale=ref,
        )
        # after convergence the step grows back towards its first size
        size = jnp.where(failed, 0.5 * s.size, s.size)
        size = jnp.where(converged, jnp.minimum(size0, 2.0 * size), size)
        done = info.load_factor
        finished = converged & (done >= 1.0 - 1e-12)
        hopeless = failed & (halvings > settings.max_halvings)
        spent = ~finished & (info.iterations >= settings.max_total)
        cause = jnp.where(
            krylov.status != Status.CONVERGED,
            krylov.status,
            jnp.where(jnp.isfinite(new), Status.STEP_TOO_SMALL, Status.NOT_FINITE),
        )
        status = jnp.where(
            hopeless, cause, jnp.where(spent, Status.MAX_ITERATIONS, s.info.status)
        ).astype(jnp.int32)
        info = NewtonInfo(**{**vars(info), "status": status})
        back = failed & ~hopeless
        keep = lambda kept, moved: jnp.where(back, kept, moved)  # noqa: E731
        u_done = jnp.where(converged, u, s.u_done)
        force_done = jnp.where(converged, force, s.force_done)
        again = converged | failed
        return _State(
            u=keep(s.u_done, u),
            force=keep(s.force_done, force),
            u_done=u_done,
            force_done=force_done,
            done=done,
            target=jnp.where(again, jnp.minimum(1.0, done + size), s.target),
            size=size,
            it=jnp.where(again, 0, s.it + 1),
            ref=ref,
            running=~(finished | hopeless | spent),
            info=info,
        )

    zero = jnp.zeros((), u0.dtype)
    force0 = operator.respond(u0)
    begin = _State(
        u=u0,
        force=force0,
        u_done=u0,
        force_done=force0,
        done=zero,
        target=zero + size0,
        size=zero + size0,
        it=jnp.asarray(0, jnp.int32),
        ref=zero,
        running=jnp.asarray(True),
        info=_empty(settings, u0.dtype),
    )
    end = jax.lax.while_loop(lambda s: s.running, iterate, begin)
    return end.u, end.info


def _last(krylov: Any) -> jax.Array:
    at = jnp.clip(krylov.iterations, 0, None)
    one = krylov.iterations < 0  # jax.scipy's CG: the second entry
    return krylov.residuals[jnp.where(one, 1, at)]


def _empty(settings: Newton, dtype: Any) -> NewtonInfo:
    code = jnp.asarray(0, jnp.int32)
    nothing = jnp.full(settings.max_total, jnp.nan, dtype)
    return NewtonInfo(
        status=code,
        linear_status=code,
        iterations=code,
        load_factor=jnp.zeros((), dtype),
        residuals=nothing,
        loads=nothing,
        linear_iterations=jnp.full(settings.max_total, -1, jnp.int32),
        linear_residuals=nothing,
        halvings=code,
        cuts=code,
        scale=jnp.zeros((), dtype),
    )
