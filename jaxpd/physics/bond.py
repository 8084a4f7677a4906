"""Bond laws: energy, force and tangent of a single bond.

Every function here acts on *one* bond; `jaxpd.operators` maps it over families and
sums. Nothing here knows about neighbours, volumes or solvers, and nothing is decorated:
`jax.jacfwd` of a force is the force's own derivative.

    xi   reference bond vector X' - X              [d]     m
    eta  relative displacement u' - u              [d]     m
    y    deformed bond vector xi + eta             [d]     m
    M    its direction y / |y|                     [d]     -
    e    extension |y| - |xi|                      []      m
    s    stretch e / |xi|                          []      -

A law is a frozen pytree with one method, `energy(xi, eta)` (micropotential w, J/m^6 in
3-D) or `force(xi, eta)` (pair force density f, N/m^6 in 3-D), f = dw/deta: the pull on
the point at the tail of the bond. Three more methods are optional: `tangent(xi, eta)`,
the hand-derived block df/deta; `axial(xi, eta)`, its positive part; and `rest(xi)`, the
blocks at eta = 0 of many bonds at once, [.., d] to [.., d, d], in NumPy or JAX. Leaves
of a law are shared [], nodal [n] (a bond takes the mean of its ends) or per bond
[k, n].

Domain: |xi| > 0 and |y| > 0; a bond squeezed to nothing has no direction.
Sources: paper 000, eqs. 7-20; S. A. Silling, E. Askari, Comput. Struct. 83 (2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointScalar, Scalar, Tensor, Vector
from jaxpd.checks import number, numbers, word
from jaxpd.physics import elastic
from jaxpd.physics.elastic import dilation_energy
from jaxpd.physics.influence import Fractional, Influence, moment

#: Surface of the unit sphere in d dimensions: both ends of a line, circle, sphere.
SPHERE = {1: 2.0, 2: 2.0 * math.pi, 3: 4.0 * math.pi}


def dot(a: Vector, b: Vector) -> Scalar:
    """Inner product, written out: mapped over bonds it compiles to faster code."""
    return sum((a[i] * b[i] for i in range(1, a.shape[0])), start=a[0] * b[0])


def extension(xi: Vector, eta: Vector) -> tuple[Scalar, Vector]:
    """Extension e (m) and direction M of a bond, free of cancellation for small eta.

    |y|^2 - |xi|^2 = eta . (2 xi + eta): the difference of the lengths is never formed.
    """
    y = xi + eta
    # sqrt, not linalg.norm, which breaks the complex step
    length, r = jnp.sqrt(dot(xi, xi)), jnp.sqrt(dot(y, y))
    return dot(eta, 2.0 * xi + eta) / (r + length), y / r


def stretch(xi: Vector, eta: Vector) -> Scalar:
    """Stretch s = (|xi + eta| - |xi|) / |xi| (-) of a bond."""
    return extension(xi, eta)[0] / jnp.sqrt(dot(xi, xi))


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Microelastic:
    """Force proportional to the extension, f = c omega(|xi|) e M (paper 000, eq. 7).

    Attributes:
        c: micromodulus [], [n] or [k, n], positive. c omega e, with e in m, is a force
            per volume squared: N/m^6 in 3-D; N/m^4 over a thickness of 1 m in 2-D.
        omega: influence function, a pytree.
    """

    c: Scalar | PointScalar
    omega: Influence

    def energy(self, xi: Vector, eta: Vector) -> Scalar:
        """Micropotential w = c omega e^2 / 2 (paper 000, eq. 10)."""
        e, _ = extension(xi, eta)
        return 0.5 * self.c * self.omega(jnp.sqrt(dot(xi, xi))) * e * e

    def force(self, xi: Vector, eta: Vector) -> Vector:
        """Pair force density f = c omega e M, the derivative of the energy."""
        e, M = extension(xi, eta)
        return self.c * self.omega(jnp.sqrt(dot(xi, xi))) * e * M

    def rest(self, xi: Any) -> Any:
        """Blocks at rest [..., d, d] of bond vectors [..., d]: c omega n n^T.

        In NumPy where everything is NumPy's, so that nothing has to be compiled.
        """
        length = ((xi * xi).sum(axis=-1)) ** 0.5
        n = xi / length[..., None]
        size = self.c * self.omega(length)
        return size[..., None, None] * n[..., :, None] * n[..., None, :]

    def axial(self, xi: Vector, eta: Vector) -> Tensor:
        """Axial part of the tangent, c omega M M^T: all of paper 000's eq. 20."""
        _, M = extension(xi, eta)
        return self.c * self.omega(jnp.sqrt(dot(xi, xi))) * jnp.outer(M, M)

    def tangent(self, xi: Vector, eta: Vector) -> Tensor:
        """Hand-derived block df/deta = c omega (M M^T + e / |y| (I - M M^T)).

        Checked against `jax.jacfwd` of the force. The second term is geometric: zero
        at rest, negative in compression, where the stiffness may lose definiteness.
        """
        e, M = extension(xi, eta)
        y = xi + eta
        MM = jnp.outer(M, M)
        turn = (e / jnp.sqrt(dot(y, y))) * (jnp.eye(xi.shape[0], dtype=MM.dtype) - MM)
        return self.c * self.omega(jnp.sqrt(dot(xi, xi))) * (MM + turn)


