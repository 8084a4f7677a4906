"""How sure a fit is: intervals by Gauss-Newton (Laplace), and by an ensemble.

    H = J^T J + d2 penalties / dz2,    J = d residuals / dz,    covariance = s^2 / H

with s = 1 where the noise is known and s^2 = sum r^2 / (N - p) where it is not. A
direction in z with next to no curvature is *not identifiable*: the data, as they were
measured, do not see it. (Displacements alone under prescribed displacements do not see
the scale of the micromodulus.) It is reported, and its intervals are infinite.

The variables of such a study are few; matrices are dense.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray
from scipy.stats import norm

from jaxpd.fitting import Fit
from jaxpd.inverse import Inverse, Values
from jaxpd.observe import Observation

#: Most variables, every entry of a field counted.
MOST = 500
#: A standard deviation of z beyond this says nothing: a factor of e^10.
WIDEST = 10.0
#: Sensitivities this many times the tolerance of the solves are noise.
ROUGH = 100.0


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Intervals of the variables of a fit.

    Attributes:
        level: probability that an interval holds the truth.
        low, high: ends of the intervals of the values, by name.
        deviation: standard deviation of z [p].
        covariance: of z [p, p], infinite on the diagonal where nothing is known.
        blind: directions in z that the data do not see [b, p], unit vectors.
        noise: estimated or known factor on all sigma, s.
        names: of the entries of z [p].
    """

    level: float
    low: Values
    high: Values
    deviation: NDArray[np.floating]
    covariance: NDArray[np.floating]
    blind: NDArray[np.floating]
    noise: float
    names: tuple[str, ...]

    @property
    def identifiable(self) -> bool:
        """Whether the data see every direction."""
        return len(self.blind) == 0

    def __str__(self) -> str:
        """The intervals of scalars, and what is not identifiable."""
        lines = [
            f"{name}: {float(self.low[name]):.6g} .. {float(self.high[name]):.6g}"
            for name in self.low
            if not np.ndim(self.low[name])
        ]
        for row in self.blind:
            order = np.argsort(-abs(row))[:3]
            parts = [
                f"{row[k]:+.2f} {self.names[k]}" for k in order if abs(row[k]) > 0.1
            ]
            lines.append(f"not identifiable from these data: {' '.join(parts)}")
        return "\n".join(lines)


@jax.jit
def _curvature(inverse: Inverse, z: Values) -> tuple[jax.Array, ...]:
    """Residuals [N], their Jacobian [N, p], gradient and Hessian of penalties."""
    flat, back = ravel_pytree(z)
    r, push = jax.linearize(lambda x: inverse.residuals(back(x)), flat)
    J = jax.lax.map(push, jnp.eye(flat.size)).T
    of = lambda x: inverse.penalty(back(x))  # noqa: E731
    return r, J, jax.grad(of)(flat), jax.hessian(of)(flat)


def _check(fit: Fit, level: float) -> None:
    size = sum(int(np.size(x)) for x in jax.tree.leaves(fit.z))
    if size > MOST:
        raise ValueError(
            f"fit: {size} unknowns are too many for dense matrices (at most {MOST}); "
            "describe the field by fewer, with a Variable's `place`"
        )
    if not 0 < level < 1:
        raise ValueError(f"level: {level} must lie between 0 and 1")


