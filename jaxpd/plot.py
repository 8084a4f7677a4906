"""Pictures through matplotlib, an extra imported when a picture is asked for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxpd.checks import numbers
from jaxpd.geometry import Box
from jaxpd.record import Run
from jaxpd.run import Solution

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def pyplot() -> Any:
    """`matplotlib.pyplot`.

    Raises:
        ModuleNotFoundError: naming the line that installs it.
    """
    try:
        import matplotlib.pyplot as plt  # noqa: PLC0415
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "pictures need matplotlib; install it with: pip install 'jaxpd[plot]'"
        ) from error
    return plt


def new_figure(rows: int, columns: int, width: float, height: float) -> Figure:
    """A figure of axes that no window manager knows of: nothing is shown or leaks."""
    pyplot()
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.subplots(rows, columns, squeeze=False)
    return figure


def deformed(solution: Solution, axes: Axes, scale: float | None = None) -> float:
    """Draw the points of a 2-D solution where they have moved, coloured by energy.

    Points outside a box-shaped body (layers of volume constraints) are drawn grey.

    Args:
        solution: what to draw.
        axes: where.
        scale: displacements are enlarged by this; chosen for 5 % of the body if None.

    Returns:
        The scale used.

    Raises:
        ValueError: if the solution is not 2-D.
    """
    X, u = np.asarray(solution.X), np.asarray(solution.u)
    if X.shape[1] != 2:
        raise ValueError(f"solution: deformed() draws 2-D, not {X.shape[1]}-D")
    if scale is None:
        largest = float(np.abs(u).max())
        scale = 0.05 * float(np.ptp(X, axis=0).max()) / largest if largest > 0 else 1.0
    x = X + scale * u
    body = solution.scene.body
    inside = body.contains(X) if isinstance(body, Box) else np.ones(len(X), bool)
    # square markers about as wide as the points are apart on a 4-inch drawing
    size = 0.7 * (4.0 * 72.0) ** 2 / len(X)
    axes.scatter(*x[~inside].T, s=size, c="0.75", marker="s", linewidths=0)
    density = np.asarray(solution.energy_density)[inside]
    top = float(np.nanpercentile(density, 99.5)) if np.isfinite(density).any() else 1.0
    dots = axes.scatter(
        *x[inside].T, s=size, c=density, vmin=0.0, vmax=top, marker="s", linewidths=0
    )
    axes.figure.colorbar(dots, ax=axes, label="strain energy density (J/m$^3$)")
    axes.set_aspect("equal")
    axes.set(xlabel="x (m)", ylabel="y (m)")
    axes.set_title(f"deformed, displacements x {scale:.3g}")
    return scale


def residual_histories(
    histories: Mapping[str, Sequence[float]], axes: Axes, rtol: float | None = None
) -> None:
    """Draw relative residuals against iterations, one line a solver.

    Args:
        histories: residuals after 0, 1, 2 .. iterations, by name.
        axes: where.
        rtol: tolerance to draw as a line.
    """
    for name, residuals in histories.items():
        label = f"{name} ({len(residuals) - 1})"
        mark = "o" if len(residuals) < 12 else ""
        axes.semilogy(np.arange(len(residuals)), residuals, marker=mark, label=label)
    if rtol is not None:
        axes.axhline(rtol, color="0.6", linestyle=":", linewidth=1)
    axes.locator_params(axis="x", integer=True)
    axes.set(xlabel="iteration", ylabel="relative residual")
    axes.legend(frameon=False)


def frames(
    run: Run, times: Sequence[float] = (), *, scale: float = 1.0, columns: int = 3
) -> Figure:
    """A panel of damage a frame, and one of the energies over time.

    Args:
        run: a 2-D run with frames.
        times: of the frames (s), the nearest are drawn; five evenly spread by default.
        scale: displacements are enlarged by this.
        columns: of panels.

    Returns:
        A figure that no window manager knows of: save it, or in a notebook show it
        after `%matplotlib inline`.

    Raises:
        ValueError: if the run is not 2-D, or kept no frames.
    """
    X, kept = np.asarray(run.X), run.frames["t"]
    if X.shape[1] != 2 or len(kept) == 0:
        raise ValueError(
            f"run: {len(kept)} frames of a {X.shape[1]}-D body; frames() draws 2-D runs"
            " of run_explicit(.., frames=..)"
        )
    if times:
        numbers("times", times, least=0, most=float(kept[-1]) * (1 + 1e-9))
    wanted = times or np.linspace(kept[0], kept[-1], 6)[1:]
    chosen = [int(np.argmin(np.abs(kept - t))) for t in wanted]
    rows = -(-(len(chosen) + 1) // columns)
    width, height = np.ptp(X, axis=0)
    panel = max(1.6, 3.6 * height / width)
    figure = new_figure(rows, columns, 4.0 * columns, (panel + 0.6) * rows)
    panels: list[Any] = figure.axes
    dots: Any = None
    # square markers as wide as the points are apart on a panel of 3.4 inches
    size = (3.4 * 72.0 / width) ** 2 * width * height / len(X)
    for axes, k in zip(panels, chosen, strict=False):
        x = X + scale * run.frames["u"][k]
        phi = run.frames["damage"][k]
        order = np.argsort(phi)  # damage on top
        dots = axes.scatter(
            *x[order].T, s=size, c=phi[order], vmin=0, vmax=0.6, marker="s", lw=0
        )
        axes.set(aspect="equal", title=f"{kept[k] * 1e6:.3g} us")
        axes.tick_params(labelsize=7)
    figure.colorbar(dots, ax=panels[: len(chosen)], label="damage", shrink=0.6)
    energies(run, panels[len(chosen)])
    for axes in panels[len(chosen) + 1 :]:
        axes.set_axis_off()
    return figure


def energies(run: Run, axes: Axes) -> None:
    """Draw the energies of a run over time."""
    for name in ("work", "kinetic", "elastic", "released"):
        axes.plot(run.t * 1e6, getattr(run, name), label=name)
    axes.set(xlabel="time (us)", ylabel="energy (J)")
    axes.legend(frameon=False)
