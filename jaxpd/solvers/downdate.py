"""Solves with a stiffness that loses bonds one by one: one factorisation, corrected.

A spring of stiffness k along g, K -> K - k g g^T, changes the inverse by one outer
product (Sherman and Morrison),

    w = K^-1 g,    K'^-1 = K^-1 + k w w^T / gap,    gap = 1 - k g . w,

so that a bond costs one back-substitution. The factors are made anew where the list of
corrections has grown long. At gap = 0 the loss leaves w without stiffness: K' w = 0.
Such a motion is pinned, a spring to the ground at the entry that moves most. Where no
load works on it the pin carries nothing and every force in the body is exact.

Host only.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.linalg import splu

Floats = NDArray[np.floating]

#: Corrections before the factors are made anew, and numbers that they may take.
CORRECTIONS, NUMBERS = 160, 40_000_000
#: A gap that is round-off: the motion has lost its stiffness.
GONE = 1e-9


class Singular(ValueError):
    """A stiffness that cannot be factorised."""


class Downdated:
    """The inverse of a symmetric positive definite matrix that loses rank-one parts.

    Attributes:
        pins: entries with a spring to the ground, and its stiffness.
        factorisations: made so far.
        solves: back-substitutions made so far.
    """

    def __init__(self, size: int):
        """Before the first `factorise`.

        Args:
            size: number of unknowns.
        """
        self.size, self.pins = size, {}
        self.factorisations = self.solves = self._count = 0
        self._limit = int(np.clip(NUMBERS // max(size, 1), 8, CORRECTIONS))
        self._w = np.empty((self._limit, size))
        self._a = np.empty(self._limit)
        self._factors: Any = None

    @property
    def full(self) -> bool:
        """Whether the factors should be made anew."""
        return self._count > self._limit - 2

    def factorise(self, K: sp.sparray, definite: bool = True) -> None:
        """Factorise K [size, size], pins added.

        Args:
            K: the matrix.
            definite: whether the diagonal is a good pivot; without it, rows are
                exchanged, for a matrix that is not positive.

        Raises:
            Singular: if that fails.
        """
        self._factors = None  # the old ones go first: memory
        if self.pins:
            extra = np.zeros(self.size)
            extra[list(self.pins)] = list(self.pins.values())
            K = K + sp.diags_array(extra)
        how: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A"}
        if definite:
            how |= {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
        try:
            self._factors = splu(sp.csc_matrix(K), **how)
        except RuntimeError as error:
            raise Singular(f"K: the stiffness is singular ({error})") from error
        self.factorisations += 1
        self._count = 0

    def solve(self, b: Floats) -> Floats:
        """K^-1 b [size]."""
        self.solves += 1
        w, a = self._w[: self._count], self._a[: self._count]
        return self._factors.solve(b) + (a * (w @ b)) @ w

    def along(self, at: NDArray[np.integer], g: Floats) -> Floats:
        """K^-1 of a vector with the entries g at `at`."""
        b = np.zeros(self.size)
        np.add.at(b, at, g)
        w, a = self._w[: self._count], self._a[: self._count]
        self.solves += 1
        return self._factors.solve(b) + (a * (w[:, at] @ g)) @ w

    def lose(self, w: Floats, k: float, gap: float) -> None:
        """K becomes K - k g g^T, of w = K^-1 g and gap = 1 - k g . w, not zero.

        Raises:
            ValueError: if there is no room left; see `full`.
        """
        if self._count == self._limit:
            raise ValueError("w: too many corrections; factorise first")
        self._w[self._count], self._a[self._count] = w, k / gap
        self._count += 1

    def pin(self, entry: int, k: float) -> tuple[Floats, float]:
        """Put a spring k (N/m) between an entry and the ground.

        Returns:
            w = K^-1 e of before, and 1 + k w[entry].
        """
        w = self.along(np.array([entry]), np.ones(1))
        gap = 1.0 + k * float(w[entry])
        self.lose(w, -k, gap)
        self.pins[entry] = self.pins.get(entry, 0.0) + k
        return w, gap
