"""What a slow fracture says about toughness: crack length, energy release rates.

The length of a crack is taken from the stiffness, through a curve of the same lattice
with straight cuts. With U the energy of the body at the load
factor 1, where every state is the factor f times that,

    G = f^2 |dU/da|      of supports that move (U falls) and of loads alone (U grows),

which is P^2 / 2 dC/da in both cases, per thickness. Curves and growth are of one
lattice, so that surface effects and the compliance of grips drop out. Host only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline, PchipInterpolator

from jaxpd.fracture.growth import Growth
from jaxpd.fracture.live import DirectLive
from jaxpd.gallery import beam_compliance, beam_force, notch_of
from jaxpd.geometry import Crack, segment

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Compliance:
    """Energy of a body with straight cracks, by length.

    Attributes:
        a: lengths [k] (m), positive and growing.
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
        return np.exp(self._curve()(np.log(a)))

    def slope_at(self, a: Any) -> Any:
        """|dU/da| (J/m): the release rate at the load factor 1."""
        return np.abs(self._curve()(np.log(a), 1)) * self.energy_at(a) / a

    def _curve(self) -> CubicSpline:
        """Logarithm of the energy over that of the length: a power is a line."""
        return CubicSpline(np.log(self.a), np.log(self.energy))

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


def cantilever_figures(growth: Growth, skip: int = 3) -> dict[str, Any]:
    """Figures of a run of `jaxpd.gallery.double_cantilever`, each to compare with 1.

    Crack lengths count from the end of the beam to the edge between two columns. The
    line of load is half a column inside, and a crack of the lattice acts as if about
    that much longer: both left out, beams fit to 2 %.

    Args:
        growth: a run over at least 8 columns; of the last ones, near the far end, more
            is left out.
        skip: columns left out at the notch and at the end of the run.

    Returns:
        "compliance" over the beam's, least and most; "dissipated", "bonds", "envelope"
        as in `Toughness`; "force" over the beam's at G0 and equal opening, mean of the
        highest state of each column; and "toughness", "opening" [F] (m), "P" [F] (N/m).
    """
    scene, X = growth.scene, growth.X
    body: Any = scene.body
    (L, H), h = body.hi, scene.resolution.dx
    E, G0, a0 = scene.material.E, scene.material.G0, notch_of(scene)
    arm = scene.supports[0]
    half: Any = arm.components[1]
    given = 2.0 * half
    pulled = arm.region.contains(X[growth.held])
    P = growth.reaction[:, pulled, 1].sum(axis=1)
    opening = growth.factor * given
    grown = growth.places()[:, 0].max() - a0
    most = min(round(grown / h), round((L - H - a0) / h))
    lengths = a0 + h * np.arange(0, most + 6, 3)
    curve = straight_cuts(growth, segment((0.0, 0.0), (L, 0.0)), lengths)
    window = (a0 + skip * h, a0 + (most - skip) * h)
    found = toughness(growth, curve, G0, h, window)
    ratio = given**2 / (2.0 * curve.energy) / beam_compliance(lengths, H, E)
    over = P[found.peaks] / beam_force(opening[found.peaks], H, E, G0)
    return {
        "compliance": (float(ratio.min()), float(ratio.max())),
        "dissipated": found.dissipated,
        "bonds": found.bonds,
        "envelope": found.envelope,
        "force": float(over.mean()),
        "toughness": found,
        "opening": opening,
        "P": P,
    }
