"""Points whose values are averages of others: u_all = P u.

P is the identity on the n points of the body and gives q more points, numbered from n
on, a short list of points and weights each. Weights that add up to 1, and that put the
new point where its list says (X_new = sum of weight X), reproduce affine fields: then
P^T maps forces on all points to forces on the body with the same resultant and moment.

`beyond_faces` makes the fictitious points of a box: layers of the lattice outside its
faces, whose displacement continues the body's linearly: the least-squares line through
the R outermost rows, axis by axis beyond edges and corners (R^d weights at most). With
the horizon m spacings R = ceil(3 m / 2): few rows amplify, and an explicit run pays in
its time step, the inverse root of the largest eigenvalue of K. Over that without
correction it is (`benchmarks/surfaces.py`, PMB material in plane stress, m = 4)

    33 with R = 2,   2.8 with R = 4,   1.37 with R = 6,   1.22 with R = 8,

1.14 of which is the stiffer bulk: the energy is that of the body's own points, each
with a whole neighbourhood, and with an `Elastic` material their energy is scaled to the
classical one as by the energy method in the bulk. The energy method has 1.34.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from jaxpd.geometry.cloud import Cloud, Lattice
from jaxpd.geometry.crack import Crack
from jaxpd.geometry.family import HORIZON_TOLERANCE, Family, find
from jaxpd.geometry.grid_family import half_offsets


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Extension:
    """The map P from n points to n + q.

    Attributes:
        sources: point numbers [q, w] that each new point is made of, int32.
        weights: their weights [q, w] (-); zero where a list is shorter.
    """

    sources: Any
    weights: Any

    def __call__(self, values: jax.Array) -> jax.Array:
        """P values: [n, ...] to [n + q, ...]."""
        weights = jnp.expand_dims(self.weights, range(2, values.ndim + 1))
        new = (weights * jnp.asarray(values)[self.sources]).sum(axis=1)
        return jnp.concatenate([values, new])

    def transpose(self, values: jax.Array) -> jax.Array:
        """P^T values: [n + q, ...] to [n, ...]."""
        n = len(values) - len(self.sources)
        weights = jnp.expand_dims(self.weights, range(2, values.ndim + 1))
        back = weights * values[n:][:, None]
        flat = back.reshape(-1, *values.shape[1:])
        return values[:n].at[jnp.ravel(self.sources)].add(flat)

    def lists(self, n: int) -> tuple[Any, Any]:
        """Point numbers and weights [n + q, w] of all points, the body's own too."""
        w = self.sources.shape[1]
        own = jnp.broadcast_to(jnp.arange(n, dtype=self.sources.dtype)[:, None], (n, w))
        one = jnp.zeros((n, w), self.weights.dtype).at[:, 0].set(1.0)
        return (
            jnp.concatenate([own, self.sources]),
            jnp.concatenate([one, self.weights]),
        )

    def matrix(self, n: int) -> sp.csr_matrix:
        """P [n + q, n] on the host."""
        sources, weights = map(np.asarray, (self.sources, self.weights))
        q, w = sources.shape
        row = np.concatenate([np.arange(n), n + np.repeat(np.arange(q), w)])
        col = np.concatenate([np.arange(n), sources.ravel()])
        value = np.concatenate([np.ones(n), weights.ravel()])
        matrix = sp.csr_matrix((value, (row, col)), shape=(n + q, n))
        matrix.eliminate_zeros()
        return matrix


def line(R: int, k: int) -> dict[int, float]:
    """Rows 0.. and weights of row -k on the least-squares line through R rows."""
    x = np.arange(R) - 0.5 * (R - 1)
    weight = 1.0 / R - x * (k + 0.5 * (R - 1)) / (x @ x)
    return dict(enumerate(weight.tolist()))


