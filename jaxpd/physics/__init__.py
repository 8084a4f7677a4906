"""Constitutive physics of one bond or one node, pure and undecorated."""

from jaxpd.physics.bond import (
    Microelastic,
    bond_block,
    bond_energy,
    bond_force,
    extension,
    micromodulus,
    pmb,
    stretch,
)
from jaxpd.physics.influence import (
    Conical,
    Constant,
    Fractional,
    Gaussian,
    Influence,
    check_order,
)

__all__ = [
    "Conical",
    "Constant",
    "Fractional",
    "Gaussian",
    "Influence",
    "Microelastic",
    "bond_block",
    "bond_energy",
    "bond_force",
    "check_order",
    "extension",
    "micromodulus",
    "pmb",
    "stretch",
]
