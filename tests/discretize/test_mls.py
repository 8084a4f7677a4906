"""Derivatives by moving least squares: what is reproduced, and how errors fall."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize import (
    apply_weights,
    curvatures,
    derivative_weights,
    find_stars,
    powers,
    slopes,
    spacing,
)
from jaxpd.geometry import mapped

WEIGHTS = jax.jit(derivative_weights, static_argnums=3)


def cloud(d, n, jitter, seed=0):
    return np.asarray(mapped((n,) * d, lambda s: s, jitter=jitter, seed=seed).X)


@pytest.mark.parametrize(
    ("d", "degree", "n"), [(1, 4, 9), (2, 2, 7), (2, 3, 8), (3, 2, 5)]
)
def test_polynomials_of_the_basis_have_exact_derivatives_of_all_orders(
    d, degree, n, rng
):
    X = cloud(d, n, 0.3)
    stars = find_stars(X, X, (1.1 + degree) * spacing(X), degree)
    places = jnp.asarray(X)
    weights = jax.jit(derivative_weights, static_argnums=3)(
        places, places, stars, degree
    )
    index = powers(d, degree)
    coefficient = rng.normal(size=len(index))

    def derivative(power):  # of the polynomial, by hand
        total = np.zeros(len(X))
        for c, p in zip(coefficient, index, strict=True):
            if all(q >= k for q, k in zip(p, power, strict=True)):
                factor = np.prod(
                    [math.perm(q, k) for q, k in zip(p, power, strict=True)]
                )
                total += c * factor * np.prod(X ** np.subtract(p, power), axis=1)
        return total

    values = jnp.asarray(derivative((0,) * d))
    found = apply_weights(weights, stars.nbr, values)
    for power, value in zip(index, found, strict=True):
        scale = spacing(X).min() ** -sum(power)
        exact = derivative(power)
        np.testing.assert_allclose(value, exact, rtol=0, atol=1e-13 * scale)


def test_the_reproducing_test_of_the_paper_has_its_slopes_and_levels():
    """Paper 001, Fig. 1: equal slopes; its levels hold with the ends alone."""
    errors = []
    for n in (61, 241):
        X = cloud(1, n, 0.0)
        x = X[:, 0]
        stars = find_stars(X, X, 2.5 / (n - 1), 2)
        w = WEIGHTS(jnp.asarray(X), jnp.asarray(X), stars, 2)
        first, second = slopes(w, 1), curvatures(w, 1, 2)
        u, exact = np.sin(2 * x) + np.exp(x), -4 * np.sin(2 * x) + np.exp(x)
        once = apply_weights(first, stars.nbr, jnp.asarray(u))[0]
        double = apply_weights(first, stars.nbr, once)[0] - exact
        direct = apply_weights(second, stars.nbr, jnp.asarray(u))[0, 0] - exact
        norm = np.linalg.norm
        inner = slice(4, -4)
        errors.append(
            [
                norm(double) / norm(exact),
                norm(direct) / norm(exact),
                norm(double[inner]) / norm(exact[inner]),
                norm(direct[inner]) / norm(exact[inner]),
            ]
        )
    errors = np.array(errors)
    rates = np.log2(errors[0] / errors[1]) / 2
    np.testing.assert_allclose(rates, [1.5, 1.5, 2.0, 2.0], atol=0.05)
    assert errors[0, 0] / errors[0, 1] == pytest.approx(0.81, abs=0.01)
    assert errors[0, 2] / errors[0, 3] == pytest.approx(2.9, abs=0.05)


def test_a_support_grows_until_its_moments_are_sound():
    X = cloud(2, 7, 0.4, seed=2)
    stars = find_stars(X, X, 1.05 * spacing(X), 2)  # too small everywhere
    grown = np.asarray(stars.support) / spacing(X)
    assert grown.min() > 1.05
    assert np.asarray(stars.there).sum(axis=0).min() >= 6


def test_degenerate_stars_are_refused_with_their_place():
    line = np.stack([np.linspace(0, 1, 12), np.zeros(12)], axis=1)
    with pytest.raises(ValueError, match=r"place 0 at \[0\. 0\.\] sees"):
        find_stars(line, line, 0.3, 2)
    with pytest.raises(ValueError, match=r"node 1 at .* coincides"):
        find_stars([[0.0]], [[0.0], [1.0], [1.0]], 1.0, 1)
    with pytest.raises(ValueError, match="support"):
        find_stars([[0.0]], [[0.0], [1.0]], 0.0, 1)


def test_weights_are_differentiable_in_the_positions(rng):
    X = cloud(2, 6, 0.2)
    stars = find_stars(X, X, 3.1 * spacing(X), 2)
    v, q = rng.normal(size=(2, *X.shape))

    @jax.jit
    def measure(X):
        w = derivative_weights(X, X, stars, 2)
        return jnp.sum(apply_weights(w, stars.nbr, jnp.asarray(v)) ** 2)

    slope = jnp.sum(jax.jit(jax.grad(measure))(jnp.asarray(X)) * q)
    h = 1e-6
    difference = (measure(X + h * q) - measure(X - h * q)) / (2 * h)
    assert float(slope) == pytest.approx(float(difference), rel=1e-6)