def beyond_faces(
    cloud: Cloud,
    delta: float,
    *,
    partial: str = "none",
    cracks: Sequence[Crack] = (),
    free: Sequence[tuple[bool, bool]] | None = None,
    rows: int | None = None,
) -> tuple[Family, Extension]:
    """Fictitious points beyond the free faces of a lattice, as thick as the horizon.

    Args:
        cloud: the body, a lattice of even spacing and volumes.
        delta: horizon (m).
        partial: as in `jaxpd.geometry.family.find`.
        cracks: bonds that they cut are left out.
        free: (below, above) per axis, whether that face gets points; all by default.
        rows: rows that the line goes through; 3 / 2 of the horizon's by default.

    Returns:
        The bonds of all points, the body's first, without those between two
        fictitious points; and the extension.

    Raises:
        ValueError: on points that are no lattice, a body thinner than the horizon, or a
            crack within a horizon of a face with fictitious points.
    """
    grid = cloud.lattice
    if grid is None or not cloud.regular:
        raise ValueError(
            "correction: 'fictitious' needs a lattice of even spacing and volumes; use "
            "'energy' for points from elsewhere"
        )
    d = len(grid.shape)
    layers = int(np.abs(half_offsets(d, delta / grid.dx, partial)).max())
    rows = rows or math.ceil(1.5 * delta / grid.dx * (1 - HORIZON_TOLERANCE))
    sides = np.ones((d, 2), bool) if free is None else np.asarray(free, bool)
    extra = np.where(sides, layers, 0)
    check_cracks(grid, delta, cracks, sides)
    shape = tuple(np.asarray(grid.shape) + extra.sum(axis=1))
    place = np.indices(shape).reshape(d, -1).T - extra[:, 0]
    body = ((place >= 0) & (place < grid.shape)).all(axis=1)
    per_axis = [_rows(n, e, rows) for n, e in zip(grid.shape, extra, strict=True)]
    sources, weights = _compose(place[~body], grid.shape, per_axis)
    X = np.asarray(grid.origin) + grid.dx * place
    origin = tuple(float(o) for o in np.asarray(grid.origin) - grid.dx * extra[:, 0])
    everyone = Cloud(
        jnp.asarray(X),
        jnp.full(len(X), grid.dx**d),
        Lattice(shape, grid.dx, origin),
    )
    found = find(everyone, delta, partial=partial, cracks=cracks)
    order = np.concatenate([np.flatnonzero(body), np.flatnonzero(~body)])
    number = np.argsort(order).astype(np.int32)
    nbr, n = number[np.asarray(found.nbr)[:, order]], int(body.sum())
    here = np.arange(len(order), dtype=np.int32)
    nbr = np.where((nbr >= n) & (here >= n), here, nbr)
    family = Family(jnp.asarray(nbr), found.bulk, partial)
    dtype = np.asarray(cloud.X).dtype
    return family, Extension(jnp.asarray(sources), jnp.asarray(weights.astype(dtype)))


def share_of_body(nbr: jax.Array, n: int) -> jax.Array:
    """Share of a bond [k, n + q] in the body: 1, or 1/2 to a fictitious point.

    So the energy is that of the body's own points, each with a whole neighbourhood.
    """
    outside = (nbr >= n) | (jnp.arange(nbr.shape[1])[None] >= n)
    return jnp.where(outside, 0.5, 1.0)


def _rows(n: int, extra: NDArray[np.integer], R: int) -> dict[int, dict[int, float]]:
    """Rows and weights of every row along an axis of n rows, by its number."""
    if extra.any() and max(R, 2) > n:
        raise ValueError(
            f"correction: 'fictitious' needs {max(R, 2)} rows of points along each "
            f"axis with a free face and the body has {n}; refine it, or use 'energy'"
        )
    rows: dict[int, dict[int, float]] = {i: {i: 1.0} for i in range(n)}
    for side, count in enumerate(extra):
        for k in range(1, int(count) + 1):
            found = line(max(R, 2), k)
            if side == 0:
                rows[-k] = found
            else:
                rows[n - 1 + k] = {n - 1 - r: w for r, w in found.items()}
    return rows


def _compose(
    place: NDArray[np.integer], shape: tuple[int, ...], per_axis: list[dict]
) -> tuple[NDArray[np.int32], NDArray[np.floating]]:
    """Point numbers and weights of places outside, the product of their axes'."""
    most = [max(len(r) for r in rows.values()) for rows in per_axis]
    tables = []
    for rows, width in zip(per_axis, most, strict=True):
        low = min(rows)
        index = np.zeros((len(rows), width), int)
        value = np.zeros((len(rows), width))
        for row, found in rows.items():
            index[row - low] = next(iter(found))
            index[row - low, : len(found)] = list(found)
            value[row - low, : len(found)] = list(found.values())
        tables.append((low, index, value))
    sources, weights = [], []
    for pick in itertools.product(*map(range, most)):
        at = [
            index[place[:, a] - low, pick[a]]
            for a, (low, index, _) in enumerate(tables)
        ]
        parts = [
            value[place[:, a] - low, pick[a]]
            for a, (low, _, value) in enumerate(tables)
        ]
        sources.append(np.ravel_multi_index(at, shape))
        weights.append(math.prod(parts))
    return np.stack(sources, axis=1).astype(np.int32), np.stack(weights, axis=1)


def check_cracks(
    grid: Lattice, delta: float, cracks: Sequence[Crack], sides: NDArray[np.bool_]
) -> None:
    """Refuse cracks within a horizon of a face with fictitious points."""
    low = np.asarray(grid.origin)
    high = low + grid.dx * (np.asarray(grid.shape) - 1)
    for crack in cracks:
        corners = np.asarray(crack.corner) + [
            np.asarray(t) @ np.asarray(crack.edges)
            for t in np.ndindex(*[2] * len(crack.edges))
        ]
        near = np.stack([corners.min(0) - delta < low, corners.max(0) + delta > high])
        if (near.T & sides).any():
            raise ValueError(
                f"cracks: {crack} comes within a horizon of a face with fictitious "
                "points, which it would have to cut as well; use correction='energy'"
            )
