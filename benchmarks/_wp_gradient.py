"""The gradient of a misfit in the nodal modulus: implicit, unrolled, differences.

The cracked plate of `gradients.py`, n = 32, m = 4; value and gradient together, one
point a tolerance of the solve, against the gradient of a solve to 1e-12. Differences
know one direction; of the whole field they would be run once a parameter.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from _wp import Job, Method, Problem
from gradients import (
    Case,
    Setting,
    far,
    gradient,
    gradient_of,
    krylov,
    loss,
    reference,
    setting,
    unrolled,
)

N, M = 32, 4
CASE = Case("small", "gather", "d-pcg", N, M)
#: Entries of the field.
FIELD = (N + 1) * (N + 2 * M - 1)


@functools.cache
def settled(operator: str, solver: str) -> tuple[Setting, Any]:
    """A setting, and its exact gradient."""
    at, _ = setting(Case("small", operator, solver, N, M))
    return at, gradient_of(reference(at, "E"))


def implicit(operator: str, solver: str) -> Callable[[float], Job]:
    """The package's: one more linear solve."""

    def job(rtol: float) -> Job:
        at, right = settled(operator, solver)
        run, arguments = jax.jit(gradient(loss)), at.to(rtol).arguments("E")
        return Job(
            lambda: run(*arguments)[1],
            lambda found: (far(found, right, "E"), np.size(found["E"])),
        )

    return job


def through(again: bool) -> Callable[[float], Job]:
    """Reverse mode through as many iterations of the same CG."""

    def job(rtol: float) -> Job:
        at, right = settled("gather", "d-pcg")
        now = at.to(rtol)
        count = krylov(jax.jit(loss)(*now.arguments())[1][1])[0]
        run, arguments = jax.jit(gradient(unrolled(count, again))), now.arguments("E")
        return Job(
            lambda: run(*arguments)[1],
            lambda found: (far(found, right, "E"), np.size(found["E"])),
        )

    return job


def differences(rtol: float) -> Job:
    """Central, along one direction, at the step cbrt(rtol) that suits the tolerance."""
    at, right = settled("gather", "d-pcg")
    now, run = at.to(rtol), jax.jit(loss)
    slope, h = float(jnp.sum(right["E"] * 10.0 * at.direction)), np.cbrt(rtol)

    def call() -> float:
        ends = [
            run(
                {"E": at.params["E"] + sign * h * 10.0 * at.direction},
                *now.arguments()[1:],
            )[0]
            for sign in (1.0, -1.0)
        ]
        return float(ends[0] - ends[1]) / (2.0 * h)

    return Job(call, lambda found: (abs(found / slope - 1.0), 1))


RTOLS = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10)
PROBLEM = Problem(
    "gradient",
    f"Gradient of a misfit in {FIELD} moduli, cracked plate",
    "error of the gradient, relative (-)",
    (
        Method("implicit, D-PCG", "bonds", implicit("gather", "d-pcg"), RTOLS),
        Method("implicit, FFT, D-PCG", "bonds", implicit("fft", "d-pcg"), RTOLS),
        Method(
            "implicit, FFT, multigrid", "bonds", implicit("fft", "multigrid"), RTOLS
        ),
        Method("unrolled CG", "peer", through(False), RTOLS),
        Method("unrolled CG, checkpoints", "peer", through(True), RTOLS),
        Method(
            "differences, one direction",
            "peer",
            differences,
            RTOLS,
            "one number in place of the field",
        ),
        Method(
            f"differences, {FIELD} directions (computed)",
            "peer",
            differences,
            RTOLS,
            "one direction times their number, not run",
            FIELD,
        ),
    ),
    False,
    ("sizes: tolerance of the solve",),
    "value and gradient",
)
