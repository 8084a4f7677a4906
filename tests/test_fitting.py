"""Fitting and its uncertainty: exact data, noise, blindness, restarts, refusals."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

import jaxpd
from jaxpd.fitting import fit
from jaxpd.inverse import Inverse, Penalty, Variable, bounded, free, positive, smooth
from jaxpd.observe import displacements, observation, openings, reaction_curve
from jaxpd.resample import ensemble, refit
from jaxpd.uncertainty import laplace

pytestmark = pytest.mark.usefixtures("compiled_quickly")
CRACK = jaxpd.segment((-0.15, 0.0), (0.15, 0.0))
TOP, BOTTOM = jaxpd.above(y=0.5), jaxpd.below(y=-0.5)
E, ALPHA = 30e9, 0.7


def plate(kinematics="small", **changes):
    """A cracked plate that is pulled by given forces."""
    scene = jaxpd.Scene(
        body=jaxpd.box((-0.5, -0.5), (0.5, 0.5)),
        material=jaxpd.Elastic(E, nu=1 / 3, state="plane stress"),
        supports=[jaxpd.holds(BOTTOM)],
        loads=[jaxpd.pull(jaxpd.above(y=0.4), x=2e5, y=1e6)],
        cracks=[CRACK],
        resolution=jaxpd.Bonds(dx=1 / 8, m=3.3, kernel=jaxpd.fractional(ALPHA)),
        kinematics=kinematics,
    )
    return dataclasses.replace(scene, **changes)


MOVED = {"supports": [jaxpd.holds(BOTTOM), jaxpd.moves(TOP, x=0, y=1e-3)], "loads": []}


@functools.cache
def problem(moved=False, kinematics="small"):
    scene = plate(kinematics, **(MOVED if moved else {}))
    return jaxpd.prepare(scene, rtol=1e-11)


@functools.cache
def measured(moved=False, kinematics="small"):
    u, info = problem(moved, kinematics).solve()
    assert int(info.status) == 0
    return np.asarray(u)


def noisy(rng, share=0.01):
    u = measured()
    sigma = share * abs(u).max()
    return u + sigma * rng.normal(size=u.shape), sigma


def both():
    return {"E": positive(0.4 * E), "alpha": bounded(-0.5, -3.0, 1.95)}


def test_a_scalar_from_exact_data():
    """Displacements under given forces see the micromodulus: 1e-6 within 30 steps."""
    found = fit(problem(), {"E": positive(0.4 * E)}, [displacements(measured())])
    assert found.reason == "converged"
    assert found.steps <= 30
    assert abs(found.values["E"] / E - 1) < 1e-6  # measured: 3e-13
    assert (np.diff(found.losses) < 0).all()
    assert found.path["E"][0] == pytest.approx(0.4 * E)
    assert found.params["E"] == pytest.approx(E)
    assert "converged" in repr(found)


def test_the_order_of_the_kernel_from_exact_data():
    found = fit(problem(), both(), [displacements(measured())])
    assert abs(found.values["alpha"] - ALPHA) < 1e-4  # measured: 3e-9
    assert abs(found.values["E"] / E - 1) < 1e-6


def test_adam_finds_the_same_more_slowly():
    found = fit(
        problem(),
        {"E": positive(0.7 * E)},
        [displacements(measured())],
        method="adam",
        steps=150,
    )
    assert abs(found.values["E"] / E - 1) < 1e-2
    assert found.losses[-1] < 1e-3 * found.losses[0]


@pytest.mark.slow
def test_prescribed_displacements_do_not_see_the_scale(rng):
    u = measured(moved=True)
    seen = displacements(u + 1e-6 * rng.normal(size=u.shape), 1e-6)
    found = fit(problem(moved=True), both(), [seen])
    sure = laplace(found)
    assert not sure.identifiable
    np.testing.assert_allclose(sure.blind, [[1.0, 0.0]], atol=1e-6)
    assert "not identifiable from these data: +1.00 E" in str(sure)
    assert np.isinf(sure.high["E"])
    assert sure.low["alpha"] < ALPHA < sure.high["alpha"]
    with pytest.raises(ValueError, match="not identifiable"):
        ensemble(found)


@pytest.mark.slow
def test_a_measured_force_makes_the_scale_visible(rng):
    u = measured(moved=True)
    seen = displacements(u + 1e-6 * rng.normal(size=u.shape), 1e-6)
    pr = problem(moved=True)
    held = np.asarray(pr.reaction(u))[TOP.contains(np.asarray(pr.X)), 1]
    pull = reaction_curve(pr, TOP, 1, [1.0], [held.sum()], 0.01 * held.sum())
    cured = laplace(fit(pr, both(), [seen, pull]))
    assert cured.identifiable
    assert cured.low["E"] < E < cured.high["E"]


@pytest.mark.slow
def test_curves_openings_and_a_users_own_quantity():
    """Newton at two load factors; an observation is a pure function."""
    pr, u = problem(True, "finite"), measured(True, "finite")
    scaled = {k: 0.5 * pr.params[k] for k in ("load", "prescribed")}
    half = pr.solve(pr.params | scaled)[0]
    at_top = TOP.contains(np.asarray(pr.X))
    curve = [
        float(np.asarray(pr.reaction(v, p))[at_top, 1].sum())
        for v, p in ((half, pr.params | scaled), (u, pr.params))
    ]
    solution = jaxpd.solve_static(plate("finite", **MOVED), rtol=1e-10)
    wide = [solution.opening(CRACK, t) for t in (0.3, 0.5)]

    def stored(problem, params, u):
        return jnp.sum(problem.energy(u, params))

    seen = (
        reaction_curve(pr, TOP, 1, [0.5, 1.0], curve, 1e-3 * curve[1]),
        openings(pr, CRACK, [0.3, 0.5], wide, 1e-6),
        observation(float(stored(pr, pr.params, u)), stored, 1e-2),
    )
    inverse = Inverse(pr, both(), seen)
    truth = {
        "E": jnp.log(1 / 0.4),
        "alpha": jax.scipy.special.logit((ALPHA + 3) / 4.95)
        - jax.scipy.special.logit(2.5 / 4.95),
    }
    r, start = jax.jit(jax.vmap(Inverse.residuals, in_axes=(None, 0)))(
        inverse, jax.tree.map(lambda z: jnp.stack([z, 0 * z]), truth)
    )
    assert r.shape == (5,)
    np.testing.assert_allclose(r, 0.0, atol=2e-4)  # in sigma
    assert (np.abs(start) > 1.0).all()


def test_missing_points_say_nothing(rng):
    data, sigma = noisy(rng)
    gaps = data.copy()
    gaps[::3] = np.nan
    gaps[1, 0] = np.nan
    inverse = Inverse(problem(), both(), (displacements(gaps, sigma),))
    assert inverse.count == np.isfinite(gaps).sum()
    look = jax.jit(Inverse.residuals)
    r = look(inverse, inverse.start()).reshape(gaps.shape)
    assert (np.asarray(r)[np.isnan(gaps)] == 0).all()
    some = np.flatnonzero(np.isfinite(gaps).all(axis=1))
    fewer = Inverse(problem(), both(), (displacements(gaps[some], sigma, some),))
    np.testing.assert_array_equal(look(fewer, fewer.start()), r[some].ravel())


@pytest.mark.slow
def test_intervals_by_curvature_and_by_an_ensemble_agree(rng):
    data, sigma = noisy(rng)
    found = fit(problem(), both(), [displacements(data, sigma)])
    sure = laplace(found)
    drawn, values = ensemble(found, 50, iterations=3)  # two batches
    for name, truth in (("E", E), ("alpha", ALPHA)):
        assert sure.low[name] < truth < sure.high[name]
        assert values[name].shape == (50,)
    # 50 draws know a standard deviation to 10 %
    np.testing.assert_allclose(drawn.deviation, sure.deviation, rtol=0.3)
    # noise that is not known is estimated
    unknown = fit(problem(), both(), [displacements(data)])
    guess = laplace(unknown)
    scale = float(unknown.inverse.observations[0].sigma[0, 0])
    assert guess.noise[0] * scale == pytest.approx(sigma, rel=0.15)
    np.testing.assert_allclose(guess.deviation, sure.deviation, rtol=0.2)


@pytest.mark.slow
def test_coverage_of_the_intervals():
    """Of 200 seeded repeats 90 to 98 % hold the truth, for each of two scalars."""
    rng, (u, sigma) = (
        np.random.default_rng(1),
        (measured(), 0.02 * abs(measured()).max()),
    )
    repeats = 200
    data = u + sigma * rng.normal(size=(repeats, *u.shape))
    guess = {"E": positive(0.9 * E), "alpha": bounded(0.5, -3.0, 1.95)}
    inverse = jax.device_put(Inverse(problem(), guess, (displacements(u, sigma),)))
    z, covariance, _ = refit(inverse, inverse.start(), (data,), iterations=5)
    deviation = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    share = (0.5 + 3.0) / 4.95
    truth = [np.log(1 / 0.9), np.log((ALPHA + 3) / (1.95 - ALPHA) * (1 / share - 1))]
    held = (np.abs(np.asarray(z) - truth) <= 1.959964 * deviation).mean(axis=0)
    assert ((held >= 0.90) & (held <= 0.98)).all(), held


@pytest.mark.slow
def test_a_field_is_found_through_a_users_variable_and_penalty(rng):
    """Two halves of a plate, by a user's `place`; a penalty pulls them together."""
    pr = problem()
    upper = np.asarray(pr.X)[:, 1] > 0
    fields = lambda p, v: p | {"E": jnp.where(upper, v[0], v[1])}  # noqa: E731
    data, _ = pr.solve(fields(pr.params, np.array([E, 0.5 * E])))
    seen = [displacements(np.asarray(data), 1e-3 * abs(np.asarray(data)).max())]
    halves = {"halves": Variable(np.full(2, 0.7 * E), positive(1.0).value, fields)}
    found = fit(pr, halves, seen)
    np.testing.assert_allclose(found.values["halves"], [E, 0.5 * E], rtol=1e-5)

    def apart(z, weight):
        return weight * (z["halves"][0] - z["halves"][1]) ** 2

    alike = fit(pr, halves, seen, [Penalty(1e9, apart)])
    assert alike.values["halves"][0] / alike.values["halves"][1] < 1.01


