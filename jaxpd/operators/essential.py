"""Prescribed displacements of kernel sums, as affine constraints that are eliminated.

Reproducing kernels do not interpolate: at a node x_I the displacement is the sum of
Psi_J(x_I) a_J. With the nodes that have a prescribed component (held ones) the unknowns
are the displacements of held nodes and the coefficients of all others,

    a = T u:   a_h = L_hh^-1 (u_h - L_hr a_r),   a_r = u_r,   L_IJ = Psi_J(x_I),

so that the constraints L a = g become prescribed entries of u, and any solver of this
package applies. Test functions vanish at held nodes, and the residual there is the
reaction, node by node.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointVector


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Essential:
    """The map T of unknowns to coefficients.

    Attributes:
        held: nodes whose displacement is unknown or prescribed [h], int32.
        nbr: nodes that reach them [k, h], int32.
        rest: shape functions there [k, h], zero for nodes that are held themselves.
        inverse: of those that are [h, h].
    """

    held: jax.Array
    nbr: jax.Array
    rest: jax.Array
    inverse: jax.Array

    def coefficients(self, u: PointVector) -> PointVector:
        """Coefficients [n, d] of unknowns [n, d]."""
        far = jnp.einsum("kh,kha->ha", self.rest, u[self.nbr])
        own = self.inverse @ (u[self.held] - far)
        return u.at[self.held].set(own, unique_indices=True)

    def back(self, force: PointVector) -> PointVector:
        """T^T f [n, d]: forces on the unknowns."""
        own = self.inverse.T @ force[self.held]
        out = force.at[self.held].set(own, unique_indices=True)
        return out.at[self.nbr].add(-self.rest[..., None] * own[None])

    def matrix(self, n: int, d: int) -> Any:
        """T as a SciPy matrix [n d, n d]; on the host, of NumPy arrays."""
        held, h = np.asarray(self.held), len(self.held)
        free = np.ones(n)
        free[held] = 0.0
        pick = sp.csr_matrix((np.ones(h), (held, np.arange(h))), (n, h))
        row = np.broadcast_to(np.arange(h), np.shape(self.nbr))
        rest = sp.csr_matrix(
            (np.ravel(self.rest), (row.ravel(), np.ravel(self.nbr))), (h, n)
        )
        inner = sp.csr_matrix(np.asarray(self.inverse)) @ (pick.T - rest)
        return sp.kron(sp.diags_array(free) + pick @ inner, sp.eye_array(d)).tocsr()


def essential(held: jax.Array, nbr: jax.Array, value: jax.Array, n: int) -> Essential:
    """The map T of held nodes [h] among n. Traced in the shape functions.

    Args:
        held: the nodes.
        nbr: nodes that reach them [k, h].
        value: shape functions there [k, h], zero where padded.
        n: number of nodes.
    """
    h = len(held)
    rank = jnp.full(n, h).at[held].set(jnp.arange(h))
    column = rank[nbr]
    own = jnp.zeros((h, h)).at[jnp.arange(h)[None], column].add(value, mode="drop")
    rest = jnp.where(column < h, 0.0, value)
    return Essential(held, nbr, rest, jnp.linalg.inv(own))
