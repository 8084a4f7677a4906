"""Peers of an explicit bond-based step: NumPy, Numba and C, one thread each.

All take velocity Verlet steps of the same problem, a regular lattice with free
boundaries: the force on i from j = i + o is w_o s y / |y|, with y = xi + eta and the
stretch s = |y| / r - 1; a bond breaks for good once |y| > r (1 + s_crit), seen before
its force is used. All write s / |y| as eta.(y + xi) / (r (|y|^2 + r |y|)), which keeps
its digits in single precision. The force of the start is evaluated before the clock.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import DTypeLike, NDArray

Vector = NDArray[np.floating]

#: Flags of gcc: the values are those of IEEE arithmetic, `sqrt` may be a vector's.
FLAGS = ("-O3", "-march=native", "-fno-math-errno", "-fno-trapping-math")

#: Points of one pass of NumPy: its scratch stays in the cache.
CHUNK = 16384

#: Cells of one pass of C over the bonds.
CELLS = 256


class Ran(NamedTuple):
    """What a peer did.

    Attributes:
        u: displacements at the end [n, d] (m).
        v: velocities at the end [n, d] (m/s).
        broken: directed bonds broken since the start, its first force included.
        seconds: of the processor, for the steps alone.
    """

    u: Vector
    v: Vector
    broken: int
    seconds: float


class Peer(Protocol):
    """A problem made ready, compiled and run once."""

    def run(self, steps: int) -> Ran:
        """Take steps from the start of the problem."""
        ...


@dataclass(frozen=True)
class Case:
    """A lattice, its bonds and its start; points are numbered in C order.

    Attributes:
        shape: points along every axis; axis a is coordinate a.
        dx: spacing (m).
        m: horizon in spacings.
        s_crit: stretch beyond which a bond breaks.
        w: of every offset, micromodulus times both volumes [k] (N).
        offsets: integer steps of the full neighbourhood [k, d].
        mass: of one point (kg).
        dt: time step (s).
        u0: displacements at the start [n, d] (m).
        v0: velocities at the start [n, d] (m/s).
        alive0: bonds at the start, False across the boundary too [k, n].
        dtype: float64 or float32, of every peer's arithmetic and storage.
    """

    shape: tuple[int, ...]
    dx: float
    m: int
    s_crit: float
    w: Vector
    offsets: NDArray[np.integer]
    mass: float
    dt: float
    u0: Vector
    v0: Vector
    alive0: NDArray[np.bool_]
    dtype: np.dtype[Any]

    def __post_init__(self):
        if len(self.shape) not in (2, 3):
            raise ValueError("shape: two or three axes")
        if {self.u0.dtype, self.v0.dtype} != {self.dtype}:
            raise ValueError("dtype: u0 and v0 must be of that kind")

    @property
    def n(self) -> int:
        """Number of points."""
        return int(np.prod(self.shape))

    @property
    def d(self) -> int:
        """Number of dimensions."""
        return len(self.shape)

    @property
    def xi(self) -> Vector:
        """Vectors of the bonds [k, d] (m), in double precision."""
        return self.offsets * self.dx

    @property
    def r(self) -> Vector:
        """Lengths of the bonds [k] (m), in double precision."""
        return np.linalg.norm(self.offsets, axis=1) * self.dx

    @property
    def bonds(self) -> int:
        """Directed bonds alive at the start: what rates are counted in."""
        return int(self.alive0.sum())

    @property
    def X(self) -> Vector:
        """Positions [n, d] (m), in double precision."""
        return np.stack(np.unravel_index(np.arange(self.n), self.shape), 1) * self.dx

    def neighbours(self) -> NDArray[np.int32]:
        """Number of every point's neighbours [n, k]; its own where there is none."""
        at = np.stack(np.unravel_index(np.arange(self.n), self.shape), 1)
        own = np.arange(self.n, dtype=np.int32)
        out = np.empty((self.n, len(self.offsets)), np.int32)
        for slot, o in enumerate(self.offsets):
            to = at + o
            inside = ((to >= 0) & (to < self.shape)).all(axis=1)
            j = np.ravel_multi_index(tuple(to.T), self.shape, mode="clip")
            out[:, slot] = np.where(inside, j, own)
        return out


