"""Tools that measure cracks, on drawn cracks whose answers are known."""

import itertools

import numpy as np
import pytest

from jaxpd.crack_path import (
    branching,
    deflection,
    first_time,
    largest_speed,
    speed_between,
    tips,
)
from jaxpd.geometry import lattice

DX, DELTA = 0.25e-3, 1e-3
NOTCH, SPEED = 0.05, 1300.0
t = np.arange(7e-6, 43.2e-6, 0.5e-6)


def grid(lo, hi, dx=DX, nodes="cell"):
    cloud = lattice(lo, hi, dx, nodes=nodes)
    assert cloud.lattice is not None
    return np.asarray(cloud.X), cloud.lattice.shape


def line(X, *corners):
    """Distance of each point to a line of corners, and length along it [n] (m)."""
    corners = np.asarray(corners, float)
    best, where, before = np.full(len(X), np.inf), np.zeros(len(X)), 0.0
    for p, q in itertools.pairwise(corners):
        size = np.hypot(*(q - p))
        s = np.clip((X - p) @ (q - p) / size, 0.0, size)
        away = np.hypot(*(X - p - s[:, None] * (q - p) / size).T)
        where = np.where(away < best, before + s, where)
        best, before = np.minimum(best, away), before + size
    return best, where


def drawn(X, length, *corners, width=DELTA):
    """Damage [F, n] of a crack along a line of corners that has grown to `length`."""
    away, where = line(X, *corners)
    # nothing before the first corner
    band = np.where(where <= 0, 0.0, np.clip(0.6 - 0.5 * away / width, 0.0, 1.0))
    return np.where(where <= length[:, None], band * (away < width), 0.0)


def straight(X, v=SPEED):
    x = NOTCH + v * np.clip(t - 8e-6, 0, None)
    return drawn(X, x, (0, 0), (0.1, 0))


def forked(X, half, origin=0.065, v=SPEED):
    """A straight crack that divides at `origin` into two at +-`half` degrees."""
    x = NOTCH + v * np.clip(t - 8e-6, 0, None)
    rise = (0.1 - origin) * np.tan(np.radians(half))
    path = np.hypot(0.1 - origin, rise)
    both = []
    for s in (1, -1):
        grown = np.minimum(x, origin) + np.clip(x - origin, 0, None) * path / (
            0.1 - origin
        )
        both.append(drawn(X, grown, (0, 0), (origin, 0), (0.1, s * rise), width=0.6e-3))
    return np.maximum(*both)


PLATE = grid((0, -0.02), (0.1, 0.02))
STEEL = grid((0, -0.1), (0.1, 0.1), 1e-3)


@pytest.mark.parametrize("nodes", ["cell", "edge"])
def test_a_straight_band_has_its_speed_and_one_tip(nodes):
    X, shape = grid((0, -0.02), (0.1, 0.02), nodes=nodes)
    run = branching(X, shape, straight(X), t, notch_x=NOTCH, delta=DELTA)
    assert run.tips == 1
    assert np.isnan([run.xb, run.xe, run.tb, run.angle]).all()
    # a tip is the last point that the crack has passed: it lags by up to dx
    lag = DX / SPEED
    stations = np.array([NOTCH + DELTA, 0.06, 0.09])
    late = np.array([run.start, *run.times]) - 8e-6 - (stations - NOTCH) / SPEED
    assert (late > -0.1 * lag).all()
    assert (late < 1.5 * lag).all()
    np.testing.assert_allclose(run.v_mean, SPEED, rtol=2e-3)
    np.testing.assert_allclose(run.v_peak, SPEED, rtol=0.02)  # positions step by dx
    assert run.v_peak >= run.v_mean


@pytest.mark.parametrize(("half", "origin"), [(31, 0.065), (25, 0.0613)])
def test_a_fork_has_its_origin_and_angle(half, origin):
    X, shape = PLATE
    run = branching(
        X, shape, forked(X, half, origin), t, notch_x=NOTCH, delta=DELTA, until=35e-6
    )
    assert run.tips == 2
    np.testing.assert_allclose(run.xe, origin, rtol=0, atol=0.3e-3)
    np.testing.assert_allclose(run.angle, 2 * half, rtol=0, atol=1.0)
    assert origin < run.xb < origin + 4e-3
    lag = run.tb - 8e-6 - (run.xb - NOTCH) / SPEED
    assert abs(lag) < 1.5 * DX / SPEED


def test_a_twig_is_no_fork_and_loaded_edges_do_not_count():
    X, shape = PLATE
    twig = drawn(X, t * 0 + 0.002, (0.06, 0), (0.065, 0.003))
    torn = np.where(np.abs(X[:, 1]) > 0.017, 1.0, 0.0)
    phi = np.maximum(np.maximum(straight(X), twig), torn)
    run = branching(X, shape, phi, t, notch_x=NOTCH, delta=DELTA)
    assert (run.tips, np.isnan(run.xb)) == (1, True)
    np.testing.assert_array_equal(run.tip[-1], tips(X, shape, straight(X))[-1])
    assert tips(X, shape, phi, margin=0.0).min() > 0.0998


