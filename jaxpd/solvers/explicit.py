"""Explicit integration in time: velocity Verlet and the step that it allows.

    v += dt a / 2,   u += dt v,   a = (force(u) + load) / mass,   v += dt a / 2

Second order, symplectic, momentum to round-off. The operator keeps its arrays in its
own layout [d, L] (`lay`, `pick`) and its memory; see `jaxpd.operators.protocol`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse.linalg


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class State:
    """A moving body at one time.

    Attributes:
        u: displacements [d, L] (m).
        v: velocities [d, L] (m/s).
        force: internal forces [d, L] (N) at u.
        history: the operator's memory.
        work: of loads and supports on the body so far [] (J).
    """

    u: jax.Array
    v: jax.Array
    force: jax.Array
    history: Any
    work: jax.Array


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Drive:
    """What is moved and by what, in the layout of the operator.

    Attributes:
        mass: [L] (kg), any positive number in empty places.
        loads: external forces [q, d, L] (N) of q histories.
        fixed: mask of prescribed displacements [d, L], or None.
        moves: prescribed displacements [p, d, L] (m) of p histories, or None.
    """

    mass: jax.Array
    loads: jax.Array
    fixed: Any
    moves: Any

    def load(self, factors: jax.Array) -> Any:
        """External forces [d, L] (N) at the factors [q] of a time."""
        return _weighted(factors, self.loads)


def _weighted(factors: jax.Array, parts: jax.Array) -> Any:
    return sum((factors[q] * parts[q] for q in range(len(parts))), start=0.0)


def begin(op: Any, u: jax.Array, v: jax.Array, history: Any) -> State:
    """The state at the start; bonds that are too long break at once."""
    force, history = op.commit(u, history)
    return State(u, v, force, history, jnp.zeros((), u.dtype))


def verlet(op: Any, drive: Drive, state: State, dt: Any, factors: Any) -> State:
    """Steps of velocity Verlet, one a row of the factors.

    Args:
        op: operator with `commit(u, history) -> force, history`.
        drive: masses, loads, supports.
        state: where to begin.
        dt: time step [] (s).
        factors: of the loads before and after each step [steps, q] and [steps, q],
            what those of the moves grow by and are after it [steps, p] and [steps, p].

    Returns:
        The state after them. `work` is that of the loads by the trapezoidal rule, and
        of the supports: what they add to the kinetic energy of the points that they
        move, and what these pull at the others.
    """
    dt = jnp.asarray(dt, state.u.dtype)
    cast = jax.tree.map(lambda x: jnp.asarray(x, state.u.dtype), factors)
    mass, light = drive.mass[None], (dt / drive.mass)[None]

    def step(state: State, factor: Any) -> tuple[State, None]:
        before, after = drive.load(factor[0]), drive.load(factor[1])
        v = state.v + 0.5 * light * (state.force + before)
        du: Any = dt * v
        if drive.fixed is not None:
            du = jnp.where(drive.fixed, _weighted(factor[2], drive.moves), du)
        u = state.u + du
        if drive.fixed is not None:  # not what round-off adds up to
            u = jnp.where(drive.fixed, _weighted(factor[3], drive.moves), u)
        force, history = op.commit(u, state.history)
        v = v + 0.5 * light * (force + after)
        pull = 0.5 * (before + after)
        if drive.fixed is None:
            work = state.work
            if len(drive.loads):
                work = work + jnp.sum(pull * du)
            return State(u, v, force, history, work), None
        v = jnp.where(drive.fixed, du / dt, v)
        gain = 0.5 * mass * (v * v - state.v * state.v)
        held = gain - 0.5 * (state.force + force) * du
        work = jnp.sum(jnp.where(drive.fixed, held, pull * du))
        return State(u, v, force, history, state.work + work), None

    return jax.lax.scan(step, state, cast)[0]


def stable_dt(diagonal: Any, mass: Any) -> float:
    """A time step (s) that is stable for bonds that pull, from the block diagonal.

    Each bond adds k (n . (u_i - u_j))^2 <= 2 k ((n . u_i)^2 + (n . u_j)^2) to u.K u, so
    that u.K u <= 2 sum_i u_i.K_ii u_i and the largest eigenvalue of M^-1 K is at most
    twice that of the blocks K_ii / m_i: dt = 2 / sqrt(2 max eig(K_ii / m_i)), exact
    for a chain. It holds at rest: where bonds push, blocks of |k| are needed, and a
    large stretch adds stiffness across the bonds.

    Args:
        diagonal: blocks K_ii [n, d, d] (N/m) at rest.
        mass: [n] (kg).
    """
    blocks = np.asarray(diagonal, float) / np.asarray(mass, float)[:, None, None]
    largest = float(np.linalg.eigvalsh(blocks)[:, -1].max())
    return float("inf") if largest <= 0.0 else 2.0 / (2.0 * largest) ** 0.5


@jax.jit
def _scaled(op: Any, drive: Drive, free: Any, history: Any, x: Any) -> jax.Array:
    """M^-1/2 K M^-1/2 x at rest."""
    root = free / jnp.sqrt(drive.mass)[None]
    rest, along = jnp.zeros_like(x), root * x
    slope = jax.jvp(lambda u: op.commit(u, history)[0], (rest,), (along,))[1]
    return -root * slope


def largest_dt(op: Any, drive: Drive, history: Any, rtol: float = 1e-6) -> float:
    """The longest stable time step (s) at rest, 2 / sqrt(largest eigenvalue of M^-1 K).

    By SciPy's Lanczos process on the symmetric M^-1/2 K M^-1/2: a check of
    `stable_dt`, dearer and from the other side.

    Args:
        op: an operator that can be differentiated forward.
        drive: masses and supports.
        history: the memory at rest.
        rtol: relative accuracy of the eigenvalue.
    """
    shape = drive.mass.shape
    free = 1.0 if drive.fixed is None else jnp.where(drive.fixed, 0.0, 1.0)

    d = drive.loads.shape[1]
    size = d * shape[0]

    def product(x):
        x = jnp.asarray(x.reshape(d, -1), drive.mass.dtype)
        return np.asarray(_scaled(op, drive, free, history, x), float).ravel()

    make: Any = scipy.sparse.linalg.LinearOperator
    lanczos: Any = scipy.sparse.linalg.eigsh
    linear = make((size, size), product, dtype=float)
    start = np.random.default_rng(0).normal(size=size)  # the same every time
    top = lanczos(linear, 1, which="LA", tol=rtol, v0=start, return_eigenvectors=False)
    return 2.0 / float(top[0]) ** 0.5
