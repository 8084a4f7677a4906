"""How fine a body is modelled, and by which nonlocal model: a scene's resolution.

Bonds of peridynamics with their influence function, or nodes with moving least
squares. Data alone, like all of a scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.checks import instance, number, whole, word
from jaxpd.discretize.schemes import SCHEMES
from jaxpd.discretize.surface import CORRECTIONS
from jaxpd.geometry import Box
from jaxpd.geometry.cloud import check_layers
from jaxpd.geometry.family import PARTIAL_RULES
from jaxpd.physics.influence import (
    Conical,
    Constant,
    Fractional,
    Gaussian,
    Influence,
    check_order,
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
        word("name", self.name, known)
        number("parameter", self.parameter)

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
    number("ratio", ratio, above=0, cure="1/3 is common")
    return Kernel("gaussian", float(ratio))


def _positive(resolution: Any, *names: str) -> None:
    """Refuse lengths that are given and not positive."""
    for name in names:
        if getattr(resolution, name) is not None:
            number(name, getattr(resolution, name), above=0, cure="in m")


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
        calibration: "continuum", the micromodulus of the integral over a whole
            neighbourhood; or "lattice", scaled so that the lattice's bulk has the
            classical energy under an equal strain, as it else lacks 7 to 13 %.
    """

    dx: float | None = None
    m: float | None = None
    delta: float | None = None
    kernel: Kernel | Influence = Kernel("fractional", 0.0)
    partial: str = "linear"
    correction: str | None = None
    nodes: str = "edge"
    layers: tuple[tuple[int, int], ...] | None = None
    calibration: str = "continuum"

    def __post_init__(self):
        """Refuse numbers and words out of range."""
        _positive(self, "dx", "delta")
        if self.m is not None:
            number("m", self.m, least=1, cure="3 to 8 is common")
        instance(
            "kernel", self.kernel, Kernel | Influence, "a kernel, as fractional(0.0)"
        )
        word("partial", self.partial, PARTIAL_RULES)
        word("nodes", self.nodes, ("edge", "cell"))
        word("calibration", self.calibration, ("continuum", "lattice"))
        if self.layers is not None:
            check_layers(self.layers, len(self.layers) or 1)
        if self.dx is not None and (self.delta or self.dx) < self.dx * (1 - 1e-9):
            raise ValueError(
                f"delta: {self.delta} is within the spacing {self.dx} and bonds nothing"
            )
        if self.correction is not None:
            word("correction", self.correction, CORRECTIONS, "None is the default")

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
            return float(self.delta)
        if self.dx is None:
            raise ValueError("dx: None; where m is given a spacing is needed (m)")
        return float(self.m or 0) * self.dx


def check_horizon(resolution: Bonds, body: Box) -> None:
    """Refuse a horizon that is longer than a body, whose units then are wrong.

    Raises:
        ValueError: naming what the horizon was given by.
    """
    size = float(np.linalg.norm(np.subtract(body.hi, body.lo)))
    if resolution.horizon > size * (1.0 + 1e-9):
        name = "delta" if resolution.m is None else "m"
        raise ValueError(
            f"{name}: the horizon {resolution.horizon:g} m is longer than the body, "
            f"{size:g} m from corner to corner; make it shorter, and look at the units"
        )


@dataclass(frozen=True)
class RKPM:
    """Reproducing kernels with nodal integration: weak form, small strains (paper 004).

    Supports are over the local spacing (`jaxpd.discretize.rkpm`), and grow where the
    moments at a place are badly conditioned.

    Attributes:
        dx: spacing of the nodes in a box (m); None where the body is a cloud with a
            rim, as made by `jaxpd.mapped` and `jaxpd.outlined`.
        scheme: of integration, a name in `jaxpd.discretize.schemes`; the default is
            made from nodes and outline alone, passes linear and quadratic patch tests
            (held edges straight) and is symmetric. "MNI" is paper 004's.
        degree: of the basis, 1 to 3. The consistent schemes of second order ask for 2,
            and integrate too little for 3 to gain anything.
        support: radius of a kernel; 2.3 to 3 is sound, see `tests/stability`.
        alpha: strength of the residual stabilisation of "NIS" (-).
    """

    dx: float | None = None
    scheme: str = "QCNI"
    degree: int = 2
    support: float = 2.6
    alpha: float = 0.05

    def __post_init__(self):
        """Refuse numbers and words out of range."""
        _positive(self, "dx")
        word("scheme", self.scheme, SCHEMES)
        if whole("degree", self.degree) not in (1, 2, 3):
            raise ValueError(f"degree: {self.degree} must be 1, 2 or 3; 2 is common")
        if self.degree < 2 and SCHEMES[self.scheme].stabilisation != "none":
            raise ValueError(
                f"degree: {self.degree} has no second derivatives, which the scheme "
                f"{self.scheme!r} needs; use 2"
            )
        number("support", self.support, above=1, cure="spacings; 2.3 to 3 is common")
        number("alpha", self.alpha, least=0)


@dataclass(frozen=True)
class MLS:
    """The MLS difference method: strong form at nodes, small strains (paper 001).

    Supports are over the local spacing (`jaxpd.discretize.spacing`), and grow where the
    moments of a star are badly conditioned. The defaults hold where the paper's own
    form does not; that one is `jaxpd.gallery.PAPER`. Cells must be near square: along a
    hole with cells two to four times as long as wide displacements may alternate; look
    at `Path.rough`.

    Attributes:
        dx: spacing of the nodes in a box (m); None where the body is a cloud with a
            rim, as made by `jaxpd.mapped`.
        degree: of the polynomials, 2 or more.
        support: radius of a star; None is 4.1, in 3-D 3.1.
        rim_support: that of a node on the boundary, whose star is one-sided; None is
            4.1.
        tau: strength of the filter against displacements that alternate from node to
            node; 0 is none. It needs wide stars: at a support of 2.5 it hardly holds.
            Where the material jumps it disturbs the stress.
        scheme: "double", derivatives of stresses that come of derivatives; "midpoint",
            stresses halfway between the nodes of a bar; "direct", second derivatives of
            displacements, for linear elasticity alone. "auto" is "midpoint" in 1-D and
            "double" in 2-D and 3-D.
        volume: "nodal", or "projected", the change of volume smoothed over stars, for
            materials that are nearly incompressible while elastic; "auto" projects
            above nu = 0.48.
    """

    dx: float | None = None
    degree: int = 2
    support: float | None = None
    rim_support: float | None = None
    tau: float = 0.3
    scheme: str = "auto"
    volume: str = "auto"

    def __post_init__(self):
        """Refuse numbers and words out of range."""
        _positive(self, "dx")
        if whole("degree", self.degree) not in (1, 2, 3, 4):
            raise ValueError(f"degree: {self.degree} must be 1 to 4; 2 is common")
        for name in ("support", "rim_support"):
            given = getattr(self, name)
            if given is not None:
                number(name, given, above=1, cure="spacings; 2.5 to 4 is common")
        number("tau", self.tau, least=0, cure="0 is no filter")
        for name, known in (
            ("scheme", ("auto", "double", "midpoint", "direct")),
            ("volume", ("auto", "nodal", "projected")),
        ):
            word(name, getattr(self, name), known)


#: Resolutions of nodes with a strain each, for small displacements.
NODES = (MLS, RKPM)
