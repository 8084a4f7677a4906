"""Laws of nature, looped over the catalogue of laws and dimensions."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from tests.catalogue import LAWS, operator

#: All laws in 2-D; one of each kind (built in, energy alone, force alone) in 1 and 3-D.
KINDS = ("fractional 0", "user's energy", "user's force")
CASES = [(name, d) for name in LAWS for d in (1, 2, 3) if d == 2 or name in KINDS]


@jax.jit
def response(op, u):
    K = op.tangent(u)
    return op.respond(u), K.mv(u), K.diagonal(), K


@jax.jit
def energy_and_gradient(op, u):
    return jax.value_and_grad(op.energy)(u)


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]} {case[1]}-D")
def case(request, rng):
    name, d = request.param
    op = operator(rng, LAWS[name](d), d)
    # stretches of either sign; points are some 0.1 apart
    u = jnp.asarray(rng.normal(scale=0.01, size=op.X.shape))
    return op, u


def rotation(rng, d):
    Q, _ = np.linalg.qr(rng.normal(size=(d, d)))
    return Q if np.linalg.det(Q) > 0 else Q * np.array([-1.0] + [1.0] * (d - 1))


def test_rest_is_without_force(case):
    op, u = case
    np.testing.assert_array_equal(response(op, 0.0 * u)[0], 0.0)


def test_both_momenta_are_conserved(case):
    op, u = case
    force = np.asarray(response(op, u)[0])
    scale = np.abs(force).sum()
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-14 * scale)
    x = np.asarray(op.X + u)
    moment = x[:, :, None] * force[:, None, :]
    turn = (moment - moment.transpose(0, 2, 1)).sum(axis=0)
    np.testing.assert_allclose(turn, 0.0, atol=1e-14 * scale)


def test_energy_gradient_is_minus_the_force(case):
    op, u = case
    if not hasattr(op.law, "energy"):
        pytest.skip("the law has no energy")
    _, gradient = energy_and_gradient(op, u)
    force = response(op, u)[0]
    # measured 8e-16
    np.testing.assert_allclose(gradient, -force, rtol=0, atol=1e-13 * abs(force).max())


def test_tangent_is_symmetric_and_the_derivative_of_the_force(case, rng):
    op, u = case
    _, _, _, K = response(op, u)
    v = jnp.asarray(rng.normal(size=u.shape))
    Kv = jax.jit(lambda K, v: K.mv(v))(K, v)
    _, slope = jax.jit(lambda op, u, v: jax.jvp(op.respond, (u,), (v,)))(op, u, v)
    np.testing.assert_allclose(Kv, -slope, rtol=0, atol=1e-13 * abs(slope).max())
    A = K.to_bsr().toarray()
    np.testing.assert_allclose(A, A.T, rtol=0, atol=1e-14 * abs(A).max())
    np.testing.assert_allclose(
        A @ v.ravel(), Kv.ravel(), rtol=0, atol=1e-13 * abs(Kv).max()
    )


def test_assembly_by_coo_and_by_bsr_agree(case):
    op, u = case
    K = response(op, u)[3]
    n, d = u.shape
    rows, cols, blocks = map(np.asarray, jax.jit(lambda K: K.coo())(K))
    A = np.zeros((n, d, n, d))
    for r, c, block in zip(rows, cols, blocks, strict=True):
        A[r, :, c, :] += block
    B = K.to_bsr().toarray()
    np.testing.assert_allclose(A.reshape(B.shape), B, rtol=0, atol=1e-14 * abs(B).max())
    own = [A[i, :, i, :] for i in range(n)]
    np.testing.assert_allclose(K.diagonal(), own, rtol=0, atol=1e-14 * abs(B).max())


def test_hand_derived_blocks_equal_ad_blocks(case):
    op, u = case
    if not hasattr(op.law, "tangent"):
        pytest.skip("the law has no hand-derived tangent")
    ad = response(op, u)[3].blocks
    hand = response(dataclasses.replace(op, blocks="hand"), u)[3].blocks
    size = jnp.abs(hand).max(axis=(2, 3), keepdims=True)
    error = jnp.abs(ad - hand) / jnp.where(size > 0, size, 1.0)
    assert error.max() <= 1e-13  # relative to each bond's own block; measured 8e-15


def test_translation_and_rotation_leave_the_force_objective(case, rng):
    op, u = case
    d = u.shape[1]
    force = response(op, u)[0]
    moved = response(op, u + jnp.asarray(rng.normal(size=(1, d))))[0]
    atol = 1e-12 * abs(force).max()  # round-off of u against bonds of length 0.1
    np.testing.assert_allclose(moved, force, rtol=0, atol=atol)
    Q = jnp.asarray(rotation(rng, d))
    turned = response(op, (op.X + u) @ Q.T - op.X)[0]
    np.testing.assert_allclose(turned, force @ Q.T, rtol=0, atol=atol)


def test_numbering_of_the_points_does_not_matter(case, rng):
    op, u = case
    new = rng.permutation(len(u))  # new[i] is the old number of point i
    old = np.argsort(new)
    shuffled = dataclasses.replace(
        op, X=op.X[new], nbr=jnp.asarray(old)[op.nbr[:, new]].astype(op.nbr.dtype),
        weight=op.weight[:, new],
    )  # fmt: skip
    np.testing.assert_array_equal(
        response(shuffled, u[new])[0], response(op, u)[0][new]
    )


@pytest.mark.parametrize("partial", ["none", "linear", "continuous"])
def test_weights_are_symmetric_in_the_ends_of_a_bond(rng, partial):
    op = operator(rng, LAWS["pmb"](2), 2, partial=partial)
    n = op.X.shape[0]
    W = np.zeros((n, n))
    W[np.asarray(op.nbr), np.arange(n)[None, :]] = np.asarray(op.weight)
    np.fill_diagonal(W, 0.0)
    np.testing.assert_allclose(W, W.T, rtol=1e-14)
    assert (W > 0).sum() == (np.asarray(op.nbr) != np.arange(n)).sum()


def test_nodal_and_per_bond_leaves_mean_the_same(rng):
    op = operator(rng, LAWS["pmb"](2), 2)
    u = jnp.asarray(rng.normal(scale=0.01, size=op.X.shape))
    field = jnp.asarray(rng.uniform(1.0, 5.0, len(u)))
    nodal = dataclasses.replace(op, law=dataclasses.replace(op.law, c=field))
    mean = 0.5 * (field[None, :] + field[op.nbr])
    bonded = dataclasses.replace(op, law=dataclasses.replace(op.law, c=mean))
    for a, b in zip(response(nodal, u)[:3], response(bonded, u)[:3], strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-14 * abs(b).max())
    wrong = dataclasses.replace(op, law=dataclasses.replace(op.law, c=jnp.ones(3)))
    with pytest.raises(ValueError, match=r"law: a leaf .* \(3,\)"):
        wrong.respond(u)
