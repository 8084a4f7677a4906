"""Damage of bonds: critical stretch from the fracture energy, breaking, softening.

A law with damage wraps an elastic one and gives each bond a memory h, a scalar. It has

    start              h of an untouched bond
    advance(xi, eta, h)  h after the bond has been at (xi, eta); never undone
    share(h)           share of the elastic force that is left, 1 to 0
    spent(xi, h)       micropotential that is gone for good; optional

and the leaves rules of `jaxpd.physics.bond`. The force of a bond is share(h) times that
of the law inside. `Brittle` breaks at once (paper 002, eq. 9); `Softening` loses its
force over a range of stretches, so that it may be differentiated in the fracture
energy. `jaxpd.physics.bilinear` has the straight fall of quasi-static paths.

Sources: paper 002, eqs. 9-10; S. A. Silling, E. Askari, Comput. Struct. 83 (2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, Scalar, Vector
from jaxpd.physics.bond import bond_energy, dot, stretch
from jaxpd.physics.influence import Influence, moment

#: B_d: bonds of length r that cross a unit of a plane, B_d r^d dr, all directions.
CROSSING = {1: 1.0, 2: 2.0, 3: math.pi}


def fracture_energy(
    s_crit: Scalar, c: Scalar, omega: Influence, d: int, delta: Scalar
) -> Scalar:
    """Energy G0 (J/m^2) that breaks all bonds across a unit of a plane at `s_crit`.

    A bond of length r holds w = c omega r^2 s^2 / 2. Of those of length r, B_d r^d dr a
    unit of volume and area cross the plane, B = 1, 2, pi for d = 1, 2, 3, hence
    G0 = (B_d / 2) c s^2 int omega r^(d+2) dr. With the PMB material that is
    c s^2 delta^4 / 4 in 2-D and pi c s^2 delta^5 / 10 in 3-D (paper 002, eq. 10).
    """
    return 0.5 * CROSSING[d] * c * s_crit**2 * moment(omega, d + 1, delta)


def critical_stretch(
    G0: Scalar, c: Scalar | PointScalar, omega: Influence, d: int, delta: Scalar
) -> Scalar | PointScalar:
    """Critical stretch s_crit (-) of the fracture energy G0 (J/m^2).

    Whatever the state: plane stress and plane strain differ by the micromodulus c.

    Args:
        G0: fracture energy [] or [n], positive; inf never breaks.
        c: micromodulus [] or [n].
        omega: influence function.
        d: space dimensions.
        delta: horizon (m).
    """
    return (G0 / fracture_energy(1.0, c, omega, d, delta)) ** 0.5


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Brittle:
    """Bonds that break for good once their stretch exceeds `s_crit`.

    Attributes:
        law: elastic bond law inside.
        s_crit: critical stretch [], [n] (a bond takes the mean of its ends) or [k, n]
            (-); inf never breaks.
    """

    law: Any
    s_crit: Scalar | PointScalar

    start = True

    def advance(self, xi: Vector, eta: Vector, h: Scalar) -> Scalar:
        """Whether the bond is intact: once not, never again."""
        # |y|^2 - r^2 against that at s_crit: nothing cancels for small stretches
        limit = self.s_crit * (2.0 + self.s_crit)
        return h & (dot(eta, 2.0 * xi + eta) <= limit * dot(xi, xi))

    def share(self, h: Scalar) -> Scalar:
        """1 intact, 0 broken."""
        return jnp.where(h, 1.0, 0.0)

    def spent(self, xi: Vector, h: Scalar) -> Scalar:
        """Micropotential at s_crit of a bond that has broken; NaN without an energy."""
        if not hasattr(self.law, "energy"):
            return jnp.full((), jnp.nan)
        safe: Any = jnp.where(jnp.isfinite(self.s_crit), self.s_crit, 0.0)
        return jnp.where(h, 0.0, bond_energy(self.law, xi, safe * xi))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Softening:
    """Bonds whose force fades around `s_crit`: a smoothed law for derivatives.

    The memory is the largest stretch so far. Between s_crit (1 -+ width) the share of
    the force falls smoothly from 1 to 0, three times continuously differentiable. A
    linear bond costs 1 + width^2 / 9 times what breaking at s_crit would.

    Attributes:
        law: elastic bond law inside.
        s_crit: critical stretch [], [n] or [k, n] (-).
        width: half of the range over s_crit [] (-), between 0 and 1.
    """

    law: Any
    s_crit: Scalar | PointScalar
    width: Scalar

    start = -1.0

    def advance(self, xi: Vector, eta: Vector, h: Scalar) -> Scalar:
        """The largest stretch so far."""
        return jnp.maximum(h, stretch(xi, eta))

    def share(self, h: Scalar) -> Scalar:
        """1 below the range, 0 above it, a smooth step in between."""
        t = 0.5 * (1.0 + (h / self.s_crit - 1.0) / self.width)
        t = jnp.clip(t, 0.0, 1.0)
        # the polynomial step of degree 7: three continuous derivatives
        return 1.0 - t**4 * (35.0 - 84.0 * t + 70.0 * t * t - 20.0 * t**3)

    def spent(self, xi: Vector, h: Scalar) -> Scalar:
        """Micropotential that the fall of the share from 1 has cost, by quadrature.

        The integral of -d share / ds w(s) up to the largest stretch.
        """
        s_crit: Any = jnp.where(jnp.isfinite(self.s_crit), self.s_crit, 1e30)
        low = s_crit * (1.0 - self.width)
        size = jnp.clip(h - low, 0.0, 2.0 * self.width * s_crit)
        nodes, weights = np.polynomial.legendre.leggauss(8)  # exact for a linear law
        s = low + size * jnp.asarray(0.5 * (nodes + 1.0), xi.dtype)
        fall = -jax.vmap(jax.grad(self.share))(s)
        w = jax.vmap(lambda x: bond_energy(self.law, xi, x * xi))(s)
        return size * jnp.sum(jnp.asarray(0.5 * weights, xi.dtype) * fall * w)
