"""Load steps: paper 001's bars, cycles, halving, resumption, what is refused."""

import dataclasses
import os
import signal
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import compiling, gallery
from jaxpd.geometry import mapped
from jaxpd.solvers.status import NotConverged, Status

E, SIGMA_Y, H_ISO, H_KIN = gallery.YOON
END = jaxpd.below(x=0.0)


def bar_stress(strain):
    return np.where(
        strain < 0.01, E * strain, SIGMA_Y + gallery.YOON_MODULUS * (strain - 0.01)
    )


@pytest.mark.parametrize(
    ("jitter", "resolution"),
    [(0.0, gallery.PAPER), (0.45, gallery.PAPER), (0.45, jaxpd.MLS())],
)
def test_the_bar_of_the_paper_is_exact_at_every_step(jitter, resolution):
    """Paper 001, Fig. 2 to 4: fewer than 5 iterations, L2 error below 1e-10.

    Its own form amplifies round-off where nodes are moved by 45 %; the default hardly.
    """
    t = np.arange(1, 401)[::8] / 400
    path = jaxpd.solve_path(
        gallery.plastic_bar(jitter=jitter, seed=1, resolution=resolution), t
    ).checked()
    strain = 0.02 * t
    exact = strain[:, None] * path.X[None, :, 0]
    error = np.linalg.norm(path.u[:, :, 0] - exact, axis=1)
    bound = 1e-10 if resolution == gallery.PAPER else 1e-13
    assert (error < bound * np.linalg.norm(exact, axis=1)).all()
    stress = bar_stress(strain)
    np.testing.assert_allclose(path.stress[:, :, 0] - stress[:, None], 0, atol=1e-6)
    np.testing.assert_allclose(-path.reaction_on(END)[:, 0], stress, rtol=1e-10)
    assert path.iterations.max() <= 2  # the paper's bound is 4


def test_load_control_takes_two_iterations():
    scene = gallery.plastic_bar(pulled=True, strain=0.010521327)
    path = jaxpd.solve_path(scene, np.linspace(0.9, 1.0, 11)).checked()
    assert path.u[-1, -1, 0] == pytest.approx(0.02, rel=1e-6)
    assert path.iterations.max() == 2


@pytest.mark.parametrize("jitter", [pytest.param(0.0, marks=pytest.mark.slow), 0.45])
def test_the_beam_is_the_bar(jitter):
    """Paper 001, Fig. 7 and 8; L2 with the contraction that the bar does not see."""
    t = np.arange(1, 401)[7::8] / 400  # eight times the paper's steps
    scene = gallery.plastic_beam(jitter=jitter, resolution=gallery.PAPER)
    path = jaxpd.solve_path(scene, t).checked()
    stress = bar_stress(0.02 * t)
    np.testing.assert_allclose(-path.reaction_on(END)[:, 0], stress, rtol=1e-10)
    np.testing.assert_allclose(
        path.stress[:, :, 0], stress[:, None] + 0 * path.peeq, rtol=1e-10
    )
    flow = 0.02 * t - stress / E
    exact = np.stack(
        [
            (0.02 * t)[:, None] * path.X[None, :, 0],
            -0.5 * flow[:, None] * path.X[None, :, 1],
        ],
        axis=2,
    )
    error = np.linalg.norm(path.u - exact, axis=(1, 2))
    assert (error < 1e-10 * np.linalg.norm(exact, axis=(1, 2))).all()
    assert path.iterations.max() <= 6


def test_a_cycle_yields_in_reverse_where_the_hardening_says():
    """-sigma_y - (K - H) peeq for isotropic K and kinematic H, not the other way."""
    fine = np.concatenate([[1.0], 1.0 + np.linspace(1.04, 1.055, 61)])
    time = jaxpd.table([0.0, 1.0, 3.0], [0.0, 1.0, -1.0])
    path = jaxpd.solve_path(gallery.plastic_bar(7, time=time), fine).checked()
    stress, peeq = path.stress[:, 0, 0], path.peeq[:, 0]
    assert stress[0] == pytest.approx(10521.3270, rel=1e-8)
    first = np.argmax(peeq > peeq[0] * (1 + 1e-9))
    reverse = -SIGMA_Y - (H_ISO - H_KIN) * peeq[0]
    assert reverse == pytest.approx(-10426.5403, rel=1e-8)
    assert stress[first - 1] > reverse > stress[first]
    assert np.diff(stress[first - 2 : first]) == pytest.approx(-E * 0.02 * 2.5e-4)


