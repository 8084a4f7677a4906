"""The implicit derivative of equilibrium: plain AD, all orders, honest failures."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import Status
from jaxpd.gradcheck import check
from jaxpd.operators import BondForce
from jaxpd.problem import Problem

pytestmark = pytest.mark.usefixtures("compiled_quickly")
TIGHT = {"rtol": 1e-13, "linear_rtol": 1e-14}


def plate(kinematics="small", n=4, m=2.2, **options):
    """A notched plate under prescribed motion and body force."""
    return jaxpd.Scene(
        body=jaxpd.box((-0.5, -0.5), (0.5, 0.5)),
        material=options.pop("material", jaxpd.Elastic(3.0, 1 / 3, "plane stress")),
        supports=[
            jaxpd.moves(jaxpd.above(y=0.5), x=0.002, y=0.02),
            jaxpd.moves(jaxpd.below(y=-0.5), x=lambda X: 0.004 * X[:, 0], y=-0.003),
        ],
        loads=[jaxpd.body_force(jaxpd.box((-0.1, -0.3), (0.5, 0.3)), x=0.03, y=0.02)],
        cracks=[jaxpd.segment((-0.5, 0.03), (0.1, 0.03))],
        resolution=jaxpd.Bonds(dx=1 / n, m=m, **options),
        kinematics=kinematics,
    )


def functional(u):
    """A scalar of the displacements."""
    w = np.random.default_rng(3).normal(size=u.shape)
    return jnp.sum(w * u) + 10.0 * jnp.sum(u * u)


def solved(params, problem):
    u, info = problem.solve(params)
    return functional(u), info.status


slope = jax.jit(jax.grad(solved, has_aux=True))  # compiled once for all tests


def plain(params, problem, free, iterations):
    """Newton's method with dense matrices, every line of it differentiated."""
    operator, constraints, load = problem.force(params)

    def iterate(u, _):
        K = -jax.jacfwd(operator.respond)(u).reshape(u.size, u.size)
        r = (operator.respond(u) + load).ravel()
        step = jnp.linalg.solve(K[free][:, free], r[free])  # free: their numbers
        return u.ravel().at[free].add(step).reshape(u.shape), None

    u, _ = jax.lax.scan(iterate, constraints.lift(), length=iterations)
    return functional(u)


@pytest.mark.parametrize(
    ("kinematics", "operator"),
    [
        ("finite", "gather"),
        pytest.param("small", "fft", marks=pytest.mark.slow),
        pytest.param("small", "gather", marks=pytest.mark.slow),
        pytest.param("small", "stencil", marks=pytest.mark.slow),
        pytest.param("finite", "stencil", marks=pytest.mark.slow),
    ],
)
def test_the_rule_is_plain_ad_of_the_unruled_solve(kinematics, operator):
    solver = "d-pcg" if operator == "fft" else "direct"
    problem = jaxpd.prepare(
        plate(kinematics), operator=operator, solver=solver, **TIGHT
    )
    at = problem.params | {"E": 3.0 + 0.3 * np.sin(np.arange(len(problem.X)))}
    ruled, status = slope(at, problem)
    iterations = 1 if kinematics == "small" else 6
    free = np.flatnonzero(~np.asarray(problem.fixed).ravel())
    unruled = jax.jit(jax.grad(plain), static_argnums=3)(at, problem, free, iterations)
    assert int(status) == Status.CONVERGED
    for name, other in unruled.items():
        scale = float(jnp.abs(other).max())
        worst = float(jnp.abs(ruled[name] - other).max())
        assert worst <= 1e-12 * scale, f"{name}: {worst / scale:.1e}"


def test_a_wrong_rule_is_caught(monkeypatch):
    """With eq. 20 for the tangent, which lacks the geometric part."""
    wrong = lambda self: dataclasses.replace(self, blocks="axial")  # noqa: E731
    monkeypatch.setattr(BondForce, "exact", wrong)
    problem = jaxpd.prepare(plate("finite"), operator="gather", **TIGHT)
    found = check(problem, ("load", "alpha"))
    for taylor in found.values():
        assert taylor.slope < 1.5
        assert not taylor.right
        assert abs(taylor.derivative / taylor.difference - 1.0) > 1e-3


@functools.cache
def small_problem(solver, kinematics="small"):
    return jaxpd.prepare(plate(kinematics), operator="gather", solver=solver, **TIGHT)


