"""Test gradients that are in equilibrium with stresses of degree 0, 1, ..: local.

Where places and weights do not satisfy the divergence theorem, the gradient with which
node I is tested is given a polynomial on its support,

    T_qI = B_qI + xi_I . tau(x_q),

with the xi that make, for all tau up to a degree,

    sum over q  w (T_qI tau + Psi_I tau_,k)  =  sum over b  s Psi_I tau n_k,

one small matrix a node: Chen, Hillman and Rueter's variationally consistent integration
(2013), of first degree for constant stresses and of second degree for linear ones. Any
rule passes its patch tests then, but trial and test differ: the stiffness is not
symmetric, and since the sum of T over nodes is not zero, neither is that of the forces.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointVector
from jaxpd.discretize.moments import monomials, powers


def consistent(
    X: PointVector,
    radius: Any,
    nodes_of: jax.Array,
    places: tuple[jax.Array, jax.Array, jax.Array, jax.Array],
    rim: tuple[jax.Array, jax.Array, jax.Array, jax.Array],
    degree: int,
) -> jax.Array:
    """Test gradients [d, K, g, c] for stresses up to a degree. Traced.

    Args:
        X: nodes [n, d] (m).
        radius: of their kernels [n] (m).
        nodes_of: nodes that reach each cell [K, c].
        places: places [g, c, d], weights [g, c], gradients [d, K, g, c] and shape
            functions [K, g, c].
        rim: places of the boundary [b, d], normals times weights [b, d], nodes [k, b]
            and shape functions [k, b] there.
        degree: 0 or more.
    """
    place, w, B, psi = places
    tau = _supported(X, radius, nodes_of, place, psi, degree)
    M = jnp.einsum("gc,kgct,kgcs->kcts", w, tau, tau)
    T = tau.shape[-1]
    gram = jnp.zeros((len(X), T, T)).at[nodes_of].add(M)
    right = missed(X, radius, nodes_of, places, rim, degree)
    xi = jnp.einsum("nts,nas->nat", jnp.linalg.inv(gram), right)
    return B + jnp.einsum("kcat,kgct->akgc", xi[nodes_of], tau)


def missed(
    X: PointVector,
    radius: Any,
    nodes_of: jax.Array,
    places: tuple[jax.Array, jax.Array, jax.Array, jax.Array],
    rim: tuple[jax.Array, jax.Array, jax.Array, jax.Array],
    degree: int,
) -> jax.Array:
    """What gradients miss of the divergence theorem [n, d, T].

    Arguments are `consistent`'s. For each node I, direction k and monomial tau of
    (x - x_I) / a_I

        sum over b  s Psi_I tau n_k  -  sum over q  w (B_qI tau + Psi_I tau_,k).
    """
    n, d = X.shape
    place, w, B, psi = places
    a = radius[nodes_of]
    z = (place[None] - X[nodes_of][:, None]) / a[:, None, :, None]
    tau: Any = monomials(z, degree)  # [K, g, c, T]
    slope: Any = jnp.stack([_slope(z, degree, k) for k in range(d)])  # d tau / d z_k
    slope = slope / a[None, :, None, :, None]
    inner: Any = jnp.einsum("gc,akgc,kgct->kcat", w, B, tau)
    inner += jnp.einsum("gc,kgc,akgct->kcat", w, psi, slope)
    at, flux, nbr, value = rim
    far = (at[None] - X[nbr]) / radius[nbr][..., None]
    outer = jnp.einsum("kb,ba,kbt->kbat", value, flux, monomials(far, degree))
    out: Any = jnp.zeros((n, d, tau.shape[-1])).at[nbr].add(outer)
    return out.at[nodes_of].add(-inner)


def _supported(
    X: jax.Array, radius: Any, nodes_of: jax.Array, place: Any, psi: Any, degree: int
) -> Any:
    """Monomials of (x - x_I) / a_I [K, g, c, T], zero where Psi_I is."""
    z = (place[None] - X[nodes_of][:, None]) / radius[nodes_of][:, None, :, None]
    return jnp.where((psi != 0.0)[..., None], monomials(z, degree), 0.0)


def _slope(z: jax.Array, degree: int, k: int) -> jax.Array:
    """Derivatives [.., T] of the monomials with respect to z_k."""
    d = z.shape[-1]
    every, index = monomials(z, degree), powers(d, degree)
    out: list[Any] = []
    for power in index:
        down = tuple(p - (a == k) for a, p in enumerate(power))
        out.append(
            every[..., index.index(down)] if power[k] else jnp.zeros_like(z[..., 0])
        )
    return jnp.stack(out, axis=-1)
