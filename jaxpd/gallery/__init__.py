"""Model problems: the scenes of the papers, with their printed figures.

A scene here reproduces a paper's set-up down to the rows of points, and its constants
carry the tables that it is compared with. Printed figures are facts of the papers,
named by table; set-ups that a paper leaves out were found by comparison and are said
to be.
"""

from jaxpd.gallery.fracture import FRACTURE_SAFETY, branching_plate, kalthoff_winkler
from jaxpd.gallery.handbook import (
    beam_compliance,
    beam_force,
    bent_beam_K,
    compact_tension_K,
    edge_notch_K,
)
from jaxpd.gallery.kernels import (
    bar_exact,
    cantilever,
    cantilever_exact,
    kernel_bar,
    kirsch_exact,
    kirsch_stress,
    l_shape,
    patch,
    patch_exact,
    patch_stress,
    plate_under_tension,
)
from jaxpd.gallery.laminates import peeled_beam, struck_laminate
from jaxpd.gallery.plastic import (
    PAPER,
    RING,
    YOON,
    YOON_MODULUS,
    cook_panel,
    plastic_bar,
    plastic_beam,
    plate_with_hole,
    pressed_ring,
)
from jaxpd.gallery.plate import (
    ALPHAS,
    CLASSICAL_OPENING,
    CRACK,
    PRINTED_CG,
    PRINTED_CG_BY_M,
    PRINTED_CONDITION,
    PRINTED_DPCG,
    PRINTED_DPCG_BY_M,
    PRINTED_MG,
    PRINTED_MG_BY_M,
    PRINTED_RTOL,
    RATIOS,
    cracked_plate,
)
from jaxpd.gallery.slow import (
    bent_beam,
    compact_tension,
    double_cantilever,
    notch_of,
    notched_plate,
)
from jaxpd.gallery.slow_paths import breaking_plate, end_of, l_panel, sheared_plate
from jaxpd.gallery.waves import (
    PRINTED_ENERGY,
    PRINTED_TRANSMITTED,
    bar_wave,
    gaussian_wave,
)

__all__ = [
    "ALPHAS",
    "CLASSICAL_OPENING",
    "CRACK",
    "FRACTURE_SAFETY",
    "PAPER",
    "PRINTED_CG",
    "PRINTED_CG_BY_M",
    "PRINTED_CONDITION",
    "PRINTED_DPCG",
    "PRINTED_DPCG_BY_M",
    "PRINTED_ENERGY",
    "PRINTED_MG",
    "PRINTED_MG_BY_M",
    "PRINTED_RTOL",
    "PRINTED_TRANSMITTED",
    "RATIOS",
    "RING",
    "YOON",
    "YOON_MODULUS",
    "bar_exact",
    "bar_wave",
    "beam_compliance",
    "beam_force",
    "bent_beam",
    "bent_beam_K",
    "branching_plate",
    "breaking_plate",
    "cantilever",
    "cantilever_exact",
    "compact_tension",
    "compact_tension_K",
    "cook_panel",
    "cracked_plate",
    "double_cantilever",
    "edge_notch_K",
    "end_of",
    "gaussian_wave",
    "kalthoff_winkler",
    "kernel_bar",
    "kirsch_exact",
    "kirsch_stress",
    "l_panel",
    "l_shape",
    "notch_of",
    "notched_plate",
    "patch",
    "patch_exact",
    "patch_stress",
    "peeled_beam",
    "plastic_bar",
    "plastic_beam",
    "plate_under_tension",
    "plate_with_hole",
    "pressed_ring",
    "sheared_plate",
    "struck_laminate",
]
