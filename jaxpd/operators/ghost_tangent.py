"""The stiffness of a ghost interlayer: bonds between a point and an average of others.

A bond of stiffness B between its end and a ghost, eta = u_end - sum w_k u_k, adds
c_i c_j B for every two of its points, with c = 1 at the end and -w_k at what makes the
ghost, added up where one point is both. Without the reaction on ghosts the rows of the
latter are missing, and the stiffness is not symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointTensor, PointVector, namespace
from jaxpd.discretize.interlayer import Joint


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class GhostTangent:
    """Stiffness of bonds and springs of ghosts, a `Tangent` of the touched points.

    Attributes:
        joint: geometry.
        blocks: of the bonds [k, q, d, d] (N/m).
        springs: of the springs [q, d, d] (N/m).
        one_way: whether what pulls at ghosts is dropped.
    """

    joint: Joint
    blocks: jax.Array
    springs: jax.Array
    one_way: bool = field(metadata={"static": True})

    @property
    def symmetric(self) -> bool:
        """Whether K is symmetric."""
        return not self.one_way

    def mv(self, du: PointVector) -> PointVector:
        """K du [p, d] (N)."""
        joint = self.joint
        sources = du[joint.sources]
        ghosts = jnp.einsum("qw,qwd->qd", joint.weights, sources)
        opening = jnp.einsum("qw,qwd->qd", joint.arms, sources)
        pull = jnp.einsum("kqab,kqb->kqa", self.blocks, du[joint.ends] - ghosts[None])
        pull0 = jnp.einsum("qab,qb->qa", self.springs, opening)
        force = jnp.zeros_like(du).at[joint.ends].add(pull)
        back = joint.arms[..., None] * pull0[:, None]
        if not self.one_way:
            back = back - joint.weights[..., None] * pull.sum(axis=0)[:, None]
        return force.at[joint.sources].add(back)

    def _lists(self) -> tuple[Any, Any, Any]:
        """Points, coefficients and blocks of all bonds: [w + 1, b], [w + 1, b], [b].

        In NumPy where all of it is NumPy's.
        """
        joint, xp = self.joint, namespace(self.blocks, self.joint.ends)
        k, q = joint.ends.shape
        w, d = joint.sources.shape[1], self.springs.shape[-1]
        made = xp.broadcast_to(joint.sources.T[:, None], (w, k, q)).reshape(w, -1)
        own = -xp.broadcast_to(joint.weights.T[:, None], (w, k, q)).reshape(w, -1)
        ends = joint.ends.reshape(1, -1)
        # a source that is the end itself: its coefficient joins that of the end
        same = made == ends
        end = 1.0 + xp.where(same, own, 0.0).sum(axis=0, keepdims=True)
        factors = xp.concatenate([end, xp.where(same, 0.0, own)])
        return xp.concatenate([ends, made]), factors, self.blocks.reshape(-1, d, d)

    def _left(self, factors: Any) -> Any:
        """Coefficients of the rows: without reaction those of the ends, 1, alone."""
        if not self.one_way:
            return factors
        xp = namespace(factors)
        return xp.zeros_like(factors) + (xp.arange(len(factors)) == 0)[:, None]

    def diagonal(self) -> PointTensor:
        """Block diagonal of K [p, d, d] (N/m), exact."""
        points, factors, blocks = self._lists()
        joint, scale = self.joint, (self._left(factors) * factors)[..., None, None]
        total = jnp.zeros((len(joint.points), *blocks.shape[1:]), blocks.dtype)
        total = total.at[points].add(scale * blocks[None])
        springs = (joint.arms**2)[..., None, None] * self.springs[:, None]
        return total.at[joint.sources].add(springs)

    def bound(self) -> PointTensor:
        """Blocks [p, d, d] (N/m) of which twice the form is at least that of K.

        (sum c_j x_j)^2 is at most sum |c| times sum |c_j| x_j^2, and a plain bond,
        whose |c| add up to 2, is counted as it is.
        """
        points, factors, blocks = self._lists()
        joint, size = self.joint, jnp.abs(factors)
        scale = 0.5 * size * size.sum(axis=0, keepdims=True)
        total = jnp.zeros((len(joint.points), *blocks.shape[1:]), blocks.dtype)
        total = total.at[points].add(scale[..., None, None] * blocks[None])
        arms = jnp.abs(jnp.asarray(joint.arms))
        scale = 0.5 * arms * arms.sum(axis=1, keepdims=True)
        springs = scale[..., None, None] * self.springs[:, None]
        return total.at[joint.sources].add(springs)

    def coo(self) -> tuple[Any, Any, Any]:
        """Rows, columns and blocks of K among the touched points; duplicates add up."""
        points, factors, blocks = self._lists()
        arms, made = self.joint.arms.T, self.joint.sources.T
        bonds = _products(points, self._left(factors), factors, blocks)
        springs = _products(made, arms, arms, self.springs)
        xp = namespace(*bonds, *springs)
        rows, cols, parts = (
            xp.concatenate(x) for x in zip(bonds, springs, strict=True)
        )
        return rows, cols, parts

    def to_bsr(self) -> sp.bsr_matrix:
        """K of the touched points as a SciPy BSR matrix on the host."""
        rows, cols, blocks = jax.tree.map(np.asarray, self).coo()
        p, d = len(self.joint.points), blocks.shape[-1]
        used = np.abs(blocks).max(axis=(1, 2)) > 0.0
        rows, cols, blocks = rows[used], cols[used], blocks[used]
        at = [
            d * x[:, None, None] + o
            for x, o in zip((rows, cols), np.indices((d, d)), strict=True)
        ]
        at = [np.broadcast_to(x, blocks.shape).ravel() for x in at]
        K = sp.coo_matrix((blocks.ravel(), tuple(at)), shape=(p * d, p * d))
        return sp.bsr_matrix(K.tocsr(), blocksize=(d, d))


def _products(points: Any, left: Any, right: Any, blocks: Any) -> tuple[Any, Any, Any]:
    """Rows, columns and blocks of all pairs of points [w, b] of each bond."""
    xp, (w, b) = namespace(points, left, right, blocks), points.shape
    scale = (left[:, None] * right[None])[..., None, None]
    rows = xp.broadcast_to(points[:, None], (w, w, b)).ravel()
    cols = xp.broadcast_to(points[None], (w, w, b)).ravel()
    return rows, cols, (scale * blocks[None, None]).reshape(-1, *blocks.shape[1:])