def test_smoothing_counts_slopes_whatever_the_lattice():
    """A slope of 1 over the unit square costs 1/2, or its total variation of 1."""
    for n in (8, 16):
        scene = plate(
            resolution=jaxpd.Bonds(dx=1 / n, m=3, nodes="cell", layers=((0, 0), (0, 0)))
        )
        pr = jaxpd.prepare(
            dataclasses.replace(scene, supports=[jaxpd.holds(jaxpd.below(y=-0.4))])
        )
        z = {"E": jnp.asarray(pr.X[:, 0])}
        plain, sharp = smooth(pr, "E", 1.0), smooth(pr, "E", 1.0, edges=1e-3)
        # the links at the ends of rows are counted by other near points: O(1/n)
        assert float(plain.cost(z, plain.numbers)) == pytest.approx(0.5, rel=2 / n)
        assert float(sharp.cost(z, sharp.numbers)) == pytest.approx(1.0, rel=2 / n)
        flat = {"E": jnp.zeros(len(pr.X))}
        slope = jax.grad(lambda z, s=sharp: s.cost(z, s.numbers))(flat)["E"]
        assert (np.asarray(slope) == 0).all()


@pytest.mark.parametrize("method", ["lbfgs", "adam"])
def test_a_fit_goes_on_where_it_was_cut_off(tmp_path, method):
    seen, file = [displacements(measured())], tmp_path / "fit.npz"
    whole = fit(problem(), both(), seen, method=method, steps=8)
    fit(problem(), both(), seen, method=method, steps=3, checkpoint=file)
    rest = fit(problem(), both(), seen, method=method, steps=8, checkpoint=file)
    np.testing.assert_array_equal(rest.losses, whole.losses)
    for name in whole.z:
        np.testing.assert_array_equal(rest.z[name], whole.z[name])
        np.testing.assert_array_equal(rest.path[name], whole.path[name])
    others = [
        ({"E": positive(E)}, seen),
        (both() | {"E": positive(0.5 * E)}, seen),
        (both(), [displacements(2 * measured())]),
    ]
    for variables, data in others:
        with pytest.raises(ValueError, match="delete it or name another"):
            fit(problem(), variables, data, method=method, checkpoint=file)
    file.write_bytes(b"nonsense")
    with pytest.raises(ValueError, match="no state of jaxpd"):
        fit(problem(), both(), seen, method=method, checkpoint=file)