@pytest.mark.parametrize(
    "solver",
    ["amg", *(pytest.param(s, marks=pytest.mark.slow) for s in ("d-pcg", "direct"))],
)
def test_all_orders_and_batches(solver):
    """grad, jacfwd, Hessian and vmap, on the device and through the host."""
    problem = small_problem(solver)
    base = jax.tree.map(jnp.asarray, problem.params)

    def f(z, problem):
        return functional(problem.solve(base | {"alpha": z[0], "E": z[1]})[0])

    @jax.jit
    def everything(rows, problem):
        gradient = jax.grad(f)
        many = jax.vmap(gradient, in_axes=(0, None))(rows, problem)
        forward = jax.jacfwd(f)(rows[0], problem)
        return many, forward, jax.jacfwd(gradient)(rows[0], problem)

    z, step = jnp.asarray([0.2, 3.3]), 1e-4
    moved = step * jnp.concatenate([jnp.eye(2), -jnp.eye(2)])
    rows = jnp.concatenate([z[None], z[None] + moved])
    many, forward, H = map(np.asarray, everything(rows, problem))
    np.testing.assert_allclose(forward, many[0], rtol=1e-11)
    np.testing.assert_allclose(H, H.T, rtol=0, atol=1e-10 * abs(H).max())
    difference = (many[1:3] - many[3:5]) / (2 * step)
    np.testing.assert_allclose(difference, H, rtol=0, atol=1e-6 * abs(H).max())


@pytest.mark.slow
def test_jacobians_by_either_mode_agree():
    problem = small_problem("direct", "finite")
    base = jax.tree.map(jnp.asarray, problem.params)

    def f(z, problem):
        return problem.solve(base | {"alpha": z[0], "delta": z[1]})[0][::7].ravel()

    z = jnp.asarray([0.2, 0.46])
    forward = jax.jit(jax.jacfwd(f))(z, problem)
    backward = jax.jit(jax.jacrev(f))(z, problem)
    np.testing.assert_allclose(
        backward, forward, rtol=0, atol=1e-11 * abs(forward).max()
    )


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Skew:
    """A law by its force, whose tangent blocks are not symmetric."""

    c: jax.Array

    def force(self, xi, eta):
        s = jaxpd.physics.stretch(xi, eta)
        turn = jnp.asarray([[1.0, 0.4], [0.0, 1.0]])
        return self.c * s * (turn @ (xi + eta))


@pytest.mark.parametrize(
    "kinematics", ["small", pytest.param("finite", marks=pytest.mark.slow)]
)
def test_a_tangent_that_is_not_symmetric_is_solved_with_its_transpose(kinematics):
    scene = plate(kinematics, material=Skew(jnp.asarray(30.0)))
    problem = jaxpd.prepare(scene, rtol=1e-12)
    assert not problem.spec.symmetric
    found = check(problem, ("law", "prescribed"))
    for taylor in found.values():
        assert taylor.slope == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    ("kinematics", "operator", "solver"),
    [
        ("finite", "gather", "d-pcg"),
        ("small", "gather", "amg"),
        pytest.param("small", "fft", "multigrid", marks=pytest.mark.slow),
        pytest.param("finite", "stencil", "spectral", marks=pytest.mark.slow),
        pytest.param("small", "gather", "cg", marks=pytest.mark.slow),
    ],
)
def test_the_derivative_of_a_failed_solve_is_nan_and_has_a_status(
    kinematics, operator, solver
):
    problem = jaxpd.prepare(
        plate(kinematics, n=16 if solver == "amg" else 8),  # AMG solves 400 at once
        operator=operator,
        solver=solver,
        linear_maxiter=1,
        rtol=1e-10,
    )

    def loss(params, problem):
        u, info = problem.solve(params)
        return jnp.sum(u * u), info.status

    grad = jax.jit(jax.grad(loss, has_aux=True))
    gradient, status = grad(problem.params, problem)
    assert int(status) != Status.CONVERGED
    for name, leaf in gradient.items():
        assert np.isnan(leaf).any(), name
    free = ~np.asarray(problem.fixed)
    assert np.isnan(np.asarray(gradient["load"])[free]).all()
    with pytest.raises(jaxpd.NotConverged):
        check(problem, ("load",))