def micromodulus(
    E: Scalar | PointScalar,
    nu: float | None,
    state: str,
    d: int,
    delta: Scalar,
    omega: Influence,
) -> Scalar | PointScalar:
    """Micromodulus c that gives the classical energy under an equal strain e.

    The energy density of a whole neighbourhood is W = c e^2 S_d I / 4 with S_d the unit
    sphere and I = int omega r^(d+1) dr (paper 000, eqs. 10-12), hence
    c = 4 (W / e^2) / (S_d I). In 2-D with the fractional kernel that is eq. 13,
    c = 4 k' (2 - alpha) / (pi delta^(2 - alpha)); at alpha = 1 - d it is the PMB
    constant of paper 002, eq. 6.

    Args:
        E: Young's modulus [] or [n] (Pa).
        nu: Poisson's ratio (-), None for a bar.
        state: one of `jaxpd.physics.elastic.DIMENSIONS`.
        d: space dimensions.
        delta: horizon (m).
        omega: influence function.
    """
    return 4.0 * dilation_energy(E, nu, state) / (SPHERE[d] * moment(omega, d, delta))


def pmb(
    E: Scalar | PointScalar, nu: float | None, state: str, d: int, delta: Scalar
) -> Microelastic:
    """The prototype microelastic material f = c s M with its calibrated constant.

    Args:
        E: Young's modulus [] or [n] (Pa).
        nu: Poisson's ratio (-) that bonds have in the state, None for a bar.
        state: one of `jaxpd.physics.elastic.DIMENSIONS`.
        d: space dimensions.
        delta: horizon (m).

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    numbers("E", E, above=0, cure="in Pa")
    word("state", state, elastic.DIMENSIONS)
    if d is True or d != elastic.DIMENSIONS[state]:
        raise ValueError(f"d: {d!r}; {state!r} is {elastic.DIMENSIONS[state]}-D")
    number("delta", delta, above=0, cure="in m")
    if nu is not None:
        number("nu", nu)
    elastic.check_bond_based(nu, state)
    omega = Fractional(jnp.asarray(1.0 - d), d)
    return Microelastic(micromodulus(E, nu, state, d, delta, omega), omega)


def bond_energy(law: Any, xi: Vector, eta: Vector) -> Scalar:
    """Micropotential of a bond.

    Raises:
        ValueError: if the law has no `energy`.
    """
    if not hasattr(law, "energy"):
        raise ValueError(
            f"law: {type(law).__name__} has no energy(xi, eta); a law given by its "
            "force alone has no stored energy to report"
        )
    return law.energy(xi, eta)


def bond_force(law: Any, xi: Vector, eta: Vector) -> Vector:
    """Pair force density: the law's `force`, or `jax.grad` of its `energy`."""
    if hasattr(law, "force"):
        return law.force(xi, eta)
    return jax.grad(bond_energy, argnums=2)(law, xi, eta)


def bond_block(law: Any, xi: Vector, eta: Vector, how: str = "ad") -> Tensor:
    """Tangent block df/deta [d, d] of a bond.

    Args:
        law: a bond law.
        xi: reference bond vector (m).
        eta: relative displacement (m).
        how: "ad" is `jax.jacfwd` of the force; "hand" the law's own `tangent`; "axial"
            the law's `axial` part alone, never negative (paper 000, eq. 20).

    Raises:
        ValueError: if the law lacks the method asked for.
    """
    if how == "ad":
        return jax.jacfwd(bond_force, argnums=2)(law, xi, eta)
    method = {"hand": "tangent", "axial": "axial"}.get(how)
    if method is None:
        raise ValueError(f"tangent: {how!r} must be 'ad', 'hand' or 'axial'")
    if not hasattr(law, method):
        raise ValueError(
            f"tangent: {how!r} needs a method {method}(xi, eta), which "
            f"{type(law).__name__} does not have; use 'ad'"
        )
    return getattr(law, method)(xi, eta)