def test_a_fit_of_a_solve_that_fails_says_so(tmp_path):
    """And keeps nothing: with the cure, the same file serves."""
    linear = dataclasses.replace(problem().linear, maxiter=2)
    broken = dataclasses.replace(problem(), linear=linear)
    seen, file = [displacements(measured())], tmp_path / "fit.npz"
    found = fit(broken, both(), seen, checkpoint=file)
    assert found.reason == "failed"
    assert np.isinf(found.losses[0])
    assert not file.exists()
    with pytest.raises(ValueError, match="failed after 0 steps"):
        laplace(found)
    with pytest.raises(ValueError, match="MAX_ITERATIONS, and of the observations 198"):
        found.checked()


@pytest.mark.slow
def test_a_far_start_arrives(rng):
    """A gradient may be small beside the first one and the fit far from its end."""
    u = measured() + 1e-9 * rng.normal(size=measured().shape)
    seen = [displacements(u, 1e-9)]
    found = fit(problem(), {"E": positive(1e-3 * E)}, seen)
    sure = laplace(found)
    assert sure.low["E"] < E < sure.high["E"]
    assert sure.misfit == pytest.approx(1.0, abs=0.3)
    early = fit(problem(), {"E": positive(0.4 * E)}, seen, steps=3)
    with pytest.raises(ValueError, match="standard deviations from its minimum"):
        laplace(early)


