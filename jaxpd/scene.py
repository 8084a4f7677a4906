"""Scenes: what a problem is, not how it is solved.

A scene is data: body, material, cracks, supports, loads, and optionally a resolution.
Nothing here is traced, searched or solved; `jaxpd.prepare` does that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from jaxpd.checks import instance, numbers, word
from jaxpd.conditions import Load, Start, Support
from jaxpd.geometry import Box, Cloud, Crack, HalfSpace, Region
from jaxpd.laminate import Laminate
from jaxpd.physics import elastic
from jaxpd.resolution import NODES, Bonds


def check_law(name: str, law: Any) -> None:
    """Refuse a law that is no pytree of numbers, as bonds and nodes need.

    Raises:
        ValueError: naming the number that is none.
    """
    for path, leaf in jax.tree_util.tree_leaves_with_path(law):
        if not path and not isinstance(leaf, Tracer):
            raise ValueError(
                f"{name}: {law!r} must be Elastic, Solid or a law: a frozen dataclass "
                "of numbers registered with jax.tree_util.register_dataclass"
            )
        numbers(f"{name}{jax.tree_util.keystr(path)}", leaf, endless=True)
    if not any(hasattr(law, how) for how in ("energy", "force", "step", "advance")):
        raise ValueError(
            f"{name}: {law!r} must be Elastic, or a law with a method energy(xi, eta) "
            "or force(xi, eta); of nodes step(strain, history)"
        )


@dataclass(frozen=True)
class Elastic:
    """Linear elastic isotropic material.

    Attributes:
        E: Young's modulus (Pa), positive.
        nu: Poisson's ratio (-); None for a bar. Bond-based laws have 1/3 in plane
            stress, 1/4 in plane strain and in 3-D, and refuse others.
        state: "bar", "plane stress", "plane strain" or "solid".
        rho: density (kg/m^3), for motion; 1-D and 2-D bodies are 1 m thick.
        G0: fracture energy (J/m^2), from which bonds have their critical stretch; None
            never breaks.
    """

    E: float
    nu: float | None = None
    state: str = "solid"
    rho: float | None = None
    G0: float | None = None

    def __post_init__(self):
        """Refuse constants that no stable solid has."""
        elastic.check(self.E, self.nu, self.state)
        for name, value in (("rho", self.rho), ("G0", self.G0)):
            if value is not None:
                numbers(name, value, above=0, endless=name == "G0", cure="or None")


@dataclass(frozen=True, eq=False)
class Solid:
    """Any bond law with what motion needs.

    Attributes:
        law: a bond law (`jaxpd.physics.bond`), or one with a memory
            (`jaxpd.physics.damage`), which then says itself when bonds break.
        rho: density (kg/m^3).
        s_crit: critical stretch (-) of a law without memory; inf never breaks.
    """

    law: Any
    rho: float
    s_crit: float = math.inf

    def __post_init__(self):
        """Refuse a solid without mass or strength."""
        numbers("rho", self.rho, above=0, cure="in kg/m^3")
        numbers("s_crit", self.s_crit, above=0, endless=True)
        check_law("law", self.law)


@dataclass(frozen=True, eq=False)
class Scene:
    """A problem of statics or of motion.

    Attributes:
        body: a `Box`, filled with a lattice, a `Cloud`, or a `Laminate` of boxes.
        material: `Elastic`, `Solid`, or any bond law (a pytree, see
            `jaxpd.physics.bond`); with `MLS` any law of one node, as
            `jaxpd.von_mises` (see `jaxpd.physics.plasticity`); of a laminate one for
            all plies, or a list.
        supports: prescribed displacements; later ones override earlier ones.
        loads: external forces; they add up.
        cracks: bonds that they cut are absent.
        resolution: how fine, and which nonlocal model; of a laminate one for all
            plies, or a list.
        kinematics: "finite" displacements (Newton) or "small" (one linear solve);
            nodes (`MLS`) are for small ones, whatever is said.
        starts: displacements and velocities at time 0; later ones override.
        no_fail: regions whose bonds never break, for motion and fracture.
        weak: surfaces that alone may fail, for `solve_fracture`: bonds that cross none
            of them never break. Empty: all may.
    """

    body: Box | Cloud | Laminate
    material: Any
    supports: tuple[Support, ...] | list[Support] = ()
    loads: tuple[Load, ...] | list[Load] = ()
    cracks: tuple[Crack, ...] | list[Crack] = ()
    resolution: Any = field(default_factory=Bonds)
    kinematics: str = "finite"
    starts: tuple[Start, ...] | list[Start] = ()
    no_fail: tuple[Region, ...] | list[Region] = ()
    weak: tuple[Crack, ...] | list[Crack] = ()

    def __post_init__(self):
        """Refuse words that mean nothing, and what is no list of the right things."""
        for name, kinds in (
            ("supports", Support),
            ("loads", Load),
            ("cracks", Crack),
            ("starts", Start),
            ("no_fail", Region),
            ("weak", Crack),
        ):
            given = getattr(self, name)
            if not isinstance(given, tuple | list) or not all(
                isinstance(x, kinds) for x in given
            ):
                raise ValueError(f"{name}: {given!r} must be a list, as in [one, two]")
        how = "a box(..), a cloud of points as lattice(..), or a laminate(..)"
        instance("body", self.body, Box | Cloud | Laminate, how)
        plies = len(self.body.plies) if isinstance(self.body, Laminate) else None
        for name in ("material", "resolution"):
            given = getattr(self, name)
            if type(given) in (tuple, list) and len(given) != plies:
                raise ValueError(
                    f"{name}: a list of {len(given)} is for a laminate of as many "
                    f"plies, and the body has {plies or 'none'}"
                )
        several = type(self.material) in (tuple, list)
        for material in self.material if several else (self.material,):
            if not isinstance(material, Elastic | Solid):
                check_law("material", material)
        several = type(self.resolution) in (tuple, list)
        for resolution in self.resolution if several else (self.resolution,):
            instance("resolution", resolution, (Bonds, *NODES), "Bonds, MLS or RKPM")
        if isinstance(self.resolution, NODES):
            object.__setattr__(self, "kinematics", "small")
        word("kinematics", self.kinematics, ("finite", "small"))

    @property
    def d(self) -> int:
        """Number of space dimensions."""
        return len(self.body.lo) if isinstance(self.body, Box) else self.body.d

    def layers(self) -> tuple[tuple[int, int], ...]:
        """Layers of points outside the body, per axis and side."""
        if self.resolution.layers is not None:
            return self.resolution.layers
        count = np.zeros((self.d, 2), int)
        if isinstance(self.body, Box) and self.resolution.dx is not None:
            depth = round(self.resolution.horizon / self.resolution.dx)
            for support in self.supports:
                plane = support.region
                if not isinstance(plane, HalfSpace) or plane.axis >= self.d:
                    continue
                if None in support.components[: self.d]:
                    continue  # points that may slide would carry load of their own
                faces = (self.body.lo[plane.axis], self.body.hi[plane.axis])
                side = 0 if plane.sign < 0 else 1
                if abs(faces[side] - plane.at) <= 1e-9 * abs(faces[1] - faces[0]):
                    count[plane.axis, side] = depth - (self.resolution.nodes == "edge")
        return tuple((int(a), int(b)) for a, b in count)
