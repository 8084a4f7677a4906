"""Ghost interlayers as operators: laws of nature, tangents, breaking, sums."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.operators import BondForce, Sum
from tests.operators.test_pulled import check_laws_of_nature, dense

GLASS = jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress", rho=1.0)
CUBE = jaxpd.Elastic(1.0, nu=1 / 4, state="solid", rho=1.0)


def stack(d=2, *, ratio=1.0, layers=None, rule="rigid", plies=2, **more):
    """Plies of 4 or 6 spacings with gaps of 1.5; every second one `ratio` finer."""
    boxes, at = [], 0.0
    for _ in range(plies):
        lo, hi = [0.0] * d, [0.48] * d
        lo[-1], hi[-1] = at, at + 0.48
        boxes.append(jaxpd.box(lo, hi))
        at += 0.63
    if layers is None:
        layers = jaxpd.interlayer(0.3, shear=0.05, rule=rule)
    dx = [0.12 if i % 2 == 0 else 0.12 / ratio for i in range(plies)]
    return jaxpd.Scene(
        body=jaxpd.laminate(boxes, layers),
        material=GLASS if d == 2 else CUBE,
        resolution=[
            jaxpd.Bonds(dx=x, delta=0.25, nodes="cell", kernel=jaxpd.fractional(-1.0))
            for x in dx
        ],
        supports=[jaxpd.holds(jaxpd.below(y=0.1) if d == 2 else jaxpd.below(z=0.1))],
        **more,
    )


@pytest.fixture(scope="module", params=["3 plies, 2 : 3", "3-D"])
def problem(request):
    """Gathered bonds: three plies that do not match, and matching ones in 3-D."""
    d, ratio, plies = (2, 1.5, 3) if request.param == "3 plies, 2 : 3" else (3, 1.0, 2)
    layers = jaxpd.interlayer(0.3, shear=0.05, rule="rigid")
    scene = stack(d, ratio=ratio, plies=plies, layers=layers)
    return jaxpd.prepare(scene, solver="d-pcg", operator="gather")


@pytest.fixture(scope="module")
def op(problem):
    return jax.jit(lambda p: p.build(p.params)[0])(problem)


def test_a_laminate_keeps_the_laws_of_nature(rng, problem, op):
    u = 0.02 * rng.normal(size=problem.X.shape)
    check_laws_of_nature(op, problem.X, jnp.asarray(u))


def test_joints_agree_with_their_own_derivatives(rng, op):
    for joint in op.joints:
        u = jnp.asarray(0.02 * rng.normal(size=joint.joint.X.shape))

        @jax.jit
        def response(joint, u):
            jacobian = -jax.jacfwd(joint.respond)(u)
            return jacobian, joint.tangent(u), joint.tangent(u).diagonal()

        jacobian, K, diagonal = response(joint, u)
        p, d = u.shape
        jacobian = np.asarray(jacobian).reshape(p * d, p * d)
        A = dense(K, p, d)
        scale = 1e-13 * abs(A).max()
        np.testing.assert_allclose(A, jacobian, rtol=0, atol=scale)
        np.testing.assert_allclose(K.to_bsr().toarray(), A, rtol=0, atol=scale)
        own = A.reshape(p, d, p, d)[np.arange(p), :, np.arange(p)]
        np.testing.assert_allclose(diagonal, own, rtol=0, atol=scale)


def test_the_bound_of_a_joint_is_above_its_stiffness(op):
    """u . K u <= 2 sum u_i . B_i u_i, as `stable_dt` needs."""
    bound = jax.jit(lambda op, rest: (op.tangent(rest), op.diagonal(op.history0())))
    for joint in op.joints:
        p, d = joint.joint.X.shape
        K, blocks = bound(joint, jnp.zeros((p, d)))
        B = np.zeros((p, d, p, d))
        B[np.arange(p), :, np.arange(p)] = blocks
        gap = np.linalg.eigvalsh(2.0 * B.reshape(p * d, -1) - K.to_bsr().toarray())
        assert gap.min() > -1e-12 * gap.max()


def test_rigid_motion_moves_no_glue(rng, problem, op):
    """A large rotation and a shift: no force at all, in 2-D and 3-D."""
    X = jnp.asarray(problem.X)
    q, _ = np.linalg.qr(rng.normal(size=(X.shape[1],) * 2))
    if np.linalg.det(q) < 0.0:
        q[:, 0] *= -1.0
    u = X @ q.T + 0.3 - X
    respond = jax.jit(lambda op, u: op.respond(u))
    for joint in op.joints:
        force = respond(joint, u[joint.joint.points])
        scale = float(jnp.abs(respond(joint, 0.01 * joint.joint.X)).max())
        np.testing.assert_allclose(force, 0.0, rtol=0, atol=1e-12 * scale)


def test_the_stiffness_between_rigid_plies_is_what_was_asked_for(op):
    """One ply shifted against the other: E / h across, shear / h along."""
    joint = op.joints[0]
    X, h = joint.joint.X, 0.15
    axis, area = X.shape[1] - 1, float(joint.joint.area.sum())
    upper = X[:, axis] > 0.555
    for along, modulus in ((axis, 0.3), (0, 0.05)):
        u = np.zeros(X.shape)
        u[upper, along] = 1e-3
        K = jax.jit(lambda op, u: op.tangent(u))(joint, jnp.zeros(X.shape)).to_bsr()
        force = (K @ u.ravel()).reshape(u.shape)
        found = force[upper].sum(axis=0)[along] / (1e-3 * area)
        # ghosts at the rim lean to one side: shear is that of the mean ghost
        rtol = 1e-12 if along == axis else 0.05
        np.testing.assert_allclose(found, modulus / h, rtol=rtol)


def test_a_ghost_breaks_whole_at_its_fracture_energy_and_still_resists_contact():
    layer = jaxpd.interlayer(0.3, shear=0.05, G0=2e-4, rule="rigid")
    motion = jaxpd.prepare_motion(stack(layers=layer))
    op = jax.jit(lambda m: m.build(m.params)[0])(motion).joints[0]
    X = op.joint.X
    upper = X[:, 1] > 0.555
    area, history = np.asarray(op.joint.area), op.history0()

    def shifted(*u):
        return jnp.asarray(np.where(upper[:, None], np.asarray(u)[None], 0.0))

    critical = np.sqrt(2 * 2e-4 / (0.3 / 0.15))

    @jax.jit
    def after(op, u, history):
        slope = jax.grad(op.energy)(u, history)
        energy, force = op.energy(u, history), op.respond(u, history)
        return op.advance(u, history), energy, force, slope

    # uniform opening by less than, and more than, the critical one; squeezing never
    assert after(op, shifted(0.0, 0.98 * critical), history)[0].max() < 0
    assert after(op, shifted(0.0, -5.0 * critical), history)[0].max() < 0
    broken, stored, _, _ = after(op, shifted(0.0, 1.05 * critical), history)
    assert broken.min() >= 0
    np.testing.assert_allclose(stored, 1.05**2 * 2e-4 * area.sum(), rtol=0.01)
    released = op.released(broken, history)
    np.testing.assert_allclose(released, stored, rtol=1e-12)
    # sliding breaks it too, at the same energy
    slide = np.sqrt(2 * 2e-4 / (0.05 / 0.15))
    assert after(op, shifted(1.2 * slide, 0.0), history)[0].min() >= 0
    # gone in tension, there in compression, and it does not heal
    assert np.abs(after(op, shifted(0.0, 0.5 * critical), broken)[2]).max() == 0
    healed, _, back, slope = after(op, shifted(0.01 * critical, -critical), broken)
    pushed = np.asarray(back)[upper].sum(axis=0)[1]
    np.testing.assert_allclose(pushed, 2.0 * critical * area.sum(), rtol=1e-4)
    assert healed.min() >= 0
    # energy of contact is energy: the force is its derivative
    np.testing.assert_allclose(slope, -back, atol=1e-16)


def test_without_reaction_momentum_is_lost(rng):
    """Paper 002, eq. 13: the force on ghosts is dropped, K is not symmetric."""
    layer = jaxpd.interlayer(0.3, rule="paper", one_way=True)
    problem = jaxpd.prepare(stack(layers=layer), solver="direct", operator="gather")
    op = jax.jit(lambda p: p.build(p.params)[0])(problem)
    assert not op.symmetric
    u = jnp.asarray(0.02 * rng.normal(size=problem.X.shape))
    joint = op.joints[0]

    @jax.jit
    def response(op, u):
        return op.respond(u), op.tangent(u), -jax.jacfwd(op.respond)(u)

    force, K, jacobian = response(joint, u[joint.joint.points])
    assert np.abs(force.sum(axis=0)).max() > 1e-3 * float(jnp.abs(force).sum())
    A = K.to_bsr().toarray()
    np.testing.assert_allclose(
        A, np.asarray(jacobian).reshape(A.shape), rtol=0, atol=1e-13 * abs(A).max()
    )
    with pytest.raises(ValueError, match="symmetric"):
        problem.solver("d-pcg")


def test_a_sum_refuses_mixed_units(op):
    @dataclasses.dataclass(frozen=True)
    class Density:
        unit: str = "N/m^3"

    with pytest.raises(ValueError, match="cannot be added"):
        _ = Sum((*op.plies, Density()), (), op.sizes).unit
    assert isinstance(op.plies[0], BondForce)
    assert op.unit == "N"


def test_memories_of_a_sum_come_in_order(problem, op):
    u = jnp.zeros(problem.X.shape)
    step = jax.jit(lambda op, u: op.advance(u, op.history0()))
    after = step(op, u)
    assert len(after) == len(op.plies) + len(op.joints)
    assert all(h.max() < 0 for h in after[len(op.plies) :])
