"""Breaking microelastic bonds of any points, made for explicit runs.

Families are swept slot by slot, as in `jaxpd.operators.bonds`, from arrays that a run
makes once: bond vectors, stiffnesses, one flag for each direction of a bond. Points are
kept along a space-filling curve, so that neighbours lie close in memory, and two
components are gathered at once as one complex number.

Both directions of a bond see the same numbers, so they break in the same step.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxpd._types import BondIndex, BondScalar, PointScalar, PointTensor, Scalar
from jaxpd.geometry.family import gather
from jaxpd.operators.lattice import full_blocks, index_pairs


def curve(X: NDArray[np.floating]) -> NDArray[np.int32]:
    """Order [n] of points [n, d] along Morton's curve. Host only."""
    span = np.ptp(X, axis=0).max() or 1.0
    cell = ((X - X.min(axis=0)) / span * (2**20 - 1)).astype(np.uint64)
    code = np.zeros(len(X), np.uint64)
    for bit in range(20):
        for axis in range(X.shape[1]):
            digit = (cell[:, axis] >> np.uint64(bit)) & np.uint64(1)
            code |= digit << np.uint64(bit * X.shape[1] + axis)
    return np.argsort(code, kind="stable").astype(np.int32)


def _far(columns: list[jax.Array], nbr: jax.Array) -> list[jax.Array]:
    """Columns at the neighbours, two at a time."""
    return _parted([gather(pair, nbr) for pair in _paired(columns)])


def _paired(columns: list[jax.Array]) -> list[jax.Array]:
    """Columns, two at a time as one complex number."""
    pairs = [columns[a : a + 2] for a in range(0, len(columns), 2)]
    return [jax.lax.complex(*p) if len(p) == 2 else p[0] for p in pairs]


def _parted(pairs: Sequence[jax.Array]) -> list[jax.Array]:
    """The columns of pairs."""
    found = []
    for pair in pairs:
        found += [pair.real, pair.imag] if jnp.iscomplexobj(pair) else [pair]
    return found


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class SlotForce:
    """Breaking microelastic bonds of any points; see `jaxpd.operators.protocol`.

    All arrays of points are in the order of the curve; `lay` and `pick` go there and
    back.

    Attributes:
        nbr: neighbour indices [k, n], the point itself where padded.
        xi: bond vectors [k, d, n] (m).
        r: their lengths [k, n] (m).
        stiff: weight times c omega(r) of every bond [k, n] (N/m).
        s_crit: critical stretch [] or [n] (-), a bond takes the mean of its ends.
        share: volume of a neighbour within the horizon [k, n] (m^d), for damage.
        order: number of the point at every place [n].
        place: place of every point [n].
        breaks: whether bonds can break; else flags stay as they are.
        reverse: whether reverse mode uses the hand-derived rule.
    """

    nbr: BondIndex
    xi: jax.Array
    r: BondScalar
    stiff: BondScalar
    s_crit: Scalar | PointScalar
    share: BondScalar
    order: jax.Array
    place: jax.Array
    breaks: bool = field(metadata={"static": True}, default=True)
    reverse: bool = field(metadata={"static": True}, default=True)

    def plain(self) -> Any:
        """The same without the hand-derived rule, for forward mode."""
        return dataclasses.replace(self, reverse=False)

    def lay(self, values: Any) -> jax.Array:
        """Nodal values [n] or [n, d] as this operator keeps them: [n] or [d, n]."""
        return jnp.asarray(values)[self.order].T

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] of what this operator keeps."""
        return row.T[self.place]

    def commit(self, u: jax.Array, flags: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Nodal forces [d, n] (N) at u [d, n] and the flags after it."""
        if self.reverse:
            bare = dataclasses.replace(self, stiff=None)
            return _ruled(bare, (u, self.stiff), flags)
        return self._commit(u, flags)

    def _limit(self, nbr: jax.Array, dtype: Any) -> jax.Array:
        s = jnp.asarray(self.s_crit, dtype)
        return s if s.ndim == 0 else 0.5 * (s + gather(s, nbr))

    def _commit(self, u: jax.Array, flags: jax.Array) -> tuple[jax.Array, jax.Array]:
        columns = list(u)

        def add(force, slot):
            nbr, xi, r, k, flag = slot
            eta = [b - a for a, b in zip(columns, _far(columns, nbr), strict=True)]
            p = sum(e * (e + 2.0 * x) for e, x in zip(eta, xi, strict=True))
            if self.breaks:
                s = self._limit(nbr, r.dtype)
                flag = flag & (p <= r * r * s * (2.0 + s))
            p = jnp.where(flag, p, 0.0)  # no root of a loose pair
            l2 = r * r + p
            F = k * p / (l2 + r * jnp.sqrt(l2))
            pull = _paired([F * (x + e) for x, e in zip(xi, eta, strict=True)])
            return tuple(f + x for f, x in zip(force, pull, strict=True)), flag

        # XLA makes every output of a sweep from the start: two components are one
        zero = tuple(_paired([jnp.zeros_like(x) for x in columns]))
        slots = (self.nbr, self.xi, self.r, self.stiff, flags)
        force, after = jax.lax.scan(add, zero, slots)
        return jnp.stack(_parted(force)), after if self.breaks else flags

    def pull_back(
        self, u: jax.Array, flags: jax.Array, ct: jax.Array
    ) -> tuple[jax.Array, jax.Array]:
        """Derivatives of sum(ct * force) in u and stiff, at frozen flags, by hand.

        As `halves_rule.pull_back`; each point gathers, nothing is scattered.
        """
        columns, d = [*u, *ct], len(u)

        def add(ubar, slot):
            nbr, xi, r, k, flag = slot
            far = _far(columns, nbr)
            y = [x + b - a for x, a, b in zip(xi, columns, far[:d], strict=False)]
            D = [a - b for a, b in zip(columns[d:], far[d:], strict=True)]
            eta = [b - a for a, b in zip(columns, far[:d], strict=False)]
            p = sum(e * (e + 2.0 * x) for e, x in zip(eta, xi, strict=True))
            p = jnp.where(flag, p, 0.0)  # no root of a loose pair
            l2 = r * r + p
            length = jnp.sqrt(l2)
            power = sum(a * b for a, b in zip(D, y, strict=True))
            live = jnp.where(flag, 1.0, 0.0).astype(k.dtype)
            F = live * p / (l2 + r * length)
            B = k * live * power * (r / (l2 * length))
            ubar = tuple(
                s - (k * F * a + B * b) for s, a, b in zip(ubar, D, y, strict=True)
            )
            return ubar, 0.5 * F * power

        zero = tuple(jnp.zeros_like(x) for x in u)
        slots = (self.nbr, self.xi, self.r, self.stiff, flags)
        ubar, stiffbar = jax.lax.scan(add, zero, slots)
        return jnp.stack(ubar), stiffbar

    def _sweep(self, flags: jax.Array, measure: Any, size: int) -> jax.Array:
        """Sums over the bonds of every point of measure(bond): [size, n]."""

        def add(sums, slot):
            *bond, flag = slot
            return sums + jnp.where(flag, measure(*bond), 0.0), None

        zero = jnp.zeros((size, self.nbr.shape[1]), self.stiff.dtype)
        slots = (self.nbr, self.xi, self.r, self.stiff, self.share, flags)
        return jax.lax.scan(add, zero, slots)[0]

    def energy(self, u: jax.Array, flags: jax.Array) -> jax.Array:
        """Stored energy of each point [n] (J): half of that of its bonds."""
        columns = list(u)

        def measure(nbr, xi, r, k, share):
            eta = [b - a for a, b in zip(columns, _far(columns, nbr), strict=True)]
            p = sum(e * (e + 2.0 * x) for e, x in zip(eta, xi, strict=True))
            e = p / (jnp.sqrt(r * r + p) + r)
            return (0.25 * k * e * e)[None]

        return self._sweep(flags, measure, 1)[0]

    def intact(self, flags: jax.Array) -> jax.Array:
        """Volume of the intact bonds of each point [n] (m^d)."""
        return self._sweep(flags, lambda nbr, xi, r, k, share: share[None], 1)[0]

    def released(self, flags: jax.Array, flags0: jax.Array) -> jax.Array:
        """Energy [] (J) of the bonds that have broken, each k (r s_crit)^2 / 2."""

        def measure(nbr, xi, r, k, share):
            return (0.25 * k * (r * self._limit(nbr, r.dtype)) ** 2)[None]

        return jnp.sum(self._sweep(flags0 & ~flags, measure, 1))

    def diagonal(self, flags: jax.Array) -> PointTensor:
        """Block diagonal [n, d, d] (N/m) of the stiffness at rest, of |k|."""
        d = self.xi.shape[1]
        pairs = index_pairs(d)

        def measure(nbr, xi, r, k, share):
            k = jnp.abs(k) / (r * r)  # an upper bound where bonds push
            return jnp.stack([k * xi[a] * xi[b] for a, b in pairs])

        return full_blocks(self.pick(self._sweep(flags, measure, len(pairs))), d)


