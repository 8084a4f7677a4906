"""One picture of any result: what a first look asks for."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial import KDTree

from jaxpd.checks import instance
from jaxpd.fracture import Growth
from jaxpd.path import Path
from jaxpd.plot import energies, frames, new_figure
from jaxpd.record import Run
from jaxpd.relaxed import Relaxed
from jaxpd.run import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Displacements are enlarged to this share of the body.
SHOWN = 0.08


def picture(found: Solution | Run | Path | Growth | Relaxed) -> Figure:
    """A figure of a result.

    Args:
        found: displacements at rest; frames and energies of a motion; the last load
            step of a path; load against displacement, and the damage, of slow fracture.

    Returns:
        A figure that no window manager knows of: save it, or show it in a notebook.

    Raises:
        ValueError: if it is no result.
    """
    cure = "what solve_static, run_explicit, solve_path or solve_fracture returned"
    instance("found", found, (Solution, Run, Path, Growth, Relaxed), cure)
    if isinstance(found, Run):
        return _motion(found)
    if isinstance(found, Growth):
        return _growth(found)
    figure = new_figure(1, 1, 6.4, 5.2)
    axes = figure.axes[0]
    if isinstance(found, Path):
        u, colour, label = found.u[-1], *_plastic(found)
        title = f"load step to t = {found.t[-1]:.4g}"
    else:
        u = np.asarray(found.u)
        colour, label = np.linalg.norm(u, axis=1), "displacement (m)"
        title = f"{len(u)} points at rest"
    X = found.motion.X if isinstance(found, Relaxed) else found.X
    _body(axes, np.asarray(X), u, colour, label)
    axes.set_title(title)
    return figure


def _plastic(path: Path) -> tuple[Any, str]:
    """Equivalent plastic strain at nodes, where it lives there; else displacements."""
    u = path.u[-1]
    if hasattr(path.history, "peeq") and len(path.peeq[-1]) == len(u):
        return path.peeq[-1], "equivalent plastic strain (-)"
    return np.linalg.norm(u, axis=1), "displacement (m)"


def _body(axes: Axes, X: Any, u: Any, colour: Any, label: str) -> float:
    """Points where they went, enlarged; returns by how much."""
    largest = float(np.abs(u).max(initial=0.0))
    size = float(np.ptp(X, axis=0).max())
    scale = SHOWN * size / largest if largest > 0 else 1.0
    scale = float(f"{scale:.1g}")
    if X.shape[1] == 1:
        order = np.argsort(X[:, 0])
        axes.plot(X[order, 0], u[order, 0], ".-")
        axes.set(xlabel="x (m)", ylabel="displacement (m)")
        return scale
    x = X + scale * u
    if X.shape[1] == 3:  # seen along the diagonal
        x = np.stack([x[:, 0] - 0.5 * x[:, 1], x[:, 2] - 0.35 * x[:, 1]], axis=1)
        x, colour = x[::-1], colour[::-1]
    width = float(np.ptp(x, axis=0).max())
    spacing = float(np.median(KDTree(x).query(x, k=min(3, len(x)))[0][:, 1]))
    colour = np.asarray(colour)
    middle, half = 0.5 * (colour.max() + colour.min()), 0.5 * np.ptp(colour)
    half = max(half, 1e-6 * abs(middle))  # round-off is no pattern
    dots = axes.scatter(
        *x.T,
        s=(300.0 * spacing / width) ** 2,
        c=colour,
        vmin=middle - half,
        vmax=middle + half,
        lw=0,
    )
    bar: Any = axes.figure
    bar.colorbar(dots, ax=axes, label=label, shrink=0.8)
    plane = X.shape[1] == 2
    axes.set(aspect="equal", ylabel="y (m)" if plane else "")
    told = ["x (m)"] if plane else []
    told += [f"displacements enlarged {scale:g} times"] if largest > 0 else []
    axes.set_xlabel("; ".join(told))
    return scale


def _motion(run: Run) -> Figure:
    """Frames of a plane run; else the last frame and the energies."""
    X = np.asarray(run.X)
    kept = len(run.frames["t"])
    if X.shape[1] == 2 and kept:
        return frames(run)
    figure = new_figure(1, 2, 11.0, 4.4)
    left, right = figure.axes
    if kept:
        u = run.frames["u"][-1]
        _body(left, X, u, np.linalg.norm(u, axis=1), "displacement (m)")
        left.set_title(f"t = {run.frames['t'][-1]:.3g} s")
    else:
        left.set_axis_off()
    energies(run, right)
    return figure


def _growth(growth: Growth) -> Figure:
    """The load factor over the states, and the damage at the end."""
    figure = new_figure(1, 2, 12.0, 5.0)
    left, right = figure.axes
    states = np.arange(len(growth.factor))
    left.plot(states, growth.factor, lw=1)
    left.plot(states[growth.envelope], growth.factor[growth.envelope], "o", ms=3)
    left.set(xlabel="state", ylabel="load factor (-); dots: the envelope")
    X = np.asarray(growth.X)
    _body(right, X, np.zeros_like(X), growth.damage(), "damage (-)")
    right.set_title(growth.stopped or "")
    return figure
