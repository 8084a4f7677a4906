"""Sums of operators: plies on points of their own, interlayers on points of theirs.

    force(u) = sum over plies of f(u[from:to])  +  sum over joints of f(u[points])

Every ply keeps its own operator, whichever it is: a lattice beside a cloud, stiff
beside soft, with its own horizon. Memories are tuples, plies first.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp

from jaxpd._types import PointScalar, PointTensor, PointVector, Scalar


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Sum:
    """The force of several operators on one body.

    Attributes:
        plies: operators on consecutive points.
        joints: operators on the points `joint.points` of their own.
        sizes: numbers of points of the plies.
    """

    plies: tuple[Any, ...]
    joints: tuple[Any, ...]
    sizes: tuple[int, ...] = field(metadata={"static": True})

    linear = False

    @property
    def parts(self) -> tuple[Any, ...]:
        """All operators, plies first."""
        return (*self.plies, *self.joints)

    @property
    def unit(self) -> str:
        """That of all operators.

        Raises:
            ValueError: if forces and force densities are mixed.
        """
        units = {op.unit for op in self.parts}
        if len(units) > 1:
            raise ValueError(f"plies: {sorted(units)} cannot be added")
        return units.pop()

    @property
    def law(self) -> Any:
        """The law of the first ply without an energy, or of the first ply."""
        laws = [op.law for op in self.plies]
        return next((law for law in laws if not hasattr(law, "energy")), laws[0])

    @property
    def symmetric(self) -> bool:
        """Whether all tangents are symmetric."""
        return all(op.symmetric for op in self.parts)

    def exact(self) -> Sum:
        """The same with tangents by automatic differentiation."""
        plies, joints = (
            tuple(op.exact() for op in x) for x in (self.plies, self.joints)
        )
        return replace(self, plies=plies, joints=joints)

    def history0(self) -> tuple[Any, ...]:
        """The memories of an untouched body."""
        return tuple(op.history0() for op in self.parts)

    def _each(self, history: Any) -> tuple[Any, Any]:
        if history is None:
            return (None,) * len(self.plies), (None,) * len(self.joints)
        return history[: len(self.plies)], history[len(self.plies) :]

    def _nodal(self, u: PointVector, name: str, history: Any) -> jax.Array:
        """What all operators have at the points, added up."""
        plies, joints = self._each(history)
        total = jnp.concatenate(
            [
                getattr(op, name)(part, h)
                for op, part, h in zip(
                    self.plies, _split(u, self.sizes), plies, strict=True
                )
            ]
        )
        for op, h in zip(self.joints, joints, strict=True):
            points = op.joint.points
            total = total.at[points].add(getattr(op, name)(u[points], h))
        return total

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal force [n, d] (N)."""
        return self._nodal(u, "respond", history)

    def energy_per_point(self, u: PointVector, history: Any = None) -> PointScalar:
        """Stored energy of each point [n] (J); that of joints at their faces."""
        return self._nodal(u, "energy_per_point", history)

    def energy(self, u: PointVector, history: Any = None) -> Scalar:
        """Stored energy [] (J)."""
        return jnp.sum(self.energy_per_point(u, history))

    def advance(self, u: PointVector, history: Any = None) -> tuple[Any, ...]:
        """The memories after u."""
        plies, joints = self._each(history)
        parts = zip(self.plies, _split(u, self.sizes), plies, strict=True)
        after = [op.advance(part, h) for op, part, h in parts]
        for op, h in zip(self.joints, joints, strict=True):
            after.append(op.advance(u[op.joint.points], h))
        return tuple(after)

    def tangent(self, u: PointVector, history: Any = None) -> SumTangent:
        """Stiffness at u."""
        plies, joints = self._each(history)
        parts = zip(self.plies, _split(u, self.sizes), plies, strict=True)
        return SumTangent(
            tuple(op.tangent(part, h) for op, part, h in parts),
            tuple(
                op.tangent(u[op.joint.points], h)
                for op, h in zip(self.joints, joints, strict=True)
            ),
            self.sizes,
        )


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SumTangent:
    """The stiffness of a `Sum`, a `Tangent`.

    Attributes:
        plies: stiffness of each ply.
        joints: stiffness of each joint.
        sizes: numbers of points of the plies.
    """

    plies: tuple[Any, ...]
    joints: tuple[Any, ...]
    sizes: tuple[int, ...] = field(metadata={"static": True})

    @property
    def symmetric(self) -> bool:
        """Whether K is symmetric."""
        return all(K.symmetric for K in (*self.plies, *self.joints))

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        parts = zip(self.plies, _split(du, self.sizes), strict=True)
        total = jnp.concatenate([K.mv(part) for K, part in parts])
        for K in self.joints:
            points = K.joint.points
            total = total.at[points].add(K.mv(du[points]))
        return total

    def diagonal(self) -> PointTensor:
        """Block diagonal [n, d, d] (N/m) for preconditioning."""
        total = jnp.concatenate([K.diagonal() for K in self.plies])
        for K in self.joints:
            total = total.at[K.joint.points].add(K.diagonal())
        return total

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows, columns and blocks of K; duplicates add up."""
        found, first = [], 0
        for K, size in zip(self.plies, self.sizes, strict=True):
            rows, cols, blocks = K.coo()
            found.append((first + rows, first + cols, blocks))
            first += size
        for K in self.joints:
            rows, cols, blocks = K.coo()
            points = jnp.asarray(K.joint.points)
            found.append((points[rows], points[cols], blocks))
        rows, cols, blocks = map(jnp.concatenate, zip(*found, strict=True))
        return rows, cols, blocks

    def to_bsr(self) -> sp.bsr_matrix:
        """K as a SciPy BSR matrix on the host."""
        total: Any = sp.block_diag([K.to_bsr() for K in self.plies], format="csr")
        n, d = sum(self.sizes), total.shape[0] // sum(self.sizes)
        for K in self.joints:
            points = np.asarray(K.joint.points)
            one, here = np.ones(len(points)), np.arange(len(points))
            pick = sp.csr_matrix((one, (here, points)), shape=(len(points), n))
            pick = sp.kron(pick, np.eye(d), format="csr")
            total = total + pick.T @ K.to_bsr().tocsr() @ pick
        return sp.bsr_matrix(total, blocksize=(d, d))


def _split(values: Any, sizes: tuple[int, ...]) -> list[Any]:
    ends = itertools.accumulate(sizes, initial=0)
    return [values[a:b] for a, b in itertools.pairwise(ends)]
