"""Quasi-static fracture: cracks that choose their way, or meet an end of their own.

As in `jaxpd.gallery.slow`: brittle bonds for `jaxpd.solve_fracture`, plane stress,
nu = 1/3, 1 m thick. `end_of` says where a scene ends.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from jaxpd.checks import positive, whole
from jaxpd.conditions import holds, moves
from jaxpd.gallery.plate import cracked_plate
from jaxpd.gallery.slow import STRAIN, bonds, brittle
from jaxpd.geometry import (
    Cloud,
    HalfSpace,
    Region,
    above,
    below,
    box,
    from_points,
    segment,
)
from jaxpd.scene import Scene


def sheared_plate(
    m: int = 3,
    rows: int = 40,
    *,
    W: float = 1e-3,
    E: float = 210e9,
    G0: float = 2.7e3,
) -> Scene:
    """A square with a notch at mid-height to its middle, its top moved sideways.

    The crack leaves the plane of the notch and turns down at some 50 degrees, until it
    meets the clamp at the bottom: that is the end (`end_of`). What stands then is a
    strut in compression, where bonds do not break.

    Args:
        m: horizon over spacing.
        rows: of points, even; the spacing is W / rows.
        W: side (m).
        E: Young's modulus (Pa).
        G0: fracture energy (J/m^2).

    Source: C. Miehe, M. Hofacker, F. Welschinger (2010), Comput. Methods Appl. Mech.
    Engrg. 199, 2765-2778, section 5.2, there with nu = 0.3.

    Raises:
        ValueError: on an odd number of rows.
    """
    whole("m", m)
    positive(W=W)
    _even("rows", rows)
    h = W / rows
    top, bottom = above(y=0.5 * W - m * h), below(y=-0.5 * W + m * h)
    return Scene(
        body=box((0.0, -0.5 * W), (W, 0.5 * W)),
        material=brittle(E, G0),
        cracks=(segment((-h, 0.0), (0.5 * W, 0.0)),),
        supports=(moves(top, x=STRAIN * W, y=0.0), holds(bottom)),
        no_fail=(top, bottom),
        resolution=bonds(h, m),
    )


def l_panel(m: int = 3, n: int = 20, *, E: float = 25.85e9, G0: float = 65.0) -> Scene:
    """The L-shaped panel of concrete: a crack from an inner corner.

    A square of 0.5 m less its lower right quarter; the foot is clamped and the free leg
    is pushed up 30 mm from its end. The crack starts at the inner corner and runs
    across the standing leg, slightly upwards. Points are those of cells, without a
    lattice behind them: the surface correction is "analytic", and there is no
    calibration. The panel was 0.1 m thick; loads here are for 1 m. No notch: the first
    break is at the strength of bonds, which grows as the horizon shrinks. The end is
    where the crack comes within a horizon of the far side (`end_of`): what is left
    there is a hinge in compression.

    Args:
        m: horizon over spacing.
        n: points along a side of a quarter.
        E: Young's modulus (Pa).
        G0: fracture energy (J/m^2).

    Source: B. Winkler (2001), thesis, University of Innsbruck; nu there is 0.18.
    """
    whole("m", m)
    whole("n", n)
    side = 0.25
    h = side / n
    i, j = np.indices((2 * n, 2 * n)).reshape(2, -1)
    kept = (i < n) | (j >= n)
    X = (np.stack([i[kept], j[kept]], axis=1) + 0.5) * h
    foot = below(y=m * h)
    at = 2 * side - 0.03
    push = box((at - 0.51 * m * h, side), (at + 0.51 * m * h, side + 0.6 * h))
    return Scene(
        body=from_points(X, h * h),
        material=brittle(E, G0),
        supports=(holds(foot), moves(push, y=STRAIN * side)),
        no_fail=(
            foot,
            box((at - 2 * m * h, side), (2 * side, side + 2 * m * h)),
        ),
        resolution=dataclasses.replace(
            bonds(h, m),
            dx=None,
            m=None,
            delta=m * h,
            correction="analytic",
            calibration="continuum",
        ),
    )


def breaking_plate(n: int = 41, m: int = 3, *, G0: float = 100.0) -> Scene:
    """The cracked plate of paper 000 (`cracked_plate`), pulled until it breaks.

    Both tips run at once and straight to the free edges.

    Args:
        n: spacings a side, odd, so that the crack lies between two rows.
        m: horizon over spacing.
        G0: fracture energy (J/m^2).

    Raises:
        ValueError: on an even number of spacings.
    """
    whole("n", n)
    whole("m", m)
    if n % 2 == 0:
        raise ValueError(
            f"n: {n} puts a row of points on the crack, which then is half a row off "
            "the middle and kinks; take an odd number"
        )
    plate = cracked_plate(n, m, -1.0, STRAIN)
    return dataclasses.replace(
        plate,
        material=brittle(plate.material.E, G0),
        no_fail=(above(y=0.5), below(y=-0.5)),
        resolution=dataclasses.replace(plate.resolution, calibration="lattice"),
    )


def end_of(scene: Scene) -> Region | None:
    """Where a scene of this module ends: what `solve_fracture` takes as its `end`.

    None for those that end in pieces.
    """
    held = [region for region in scene.no_fail if isinstance(region, HalfSpace)]
    delta = scene.resolution.horizon
    if isinstance(scene.body, Cloud):  # the L-shaped panel
        return box((0.0, held[0].at), (delta, 1.0))
    shear = any(support.components[:2] == (0.0, 0.0) for support in scene.supports)
    if shear and len(held) == 2:
        low = min(region.at for region in held)
        return below(y=low + 0.5 * delta)
    return None


def _even(name: str, value: int) -> None:
    if whole(name, value) % 2:
        raise ValueError(f"{name}: {value} must be even, with the crack between two")
