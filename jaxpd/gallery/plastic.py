"""Elastoplastic bodies of nodes: paper 001's bars, and scenes that are not patch tests.

Loads and supports grow over a pseudo-time, see `jaxpd.solve_path`.
"""

from __future__ import annotations

import math
from typing import Any

import jax.numpy as jnp

from jaxpd.checks import number, whole
from jaxpd.conditions import moves, pressure, traction
from jaxpd.geometry import Cloud, above, ball, below, box, mapped
from jaxpd.physics import von_mises
from jaxpd.resolution import MLS, RKPM
from jaxpd.scene import Scene
from jaxpd.schedule import Table, ramp

#: Constants of paper 001, section 4.2 (psi): E, sigma_y, h_iso (its K), h_kin (its H).
YOON = (1e6, 1e4, 5e4, 5e3)
#: Elastoplastic modulus of its bar, E (K + H) / (E + K + H).
YOON_MODULUS = 1e6 * 55e3 / 1.055e6
#: Paper 001's own form: its second-order basis, weight and radius found by comparison.
PAPER = MLS(support=2.5, rim_support=2.5, tau=0.0, scheme="double", volume="nodal")
#: The ring: inner and outer radius (m), E (Pa), nu, sigma_y (Pa), in units of MPa.
RING = (1.0, 2.0, 2.1e5, 0.3, 240.0)
#: Radius of the hole over the half width of the plate.
HOLE = 0.3
#: Corners of Cook's panel, counter-clockwise.
COOK = ((0.0, 0.0), (48.0, 44.0), (48.0, 60.0), (0.0, 44.0))


def _nodes(resolution: MLS | RKPM | None) -> MLS | RKPM:
    return MLS() if resolution is None else resolution


def _end(
    length: float, strain: float, time: Table | None, pulled: bool
) -> tuple[list[Any], list[Any]]:
    """Supports and loads at the far end of a bar: displaced, or pulled."""
    end, time = above(x=length), ramp(1.0) if time is None else time
    if pulled:
        return [], [traction(end, x=YOON[0] * strain, time=time)]
    return [moves(end, x=length * strain, time=time)], []


def plastic_bar(
    n: int = 61,
    *,
    strain: float = 0.02,
    time: Table | None = None,
    jitter: float = 0.0,
    seed: int = 0,
    pulled: bool = False,
    law: Any = None,
    resolution: MLS | RKPM | None = None,
) -> Scene:
    """The bar of paper 001, section 4.2: 61 nodes on 1 m, from t = 0 to 1.

    Args:
        n: nodes.
        strain: of the whole bar at t = 1 (-).
        time: history of the load; a ramp by default.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        pulled: by a traction E strain at the end (load control) instead of a
            displacement.
        law: of the bar, paper 001's by default.
        resolution: the recommended one by default; `PAPER` is the paper's.
    """
    n = whole("n", n, 2)
    number("strain", strain)
    E, sigma_y, h_iso, h_kin = YOON
    law = von_mises(E, None, sigma_y, h_iso, h_kin, state="bar") if law is None else law
    moved, loads = _end(1.0, strain, time, pulled)
    return Scene(
        mapped((n,), lambda s: s, jitter=jitter, seed=seed),
        law,
        supports=[moves(below(x=0.0), x=0.0), *moved],
        loads=loads,
        resolution=_nodes(resolution),
    )


def plastic_beam(
    shape: tuple[int, int] = (17, 9),
    *,
    strain: float = 0.02,
    time: Table | None = None,
    jitter: float = 0.0,
    seed: int = 0,
    pulled: bool = False,
    nu: float = 0.0,
    resolution: MLS | RKPM | None = None,
) -> Scene:
    """Paper 001, section 4.3: the same bar in plane stress, 2 by 1 m, 17 x 9 nodes.

    The left edge is a roller with one pinned node: plastic flow contracts the bar, and
    a clamped edge would not let it (found by comparison; the paper does not say).

    Args:
        shape: nodes along and across.
        strain: of the whole bar at t = 1 (-).
        time: history of the load; a ramp by default.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        pulled: by a traction E strain at the end instead of a displacement.
        nu: Poisson's ratio; 0 in the paper.
        resolution: the recommended one by default; `PAPER` is the paper's.
    """
    number("strain", strain)
    E, sigma_y, h_iso, h_kin = YOON
    law = von_mises(E, nu, sigma_y, h_iso, h_kin, state="plane stress")
    moved, loads = _end(2.0, strain, time, pulled)
    corner = box((-1e-6, -1e-6), (1e-6, 1e-6))
    size = jnp.array([2.0, 1.0])
    return Scene(
        mapped(shape, lambda s: s * size, jitter=jitter, seed=seed),
        law,
        supports=[moves(below(x=0.0), x=0.0), moves(corner, y=0.0), *moved],
        loads=loads,
        resolution=_nodes(resolution),
    )


def ring_body(shape: tuple[int, int], jitter: float = 0.0, seed: int = 0) -> Cloud:
    """Nodes of a quarter ring, radial and angular, over the radii of `RING`."""
    a, b = RING[:2]

    def place(s):
        angle = 0.5 * jnp.pi * s[1]
        r = a + (b - a) * s[0]
        return r * jnp.stack([jnp.cos(angle), jnp.sin(angle)])

    return mapped(shape, place, jitter=jitter, seed=seed)


