"""Every Python example of the README runs, and finds the numbers that it tells."""

import contextlib
import io
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd

README = Path(__file__).parent.parent / "README.md"
BLOCKS = re.findall(r"```python\n(.*?)```", README.read_text(), flags=re.DOTALL)


def run(code):
    out, names = io.StringIO(), {"__name__": "readme"}
    with contextlib.redirect_stdout(out):
        exec(compile(code, str(README), "exec"), names)
    return out.getvalue(), names


def block(word):
    (found,) = [b for b in BLOCKS if word in b]  # a word of two blocks names neither
    return found


@pytest.mark.slow
def test_the_plate_in_ten_lines():
    printed, names = run(block("solution.opening"))
    assert round(float(printed), 3) == 0.573
    assert names["solution"].iterations == 2


@pytest.mark.slow
def test_the_fit_in_ten_lines():
    printed, names = run(block("found = jaxpd.fit("))
    assert abs(names["found"].values["E"] / 30e9 - 1) < 1e-6
    assert "E: 2.9" in printed


@pytest.mark.slow
def test_a_gradient_by_hand():
    """The lines after the fit go on from it."""
    code = (
        block("found = jaxpd.fit(")
        + block("halves =")
        + block("slope = jax.grad(loss)")
    )
    printed, names = run(code)
    np.testing.assert_allclose(
        jaxpd.fit(names["problem"], names["halves"], names["seen"]).values["halves"],
        30e9,
        rtol=1e-4,
    )
    assert float(printed.split()[-1]) == pytest.approx(float(names["slope"]), rel=1e-3)


@pytest.mark.slow
def test_kernels_in_the_weak_form():
    printed, names = run(block("plate_under_tension"))
    assert abs(float(printed) / 3 - 1) < 0.02
    exact = jaxpd.gallery.kirsch_exact(names["solution"].X)
    error = np.linalg.norm(names["solution"].u - exact) / np.linalg.norm(exact)
    assert error < 1e-3


def test_a_law_in_ten_lines():
    _, names = run(block("class LogStrain"))
    assert names["LogStrain"].energy


@pytest.mark.slow
def test_the_plate_that_branches(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    printed, names = run(block("branching.png"))
    assert printed.startswith("Run(64000 points")
    found = jaxpd.crack_path.branching(
        names["run"].X,
        (400, 160),
        names["run"].frames["damage"],
        names["run"].frames["t"],
        notch_x=0.05,
        delta=1e-3,
    )
    assert found.tips == 2
    assert found.xe == pytest.approx(65.2e-3, abs=1.5e-3)
    assert (tmp_path / "branching.png").stat().st_size > 10_000


@pytest.mark.slow
def test_a_gradient_of_a_run_and_a_damage_law():
    printed, names = run("import jax, jaxpd\n" + block("motion.march"))
    assert float(printed) > 0
    _, names = run("import jax, jaxpd\nimport jax.numpy as jnp\n" + block("Fatigue"))
    law = jaxpd.physics.pmb(1.0, 1 / 3, "plane stress", 2, 0.3)
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (1.0, 0.5)),
        material=jaxpd.Solid(names["Fatigue"](law, np.asarray(0.02)), rho=1.0),
        starts=[jaxpd.initially(jaxpd.above(x=0.5), vx=0.01)],
        resolution=jaxpd.Bonds(dx=0.1, m=3, nodes="cell"),
    )
    found = jaxpd.run_explicit(scene, 2.0, records=4).checked()
    assert 0 < found.damage().max() <= 1


def test_panes_glued_together():
    _, names = run(block("jaxpd.laminate("))
    mass = 2440.0 * 0.02 * 0.01 + 1100.0 * 0.02 * 0.76e-3
    impulse = 1e5 * 1e-6  # of the triangle
    moved = names["run"]
    np.testing.assert_allclose(moved.momentum[-1], [0.0, -impulse], atol=1e-12)
    op, drive = jax.jit(lambda m: m.build(m.params))(moved.motion)
    np.testing.assert_allclose(op.pick(drive.mass).sum(), mass, rtol=1e-12)


def test_a_place_for_the_modulus_of_the_glue():
    _, names = run("import jaxpd\n" + block("sought ="))
    glue = jaxpd.interlayer(1.0)
    placed = names["place"]({"interlayers": (glue,), "load": 0}, 2.0)
    assert placed["interlayers"][0].E == 2.0
    assert set(names["sought"]) == {"glue"}


@pytest.mark.slow
def test_a_ring_that_flows_and_what_its_yield_stress_does():
    printed, names = run(block("def quarter") + block("path.replay()"))
    assert printed.startswith("Path(275 nodes, 12 frames, 12 load steps")
    path = names["path"]
    assert path.peeq[5].max() == pytest.approx(path.peeq[-1].max())
    assert path.u[-1, 0, 0] > 0  # stays open
    assert names["slope"] < 0


def test_a_law_of_strain_in_ten_lines():
    _, names = run("import jax, jax.numpy as jnp\n" + block("class Stiffening"))
    law = names["Stiffening"](jnp.asarray(10.0))
    scene = jaxpd.gallery.plastic_bar(5, law=law, strain=0.5)
    path = jaxpd.solve_path(scene, [1.0]).checked()
    np.testing.assert_allclose(path.stress[-1], 7.5)


def test_a_plate_that_breaks_slowly_and_its_derivative():
    """The lines after the path go on from it; both forms are homogeneous."""
    code = block("solve_fracture(scene).checked()") + block("def peak(params)")
    printed, names = run(code)
    growth = names["growth"]
    assert "severed" in printed
    assert np.abs(growth.balance).max() < 1e-12
    value = growth.force[growth.peak]
    # forces go with (G0 E)^(1/2)
    assert float(names["slope"]["G0"]) == pytest.approx(value / (2 * 3.8), rel=1e-8)
    total = float(names["slope"]["E"].sum())
    assert total == pytest.approx(value / (2 * 72e9), rel=1e-8)


def test_the_table_of_methods_is_the_planner_s():
    assert jaxpd.planner.which_when() in README.read_text()


@pytest.mark.slow
def test_the_plan_and_the_refinement():
    printed, names = run(block("jaxpd.plan(strip") + block("jaxpd.refine(fine"))
    assert names["plan"].error <= 1e-3
    assert names["coarser"].scene.resolution == jaxpd.RKPM(dx=1 / 8)
    assert "order" in printed
    assert len(names["found"].values) == 3


def test_the_scene_file(tmp_path):
    (text,) = re.findall(r"```toml\n(.*?)```", README.read_text(), flags=re.DOTALL)
    path = tmp_path / "scene.toml"
    path.write_text(text)
    file = jaxpd.load_scene(path)
    assert jaxpd.plan(file.scene, **file.wish).error <= 0.02


def test_the_citation_has_the_version():
    lines = (README.parent / "CITATION.cff").read_text().splitlines()
    assert f"version: {jaxpd.__version__}" in lines
