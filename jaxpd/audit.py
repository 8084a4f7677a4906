"""What elastic constants a discretisation has, in the bulk and at its surfaces.

The energy of every point under affine fields, taken from the operator that a solve
would use, gives its own stiffness C [s, s] in Voigt notation (s = 1, 3, 6 strains):

    W(e) = e C e / 2,    C_IJ = W(e_I + e_J) - W(e_I) - W(e_J)    for I != J,

and its inverse the constants: E_a = 1 / S_aa and nu_ab = -S_ab / S_aa in tension along
the axis a, G = 1 / S in shear. They are what a point contributes to the energy if the
body is strained evenly, not what a solve finds: there soft surfaces contract.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxpd._types import PointScalar, PointVector
from jaxpd.body import check_bonds, cloud_of
from jaxpd.checks import instance, word
from jaxpd.compiling import quickly
from jaxpd.conditions import holds
from jaxpd.discretize.surface import CORRECTIONS
from jaxpd.geometry import Box, box, find, find_on_grid
from jaxpd.operators.patches import rim
from jaxpd.physics import elastic
from jaxpd.prepare import prepare
from jaxpd.problem import Problem
from jaxpd.scene import Elastic, Scene

#: Strain of the fields; energies of both signs are averaged: errors of its square.
STRAIN = 1e-4
#: Share of the largest neighbourhoods' volume from which a point of a cloud is bulk.
WHOLE = 0.9


@dataclass(frozen=True, eq=False)
class Constants:
    """Effective constants of every point with one correction, over the classical ones.

    Attributes:
        E: in tension along each axis [n, d] (-).
        nu: mean over the axes across of Poisson's ratio in that tension [n, d] (-).
        G: shear moduli in the planes 12, or 23, 13, 12 [n, 0], [n, 1], [n, 3] (-).
    """

    E: NDArray[np.floating]
    nu: NDArray[np.floating]
    G: NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Audit:
    """Effective constants of a scene; `print` it for the table.

    Attributes:
        X: reference positions [n, d] (m).
        bulk: points with a whole neighbourhood [n].
        face: whether a point lies on a face across an axis [n, d]: an outermost row of
            the lattice, or within half a point's size of the box around a cloud.
        constants: for each correction.
        refused: corrections that the scene cannot have, and why.
    """

    X: PointVector
    bulk: NDArray[np.bool_]
    face: NDArray[np.bool_]
    constants: dict[str, Constants]
    refused: dict[str, str]

    def places(self, correction: str) -> dict[str, dict[str, float]]:
        """For each of "E", "nu", "G" its value over the classical one, by place.

        "bulk" and the faces by the median, over all axes: "along" for tension along a
        face or shear in its plane, "across" for the others; the points without a whole
        neighbourhood by their extremes, "rim min" and "rim max". NaN where there is no
        such point.
        """
        constants, face = self.constants[correction], self.face
        across = {"E": face, "nu": face}
        i, j = np.array(_planes(face.shape[1]), int).reshape(-1, 2).T
        across["G"] = face[:, i] | face[:, j]
        found = {}
        for name, normal in across.items():
            x = getattr(constants, name)
            some = face.any(axis=1, keepdims=True) & ~normal
            rim = x[np.logical_not(self.bulk)]
            found[name] = {
                "bulk": _median(x[self.bulk]),
                "along": _median(x[some]),
                "across": _median(x[normal]),
                "rim min": float(rim.min()) if rim.size else np.nan,
                "rim max": float(rim.max()) if rim.size else np.nan,
            }
        return found

    def __str__(self) -> str:
        """The table of `places`."""
        head = ("bulk", "along", "across", "rim min", "rim max")
        lines = [f"{'':21}" + "".join(f"{name:>9}" for name in head)]
        for correction in self.constants:
            for name, row in self.places(correction).items():
                numbers = "".join(f"{row[place]:9.4f}" for place in head)
                lines.append(f"{correction:16}{name:>5}{numbers}")
        lines += [f"{name}: {why}" for name, why in self.refused.items()]
        return "\n".join(lines)


def _median(x: NDArray[np.floating]) -> float:
    return float(np.median(x)) if x.size else np.nan


def _planes(d: int) -> list[tuple[int, int]]:
    """Planes of shear in Voigt's order."""
    return {1: [], 2: [(0, 1)], 3: [(1, 2), (0, 2), (0, 1)]}[d]


