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
    printed, names = run(block("jaxpd.fit(") + block("halves =") + block("jax.grad"))
    np.testing.assert_allclose(
        jaxpd.fit(names["problem"], names["halves"], names["seen"]).values["halves"],
        30e9,
        rtol=1e-4,
    )
    assert float(printed.split()[-1]) == pytest.approx(float(names["slope"]), rel=1e-3)


def test_a_law_in_ten_lines():
    _, names = run(block("class LogStrain"))
    assert names["LogStrain"].energy
