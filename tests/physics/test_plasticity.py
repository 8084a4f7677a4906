"""A plastic node: witnesses of its tangent, its surface, states against each other."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpd.physics import (
    Hooke,
    Linear,
    Plastic,
    Voce,
    VonMises,
    elastic,
    tangent_block,
    von_mises,
    von_mises_stress,
)
from jaxpd.physics.return_mapping import modes

E, NU, SIGMA_Y = 2.1e5, 0.3, 240.0
STATES = ["bar", "plane strain", "plane stress", "solid"]
SIZE = {"bar": 1, "plane strain": 3, "plane stress": 3, "solid": 6}
NODES = 2000


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Stiffening:
    """A user's own hardening, convex: Newton from 0 overshoots its root."""

    sigma_y: float
    rise: float

    def __call__(self, peeq):
        return self.sigma_y + self.rise * peeq**2


HARDENING = {
    "linear": Linear(SIGMA_Y, 5e3),
    "voce": Voce(SIGMA_Y, 100.0, 30.0, 500.0),
    "user": Stiffening(SIGMA_Y, 1e8),
}
KINDS = [(state, "linear") for state in STATES]
KINDS += [("plane stress", "voce"), ("plane strain", "user")]


def make(state, hardening="linear", h_kin=3e3):
    return VonMises(
        E, None if state == "bar" else NU, HARDENING[hardening], h_kin, state
    )


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0))
def _respond(law, strain, history):
    def twice(e):
        stress, after = law.step(e, history)
        return stress, (stress, after)

    ad, (stress, after) = jax.jacfwd(twice, has_aux=True)(strain)
    return stress, after, ad, law.tangent(strain, history)


def respond(law, strain, history):
    """Stress, memory, block by autodiff and by hand, compiled for NODES nodes."""
    n = len(strain)

    def padded(v):
        v = np.asarray(v)
        return np.concatenate([v, np.zeros((NODES - n, *v.shape[1:]))])

    out = _respond(law, *jax.tree.map(padded, (strain, history)))
    return jax.tree.map(lambda v: np.asarray(v)[:n], out)


def step(law, strain, history):
    return respond(law, strain, history)[:2]


def blocks(law, strain, history):
    return respond(law, strain, history)[2:]


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0))
def continuum(law, strain, history):
    return tangent_block(law, strain, history, "continuum")


@jax.jit
def elastic_block(law):
    return law.stiffness()


def untouched(law, n=NODES):
    return Plastic(np.zeros((n, SIZE[law.state])), np.zeros(n))


def walk(law, rng, steps=2):
    """Random paths of a random size: strain, memory before, stress, memory after."""
    history, s = untouched(law), SIZE[law.state]
    size = 10 ** rng.uniform(-4, -2, (NODES, 1))
    strain, stress, after = np.zeros((NODES, s)), None, history
    for _ in range(steps + 1):
        history, strain = after, strain + size * rng.normal(size=(NODES, s))
        stress, after = step(law, strain, history)
    return strain, history, stress, after


