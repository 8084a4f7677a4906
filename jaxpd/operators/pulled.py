"""Operators on more points than are unknown: P^T respond(P u).

`op` acts on all points, u_all = P u makes their displacements from the body's (see
`jaxpd.discretize.extension`), and P^T takes the forces back. The energy is `op`'s, so
that the force is its derivative, the stiffness P^T K P is symmetric and positive
semidefinite where K is, and both momenta are conserved if P reproduces affine fields.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointScalar, PointTensor, PointVector, Scalar
from jaxpd.discretize.extension import Extension


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Pulled:
    """The force of an operator on extended points, pulled back to the body's.

    Attributes:
        op: the operator on all points.
        P: the extension.
        credited: whether `energy_per_point` counts the bonds to new points whole at
            their end in the body, as for fictitious points, which are no part of it;
            else new points hand their energy on by P^T. The sum is the same.
    """

    op: Any
    P: Extension
    credited: bool = field(metadata={"static": True}, default=False)

    @property
    def unit(self) -> str:
        """That of the operator."""
        return self.op.unit

    @property
    def symmetric(self) -> bool:
        """Whether tangents are symmetric."""
        return self.op.symmetric

    @property
    def linear(self) -> bool:
        """Whether the force is linear in u."""
        return self.op.linear

    @property
    def law(self) -> Any:
        """The bond law of the operator."""
        return self.op.law

    def exact(self) -> Pulled:
        """The same with tangents by automatic differentiation."""
        return dataclasses.replace(self, op=self.op.exact())

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal force [n, d] (N) on the points of the body."""
        return self.P.transpose(self.op.respond(self.P(u), history))

    def advance(self, u: PointVector, history: Any = None) -> Any:
        """The committed memory of the operator after u."""
        return self.op.advance(self.P(u), history)

    def history0(self) -> Any:
        """The memory of an untouched body."""
        return self.op.history0()

    def energy(self, u: PointVector, history: Any = None) -> Scalar:
        """Stored energy [] (J)."""
        return self.op.energy(self.P(u), history)

    def energy_per_point(self, u: PointVector, history: Any = None) -> PointScalar:
        """Stored energy of each point of the body [n] (J); they add up to `energy`."""
        n = len(u)
        if not self.credited:
            return self.P.transpose(self.op.energy_per_point(self.P(u), history))
        # a point has half the energy of its bonds: twice the weight is all of it
        weight = jnp.where(self.op.nbr >= n, 2.0 * self.op.weight, self.op.weight)
        op = dataclasses.replace(self.op, weight=weight)
        return op.energy_per_point(self.P(u), history)[:n]

    def tangent(self, u: PointVector, history: Any = None) -> PulledTangent:
        """Stiffness P^T K P at u."""
        return PulledTangent(self.op.tangent(self.P(u), history), self.P)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class PulledTangent:
    """The stiffness P^T K P.

    Attributes:
        K: stiffness of all points, a `Tangent`.
        P: the extension.
    """

    K: Any
    P: Extension

    @property
    def symmetric(self) -> bool:
        """Whether K is symmetric."""
        return self.K.symmetric

    def mv(self, du: PointVector) -> PointVector:
        """P^T K P du [n, d] (N)."""
        return self.P.transpose(self.K.mv(self.P(du)))

    def diagonal(self) -> PointTensor:
        """Blocks [n, d, d] (N/m) for preconditioning: positive, but not exact.

        The sum over points of P^2 times their own blocks, without what lies beside the
        diagonal of K between points that share a source.
        """
        squared = dataclasses.replace(self.P, weights=self.P.weights**2)
        return squared.transpose(self.K.diagonal())

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of P^T K P: w^2 blocks for each block of K."""
        rows, cols, blocks = self.K.coo()
        n = self.K.diagonal().shape[0] - self.P.sources.shape[0]
        sources, weights = self.P.lists(n)
        w = sources.shape[1]
        scale = weights[rows][:, :, None] * weights[cols][:, None, :]
        shape, d = scale.shape, blocks.shape[-1]
        to = jnp.broadcast_to(sources[rows][:, :, None], shape)
        of = jnp.broadcast_to(sources[cols][:, None, :], shape)
        parts = scale[..., None, None] * blocks[:, None, None]
        return to.ravel(), of.ravel(), parts.reshape(len(rows) * w * w, d, d)

    def to_bsr(self) -> sp.bsr_matrix:
        """P^T K P as a SciPy BSR matrix on the host."""
        K = self.K.to_bsr()
        d = K.blocksize[0]
        n = K.shape[0] // d - np.shape(self.P.sources)[0]
        P = sp.kron(self.P.matrix(n), np.eye(d), format="csr")
        return sp.bsr_matrix(P.T @ (K.tocsr() @ P), blocksize=(d, d))
