"""A lattice laid along one row, so that every step along an axis is a shift of it.

There are empty places between its lines, as many as the longest step along an axis, and
margins before and behind: a step off the lattice meets an empty place. The row is a
multiple of 512 places long; loops of odd lengths are several times slower on a CPU.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from jaxpd.geometry.grid_family import inside

#: Rows are multiples of this long, those below `SHORT` places of 64.
QUANTUM, SHORT = 512, 4096


@dataclass(frozen=True)
class Row:
    """A lattice along one row, and its offsets in groups. Host data, hashable.

    Attributes:
        shape: points along each axis.
        offsets: steps of the later neighbours, k tuples of d integers.
    """

    shape: tuple[int, ...]
    offsets: tuple[tuple[int, ...], ...]

    @property
    def d(self) -> int:
        """Space dimensions."""
        return len(self.shape)

    @cached_property
    def pitch(self) -> tuple[int, ...]:
        """Places of a line along every axis but the first, empty ones included."""
        reach = np.abs(np.asarray(self.offsets)).max(axis=0)
        return tuple((np.asarray(self.shape) + reach)[1:].tolist())

    @cached_property
    def strides(self) -> NDArray[np.int64]:
        """Places that a step along each axis moves [d]."""
        return np.cumprod((1, *self.pitch[::-1]))[::-1].astype(int)

    @cached_property
    def hops(self) -> NDArray[np.int64]:
        """Places that every offset moves [k], positive."""
        return np.asarray(self.offsets) @ self.strides

    @property
    def used(self) -> int:
        """Places up to the last line's end."""
        return self.shape[0] * int(self.strides[0])

    @cached_property
    def length(self) -> int:
        """Places of the row, whole quanta."""
        return _whole(self.used)

    @cached_property
    def margin(self) -> int:
        """Empty places before and behind, at least the longest hop, whole quanta."""
        return _whole(int(self.hops.max()))

    @cached_property
    def group(self) -> int:
        """Offsets of a group: 4 in 3-D; else up to 8, few of them left over."""
        if self.d == 3:
            return 4
        k = len(self.offsets)
        groups = {g: -(-k // g) for g in range(1, 9)}
        return min(groups, key=lambda g: (groups[g] * g - k + 2 * groups[g], -g))

    @cached_property
    def places(self) -> NDArray[np.int64]:
        """Place of every point [n]."""
        return self.strides @ np.indices(self.shape).reshape(self.d, -1)

    def lay(self, values: Any, empty: float = 0.0) -> jax.Array:
        """Nodal values [n] or [n, d] along the row: [length] or [d, length]."""
        values = jnp.asarray(values)
        rest = [(0, 0)] * (values.ndim - 1)
        lines = values.reshape(*self.shape, *values.shape[1:])
        room = [(0, p - n) for p, n in zip(self.pitch, self.shape[1:], strict=True)]
        lines = jnp.pad(lines, [(0, 0), *room, *rest], constant_values=empty)
        row = lines.reshape(self.used, *values.shape[1:])
        tail = [(0, self.length - self.used), *rest]
        return jnp.pad(row, tail, constant_values=empty).T

    def pick(self, row: Any) -> jax.Array:
        """Nodal values [n] or [n, d] from a row [length] or [d, length]."""
        lines = row.T[: self.used].reshape(self.shape[0], *self.pitch, *row.shape[:-1])
        points = lines[tuple(map(slice, self.shape))]
        return points.reshape(math.prod(self.shape), *row.shape[:-1])


@functools.lru_cache(maxsize=64)
def row_of(shape: tuple[int, ...], offsets: tuple[tuple[int, ...], ...]) -> Row:
    """The row of a lattice, made once."""
    return Row(shape, offsets)


def places_taken(row: Row) -> NDArray[np.uint8]:
    """Places that hold a point [margin + length + margin]. Host only."""
    taken = np.zeros(2 * row.margin + row.length, np.uint8)
    taken[row.margin + row.places] = 1
    return taken


def start_bits(row: Row, cut: Any = None) -> NDArray[np.uint8]:
    """Bits [groups, margin + length] of the bonds of a lattice. Host only.

    Args:
        row: the lattice.
        cut: (point, slot) [2, b] of bonds that are broken from the start.
    """
    G = row.group
    words = np.zeros((-(-len(row.offsets) // G), row.margin + row.length), np.uint8)
    places = row.places.reshape(row.shape) + row.margin
    for s, step in enumerate(row.offsets):
        words[s // G, places[inside(row.shape, step)].ravel()] |= 1 << (s % G)
    if cut is not None:
        point, slot = np.asarray(cut)
        bit = ~(np.uint8(1) << (slot % G).astype(np.uint8))
        np.bitwise_and.at(words, (slot // G, row.places[point] + row.margin), bit)
    return words


def _whole(length: int) -> int:
    quantum = QUANTUM if length >= SHORT else 64
    return -(-max(length, 1) // quantum) * quantum
