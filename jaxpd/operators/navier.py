"""The strong form in displacements: Navier's equation, for linear elasticity alone.

    r_i = C_abcd d2u_c / dx_b dx_d + f_a,

second derivatives taken at once by moving least squares (paper 001, eq. 1, 7) where
`strong` takes first derivatives twice. It knows no stress and so no plasticity; it is
here to be compared with. Alternating displacements do not escape it, and it needs no
filter.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointTensor, PointVector
from jaxpd.operators.strong import StrongForce
from jaxpd.operators.strong_tangent import sparse_map
from jaxpd.physics import Hooke
from jaxpd.physics.voigt import voigt


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class NavierForce:
    """Navier's equation as an operator; its rows of traction are those of `strong`.

    Attributes:
        strong: the same body by stresses, for what is looked at.
        rows: of r [d, d, k, n] (N/m^4): component a sums rows[a, c] times u_c over the
            star of node n.
    """

    strong: StrongForce
    rows: jax.Array

    unit = "N/m^3"
    symmetric = False
    linear = True

    @property
    def history(self) -> Any:
        """None, ()."""
        return self.strong.history

    def after(self, history: Any) -> NavierForce:
        """The same: there is no memory."""
        return self

    def exact(self) -> NavierForce:
        """The same: it is linear."""
        return self

    def history0(self) -> Any:
        """No memory."""
        return self.strong.history0()

    def advance(self, u: PointVector, history: Any = None) -> Any:
        """No memory."""
        return self.strong.history

    def update(self, u: PointVector, history: Any = None) -> tuple[jax.Array, Any]:
        """Stresses at nodes [n, s] (Pa), by first derivatives, and no memory."""
        return self.strong.update(u)

    def strain(self, u: PointVector) -> jax.Array:
        """Strains at nodes [n, s] (-), by first derivatives."""
        return self.strong.strain(u)

    def bound(self) -> float:
        """Bound on the row sums of |K| (N/m^4), that of the form in stresses."""
        return self.strong.bound()

    def tensor(self, stress: jax.Array) -> jax.Array:
        """Stress tensors [n, d, d] (Pa) of Voigt stresses [n, s]."""
        return self.strong.tensor(stress)

    def energy(self, u: PointVector, history: Any = None) -> Any:
        """None exists. NaN."""
        return self.strong.energy(u)

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Balance of each node [n, d] (N/m^3), or (-n sigma) / h under traction."""
        picked = u[self.strong.weights.stars_of]
        return jnp.einsum("ackn,knc->na", self.rows, picked)

    def left(self, stress: jax.Array, u: PointVector) -> PointVector:
        """The same; stresses are not asked."""
        return self.respond(u)

    def tangent(self, u: PointVector, history: Any = None) -> NavierTangent:
        """K = -rows, whatever u is."""
        return NavierTangent(self.strong.weights.stars_of, self.rows)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class NavierTangent:
    """K = -rows.

    Attributes:
        nbr: nodes of each star [k, n], int32.
        rows: see `NavierForce`.
    """

    nbr: jax.Array
    rows: jax.Array

    symmetric = False

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N/m^3)."""
        return -jnp.einsum("ackn,knc->na", self.rows, du[self.nbr])

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [n, d, d] (N/m^4), exact."""
        here = self.nbr == jnp.arange(self.nbr.shape[1], dtype=self.nbr.dtype)[None]
        return -jnp.einsum("ackn,kn->nac", self.rows, here.astype(self.rows.dtype))

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix; on the host, of NumPy arrays."""
        d, n = self.rows.shape[0], self.nbr.shape[1]
        K = sparse_map(-self.rows, np.arange(n), self.nbr, d, d, (n * d, n * d))
        return sp.bsr_matrix(K, blocksize=(d, d))


def check_law(law: Any) -> None:
    """Refuse a law that has more than one stiffness.

    Raises:
        ValueError: if it is not Hooke's, or its constants vary from node to node.
    """
    if not isinstance(law, Hooke) or any(np.ndim(x) for x in jax.tree.leaves(law)):
        raise ValueError(
            "scheme: 'direct' has no stress to differentiate and takes Elastic with one"
            f" E and nu, not {type(law).__name__} or nodal values; use 'double'"
        )


def navier(strong: StrongForce, second: jax.Array, pulled: jax.Array) -> NavierForce:
    """Navier's equation of a body whose stresses `strong` has.

    Args:
        strong: with Hooke's law of shared constants; its rows of traction are kept.
        second: weights of second derivatives [d, d, k, n] (1/m^2).
        pulled: mask [n, d] of rows of traction.

    Raises:
        ValueError: if the law is not Hooke's, or its constants vary from node to node.
    """
    law, w = strong.law, strong.weights
    check_law(law)
    V = jnp.asarray(voigt(w.B.shape[0]))
    C = jnp.einsum("sab,st,tcd->abcd", V, law.stiffness(), V)
    inside = jnp.einsum("abcd,bdkn->ackn", C, second)
    # a traction looks at the stress of its own node, which is slot by slot C B
    normal = jnp.sum(w.D, axis=2)
    outside = jnp.einsum("abn,abcd,dkn->ackn", normal, C, w.B)
    return NavierForce(strong, jnp.where(pulled.T[:, None, None, :], outside, inside))
