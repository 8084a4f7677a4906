"""Where a weak form is sampled: nodes, circles about them, triangles, cells of nodes.

A rule has g places in each of c cells. All follow the nodes: places and weights are
traced, which triangles and nearest nodes there are is frozen.

    "nodes"      each node, with its volume: plain nodal integration
    "circles"    a circle of the node's volume, a sector of it at the boundary, by Gauss
                 along radius and angle (paper 004, eq. 30, 31); in 1-D its two halves
    "triangles"  Gauss points of Delaunay's triangles, in 1-D of the intervals: the
                 background cells of classical meshfree methods
    "cells"      d + 1 places in the dual cell of each node, which integrate quadratic
                 polynomials over it whatever its shape

Volumes of nodes are paper 004's (eq. 18): shares of a full angle times squares of local
spacings, scaled to fill the body; or those of the dual cells.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import KDTree

from jaxpd._types import PointScalar, PointVector
from jaxpd.discretize.dual import Dual, cell_moments, dual
from jaxpd.discretize.moments import monomials
from jaxpd.geometry.outline import angles, polygon_moments

RULES = ("nodes", "circles", "triangles", "cells")
VOLUMES = ("spacing", "cells")
#: Gauss points of a triangle, their barycentric coordinates and shares, by their number
#: (Strang and Fix 1973; Dunavant 1985): exact for polynomials of degree 1, 2, 4 and 6.
TRIANGLE = {
    1: ([(1 / 3, 1 / 3)], [1.0]),
    3: ([(2 / 3, 1 / 6)], [1 / 3]),
    6: (
        [
            (0.108103018168070, 0.445948490915965),
            (0.816847572980459, 0.091576213509771),
        ],
        [0.223381589678011, 0.109951743655322],
    ),
    12: (
        [
            (0.501426509658179, 0.249286745170910),
            (0.873821971016996, 0.063089014491502),
            (0.053145049844817, 0.310352451033784),
        ],
        [0.116786275726379, 0.050844906370207, 0.082851075618374],
    ),
}


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Rule:
    """A rule on a body of nodes; topology, frozen.

    Attributes:
        edge: outline [s, 2]; in 1-D the two end nodes [1, 2].
        near: nearest nodes of each node [4, n], or fewer.
        counted: which of them the local spacing is the mean distance of.
        dual: triangles and cells, or None.
        kind: one of `RULES`.
        points: along the radius and the angle of a circle; in a triangle, and 0; 1 for
            the centroid of a cell alone.
        volumes: of nodes, one of `VOLUMES`.
        exact: whether weights are corrected so that polynomials of degree 2 are
            integrated over the body.
    """

    edge: jax.Array
    near: jax.Array
    counted: jax.Array
    dual: Dual | None
    kind: str = field(metadata={"static": True})
    points: tuple[int, int] = field(metadata={"static": True}, default=(2, 6))
    volumes: str = field(metadata={"static": True}, default="spacing")
    exact: bool = field(metadata={"static": True}, default=False)


def quadrature(
    X: ArrayLike,
    edge: Any,
    kind: str,
    *,
    points: tuple[int, int] = (2, 6),
    volumes: str = "spacing",
    exact: bool = False,
) -> Rule:
    """A rule on nodes [n, d] (m) in an outline [s, 2], None in 1-D. Host only."""
    nodes = np.asarray(X, float)
    n, d = nodes.shape
    if kind not in RULES or volumes not in VOLUMES:
        raise ValueError(f"kind: {kind!r} must be one of {RULES}, volumes of {VOLUMES}")
    if d == 1:
        edge = [[np.argmin(nodes[:, 0]), np.argmax(nodes[:, 0])]]
    rim = np.asarray(edge, int)
    share = shares(nodes, rim)
    few = np.where(share < 0.75, 1, 2)
    if d == 2:
        few = np.where(share <= 0.3, 2, np.where(share <= 0.6, 3, 4))
    near: Any = KDTree(nodes).query(nodes, k=min(2 * d + 1, n))[1]
    near = near[:, 1:]
    counted = np.arange(near.shape[1])[None] < few[:, None]
    cells = None
    if kind in ("triangles", "cells") or volumes == "cells":
        cells = dual(nodes, rim)
    return Rule(
        jnp.asarray(rim.astype(np.int32)),
        jnp.asarray(near.T.astype(np.int32)),
        jnp.asarray(counted.T),
        cells,
        kind,
        points,
        volumes,
        exact,
    )


def shares(X: Any, edge: Any) -> Any:
    """Share of a full angle inside the body at each node [n] (-)."""
    if X.shape[1] == 2:
        return angles(X, edge)[1] / (2.0 * np.pi)
    out = np.ones(len(X))
    out[np.asarray(edge).ravel()] = 0.5
    return out


def body_moments(X: Any, edge: Any, degree: int) -> Any:
    """Integrals of the monomials over the body up to a degree. Traced."""
    if X.shape[1] == 2:
        return polygon_moments(X, edge, degree)
    a, b = X[edge[0, 0], 0], X[edge[0, 1], 0]
    each = [(b - a), (b**2 - a**2) / 2.0, (b**3 - a**3) / 6.0]
    return jnp.stack(each[: degree + 1])


def volumes_of(X: PointVector, rule: Rule) -> PointScalar:
    """Volumes of the nodes [n] (m^d). Traced."""
    if rule.volumes == "cells":
        assert rule.dual is not None
        return cell_moments(X, rule.dual)[0]
    d = X.shape[1]
    if d == 1:
        share: Any = jnp.ones(len(X)).at[rule.edge.ravel()].set(0.5)
    else:
        share = shares(X, rule.edge)
    far = X[rule.near] - X[None]
    far = jnp.sqrt(jnp.sum(far * far, axis=-1))
    h = jnp.sum(jnp.where(rule.counted, far, 0.0), axis=0) / rule.counted.sum(axis=0)
    part = share * h**d
    return part / part.sum() * body_moments(X, rule.edge, 0)[0]


def places_of(X: PointVector, rule: Rule) -> tuple[jax.Array, jax.Array]:
    """Places [g, c, d] (m) and weights [g, c] (m^d) of a rule. Traced."""
    place, w = _plain(X, rule)
    if not rule.exact:
        return place, w
    # the least relative change of weights with which moments are those of the body
    middle, size = X.mean(axis=0), jnp.ptp(X, axis=0).max()
    p = monomials((place - middle[None, None]) / size, 2)
    moments = body_moments((X - middle[None]) / size, rule.edge, 2) * size ** X.shape[1]
    missed = moments - jnp.einsum("gc,gck->k", w, p)
    M = jnp.einsum("gc,gck,gcl->kl", w, p, p)
    return place, w * (1.0 + p @ jnp.linalg.solve(M, missed))


def _plain(X: PointVector, rule: Rule) -> tuple[jax.Array, jax.Array]:
    n, d = X.shape
    if rule.kind == "nodes":
        return X[None], volumes_of(X, rule)[None]
    if rule.kind == "triangles":
        return _triangles(X, rule)
    if rule.kind == "cells":
        assert rule.dual is not None
        volume, centroid, spread = cell_moments(X, rule.dual)
        if rule.points[0] == 1:
            return centroid[None], volume[None]
        e = simplex(d)
        place = centroid[None] + jnp.einsum("nab,gb->gna", stretch(spread), e)
        return place, jnp.broadcast_to(volume / (d + 1), (d + 1, n))
    volume = volumes_of(X, rule)
    along, around = rule.points
    r, wr = _gauss(along)
    if d == 1:
        end = rule.edge[0]
        f: Any = jnp.ones(n).at[end].set(0.5)
        radius = volume / (2.0 * f)
        side = jnp.concatenate([-r, r])[:, None]
        w = jnp.concatenate([wr, wr])[:, None] * radius[None]
        index = jnp.arange(n)[None]
        left, right = (side < 0) & (index == end[0]), (side > 0) & (index == end[1])
        beyond = left | right
        far: Any = jnp.where(beyond, 0.0, side * radius[None])
        kept: Any = jnp.where(beyond, 0.0, w)
        return X[None] + far[:, :, None], kept
    start, sweep = angles(X, rule.edge)
    radius = jnp.sqrt(2.0 * volume / sweep)
    t, wt = _gauss(around)
    angle = start[None] + t[:, None] * sweep[None]
    way = jnp.stack([jnp.cos(angle), jnp.sin(angle)], axis=-1)  # [around, n, 2]
    far = r[:, None, None] * radius[None, None]
    place = X[None, None] + far[..., None] * way[None]
    share = (wr * 2.0 * r)[:, None] * wt[None]
    w = share[:, :, None] * volume[None, None]
    return place.reshape(-1, n, 2), w.reshape(-1, n)


def _triangles(X: PointVector, rule: Rule) -> tuple[jax.Array, jax.Array]:
    assert rule.dual is not None
    at = X[rule.dual.triangle]
    if X.shape[1] == 1:
        r, w = _gauss(rule.points[0])
        length = at[:, 1] - at[:, 0]
        return at[None, :, 0] + r[:, None, None] * length[None], w[:, None] * length.T
    if rule.points[0] not in TRIANGLE:
        raise ValueError(
            f"points: {rule.points[0]} must be one of {tuple(TRIANGLE)} in a triangle"
        )
    share, w = [], []
    for (a, b), size in zip(*TRIANGLE[rule.points[0]], strict=True):
        c = 1.0 - a - b
        every = {(a, b, c), (b, c, a), (c, a, b), (a, c, b), (c, b, a), (b, a, c)}
        every = sorted({tuple(np.round(e, 12)) for e in every})
        share += every
        w += [size] * len(every)
    one, two = at[:, 1] - at[:, 0], at[:, 2] - at[:, 0]
    area = 0.5 * (one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    bary = np.array(share) / np.sum(share, axis=1, keepdims=True)
    place = jnp.einsum("gk,tka->gta", jnp.asarray(bary), at)
    return place, jnp.asarray(np.array(w) / np.sum(w))[:, None] * area[None]


def _gauss(points: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss's rule on 0 to 1."""
    x, w = np.polynomial.legendre.leggauss(points)
    return 0.5 * (1.0 + x), 0.5 * w


def simplex(d: int) -> np.ndarray:
    """Corners [d + 1, d] of a regular simplex, their covariance one."""
    if d == 1:
        return np.array([[-1.0], [1.0]])
    angle = np.pi * (0.5 + np.arange(3) * 2.0 / 3.0)
    return np.sqrt(2.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def stretch(spread: Any) -> jax.Array:
    """The lower factor L of covariances L L^T [n, d, d], in closed form."""
    if spread.shape[-1] == 1:
        return jnp.sqrt(spread)
    a = jnp.sqrt(spread[:, 0, 0])
    b = spread[:, 1, 0] / a
    c = jnp.sqrt(spread[:, 1, 1] - b * b)
    return jnp.stack(
        [jnp.stack([a, jnp.zeros_like(a)], -1), jnp.stack([b, c], -1)], axis=-2
    )
