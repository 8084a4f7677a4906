"""Fitting by optax: L-BFGS or Adam, with history, progress, early stop and restart."""

from __future__ import annotations

import contextlib
import functools
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jaxpd.inverse import Inverse, Penalty, Values, Variable
from jaxpd.io import load_state, save_state
from jaxpd.observe import Observation
from jaxpd.problem import Params, Problem
from jaxpd.run import QUICK_POINTS
from jaxpd.solvers.linear import quickly

#: Steps without a lower loss after which a fit ends.
PATIENCE = {"lbfgs": 2, "adam": 50}
#: Most evaluations of a line search.
SEARCHES = 25


@dataclass(frozen=True, eq=False)
class Fit:
    """What was found.

    Attributes:
        inverse: the problem.
        z: variables of the lowest loss, without units.
        reason: why it ended: "gradient" (small enough), "stalled" (the loss no longer
            falls), "steps" (used up) or "failed" (loss or gradient not finite).
        losses: loss at the start and after each step.
        gradients: largest entry of its gradient in z.
        path: values of the scalar variables, by name.
    """

    inverse: Inverse
    z: Values
    reason: str
    losses: np.ndarray
    gradients: np.ndarray
    path: dict[str, np.ndarray]

    @property
    def values(self) -> Values:
        """Values of the variables."""
        return jax.tree.map(np.asarray, self.inverse.values(self.z))

    @property
    def params(self) -> Params:
        """Parameters of the problem with these values."""
        return self.inverse.params(self.z)

    @property
    def steps(self) -> int:
        """Steps taken."""
        return len(self.losses) - 1

    def __repr__(self) -> str:
        """One line: why it ended, loss, scalar values."""
        shown = {k: f"{float(v):.6g}" for k, v in self.values.items() if not v.ndim}
        return (
            f"Fit({self.reason} after {self.steps} steps, loss {self.losses.min():.3e}"
            f" over {self.inverse.count} data, {shown})"
        )


def fit(
    problem: Problem,
    variables: dict[str, Variable],
    observations: Sequence[Observation],
    penalties: Sequence[Penalty] = (),
    *,
    method: str = "lbfgs",
    steps: int = 100,
    rate: float = 0.05,
    gtol: float = 1e-9,
    rtol: float = 1e-12,
    progress: bool = False,
    checkpoint: str | Path | None = None,
    every: int = 1,
) -> Fit:
    """Fit parameters of a problem to observations.

    Args:
        problem: its `params` are the rest.
        variables: what is sought, by name: `jaxpd.inverse.positive` and others.
        observations: what was measured: `jaxpd.observe.displacements` and others.
        penalties: what is preferred: `jaxpd.inverse.smooth`.
        method: "lbfgs" with a line search, or "adam".
        steps: most steps.
        rate: learning rate of Adam, in z.
        gtol: it ends when the largest entry of the gradient is below this share of the
            first.
        rtol: a loss that falls by less than this share has not fallen.
        progress: show a bar (needs tqdm).
        checkpoint: a file that keeps the state; if it exists, the fit goes on from it,
            to the same end, bit by bit.
        every: steps between checkpoints.

    Returns:
        A `Fit`.

    Raises:
        ValueError: on an unknown method or parameter, numbers that are not positive, or
            a checkpoint of another fit.
    """
    if method not in PATIENCE:
        raise ValueError(f"method: {method!r} must be one of {list(PATIENCE)}")
    for name, number in (("steps", steps), ("rate", rate), ("every", every)):
        if not number > 0:
            raise ValueError(f"{name}: {number} must be positive")
    if not variables or not observations:
        raise ValueError("variables, observations: give at least one of each")
    for name, variable in variables.items():
        if variable.place is None and name not in problem.params:
            raise ValueError(
                f"variables: {name!r} is no parameter, there are "
                f"{sorted(problem.params)}; give it a `place`"
            )
    inverse = Inverse(problem, variables, tuple(observations), tuple(penalties))
    inverse = jax.device_put(inverse)
    state = _begin(inverse, method, rate)
    shapes = {k: np.shape(v.start) for k, v in variables.items()}
    mark = f"a fit by {method} at rate {rate} of {json.dumps(shapes)}"
    file = None if checkpoint is None else Path(checkpoint)
    if file is not None and file.exists():
        state = load_state(file, state, mark)
    with _bar(progress, steps) as show:
        while not (reason := _ended(state, method, steps, gtol, rtol)):
            state = _advance(state, inverse, method, rate)
            show(state)
            if file is not None and state.taken % every == 0:
                save_state(file, state, mark)
    if file is not None:
        save_state(file, state, mark)
    names = [k for k, v in variables.items() if not np.ndim(v.start)]
    path = dict(zip(names, state.path.T, strict=True))
    return Fit(inverse, state.best, reason, state.losses, state.gradients, path)