@jax.custom_vjp
def _ruled(bare: SlotForce, traced: Any, flags: jax.Array) -> Any:
    u, stiff = traced
    return dataclasses.replace(bare, stiff=stiff)._commit(u, flags)


def _forward(bare: SlotForce, traced: Any, flags: jax.Array) -> Any:
    force, after = _ruled(bare, traced, flags)
    return (force, after), (bare, traced, after)


def _backward(kept: Any, cotangents: Any) -> Any:
    bare, (u, stiff), after = kept
    op = dataclasses.replace(bare, stiff=stiff)
    return None, op.pull_back(u, after, cotangents[0]), None


_ruled.defvjp(_forward, _backward)


def slot_force(
    bonds: Any, s_crit: jax.Array, share: jax.Array, order: jax.Array
) -> Any:
    """The same bonds as those of a `BondForce` of a microelastic law, to move.

    Args:
        bonds: the bonds.
        s_crit: critical stretch [] or [n] (-).
        share: volume of a neighbour within the horizon [k, n] (m^d).
        order: number of the point at every place of the curve [n].
    """
    law = bonds.law
    here = jnp.arange(len(order), dtype=order.dtype)
    place = jnp.zeros_like(order).at[order].set(here)
    nbr = place[bonds.nbr[:, order]]
    X = bonds.X[order]
    lead = jnp.zeros(X.shape[1]).at[0].set(1.0) * bonds.delta

    def of(slot):
        nbr, weight = slot
        pad = jnp.where(nbr == here, 1.0, 0.0)
        xi = X[nbr] - X + pad[:, None] * lead[None, :]
        c = law.c if jnp.ndim(law.c) == 0 else law.c[order]
        c = c if jnp.ndim(c) == 0 else 0.5 * (c + c[nbr])
        r = jnp.sqrt(jnp.sum(xi * xi, axis=1))
        return xi.T, r, weight * c * law.omega(r)

    xi, r, stiff = jax.lax.map(of, (nbr, bonds.weight[:, order]))
    s = s_crit if s_crit.ndim == 0 else s_crit[order]
    return SlotForce(nbr, xi, r, stiff, s, share[:, order], order, place)
