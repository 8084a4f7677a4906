"""Convolutions on boxes of a lattice, for terms that vanish in its interior.

The first term of the volume correction is exact for all bonds with an end whose
neighbourhood is whole; the later ones live on the rim alone, within one horizon of a
surface or a crack. Disjoint boxes cover the rim; a box is convolved from the points
within reach of it, by transforms of its own padded length. Boxes of the same shape are
stacked and share their transforms.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
import scipy.fft
import scipy.ndimage
from numpy.typing import NDArray

from jaxpd._types import namespace
from jaxpd.geometry.grid_family import GridFamily, add_at, offset_sums

#: First point and the one after the last along each axis.
Box = tuple[tuple[int, int], ...]

#: Patches are used from so many points on, for at most this share of the work of whole
#: lattices, and for so many shapes: each is compiled.
FEWEST_POINTS = 30_000
LARGEST_SHARE = 0.7
MOST_SHAPES = 6


def rim(family: GridFamily) -> NDArray[np.bool_]:
    """The points [*shape] that miss a bond. Host only."""
    count = offset_sums(family, np.ones(len(family.offsets)))
    return np.asarray(count) < 2 * len(family.offsets) - 0.5


def covering(family: GridFamily) -> tuple[Box, ...]:
    """Disjoint boxes that cover the rim: a frame, and one box a crack. Host only."""
    core = [(0, n) for n in family.shape]
    boxes: list[Box] = []
    reach = family.reach.tolist()
    if any(n <= 2 * r for n, r in zip(family.shape, reach, strict=True)):
        return (tuple(core),)
    for axis, (n, r) in enumerate(zip(family.shape, reach, strict=True)):
        for side in ((0, r), (n - r, n)):
            boxes.append((*core[:axis], side, *core[axis + 1 :]))
        core[axis] = (r, n - r)
    inner = rim(family)[slices(tuple(core))]
    label: Any = scipy.ndimage.label(inner, structure=np.ones((3,) * inner.ndim))
    cracks: list[Box] = []
    for found in scipy.ndimage.find_objects(label[0]):
        box = tuple(
            (s.start + r, s.stop + r) for s, r in zip(found, reach, strict=True)
        )
        while hit := next((other for other in cracks if _overlap(box, other)), None):
            cracks.remove(hit)
            box = tuple(
                (min(a, c), max(b, d)) for (a, b), (c, d) in zip(box, hit, strict=True)
            )
        cracks.append(box)
    return (*boxes, *cracks)


def rim_boxes(family: GridFamily) -> tuple[Box, ...]:
    """The covering boxes where they pay, else none: (). Host only."""
    if family.n < FEWEST_POINTS:
        return ()
    boxes = covering(family)
    few = len({_shape_of(box, family) for box in boxes}) <= MOST_SHAPES
    return boxes if few and share(family, boxes) <= LARGEST_SHARE else ()


def share(family: GridFamily, boxes: tuple[Box, ...]) -> float:
    """Padded points of the boxes over those of the whole lattice; 1 without boxes."""
    whole: Box = tuple((0, n) for n in family.shape)
    sizes = [math.prod(padded(box, family)) for box in boxes or (whole,)]
    return sum(sizes) / math.prod(padded(whole, family))


def slices(box: Box) -> tuple[slice, ...]:
    """The points of a box."""
    return tuple(slice(a, b) for a, b in box)


def source(box: Box, family: GridFamily) -> Box:
    """The points of the lattice within reach of a box."""
    return tuple(
        (max(0, a - r), min(n, b + r))
        for (a, b), n, r in zip(box, family.shape, family.reach.tolist(), strict=True)
    )


def padded(box: Box, family: GridFamily) -> tuple[int, ...]:
    """Lengths of the transforms for a box.

    Whatever of the reach is clipped at an end of the lattice is zeros instead.
    """
    lengths = []
    for (a, b), n, r in zip(box, family.shape, family.reach.tolist(), strict=True):
        clipped = max(r - a, b + r - n, 0)
        needed = min(n, b + r) - max(0, a - r) + clipped
        fast: Any = scipy.fft.next_fast_len(max(needed, 2 * r + 1), real=True)
        lengths.append(int(fast))
    return tuple(lengths)


def spectrum(family: GridFamily, parts: Any, lengths: tuple[int, ...]) -> Any:
    """Transforms [q, *half] of the block entries of the offsets, real."""
    xp, steps = namespace(parts, family.cut), family.steps
    both = np.concatenate([steps, -steps]) % np.asarray(lengths)
    flat = np.ravel_multi_index(tuple(both.T), lengths)
    size = (math.prod(lengths), parts.shape[1])
    table = add_at(xp, size, flat, xp.concatenate([parts] * 2))
    table = xp.moveaxis(table, 1, 0).reshape(-1, *lengths)
    axes = tuple(range(1, len(lengths) + 1))
    return xp.fft.rfftn(table, axes=axes).real  # even in the offset: real


def convolve(symbol: Any, lengths: tuple[int, ...], u: Any) -> Any:
    """Blocks of all offsets times u [..., d, *points], on the padded points.

    Args:
        symbol: [d, d, *half]; row s holds entries (a, a - s).
        lengths: padded points along each axis.
        u: components apart, behind any others.
    """
    d = len(lengths)
    axes, xp = tuple(range(-d, 0)), namespace(u, symbol)
    U = xp.fft.rfftn(u, lengths, axes=axes)
    turned = (xp.roll(U, s, axis=-d - 1) if s else U for s in range(d))
    symbol = symbol.reshape(d, *(1,) * (u.ndim - d - 1), *symbol.shape[1:])
    Y = sum(S * Us for S, Us in zip(symbol, turned, strict=True))
    return xp.fft.irfftn(Y, lengths, axes=axes)


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Patches:
    """Terms of the factor of a bond on boxes of one shape.

    Attributes:
        symbol: as in `convolve`.
        left: fields of the terms on the boxes [T, b, *box].
        right: on the points within reach of them [T, b, *source].
        boxes: boxes and the points within reach of each.
        lengths: padded points along each axis.
    """

    symbol: Any
    left: Any
    right: Any
    boxes: tuple[tuple[Box, Box], ...] = field(metadata={"static": True})
    lengths: tuple[int, ...] = field(metadata={"static": True})

    def subtract(self, force: Any, u: Any) -> Any:
        """Force [d, *shape] less the terms' pull of u [d, *shape]."""
        xp = namespace(force, u, self.left)
        near = xp.stack([u[(..., *slices(src))] for _, src in self.boxes])
        y = convolve(self.symbol, self.lengths, self.right[:, :, None] * near[None])
        for k, (box, src) in enumerate(self.boxes):
            here = y[(slice(None), k, slice(None), *_within(box, src))]
            pull = xp.sum(self.left[:, k, None] * here, axis=0)
            force = add_box(force, box, -pull)
        return force

    def sums(self, entries: Any, own: Any) -> Any:
        """Block diagonal [q, *shape] with the terms' share; entries as `spectrum`'s."""
        xp, d = namespace(entries, own), len(self.lengths)
        axes = tuple(range(-d, 0))
        spread = xp.fft.rfftn(self.right, self.lengths, axes=axes)
        y = xp.fft.irfftn(
            entries[None, None] * spread[:, :, None], self.lengths, axes=axes
        )
        for k, (box, src) in enumerate(self.boxes):
            here = y[(slice(None), k, slice(None), *_within(box, src))]
            own = add_box(own, box, xp.sum(self.left[:, k, None] * here, axis=0))
        return own


