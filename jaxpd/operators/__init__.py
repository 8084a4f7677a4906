"""Operators: cloud, weights and physics made into nodal forces and tangents."""

from jaxpd.operators.bonds import BondForce, BondTangent, assemble, bond_weights
from jaxpd.operators.constraints import Constraints, fix
from jaxpd.operators.fft import FFTTangent, convolution, pivots
from jaxpd.operators.ghost_tangent import GhostTangent
from jaxpd.operators.ghosts import GhostForce
from jaxpd.operators.halves import HalfForce
from jaxpd.operators.lattice import LatticeTangent
from jaxpd.operators.memory import MemoryForce
from jaxpd.operators.navier import NavierForce, NavierTangent, navier
from jaxpd.operators.protocol import ForceOperator, MotionForce, Tangent
from jaxpd.operators.pulled import Pulled, PulledTangent
from jaxpd.operators.pulled_motion import PulledMotion
from jaxpd.operators.rest import BondsAtRest, LinearForce
from jaxpd.operators.slots import SlotForce
from jaxpd.operators.stencil import StencilForce
from jaxpd.operators.strong import StrongForce
from jaxpd.operators.strong_tangent import StrongTangent
from jaxpd.operators.sum import Sum, SumTangent
from jaxpd.operators.sum_motion import SumMotion

__all__ = [
    "BondForce",
    "BondTangent",
    "BondsAtRest",
    "Constraints",
    "FFTTangent",
    "ForceOperator",
    "GhostForce",
    "GhostTangent",
    "HalfForce",
    "LatticeTangent",
    "LinearForce",
    "MemoryForce",
    "MotionForce",
    "NavierForce",
    "NavierTangent",
    "Pulled",
    "PulledMotion",
    "PulledTangent",
    "SlotForce",
    "StencilForce",
    "StrongForce",
    "StrongTangent",
    "Sum",
    "SumMotion",
    "SumTangent",
    "Tangent",
    "assemble",
    "bond_weights",
    "convolution",
    "fix",
    "navier",
    "pivots",
]
