"""What a scene holds, as far as its cost depends on it: counts and flags. Host only.

Nothing is prepared: points are counted, bonds a point are those of a whole
neighbourhood, and how irregular nodes lie is measured by their nearest neighbours.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import KDTree

from jaxpd.body import cloud_of
from jaxpd.geometry import Box, Cloud
from jaxpd.laminate import Laminate
from jaxpd.planner.laws import projected
from jaxpd.plies import ply_scenes
from jaxpd.resolution import NODES, RKPM, Bonds, Kernel
from jaxpd.scene import Scene

#: Points of which nearest neighbours are looked at.
SAMPLE = 4000


@dataclass(frozen=True)
class Look:
    """What a scene with a resolution holds.

    Attributes:
        d: space dimensions.
        n: points, of all plies.
        dx: spacing (m), of a cloud the mean (V / n)^(1/d).
        m: horizon over spacing (-); of nodes the radius of a star or kernel.
        neighbours: points within the horizon of one inside.
        sides: extent of the body per axis (m).
        regular: whether the points are a lattice.
        spread: standard deviation over mean of the distances to the nearest neighbour
            (-): 0 on a lattice, 0.17 where nodes are moved by 0.3 spacings.
        condition: largest over smallest eigenvalue of the stiffness, roughly (-).
        step: stable time step times the speed (E / rho)^(1/2) (m), roughly.
        terms: products with waves that the surface correction asks of an FFT.
        plies: number of plies, 1 of one body.
        ghosts: ghost points of all interlayers, roughly.
    """

    d: int
    n: int
    dx: float
    m: float
    neighbours: float
    sides: tuple[float, ...]
    regular: bool
    spread: float
    condition: float
    step: float
    terms: int
    plies: int = 1
    ghosts: int = 0

    @property
    def bonds(self) -> float:
        """Bonds of all points, each direction counted."""
        return self.n * self.neighbours

    @property
    def unknowns(self) -> int:
        """Displacement components, held ones included."""
        return self.n * self.d

    @property
    def least(self) -> float:
        """Shortest side of the body (m)."""
        return min(self.sides)


def chosen(resolution: Any) -> bool:
    """Whether a resolution was given: bonds without spacing and horizon were not."""
    if isinstance(resolution, list | tuple):
        return all(map(chosen, resolution))
    if isinstance(resolution, Bonds):
        return not (resolution.dx is None and resolution.m is resolution.delta is None)
    return True


def look(scene: Scene) -> Look:
    """Count what a scene with a resolution holds.

    Raises:
        ValueError: of a body or resolution that cannot be laid out.
    """
    if isinstance(scene.body, Laminate):
        return _stacked(scene)
    resolution = scene.resolution
    if isinstance(resolution, NODES):
        return _nodes(scene)
    n, dx, sides, X = _points(scene)
    m = resolution.horizon / dx
    k, second, step = _neighbourhood(m, scene.d, resolution.kernel)
    held = 1.0 if _held_twice(scene) else 2.0
    length = held * max(sides)
    condition = max(4.0, 4.0 / ((math.pi * dx / length) ** 2 * second))
    corrected = resolution.correction in (None, "lattice") and scene.d > 0
    return Look(
        d=scene.d,
        n=n,
        dx=dx,
        m=m,
        neighbours=k,
        sides=sides,
        regular=X is None,
        spread=0.0 if X is None else spread(X),
        condition=condition,
        step=dx * step,
        terms=5 if corrected else 1,
    )


def _points(
    scene: Scene,
) -> tuple[int, float, tuple[float, ...], np.ndarray | None]:
    """Number, spacing and extent of points, and where they are if on no lattice."""
    body, resolution = scene.body, scene.resolution
    if isinstance(body, Box) and resolution.dx is not None:
        dx = resolution.dx
        layers = np.sum(scene.layers(), axis=1)
        cells = np.rint((np.asarray(body.hi) - np.asarray(body.lo)) / dx)
        points = cells + (resolution.nodes == "edge") + layers
        sides = tuple(float(x) for x in dx * np.maximum(cells + layers, 1))
        return int(np.prod(points)), dx, sides, None
    cloud = cloud_of(scene)
    X, dx = np.asarray(cloud.X), _spacing(cloud)
    return len(X), dx, _sides(X, dx), None if cloud.regular else X


def _stacked(scene: Scene) -> Look:
    """Of a laminate: the sums and the least favourable of its plies."""
    looks = [look(ply) for ply in ply_scenes(scene)]
    n = sum(one.n for one in looks)
    axis = scene.body.axis  # type: ignore[union-attr]
    ghosts = sum(
        round(one.n * one.dx / one.sides[axis])
        for one, layer in zip(looks, scene.body.interlayers, strict=False)  # type: ignore[union-attr]
        if layer is not None
    )
    low = np.min([ply.lo for ply in scene.body.plies], axis=0)  # type: ignore[union-attr]
    high = np.max([ply.hi for ply in scene.body.plies], axis=0)  # type: ignore[union-attr]
    return dataclasses.replace(
        min(looks, key=lambda one: one.dx),
        n=n,
        neighbours=sum(one.bonds for one in looks) / n,
        sides=tuple(map(float, high - low)),
        condition=sum(one.condition for one in looks),
        plies=len(looks),
        ghosts=ghosts,
    )


def _nodes(scene: Scene) -> Look:
    resolution = scene.resolution
    body = scene.body
    if isinstance(body, Box):
        if resolution.dx is None:
            raise ValueError(
                f"dx: None; a box needs a spacing, as in {type(resolution).__name__}"
                "(dx=1/16)"
            )
        cells = (np.asarray(body.hi) - np.asarray(body.lo)) / resolution.dx
        n, dx, X = int(np.prod(np.rint(cells) + 1)), resolution.dx, None
        sides = tuple(float(x) for x in cells * dx)
    elif isinstance(body, Cloud):
        X, dx = np.asarray(body.X), _spacing(body)
        n, sides = len(X), _sides(X, dx)
        X = None if body.regular else X
    else:
        raise ValueError(
            "body: a laminate is for bonds, and the resolution is of nodes"
        )
    weak = isinstance(resolution, RKPM)
    m = (
        resolution.support
        if weak
        else resolution.support or (4.1, 4.1, 3.1)[scene.d - 1]
    )
    # stars of the strong form are convolved with themselves, and once more by volumes
    m *= 1.5 if projected(scene) else 1.0
    k = (2 * m) ** scene.d * (1.0, math.pi / 4, math.pi / 6)[scene.d - 1]
    return Look(
        d=scene.d,
        n=n,
        dx=dx,
        m=m,
        neighbours=k,
        sides=sides,
        regular=X is None,
        spread=0.0 if X is None else spread(X),
        condition=4.0 * (max(sides) / dx) ** 2,
        step=dx,
        terms=1,
    )


def spread(X: np.ndarray) -> float:
    """Standard deviation over mean of the distances to the nearest neighbour (-)."""
    if len(X) < 3:
        return 0.0
    pick = np.linspace(0, len(X) - 1, min(len(X), SAMPLE)).astype(int)
    near = KDTree(X).query(X[pick], k=2)[0][:, 1]
    return float(near.std() / near.mean())


def _spacing(cloud: Cloud) -> float:
    if cloud.lattice is not None:
        return cloud.lattice.dx
    return float((np.asarray(cloud.vol).sum() / cloud.n) ** (1.0 / cloud.d))


def _sides(X: np.ndarray, dx: float) -> tuple[float, ...]:
    return tuple(float(max(side, dx)) for side in np.ptp(X, axis=0))


def _held_twice(scene: Scene) -> bool:
    """Whether supports lie on opposite sides of the body."""
    places = {str(s.region) for s in scene.supports}
    return len(places) > 1


def _neighbourhood(m: float, d: int, kernel: Any) -> tuple[float, float, float]:
    """Bonds of a point inside, mean square of their reach along an axis, stable step.

    The mean is over stiffnesses, in spacings squared: the ratio of the ends of the
    spectrum is 4 over it times the square of the smallest wave number. The step is that
    of `jaxpd.solvers.explicit.stable_dt` at a unit speed and spacing.
    """
    reach = int(m + 1e-9)
    span = np.arange(-reach, reach + 1)
    grid = np.stack([g.ravel() for g in np.meshgrid(*[span] * d, indexing="ij")], 1)
    r2 = (grid**2).sum(axis=1)
    grid = grid[(r2 > 0) & (r2 <= m * m * (1 + 1e-9))]
    r = np.sqrt((grid**2).sum(axis=1))
    if isinstance(kernel, Kernel):
        omega = np.asarray(kernel.influence(d, float(m))(r))
    else:
        omega = np.ones(len(r))
    omega = np.where(np.isfinite(omega) & (omega > 0), omega, 1e-12)
    stiff = omega * (grid[:, 0] / r) ** 2
    second = float((stiff * grid[:, 0] ** 2).sum() / stiff.sum())
    along = float((stiff * (grid[:, 0] / r) ** 2 * r**2).sum() / stiff.sum())
    return float(len(r)), second, along**0.5
