"""Operators: cloud, weights and physics made into nodal forces and tangents."""

from jaxpd.operators.bonds import BondForce, BondTangent, assemble, bond_weights
from jaxpd.operators.constraints import Constraints, fix
from jaxpd.operators.protocol import ForceOperator, Tangent

__all__ = [
    "BondForce",
    "BondTangent",
    "Constraints",
    "ForceOperator",
    "Tangent",
    "assemble",
    "bond_weights",
    "fix",
]