def test_notches_may_count_as_damage_and_fields_be_single_precision():
    X, shape = PLATE
    phi = straight(X)
    none = np.where(X[:, 0] > NOTCH, phi, 0.0)
    a = branching(X, shape, phi, t, notch_x=NOTCH, delta=DELTA)
    b = branching(X, shape, none, t, notch_x=NOTCH, delta=DELTA)
    single = np.asarray(X, np.float32), shape, np.asarray(phi, np.float32)
    c = branching(*single, t, notch_x=NOTCH, delta=DELTA)
    np.testing.assert_allclose([c.start, *c.times], [a.start, *a.times], rtol=1e-6)
    np.testing.assert_array_equal([a.start, *a.times], [b.start, *b.times])
    assert a.v_mean == b.v_mean


def test_a_crack_that_never_starts_has_no_tips_times_or_speeds():
    X, shape = PLATE
    run = branching(X, shape, straight(X, v=0.0), t, notch_x=NOTCH, delta=DELTA)
    assert run.tips == 0
    assert np.isnan([run.start, *run.times, run.v_mean, run.v_peak, run.xe]).all()


def test_a_threshold_that_nothing_passes_gives_nan():
    X, shape = PLATE
    kw = {"delta": DELTA, "threshold": 0.95}
    run = branching(X, shape, forked(X, 30), t, notch_x=NOTCH, **kw)
    assert run.tips == 0
    assert np.isnan([run.start, run.v_mean, run.v_peak, run.xe, run.angle]).all()
    X, shape = STEEL
    path = deflection(X, shape, bent(X, 65), T, tip=(NOTCH, 0.025), **kw)
    assert not path.radius.any()
    assert np.isnan([*path.times, path.v, path.angle, path.chord, path.first]).all()
    assert path.path.shape == (0, 2)


T = np.arange(0, 60e-6, 1e-6)
BIG = 3e-3  # horizon of the steel plate


def bent(X, angle, y=0.025, bend=45, v=1770.0):
    """From (NOTCH, y): 2 horizons at `bend` degrees, then at `angle`; the notch too.

    The sign of `angle` is the side to which it turns.
    """
    side = np.sign(angle)
    one = np.radians([side * bend, angle])
    steps = np.array([2 * BIG, 0.06])[:, None] * np.stack([np.cos(one), np.sin(one)], 1)
    corners = np.cumsum([(NOTCH, y), *steps], axis=0)
    grown = v * np.clip(T - 24e-6, 0, None)
    crack = drawn(X, grown, *corners, width=2e-3) * (grown > 0)[:, None]
    notch = drawn(X, T * 0 + 1, (0, y), (NOTCH, y), width=2e-3)
    return np.maximum(crack, notch)


@pytest.mark.parametrize("angle", [65, -65, 70, -58])
def test_a_bent_path_has_the_angle_of_its_straight_part(angle):
    X, shape = STEEL
    y = np.sign(angle) * 0.025
    run = deflection(X, shape, bent(X, angle, y), T, tip=(NOTCH, y), delta=BIG)
    assert run.side == np.sign(angle)
    np.testing.assert_allclose(run.angle, abs(angle), rtol=0, atol=1.0)
    # the path at 20 mm, by the law of cosines, from 2 horizons at 45 degrees
    turn, first = np.radians(abs(angle) - 45), 2 * BIG
    rest = np.sqrt(0.02**2 - (first * np.sin(turn)) ** 2) - first * np.cos(turn)
    rise = np.arctan2(rest * np.sin(turn), first + rest * np.cos(turn))
    np.testing.assert_allclose(run.chord, 45 + np.degrees(rise), rtol=0, atol=1.0)
    assert run.chord < run.first < run.angle
    np.testing.assert_allclose(run.v, 1770.0, rtol=0.02)
    # the radius is shorter than the path by at most what the bend cuts off
    late = run.times - 24e-6 - np.array([0.01, 0.04]) / 1770.0
    assert (np.abs(late) < 1e-6).all()
    away = np.hypot(*(run.path - (NOTCH, y)).T)
    np.testing.assert_allclose(np.diff(away), 1e-3, rtol=1e-9)
    assert (run.side * (run.path[:, 1] - y) > 0).all()


