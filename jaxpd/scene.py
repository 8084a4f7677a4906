"""Scenes: what a problem is, not how it is solved.

A scene is data: body, material, cracks, supports, loads, and optionally a resolution.
Nothing here is traced, searched or solved; `jaxpd.prepare` does that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.conditions import Load, Start, Support
from jaxpd.geometry import Box, Cloud, Crack, HalfSpace, Region
from jaxpd.physics import elastic
from jaxpd.physics.influence import (
    Conical,
    Constant,
    Fractional,
    Gaussian,
    Influence,
    check_order,
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
            if value is not None and not np.all(np.asarray(value) > 0):
                raise ValueError(f"{name}: {value} must be positive, or None")


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
        if not (self.rho > 0 and self.s_crit > 0):
            raise ValueError(
                f"rho, s_crit: {self.rho}, {self.s_crit} must both be positive"
            )


@dataclass(frozen=True)
class Kernel:
    """An influence function by name, so that a scene stays data.

    Attributes:
        name: "fractional", "constant", "conical" or "gaussian".
        parameter: order alpha of the fractional kernel; decay length over horizon of
            the Gaussian.
    """

    name: str
    parameter: float = 0.0

    def __post_init__(self):
        """Refuse an unknown name."""
        known = ("fractional", "constant", "conical", "gaussian")
        if self.name not in known:
            raise ValueError(f"name: {self.name!r} must be one of {known}")

    def influence(self, d: int, delta: Any) -> Influence:
        """The influence function in d dimensions with horizon `delta` (m)."""
        if self.name == "fractional":
            return Fractional(self.parameter, d)
        if self.name == "constant":
            return Constant()
        if self.name == "conical":
            return Conical(delta)
        return Gaussian(self.parameter * delta)


def fractional(alpha: float) -> Kernel:
    """The kernel 1 / r^(d + alpha), alpha < 2; alpha = 1 - d is the PMB material."""
    check_order(alpha)
    return Kernel("fractional", float(alpha))


def constant() -> Kernel:
    """The influence function omega = 1."""
    return Kernel("constant")


def conical() -> Kernel:
    """The influence function omega = 1 - r / delta."""
    return Kernel("conical")


def gaussian(ratio: float = 1 / 3) -> Kernel:
    """The influence function exp(-(r / (ratio delta))^2)."""
    if not ratio > 0:
        raise ValueError(f"ratio: {ratio} must be positive")
    return Kernel("gaussian", float(ratio))


@dataclass(frozen=True)
class Bonds:
    """Bond-based peridynamics at a resolution.

    Attributes:
        dx: spacing of the lattice (m); None where the body is a cloud of points.
        m: horizon over spacing (-); give this or `delta`.
        delta: horizon (m).
        kernel: influence function: a `Kernel`, or any pytree of
            `jaxpd.physics.Influence`.
        partial: volume of neighbours at the rim of the horizon, "none", "linear" or
            "continuous"; see `jaxpd.geometry.family.find`.
        correction: surface correction, "none", "lattice", "analytic", "energy", "force
            density" or "fictitious"; see `jaxpd.discretize.surface`. None is "lattice"
            on a lattice, "analytic" on points from elsewhere.
        nodes: "edge" or "cell"; see `jaxpd.geometry.lattice`.
        layers: (below, above) layers of points outside the body, per axis. None puts
            m - 1 layers outside each face that lies on the plane of a half-space
            support of all components: with the face itself m rows, a volume constraint
            as thick as the horizon. Rollers get none: points outside that may slide
            would carry load of their own.
    """

    dx: float | None = None
    m: float | None = None
    delta: float | None = None
    kernel: Kernel | Influence = Kernel("fractional", 0.0)
    partial: str = "linear"
    correction: str | None = None
    nodes: str = "edge"
    layers: tuple[tuple[int, int], ...] | None = None

    @property
    def horizon(self) -> float:
        """Horizon (m), from `delta` or `m`.

        Raises:
            ValueError: unless exactly one of them is given, or without a spacing.
        """
        if (self.m is None) == (self.delta is None):
            raise ValueError(
                f"m: give exactly one of m (got {self.m}) and delta (got {self.delta})"
            )
        if self.delta is not None:
            if not self.delta > 0:
                raise ValueError(f"delta: {self.delta} must be positive (m)")
            return float(self.delta)
        if self.dx is None or not self.dx > 0:
            raise ValueError(f"dx: {self.dx} must be positive (m) where m is given")
        if not (self.m or 0) >= 1:
            raise ValueError(f"m: {self.m} must be at least 1; 3 to 8 is common")
        return float(self.m or 0) * self.dx


@dataclass(frozen=True, eq=False)
class Scene:
    """A problem of statics or of motion.

    Attributes:
        body: a `Box`, filled with a lattice, or a `Cloud`.
        material: `Elastic`, `Solid`, or any bond law (a pytree, see
            `jaxpd.physics.bond`).
        supports: prescribed displacements; later ones override earlier ones.
        loads: external forces; they add up.
        cracks: bonds that they cut are absent.
        resolution: how fine, and which nonlocal model.
        kinematics: "finite" displacements (Newton) or "small" (one linear solve).
        starts: displacements and velocities at time 0; later ones override.
        no_fail: regions whose bonds never break, for motion.
    """

    body: Box | Cloud
    material: Any
    supports: tuple[Support, ...] | list[Support] = ()
    loads: tuple[Load, ...] | list[Load] = ()
    cracks: tuple[Crack, ...] | list[Crack] = ()
    resolution: Bonds = Bonds()
    kinematics: str = "finite"
    starts: tuple[Start, ...] | list[Start] = ()
    no_fail: tuple[Region, ...] | list[Region] = ()

    def __post_init__(self):
        """Refuse words that mean nothing, and what is no list of the right things."""
        for name, kinds in (
            ("supports", Support),
            ("loads", Load),
            ("cracks", Crack),
            ("starts", Start),
            ("no_fail", Region),
        ):
            given = getattr(self, name)
            if not isinstance(given, tuple | list) or not all(
                isinstance(x, kinds) for x in given
            ):
                raise ValueError(f"{name}: {given!r} must be a list, as in [one, two]")
        if self.kinematics not in ("finite", "small"):
            raise ValueError(
                f"kinematics: {self.kinematics!r} must be 'finite' or 'small'"
            )

    @property
    def d(self) -> int:
        """Number of space dimensions."""
        return self.body.d if isinstance(self.body, Cloud) else len(self.body.lo)

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
