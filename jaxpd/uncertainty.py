"""How sure a fit is: intervals by Gauss-Newton (Laplace).

    H = J^T J + d2 penalties / dz2,    J = d residuals / dz
    covariance = H^-1 (sum_o s_o^2 J_o^T J_o + d2 penalties / dz2) H^-1

over the observations o: s_o = 1 where the noise is known, else estimated from what is
left, s_o^2 = r_o^2 / (N_o - trace J_o H^-1 J_o^T), with Student's t for the intervals.
A direction in z with next to no curvature is *not identifiable*: the data (and the
penalties, where there are any) do not see it. (Displacements alone under prescribed
displacements do not see the scale of the micromodulus.) It is reported, and intervals
that it touches are infinite.

The variables of such a study are few; matrices are dense.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from numpy.typing import NDArray
from scipy.stats import chi2, norm, t

from jaxpd.fitting import Fit
from jaxpd.inverse import Inverse, Values

#: Most variables, every entry of a field counted.
MOST = 500
#: A standard deviation of z beyond this says nothing: a factor of e^10.
WIDEST = 10.0
#: Sensitivities this many times the tolerance of the solves are noise.
ROUGH = 100.0
#: Entries of an array that are shown.
MANY = 8
#: Furthest from the minimum that counts as being there, in standard deviations.
NEAR = 0.1


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """Intervals of the variables of a fit.

    Attributes:
        level: probability that an interval holds the truth.
        low, high: ends of the intervals of the values, by name.
        deviation: standard deviation of z [p].
        covariance: of z [p, p], infinite on the diagonal where nothing is known.
        blind: directions in z that are not seen [b, p], unit vectors.
        rough: whether the solves' tolerance, and not the noise, hides one of them.
        noise: factor on the sigma of each observation, 1 where it is known.
        misfit: mean square of the residuals over these; near 1 if the model is right.
        bound: misfit that a right model exceeds once in a million times; infinite where
            the noise was estimated from it.
        names: of the entries of z [p].
    """

    level: float
    low: Values
    high: Values
    deviation: NDArray[np.floating]
    covariance: NDArray[np.floating]
    blind: NDArray[np.floating]
    rough: bool
    noise: tuple[float, ...]
    misfit: float
    bound: float
    names: tuple[str, ...]

    @property
    def identifiable(self) -> bool:
        """Whether every direction is seen."""
        return len(self.blind) == 0

    def __str__(self) -> str:
        """The intervals, the misfit, and what is not identifiable."""
        lines = []
        for name, low in self.low.items():
            ends = zip(np.ravel(low), np.ravel(self.high[name]), strict=True)
            shown = [f"{a:.6g} .. {b:.6g}" for a, b in list(ends)[:MANY]]
            each = (
                [f"{name}[{k}]" for k in range(len(shown))] if np.ndim(low) else [name]
            )
            lines += [f"{k}: {x}" for k, x in zip(each, shown, strict=True)]
            if np.size(low) > MANY:
                lines.append(f"... and {np.size(low) - MANY} more of {name}")
        lines.append(f"misfit: {self.misfit:.3g}")
        if self.misfit > self.bound:
            lines.append(
                "the model does not explain the data at this noise: a misfit up to "
                f"{self.bound:.2f} is to be expected; another start, or another model"
            )
        for row in self.blind[:5]:
            order = [k for k in np.argsort(-abs(row))[:3] if abs(row[k]) > 0.01]
            parts = " ".join(f"{row[k]:+.2f} {self.names[k]}" for k in order)
            lines.append(f"not identifiable from these data: {parts}")
        if self.rough:
            lines.append("the solves' rtol hides it; a smaller one may show it")
        return "\n".join(lines)


@jax.jit
def curvature(inverse: Inverse, z: Values) -> tuple[jax.Array, ...]:
    """Residuals [N], their Jacobian [N, p], gradient and Hessian of penalties."""
    flat, back = ravel_pytree(z)
    r, push = jax.linearize(lambda x: inverse.residuals(back(x)), flat)
    J = jax.lax.map(push, jnp.eye(flat.size)).T
    of = lambda x: inverse.penalty(back(x))  # noqa: E731
    return r, J, jax.grad(of)(flat), jax.hessian(of)(flat)


def laplace(fit: Fit, level: float = 0.95) -> Uncertainty:
    """Intervals from the curvature of the loss at its minimum.

    Args:
        fit: a fit that has ended well.
        level: of the intervals.

    Raises:
        ValueError: if the fit failed, is not at its minimum, has too many unknowns, or
            no more data than these and noise that is not known.
    """
    size = sum(int(np.size(x)) for x in jax.tree.leaves(fit.z))
    if size > MOST:
        raise ValueError(
            f"fit: {size} unknowns are too many for dense matrices (at most {MOST}); "
            "describe the field by fewer, with a Variable's `place`"
        )
    if not 0 < level < 1:
        raise ValueError(f"level: {level} must lie between 0 and 1")
    inverse, z = fit.inverse, fit.z
    r, J, slope, P = map(np.asarray, curvature(inverse, z))
    if fit.reason == "failed" or not (np.isfinite(r).all() and np.isfinite(J).all()):
        raise ValueError(f"fit: {fit!r} has no residuals or derivatives at its end")
    value, vector = np.linalg.eigh(J.T @ J + P)
    # what the solver leaves of an exact zero: its tolerance times the predictions
    shown = [np.nan_to_num(o.data) / o.sigma for o in inverse.observations]
    floor = ROUGH * inverse.problem.linear.rtol
    floor *= float(np.linalg.norm(np.concatenate([x.ravel() for x in shown])))
    least = max(floor**2, 1e-14 * value.max())
    # an estimated sigma may be far off: what is seen depends on it
    s, freedom, weight = _noise(inverse, r, J, value, vector, least)
    least = max(least, (max(s) / WIDEST) ** 2)
    seen = value > least
    some = vector[:, seen] / value[seen]
    inner = some.T @ ((J * weight[:, None] ** 2).T @ J + P) @ some
    covariance = vector[:, seen] @ inner @ vector[:, seen].T
    step = vector[:, seen] @ (some.T @ (J.T @ r + slope))
    blind = vector[:, ~seen].T
    top = blind[np.arange(len(blind)), abs(blind).argmax(axis=1)]
    blind = blind * np.sign(top)[:, None]
    lost = np.linalg.norm(blind, axis=0) > 0.1 / size**0.5
    deviation = np.sqrt(np.diag(covariance))
    away = float(np.max(np.abs(step) / np.where(deviation > 0, deviation, np.inf)))
    exact = fit.losses.min() <= 1e-15 * fit.losses[0]
    if away > NEAR and not exact:
        raise ValueError(
            f"fit: {fit!r} is {away:.2g} standard deviations from its minimum; go on "
            "with more steps, a smaller gtol, or from here"
        )
    covariance[lost, lost] = deviation[lost] = np.inf
    known = all(o.known for o in inverse.observations)
    tail = 0.5 + 0.5 * level
    quantile = norm.ppf(tail) if known else t.ppf(tail, max(freedom, 1.0))
    low, high = _ends(inverse, z, deviation * quantile)
    there = np.concatenate([np.isfinite(o.data).ravel() for o in inverse.observations])
    misfit = float(np.mean((r / weight)[there] ** 2))
    hidden = bool((value[~seen] > (max(s) / WIDEST) ** 2).any())
    return Uncertainty(
        level,
        low,
        high,
        deviation,
        covariance,
        blind,
        hidden,
        s,
        misfit,
        float(chi2.isf(1e-6, there.sum()) / there.sum()) if known else np.inf,
        _names(z),
    )


def _noise(
    inverse: Inverse, r: Any, J: Any, value: Any, vector: Any, least: float
) -> tuple[tuple[float, ...], float, Any]:
    """Factors on sigma, degrees of freedom that are left, the factors by residual [N].

    Raises:
        ValueError: if an observation of unknown noise has nothing left to tell it.
    """
    seen = value > least
    root = J @ (vector[:, seen] / np.sqrt(value[seen]))
    factors, left, weight, at = [], np.inf, np.ones(len(r)), 0
    for o in inverse.observations:
        span = slice(at, at + np.size(o.data))
        at = span.stop
        if o.known:
            factors.append(1.0)
            continue
        count = int(np.isfinite(o.data).sum())
        free = count - float((root[span] ** 2).sum())
        if free < 0.5:
            raise ValueError(
                f"fit: an observation of {count} data and unknown noise says nothing "
                "of its noise; give it a sigma"
            )
        s = float(np.sqrt(r[span] @ r[span] / free))
        factors.append(s)
        weight[span], left = max(s, 1e-300), min(left, free)
    return tuple(factors), left, weight


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
