"""The one protocol between mechanics and solvers.

Solvers know these classes and no physics; an operator knows physics and no solver.
Forces are nodal forces (N in 3-D): volumes of both ends included, so that the stiffness
is symmetric (paper 000, eq. 17).
"""

from __future__ import annotations

from typing import Any, Protocol

import jax

from jaxpd._types import PointTensor, PointVector, Scalar


class Tangent(Protocol):
    """The stiffness K = -d respond / du at a displacement: positive at rest."""

    @property
    def symmetric(self) -> bool:
        """Whether K is symmetric."""
        ...

    def mv(self, du: PointVector) -> PointVector:
        """K du [n, d] (N)."""
        ...

    def diagonal(self) -> PointTensor:
        """Block diagonal [n, d, d] (N/m) for preconditioning."""
        ...

    def coo(self) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Rows [b], columns [b] and blocks [b, d, d] of K; duplicates add up."""
        ...


class ForceOperator(Protocol):
    """Displacements to nodal forces."""

    @property
    def unit(self) -> str:
        """Either "N" for nodal forces or "N/m^3" for force densities."""
        ...

    @property
    def symmetric(self) -> bool:
        """Whether tangents are symmetric."""
        ...

    @property
    def linear(self) -> bool:
        """Whether the force is linear in u."""
        ...

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal force [n, d] = -dE/du where an energy exists; zero at rest."""
        ...

    def exact(self) -> ForceOperator:
        """The same forces with tangents by automatic differentiation."""
        ...

    def advance(self, u: PointVector, history: Any = None) -> Any:
        """The committed memory after u; called by the driver alone."""
        ...

    def history0(self) -> Any:
        """The memory of an untouched body."""
        ...

    def energy(self, u: PointVector, history: Any = None) -> Scalar:
        """Stored energy [] (J)."""
        ...

    def tangent(self, u: PointVector, history: Any = None) -> Tangent:
        """Stiffness at u and frozen history."""
        ...


class MotionForce(Protocol):
    """Displacements and memory to nodal forces and memory, for explicit runs.

    One sweep commits the memory and makes the force, since a bond that breaks at u does
    not pull at u. Arrays of points are kept in the operator's own layout, [L] or
    [d, L]: `lay` goes there, `pick` comes back.
    """

    def lay(self, values: Any) -> jax.Array:
        """Nodal values [n] or [n, d] as [L] or [d, L]; empty places are zero."""
        ...

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of [L] or [d, L]."""
        ...

    def plain(self) -> MotionForce:
        """The same without hand-derived rules, for forward mode."""
        ...

    def commit(self, u: jax.Array, history: Any) -> tuple[jax.Array, Any]:
        """The memory after u [d, L], and the forces [d, L] (N) that it leaves."""
        ...

    def energy(self, u: jax.Array, history: Any) -> jax.Array:
        """Stored energy (J), point by point; the sum is the body's."""
        ...

    def released(self, history: Any, history0: Any) -> jax.Array:
        """Energy [] (J) that breaking has cost since `history0`; NaN if unknown."""
        ...

    def intact(self, history: Any) -> jax.Array:
        """Volume of the bonds of each point that are left [L], in any unit."""
        ...

    def diagonal(self, history: Any) -> PointTensor:
        """Diagonal blocks [n, d, d] (N/m) of the stiffness at rest, or larger ones."""
        ...