def tensors(law, strain, stress, history):
    """Stress and plastic strain in 3-D, [n, 3, 3], without the law's own modes."""
    stress, p = np.asarray(stress), np.asarray(history.strain_p)
    sigma, flow = np.zeros((2, len(p), 3, 3))
    s = p.shape[1]
    zz = np.zeros(len(p))
    if law.state == "plane strain":
        e, lam = np.asarray(strain), E * NU / (1 + NU) / (1 - 2 * NU)
        zz = lam * (e[:, 0] + e[:, 1]) + E / (1 + NU) * (p[:, 0] + p[:, 1])
    for a in range(1 if s == 1 else s // 3 + 1):
        sigma[:, a, a], flow[:, a, a] = stress[:, a], p[:, a]
    if s == 1:
        flow[:, 1, 1] = flow[:, 2, 2] = -p[:, 0] / 2
    elif s == 3:
        sigma[:, 2, 2], flow[:, 2, 2] = zz, -p[:, 0] - p[:, 1]
    pairs = {1: [], 3: [(0, 1)], 6: [(1, 2), (0, 2), (0, 1)]}[s]
    for i, (a, b) in enumerate(pairs):
        at = s - len(pairs) + i
        sigma[:, a, b] = sigma[:, b, a] = stress[:, at]
        flow[:, a, b] = flow[:, b, a] = p[:, at] / 2
    return sigma, flow


def relative_deviator(law, strain, stress, history):
    sigma, flow = tensors(law, strain, stress, history)
    mean = np.trace(sigma, axis1=1, axis2=2)[:, None, None] / 3
    return sigma - mean * np.eye(3) - 2 / 3 * law.h_kin * flow, flow


def norm(a):
    return np.sqrt((a * a).sum(axis=(1, 2)))


@pytest.mark.parametrize(("state", "hardening"), KINDS)
def test_hand_derived_block_autodiff_and_difference_agree(rng, state, hardening):
    law = make(state, hardening)
    strain, history, _, after = walk(law, rng)
    flows = np.asarray(after.peeq > history.peeq)
    assert 0.3 < flows.mean() < 0.95
    assert 0.2 < np.mean(np.asarray(history.peeq) > 0) < 0.95
    ad, hand = map(np.asarray, blocks(law, strain, history))
    assert np.abs(ad - hand).max() <= 1e-12 * E  # measured 8e-16
    assert np.abs(hand - hand.transpose(0, 2, 1)).max() <= 1e-14 * E
    # Voigt blocks of hardening: positive definite, no stiffer than the elastic one
    C = np.asarray(elastic_block(law))
    assert np.linalg.eigvalsh(hand).min() > 0
    assert np.linalg.eigvalsh(C - hand).min() >= -1e-12 * E
    np.testing.assert_array_equal(hand[~flows], np.broadcast_to(C, hand.shape)[~flows])

    h = 1e-7
    for a, e in enumerate(h * np.eye(SIZE[state])[:, None, :]):
        (up, p), (down, m) = (step(law, strain + sign * e, history) for sign in (1, -1))
        slope = np.asarray((up - down) / (2 * h))
        both = (np.asarray(p.peeq > history.peeq) == flows) & (
            np.asarray(m.peeq > history.peeq) == flows
        )
        assert both.mean() > 0.99  # the others straddle the kink
        # truncation (h / 1e-3)^2 with 1e-3 a strain at yield; measured 5e-9
        error = np.abs(slope - ad[:, :, a]).max(axis=1)[both]
        assert error.max() <= 1e-7 * E


@pytest.mark.parametrize(
    ("state", "hardening"), [("plane stress", "voce"), ("solid", "linear")]
)
def test_the_continuum_block_is_the_limit_of_small_steps(rng, state, hardening):
    law = make(state, hardening)
    strain, _, _, after = walk(law, rng)
    C = np.asarray(elastic_block(law))
    for size, room in ((1e-6, 1e-2), (1e-8, 1e-4)):  # the error is of the step's order
        further = strain + size * rng.normal(size=strain.shape)
        _, end, _, hand = respond(law, further, after)
        flows = np.asarray(end.peeq > after.peeq)
        assert 0.2 < flows.mean() < 0.9
        found = np.asarray(continuum(law, further, after))
        assert np.abs(found - np.asarray(hand)).max() <= room * E
        np.testing.assert_array_equal(
            found[~flows], np.broadcast_to(C, found.shape)[~flows]
        )
        # a step along the flow: the block lets it pass with the plastic slope alone
        assert np.linalg.eigvalsh(C - found[flows]).min() >= -1e-12 * E
    big = np.asarray(continuum(law, strain + 1e-3, after)) - np.asarray(
        blocks(law, strain + 1e-3, after)[1]
    )
    assert np.abs(big).max() > 1e-2 * E


@pytest.mark.parametrize(("state", "hardening"), KINDS)
def test_the_return_ends_on_the_surface_along_its_normal(rng, state, hardening):
    law = make(state, hardening)
    strain, history, stress, after = walk(law, rng)
    xi, flow = relative_deviator(law, strain, stress, after)
    q, Y = np.sqrt(1.5) * norm(xi), np.asarray(law.hardening(after.peeq))
    flows = np.asarray(after.peeq > history.peeq)
    assert (q - Y).max() <= 1e-10 * SIGMA_Y
    assert np.abs(q - Y)[flows].max() <= 1e-12 * SIGMA_Y
    trace = np.trace(flow, axis1=1, axis2=2)
    assert np.abs(trace).max() <= 1e-14 * np.abs(flow).max()
    # backward Euler: d strain_p = 3/2 dgamma xi / Y, whose equivalent is dgamma
    before = tensors(law, strain, stress, history)[1]
    dgamma = np.asarray(after.peeq - history.peeq)
    want = 1.5 * (dgamma / Y)[:, None, None] * xi
    np.testing.assert_allclose(flow - before, want, rtol=0, atol=1e-15)
    assert (dgamma >= 0).all()
    # dissipation of the relative stress, Y dgamma
    power = (xi * (flow - before)).sum(axis=(1, 2))
    np.testing.assert_allclose(power, Y * dgamma, rtol=0, atol=1e-12)
    # the stress is the elastic one of strain - strain_p (planes have a zz of their own)
    if state != "plane strain":
        C = np.asarray(elastic_block(law))
        left = np.asarray(strain - after.strain_p) @ C
        np.testing.assert_allclose(stress, left, rtol=0, atol=1e-12 * SIGMA_Y)


@pytest.mark.parametrize("state", ["plane strain", "solid"])
def test_the_radial_block_is_the_textbooks(rng, state):
    """Simo and Hughes (1998), box 3.2: 3-D tensors, projected on the plane's rows."""
    law = make(state)
    strain, history, stress, after = walk(law, rng)
    xi, _ = relative_deviator(law, strain, stress, after)
    normals = xi / np.maximum(norm(xi), 1e-30)[:, None, None]
    G, bulk = E / (2 * (1 + NU)), E / (3 * (1 - 2 * NU))
    dgamma = np.asarray(after.peeq - history.peeq)
    # their multiplier is sqrt(3/2) of ours; the trial's norm is sqrt(2/3) q
    trial = np.sqrt(2 / 3) * np.asarray(law.hardening(after.peeq))
    trial = trial + np.sqrt(2 / 3) * dgamma * (3 * G + law.h_kin)
    theta = 1 - 2 * G * np.sqrt(1.5) * dgamma / trial
    bar = 1 / (1 + (5e3 + law.h_kin) / (3 * G)) - (1 - theta)
    rows = [(0, 0), (1, 1), (0, 1)]
    if state == "solid":
        rows = [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)]
    delta = np.array([1.0 if a == b else 0.0 for a, b in rows])
    unit = np.diag([1.0 if a == b else 0.5 for a, b in rows])
    n = np.stack([normals[:, a, b] for a, b in rows], axis=1)
    volume = np.outer(delta, delta)
    want = bulk * volume + 2 * G * theta[:, None, None] * (unit - volume / 3)
    want = want - 2 * G * bar[:, None, None] * n[:, :, None] * n[:, None, :]
    flows = np.asarray(after.peeq > history.peeq)
    hand = np.asarray(blocks(law, strain, history)[1])
    assert np.abs(want - hand)[flows].max() <= 1e-12 * E


