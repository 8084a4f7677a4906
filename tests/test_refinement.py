"""Convergence of scenes: orders that are known, and those that are not stated."""

import dataclasses
import math

import numpy as np
import pytest

import jaxpd
from jaxpd import gallery
from jaxpd.convergence import Refinement
from tests.manufactured import off


def rows(values, dx=None, exact=None):
    dx = tuple(0.5**k for k in range(len(values))) if dx is None else dx
    k = len(values)
    return Refinement(
        "h", dx, (math.nan,) * k, (0,) * k, tuple(values), (0.0,) * k, exact
    )


@pytest.mark.parametrize("p", [0.5, 1.0, 2.0, 3.3])
@pytest.mark.parametrize("dx", [(1, 0.5, 0.25), (1, 0.7, 0.4), (1.0, 0.9, 0.3, 0.2)])
def test_the_order_of_a_power_is_found(p, dx):
    found = rows([2.0 + 0.3 * h**p for h in dx], dx)
    assert found.order == pytest.approx(p, rel=1e-6)
    assert found.limit == pytest.approx(2.0, rel=1e-9)
    assert found.error == pytest.approx(1.25 * 0.3 * dx[-1] ** p, rel=1e-6)
    known = rows([2.0 + 0.3 * h**p for h in dx], dx, exact=2.0)
    np.testing.assert_allclose(known.orders[1:], p, rtol=1e-9)
    assert known.converged(2 * 0.15 * dx[-1] ** p)
    assert not known.converged(0.1 * 0.15 * dx[-1] ** p)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ([1.0, 1.2, 1.1, 1.15], "to and fro"),
        ([1.0, 1.1, 1.3, 1.7], "do not shrink"),
        ([1.0, 1.0, 1.0], "does not change"),
        ([1.0, 1.1], "two levels tell no order"),
    ],
)
def test_no_order_is_stated_where_there_is_none(values, words):
    found = rows(values)
    assert found.order is None
    assert found.limit is None
    assert not found.converged(1.0)
    assert words in str(found)


def sine(X):
    return np.sin(np.pi * X[:, 0]) / np.pi**2


def half_wave(X):
    return np.sin(np.pi * X[:, 0])


def bar(beyond=None, **resolution):
    """Under a load of half a wave: u = sine, and beyond the ends what is prescribed."""
    ends = [jaxpd.below(x=0.0), jaxpd.above(x=1.0)]
    return jaxpd.Scene(
        body=jaxpd.box((0.0,), (1.0,)),
        material=jaxpd.Elastic(1.0, state="bar"),
        supports=[jaxpd.moves(end, x=beyond or 0.0) for end in ends],
        loads=[jaxpd.body_force(jaxpd.box((0.0,), (1.0,)), x=half_wave)],
        resolution=jaxpd.Bonds(dx=1 / 16, **resolution),
        kinematics="small",
    )


def largest(solution):
    return float(np.asarray(solution.u).max())


@pytest.mark.parametrize(("beyond", "order"), [(None, 1.0), (sine, 2.0)])
def test_a_bar_converges_to_the_classical_one(beyond, order):
    """With the horizon where it is held still beyond its ends, else with its square."""
    scene = bar(beyond, m=3, calibration="lattice", correction="none")
    found = jaxpd.refine(scene, quantity=largest, exact=1 / np.pi**2)
    assert found.what == "delta"
    np.testing.assert_allclose(np.array(found.delta) / found.dx, 3.0)
    assert found.order == pytest.approx(order, abs=0.1)
    assert found.converged(0.1 if order == 1.0 else 1e-3)


def test_a_bar_with_a_fixed_horizon_converges_to_the_nonlocal_one():
    scene = bar(delta=0.25, correction="none", kernel=jaxpd.constant())
    found = jaxpd.refine(scene, "m", quantity=largest, levels=5)
    assert set(found.delta) == {0.25}
    assert 0.9 < found.order < 2.6
    # and not to the classical one: the horizon is a quarter of the bar
    assert abs(found.limit * np.pi**2 - 1.0) > 10 * found.error * np.pi**2


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_kernels_converge_on_a_smooth_field():
    def error(n):
        wrong, exact = off(jaxpd.RKPM(), n)
        return float(np.linalg.norm(wrong) / np.linalg.norm(exact))

    sizes = (9, 13, 17)
    values = tuple(error(n) for n in sizes)
    found = rows(values, tuple(1 / (n - 1) for n in sizes), exact=0.0)
    assert found.order > 2.5


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_a_function_of_the_spacing_refines_bodies_of_nodes():
    def make(h):
        n = round(1 / h)
        return gallery.cantilever((2 * n + 1, n + 1))

    tip = gallery.cantilever_exact(np.array([[2.0, 0.0]]))[0, 1]

    def deflection(solution):
        X = np.asarray(solution.X)
        return float(solution.u[np.argmin(np.abs(X - [2.0, 0.0]).sum(1)), 1])

    found = jaxpd.refine(
        make, quantity=deflection, exact=float(tip), sizes=[1 / 4, 1 / 8]
    )
    assert found.what == "h"
    assert found.order > 1.5
    assert "error" in found.verdict


def test_cracks_that_jump_are_told():
    scene = gallery.cracked_plate(20, 3, kinematics="small")
    found = jaxpd.refine(scene, levels=2)
    assert "midway between rows" in str(found)


@pytest.mark.slow
def test_the_crack_of_a_plate_converges_to_the_classical_opening():
    """At 0.15 n = k + 1/2; to 1.006 of the classical one, which m = 4 leaves."""

    def make(h):
        return gallery.cracked_plate(round(1 / h), 4, kinematics="small")

    def opening(solution):
        return solution.opening(gallery.CRACK) / 1e-3

    found = jaxpd.refine(
        make, quantity=opening, sizes=[1 / 30, 1 / 50, 1 / 90, 1 / 130]
    )
    assert found.order == pytest.approx(1.1, abs=0.4)
    assert found.limit / gallery.CLASSICAL_OPENING == pytest.approx(1.006, abs=0.006)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"what": "h"}, "what: 'h' must be one of"),
        ({"ratio": 1.0}, "ratio: 1.0 must be a number above 1"),
        ({"levels": 1}, "levels: 1 must be a whole number, at least 2"),
        ({"sizes": [0.1, 0.2]}, "sizes: .* must be two or more, positive and falling"),
        ({"ratio": 1.01}, "the same lattice twice"),
        ({"quantity": lambda s: float("nan")}, "quantity: nan must .* at dx"),
    ],
)
def test_what_cannot_be_refined_is_refused(change, words):
    with pytest.raises(ValueError, match=words):
        jaxpd.refine(bar(m=3), **change)


def test_bodies_that_cannot_be_refined_are_refused():
    with pytest.raises(ValueError, match="give a function of the spacing"):
        jaxpd.refine(gallery.cantilever())
    with pytest.raises(ValueError, match="sizes: None"):
        jaxpd.refine(lambda h: bar(m=3))
    left = dataclasses.replace(bar(m=3), resolution=jaxpd.Bonds(m=3))
    with pytest.raises(ValueError, match="needs a spacing dx"):
        jaxpd.refine(left)
