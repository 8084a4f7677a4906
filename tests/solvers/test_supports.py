"""Every prepared solver on supports that are no whole planes, against sparse LU."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, prepare
from jaxpd.problem import Problem, host_system
from jaxpd.solvers import Status
from jaxpd.solvers.direct import solve_free
from jaxpd.solvers.linear import solve_system

DOWN, UP = jaxpd.below(y=-0.5), jaxpd.above(y=0.5)
SUPPORTS = {
    "pins": [
        jaxpd.holds(DOWN),
        jaxpd.moves(UP, y=1e-3),
        jaxpd.holds(jaxpd.box((0.2, 0.1), (0.3, 0.2))),
    ],
    "part of a face": [
        jaxpd.holds(jaxpd.box((-0.6, -0.6), (-0.1, -0.49))),
        jaxpd.moves(jaxpd.box((0.3, 0.49), (0.6, 0.6)), y=1e-3),
    ],
    "a plane inside": [
        jaxpd.holds(DOWN),
        jaxpd.moves(jaxpd.box((-0.6, 0.24), (0.6, 0.26)), x=0.0, y=1e-3),
    ],
    "one component": [
        jaxpd.moves(jaxpd.box((-1.0, -1.0), (1.0, 1.0)), x=0.0),
        jaxpd.holds(DOWN),
        jaxpd.moves(UP, y=1e-3),
    ],
}


def plate(supports, **how):
    scene = gallery.cracked_plate(16, 4, kinematics="small")
    return prepare(dataclasses.replace(scene, supports=SUPPORTS[supports]), **how)


@pytest.mark.parametrize("supports", SUPPORTS)
def test_supports_that_are_no_whole_planes(supports):
    problem = plate(supports)  # the automatic choice can be made
    K, constraints, b = host_system(problem)
    want = solve_free(K.to_bsr(), constraints.fixed, b)
    for method in ("spectral", "multigrid"):
        solver = problem.solver(method, 1e-9)
        x, info = solve_system(solver, K, constraints, b)
        assert Status(int(info.status)) is Status.CONVERGED
        np.testing.assert_array_equal(np.asarray(x)[constraints.fixed], 0.0)
        np.testing.assert_allclose(x, want, rtol=0, atol=1e-6 * abs(want).max())


def test_points_and_volumes_that_left_the_lattice_are_gathered():
    cloud = jaxpd.lattice((-0.5, -0.5), (0.5, 0.5), 1 / 16)
    assert cloud.regular
    scene = gallery.cracked_plate(16, 4, kinematics="small")
    for changes in ({"vol": cloud.vol.at[3].mul(0.5)}, {"X": 1.01 * cloud.X}):
        body = dataclasses.replace(cloud, **changes)
        assert not body.regular
        pulled = {"supports": [jaxpd.holds(DOWN)], "loads": [jaxpd.pull(UP, y=1.0)]}
        moved = dataclasses.replace(scene, body=body, **pulled)
        assert prepare(moved).spec.operator == "gather"
        with pytest.raises(ValueError, match="operator: 'fft' needs a lattice of even"):
            prepare(moved, operator="fft")


def test_parameters_that_do_not_exist_are_refused():
    problem = plate("pins", solver="pcg")
    with pytest.raises(ValueError, match=r"params: \['alhpa'\] must be absent"):
        problem.stiffness(problem.params | {"alhpa": 1.0})
    with pytest.raises(ValueError, match="X and vol are parameters"):
        jax.jit(Problem.solve)(problem, problem.params | {"X": jnp.ones((2, 2))})


def test_a_row_of_cells_that_nothing_holds_across_is_refused():
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (1.0, 1 / 16)),
        material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
        supports=[jaxpd.holds(jaxpd.below(x=0.1)), jaxpd.holds(jaxpd.above(x=0.9))],
        resolution=jaxpd.Bonds(dx=1 / 16, m=3, nodes="cell"),
    )
    for operator in ("auto", "gather"):
        with pytest.raises(ValueError, match="all their bonds in one line"):
            prepare(scene, operator=operator)


def test_bonds_break_through_the_problem_alone():
    problem = plate("pins", solver="pcg")
    family = jaxpd.geometry.without(problem.family, np.array([[40], [0]]))
    with pytest.raises(ValueError, match=r"family: it misses .* use problem.without"):
        dataclasses.replace(problem, family=family).stiffness()
    less = problem.without(np.array([[40], [0]]))
    assert less.spec.cuts == problem.spec.cuts + 1
    less.stiffness()
    i, j, slot = problem.family.ends()
    corner = (i == 0) | (j == 0)
    with pytest.raises(ValueError, match="bonds: some lead off the lattice"):
        problem.without(np.array([[0], [problem.family.offsets.index((1, -1))]]))
    top = int(problem.family.n) - 1
    loose = (i == top) | (j == top)
    assert corner.any()
    if not problem.fixed[top].all():
        with pytest.raises(ValueError, match="rigid-body mode"):
            problem.without(np.stack([i[loose], slot[loose]]))


def test_points_on_few_long_bonds_are_smoothed_with_care():
    """An island of 2 x 2 points on its six longest bonds a point, h = 1/32, m = 8."""
    problem = prepare(gallery.cracked_plate(32, 8, kinematics="small"), solver="pcg")
    i, j, slot = problem.family.ends()
    x = np.asarray(problem.X)
    island = (abs(x[:, 0] - 0.25) < 0.03) & (abs(x[:, 1] - 0.25) < 0.03)
    length = np.linalg.norm(x[j] - x[i], axis=1)
    gone = (island[i] ^ island[j]) & (length < 0.245)
    torn = problem.without(np.stack([i[gone], slot[gone]]))
    _, info = solve_system(torn.solver("multigrid"), *host_system(torn))
    assert Status(int(info.status)) is Status.CONVERGED
    assert int(info.iterations) <= 30
