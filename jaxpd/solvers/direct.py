"""Sparse direct solution on the host, behind the same call as the iterative solvers."""

from __future__ import annotations

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jaxpd.operators.constraints import Constraints
from jaxpd.solvers.krylov import KrylovInfo
from jaxpd.solvers.status import Status

#: Share of |K| |x| to which a residual is round-off.
ROUND_OFF = 64.0 * np.finfo(float).eps


def solve_free(
    matrix: sp.spmatrix, fixed: np.ndarray, b: np.ndarray, symmetric: bool = True
) -> np.ndarray:
    """Solve K x = b on the entries that are not fixed; zero on the others. Host only.

    Args:
        matrix: K [n d, n d].
        fixed: mask [n, d].
        b: right-hand side [n, d].
        symmetric: choose the pivoting for a symmetric K. The ordering is that for a
            symmetric pattern anyway, which is faster on nodes in 2-D.

    Returns:
        x [n, d]; NaN if K is exactly singular, or anything is not finite.
    """
    free = np.flatnonzero(~np.ravel(fixed))
    K = sp.csr_matrix(matrix)[free][:, free].tocsc()
    # pivots off the diagonal undo the ordering: 4 times the fill near nu = 1/2
    how: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 1e-4}
    if symmetric:
        how |= {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    x = np.zeros(b.size)
    right = np.ravel(b)[free]
    if not (np.isfinite(K.data).all() and np.isfinite(right).all()):
        x[free] = np.nan
        return x.reshape(b.shape)
    bound, size = 1e-9 * np.linalg.norm(right), abs(K)
    try:
        # the default ordering where the first will not do; symmetric but indefinite,
        # the diagonal is no good pivot
        for way in (how, {}):
            factors = splu(K, **way)
            x[free] = factors.solve(right)
            if not symmetric:  # rows of balance and of traction differ in size
                x[free] += factors.solve(right - K @ x[free])
            # below the round-off of the product no ordering gets
            least = ROUND_OFF * np.linalg.norm(size @ abs(x[free]))
            if np.linalg.norm(K @ x[free] - right) <= max(bound, least):
                break
    except RuntimeError:  # "Factor is exactly singular"
        x[free] = np.nan
    return x.reshape(b.shape)


def direct(
    tangent: Any,
    constraints: Constraints,
    b: jax.Array,
    *,
    rtol: float = 1e-6,
    transpose: bool = False,
) -> tuple[jax.Array, KrylovInfo]:
    """Factorise a tangent's BSR matrix on the host and solve; works inside `jit`.

    Args:
        tangent: a pytree with `to_bsr()`, `mv` and `symmetric`.
        constraints: which entries are prescribed.
        b: right-hand side [n, d], zero where prescribed.
        rtol: the true residual above which the solve counts as failed.
        transpose: solve with the transpose.
    """
    x = _factorised(transpose, tangent, constraints, b)
    mv = functools.partial(_product, transpose, tangent)
    norm = jnp.linalg.norm(b)
    left = constraints.project(b - mv(x))
    rel = jnp.linalg.norm(left) / jnp.where(norm > 0, norm, 1.0)
    status = jnp.where(
        rel <= rtol,
        Status.CONVERGED,
        jnp.where(jnp.isfinite(rel), Status.BREAKDOWN, Status.NOT_FINITE),
    )
    residuals = jnp.stack([jnp.ones_like(rel), rel])
    return x, KrylovInfo(status.astype(jnp.int32), jnp.asarray(1, jnp.int32), residuals)


def _product(transpose: bool, tangent: Any, v: jax.Array) -> jax.Array:
    return jax.vjp(tangent.mv, v)[1](v)[0] if transpose else tangent.mv(v)


@functools.partial(jax.custom_jvp, nondiff_argnums=(0,))
def _factorised(
    transpose: bool, tangent: Any, constraints: Constraints, b: jax.Array
) -> jax.Array:
    """The solve itself; a callback has no derivative of its own."""

    def on_host(tangent, fixed, b):
        matrix = jax.tree.map(np.asarray, tangent).to_bsr()
        matrix = matrix.T if transpose else matrix
        return solve_free(matrix, np.asarray(fixed), np.asarray(b), tangent.symmetric)

    out = jax.ShapeDtypeStruct(b.shape, b.dtype)
    fixed = constraints.fixed
    return jax.pure_callback(on_host, out, tangent, fixed, b, vmap_method="sequential")


@_factorised.defjvp
def _factorised_rule(transpose: bool, primals: Any, tangents: Any) -> Any:
    """K dx = db - dK x."""
    tangent, constraints, _ = primals
    x = _factorised(transpose, *primals)
    moved = jax.jvp(lambda K: _product(transpose, K, x), (tangent,), (tangents[0],))[1]
    b = constraints.project(tangents[2] - moved)
    return x, _factorised(transpose, tangent, constraints, b)