def unrolled(law, strain, history, n):
    """Plane stress by n steps of Newton on q^2 = Y^2, differentiated as they stand."""
    _, _, T, k = modes(law.E, law.nu, law.state)
    kappa = T * T * k + law.h_kin
    m = jnp.array([[1.0, 1, 0], [1, -1, 0], [0, 0, 2**0.5]]) / 2**0.5
    e, p = m @ strain, m @ history.strain_p
    z = T * k * (e - p) - law.h_kin * p / T

    def f(x):
        Y = law.hardening(history.peeq + x)
        return ((z / (1 + kappa * x / Y)) ** 2).sum() - Y * Y

    # forward mode differentiates each of the n steps
    x = jax.lax.fori_loop(0, n, lambda _, x: x - f(x) / jax.grad(f)(x), jnp.zeros(()))
    Y = law.hardening(history.peeq + x)
    p = p + x * T * z / (Y + kappa * x)
    return m.T @ (k * (e - p))


def test_an_unrolled_iteration_has_a_wrong_tangent_until_it_is_done(rng):
    law = make("plane stress")
    strain, history, _, after = walk(law, rng)
    dgamma = np.asarray(after.peeq - history.peeq)
    some = (dgamma > 0) & (dgamma < 1e-3)  # up to a strain at yield; larger is slower
    hand = np.asarray(blocks(law, strain, history)[1])
    block = jax.jit(jax.vmap(jax.jacfwd(partial(unrolled, law)), (0, 0, None)))
    error = {}
    for n in (2, 3, 4, 8, 10):
        ad = np.asarray(block(strain, history, n))
        error[n] = float(np.abs(ad - hand)[some].max() / E)
    assert error[2] > error[3] > error[4] > 1e-3, error
    assert error[8] <= 1e-12, error
    assert error[10] <= 1e-12, error


