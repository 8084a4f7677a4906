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
from jax.tree_util import Partial

from jaxpd.checks import instance, numbers, real
from jaxpd.geometry import Crack, Region
from jaxpd.problem import Params, Problem


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Observation:
    """A measured quantity.

    Attributes:
        data: measured values [...], [F, ...] with load factors; NaN where missing.
        sigma: standard deviation of their noise, as `data`; a scale whose factor is
            estimated where it is not `known`.
        predict: what an exact measurement would read, a `jax.tree_util.Partial` called
            as predict(problem, params, u) at each load factor.
        load_factors: F shares of load and prescribed displacements at which it was
            read; None is at full load, without an axis for them.
        known: whether `sigma` is the noise.
    """

    data: Any
    sigma: Any
    predict: Any
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
        predict: see `Observation`. A function made anew is compiled anew; arrays that
            it needs are best bound by `jax.tree_util.Partial`.
        sigma: standard deviation of the noise, [] or of a shape that broadcasts to that
            of the data; unknown if left out.
        load_factors: if given, `data` has a row for each.

    Raises:
        ValueError: without data, on infinite ones, on noise that is not positive, or on
            a number of rows that is not that of the load factors.
    """
    if real(data) is None:
        raise ValueError(f"data: {data!r} must be numbers, NaN where they are missing")
    if sigma is not None and real(sigma) is None:
        raise ValueError(f"sigma: {sigma!r} must be a number, or one for each of data")
    if not callable(predict):
        raise ValueError(f"predict: {predict!r} must be a function of a solution")
    values = np.asarray(data, float)
    there = np.isfinite(values)
    factors = None if load_factors is None else tuple(map(float, load_factors))
    if not there.any() or np.isinf(values).any():
        raise ValueError(
            f"data: of {values.size} numbers {there.sum()} are finite and "
            f"{np.isinf(values).sum()} infinite; there must be some and none, and NaN "
            "marks what is missing"
        )
    if factors is not None and values.shape[:1] != (len(factors),):
        raise ValueError(
            f"data: {values.shape} must have a row for each of the {len(factors)} load "
            "factors"
        )
    known = sigma is not None
    size = np.sqrt(np.mean(values[there] ** 2)) or 1.0
    try:
        size = np.broadcast_to(
            np.asarray(sigma if known else size, float), values.shape
        )
    except ValueError as error:
        raise ValueError(
            f"sigma: shape {np.asarray(sigma).shape} does not fit data of shape "
            f"{values.shape}"
        ) from error
    if not ((size > 0) & np.isfinite(size))[there].all():
        worst = float(np.min(size[there]))
        raise ValueError(
            f"sigma: all must be positive and finite (the smallest is {worst}), or "
            "None if the noise is unknown"
        )
    size = np.where(there, size, 1.0)
    return Observation(values, size, Partial(predict), factors, known)


def _all(problem: Problem, params: Params, u: jax.Array) -> jax.Array:
    return u


def _some(at: Any, problem: Problem, params: Params, u: jax.Array) -> jax.Array:
    return u.at[at].get(mode="fill", fill_value=jnp.nan)


def displacements(data: Any, sigma: Any = None, points: Any = None) -> Observation:
    """Measured displacements [n, d] (m), or [k, d] of some points given by number.

    Rows are those of `problem.X`, points outside the body where it is held included;
    a number beyond them is predicted as NaN, and the fit fails.

    Raises:
        ValueError: on negative or broken numbers, or not one for each row; and as
            `observation`.
    """
    if points is None:
        return observation(data, _all, sigma)
    at = np.asarray(points)
    if at.dtype.kind not in "iu" or at.ndim != 1 or (at < 0).any():
        raise ValueError(f"points: {points} must be a list of numbers of points")
    if np.shape(data)[:1] != at.shape:
        raise ValueError(
            f"points: there are {len(at)} and data for {np.shape(data)[:1]}"
        )
    return observation(data, Partial(_some, at), sigma)


def _resultant(
    inside: Any, problem: Problem, params: Params, u: jax.Array
) -> jax.Array:
    return jnp.sum(problem.reaction(u, params), where=inside)


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
        ValueError: if no prescribed point lies in the region; and as `observation`.
    """
    d, inside = problem.X.shape[1], np.zeros(np.shape(problem.fixed), bool)
    if axis not in range(d):
        raise ValueError(f"axis: {axis!r} must be one of 0 .. {d - 1}")
    inside[:, axis] = region.contains(np.asarray(problem.X))
    inside &= np.asarray(problem.fixed)
    if not inside.any():
        raise ValueError(f"region: no point that is prescribed lies in {region}")
    values = np.asarray(data, float).reshape(-1)
    return observation(values, Partial(_resultant, inside), sigma, load_factors)


def _opening(
    i: Any, j: Any, normal: Any, problem: Problem, params: Params, u: jax.Array
) -> jax.Array:
    return (u[i] - u[j]) @ normal


def openings(
    problem: Problem, crack: Crack, at: Sequence[float], data: Any, sigma: Any = None
) -> Observation:
    """Openings (m) of a 2-D crack at edge coordinates `at` [k] in 0..1.

    As `Solution.opening`: between the points nearest above and below.

    Raises:
        ValueError: as `observation`.
    """
    instance("crack", crack, Crack, "a segment(..)")
    numbers("at", at, least=0, most=1)
    if np.ndim(at) != 1:
        raise ValueError(f"at: {at!r} must be a list of edge coordinates [k]")
    X = np.asarray(problem.X)
    i, j = np.array([crack.faces(X, t) for t in at]).T
    return observation(data, Partial(_opening, i, j, crack.normal), sigma)
