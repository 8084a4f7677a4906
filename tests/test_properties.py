"""Laws of mechanics over random scenes: they hold, or a named error is raised.

Compilation is what costs, so tests of every day draw plane scenes of one topology:
sizes and moduli over 18 and 15 decades, orders of the kernel, places, volumes, loads,
cracks. The slow ones draw bars, plates and solids, kernels of every kind, rims and
corrections too. Every tolerance is relative to the size of what is compared; solves are
to 1e-10.
"""

import dataclasses

import jax
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import jaxpd
from jaxpd.geometry import segment
from jaxpd.solvers.status import NotConverged, Status

SHAPES = {1: (9,), 2: (5, 5), 3: (3, 3, 3)}
STATES = {1: ("bar", None), 2: ("plane stress", 1 / 3), 3: ("solid", 1 / 4)}
KERNELS = [
    jaxpd.fractional(0.0),
    jaxpd.fractional(-1.0),
    jaxpd.fractional(1.5),
    jaxpd.constant(),
    jaxpd.conical(),
    jaxpd.gaussian(0.5),
]
ORDERS = st.floats(-2.0, 1.5).map(jaxpd.fractional)
FEW = settings(
    max_examples=15,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow],
)
MANY = settings(FEW, max_examples=100)
SOME = settings(FEW, max_examples=15)


@st.composite
def scenes(draw, kinematics="small", *, every=False):
    """A body of any size held at one end and pulled at; `every` kind, or plane."""
    d = draw(st.sampled_from([1, 2, 3])) if every else 2
    shape, (state, nu) = SHAPES[d], STATES[d]
    dx = 10.0 ** draw(st.integers(-9, 9))
    grid = jaxpd.lattice(
        (0.0,) * d, tuple(dx * (n - 1.0) for n in shape), dx, nodes="edge"
    )
    jitter = draw(st.sampled_from([0.0, 0.2] if every else [0.0, 0.01]))
    rng = np.random.default_rng(draw(st.integers(0, 2**16)))
    X = np.asarray(grid.X) + dx * jitter * rng.uniform(-1, 1, grid.X.shape)
    vol = np.asarray(grid.vol) * (1.0 + jitter * rng.uniform(-1, 1, grid.n))
    body = jaxpd.from_points(X, vol)
    held = jaxpd.below(x=dx * 0.9)
    E = 10.0 ** draw(st.integers(-3, 12))
    force = rng.normal(size=d) * E * dx ** (d - 1) * 1e-8
    pull = dict(zip("xyz", force, strict=False))
    kernel = st.sampled_from(KERNELS) if every else ORDERS
    cracks = []
    if d == 2 and draw(st.booleans()):
        a, b = rng.uniform(0.2, 3.8, (2, 2)) * dx
        cracks = [segment(tuple(a), tuple(b))]
    return jaxpd.Scene(
        body=body,
        material=jaxpd.Elastic(E, nu, state, rho=10.0 ** draw(st.integers(-3, 4))),
        supports=[jaxpd.holds(held)],
        loads=[jaxpd.pull(jaxpd.above(x=dx * 1.5), **pull)],
        cracks=cracks,
        resolution=jaxpd.Bonds(
            delta=2.3 * dx,
            kernel=draw(kernel),
            partial=draw(st.sampled_from(["none", "linear"])) if every else "linear",
            correction=draw(st.sampled_from(["none", "analytic"])) if every else None,
        ),
        kinematics=kinematics,
    )


def named(error):
    """A scene may be refused for two reasons: pieces, and points without stiffness."""
    assert str(error).split(": ")[0] in ("supports", "delta")


def solved(scene):
    """The solution of a scene, or None where it was refused or failed by name."""
    try:
        solution = jaxpd.solve_static(scene, rtol=1e-10, solver="direct")
    except ValueError as error:
        named(error)
        return None
    if solution.status is not Status.CONVERGED:
        with pytest.raises(NotConverged):
            solution.checked()
        return None
    return solution


def close(a, b, size, rtol):
    """Whether two arrays agree to a share of a size."""
    np.testing.assert_allclose(a, b, rtol=0, atol=rtol * float(size) + 1e-300)


def operator_of(scene):
    """The operator of a scene and its displacements at rest."""
    problem = jaxpd.prepare(scene, solver="direct")
    operator, _, load = problem.build(problem.params)
    return problem, operator, load


def statics(scene):
    """Finite, in balance, with work and energy that agree."""
    solution = solved(scene)
    if solution is None:
        return
    u, reaction = np.asarray(solution.u), np.asarray(solution.reaction)
    assert np.isfinite(u).all()
    assert np.isfinite(reaction).all()
    load = np.asarray(solution.problem.params["load"])
    size = np.abs(load).sum()
    close(reaction.sum(axis=0), -load.sum(axis=0), size, 1e-8)
    X = np.asarray(solution.X)
    for a in range(scene.d):
        for b in range(a):
            turn = X[:, a] * (load + reaction)[:, b] - X[:, b] * (load + reaction)[:, a]
            close(turn.sum(), 0.0, size * np.abs(X).max(), 1e-8)
    energy = float(np.sum(np.asarray(solution.energy)))
    work = float((load * u).sum())
    assert energy >= 0.0
    # the energy is that of finite displacements, which differs by a strain, 1e-7
    close(work, 2.0 * energy, abs(work), 1e-5)


