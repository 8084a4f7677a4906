"""Derivatives by moving least squares: fast derivative approximation (paper 001).

A Taylor polynomial about y is fitted to the values of the star of y,

    u(x) ~ sum over alpha  (x - y)^alpha / alpha!  D^alpha u(y),

by weighted least squares (eq. 18, 19); its coefficients are value and all derivatives
at once, each a weighted sum of nodal values. They are diffuse derivatives: of the fit,
not of the fitted function. A polynomial of the degree of the basis is reproduced.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointVector
from jaxpd.discretize.moments import Stars, powers, star_moments


def derivative_weights(
    places: PointVector, X: PointVector, stars: Stars, degree: int = 2
) -> jax.Array:
    """Weights of value and derivatives at some places, all from one moment matrix.

    Traced in places and nodes; stars and their radii are frozen.

    Args:
        places: where [q, d] (m).
        X: nodes [n, d] (m).
        stars: of the places.
        degree: of the polynomial.

    Returns:
        [K, k, q] (m^-|alpha|), alpha in the order of `jaxpd.discretize.powers`: the
        derivative D^alpha u is the sum over slots of weights times u[nbr]; zero where
        padded. Sums of weights times monomials are those of Taylor to round-off: the
        inverse of M is corrected once, a' = (2 - a P) a.
    """
    p, w, M = star_moments(places, X, stars, degree)
    a = jnp.einsum("qij,qkj,qk->qik", jnp.linalg.inv(M), p, w)
    eye = jnp.eye(M.shape[-1], dtype=M.dtype)[None]
    a = jnp.einsum("qij,qjk->qik", 2.0 * eye - jnp.einsum("qik,qkj->qij", a, p), a)
    order = jnp.asarray([sum(power) for power in powers(X.shape[1], degree)])
    scale = stars.support[:, None] ** -order[None, :].astype(a.dtype)
    return jnp.transpose(a * scale[:, :, None], (1, 2, 0))


def slopes(weights: jax.Array, d: int) -> jax.Array:
    """Of derivative weights those of the gradient [d, k, q] (1/m)."""
    return weights[1 : d + 1]


def curvatures(weights: jax.Array, d: int, degree: int) -> jax.Array:
    """Of derivative weights those of all second derivatives [d, d, k, q] (1/m^2).

    Raises:
        ValueError: if the basis has none.
    """
    if degree < 2:
        raise ValueError(f"degree: {degree} has no second derivatives; use 2 or more")
    index = powers(d, degree)

    def of(a: int, b: int) -> Any:
        power = tuple((c == a) + (c == b) for c in range(d))
        return weights[index.index(power)]

    return jnp.stack([jnp.stack([of(a, b) for b in range(d)]) for a in range(d)])


def apply_weights(weights: jax.Array, nbr: jax.Array, values: jax.Array) -> jax.Array:
    """Sum over slots of weights [..., k, q] times values[nbr], values [n] or [n, c].

    Returns:
        [..., q] or [..., q, c].
    """
    picked = values[nbr]
    if values.ndim == 1:
        return jnp.einsum("...kq,kq->...q", weights, picked)
    return jnp.einsum("...kq,kqc->...qc", weights, picked)
