"""Weights, not forces: what a discretisation adds to bonds and nodes."""

from jaxpd.discretize.directional import bond_factors
from jaxpd.discretize.extension import Extension, beyond_faces, share_of_body
from jaxpd.discretize.mls import apply_weights, curvatures, derivative_weights, slopes
from jaxpd.discretize.moments import Stars, find_stars, powers, spacing
from jaxpd.discretize.surface import CORRECTIONS

__all__ = [
    "CORRECTIONS",
    "Extension",
    "Stars",
    "apply_weights",
    "beyond_faces",
    "bond_factors",
    "curvatures",
    "derivative_weights",
    "find_stars",
    "powers",
    "share_of_body",
    "slopes",
    "spacing",
]
