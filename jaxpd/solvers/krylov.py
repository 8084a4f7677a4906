"""Conjugate gradients, matrix-free: JAX's own, and one that tells what happened.

Vectors may have any shape; [n, d] here. `mv` must be symmetric and positive definite on
the subspace of the right-hand side, and so must the preconditioner `precondition`, a
map from residuals to corrections.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import jax.scipy.sparse.linalg as jsl

from jaxpd.solvers.status import Status

Map = Callable[[jax.Array], jax.Array]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class KrylovInfo:
    """What an iteration did.

    Attributes:
        status: `Status` code [].
        iterations: applications of the preconditioner and operator [].
        residuals: relative residual norms [maxiter + 1], the first is that of the
            initial guess; NaN beyond `iterations`. The last is a true residual if the
            status is CONVERGED.
    """

    status: jax.Array
    iterations: jax.Array
    residuals: jax.Array


def cg(
    mv: Map,
    b: jax.Array,
    *,
    precondition: Map | None = None,
    rtol: float = 1e-6,
    maxiter: int = 10_000,
) -> tuple[jax.Array, KrylovInfo]:
    """CG by `jax.scipy.sparse.linalg.cg`, which counts nothing and reports nothing.

    Iterations are -1 and the history holds the first and the last true residual; the
    status is judged by the last.
    """
    x, _ = jsl.cg(mv, b, tol=rtol, maxiter=maxiter, M=precondition)
    return x, _judged(mv, b, x, rtol)


def _judged(mv: Map, b: jax.Array, x: jax.Array, rtol: float) -> KrylovInfo:
    """What is known of a solver that tells nothing: its last true residual."""
    norm = jnp.linalg.norm(b)
    last = jnp.linalg.norm(b - mv(x)) / jnp.where(norm > 0, norm, 1.0)
    # its recurrence stops at rtol; the true residual may exceed that by round-off
    good = last <= 1.1 * rtol
    status = jnp.where(
        good,
        Status.CONVERGED,
        jnp.where(jnp.isfinite(last), Status.MAX_ITERATIONS, Status.NOT_FINITE),
    )
    residuals = jnp.stack([jnp.ones_like(last), last])
    return KrylovInfo(status.astype(jnp.int32), jnp.asarray(-1, jnp.int32), residuals)


def general(
    method: str,
    mv: Map,
    b: jax.Array,
    *,
    precondition: Map | None = None,
    rtol: float = 1e-6,
    maxiter: int = 10_000,
    restart: int = 200,
) -> tuple[jax.Array, KrylovInfo]:
    """For operators that are not symmetric: "gmres" or "bicgstab" of `jax.scipy`.

    They report nothing: iterations are -1, and the status is judged by the last true
    residual, as with `cg`. GMRES restarts after `restart` vectors.
    """
    near = precondition or (lambda r: r)

    def A(v):  # jax.scipy compares preconditioned residuals with plain tolerances
        return near(mv(v))

    limits: dict[str, Any] = {"tol": 0.1 * rtol}
    if method == "gmres":
        restart = min(restart, b.size)
        limits |= {"restart": restart, "maxiter": -(-maxiter // restart)}
        x, _ = jsl.gmres(A, near(b), solve_method="incremental", **limits)
    else:
        x, _ = jsl.bicgstab(A, near(b), maxiter=maxiter, **limits)
    return x, _judged(mv, b, x, rtol)


class _State(NamedTuple):
    x: jax.Array
    r: jax.Array
    p: jax.Array
    rz: jax.Array
    k: jax.Array
    phase: jax.Array  # of `_STEP`, `_CHECK`, `_END`
    status: jax.Array
    history: jax.Array


#: A turn steps, or recomputes r = b - A x, or there is none any more.
_STEP, _CHECK, _END = range(3)


def pcg(
    mv: Map,
    b: jax.Array,
    *,
    precondition: Map | None = None,
    rtol: float = 1e-6,
    maxiter: int = 10_000,
    x0: jax.Array | None = None,
) -> tuple[jax.Array, KrylovInfo]:
    """Preconditioned CG with counts, residual history and honest ends.

    Stops when the *true* residual satisfies ||b - A x|| <= rtol ||b||: the recursive
    one is trusted to say when to look, and the iteration restarts from the true one if
    it was wrong. Operator and preconditioner are traced once each.

    Args:
        mv: the operator A.
        b: right-hand side.
        precondition: approximates the inverse of A; identity by default.
        rtol: relative tolerance.
        maxiter: most iterations.
        x0: initial guess, zero by default.

    Returns:
        The last iterate and a `KrylovInfo`; the status is NEGATIVE_CURVATURE if
        p . A p <= 0 for a search direction, BREAKDOWN if r . M r <= 0, NOT_FINITE on
        NaN or infinity. The iterate is then the last one before.
    """
    shape, dtype = b.shape, b.dtype
    b = b.ravel()
    norm = jnp.sqrt(b @ b)
    scale = jnp.where(norm > 0, norm, 1.0)
    zero = jnp.zeros_like(b)
    start = zero if x0 is None else jnp.where(norm > 0, x0.ravel(), 0.0)
    first = norm / scale if x0 is None else jnp.asarray(jnp.nan, dtype)

    def A(v):
        return mv(v.reshape(shape)).ravel()

    def M(r):
        return r if precondition is None else precondition(r.reshape(shape)).ravel()

    def turn(s: _State) -> _State:
        check = s.phase == _CHECK
        z = M(s.r) if precondition is None else jax.lax.cond(check, lambda r: r, M, s.r)
        rz = s.r @ z
        p = jnp.where(
            check, s.p, z + jnp.where(jnp.isfinite(s.rz), rz / s.rz, 0.0) * s.p
        )
        q = A(jnp.where(check, s.x, p))
        curvature = p @ q
        bad = jnp.where(
            jnp.isfinite(rz) & jnp.isfinite(curvature),
            jnp.where(
                rz > 0,
                jnp.where(curvature > 0, Status.CONVERGED, Status.NEGATIVE_CURVATURE),
                Status.BREAKDOWN,
            ),
            Status.NOT_FINITE,
        )
        bad = jnp.where(check, Status.CONVERGED, bad)
        moving = ~check & (bad == Status.CONVERGED)
        step = jnp.where(moving, rz / curvature, 0.0)
        x = jnp.where(moving, s.x + step * p, s.x)
        r = jnp.where(check, b - q, jnp.where(moving, s.r - step * q, s.r))
        rel = jnp.sqrt(r @ r) / scale
        lost = (bad == Status.CONVERGED) & ~jnp.isfinite(rel)
        bad = jnp.where(lost, Status.NOT_FINITE, bad)
        stop = bad != Status.CONVERGED
        k = s.k + jnp.where(moving & ~stop, 1, 0)
        inside = rel <= rtol
        done = check & inside
        late = ~done & ~inside & (k >= maxiter)
        status = jnp.where(stop, bad, jnp.where(late, Status.MAX_ITERATIONS, s.status))
        return _State(
            x=x,
            r=r,
            p=p,
            # after a check that failed, restart along the preconditioned residual
            rz=jnp.where(check, jnp.inf, rz),
            k=k,
            phase=jnp.where(
                done | late | stop, _END, jnp.where(~check & inside, _CHECK, _STEP)
            ),
            status=status.astype(jnp.int32),
            history=s.history.at[k].set(jnp.where(stop, s.history[k], rel)),
        )

    begin = jnp.where(norm == 0, _END, _STEP if x0 is None else _CHECK)
    state = _State(
        x=start,
        r=b,
        p=zero,
        rz=jnp.asarray(jnp.inf, dtype),
        k=jnp.asarray(0, jnp.int32),
        phase=begin,
        status=jnp.asarray(Status.CONVERGED, jnp.int32),
        history=jnp.full(maxiter + 1, jnp.nan, dtype).at[0].set(first),
    )
    end = jax.lax.while_loop(lambda s: s.phase != _END, turn, state)
    return end.x.reshape(shape), KrylovInfo(end.status, end.k, end.history)


def point_jacobi(blocks: jax.Array) -> Map:
    """Preconditioner from the diagonal entries of block diagonals [n, d, d]."""
    inverse = 1.0 / jnp.diagonal(blocks, axis1=1, axis2=2)
    return lambda r: inverse * r


def block_jacobi(blocks: jax.Array) -> Map:
    """Preconditioner from the inverses of block diagonals [n, d, d]."""
    inverse = jnp.linalg.inv(blocks)
    return lambda r: jnp.einsum("nab,nb->na", inverse, r)
