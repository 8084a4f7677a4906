"""Two dynamic fracture benchmarks against the acceptance bands that were measured."""

import numpy as np
import pytest

import jaxpd
from jaxpd.crack_path import branching, deflection
from jaxpd.gallery import FRACTURE_SAFETY, branching_plate, kalthoff_winkler

pytestmark = pytest.mark.slow


def branch(m, delta=1e-3, until=46e-6, **more):
    """A run in float32 to 46 us, a frame every 0.5 us: its balances and its crack."""
    scene = branching_plate(m, delta, **more)
    records = round(until / 0.5e-6)
    run = jaxpd.run_explicit(
        scene,
        until,
        safety=FRACTURE_SAFETY,
        records=records,
        frames=records,
        dtype="float32",
    ).checked()
    shape = (round(0.1 * m / delta), round(0.04 * m / delta))
    X, phi = np.asarray(run.X), run.frames["damage"]
    crack = branching(
        X, shape, phi, run.frames["t"], notch_x=0.05, delta=delta, until=43e-6
    )
    return (run.balance, run.kinetic, run.momentum), crack


def in_band(crack):
    assert crack.tips == 2
    assert crack.xe == pytest.approx(65.2e-3, abs=1.5e-3)
    assert crack.tb == pytest.approx(20.3e-6, abs=1.0e-6)
    assert crack.times[1] == pytest.approx(38.0e-6, abs=1.2e-6)
    assert crack.v_mean == pytest.approx(1325, rel=0.05)
    assert 1450 <= crack.v_peak <= 1850  # below 0.65 of the Rayleigh speed, 1990 m/s
    assert crack.angle == pytest.approx(62, abs=6)


def as_it_should(balances, crack):
    in_band(crack)
    balance, kinetic, momentum = balances
    # measured 2e-4
    assert np.abs(balance[10:]).max() < 5e-3
    scale = kinetic[-1] / 10.0  # of momentum, at speeds of 10 m/s
    assert np.abs(momentum).max() < 1e-4 * scale


@pytest.mark.parametrize("m", [3, 5])  # 4 is below, in a run that has another use
def test_glass_branches_once_where_and_when_it_should(m):
    as_it_should(*branch(m))


def test_the_fork_does_not_move_with_the_horizon():
    # half the horizon takes minutes: benchmarks/fracture.py, 65.3 mm
    _, crack = branch(4, 2e-3)
    assert crack.tips == 2
    assert crack.xe == pytest.approx(65.2e-3, abs=3e-3)
    assert crack.v_mean == pytest.approx(1325, rel=0.05)
    assert 19.0e-6 <= crack.tb <= 23e-6


def test_half_the_stress_does_not_branch():
    _, crack = branch(3, stress=1e6)
    assert crack.tips == 1
    assert np.isnan(crack.xe)


def test_glass_branches_at_m_4_and_stress_squared_over_fracture_energy_is_all():
    # at m = 3 the fork itself is uncertain to 0.6 mm, beyond the tolerance
    (balances, one), (_, six) = branch(4), branch(4, stress=12e6, G0=36 * 3.8)
    as_it_should(balances, one)
    assert six.xe == pytest.approx(one.xe, abs=0.5e-3)
    assert six.times[1] == pytest.approx(one.times[1], abs=0.5e-6)
    assert six.v_mean == pytest.approx(one.v_mean, rel=0.015)


@pytest.mark.parametrize(("m", "delta"), [(3, 1.5e-3), (4, 2e-3), (3, 3e-3)])
def test_struck_steel_cracks_at_its_angle(m, delta):
    scene, until = kalthoff_winkler(m, delta), 60e-6
    run = jaxpd.run_explicit(
        scene,
        until,
        safety=FRACTURE_SAFETY,
        records=60,
        frames=60,
        dtype="float32",
    ).checked()
    shape = (round(0.1 * m / delta), round(0.2 * m / delta))
    cracks = [
        deflection(
            np.asarray(run.X),
            shape,
            run.frames["damage"],
            run.frames["t"],
            tip=(0.05, y),
            delta=delta,
        )
        for y in (-0.025, 0.025)
    ]
    for crack in cracks:
        assert crack.angle == pytest.approx(64, abs=4)
        assert crack.times[1] == pytest.approx(47e-6, abs=1.5e-6)
        assert crack.v == pytest.approx(1770, rel=0.06)
    assert cracks[0].angle == pytest.approx(cracks[1].angle, abs=1.0)
    assert [crack.side for crack in cracks] == [-1, 1]
    assert np.abs(run.balance[5:]).max() < 1e-2
    # no crack from the far edge before 45 us
    rear = np.asarray(run.X)[:, 0] > 0.09
    assert run.frames["damage"][run.frames["t"] < 45e-6][:, rear].max() < 0.05


def test_float32_and_float64_break_the_same_bonds():
    damage = [
        jaxpd.run_explicit(
            branching_plate(3, 2e-3),
            30e-6,
            safety=FRACTURE_SAFETY,
            records=6,
            dtype=dtype,
        ).damage()
        for dtype in ("float32", "float64")
    ]
    assert (damage[1] > 0.3).sum() > 20
    differ = np.abs(damage[0] - damage[1]) > 1e-3
    assert differ.mean() < 1e-3
