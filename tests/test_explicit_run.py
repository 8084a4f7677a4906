"""Runs in time: what drives them, what they keep, and that nothing is lost."""

import dataclasses
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import jaxpd
import jaxpd.plot
from jaxpd import io
from jaxpd.schedule import STEADY

GLASS = jaxpd.Elastic(72e9, nu=1 / 3, state="plane stress", rho=2440.0, G0=3.8)


def small(**changes):
    """A notched strip that is torn."""
    plate = jaxpd.gallery.branching_plate(m=3, delta=3e-3, stress=4e6)
    box = jaxpd.box((0.0, -0.006), (0.02, 0.006))
    loads = [
        jaxpd.traction(jaxpd.above(y=0.006), y=+4e6, time=jaxpd.ramp(1e-6)),
        jaxpd.traction(jaxpd.below(y=-0.006), y=-4e6, time=jaxpd.ramp(1e-6)),
    ]
    crack = jaxpd.segment((0.0, 0.0), (0.008, 0.0))
    return dataclasses.replace(plate, body=box, loads=loads, cracks=(crack,), **changes)


def test_tables_and_ramps_are_linear_between_their_points():
    ramp, steps = jaxpd.ramp(2.0, start=1.0), jaxpd.table([0, 1, 3], [0, 2, -2])
    np.testing.assert_allclose(ramp([0, 1, 2, 3, 9]), [0, 0, 0.5, 1, 1])
    np.testing.assert_allclose(steps([-1, 0.5, 2, 5]), [0, 1, 0, -2])
    np.testing.assert_allclose(STEADY([0, 2]), [0, 2])
    assert steps.at_start() == (0.0, 2.0)
    assert STEADY.at_start() == (0.0, 1.0)
    assert ramp.at_start() == (0.0, 0.0)
    with pytest.raises(ValueError, match="times"):
        jaxpd.table([0, 0], [1, 2])
    with pytest.raises(ValueError, match="factors"):
        jaxpd.table([0, 1], [1])
    with pytest.raises(ValueError, match="rise: 0"):
        jaxpd.ramp(0)


@pytest.fixture(scope="module")
def torn():
    motion = jaxpd.prepare_motion(small())
    return jaxpd.run_explicit(motion, 6e-6, records=12, frames=6).checked()


def test_a_run_balances_its_energy_and_says_what_broke(torn):
    assert torn.released[-1] > 0.02 * torn.work[-1] > 0
    assert np.abs(torn.balance[3:]).max() < 5e-3  # nothing to speak of before
    damage, cut = torn.damage(), torn.damage0
    assert (cut > 0).sum() < (torn.damage(precracks=True) > 0).sum()
    assert cut.max() == pytest.approx(0.42, abs=0.1)
    np.testing.assert_allclose(
        1 - torn.damage(precracks=True), (1 - cut) * (1 - damage), atol=1e-12
    )
    assert len(torn.frames["t"]) == 7
    np.testing.assert_array_equal(torn.frames["damage"][0], cut)
    np.testing.assert_array_equal(torn.frames["u"][-1], torn.u)
    assert "points" in repr(torn)


def test_frames_become_a_series_of_vtu_files(torn, tmp_path):
    meshio = pytest.importorskip("meshio")
    files = torn.write_vtu(tmp_path / "frames")
    assert len(files) == 7
    last = meshio.read(files[-1])
    np.testing.assert_array_equal(last.point_data["damage"], torn.frames["damage"][-1])
    np.testing.assert_array_equal(last.point_data["u"][:, :2], torn.u)
    listed = (tmp_path / "frames" / "series.pvd").read_text()
    assert all(file.name in listed for file in files)
    with pytest.raises(ValueError, match="frames="):
        io.write_series(tmp_path / "none", np.zeros((1, 2)), np.zeros(0), {})


def test_a_run_is_drawn_panel_by_panel(torn):
    figure = jaxpd.plot.frames(torn, scale=5.0)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[0] == "1 us"
    assert titles[4] == "6 us"
    none = dataclasses.replace(torn, frames={k: x[:0] for k, x in torn.frames.items()})
    with pytest.raises(ValueError, match="0 frames"):
        jaxpd.plot.frames(none)


KILLED = """
import jax, sys
jax.config.update("jax_enable_x64", True)
sys.path.insert(0, sys.argv[2])
from tests.test_explicit_run import run
run(sys.argv[1])
"""


def run(folder):
    motion = jaxpd.prepare_motion(small())
    return jaxpd.run_explicit(
        motion, 6e-6, dt=1e-9, records=60, frames=6, folder=folder
    )


