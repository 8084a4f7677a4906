"""Load steps again: derivatives through loading, unloading, reloading; fits."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, gradcheck

pytestmark = pytest.mark.usefixtures("compiled_quickly")
CYCLE = jaxpd.table([0, 1, 2, 3], [0, 1, -0.4, 1.3])


def directions(at, rng):
    """Changes of every number of the law, of the positions and of the conditions."""
    still = jax.tree.map(jnp.zeros_like, at)
    law, none = at["law"], still["law"]

    def along(name):
        if hasattr(none, name):
            return dataclasses.replace(none, **{name: getattr(law, name)})
        hard = dataclasses.replace(
            none.hardening, **{name: getattr(law.hardening, name)}
        )
        return dataclasses.replace(none, hardening=hard)

    names = ["E", "sigma_y", "h_iso", "h_kin"] + ["nu"] * (law.nu is not None)
    found = {name: still | {"law": along(name)} for name in names}
    X = at["X"]
    size = 0.1 * float(jnp.ptp(X[:, 0])) / len(X) ** (1 / X.shape[1])
    found["X"] = still | {"X": size * rng.normal(size=X.shape)}
    for name in ("prescribed", "load", "tau"):
        if np.abs(at[name]).max() > 0:
            found[name] = still | {name: at[name]}
    return found


def measure(params, replay, weights):
    frames, _ = replay.solve(params)
    return jnp.sum(weights * frames.u) + jnp.sum(frames.stress**2) / frames.stress.size


def slopes(scene, times, rng, mode):
    path = jaxpd.solve_path(scene, times, rtol=1e-13).checked()
    grown = np.diff(path.peeq.max(axis=1), prepend=0.0) > 0
    assert grown[0] or grown[:6].any()
    assert not grown.all()  # some steps unload
    replay = path.replay()
    frames, _ = replay.solve()
    np.testing.assert_allclose(frames.u, path.u, atol=1e-12 * np.abs(path.u).max())
    weights = rng.normal(size=frames.u.shape) * np.abs(path.stress).max() ** 2
    weights /= np.abs(path.u).max() * frames.u.size**0.5
    at = jax.tree.map(jnp.asarray, replay.params)
    return gradcheck.taylor(
        measure,
        at,
        directions(at, rng),
        replay,
        jnp.asarray(weights),
        mode=mode,
        steps=1e-3 * 0.5 ** np.arange(5),
        noise=1e-12,
    )


def test_a_bar_in_a_cycle_has_the_right_derivatives(rng):
    """Tension, compression, tension again; perturbations stay off the kinks."""
    scene = gallery.plastic_bar(7, strain=0.021, time=CYCLE, jitter=0.2)
    found = slopes(scene, np.arange(1, 13) / 4, rng, "reverse")
    assert set(found) == {"E", "sigma_y", "h_iso", "h_kin", "X", "prescribed"}
    for name, taylor in found.items():
        assert taylor.right, (name, taylor)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("state", "mode"), [("plane strain", "reverse"), ("plane stress", "forward")]
)
def test_bodies_in_a_cycle_have_the_right_derivatives(state, mode, rng):
    """Taylor slopes 2.00 +- 0.05 along every parameter, nodes included."""
    law = jaxpd.von_mises(2.1e5, 0.3, 240.0, 2e4, 1e4, state=state)
    if state == "plane strain":
        scene = gallery.pressed_ring((5, 7), 150.0, time=CYCLE, law=law)
    else:
        # 5 x 9 graded nodes are too few: half of the displacements alternate
        scene = gallery.plate_with_hole((7, 9), 0.002, time=CYCLE, law=law)
    found = slopes(scene, np.arange(1, 10) / 3, rng, mode)
    assert len(found) == 8
    for name, taylor in found.items():
        assert taylor.slope == np.inf or abs(taylor.slope - 2.0) < 0.05, (name, taylor)


@pytest.mark.slow
def test_forward_and_reverse_agree_and_vmap_maps():
    scene = gallery.plastic_bar(5, time=CYCLE)
    replay = jaxpd.solve_path(scene, [0.5, 1.0, 2.0, 3.0], rtol=1e-12).replay([3])
    at = jax.tree.map(jnp.asarray, replay.params)

    def stress(sigma_y, replay):
        hard = dataclasses.replace(at["law"].hardening, sigma_y=sigma_y)
        law = dataclasses.replace(at["law"], hardening=hard)
        return replay.solve(at | {"law": law})[0].stress[0, 0, 0]

    @jax.jit
    def look(s, replay):
        values = jax.vmap(lambda x: stress(x, replay))(s)
        return values, jax.grad(stress)(s[1], replay), jax.jacfwd(stress)(s[1], replay)

    values, back, forth = look(1e4 * jnp.array([0.999, 1.0, 1.001]), replay)
    assert float(back) == pytest.approx(float(forth), rel=1e-12)
    slope = (values[2] - values[0]) / 20.0
    assert float(back) == pytest.approx(float(slope), rel=1e-6)


@pytest.mark.slow
def test_second_derivatives_go_through_the_steps():
    scene = gallery.plastic_bar(5, strain=0.021, time=CYCLE)
    replay = jaxpd.solve_path(scene, [0.5, 1.0, 2.0, 3.0], rtol=1e-12).replay([3])
    law = replay.params["law"]

    def stress(E, replay):
        changed = replay.params | {"law": dataclasses.replace(law, E=E)}
        return replay.solve(changed)[0].stress[0, 0, 0]

    slope = jax.jit(jax.grad(stress))
    difference = (slope(1e6 + 1.0, replay) - slope(1e6 - 1.0, replay)) / 2.0
    found = jax.jit(jax.hessian(stress))(1e6, replay)
    assert float(found) == pytest.approx(float(difference), rel=1e-5)


@pytest.mark.slow
def test_yield_stress_and_both_hardenings_follow_from_a_cyclic_curve():
    """From the reactions of a bar in a cycle, noise free; 1e-3 is asked."""
    scene = gallery.plastic_bar(5, time=CYCLE)
    times = np.arange(1, 25) / 8
    replay = jaxpd.solve_path(scene, times, rtol=1e-12).replay()

    def curve(problem, params, frames):
        return frames.reaction[:, 0, 0]

    data = np.asarray(replay.solve()[0].reaction[:, 0, 0])
    seen = jaxpd.observe.observation(data, curve, 10.0)

    def place(name):
        def put(params, value):
            law = params["law"]
            if name == "h_kin":
                return params | {"law": dataclasses.replace(law, h_kin=value)}
            hard = dataclasses.replace(law.hardening, **{name: value})
            return params | {"law": dataclasses.replace(law, hardening=hard)}

        return put

    start = {"sigma_y": 8e3, "h_iso": 3e4, "h_kin": 1e4}
    sought = {k: jaxpd.inverse.positive(v, place(k)) for k, v in start.items()}
    found = jaxpd.fit(replay, sought, seen).checked()
    exact = {"sigma_y": 1e4, "h_iso": 5e4, "h_kin": 5e3}
    for name, value in exact.items():
        assert found.values[name] == pytest.approx(value, rel=1e-4), found
