"""The weak form: internal forces of a law sampled at places in cells (paper 004).

    f_I = - sum over q  w_q  T_qI^T sigma(B_q a),     a = T u,

with the weights of `jaxpd.discretize.sampling` and coefficients a of unknowns u
(`jaxpd.operators.essential`). Where trial and test gradients are the same, B = T, the
forces follow from an energy if the law's do, and the stiffness B^T C B w is symmetric.

Forces are nodal (N). They are on unknowns: at held nodes the force is the reaction.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointVector
from jaxpd.discretize.sampling import Sampling
from jaxpd.discretize.stabilised import Penalty
from jaxpd.operators.essential import Essential
from jaxpd.operators.strong import each, stiffest, untouched
from jaxpd.operators.weak_tangent import WeakTangent
from jaxpd.physics import Hooke, VonMises, tangent_block
from jaxpd.physics.voigt import voigt


def strains(weights: Sampling, a: PointVector) -> jax.Array:
    """Strains at places [g c, s], engineering shear, of coefficients [n, d] (-)."""
    slope = jnp.einsum("bkgc,kca->gcab", weights.B, a[weights.nodes_of])
    strain = jnp.einsum("sab,gcab->gcs", voigt(a.shape[1]), slope)
    return strain.reshape(weights.q, -1)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class WeakForce:
    """Internal forces of a weak form as an operator; see the module's docstring.

    Attributes:
        weights: between nodes and places.
        essential: unknowns to coefficients.
        law: of one place (`jaxpd.physics.node`), leaves [] or [g c].
        penalty: rows of a stabilised scheme, or None.
        loads: nodal forces [r, n, d] (N) on coefficients, of r histories.
        history: committed memory of the places, leaves [g c, ..].
        how: tangent of the law, "ad", "hand" or "continuum".
    """

    weights: Sampling
    essential: Essential
    law: Any
    penalty: Penalty | None
    loads: jax.Array
    history: Any
    how: str = field(metadata={"static": True}, default="ad")

    unit = "N"

    @property
    def symmetric(self) -> bool:
        """Whether tangents are symmetric: one gradient, and a law whose block is."""
        return self.weights.T is None and evenhanded(self.law)

    @property
    def linear(self) -> bool:
        """Whether the law is linear elastic."""
        return isinstance(self.law, Hooke)

    def exact(self) -> WeakForce:
        """The same with tangents by automatic differentiation."""
        return dataclasses.replace(self, how="ad")

    def history0(self) -> Any:
        """The memory of an untouched body."""
        return untouched(self.law, self.weights.q)

    def after(self, history: Any) -> WeakForce:
        """The operator of the next load step, with this memory committed."""
        return dataclasses.replace(self, history=history)

    def load(self, factors: Any) -> PointVector:
        """External forces on the unknowns [n, d] (N) at factors of histories [r]."""
        return self.essential.back(jnp.einsum("r,rna->na", factors, self.loads))

    def field(self, u: PointVector) -> PointVector:
        """Displacements of the nodes [n, d] (m) of unknowns."""
        return self.weights.field(self.essential.coefficients(u))

    def strain(self, u: PointVector) -> jax.Array:
        """Strains at places [g c, s] (-)."""
        return strains(self.weights, self.essential.coefficients(u))

    def update(self, u: PointVector, history: Any = None) -> tuple[jax.Array, Any]:
        """Stresses [g c, s] (Pa) and trial memory at u."""
        history = self.history if history is None else history
        axes = (each(self.law, self.weights.q), 0, 0)
        step = jax.vmap(lambda law, e, h: law.step(e, h), in_axes=axes)
        return step(self.law, self.strain(u), history)

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal forces on the unknowns [n, d] (N)."""
        return self.left(self.update(u, history)[0], u)

    def left(self, stress: jax.Array, u: PointVector) -> PointVector:
        """The same of known stresses [g c, s] (Pa) at u."""
        w = self.weights
        out = -spread(w, jnp.ravel(w.w)[:, None] * stress)
        if self.penalty is not None:
            out = out - self.penalty.force(w.nodes_of, self.essential.coefficients(u))
        return self.essential.back(out)

    def advance(self, u: PointVector, history: Any = None) -> Any:
        """The memory committed at u."""
        return self.update(u, history)[1]

    def density(self, u: PointVector) -> jax.Array:
        """Stored energy of linear elasticity at places [g c] (J/m^3); NaN of others."""
        if not (self.linear and self.symmetric):
            return jnp.full(self.weights.q, jnp.nan)
        return 0.5 * jnp.sum(self.update(u)[0] * self.strain(u), axis=1)

    def energy(self, u: PointVector, history: Any = None) -> Any:
        """Stored energy [] (J) of linear elasticity and its stabilisation; else NaN."""
        total = jnp.sum(jnp.ravel(self.weights.w) * self.density(u))
        if self.penalty is None:
            return total
        a = self.essential.coefficients(u)
        return total + self.penalty.energy(self.weights.nodes_of, a)

    def bound(self) -> float:
        """Bound on the row sums of |K| of the elastic body (N/m). Host only."""
        w = self.weights
        near = np.abs(w.B).sum(axis=(0, 1)) * np.asarray(w.w)
        far = np.abs(w.B if w.T is None else w.T).sum(axis=0)
        row = np.einsum("kgc,gc->kc", far, near)
        total = np.bincount(np.ravel(w.nodes_of), np.ravel(row))
        return float(stiffest(self.law) * total.max())

    def tangent(self, u: PointVector, history: Any = None) -> WeakTangent:
        """K = T^T C B w, C the law's tangent at each place."""
        history = self.history if history is None else history

        def block(law, e, h):
            return tangent_block(law, e, h, self.how)

        axes = (each(self.law, self.weights.q), 0, 0)
        C = jax.vmap(block, in_axes=axes)(self.law, self.strain(u), history)
        parts = self.weights, self.essential, C, self.penalty
        return WeakTangent(*parts, self.symmetric)


def evenhanded(law: Any) -> bool:
    """Whether a law's block dstress/dstrain is symmetric: Hooke's and von Mises' are.

    Others say so by an attribute `symmetric`; without it the tangent counts as
    unsymmetric, which is right for any law.
    """
    return isinstance(law, Hooke | VonMises) or bool(getattr(law, "symmetric", False))


def spread(weights: Sampling, stress: jax.Array) -> PointVector:
    """Sums [n, d] over places of test gradients times stresses [g c, s]."""
    test = weights.B if weights.T is None else weights.T
    d, _, g, c = test.shape
    tensor = jnp.einsum("sab,gcs->gcab", voigt(d), stress.reshape(g, c, -1))
    force = jnp.einsum("bkgc,gcab->kca", test, tensor)
    n = weights.value.shape[1]
    return jnp.zeros((n, d), force.dtype).at[weights.nodes_of].add(force)
