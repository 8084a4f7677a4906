"""Weights, not forces: what a discretisation adds to bonds and nodes."""

from jaxpd.discretize.surface import volume_correction

__all__ = ["volume_correction"]
