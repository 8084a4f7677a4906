"""Surface corrections by axis: the energy method and the force density method.

Each point has a factor g_a for every axis a: what it should feel under a uniaxial
strain along a, all other strains zero, over what its own bonds give. A bond along the
unit vector n takes the mean gbar_a of its two ends and interpolates by the ellipsoid

    factor = 1 / sqrt(sum_a (n_a / gbar_a)^2),

so that it is symmetric in the ends, positive, and gbar_a for a bond along an axis.

    "energy"         g_a = (C_aaaa / 2) / W_a with W_a the energy density of the
                     point's bonds per squared strain. W_a is a sum over the lattice,
                     so that its quadrature error is corrected in the bulk as well.
    "force density"  g_a = 2 p_a / (p_a+ + p_a-): p_a is the pull along a, per strain,
                     of half a whole neighbourhood (an integral, so that the bulk's
                     quadrature is corrected here too), p_a+ and p_a- those of the
                     point's bonds ahead and behind. Only their sum is corrected: at a
                     flat face one of them is zero for the axis across.

Bonds that a crack cuts are missing from the sums, as they are from the volumes of
`jaxpd.discretize.surface`: a crack is a surface. Nothing depends on Young's modulus,
and a modulus that varies from point to point is left out of the factors.

Sources: E. Madenci, E. Oterkus, Peridynamic Theory and Its Applications (2014), ch. 4
(energy); B. Kilic, thesis, University of Arizona (2008) (force density); both reviewed
by Q. V. Le, F. Bobaru (2018), paper 002. Kilic corrects the pull of one half; the sum
over both is how it is made to mean something at the face itself.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import BondScalar, PointScalar, PointVector, Scalar, namespace
from jaxpd.geometry.family import Family, bond_vectors, gather, over_slots
from jaxpd.geometry.family import partial_volumes as shares
from jaxpd.geometry.grid_family import GridFamily, offset_shares, offset_sums
from jaxpd.physics.bond import Microelastic
from jaxpd.physics.elastic import confined_modulus
from jaxpd.physics.influence import moment

DIRECTIONAL = ("energy", "force density")
#: Integral of |n_a|^3 over the directions n in d dimensions.
CUBES = {1: 2.0, 2: 8.0 / 3.0, 3: math.pi}


def whole(
    method: str, law: Microelastic, nu: float | None, state: str, d: int, delta: Scalar
) -> Scalar:
    """What a whole neighbourhood of a law with E = 1 has [] (-): energy, or pull."""
    if method == "energy":
        return 0.5 * confined_modulus(1.0, nu, state)
    if method == "force density":
        return law.c * moment(law.omega, d - 1, delta) * CUBES[d]
    raise ValueError(f"correction: {method!r} must be one of {DIRECTIONAL}")


def _measure(method: str, law: Microelastic, xi: Any) -> Any:
    """Energy or pull of bonds [..., d] per squared volume and along each axis."""
    block = law.rest(xi)
    own = [block[..., a, a] for a in range(xi.shape[-1])]
    along = namespace(xi, *own).stack(own, axis=-1)
    # half the energy of a bond is the other end's
    return 0.25 * xi**2 * along if method == "energy" else abs(xi) * along


def ellipsoid(n: Any, mean: Any) -> Any:
    """Factor of bonds along n [..., d] from the means of their ends [..., d]."""
    return 1.0 / namespace(n, mean).sqrt(((n / mean) ** 2).sum(axis=-1))


def grid_factors(
    family: GridFamily, delta: Scalar, dx: Scalar, law: Microelastic, goal: Scalar,
    method: str,
) -> BondScalar:  # fmt: skip
    """Factor of every bond [k, n] (-) of a lattice, at its first end.

    Args:
        family: the bonds; those that are missing are missing from the sums.
        delta: horizon (m).
        dx: spacing (m).
        law: the bond law with E = 1, shared by all bonds.
        goal: from `whole`.
        method: one of `DIRECTIONAL`.
    """
    d, steps = len(family.shape), family.steps
    weight = offset_shares(family, delta, dx) * dx**d
    sums = offset_sums(family, weight[:, None] * _measure(method, law, steps * dx))
    sums = sums.reshape(family.n, d)
    xp = namespace(sums)
    g = goal / xp.where(sums > 0, sums, goal)  # an axis without bonds has no use for g
    hop = (steps @ family.strides)[:, None]
    # where the second end would lie off the lattice there is no bond: any number does
    far = (xp.arange(family.n)[None, :] + hop).clip(0, family.n - 1)
    n2 = (steps**2 / (steps**2).sum(axis=1, keepdims=True))[:, None, :]
    total: Any = 0.0
    for a in range(d):
        total = total + n2[..., a] / (0.5 * (g[None, :, a] + g[far, a])) ** 2
    return 1.0 / xp.sqrt(total)


def _family_sums(
    X: PointVector,
    vol: PointScalar,
    family: Family,
    delta: Scalar,
    law: Microelastic,
    method: str,
) -> PointVector:
    """Energy or pull of the bonds of every point along each axis [n, d]."""
    beta = shares(X, vol, family, delta)

    @partial(jax.checkpoint, prevent_cse=False)  # backwards, computed again
    def of(slot):
        nbr, share = slot
        part = _measure(method, law, bond_vectors(X, nbr, delta))
        return (share * gather(vol, nbr))[:, None] * part

    def add(total, slot):
        return total + of(slot), None

    return jax.lax.scan(add, jnp.zeros_like(X), (family.nbr, beta))[0]


def family_factors(
    X: PointVector,
    vol: PointScalar,
    family: Family,
    delta: Scalar,
    law: Microelastic,
    goal: Scalar,
    method: str,
) -> BondScalar:
    """Factor of every bond [k, n] (-) of index lists; see `grid_factors`."""
    sums = _family_sums(X, vol, family, delta, law, method)
    g = goal / jnp.where(sums > 0, sums, goal)

    def factor(xi, nbr):
        n = xi / jnp.sqrt((xi * xi).sum(axis=1, keepdims=True))
        return ellipsoid(n, 0.5 * (g + gather(g, nbr)))

    return over_slots(factor, X, family, delta)


def bulk_factor(
    X: PointVector,
    vol: PointScalar,
    family: Family,
    delta: Scalar,
    law: Microelastic,
    goal: Scalar,
) -> Scalar:
    """Factor [] (-) of the energy method for the points of most energy: the bulk."""
    return goal / _family_sums(X, vol, family, delta, law, "energy")[:, 0].max()


def bond_factors(
    family: Family | GridFamily, params: dict[str, Any], law: Microelastic,
    nu: float | None, state: str, method: str,
) -> BondScalar:  # fmt: skip
    """Factor of every bond [k, n] (-), or [] of all, from a problem's parameters.

    Args:
        family: the bonds, of a lattice or by index lists.
        params: `delta` with `dx`, or with `X` and `vol`.
        law: the bond law with E = 1.
        nu: Poisson's ratio (-), None for a bar.
        state: one of `jaxpd.physics.elastic.DIMENSIONS`.
        method: one of `DIRECTIONAL`, or "fictitious": whole neighbourhoods, which all
            get the factor of the energy method in the bulk.
    """
    delta = params["delta"]
    if isinstance(family, GridFamily):
        goal = whole(method, law, nu, state, len(family.shape), delta)
        return grid_factors(family, delta, params["dx"], law, goal, method)
    X = params["X"]
    if method == "fictitious":
        goal = whole("energy", law, nu, state, X.shape[1], delta)
        return bulk_factor(X, params["vol"], family, delta, law, goal)
    goal = whole(method, law, nu, state, X.shape[1], delta)
    return family_factors(X, params["vol"], family, delta, law, goal, method)