def on_surface(law):
    """A strain of an untouched node whose trial is on the surface."""
    d = np.array([1.0, -0.2, 0.1, 0.4, 0.2, 0.7])[: SIZE[law.state]]
    d = d if law.state == "solid" else np.array([1.0, 0.3, 0.5])[: SIZE[law.state]]
    return d * SIGMA_Y / float(elastic_size(law, d))


@jax.jit
def elastic_size(law, d):
    """Equivalent stress of a strain without flow."""
    hooke = Hooke(law.E, law.nu, law.state)
    zz = 0.0 if law.state == "solid" else hooke.out_of_plane(d)
    return von_mises_stress(hooke.step(d)[0], zz)


@pytest.mark.parametrize("state", STATES)
def test_elastic_at_rest_and_on_the_surface_plastic_beyond(state):
    law = make(state)
    surface = on_surface(law)
    strain = jnp.asarray(np.outer([0.0, 1.0, 1.0 + 1e-9, -1.0, -1.0 - 1e-9], surface))
    history = untouched(law, 5)
    C = np.asarray(elastic_block(law))
    stress, after = step(law, strain, history)
    assert not np.any(np.asarray(stress[0]))
    np.testing.assert_array_equal(np.asarray(after.peeq) > 0, [0, 0, 1, 0, 1])
    for found in map(np.asarray, blocks(law, strain, history)):
        for i in (0, 1, 3):
            np.testing.assert_array_equal(found[i], C)
        for i in (2, 4):
            assert np.abs(found[i] - C).max() > 0.1 * E


@pytest.mark.parametrize(("state", "hardening"), KINDS)
def test_a_committed_state_is_consistent_and_unloads_elastically(rng, state, hardening):
    law = make(state, hardening)
    strain, _, stress, after = walk(law, rng)
    again, same = step(law, strain, after)
    np.testing.assert_array_equal(same.peeq, after.peeq)
    np.testing.assert_array_equal(same.strain_p, after.strain_p)
    np.testing.assert_array_equal(again, stress)
    C = np.asarray(elastic_block(law))
    for found in blocks(law, strain, after):
        np.testing.assert_array_equal(found, np.broadcast_to(C, found.shape))


def drive(law, path):
    """Stress along a path of bar strains, from rest."""

    def one(history, e):
        stress, history = law.step(e[None], history)
        return history, stress[0]

    return np.asarray(jax.jit(partial(jax.lax.scan, one))(law.history0(), path)[1])


@pytest.mark.parametrize(
    ("h_iso", "h_kin", "last", "reverse"),
    [(5e4, 5e3, -10378.673, -10426.5403), (5e3, 5e4, -9528.673, -9573.4597)],
)
def test_the_bar_of_the_paper(h_iso, h_kin, last, reverse):
    """Paper 001's constants; K isotropic, H kinematic as in Simo and Hughes.

    Unloaded in the steps of its load, 5e-5, the last elastic stress is short of the
    reverse yield stress -sigma_y - (K - H) peeq by less than a step of 50.
    """
    E, sigma_y, h = 1e6, 1e4, 5e-5
    law = VonMises(E, None, Linear(sigma_y, h_iso), h_kin, "bar")
    path = h * np.concatenate([np.arange(1, 401), 400 - np.arange(1, 451)])
    stress = drive(law, path)
    slope = E * (h_iso + h_kin) / (E + h_iso + h_kin)
    assert slope == pytest.approx(52132.7014, rel=1e-9)  # its printed digits
    np.testing.assert_allclose(stress[:200], E * path[:200], rtol=1e-13)
    measured = (stress[399] - stress[200]) / (path[399] - path[200])
    assert measured == pytest.approx(slope, rel=1e-10)
    assert stress[399] == pytest.approx(10521.3270, abs=5e-5)
    steps = np.diff(stress[399:]) / -h
    elastic_steps = int(np.argmax(steps < 0.99 * E))
    assert stress[399 + elastic_steps] == pytest.approx(last, abs=1e-3)
    np.testing.assert_allclose(steps[elastic_steps + 1 :], slope, rtol=1e-8)
    # where the elastic line meets the plastic one
    e = (stress[399] - stress[-1] - E * 0.02 + slope * path[-1]) / (slope - E)
    assert stress[399] + E * (e - 0.02) == pytest.approx(reverse, abs=1e-4)
    peeq = (stress[399] - sigma_y) / (h_iso + h_kin)
    assert reverse == pytest.approx(-sigma_y - (h_iso - h_kin) * peeq, abs=1e-4)


