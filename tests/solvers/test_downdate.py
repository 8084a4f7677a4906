"""A factorisation that loses rank-one parts, against dense algebra."""

import numpy as np
import pytest
import scipy.sparse as sp

from jaxpd.solvers.downdate import GONE, Downdated, Singular


def springs(rng, size=30, count=120):
    """K = B^T B of a well connected net."""
    B = np.where(rng.random((count, size)) < 0.2, rng.normal(size=(count, size)), 0.0)
    return B, sp.csr_array(B.T @ B)


def test_solves_follow_the_losses(rng):
    B, K = springs(rng)
    inverse = Downdated(B.shape[1])
    inverse.factorise(K)
    b = rng.normal(size=B.shape[1])
    for row in B[:20]:
        at = np.flatnonzero(row)
        w = inverse.along(at, 0.7 * row[at])
        inverse.lose(w, 1.0 / 0.7**2, 1.0 - (row[at] / 0.7) @ w[at])
    left = B[20:].T @ B[20:]
    exact = np.linalg.solve(left, b)
    np.testing.assert_allclose(inverse.solve(b), exact, rtol=0, atol=1e-9)
    assert inverse.factorisations == 1


def test_the_list_of_corrections_ends(rng):
    B, K = springs(rng)
    inverse = Downdated(B.shape[1])
    inverse.factorise(K)
    w = np.zeros(B.shape[1])
    while not inverse.full:
        inverse.lose(w, 0.0, 1.0)
    inverse.lose(w, 0.0, 1.0)
    with pytest.raises(ValueError, match="factorise first"):
        inverse.lose(w, 0.0, 1.0)


def test_a_motion_without_stiffness_is_pinned_and_forces_stay_exact():
    """A chain of three free points loses its last hold: the pin carries nothing."""
    k = np.array([2.0, 3.0, 5.0])  # ground-0, 0-1, 1-2
    B = np.array([[1.0, 0, 0], [-1.0, 1.0, 0], [0, -1.0, 1.0]])
    inverse = Downdated(3)
    inverse.factorise(sp.csr_array(B.T @ (k[:, None] * B)))
    at, g = np.array([0]), np.array([1.0])
    w = inverse.along(at, g)
    assert abs(1.0 - k[0] * w[0]) <= GONE  # all three move together
    np.testing.assert_allclose(w, w[0], rtol=1e-12)
    inverse.pin(2, 7.0)
    w = inverse.along(at, g)
    inverse.lose(w, k[0], 1.0 - k[0] * w[0])
    b = np.array([-1.0, 0.0, 1.0])  # in balance by itself
    u = inverse.solve(b)
    assert abs(u[2]) < 1e-12
    np.testing.assert_allclose(k[1:] * (B[1:] @ u), [1.0, 1.0], rtol=1e-12)


def test_a_singular_matrix_is_named():
    with pytest.raises(Singular, match="singular"):
        Downdated(2).factorise(sp.csr_array((2, 2)))
