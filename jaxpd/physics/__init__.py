"""Constitutive physics of one bond or one node, pure and undecorated."""

from jaxpd.physics.bilinear import Bilinear
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
from jaxpd.physics.hardening import Linear, Voce
from jaxpd.physics.influence import (
    Conical,
    Constant,
    Fractional,
    Gaussian,
    Influence,
    check_order,
)
from jaxpd.physics.node import Hooke, tangent_block, von_mises_stress
from jaxpd.physics.plasticity import Plastic, VonMises, von_mises

__all__ = [
    "Bilinear",
    "Brittle",
    "Conical",
    "Constant",
    "Fractional",
    "Gaussian",
    "Hooke",
    "Influence",
    "Linear",
    "Microelastic",
    "Plastic",
    "Softening",
    "Voce",
    "VonMises",
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
    "tangent_block",
    "von_mises",
    "von_mises_stress",
]
