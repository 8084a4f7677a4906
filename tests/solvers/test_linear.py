"""Every linear solver on the same constrained tangent, against SciPy."""

import types

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse as sp
import scipy.sparse.linalg as spla

import jaxpd
from jaxpd import gallery
from jaxpd.prepare import prepare
from jaxpd.problem import first_system
from jaxpd.solvers import LinearSolver, Status, direct
from jaxpd.solvers.linear import METHODS, linear_solver, solve_system


@pytest.fixture(scope="module")
def problem():
    return prepare(gallery.cracked_plate(16, 4, 0.0))


@pytest.fixture(scope="module")
def exact(problem):
    K, constraints, b = first_system(problem)
    free = np.flatnonzero(~np.asarray(constraints.fixed).ravel())
    A = K.to_bsr().tocsr()[free][:, free].tocsc()
    x = np.zeros(b.size)
    x[free] = spla.spsolve(A, np.asarray(b).ravel()[free])
    return x.reshape(b.shape)


@pytest.mark.parametrize("method", METHODS)
def test_all_solvers_agree_with_scipy(problem, exact, method):
    solver = problem.solver(method, 1e-10)
    x, info = solve_system(solver, *first_system(problem))
    assert Status(int(info.status)) is Status.CONVERGED
    assert np.abs(x - exact).max() <= 1e-7 * np.abs(exact).max()
    np.testing.assert_array_equal(np.asarray(x)[np.asarray(problem.fixed)], 0.0)


def test_amg_needs_few_iterations_and_several_levels(rng):
    problem = prepare(gallery.cracked_plate(48, 3, 0.0))
    solver = problem.solver("amg")
    assert solver.hierarchy.levels == 3
    assert solver.hierarchy.sizes[-1] <= 400
    assert solver.hierarchy.complexity < 1.5
    assert solver.hierarchy.seconds > 0
    _, info = solve_system(solver, *first_system(problem))
    assert int(info.iterations) <= 10
    cycle = solver.hierarchy.apply  # symmetric through its middle level, too
    a, b = rng.normal(size=(2, *problem.fixed.shape))
    assert (a * cycle(b)).sum() == pytest.approx((b * cycle(a)).sum(), rel=1e-10)


def test_the_cycle_is_symmetric_and_positive(problem, rng):
    cycle = problem.solver("amg").hierarchy.apply
    a, b = rng.normal(size=(2, *problem.fixed.shape))
    assert (a * cycle(b)).sum() == pytest.approx((b * cycle(a)).sum(), rel=1e-10)
    free = np.where(problem.fixed, 0.0, a)
    assert (free * cycle(free)).sum() > 0


def test_cg_refuses_what_is_not_symmetric(problem):
    K, constraints, b = first_system(problem)
    skew = types.SimpleNamespace(mv=K.mv, symmetric=False)
    with pytest.raises(ValueError, match="is for symmetric tangents"):
        LinearSolver(method="d-pcg")(skew, constraints, b)


def test_unknown_methods_and_missing_hierarchies_are_refused():
    with pytest.raises(ValueError, match="method: 'magic' must be one of"):
        linear_solver("magic")
    with pytest.raises(ValueError, match="hierarchy: method 'amg' needs one"):
        linear_solver("amg")


def test_an_ordering_that_fails_is_followed_by_the_default_one(monkeypatch, rng):
    K = sp.csr_matrix(np.eye(8) + 0.3 * rng.normal(size=(8, 8)))
    b, asked = rng.normal(size=(4, 2)), []

    def factorise(matrix, **how):
        asked.append(how.get("permc_spec"))
        return spla.splu(matrix * 2.0 if how else matrix, **how)

    monkeypatch.setattr(direct, "splu", factorise)
    x = direct.solve_free(K, np.zeros((4, 2), bool), b, symmetric=False)
    assert asked == ["MMD_AT_PLUS_A", None]
    np.testing.assert_allclose(K @ x.ravel(), b.ravel(), atol=1e-12)


@pytest.mark.parametrize("operator", ["gather", "stencil"])
@pytest.mark.parametrize("method", ["gmres", "bicgstab"])
def test_general_solvers_take_the_operators_of_bonds_and_have_gradients(
    method, operator
):
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (2.0, 1.0)),
        material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
        supports=[jaxpd.holds(jaxpd.below(x=0.0))],
        loads=[jaxpd.traction(jaxpd.above(x=2.0), y=1e-3)],
        resolution=jaxpd.Bonds(dx=0.25, m=2),
        kinematics="small",
    )

    def compliance(solver):
        problem = jaxpd.prepare(scene, operator=operator, solver=solver, rtol=1e-9)

        def of(E):
            params = problem.params | {"E": E}
            return jnp.sum(params["load"] * problem.solve(params)[0])

        return jax.value_and_grad(of)(jnp.asarray(1.3))

    for ours, known in zip(compliance(method), compliance("direct"), strict=True):
        np.testing.assert_allclose(ours, known, rtol=1e-6)


def test_factors_of_differences_near_one_volume_keep_their_ordering(monkeypatch):
    made = []

    def kept(*args, **how):
        made.append(spla.splu(*args, **how))
        return made[-1]

    monkeypatch.setattr("jaxpd.solvers.direct.splu", kept)
    for nu in (0.0, 0.499):
        scene = jaxpd.Scene(
            body=jaxpd.box((0.0, 0.0), (2.0, 1.0)),
            material=jaxpd.Elastic(1.0, nu, "plane strain"),
            supports=[jaxpd.holds(jaxpd.below(x=0.0))],
            loads=[jaxpd.traction(jaxpd.above(x=2.0), y=1e-6)],
            resolution=jaxpd.MLS(dx=1 / 24, volume="nodal"),
        )
        jaxpd.solve_static(scene).checked()
    assert len(made) == 2  # one attempt each
    fill = [f.L.nnz + f.U.nnz for f in made]
    assert fill[1] < 1.2 * fill[0]  # pivots off the diagonal: 4 times
