"""Bonds that soften on a straight line, at the energy of a brittle bond.

    s_p = s_crit / sqrt(ratio)     stretch at which the force begins to fall
    s_f = s_crit sqrt(ratio)       stretch at which nothing is left of it
    h   largest stretch so far, the memory

Loading follows the two lines, unloading goes straight back to the origin. The area
below them is k s_p s_f / 2 = k s_crit^2 / 2, whatever the ratio, and what is spent of
it grows in proportion to h - s_p: share = (s_f / h - 1) / (ratio - 1), so that
-d share / dh w(h) is constant for w(s) = w(s_crit) s^2 / s_crit^2.

Per unit of stiffness, with s the stretch of a bond and h that of its memory before:

    tension(s, h)    share(max(h, s)) s
    slope(s, h)      its derivative in s: share(h) on the way back, else 1, then
                     -1 / (ratio - 1), then 0

Functions of the stretch alone are NumPy's on NumPy arrays, else JAX's.

Source: the cohesive law of two lines, e.g. P. P. Camanho, C. G. Davila, NASA/TM-2002-
211737, on a bond; the closed forms above are elementary.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointScalar, Scalar, Vector, namespace
from jaxpd.checks import number
from jaxpd.physics.bond import bond_energy, stretch


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Bilinear:
    """Bonds that soften on a straight line; see the module.

    Attributes:
        law: elastic bond law inside; None where the functions of the stretch alone
            are asked for.
        s_crit: critical stretch of the brittle bond of the same energy [], [n] or
            [k, n] (-); inf never softens.
        ratio: s_f / s_p [] (-), above 1; see `checked_ratio`.
    """

    law: Any
    s_crit: Scalar | PointScalar
    ratio: Scalar

    start = -1.0

    @property
    def peak(self) -> Any:
        """Stretch s_p (-) of the largest force."""
        return self.s_crit / self.ratio**0.5

    @property
    def end(self) -> Any:
        """Stretch s_f (-) from which on there is no force."""
        return self.s_crit * self.ratio**0.5

    def advance(self, xi: Vector, eta: Vector, h: Scalar) -> Scalar:
        """The largest stretch so far."""
        return jnp.maximum(h, stretch(xi, eta))

    def share(self, h: Any) -> Any:
        """Share of the elastic force that is left (-), 1 to 0."""
        xp, root = namespace(h, self.s_crit, self.ratio), self.ratio**0.5
        over = xp.maximum(h / self.s_crit, 1.0 / root)
        return xp.clip((root / over - 1.0) / (self.ratio - 1.0), 0.0, 1.0)

    def used(self, h: Any) -> Any:
        """Share of the energy of the bond that is gone for good (-), 0 to 1."""
        xp, root = namespace(h, self.s_crit, self.ratio), self.ratio**0.5
        return xp.clip((h / self.s_crit * root - 1.0) / (self.ratio - 1.0), 0.0, 1.0)

    def spent(self, xi: Vector, h: Scalar) -> Scalar:
        """Micropotential that is gone for good; of a linear law inside.

        NaN of a law without an energy.
        """
        if not hasattr(self.law, "energy"):
            return jnp.full((), jnp.nan)
        safe: Any = jnp.where(jnp.isfinite(self.s_crit), self.s_crit, 0.0)
        return self.used(h) * bond_energy(self.law, xi, safe * xi)

    def tension(self, s: Any, h: Any) -> Any:
        """Tension over stiffness (-) at the stretch s, memory h before."""
        return self.share(namespace(s, h).maximum(s, h)) * s

    def slope(self, s: Any, h: Any) -> Any:
        """Derivative of `tension` in s (-); where s = h, that of going on."""
        xp = namespace(s, h, self.s_crit, self.ratio)
        back = (s < h) | (s < self.peak)
        on = xp.where(s < self.end, -1.0 / (self.ratio - 1.0), 0.0)
        return xp.where(back, self.share(h), on)


def checked_ratio(ratio: float) -> float:
    """The ratio s_f / s_p of a straight fall, checked.

    Raises:
        ValueError: unless it is a number above 1.
    """
    means = "the stretch without force over that of the largest"
    usual = "10 is smooth on a weak plane, None is brittle"
    return float(number("softening", ratio, above=1, cure=f"{means}; {usual}"))