@FEW
@given(scenes())
def test_supports_balance_loads_and_work_is_twice_the_energy(scene):
    statics(scene)


@pytest.mark.slow
@MANY
@given(scenes(every=True))
def test_many_supports_balance_loads_and_work_is_twice_the_energy(scene):
    statics(scene)


def moved(scene, order, map_X, regions):
    """A scene with its points in another order and place, held and pulled there."""
    X, vol = np.asarray(scene.body.X), np.asarray(scene.body.vol)
    load = scene.loads[0]
    return dataclasses.replace(
        scene,
        body=jaxpd.from_points(map_X(X[order]), vol[order]),
        supports=[jaxpd.holds(regions[0])],
        loads=[dataclasses.replace(load, region=regions[1])],
        cracks=[],
    )


def number_and_place(scene, seed):
    """The order of the points and where the body lies do not matter."""
    scene = dataclasses.replace(scene, cracks=[])
    first = solved(scene)
    if first is None:
        return
    held, pulled = scene.supports[0].region, scene.loads[0].region
    rng = np.random.default_rng(seed)
    order = rng.permutation(scene.body.n)
    u = np.asarray(first.u)
    size = np.abs(u).max()
    second = solved(moved(scene, order, lambda X: X, (held, pulled)))
    assert second is not None
    close(second.u, u[order], size, 1e-6)
    shift = 3.0 * scene.resolution.delta
    there = (jaxpd.below(x=held.at + shift), jaxpd.above(x=pulled.at + shift))
    third = solved(moved(scene, np.arange(len(u)), lambda X: X + shift, there))
    assert third is not None
    close(third.u, u, size, 1e-6)


@FEW
@given(scenes(), st.integers(0, 2**16))
def test_numbers_of_points_and_the_origin_do_not_matter(scene, seed):
    number_and_place(scene, seed)


@pytest.mark.slow
@MANY
@given(scenes(every=True), st.integers(0, 2**16))
def test_many_numbers_of_points_and_the_origin_do_not_matter(scene, seed):
    number_and_place(scene, seed)


@jax.jit
def response(problem, u):
    """Nodal forces (N) of displacements."""
    operator, _, _ = problem.build(problem.params)
    return operator.respond(u, operator.history0())


def rigid_motion(scene, seed):
    """Shifts and large turns pull at nothing; forces add up to nothing."""
    try:
        problem = jaxpd.prepare(scene, solver="direct")
    except ValueError as error:
        named(error)
        return
    rng = np.random.default_rng(seed)
    X, d = np.asarray(problem.X), scene.d
    Q = np.linalg.qr(rng.normal(size=(d, d)))[0]
    Q[:, 0] *= np.sign(np.linalg.det(Q))
    dx = scene.resolution.delta / 2.3
    rigid = X @ Q.T - X + dx * rng.normal(size=d)
    bent = 1e-2 * dx * rng.normal(size=X.shape)
    still, strained = (np.asarray(response(problem, u)) for u in (rigid, bent))
    size = np.abs(strained).max()
    assert np.isfinite(still).all()
    assert size > 0
    close(still, 0.0, size, 1e-10)
    close(strained.sum(axis=0), 0.0, np.abs(strained).sum(), 1e-12)


@FEW
@given(scenes("finite"), st.integers(0, 2**16))
def test_rigid_motions_pull_at_nothing(scene, seed):
    rigid_motion(scene, seed)


@pytest.mark.slow
@MANY
@given(scenes("finite", every=True), st.integers(0, 2**16))
def test_many_rigid_motions_pull_at_nothing(scene, seed):
    rigid_motion(scene, seed)


@pytest.mark.slow
@SOME
@given(scenes("finite", every=True), st.integers(0, 2**16))
def test_a_free_body_keeps_its_momentum(scene, seed):
    d, dx = scene.d, scene.resolution.delta / 2.3
    c = (scene.material.E / scene.material.rho) ** 0.5
    v = dict(zip(("vx", "vy", "vz"), 0.01 * c * np.arange(1.0, d + 1), strict=False))
    start = jaxpd.initially(jaxpd.above(x=dx * 1.5), **v)
    free = dataclasses.replace(scene, supports=[], loads=[], starts=[start])
    run = jaxpd.run_explicit(free, 3.0 * dx / c, records=3, progress=False).checked()
    mass = scene.material.rho * np.asarray(scene.body.vol)
    v0 = np.asarray(run.motion.params["v0"])
    P0 = (mass[:, None] * v0).sum(axis=0)
    P = (mass[:, None] * np.asarray(run.v)).sum(axis=0)
    assert np.isfinite(run.u).all()
    close(P, P0, np.abs(P0).max(), 1e-11)


@pytest.mark.slow
@SOME
@given(scenes(), st.integers(0, 2**16))
def test_gradients_are_right_along_a_direction(scene, seed):
    if solved(scene) is None:
        return
    problem = jaxpd.prepare(scene, solver="direct", rtol=1e-12)
    found = jaxpd.gradcheck.check(problem, ["E", "load"], seed=seed)
    assert all(taylor.right for taylor in found.values()), found
