"""Operators: cloud, weights and physics made into nodal forces and tangents."""

from jaxpd.operators.bonds import BondForce, BondTangent, assemble, bond_weights
from jaxpd.operators.constraints import Constraints, fix
from jaxpd.operators.fft import FFTTangent, convolution, pivots
from jaxpd.operators.halves import HalfForce
from jaxpd.operators.lattice import LatticeTangent
from jaxpd.operators.memory import MemoryForce
from jaxpd.operators.protocol import ForceOperator, MotionForce, Tangent
from jaxpd.operators.pulled import Pulled, PulledTangent
from jaxpd.operators.pulled_motion import PulledMotion
from jaxpd.operators.rest import BondsAtRest, LinearForce
from jaxpd.operators.slots import SlotForce
from jaxpd.operators.stencil import StencilForce

__all__ = [
    "BondForce",
    "BondTangent",
    "BondsAtRest",
    "Constraints",
    "FFTTangent",
    "ForceOperator",
    "HalfForce",
    "LatticeTangent",
    "LinearForce",
    "MemoryForce",
    "MotionForce",
    "Pulled",
    "PulledMotion",
    "PulledTangent",
    "SlotForce",
    "StencilForce",
    "Tangent",
    "assemble",
    "bond_weights",
    "convolution",
    "fix",
    "pivots",
]