def stacked(
    family: GridFamily, boxes: tuple[Box, ...], left: Any, right: Any
) -> list[tuple[tuple[int, ...], tuple[tuple[Box, Box], ...], Any, Any]]:
    """Lengths, boxes, left and right fields of every shape, from fields [T, *shape]."""
    xp = namespace(left, right)
    groups: dict[Any, list[Box]] = {}
    for box in boxes:
        groups.setdefault(_shape_of(box, family), []).append(box)
    found = []
    for members in groups.values():
        pairs = tuple((box, source(box, family)) for box in members)
        out = xp.stack([left[(..., *slices(box))] for box, _ in pairs], axis=1)
        near = xp.stack([right[(..., *slices(src))] for _, src in pairs], axis=1)
        found.append((padded(members[0], family), pairs, out, near))
    return found


def add_box(total: Any, box: Box, part: Any) -> Any:
    """The array [..., *shape] with a part [..., *box] added; NumPy's is written to."""
    at = (..., *slices(box))
    if isinstance(total, np.ndarray) and isinstance(part, np.ndarray):
        total[at] += part
        return total
    xp = namespace(total, part)
    start = [0] * (total.ndim - len(box)) + [a for a, _ in box]
    return jax.lax.dynamic_update_slice(xp.asarray(total), total[at] + part, start)


def _shape_of(box: Box, family: GridFamily) -> tuple[Any, ...]:
    sides = [tuple(b - a for a, b in ends) for ends in (box, source(box, family))]
    return (*sides, padded(box, family))


def _within(box: Box, src: Box) -> tuple[slice, ...]:
    """The points of a box as places in its source."""
    return tuple(
        slice(a - low, b - low) for (a, b), (low, _) in zip(box, src, strict=True)
    )


def _overlap(one: Box, other: Box) -> bool:
    return all(a < d and c < b for (a, b), (c, d) in zip(one, other, strict=True))
