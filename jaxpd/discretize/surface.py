"""Surface corrections: bonds near a boundary made stiffer, since there are fewer.

The volume method of Q. V. Le and F. Bobaru (2018), paper 002, eq. 7: a bond is scaled
by 2 V0 / (V_i + V_j), V the volume of a neighbourhood and V0 that of a whole one. Two
conventions for V0 are in use and both are needed, by name:

    "lattice"   the lattice sum of the bulk, so that the interior is left as it is;
                the tables of paper 000 need it
    "analytic"  2 delta, pi delta^2, 4 pi delta^3 / 3, which also scales the interior
                (by 8.9 % at m = 4); the figures of paper 002 need it

The other methods: "energy" and "force density" in `jaxpd.discretize.directional`,
"fictitious" in `jaxpd.discretize.extension`. Measured by `benchmarks/surfaces.py` on a
strip in tension (plane stress, m = 3 and 4): how far the modulus of a row within a
horizon of the face is from the middle's, at most,

    none 21-30 %, volume 18-24 %, energy 6-7 %, force density 4-6 %, fictitious 0.6 %.
"""

from __future__ import annotations

from typing import Any

from jaxpd._types import BondScalar, PointScalar, PointVector, Scalar
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.geometry.family import (
    Family,
    ball_volume,
    bulk_volume,
    neighbourhood_volumes,
)
from jaxpd.geometry.grid_family import GridFamily, offset_shares, offset_sums

VOLUMES = ("none", "lattice", "analytic")
CORRECTIONS = (*VOLUMES, *DIRECTIONAL, "fictitious")


def volumes_over(
    X: PointVector,
    vol: PointScalar,
    family: Family,
    beta: BondScalar,
    delta: Scalar,
    V0: str,
) -> PointScalar:
    """Neighbourhood volumes over V0, v = V / V0 [n] (-).

    Args:
        X: reference positions (m), for the number of dimensions alone.
        vol: volumes (m^d).
        family: the bonds; those that a crack cuts are missing from V.
        beta: shares of `partial_volumes`.
        delta: horizon (m).
        V0: "lattice" or "analytic".

    Raises:
        ValueError: on another V0, or "lattice" for a cloud that is none.
    """
    d = X.shape[1]
    if V0 == "lattice":
        whole = bulk_volume(family, vol, delta, d)
    elif V0 == "analytic":
        whole = ball_volume(delta, d)
    else:
        raise ValueError(f"V0: {V0!r} must be 'lattice' or 'analytic'")
    return neighbourhood_volumes(vol, family, beta) / whole


def relative_volumes(family: GridFamily, delta: Scalar, dx: Scalar, V0: str) -> Any:
    """Neighbourhood volumes over V0, v = V / V0 [n] (-), of the points of a lattice.

    The factor of a bond is 2 / (v_i + v_j). In NumPy where delta and dx are NumPy's.

    Args:
        family: the bonds; those that are missing are missing from V.
        delta: horizon (m).
        dx: spacing (m).
        V0: "lattice" or "analytic".

    Raises:
        ValueError: on another V0.
    """
    beta = offset_shares(family, delta, dx)
    V = 1.0 + offset_sums(family, beta)
    return V.ravel() / (1.0 + 2.0 * beta.sum()) / over_bulk(family, delta, dx, V0)


def over_bulk(family: GridFamily, delta: Scalar, dx: Scalar, V0: str) -> Any:
    """V0 over the volume of a whole neighbourhood of a lattice [] (-).

    Raises:
        ValueError: on another V0.
    """
    if V0 == "lattice":
        return 1.0
    if V0 != "analytic":
        raise ValueError(f"V0: {V0!r} must be 'lattice' or 'analytic'")
    bulk = 1.0 + 2.0 * offset_shares(family, delta, dx).sum()
    return ball_volume(delta / dx, len(family.shape)) / bulk
