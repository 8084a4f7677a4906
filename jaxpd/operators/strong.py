"""The strong form: the balance of stress at nodes, collocated (paper 001).

Strains at stress points are weighted sums of nodal displacements, stresses follow from
the law, and the balance of a node is a weighted sum of stresses again,

    strain_q = sum over k  B_k u,    r_i = sum over k  D_k sigma_k + f_i,

the double derivative approximation (eq. 9, 22) where stress points are the nodes. At
nodes under traction the row of a component is (t - n sigma) / h instead, at the scale
of the others. Residuals are force densities (N/m^3).

D is not the transpose of B and no energy exists: the tangent K = -D C B is not
symmetric, whatever paper 001 expects of it, and CG does not apply.

The double derivative does not see displacements that alternate from node to node, nor
stresses that do. The filter is what they are held by: with Phi the fit of the value
itself, which smooths,

    f = -(tau mu / h^2) (1 - Phi)^2 u

at nodes of balance; it leaves polynomials of the basis alone, and falls with h as the
error of the scheme does. tau = 0 is paper 001.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.discretize.collocate import Collocation
from jaxpd.operators.strong_tangent import StrongTangent
from jaxpd.physics import Hooke, tangent_block
from jaxpd.physics.voigt import voigt


def each(law: Any, q: int) -> Any:
    """Axes for `jax.vmap` over stress points: leaves [q] vary, others are shared."""
    return jax.tree.map(lambda x: 0 if jnp.shape(x)[:1] == (q,) else None, law)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class StrongForce:
    """The residual of the strong form as an operator; see the module's docstring.

    Attributes:
        weights: between nodes and stress points.
        law: of one stress point (`jaxpd.physics.plasticity`), leaves [] or [q].
        shear: modulus mu of the filter [] or [n] (Pa).
        tau: strength of the filter [] (-).
        history: committed memory of the stress points, leaves [q, ...].
        how: tangent of the law, "ad", "hand" or "continuum".
    """

    weights: Collocation
    law: Any
    shear: PointScalar
    tau: Any
    history: Any
    how: str = field(metadata={"static": True}, default="ad")

    unit = "N/m^3"
    symmetric = False

    @property
    def linear(self) -> bool:
        """Whether the law is linear elastic."""
        return isinstance(self.law, Hooke)

    def exact(self) -> StrongForce:
        """The same with tangents by automatic differentiation."""
        return dataclasses.replace(self, how="ad")

    def history0(self) -> Any:
        """The memory of an untouched body."""
        return untouched(self.law, self.weights.q)

    def after(self, history: Any) -> StrongForce:
        """The operator of the next load step, with this memory committed."""
        return dataclasses.replace(self, history=history)

    def strain(self, u: PointVector) -> jax.Array:
        """Strains at stress points [q, s] (-)."""
        return self.weights.strain(u)

    def update(self, u: PointVector, history: Any = None) -> tuple[jax.Array, Any]:
        """Stresses [q, s] (Pa) and trial memory at u."""
        history = self.history if history is None else history
        axes = (each(self.law, self.weights.q), 0, 0)
        step = jax.vmap(lambda law, e, h: law.step(e, h), in_axes=axes)
        return step(self.law, self.strain(u), history)

    def tensor(self, stress: jax.Array) -> jax.Array:
        """Stress tensors [q, d, d] (Pa) of Voigt stresses [q, s]."""
        return jnp.einsum("sab,qs->qab", voigt(self.weights.D.shape[0]), stress)

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Balance of each node [n, d] (N/m^3), or (-n sigma) / h under traction."""
        return self.left(self.update(u, history)[0], u)

    def left(self, stress: jax.Array, u: PointVector) -> PointVector:
        """The same of known stresses [q, s] (Pa) at u."""
        held = self.weights.held(u, self.shear)
        return self.weights.balance(stress) - self.tau * held

    def advance(self, u: PointVector, history: Any = None) -> Any:
        """The memory committed at u."""
        return self.update(u, history)[1]

    def energy(self, u: PointVector, history: Any = None) -> Any:
        """None exists: D is not the transpose of B. NaN."""
        return jnp.full((), jnp.nan, u.dtype)

    def bound(self) -> float:
        """Bound on the row sums of |K| of the elastic body (N/m^4). Host only."""
        strain = np.abs(self.weights.B).sum(axis=(0, 1)).max()
        row = np.abs(self.weights.D).sum(axis=(1, 2)).max()
        return float(row * stiffest(self.law) * strain)

    def tangent(self, u: PointVector, history: Any = None) -> StrongTangent:
        """K = -D C B + filter, C the law's tangent at each stress point."""
        history = self.history if history is None else history

        def block(law, e, h):
            return tangent_block(law, e, h, self.how)

        axes = (each(self.law, self.weights.q), 0, 0)
        C = jax.vmap(block, in_axes=axes)(self.law, self.strain(u), history)
        return StrongTangent(self.weights, C, self.shear, self.tau)


def stiffest(law: Any) -> float:
    """Largest row sum of a law's elastic stiffness (Pa), or an estimate. Host only."""
    if hasattr(law, "stiffness") and not any(map(np.ndim, jax.tree.leaves(law))):
        return float(np.abs(law.stiffness()).sum(axis=1).max())
    return float(4.0 * np.max(law.shear))


def untouched(law: Any, q: int) -> Any:
    """Memory of q untouched stress points: leaves [q, ...]."""
    return jax.tree.map(
        lambda x: jnp.broadcast_to(jnp.asarray(x), (q, *np.shape(x))), law.history0()
    )
