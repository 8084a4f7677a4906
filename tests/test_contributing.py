"""The examples of CONTRIBUTING.md run, are short, and inherit the catalogue's tests."""

import re
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, gradcheck
from jaxpd.discretize.schemes import SCHEMES
from jaxpd.problem import first_system
from jaxpd.solvers.linear import PRECONDITIONERS
from tests import catalogue, test_invariants, test_schemes

TEXT = (Path(__file__).parent.parent / "CONTRIBUTING.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, flags=re.DOTALL)


@pytest.fixture
def added(monkeypatch):
    """What the examples add, taken back afterwards."""
    for table in (SCHEMES, PRECONDITIONERS, catalogue.LAWS):
        for name in list(table):
            monkeypatch.setitem(table, name, table[name])
    before = {id(t): set(t) for t in (SCHEMES, PRECONDITIONERS, catalogue.LAWS)}
    names = {"__name__": "contributing"}
    for block in BLOCKS:
        exec(compile(block, "CONTRIBUTING.md", "exec"), names)
    yield names
    for table in (SCHEMES, PRECONDITIONERS, catalogue.LAWS):
        for name in set(table) - before[id(table)]:
            del table[name]


def test_each_example_is_short():
    assert len(BLOCKS) == 4
    law, entry, scheme, solver = (len(block.splitlines()) for block in BLOCKS)
    assert law + entry < 30
    assert scheme < 30
    assert solver < 30


def test_the_law_inherits_the_tests_of_laws(added, rng):
    op = catalogue.operator(rng, catalogue.LAWS["exponential"](2), 2)
    case = op, jnp.asarray(rng.normal(scale=0.01, size=op.X.shape))
    test_invariants.test_rest_is_without_force(case)
    test_invariants.test_both_momenta_are_conserved(case)
    test_invariants.test_energy_gradient_is_minus_the_force(case)
    test_invariants.test_tangent_is_symmetric_and_the_derivative_of_the_force(case, rng)
    test_invariants.test_translation_and_rotation_leave_the_force_objective(case, rng)


def test_the_solver_solves_by_a_symmetric_preconditioner(added):
    scene = gallery.cracked_plate(16, 3, kinematics="small")
    mine, known = (
        jaxpd.solve_static(scene, solver=name, rtol=1e-10).checked()
        for name in ("jacobi twice", "d-pcg")
    )
    np.testing.assert_allclose(mine.u, known.u, rtol=0, atol=1e-8 * abs(known.u).max())
    assert mine.linear_iterations[0] < known.linear_iterations[0]
    problem = jaxpd.prepare(scene, solver="jacobi twice", rtol=1e-10)
    K, constraints, _ = first_system(problem)
    apply = PRECONDITIONERS["jacobi twice"](K, constraints)
    a, b = np.random.default_rng(0).normal(size=(2, *problem.fixed.shape))
    a, b = (np.where(problem.fixed, 0.0, x) for x in (a, b))
    assert float((a * apply(b)).sum()) == pytest.approx(float((b * apply(a)).sum()))
    assert float((a * apply(a)).sum()) > 0


@pytest.mark.slow
def test_gradients_go_through_the_solver(added):
    scene = gallery.cracked_plate(16, 3, kinematics="small")
    problem = jaxpd.prepare(scene, solver="jacobi twice", rtol=1e-10)
    gradcheck.check(problem, names=["E"])


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_the_scheme_inherits_the_tests_of_schemes(added):
    test_schemes.passes_its_patch_tests("T6")
    test_schemes.resists_as_it_says("T6")
