"""Fracture energies against closed forms, the lattice's own, and memories of bonds."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.geometry.family import partial_volume
from jaxpd.geometry.grid_family import half_offsets
from jaxpd.physics import Constant, Fractional, Microelastic, micromodulus
from jaxpd.physics.damage import Brittle, Softening, critical_stretch, fracture_energy

E, G0, DELTA = 72e9, 3.8, 1e-3


def s_crit(nu, state, d, omega):
    c = micromodulus(E, nu, state, d, DELTA, omega)
    return float(critical_stretch(G0, c, omega, d, DELTA))


def test_critical_stretch_of_the_pmb_material_is_that_of_the_papers():
    near = partial(pytest.approx, rel=1e-12)
    stress = s_crit(1 / 3, "plane stress", 2, Fractional(-1.0, 2))
    strain = s_crit(1 / 4, "plane strain", 2, Fractional(-1.0, 2))
    solid = s_crit(1 / 4, "solid", 3, Fractional(-2.0, 3))
    bulk = E / (3 * (1 - 2 / 4))
    # paper 002, eq. 10; the plane strain one from W = pi c delta^3 e^2 / 16 = 0.6 E e^2
    assert stress == near((4 * np.pi * G0 / (9 * E * DELTA)) ** 0.5)
    assert strain == pytest.approx(
        (5 * np.pi * G0 / (12 * E * DELTA)) ** 0.5, rel=1e-12
    )
    assert solid == near((5 * G0 / (9 * bulk * DELTA)) ** 0.5)


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("alpha", [-2.0, 0.5])
def test_fracture_energy_is_that_of_the_bonds_across_a_plane(d, alpha):
    omega = Fractional(alpha, d)
    # by quadrature: heights above the plane, lengths r, the cap that crosses
    nodes, weights = np.polynomial.legendre.leggauss(60)
    r = 0.5 * DELTA * (nodes + 1)
    t = 0.5 * (nodes + 1)  # z / r
    cap = {1: np.ones_like(t), 2: 2 * np.arccos(t), 3: 2 * np.pi * (1 - t)}[d]
    bond = 0.5 * omega(r) * r**2
    G = 0.5 * DELTA * np.sum(weights * bond * r**d) * 0.5 * np.sum(weights * cap)
    assert float(fracture_energy(1.0, 1.0, omega, d, DELTA)) == pytest.approx(
        G, rel=2e-3
    )


def test_fracture_energy_of_the_lattice_is_that_of_the_findings():
    printed = {
        "none": (1.026, 0.929, 1.070, 0.996),
        "continuous": (1.034, 1.021, 1.024, 1.009),
    }
    for rule, row in printed.items():
        for m, ratio in zip((3, 4, 5, 6), row, strict=True):
            o = np.asarray(half_offsets(2, m, rule), float)
            r = np.hypot(*o.T)
            beta = partial_volume(r, float(m), 1.0, rule)
            # a bond of the half set crosses |o_1| rows of a unit of length
            G = np.sum(beta * 0.5 * r * np.abs(o[:, 1]))
            whole = fracture_energy(1.0, 1.0, Fractional(-1.0, 2), 2, float(m))
            assert G / float(whole) == pytest.approx(ratio, abs=6e-4)


def test_a_broken_bond_stays_broken_and_keeps_the_energy_that_it_cost():
    law = Brittle(micro := type("L", (), {})(), 0.01)
    micro.energy = lambda xi, eta: 0.5 * (eta @ eta)
    xi = jnp.array([2.0, 0.0])
    assert bool(law.advance(xi, 0.0099 * xi, True))
    assert not bool(law.advance(xi, 0.0101 * xi, True))
    assert not bool(law.advance(xi, 0.0 * xi, False))
    assert float(law.share(law.start)) == 1.0
    assert float(law.spent(xi, False)) == pytest.approx(0.5 * 4e-4)
    assert float(law.spent(xi, True)) == 0.0


def test_softening_spends_what_breaking_at_once_spends_but_for_its_width():
    micro = Microelastic(jnp.asarray(3.0), Constant())
    xi = jnp.array([0.5, 1.0])
    hard = Brittle(micro, 0.01)

    @jax.jit
    def look(s_crit):
        soft = Softening(micro, s_crit, 0.2)
        h = soft.advance(xi, 0.02 * xi, soft.start)
        healed = soft.advance(xi, -0.5 * xi, h)
        shares = soft.share(h), soft.share(0.0079), soft.share(0.01)
        return h, healed, shares, soft.spent(xi, h), hard.spent(xi, False)

    h, healed, shares, soft, once = look(jnp.asarray(0.01))
    assert shares[0] == 0.0
    assert shares[1] == 1.0
    assert healed == h
    # the mean of s^2 over the fall: 1 + width^2 / 9 for the step of degree 7
    assert float(soft / once) == pytest.approx(1 + 0.2**2 / 9, rel=1e-6)
    slope = jax.jvp(look, (jnp.asarray(0.01),), (jnp.asarray(1.0),))[1]
    assert float(slope[2][2]) > 0.0
