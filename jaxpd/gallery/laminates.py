"""Laminated glass under an impact pressure, and a peeled beam."""

from __future__ import annotations

from jaxpd.checks import number, positive, whole
from jaxpd.conditions import drives, holds, pull
from jaxpd.geometry import box, segment
from jaxpd.laminate import interlayer, laminate
from jaxpd.resolution import Bonds, fractional
from jaxpd.scene import Elastic, Scene
from jaxpd.schedule import table


def struck_laminate(
    plies: int = 2,
    *,
    pressure: float = 60e6,
    dx: float = 0.5e-3,
    m: float = 3,
    G0: float | None = 8.0,
    peel: float | None = 100.0,
) -> Scene:
    """Glass plies of 5 mm, 0.76 mm of polymer between them, hit in the middle.

    A cross-section 0.1 m long in plane strain, E = 72 GPa, nu = 1/4, rho = 2440, whose
    ends are held below. The pressure acts on 10 mm of the top, rises within 1 us, stays
    for 4 us and falls within 1 us. The interlayer has the moduli of polyvinyl butyral
    at high rates, 2 GPa across and 0.2 GPa in shear, and its mass. Run it for 20 us.

    Args:
        plies: how many; 2 or 3 are common.
        pressure: at its highest (Pa).
        dx: spacing (m), a divisor of 5 mm.
        m: horizon over spacing.
        G0: fracture energy of the glass (J/m^2); None never breaks.
        peel: fracture energy of the interlayer (J/m^2); None never comes apart.
    """
    positive(dx=dx, m=m)
    number("pressure", pressure, cure="in Pa")
    whole("plies", plies, 2)
    if peel is not None:
        number("peel", peel, above=0, cure="in J/m^2, or None")
    length, H, h, patch = 0.1, 5e-3, 0.76e-3, 10e-3
    floors = [i * (H + h) for i in range(plies)]
    boxes = [box((0.0, y), (length, y + H)) for y in floors]
    top = floors[-1] + H
    low, high = 0.5 * (length - patch), 0.5 * (length + patch)
    struck = box((low, top - m * dx), (high, top))
    glue = interlayer(2e9, shear=0.2e9, rho=1100.0, G0=peel)
    feet = [box((x, 0.0), (x + m * dx, m * dx)) for x in (0.0, length - m * dx)]
    return Scene(
        body=laminate(boxes, glue),
        material=Elastic(72e9, nu=1 / 4, state="plane strain", rho=2440.0, G0=G0),
        supports=[holds(foot) for foot in feet],
        loads=[
            pull(
                struck,
                y=-pressure * patch,
                time=table((0.0, 1e-6, 5e-6, 6e-6), (0.0, 1.0, 1.0, 0.0)),
            )
        ],
        no_fail=[struck, *feet],
        resolution=Bonds(
            dx=dx,
            m=m,
            kernel=fractional(-1.0),
            nodes="cell",
            partial="continuous",
            correction="none",
        ),
    )


def peeled_beam(
    G0: float = 1e-6,
    *,
    E: float = 0.01,
    shear: float | None = None,
    speed: float = 1e-4,
) -> Scene:
    """A double cantilever beam: two plies, peeled apart from a notch along the layer.

    Two plies of 0.4 x 0.04 m, E = rho = 1, plane stress, a layer of 0.01 m with a notch
    of 0.08 m; points within 0.02 m of the ends are driven apart. Run it for 120 s.

    Args:
        G0: fracture energy of the interlayer (J/m^2).
        E: its modulus across (Pa).
        shear: its shear modulus (Pa), or None.
        speed: at which the ends part (m/s).
    """
    number("speed", speed, cure="in m/s")
    H, h, length = 0.04, 0.01, 0.4
    middle = H + 0.5 * h
    sides = ((0.0, H, -1.0), (H + h, 2.0 * H + h, 1.0))
    return Scene(
        body=laminate(
            [box((0.0, low), (length, high)) for low, high, _ in sides],
            interlayer(E, shear=shear, G0=G0),
        ),
        material=Elastic(1.0, nu=1 / 3, state="plane stress", rho=1.0),
        cracks=[segment((-0.1, middle), (0.08, middle))],
        supports=[
            drives(box((0.0, low), (0.02, high)), y=0.5 * sign * speed)
            for low, high, sign in sides
        ],
        resolution=Bonds(dx=0.01, m=3, kernel=fractional(-1.0), nodes="cell"),
    )
