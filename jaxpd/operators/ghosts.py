"""Ghost interlayers as an operator on the points that they touch.

Every bond leads from a ghost, the average of some points, to another point:

    eta = u_end - sum_k w_k u_k,    e = |xi + eta| - |xi|,    W = k e^2 / 2,

and a spring of each ghost joins the averages of the two faces, e0 = |y_B - y_A| - |..|.
A ghost breaks for good, with all its bonds and its spring, once these store G0 times
its area, less the share of squeezing in what the traction t would store,

    (C_n <t_n>^2 + C_t t_t^2) / 2 of tension and shear,   C_n <-t_n>^2 / 2 of squeezing,

C energy per area over half a squared traction under an even one. Bonds also store the
plies' strain along the layer, which breaks no glue: tension and shear must be worth
half of G0. The normal turns with the layer. The memory is one number a ghost [q]: what
its breaking has cost (J), zero where a crack was, and below zero while intact. A broken
one still resists its faces' being pushed together, by a spring between the two
that is central: until they have slid by about the gap.

Which bonds, and how stiff: `jaxpd.discretize.interlayer`, `.calibration`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointScalar, PointTensor, PointVector, Scalar, namespace
from jaxpd.discretize.interlayer import Joint
from jaxpd.operators.ghost_tangent import GhostTangent


def start(joint: Joint, cut: bool = True) -> Any:
    """The memory at the start [q], without what cracks cut or not; NumPy's too."""
    return namespace(joint.intact).where(joint.intact | (not cut), -1.0, 0.0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class GhostForce:
    """The force of an interlayer on the points that it touches.

    Attributes:
        joint: geometry.
        s: stiffness of the bonds over their unit [] or [q].
        k0: stiffness of the springs [] or [q] (N/m^3).
        G0: fracture energy [] or [q] (J/m^2), or None: never breaks.
        stored: C_n and C_t [] or [q] (m^3/N), see the module.
        one_way: whether what pulls at ghosts is dropped.
    """

    joint: Joint
    s: Scalar | PointScalar
    k0: Scalar | PointScalar
    G0: Any = None
    stored: tuple[Any, Any] = (0.0, 0.0)
    one_way: bool = field(metadata={"static": True}, default=False)

    unit, linear = "N", False

    @property
    def symmetric(self) -> bool:
        """Whether tangents are symmetric: not where forces are dropped."""
        return not self.one_way

    def exact(self) -> GhostForce:
        """Itself: its blocks are the derivative."""
        return self

    def history0(self) -> jax.Array:
        """Ghosts that no crack cuts are intact."""
        area = jnp.asarray(self.joint.area)
        return jnp.asarray(start(self.joint), area.dtype)

    def _stretched(self, u: PointVector) -> tuple[Any, ...]:
        """Per bond y [k, d, q], |y|, e [k, q]; per spring y [d, q], |y|, e [q]."""
        joint = self.joint
        sources = u[joint.sources]
        ghosts = jnp.einsum("qw,qwd->dq", joint.weights, sources)
        eta = jnp.moveaxis(u[joint.ends], -1, 1) - ghosts[None]
        bonds = _lengthened(joint.xi, eta, axis=1)
        opening = jnp.einsum("qw,qwd->dq", joint.arms, sources)
        return *bonds, *_lengthened(joint.across, opening, axis=0)

    def _stiff(self, history: Any, e0: jax.Array) -> tuple[Any, Any]:
        """Stiffness of bonds [k, q] and springs [q] (N/m), contact included."""
        joint = self.joint
        intact = history < 0.0
        bonds: Any = jnp.where(intact[None], 1.0, 0.0) * self.s * joint.unit
        contact: Any = jnp.where(e0 < 0.0, self.held, 0.0)
        springs: Any = self._springs
        return bonds, jnp.where(intact, springs, contact)

    @property
    def _springs(self) -> jax.Array:
        return jnp.asarray(self.k0) * jnp.asarray(self.joint.area)

    @property
    def held(self) -> Any:
        """Normal stiffness between rigid plies [q] (N/m), that of contact too."""
        return (self.s * self.joint.rigid + self.k0) * self.joint.area

    def energies(self, u: PointVector, history: Any = None) -> Any:
        """Stored energy of each ghost [q] (J)."""
        history = self.history0() if history is None else history
        _, _, e, _, _, e0 = self._stretched(u)
        bonds, springs = self._stiff(history, e0)
        return 0.5 * (jnp.sum(bonds * e * e, axis=0) + springs * e0 * e0)

    def energy(self, u: PointVector, history: Any = None) -> Scalar:
        """Stored energy [] (J)."""
        return jnp.sum(self.energies(u, history))

    def energy_per_point(self, u: PointVector, history: Any = None) -> PointScalar:
        """Energy of the ghosts, handed on to the points that make them [p] (J)."""
        joint = self.joint
        share = joint.weights * self.energies(u, history)[:, None]
        return jnp.zeros(len(u), share.dtype).at[joint.sources].add(share)

    def advance(self, u: PointVector, history: Any = None) -> jax.Array:
        """The memory after u: ghosts with too much energy break."""
        history = self.history0() if history is None else history
        if self.G0 is None:
            return history
        t = self.traction(u, history)
        n = self._normal(u)
        normal = jnp.sum(n * t, axis=0)
        along = jnp.sum(t * t, axis=0) - normal**2
        across, shear = self.stored
        held = 0.5 * across * jnp.maximum(normal, 0.0) ** 2 + 0.5 * shear * along
        pushed = 0.5 * across * jnp.minimum(normal, 0.0) ** 2
        whole = jnp.where(held + pushed > 0.0, held + pushed, 1.0)
        stored: Any = self.energies(u, history)
        area, least = self.joint.area, 0.5 * self.G0
        breaks = (stored * held / whole >= self.G0 * area) & (held >= least)
        e0 = self._stretched(u)[-1]
        contact = jnp.where(e0 < 0.0, 0.5 * self.held * e0 * e0, 0.0)
        lost = jnp.maximum(stored - contact, 0.0)
        after: Any = jnp.where((history < 0.0) & breaks, lost, history)
        return after

    def traction(self, u: PointVector, history: Any = None) -> jax.Array:
        """Traction [d, q] (Pa) that the layer passes on to the lower ply.

        Half of what a ghost's bonds pull at the upper end less at the lower one, and
        its spring, over the area: along the axis positive in tension.
        """
        history = self.history0() if history is None else history
        joint = self.joint
        y, length, e, y0, length0, e0 = self._stretched(u)
        bonds, springs = self._stiff(history, e0)
        side = jnp.sign(jnp.sum(joint.xi * joint.across[None], axis=1))
        pull = jnp.sum((0.5 * side * bonds * e / length)[:, None] * y, axis=0)
        return (pull + (springs * e0 / length0)[None] * y0) / joint.area[None]

    def _normal(self, u: PointVector) -> jax.Array:
        """Unit normal of the deformed layer at every ghost [d, q]."""
        joint = self.joint
        x = u + joint.X
        ghosts = jnp.einsum("qw,qwd->dq", joint.weights, x[joint.sources])
        opening = jnp.einsum("qw,qwd->dq", joint.arms, x[joint.sources])
        sides = [ghosts[:, after] - ghosts[:, before] for before, after in joint.beside]
        if not sides:
            n = jnp.ones_like(opening)
        elif len(sides) == 1:
            n = jnp.stack([-sides[0][1], sides[0][0]])
        else:
            n = jnp.cross(sides[0], sides[1], axis=0)
        size = jnp.sqrt(jnp.sum(n * n, axis=0, keepdims=True))
        rest = jnp.asarray(joint.across)
        # a ghost without neighbours keeps the normal that it had
        n = jnp.where(size > 0.0, n / jnp.where(size > 0.0, size, 1.0), rest)
        n = n / jnp.sqrt(jnp.sum(n * n, axis=0, keepdims=True))
        return n * jnp.sign(jnp.sum(n * opening, axis=0, keepdims=True))

    def respond(self, u: PointVector, history: Any = None) -> PointVector:
        """Internal force [p, d] (N) on the points."""
        history = self.history0() if history is None else history
        y, length, e, y0, length0, e0 = self._stretched(u)
        bonds, springs = self._stiff(history, e0)
        pull = (bonds * e / length)[:, None] * y
        return self._spread(u, pull, (springs * e0 / length0)[None] * y0)

    def _spread(self, u: PointVector, pull: jax.Array, pull0: jax.Array) -> PointVector:
        """Forces on points of pulls at ghosts [k, d, q] and springs [d, q]."""
        joint = self.joint
        force = jnp.zeros_like(u).at[joint.ends].add(-jnp.moveaxis(pull, 1, -1))
        back = -joint.arms[..., None] * pull0.T[:, None]
        if not self.one_way:
            back = back + joint.weights[..., None] * pull.sum(axis=0).T[:, None]
        return force.at[joint.sources].add(back)

    def tangent(self, u: PointVector, history: Any = None) -> GhostTangent:
        """Stiffness at u, from the hand-derived block of one bond."""
        history = self.history0() if history is None else history
        y, length, e, y0, length0, e0 = self._stretched(u)
        bonds, springs = self._stiff(history, e0)
        blocks = jax.vmap(_block, in_axes=(0, 0, 0, 0))(bonds, y, length, e)
        return GhostTangent(
            self.joint, blocks, _block(springs, y0, length0, e0), self.one_way
        )

    def commit(
        self, u: PointVector, history: jax.Array
    ) -> tuple[PointVector, jax.Array]:
        """Forces [p, d] (N) at u and the memory after it."""
        history = self.advance(u, history)
        return self.respond(u, history), history

    def released(self, history: jax.Array, history0: jax.Array) -> Scalar:
        """Energy [] (J) that breaking has cost since `history0`."""
        return jnp.sum(jnp.maximum(history, 0.0) - jnp.maximum(history0, 0.0))

    def intact(self, history: jax.Array) -> PointScalar:
        """Volume of the intact ghosts within the horizon of each point [p] (m^d)."""
        joint = self.joint
        share = jnp.where(history[None] < 0.0, joint.share, 0.0)
        zero = jnp.zeros(len(joint.points), share.dtype)
        return zero.at[joint.ends].add(share)

    def diagonal(self, history: jax.Array) -> PointTensor:
        """Blocks [p, d, d] (N/m) that bound the stiffness at rest, see the tangent.

        As if no ghost were broken: the contact of broken ones is less stiff.
        """
        rest = jnp.zeros(self.joint.X.shape, self.joint.area.dtype)
        whole = jnp.full(self.joint.area.shape, -1.0)
        return self.tangent(rest, whole).bound()


def _lengthened(xi: Any, eta: jax.Array, axis: int) -> tuple[jax.Array, ...]:
    """Vector y = xi + eta, its length, and how much longer it is than xi."""
    r2 = jnp.sum(xi * xi, axis=axis)
    p = jnp.sum(eta * (2.0 * xi + eta), axis=axis)
    length = jnp.sqrt(r2 + p)
    return xi + eta, length, p / (length + jnp.sqrt(r2))


def _block(k: jax.Array, y: jax.Array, length: jax.Array, e: jax.Array) -> jax.Array:
    """Blocks [q, d, d] (N/m) of k e y / |y|: k (n n + (e / |y|) (1 - n n))."""
    n = (y / length[None]).T
    both = n[:, :, None] * n[:, None, :]
    across = jnp.eye(n.shape[1], dtype=n.dtype)[None] - both
    return k[:, None, None] * (both + (e / length)[:, None, None] * across)
