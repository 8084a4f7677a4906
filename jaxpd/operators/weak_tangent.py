"""The stiffness of the weak form: dense blocks of cells, summed where cells overlap."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointTensor, PointVector
from jaxpd.discretize.sampling import Sampling
from jaxpd.discretize.stabilised import Penalty
from jaxpd.operators.essential import Essential
from jaxpd.physics.voigt import voigt

#: Numbers in the blocks of cells that are made at once on the host.
AT_ONCE = 4_000_000


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class WeakTangent:
    """K = E^T (sum over q  w T^T C B) E, on all unknowns; E maps to coefficients.

    Attributes:
        weights: between nodes and places.
        essential: unknowns to coefficients.
        C: tangent of the law at each place [g c, s, s] (Pa).
        penalty: rows of a stabilised scheme, or None.
        symmetric: whether trial and test gradients are the same, and C symmetric.
    """

    weights: Sampling
    essential: Essential
    C: jax.Array
    penalty: Penalty | None
    symmetric: bool = field(metadata={"static": True})

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        w, V = self.weights, voigt(du.shape[1])
        a = self.essential.coefficients(du)
        local = a[w.nodes_of]
        slope = jnp.einsum("bkgc,kca->gcab", w.B, local)
        strain = jnp.einsum("sab,gcab->gcs", V, slope)
        C = self.C.reshape(*w.w.shape, *self.C.shape[1:])
        stress = w.w[..., None] * jnp.einsum("gcst,gct->gcs", C, strain)
        tensor = jnp.einsum("sab,gcs->gcab", V, stress)
        test = w.B if w.T is None else w.T
        force = jnp.einsum("bkgc,gcab->kca", test, tensor)
        out = jnp.zeros_like(a).at[w.nodes_of].add(force)
        if self.penalty is not None:
            out = out + self.penalty.force(w.nodes_of, a)
        return self.essential.back(out)

    def diagonal(self) -> PointTensor:
        """Block diagonal [n, d, d] (N/m) of K on coefficients."""
        w, d = self.weights, self.weights.B.shape[0]
        V = voigt(d)
        C = self.C.reshape(*w.w.shape, *self.C.shape[1:])
        D = jnp.einsum("sab,gcst,tde->gcabde", V, C * w.w[..., None, None], V)
        test = w.B if w.T is None else w.T
        block = jnp.einsum("bkgc,gcabde,ekgc->kcad", test, D, w.B)
        out = jnp.zeros((w.value.shape[1], d, d), block.dtype)
        out = out.at[w.nodes_of].add(block)
        if self.penalty is not None:
            out = out + self.penalty.diagonal(w.nodes_of, len(out))
        return out

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of K on coefficients, cell by cell; they add up."""
        w, d = self.weights, self.weights.B.shape[0]
        V = voigt(d)
        C = self.C.reshape(*w.w.shape, *self.C.shape[1:]) * w.w[..., None, None]
        D = jnp.einsum("sab,gcst,tde->gcabde", V, C, V)
        test = w.B if w.T is None else w.T
        block = jnp.einsum("bkgc,gcabde,elgc->klcad", test, D, w.B)
        if self.penalty is not None:
            block = block + self.penalty.coo()
        row = jnp.broadcast_to(w.nodes_of[:, None], block.shape[:3])
        column = jnp.broadcast_to(w.nodes_of[None], block.shape[:3])
        return row.ravel(), column.ravel(), block.reshape(-1, d, d)

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix; on the host, of NumPy arrays."""
        w = self.weights
        d, K, g, c = w.B.shape
        n, V = w.value.shape[1], np.asarray(voigt(w.B.shape[0]))
        s = len(V)
        C = np.asarray(self.C).reshape(g, c, s, s) * np.asarray(w.w)[..., None, None]
        nodes = np.asarray(w.nodes_of)
        indptr, indices, position = pattern(nodes.tobytes(), nodes.shape, n)
        total = np.zeros((d, d, len(indices)))
        for part in np.array_split(np.arange(c), -(-c * (K * d) ** 2 // AT_ONCE)):
            B = _rows(np.asarray(w.B)[..., part], V)
            T = B if w.T is None else _rows(np.asarray(w.T)[..., part], V)
            CB = np.einsum("gcst,cgtx->cgsx", C[:, part], B)
            m = len(part)
            block = T.reshape(m, g * s, -1).transpose(0, 2, 1) @ CB.reshape(
                m, g * s, -1
            )
            if self.penalty is not None:
                block = block + _stabilised(self.penalty, part, K * d)
            at = position[part].ravel()
            block = block.reshape(m, K, d, K, d)
            for a, b in np.ndindex(d, d):
                each = np.ascontiguousarray(block[:, :, a, :, b]).ravel()
                total[a, b] += np.bincount(at, each, len(indices))
        entries = np.ascontiguousarray(total.transpose(2, 0, 1))
        full = sp.bsr_matrix((entries, indices, indptr), (n * d, n * d))
        if not len(self.essential.held):
            return full
        E = self.essential.matrix(n, d)
        return sp.bsr_matrix(E.T @ full.tocsr() @ E, blocksize=(d, d))


def _stabilised(penalty: Any, part: np.ndarray, size: int) -> np.ndarray:
    """Blocks [c, K d, K d] of a penalty in some cells; on the host."""
    v = np.asarray(penalty.v)[..., part]
    R = np.asarray(penalty.R)[..., part].transpose(4, 0, 3, 2, 1)  # [c, m, g, K, d]
    R = R.reshape(len(part), -1, size)
    weight = v.transpose(2, 0, 1).reshape(len(part), -1, 1)
    return R.transpose(0, 2, 1) @ (weight * R)


def _rows(B: np.ndarray, V: np.ndarray) -> np.ndarray:
    """Strains of the unknowns of a cell [c, g, s, K d] of gradients [d, K, g, c]."""
    d, K, g, c = B.shape
    return np.einsum("sab,bkgc->cgska", V, B, optimize=True).reshape(c, g, -1, K * d)


@functools.lru_cache(maxsize=2)
def pattern(
    nodes: bytes, shape: tuple[int, int], n: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which pairs of nodes share a cell, as CSR, and where those of each cell are.

    Args:
        nodes: those of cells [K, c] as bytes of int32, so that the last two are kept.
        shape: K and c.
        n: number of nodes.

    Returns:
        Row pointers [n + 1], columns [p], positions among them [c, K, K].
    """
    nodes_of = np.frombuffer(nodes, np.int32).reshape(shape)
    K, c = shape
    cell = np.broadcast_to(np.arange(c), shape)
    ones = np.ones(K * c, np.int32)
    has = sp.csr_matrix((ones, (cell.ravel(), nodes_of.ravel())), (c, n))
    both = sp.csr_matrix(has.T @ has)
    both.sort_indices()
    row = np.repeat(np.arange(n, dtype=np.int64), np.diff(both.indptr))
    key = nodes_of.T[:, :, None].astype(np.int64) * n + nodes_of.T[:, None]
    position = np.searchsorted(row * n + both.indices, key.ravel())
    return both.indptr, both.indices, position.reshape(c, K, K).astype(np.int32)
