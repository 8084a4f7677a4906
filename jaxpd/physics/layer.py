"""Plane waves through a thin layer between two half-spaces: exact coefficients.

    u = exp(i (k x - w t)) + R exp(-i (k x + w t)) in front, T exp(i (k x - w t)) behind

both taken at the faces of the layer. Z = rho c is an impedance (Pa s/m). Displacements,
so that R of a free surface is +1.

Source: any text on acoustics; L. M. Brekhovskikh, Waves in Layered Media (1960).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Complex = NDArray[np.complexfloating]


def slab(
    omega: ArrayLike, E: float, rho: float, E_l: float, rho_l: float, h: float
) -> tuple[Complex, Complex]:
    """Reflection and transmission of a layer with mass and stiffness.

    Args:
        omega: angular frequencies [w] (1/s).
        E: modulus of both half-spaces (Pa): the one that the wave sees.
        rho: their density (kg/m^3).
        E_l: modulus of the layer (Pa).
        rho_l: density of the layer (kg/m^3).
        h: its thickness (m).

    Returns:
        R and T [w].
    """
    w = np.asarray(omega, float)
    Z, Z_l = np.sqrt(E * rho), np.sqrt(E_l * rho_l)
    kh = w * h * np.sqrt(rho_l / E_l)
    T = 1.0 / (np.cos(kh) - 0.5j * (Z / Z_l + Z_l / Z) * np.sin(kh))
    return 0.5j * (Z_l / Z - Z / Z_l) * np.sin(kh) * T, T


def spring(omega: ArrayLike, E: float, rho: float, K: float) -> tuple[Complex, Complex]:
    """Reflection and transmission of springs of stiffness K (N/m^3) without mass.

    The limit of `slab` for K = E_l / h without mass: T = 1 / (1 - i w tau), with tau =
    Z / (2 K).
    """
    delay = -1j * np.asarray(omega, float) * np.sqrt(E * rho) / (2.0 * K)
    return delay / (1.0 + delay), 1.0 / (1.0 + delay)


def through(
    signal: ArrayLike, dt: float, coefficient: ArrayLike
) -> NDArray[np.floating]:
    """What becomes of a signal in time whose frequencies are multiplied.

    Args:
        signal: samples [n], zero towards both ends.
        dt: between them (s).
        coefficient: R or T at the frequencies of `frequencies(n, dt)`.
    """
    signal = np.asarray(signal, float)
    return np.fft.irfft(np.fft.rfft(signal) * np.conj(coefficient), n=len(signal))


def frequencies(n: int, dt: float) -> NDArray[np.floating]:
    """Angular frequencies (1/s) of n samples, dt apart, for `through`."""
    return 2.0 * np.pi * np.fft.rfftfreq(n, dt)
