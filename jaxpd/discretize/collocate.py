"""Where a strong form is collocated: stars, rows of balance and of traction.

Topology on the host (`lay_out`), weights traced in the positions (`collocation`). Three
schemes have the same shape, weights from nodes to stress points and back to nodes:

    "double"    stress points are the nodes
    "midpoint"  stress points halfway between the nodes of a bar: differences of
                neighbours, which let no alternating stress or displacement pass
    "direct"    as "double" for tractions; see `jaxpd.operators.navier`
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd._types import PointScalar, PointVector
from jaxpd.discretize.mls import (
    apply_weights,
    curvatures,
    derivative_weights,
    slopes,
)
from jaxpd.discretize.moments import Stars, find_stars, spacing
from jaxpd.geometry import Cloud, row_normals
from jaxpd.physics.voigt import voigt

#: Sum of normals times areas over the area, above which a rim counts as open.
OPEN = 0.05


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Layout:
    """Topology of a collocation, frozen.

    Attributes:
        stars: of the nodes.
        back: slot of node i in the star of each node of its own star [k, n], -1 where
            there is none.
        point: stress point of each node's traction [n], int32.
        normal: outward normal of each component's row [n, d, d].
        pulled: mask [n, d] of rows of traction.
        h: scale of those rows [n] (m).
        order: nodes of a bar from left to right [n], int32; for "midpoint".
        degree: of the polynomials.
        scheme: "double", "direct" or "midpoint".
        projected: whether changes of volume are smoothed.
    """

    stars: Stars
    back: jax.Array
    point: jax.Array
    normal: jax.Array
    pulled: jax.Array
    h: PointScalar
    order: jax.Array
    degree: int = field(metadata={"static": True}, default=2)
    scheme: str = field(metadata={"static": True}, default="double")
    projected: bool = field(metadata={"static": True}, default=False)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Collocation:
    """Weights between nodes and stress points.

    Attributes:
        nodes_of: nodes of the star of each stress point [k, q], int32.
        B: weights of the gradient there [d, k, q] (1/m).
        points_of: stress points of the star of each node [l, n], int32.
        D: weights of a row [d, d, l, n] (1/m): component a sums D[a, b] times stress
            ab; of a traction row -normal / h at the node's own stress point.
        back: where node i is among `nodes_of` of its star's points [l, n], int32, -1
            where it is not.
        stars_of: nodes of the star of each node [k', n], int32.
        value: weights Phi of the value [k', n] (-).
        filtered: share of the filter in each row [n, d] (m^-2), zero at tractions.
        projected: whether the trace of strains is smoothed, by Phi twice.
    """

    nodes_of: jax.Array
    B: jax.Array
    points_of: jax.Array
    D: jax.Array
    back: jax.Array
    stars_of: jax.Array
    value: jax.Array
    filtered: jax.Array
    projected: bool = field(metadata={"static": True}, default=False)

    @property
    def q(self) -> int:
        """Number of stress points."""
        return self.B.shape[-1]

    def strain(self, u: PointVector) -> jax.Array:
        """Strains at stress points [q, s], engineering shear (-)."""
        slope = apply_weights(self.B, self.nodes_of, u)  # [b, q, a]: du_a / dx_b
        strain = jnp.einsum("sab,bqa->qs", voigt(u.shape[1]), slope)
        if not self.projected:
            return strain
        d = u.shape[1]
        trace = smooth = strain[:, :d].sum(axis=1)
        for _ in range(2):
            smooth = apply_weights(self.value, self.stars_of, smooth)
        return strain.at[:, :d].add((smooth - trace)[:, None] / d)

    def balance(self, stress: jax.Array) -> PointVector:
        """What stresses [q, s] (Pa) leave at each node [n, d] (N/m^3)."""
        tensor = jnp.einsum("sab,qs->qab", voigt(self.D.shape[0]), stress)
        return jnp.einsum("ablq,lqab->qa", self.D, tensor[self.points_of])

    def held(self, u: PointVector, shear: Any) -> PointVector:
        """The filter's force density over -tau [n, d] (N/m^3)."""
        mu = jnp.broadcast_to(jnp.asarray(shear, u.dtype), u.shape[:1])
        return self.filtered * mu[:, None] * self.rough(u)

    def rough(self, u: PointVector) -> PointVector:
        """(1 - Phi)^2 u [n, d] (m): what does not vary slowly from node to node."""
        for _ in range(2):
            u = u - apply_weights(self.value, self.stars_of, u)
        return u


def lay_out(
    cloud: Cloud,
    fixed: np.ndarray,
    *,
    degree: int = 2,
    support: float = 4.1,
    rim_support: float = 4.1,
    scheme: str = "double",
    projected: bool = False,
) -> Layout:
    """Stars and rows of a cloud with a rim. Host only.

    Args:
        cloud: nodes.
        fixed: mask of prescribed components [n, d].
        degree: of the polynomials.
        support: radius of the star of an inner node over the local spacing.
        rim_support: that of a node on the rim.
        scheme: "double", "direct" or "midpoint".
        projected: smooth changes of volume, where stress points are nodes.

    Raises:
        ValueError: without a rim or with an open one, on a degenerate star, or
            "midpoint" beyond 1-D.
    """
    X, rim = np.asarray(cloud.X), cloud.rim
    n, d = X.shape
    if rim is None:
        raise ValueError(
            "body: a strong form needs the normals of the boundary, and this cloud has "
            "no rim; use a box, jaxpd.mapped(..), or from_points(X, vol, rim)"
        )
    area = np.asarray(rim.area)
    hole = np.abs((np.asarray(rim.normal) * area[:, None]).sum(axis=0)).max()
    if hole > OPEN * area.sum():
        raise ValueError(
            f"rim: its faces leave {hole:.3g} of {area.sum():.3g} m^(d-1) open: the "
            "normals of a closed surface balance; give every node on the boundary its "
            "face, and let normals look outwards"
        )
    entry, on = row_normals(rim, n, d)
    h = spacing(X)
    stars = find_stars(X, X, np.where(on, rim_support, support) * h, degree)
    normal = np.where(on[:, None, None], np.asarray(rim.normal)[entry], 0.0)
    point, order = np.arange(n), np.argsort(X[:, 0], kind="stable")
    if scheme == "midpoint":
        if d > 1:
            raise ValueError(f"scheme: 'midpoint' is for bars, and this body is {d}-D")
        rank = np.argsort(order)
        point = np.clip(rank - (rank == n - 1), 0, n - 2)
        gaps = np.diff(X[order, 0])
        h = 0.5 * gaps[point]
    return Layout(
        stars=stars,
        back=jnp.asarray(_back(stars)),
        point=jnp.asarray(point.astype(np.int32)),
        normal=jnp.asarray(normal),
        pulled=jnp.asarray(on[:, None] & ~np.asarray(fixed)),
        h=jnp.asarray(h),
        order=jnp.asarray(order.astype(np.int32)),
        degree=degree,
        scheme=scheme,
        projected=projected,
    )


def _back(stars: Stars) -> np.ndarray:
    nbr, there = np.asarray(stars.nbr), np.asarray(stars.there)
    k, n = nbr.shape
    here, back = np.arange(n)[None], np.full((k, n), -1)
    for s in range(k):
        match = (nbr[:, nbr[s]] == here) & there[:, nbr[s]]
        back[s] = np.where(match.any(axis=0), match.argmax(axis=0), -1)
    return np.where(there, back, -1).astype(np.int32)


def collocation(X: PointVector, layout: Layout) -> Collocation:
    """Weights of a layout, traced in the positions X [n, d]; normals and h frozen."""
    n, d = X.shape
    stars = layout.stars
    weights = derivative_weights(X, X, stars, layout.degree)
    square = 1.0 / layout.h**2
    if layout.scheme == "midpoint":
        parts: Any = _midpoints(X, layout)
        filtered = jnp.zeros_like(X)
    else:
        B = jnp.where(stars.there[None], slopes(weights, d), 0.0)
        D = jnp.broadcast_to(B[None], (d, *B.shape))
        at_node = (stars.nbr == jnp.arange(n)[None]) & stars.there
        D = _with_tractions(D, layout, at_node)
        parts = (stars.nbr, B, stars.nbr, D, layout.back)
        filtered = jnp.where(layout.pulled, 0.0, square[:, None])
    maps: Any = (*parts, stars.nbr, weights[0], filtered)
    return Collocation(*maps, projected=layout.projected)


def _with_tractions(D: Any, layout: Layout, at_node: Any) -> jax.Array:
    """Rows of balance [d, d, l, n] with those of traction in their place."""
    rows: Any = -jnp.transpose(layout.normal, (1, 2, 0)) / layout.h[None, None, :]
    rows = jnp.where(at_node[None, None], rows[:, :, None, :], 0.0)
    return jnp.where(layout.pulled.T[:, None, None, :], rows, D)


def _midpoints(X: PointVector, layout: Layout) -> tuple[jax.Array, ...]:
    """Differences of neighbours in a bar, and of the stresses between them."""
    n, order = X.shape[0], layout.order
    gap = jnp.diff(X[order, 0])
    q = jnp.arange(n - 1, dtype=order.dtype)
    nodes_of = jnp.stack([order[:-1], order[1:]])
    B = jnp.stack([-1.0 / gap, 1.0 / gap])[None]
    rank = jnp.argsort(order).astype(order.dtype)
    left, right = jnp.maximum(rank - 1, 0), jnp.minimum(rank, n - 2)
    points_of = jnp.stack([left, right])
    inner = (rank > 0) & (rank < n - 1)
    cell = 0.5 * (gap[left] + gap[right])
    across = jnp.stack([-1.0 / cell, 1.0 / cell])
    # at the ends both slots are the same point: the first one counts
    own = jnp.stack([~inner, jnp.zeros_like(inner)])
    D = jnp.where(inner[None], across, 0.0)[None, None]
    D = _with_tractions(D, layout, own)
    # node i is the right one of the point on its left, the left one of the other
    back = jnp.where(q[points_of] == rank[None], 0, 1).astype(order.dtype)
    return nodes_of, B, points_of, D, back


def second_derivatives(X: PointVector, layout: Layout) -> jax.Array:
    """Weights of second derivatives at nodes [d, d, k, n] (1/m^2)."""
    weights = derivative_weights(X, X, layout.stars, layout.degree)
    second = curvatures(weights, X.shape[1], layout.degree)
    return jnp.where(layout.stars.there[None, None], second, 0.0)