def test_directions_turn_with_the_notch():
    """The plate turned by a quarter: a notch that runs up."""
    X, shape = STEEL
    phi = bent(X, 65)
    turned = np.stack([-X[:, 1], X[:, 0]], 1)
    order = np.lexsort((turned[:, 1], turned[:, 0]))
    a = deflection(X, shape, phi, T, tip=(NOTCH, 0.025), delta=BIG)
    b = deflection(
        turned[order],
        shape[::-1],
        phi[:, order],
        T,
        tip=(-0.025, NOTCH),
        along=(0.0, 2.0),
        delta=BIG,
    )
    np.testing.assert_allclose(b.angle, a.angle, rtol=1e-9)
    np.testing.assert_allclose(b.path[:, ::-1] * (1, -1), a.path, rtol=1e-9)


def test_a_crack_straight_ahead_has_angle_zero():
    X, shape = STEEL
    run = deflection(X, shape, bent(X, 1e-9, bend=0), T, tip=(NOTCH, 0.025), delta=BIG)
    np.testing.assert_allclose([run.angle, run.chord], 0.0, rtol=0, atol=0.1)


def test_a_crack_from_the_rear_that_is_not_connected_is_ignored():
    X, shape = STEEL
    phi = bent(X, 65)
    rear = drawn(X, 500 * np.clip(T - 30e-6, 0, None), (0.1, 0.0), (0.06, 0.0))
    below = bent(X, -65, y=-0.025)
    a = deflection(X, shape, phi, T, tip=(NOTCH, 0.025), delta=BIG)
    b = deflection(
        X,
        shape,
        np.maximum.reduce([phi, rear, below]),
        T,
        tip=(NOTCH, 0.025),
        delta=BIG,
    )
    assert (rear > 0.35).any()
    np.testing.assert_array_equal(a.radius, b.radius)
    assert (a.angle, a.v, a.chord) == (b.angle, b.v, b.chord)


def test_times_and_speeds_of_a_staircase():
    t = np.linspace(0, 1, 11)
    p = np.array([np.nan, 0, 0, 1, 2, 3, 4, 6, 8, 10, 10.0])
    np.testing.assert_allclose(first_time(t, p, 0.5), 0.25)
    np.testing.assert_allclose(first_time(t, p, 10.0), 0.9)  # not later, on the flat
    assert np.isnan(first_time(t, p, 0.0))  # there before it was seen
    assert np.isnan(first_time(t, p, 11.0))
    np.testing.assert_allclose(speed_between(t, p, 1, 4), 10.0)
    np.testing.assert_allclose(speed_between(t, p, 4, 10), 20.0)
    assert np.isnan(speed_between(t, p, 4, 11))
    assert np.isnan(speed_between(t, p, 8, 10))  # a difference is no speed
    np.testing.assert_allclose(largest_speed(t, p, 0.2), 20.0)
    assert np.isnan(largest_speed(t, p, 0.1))
    assert np.isnan(largest_speed(t, p, 2.0))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"phi": np.zeros((3, 9))}, "phi"),
        ({"phi": np.zeros(16)}, "phi"),
        ({"phi": np.full((3, 16), np.nan)}, "phi"),
        ({"shape": (4, 5)}, "X, shape"),
        ({"X": np.zeros((16, 3))}, "X, shape"),
        ({"X": np.zeros((16, 2))}, "X"),
        ({"t": np.zeros(3)}, "t"),
        ({"t": np.arange(4.0)}, "t"),
        ({"threshold": 35}, "threshold"),
    ],
)
def test_what_is_no_field_of_a_lattice_is_refused_by_name(change, name):
    X, shape = grid((0, 0), (1, 1), 0.25)
    fields = {"X": X, "shape": shape, "phi": np.zeros((3, 16)), "t": np.arange(3.0)}
    for run, more in [
        (branching, {"notch_x": 0.5, "margin": 0.1}),
        (deflection, {"tip": (0.5, 0.5), "stations": (0.1, 0.9), "chord": 0.6}),
    ]:
        with pytest.raises(ValueError, match=f"^{name}: "):
            run(**fields | {"delta": 0.5} | more | change)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"tip": (5.0, 0.0)}, "tip"),
        ({"along": (0.0, 0.0)}, "along"),
        ({"fit": (0.01, 0.05)}, "fit"),
        ({"stations": (0.04, 0.01)}, "stations"),
        ({"chord": 0.002}, "chord"),
    ],
)
def test_radii_that_do_not_fit_are_refused_by_name(change, name):
    X, shape = STEEL
    fields = {"phi": np.zeros((2, len(X))), "t": [0, 1], "tip": (0, 0), "delta": BIG}
    with pytest.raises(ValueError, match=f"^{name}: "):
        deflection(X, shape, **fields | change)


def test_margin_and_window_are_refused_by_name():
    X, shape = PLATE
    with pytest.raises(ValueError, match=r"^margin: "):
        tips(X, shape, np.zeros((1, len(X))), margin=0.03)
    with pytest.raises(ValueError, match=r"^window: "):
        largest_speed([0, 1], [0, 1], 0)
