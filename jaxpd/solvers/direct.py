"""Sparse direct solution on the host, behind the same call as the iterative solvers."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jaxpd.operators.constraints import Constraints
from jaxpd.solvers.krylov import KrylovInfo
from jaxpd.solvers.status import Status


def solve_free(
    matrix: sp.spmatrix, fixed: np.ndarray, b: np.ndarray, symmetric: bool = True
) -> np.ndarray:
    """Solve K x = b on the entries that are not fixed; zero on the others. Host only.

    Args:
        matrix: K [n d, n d].
        fixed: mask [n, d].
        b: right-hand side [n, d].
        symmetric: choose the ordering and pivoting for a symmetric K.

    Returns:
        x [n, d]; NaN if K is exactly singular, or anything is not finite.
    """
    free = np.flatnonzero(~np.ravel(fixed))
    K = sp.csr_matrix(matrix)[free][:, free].tocsc()
    how: dict[str, Any] = (
        {
            "permc_spec": "MMD_AT_PLUS_A",
            "diag_pivot_thresh": 0.0,
            "options": {"SymmetricMode": True},
        }
        if symmetric
        else {}
    )
    x = np.zeros(b.size)
    right = np.ravel(b)[free]
    if not (np.isfinite(K.data).all() and np.isfinite(right).all()):
        x[free] = np.nan
        return x.reshape(b.shape)
    try:
        x[free] = splu(K, **how).solve(right)
        missed = np.linalg.norm(K @ x[free] - right) > 1e-9 * np.linalg.norm(right)
        if symmetric and missed:  # indefinite: the diagonal is no good pivot
            x[free] = splu(K).solve(right)
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

    def on_host(tangent, fixed, b):
        matrix = jax.tree.map(np.asarray, tangent).to_bsr()
        matrix = matrix.T if transpose else matrix
        return solve_free(matrix, np.asarray(fixed), np.asarray(b), tangent.symmetric)

    out = jax.ShapeDtypeStruct(b.shape, b.dtype)
    fixed = constraints.fixed
    x = jax.pure_callback(on_host, out, tangent, fixed, b, vmap_method="sequential")

    def mv(v):
        return jax.vjp(tangent.mv, v)[1](v)[0] if transpose else tangent.mv(v)

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
