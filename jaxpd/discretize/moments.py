"""The moment matrix of a star, which MLS and reproducing kernels share.

A star is a node with the neighbours within its support radius rho. With monomials of
q = (x - y) / rho up to a degree and a weight w(|q|),

    M = sum over the star  w p p^T,    p = (1, q_1, .., q_d, q_1^2 / 2, q_1 q_2, ..)

must be invertible, and well enough conditioned: the support of a node grows until it
is. Which nodes are in a star, and its radius, are found on the host and then frozen;
M itself is traced in the positions.

Weight: w = (1 - |q|)^4, as in later papers on the MLS difference method; paper 001
names none.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial import KDTree

from jaxpd._types import PointScalar, PointVector, namespace

#: Condition number of sqrt(w) p, its columns of length 1, above which a support grows.
WORST = 1e4
#: By how much it grows at once, and how often at most.
GROWTH, TRIES = 1.1, 12


def powers(d: int, degree: int) -> tuple[tuple[int, ...], ...]:
    """Multi-indices of the monomials up to a degree, by degree: 1, x, y, x^2, xy, .."""
    every = itertools.product(range(degree + 1), repeat=d)
    kept = [p for p in every if sum(p) <= degree]
    return tuple(sorted(kept, key=lambda p: (sum(p), tuple(-a for a in p))))


def monomials(q: Any, degree: int) -> Any:
    """Scaled monomials [..., K] of q [..., d]: Taylor's, each over its factorials."""
    xp = namespace(q)
    columns = []
    for power in powers(q.shape[-1], degree):
        term = xp.ones_like(q[..., 0])
        for a, p in enumerate(power):
            for _ in range(p):
                term = term * q[..., a]
        columns.append(term / math.prod(map(math.factorial, power)))
    return xp.stack(columns, axis=-1)


def weight(q: Any) -> Any:
    """The weight (1 - |q|)^4 of q [..., d] inside the support, zero outside."""
    xp = namespace(q)
    square = xp.sum(q * q, axis=-1)
    length = xp.sqrt(xp.where(square > 0, square, 1.0))
    length = xp.where(square > 0, length, 0.0)
    return xp.where(length < 1.0, (1.0 - length) ** 4, 0.0)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Stars:
    """Neighbours of some places, slot by slot, padded; topology, frozen.

    Attributes:
        nbr: numbers of the neighbours [k, q], int32, nearest first.
        there: mask [k, q], False where padded.
        support: radii rho [q] (m).
    """

    nbr: jax.Array
    there: jax.Array
    support: PointScalar


def find_stars(
    places: ArrayLike, X: ArrayLike, support: ArrayLike, degree: int
) -> Stars:
    """The nodes within the support of each place, grown until the moments are sound.

    Args:
        places: where [q, d] (m).
        X: the nodes [n, d] (m).
        support: first radii [q] or [] (m).
        degree: of the monomials.

    Raises:
        ValueError: naming the first place whose neighbours are too few, or degenerate
            (all on a line or a curve of that degree), at any support tried; or nodes
            that coincide.
    """
    at, nodes = np.asarray(places, float), np.asarray(X, float)
    rho = np.array(np.broadcast_to(np.asarray(support, float), (len(at),)))
    if not (np.isfinite(rho) & (rho > 0)).all():
        raise ValueError(f"support: radii from {rho.min()} must be positive (m)")
    tree = KDTree(nodes)
    if len(nodes) > 1:
        near: Any = tree.query(nodes, k=2)[0][:, 1]
        if near.min() <= 1e-12 * rho.max():
            bad = int(np.argmin(near))
            raise ValueError(f"X: node {bad} at {nodes[bad]} coincides with another")
    found: list[NDArray[np.integer]] = [np.zeros(0, int)] * len(at)
    left, condition = np.arange(len(at)), np.zeros(len(at))
    for _ in range(TRIES):
        for i, star in zip(
            left, tree.query_ball_point(at[left], rho[left]), strict=True
        ):
            far = np.linalg.norm(nodes[star] - at[i], axis=1)
            found[i] = np.asarray(star)[np.lexsort((star, far))]
        condition[left] = _conditions(
            at[left], nodes, [found[i] for i in left], rho[left], degree
        )
        left = left[~(condition[left] < WORST)]
        if not len(left):
            break
        rho[left] *= GROWTH
    if len(left):
        bad, need = int(left[0]), len(powers(at.shape[1], degree))
        raise ValueError(
            f"support: the place {bad} at {at[bad]} sees {len(found[bad])} nodes within"
            f" {rho[bad] / GROWTH:.4g} m, and {need} monomials of degree {degree} are "
            f"not determined by them (condition number {condition[bad]:.1e}, at most "
            f"{WORST:.0e}); add nodes there, make cells nearer to square, the support "
            "larger, or the degree lower"
        )
    nbr, there = _pad(found)
    return Stars(jnp.asarray(nbr), jnp.asarray(there), jnp.asarray(rho))


def _pad(found: list[NDArray[np.integer]]) -> tuple[np.ndarray, np.ndarray]:
    """Lists of neighbours as [k, q], padded with the nearest, and what is there."""
    size = np.array([len(star) for star in found])
    nbr = np.zeros((int(size.max(initial=1)), len(found)), np.int32)
    there = np.arange(len(nbr))[:, None] < size
    for q, star in enumerate(found):
        nbr[: len(star), q] = star
        nbr[len(star) :, q] = star[0]
    return nbr, there


def _conditions(
    at: np.ndarray, nodes: np.ndarray, found: list[Any], rho: np.ndarray, degree: int
) -> np.ndarray:
    """Condition numbers [q] of sqrt(w) p, infinite with fewer nodes than monomials."""
    few = np.array([len(star) for star in found]) < len(powers(at.shape[1], degree))
    out = np.full(len(at), np.inf)
    for part in np.array_split(np.flatnonzero(~few), max(1, len(at) // 4096)):
        if not len(part):
            continue
        nbr, there = _pad([found[i] for i in part])
        q = (nodes[nbr.T] - at[part][:, None, :]) / rho[part][:, None, None]
        root = np.where(there.T, np.sqrt(weight(q)), 0.0)
        columns = root[:, :, None] * monomials(q, degree)
        columns /= np.maximum(np.linalg.norm(columns, axis=1, keepdims=True), 1e-300)
        size = np.linalg.svd(columns, compute_uv=False)
        out[part] = size[:, 0] / np.maximum(size[:, -1], 1e-300)
    return out


def spacing(X: ArrayLike) -> NDArray[np.floating]:
    """Local spacing [n] (m) of nodes.

    The mean distance of the 2 d nearest others, and of it the median over a node and
    its 3^d - 1 nearest, so that a node moved at random does not change it much.
    """
    nodes = np.asarray(X, float)
    n, d = nodes.shape
    if n < 2:
        raise ValueError(f"X: {n} node has no spacing; give at least two")
    far: Any
    near: Any
    far, near = KDTree(nodes).query(nodes, k=min(3**d, n))
    return np.median(far[:, 1 : 2 * d + 1].mean(axis=1)[near], axis=1)


def star_moments(
    places: PointVector, X: PointVector, stars: Stars, degree: int
) -> tuple[Any, Any, Any]:
    """Monomials [q, k, K], weights [q, k] and moment matrices M [q, K, K] of stars."""
    xi = X[stars.nbr] - places[None]
    q = jnp.swapaxes(xi / stars.support[None, :, None], 0, 1)
    p = monomials(q, degree)
    w: Any = jnp.where(stars.there.T, weight(q), 0.0)
    return p, w, jnp.einsum("qk,qki,qkj->qij", w, p, p)