def relax(law, strain, history, free):
    """Strains with the stress of the free components zero, by Newton's iteration."""
    strain = np.array(strain)
    for _ in range(12):
        stress, _, _, K = respond(law, strain, history)
        residual = np.asarray(stress)[:, free, None]
        if np.abs(residual).max() <= 1e-11 * SIGMA_Y:
            break
        K = np.asarray(K)[:, free][:, :, free]
        strain[:, free] -= np.linalg.solve(K, residual)[:, :, 0]
    stress, history = step(law, strain, history)
    assert np.abs(np.asarray(stress)[:, free]).max() <= 1e-10 * SIGMA_Y
    return strain, np.asarray(stress), history


@pytest.mark.parametrize("state", ["plane stress", "solid"])
def test_uniaxial_stress_is_that_of_a_bar(rng, state):
    bar, law = make("bar"), make(state)
    free = [1, 2] if state == "plane stress" else [1, 2, 3, 4, 5]
    h_bar, history = untouched(bar), untouched(law)
    strain = np.zeros((NODES, SIZE[state]))
    for _ in range(3):
        strain[:, 0] += rng.normal(size=NODES) * 2e-3
        strain, stress, history = relax(law, strain, history, free)
        want, h_bar = step(bar, jnp.asarray(strain[:, :1]), h_bar)
        atol = 1e-11 * SIGMA_Y
        np.testing.assert_allclose(stress[:, :1], want, rtol=0, atol=atol)
        np.testing.assert_allclose(history.peeq, h_bar.peeq, rtol=0, atol=1e-14)
    assert 0.5 < np.mean(np.asarray(h_bar.peeq) > 0) < 1


def test_a_solid_free_of_zz_is_in_plane_stress(rng):
    plane, law = make("plane stress"), make("solid")
    h_plane, history = untouched(plane), untouched(law)
    strain = np.zeros((NODES, 6))
    for _ in range(2):
        strain[:, [0, 1, 5]] += rng.normal(size=(NODES, 3)) * 2e-3
        strain, stress, history = relax(law, strain, history, [2, 3, 4])
        flat = jnp.asarray(strain[:, [0, 1, 5]])
        want, h_plane = step(plane, flat, h_plane)
        atol = 1e-10 * SIGMA_Y
        np.testing.assert_allclose(stress[:, [0, 1, 5]], want, rtol=0, atol=atol)
        p = np.asarray(history.strain_p)
        np.testing.assert_allclose(p[:, [0, 1, 5]], h_plane.strain_p, atol=1e-13)
    assert not np.any(jax.jit(jax.vmap(plane.out_of_plane))(flat, h_plane))


def test_a_solid_held_along_zz_is_in_plane_strain(rng):
    plane, law = make("plane strain"), make("solid")
    flat, h_plane, stress, after = walk(plane, rng)

    def raised(v):
        zz, none = -v[:, 0] - v[:, 1], np.zeros(len(v))
        return np.stack([v[:, 0], v[:, 1], zz, none, none, v[:, 2]], axis=1)

    strain = raised(flat) * [1, 1, 0, 0, 0, 1]
    history = Plastic(raised(h_plane.strain_p), h_plane.peeq)
    full, end = step(law, strain, history)
    atol, rows = 1e-12 * SIGMA_Y, np.array([0, 1, 5])
    np.testing.assert_allclose(full[:, rows], stress, rtol=0, atol=atol)
    zz = jax.jit(jax.vmap(plane.out_of_plane))(flat, after)
    np.testing.assert_allclose(full[:, 2], zz, rtol=0, atol=atol)
    np.testing.assert_allclose(end.strain_p, raised(after.strain_p), atol=1e-15)
    q = jax.jit(jax.vmap(von_mises_stress))(stress, zz)
    same = jax.jit(jax.vmap(von_mises_stress))(full)
    np.testing.assert_allclose(same, q, rtol=1e-12)
    for a, b in zip(
        blocks(law, strain, history), blocks(plane, flat, h_plane), strict=True
    ):
        np.testing.assert_allclose(a[:, rows][:, :, rows], b, rtol=0, atol=1e-12 * E)
    with pytest.raises(ValueError, match=r"state: 'solid' has no plane"):
        law.out_of_plane(strain[0], history)


@jax.jit
@partial(jax.vmap, in_axes=(None, 0, 0, None))
def slopes(law, strain, history, direction):
    """Gradient of a scalar of the step in everything, and its change along a line."""

    def scalar(law, strain, history):
        stress, after = law.step(strain, history)
        stress = stress / E
        return 1e6 * (stress * stress).sum() + (1e3 * after.peeq) ** 2

    gradient = jax.grad(scalar, argnums=(0, 1, 2))
    at = (law, strain, history)
    zero = jax.tree.map(jnp.zeros_like, (law, history))
    return jax.jvp(gradient, at, (zero[0], direction, zero[1]))


