"""Reproducing kernel shape functions with their derivatives (paper 004, eq. 6 to 9).

Each node I carries a kernel phi_I of radius a_I. At a place x the shape functions are

    Psi_I(x) = b(x) . p(x_I - x) phi_I(x - x_I),    A b = p(0),    A = sum phi p p^T,

so that polynomials of the degree of the basis are reproduced. The frame of p may be
moved at will; held still while x moves, the derivatives of A come of phi alone,

    A b_k = p_,k - A_,k b,   A b_kl = p_,kl - A_,k b_l - A_,l b_k - A_,kl b.

Neighbours and radii are found on the host and frozen; all else is traced in places and
nodes. The kernel is the cubic B-spline, twice continuously differentiable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from jaxpd._types import PointScalar, PointVector
from jaxpd.discretize.moments import monomials, powers

#: Condition number of A in units of the radius above which radii nearby grow.
WORST = 1e8
#: By how much they grow at once, and how often at most.
GROWTH, TRIES = 1.1, 12
#: Lists of nodes are padded to multiples of this: bodies alike compile once.
ROUND = 4
#: Radius over the distance of the node that a basis needs at least (findings: 4 + 8 f
#: neighbours of a quadratic basis in a plane, f the share of a full angle).
GUARD = {1: 1.05, 2: 1.15, 3: 1.15}


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Cover:
    """Which nodes' kernels reach some places; topology, frozen.

    Attributes:
        nbr: numbers of the nodes [k, q], int32, nearest first.
        there: mask [k, q], False where padded.
        radius: of the kernel of each node [n] (m).
        scale: unit of length of the basis at each place [q] (m).
    """

    nbr: jax.Array
    there: jax.Array
    radius: PointScalar
    scale: PointScalar


def kernel(q: Any) -> tuple[Any, Any, Any]:
    """The cubic B-spline phi of q = r / a, phi' / q and (phi'' - phi' / q) / q^2."""
    near, far = q < 0.5, 1.0 - jnp.minimum(q, 1.0)
    safe: Any = jnp.where(q > 0.0, q, 1.0)
    value = jnp.where(near, 2 / 3 - 4 * q**2 * (1 - q), 4 / 3 * far**3)
    slope = jnp.where(near, -8 + 12 * q, -4 * far**2 / safe)
    bend = jnp.where(near, 12 / safe, (8 * far + 4 * far**2 / safe) / safe**2)
    return value, slope, jnp.where(q > 0.0, bend, 0.0)


def radii(
    X: ArrayLike, share: ArrayLike, support: float, degree: int
) -> NDArray[np.floating]:
    """Radii of kernels [n] (m): `support` local spacings, and enough neighbours.

    Args:
        X: nodes [n, d] (m).
        share: of a full angle inside the body at each node [n] (-).
        support: over the local spacing, the mean distance of the 2 d nearest others, of
            fewer at the boundary.
        degree: of the basis.
    """
    nodes, f = np.asarray(X, float), np.asarray(share, float)
    n, d = nodes.shape
    if d == 1:
        few, need = np.where(f < 0.75, 1, 2), np.full(n, degree)
    elif d == 2:
        few = np.where(f <= 0.3, 2, np.where(f <= 0.6, 3, 4))
        need = np.rint((4 + 8 * f) if degree > 1 else (2 + 4 * f)).astype(int)
    else:
        few = np.where(f <= 0.2, 3, np.where(f <= 0.6, 5, 6))
        need = np.rint((10 + 20 * f) if degree > 1 else (4 + 8 * f)).astype(int)
    most = int(max(few.max(), need.max()))
    if n <= most:
        raise ValueError(f"X: {n} nodes are too few for a basis of degree {degree}")
    far: Any = KDTree(nodes).query(nodes, k=most + 1)[0][:, 1:]
    row = np.arange(n)
    if not far[:, 0].min() > 1e-12 * far.max():
        bad = int(np.argmin(far[:, 0]))
        raise ValueError(f"X: node {bad} at {nodes[bad]} coincides with another")
    near = np.cumsum(far, axis=1)[row, few - 1] / few
    return np.maximum(support * near, GUARD[d] * far[row, need - 1])


def find_cover(
    places: ArrayLike, X: ArrayLike, radius: ArrayLike, degree: int
) -> Cover:
    """The nodes whose kernels reach each place; radii grow until moments are sound.

    Args:
        places: where [q, d] (m).
        X: the nodes [n, d] (m).
        radius: of each node [n] (m).
        degree: of the basis.

    Raises:
        ValueError: naming the first place where the moments stay unsound.
    """
    at, nodes = np.asarray(places, float), np.asarray(X, float)
    a = np.array(np.broadcast_to(np.asarray(radius, float), (len(nodes),)))
    if not (np.isfinite(a) & (a > 0)).all():
        raise ValueError(f"radius: from {a.min()} must be positive (m)")
    tree, need = KDTree(nodes), len(powers(nodes.shape[1], degree))
    left = np.arange(len(at))
    for t in range(TRIES):
        nbr, there, near = _reach(tree, at[left], a)
        left = left[_conditions(at[left], nodes, (nbr, there), a, degree) > WORST]
        if not len(left):
            if t == 0:  # no radius grew: these are the lists
                return _cover(a, nbr, there, near)
            break
        # of the nearest, whether they reach it or not, ever more of them
        grow = tree.query(at[left], k=min(need + 2 + 2 * t, len(nodes)))[1]
        a[np.unique(grow)] *= GROWTH
    if len(left):
        there = _reach(tree, at[left[:1]], a)[1]
        raise ValueError(
            f"support: the place {left[0]} at {at[left[0]]} is reached by "
            f"{int(there.sum())} kernels, and {need} monomials of degree {degree} are "
            "not determined by them; add nodes there, make cells nearer to square, the "
            "support larger, or the degree lower"
        )
    return cover_of(at, nodes, a)


def cover_of(at: np.ndarray, nodes: np.ndarray, radius: np.ndarray) -> Cover:
    """The cover of places [q, d] by kernels of given radii [n] (m), unchecked. Host."""
    return _cover(radius, *_reach(KDTree(nodes), at, radius))


def check_cover(at: np.ndarray, nodes: np.ndarray, cover: Cover, degree: int) -> None:
    """Refuse places that are outside the box of the nodes, or hardly reached. Host.

    Raises:
        ValueError: naming the first of them.
    """
    lists = np.asarray(cover.nbr).T, np.asarray(cover.there).T
    bad = _conditions(at, nodes, lists, np.asarray(cover.radius), degree) > 1e3 * WORST
    slack = 1e-9 * np.ptp(nodes, axis=0).max()
    low, high = nodes.min(axis=0) - slack, nodes.max(axis=0) + slack
    bad |= ((at < low) | (at > high)).any(axis=1)
    if bad.any():
        first = int(np.argmax(bad))
        raise ValueError(
            f"places: {at[first]}, number {first}, lies outside the body: too few "
            "kernels reach it; give places inside"
        )


def _cover(radius: Any, nbr: Any, there: Any, near: Any) -> Cover:
    return Cover(
        jnp.asarray(nbr.T.astype(np.int32)),
        jnp.asarray(there.T),
        jnp.asarray(radius),
        jnp.asarray(np.maximum(radius[nbr[:, 0]], near)),
    )


def _reach(tree: KDTree, at: np.ndarray, a: np.ndarray) -> tuple[Any, Any, Any]:
    """Neighbours [q, k], padded with the nearest, whether they reach, and how far."""
    n, most = len(a), a.max()
    crowd = tree.query_ball_point(
        at[:: max(1, len(at) // 500)], most, return_length=True
    )
    k = int(1.1 * np.max(crowd)) // 2
    while True:
        k = min(2 * k + 1, n)
        found = tree.query(at, k=k, distance_upper_bound=most)
        far, nbr = (np.reshape(x, (len(at), k)) for x in found)
        if k == n or np.isinf(far[:, -1]).all():
            break
    nbr = np.where(nbr == n, nbr[:, :1], nbr)
    if (nbr == n).any():
        nearest = np.reshape(tree.query(at)[1], (len(at), 1))
        nbr = np.where(nbr == n, nearest, nbr)
    there = far < a[nbr] * (1.0 - 1e-12)
    order = np.argsort(~there, axis=1, kind="stable")
    most = max(1, int(there.sum(axis=1).max()))
    width = min(-(-most // ROUND) * ROUND, k)
    nbr, there, far = (
        np.take_along_axis(x, order, axis=1)[:, :width] for x in (nbr, there, far)
    )
    reach = np.where(there, far, 0.0).max(axis=1)
    return np.where(there, nbr, nbr[:, :1]), there, reach


def _conditions(
    at: np.ndarray, nodes: np.ndarray, found: Any, a: np.ndarray, degree: int
) -> np.ndarray:
    """Condition numbers [q] of the moment matrices, infinite with too few nodes."""
    nbr, there = found
    need, out = len(powers(at.shape[1], degree)), np.full(len(at), np.inf)
    for part in np.array_split(np.arange(len(at)), max(1, len(at) // 8192)):
        xi = nodes[nbr[part]] - at[part][:, None]
        q = np.sqrt((xi**2).sum(axis=2)) / a[nbr[part]]
        phi = np.where(there[part], np.asarray(_value(q)), 0.0)
        p = monomials(xi / a[nbr[part, :1]][:, :, None], degree)
        moments = (p * phi[..., None]).transpose(0, 2, 1) @ p
        size = np.linalg.eigvalsh(moments)
        out[part] = size[:, -1] / np.maximum(size[:, 0], 1e-300)
    return np.where(there.sum(axis=1) < need, np.inf, out)


def _value(q: np.ndarray) -> np.ndarray:
    far = 1.0 - np.minimum(q, 1.0)
    return np.where(q < 0.5, 2 / 3 - 4 * q**2 * (1 - q), 4 / 3 * far**3)


def shape_functions(
    places: PointVector, X: PointVector, cover: Cover, degree: int = 2, order: int = 1
) -> tuple[jax.Array, ...]:
    """Shape functions at some places and their derivatives up to `order`.

    Traced in places and nodes; neighbours and radii are frozen.

    Args:
        places: where [q, d] (m).
        X: nodes [n, d] (m).
        cover: of the places.
        degree: of the basis.
        order: of derivatives, 0, 1 or 2.

    Returns:
        Psi [k, q], its gradient [d, k, q] (1/m), its second derivatives [d, d, k, q]
        (1/m^2); zero where padded.
    """
    q, d = places.shape
    xi = jnp.swapaxes(X[cover.nbr] - places[None], 0, 1)
    a = cover.radius[cover.nbr].T
    square = jnp.sum(xi * xi, axis=-1)
    r = jnp.sqrt(jnp.where(square > 0.0, square, 1.0))
    value, slope, bend = kernel(jnp.where(square > 0.0, r, 0.0) / a)
    there = cover.there.T

    def on(f) -> Any:  # where the kernel reaches
        return jnp.where(there, f, 0.0)

    phi, s = on(value), cover.scale
    p = monomials(xi / s[:, None, None], degree)
    A = jnp.einsum("qk,qki,qkj->qij", phi, p, p)
    inverse = jnp.linalg.inv(A)

    def solve(right):  # [.., q, K], with one step of refinement
        x = jnp.einsum("qij,...qj->...qi", inverse, right)
        left = right - jnp.einsum("qij,...qj->...qi", A, x)
        return x + jnp.einsum("qij,...qj->...qi", inverse, left)

    def moment(f):  # sums over the nodes of f p: f [.., q, k]
        return jnp.einsum("...qk,qki->...qi", f, p)

    def on_nodes(b):  # b . p_I
        return jnp.einsum("...qi,qki->...qk", b, p)

    index, K = powers(d, degree), A.shape[-1]
    unit = jnp.eye(K, dtype=p.dtype)
    v = on_nodes(solve(jnp.broadcast_to(unit[0], (q, K))))
    out: list[Any] = [phi * v]
    if order == 0:
        return (out[0].T,)
    axes = [index.index(tuple(int(c == b) for c in range(d))) for b in range(d)]
    along = on(slope / a**2)
    dphi = along[None] * -jnp.moveaxis(xi, -1, 0)
    right = unit[jnp.asarray(axes)][:, None] / s[None, :, None]
    dv = on_nodes(solve(right - moment(dphi * v[None])))
    out.append(phi[None] * dv + dphi * v[None])
    if order > 1:
        if degree < 2:
            raise ValueError(f"degree: {degree} has no second derivatives to reproduce")
        eye = jnp.eye(d, dtype=p.dtype)
        normal = jnp.einsum("qka,qkb->abqk", xi, xi)
        ddphi = on(bend / a**4)[None, None] * normal
        ddphi += along[None, None] * eye[:, :, None, None]
        pairs = [
            [
                index.index(tuple((c == e) + (c == g) for c in range(d)))
                for g in range(d)
            ]
            for e in range(d)
        ]
        right = unit[jnp.asarray(pairs)][:, :, None] / s[None, None, :, None] ** 2
        cross = dphi[:, None] * dv[None]
        bent = cross + jnp.swapaxes(cross, 0, 1) + ddphi * v[None, None]
        out.append(phi[None, None] * on_nodes(solve(right - moment(bent))) + bent)
    return tuple(jnp.swapaxes(x, -1, -2) for x in out)