def test_a_killed_run_goes_on_to_the_same_bits(tmp_path):
    folder = tmp_path / "run"
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    child = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(folder), root], cwd=root
    )
    deadline = time.monotonic() + 120
    while not (folder / "frame_000010.npz").exists():
        assert child.poll() is None, "the run ended before it was killed"
        assert time.monotonic() < deadline
        time.sleep(0.005)
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    before = io_step(folder)
    assert 9 <= before < 60
    resumed, whole = run(folder), run(None)
    assert resumed.steps == whole.steps == 6000
    for name in ("u", "v", "t", "kinetic", "elastic", "released", "work", "momentum"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
    for name, values in whole.frames.items():
        np.testing.assert_array_equal(resumed.frames[name], values)
    np.testing.assert_array_equal(resumed.damage(), whole.damage())
    # a run that has ended is read, not run again; another is refused
    again = run(folder)
    np.testing.assert_array_equal(again.u, whole.u)
    other = jaxpd.prepare_motion(small(no_fail=[jaxpd.above(y=0.005)]))
    with pytest.raises(ValueError, match=r"state\.npz is of a run"):
        jaxpd.run_explicit(other, 6e-6, dt=1e-9, records=60, frames=6, folder=folder)
    with pytest.raises(ValueError, match="there is no folder"):
        run(tmp_path / "no" / "where")


def io_step(folder):
    with np.load(folder / "state.npz", allow_pickle=False) as kept:
        return len(kept[[name for name in kept.files if name != "mark"][-1]]) - 1


def test_prescribed_motion_works_on_the_body_and_is_followed_exactly():
    bar = jaxpd.Scene(
        body=jaxpd.box((0.0,), (1.0,)),
        material=jaxpd.Elastic(1.0, state="bar", rho=1.0),
        supports=[
            jaxpd.drives(jaxpd.below(x=0.1), x=0.01),
            jaxpd.moves(jaxpd.above(x=0.9), x=0.02, time=jaxpd.ramp(0.3)),
        ],
        loads=[jaxpd.body_force(jaxpd.box((0.3,), (0.5,)), x=0.1)],
        resolution=jaxpd.Bonds(dx=0.05, m=2, nodes="cell"),
    )
    run = jaxpd.run_explicit(bar, 0.4, safety=0.1, records=4)
    X = np.asarray(run.X)[:, 0]
    np.testing.assert_allclose(run.u[X < 0.1, 0], 0.01 * 0.4, rtol=1e-12)
    np.testing.assert_allclose(run.u[X > 0.9, 0], 0.02, rtol=1e-12)
    np.testing.assert_allclose(run.v[X < 0.1, 0], 0.01, rtol=1e-9)
    assert run.work[-1] > 0
    assert np.abs(run.balance).max() < 2e-3
    # tractions and resultants pull as much as they say
    face = dataclasses.replace(bar, loads=[jaxpd.traction(jaxpd.above(x=1.0), x=3.0)])
    load = jaxpd.prepare_motion(face).params["load"]
    assert load.sum() == pytest.approx(3.0, rel=1e-12)


def test_words_that_mean_nothing_are_refused():
    scene = small()
    for change, message in (
        ({"material": jaxpd.Elastic(1.0, 1 / 3, "plane stress")}, "density"),
        ({"loads": [jaxpd.traction(jaxpd.above(y=0.1), y=1.0)]}, "face"),
        ({"loads": [jaxpd.traction(jaxpd.box((0, 0), (1, 1)), x=1.0)]}, "half-space"),
        ({"starts": [jaxpd.initially(jaxpd.above(y=1.0), vx=1.0)]}, "starts: no point"),
    ):
        with pytest.raises(ValueError, match=message):
            jaxpd.prepare_motion(dataclasses.replace(scene, **change))
    for options, message in (
        ({"dtype": "float16"}, "float16"),
        ({"softening": 2.0}, "softening: 2.0"),
        ({"operator": "fft"}, "operator: 'fft'"),
        ({"operator": "halves", "softening": 0.1}, "operator: 'halves'"),
    ):
        with pytest.raises(ValueError, match=message):
            jaxpd.prepare_motion(scene, **options)
    motion = jaxpd.prepare_motion(scene)
    for options, message in (
        ({"frames": 7}, "frames: 7"),
        ({"records": 0}, "records"),
        ({"safety": 1.5}, "safety: 1.5"),
        ({"dt": -1.0}, "dt: -1.0"),
    ):
        with pytest.raises(ValueError, match=message):
            jaxpd.run_explicit(motion, 1e-6, **options)
    with pytest.raises(ValueError, match="must be a region"):
        jaxpd.traction("above", x=1.0)
    with pytest.raises(ValueError, match="statics"):
        jaxpd.prepare(scene)


def test_nan_stops_a_run_with_its_place():
    motion = jaxpd.prepare_motion(small())
    v0 = np.array(motion.params["v0"])
    v0[17] = np.nan
    bad = dataclasses.replace(motion, params=motion.params | {"v0": v0})
    run = jaxpd.run_explicit(bad, 6e-6, records=12, frames=6)
    assert run.steps < 36  # of the whole run
    with pytest.raises(jaxpd.Diverged, match=r"not finite by t = .* at point \d+"):
        run.checked()


def test_float32_runs_follow_float64(torn):
    narrow = jaxpd.prepare_motion(small(), dtype="float32")
    run = jaxpd.run_explicit(narrow, 6e-6, records=12, frames=6).checked()
    assert run.u.dtype == np.float32
    size = np.abs(torn.u).max()
    assert np.abs(run.u - torn.u).max() < 1e-3 * size
    assert np.abs(run.balance[3:]).max() < 5e-3
