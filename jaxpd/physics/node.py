"""Laws of one node: stress of a strain and a memory, and the block of a step.

What `jaxpd.physics.bond` is to bonds, for the theories with a strain at each node (MLS
difference, RKPM). Strain and stress are in Voigt notation with engineering shear, [s]:

    [1]  bar     xx
    [3]  plane   xx, yy, xy
    [6]  solid   xx, yy, zz, then the shears yz, xz, xy

No law here tells one shear of a solid from another: any order will do. A law is a
frozen pytree whose leaves are numbers [], pure and undecorated, with

    history0()               memory of an untouched node, a pytree
    step(strain, history)    stress [s] (Pa) at the strain and the new memory
    tangent(strain, history)    hand-derived dstress/dstrain [s, s] (Pa); optional
    continuum(strain, history)  that of an infinitely small step; optional
    shear                    elastic shear modulus [] (Pa), a property or a leaf
    symmetric                whether dstress/dstrain is; optional, False where missing

`Hooke` has no memory; `jaxpd.physics.plasticity` has von Mises' law.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import Scalar
from jaxpd.physics.elastic import out_of_plane, shear_modulus, stiffness


def apply(matrix: Any, vector: Any) -> Any:
    """Matrix times vector in full precision, on a GPU too, in the vector's type."""
    return jnp.matmul(jnp.asarray(matrix, vector.dtype), vector, precision="highest")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Hooke:
    """Linear elasticity of one node, without memory: its history is ().

    Strain and stress in Voigt notation with engineering shear, [1] of a bar, [3] of a
    plane (xx, yy, xy), [6] of a solid (xx, yy, zz, then the shears yz, xz, xy).

    Attributes:
        E: Young's modulus [] (Pa), positive.
        nu: Poisson's ratio [] (-), None for a bar; `elastic.check` says which.
        state: one of `jaxpd.physics.elastic.DIMENSIONS`.
    """

    E: Scalar
    nu: Scalar | None
    state: str = field(metadata={"static": True})

    def history0(self) -> tuple[()]:
        """No memory."""
        return ()

    def stiffness(self) -> Any:
        """Elastic stiffness [s, s] (Pa)."""
        return stiffness(self.E, self.nu, self.state)

    @property
    def shear(self) -> Scalar:
        """Elastic shear modulus [] (Pa); of a bar E / 2."""
        return shear_modulus(self.E, self.nu, self.state)

    def step(self, strain: Any, history: tuple[()] = ()) -> tuple[Any, tuple[()]]:
        """Stress [s] (Pa) at the strain [s], and no memory."""
        return apply(self.stiffness(), strain), history

    def tangent(self, strain: Any, history: tuple[()] = ()) -> Any:
        """The elastic stiffness, whatever the strain."""
        return self.stiffness()

    def continuum(self, strain: Any, history: tuple[()] = ()) -> Any:
        """The elastic stiffness, whatever the strain."""
        return self.stiffness()

    def out_of_plane(self, strain: Any, history: tuple[()] = ()) -> Scalar:
        """Stress zz [] (Pa) of a plane or a bar."""
        return out_of_plane(self.E, self.nu, self.state, strain[0:2].sum())


def tangent_block(law: Any, strain: Any, history: Any, how: str = "ad") -> Any:
    """Block dstress/dstrain [s, s] (Pa) of a node over a step.

    Args:
        law: a law of one node.
        strain: strain [s] at the end of the step.
        history: memory at its start.
        how: "ad" is `jax.jacfwd` of the step's stress; "hand" the law's own `tangent`;
            "continuum" that of an infinitely small step at the new state.

    Raises:
        ValueError: if the law lacks the method asked for.
    """
    if how == "ad":
        return jax.jacfwd(lambda e: law.step(e, history)[0])(strain)
    method = {"hand": "tangent", "continuum": "continuum"}.get(how)
    if method is None:
        raise ValueError(f"tangent: {how!r} must be 'ad', 'hand' or 'continuum'")
    if not hasattr(law, method):
        raise ValueError(
            f"tangent: {how!r} needs a method {method}(strain, history), which "
            f"{type(law).__name__} does not have; use 'ad'"
        )
    return getattr(law, method)(strain, history)


def von_mises_stress(stress: Any, zz: Scalar = 0.0) -> Scalar:
    """Equivalent stress [] (Pa) of a stress [1], [3] or [6]; zz of a plane is given.

    Its derivative does not exist where the deviator is zero.
    """
    if stress.shape[0] == 1:
        return jnp.abs(stress[0] - zz)
    normal = stress[:3] if stress.shape[0] == 6 else jnp.stack([*stress[:2], zz])
    shears = stress[3:] if stress.shape[0] == 6 else stress[2:]
    apart = normal - jnp.roll(normal, 1)
    return jnp.sqrt(0.5 * (apart * apart).sum() + 3.0 * (shears * shears).sum())
