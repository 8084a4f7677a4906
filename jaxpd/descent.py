"""Going downhill: steps of L-BFGS with a line search, or of any optax transformation.

One function is compiled, loss and gradient together, and the line search looks at it
from the host: a search inside the trace would compile them again.
"""

from __future__ import annotations

import functools
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import optax

from jaxpd.compiling import quickly
from jaxpd.inverse import Inverse, Values
from jaxpd.run import QUICK_POINTS

#: Most evaluations of a line search.
SEARCHES = 25


class State(NamedTuple):
    """A fit under way: where it is, what was evaluated there, and the way on."""

    z: Values
    loss: Any
    slope: Values
    way: Values
    memory: Any
    best: Values
    losses: np.ndarray
    gradients: np.ndarray
    path: np.ndarray

    @property
    def taken(self) -> int:
        """Points in the histories."""
        return len(self.losses)

    @property
    def fall(self) -> float:
        """Slope of the loss along the way."""
        return _inner(self.slope, self.way)


def moved(
    state: State, seen: tuple[Values, Any, Values, Any], method: Any, rate: float
) -> State:
    """The state at another z, with histories longer by one."""
    z, loss, slope, scalars = seen
    way, memory = _direct(slope, state.memory, z, method, rate)
    better = float(loss) < state.losses.min(initial=np.inf)
    sizes = [np.abs(np.asarray(g)).max() for g in jax.tree.leaves(slope)]
    return State(
        z,
        loss,
        slope,
        way,
        memory,
        z if better else state.best,
        np.append(state.losses, loss),
        np.append(state.gradients, np.max(sizes)),  # NaN if any is
        np.concatenate([state.path, np.asarray(scalars)[None]]),
    )


def _evaluate(z: Values, inverse: Inverse) -> tuple[Any, Values, jax.Array]:
    """Loss, infinite where a solve failed; its gradient; values of scalars."""

    def of(z):
        loss = inverse.loss(z)
        return jnp.where(jnp.isnan(loss), jnp.inf, loss)

    values, start = inverse.values(z), inverse.variables
    scalars = [values[k] for k in values if not jnp.ndim(start[k].start)]
    return *jax.value_and_grad(of)(z), jnp.array(scalars)


_compiled = jax.jit(_evaluate)


def _look(z: Values, inverse: Inverse) -> tuple[Values, Any, Values, jax.Array]:
    few = len(inverse.problem.X) <= QUICK_POINTS[inverse.problem.spec.kinematics]
    return z, *(quickly(_evaluate) if few else _compiled)(z, inverse)


def _optimiser(method: Any, rate: float) -> Any:
    if isinstance(method, str):
        return optax.adam(rate) if method == "adam" else optax.scale_by_lbfgs()
    return method


@functools.partial(jax.jit, static_argnums=(3, 4))
def _direct(slope: Values, memory: Any, z: Values, method: Any, rate: float) -> Any:
    """The way on, and the memory of the optimiser."""
    way, memory = _optimiser(method, rate).update(slope, memory, z)
    sign = -1.0 if method == "lbfgs" else 1.0
    return jax.tree.map(lambda x: sign * x, way), memory


def begin(inverse: Inverse, method: Any, rate: float) -> State:
    """The state at the first guess."""
    z = inverse.start()
    memory = jax.jit(_optimiser(method, rate).init)(z)
    seen, nothing = _look(z, inverse), np.zeros(0)
    path = np.zeros((0, len(seen[3])))
    empty = State(z, 0.0, z, z, memory, z, nothing, nothing, path)
    return moved(empty, seen, method, rate)


def advance(state: State, inverse: Inverse, method: Any, rate: float) -> State:
    """The state one step further."""
    if method != "lbfgs":
        z = jax.tree.map(jnp.add, state.z, state.way)
        return moved(state, _look(z, inverse), method, rate)
    seen = None
    if state.fall < 0:
        # the first way is the gradient itself, of any length
        first = 1.0 / _inner(state.way, state.way) ** 0.5 if state.taken == 1 else 1.0
        seen = _search(state, inverse, min(1.0, first))
    if seen is None:  # nothing lower there: forget, and go down the gradient once
        way = jax.tree.map(jnp.negative, state.slope)
        memory = jax.jit(_optimiser(method, rate).init)(state.z)
        state = state._replace(way=way, memory=memory)
        seen = _search(state, inverse, min(1.0, 1.0 / _inner(way, way) ** 0.5))
    if seen is None:  # stay, and let the history say so
        seen = (state.z, state.loss, state.slope, state.path[-1])
    return moved(state, seen, method, rate)


def _search(state: State, inverse: Inverse, length: float) -> Any:
    """What is seen after a step that meets the weak Wolfe conditions, or None.

    By bisection; a solve that fails is too far. Source: A. S. Lewis, M. L. Overton,
    Math. Program. 141 (2013), algorithm 2.6.
    """
    begin, fall = float(state.loss), state.fall
    near, far, found = 0.0, np.inf, None
    for _ in range(SEARCHES):
        z = jax.tree.map(lambda x, p, t=length: x + t * p, state.z, state.way)
        seen = _look(z, inverse)
        slope = _inner(seen[2], state.way)
        if not (float(seen[1]) <= begin + 1e-4 * length * fall and np.isfinite(slope)):
            far = length
        else:
            near, found = length, seen
            if slope >= 0.9 * fall:
                break
        length = 0.5 * (near + far) if np.isfinite(far) else 2.0 * near
    return found


def _inner(a: Values, b: Values) -> float:
    return float(sum(jnp.vdot(a[k], b[k]) for k in a))
