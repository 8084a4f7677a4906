"""Extreme eigenvalues and condition numbers by the Lanczos process, matrix-free."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.linalg import eigh_tridiagonal


@dataclass(frozen=True)
class Spectrum:
    """Ends of a spectrum.

    Attributes:
        smallest: smallest eigenvalue.
        largest: largest eigenvalue.
        steps: Lanczos steps taken.
        error: bound on the relative error of either end, from the Ritz residuals.
    """

    smallest: float
    largest: float
    steps: int
    error: float

    @property
    def condition(self) -> float:
        """Condition number kappa_2 (-)."""
        return self.largest / self.smallest


def extremes(
    mv: Callable[..., jax.Array],
    start: jax.Array,
    *operands: Any,
    rtol: float = 1e-4,
    max_steps: int = 5000,
    chunk: int = 50,
) -> Spectrum:
    """Smallest and largest eigenvalue of a symmetric positive definite operator.

    Plain Lanczos: without reorthogonalisation extreme Ritz values come out right and
    merely repeat. It stops when both Ritz residuals, divided by their eigenvalues, are
    below `rtol`; each bounds the distance to the nearest eigenvalue.

    Args:
        mv: the operator, called as mv(v, *operands); traced once.
        start: a random vector in the subspace of interest (prescribed entries zero).
        *operands: pytrees that mv needs. Large ones belong here: what mv closes over
            becomes a constant of the compiled code.
        rtol: relative accuracy of both ends.
        max_steps: most Lanczos steps.
        chunk: steps between looks at the Ritz values.

    Raises:
        ValueError: if the operator is not positive definite, or `max_steps` do not
            suffice, with the figures reached.
    """

    @jax.jit
    def advance(carry, operands):
        def step(carry, _):
            q_old, q, beta = carry
            w = mv(q, *operands) - beta * q_old
            a = jnp.vdot(q, w)
            w = w - a * q
            b = jnp.linalg.norm(w)
            return (q, w / jnp.where(b > 0, b, 1.0), b), (a, b)

        return jax.lax.scan(step, carry, None, length=chunk)

    q = start / jnp.linalg.norm(start)
    carry = (jnp.zeros_like(q), q, jnp.zeros((), q.dtype))
    a_all, b_all = np.zeros(0), np.zeros(0)
    low = high = error = np.nan
    while len(a_all) < max_steps:
        carry, (a, b) = advance(carry, operands)
        a_all, b_all = np.append(a_all, a), np.append(b_all, b)
        # an exhausted Krylov space ends the process: cut there
        empty = np.flatnonzero(b_all <= 1e-13 * np.abs(a_all).max())
        size = int(empty[0]) + 1 if len(empty) else len(a_all)
        ritz, vectors = eigh_tridiagonal(a_all[:size], b_all[: size - 1])
        low, high = float(ritz[0]), float(ritz[-1])
        residual = np.abs(b_all[size - 1] * vectors[-1, [0, -1]])
        if not low > 0:
            raise ValueError(
                f"mv: not positive definite, Ritz value {low:.3e} beside {high:.3e}"
            )
        error = float(np.max(residual / [low, high]))
        if len(empty) or error <= rtol:
            return Spectrum(low, high, size, error)
    raise ValueError(
        f"max_steps: {max_steps} Lanczos steps reach {low:.4e} .. {high:.4e} to "
        f"{error:.1e} only; raise max_steps or loosen rtol = {rtol:g}"
    )
