"""Is a derivative right? Taylor remainders say so, for any problem and parameter.

    |f(p + h q) - f(p) - h f'(p) q|                        ~ h^2
    |f(p + h q) - f(p) - h f'(p) q - h^2 q f''(p) q / 2|   ~ h^3

A wrong derivative leaves the first at slope 1, a wrong second derivative the second at
slope 2. Remainders below the noise of the solves behind f say nothing and are not used;
solve to `rtol` of 1e-10 or less.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxpd.checks import number, whole, word
from jaxpd.problem import Params, Problem
from jaxpd.solvers.status import NotConverged, Status


@dataclass(frozen=True, eq=False)
class Taylor:
    """Remainders of a Taylor expansion along one direction.

    Attributes:
        steps: h [s], falling.
        remainders: [s].
        derivative: f'(p) q.
        difference: central difference of the smallest step for it.
        order: highest derivative that the expansion has, 1 or 2.
        floor: remainders below are noise.
    """

    steps: NDArray[np.floating]
    remainders: NDArray[np.floating]
    derivative: float
    difference: float
    order: int
    floor: float

    @property
    def slopes(self) -> NDArray[np.floating]:
        """Slopes between successive steps above the floor; empty if there are none."""
        above = np.append(self.remainders > self.floor, False)
        used = int(np.argmin(above)) if self.finite else 0
        r, h = self.remainders[:used], self.steps[:used]
        return np.log(r[1:] / r[:-1]) / np.log(h[1:] / h[:-1])

    @property
    def finite(self) -> bool:
        """Whether the derivative and all remainders are numbers."""
        return bool(np.isfinite([self.derivative, *self.remainders]).all())

    @property
    def slope(self) -> float:
        """The slope at the smallest steps that say something; order + 1 is right.

        Infinite where no remainder is above the floor, the expansion being exact; NaN
        where something is not finite, or a single remainder says too little.
        """
        if len(self.slopes):
            return float(self.slopes[-1])
        exact = self.finite and (self.remainders <= self.floor).all()
        return np.inf if exact else np.nan

    @property
    def right(self) -> bool:
        """Whether the slope is order + 1 but for 0.05, or the expansion exact."""
        return self.slope > self.order + 1 - 0.05

    def __repr__(self) -> str:
        """One line: slope, derivative, verdict."""
        verdict = "right" if self.right else "NOT right"
        return f"Taylor({verdict}: slope {self.slope:.3f}, f' q {self.derivative:.6g})"

    def __str__(self) -> str:
        """The steps, remainders and slopes, a line each."""
        slopes = [*(f"{s:8.3f}" for s in self.slopes)]
        slopes = [" " * 8, *slopes, *["   noise"] * len(self.steps)][: len(self.steps)]
        lines = [
            f"{h:10.3e} {r:12.3e} {s}"
            for h, r, s in zip(self.steps, self.remainders, slopes, strict=True)
        ]
        return "\n".join(["         h    remainder    slope", *lines])


def taylor(
    function: Callable[..., jax.Array],
    at: Any,
    directions: Mapping[str, Any],
    *operands: Any,
    mode: str = "reverse",
    order: int = 1,
    steps: NDArray[np.floating] | None = None,
    noise: float = 1e-11,
) -> dict[str, Taylor]:
    """Taylor tests of a scalar function along some directions, compiled once.

    Args:
        function: called as function(at, *operands); a scalar.
        at: a pytree of floating-point arrays.
        directions: pytrees like `at`, by name.
        *operands: whatever else the function needs that should not become a constant.
        mode: "reverse" takes derivatives by `jax.grad`, "forward" by `jax.jvp`.
        order: 1, or 2 for a Hessian-vector product too, forward over `mode`.
        steps: h, falling; 0.1 / 2^k by default.
        noise: of the function, relative.

    Returns:
        A `Taylor` of each direction.

    Raises:
        ValueError: on an unknown mode or order.
    """
    word("mode", mode, ("reverse", "forward"))
    number("noise", noise, above=0)
    if not callable(function):
        raise ValueError(f"function: {function!r} must be called as function(at)")
    if whole("order", order) not in (1, 2):
        raise ValueError(f"order: {order} must be 1 or 2")
    h = 0.1 * 0.5 ** np.arange(9) if steps is None else np.asarray(steps, float)

    def first(at, q, operands):
        if mode == "forward":
            return jax.jvp(lambda p: function(p, *operands), (at,), (q,))
        value, gradient = jax.value_and_grad(function)(at, *operands)
        parts = jax.tree.map(lambda g, x: jnp.sum(g * x), gradient, q)
        return value, sum(jax.tree.leaves(parts))

    @jax.jit
    def expand(at, q, operands):
        if order == 1:
            return *first(at, q, operands), 0.0
        (value, slope), (_, curvature) = jax.jvp(
            lambda p: first(p, q, operands), (at,), (q,)
        )
        return value, slope, curvature

    alone = jax.jit(function)  # most values need no derivative

    found = {}
    for name, q in directions.items():
        q = jax.tree.map(_like, q, at)  # of one type: compiled once
        value, slope, curvature = map(float, expand(at, q, operands))

        def along(h, q=q):
            moved = jax.tree.map(lambda p, dp: p + h * dp, at, q)
            return float(alone(moved, *operands))

        rest = [abs(along(x) - value - x * slope - 0.5 * x * x * curvature) for x in h]
        difference = (along(h[-1]) - along(-h[-1])) / (2 * h[-1])
        found[name] = Taylor(
            h, np.asarray(rest), slope, difference, order, noise * abs(value)
        )
    return found


def check(
    problem: Problem,
    names: Sequence[str] | None = None,
    *,
    params: Params | None = None,
    measure: Callable[[Problem, Params, jax.Array], jax.Array] | None = None,
    seed: int = 0,
    **options: Any,
) -> dict[str, Taylor]:
    """Taylor tests of a problem's solution along random changes of its parameters.

    Args:
        problem: prepared with `rtol` of 1e-10 or less.
        names: of the parameters, all by default.
        params: where; those of the problem by default.
        measure: a scalar of (problem, params, u); by default a random functional of
            the displacements and their square.
        seed: of the random changes.
        **options: those of `taylor`.

    Returns:
        A `Taylor` of each parameter, by name.

    Raises:
        ValueError: on an unknown parameter.
        NotConverged: if the solve itself fails.
    """
    names = (names,) if isinstance(names, str) else names
    at = dict(problem.params if params is None else params)
    at = jax.tree.map(jnp.asarray, at)
    unknown = sorted(set(names or ()) - set(at))
    if unknown:
        raise ValueError(f"names: {unknown} are no parameters; there are {sorted(at)}")
    u, info = problem.solve(at)
    status = Status(int(info.status))
    if status is not Status.CONVERGED:
        history = np.asarray(info.residuals)[: int(info.iterations)]
        raise NotConverged(status, history, f"solve ({problem.linear.method})")
    size = float(jnp.abs(u).max()) or 1.0
    rng = np.random.default_rng(seed)
    weights = jnp.asarray(rng.normal(size=u.shape)) / u.size**0.5

    def random_functional(problem, params, u):
        v = u / size
        return jnp.sum(weights * v) + 0.5 * jnp.mean(v * v)

    chosen = measure or random_functional

    def function(params, problem):
        return chosen(problem, params, problem.solve(params)[0])

    pull = problem.reaction(u, at)
    fallback = {"load": float(jnp.abs(pull).max()), "prescribed": size}
    directions = {}
    for name in names or at:

        def change(path, x, name=name):
            parts = [getattr(step, "key", None) for step in path]
            around = at if len(path) < 2 else at[name][path[0].idx]
            own = parts[-1] if parts else name  # of a laminate that of a ply
            size = _size(str(own), x, around) or fallback.get(name, 1.0)
            return rng.normal(size=jnp.shape(x)) * size

        still = jax.tree.map(jnp.zeros_like, at)
        moved = jax.tree_util.tree_map_with_path(change, at[name])
        directions[name] = still | {name: moved}
    return taylor(function, at, directions, problem, **options)


def _like(x: Any, p: Any) -> jax.Array:
    p = jnp.asarray(p)
    return jnp.broadcast_to(jnp.asarray(x, p.dtype), p.shape)


def _size(name: str, value: Any, params: Params) -> float:
    """How far to move a parameter: of its own size, positions by a share of theirs."""
    if name == "X":
        return 0.2 * float(jnp.mean(params["vol"]) ** (1.0 / value.shape[1]))
    return float(jnp.max(jnp.abs(value)))