@pytest.mark.parametrize("state", ["plane stress", "solid"])
def test_derivatives_are_finite_everywhere_and_right_to_second_order(rng, state):
    law = make(state, "voce" if state == "plane stress" else "linear")
    strain, history, _, after = walk(law, rng)
    strain, history, after = (
        jax.tree.map(lambda v: v[:20], t) for t in (strain, history, after)
    )
    # awkward points: zero, the surface, just beyond, and xi = 0 after a history
    surface = on_surface(law)
    M, share, T, _ = modes(1.0, NU, state)
    k = np.asarray(jax.jit(lambda: modes(E, NU, state)[3])())
    back = (T * k + float(law.h_kin) / T) * (np.asarray(after.strain_p) @ M.T)
    centre = (back / (T * k * share)) @ M
    at = np.concatenate([np.outer([0.0, 1.0, 1.0 + 1e-9], surface), centre])
    start = untouched(law, 3)
    memory = jax.tree.map(lambda a, b: np.concatenate([a, b]), start, after)
    line = rng.normal(size=SIZE[state])
    both = jax.tree.map(lambda *v: np.concatenate(v), (at, memory), (strain, history))
    for leaf in jax.tree.leaves((slopes(law, *both, line), respond(law, *both))):
        assert np.all(np.isfinite(leaf))
    second = jax.tree.map(lambda v: v[-20:], slopes(law, *both, line)[1])
    h = 1e-7

    def near(s):
        shifted = both[0].copy()
        shifted[-20:] += s * h * line
        gradient = slopes(law, shifted, both[1], line)[0]
        return jax.tree.map(lambda v: v[-20:], gradient)

    up, down = near(1), near(-1)
    same = np.asarray(step(law, strain, history)[1].peeq > history.peeq)
    for s in (1, -1):
        peeq = step(law, strain + s * h * line, history)[1].peeq
        assert np.array_equal(np.asarray(peeq > history.peeq), same)  # off the kink
    for a, b, want in zip(*map(jax.tree.leaves, (up, down, second)), strict=True):
        difference = np.asarray(a - b) / (2 * h)
        want = np.asarray(want)
        size = np.abs(want).max()
        np.testing.assert_allclose(difference, want, rtol=0, atol=1e-5 * size + 1e-12)


@pytest.mark.parametrize(("state", "hardening"), KINDS)
def test_stress_over_modulus_knows_no_unit(rng, state, hardening):
    law, scale = make(state, hardening), 1e-9  # GPa for Pa
    shape = dataclasses.asdict(law.hardening)
    shape = {n: v * (1 if n == "rate" else scale) for n, v in shape.items()}
    small = type(law.hardening)(**shape)
    small = VonMises(E * scale, law.nu, small, law.h_kin * scale, state)
    strain, history, stress, after = walk(law, rng)
    other, end = step(small, strain, history)
    error = np.abs(np.asarray(other) / (E * scale) - np.asarray(stress) / E)
    assert error.max() <= 1e-13 * np.abs(np.asarray(stress)).max() / E
    np.testing.assert_allclose(end.peeq, after.peeq, rtol=0, atol=1e-16)


number = st.floats(-1.0, 1.0)
laws = st.tuples(
    st.integers(-3, 12),  # E = 10^n
    st.floats(-5.0, -1.0),  # sigma_y / E = 10^n
    st.floats(0.0, 3.0),  # rise / sigma_y
    st.floats(-1.0, 4.0),  # rate = 10^n
    st.floats(0.0, 1.0),  # h_iso / E
    st.floats(0.0, 1.0),  # h_kin / E
    st.floats(-0.9, 0.49),  # nu
    st.floats(-1.0, 3.0),  # strain / strain at yield = 10^n
)


