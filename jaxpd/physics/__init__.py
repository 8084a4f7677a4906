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
from jaxpd.physics.damage import (
    Brittle,
    Softening,
    critical_stretch,
    fracture_energy,
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
    "Brittle",
    "Conical",
    "Constant",
    "Fractional",
    "Gaussian",
    "Influence",
    "Microelastic",
    "Softening",
    "bond_block",
    "bond_energy",
    "bond_force",
    "check_order",
    "critical_stretch",
    "extension",
    "fracture_energy",
    "micromodulus",
    "pmb",
    "stretch",
]
