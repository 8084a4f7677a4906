"""Every Python example of the README runs, and finds the numbers that it tells."""

import contextlib
import io
import re
from pathlib import Path

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
    return next(b for b in BLOCKS if word in b)


@pytest.mark.slow
def test_the_plate_in_ten_lines():
    printed, names = run(block("solution.opening"))
    assert round(float(printed), 3) == 0.573
    assert names["solution"].iterations == 2


@pytest.mark.slow
def test_the_fit_in_ten_lines():
    printed, names = run(block("jaxpd.fit("))
    assert abs(names["found"].values["E"] / 30e9 - 1) < 1e-6
    assert "E: 2.9" in printed


@pytest.mark.slow
def test_a_gradient_by_hand():
    """The lines after the fit go on from it."""
    printed, names = run(block("jaxpd.fit(") + block("halves =") + block("slope ="))
    np.testing.assert_allclose(
        jaxpd.fit(names["problem"], names["halves"], names["seen"]).values["halves"],
        30e9,
        rtol=1e-4,
    )
    assert float(printed.split()[-1]) == pytest.approx(float(names["slope"]), rel=1e-3)


def test_a_law_in_ten_lines():
    _, names = run(block("class LogStrain"))
    assert names["LogStrain"].energy


@pytest.mark.slow
def test_the_plate_that_branches(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    printed, names = run(block("run_explicit"))
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
