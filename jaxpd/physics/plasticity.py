"""Von Mises plasticity of one node: hardening, return mapping, consistent tangent.

Every function here acts on *one* node, is pure and undecorated; nothing here knows
about neighbours. Strains are small. Strain and stress are in Voigt notation with
engineering shear, [s] = [1] of a bar, [3] of a plane (xx, yy, xy), [6] of a solid (xx,
yy, zz, then the shears yz, xz, xy, in any order: the law is isotropic).

    strain_p  plastic strain, traceless: zz of a plane is -(xx + yy)    [s]   -
    peeq      equivalent plastic strain, sum of dgamma                  []    -
    dgamma    its growth in a step                                      []    -
    q         equivalent stress of the relative stress                  []    Pa
    Y         yield stress, hardening(peeq)                             []    Pa

A law has `history0()` and `step(strain, history) -> (stress, history)`; optional are
`tangent(strain, history)`, derived by hand, and `continuum(strain, history)`. The back
stress of Prager's rule is (2/3) h_kin strain_p as deviators (in a bar h_kin strain_p):
not stored. `jaxpd.physics.return_mapping` has the scalar equation of a step.

Where f = q - Y of the trial is at most 1e-10 Y the step is elastic: a committed state
unloads, and a point on the surface has the elastic block. Between the two the stress
has a kink; derivatives are finite everywhere, and those of the branch taken.

Sources: J. C. Simo, T. J. R. Hughes, Computational Inelasticity (1998), boxes 3.1-3.3;
J. C. Simo, R. L. Taylor, Comput. Methods Appl. Mech. Eng. 48 (1985) 101-118 (consistent
tangent); Int. J. Numer. Methods Eng. 22 (1986) 649-670 (plane stress); paper 001.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from jaxpd._types import Scalar
from jaxpd.checks import numbers
from jaxpd.physics import elastic
from jaxpd.physics.hardening import Linear
from jaxpd.physics.node import apply
from jaxpd.physics.return_mapping import modes, multiplier

#: How far beyond the surface, over the yield stress, a trial is still elastic.
ON_SURFACE = 1e-10


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Plastic:
    """All the memory of a node.

    Attributes:
        strain_p: plastic strain [s] (-), engineering shear.
        peeq: equivalent plastic strain [] (-).
    """

    strain_p: Any
    peeq: Scalar


class _Return(NamedTuple):
    """One return: rows A [r, s] (Pa), factors of modes, and what it came to."""

    M: Any
    T: Any
    A: Any
    z: Any
    kappa: Any
    Y: Scalar
    L: Any
    dgamma: Scalar
    plastic: Any
    mark: Scalar  # 1, or NaN where there is no answer


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class VonMises:
    """Associated flow, isotropic hardening of any shape, Prager's kinematic hardening.

    Made by `von_mises`, which checks the numbers. Leaves are numbers [].

    Attributes:
        E: Young's modulus (Pa), positive.
        nu: Poisson's ratio (-), None for a bar.
        hardening: pytree, yield stress (Pa) of peeq, differentiable by JAX.
        h_kin: kinematic hardening modulus (Pa), not negative.
        state: one of `jaxpd.physics.elastic.DIMENSIONS`.
    """

    E: Scalar
    nu: Scalar | None
    hardening: Callable[[Scalar], Scalar]
    h_kin: Scalar
    state: str = field(metadata={"static": True})

    def history0(self) -> Plastic:
        """No plastic strain."""
        s = {1: 1, 2: 3, 3: 6}[elastic.DIMENSIONS[self.state]]
        return Plastic(jnp.zeros(s), jnp.zeros(()))

    def stiffness(self) -> Any:
        """Elastic stiffness [s, s] (Pa)."""
        return elastic.stiffness(self.E, self.nu, self.state)

    @property
    def shear(self) -> Scalar:
        """Elastic shear modulus [] (Pa); of a bar E / 2."""
        return elastic.shear_modulus(self.E, self.nu, self.state)

    def _return(self, strain: Any, history: Plastic) -> _Return:
        M, share, T, k = modes(self.E, self.nu, self.state)
        kappa = T * T * k + self.h_kin
        A = (T * k * share)[:, None] * M
        p = apply(M, history.strain_p)
        z = apply(A, strain) - (T * k + self.h_kin / T) * p
        q2, Y = (z * z).sum(), self.hardening(history.peeq)
        slack = max(ON_SURFACE, 8.0 * float(jnp.finfo(z.dtype).eps))
        limit = ((1.0 + slack) * Y) ** 2
        plastic = q2 > limit
        # an elastic step solves, and drops, the problem of a point on the surface
        idle = jnp.zeros_like(z).at[-1].set(1.0) * Y
        z = jnp.where(plastic, z, idle)
        if isinstance(self.hardening, Linear) and self.state != "plane stress":
            slope = kappa[0] + self.hardening.h_iso
            dgamma, found = (jnp.sqrt((z * z).sum()) - Y) / slope, slope > 0
        else:
            dgamma, found = multiplier(z, kappa, self.hardening, history.peeq)
        dgamma = jnp.where(plastic, dgamma, 0.0)
        new = self.hardening(history.peeq + dgamma)
        good = (Y > 0) & ((q2 <= limit) | (plastic & found & (new > 0)))
        mark = jnp.where(good, 1.0, jnp.nan)
        L = new + kappa * dgamma
        return _Return(M, T, A, z, kappa, new, L, dgamma, plastic, mark)

    def step(self, strain: Any, history: Plastic) -> tuple[Any, Plastic]:
        """Backward Euler's stress [s] (Pa) at the strain [s], and the new memory.

        f <= 0 holds at the end, with equality where the step was plastic. All results
        are NaN where there is no answer: yield stress not positive before or after the
        step, softening faster than elasticity unloads, or no root found.
        """
        r = self._return(strain, history)
        grown = history.strain_p + apply(r.M.T, r.dgamma * r.T * r.z / r.L)
        # A^T / T: stress of a plastic strain, without the volume
        stress = apply(self.stiffness(), strain)
        stress = stress - apply((r.A / r.T[:, None]).T, apply(r.M, grown))
        memory = Plastic(r.mark * grown, r.mark * (history.peeq + r.dgamma))
        return r.mark * stress, memory

    def tangent(self, strain: Any, history: Plastic) -> Any:
        """Hand-derived consistent block dstress/dstrain [s, s] (Pa), symmetric.

        With m = z / L^2, C - A^T (diag(dgamma / L) + (Y - dgamma Y') m m^T / D) A and
        D = sum z^2 (Y' + kappa) / L^3. Checked against `jax.jacfwd` of the step.
        """
        r = self._return(strain, history)
        slope = jax.grad(self.hardening)(history.peeq + r.dgamma)
        m = r.z / r.L**2
        D = (m * m * r.L * (slope + r.kappa)).sum()
        along = ((r.Y - r.dgamma * slope) / D) * jnp.outer(m, m)
        return self._softened(r, jnp.diag(r.dgamma / r.L) + along)

    def continuum(self, strain: Any, history: Plastic) -> Any:
        """Elastoplastic block [s, s] (Pa) at the new state, the limit of small steps.

        C - A^T n n^T A / (Y' + sum n^2 kappa), n = z / L the direction of the stress.
        """
        r = self._return(strain, history)
        slope = jax.grad(self.hardening)(history.peeq + r.dgamma)
        n = r.z / r.L
        return self._softened(r, jnp.outer(n, n) / (slope + (n * n * r.kappa).sum()))

    def _softened(self, r: _Return, inner: Any) -> Any:
        """C - A^T inner A where the step was plastic, else C."""
        loss = jnp.matmul(r.A.T, jnp.matmul(inner, r.A, precision="highest"))
        return r.mark * (self.stiffness() - jnp.where(r.plastic, loss, 0.0))

    def out_of_plane(self, strain: Any, history: Plastic) -> Scalar:
        """Stress zz [] (Pa) of a plane at a strain [s], its memory after the step.

        Raises:
            ValueError: in a solid.
        """
        trace = strain[0:2].sum()
        zz = elastic.out_of_plane(self.E, self.nu, self.state, trace)
        flows = 2.0 if self.state == "plane strain" else 0.0
        return zz + flows * self.shear * history.strain_p[0:2].sum()


def von_mises(
    E: Scalar,
    nu: Scalar | None,
    sigma_y: Scalar | None = None,
    h_iso: Scalar = 0.0,
    h_kin: Scalar = 0.0,
    *,
    state: str,
    hardening: Callable[[Scalar], Scalar] | None = None,
) -> VonMises:
    """Von Mises' law with linear hardening, or with `hardening` in its place.

    Numbers that are traced are taken as they are.

    Args:
        E: Young's modulus [] or [n] (Pa).
        nu: Poisson's ratio (-), None for a bar.
        sigma_y: initial yield stress (Pa); with `hardening` it may be left out.
        h_iso: isotropic hardening modulus (Pa); below 0 it softens.
        h_kin: kinematic hardening modulus (Pa).
        state: one of `jaxpd.physics.elastic.DIMENSIONS`.
        hardening: pytree, yield stress (Pa) of peeq, for instance `Voce`.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    # numbers that are known stay so inside a trace
    with jax.ensure_compile_time_eval():
        _check(E, nu, sigma_y, h_iso, h_kin, state, hardening)
    law: Any = Linear(sigma_y, h_iso) if hardening is None else hardening
    return VonMises(E, nu, law, h_kin, state)


def _known(*values: Any) -> bool:
    return not any(isinstance(v, Tracer) for v in jax.tree.leaves(values))


def _check(
    E: Any, nu: Any, sigma_y: Any, h_iso: Any, h_kin: Any, state: str, hardening: Any
) -> None:
    for name, value in (("E", E), ("nu", nu), ("h_iso", h_iso), ("h_kin", h_kin)):
        if value is not None or name != "nu":
            numbers(name, value)
    if _known(E, nu):
        elastic.check(E, nu, state)
    if sigma_y is None and hardening is None:
        raise ValueError("sigma_y: None; give a yield stress (Pa), or a hardening")
    if sigma_y is not None:
        numbers("sigma_y", sigma_y, above=0, cure="in Pa")
    numbers("h_kin", h_kin, least=0, cure="h_iso may soften")
    if hardening is not None:
        leaves = jax.tree_util.tree_leaves_with_path(hardening)
        if not callable(hardening) or any(callable(leaf) for _, leaf in leaves):
            raise ValueError(
                f"hardening: {hardening!r} must be a pytree of numbers with __call__, "
                "as Voce: a frozen dataclass registered with "
                "jax.tree_util.register_dataclass"
            )
        for path, leaf in leaves:
            numbers(f"hardening{jax.tree_util.keystr(path)}", leaf)
        if not _known(h_iso) or np.any(np.asarray(h_iso) != 0):
            raise ValueError(
                f"h_iso: {h_iso} is linear hardening, which `hardening` "
                f"({type(hardening).__name__}) replaces; leave it out"
            )
        if not _known(hardening, sigma_y):
            return
        first = np.asarray(hardening(jnp.zeros(())))
        numbers("hardening", first, above=0, cure="the yield stress (Pa) at peeq = 0")
        if sigma_y is not None and not np.allclose(first, sigma_y, rtol=1e-6):
            raise ValueError(
                f"sigma_y: {sigma_y} differs from hardening(0) = {first}; leave "
                "sigma_y out"
            )
    elif _known(E, nu, h_iso, h_kin):
        _, _, T, k = modes(E, nu, state)
        least = -float(np.min((np.asarray(k).T * T**2).min(axis=-1) + h_kin))
        if not np.all(np.asarray(h_iso) > least):
            raise ValueError(
                f"h_iso: {h_iso} softens faster than elasticity unloads and leaves no "
                f"unique stress; set it above {least:g} (Pa)"
            )
