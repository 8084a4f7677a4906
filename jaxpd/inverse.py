"""Inverse problems: what was measured, what is sought, what is preferred.

    loss(z) = sum r(z)^2 / 2 + penalties(z),    r = (predicted - measured) / sigma

the negative logarithm of a posterior density. Sought are variables z without units or
bounds, zero at the start; `Variable` says which parameters of the problem they make.
Variables and penalties are pure functions beside their numbers, like the observations
of `jaxpd.observe`: a user adds one by writing the function.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial import KDTree

from jaxpd.checks import number, numbers
from jaxpd.observe import Observation
from jaxpd.problem import Params, Problem
from jaxpd.solvers.status import Status

Values = dict[str, Any]


@dataclass(frozen=True)
class Positive:
    """value = start exp(z): positive, and z counts factors of e."""

    def __call__(self, z: Any, start: Any) -> Any:
        """The value."""
        return start * jnp.exp(z)


@dataclass(frozen=True)
class Bounded:
    """Between two numbers, by the logistic function."""

    low: float
    high: float

    def __call__(self, z: Any, start: Any) -> Any:
        """The value."""
        share = (start - self.low) / (self.high - self.low)
        at = z + jnp.log(share) - jnp.log1p(-share)
        return self.low + (self.high - self.low) * jax.nn.sigmoid(at)


@dataclass(frozen=True)
class Free:
    """value = start + scale z."""

    scale: float

    def __call__(self, z: Any, start: Any) -> Any:
        """The value."""
        return start + self.scale * z


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Variable:
    """Something that is sought.

    Attributes:
        start: first guess, any shape.
        value: called as value(z, start); start itself at z = 0, monotone in each z.
        place: parameters of the problem with a value put in, called as
            place(params, value); None puts it where the variable's name says.
    """

    start: Any
    value: Callable[[Any, Any], Any] = field(metadata={"static": True})
    place: Callable[[Params, Any], Params] | None = field(
        metadata={"static": True}, default=None
    )


def positive(
    start: Any, place: Callable[[Params, Any], Params] | None = None
) -> Variable:
    """A variable that stays positive.

    Raises:
        ValueError: if the first guess is not.
    """
    numbers("start", start, above=0)
    return Variable(np.asarray(start, float), Positive(), place)


def bounded(
    start: Any,
    low: float,
    high: float,
    place: Callable[[Params, Any], Params] | None = None,
) -> Variable:
    """A variable that stays between `low` and `high`.

    Raises:
        ValueError: if the first guess does not lie between them.
    """
    for name, end in (("low", low), ("high", high)):
        number(name, end)
    x = np.asarray(numbers("start", start, above=low, below=high), float)
    return Variable(x, Bounded(float(low), float(high)), place)


def free(
    start: Any, scale: float, place: Callable[[Params, Any], Params] | None = None
) -> Variable:
    """A variable without bounds that is expected to move by about `scale`.

    Raises:
        ValueError: if the scale is not positive.
    """
    number("scale", scale, above=0, cure="how far it is expected to move")
    numbers("start", start)
    return Variable(np.asarray(start, float), Free(float(scale)), place)


def check_variable(problem: Problem, name: str, variable: Variable) -> None:
    """Refuse a variable that does not fit a problem.

    Raises:
        ValueError: if it is no parameter, has another shape than its first guess, or is
            a horizon that may leave the bonds that were found.
    """
    if variable.place is None and name not in problem.params:
        raise ValueError(
            f"variables: {name!r} is no parameter, there are "
            f"{sorted(problem.params)}; give it a `place`"
        )
    shape, n = np.shape(variable.start), len(problem.X)
    value = jax.eval_shape(variable.value, jnp.zeros(shape), variable.start)
    if value.shape != shape:
        raise ValueError(
            f"variables: {name!r} starts with shape {shape} and its value has "
            f"{value.shape}; what makes arrays of it belongs into `place`"
        )
    if name == "E" and variable.place is None and shape not in ((), (n,)):
        raise ValueError(f"variables: 'E' {shape} must be a number or a field [{n}]")
    if name == "delta" and variable.place is None:
        found = float(problem.params["delta"])
        high = getattr(variable.value, "high", np.inf)
        if high > found * (1 + 1e-9) or problem.family.partial != "continuous":
            raise ValueError(
                f"variables: 'delta' may reach {high:g} by the rule "
                f"{problem.family.partial!r} and bonds were found within {found:g} m; "
                "prepare the longest horizon, with partial='continuous', and use "
                "bounded(start, low, high) up to it"
            )


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Penalty:
    """What is preferred of the variables, a scalar of z.

    Attributes:
        numbers: a pytree that the function needs.
        cost: called as cost(z, numbers), with z by name.
    """

    numbers: Any
    cost: Callable[[Values, Any], Any] = field(metadata={"static": True})


def smooth(
    problem: Problem, name: str, weight: float, edges: float | None = None
) -> Penalty:
    """Prefer a nodal variable that varies little from point to point.

    With g the difference quotient of z (of a positive variable the logarithm of value
    over start) to the 2 d nearest points, weight times the integral of g^2 / 2, or with
    `edges` of sqrt(g^2 + edges^2) - edges, smoothed total variation, which may jump.

    Args:
        problem: its points.
        name: of the variable, [n].
        weight: of the penalty, m^(2 - d), or m^(1 - d) with `edges`.
        edges: slope (1/m) from which on a difference counts as a jump.

    Raises:
        ValueError: on a negative weight or slope, or if `name` is no nodal variable.
    """
    number("weight", weight, least=0)
    if edges is not None:
        number("edges", edges, above=0, cure="in 1/m, or None")
    X, params = np.asarray(problem.X), problem.params
    n, d = X.shape
    size = params["dx"] ** d * np.ones(n) if "dx" in params else params["vol"]
    near: Any = KDTree(X).query(X, k=min(2 * d + 1, n))[1]
    i, j = np.repeat(np.arange(n), near.shape[1] - 1), near[:, 1:].ravel()
    i, j = np.unique(np.sort(np.stack([i, j]), axis=0), axis=1)
    length = np.linalg.norm(X[i] - X[j], axis=1)
    share = 0.5 * (np.asarray(size)[i] + np.asarray(size)[j]) * weight

    return Penalty((i, j, length, share), _Slopes(name, edges))


@dataclass(frozen=True)
class _Slopes:
    """Cost of `smooth`; equal ones compile once."""

    name: str
    edges: float | None

    def __call__(self, z: Values, numbers: Any) -> Any:
        i, j, length, share = numbers
        if self.name not in z or jnp.ndim(z[self.name]) != 1:
            raise ValueError(f"name: {self.name!r} is sought as no field [n]")
        g = (z[self.name][i] - z[self.name][j]) / length
        if self.edges is None:
            return 0.5 * jnp.sum(share * g * g)
        # sqrt(g^2 + e^2) - e without cancellation
        return jnp.sum(share * g * g / (jnp.sqrt(g * g + self.edges**2) + self.edges))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Inverse:
    """An inverse problem: a pytree, with pure functions of z.

    Attributes:
        problem: the forward problem.
        variables: what is sought, by name.
        observations: what was measured.
        penalties: what is preferred.
    """

    problem: Problem
    variables: dict[str, Variable]
    observations: tuple[Observation, ...]
    penalties: tuple[Penalty, ...] = ()

    def start(self) -> Values:
        """Z of the first guess: zeros."""
        return {k: jnp.zeros(jnp.shape(v.start)) for k, v in self.variables.items()}

    def values(self, z: Values) -> Values:
        """Values of the variables."""
        return {k: v.value(z[k], v.start) for k, v in self.variables.items()}

    def params(self, z: Values) -> Params:
        """Parameters of the problem."""
        params = dict(self.problem.params)
        for name, value in self.values(z).items():
            place = self.variables[name].place
            params = place(params, value) if place else params | {name: value}
        return params

    def predictions(self, z: Values) -> list[jax.Array]:
        """What exact measurements would read; NaN where a solve failed."""
        params, problem = self.params(z), self.problem
        asked = [o.load_factors or (1.0,) for o in self.observations]
        factors = sorted({t for some in asked for t in some})

        def at(t):
            scaled = {k: t * params[k] for k in ("load", "prescribed")}
            u, info = problem.solve(params | scaled)
            good = jnp.where(info.status == Status.CONVERGED, 1.0, jnp.nan)
            of = [o.predict(problem, params | scaled, u) for o in self.observations]
            return [good * jnp.asarray(value) for value in of]

        if len(factors) == 1:
            rows = [value[None] for value in at(factors[0])]
        else:
            rows = jax.lax.map(at, jnp.asarray(factors))
        found = []
        row: Any
        for o, some, row in zip(self.observations, asked, rows, strict=True):
            picked = row[np.array([factors.index(t) for t in some])]
            picked = picked[0] if o.load_factors is None else picked
            if picked.shape != jnp.shape(o.data):
                raise ValueError(
                    f"predict: it gives an array {picked.shape} and the data are "
                    f"{jnp.shape(o.data)}"
                )
            found.append(picked)
        return found

    def residuals(self, z: Values) -> jax.Array:
        """(predicted - measured) / sigma [N]; zero where missing."""
        found = []
        value: Any
        for o, value in zip(self.observations, self.predictions(z), strict=True):
            there = jnp.isfinite(o.data)
            r = jnp.where(there, value - jnp.where(there, o.data, 0.0), 0.0) / o.sigma
            found.append(r.ravel())
        return jnp.concatenate(found)

    def loss(self, z: Values) -> jax.Array:
        """Half the sum of squared residuals, and the penalties."""
        r = self.residuals(z)
        return 0.5 * (r @ r) + self.penalty(z)

    def penalty(self, z: Values) -> jax.Array:
        """The penalties."""
        costs = [p.cost(z, p.numbers) for p in self.penalties]
        return sum(costs, start=jnp.zeros(()))

    @property
    def count(self) -> int:
        """Number of measured values that are there. Host only."""
        return sum(int(np.isfinite(o.data).sum()) for o in self.observations)
