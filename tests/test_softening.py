"""Softening bonds: the law, closed-form snap-back, ways out, and a beam that splits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.fracture import soft_walk
from jaxpd.fracture.events import Limits
from jaxpd.fracture.soft import SoftBody
from jaxpd.fracture.soft_rest import relaxed
from jaxpd.fracture.soft_states import SoftStates
from jaxpd.fracture.soft_walk import SoftWalk
from jaxpd.operators.springs import Springs
from jaxpd.physics import Bilinear, Microelastic, bond_energy
from jaxpd.physics.influence import Constant

RATIO = 4.0


def scalar(s_crit=0.01, ratio=RATIO):
    return Bilinear(None, s_crit, ratio)


def test_a_bilinear_bond_costs_what_the_brittle_one_does():
    law = scalar()
    assert (law.peak, law.end) == pytest.approx((0.005, 0.02))
    s = np.linspace(0.0, 0.025, 200_001)
    pull = law.tension(s, s)
    area = np.sum(0.5 * (pull[1:] + pull[:-1]) * np.diff(s))
    assert area == pytest.approx(0.5 * 0.01**2, rel=1e-8)
    # on the way: spent and stored are the area so far
    for stop in (0.004, 0.009, 0.019):
        on = s <= stop + 1e-12
        area = np.sum(0.5 * (pull[on][1:] + pull[on][:-1]) * np.diff(s[on]))
        h = s[on][-1]
        stored = 0.5 * law.share(h) * h * h
        assert law.used(h) * 0.5 * 0.01**2 + stored == pytest.approx(area, rel=1e-8)


def test_the_tangent_by_hand_is_that_of_automatic_differentiation():
    law = scalar()
    s = jnp.asarray([-0.01, 0.001, 0.0049, 0.0051, 0.01, 0.019, 0.021])
    for h in (0.0, 0.008, 0.03):
        h = jnp.full(s.shape, h)
        by_ad = jnp.diagonal(jax.jacfwd(lambda x, h=h: law.tension(x, h))(s))
        np.testing.assert_allclose(law.slope(s, h), by_ad, rtol=1e-12, atol=1e-14)
        here = np.asarray(s), np.asarray(h)
        np.testing.assert_allclose(law.slope(*here), by_ad, rtol=1e-12, atol=1e-14)


def test_a_bilinear_bond_forgets_nothing_and_unloads_to_the_origin():
    xi = jnp.asarray([1.0, 0.0])
    law = Bilinear(Microelastic(2.0, Constant()), 0.01, RATIO)
    h = law.advance(xi, 0.012 * xi, law.start)
    assert float(h) == pytest.approx(0.012)
    assert float(law.advance(xi, 0.003 * xi, h)) == float(h)
    assert float(law.share(law.start)) == 1.0
    share = float(law.share(h))
    assert share * 0.012 == pytest.approx(0.005 * (0.02 - 0.012) / 0.015)
    back = law.tension(jnp.asarray([0.006, 0.003, 0.0]), h)
    np.testing.assert_allclose(back, share * np.array([0.006, 0.003, 0.0]), rtol=1e-14)
    whole = float(bond_energy(law.law, xi, 0.01 * xi))
    assert float(law.spent(xi, 0.03)) == pytest.approx(whole, rel=1e-14)
    assert float(law.spent(xi, h)) == pytest.approx(whole * 7 / 15, rel=1e-12)
    never = Bilinear(law.law, jnp.inf, RATIO)
    assert (float(never.share(h)), float(never.spent(xi, h))) == (1.0, 0.0)


def row(springs, solver="direct"):
    """Points on a line, the first held and the last moved by the load factor.

    Springs are (end, end, stiffness, critical stretch), all 1 m long.
    """
    i, j, k, s_crit = map(np.array, zip(*springs, strict=True))
    n = int(j.max()) + 1
    all_of = Springs(i, j, np.ones((len(i), 1)), np.ones(len(i)), k.astype(float))
    fixed = np.zeros((n, 1), bool)
    fixed[[0, -1]] = True
    moved = np.zeros((n, 1))
    moved[-1] = 1.0
    law = Bilinear(None, s_crit.astype(float), RATIO)
    whole = np.ones(len(i), bool)
    return SoftBody(all_of, law, fixed, moved, np.zeros((n, 1)), whole, solver)


def walk(body, amount=0.1, factor=np.inf, states=500):
    end = np.zeros(len(body.springs.k), bool)
    energy = amount * body.most.max()
    return SoftWalk(
        body, SoftStates(body), Limits(states, factor, end, 1e-9), energy, energy
    )


def chain():
    """A bond behind a spring so weak that it snaps back."""
    return row([(0, 1, 1.0, 0.01), (1, 2, 0.1, np.inf)])


@pytest.mark.parametrize("amount", [0.4, 0.2, 0.1])
def test_dissipation_control_follows_the_snap_back_of_one_bond(amount):
    body = chain()
    path = walk(body, amount)
    assert path.by_energy().startswith("severed")
    states = path.states
    f, pull = states.column("factor"), np.array(states.reactions)[:, 1, 0]
    e = f - pull / 0.1  # elongation of the bond
    np.testing.assert_allclose(pull, scalar().tension(e, e), atol=1e-9 * pull.max())
    assert f.max() == pytest.approx(0.005 + 0.005 / 0.1, rel=1e-9)
    assert f[-1] == pytest.approx(0.02, rel=1e-6)  # far below: it snapped back
    assert states.column("released")[-1] == pytest.approx(0.5 * 0.01**2, rel=1e-6)
    left = states.column("work") - states.column("stored") - states.column("released")
    assert np.abs(left).max() <= 1e-12 * states.column("work").max()
    assert states.broken_at[0] == len(f) - 1


def test_conjugate_gradients_turn_to_factors_where_curvature_is_negative():
    springs = [(0, 1, 1.0, 0.01), (1, 2, 0.1, np.inf)]
    path, other = walk(row(springs)), walk(row(springs, "d-pcg"))
    for each in (path, other):
        assert each.by_energy().startswith("severed")
    f, g = path.states.column("factor"), other.states.column("factor")
    np.testing.assert_allclose(g, f, rtol=1e-9)
    assert other.fallbacks["direct"] == other.states.column("direct").sum() > 0
    assert not path.fallbacks["direct"]


def test_dissipation_control_passes_from_one_bond_to_the_next():
    # two bonds side by side, the second begins where the first has long ended
    bonds = [(0, 1, 1.0, 0.01), (0, 1, 2.0, 0.1), (1, 2, 0.3, np.inf)]
    body = row(bonds)
    path = walk(body, 0.03)
    assert path.by_energy().startswith("severed")
    f, pull = path.states.column("factor"), np.array(path.states.reactions)[:, 1, 0]
    e = f - pull / 0.3
    both = scalar().tension(e, e) + 2.0 * scalar(0.1).tension(e, e)
    np.testing.assert_allclose(pull, both, atol=1e-8 * pull.max())
    assert {0.005, 0.02, 0.05, 0.2} <= set(np.round(e, 8))
    assert path.states.column("broken")[-1] == 2
    assert not path.fallbacks["halved"]


def snapping():
    """A bond beside a spring that stays, both behind a weak one; its closed form."""
    body = row([(0, 1, 1.0, 0.01), (0, 1, 0.1, np.inf), (1, 2, 0.1, np.inf)])

    def check(states):
        f, pull = states.column("factor"), np.array(states.reactions)[:, 1, 0]
        e = f - pull / 0.1
        both = scalar().tension(e, e) + 0.1 * e
        np.testing.assert_allclose(pull, both, atol=1e-8 * pull.max())
        return f

    return walk(body, 0.1), check


def test_load_control_goes_through_a_snap_back_by_dissipation():
    path, check = snapping()
    # the force falls from 0.055 + 0.005 = 0.06 on
    asked = [0.03, 0.05, 0.0555, 0.1, 0.3]
    assert path.by_load(asked) == "load factor 0.3 reached"
    f = check(path.states)
    assert set(asked) <= set(np.round(f, 9))
    assert f.max() == pytest.approx(0.3)
    falls = np.flatnonzero(np.diff(f) < 0)
    assert f[falls[0]] == pytest.approx(0.06, rel=0.01)
    assert f[falls[-1] + 1] == pytest.approx(0.04, rel=1e-6)
    assert path.fallbacks["dissipation"] == 1
    assert path.fallbacks["halved"] == path.states.column("halved").sum() > 0
    assert not path.fallbacks["relaxed"]


def test_load_control_relaxes_where_nothing_else_helps(monkeypatch):
    monkeypatch.setitem(soft_walk.HALVINGS, "energy", 0)
    path, _ = snapping()
    assert path.by_load([0.05, 0.1]) == "load factor 0.1 reached"
    assert path.fallbacks["relaxed"] == path.states.column("relaxed").sum() == 1
    pull = path.states.reactions[-1][1, 0]
    assert pull == pytest.approx(0.05 * 0.1, rel=1e-8)  # two weak springs in a row
    balance = path.states.column("work") - path.states.column("released")
    balance -= path.states.column("stored")
    assert np.abs(balance).max() <= 1e-3 * path.states.column("work").max()


def test_relaxation_finds_the_state_beyond_a_snap_back():
    body = chain()
    path = walk(body)
    assert path.by_load([0.05]).endswith("reached")
    trial = relaxed(body, 0.06)
    assert body.h[0] < 0.005  # what was tried leaves no trace
    path._keep(trial, damped=True)
    row = path.states.rows[-1]
    assert row["broken"] == 1
    assert row["bonds"] == pytest.approx(0.5 * 0.01**2, rel=1e-12)
    assert row["stored"] == pytest.approx(0.0, abs=1e-15)
    # damping took what the spring had stored beyond the bond's own
    assert row["released"] == pytest.approx(row["work"], rel=1e-12)
    assert row["released"] > 2 * row["bonds"]


def test_a_bilinear_bond_works_in_explicit_runs():
    law = Bilinear(Microelastic(2.0, Constant()), 0.01, RATIO)
    bar = jaxpd.Scene(
        body=jaxpd.box((0.0,), (1.0,)),
        material=jaxpd.Solid(law, rho=1.0),
        supports=[
            jaxpd.moves(jaxpd.below(x=0.1), x=0.0),
            jaxpd.moves(jaxpd.above(x=0.9), x=0.03, time=jaxpd.ramp(20.0)),
        ],
        resolution=jaxpd.Bonds(dx=0.05, m=2, nodes="cell"),
    )
    run = jaxpd.run_explicit(bar, 20.0, safety=0.03, records=10).checked()
    assert run.released[-1] > 0
    assert (np.diff(run.released) >= 0).all()
    assert 0 < run.damage().max() <= 1
    assert np.abs(run.balance).max() < 1e-2


def test_a_bond_that_unloads_keeps_its_damage():
    body = row([(0, 1, 1.0, 0.01), (1, 2, 10.0, np.inf)])
    path = walk(body)
    assert path.by_load([0.01, 0.002, 0.012]).endswith("reached")
    f, pull = path.states.column("factor"), np.array(path.states.reactions)[:, 1, 0]
    e = f - pull / 10.0
    at = [int(np.argmin(np.abs(f - x))) for x in (0.01, 0.002, 0.012)]
    out, back, on = at
    k = pull[out] / e[out]
    assert pull[back] == pytest.approx(k * e[back], rel=1e-9)
    assert pull[on] == pytest.approx(scalar().tension(e[on], e[on]), rel=1e-9)
    bonds = path.states.column("bonds")
    assert bonds[back] == pytest.approx(bonds[out], rel=1e-12)
    assert bonds[on] > bonds[back]
