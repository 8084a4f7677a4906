"""Sums of operators of motion: every ply in its own layout, one after another.

The protocol is `jaxpd.operators.protocol.MotionForce`; see `jaxpd.operators.sum`.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointTensor
from jaxpd.operators.ghosts import GhostForce


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SumMotion:
    """Plies, each moved by its own operator, and the joints between them.

    Attributes:
        plies: operators of motion.
        joints: ghost interlayers.
        sizes: numbers of points of the plies.
        places: where the points of each joint are kept, found once by `placed`.
    """

    plies: tuple[Any, ...]
    joints: tuple[GhostForce, ...]
    sizes: tuple[int, ...] = field(metadata={"static": True})
    places: tuple[jax.Array, ...] = ()

    def placed(self) -> SumMotion:
        """The same, ready to be used."""
        place = self.pick(jnp.arange(self._lengths[-1], dtype=jnp.int32))
        return replace(self, places=tuple(place[op.joint.points] for op in self.joints))

    def plain(self) -> SumMotion:
        """The same without hand-derived rules, for forward mode."""
        return replace(self, plies=tuple(op.plain() for op in self.plies))

    @property
    def _ends(self) -> list[int]:
        """Where the plies end in the points."""
        return [*itertools.accumulate(self.sizes)][:-1]

    @property
    def _lengths(self) -> list[int]:
        """Where the plies end in the layout, the last one too."""
        lengths = [
            jax.eval_shape(op.lay, jax.ShapeDtypeStruct((n,), float)).shape[0]
            for op, n in zip(self.plies, self.sizes, strict=True)
        ]
        return [*itertools.accumulate(lengths)]

    @property
    def _cuts(self) -> list[int]:
        return self._lengths[:-1]

    def lay(self, values: Any) -> jax.Array:
        """Nodal values [n] or [n, d] as they are kept: [L] or [d, L]."""
        parts = jnp.split(jnp.asarray(values), self._ends)
        rows = [op.lay(part) for op, part in zip(self.plies, parts, strict=True)]
        return jnp.concatenate(rows, axis=-1)

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of what is kept."""
        parts = jnp.split(row, self._cuts, axis=-1)
        found = [op.pick(part) for op, part in zip(self.plies, parts, strict=True)]
        return jnp.concatenate(found)

    def _joined(self, history: Any) -> Any:
        """Each joint with its places and its memory."""
        rest = history[len(self.plies) :]
        return zip(self.joints, self.places, rest, strict=True)

    def commit(self, u: jax.Array, history: Any) -> tuple[jax.Array, Any]:
        """The memories after u [d, L], and the forces [d, L] (N) that they leave."""
        parts = jnp.split(u, self._cuts, axis=-1)
        plies = zip(self.plies, parts, history, strict=False)
        done = [op.commit(part, h) for op, part, h in plies]
        force = jnp.concatenate([f for f, _ in done], axis=-1)
        after = [h for _, h in done]
        for op, place, h in self._joined(history):
            pull, h = op.commit(u[:, place].T, h)
            force = force.at[:, place].add(pull.T)
            after.append(h)
        return force, tuple(after)

    def energy(self, u: jax.Array, history: Any) -> jax.Array:
        """Stored energy (J), point by point [L]; that of joints at their faces."""
        parts = jnp.split(u, self._cuts, axis=-1)
        plies = zip(self.plies, parts, history, strict=False)
        total = jnp.concatenate([op.energy(part, h) for op, part, h in plies])
        for op, place, h in self._joined(history):
            total = total.at[place].add(op.energy_per_point(u[:, place].T, h))
        return total

    def released(self, history: Any, history0: Any) -> jax.Array:
        """Energy [] (J) that breaking has cost since `history0`; NaN if unknown."""
        parts = zip((*self.plies, *self.joints), history, history0, strict=True)
        return jnp.stack([op.released(h, h0) for op, h, h0 in parts]).sum()

    def intact(self, history: Any) -> jax.Array:
        """Volume of the bonds of each point that are left [L], ghosts included."""
        plies = zip(self.plies, history, strict=False)
        total = jnp.concatenate([op.intact(h) for op, h in plies])
        for op, place, h in self._joined(history):
            total = total.at[place].add(op.intact(h).astype(total.dtype))
        return total

    def diagonal(self, history: Any) -> PointTensor:
        """Blocks [n, d, d] (N/m) that bound the stiffness as its diagonal would."""
        plies = zip(self.plies, history, strict=False)
        total = jnp.concatenate([op.diagonal(h) for op, h in plies])
        for op, h in zip(self.joints, history[len(self.plies) :], strict=True):
            total = total.at[op.joint.points].add(op.diagonal(h))
        return total
