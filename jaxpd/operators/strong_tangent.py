"""The stiffness of the strong form: a product of sparse maps, never symmetric."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointTensor, PointVector
from jaxpd.discretize.collocate import Collocation
from jaxpd.physics.voigt import voigt


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class StrongTangent:
    """K = -D C B + tau filter, on all unknowns.

    Attributes:
        weights: between nodes and stress points.
        C: tangent of the law at each stress point [q, s, s] (Pa).
        shear: modulus of the filter [] or [n] (Pa).
        tau: its strength [].
    """

    weights: Collocation
    C: jax.Array
    shear: Any
    tau: Any

    symmetric = False

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N/m^3)."""
        stress = jnp.einsum("qst,qt->qs", self.C, self.weights.strain(du))
        held = self.tau * self.weights.held(du, self.shear)
        return held - self.weights.balance(stress)

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m^4), without what smooths volumes.

        Of the square of the filter the square of its diagonal.
        """
        w = self.weights
        V = jnp.asarray(voigt(w.D.shape[0]))
        mine = w.B[:, w.back, w.points_of]  # [b, l, n]: of node i in its star's points
        mine = jnp.where(w.back >= 0, mine, 0.0)
        C = jnp.einsum("sab,qst,tcd->qabcd", V, self.C, V)[w.points_of]
        blocks = -jnp.einsum("abln,lnabcd,dln->nac", w.D, C, mine)
        here = jnp.arange(w.stars_of.shape[1], dtype=w.stars_of.dtype)
        own = jnp.sum(jnp.where(w.stars_of == here[None], w.value, 0.0), axis=0)
        mu = jnp.broadcast_to(jnp.asarray(self.shear, own.dtype), own.shape)
        held = self.tau * w.filtered * (mu * (1.0 - own) ** 2)[:, None]
        return blocks + held[:, :, None] * jnp.eye(w.D.shape[0])[None]

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix; on the host, of NumPy arrays."""
        w, V = self.weights, np.asarray(voigt(self.weights.D.shape[0]))
        (s, d, _), q, n = V.shape, w.q, w.points_of.shape[1]
        # rows of stresses, columns of displacements: an entry for each s, a, slot
        B = np.einsum("sab,bkq->sakq", V, w.B)
        B = sparse_map(B, np.arange(q), w.nodes_of, s, d, (q * s, n * d))
        D = np.einsum("sab,abln->asln", V, w.D)
        D = sparse_map(D, np.arange(n), w.points_of, d, s, (n * d, q * s))
        one = sparse_map(w.value[None, None], np.arange(n), w.stars_of, 1, 1, (n, n))
        if w.projected:  # of trace to trace, spread over the normal strains
            mean = np.zeros((s, s))
            mean[:d, :d] = 1.0 / d
            B = B + sp.kron(one @ one - sp.eye_array(n), mean) @ B
        C = sp.bsr_matrix(
            (np.asarray(self.C), np.arange(q), np.arange(q + 1)), (q * s, q * s)
        )
        K = -(D @ (C @ B))
        if np.any(self.tau):
            rest = sp.eye_array(n) - one
            rough = sp.kron(rest @ rest, sp.eye_array(d))
            mu = np.broadcast_to(self.shear, (n,))[:, None]
            K = K + sp.diags_array((self.tau * mu * w.filtered).ravel()) @ rough
        return sp.bsr_matrix(sp.csr_matrix(K), blocksize=(d, d))


def sparse_map(
    values: Any, rows: Any, columns: Any, a: int, b: int, shape: tuple[int, int]
) -> sp.csr_matrix:
    """Entries [a, b, slots, rows] at block rows [rows] and columns [slots, rows]."""
    r = rows[None, None, None] * a + np.arange(a)[:, None, None, None]
    c = np.asarray(columns)[None, None] * b + np.arange(b)[None, :, None, None]
    r, c = np.broadcast_to(r, values.shape), np.broadcast_to(c, values.shape)
    kept = np.asarray(values) != 0.0
    return sp.csr_matrix((np.asarray(values)[kept], (r[kept], c[kept])), shape)
