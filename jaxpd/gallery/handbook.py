"""Closed forms of fracture mechanics for the specimens of `jaxpd.gallery.slow`.

Plane stress; forces P per thickness (N/m), a crack lengths (m), E Young's modulus (Pa).
A brittle body breaks where K = sqrt(E G0).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

#: Correction of crack length over arm height by Poisson's ratio 1/3 of the arms' foot.
FOOT = 0.669


def beam_compliance(a: Any, H: float, E: float) -> Any:
    """Opening over force (m^2/N) of a double cantilever, 8 (a + 0.669 H)^3 / (E H^3).

    Bending of arms on an elastic foundation, whose length is added to the crack.

    Args:
        a: length of the crack from the line of load (m).
        H: height of an arm (m).
        E: Young's modulus (Pa).

    Source: J. G. Williams (1989), End corrections for orthotropic DCB specimens,
    Compos. Sci. Technol. 35, 367-376, for the form; the isotropic 0.67 of plane stress.
    """
    return 8.0 * (np.asarray(a) + FOOT * H) ** 3 / (E * H**3)


def beam_force(opening: Any, H: float, E: float, G: float) -> Any:
    """Force (N/m) of a double cantilever of growing crack at an opening (m).

    Crack length is eliminated from `beam_compliance` and G = P^2/2 dC/da:

        P = (G E H^3 / 12)^(3/4) / (opening E H^3 / 8)^(1/2)
    """
    stiff = E * H**3
    return (G * stiff / 12.0) ** 0.75 / np.sqrt(np.asarray(opening) * stiff / 8.0)


def edge_notch_K(stress: Any, a: Any, W: float) -> Any:
    """K (Pa sqrt m) of an edge notch in a plate in tension, ends far and free to turn.

    Source: H. Tada, P. Paris, G. Irwin, The Stress Analysis of Cracks Handbook, 2.10,
    better than 0.5 % for any a / W.
    """
    x = np.asarray(a) / W
    t = 0.5 * math.pi * x
    shape = 0.752 + 2.02 * x + 0.37 * (1.0 - np.sin(t)) ** 3
    size = np.sqrt(math.pi * np.asarray(a)) * np.sqrt(np.tan(t) / t)
    return np.asarray(stress) * size * shape / np.cos(t)


def compact_tension_K(P: Any, a: Any, W: float) -> Any:
    """K (Pa sqrt m) of the compact tension specimen, a from the line of the pins.

    Source: ASTM E399, A4.5.3; 0.5 % for 0.2 <= a / W <= 1.
    """
    x = np.asarray(a) / W
    poly = 0.886 + x * (4.64 + x * (-13.32 + x * (14.72 - 5.6 * x)))
    return np.asarray(P) / math.sqrt(W) * (2.0 + x) * poly / (1.0 - x) ** 1.5


def bent_beam_K(P: Any, a: Any, W: float) -> Any:
    """K (Pa sqrt m) of a notched beam in three-point bending, span 4 W.

    Source: J. E. Srawley (1976), Int. J. Fract. 12, 475-476; 0.5 % for any a / W.
    """
    x = np.asarray(a) / W
    top = 3.0 * np.sqrt(x) * (1.99 - x * (1.0 - x) * (2.15 + x * (-3.93 + 2.7 * x)))
    return 4.0 * np.asarray(P) / math.sqrt(W) * top / (2 * (1 + 2 * x) * (1 - x) ** 1.5)