def test_a_transformation_of_optax_may_be_the_users_own():
    own = optax.chain(optax.clip(1.0), optax.adam(0.1))
    seen = [displacements(measured())]
    found = fit(problem(), {"E": positive(0.7 * E)}, seen, method=own, steps=60)
    assert abs(found.values["E"] / E - 1) < 0.05


@pytest.mark.slow
def test_blindness_of_a_field_and_noise_of_two_kinds(rng):
    pr, u = problem(moved=True), measured(moved=True)
    sigma = 1e-3 * abs(u).max()
    data = u + sigma * rng.normal(size=u.shape)
    field = {"E": positive(np.full(len(u), E))}
    seen, flat = displacements(data, sigma), smooth(pr, "E", 10.0)
    one = laplace(fit(pr, field, seen, flat, steps=500))
    assert not one.identifiable
    assert np.isinf(one.high["E"]).all()
    assert "E[" in str(one)
    # a force known to 10 % is made no sharper by displacements of unknown noise
    held = np.asarray(pr.reaction(u))[TOP.contains(np.asarray(pr.X)), 1].sum()
    pull = reaction_curve(pr, TOP, 1, [1.0], [1.1 * held], 0.1 * held)
    mixed = fit(pr, {"E": positive(E)}, [displacements(data), pull])
    sure = laplace(mixed)
    assert sure.deviation[0] == pytest.approx(0.1 / 1.1, rel=0.05)
    assert sure.noise[1] == 1.0
    scale = float(mixed.inverse.observations[0].sigma[0, 0])
    assert sure.noise[0] * scale == pytest.approx(sigma, rel=0.15)