def laplace(fit: Fit, level: float = 0.95) -> Uncertainty:
    """Intervals from the curvature of the loss at its minimum.

    Args:
        fit: a fit that has ended well.
        level: of the intervals.

    Raises:
        ValueError: if the fit failed, has too many unknowns, or fewer data than these
            and noise that is not known.
    """
    _check(fit, level)
    inverse, z = fit.inverse, fit.z
    r, J, _, curvature = map(np.asarray, _curvature(inverse, z))
    if not np.isfinite(J).all():
        raise ValueError(f"fit: {fit!r} has no finite derivative at its end")
    p, count = J.shape[1], inverse.count
    noise = 1.0
    if not inverse.known:
        if count <= p:
            raise ValueError(
                f"fit: {count} data for {p} unknowns say nothing of the noise; give "
                "every observation its sigma"
            )
        noise = float(np.sqrt(r @ r / (count - p)))
    # what the solver leaves of an exact zero: its tolerance times the predictions
    shown = np.concatenate(
        [
            (np.where(np.isfinite(o.data), o.data, 0.0) / o.sigma).ravel()
            for o in jax.tree.map(np.asarray, inverse.observations)
        ]
    )
    floor = ROUGH * inverse.problem.linear.rtol * np.linalg.norm(shown)
    value, vector = np.linalg.eigh(J.T @ J + curvature)
    least = max(floor**2, (noise / WIDEST) ** 2, 1e-14 * value.max())
    seen = value > least
    some = vector[:, seen]
    covariance = noise**2 * (some / value[seen]) @ some.T
    blind = vector[:, ~seen].T
    blind = (
        blind
        * np.sign(blind[np.arange(len(blind)), abs(blind).argmax(axis=1)])[:, None]
    )
    lost = (np.abs(blind) > 0.1).any(axis=0)
    covariance[lost, lost] = np.inf
    deviation = np.sqrt(np.diag(covariance))
    low, high = _ends(inverse, z, deviation * norm.ppf(0.5 + 0.5 * level))
    return Uncertainty(level, low, high, deviation, covariance, blind, noise, _names(z))


def _names(z: Values) -> tuple[str, ...]:
    """Names of the entries of z, in the order in which it is ravelled."""
    found: list[str] = []
    for name in sorted(z):
        x = z[name]
        found += [name] if not x.ndim else [f"{name}[{k}]" for k in range(x.size)]
    return tuple(found)


def _ends(inverse: Inverse, z: Values, reach: NDArray) -> tuple[Values, Values]:
    """Values at both ends of intervals z +- reach, in order."""
    flat, back = ravel_pytree(z)
    ends = [inverse.values(back(flat + s * jnp.asarray(reach))) for s in (-1.0, 1.0)]
    pair = [jax.tree.map(np.asarray, e) for e in ends]
    low = jax.tree.map(np.minimum, *pair)
    return low, jax.tree.map(np.maximum, *pair)


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
        Flat z [b, p], its covariances [b, p, p] where the noise is known, and losses.
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
            r, J, slope, curvature = _curvature(this, back(new))
            cost = 0.5 * r @ r + this.penalty(back(new))
            better = cost <= loss  # a failed solve is NaN: not better
            seen = (new, cost, J.T @ r + slope, J.T @ J + curvature)
            old = (x, loss, g, H)
            x, loss, g, H = (
                jnp.where(better, a, b) for a, b in zip(seen, old, strict=True)
            )
            damping = jnp.where(better, 0.1 * damping, 10.0 * damping + 1e-6)
            return (x, damping, loss, g, H), None

        # the first turn does not move: it looks
        still = (flat, 0.0, jnp.inf, jnp.zeros_like(flat), jnp.eye(flat.size))
        begin = jax.tree.map(jnp.asarray, still)
        (x, _, loss, _, H), _ = jax.lax.scan(turn, begin, length=iterations + 1)
        return x, jnp.linalg.inv(H), loss

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
        ValueError: as `laplace`; or if directions are not identifiable.
    """
    first = laplace(fit, level)
    if not first.identifiable:
        raise ValueError(f"fit: {first}")
    inverse, rng = fit.inverse, np.random.default_rng(seed)
    data = []
    for o, value in zip(
        inverse.observations, jax.jit(Inverse.predictions)(inverse, fit.z), strict=True
    ):
        shape = (count, *np.shape(o.data))
        made = value[None] + first.noise * o.sigma * rng.normal(size=shape)
        data.append(jnp.where(jnp.isfinite(o.data)[None], made, jnp.nan))
    flat, _, _ = refit(inverse, fit.z, tuple(data), iterations=iterations, batch=batch)
    _, back = ravel_pytree(fit.z)
    values = jax.tree.map(np.asarray, jax.vmap(lambda x: inverse.values(back(x)))(flat))
    tail = 0.5 - 0.5 * level
    low, high = (
        {k: np.quantile(v, q, axis=0) for k, v in values.items()}
        for q in (tail, 1.0 - tail)
    )
    spread = np.atleast_2d(np.cov(np.asarray(flat).T))
    found = Uncertainty(
        level,
        low,
        high,
        np.sqrt(np.diag(spread)),
        spread,
        first.blind,
        first.noise,
        first.names,
    )
    return found, values
