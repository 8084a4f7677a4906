"""A body of springs that loses some of them, in equilibrium all along. Host only.

Springs are linear, so that at a load factor f the displacements are f u, with u those
at the factor 1: K u = load, u prescribed on the supports. A spring that goes changes u
by one back-substitution (`jaxpd.solvers.downdate`).
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.operators.springs import Springs
from jaxpd.solvers.downdate import GONE, Downdated, Singular

Floats = NDArray[np.floating]

#: A gap that loses digits: the factors are made anew.
NEARLY = 1e-6


class Live(Protocol):
    """What a driver of fracture needs of a body that loses springs.

    Attributes:
        u: displacements at the load factor 1 [n, d] (m).
        intact: which springs stand [b].
        torn: whether a load pulls at a piece that nothing holds any more.
        floppy: points of motions that lost their stiffness without any load [n].
        cost: counters by name.
    """

    u: Floats
    intact: NDArray[np.bool_]
    torn: bool
    floppy: NDArray[np.bool_]
    cost: dict[str, float]

    def lose(self, bonds: NDArray[np.integer]) -> None:
        """Take springs away, and follow with u."""
        ...

    def settle(self) -> dict[str, Any]:
        """Forget how it came here: what is left to keep, for `restore`."""
        ...

    def restore(self, kept: dict[str, Any]) -> None:
        """Go on from what `settle` gave."""
        ...


class DirectLive:
    """`Live` by a sparse factorisation and its rank-one corrections."""

    def __init__(
        self,
        springs: Springs,
        fixed: NDArray[np.bool_],
        prescribed: Floats,
        load: Floats,
        intact: NDArray[np.bool_],
    ):
        """Factorise the body that stands.

        Args:
            springs: all springs, on the host.
            fixed: mask of prescribed components [n, d].
            prescribed: their displacements at the load factor 1 [n, d] (m).
            load: forces at the load factor 1 [n, d] (N).
            intact: which springs stand [b].
        """
        n, d = fixed.shape
        self.springs, self.fixed, self.load = springs, fixed, load
        self.intact = intact.copy()
        self._free = np.flatnonzero(~fixed.ravel())
        self._place = np.full(n * d, -1)
        self._place[self._free] = np.arange(len(self._free))
        self._B = springs.differences(n)
        self._ends = d * np.stack([springs.i, springs.j])[:, :, None] + np.arange(d)
        self.inverse = Downdated(len(self._free))
        self.u = np.where(fixed, prescribed, 0.0)
        self.torn, self.floppy = False, np.zeros(n, bool)
        self._stiff, self._tension = float(springs.k.max()), 0.0
        try:
            self._anew()
        except Singular:  # a hinge, or a point on one bond: found bond by bond
            self.intact = np.ones(len(intact), bool)
            self._anew()
            self.lose(np.flatnonzero(~intact))

    @property
    def cost(self) -> dict[str, float]:
        """Factorisations and back-substitutions so far."""
        inverse = self.inverse
        return {
            "factorisations": inverse.factorisations,
            "solves": inverse.solves,
            "iterations": 0,
        }

    def settle(self) -> dict[str, Any]:
        """Factorise anew; pins, and which points are floppy."""
        self._anew()
        pins = np.array([*self.inverse.pins.items()]).reshape(-1, 2)
        made = np.array([self.inverse.factorisations, self.inverse.solves])
        return {
            "pins": pins,
            "floppy": self.floppy,
            "intact": self.intact.copy(),
            "made": made,
        }

    def restore(self, kept: dict[str, Any]) -> None:
        """Go on from what `settle` gave, to the same bits."""
        self.inverse.pins = {int(entry): float(k) for entry, k in kept["pins"]}
        self.floppy, self.intact = kept["floppy"], kept["intact"]
        self._anew()
        made = kept["made"].tolist()
        self.inverse.factorisations, self.inverse.solves = made

    def _stiffness(self) -> sp.csr_array:
        B = self._B[self.intact]
        return (B.T @ (B.multiply(self.springs.k[self.intact][:, None]))).tocsr()

    def _anew(self) -> None:
        """Factorise what stands, and solve for u."""
        K = self._stiffness()
        flat = np.where(self.fixed, self.u, 0.0).ravel()
        b = (self.load.ravel() - K @ flat)[self._free]
        A = K[self._free][:, self._free]
        self.inverse.factorise(A)
        x = self.inverse.solve(b)
        x += self.inverse.solve(b - self._pinned(A, x))
        left = np.abs(b - self._pinned(A, x)).max(initial=0.0)
        if not left <= 1e-6 * np.abs(b).max(initial=0.0):
            raise Singular("K: the stiffness is singular but for round-off")
        flat[self._free] = x
        self.u = flat.reshape(self.u.shape)
        if not self._tension:
            pull = self.springs.k * (self._B @ flat)
            self._tension = float(np.abs(pull[self.intact]).max(initial=0.0))

    def _pinned(self, A: sp.csr_array, x: Floats) -> Floats:
        """A x with the pins."""
        y = A @ x
        for entry, k in self.inverse.pins.items():
            y[entry] += k * x[entry]
        return y

    def lose(self, bonds: NDArray[np.integer]) -> None:
        """Take springs away, and follow with u.

        Raises:
            Singular: if what is left cannot be factorised.
        """
        bonds = bonds[self.intact[bonds]]
        for bond in bonds:
            if self.inverse.full:
                self._anew()
            self._lose(int(bond))
        if self.inverse.full:
            self._anew()

    def _lose(self, bond: int) -> None:
        springs, u = self.springs, self.u.ravel()
        ends = self._ends[:, bond].ravel()
        g = np.concatenate([-springs.n[bond], springs.n[bond]])
        k, e = springs.k[bond], float(g @ u[ends])
        self.intact[bond] = False
        at = self._place[ends]
        free = at >= 0
        at, gf = at[free], g[free]
        if not len(at):
            return
        w = self.inverse.along(at, gf)
        gap = 1.0 - k * float(gf @ w[at])
        if gap <= GONE:  # w moves without stiffness now
            self._pin(w)
            e = float(g @ u[ends])
            w = self.inverse.along(at, gf)
            gap = 1.0 - k * float(gf @ w[at])
        self.inverse.lose(w, k, gap)
        u[self._free] += w * (k * e / gap)
        if gap < NEARLY:  # digits are lost
            self._anew()
        self._look()

    def _pin(self, w: Floats) -> None:
        """Hold a motion that has lost its stiffness."""
        entry = int(np.argmax(np.abs(w)))
        n, d = self.fixed.shape
        moves = np.zeros(n * d, bool)
        moves[self._free] = np.abs(w) > 1e-6 * abs(w[entry])
        self.floppy |= moves.reshape(n, d).any(axis=1)
        along, gap = self.inverse.pin(entry, self._stiff)
        u = self.u.ravel()
        at = self._free[entry]
        u[self._free] -= along * (self._stiff * u[at] / gap)

    def _look(self) -> None:
        """Whether a pin carries load, more than round-off would."""
        if not self.inverse.pins or self.torn:
            return
        u = self.u.ravel()
        held = max(k * abs(u[self._free[p]]) for p, k in self.inverse.pins.items())
        self.torn = bool(held > 1e-6 * self._tension)
