"""The one table of bond laws that every invariant is tested on.

A new law enters by one line in `LAWS`: a name and a function of the number of space
dimensions that makes it. It then inherits zero force at rest, both momenta, symmetry,
rotation, the energy's gradient, and a hand-derived tangent (if it has one) against AD.
"""

from dataclasses import dataclass

import jax
import jax.numpy as jnp

from jaxpd.geometry import find, from_points
from jaxpd.operators import BondForce, bond_weights
from jaxpd.physics import (
    Conical,
    Constant,
    Fractional,
    Gaussian,
    Microelastic,
    micromodulus,
    pmb,
    stretch,
)

DELTA = 0.42
STATES = {1: "bar", 2: "plane stress", 3: "solid"}
NU = {1: None, 2: 1 / 3, 3: 1 / 4}


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class LogStrain:
    """A user's law by its energy alone: quadratic in the logarithmic stretch."""

    c: jax.Array

    def energy(self, xi, eta):
        return 0.5 * self.c * jnp.log1p(stretch(xi, eta)) ** 2 * jnp.sqrt(xi @ xi)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Hardening:
    """A user's law by its force alone: the stretch and its cube."""

    c: jax.Array

    def force(self, xi, eta):
        y, s = xi + eta, stretch(xi, eta)
        return self.c * (s + 10.0 * s**3) * y / jnp.sqrt(y @ y)


def microelastic(omega, d):
    c = micromodulus(2.0, NU[d], STATES[d], d, DELTA, omega)
    return Microelastic(c, omega)


LAWS = {
    "fractional -3": lambda d: microelastic(Fractional(jnp.asarray(-3.0), d), d),
    "fractional 0": lambda d: microelastic(Fractional(jnp.asarray(0.0), d), d),
    "fractional 1.9": lambda d: microelastic(Fractional(jnp.asarray(1.9), d), d),
    "constant": lambda d: microelastic(Constant(), d),
    "conical": lambda d: microelastic(Conical(jnp.asarray(DELTA)), d),
    "gaussian": lambda d: microelastic(Gaussian(jnp.asarray(DELTA / 3)), d),
    "pmb": lambda d: pmb(2.0, NU[d], STATES[d], d, DELTA),
    "user's energy": lambda d: LogStrain(jnp.asarray(3.0)),
    "user's force": lambda d: Hardening(jnp.asarray(3.0)),
}


def random_cloud(rng, d, n=60):
    """Points in the unit cube, a rough spacing apart, of unequal volumes."""
    side = {1: n, 2: 8, 3: 4}[d]
    grid = jnp.stack(
        [g.ravel() for g in jnp.meshgrid(*[jnp.arange(side)] * d, indexing="ij")], 1
    )
    X = (grid + 0.5 + rng.uniform(-0.3, 0.3, grid.shape)) / side
    return from_points(X, rng.uniform(0.5, 1.5, len(X)) / len(X))


def operator(rng, law, d, correction="analytic", partial="linear", blocks="ad"):
    """A bond operator on a random cloud."""
    cloud = random_cloud(rng, d)
    family = find(cloud, DELTA, partial=partial)
    weight = bond_weights(cloud.X, cloud.vol, family, jnp.asarray(DELTA), correction)
    return BondForce(cloud.X, family.nbr, weight, law, jnp.asarray(DELTA), blocks)
