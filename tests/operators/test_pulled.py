"""Operators on extended points, and the fictitious points beyond the faces of a box."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.discretize import Extension, beyond_faces
from jaxpd.geometry import from_points, lattice
from jaxpd.operators import BondForce, Pulled, bond_weights
from tests.catalogue import LAWS, random_cloud
from tests.discretize.test_surface import strip


@pytest.fixture(scope="module")
def problem():
    """A plate of 7 x 8 points, m = 2, fictitious points all around, finite strains."""
    scene = strip("fictitious", 7, 8, 2, kinematics="finite")
    return jaxpd.prepare(scene, solver="d-pcg")


@pytest.fixture(scope="module")
def op(problem):
    return jax.jit(lambda p: p.build(p.params)[0])(problem)


@jax.jit
def response(op, u):
    energy, slope = jax.value_and_grad(op.energy)(u)
    K = op.tangent(u)
    return op.respond(u), energy, slope, op.energy_per_point(u), K, K.diagonal()


def dense(K, n, d):
    rows, cols, blocks = map(np.asarray, jax.jit(lambda K: K.coo())(K))
    A = np.zeros((n, d, n, d))
    np.add.at(A, (rows, slice(None), cols), blocks)
    return A.reshape(n * d, n * d)


def check_laws_of_nature(op, X, u):
    """Momenta, energy and tangent of a pulled operator at a displacement."""
    n, d = u.shape
    force, energy, slope, per_point, K, diagonal = response(op, u)
    scale = float(np.abs(force).sum())
    np.testing.assert_allclose(slope, -force, rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(per_point.sum(), energy, rtol=1e-12)
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-13 * scale)
    moment = np.asarray(X + u)[:, :, None] * np.asarray(force)[:, None, :]
    turn = (moment - moment.transpose(0, 2, 1)).sum(axis=0)
    np.testing.assert_allclose(turn, 0.0, atol=1e-13 * scale)
    A = K.to_bsr().toarray()
    np.testing.assert_allclose(A, A.T, rtol=0, atol=1e-14 * abs(A).max())
    B = dense(K, n, d)
    np.testing.assert_allclose(A, B, rtol=0, atol=1e-14 * abs(A).max())
    v = np.random.default_rng(1).normal(size=u.shape)
    product = jax.jit(lambda K, v: K.mv(v))(K, v)
    np.testing.assert_allclose(
        product.ravel(), A @ v.ravel(), rtol=0, atol=1e-13 * abs(A).max()
    )
    return A, diagonal


def test_fictitious_points_keep_the_laws_of_nature(op, problem, rng):
    X = problem.X
    u = jnp.asarray(rng.normal(scale=1e-4, size=X.shape))
    check_laws_of_nature(op, X, u)
    A, diagonal = check_laws_of_nature(op, X, 0.0 * u)
    low = np.linalg.eigvalsh(A)
    assert np.linalg.eigvalsh(diagonal).min() > 0
    # the three rigid motions and nothing else is without energy
    assert (np.abs(low[:3]) < 1e-14 * low[-1]).all()
    assert low[3] > 1e-3 * low[-1]
    # not the exact blocks, but nothing that a preconditioner minds: measured 1.0 to 1.9
    exact = A.reshape(len(X), 2, len(X), 2)[np.arange(len(X)), :, np.arange(len(X))]
    ratio = np.trace(diagonal, axis1=1, axis2=2) / np.trace(exact, axis1=1, axis2=2)
    assert 0.99 < ratio.min() < ratio.max() < 2.5


def test_under_affine_fields_every_point_has_the_energy_of_the_bulk(op, problem, rng):
    X = np.asarray(problem.X)
    F = 1e-6 * rng.normal(size=(2, 2))
    per_point = np.asarray(response(op, jnp.asarray(X @ F.T))[3])
    np.testing.assert_allclose(per_point, per_point[0], rtol=1e-9)
    turn = np.array([[0.0, -1.0], [1.0, 0.0]])  # by a right angle, not by a little
    turned = response(op, jnp.asarray(X @ turn.T - X))[0]
    size = np.abs(response(op, jnp.asarray(X))[0]).max()
    np.testing.assert_allclose(turned, 0.0, atol=1e-13 * size)


def test_affine_fields_are_continued_exactly_in_three_dimensions(rng):
    cloud = lattice((0, 0, 0), (0.5, 0.3, 0.4), 0.1)
    family, P = beyond_faces(
        cloud, 0.15, partial="continuous", free=[(True, True), (False, True), (1, 0)]
    )
    X = np.asarray(P(cloud.X))
    new = X[cloud.n :]
    low, high = new.min(axis=0), new.max(axis=0)
    np.testing.assert_allclose(low, [-0.2, 0.0, -0.2], atol=1e-12)
    np.testing.assert_allclose(high, [0.7, 0.5, 0.4], atol=1e-12)
    length = np.linalg.norm(X[np.asarray(family.nbr)] - X, axis=2)
    assert length.max() < 0.2 + 1e-12  # numbers and places belong together
    F, b = rng.normal(size=(3, 3)), rng.normal(size=(1, 3))
    np.testing.assert_allclose(P(cloud.X @ F.T + b), X @ F.T + b, atol=1e-13)
    full = P.matrix(cloud.n)
    values = rng.normal(size=(full.shape[0], 3))
    np.testing.assert_allclose(P.transpose(jnp.asarray(values)), full.T @ values)


def test_ghosts_that_are_means_of_two_points_hand_their_energy_on(rng):
    """The general case: points between others, as between plies."""
    cloud = random_cloud(rng, 2, 20)
    n, q = cloud.n, 5
    sources = np.stack([np.arange(q), np.arange(q) + 20], 1).astype(np.int32)
    P = Extension(jnp.asarray(sources), jnp.full((q, 2), 0.5))
    X = P(cloud.X)
    everyone = from_points(X, jnp.full(n + q, 1.0 / n))
    delta = jnp.asarray(0.3)
    family = jaxpd.geometry.find(everyone, 0.3)
    weight = bond_weights(X, everyone.vol, family, delta)
    full = BondForce(X, family.nbr, weight, LAWS["user's energy"](2), delta)
    u = jnp.asarray(rng.normal(scale=0.01, size=(n, 2)))
    check_laws_of_nature(Pulled(full, P), cloud.X, u)


@pytest.mark.slow
def test_a_strip_with_fictitious_points_is_stretched_evenly():
    found = jaxpd.solve_static(strip("fictitious", 11, 9, 2), rtol=1e-9).checked()
    E = np.asarray(found.energy_density).reshape(11, 9)[5] / 1e-6
    # of every row, against the middle
    np.testing.assert_allclose(E, E[4], rtol=0.02)


def test_fictitious_points_say_where_they_cannot_be():
    scene = strip("fictitious", 9, 9, 3)

    def refuses(match, **parts):
        with pytest.raises(ValueError, match=match):
            jaxpd.prepare(dataclasses.replace(scene, **parts))

    with pytest.raises(
        ValueError, match=r"operator: 'stencil' does not .* use 'gather"
    ):
        jaxpd.prepare(scene, operator="stencil")
    crack = jaxpd.segment((-0.03, 0.0), (0.03, 0.0))
    refuses("cracks: .* within a horizon of a face .* use correction=", cracks=[crack])
    E = np.full(81, 2.0)
    refuses(
        "E: a modulus of every point", material=jaxpd.Elastic(E, 1 / 3, "plane stress")
    )
    thin = strip("fictitious", 9, 4, 3)
    refuses(
        "needs 5 rows .* the body has 4; refine", body=thin.body, supports=thin.supports
    )
    X = lattice((-0.08, -0.08), (0.08, 0.08), 0.02).X
    refuses("needs a lattice", body=from_points(X, 4e-4))
    held = [jaxpd.holds(half(**{axis: sign * 0.08})) for axis in "xy"
            for half, sign in ((jaxpd.above, 1), (jaxpd.below, -1))]  # fmt: skip
    refuses("finds no free face; use 'none' or 'lattice'", supports=held)
