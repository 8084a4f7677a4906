"""Solves with the tangent of springs that soften: one factorisation, corrected.

    K = K_0 + B^T diag(k_t) B

with K_0 that of the springs that never soften. A fall on a straight line has a few
slopes, so that from one iteration to the next few springs change theirs, each by one
outer product (`jaxpd.solvers.downdate`). Past a limit point K is not positive; the
factorisation copes, and is made with row exchanges where the residual asks for it.

Host only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.solvers.downdate import Downdated, Singular

Floats = NDArray[np.floating]

#: Springs that may change without a new factorisation: each costs a back-substitution.
FEW = 40
#: A gap of a correction that would lose digits.
NARROW = 1e-3
#: Residual of a linear solve that will do (-); Newton's method looks at its own.
GOOD = 1e-6


class SoftTangent:
    """K on the free entries, for slopes that change; see the module.

    Attributes:
        inverse: the factors, with counters.
        K0: stiffness of what never softens [free, free].
        B: elongations of the others, of free displacements [b, free].
        slopes: of the springs now [b] (N/m).
    """

    def __init__(self, K0: sp.csr_array, B: sp.csr_array):
        """Before the first `follow`."""
        self.K0, self.B = K0, B
        size: Any = K0.shape
        self.inverse = Downdated(size[0])
        self.slopes: Floats = np.empty(0)
        self._definite = True

    def follow(self, k: Floats) -> None:
        """Go to the slopes k [b] (N/m).

        Raises:
            Singular: if the matrix cannot be factorised.
        """
        if not self.inverse.factorisations:
            self._anew(k)
            return
        changed = np.flatnonzero(k != self.slopes)
        if len(changed) > FEW:
            self._anew(k)
            return
        for spring in changed.tolist():
            if self.inverse.full or not self._correct(spring, k[spring]):
                self._anew(k)
                return

    def _correct(self, spring: int, k: float) -> bool:
        """Change one slope; whether that could be done."""
        row = slice(*self.B.indptr[spring : spring + 2])
        at, g = self.B.indices[row], np.asarray(self.B.data[row], float)
        less = float(self.slopes[spring] - k)
        w = self.inverse.along(at, g)
        gap = 1.0 - less * float(g @ w[at])
        if not abs(gap) > NARROW:
            return False
        self.inverse.lose(w, less, gap)
        self.slopes[spring] = k
        return True

    def _anew(self, k: Floats, definite: bool = True) -> None:
        self.slopes = k.copy()
        self._definite = definite
        K = self.K0 + self.B.T @ self.B.multiply(k[:, None]).tocsr()
        self.inverse.factorise(K, definite)

    def mv(self, x: Floats) -> Floats:
        """K x [free]."""
        return self.K0 @ x + self.B.T @ (self.slopes * (self.B @ x))

    def solve(self, b: Floats) -> Floats:
        """K^-1 b [free], refined once.

        Raises:
            Singular: if no factorisation gives a small residual.
        """
        size = np.linalg.norm(b)
        for attempt in range(3):
            if attempt:  # corrections add round-off; then the pivots may be at fault
                self._anew(self.slopes, definite=attempt == 1 and self._definite)
            x = self.inverse.solve(b)
            x += self.inverse.solve(b - self.mv(x))
            if np.linalg.norm(b - self.mv(x)) <= GOOD * size:
                return x
        raise Singular("K: the tangent is singular, or too close to it")
