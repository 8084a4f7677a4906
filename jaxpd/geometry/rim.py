"""The rim of a body as its nodes see it: where faces are, and which way they look.

Strong forms replace the balance of a node on a face by the traction there, so they need
the outward normal of every node on the boundary. A node on an edge or in a corner lies
on several faces and has an entry for each.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Rim:
    """Faces of nodes, one entry a node and face; frozen in shape derivatives.

    Attributes:
        node: number of the node [q], int32.
        normal: outward unit normal of its face [q, d].
        area: its share of the face [q] (m^(d-1)); they add up to the boundary.
        edge: of a plane body the edges [s, 2] between boundary nodes, int32, the body
            on their left, see `jaxpd.geometry.outline`; None if not known.
    """

    node: jax.Array
    normal: jax.Array
    area: jax.Array
    edge: jax.Array | None = None


def rim(node: ArrayLike, normal: ArrayLike, area: ArrayLike) -> Rim:
    """A rim of given nodes [q], normals [q, d], made units, and areas [q] (m^(d-1)).

    Raises:
        ValueError: on shapes that do not fit, normals of no length or areas that are
            not positive.
    """
    i, n, A = np.asarray(node), np.asarray(normal, float), np.asarray(area, float)
    if i.ndim != 1 or i.dtype.kind not in "iu" or (i < 0).any():
        raise ValueError(f"node: {node!r} must be a list of numbers of nodes")
    if n.ndim != 2 or len(n) != len(i) or A.shape != i.shape:
        raise ValueError(
            f"normal, area: shapes {n.shape} and {A.shape} must be [{len(i)}, d] and "
            f"[{len(i)}], one for each of the nodes"
        )
    length = np.linalg.norm(n, axis=1)
    if not (np.isfinite(length) & (length > 0)).all() or not (A > 0).all():
        raise ValueError("normal, area: normals need a length, and areas be positive")
    return Rim(
        jnp.asarray(i.astype(np.int32)),
        jnp.asarray(n / length[:, None]),
        jnp.asarray(A),
    )


def rim_of_grid(
    shape: Sequence[int], normals: NDArray[np.floating], areas: NDArray[np.floating]
) -> Rim:
    """The rim of a grid of nodes whose outermost ones lie on the faces.

    Args:
        shape: nodes along each axis.
        normals: at every node the outward normal of the upper face of each axis
            [n, d axes, d]; that of the lower face is its opposite.
        areas: at every node the area of a whole cell's face across each axis [n, d]
            (m^(d-1)); nodes on an edge of a face have half of it, in a corner a
            quarter.
    """
    d = len(shape)
    at = np.indices(shape).reshape(d, -1)
    end = [(at[a] == 0, at[a] == shape[a] - 1) for a in range(d)]
    half = np.stack([np.where(low | high, 0.5, 1.0) for low, high in end])
    node, normal, area = [], [], []
    for a in range(d):
        share = np.prod(np.delete(half, a, axis=0), axis=0)
        for sign, on in zip((-1.0, 1.0), end[a], strict=True):
            node.append(np.flatnonzero(on))
            normal.append(sign * normals[on, a])
            area.append(share[on] * areas[on, a])
    made = rim(np.concatenate(node), np.concatenate(normal), np.concatenate(area))
    if d != 2:
        return made
    loop = grid_loop((shape[0], shape[1]))
    edge = np.stack([loop, np.roll(loop, -1)], axis=1)
    return dataclasses.replace(made, edge=jnp.asarray(edge.astype(np.int32)))


def grid_loop(shape: tuple[int, int]) -> NDArray[np.integer]:
    """The nodes around a grid [n0, n1] of right-handed axes, counter-clockwise."""
    number = np.arange(shape[0] * shape[1]).reshape(shape)
    sides = (number[:-1, 0], number[-1, :-1], number[:0:-1, -1], number[0, :0:-1])
    return np.concatenate(sides)


def row_normals(
    faces: Rim, n: int, d: int
) -> tuple[NDArray[np.integer], NDArray[np.bool_]]:
    """Which entry of the rim each component of a node's traction row belongs to.

    In a corner each component takes the face that looks most along it, so that the
    corner of a roller and a free face has one row of each.

    Returns:
        The entry [n, d], and the mask [n] of nodes that have one.
    """
    node, normal = np.asarray(faces.node), np.asarray(faces.normal)
    entry = np.zeros((n, d), int)
    for a in range(d):
        along = np.abs(normal[:, a])
        order = np.argsort(along + 1e-9 * np.arange(len(node))[::-1], kind="stable")
        entry[node[order], a] = order  # the last one written looks most along the axis
    on = np.zeros(n, bool)
    on[node] = True
    return entry, on
