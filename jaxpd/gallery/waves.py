"""Waves: a pulse in a bar, the Gaussian wave of paper 002, a struck laminate."""

from __future__ import annotations

import numpy as np

from jaxpd.checks import number, positive, whole
from jaxpd.conditions import initially
from jaxpd.geometry import above, box
from jaxpd.laminate import interlayer, laminate
from jaxpd.resolution import Bonds, fractional
from jaxpd.scene import Elastic, Scene


def bar_wave(
    n: int = 200,
    m: float = 3,
    width: float = 0.1,
    amplitude: float = 1e-5,
    alpha: float = 0.0,
) -> Scene:
    """A Gaussian pulse of displacement in the middle of a bar at rest.

    A bar of 1 m, E = rho = 1, so that long waves travel at 1 m/s. The pulse parts into
    two of half the height, which reach the ends at 0.5 s and come back unchanged.

    Args:
        n: spacings of the bar.
        m: horizon over spacing.
        width: of the pulse exp(-(x / width)^2) (m).
        amplitude: of the pulse (m).
        alpha: order of the fractional kernel.
    """
    whole("n", n)
    positive(m=m, width=width)
    number("amplitude", amplitude, cure="in m")
    return Scene(
        body=box((-0.5,), (0.5,)),
        material=Elastic(1.0, state="bar", rho=1.0),
        starts=(
            initially(
                above(x=-1.0),
                ux=lambda X: amplitude * np.exp(-((X[:, 0] / width) ** 2)),
            ),
        ),
        resolution=Bonds(dx=1.0 / n, m=m, kernel=fractional(alpha), nodes="cell"),
    )


#: What paper 002 prints of Fig. 6: energy densities (J/m^3) on the row of the pulse.
PRINTED_ENERGY = {
    "corrected": {"plateau": 3.49636e-7, "edge": 4.11448e-7, "y": 41.94},
    "uncorrected": {"plateau": 3.20270e-7, "edge": 2.23789e-7, "y": 41.78},
}
#: Printed for the soft interlayer: height of the transmitted half wave (m).
PRINTED_TRANSMITTED = (0.008, 0.009)


def gaussian_wave(
    E: float | None = 0.01,
    *,
    rule: str = "calibrated",
    correction: str = "analytic",
    height: float = 35.0,
    one_way: bool = False,
) -> Scene:
    """The Gaussian wave of paper 002 through an interlayer.

    Two strips, 0.4 m wide and as high as `height`, E = rho = 1, nu = 1/3, plane stress,
    around a layer of 0.04 m; dx = 0.02 m, m = 4, points on the edges with whole
    volumes; u_y = 0.02 exp(-0.01 y^2) at the start, half of which moves up. Run it for
    70 s at dt <= 0.0125 s. The set-up was found by comparison.

    Args:
        E: of the interlayer (Pa): 1 "identical", 0.01 "soft", None without any.
        rule: how its bonds are made; the printed figures need "paper".
        correction: "analytic" for the printed corrected figures, "none" for the others.
        height: of each strip with half of the gap (m), a multiple of 0.02 m.
        one_way: drop what pulls at the ghosts, as the paper does.
    """
    positive(height=height)
    layer = None if E is None else interlayer(E, rule=rule, one_way=one_way)
    dx, width = 0.02, 0.2
    low = box((-width, 0.0), (width, height - dx))
    high = box((-width, height + dx), (width, 2.0 * height))
    pulse = initially(above(y=-1.0), uy=lambda X: 0.02 * np.exp(-0.01 * X[:, 1] ** 2))
    return Scene(
        body=laminate([low, high], [layer]),
        material=Elastic(1.0, nu=1 / 3, state="plane stress", rho=1.0),
        starts=(pulse,),
        resolution=Bonds(dx=dx, m=4, kernel=fractional(-1.0), correction=correction),
    )
