"""Operators: cloud, weights and physics made into nodal forces and tangents."""

from jaxpd.operators.bonds import BondForce, BondTangent, assemble, bond_weights
from jaxpd.operators.constraints import Constraints, fix
from jaxpd.operators.fft import FFTTangent, convolution, pivots
from jaxpd.operators.lattice import LatticeTangent
from jaxpd.operators.protocol import ForceOperator, Tangent
from jaxpd.operators.pulled import Pulled, PulledTangent
from jaxpd.operators.rest import BondsAtRest, LinearForce
from jaxpd.operators.stencil import StencilForce

__all__ = [
    "BondForce",
    "BondTangent",
    "BondsAtRest",
    "Constraints",
    "FFTTangent",
    "ForceOperator",
    "LatticeTangent",
    "LinearForce",
    "Pulled",
    "PulledTangent",
    "StencilForce",
    "Tangent",
    "assemble",
    "bond_weights",
    "convolution",
    "fix",
    "pivots",
]
