"""Dynamic fracture: the branching plate, the Kalthoff-Winkler plate."""

from __future__ import annotations

from jaxpd.checks import number, positive
from jaxpd.conditions import drives, traction
from jaxpd.geometry import above, below, box, segment
from jaxpd.resolution import Bonds, fractional
from jaxpd.scene import Elastic, Scene

#: Step over that of `longest_dt` in the fracture scenes: half of Silling's and Askari's
#: sqrt(2 rho / sum c V / |xi|), as the acceptance figures were measured.
FRACTURE_SAFETY = 0.354


def branching_plate(
    m: float = 4,
    delta: float = 1e-3,
    stress: float = 2e6,
    G0: float = 3.8,
    *,
    partial: str = "continuous",
) -> Scene:
    """A crack that branches: pre-cracked soda-lime glass under sudden stress.

    A plate of 0.1 x 0.04 m with an edge crack of 0.05 m at mid-height; the long edges
    are pulled apart from time 0 on; plane stress, E = 72 GPa, nu = 1/3, rho = 2440.
    With the defaults one crack becomes two at 65.2 +- 1.5 mm, 20.3 +- 1 us; run it for
    43 us, before the branches reach the far edge.

    Args:
        m: horizon over spacing; 3 to 6 is common.
        delta: horizon (m).
        stress: on the long edges (Pa), spread over a horizon.
        G0: fracture energy (J/m^2).
        partial: volume of neighbours at the rim of the horizon; "none" lets the
            lattice's own fracture energy scatter by 14 % with m, "continuous" by 3 %.
    """
    positive(m=m, delta=delta)
    number("stress", stress, cure="in Pa")
    return Scene(
        body=box((0.0, -0.02), (0.1, 0.02)),
        material=Elastic(72e9, nu=1 / 3, state="plane stress", rho=2440.0, G0=G0),
        cracks=(segment((0.0, 0.0), (0.05, 0.0)),),
        loads=(
            traction(above(y=0.02), y=+stress),
            traction(below(y=-0.02), y=-stress),
        ),
        resolution=_fracture_bonds(m, delta, partial),
    )


def kalthoff_winkler(
    m: float = 3, delta: float = 3e-3, speed: float = 16.5, *, partial="continuous"
) -> Scene:
    """The Kalthoff-Winkler plate: a struck edge between two notches, in steel.

    A plate of 0.1 x 0.2 m with two notches 0.05 m long and 0.05 m apart; the points
    within a horizon of the edge between them move at a constant speed along x; plane
    strain, E = 190 GPa, nu = 1/4, rho = 8000, G0 = 22.2 kJ/m^2. Cracks leave the notch
    tips at some 64 degrees and are 40 mm long at 47 us; run it for 60 us. With a
    horizon of 3 mm or more a second system of cracks starts from the far edge then.

    Args:
        m: horizon over spacing.
        delta: horizon (m).
        speed: of the struck edge (m/s).
        partial: as in `branching_plate`.
    """
    positive(m=m, delta=delta)
    number("speed", speed, cure="in m/s")
    steel = Elastic(190e9, nu=1 / 4, state="plane strain", rho=8000.0, G0=22.2e3)
    return Scene(
        body=box((0.0, -0.1), (0.1, 0.1)),
        material=steel,
        cracks=tuple(segment((0.0, y), (0.05, y)) for y in (-0.025, 0.025)),
        supports=(drives(box((0.0, -0.025), (delta, 0.025)), x=speed),),
        resolution=_fracture_bonds(m, delta, partial),
    )


def _fracture_bonds(m: float, delta: float, partial: str) -> Bonds:
    return Bonds(
        dx=delta / m,
        delta=delta,
        kernel=fractional(-1.0),  # the PMB material
        nodes="cell",
        partial=partial,
        correction="none",
    )
