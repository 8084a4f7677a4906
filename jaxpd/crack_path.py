"""Crack paths in damage fields of a regular 2-D lattice: tips, speeds, forks, angles.

Host only, after the run; nothing here knows how the damage came about. Everywhere:

    X, shape   positions in C order, points along x and along y      [n, 2]   m
    phi, t     damage (the notch may count) at F growing times  [F, n], [F]   -, s
    threshold  damage above it is crack; delta is the horizon            []   -, m

Tips are points (middles of cells on a cell-centred lattice) and move in steps of dx: a
speed is the slope of a line through three outputs or more, an angle that of a line
through means over many points. What did not happen is NaN; shapes that do not fit and
arguments out of range are a ValueError.

Source of the defaults: bond-based runs of branching and of the Kalthoff-Winkler impact:
thresholds of 0.30 to 0.40 moved a fork by 0.1 mm, 0.45 and 0.5 lost parts of cracks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import label

from jaxpd.checks import number, real


@dataclass(frozen=True, eq=False)
class Branching:
    """A crack that grows along x from a notch, and its fork; see `branching`."""

    tip: Any  # largest x of the crack, at least the end of the notch [F] (m)
    start: float  # time at which the tip is delta past the notch (s)
    times: Any  # times at which it passes the stations (s)
    tb: float  # time at which it passes xb (s)
    v_peak: float  # largest speed over a window, to 2 delta before the far edge (m/s)
    v_mean: float  # slope of the tip from `start` to there, or the last output (m/s)
    tips: int  # bands of damage 2 delta behind the tip; 0 if the crack never started
    xb: float  # first column of two bands (m), the later the larger delta
    xe: float  # where the lines through the two branches meet (m), whatever delta
    angle: float  # angle between the two lines (deg)


@dataclass(frozen=True, eq=False)
class Deflection:
    """A crack that turns away from its notch; see `deflection`."""

    radius: Any  # largest distance from the notch tip [F] (m); 0 without a crack
    times: Any  # times at which it passes the two stations (s)
    v: float  # speed between them (m/s)
    angle: float  # direction of the path over the radii of the fit (deg)
    chord: float  # direction from the notch tip to the path at one radius (deg)
    first: float  # direction of the path from radius delta to there: 2 delta are bent
    path: Any  # middle of the crack at radii from delta to the last station [p, 2] (m)
    side: int  # 1: the crack turns to the left of the notch direction, -1: right


def tips(
    X: Any, shape: Any, phi: Any, threshold: float = 0.35, margin: float = 4e-3
) -> Any:
    """Largest x of damage [F] (m), rows within `margin` of the loaded edges aside."""
    x, y, field, *_ = _lattice(X, shape, phi, threshold, range(len(phi)))
    hit = (field[:, :, _inside(y, margin)] > threshold).any(2)
    return np.array([x[h].max() if h.any() else np.nan for h in hit])


def first_time(t: Any, position: Any, at: float) -> float:
    """Time at which a position reaches `at`, linear between outputs (s), if seen."""
    t, p, slack = _record(t, position)
    k = int(np.argmax(p >= at - slack)) if p.size else 0
    return float(np.interp(at, p[k - 1 : k + 1], t[k - 1 : k + 1])) if k else np.nan


def speed_between(t: Any, position: Any, a: float, b: float) -> float:
    """Slope of the line through the outputs from station a to b, if reached (m/s)."""
    t, p, slack = _record(t, position)
    past = np.flatnonzero(p >= b - slack)
    some = (p >= a - slack) & (p <= b + slack) & (np.arange(len(p)) <= past[:1].sum())
    return _slope(t[some], p[some]) if past.size else np.nan


def largest_speed(t: Any, position: Any, window: float) -> float:
    """Largest slope of lines through all outputs within a duration `window` (m/s)."""
    t, p, _ = _record(t, position)
    _need(window > 0, "window", window, "must be positive")
    starts = [i for i in range(len(t)) if t[i] + window <= t[-1] + 1e-6 * window]
    stops = [int(np.argmin(np.abs(t - t[i] - window))) + 1 for i in starts]
    slopes = [_slope(t[i:j], p[i:j]) for i, j in zip(starts, stops, strict=True)]
    return float(np.fmax.reduce([np.nan, *slopes]))


def branching(
    X: Any,
    shape: Any,
    phi: Any,
    t: Any,
    *,
    notch_x: float,
    delta: float,
    stations: Sequence[float] = (0.06, 0.09),
    window: float = 5e-6,
    fit: float = 0.01,
    until: float = np.inf,
    threshold: float = 0.35,
    margin: float = 4e-3,
) -> Branching:
    """Growth and fork of a crack that runs along x from the notch end `notch_x` (m).

    Damaged points of a column are one band across gaps of less than delta / 2. A fork
    is two bands that part over most of the length `fit` (m) behind their first column;
    lines go through the damage-weighted middles of the outermost two. Fork and tips are
    those of the last output up to `until` (s), the peak speed that over a `window` (s).
    """
    x, y, field, t, dx = _lattice(X, shape, phi, threshold, t)
    _need(min(delta, fit) > 0, "delta, fit", (delta, fit), "must be positive lengths")
    _need(until >= t[0], "until", until, f"must not be before the first output {t[0]}")
    now, near = np.flatnonzero(t <= until)[-1], _inside(y, margin)
    tip = np.fmax(tips(X, shape, phi, threshold, margin), notch_x)
    bands = [_bands(c, y[near], threshold, delta / dx / 2) for c in field[now][:, near]]
    fork = [(a, b[0], b[-1]) for a, b in zip(x, bands, strict=True) if len(b) > 1]
    xb, xe, angle = _fork([row for row in fork if row[0] > notch_x], fit, dx)
    begin, end = notch_x + delta, x[-1] - 2 * delta
    runs = (tip >= begin) & (tip <= end)
    speeds = largest_speed(t[runs], tip[runs], window), _slope(t[runs], tip[runs])
    count = len(bands[abs(x - tip[now] + 2 * delta).argmin()]) * int(tip[now] >= begin)
    start, tb, *times = [first_time(t, tip, at) for at in (begin, xb, *stations)]
    return Branching(tip, start, np.array(times), tb, *speeds, count, xb, xe, angle)


def deflection(
    X: Any,
    shape: Any,
    phi: Any,
    t: Any,
    *,
    tip: Sequence[float],
    delta: float,
    along: Sequence[float] = (1.0, 0.0),
    stations: Sequence[float] = (0.01, 0.04),
    fit: Sequence[float] = (0.01, 0.03),
    chord: float = 0.02,
    threshold: float = 0.35,
) -> Deflection:
    """Path of the crack from a notch that ends at `tip` (m), running in `along`.

    The crack hangs together with points within delta of the tip; the flanks of the
    notch and what is more than delta to the other side are left out. Its side, to which
    angles are positive, is that of the longer one. The path is read as the radius
    passes the second of the `stations` (m): damage-weighted angles of rings 1.5 dx wide
    and total least squares over the radii `fit`, and from delta to `chord` (m).
    """
    _, _, field, t, dx = _lattice(X, shape, phi, threshold, t)
    far, size = stations[1], float(np.linalg.norm(along))
    _need(0 < stations[0] < far, "stations", stations, "must be two growing radii")
    _need(0 < fit[0] < fit[1] <= far, "fit", fit, f"must be radii that grow to {far}")
    _need(0 < delta < chord <= far, "chord", chord, f"must be in {delta}..{far}")
    _need(size > 0, "along", along, "must be a direction")
    frame = np.array([along, [-along[1], along[0]]]) / size
    ahead, across = (frame @ (np.asarray(X) - tip).T).reshape(2, *shape)
    r = np.hypot(ahead, across)
    _need(r.min() <= dx, "tip", tip, "must be in the lattice")
    trials = []
    for side in (1, -1):
        free = ((ahead >= 0) | (abs(across) > delta)) & (side * across >= -delta)
        q: list[Any] = [label(free & (p > threshold), np.ones((3, 3))) for p in field]
        crack = [np.isin(a, a[(a > 0) & (r <= delta)]) for a, _ in q]
        trials.append((np.array([r[c].max(initial=0) for c in crack]), crack, side))
    radius, crack, side = max(trials, key=lambda trial: np.minimum(trial[0], far).sum())
    k = int(np.argmax(radius >= far))
    rings = np.arange(np.ceil(delta / dx), (radius[k] >= far) * far / dx + 1e-6) * dx
    # no ring is empty: a step from point to point of a crack is less than 1.5 dx
    on = [crack[k] & (abs(r - ring) <= 0.75 * dx) for ring in rings]
    theta = np.arctan2(side * across, ahead)
    theta = np.array([np.average(theta[o], weights=field[k][o]) for o in on])
    path = rings[:, None] * np.stack([np.cos(theta), np.sin(theta)], 1)
    angle = _direction(path[(rings > fit[0] - dx / 2) & (rings < fit[1] + dx / 2)])
    secant = float(np.degrees(np.interp(chord, rings, theta))) if on else np.nan
    first = _direction(path[rings < chord + dx / 2])
    path = tip + path * (1, side) @ frame
    times = np.array([first_time(t, radius, at) for at in stations])
    speed = speed_between(t, radius, *stations)
    return Deflection(radius, times, speed, angle, secant, first, path, side)


def _need(true: Any, name: str, value: Any, cure: str) -> None:
    if not true:
        raise ValueError(f"{name}: {value} {cure}")


def _lattice(X: Any, shape: Any, phi: Any, threshold: float, t: Any) -> Any:
    """Columns x, rows y, damage [F, nx, ny], times and spacing, checked."""
    for name, given in (("X", X), ("shape", shape), ("phi", phi), ("t", t)):
        _need(real(given) is not None, name, repr(given), "must be numbers")
    number("threshold", threshold, above=0, below=1)
    X, phi, t = np.asarray(X, float), np.asarray(phi), np.asarray(t, float)
    n = int(np.prod(shape))
    fits = len(shape) == 2 and min(shape) > 1 and X.shape == (n, 2)
    _need(fits, "X, shape", (X.shape, tuple(shape)), "must be [nx ny, 2] and (nx, ny)")
    fits = phi.ndim == 2 and phi.shape[1] == n and len(phi) > 0
    _need(fits, "phi", phi.shape, f"must be [F, {n}], a row for each output")
    _need(np.isfinite(phi).all(), "phi", "NaN or infinite", "must be finite")
    fits = t.shape == phi.shape[:1] and (np.diff(t) > 0).all()
    _need(fits, "t", t, f"must be {len(phi)} growing times")
    dx = float(X[-1, 1] - X[0, 1]) / (shape[1] - 1)
    even = abs(X - X[0] - dx * np.indices(shape).reshape(2, -1).T).max() < 1e-3 * dx
    _need(even, "X", f"spacing {dx}", "must be a regular lattice with y fastest")
    return X[:: shape[1], 0], X[: shape[1], 1], phi.reshape(-1, *shape), t, dx


def _inside(y: Any, margin: float) -> Any:
    inside = (y >= y.min() + margin) & (y <= y.max() - margin)
    _need(margin >= 0 and inside.any(), "margin", margin, "must leave some rows")
    return inside


def _record(t: Any, position: Any) -> tuple[Any, Any, float]:
    t, p = np.asarray(t, float), np.asarray(position, float)
    _need(t.ndim == 1 and t.shape == p.shape, "position", p.shape, "must be as t")
    there = np.isfinite(p)
    return t[there], p[there], 1e-6 * abs(p[there]).max(initial=0)


def _slope(t: Any, p: Any) -> float:
    return float(np.polyfit(t - t[0], p, 1)[0]) if len(t) > 2 else np.nan


def _bands(damage: Any, y: Any, threshold: float, gap: float) -> list[float]:
    """Middles of the damaged runs of a column, joined over gaps of fewer points."""
    hit = np.flatnonzero(damage > threshold)
    runs = np.split(hit, np.flatnonzero(np.diff(hit) - 1 > gap - 1e-6) + 1)
    return [float(np.average(y[k], weights=damage[k])) for k in runs if len(k)]


def _fork(pairs: Any, fit: float, dx: float) -> tuple[float, float, float]:
    """xb, xe and angle (deg) from rows of x and the outer middles of double columns."""
    pairs = np.reshape(pairs, (-1, 3))
    for i, x in enumerate(pairs[:, 0]):
        some = pairs[i : np.searchsorted(pairs[:, 0], x + fit + dx / 2)]
        if len(some) > max(2, fit / dx / 2):
            (low, up), (a, b) = np.polyfit(some[:, 0] - x, some[:, 1:], 1)
            if up > low:
                angle = float(np.degrees(np.arctan(up) - np.arctan(low)))
                return float(x), float(x - (b - a) / (up - low)), angle
    return np.nan, np.nan, np.nan


def _direction(path: Any) -> float:
    if len(path) < 2:
        return np.nan
    v = np.linalg.eigh(np.cov(path.T))[1][:, 1]
    v = v * np.sign(v @ (path[-1] - path[0]))
    return float(np.degrees(np.arctan2(v[1], v[0])))
