"""What is between the plies of a laminate: ghosts, their calibration, their operator.

On the host, once: which ghosts, and the response of a small piece of each ply, row by
row, that calibrates their bonds. Traced: how stiff the bonds of given moduli are.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.discretize import beyond_faces
from jaxpd.discretize.calibration import Calibration, Rows, modes_of, rows_of
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.discretize.facing import Face
from jaxpd.discretize.interlayer import Joint, join
from jaxpd.discretize.surface import VOLUMES
from jaxpd.geometry import GridFamily, find, find_on_grid, lattice
from jaxpd.geometry.grid_family import half_offsets
from jaxpd.laminate import Interlayer
from jaxpd.operators.ghosts import GhostForce
from jaxpd.physics import Fractional, micromodulus
from jaxpd.plies import laminate_of, ply_scenes, points_of
from jaxpd.problem import Problem, first_tangent
from jaxpd.scene import Elastic, Scene

#: The ghosts of an interlayer, and how stiff moduli make their bonds.
Glue = tuple[Joint, Calibration]


def glue_of(scene: Scene, plies: Sequence[Problem]) -> tuple[Glue, ...]:
    """Ghosts and calibration of every interlayer."""
    body, scenes = laminate_of(scene), ply_scenes(scene)
    first = np.concatenate([[0], np.cumsum([len(ply.X) for ply in plies])])
    known: dict[int, tuple[Rows, ...]] = {}

    def rows(i: int) -> tuple[Rows, ...]:
        i = next(j for j in range(i + 1) if j == i or _alike(scenes[i], scenes[j]))
        if i not in known:
            known[i] = _rows(scenes[i], plies[i], body.axis)
        return known[i]

    found = []
    for i, layer in enumerate(body.interlayers):
        if layer is None:
            continue
        faces = [
            _face(scenes[j], body.axis, j == i, int(first[j]), layer)
            for j in (i, i + 1)
        ]
        paper = _paper(scenes[i : i + 2], layer) if layer.rule == "paper" else None
        whole = join(*faces, paper=paper)
        joint = (
            join(*faces, paper=paper, cracks=scene.cracks) if scene.cracks else whole
        )
        found.append((joint, _calibration(layer, whole, faces, body.gaps[i], i, rows)))
    return tuple(found)


def _alike(a: Scene, b: Scene) -> bool:
    """Whether two plies have the same rows of points."""
    same = a.material is b.material and np.ndim(getattr(a.material, "E", 0.0)) == 0
    ra, rb = (dataclasses.replace(s.resolution, layers=None) for s in (a, b))
    return same and ra == rb


def _face(scene: Scene, axis: int, up: bool, first: int, layer: Interlayer) -> Face:
    box: Any = scene.body
    resolution = scene.resolution
    grid: Any = points_of(box, resolution, resolution.layers).lattice
    delta = layer.delta or resolution.horizon
    corrected = resolution.correction in VOLUMES[1:] or resolution.correction is None
    return Face(
        grid, axis, up, box.lo, box.hi, first, delta, resolution.partial, corrected
    )


def _paper(scenes: Sequence[Scene], layer: Interlayer) -> float:
    """Micromodulus of the PMB material over its modulus (paper 002, eq. 6)."""
    scene = scenes[0]
    if not isinstance(scene.material, Elastic):
        raise ValueError("rule: 'paper' takes plies of Elastic material")
    delta = layer.delta or scene.resolution.horizon
    if len({s.resolution.horizon for s in scenes}) > 1 and layer.delta is None:
        raise ValueError("rule: 'paper' needs interlayer(delta=..) where plies differ")
    d, material = scene.d, scene.material
    omega = Fractional(1.0 - d, d)
    return float(micromodulus(1.0, material.nu, material.state, d, delta, omega))


def _calibration(
    layer: Interlayer, joint: Joint, faces: Sequence[Face], h: float, i: int, rows: Any
) -> Calibration:
    d, axis = joint.X.shape[1], faces[0].axis
    if layer.shear is not None and d == 1:
        raise ValueError("shear: a bar has none; leave it out")
    inner = _inner(joint, faces)
    normal, shear = ([], [])
    for face in faces:
        first, n = face.first, int(np.prod(face.grid.shape))
        place = np.unravel_index(np.arange(n), face.grid.shape)[axis]
        depth = np.abs(place - face.row)
        end = joint.points[joint.ends]
        own = (end >= first) & (end < first + n)
        own &= inner[None] & (joint.unit > 0.0)
        slot, ghost = np.nonzero(own)
        row = depth[end[slot, ghost] - first]
        xi, unit = joint.xi[slot, :, ghost], joint.unit[slot, ghost]
        along = xi[:, axis] ** 2 / (xi**2).sum(axis=1)
        area = joint.area[inner].sum()
        normal.append(np.bincount(row, unit * along) / area)
        shear.append(np.bincount(row, unit * (1.0 - along) / max(d - 1, 1)) / area)
    ratio = float(sum(map(np.sum, shear)) / sum(map(np.sum, normal)))
    unit = float(joint.rigid[inner].mean())
    if layer.rule != "calibrated":
        if layer.shear is not None:
            _check_shear(layer.E - layer.shear / ratio, layer, ratio)
        return Calibration(h, unit, ratio, None, None, layer.rule)
    below, above = rows(i), rows(i + 1)
    modes = [
        modes_of(low, high, (x[0], x[1]))
        for low, high, x in zip(below, above, (normal, shear), strict=False)
    ]
    across = h / float(layer.E) + modes[0].inset
    target = across if layer.shear is None else h / layer.shear + modes[-1].inset
    s = modes[0 if layer.shear is None else -1].bonds_on_host(target)
    if s is None:
        raise ValueError(
            f"interlayers: no bonds make layer {i} as stiff as {h / target:.3g} Pa "
            "over its thickness, beside these plies; use finer plies, or rule='rigid'"
        )
    if layer.shear is not None:
        _check_shear(modes[0].spring(across, s), layer, ratio)
    return Calibration(h, unit, ratio, modes[0], modes[-1], layer.rule)


def _check_shear(spring: Any, layer: Interlayer, ratio: float) -> None:
    if not np.all(np.asarray(spring) >= 0.0):
        raise ValueError(
            f"shear: {layer.shear} is more than bonds of the normal modulus {layer.E} "
            f"leave room for, some {ratio:.2f} of it; leave it out for bonds alone"
        )


def _inner(joint: Joint, faces: Sequence[Face]) -> Any:
    """Mask of the ghosts further than a horizon from the rim, or all [q]."""
    axis, place = faces[0].axis, joint.places
    inner = joint.intact.copy()
    for a in set(range(place.shape[1])) - {axis}:
        reach = max(face.delta + 0.5 * face.grid.dx for face in faces)
        low = max(face.lo[a] for face in faces) + reach
        high = min(face.hi[a] for face in faces) - reach
        inner &= (place[:, a] >= low) & (place[:, a] <= high)
    return inner if inner.any() else np.ones(len(inner), bool)


def _rows(scene: Scene, ply: Problem, axis: int) -> tuple[Rows, ...]:
    """Rows of a ply below a free face, displaced across it and along it."""
    resolution, d = scene.resolution, ply.X.shape[1]
    dx, m = resolution.dx, resolution.horizon / resolution.dx
    reach = int(np.abs(half_offsets(d, m, resolution.partial)).max())
    few = 4 * reach + 4
    shape = [4 * reach + 1] * d
    shape[axis] = few + 3 * reach
    cloud = lattice([0.0] * d, [dx * n for n in shape], dx, nodes="cell")
    delta, how = resolution.horizon, {"partial": resolution.partial}
    extension, params = None, {k: _mean(v) for k, v in ply.params.items()}
    if isinstance(ply.family, GridFamily):
        family: Any = find_on_grid(cloud, delta, **how)
        spec = dataclasses.replace(ply.spec, cuts=0, pivots=(), patches=())
    else:
        family, spec = find(cloud, delta, **how), ply.spec
        params |= {"X": cloud.X, "vol": cloud.vol}
    if ply.extension is not None:
        free = [(a == axis, a == axis) for a in range(d)]
        family, extension = beyond_faces(cloud, delta, free=free, **how)
    zero = np.zeros(cloud.X.shape)
    params |= {"prescribed": zero, "load": zero}
    model = dataclasses.replace(
        ply,
        params=params,
        family=family,
        fixed=zero > 1.0,
        X=np.asarray(cloud.X),
        spec=spec,
        extension=extension,
    )
    alike = isinstance(family, GridFamily) and spec.correction not in DIRECTIONAL
    K = (model.rest() if alike else first_tangent(model)).to_bsr().tocsr()
    inset = 0.5 * dx if resolution.nodes == "cell" else 0.0
    across = [axis, *(a for a in range(d) if a != axis)][:2]
    return tuple(
        Rows(rows_of(K, shape, axis, a)[:few] / dx ** (d - 1), dx, inset)
        for a in across
    )


def _mean(value: Any) -> Any:
    """Nodal numbers made one; laws leaf by leaf."""
    return jax.tree.map(lambda x: np.mean(np.asarray(x)) if np.ndim(x) else x, value)


def glue_force(glue: Glue, layer: Interlayer, no_fail: Any = None) -> GhostForce:
    """The operator of an interlayer of the given moduli.

    Args:
        glue: its ghosts and calibration.
        layer: its moduli.
        no_fail: mask of ghosts that never break [q], or None.
    """
    joint, calibration = glue
    for name in ("E", "shear", "G0"):
        shape = np.shape(
            getattr(layer, name) if getattr(layer, name) is not None else 0
        )
        if shape not in ((), joint.area.shape):
            raise ValueError(
                f"interlayers: {name} of shape {shape} must be one number, or one for "
                f"each of {len(joint.area)} ghosts"
            )
    E = jnp.asarray(layer.E)
    s, k0 = calibration(E, layer.shear)
    G0, stored = layer.G0, (0.0, 0.0)
    if G0 is not None:
        stored = calibration.stored(E, s, k0)
        if no_fail is not None:
            G0 = jnp.where(no_fail, jnp.inf, G0)
    return GhostForce(joint, s, k0, G0, stored, layer.one_way)


def glue_mass(glue: Glue, layer: Interlayer, n: int) -> jax.Array:
    """What an interlayer adds to the masses of its faces [n] (kg)."""
    joint, calibration = glue
    share = joint.weights * (layer.rho * calibration.h * joint.area)[:, None]
    return jnp.zeros(n).at[joint.points[joint.sources]].add(share)