def test_a_block_in_tension_is_the_bar_in_three_dimensions():
    law = jaxpd.von_mises(E, 0.3, SIGMA_Y, H_ISO, H_KIN, state="solid")
    scene = jaxpd.Scene(
        mapped((4, 4, 4), lambda s: s, jitter=0.2, seed=2),
        law,
        supports=[
            jaxpd.moves(jaxpd.below(x=0.0), x=0.0),
            jaxpd.moves(jaxpd.below(y=0.0), y=0.0),
            jaxpd.moves(jaxpd.below(z=0.0), z=0.0),
            jaxpd.moves(jaxpd.above(x=1.0), x=0.02, time=jaxpd.ramp(1.0)),
        ],
        resolution=jaxpd.MLS(),
    )
    path = jaxpd.solve_path(scene, [0.4, 0.7, 1.0]).checked()
    np.testing.assert_allclose(
        -path.reaction_on(END)[:, 0], bar_stress(0.02 * path.t), rtol=1e-9
    )
    np.testing.assert_allclose(path.stress[-1, :, 1:], 0.0, atol=1e-5)


def test_unloading_to_nothing_leaves_plastic_strain_and_is_rest():
    time = jaxpd.table([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 0.0, 0.0])
    scene = gallery.plastic_bar(9, strain=0.0104, pulled=True, time=time)
    path = jaxpd.solve_path(scene, [0.5, 1.0, 1.5, 2.0, 2.5, 3.0]).checked()
    np.testing.assert_allclose(path.stress[-1], 0.0, atol=1e-6)
    left = path.history.strain_p[-1, :, 0]
    np.testing.assert_allclose(path.strain[-1, :, 0], left, rtol=1e-6)
    assert left.min() > 1e-3
    # nothing changes from t = 2 on: no iteration has anything to do
    np.testing.assert_allclose(path.u[-1], path.u[3], rtol=1e-9)


def test_a_load_may_be_held_and_steps_may_be_many():
    """A step without change has no residual to be relative to, small ones little."""
    held = jaxpd.table([0, 1, 2, 3], [0, 1, 1, 0])
    times = [*(np.arange(1, 11) / 10), 1.5, 2.0, 3.0]
    scene = gallery.plastic_bar(61, strain=0.0104, pulled=True, time=held)
    path = jaxpd.solve_path(scene, times).checked()
    assert len(path.steps) == 13
    np.testing.assert_allclose(path.u[11], path.u[9], rtol=1e-10)
    scene = gallery.plastic_bar(301, strain=0.005, pulled=True)
    path = jaxpd.solve_path(scene, np.arange(1, 101) / 400, max_halvings=0).checked()
    np.testing.assert_allclose(path.stress[-1], E * 0.005 / 4, rtol=1e-8)


def test_steps_that_fail_are_halved_and_a_hopeless_load_is_said():
    """Perfectly plastic, and pulled by more than its yield stress."""
    law = jaxpd.von_mises(E, None, SIGMA_Y, state="bar")
    scene = gallery.plastic_bar(9, law=law, strain=0.0125, pulled=True)
    path = jaxpd.solve_path(scene, [0.5, 1.0], max_halvings=4)
    assert path.stopped
    assert "4 halvings" in path.stopped
    assert "limit load" in path.stopped
    assert "prescribe displacements instead" in path.stopped
    assert len(path.t) == 1
    assert {s.searched for s in path.steps} == {False, True}
    last = max(s.t for s in path.accepted)
    assert 0.7 < last < 0.8 + 1e-6  # yields at 0.8
    with pytest.raises(NotConverged, match="load step to t"):
        path.checked()
    with pytest.raises(NotConverged):
        path.replay()


@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.slow
def test_displacements_as_large_as_the_body_end_a_path():
    """Beyond the limit load the filter would carry what the material cannot."""
    limit = 2 * 240.0 / np.sqrt(3) * np.log(2.0)
    path = jaxpd.solve_path(gallery.pressed_ring((11, 25), 1.6 * limit), [0.5, 1.0])
    assert "beyond its limit load" in path.stopped
    with pytest.raises(NotConverged, match="limit load"):
        path.checked()