@pytest.mark.parametrize("state", ["plane stress", "solid"])
def test_stress_never_leaves_the_surface_and_dissipates(state):
    take = jax.jit(lambda law, e, h: law.step(e, h))

    @settings(deadline=None, max_examples=60, derandomize=True)
    @given(laws, st.lists(st.tuples(*[number] * SIZE[state]), min_size=1, max_size=4))
    def hold(numbers, path):
        exponent, y, rise, rate, h_iso, h_kin, nu, size = numbers
        E = 10.0**exponent
        sigma_y = E * 10.0**y
        hardening = Voce(sigma_y, rise * sigma_y, 10.0**rate, h_iso * E)
        law = VonMises(E, nu, hardening, h_kin * E, state)
        history = Plastic(np.zeros(SIZE[state]), np.zeros(()))
        for e in path:
            strain = np.array(e) * 10.0 ** (y + size)
            stress, after = jax.tree.map(np.asarray, take(law, strain, history))
            new, old = (jax.tree.map(lambda v: v[None], h) for h in (after, history))
            xi, flow = relative_deviator(law, strain[None], stress[None], new)
            before = tensors(law, strain[None], stress[None], old)[1]
            q, p = np.sqrt(1.5) * norm(xi)[0], float(after.peeq)
            Y = sigma_y * (1 - rise * np.expm1(-(10.0**rate) * p)) + h_iso * E * p
            # round-off: of the surface, of E strain
            room = 1e-10 * Y + 1e-13 * E * np.abs(strain).max() / (1 - 2 * 0.49)
            assert q - Y <= room
            assert float(after.peeq) >= float(history.peeq)
            power = (xi * (flow - before)).sum()
            assert power >= -1e-13 * Y * float(after.peeq)
            history = after

    hold()


def test_where_there_is_no_answer_there_is_no_number():
    """Softened to nothing, before the step or in it: NaN in all results."""
    soft = [
        make("bar", "linear"),
        make("plane stress", "linear"),
        make("plane stress", "voce"),
    ]
    h_isos = [-8e4, -8e4, -5e4]
    for law, h_iso in zip(soft, h_isos, strict=True):
        hardening = dataclasses.replace(law.hardening, h_iso=h_iso)
        law = dataclasses.replace(law, hardening=hardening, h_kin=0.0)
        s = SIZE[law.state]
        strain = jnp.asarray(np.outer([0.5e-3, 2e-3, 1e-1], np.eye(s)[0]))
        stress, after = step(law, strain, untouched(law, 3))
        for v in (stress, after.peeq, after.strain_p):
            assert np.all(np.isfinite(v[:2]))
            assert np.all(np.isnan(v[2]))
        assert np.all(np.isnan(blocks(law, strain, untouched(law, 3))[0][2]))
        spent = Plastic(jnp.zeros((3, s)), jnp.full(3, 1.0))
        assert np.all(np.isnan(step(law, 0 * strain, spent)[0]))


@pytest.mark.parametrize("state", STATES)
def test_hookes_law_has_the_same_door_and_no_memory(state):
    nu = None if state == "bar" else NU
    law, plastic = Hooke(E, nu, state), make(state)
    strain = 0.5 * on_surface(plastic)
    assert law.history0() == ()

    @jax.jit
    def door(law, e):
        found = [tangent_block(law, e, (), how) for how in ("ad", "hand", "continuum")]
        zz = None if state == "solid" else law.out_of_plane(e)
        return law.step(e, law.history0()), zz, found

    (stress, history), zz, found = door(law, strain)
    assert history == ()
    want, memory = jax.tree.map(
        lambda v: v[0], step(plastic, strain[None], untouched(plastic, 1))
    )
    np.testing.assert_allclose(stress, want, rtol=1e-14)
    C = np.asarray(elastic_block(plastic))
    for block in found:
        np.testing.assert_allclose(block, C, rtol=0, atol=1e-15 * E)
    assert law.shear == plastic.shear == (E / 2 if state == "bar" else E / 2 / (1 + NU))
    if state != "solid":
        want = float(jax.jit(plastic.out_of_plane)(strain, memory))
        assert float(zz) == pytest.approx(want, rel=1e-15)
        trace = float(strain[:2].sum())
        lam = E * NU / ((1 + NU) * (1 - 2 * NU)) if state == "plane strain" else 0
        assert float(zz) == pytest.approx(lam * trace, rel=1e-14)


@pytest.mark.parametrize("state", ["plane stress", "plane strain", "solid"])
def test_stiffness_is_differentiable_in_poissons_ratio(state):
    def stiffness(nu):
        return elastic.stiffness(E, nu, state)

    slope = np.asarray(jax.jit(jax.jacfwd(stiffness))(NU))
    want = (np.asarray(stiffness(NU + 1e-6)) - np.asarray(stiffness(NU - 1e-6))) / 2e-6
    np.testing.assert_allclose(slope, want, rtol=0, atol=1e-8 * np.abs(slope).max())


