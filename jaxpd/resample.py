"""How sure a fit is, by fits to many sets of made-up data side by side."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxpd.fitting import Fit
from jaxpd.inverse import Inverse, Values
from jaxpd.observe import Observation
from jaxpd.uncertainty import NEAR, Uncertainty, curvature, laplace


@functools.partial(jax.jit, static_argnames=("iterations", "batch"))
def refit(
    inverse: Inverse, z: Values, data: Any, *, iterations: int = 4, batch: int = 25
) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Fit many sets of data at once by damped Gauss-Newton steps, from z.

    Args:
        inverse: the problem; its data are replaced.
        z: where to begin.
        data: sets of data, one array [b, ...] an observation.
        iterations: Gauss-Newton steps.
        batch: how many are solved side by side.

    Returns:
        Flat z [b, p], its covariances [b, p, p] where the noise is known, and how far
        from their minima they are, in standard deviations [b]; NaN if a solve failed.
    """
    flat, back = ravel_pytree(z)

    def one(sets):
        observations = tuple(
            Observation(d, o.sigma, o.predict, o.load_factors, o.known)
            for o, d in zip(inverse.observations, sets, strict=True)
        )
        this = Inverse(
            inverse.problem, inverse.variables, observations, inverse.penalties
        )

        def turn(carry, _):
            x, damping, loss, g, H = carry
            size = jnp.diag(jnp.maximum(jnp.diag(H), 1e-300))
            move = -jnp.linalg.solve(H + damping * size, g)
            new = x + jnp.clip(move, -2.0, 2.0)
            r, J, slope, P = curvature(this, back(new))
            cost = 0.5 * r @ r + this.penalty(back(new))
            better = cost <= loss  # a failed solve is NaN: not better
            seen = (new, cost, J.T @ r + slope, J.T @ J + P)
            old = (x, loss, g, H)
            x, loss, g, H = (
                jnp.where(better, a, b) for a, b in zip(seen, old, strict=True)
            )
            damping = jnp.where(better, 0.1 * damping, 10.0 * damping + 1e-6)
            return (x, damping, loss, g, H), None

        # the first turn does not move: it looks
        still = (flat, 0.0, jnp.inf, jnp.zeros_like(flat), jnp.eye(flat.size))
        begin = jax.tree.map(jnp.asarray, still)
        (x, _, loss, g, H), _ = jax.lax.scan(turn, begin, length=iterations + 1)
        away = jnp.sqrt(g @ jnp.linalg.solve(H, g))
        return x, jnp.linalg.inv(H), jnp.where(jnp.isfinite(loss), away, jnp.nan)

    return jax.lax.map(one, data, batch_size=batch)


def ensemble(
    fit: Fit,
    count: int = 200,
    level: float = 0.95,
    *,
    seed: int = 0,
    iterations: int = 4,
    batch: int = 25,
) -> tuple[Uncertainty, Values]:
    """Intervals from fits to many sets of data, made of the fit and seeded noise.

    The parametric bootstrap: it sees what is curved, which `laplace` does not, and
    costs `count` times `iterations` solves, done side by side.

    Args:
        fit: a fit that has ended well.
        count: sets of data.
        level: of the intervals.
        seed: of the noise.
        iterations: Gauss-Newton steps of each.
        batch: how many are solved side by side; memory grows with it.

    Returns:
        Intervals, and the values found [count, ...] by name.

    Raises:
        ValueError: as `laplace`; if directions are not identifiable; with penalties,
            whose knowledge such a spread leaves out; or if fits did not arrive.
    """
    first = laplace(fit, level)
    if not first.identifiable:
        raise ValueError(f"fit: {first}")
    if fit.inverse.penalties:
        raise ValueError(
            "fit: it has penalties, and the spread of such an ensemble leaves out what "
            "they know; use laplace()"
        )
    inverse, rng, data = fit.inverse, np.random.default_rng(seed), []
    predictions = jax.jit(Inverse.predictions)(inverse, fit.z)
    for o, value, s in zip(inverse.observations, predictions, first.noise, strict=True):
        made = np.asarray(value)[None] + s * np.asarray(o.sigma)[None] * rng.normal(
            size=(count, *np.shape(o.data))
        )
        data.append(np.where(np.isfinite(o.data)[None], made, np.nan))
    flat, _, away = refit(
        inverse, fit.z, tuple(data), iterations=iterations, batch=batch
    )
    late = int((~(np.asarray(away) <= NEAR * max(first.noise))).sum())
    if late > 0.02 * count:
        raise ValueError(
            f"iterations: after {iterations} of them {late} of {count} fits failed or "
            f"are more than {NEAR} standard deviations from their minima; take more"
        )
    _, back = ravel_pytree(fit.z)
    values = jax.tree.map(np.asarray, jax.vmap(lambda x: inverse.values(back(x)))(flat))
    tail = 0.5 - 0.5 * level
    low, high = (
        {k: np.quantile(v, q, axis=0) for k, v in values.items()}
        for q in (tail, 1.0 - tail)
    )
    spread = np.atleast_2d(np.cov(np.asarray(flat).T))
    deviation = np.sqrt(np.diag(spread))
    found = dataclasses.replace(
        first, low=low, high=high, deviation=deviation, covariance=spread
    )
    return found, values
