"""J2 plasticity at a point, by return mapping, for the peers of the plastic body.

Strains and stresses hold the components ``xx, yy, zz, xy``, the strains with the
engineering shear ``2 eps_xy``.  The yield surface is ``|dev(stress) - back| =
sqrt(2/3) (sigma_y + h_iso peeq)`` with Prager's ``back = 2/3 h_kin eps_p``, so in
uniaxial tension the plastic modulus is ``h_iso + h_kin``.  Steps are backward Euler.
Plane stress is the same three-dimensional map with Newton's method on ``eps_zz``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

_ONE = np.array([1.0, 1.0, 1.0, 0.0])
_DEVIATOR = np.diag([1.0, 1.0, 1.0, 0.5]) - np.outer(_ONE, _ONE) / 3.0
_TWICE = np.array([1.0, 1.0, 1.0, 2.0])  # counts the shear's two entries


@dataclass(frozen=True)
class Material:
    """Isotropic elasticity with von Mises plasticity, hardening linearly.

    Attributes:
        E: Young's modulus.
        nu: Poisson's ratio.
        sigma_y: Initial uniaxial yield stress; infinite for an elastic body.
        h_iso: Isotropic hardening modulus, over the equivalent plastic strain.
        h_kin: Kinematic hardening modulus (Prager), over the plastic strain.
    """

    E: float
    nu: float
    sigma_y: float = np.inf
    h_iso: float = 0.0
    h_kin: float = 0.0


@dataclass(frozen=True)
class State:
    """Internal variables: plastic strain ``[n, 4]`` and its equivalent ``[n]``."""

    plastic: FloatArray
    peeq: FloatArray

    @classmethod
    def virgin(cls, n: int) -> State:
        """No plastic strain yet, at ``n`` points."""
        return cls(np.zeros((n, 4)), np.zeros(n))


def mises(stress: FloatArray) -> FloatArray:
    """Equivalent stress of the components ``xx, yy, zz, xy`` on the last axis."""
    mean = stress[..., :3].mean(axis=-1, keepdims=True)
    return np.sqrt(1.5 * ((stress - mean * _ONE) ** 2 @ _TWICE))


def return_map(
    material: Material, strain: FloatArray, state: State
) -> tuple[FloatArray, State, FloatArray]:
    """Stress after a step to a given strain.

    Args:
        material: The material.
        strain: Total strain at the step's end, shape ``[n, 4]``.
        state: Internal variables at the step's start.

    Returns:
        The stress ``[n, 4]``, the new state and the consistent tangent
        ``[n, 4, 4]`` (stress over strain with the engineering shear).
    """
    mu = 0.5 * material.E / (1.0 + material.nu)
    bulk = material.E / (3.0 * (1.0 - 2.0 * material.nu))
    elastic = strain - state.plastic
    volume = elastic[:, :3].sum(axis=1, keepdims=True)
    trial = 2.0 * mu * elastic @ _DEVIATOR
    back = 2.0 / 3.0 * material.h_kin * state.plastic / _TWICE
    eta = trial - back
    norm = np.sqrt(eta**2 @ _TWICE)
    radius = np.sqrt(2.0 / 3.0) * (material.sigma_y + material.h_iso * state.peeq)
    stiff = 2.0 * mu + 2.0 / 3.0 * (material.h_iso + material.h_kin)
    flow = np.maximum(norm - radius, 0.0) / stiff
    yields = flow > 0.0
    safe = np.where(yields, norm, 1.0)
    normal = eta / safe[:, None]

    stress = bulk * volume * _ONE + trial - 2.0 * mu * flow[:, None] * normal
    new = State(
        state.plastic + flow[:, None] * normal * _TWICE,
        state.peeq + np.sqrt(2.0 / 3.0) * flow,
    )
    shrink = 2.0 * mu * flow / safe
    drop = np.where(yields, 2.0 * mu / stiff - shrink, 0.0)
    tangent = 2.0 * mu * (1.0 - shrink)[:, None, None] * _DEVIATOR
    tangent += bulk * np.outer(_ONE, _ONE)
    tangent -= (2.0 * mu * drop)[:, None, None] * normal[:, :, None] * normal[:, None]
    return stress, new, tangent


def plane_map(
    material: Material, strain: FloatArray, state: State, plane: str
) -> tuple[FloatArray, State, FloatArray]:
    """Stress after a step in plane strain or plane stress.

    Args:
        material: The material.
        strain: In-plane strain ``xx, yy, 2 xy`` at the step's end, ``[n, 3]``.
        state: Internal variables at the step's start.
        plane: ``"strain"`` or ``"stress"``.

    Returns:
        The stress ``[n, 4]``, the new state and the in-plane consistent tangent
        ``[n, 3, 3]``.

    Raises:
        RuntimeError: If the thickness strain of plane stress is not found.
    """
    inside = np.array([0, 1, 3])
    full = np.zeros((strain.shape[0], 4))
    full[:, inside] = strain
    if plane == "strain":
        stress, new, tangent = return_map(material, full, state)
        return stress, new, tangent[:, inside[:, None], inside]
    nu = material.nu
    elastic = strain[:, :2] - state.plastic[:, :2]
    full[:, 2] = state.plastic[:, 2] - nu / (1.0 - nu) * elastic.sum(axis=1)
    for _ in range(40):
        stress, new, tangent = return_map(material, full, state)
        step = stress[:, 2] / tangent[:, 2, 2]
        limit = 1e-14 + 4e-15 * np.abs(full).max(axis=1, initial=0.0)
        if np.all(np.abs(step) <= limit):
            break
        full[:, 2] -= step
    else:
        raise RuntimeError("plane stress: no thickness strain found")
    coupled = tangent[:, inside, 2]
    condensed = tangent[:, inside[:, None], inside] - (
        coupled[:, :, None] * coupled[:, None] / tangent[:, 2, 2, None, None]
    )
    stress[:, 2] = 0.0
    return stress, new, condensed
