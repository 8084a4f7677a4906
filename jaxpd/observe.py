"""Observations: what was measured, and what an exact measurement would read.

An observation is a pure function of a solution beside its numbers: a user adds one by
writing the function, see `observation`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.geometry import Crack, Region
from jaxpd.problem import Params, Problem


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Observation:
    """A measured quantity.

    Attributes:
        data: measured values [...], [F, ...] with load factors; NaN where missing.
        sigma: standard deviation of their noise [] or as `data`; only ratios between
            observations matter where it is not `known`.
        predict: what an exact measurement would read, called as
            predict(problem, params, u) at each load factor.
        load_factors: F shares of load and prescribed displacements at which it was
            read; None is at full load, without an axis for them.
        known: whether `sigma` is the noise, or a scale whose factor is to be estimated.
    """

    data: Any
    sigma: Any
    predict: Callable[[Problem, Params, jax.Array], Any] = field(
        metadata={"static": True}
    )
    load_factors: tuple[float, ...] | None = field(
        metadata={"static": True}, default=None
    )
    known: bool = field(metadata={"static": True}, default=True)


def observation(
    data: Any,
    predict: Callable[[Problem, Params, jax.Array], Any],
    sigma: Any = None,
    load_factors: Sequence[float] | None = None,
) -> Observation:
    """An observation of anything that follows from a solution, checked.

    Args:
        data: measured values; NaN where missing.
        predict: see `Observation`.
        sigma: standard deviation of the noise; unknown if left out.
        load_factors: if given, `data` has a row for each.

    Raises:
        ValueError: without data, on noise that is not positive, or on a number of rows
            that is not that of the load factors.
    """
    values = np.asarray(data, float)
    factors = None if load_factors is None else tuple(map(float, load_factors))
    if not np.isfinite(values).any():
        raise ValueError("data: not one number is finite; NaN marks what is missing")
    if factors is not None and values.shape[:1] != (len(factors),):
        raise ValueError(
            f"data: {values.shape} must have a row for each of the {len(factors)} load "
            "factors"
        )
    known = sigma is not None
    if not known:
        sigma = np.sqrt(np.nanmean(values**2)) or 1.0
    size = np.asarray(sigma, float)
    if not (size > 0).all():
        raise ValueError(f"sigma: {sigma} must be positive, or None if it is unknown")
    return Observation(values, size, predict, factors, known)


def _all(problem: Problem, params: Params, u: jax.Array) -> jax.Array:
    return u


def displacements(data: Any, sigma: Any = None, points: Any = None) -> Observation:
    """Measured displacements [n, d] (m), or [k, d] of some points given by number."""
    if points is None:
        return observation(data, _all, sigma)
    at = np.asarray(points)
    return observation(data, lambda problem, params, u: u[at], sigma)


def reaction_curve(
    problem: Problem,
    region: Region,
    axis: int,
    load_factors: Sequence[float],
    data: Any,
    sigma: Any = None,
) -> Observation:
    """Resultants (N) of the supports' forces in a region, at some load factors [F].

    Raises:
        ValueError: if no prescribed point lies in the region.
    """
    inside = region.contains(np.asarray(problem.X))
    inside &= np.asarray(problem.fixed)[:, axis]
    if not inside.any():
        raise ValueError(f"region: no point that is prescribed lies in {region}")

    def predict(problem, params, u):
        return jnp.sum(problem.reaction(u, params)[:, axis], where=inside)

    values = np.asarray(data, float).reshape(-1)
    return observation(values, predict, sigma, load_factors)


def openings(
    problem: Problem, crack: Crack, at: Sequence[float], data: Any, sigma: Any = None
) -> Observation:
    """Openings (m) of a 2-D crack at edge coordinates `at` [k] in 0..1.

    As `Solution.opening`: between the points nearest above and below.
    """
    X = np.asarray(problem.X)
    i, j = np.array([crack.faces(X, t) for t in at]).T
    normal = crack.normal
    return observation(data, lambda problem, params, u: (u[i] - u[j]) @ normal, sigma)
