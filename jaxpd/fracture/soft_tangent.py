"""Solves with the tangent of springs that soften: one factorisation, corrected.

    K = K_0 + B^T diag(k_t) B

with K_0 that of the springs that never soften. A fall on a straight line has a few
slopes, so that from one iteration to the next few springs change theirs, each by one
outer product (`jaxpd.solvers.downdate`). Past a limit point K is not positive; the
factorisation copes, and is made with row exchanges where the residual asks for it.

`KrylovTangent` iterates instead, by conjugate gradients, and turns to the factors where
it meets a direction of negative curvature, or does not converge.

Host only.
"""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.operators.constraints import fix
from jaxpd.operators.springs import Springs, SpringTangent
from jaxpd.solvers.downdate import Downdated, Singular
from jaxpd.solvers.linear import LinearSolver, solve_system
from jaxpd.solvers.status import Status

Floats = NDArray[np.floating]

#: Springs that may change without a new factorisation: each costs a back-substitution.
FEW = 40
#: A gap of a correction that would lose digits.
NARROW = 1e-3
#: The iteration, before it is given up.
ITERATE = LinearSolver(None, "d-pcg", 1e-9, 5000)
#: Residual of a linear solve that will do (-); Newton's method looks at its own.
GOOD = 1e-6


class SoftTangent:
    """K on the free entries, for slopes that change; see the module.

    Attributes:
        inverse: the factors, with counters.
        K0: stiffness of what never softens [free, free].
        B: elongations of the others, of free displacements [b, free].
        slopes: of the springs now [b] (N/m).
        turned: solves that turned to the factors.
    """

    def __init__(self, K0: sp.csr_array, B: sp.csr_array):
        """Before the first `follow`."""
        self.K0, self.B = K0, B
        size: Any = K0.shape
        self.inverse = Downdated(size[0])
        self.slopes: Floats = np.empty(0)
        self._made: Floats = np.empty(0)
        self.turned = 0

    def follow(self, k: Floats) -> None:
        """Go to the slopes k [b] (N/m)."""
        self.slopes = k.copy()

    def mv(self, x: Floats) -> Floats:
        """K x [free]."""
        return self.K0 @ x + self.B.T @ (self.slopes * (self.B @ x))

    def solve(self, b: Floats) -> Floats:
        """K^-1 b [free], refined once.

        Raises:
            Singular: if no factorisation gives a small residual.
        """
        size = np.linalg.norm(b)
        self._correct()
        for definite in (None, True, False):
            # corrections add round-off; then the pivots may be at fault
            if definite is not None:
                self._anew(definite)
            x = self.inverse.solve(b)
            x += self.inverse.solve(b - self.mv(x))
            if np.linalg.norm(b - self.mv(x)) <= GOOD * size:
                return x
        raise Singular("K: the tangent is singular, or too close to it")

    def _correct(self) -> None:
        """Bring the factors to the slopes."""
        if not self.inverse.factorisations:
            self._anew()
            return
        changed = np.flatnonzero(self.slopes != self._made)
        if len(changed) > FEW:
            self._anew()
            return
        for spring in changed.tolist():
            row = slice(*self.B.indptr[spring : spring + 2])
            at, g = self.B.indices[row], np.asarray(self.B.data[row], float)
            less = float(self._made[spring] - self.slopes[spring])
            if self.inverse.full:
                self._anew()
                return
            w = self.inverse.along(at, g)
            gap = 1.0 - less * float(g @ w[at])
            if not abs(gap) > NARROW:
                self._anew()
                return
            self.inverse.lose(w, less, gap)
            self._made[spring] = self.slopes[spring]

    def _anew(self, definite: bool = True) -> None:
        self._made = self.slopes.copy()
        K = self.K0 + self.B.T @ self.B.multiply(self.slopes[:, None]).tocsr()
        self.inverse.factorise(K, definite)


class KrylovTangent(SoftTangent):
    """The same by conjugate gradients with the diagonal, as long as they can."""

    def __init__(
        self,
        K0: sp.csr_array,
        B: sp.csr_array,
        springs: Springs,
        soft: NDArray[np.integer],
        fixed: NDArray[np.bool_],
    ):
        """Before the first `follow`.

        Args:
            K0: as of `SoftTangent`.
            B: as of `SoftTangent`.
            springs: all springs, with k zero where a crack has cut one.
            soft: numbers of those that may soften.
            fixed: mask of prescribed components [n, d].
        """
        super().__init__(K0, B)
        self._springs, self._soft = jax.device_put(springs), soft
        self._k = np.asarray(springs.k)
        self._held = fix(fixed)
        self._free = ~fixed

    def solve(self, b: Floats) -> Floats:
        """K^-1 b [free].

        Raises:
            Singular: if the factors were needed and no residual was small.
        """
        if not b.any():
            return np.zeros_like(b)
        k, right = self._k.copy(), np.zeros(self._free.shape)
        k[self._soft] = self.slopes
        right[self._free] = b
        K = SpringTangent(self._springs, jnp.asarray(k), len(right))
        x, info = solve_system(ITERATE, K, self._held, jnp.asarray(right))
        if info.status == Status.CONVERGED:
            return np.asarray(x)[self._free]
        self.turned += 1
        return super().solve(b)
