"""Laminates: plies and the thin layers between them, as a user names them.

An interlayer is not filled with points. It is what its thickness, the gap between two
plies, and its moduli make of the displacements on both sides; see
`jaxpd.discretize.interlayer`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax

from jaxpd._types import Scalar
from jaxpd.checks import flag, number, word
from jaxpd.geometry import Box

RULES = ("calibrated", "rigid", "paper")


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Interlayer:
    """What lies between two plies; made by `interlayer` or `adhesive`.

    Attributes:
        E: traction across the layer over its strain [] (Pa).
        shear: shear modulus [] (Pa), or None: bonds alone, of which the ratio of shear
            to normal stiffness follows (some 0.6 in 2-D).
        G0: fracture energy [] (J/m^2), or None: never breaks.
        rho: density [] (kg/m^3), its mass goes to the points on both faces.
        delta: reach of its bonds [] (m), or None: the horizon of each ply.
        rule: how stiff the bonds are; see `interlayer`.
        one_way: whether forces on ghosts are dropped, as in paper 002, eq. 13.
    """

    E: Scalar
    shear: Scalar | None = None
    G0: Scalar | None = None
    rho: Scalar = 0.0
    delta: Any = field(metadata={"static": True}, default=None)
    rule: str = field(metadata={"static": True}, default="calibrated")
    one_way: bool = field(metadata={"static": True}, default=False)


def interlayer(
    E: float,
    *,
    shear: float | None = None,
    G0: float | None = None,
    rho: float = 0.0,
    delta: float | None = None,
    rule: str = "calibrated",
    one_way: bool = False,
) -> Interlayer:
    """A layer between two plies; its thickness is the gap that the plies leave.

    Args:
        E: traction across the layer over its strain (Pa): Young's modulus of a layer
            that is free to contract, the larger one of `adhesive` of one that is not.
        shear: shear modulus (Pa); without it bonds alone fix the ratio of the two. At
            most some half of E: what bonds of that stiffness leave for the spring. To
            be given where the layer is thin beside the horizon: bonds that are no
            stiffer than the shear modulus asks for stiffen the plies less along the
            layer, which they do by more than a real layer would.
        G0: fracture energy (J/m^2); without it the layer never breaks. Energy is right,
            strength only where the layer is softer than the plies over a horizon.
        rho: density (kg/m^3), of a mass on the faces: for layers that are thin beside
            their own waves. Without it the layer has no mass.
        delta: reach of its bonds (m); the horizon of each ply by default.
        rule: "calibrated" makes the static compliance between the faces h / E exactly,
            softness of the plies' own surfaces included; "rigid" makes it h / E between
            rigid plies; "paper" takes the micromodulus of E at the plies' horizon
            (paper 002, section 2.2), which is right at h / delta = 2/3 alone.
        one_way: drop what pulls at the ghosts (paper 002, eq. 13). Momentum is not
            kept and stiff layers blow up: for reproduction and nothing else.

    Raises:
        ValueError: on numbers out of range.
    """
    number("E", E, above=0, cure="in Pa")
    for name, value in (("shear", shear), ("G0", G0), ("delta", delta)):
        if value is not None:
            number(name, value, above=0, cure="or None")
    number("rho", rho, least=0, cure="in kg/m^3")
    flag("one_way", one_way)
    word("rule", rule, RULES)
    if rule == "paper" and shear is not None:
        raise ValueError("shear: bonds alone make the rule 'paper'; leave it out")
    return Interlayer(E, shear, G0, rho, delta, rule, one_way)


def adhesive(E: float, nu: float, **more: Any) -> Interlayer:
    """An isotropic layer that is thin beside its width, so that plies hold it in plane.

    Its normal modulus is E (1 - nu) / ((1 + nu) (1 - 2 nu)), its shear modulus
    E / (2 (1 + nu)).

    Args:
        E: Young's modulus (Pa).
        nu: Poisson's ratio (-), at least 0 and below 1/2.
        **more: those of `interlayer`, but for `shear`.

    Raises:
        ValueError: on numbers out of range.
    """
    number("E", E, above=0, cure="in Pa")
    number("nu", nu, least=0, below=0.5, cure="else use interlayer()")
    if "shear" in more:
        raise ValueError("shear: follows from E and nu; use interlayer() to give it")
    held = E * (1 - nu) / ((1 + nu) * (1 - 2 * nu))
    return interlayer(held, shear=E / (2 * (1 + nu)), **more)


@dataclass(frozen=True)
class Laminate:
    """A stack of plies; made by `laminate`.

    Attributes:
        plies: boxes, in the order in which they lie along the axis.
        interlayers: one between each two plies, None where nothing joins them.
        axis: along which they are stacked.
    """

    plies: tuple[Box, ...]
    interlayers: tuple[Interlayer | None, ...]
    axis: int

    @property
    def d(self) -> int:
        """Number of space dimensions."""
        return len(self.plies[0].lo)

    @property
    def layers(self) -> tuple[Interlayer, ...]:
        """The interlayers that there are, which have parameters and ghosts."""
        return tuple(layer for layer in self.interlayers if layer is not None)

    @property
    def gaps(self) -> tuple[float, ...]:
        """Thickness of each interlayer (m)."""
        a = self.axis
        pairs = itertools.pairwise(self.plies)
        return tuple(float(above.lo[a] - below.hi[a]) for below, above in pairs)


def laminate(
    plies: Sequence[Box],
    interlayers: Interlayer | Sequence[Interlayer | None] | None,
) -> Laminate:
    """A stack of boxes with an interlayer in each gap.

    Plies may differ in width, as in a lap joint: the layer is where both lie.

    Args:
        plies: boxes, from below upwards; along one axis they leave gaps.
        interlayers: one for all gaps, or one for each; None joins nothing, and plies
            then pass through each other unseen.

    Raises:
        ValueError: on fewer than two plies, boxes that leave no gap, that do not lie
            over one another, or a wrong number of interlayers.
    """
    given: Any = plies
    boxes = tuple(given) if isinstance(given, list | tuple) else (given,)
    if len(boxes) < 2 or not all(isinstance(ply, Box) for ply in boxes):
        raise ValueError(f"plies: {given} must be two boxes or more, made by box()")
    d = len(boxes[0].lo)
    if any(len(ply.lo) != d for ply in boxes):
        raise ValueError("plies: all must have the same number of dimensions")
    pairs = list(itertools.pairwise(boxes))
    axes = [a for a in range(d) if all(p.hi[a] < q.lo[a] for p, q in pairs)]
    if not axes:
        raise ValueError(
            f"plies: {given} must leave gaps along one axis, in increasing order; the "
            "gap is the thickness of the interlayer"
        )
    if len(axes) > 1:
        raise ValueError(f"plies: {given} do not face each other, but diagonally")
    for below, above in pairs:
        for a in set(range(d)) - set(axes):
            width = min(below.hi[a], above.hi[a]) - max(below.lo[a], above.lo[a])
            if not width > 0:
                raise ValueError(f"plies: {below} and {above} do not face each other")
    if any(math.isinf(x) for ply in boxes for x in (*ply.lo, *ply.hi)):
        raise ValueError("plies: boxes must be finite")
    between: Any = interlayers
    if isinstance(between, list | tuple):
        layers = tuple(between)
    else:
        layers = (between,) * len(pairs)
    if len(layers) != len(pairs) or not all(
        layer is None or isinstance(layer, Interlayer) for layer in layers
    ):
        raise ValueError(
            f"interlayers: {between} must be one, or one for each of the {len(pairs)} "
            "gaps, made by interlayer() or adhesive()"
        )
    return Laminate(boxes, layers, axes[0])