def test_transforms_start_where_they_are_told():
    z = jnp.zeros(3)
    for variable in (
        positive([1.0, 2.0, 3.0]),
        bounded([0.1, 0.5, 0.9], 0.0, 1.0),
        free([-1.0, 0.0, 1.0], 10.0),
    ):
        value = variable.value(z, variable.start)
        np.testing.assert_allclose(value, variable.start, rtol=1e-15, atol=1e-16)
        far = variable.value(z + 30.0, variable.start)
        assert (np.asarray(far) > np.asarray(variable.start)).all()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: positive(-1.0), "start: -1.0 must be positive"),
        (lambda: bounded(2.0, 0.0, 1.0), "start: 2.0 must lie between"),
        (lambda: free(2.0, 0.0), "scale: 0.0"),
        (lambda: displacements(np.full((3, 2), np.nan)), "data: of 6 numbers 0"),
        (lambda: displacements([[1.0, np.inf]]), "1 infinite"),
        (lambda: displacements(np.ones((3, 2)), -1.0), "sigma: all must be positive"),
        (lambda: displacements(np.ones((3, 2)), np.ones(3)), "sigma: shape"),
        (lambda: displacements(np.ones((1, 2)), 1.0, [-1]), "points: "),
        (lambda: displacements(np.ones((2, 2)), 1.0, [1]), "points: there are 1"),
        (lambda: displacements(np.ones((1, 2)), 1.0, [0.5]), "points: "),
        (lambda: observation([1.0], print, 1.0, [0.5, 1.0]), "a row for each"),
        (lambda: fit(problem(), both(), []), "at least one"),
        (
            lambda: fit(problem(), {"c": positive(1.0)}, [displacements(measured())]),
            "variables: 'c' is no parameter",
        ),
        (
            lambda: fit(problem(), both(), [displacements(measured())], method="sgd"),
            "method: 'sgd'",
        ),
        (
            lambda: fit(
                problem(), {"E": positive(np.ones(5))}, [displacements(measured())]
            ),
            "variables: 'E' \\(5,\\) must be",
        ),
        (
            lambda: fit(
                problem(), {"delta": positive(0.3)}, [displacements(measured())]
            ),
            "variables: 'delta' may reach inf by the rule 'linear'",
        ),
        (
            lambda: fit(
                problem(),
                {"E": Variable(1.0, lambda z, start: start + jnp.ones(3) * z)},
                [displacements(measured())],
            ),
            "belongs into `place`",
        ),
        (
            lambda: fit(
                problem(), both(), [displacements(measured())], checkpoint="no/where"
            ),
            "there is no folder no",
        ),
        (
            lambda: fit(
                problem(),
                both(),
                [displacements(measured())],
                [smooth(problem(), "E", 1.0)],
            ),
            "name: 'E' is sought as no field",
        ),
        (
            lambda: fit(problem(), both(), [displacements(measured())], steps=0),
            "steps: 0",
        ),
        (
            lambda: fit(problem(), both(), [displacements(measured()[:-1])]),
            "predict: it gives",
        ),
        (
            lambda: reaction_curve(problem(), jaxpd.above(y=0.2), 1, [1.0], [1.0]),
            "region: no point that is prescribed",
        ),
        (
            lambda: reaction_curve(problem(), BOTTOM, "y", [1.0], [1.0]),
            "axis: 'y' must be one of 0 .. 1",
        ),
        (
            lambda: fit(problem(), {"E": 1e9}, [displacements(measured())]),
            "float is no",
        ),
        (lambda: fit(problem(), both(), measured()), "ndarray is no Observation"),
        (lambda: smooth(problem(), "E", -1.0), "weight: -1.0"),
        (lambda: smooth(problem(), "E", 1.0, edges=0.0), "edges: 0.0"),
    ],
)
def test_bad_requests_are_refused(call, says):
    with pytest.raises(ValueError, match=says):
        call()