class _State(NamedTuple):
    """A fit under way: where it is, what was evaluated there, and what it remembers."""

    z: Values
    loss: Any
    slope: Values
    memory: Any
    best: Values
    losses: np.ndarray
    gradients: np.ndarray
    path: np.ndarray

    @property
    def taken(self) -> int:
        return len(self.losses)

    def at(self, z: Values, loss: Any, slope: Values, scalars: Any) -> _State:
        """The next state, histories longer by one."""
        largest = max(float(jnp.abs(g).max()) for g in jax.tree.leaves(slope))
        better = float(loss) < self.losses.min(initial=np.inf)
        return self._replace(
            z=z,
            loss=loss,
            slope=slope,
            best=z if better else self.best,
            losses=np.append(self.losses, loss),
            gradients=np.append(self.gradients, largest),
            path=np.concatenate([self.path, np.asarray(scalars)[None]]),
        )


def _evaluate(z: Values, inverse: Inverse) -> tuple[Any, Values, jax.Array]:
    """Loss, infinite where a solve failed; its gradient; values of scalars."""

    def of(z):
        loss = inverse.loss(z)
        return jnp.where(jnp.isnan(loss), jnp.inf, loss)

    scalars = [v for v in inverse.values(z).values() if not jnp.ndim(v)]
    return *jax.value_and_grad(of)(z), jnp.array(scalars)


_compiled = jax.jit(_evaluate)


def _look(z: Values, inverse: Inverse) -> tuple[Any, Values, jax.Array]:
    few = len(inverse.problem.X) <= QUICK_POINTS[inverse.problem.spec.kinematics]
    return (quickly(_evaluate) if few else _compiled)(z, inverse)


def _optimiser(method: str, rate: float) -> Any:
    return optax.adam(rate) if method == "adam" else optax.scale_by_lbfgs()


@functools.partial(jax.jit, static_argnums=(3, 4))
def _direct(slope: Values, memory: Any, z: Values, method: str, rate: float) -> Any:
    """The way on, and the memory of the optimiser."""
    way, memory = _optimiser(method, rate).update(slope, memory, z)
    sign = 1.0 if method == "adam" else -1.0
    return jax.tree.map(lambda x: sign * x, way), memory


def _begin(inverse: Inverse, method: str, rate: float) -> _State:
    z = inverse.start()
    memory = jax.jit(_optimiser(method, rate).init)(z)
    loss, slope, scalars = _look(z, inverse)
    nothing = np.zeros(0)
    path = np.zeros((0, len(scalars)))
    empty = _State(z, loss, slope, memory, z, nothing, nothing, path)
    return empty.at(z, loss, slope, scalars)


def _advance(state: _State, inverse: Inverse, method: str, rate: float) -> _State:
    way, memory = _direct(state.slope, state.memory, state.z, method, rate)
    state = state._replace(memory=memory)
    if method == "adam":
        z = jax.tree.map(jnp.add, state.z, way)
        return state.at(z, *_look(z, inverse))
    return _search(state, way, inverse)


def _search(state: _State, way: Values, inverse: Inverse) -> _State:
    """A step along `way` that meets the weak Wolfe conditions, by bisection.

    A solve that fails is too far. Source: A. S. Lewis, M. L. Overton, Math. Program.
    141 (2013), algorithm 2.6.
    """
    begin = float(state.loss)
    fall = _inner(state.slope, way)
    # the first way is the gradient itself, of any length
    length = 1.0 if state.taken > 1 else min(1.0, 1.0 / _inner(way, way) ** 0.5)
    near, far, found = 0.0, np.inf, None
    for _ in range(SEARCHES):
        z = jax.tree.map(lambda x, p, t=length: x + t * p, state.z, way)
        seen = _look(z, inverse)
        slope = _inner(seen[1], way)
        if not (float(seen[0]) <= begin + 1e-4 * length * fall and np.isfinite(slope)):
            far = length
        else:
            near, found = length, (z, *seen)
            if slope >= 0.9 * fall:
                break
        length = 0.5 * (near + far) if np.isfinite(far) else 2.0 * near
    if found is None:  # nothing lower in sight: stay, and say so by the history
        found = (state.z, state.loss, state.slope, state.path[-1])
    return state.at(*found)


def _inner(a: Values, b: Values) -> float:
    return float(sum(jnp.vdot(a[k], b[k]) for k in a))


def _ended(state: _State, method: str, steps: int, gtol: float, rtol: float) -> str:
    """Why the fit ends, or nothing."""
    if not state.taken:
        return ""
    if not np.isfinite([state.losses[-1], state.gradients[-1]]).all():
        return "failed"
    if state.gradients[-1] <= gtol * state.gradients[0]:
        return "gradient"
    late = PATIENCE[method]
    if state.taken > late:
        before = state.losses[:-late].min()
        if not state.losses[-late:].min() < (1.0 - rtol) * before:
            return "stalled"
    return "steps" if state.taken > steps else ""


@contextlib.contextmanager
def _bar(wanted: bool, steps: int) -> Iterator[Callable[[_State], None]]:
    if not wanted:
        yield lambda state: None
        return
    try:
        from tqdm.auto import tqdm  # noqa: PLC0415
    except ImportError as error:
        raise ValueError(
            "progress: True needs tqdm; pip install 'jaxpd[progress]', or leave it out"
        ) from error
    with tqdm(total=steps + 1, desc="fit") as bar:

        def show(state):
            bar.update(state.taken - bar.n)
            bar.set_postfix(loss=f"{float(state.loss):.3e}")

        yield show
