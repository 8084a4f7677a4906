"""Classical elasticity: what a nonlocal law is calibrated against.

Four states of a solid, each with the number of dimensions that it is modelled in:

    "bar"           1-D   uniaxial stress, energy E e^2 / 2
    "plane stress"  2-D   per unit thickness
    "plane strain"  2-D   per unit thickness
    "solid"         3-D

A bond-based law has pair forces along the bonds alone and so one elastic constant: its
Poisson's ratio is 1/3 in plane stress, 1/4 in plane strain and in 3-D.
"""

from __future__ import annotations

from fractions import Fraction
from typing import Any

import jax.numpy as jnp

from jaxpd._types import Scalar
from jaxpd.checks import numbers, word

DIMENSIONS = {"bar": 1, "plane stress": 2, "plane strain": 2, "solid": 3}
#: The only Poisson's ratio of a bond-based law; a bar has none to speak of.
BOND_BASED_NU = {
    "plane stress": Fraction(1, 3),
    "plane strain": Fraction(1, 4),
    "solid": Fraction(1, 4),
}


def check(E: float, nu: float | None, state: str) -> None:
    """Refuse elastic constants that no stable isotropic solid has.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    word("state", state, DIMENSIONS)
    numbers("E", E, above=0, cure="in Pa")
    if state != "bar":
        limit = 0.5 if state != "plane stress" else 1.0
        numbers("nu", nu, above=-1, below=limit, cure=f"it is so in {state}")
    elif nu is not None:
        numbers("nu", nu, cure="a bar has none, leave it out")


def check_bond_based(nu: float | None, state: str) -> None:
    """Refuse a Poisson's ratio that a bond-based law cannot have.

    Raises:
        ValueError: naming the ratio that it has.
    """
    if state in BOND_BASED_NU:
        only = BOND_BASED_NU[state]
        if nu is None or abs(nu - float(only)) > 1e-6:
            raise ValueError(
                f"nu: {nu} is out of reach of a bond-based law, whose pair forces fix "
                f"Poisson's ratio at {only} in {state}; set nu={only}, or use a theory "
                "with two constants (MLS difference, RKPM)"
            )


def dilation_energy(E: Scalar, nu: float | None, state: str) -> Scalar:
    """Strain energy density W / e^2 (Pa) under the same strain e in all d directions.

    2 k' in the notation of paper 000, eq. 14.
    """
    if state == "bar":
        return 0.5 * E
    if nu is None:
        raise ValueError(f"nu: None; {state} needs a Poisson's ratio")
    if state == "plane stress":
        return E / (1.0 - nu)
    if state == "plane strain":
        return E / (1.0 - nu - 2.0 * nu**2)
    return 1.5 * E / (1.0 - 2.0 * nu)


def confined_modulus(E: Scalar, nu: float | None, state: str) -> Scalar:
    """Stress over strain C_1111 (Pa) along an axis, all other strains zero."""
    if state == "bar":
        return E
    if nu is None:
        raise ValueError(f"nu: None; {state} needs a Poisson's ratio")
    if state == "plane stress":
        return E / (1.0 - nu**2)
    return E * (1.0 - nu) / ((1.0 + nu) * (1.0 - 2.0 * nu))


def shear_modulus(E: Scalar, nu: Scalar | None, state: str) -> Scalar:
    """Shear modulus (Pa); of a bar E / 2, that of nu = 0."""
    if state == "bar":
        return 0.5 * E
    if nu is None:
        raise ValueError(f"nu: None; {state} needs a Poisson's ratio")
    return E / (2.0 * (1.0 + nu))


def lame(E: Scalar, nu: Scalar | None) -> Scalar:
    """Lame's first constant (Pa) of a solid; infinite from nu = 0.5 on."""
    if nu is None:
        raise ValueError("nu: None; a solid needs a Poisson's ratio")
    below = jnp.asarray(nu) < 0.5
    safe: Any = jnp.where(below, nu, 0.0)  # where of a where: finite derivatives
    return jnp.where(below, E * safe / ((1.0 + safe) * (1.0 - 2.0 * safe)), jnp.inf)


def stiffness(E: Scalar, nu: Scalar | None, state: str) -> Any:
    """Stiffness in Voigt notation [1, 1], [3, 3] or [6, 6] (Pa), engineering shear.

    E and nu may be traced. Isotropic, hence the same for any order of the shears.
    """
    if state == "bar":
        return jnp.reshape(jnp.asarray(E), (1, 1))
    shear = shear_modulus(E, nu, state)
    if state == "plane stress" and nu is not None:
        lam = E * nu / (1.0 - nu**2)
    else:
        lam = lame(E, nu)
    d = DIMENSIONS[state]
    n_shear = d * (d - 1) // 2
    normal = lam * jnp.ones((d, d)) + 2.0 * shear * jnp.eye(d)
    return jnp.block(
        [
            [normal, jnp.zeros((d, n_shear))],
            [jnp.zeros((n_shear, d)), shear * jnp.eye(n_shear)],
        ]
    )


def out_of_plane(E: Scalar, nu: Scalar | None, state: str, trace: Scalar) -> Scalar:
    """Elastic stress zz [] (Pa): lam (xx + yy) in plane strain, else 0.

    Raises:
        ValueError: in a solid, whose stress has a zz of its own.
    """
    if state == "solid":
        raise ValueError("state: 'solid' has no plane; its stress zz is stress[2]")
    return lame(E, nu) * trace if state == "plane strain" else jnp.zeros_like(trace)
