"""One bond: four witnesses of its tangent, its domain, and a wrong block caught."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.physics import Microelastic, bond_block, bond_force, pmb, stretch
from jaxpd.physics.bond import bond_energy, extension
from tests.catalogue import DELTA, LAWS, NU, STATES, Hardening, LogStrain, microelastic

HAND = ["fractional 0", "fractional 1.9", "gaussian"]


def bonds(rng, d, scale):
    """200 bonds of length 0.1 .. 0.4 and displacements `scale` times as large."""
    xi = rng.normal(size=(200, d))
    xi *= rng.uniform(0.1, 0.4, (200, 1)) / np.linalg.norm(xi, axis=1, keepdims=True)
    eta = scale * rng.uniform(-1, 1, (200, d)) * np.linalg.norm(xi, axis=1)[:, None]
    return jnp.asarray(xi), jnp.asarray(eta)


def relative(a, b):
    """Largest difference of blocks, each relative to its own largest entry."""
    axes = tuple(range(1, np.ndim(b)))
    size = np.abs(b).max(axis=axes, keepdims=True)
    return float((np.abs(np.asarray(a) - b) / size).max())


@pytest.mark.parametrize("d", [1, 2, 3])
@pytest.mark.parametrize("name", HAND)
def test_hand_derived_block_and_autodiff_agree(rng, name, d):
    law = LAWS[name](d)

    @jax.jit
    def response(law, xi, eta):
        def one(x, e):
            blocks = [bond_block(law, x, e, how) for how in ("ad", "hand", "axial")]
            slope = jax.grad(bond_energy, argnums=2)(law, x, e)
            return *blocks, bond_force(law, x, e), slope

        return jax.vmap(one)(xi, eta)

    for scale in (1e-8, 1e-3, 0.3):
        xi, eta = bonds(rng, d, scale)
        s = np.asarray(jax.vmap(stretch)(xi, eta))
        assert s.min() < 0 < s.max()
        ad, hand, axial, force, slope = map(np.asarray, response(law, xi, eta))
        assert relative(ad, hand) <= 1e-13
        # the force is the energy's slope; both are of order eta
        np.testing.assert_allclose(slope, force, rtol=0, atol=1e-14 * abs(force).max())
        np.testing.assert_allclose(hand, hand.transpose(0, 2, 1), rtol=1e-14)
        # eq. 20 leaves the geometric part out: of the order of the stretch, no more
        assert relative(axial, hand) <= 3 * np.abs(s).max()
        assert np.linalg.eigvalsh(axial).min() >= -1e-12 * np.abs(axial).max()
        back = np.asarray(response(law, -xi, -eta)[3])
        np.testing.assert_array_equal(back, -force)  # Newton's third law


@pytest.mark.parametrize("d", [1, 2, 3])
def test_complex_step_and_finite_difference_agree_with_the_hand_block(rng, d):
    law = LAWS["fractional 0"](d)
    xi, eta = bonds(rng, d, 0.2)
    xi, eta = np.asarray(xi), np.asarray(eta)
    hand = np.asarray(jax.jit(jax.vmap(lambda x, e: law.tangent(x, e)))(xi, eta))
    compiled = jax.jit(jax.vmap(lambda x, e: law.force(x, e)))

    def force(xi, eta):
        return np.asarray(compiled(xi, eta))

    def witness(step):
        columns = [step(np.broadcast_to(e, eta.shape)) for e in np.eye(d)]
        return np.stack(columns, axis=-1)

    h = 1e-30
    imaginary = witness(lambda e: force(xi + 0j, eta + 1j * h * e).imag / h)
    assert relative(imaginary, hand) <= 1e-14  # exact to round-off; measured 6e-16
    step = 1e-6
    central = witness(
        lambda e: (force(xi, eta + step * e) - force(xi, eta - step * e)) / (2 * step)
    )
    # truncation (step / 0.1)^2 = 1e-10 and round-off 1e-16 / 1e-6; measured 1e-10
    assert relative(central, hand) <= 1e-8


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class WrongSign(Microelastic):
    """The geometric term with the wrong sign, a classical slip."""

    def tangent(self, xi, eta):
        return 2.0 * self.axial(xi, eta) - super().tangent(xi, eta)


@pytest.mark.parametrize("d", [2, 3])
def test_a_wrong_hand_block_is_caught(rng, d):
    right = microelastic(LAWS["fractional 0"](d).omega, d)
    wrong = WrongSign(right.c, right.omega)
    xi, eta = bonds(rng, d, 0.01)

    @jax.jit
    @jax.vmap
    def blocks(x, e):
        return [bond_block(wrong, x, e, how) for how in ("ad", "hand")]

    ad, hand = map(np.asarray, blocks(xi, eta))
    assert relative(ad, hand) > 1e-3


@pytest.mark.parametrize(
    "law", [LogStrain(jnp.asarray(2.0)), Hardening(jnp.asarray(2.0))]
)
@pytest.mark.parametrize("d", [1, 2, 3])
def test_a_users_law_gets_force_and_block_for_free(rng, law, d):
    xi, eta = bonds(rng, d, 0.2)
    xi, eta = np.asarray(xi), np.asarray(eta)

    @jax.jit
    @jax.vmap
    def response(x, e):
        return bond_force(law, x, e), bond_block(law, x, e)

    block = np.asarray(response(xi, eta)[1])
    step = 1e-6
    for a, e in enumerate(step * np.eye(d)[:, None, :]):
        ahead, behind = (np.asarray(response(xi, eta + s * e)[0]) for s in (1, -1))
        slope = (ahead - behind) / (2 * step)
        np.testing.assert_allclose(
            block[:, :, a], slope, rtol=0, atol=1e-7 * float(abs(block).max())
        )


def test_what_a_users_law_lacks_is_named():
    law, xi, eta = Hardening(jnp.asarray(2.0)), jnp.ones(2), jnp.zeros(2)
    with pytest.raises(ValueError, match=r"law: Hardening has no energy"):
        bond_energy(law, xi, eta)
    with pytest.raises(ValueError, match=r"tangent: 'hand' needs a method tangent"):
        bond_block(law, xi, eta, "hand")
    with pytest.raises(ValueError, match=r"tangent: 'magic' must be"):
        bond_block(law, xi, eta, "magic")


def test_small_stretches_keep_their_digits_in_float32(rng):
    """The textbook difference of lengths loses them: 4.6 % at s = 1e-6."""
    xi, _ = bonds(rng, 2, 0.0)
    eta = 1e-6 * xi
    exact = 1e-6
    small = [jnp.asarray(v, jnp.float32) for v in (xi, eta)]
    ours = jax.vmap(stretch)(*small)
    x, y = (np.linalg.norm(v, axis=1) for v in (small[0], small[0] + small[1]))
    assert np.abs(ours / exact - 1).max() < 5e-7  # measured 4e-7
    assert np.abs((y - x) / x / exact - 1).max() > 1e-2


def test_extension_and_direction_of_a_known_bond():
    e, M = extension(jnp.array([3.0, 0.0]), jnp.array([0.0, 4.0]))
    assert float(e) == pytest.approx(2.0, rel=1e-15)
    np.testing.assert_allclose(M, [0.6, 0.8], rtol=1e-15)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_pmb_constants_are_those_of_the_field(d):
    """Paper 002, eq. 6, and 2 E / delta^2 in 1-D."""
    E, delta = 7.0, DELTA
    want = {
        1: 2 * E / delta**2,
        2: 6 * E / (np.pi * delta**3 * (1 - 1 / 3)),
        3: 18 * (E / (3 * (1 - 2 / 4))) / (np.pi * delta**4),
    }[d]
    law = pmb(E, NU[d], STATES[d], d, delta)
    assert float(law.c) == pytest.approx(want, rel=1e-14)
    f = law.force(jnp.eye(d)[0], 0.1 * jnp.eye(d)[0])  # s = 0.1 whatever the length
    np.testing.assert_allclose(f, 0.1 * want * np.eye(d)[0], rtol=1e-12)
