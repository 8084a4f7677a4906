import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.sparse.linalg as spla

from jaxpd.solvers import Status, block_jacobi, cg, extremes, pcg, point_jacobi


def spd(rng, n, condition):
    Q, _ = np.linalg.qr(rng.normal(size=(n, n)))
    return (Q * np.geomspace(1.0, condition, n)) @ Q.T


@pytest.fixture
def system(rng):
    A = jnp.asarray(spd(rng, 60, 1e4))
    return A, jnp.asarray(rng.normal(size=60))


def test_pcg_agrees_with_jax_and_scipy(system):
    A, b = system
    x, info = jax.jit(lambda A, b: pcg(lambda v: A @ v, b, rtol=1e-8))(A, b)
    y, other = jax.jit(lambda A, b: cg(lambda v: A @ v, b, rtol=1e-8))(A, b)
    assert int(info.status) == int(other.status) == Status.CONVERGED
    exact = np.linalg.solve(A, b)
    # cond(A) rtol |x| is what a residual promises
    for z in (x, y):
        assert np.linalg.norm(z - exact) <= 1e4 * 1e-8 * np.linalg.norm(exact)
    count = []
    spla.cg(np.asarray(A), np.asarray(b), rtol=1e-8, callback=lambda _: count.append(1))
    # beyond 60 iterations, the size of the system, round-off has a say: 198 and 196
    assert abs(int(info.iterations) - len(count)) <= 0.02 * len(count)
    history = np.asarray(info.residuals)[: int(info.iterations) + 1]
    assert history[0] == 1.0
    true = np.linalg.norm(b - A @ x) / np.linalg.norm(b)
    assert history[-1] == pytest.approx(true, rel=1e-12)
    assert true <= 1e-8
    assert np.isnan(np.asarray(info.residuals)[int(info.iterations) + 1 :]).all()


def test_the_true_residual_is_met_where_the_recursive_one_drifts(rng):
    A = jnp.asarray(spd(rng, 100, 1e7))
    b = A @ jnp.asarray(rng.normal(size=100))
    x, info = jax.jit(lambda A, b: pcg(lambda v: A @ v, b, rtol=1e-10))(A, b)
    assert int(info.status) == Status.CONVERGED
    assert np.linalg.norm(b - A @ x) <= 1e-10 * np.linalg.norm(b)


def test_preconditioners_and_initial_guesses_help(rng):
    scale = jnp.asarray(np.geomspace(1, 1e3, 60))
    A = jnp.asarray(spd(rng, 60, 10.0)) * scale[:, None] * scale[None, :]
    b = jnp.asarray(rng.normal(size=(60, 1)))
    mv = lambda v: A @ v  # noqa: E731
    exact = jnp.linalg.solve(A, b)
    plain = pcg(mv, b)[1]
    diagonal = point_jacobi(jnp.diagonal(A).reshape(60, 1, 1))
    helped = pcg(mv, b, precondition=diagonal)[1]
    assert int(helped.iterations) < int(plain.iterations) / 2
    x, warm = pcg(mv, b, precondition=diagonal, x0=exact)
    assert int(warm.iterations) == 0
    np.testing.assert_array_equal(x, exact)
    x, near = pcg(mv, b, precondition=diagonal, x0=exact * (1 + 1e-3))
    assert 0 < int(near.iterations) <= int(helped.iterations)
    assert jnp.linalg.norm(b - mv(x)) <= 1e-6 * jnp.linalg.norm(b)


def test_blocks_are_inverted(rng):
    blocks = jnp.asarray(np.stack([spd(rng, 3, 50.0) for _ in range(7)]))
    r = jnp.asarray(rng.normal(size=(7, 3)))
    want = np.stack([np.linalg.solve(B, v) for B, v in zip(blocks, r, strict=True)])
    np.testing.assert_allclose(block_jacobi(blocks)(r), want, rtol=1e-10)


@pytest.mark.parametrize(
    ("matrix", "precondition", "b", "status"),
    [
        (np.diag([1.0, -1.0]), None, [1.0, 2.0], Status.NEGATIVE_CURVATURE),
        (np.diag([1.0, 2.0]), lambda r: -r, [1.0, 2.0], Status.BREAKDOWN),
        (np.diag([1.0, np.nan]), None, [1.0, 2.0], Status.NOT_FINITE),
        (np.diag([1.0, 2.0]), None, [np.nan, 2.0], Status.NOT_FINITE),
        (np.diag([1.0, 0.0]), None, [1.0, 2.0], Status.NEGATIVE_CURVATURE),
    ],
)
def test_each_failure_has_its_own_status(matrix, precondition, b, status):
    A = jnp.asarray(matrix)
    x, info = pcg(
        lambda v: A @ v, jnp.asarray(b), precondition=precondition, maxiter=20
    )
    assert Status(int(info.status)) is status
    if np.isfinite(b).all() and np.isfinite(matrix).all():
        assert np.isfinite(x).all()  # the last good iterate, not garbage


def test_a_limit_of_iterations_is_kept_and_told(system):
    A, b = system
    _, info = pcg(lambda v: A @ v, b, maxiter=5)
    assert int(info.iterations) == 5
    assert Status(int(info.status)) is Status.MAX_ITERATIONS
    _, other = cg(lambda v: A @ v, b, maxiter=5)
    assert Status(int(other.status)) is Status.MAX_ITERATIONS


def test_nothing_to_do_is_nothing_done(system):
    A, b = system
    x, info = pcg(lambda v: A @ v, 0.0 * b)
    np.testing.assert_array_equal(x, 0.0)
    assert int(info.iterations) == 0
    assert int(info.status) == Status.CONVERGED


def test_batches_stop_one_by_one(rng):
    A = jnp.asarray(np.stack([spd(rng, 20, c) for c in (2.0, 1e3)]))
    b = jnp.asarray(rng.normal(size=(2, 20)))
    x, info = jax.vmap(lambda A, b: pcg(lambda v: A @ v, b, rtol=1e-9))(A, b)
    counts = np.asarray(info.iterations)
    alone = [int(pcg(lambda v, M=M: M @ v, r, rtol=1e-9)[1].iterations) for M, r in zip(A, b, strict=True)]  # fmt: skip  # noqa: E501
    np.testing.assert_array_equal(counts, alone)
    assert counts[0] < counts[1]
    for M, y, r in zip(A, x, b, strict=True):
        assert np.linalg.norm(r - M @ y) <= 1e-9 * np.linalg.norm(r)


def test_lanczos_finds_both_ends(rng):
    A = jnp.asarray(spd(rng, 300, 1e4) * 7.0)
    found = extremes(lambda v: A @ v, jnp.asarray(rng.normal(size=300)), rtol=1e-6)
    assert found.smallest == pytest.approx(7.0, rel=1e-6)
    assert found.condition == pytest.approx(1e4, rel=1e-6)
    small = extremes(lambda v: 3.0 * v, jnp.asarray(rng.normal(size=5)))
    assert small.condition == pytest.approx(1.0, rel=1e-12)


def test_lanczos_refuses_what_it_cannot_do(rng):
    start = jnp.asarray(rng.normal(size=50))
    D = jnp.linspace(-1.0, 1.0, 50)
    with pytest.raises(ValueError, match="mv: not positive definite"):
        extremes(lambda v: D * v, start)
    D = jnp.geomspace(1e-6, 1.0, 50)
    with pytest.raises(ValueError, match="max_steps: 10 Lanczos steps reach"):
        extremes(lambda v: D * v, start, max_steps=10, chunk=10)