def make_case(
    shape: tuple[int, ...], m: int = 3, dtype: DTypeLike = np.float64, seed: int = 0
) -> Case:
    """A plate or block of glass, stretched by 1 % along axis 1, with a crack.

    The crack lies between two layers of axis 1 and goes through half of axis 0;
    velocities are random, so that some bonds break within ten steps.

    Args:
        shape: points along two or three axes.
        m: horizon in spacings of 1 mm.
        dtype: float64 or float32.
        seed: of the velocities.
    """
    E, rho, dx, s_crit = 72e9, 2440.0, 1e-3, 0.012
    d, delta = len(shape), m * dx
    c = 9 * E / (np.pi * delta**3) if d == 2 else 12 * E / (np.pi * delta**4)
    grid = np.stack(np.meshgrid(*[np.arange(-m, m + 1)] * d, indexing="ij"), -1)
    steps = grid.reshape(-1, d)
    length = np.linalg.norm(steps, axis=1)
    offsets = steps[(length > 0) & (length <= m * (1 + 1e-9))]
    vol = dx**d  # of unit thickness in two dimensions
    w = np.full(len(offsets), c * vol**2)
    mass = rho * vol
    r = np.linalg.norm(offsets, axis=1) * dx
    dt = 0.5 * float(np.sqrt(2 * mass / (w / r).sum()))

    n = int(np.prod(shape))
    at = np.stack(np.unravel_index(np.arange(n), shape), 1)
    plane, end = shape[1] // 2 - 0.5, shape[0] // 2 + 0.3  # no bond meets the end
    alive0 = np.empty((len(offsets), n), bool)
    for slot, o in enumerate(offsets):
        to = at + o
        alive0[slot] = ((to >= 0) & (to < shape)).all(axis=1)
        if o[1]:
            way = (plane - at[:, 1]) / o[1]
            crossed = (way > 0) & (way < 1)
            alive0[slot] &= ~(crossed & (at[:, 0] + way * o[0] < end))
    rng = np.random.default_rng(seed)
    u0 = np.zeros((n, d))
    u0[:, 1] = 0.01 * dx * (at[:, 1] - (shape[1] - 1) / 2)
    v0 = 2e-4 * dx / dt * rng.uniform(-1, 1, (n, d))
    kind: np.dtype[Any] = np.dtype(dtype)
    u: Any = u0.astype(kind)
    v: Any = v0.astype(kind)
    return Case(shape, dx, m, s_crit, w, offsets, mass, dt, u, v, alive0, kind)


