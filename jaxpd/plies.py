"""A laminate taken apart, on the host: a scene for each ply.

Plies are prepared one by one, as bodies of their own; supports and loads are those of
the whole. What is between them: `jaxpd.glue`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from jaxpd.body import check_free, check_loose
from jaxpd.discretize.interlayer import Joint
from jaxpd.geometry import GridFamily, grid_pieces, lattice, pieces
from jaxpd.geometry.crack import beside, check_inside
from jaxpd.laminate import Laminate
from jaxpd.problem import Problem
from jaxpd.scene import Elastic, Scene


def ply_scenes(scene: Scene) -> list[Scene]:
    """Each ply of a laminate as a scene of its own, without supports and loads."""
    body = laminate_of(scene)
    _check_materials(scene)
    corners = np.array([at for box in body.plies for at in (box.lo, box.hi)])
    check_inside(scene.cracks, corners)
    found = []
    for i, box in enumerate(body.plies):
        material, resolution = (
            given[i] if type(given) in (tuple, list) else given
            for given in (scene.material, scene.resolution)
        )
        if resolution.dx is None:
            raise ValueError("dx: None; plies need a spacing, as in Bonds(dx=.., m=4)")
        one = dataclasses.replace(
            scene, body=box, material=material, resolution=resolution
        )
        layers = [list(pair) for pair in one.layers()]
        if i > 0:  # a face to an interlayer has none
            layers[body.axis][0] = 0
        if i < len(body.plies) - 1:
            layers[body.axis][1] = 0
        layers = tuple((below, above) for below, above in layers)
        X = np.asarray(points_of(box, resolution, layers).X)
        found.append(
            dataclasses.replace(
                one,
                resolution=dataclasses.replace(resolution, layers=layers),
                supports=(),
                loads=(),
                starts=(),
                cracks=[c for c in scene.cracks if not beside(c, X)],
                no_fail=[r for r in scene.no_fail if r.contains(X).any()],
            )
        )
    return found


def _check_materials(scene: Scene) -> None:
    given = scene.material
    each = given if type(given) in (tuple, list) else (given,)
    if len(each) == 1 and np.ndim(getattr(each[0], "E", 0.0)):
        raise ValueError(
            "material: a modulus of every point goes by plies: a list of materials, "
            "each with an array of the points of its ply"
        )
    states = {m.state for m in each if isinstance(m, Elastic)}
    if len(states) > 1:
        raise ValueError(f"material: plies must share a state, not {sorted(states)}")


def laminate_of(scene: Scene) -> Laminate:
    """The body of a scene that is a laminate."""
    assert isinstance(scene.body, Laminate)
    return scene.body


def points_of(box: Any, resolution: Any, layers: Any) -> Any:
    """The points of a ply, a lattice."""
    how = {"layers": layers, "nodes": resolution.nodes}
    return lattice(box.lo, box.hi, resolution.dx, **how)


def check_stack(
    X: np.ndarray, plies: Sequence[Problem], joints: Sequence[Joint], fixed: np.ndarray
) -> None:
    """Refuse a laminate that can still move freely; interlayers hold plies together."""
    labels, first, pairs, count = [], 0, [], 0
    for ply in plies:
        family = ply.family
        if isinstance(family, GridFamily):
            found = grid_pieces(family)
        else:
            found = pieces(np.asarray(family.nbr))[: len(ply.X)]
        labels.append(found + count)
        count += int(found.max()) + 1
        if ply.extension is None:
            check_loose(ply.X, ply.family, fixed[first : first + len(ply.X)])
        first += len(ply.X)
    label = np.concatenate(labels)
    for joint in joints:
        ends = label[joint.points[joint.sources[joint.intact]]]
        pairs += [np.stack([ends[:, 0], end], axis=1) for end in ends.T[1:]]
    at = np.concatenate([*pairs, np.zeros((0, 2), int)]).astype(int)
    graph = sp.coo_matrix((np.ones(len(at)), (at[:, 0], at[:, 1])), shape=(count,) * 2)
    check_free(X, connected_components(graph, directed=False)[1][label], fixed)
