"""Derivatives of runs in time, and where the two conventions for breaking are wrong."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.gradcheck import taylor
from jaxpd.launch import longest_dt

pytestmark = pytest.mark.usefixtures("compiled_quickly")
RECORDS, EVERY = 25, 40  # 1000 steps


def plate(**more):
    """A plate that is pulled at one end and flies at the other."""
    material = jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress", rho=1.0, **more)
    return jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (1.0, 0.5)),
        material=material,
        supports=[jaxpd.drives(jaxpd.below(x=0.15), x=-2e-3)],
        starts=[jaxpd.initially(jaxpd.above(x=0.7), vx=3e-3)],
        resolution=jaxpd.Bonds(
            dx=0.1, m=2, kernel=jaxpd.fractional(-0.5), nodes="cell"
        ),
    )


def end(params, motion, *, dt, records=RECORDS):
    """A scalar of the state at the end and of what was passed on the way."""
    u, v, seen = motion.march(
        params, dt=dt, every=EVERY, records=records, measure=squares
    )
    x = jnp.arange(u.size, dtype=u.dtype).reshape(u.shape) / u.size
    return 1e3 * jnp.sum(jnp.sin(x * 7) * (u + v)) + 1e4 * jnp.sum(seen)


def squares(u, v):
    return jnp.sum(u[::5] ** 2)


def directions(motion, names, rng):
    found = {}
    for name in names:
        at = {k: jnp.zeros_like(x) for k, x in motion.params.items()}
        p = np.asarray(motion.params[name])
        size = np.abs(p).max() or 1e-3
        at[name] = jnp.asarray(size * rng.normal(size=p.shape))
        found[name] = at
    return found


def check(motion, names, rng, records=RECORDS, **options):
    at = jax.tree.map(jnp.asarray, motion.params)
    dt = 0.5 * longest_dt(motion)
    function = partial(end, dt=dt, records=records)
    along = directions(motion, names, rng)
    found = taylor(function, at, along, motion, **options)
    for name, test in found.items():
        assert test.slope == pytest.approx(2.0, abs=0.05), f"{name}\n{test!s}"
        assert test.derivative != 0.0


def uneven(rng, **options):
    motion = jaxpd.prepare_motion(plate(), **options)
    E = rng.uniform(0.8, 1.2, len(motion.X))
    return dataclasses.replace(motion, params=motion.params | {"E": E})


def test_taylor_slopes_are_2(rng):
    steps = 0.02 * 0.5 ** np.arange(4)
    check(uneven(rng), ("E", "alpha", "v0", "prescribed"), rng, records=5, steps=steps)


@pytest.mark.slow
def test_taylor_slopes_are_2_through_a_thousand_steps(rng):
    steps = 0.02 * 0.5 ** np.arange(6)
    names = ("E", "alpha", "u0", "v0", "prescribed", "rho")
    check(uneven(rng), names, rng, steps=steps)


@pytest.mark.slow
def test_taylor_slopes_of_a_cloud_are_2(rng):
    motion = uneven(rng, operator="slots")
    check(motion, ("E", "alpha", "v0"), rng, steps=0.02 * 0.5 ** np.arange(6))


def along_G0(motion):
    at = jax.tree.map(jnp.asarray, motion.params)
    return at, {"G0": {k: jnp.zeros_like(x) for k, x in at.items()} | {"G0": at["G0"]}}


@pytest.fixture(scope="module")
def smoothed():
    """Motion where many bonds fail by the smoothed law, its step, its Taylor test.

    The largest stretch of a bond moves from step to step: kinks, far apart.
    """
    soft = jaxpd.prepare_motion(plate(G0=8e-6), softening=0.5)
    dt = 0.5 * longest_dt(soft)
    at, up = along_G0(soft)
    steps = np.concatenate([1e-3 * 0.5 ** np.arange(2), 2e-4 * 0.5 ** np.arange(5)])
    return soft, dt, taylor(partial(end, dt=dt), at, up, soft, steps=steps)["G0"]


@pytest.mark.slow
def test_the_smoothed_law_has_a_derivative_in_the_fracture_energy(smoothed):
    soft, dt, found = smoothed
    assert found.slope == pytest.approx(2.0, abs=0.05), str(found)
    assert found.derivative != 0.0
    run = jaxpd.run_explicit(soft, 1000 * dt, dt=dt, records=1)
    assert (run.damage() > 0.01).sum() > 5


@pytest.mark.slow
def test_frozen_damage_and_the_smoothed_law_are_each_wrong_somewhere(smoothed):
    hard = jaxpd.prepare_motion(plate(G0=4e-6))
    soft = jaxpd.prepare_motion(plate(G0=4e-6), softening=0.5)
    at, up = along_G0(hard)
    function = partial(end, dt=0.5 * longest_dt(hard))
    # frozen: the derivative in G0 is 0, while a change of 20 % breaks other bonds
    frozen = taylor(function, at, up, hard, steps=np.array([0.4, 0.2]))["G0"]
    assert frozen.derivative == 0.0
    run = jax.jit(function)
    value, smooth = (float(run(at, motion)) for motion in (hard, soft))
    assert frozen.remainders.min() > 1e-3 * abs(value)  # measured 1e-2
    # smoothed: the derivative is right, but of a run that is not the brittle one
    assert abs(smooth - value) > 1e-2 * abs(value)  # measured 3e-2
    # and where many bonds fail it is right in a small neighbourhood alone
    _, _, found = smoothed
    np.testing.assert_array_equal(found.steps[[0, 1, 3, 4]], [1e-3, 5e-4, 1e-4, 5e-5])
    assert abs(found.slopes[0] - 2.0) > 0.2
    assert found.slopes[3] == pytest.approx(2.0, abs=0.05)


@pytest.mark.slow
def test_a_derivative_needs_the_memory_of_the_square_root_of_the_steps():
    motion = jaxpd.prepare_motion(plate())
    at = jax.tree.map(jnp.asarray, motion.params)

    def peak(steps, every):
        def loss(params, motion):
            u, _, _ = motion.march(params, dt=1e-2, every=every, records=steps // every)
            return jnp.sum(u**2)

        compiled = jax.jit(jax.grad(loss)).lower(at, motion).compile()
        return compiled.memory_analysis().temp_size_in_bytes

    root, plain = peak(1600, 40), peak(1600, 1600)
    state = motion.X.nbytes
    assert root < 0.25 * plain
    assert plain > 1600 * state