class _Layout:
    """Flat padded arrays: bonds that leave the lattice end in cells of a gap.

    Rows share gaps of m cells and a whole margin lies before and behind, so that each
    offset is one shift of flat arrays. A block is a whole plate or one plane of a
    block of points, its rows and the gaps between them.
    """

    def __init__(self, case: Case):
        shape, m = case.shape, case.m
        wide = [max(s + m, 8) for s in shape]
        strides = np.append(np.cumprod(wide[:0:-1])[::-1], 1).astype(np.int64)
        self.shift = case.offsets @ strides
        self.margin = -(-int(self.shift.max()) // 16) * 16
        at = np.unravel_index(np.arange(case.n), shape)
        self.cell = self.margin + np.stack(at, 1) @ strides  # [n]
        self.blocks = self.cell[:: shape[-2] * shape[-1]].astype(np.int64)
        self.length = -(-shape[-2] * wide[-1] // 8) * 8
        self.size = int(self.blocks[-1]) + self.length + self.margin
        self.start, self.stop = int(self.cell[0]), int(self.cell[-1]) + 1

    def spread(self, values: NDArray[Any]) -> NDArray[Any]:
        """Values [..., n] in cells [..., size], zero elsewhere."""
        out = np.zeros((*values.shape[:-1], self.size), values.dtype)
        out[..., self.cell] = values
        return out


def _half(case: Case, layout: _Layout) -> NDArray[np.integer]:
    """The offsets that look ahead; every bond must be alive from both ends or none.

    Raises:
        ValueError: if a bond is alive from one end only.
    """
    ahead = np.flatnonzero(layout.shift > 0)
    number = {tuple(o): slot for slot, o in enumerate(case.offsets.tolist())}
    alive = case.alive0.reshape(-1, *case.shape)
    for slot in ahead:
        o = case.offsets[slot].tolist()
        back = alive[number[tuple(-a for a in o)]]
        here = tuple(
            slice(max(0, -a), s - max(0, a)) for a, s in zip(o, case.shape, strict=True)
        )
        there = tuple(
            slice(max(0, a), s - max(0, -a)) for a, s in zip(o, case.shape, strict=True)
        )
        if (alive[slot][here] != back[there]).any():
            raise ValueError("alive0: a bond is alive from one end only")
    return ahead


class _Numpy:
    """Plain NumPy: half the neighbourhood, shifted slices, scratch that is kept."""

    def __init__(self, case: Case):
        self.case, self.layout = case, _Layout(case)
        self.ahead = _half(case, self.layout)
        self.alive0 = self.layout.spread(case.alive0[self.ahead])
        self.scratch = np.empty((case.d + 4, CHUNK), case.dtype)
        self.keep = np.empty(CHUNK, bool)
        self.run(1)

    def _force(self, u: Vector, alive: NDArray[np.bool_], g: Vector) -> None:
        case, layout, d = self.case, self.layout, self.case.d
        kind = case.dtype.type
        table = [
            (int(layout.shift[s]), [kind(x) for x in case.xi[s]], kind(case.r[s]),
             kind((case.r[s] * (1 + case.s_crit)) ** 2), kind(case.w[s] / case.r[s]))
            for s in self.ahead
        ]  # fmt: skip
        g[...] = 0
        for at in range(layout.start, layout.stop, CHUNK):
            to = min(at + CHUNK, layout.stop)
            part = self.scratch[:, : to - at]
            y, (l2, stretch, f, t), keep = part[:d], part[-4:], self.keep[: to - at]
            for slot, (shift, xi, r, limit, w) in enumerate(table):
                ahead = slice(at + shift, to + shift)
                l2[...] = 0
                stretch[...] = 0
                for a in range(d):
                    np.subtract(u[a, ahead], u[a, at:to], out=f)
                    np.add(f, xi[a], out=y[a])
                    np.add(y[a], xi[a], out=t)
                    t *= f
                    stretch += t
                    np.multiply(y[a], y[a], out=t)
                    l2 += t
                bond = alive[slot, at:to]
                np.less_equal(l2, limit, out=keep)
                bond &= keep
                np.sqrt(l2, out=f)
                f *= r
                f += l2
                np.divide(stretch, f, out=f)
                f *= w
                f *= bond
                for a in range(d):
                    np.multiply(f, y[a], out=t)
                    g[a, at:to] += t
                    g[a, ahead] -= t

    def run(self, steps: int) -> Ran:
        """Take steps from the start of the case."""
        case, layout, kind = self.case, self.layout, self.case.dtype.type
        u, v = layout.spread(case.u0.T), layout.spread(case.v0.T)
        alive, g, t = self.alive0.copy(), np.zeros_like(u), np.empty_like(u)
        dt, half = kind(case.dt), kind(0.5 * case.dt / case.mass)
        self._force(u, alive, g)
        start = time.process_time()
        for _ in range(steps):
            v += np.multiply(g, half, out=t)
            u += np.multiply(v, dt, out=t)
            self._force(u, alive, g)
            v += np.multiply(g, half, out=t)
        seconds = time.process_time() - start
        broken = 2 * int(self.alive0.sum() - alive.sum())
        at = layout.cell
        return Ran(u[:, at].T.copy(), v[:, at].T.copy(), broken, seconds)


_C_SOURCE = r"""
#include <math.h>
#include <stdint.h>
#include <string.h>

/* T, W (a word as wide as T), SQRT, D, G (offsets of a pass), PER (bits of a word) */

typedef struct { T xi[3], r, lim, w; int64_t s; } Bond;

#if D == 3
#define IF3(x) x
#else
#define IF3(x)
#endif

/* one bond of point i: vectors y and e are declared, f is w/r eta.(y+xi)/(l2+r l) */
#define PAIR(o)                                                                        \
  T ex = ux[i + (o).s] - ux[i], yx = ex + (o).xi[0];                                   \
  T ey = uy[i + (o).s] - uy[i], yy = ey + (o).xi[1];                                   \
  IF3(T ez = uz[i + (o).s] - uz[i]; T yz = ez + (o).xi[2];)                            \
  T l2 = yx * yx + yy * yy IF3(+yz * yz);                                              \
  T a = ex * (yx + (o).xi[0]) + ey * (yy + (o).xi[1]) IF3(+ez * (yz + (o).xi[2]));     \
  T q = (o).w * a / (l2 + (o).r * SQRT(l2));

#ifndef HALF
/* full neighbourhood: G offsets of a chunk at a time, sums in registers */
static void force(int64_t n_blocks, const int64_t *blocks, int64_t length, int64_t size,
                  int64_t k, const Bond *bonds, const T *restrict u, W *restrict alive,
                  T *restrict g, T *restrict back) {
  const T *restrict ux = u, *restrict uy = u + size;
  IF3(const T *restrict uz = u + 2 * size;)
  T *restrict gx = g, *restrict gy = g + size;
  IF3(T *restrict gz = g + 2 * size;)
  memset(g, 0, sizeof(T) * D * size);
  const int64_t per_block = (length + CELLS - 1) / CELLS;
  for (int64_t chunk = 0; chunk < n_blocks * per_block; chunk++) {
    int64_t start = blocks[chunk / per_block], done = chunk % per_block * CELLS;
    int64_t cells = length - done < CELLS ? length - done : CELLS;
    int64_t from = start + done, to = from + (cells & ~(int64_t)7);
    for (int64_t first = 0; first < k; first += G) {
      W *restrict word = alive + first / PER * size;
      const int low = (int)(first % PER);
      Bond o[G];
      for (int b = 0; b < G; b++) o[b] = bonds[first + b];
      for (int64_t i = from; i < to; i++) {
        W bits = word[i] >> low, gone = 0;
        T fx = gx[i], fy = gy[i];
        IF3(T fz = gz[i];)
#pragma GCC unroll 16
        for (int b = 0; b < G; b++) {
          PAIR(o[b])
          W bit = (W)1 << b;
          W keep = l2 <= o[b].lim ? bits & bit : 0;
          T f = keep ? q : (T)0;
          gone |= keep;
          fx += f * yx;
          fy += f * yy;
          IF3(fz += f * yz;)
        }
        gx[i] = fx;
        gy[i] = fy;
        IF3(gz[i] = fz;)
        word[i] ^= ((bits & (((W)1 << G) - 1)) ^ gone) << low;
      }
    }
  }
}
#else
/* half neighbourhood: an offset of a chunk at a time, reactions in arrays apart */
static void force(int64_t n_blocks, const int64_t *blocks, int64_t length, int64_t size,
                  int64_t k, const Bond *bonds, const T *restrict u, W *restrict alive,
                  T *restrict g, T *restrict back) {
  const T *restrict ux = u, *restrict uy = u + size;
  IF3(const T *restrict uz = u + 2 * size;)
  T *restrict gx = g, *restrict gy = g + size;
  IF3(T *restrict gz = g + 2 * size;)
  memset(g, 0, sizeof(T) * D * size);
  memset(back, 0, sizeof(T) * D * size);
  const int64_t per_block = (length + CELLS - 1) / CELLS;
  for (int64_t chunk = 0; chunk < n_blocks * per_block; chunk++) {
    int64_t start = blocks[chunk / per_block], done = chunk % per_block * CELLS;
    int64_t cells = length - done < CELLS ? length - done : CELLS;
    int64_t from = start + done, to = from + (cells & ~(int64_t)7);
    for (int64_t slot = 0; slot < k; slot++) {
      W *restrict word = alive + slot / PER * size;
      const W bit = (W)1 << slot % PER;
      const Bond o = bonds[slot];
      T *restrict bx = back + o.s, *restrict by = bx + size;
      IF3(T *restrict bz = by + size;)
#pragma GCC ivdep
      for (int64_t i = from; i < to; i++) {
        PAIR(o)
        W bits = word[i];
        W keep = l2 <= o.lim ? bits & bit : 0;
        T f = keep ? q : (T)0;
        word[i] = (bits & ~bit) | keep;
        gx[i] += f * yx;
        gy[i] += f * yy;
        IF3(gz[i] += f * yz;)
        bx[i] += f * yx;
        by[i] += f * yy;
        IF3(bz[i] += f * yz;)
      }
    }
  }
  for (int64_t i = 0; i < D * size; i++) g[i] -= back[i];
}
#endif

/* the force, then steps of velocity Verlet */
void advance(int64_t steps, T dt, T kick, int64_t n_blocks, const int64_t *blocks,
             int64_t length, int64_t size, int64_t k, const Bond *bonds, T *restrict u,
             T *restrict v, W *restrict alive, T *restrict g, T *restrict back) {
  if (steps == 0)
    force(n_blocks, blocks, length, size, k, bonds, u, alive, g, back);
  for (int64_t step = 0; step < steps; step++) {
    for (int64_t i = 0; i < D * size; i++) {
      v[i] += kick * g[i];
      u[i] += dt * v[i];
    }
    force(n_blocks, blocks, length, size, k, bonds, u, alive, g, back);
    for (int64_t i = 0; i < D * size; i++) v[i] += kick * g[i];
  }
}
"""


@cache
def _library(gcc: str, double: bool, d: int, group: int, half: bool) -> Any:
    """The compiled C."""
    width = 64 if double else 32
    macros = {"T": "double" if double else "float", "W": f"uint{width}_t", "D": d,
              "SQRT": "sqrt" if double else "sqrtf", "G": group,
              "PER": width // group * group, "CELLS": CELLS}  # fmt: skip
    if half:
        macros["HALF"] = 1
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, "peer.c"), Path(folder, "peer.so")
        source.write_text(_C_SOURCE)
        given = [f"-D{name}={value}" for name, value in macros.items()]
        subprocess.run([gcc, *FLAGS, "-shared", "-fPIC", *given, str(source), "-o",
                        str(target), "-lm"], check=True)  # fmt: skip
        return ctypes.CDLL(str(target))


class _C:
    """C with vectors over the cells of a chunk, and one bit a bond."""

    def __init__(self, case: Case, library: Any, half: bool, group: int):
        self.case, self.layout, self.half = case, _Layout(case), half
        layout, double = self.layout, case.dtype == np.float64
        self.advance = library.advance
        self.advance.restype = None
        real = ctypes.c_double if double else ctypes.c_float
        whole, at = ctypes.c_int64, ctypes.c_void_p
        self.advance.argtypes = [whole, real, real, whole, at, whole, whole, whole,
                                 at, at, at, at, at, at]  # fmt: skip
        slots = _half(case, layout) if half else np.arange(len(case.offsets))
        kind, k = case.dtype, -(-len(slots) // group) * group
        bond = np.dtype(
            [("xi", kind, 3), ("r", kind), ("lim", kind), ("w", kind), ("s", np.int64)],
            align=True,
        )
        self.bonds = np.zeros(k, bond)
        self.bonds["xi"] = self.bonds["r"] = 1.0  # those that fill the last group
        own = self.bonds[: len(slots)]
        own["xi"] = 0.0
        own["xi"][:, : case.d] = case.xi[slots]
        own["r"], own["s"] = case.r[slots], layout.shift[slots]
        own["lim"] = (case.r[slots] * (1 + case.s_crit)) ** 2
        own["w"] = case.w[slots] / case.r[slots]
        width = 64 if double else 32
        per = width // group * group
        word = np.dtype(f"uint{width}")
        words = np.zeros((-(-k // per), case.n), word)
        for slot, number in enumerate(slots):
            bit = case.alive0[number].astype(word) << word.type(slot % per)
            words[slot // per] |= bit
        self.words = layout.spread(words)
        self.run(1)

    def run(self, steps: int) -> Ran:
        """Take steps from the start of the case."""
        case, layout = self.case, self.layout
        u, v = layout.spread(case.u0.T), layout.spread(case.v0.T)
        words, g = self.words.copy(), np.zeros_like(u)
        back = np.zeros_like(u) if self.half else g[:0]
        blocks, bonds = layout.blocks, self.bonds
        lattice = (len(blocks), blocks, layout.length, layout.size, len(bonds))
        rest = [x.ctypes.data if isinstance(x, np.ndarray) else x
                for x in (*lattice, bonds, u, v, words, g, back)]  # fmt: skip
        kick = 0.5 * case.dt / case.mass
        self.advance(0, case.dt, kick, *rest)
        start = time.process_time()
        if steps:
            self.advance(steps, case.dt, kick, *rest)
        seconds = time.process_time() - start
        gone = self.words ^ words
        broken = int(np.bitwise_count(gone).sum()) * (2 if self.half else 1)
        at = layout.cell
        return Ran(u[:, at].T.copy(), v[:, at].T.copy(), broken, seconds)


@cache
def _compiled(d: int) -> Any:
    """The steps of Numba in d dimensions, or None where it is missing."""
    try:
        from numba import njit  # pyright: ignore[reportMissingImports]
    except ImportError:
        return None

    @njit(error_model="numpy")
    def force(xi, r, w, limit, nbr, u, alive, g):
        n, k = nbr.shape
        own = 1 if len(r) == n else 0  # one row for every point, or one for all
        for i in range(n):
            row = own * i
            g0 = g1 = g2 = y2 = u[0, 0] * 0
            for s in range(k):
                if not alive[i, s]:
                    continue
                j = nbr[i, s]
                e0, e1 = u[j, 0] - u[i, 0], u[j, 1] - u[i, 1]
                x0, x1 = xi[row, s, 0], xi[row, s, 1]
                y0, y1 = x0 + e0, x1 + e1
                l2 = y0 * y0 + y1 * y1
                a = e0 * (y0 + x0) + e1 * (y1 + x1)
                if d == 3:
                    e2, x2 = u[j, 2] - u[i, 2], xi[row, s, 2]
                    y2 = x2 + e2
                    l2 += y2 * y2
                    a += e2 * (y2 + x2)
                if l2 > limit[row, s]:
                    alive[i, s] = False
                    continue
                f = w[row, s] * a / (l2 + r[row, s] * np.sqrt(l2))
                g0 += f * y0
                g1 += f * y1
                if d == 3:
                    g2 += f * y2
            g[i, 0] = g0
            g[i, 1] = g1
            if d == 3:
                g[i, 2] = g2

    @njit(error_model="numpy")
    def advance(steps, dt, kick, xi, r, w, limit, nbr, u, v, alive, g):
        if steps == 0:
            force(xi, r, w, limit, nbr, u, alive, g)
        for _ in range(steps):
            for i in range(len(u)):
                for a in range(d):
                    v[i, a] += kick[i] * g[i, a]
                    u[i, a] += dt * v[i, a]
            force(xi, r, w, limit, nbr, u, alive, g)
            for i in range(len(u)):
                for a in range(d):
                    v[i, a] += kick[i] * g[i, a]

    return advance


class _Numba:
    """Points one by one, each with the list of its neighbours and their flags.

    Args:
        advance: compiled.
        bonds: xi [rows, k, d], r and w [rows, k] in double precision, with a row for
            every point or one for all.
        s_crit: stretch beyond which a bond breaks.
        nbr: neighbours [n, k].
        mass: of the points [n] (kg).
        dt: time step (s).
        u0: displacements at the start [n, d] (m); their kind is that of the arithmetic.
        v0: velocities at the start [n, d] (m/s).
        alive0: bonds at the start [n, k].
    """

    def __init__(
        self,
        advance: Any,
        bonds: tuple[Vector, Vector, Vector],
        s_crit: float,
        nbr: NDArray[np.integer],
        mass: Vector,
        dt: float,
        u0: Vector,
        v0: Vector,
        alive0: NDArray[np.bool_],
    ):
        xi, r, w = bonds
        kind = u0.dtype
        whole = np.where(r > 0, r, 1.0)  # padding has no length
        parts = (xi, r, w / whole, (r * (1 + s_crit)) ** 2)
        self.bonds = [np.ascontiguousarray(x, kind) for x in parts]
        self.nbr = np.ascontiguousarray(nbr, np.int32)
        self.dt, self.kick = kind.type(dt), (0.5 * dt / mass).astype(kind)
        self.u0, self.v0, self.alive0 = u0, v0.astype(kind), alive0
        self.advance = advance
        self.run(1)

    def run(self, steps: int) -> Ran:
        """Take steps from the start of the problem."""
        u, v = self.u0.copy(order="C"), self.v0.copy(order="C")
        alive = self.alive0.copy(order="C")
        g = np.zeros_like(u)
        rest = (self.dt, self.kick, *self.bonds, self.nbr, u, v, alive, g)
        self.advance(0, *rest)
        start = time.process_time()
        if steps:
            self.advance(steps, *rest)
        seconds = time.process_time() - start
        return Ran(u, v, int(self.alive0.sum() - alive.sum()), seconds)


def numpy_stencil(case: Case) -> Peer:
    """NumPy on half the neighbourhood."""
    return _Numpy(case)


class _Gathered:
    """NumPy on neighbour lists, one array operation for all bonds."""

    def __init__(self, case: Case):
        self.case, self.nbr = case, case.neighbours()
        self.run(1)

    def _force(self, u: Vector, alive: NDArray[np.bool_]) -> Vector:
        case = self.case
        eta = u[self.nbr] - u[:, None]
        y = case.xi[None] + eta
        l2 = (y * y).sum(axis=2)
        alive &= l2 <= (case.r * (1.0 + case.s_crit))[None] ** 2
        r = case.r[None]
        pull = (eta * (y + case.xi[None])).sum(axis=2) / (r * (l2 + r * np.sqrt(l2)))
        return ((np.where(alive, case.w[None], 0.0) * pull)[:, :, None] * y).sum(axis=1)

    def run(self, steps: int) -> Ran:
        """Start afresh and step."""
        case, alive = self.case, np.ascontiguousarray(self.case.alive0.T).copy()
        before = int(alive.sum())
        u, v = case.u0.copy(), case.v0.copy()
        a = self._force(u, alive) / case.mass
        start = time.process_time()
        for _ in range(steps):
            v = v + 0.5 * case.dt * a
            u = u + case.dt * v
            a = self._force(u, alive) / case.mass
            v = v + 0.5 * case.dt * a
        seconds = time.process_time() - start
        return Ran(u, v, before - int(alive.sum()), seconds)


def numpy_neighbour_list(case: Case) -> Peer:
    """NumPy as it is usually written: arrays [n, k, d] over all bonds."""
    return _Gathered(case)


def c_loop(case: Case, half: bool = False, group: int = 4) -> Peer | None:
    """C on the full neighbourhood or on half of it, or None without gcc.

    Args:
        case: the problem.
        half: count every bond once and keep its reaction.
        group: offsets of the full neighbourhood that share one pass.
    """
    gcc = shutil.which("gcc")
    if gcc is None:
        return None
    group = 1 if half else group
    double = bool(case.dtype == np.float64)
    return _C(case, _library(gcc, double, case.d, group, half), half, group)


def numba_neighbour_list(case: Case) -> Peer | None:
    """Numba with lists of neighbours, or None where it is missing.

    The vectors, lengths and weights of the bonds are the same for all points and kept
    once, which a code for clouds could not do.
    """
    advance = _compiled(case.d)
    if advance is None:
        return None
    bonds = case.xi[None], case.r[None], case.w[None]
    mass = np.full(case.n, case.mass)
    return _Numba(advance, bonds, case.s_crit, case.neighbours(), mass, case.dt,
                  case.u0, case.v0, case.alive0.T)  # fmt: skip


def numba_cloud(
    X: Vector,
    nbr: NDArray[np.integer],
    weight: Vector,
    s_crit: float,
    mass: float | Vector,
    dt: float,
    u0: Vector,
    v0: Vector,
    alive0: NDArray[np.bool_],
) -> Peer | None:
    """Numba on a cloud of points, or None where it is missing.

    Vectors, lengths and weights of all bonds are stored: that is faster than to
    gather positions as well.

    Args:
        X: positions [n, d] (m).
        nbr: neighbours [n, k]; the point itself is padding.
        weight: of every bond, micromodulus times both volumes [n, k] (N).
        s_crit: stretch beyond which a bond breaks.
        mass: of the points (kg), one for all or [n].
        dt: time step (s).
        u0: displacements at the start [n, d] (m); their kind is that of the arithmetic.
        v0: velocities at the start [n, d] (m/s).
        alive0: bonds at the start [n, k].
    """
    advance = _compiled(X.shape[1])
    if advance is None:
        return None
    xi = np.asarray(X, float)[nbr] - np.asarray(X, float)[:, None]
    bonds = xi, np.linalg.norm(xi, axis=2), np.asarray(weight, float)
    own = nbr == np.arange(len(nbr))[:, None]
    masses = np.broadcast_to(np.asarray(mass, float), len(nbr))
    return _Numba(advance, bonds, s_crit, nbr, masses, dt, u0, v0, alive0 & ~own)


#: Peers of a lattice by name.
PEERS: dict[str, Callable[[Case], Peer | None]] = {
    "numpy": numpy_stencil,
    "numba": numba_neighbour_list,
    "c": c_loop,
    "c half": lambda case: c_loop(case, half=True),
}