def audit(scene: Scene, corrections: Sequence[str] | None = None) -> Audit:
    """Effective constants of a scene with each surface correction.

    Supports, loads and starts play no part. Points outside the body that supports have
    added are points like the others. Of a scene of motion cracks are as in statics.

    Args:
        scene: what would be solved, of an `Elastic` material of one modulus.
        corrections: names of `jaxpd.discretize.CORRECTIONS`; left out, all of them,
            and those that the scene cannot have are listed with the reason.

    Raises:
        ValueError: on another material, or a correction asked for by name that the
            scene cannot have.
    """
    instance("scene", scene, Scene, "a Scene(..)")
    some = CORRECTIONS if corrections is None else corrections
    if not isinstance(some, list | tuple) or not some:
        raise ValueError(f"corrections: give at least one, not {corrections!r}")
    for name in some:
        word("corrections", name, CORRECTIONS)
    check_bonds(scene, "an audit of surfaces")
    material = scene.material
    if not isinstance(material, Elastic) or np.ndim(material.E):
        raise ValueError(
            f"material: {material!r} must be Elastic with one modulus E; the audit "
            "compares with its constants"
        )
    scene = _held(scene)
    constants, refused, problem = {}, {}, None
    for correction in CORRECTIONS if corrections is None else corrections:
        resolution = dataclasses.replace(scene.resolution, correction=correction)
        try:
            one = dataclasses.replace(scene, resolution=resolution)
            problem = prepare(one, solver="d-pcg", rtol=1e-2)
        except ValueError as error:
            if corrections is not None or not str(error).startswith(
                ("correction", "alpha", "cracks", "V0")
            ):
                raise
            refused[correction] = str(error)
            continue
        constants[correction] = _constants(problem, material)
    assert problem is not None
    return Audit(np.asarray(problem.X), *_places(scene), constants, refused)


def _held(scene: Scene) -> Scene:
    """The same body and layers, half of it held: a scene that `prepare` accepts."""
    layers = scene.layers() if isinstance(scene.body, Box) else scene.resolution.layers
    X = np.asarray(cloud_of(scene).X)
    low, high = X.min(axis=0), X.max(axis=0)
    half = box(low - 1.0, 0.5 * (low + high))
    return dataclasses.replace(
        scene,
        resolution=dataclasses.replace(scene.resolution, layers=layers),
        supports=(holds(half),),
        loads=(),
        starts=(),
        no_fail=(),
    )


def _strains(d: int) -> NDArray[np.floating]:
    """Unit strains [s, d, d] in Voigt's order, engineering shear."""
    pairs = [(a, a) for a in range(d)] + _planes(d)
    found = np.zeros((len(pairs), d, d))
    for e, (a, b) in zip(found, pairs, strict=True):
        e[a, b] += 0.5
        e[b, a] += 0.5
    return found


def _energies(problem: Problem, fields: Any) -> PointScalar:
    """Mean energies [f, n] (J) under displacements [f, n, d] and their opposites."""
    operator, _, _ = problem.build(problem.params)

    def of(u):
        plus, minus = operator.energy_per_point(u), operator.energy_per_point(-u)
        return 0.5 * (plus + minus)

    return jax.lax.map(of, fields)


def _constants(problem: Problem, material: Elastic) -> Constants:
    X, d = np.asarray(problem.X), problem.X.shape[1]
    params = problem.params
    vol = np.asarray(params["vol"] if "vol" in params else params["dx"] ** d)
    unit = _strains(d)
    s = len(unit)
    first, second = np.triu_indices(s, 1)
    strains = STRAIN * np.concatenate([unit, unit[first] + unit[second]])
    fields = jnp.asarray(np.einsum("fab,nb->fna", strains, X), X.dtype)
    W = np.asarray(quickly(_energies)(problem, fields)) / (vol * STRAIN**2)
    C = np.zeros((len(X), s, s))
    C[:, range(s), range(s)] = 2.0 * W[:s].T
    C[:, first, second] = (W[s:] - W[first] - W[second]).T
    C[:, second, first] = C[:, first, second]
    # a point that has bonds in few directions alone resists some strains not at all
    size = np.trace(C, axis1=1, axis2=2)[:, None, None]
    S = np.linalg.inv(C + 1e-12 * size * np.eye(s))
    own = np.diagonal(S, axis1=1, axis2=2)
    classical = np.linalg.inv(
        np.asarray(elastic.stiffness(material.E, material.nu or 0.0, material.state))
    )
    E = classical[0, 0] / own[:, :d]
    nu = np.zeros((len(X), 0))
    if d > 1:
        across = (S[:, :d, :d].sum(axis=2) - own[:, :d]) / (d - 1)
        nu = across / own[:, :d] / (classical[0, 1] / classical[0, 0])
    G = classical[-1, -1] / own[:, d:] if d > 1 else nu
    return Constants(E, nu, G)


def _places(scene: Scene) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Points with a whole neighbourhood [n], and those on faces across axes [n, d]."""
    cloud, resolution = cloud_of(scene), scene.resolution
    how: dict[str, Any] = {"partial": resolution.partial, "cracks": scene.cracks}
    X, vol = np.asarray(cloud.X), np.asarray(cloud.vol)
    if cloud.regular:
        bulk = ~rim(find_on_grid(cloud, resolution.horizon, **how)).ravel()
    else:
        family = find(cloud, resolution.horizon, **how)
        present, nbr = np.asarray(family.present), np.asarray(family.nbr)
        V = vol + np.where(present, vol[nbr], 0.0).sum(axis=0)
        bulk = np.quantile(V, 0.9) * WHOLE <= V
    half = 0.5 * vol[:, None] ** (1 / cloud.d)
    low, high = X.min(axis=0) + half, X.max(axis=0) - half
    return bulk, (low >= X) | (high <= X)