@pytest.mark.parametrize(
    "solver",
    ["direct", *(pytest.param(s, marks=pytest.mark.slow) for s in ("d-pcg", "amg"))],
)
def test_one_failure_of_a_batch_leaves_the_others_alone(solver):
    problem = small_problem(solver)

    def loss(E, problem):
        u, info = problem.solve(problem.params | {"E": E})
        return jnp.sum(u * u), info.status

    E = jnp.asarray([3.0, jnp.nan, 4.0])
    both = jax.jit(jax.vmap(jax.grad(loss, has_aux=True), in_axes=(0, None)))
    gradient, status = both(E, problem)
    one = jax.jit(jax.grad(loss, has_aux=True))(E[2], problem)[0]
    assert np.isfinite(np.asarray(gradient)[[0, 2]]).all()
    assert np.isnan(gradient[1])
    assert (np.asarray(status) == 0).tolist() == [True, False, True]
    np.testing.assert_allclose(gradient[2], one, rtol=1e-9)


def test_a_failed_adjoint_alone_is_nan_too():
    """The forward solve needs no iteration; the adjoint does, and has none."""
    problem = small_problem("d-pcg")
    linear = dataclasses.replace(problem.linear, maxiter=1)
    problem = dataclasses.replace(problem, linear=linear)
    still = jax.tree.map(np.zeros_like, problem.params) | {
        k: np.asarray(problem.params[k]) for k in ("E", "alpha", "delta", "X", "vol")
    }
    gradient, status = slope(still, problem)
    assert int(status) == Status.CONVERGED
    assert np.isnan(gradient["load"]).any()


def test_rigid_motion_left_free_is_refused_or_nan():
    scene = dataclasses.replace(
        plate(), supports=[jaxpd.moves(jaxpd.above(y=0.5), y=0.01)]
    )
    with pytest.raises(ValueError, match="rigid-body"):
        jaxpd.prepare(scene)
    # taken apart by hand, behind the door's back
    problem = small_problem("d-pcg")
    loose = dataclasses.replace(problem, fixed=np.zeros_like(problem.fixed))
    gradient, status = slope(loose.params, loose)
    assert int(status) != Status.CONVERGED
    assert np.isnan(gradient["E"])


def test_points_that_coincide_are_refused_and_padding_is_harmless(rng):
    X = rng.uniform(size=(30, 2))
    with pytest.raises(ValueError, match="coincide"):
        jaxpd.geometry.find(
            jaxpd.from_points(np.concatenate([X, X[:1]]), np.ones(31)), 0.4
        )
    problem = small_problem("d-pcg")
    nbr = np.asarray(problem.family.nbr)
    assert (nbr == np.arange(nbr.shape[1])).any()  # there are padded bonds
    gradient, _ = slope(problem.params, problem)
    for name in ("X", "vol", "delta"):
        assert np.isfinite(gradient[name]).all()
        assert float(jnp.abs(gradient[name]).max()) > 0


@pytest.mark.parametrize("operator", ["gather", "stencil"])
def test_an_unstretched_body_has_derivatives_of_all_orders(operator):
    problem = jaxpd.prepare(plate("finite"), operator=operator)

    def energy(u, problem):
        return jnp.sum(problem.energy(u))

    zero = jnp.zeros(problem.X.shape)
    one = jnp.ones_like(zero)
    grad = jax.grad(energy)
    force, curvature = jax.jit(
        lambda u, p: (grad(u, p), jax.jvp(lambda u: grad(u, p), (u,), (one,))[1])
    )(zero, problem)
    assert (np.asarray(force) == 0).all()
    # a translation costs nothing
    assert abs(np.asarray(curvature)).max() < 1e-14


def test_solutions_without_a_load_have_derivatives():
    """Nothing moves, the first residual is zero, and yet loads have a gradient."""
    problem = jaxpd.prepare(plate("finite"), operator="gather", **TIGHT)
    zero = jax.tree.map(jnp.zeros_like, problem.params)
    at = problem.params | {"load": zero["load"], "prescribed": zero["prescribed"]}

    def loss(params, problem):
        return jnp.sum(Problem.solve(problem, params)[0])

    gradient = jax.jit(jax.grad(loss))(at, problem)
    assert float(jnp.abs(gradient["load"]).max()) > 0
    assert np.isfinite(gradient["load"]).all()
    assert float(gradient["E"]) == 0.0
