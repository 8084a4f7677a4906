"""Equilibrium of springs that soften: Newton's method with the consistent tangent.

Unknowns are the free displacements and, where the spent energy D is prescribed instead
of the load factor f, the factor. With K the tangent, and prescribed displacements and
loads in proportion to f,

    K a = r,  K b = q,  du = a + df b,      q = load - K g
    df   either what is left to the target, or from D + D_u . du = target

so that two back-substitutions serve the bordered system, which is regular at the limit
points of f. The trial memory of a spring is the larger of its memory and its stretch:
iterations leave no trace, `commit` alone does.

Sources: M. A. Gutierrez, Commun. Numer. Meth. Eng. 20 (2004) (control by dissipated
energy); M. A. Crisfield, Comput. Struct. 13 (1981) (the two solves).

Host only.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jaxpd.fracture.soft_tangent import KrylovTangent, SoftTangent
from jaxpd.operators.soft_springs import GHOST
from jaxpd.operators.springs import Springs
from jaxpd.physics.bilinear import Bilinear
from jaxpd.solvers.downdate import Singular

Floats = NDArray[np.floating]

#: Residual over the forces that counts as rest (-), and miss over the spent energy.
RTOL, MISS = 1e-10, 1e-8
#: Most iterations of a step, and halvings of one by the line search.
ITERATIONS, CUTS = 25, 6
#: Relative distance within which a stretch is at its limit.
NEAR = 1e-9


@dataclass(frozen=True)
class Trial:
    """A state that was tried.

    Attributes:
        u: displacements [n d] (m).
        factor: load factor.
        stretch: of the springs that soften [b] (-).
        iterations: of Newton's method.
        cuts: halvings of its steps.
    """

    u: Floats
    factor: float
    stretch: Floats
    iterations: int = 0
    cuts: int = 0

    def scaled(self, factor: float) -> Trial:
        """This at another factor, where all is linear."""
        x = factor / self.factor
        return Trial(x * self.u, factor, x * self.stretch, self.iterations)


class SoftBody:
    """A body of springs of which some soften.

    Attributes:
        springs: all of them.
        law: of the springs in `soft`.
        soft: numbers of the springs that may soften [b].
        u: displacements in the committed state [n d] (m).
        factor: its load factor.
        h: memory of the springs in `soft` [b] (-).
        most: energy of each of them until it is broken [b] (J).
        scale: size of the forces so far (N).
    """

    def __init__(
        self,
        springs: Springs,
        law: Bilinear,
        fixed: NDArray[np.bool_],
        prescribed: Floats,
        load: Floats,
        intact: NDArray[np.bool_],
        solver: str = "direct",
    ):
        """At rest.

        Args:
            springs: all springs, on the host.
            law: softening of each; `s_crit` [b] is inf where it never does.
            fixed: mask of prescribed components [n, d].
            prescribed: their displacements at the load factor 1 [n, d] (m).
            load: forces at the load factor 1 [n, d] (N).
            intact: which springs are there [b].
            solver: of the tangent, "direct" or "d-pcg".
        """
        n = len(fixed)
        self.springs, self.fixed, self.load = springs, fixed, load.ravel()
        self.intact = intact
        self.lift = np.where(fixed, prescribed, 0.0).ravel()
        self.soft = np.flatnonzero(intact & np.isfinite(law.s_crit))
        self.law = Bilinear(None, np.asarray(law.s_crit)[self.soft], law.ratio)
        self.k, self.length = springs.k[self.soft], springs.length[self.soft]
        self.most = 0.5 * self.k * (self.length * self.law.s_crit) ** 2
        B = springs.differences(n)
        hard = intact.copy()
        hard[self.soft] = False
        K = B[hard].T @ B[hard].multiply(springs.k[hard][:, None]).tocsr()
        self._K, self._B = K, B[self.soft]
        self._free = np.flatnonzero(~fixed.ravel())
        inner, across = K[self._free][:, self._free], self._B[:, self._free]
        parts = inner.tocsr(), across.tocsr()
        if solver == "direct":
            self.tangent = SoftTangent(*parts)
        else:
            there = dataclasses.replace(springs, k=np.where(intact, springs.k, 0.0))
            self.tangent = KrylovTangent(*parts, there, self.soft, fixed)
        self.u, self.factor = np.zeros(fixed.size), 0.0
        self.h, self.scale = np.zeros(len(self.soft)), 0.0

    def stretch(self, u: Floats) -> Floats:
        """Stretches [b] (-) of the springs that may soften."""
        return (self._B @ u) / self.length

    def inner(self, u: Floats, s: Floats, h: Floats) -> Floats:
        """Forces of the body on supports and loads [n d] (N)."""
        pull = self.k * self.length * self.law.tension(s, h)
        return self._K @ u + self._B.T @ pull

    def row_sums(self) -> Floats:
        """Sums of the sizes of a row's entries of the stiffness at rest [n d] (N/m)."""
        across = abs(self._B)
        soft = across.T @ (self.k * (across @ np.ones(self.fixed.size)))
        return abs(self._K) @ np.ones(self.fixed.size) + soft

    def spent(self, h: Floats) -> float:
        """Energy (J) that is gone for good."""
        return float(self.most @ self.law.used(h))

    def stored(self, u: Floats, s: Floats, h: Floats) -> float:
        """Energy (J) of all springs."""
        soft = self.k * self.law.share(np.maximum(h, s)) * (self.length * s) ** 2
        return 0.5 * float(u @ (self._K @ u)) + 0.5 * float(soft.sum())

    def drift(self, trial: Trial) -> float:
        """What the trapezoid of work misses on the way to a trial (-).

        A share of the energies that change; zero where all is linear between.
        """
        s, h = self.stretch(self.u), np.maximum(self.h, trial.stretch)
        old = self.inner(self.u, s, self.h), self.stored(self.u, s, self.h)
        new = self.inner(trial.u, trial.stretch, h)
        held = self.fixed.ravel()
        du, mean = trial.u - self.u, 0.5 * (self.factor + trial.factor)
        force = np.where(held, 0.5 * (old[0] + new), mean * self.load)
        gain = self.stored(trial.u, trial.stretch, h) - old[1]
        gone = self.spent(h) - self.spent(self.h)
        change = abs(gain) + gone
        return abs(float(force @ du) - gain - gone) / change if change else 0.0

    def gone(self) -> NDArray[np.bool_]:
        """Which springs have nothing left of their force [b]."""
        return self.law.used(self.h) >= 1.0 - NEAR

    def moving(self) -> NDArray[np.bool_]:
        """Which springs spend energy if the path goes on [b]."""
        s = self.stretch(self.u) * (1.0 + NEAR)
        law = self.law
        return (s >= np.maximum(self.h, law.peak)) & ~self.gone()

    def left(self) -> float:
        """Energy (J) that the springs of `moving` can still spend."""
        on = self.moving()
        return float((self.most * (1.0 - self.law.used(self.h)))[on].sum())

    def commit(self, trial: Trial) -> None:
        """Make a trial the state, and its stretches memory."""
        self.u, self.factor = trial.u, trial.factor
        self.h = np.maximum(self.h, trial.stretch)

    def elastic(self) -> Trial | None:
        """The next state at which a spring comes to its limit; all is linear before.

        Returns:
            None where a spring is there already, or none is stretched.
        """
        left = ~self.gone()
        share = np.where(left, self.law.share(self.h), GHOST)
        self.tangent.follow(self.k * share)
        one = self._along()
        s = self.stretch(one)
        limit = np.maximum(self.h, self.law.peak)
        may = left & (s > NEAR * np.abs(s).max(initial=0.0))
        if not may.any():
            return None
        factor = float((limit[may] / s[may]).min())
        if factor <= self.factor * (1.0 + NEAR):
            return None
        return Trial(factor * one, factor, factor * s, 1)

    def _along(self) -> Floats:
        """What the factor moves by the tangent [n d] (m)."""
        K, moved = self.tangent, self.lift.copy()
        pull = self._K @ moved + self._B.T @ (K.slopes * (self._B @ moved))
        moved[self._free] = K.solve((self.load - pull)[self._free])
        return moved

    def step(self, target: float, by: str, start: Trial | None = None) -> Trial | None:
        """Newton's method from the committed state to the next.

        Args:
            target: load factor, or energy (J) that is spent on the way.
            by: "factor" or "energy".
            start: displacements at the load factor to begin with, if others.

        Returns:
            None if it does not converge.
        """
        try:
            return self._newton(target, by, start)
        except Singular:
            return None

    def _newton(self, target: float, by: str, start: Trial | None) -> Trial | None:
        law, h, free = self.law, self.h, self._free
        u, f = (start or self).u, (start or self).factor
        at_rest = start is None
        before = self.spent(h)
        steep = self.most * law.ratio**0.5 / law.s_crit / (law.ratio - 1.0)
        unit = 1.0  # residual that weighs as much as missing the whole target
        cuts, size = 0, abs(target) or 1.0
        held = self.fixed.ravel()

        def look(u, f):
            s = self.stretch(u)
            inner = self.inner(u, s, h)
            r = (f * self.load - inner)[free]
            scale = np.linalg.norm(f * self.load) + np.linalg.norm(inner[held])
            gone = self.spent(np.maximum(h, s)) - before
            c = target - (gone if by == "energy" else f)
            return s, r, c / size, max(scale, self.scale)

        s, r, c, scale = look(u, f)
        for iteration in range(ITERATIONS):
            ahead = s * (1.0 + NEAR)
            slope = law.slope(ahead, h)
            self.tangent.follow(self.k * np.where(slope == 0.0, GHOST, slope))
            a = np.zeros_like(u)
            a[free] = 0.0 if at_rest else self.tangent.solve(r)
            b, df = np.zeros_like(u), 0.0
            if by == "energy":
                b = self._along()
                on = (ahead >= np.maximum(h, law.peak)) & (s < law.end)
                per = self._B.T @ np.where(on, steep / self.length, 0.0)
                rate = float(per @ b)
                if rate == 0.0:
                    return None
                df = (c * size - float(per @ a)) / rate
            elif at_rest:
                b, df = self._along(), target - f
            was = np.linalg.norm(r) / unit + abs(c)
            du = a + df * b
            for cut in range(CUTS + 1):
                length = 0.5**cut
                tried = u + length * du
                after = look(tried, f + length * df)
                now = np.linalg.norm(after[1]) / unit + abs(after[2])
                calm = np.linalg.norm(after[1]) <= RTOL * after[3]
                calm = calm and abs(after[2]) <= MISS
                if calm or at_rest or now <= (1.0 - 1e-4 * length) * was:
                    break
            else:
                return None
            cuts += cut
            u, f = tried, f + length * df
            s, r, c, scale = after
            if not np.isfinite(now):
                return None
            if calm:
                self.scale = scale
                return Trial(u, f, s, iteration + 1, cuts)
            if at_rest:
                unit, at_rest = np.linalg.norm(r) or 1.0, False
        return None