@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.slow
def test_consistent_tangents_need_fewer_iterations_than_continuum_ones():
    scene = gallery.pressed_ring((6, 9), 160.0)
    most = {
        how: jaxpd.solve_path(scene, [0.6, 1.0], tangent=how).checked().iterations.max()
        for how in ("ad", "hand", "continuum")
    }
    assert most["ad"] == most["hand"] <= 6
    assert most["continuum"] > most["ad"]


def test_a_path_that_is_interrupted_goes_on_to_the_same_end(tmp_path):
    scene = gallery.plastic_bar(9)
    times = [0.3, 0.6, 0.8, 1.0]
    whole = jaxpd.solve_path(scene, times)
    code = textwrap.dedent(
        f"""
        import os, signal, jax, jaxpd
        jax.config.update("jax_enable_x64", True)
        from jaxpd import gallery, walk
        from jaxpd import compiling
        compiling.QUICK.update({compiling.QUICK})
        go = walk.Walk.go
        def once(self, target):
            if len(self.frames) == 2:
                os.kill(os.getpid(), signal.SIGKILL)
            go(self, target)
        walk.Walk.go = once
        jaxpd.solve_path(gallery.plastic_bar(9), {times}, folder={str(tmp_path)!r})
        """
    )
    done = subprocess.run([sys.executable, "-c", code], env=dict(os.environ))
    assert done.returncode == -signal.SIGKILL
    again = jaxpd.solve_path(scene, times, folder=tmp_path)
    for name in ("t", "u", "stress", "reaction", "peeq"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    assert again.steps == whole.steps
    with pytest.raises(ValueError, match="delete it or name another"):
        jaxpd.solve_path(gallery.plastic_bar(10), times, folder=tmp_path)
    assert jaxpd.solve_path(scene, times, folder=tmp_path).steps == whole.steps


def test_a_law_of_ones_own_needs_a_step_and_a_modulus():
    @jax.tree_util.register_dataclass
    @dataclasses.dataclass(frozen=True, eq=False)
    class Stiffening:
        E: jax.Array

        @property
        def shear(self):
            return self.E / 2

        def history0(self):
            return jnp.zeros(())  # largest strain so far

        def step(self, strain, history):
            most = jnp.maximum(history, jnp.abs(strain[0]))
            return self.E * (1.0 + most) * strain, most

    law = Stiffening(jnp.asarray(10.0))
    scene = gallery.plastic_bar(7, law=law, strain=7.5e-6, pulled=True)
    path = jaxpd.solve_path(scene, [0.5, 1.0]).checked()
    np.testing.assert_allclose(path.stress[-1], 7.5, rtol=1e-9)
    np.testing.assert_allclose(path.strain[-1], 0.5, rtol=1e-9)
    assert path.iterations.max() > 1
    with pytest.raises(ValueError, match="Stiffening has none"):
        _ = path.peeq


def test_frames_are_written(tmp_path):
    resolution = jaxpd.MLS(scheme="double")
    path = jaxpd.solve_path(gallery.plastic_bar(9, resolution=resolution), [0.5, 1.0])
    files = path.write(tmp_path / "bar")
    assert len(files) == 2
    assert b"peeq" in files[0].read_bytes()


def test_bad_paths_are_refused_with_their_cure():
    scene = gallery.plastic_bar(7)
    with pytest.raises(ValueError, match="must rise strictly"):
        jaxpd.solve_path(scene, [0.5, 0.5])
    with pytest.raises(ValueError, match="must rise strictly"):
        jaxpd.solve_path(scene, [0.0, 0.5])
    with pytest.raises(ValueError, match="solve_path"):
        jaxpd.solve_static(scene)
    bonds = gallery.cracked_plate(8, 3)
    with pytest.raises(ValueError, match=r"resolution=MLS\(\.\.\)"):
        jaxpd.solve_path(bonds, [1.0])
    with pytest.raises(ValueError, match="motion is for bonds"):
        jaxpd.run_explicit(scene, 1.0)
    assert Status.CONVERGED == 0
