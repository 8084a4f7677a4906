"""Scenes whose bonds soften: toughness of the lattice, steps, derivatives, fits."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gradcheck
from jaxpd.fracture.breaking import prepare_fracture
from jaxpd.fracture.measures import straight_cuts, toughness
from jaxpd.gallery.slow import double_cantilever
from jaxpd.inverse import positive
from jaxpd.observe import observation

H = 12  # rows of an arm


def beam(G0=1e-4, m=3, arm=6, length=24, notch=8):
    """A small double cantilever beam with spacing 1 and E = 1."""
    return double_cantilever(
        m, arm / m, length / arm, notch / arm, delta=float(m), E=1.0, G0=G0
    )


@pytest.fixture(scope="module")
def split():
    """A beam of 12 rows an arm, with the path of bonds that soften."""
    scene = beam(arm=H, length=60, notch=24)
    end = jaxpd.box((42, -H), (60, H))
    return scene, end, jaxpd.solve_fracture(scene, softening=10.0, end=end).checked()


def test_softening_bonds_measure_the_lattice_sum(split):
    scene, _, growth = split
    curve = straight_cuts(growth, scene.weak[0], np.arange(25.0, 48.0, 2.0))
    found = toughness(growth, curve, 1e-4, 1.0, (28.0, 40.0))
    # the lattice sum of the bonds between two rows
    lattice = prepare_fracture(scene, "lattice").toughness
    assert lattice == pytest.approx(0.947, abs=1e-3)
    assert found.dissipated == pytest.approx(lattice, rel=0.02)
    assert found.bonds == pytest.approx(found.dissipated, rel=1e-12)
    assert found.spread[0] > 0.97 * lattice  # no trapping
    assert found.spread[1] < 1.03 * lattice
    assert np.abs(growth.balance).max() < 1e-3
    assert not any(growth.fallbacks[k] for k in ("halved", "dissipation", "relaxed"))


def test_damage_is_the_lost_share(split):
    _, _, growth = split
    damage = growth.damage()
    assert damage.max() < 0.5
    beside = growth.X[np.argmin(np.abs(growth.X - [30.5, 0.5]).sum(axis=1))]
    at = np.abs(growth.X - beside).sum(axis=1) < 1e-9
    # what crosses the plane is gone there, and nothing ahead of the process zone
    assert 0.3 < damage[at][0] < 0.5
    assert damage[growth.X[:, 0] > 52].max() == 0.0
    early = growth.damage(len(growth.factor) // 2)
    assert (early <= damage + 1e-12).all()
    tip = growth.places()[-5:, 0]
    zone = (growth.X[:, 0] > tip.mean()) & (damage > 0)
    assert len(np.unique(np.round(damage[zone], 6))) > 5  # shares, not counts


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.5, 2.0])
def test_the_size_of_steps_does_not_matter(split, size):
    scene, end, growth = split
    amount = size * 8 * np.median(energies(growth))
    other = jaxpd.solve_fracture(scene, softening=10.0, amount=amount, end=end)
    # as far as both went: they end a step apart
    last = min(growth.bonds[-1], other.bonds[-1])
    grown = (growth.bonds > 0.3 * last) & (growth.bonds <= last)
    assert grown.sum() > 20
    there = np.interp(growth.bonds[grown], other.bonds, other.factor)
    np.testing.assert_allclose(there, growth.factor[grown], rtol=5e-3)
    pull = np.interp(growth.bonds[grown], other.bonds, other.force)
    np.testing.assert_allclose(pull, growth.force[grown], rtol=5e-3)


def energies(growth):
    """Energy of each bond that may soften (J)."""
    soft = growth.softened
    springs = growth.springs
    stretched = springs.length[soft.soft] * soft.law.s_crit
    return 0.5 * springs.k[soft.soft] * stretched**2


@pytest.mark.slow
def test_load_control_finds_the_same_path(split):
    scene, _, growth = split
    rising = growth.envelope[2:]
    other = jaxpd.solve_fracture(scene, softening=10.0, factors=growth.factor[rising])
    at = at_factors(other.checked(), growth.factor[rising])
    for name in ("force", "bonds", "stored"):
        known = getattr(growth, name)[rising]
        got = getattr(other, name)[at]
        np.testing.assert_allclose(got, known, rtol=1e-3, atol=1e-3 * known.max())


@pytest.mark.slow
def test_conjugate_gradients_find_the_same_path(small):
    scene, asked, growth = small
    more = {"softening": 10.0, "factors": asked}
    other = jaxpd.solve_fracture(scene, solver="d-pcg", **more).checked()
    np.testing.assert_allclose(other.factor, growth.factor, rtol=1e-5)
    np.testing.assert_allclose(other.force, growth.force, rtol=1e-5)
    # it turned to factors where curvature was negative, and said how often
    assert other.fallbacks["direct"] == other.cost["direct"].sum()
    assert growth.fallbacks["direct"] == 0


@pytest.fixture(scope="module")
def small():
    """A small beam under given openings, beyond the highest force."""
    scene = beam()
    first = jaxpd.solve_fracture(scene, softening=10.0, max_states=12)
    asked = first.factor[1] * np.linspace(0.75, 6.0, 8)
    growth = jaxpd.solve_fracture(scene, softening=10.0, factors=asked).checked()
    assert 2 < np.argmax(growth.force) < len(growth.force) - 2
    return scene, asked, growth


def at_factors(growth, asked):
    return [int(np.argmin(np.abs(growth.factor - f))) for f in asked]


def test_the_path_again_is_the_path(small):
    _, _, growth = small
    frames, info = growth.replay().solve()
    assert int(info.status) == 0
    size = np.abs(growth.u).max()
    np.testing.assert_allclose(frames.u, growth.softened.u[1:], atol=1e-8 * size)
    for name, of in (("stored", "stored"), ("spent", "bonds"), ("force", "force")):
        known = getattr(growth, of)[1:]
        got = getattr(frames, name)
        np.testing.assert_allclose(got, known, atol=1e-8 * known.max())
    with pytest.raises(ValueError, match=r"kept.*at rest"):
        growth.replay([0])


def force(params, replay):
    frames, _ = replay.solve(params)
    return frames.force[0]


@pytest.mark.slow
@pytest.mark.parametrize("beyond", [False, True])
def test_derivatives_of_the_force_before_and_beyond_its_peak(small, beyond):
    _, asked, growth = small
    peak = int(np.argmax(growth.force))
    state = at_factors(growth, asked)[-1] if beyond else peak - 1
    assert growth.bonds[state] > 0
    replay = growth.replay([state])
    at = jax.tree.map(jnp.asarray, replay.params)
    still = jax.tree.map(jnp.zeros_like, at)
    ways = {name: still | {name: at[name]} for name in ("G0", "E", "prescribed")}
    steps = 5e-3 * 0.5 ** np.arange(7)
    found = gradcheck.taylor(force, at, ways, replay, steps=steps)
    for name, taylor in found.items():
        assert abs(taylor.slope - 2.0) < 0.05, (name, str(taylor))


@pytest.mark.slow
def test_toughness_is_found_from_a_curve_of_force_and_opening(small):
    scene, asked, growth = small
    true = 0.8e-4
    other = dataclasses.replace(scene.material, G0=true)
    other = dataclasses.replace(scene, material=other)
    measured = jaxpd.solve_fracture(other, softening=10.0, factors=asked).checked()
    data = measured.force[at_factors(measured, asked)]
    replay = growth.replay(at_factors(growth, asked))
    seen = observation(data, curve_of_forces, sigma=0.01 * data.max())
    found = jaxpd.fit(replay, {"G0": positive(1e-4)}, seen, gtol=1e-6, steps=20)
    assert float(found.checked().values["G0"]) == pytest.approx(true, rel=0.01)


def curve_of_forces(problem, params, frames):
    return frames.force


def test_settings_that_mean_nothing_are_refused():
    scene = beam()
    for wrong, words in (
        ({"softening": 1.0}, "softening: 1.0"),
        ({"softening": 10.0, "amount": -1.0}, "amount: -1.0"),
        ({"amount": 1.0}, "amount: 1.0"),
        ({"softening": 10.0, "solver": "amg"}, "solver: 'amg'"),
        ({"softening": 10.0, "few": 3, "factors": 0.1}, "few: 3"),
        ({"softening": 10.0, "folder": "there"}, "folder: there"),
    ):
        with pytest.raises(ValueError, match=words):
            jaxpd.solve_fracture(scene, **wrong)


@pytest.mark.slow
def test_derivatives_in_fields_of_stiffness_and_strength_and_in_the_kernel(small):
    _, asked, growth = small
    replay = growth.replay([at_factors(growth, asked)[3]])
    n = len(growth.X)
    at = dict(jax.tree.map(jnp.asarray, replay.params))
    at |= {"E": jnp.full(n, at["E"]), "G0": jnp.full(n, at["G0"])}
    still = jax.tree.map(jnp.zeros_like, at)
    wave = 1.0 + 0.3 * jnp.sin(jnp.asarray(growth.X[:, 0]))
    ways = {name: still | {name: at[name] * wave} for name in ("E", "G0")}
    ways["alpha"] = still | {"alpha": jnp.ones_like(at["alpha"])}
    steps = 5e-3 * 0.5 ** np.arange(7)
    found = gradcheck.taylor(force, at, ways, replay, steps=steps)
    for name, taylor in found.items():
        assert abs(taylor.slope - 2.0) < 0.05, (name, str(taylor))
        assert taylor.derivative != 0.0
