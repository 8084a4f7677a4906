"""Quasi-static fracture: specimens of brittle bonds for `jaxpd.solve_fracture`.

Plane stress, nu = 1/3, 1 m thick, small strains; PMB bonds with linear shares at the
rim of the horizon, surface corrections and micromodulus of the lattice. Rows of points
lie beside crack planes, never on them: their number is even. Notches end on the edge
between two columns and cut the bonds through that very place.

Every scene runs with `solve_fracture(scene, end=end_of(scene))` to its end: until
nothing carries load, or a load pulls a piece off, or a crack has come to where small
strains and held regions leave no sense in going on. Figures to compare with are in
`jaxpd.gallery.handbook`.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from jaxpd.checks import number, positive, whole, word
from jaxpd.conditions import moves, traction
from jaxpd.geometry import Box, above, below, box, segment
from jaxpd.resolution import Bonds, fractional
from jaxpd.scene import Elastic, Scene

#: Soda-lime glass: Young's modulus (Pa) and fracture energy (J/m^2).
GLASS = (72e9, 3.8)
#: Load factor 1: mean strain, or relative opening, that is prescribed (-).
STRAIN = 1e-3


def double_cantilever(
    m: int = 3,
    arm: float = 4.0,
    length: float = 9.0,
    notch: float = 3.0,
    *,
    delta: float = 1e-3,
    E: float = GLASS[0],
    G0: float = GLASS[1],
) -> Scene:
    """A double cantilever beam: the specimen that measures fracture energy.

    Two arms of height H, joined ahead of a notch on the mid-plane, which alone may
    fail. The ends of the arms, one column of points each, move apart along y and turn
    freely; at the far end x is held. The crack grows under a falling load until the
    specimen is in two. What brittle bonds need is above G0 and depends on m (lattice
    trapping): 1.3, 1.19, 1.06 G0 at m = 3, 4, 6.

    Args:
        m: horizon over spacing.
        arm: height of an arm over the horizon; times m a whole number of rows.
        length: of the beam over H.
        notch: its length over H, both rounded to columns.
        delta: horizon (m).
        E: Young's modulus (Pa).
        G0: fracture energy (J/m^2).

    Raises:
        ValueError: if an arm has no whole number of rows.
    """
    whole("m", m)
    positive(arm=arm, length=length, notch=notch, delta=delta)
    h = delta / m
    rows = _whole("arm", arm * m, "arm times m", "rows")
    columns, a0 = round(length * rows), round(notch * rows)
    if not 0 < a0 < columns - m:
        raise ValueError(
            f"notch: {notch} must be above 0 and end before length {length}"
        )
    H, L = rows * h, columns * h
    end = 0.6 * h
    open_by = 0.5 * STRAIN * H
    return Scene(
        body=box((0.0, -H), (L, H)),
        material=brittle(E, G0),
        cracks=(segment((-h, 0.0), (a0 * h, 0.0)),),
        supports=(
            moves(box((0.0, 0.0), (end, H)), y=+open_by),
            moves(box((0.0, -H), (end, 0.0)), y=-open_by),
            moves(box((L - end, -H), (L, H)), x=0.0),
        ),
        weak=(segment((-h, 0.0), (L + h, 0.0)),),
        no_fail=(box((0.0, -H), (delta, H)),),
        resolution=bonds(h, m),
    )


def notched_plate(
    m: int = 3,
    columns: int = 40,
    load: str = "stress",
    *,
    notch: float = 0.4,
    straight: bool = True,
    W: float = 0.04,
    E: float = GLASS[0],
    G0: float = GLASS[1],
) -> Scene:
    """A plate with a notch in one edge, W wide and 2 W high, in tension.

    Under stress the ends are free to turn and K at the notch is Tada's
    (`edge_notch_K`); the plate breaks in an instant at K / sqrt(E G0) = 1.09,
    0.97, 0.87 at m = 3, 4, 6 with 40, 48, 48 columns: the horizon is no small part of
    the notch. K^-2 there is linear in h / a; its limit is the toughness that the
    lattice traps in tension, more than in a double cantilever at m = 3 (1.54 G0).

    Args:
        m: horizon over spacing.
        columns: of points; the spacing is W / columns.
        load: "stress", 1 MPa on both ends; or "grips", m rows at each end clamped and
            moved apart by 1/1000 of the height.
        notch: its length over W, rounded to columns.
        straight: only bonds across the plane of the notch may fail.
        W: width (m).
        E: Young's modulus (Pa).
        G0: fracture energy (J/m^2).

    Raises:
        ValueError: on an unknown load.
    """
    _check(m, columns, "columns", notch, W)
    h, L = W / columns, 2.0 * W
    a0, grip = round(notch * columns), L / 2 - m * h
    ends = (above(y=grip), below(y=-grip))
    supports, loads = (), ()
    if word("load", load, ("stress", "grips")) == "stress":
        loads = (
            traction(above(y=L / 2), y=+1e6),
            traction(below(y=-L / 2), y=-1e6),
        )
        supports = _three_points((W - 0.5 * h, -0.5 * L + 0.5 * h), h)
    else:
        supports = (
            moves(ends[0], x=0.0, y=+0.5 * STRAIN * L),
            moves(ends[1], x=0.0, y=-0.5 * STRAIN * L),
        )
    return Scene(
        body=box((0.0, -L / 2), (W, L / 2)),
        material=brittle(E, G0),
        cracks=(segment((-h, 0.0), (a0 * h, 0.0)),),
        supports=supports,
        loads=loads,
        weak=(segment((-h, 0.0), (W + h, 0.0)),) if straight else (),
        no_fail=ends,
        resolution=bonds(h, m),
    )


def compact_tension(
    m: int = 3,
    columns: int = 40,
    *,
    notch: float = 0.5,
    W: float = 0.04,
    E: float = GLASS[0],
    G0: float = GLASS[1],
) -> Scene:
    """A compact tension specimen, 1.25 W by 1.2 W, pulled at two pins.

    x is 0 on the line of the pins. A pin is the column of points nearest to that line,
    0.25 W high, which moves along y and turns freely; W / 8 around them nothing
    breaks. `compact_tension_K` has its K. The crack keeps to the mid-plane by
    itself; the two halves hang on their pins in the end.

    Args:
        m: horizon over spacing.
        columns: of points over W, divisible by 20 (holes and edges on the lattice).
        notch: length of the notch from the line of the pins over W.
        W: width from that line to the back (m).
        E: Young's modulus (Pa).
        G0: fracture energy (J/m^2).

    Source: ASTM E399, compact specimen.

    Raises:
        ValueError: if the lattice does not fit the specimen.
    """
    _check(m, columns, "columns", notch, W)
    if columns % 20:
        raise ValueError(f"columns: {columns} must be divisible by 20, as 40")
    h = W / columns
    a0 = round(notch * columns)
    open_by, thin = 0.5 * STRAIN * W, 0.6 * h
    up, down = ((0.0, 0.15 * W), (thin, 0.4 * W)), ((0.0, -0.4 * W), (thin, -0.15 * W))
    wide = 0.125 * W
    return Scene(
        body=box((-0.25 * W, -0.6 * W), (W, 0.6 * W)),
        material=brittle(E, G0),
        cracks=(segment((-0.25 * W - h, 0.0), (a0 * h, 0.0)),),
        supports=(
            moves(box(*up), y=+open_by),
            moves(box(*down), y=-open_by),
            moves(box((W - 0.6 * h, -0.6 * h), (W, 0.6 * h)), x=0.0),
        ),
        no_fail=(
            box((-wide, 0.15 * W), (wide, 0.4 * W)),
            box((-wide, -0.4 * W), (wide, -0.15 * W)),
        ),
        resolution=bonds(h, m),
    )


def bent_beam(
    m: int = 3,
    rows: int = 24,
    *,
    notch: float = 0.5,
    straight: bool = False,
    W: float = 0.04,
    E: float = GLASS[0],
    G0: float = GLASS[1],
) -> Scene:
    """A notched beam on two rollers 4 W apart, pressed down in the middle.

    The beam is 4.5 W long and W high with a notch from below. The press is the pair of
    points above it, a roller the pair of points below, so that all turn freely; near
    the rollers nothing breaks. `bent_beam_K` has its K. In the end the halves
    rest on rollers and press without load.

    Args:
        m: horizon over spacing.
        rows: of points over the height W, divisible by 4.
        notch: its length over W, rounded to rows.
        straight: only bonds across the plane of the notch may fail.
        W: height (m).
        E: Young's modulus (Pa).
        G0: fracture energy (J/m^2).

    Source: ASTM E399, bend specimen.

    Raises:
        ValueError: if the lattice does not fit the beam.
    """
    _check(m, rows, "rows", notch, W)
    if rows % 4:
        raise ValueError(f"rows: {rows} must be divisible by 4, as 24")
    h = W / rows
    a0, span = round(notch * rows), 4.0 * W
    left, right = (-0.5 * span - 0.5 * h, 0.5 * h), (0.5 * span + 0.5 * h, 0.5 * h)
    near = 1.5 * m * h
    return Scene(
        body=box((-2.25 * W, 0.0), (2.25 * W, W)),
        material=brittle(E, G0),
        cracks=(segment((0.0, -h), (0.0, a0 * h)),),
        supports=(
            moves(_point(left, h), x=0.0, y=0.0),
            moves(_point(right, h), y=0.0),
            moves(box((-0.6 * h, W - 0.6 * h), (0.6 * h, W)), y=-STRAIN * W),
        ),
        weak=(segment((0.0, W + h), (0.0, -h)),) if straight else (),
        no_fail=(
            box((left[0] - near, 0.0), (left[0] + near, near)),
            box((right[0] - near, 0.0), (right[0] + near, near)),
        ),
        resolution=bonds(h, m),
    )


def notch_of(scene: Scene) -> float:
    """Length of the notch of a scene above (m), from where its handbook measures it."""
    if len(scene.cracks) != 1:
        raise ValueError(f"scene: has {len(scene.cracks)} cracks; one is measured")
    return float(np.abs(scene.cracks[0].point(1.0)).max())


def brittle(E: float, G0: float) -> Elastic:
    """A brittle material of bonds in plane stress: E (Pa), G0 (J/m^2)."""
    return Elastic(E, nu=1 / 3, state="plane stress", G0=G0)


def bonds(h: float, m: int) -> Bonds:
    """Bonds on a lattice of spacing h (m), as slow fracture takes them."""
    return Bonds(
        dx=h,
        m=m,
        kernel=fractional(-1.0),  # the PMB material
        nodes="cell",
        partial="linear",
        correction="lattice",
        calibration="lattice",
    )


def _point(at: tuple[float, float], h: float) -> Box:
    """A box around one point of the lattice."""
    return box((at[0] - 0.1 * h, at[1] - 0.1 * h), (at[0] + 0.1 * h, at[1] + 0.1 * h))


def _three_points(at: tuple[float, float], h: float) -> tuple[Any, ...]:
    """Supports without reactions: a point held, and its neighbour above along x."""
    return (
        moves(_point(at, h), x=0.0, y=0.0),
        moves(_point((at[0], at[1] + h), h), x=0.0),
    )


def _check(m: int, n: int, name: str, notch: float, W: float) -> None:
    whole("m", m)
    whole(name, n)
    number("notch", notch, above=0, below=1, cure="a share of W")
    positive(W=W)


def _whole(name: str, value: float, what: str, of: str) -> int:
    if abs(value - round(value)) > 1e-9 or round(value) < 1:
        raise ValueError(f"{name}: {what} is {value}, and must be a number of {of}")
    return round(value)
