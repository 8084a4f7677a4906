"""How a solve ended, inside a trace as a number and outside as words.

Inside `jit` nothing can be raised: solvers return a `Status` code beside their result.
On the host `describe` turns it into a sentence with figures and a cure.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Status(IntEnum):
    """Outcome of an iteration; larger is worse."""

    CONVERGED = 0
    MAX_ITERATIONS = 1
    BREAKDOWN = 2
    NEGATIVE_CURVATURE = 3
    NOT_FINITE = 4
    STEP_TOO_SMALL = 5


CURES = {
    Status.CONVERGED: "converged",
    Status.MAX_ITERATIONS: (
        "the iteration limit was reached; raise it, loosen rtol, or use a stronger "
        "preconditioner (solver='amg')"
    ),
    Status.BREAKDOWN: (
        "the preconditioner is not positive definite, or the factorisation missed "
        "rtol: the stiffness is indefinite or nearly singular, or rtol is below "
        "round-off; loosen rtol, or prepare() anew for these parameters"
    ),
    Status.NEGATIVE_CURVATURE: (
        "the stiffness is not positive definite: compression has buckled bonds, the "
        "law softens, or a part hangs on too few "
        "bonds; use tangent='axial', more load_steps, or solver='direct'"
    ),
    Status.NOT_FINITE: (
        "NaN or infinity appeared: the tangent is singular, a bond was squeezed to "
        "zero length, or the law is undefined at this strain"
    ),
    Status.STEP_TOO_SMALL: (
        "the load step was halved to its limit: there is no equilibrium nearby, or "
        "rtol is below what round-off allows"
    ),
}


class NotConverged(RuntimeError):
    """A solve that did not converge; the message carries figures and a cure.

    Attributes:
        status: how it ended.
        residuals: relative residual after each iteration.
    """

    def __init__(self, status: Status, residuals: np.ndarray, what: str):
        self.status = status
        self.residuals = residuals
        super().__init__(describe(status, residuals, what))


def describe(status: Status, residuals: np.ndarray, what: str) -> str:
    """One sentence: what was solved, how it ended, the residual history, the cure."""
    shown = [f"{r:.1e}" for r in residuals]
    if len(shown) > 8:
        shown = [*shown[:3], "...", *shown[-4:]]
    return (
        f"{what}: {Status(status).name} after {len(residuals)} iterations, relative "
        f"residuals {', '.join(shown) or 'none'}: {CURES[Status(status)]}"
    )