def pressed_ring(
    shape: tuple[int, int] = (11, 25),
    p: float = 172.3,
    *,
    time: Table | None = None,
    jitter: float = 0.0,
    seed: int = 0,
    law: Any = None,
    resolution: MLS | RKPM | None = None,
) -> Scene:
    """A thick-walled cylinder under internal pressure, plane strain, perfectly plastic.

    A quarter with rollers on both cuts. At p = 172.3 the elastic-plastic front is at
    r = 1.5; the closed form is Hill's where nu = 1/2.

    Args:
        shape: nodes radially and along the angle.
        p: pressure at the end of the history.
        time: history of the pressure; a ramp by default.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        law: perfect plasticity with the constants of `RING` by default.
        resolution: the recommended one by default.
    """
    a, _, E, nu, sigma_y = RING
    law = von_mises(E, nu, sigma_y, state="plane strain") if law is None else law
    return Scene(
        ring_body(shape, jitter, seed),
        law,
        supports=[moves(below(x=1e-9), x=0.0), moves(below(y=1e-9), y=0.0)],
        loads=[
            pressure(
                ball((0.0, 0.0), a * (1.0 + 1e-6)),
                p,
                time=ramp(1.0) if time is None else time,
            )
        ],
        resolution=_nodes(resolution),
    )


def plate_with_hole(
    shape: tuple[int, int] = (17, 25),
    stretch: float = 0.004,
    *,
    time: Table | None = None,
    jitter: float = 0.0,
    seed: int = 0,
    grading: float = 1.3,
    law: Any = None,
    resolution: MLS | RKPM | None = None,
) -> Scene:
    """A quarter of a square plate with a hole, pulled along y, in plane stress.

    Half width 1 m, radius 0.3 m. Perfectly plastic, it carries 0.7 sigma_y on its
    gross width: the net section yields.

    Args:
        shape: nodes from the hole outwards, and around it (an odd number puts one in
            the corner).
        stretch: displacement of the edge y = 1 at the end of the history (m).
        time: history; a ramp by default.
        jitter: share of a spacing by which inner nodes are moved at random.
        seed: of the moves.
        grading: cells grow by exp(grading) from the hole to the edge; with 1.3 they are
            near square at the hole. With 0 they are all as long, two to four times as
            long as wide at the hole, and displacements alternate there: `Path.rough` is
            above 0.1 on 11 x 17, 13 x 21 and 15 x 25.
        law: perfect plasticity with E, nu, sigma_y of `RING` by default.
        resolution: the recommended one by default.
    """
    number("stretch", stretch, cure="in m")
    number("grading", grading)
    _, _, E, nu, sigma_y = RING
    law = von_mises(E, nu, sigma_y, state="plane stress") if law is None else law

    def place(s):
        angle = 0.5 * math.pi * s[1]
        hole = HOLE * jnp.stack([jnp.cos(angle), jnp.sin(angle)])
        # along the edges x = 1 and y = 1, the corner in the middle
        edge = jnp.stack(
            [jnp.minimum(1.0, 2.0 - 2.0 * s[1]), jnp.minimum(1.0, 2 * s[1])]
        )
        out = jnp.expm1(grading * s[0]) / math.expm1(grading) if grading else s[0]
        return hole + out * (edge - hole)

    body = mapped(shape, place, jitter=jitter, seed=seed)
    time = ramp(1.0) if time is None else time
    return Scene(
        body,
        law,
        supports=[
            moves(below(x=1e-9), x=0.0),
            moves(below(y=1e-9), y=0.0),
            moves(above(y=1.0 - 1e-9), y=stretch, time=time),
        ],
        resolution=_nodes(resolution),
    )


def cook_panel(
    shape: tuple[int, int] = (17, 17),
    shear: float = 1.2,
    *,
    time: Table | None = None,
    law: Any = None,
    resolution: MLS | RKPM | None = None,
) -> Scene:
    """Cook's panel, clamped on the left and sheared by a force on the right edge.

    Args:
        shape: nodes along and across.
        shear: force along y at the end of the history, over an edge of 16.
        time: history; a ramp by default.
        law: E = 70, nu = 1/3, sigma_y = 0.243, h_iso = 0.135, h_kin = 0.015 in plane
            strain by default.
        resolution: the recommended one by default.
    """
    number("shear", shear)
    if law is None:
        law = von_mises(70.0, 1 / 3, 0.243, 0.135, 0.015, state="plane strain")
    corners = jnp.array(COOK)

    def place(s):
        low = corners[0] + s[0] * (corners[1] - corners[0])
        high = corners[3] + s[0] * (corners[2] - corners[3])
        return low + s[1] * (high - low)

    right = above(x=48.0 - 1e-9)
    time = ramp(1.0) if time is None else time
    return Scene(
        mapped(shape, place),
        law,
        supports=[moves(below(x=1e-9), x=0.0, y=0.0)],
        loads=[traction(right, y=shear / 16.0, time=time)],
        resolution=_nodes(resolution),
    )