def test_leaves_may_be_mapped_over_nodes_and_traced(rng):
    state = "plane strain"
    strain, history, *_ = walk(make(state), rng)
    E_nodes = jnp.asarray(E * rng.uniform(0.5, 2.0, NODES))
    law = von_mises(E_nodes, NU, SIGMA_Y, 5e3, 3e3, state=state)
    axes = VonMises(0, None, None, None, state)
    mapped = jax.jit(
        jax.vmap(lambda law, e, h: law.step(e, h)[0], in_axes=(axes, 0, 0))
    )(law, strain, history)
    for i in (0, 7, 99):
        one = dataclasses.replace(make(state), E=float(E_nodes[i]))
        at = jax.tree.map(lambda v, i=i: v[i : i + 1], (strain, history))
        np.testing.assert_allclose(mapped[i], step(one, *at)[0][0], rtol=1e-12)

    @jax.jit
    def work(sigma_y):
        law = von_mises(E, None, sigma_y, 5e3, 3e3, state="bar")
        return law.step(jnp.array([0.01]), law.history0())[0][0]

    # stress = sigma_y E / (E + K + H) + ...: linear in the yield stress
    assert float(jax.grad(work)(SIGMA_Y)) == pytest.approx(E / (E + 8e3), rel=1e-13)


def test_equivalent_stress_of_known_stresses():
    size = jax.jit(von_mises_stress)
    assert float(size(jnp.array([-3.0]))) == 3.0
    assert float(size(jnp.array([0.0, 0, 2]))) == pytest.approx(2 * 3**0.5, rel=1e-15)
    assert float(size(jnp.array([5.0, 5, 0]), 5.0)) == 0.0
    assert float(size(jnp.array([5.0, 5, 5, 0, 0, 0]))) == 0.0
    assert float(size(jnp.array([5.0, 0, 0, 0, 0, 0]))) == 5.0


class StepOnly:
    def step(self, strain, history):
        return 2.0 * strain, history


BAR = partial(von_mises, 1.0, None, state="bar")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: BAR(-5.0), r"sigma_y: -5.0 must be positive"),
        (lambda: BAR(np.nan), r"sigma_y: nan must be positive"),
        (lambda: BAR(), r"sigma_y: None; give a yield stress"),
        (lambda: BAR(1.0, -1.5), r"h_iso: -1.5 softens .* above -1 "),
        (lambda: BAR(1.0, -1.5, 0.25), r"h_iso: -1.5 softens .* above -1.25 "),
        (lambda: BAR(1.0, np.inf), r"h_iso: inf must be a number"),
        (lambda: BAR(1.0, 0.0, -0.5), r"h_kin: -0.5 must not be negative"),
        (
            lambda: von_mises(0.0, None, 1.0, state="bar"),
            r"E: 0.0 must be positive",
        ),
        (
            lambda: von_mises(1.0, 0.5, 1.0, state="solid"),
            r"nu: 0.5 must lie between",
        ),
        (
            lambda: von_mises(1.0, None, 1.0, state="plane stress"),
            r"nu: None must lie between",
        ),
        (
            lambda: von_mises(1.0, 0.3, 1.0, state="shell"),
            r"state: 'shell' must be one of",
        ),
        (
            lambda: BAR(hardening=Voce(-2.0, 1.0, 1.0, 0.0)),
            r"hardening: .*-2.* must be positive.* at peeq = 0",
        ),
        (
            lambda: BAR(3.0, hardening=Voce(2.0, 1.0, 1.0, 0.0)),
            r"sigma_y: 3.0 differs from hardening\(0\) = 2.0",
        ),
        (
            lambda: BAR(2.0, 7.0, hardening=Voce(2.0, 1.0, 1.0, 0.0)),
            r"h_iso: 7.0 is linear hardening, which `hardening` \(Voce\) replaces",
        ),
        (
            lambda: tangent_block(BAR(1.0), jnp.zeros(1), None, "magic"),
            r"tangent: 'magic' must be",
        ),
        (
            lambda: tangent_block(StepOnly(), jnp.zeros(1), None, "hand"),
            r"tangent: 'hand' needs a method tangent.*StepOnly does not have",
        ),
    ],
)
def test_wrong_input_is_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_a_law_of_a_step_alone_has_a_block():
    block = tangent_block(StepOnly(), jnp.ones(2), None)
    np.testing.assert_array_equal(block, 2 * np.eye(2))
