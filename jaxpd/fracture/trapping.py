"""What brittle bonds of a lattice really ask for: `trapping`.

Between two rows the bonds of a lattice hold a fracture energy that is an exact sum, but
a crack asks for more than that. A bond breaks at once, and what its loss frees beyond
what it held is gone too: the lattice traps the crack. At a horizon of three spacings
that is some 20 %, at six 4 %, and the load that makes the crack move is higher still.

Here both are measured, on a long strip between rigid grips with the lattice, the kernel
and the shares of a scene, along the exact path (`events`) while the crack grows
steadily. Strength scales with the square root of the fracture energy and nothing else
does, so a ratio that was measured can be divided out: `solve_fracture(scene,
toughness=ratio)`.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from jaxpd.checks import instance
from jaxpd.conditions import moves
from jaxpd.fracture.breaking import prepare_fracture
from jaxpd.fracture.solve import solve_fracture
from jaxpd.geometry import box, segment
from jaxpd.scene import Elastic, Scene

#: Half the height of the strip over the horizon, its notch and the rest over that half,
#: and the growth that is measured, in spacings, after what is left out.
HEIGHT, NOTCH, REST, GROWTH, SKIPPED = 4, 2, 2, 12, 6


@dataclass(frozen=True)
class Trapping:
    """Fracture energies of a lattice over G0, for nominal critical stretches.

    Attributes:
        lattice: what the bonds between two rows hold (-).
        dissipated: what the growth of a crack takes along the exact path (-).
        envelope: energy release rate that monotone loading has to reach (-).
        states: events that were looked at.
    """

    lattice: float
    dissipated: float
    envelope: float
    states: int


def trapping(scene: Scene) -> Trapping:
    """Measure what a crack along the rows takes on the lattice of a scene.

    Args:
        scene: in 2-D, of `Elastic` with a fracture energy, on a lattice.

    Raises:
        ValueError: on another scene.
    """
    instance("scene", scene, Scene, "a Scene(..)")
    material, resolution = scene.material, scene.resolution
    if scene.d != 2 or not isinstance(material, Elastic) or resolution.dx is None:
        raise ValueError("scene: trapping is measured in 2-D, with Elastic on a box")
    dx, delta = resolution.dx, resolution.horizon
    H = dx * np.ceil(HEIGHT * delta / dx)
    notch, growth = NOTCH * H, (GROWTH + SKIPPED) * dx
    L = notch + growth + REST * H
    grip = delta * (1.0 + 1e-9)
    strip = dataclasses.replace(
        scene,
        body=box((0.0, -H), (L, H)),
        cracks=(segment((-dx, 0.0), (notch, 0.0)),),
        weak=(segment((-dx, 0.0), (L + dx, 0.0)),),
        no_fail=(),
        starts=(),
        loads=(),
        supports=(
            moves(box((0.0, H - grip), (L, H)), y=+1.0),
            moves(box((0.0, -H), (L, grip - H)), y=-1.0),
            moves(box((L - dx, -H), (L, H)), x=0.0),
        ),
        resolution=dataclasses.replace(resolution, nodes="cell", layers=None),
    )
    end = box((notch + growth, -H), (L, H))
    found = solve_fracture(strip, end=end, solver="direct").checked()
    # bonds between rows, per length: their energy says how far the crack has come
    held = prepare_fracture(strip, "lattice").toughness
    gone = found.bonds / (float(np.mean(np.asarray(material.G0))) * held)
    steady = gone >= SKIPPED * dx
    if steady.sum() < 10:
        raise ValueError(f"dx: {dx} leaves too few events to measure; see the scene")
    length = gone[steady]
    stiff = found.force[steady] / found.factor[steady]
    release = -0.5 * np.polyfit(length, stiff, 1)[0] * found.factor[steady] ** 2
    # the last state only ends the path, at the factor of the one before
    G0 = float(np.mean(np.asarray(material.G0)))
    return Trapping(
        lattice=held,
        dissipated=float(np.polyfit(length, found.released[steady], 1)[0]) / G0,
        envelope=float(release.max()) / G0,
        states=int(steady.sum()),
    )
