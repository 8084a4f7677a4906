"""Weights, not forces: what a discretisation adds to bonds and nodes."""

from jaxpd.discretize.directional import bond_factors
from jaxpd.discretize.extension import Extension, beyond_faces, share_of_body
from jaxpd.discretize.surface import CORRECTIONS

__all__ = ["CORRECTIONS", "Extension", "beyond_faces", "bond_factors", "share_of_body"]
