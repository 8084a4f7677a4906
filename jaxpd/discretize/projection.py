"""Gradients for trial and test alike that are in equilibrium: one sparse solution.

Where places and weights do not satisfy the divergence theorem, the gradients B of all
nodes are changed together, by as little as it takes,

    minimise  sum over q, I  w_q delta_qI^2 / omega_qI,
    omega^2 = Psi_I^2 + (SMOOTH a_I |grad Psi_I|)^2 at x_q,

so that (a) at every place q the sum over I of delta_qI p(x_I) is zero for polynomials
p of a degree, which the gradients go on to reproduce, and (b) for all nodes I and
polynomials tau of one degree less

    sum over q  w (T_qI tau + Psi_I tau_,k)  =  sum over b  s Psi_I tau n_k

holds of T = B + delta.

With lambda_I(x) a polynomial like tau for each node, delta_qI is omega_qI times
lambda_I(x_q) less its best fit of p(x_I) over the nodes that reach q. The system of the
lambda is symmetric, positive but for lambda_I(x) that are polynomials p in x_I, and
compatible if weights and boundary rule are exact: `exact=True` in
`jaxpd.discretize.quadrature.quadrature`, four nodes a held straight edge. What is not
compatible is left out.

Degree 2 is the quadratic consistency of Duan, Wang, Gao and Li (2014), here without
cells; degree 1 is the linear one.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from jaxpd._types import PointVector
from jaxpd.discretize.consistency import missed
from jaxpd.discretize.moments import monomials

#: Share of the gradient in omega: at a node that few others reach, |Psi| is zero for
#: these and fits no polynomial.
SMOOTH = 0.01
#: What is added to the diagonal, relative to its largest entry, and how many steps of
#: refinement take it out again.
SHIFT, STEPS = 1e-11, 3


def projected(
    X: PointVector,
    radius: Any,
    nodes_of: jax.Array,
    places: tuple[jax.Array, jax.Array, jax.Array, jax.Array],
    rim: tuple[jax.Array, jax.Array, jax.Array, jax.Array],
    degree: int = 2,
) -> jax.Array:
    """Gradients [d, K, g, c] that are in equilibrium with stresses up to degree - 1.

    Traced; the factors are computed on the host.

    Args:
        X: nodes [n, d] (m).
        radius: of their kernels [n] (m).
        nodes_of: nodes that reach each cell [K, c].
        places: places [g, c, d], weights [g, c], gradients [d, K, g, c] and shape
            functions [K, g, c].
        rim: places of the boundary [b, d], normals times weights [b, d], nodes [k, b]
            and shape functions [k, b] there.
        degree: of the polynomials whose gradients stay as they are, 1 or 2.
    """
    n, d = X.shape
    place, w, B, psi = places
    a = radius[nodes_of]
    far = X[nodes_of][:, None] - place[None]
    z = -far / a[:, None, :, None]
    tau: Any = monomials(z, degree - 1)  # [K, g, c, T]
    square: Any = psi**2 + (SMOOTH * a[:, None]) ** 2 * jnp.sum(B * B, axis=0)
    here: Any = square > 0.0
    safe: Any = jnp.where(here, square, 1.0)
    weight: Any = jnp.where(here, jnp.sqrt(safe), 0.0)
    reached: Any = jnp.where(here[..., None], far, 0.0)
    scale = jax.lax.stop_gradient(jnp.abs(reached).max(axis=(0, 3)))
    p = monomials(far / scale[None, ..., None], degree)
    gram = jnp.einsum("kgc,kgci,kgcj->gcij", weight, p, p)
    fit = jnp.linalg.inv(gram)

    def change(lam):  # [T, n, d] -> delta [d, K, g, c]
        each = weight[None] * jnp.einsum("tkca,kgct->akgc", lam[:, nodes_of], tau)
        mean = jnp.einsum("gcij,kgcj,akgc->agci", fit, p, each)
        return each - weight[None] * jnp.einsum("kgci,agci->akgc", p, mean)

    def matvec(lam):
        inner = jnp.einsum("gc,akgc,kgct->tkca", w, change(lam), tau)
        return jnp.zeros_like(lam).at[:, nodes_of].add(inner)

    def on_host(_, b):
        shape = jax.ShapeDtypeStruct(b.shape, b.dtype)
        parts = nodes_of, w, weight, tau, p, fit, null, b
        return jax.pure_callback(_solve, shape, *parts, vmap_method="sequential")

    null = _null(X, radius, degree)
    right = missed(X, radius, nodes_of, places, rim, degree - 1)
    b = jnp.transpose(right, (2, 0, 1)).reshape(-1, d)  # [T n, d]
    b = (b - null @ (null.T @ b)).reshape(-1, n, d)
    lam = jax.lax.custom_linear_solve(matvec, b, on_host, symmetric=True)
    return B + change(lam)


def _null(X: jax.Array, radius: Any, degree: int) -> jax.Array:
    """Orthonormal lambda [T n, m] that change nothing: polynomials of x and x_I."""
    n, d = X.shape
    middle, size = X.mean(axis=0), jnp.ptp(X, axis=0).max()
    at = (X - middle[None]) / size
    p = monomials(at, degree)
    tau = jnp.ones((1, n, 1))
    if degree > 1:  # 1 and x as polynomials of (x - x_I) / a_I
        tau = jnp.zeros((1 + d, n, 1 + d)).at[0, :, 0].set(1.0).at[0, :, 1:].set(at)
        k = jnp.arange(1, 1 + d)
        tau = tau.at[k, :, k].set((radius / size)[None])
    both = tau[:, :, :, None] * p[None, :, None, :]
    return jnp.linalg.qr(both.reshape(len(tau) * n, -1))[0]


def _solve(
    nodes_of: Any, w: Any, weight: Any, tau: Any, p: Any, fit: Any, null: Any, b: Any
) -> np.ndarray:
    """The lambda [T, n, d] of right-hand sides b, by factors of a shifted matrix."""
    nodes_of, w, weight, tau, p, fit, null, b = map(
        np.asarray, (nodes_of, w, weight, tau, p, fit, null, b)
    )
    T, n, d = b.shape
    right = b.reshape(T * n, d)
    K, c = nodes_of.shape
    t = np.sqrt(np.maximum(w, 0.0))[None, ..., None] * tau
    diagonal = np.einsum("kgc,kgct,kgcs->ckts", weight, tau * w[None, ..., None], tau)
    low = np.einsum("kgc,kgci,kgct->cgikt", weight, p, t)
    del t
    fitted = np.einsum("gcij,cgjkt->cgikt", fit, low)
    block = -(
        low.reshape(c, -1, K * T).transpose(0, 2, 1) @ fitted.reshape(c, -1, K * T)
    ).reshape(c, K, T, K, T)
    k = np.arange(K)
    block[:, k, :, k] += diagonal.transpose(1, 0, 2, 3)
    at = (np.arange(T) * n + nodes_of.T[:, :, None]).reshape(c, K * T)
    rows = np.broadcast_to(at[:, :, None], (c, K * T, K * T))
    columns = np.broadcast_to(at[:, None], rows.shape)
    values = block.reshape(rows.shape)
    used = values != 0.0
    S = sp.coo_matrix(
        (values[used], (rows[used], columns[used])), shape=(T * n, T * n)
    ).tocsc()
    S = 0.5 * (S + S.T)
    if not (np.isfinite(S.data).all() and np.isfinite(right).all()):
        return np.full(b.shape, np.nan)
    shift = SHIFT * S.diagonal().max()
    factors = splu(
        (S + shift * sp.identity(T * n)).tocsc(),
        permc_spec="MMD_AT_PLUS_A",
        diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )
    x = np.zeros_like(right)
    for _ in range(1 + STEPS):
        left = right - S @ x
        x += factors.solve(left - null @ (null.T @ left))
        x -= null @ (null.T @ x)
    return x.reshape(b.shape)
