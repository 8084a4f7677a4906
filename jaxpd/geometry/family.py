"""Families: who is bonded to whom, and what of a bond's length and volume follows.

Topology is found on the host, once. Everything that depends on positions or on the
horizon is computed from them inside the trace, one slot of the families at a time, so
that no array of bond vectors is ever stored.

    nbr   neighbour of point i in slot s           [k, n]  int32; i itself where padded
    xi    bond vector X[nbr] - X                   [n, d]  m, of one slot
    beta  share of the neighbour's volume inside the horizon  [k, n]  -

A point is a neighbour if |xi| <= delta (1 + 1e-9), or 8 units in the last place of its
position where that is more (float32): points that round-off moves across a horizon of a
whole number of spacings stay in. Topology is frozen in a derivative; with
partial="continuous" the sums over a family are continuous where a neighbour enters,
with "none" and "linear" they jump there.

Padding is harmless by construction: a padded bond leads from a point to itself, has
weight zero, and delta e_1 is added to its xi before any norm is taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from jaxpd._types import (
    BondIndex,
    BondScalar,
    PointScalar,
    PointVector,
    Scalar,
    namespace,
)
from jaxpd.geometry.cloud import Cloud, Lattice
from jaxpd.geometry.crack import Crack, check_dimension

#: Relative widening of the horizon in the neighbour search, for 64-bit positions.
HORIZON_TOLERANCE = 1e-9
PARTIAL_RULES = ("none", "linear", "continuous")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Family:
    """Neighbours of every point, both directions of each bond.

    Attributes:
        nbr: neighbour indices [k, n], the point itself where padded.
        bulk: lengths of the bonds of a point far from every boundary [kb] in units of
            dx, from the lattice; empty for a cloud without one.
        partial: rule of `partial_volume`.
    """

    nbr: BondIndex
    bulk: jax.Array
    partial: str = field(metadata={"static": True}, default="none")

    @property
    def present(self) -> BondIndex:
        """Mask [k, n]: True for bonds, False for padding."""
        return self.nbr != jnp.arange(self.nbr.shape[1], dtype=self.nbr.dtype)[None]

    @property
    def n_bonds(self) -> int:
        """Number of bonds, each counted once (host)."""
        nbr = np.asarray(self.nbr)
        return int((nbr != np.arange(nbr.shape[1])).sum()) // 2


def find(
    cloud: Cloud,
    delta: float,
    *,
    partial: str = "none",
    cracks: Sequence[Crack] = (),
) -> Family:
    """Find all bonds shorter than the horizon that no crack cuts. Host only.

    Args:
        cloud: the points.
        delta: horizon (m).
        partial: "none" counts a neighbour whole; "linear" by the share of its cell
            inside the horizon, beta = clip((delta - |xi|) / dx + 1/2, 0, 1);
            "continuous" likewise, and takes in the points up to delta + dx / 2, so
            that a neighbour enters with beta = 0.
        cracks: bonds that they cut are left out.

    Raises:
        ValueError: on a horizon that is not positive, an unknown rule, coincident
            points, or points that are left without any bond.
    """
    if not (np.isfinite(delta) and delta > 0):
        raise ValueError(f"delta: {delta} must be a positive number")
    if partial not in PARTIAL_RULES:
        raise ValueError(f"partial: {partial!r} must be one of {PARTIAL_RULES}")
    X = np.asarray(cloud.X)
    if cloud.lattice is not None:
        nbr, bulk = _lattice_neighbours(cloud.lattice, delta, partial)
    else:
        size = np.asarray(cloud.vol) ** (1 / cloud.d)
        rim = 0.25 * size if partial == "continuous" else np.zeros(cloud.n)
        digits = 8 * float(np.finfo(X.dtype).eps) * float(np.abs(X).max()) / delta
        reach = delta * (1 + max(HORIZON_TOLERANCE, digits))
        nbr = _tree_neighbours(X.astype(float), reach, rim)
        bulk = np.zeros(0)
    here = np.arange(cloud.n, dtype=np.int32)
    check_dimension(cracks, cloud.d)
    for crack in cracks:
        for row in nbr:  # slot by slot: the masks stay small
            cut = crack.cuts(X, here, row)
            row[cut] = here[cut]
    bonded = (nbr != here).any(axis=0)
    if not bonded.all():
        bad = np.flatnonzero(~bonded)
        raise ValueError(
            f"delta: {len(bad)} of {cloud.n} points have no bond (the first is point "
            f"{bad[0]} at {X[bad[0]]}) with the horizon {delta:g}; make the horizon "
            "larger than the spacing, or remove the points"
        )
    return Family(jnp.asarray(nbr), jnp.asarray(bulk), partial)


def _lattice_neighbours(
    grid: Lattice, delta: float, partial: str
) -> tuple[NDArray[np.int32], NDArray[np.floating]]:
    """One slot an offset, so that a gather of a slot is a shifted read."""
    m = delta / grid.dx * (1 + HORIZON_TOLERANCE) + 0.5 * (partial == "continuous")
    d, reach = len(grid.shape), math.floor(m)
    span = np.arange(-reach, reach + 1)
    offsets = np.stack([g.ravel() for g in np.meshgrid(*[span] * d, indexing="ij")], 1)
    length = np.sqrt((offsets**2).sum(axis=1))
    keep = (length > 0) & (length <= m)
    offsets, length = offsets[keep], length[keep]
    here = np.arange(math.prod(grid.shape), dtype=np.int32)
    at = np.stack(np.unravel_index(here, grid.shape)).astype(np.int32)
    stride = np.cumprod((1, *grid.shape[:0:-1]))[::-1]
    nbr = np.empty((len(offsets), len(here)), np.int32)
    for row, offset in zip(nbr, offsets, strict=True):
        inside = np.ones(len(here), bool)
        for a, step in enumerate(offset):
            inside &= (at[a] + step >= 0) & (at[a] + step < grid.shape[a])
        row[:] = np.where(inside, here + int(offset @ stride), here)
    return nbr[(nbr != here).any(axis=1)], length


def _tree_neighbours(
    X: NDArray[np.floating], reach: float, rim: NDArray[np.floating]
) -> NDArray[np.int32]:
    """Pairs no further apart than `reach` and the `rim` [n] of both ends."""
    widest = reach + 2.0 * float(rim.max())
    pairs = KDTree(X).query_pairs(widest, output_type="ndarray")
    length = np.linalg.norm(X[pairs[:, 0]] - X[pairs[:, 1]], axis=1)
    near = length <= reach + rim[pairs].sum(axis=1)
    pairs, length = pairs[near], length[near]
    if len(pairs) and length.min() <= 1e-12 * reach:
        i, j = pairs[np.argmin(length)]
        raise ValueError(f"X: points {i} and {j} coincide at {X[i]}; remove one")
    i = np.concatenate([pairs[:, 0], pairs[:, 1]])
    j = np.concatenate([pairs[:, 1], pairs[:, 0]])
    order = np.lexsort((j, i))
    i, j = i[order], j[order]
    count = np.bincount(i, minlength=len(X))
    slot = np.arange(len(i)) - np.repeat(np.cumsum(count) - count, count)
    nbr = np.tile(np.arange(len(X), dtype=np.int32), (int(count.max(initial=0)), 1))
    nbr[slot, i] = j
    return nbr


def gather(values: jax.Array, nbr: jax.Array) -> jax.Array:
    """Nodal values [n, ...] at the neighbours [n] of one slot, without bound checks."""
    return values.at[nbr].get(mode="promise_in_bounds")


def bond_vectors(X: PointVector, nbr: jax.Array, delta: Scalar) -> PointVector:
    """Bond vectors xi [n, d] (m) of one slot; delta e_1 where the slot is padding."""
    padded = nbr == jnp.arange(nbr.shape[0], dtype=nbr.dtype)
    shift = jnp.zeros(X.shape[1:], X.dtype).at[0].set(1.0) * delta
    return gather(X, nbr) - X + jnp.where(padded[:, None], shift[None, :], 0.0)


def over_slots(
    measure: Callable[[PointVector, jax.Array], jax.Array],
    X: PointVector,
    family: Family,
    delta: Scalar,
) -> jax.Array:
    """Evaluate `measure(xi, nbr)` of one slot for every slot: [k, n, ...].

    The way to compute an array over bonds without storing their vectors, backwards too.
    """

    @partial(jax.checkpoint, prevent_cse=False)
    def of(nbr):
        return measure(bond_vectors(X, nbr, delta), nbr)

    return jax.lax.map(of, family.nbr)


def partial_volume(length: jax.Array, delta: Scalar, dx: jax.Array, rule: str):
    """Share beta of a neighbour's cell that lies inside the horizon, 0..1.

    Args:
        length: bond length |xi| (m).
        delta: horizon (m).
        dx: cell size (m); for a symmetric beta the mean of both ends.
        rule: one of `PARTIAL_RULES`.

    Source: the linear rule of Hu, Ha and Bobaru (2010), as used by the tables of paper
    000 (found by comparison; the paper does not state it).
    """
    xp = namespace(length, delta, dx)
    if rule == "none":
        return xp.ones_like(length)
    return xp.clip((delta - length) / dx + 0.5, 0.0, 1.0)


def partial_volumes(
    X: PointVector, vol: PointScalar, family: Family, delta: Scalar
) -> BondScalar:
    """Shares beta [k, n] of all bonds, zero where padded."""
    size = vol ** (1.0 / X.shape[1])
    here = jnp.arange(X.shape[0], dtype=family.nbr.dtype)

    def beta(xi, nbr) -> Any:
        length = jnp.sqrt(jnp.sum(xi * xi, axis=1))
        dx = 0.5 * (size + size[nbr])
        return jnp.where(
            nbr == here, 0.0, partial_volume(length, delta, dx, family.partial)
        )

    return over_slots(beta, X, family, delta)


def neighbourhood_volumes(
    vol: PointScalar, family: Family, beta: BondScalar
) -> PointScalar:
    """Volume V of every neighbourhood [n] (m^d), the point itself included.

    V_i = vol_i + sum over the family of beta_ij vol_j; cut bonds are missing from it.
    """

    @partial(jax.checkpoint, prevent_cse=False)
    def of(slot):
        nbr, share = slot
        return share * vol[nbr]

    def add(total, slot):
        return total + of(slot), None

    return jax.lax.scan(add, vol, (family.nbr, beta))[0]


def bulk_volume(family: Family, vol: PointScalar, delta: Scalar, d: int) -> Scalar:
    """Neighbourhood volume of a point far from every boundary of the lattice (m^d).

    Raises:
        ValueError: if the cloud is not a lattice.
    """
    if family.bulk.shape[0] == 0:
        raise ValueError(
            "V0: 'lattice' needs a cloud made by lattice(); use V0='analytic' for "
            "points from elsewhere"
        )
    dx = vol[0] ** (1.0 / d)
    beta = partial_volume(family.bulk * dx, delta, dx, family.partial)
    return vol[0] * (1.0 + jnp.sum(beta))


def ball_volume(delta: Scalar, d: int) -> Scalar:
    """Volume of a whole neighbourhood: 2 delta, pi delta^2, 4 pi delta^3 / 3."""
    return {1: 2.0, 2: math.pi, 3: 4.0 * math.pi / 3.0}[d] * delta**d
