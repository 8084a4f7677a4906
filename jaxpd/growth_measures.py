"""What a slow fracture says about toughness: crack length, energy release rates.

The length of a crack is taken from the stiffness, through a curve of the same lattice
with straight cuts. With U the energy of the body at the load
factor 1, where every state is the factor f times that,

    G = f^2 |dU/da|      of supports that move (U falls) and of loads alone (U grows),

which is P^2 / 2 dC/da in both cases, per thickness. Curves and growth are of one lattice,
so that surface effects and the compliance of grips drop out. Host only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from jaxpd.geometry import Crack
from jaxpd.growth import Growth
from jaxpd.live import DirectLive

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Compliance:
    """Energy of a body with straight cracks, by length.

    Attributes:
        a: lengths [k] (m), growing.
        energy: at the load factor 1 [k] (J).
    """

    a: Floats
    energy: Floats

    def __post_init__(self):
        """Refuse what is no curve."""
        step = np.diff(self.energy)
        if len(self.a) < 4 or not ((step > 0).all() or (step < 0).all()):
            raise ValueError(
                f"energy: {len(self.a)} lengths must be at least 4, none below the "
                "notch, and their energies rise or fall throughout: by supports that "
                "move, or by loads, not by both"
            )

    def energy_at(self, a: Any) -> Any:
        """Energy at the load factor 1 (J) of cracks of length a (m)."""
        return np.exp(CubicSpline(self.a, np.log(self.energy))(a))

    def slope_at(self, a: Any) -> Any:
        """|dU/da| (J/m): the release rate at the load factor 1."""
        slope = CubicSpline(self.a, np.log(self.energy))(a, 1)
        return np.abs(slope) * self.energy_at(a)

    def length_of(self, energy: Any) -> Any:
        """Length (m) of the straight crack of that energy; nan beyond the curve."""
        fine = np.linspace(self.a[0], self.a[-1], 50 * len(self.a))
        known = np.log(self.energy_at(fine))
        order = np.argsort(known)
        value = np.log(np.maximum(np.asarray(energy, float), 1e-300))
        return PchipInterpolator(known[order], fine[order], extrapolate=False)(value)


def straight_cuts(growth: Growth, plane: Crack, lengths: Sequence[float]) -> Compliance:
    """The curve of a body whose bonds across a plane are cut straight.

    Give lengths from the notch on that the crack of interest takes, edges between
    columns some two or three apart, and a few columns more; near the far end of a
    specimen the curve is another. Each costs a factorisation.

    Args:
        growth: of the body; the cracks of its scene are cut at first.
        plane: surface in which the cuts lie; lengths count from its first corner.
        lengths: of the cuts (m), growing.

    Raises:
        ValueError: if lengths do not grow.
    """
    a = np.asarray(lengths, float)
    if a.ndim != 1 or not (np.diff(a) > 0).all():
        raise ValueError(f"lengths: {lengths} must grow")
    fracture, springs, X = growth.fracture, growth.springs, growth.X
    prescribed, load = (np.asarray(fracture.params[k]) for k in ("prescribed", "load"))
    intact = ~np.asarray(fracture.cut)
    fixed = np.asarray(fracture.fixed)
    energy = []
    map_ = springs.differences(len(X))
    span = float(np.linalg.norm(plane.edges[0]))
    for x in a:
        short = (tuple(x / span * e for e in plane.edges[0]), *plane.edges[1:])
        gone = Crack(plane.corner, short).cuts(X, springs.i, springs.j)
        live = DirectLive(springs, fixed, prescribed, load, intact & ~gone)
        e = map_ @ live.u.ravel()
        energy.append(0.5 * float(np.where(live.intact, springs.k * e * e, 0.0).sum()))
    return Compliance(a, np.array(energy))


@dataclass(frozen=True, eq=False)
class Toughness:
    """Release rates of a growing crack, over G0 unless said otherwise.

    Attributes:
        a: length of the crack by its stiffness [F] (m); nan at rest and beyond the
            curve.
        G: release rate of each state [F] (-).
        dissipated: released energy per new length (-).
        bonds: energy that the broken bonds held, per new length (-).
        columns: number of each column of growth [c], from 0.
        peaks: state of the highest release rate in each of them [c].
        envelope: mean of G over those (-): what a load must exceed.
        spread: lowest and highest of them (-).
    """

    a: Floats
    G: Floats
    dissipated: float
    bonds: float
    columns: NDArray[np.integer]
    peaks: NDArray[np.integer]
    envelope: float
    spread: tuple[float, float]


def toughness(
    growth: Growth, curve: Compliance, G0: float, dx: float, window: Any
) -> Toughness:
    """Measure release rates of a crack that grows in a plane, per thickness.

    Args:
        growth: the run.
        curve: of the same body.
        G0: fracture energy to compare with (J/m^2).
        dx: width of a column (m).
        window: lengths (m) between which growth is steady, some columns from the notch
            and from the end of the run; rounded to columns.

    Raises:
        ValueError: if fewer than three columns of the window are grown through.
    """
    f = np.where(growth.factor > 0, growth.factor, np.nan)
    a = curve.length_of(0.5 * growth.force / f)
    G = f**2 * curve.slope_at(a) / G0
    start, stop = (round(w / dx) * dx for w in window)
    inside = np.flatnonzero((a >= start) & (a < stop))
    number = np.floor((a[inside] - start) / dx).astype(int)
    columns = np.unique(number)
    if len(columns) < 3:
        raise ValueError(
            f"window: {window} has states in {len(columns)} columns; take a longer "
            "run, or one that the curve covers"
        )
    peaks = np.array([(some := inside[number == c])[G[some].argmax()] for c in columns])

    def rate(total: Floats) -> float:
        return float(np.polyfit(a[inside] - start, total[inside], 1)[0] / G0)

    high = G[peaks]
    return Toughness(
        a=a,
        G=G,
        dissipated=rate(growth.released),
        bonds=rate(growth.bonds),
        columns=columns,
        peaks=peaks,
        envelope=float(high.mean()),
        spread=(float(high.min()), float(high.max())),
    )
