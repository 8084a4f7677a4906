"""Plane waves in bars and plates with a layer, and what an exact layer makes of them.

A Gaussian pulse starts in the lower ply; the displacement is taken down at one point of
each ply, and that of an unbroken body of the same lattice at the same distances from
where the layer was. The latter, frequency by frequency times the exact coefficient of
the layer between half-spaces of the lattice's own long-wave modulus, is what should be
there: dispersion and modulus of the lattice cancel, what is left is the layer's error.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import jaxpd
from jaxpd import Bonds, Elastic, Interlayer, Motion, Scene, box, fractional
from jaxpd.geometry import find
from jaxpd.launch import longest_dt
from jaxpd.physics import Fractional, Microelastic, layer, micromodulus

#: Samples that a coefficient in frequency is applied to, the rest zero.
PADDED = 2**15
EVERYWHERE = jaxpd.above(y=-1e9), jaxpd.above(x=-1e9)

march = jax.jit(Motion.march, static_argnames=("dt", "every", "records", "measure"))


@dataclass(frozen=True)
class Body:
    """Two plies, or one twice as long, and a pulse; E = rho = 1.

    Attributes:
        d: 1, a bar, or 2, a plate whose points move along y alone.
        dx: spacing (m).
        a: width of the pulse exp(-(y / a)^2) (m).
        half: of the width of a plate (m).
        away: from the faces to where the displacement is taken down (m).
    """

    d: int
    dx: float
    a: float
    half: float = 0.0
    away: float = 0.0

    @property
    def L(self) -> float:
        """Length of a ply (m)."""
        return 10.0 * self.a

    def box(self, low: float, high: float) -> Any:
        """Between two heights (m)."""
        if self.d == 1:
            return box((low,), (high,))
        return box((-self.half, low), (self.half, high))

    def scene(
        self,
        h: float | None,
        what: Interlayer | None,
        E: float = 1.0,
        mean: str = "arithmetic",
    ) -> Scene:
        """The scene of an unbroken body (h None), a laminate, or a meshed layer.

        Args:
            h: thickness of the layer (m).
            what: the layer; None fills it with points.
            E: modulus of those points (Pa).
            mean: modulus of a bond between points of two moduli: "arithmetic", as
                `Elastic` has it, or "harmonic", by a law with a number a bond.
        """
        up, L = self.d - 1, self.L
        modulus: Any = 1.0
        if h is None:
            body: Any = self.box(-L, L)
        elif what is not None:
            body = jaxpd.laminate([self.box(-L, 0.0), self.box(h, L + h)], what)
        else:
            ends = self.box(-L, L + h)
            body = jaxpd.lattice(ends.lo, ends.hi, self.dx, nodes="cell")
            y = np.asarray(body.X)[:, up]
            modulus = np.where((y > 0.0) & (y < h), E, 1.0)
        flat: Any = (
            {"state": "bar"} if up == 0 else {"nu": 1 / 3, "state": "plane stress"}
        )
        pulse = {
            "xy"[up]: lambda X: 1e-4 * np.exp(-(((X[:, up] + 0.5 * L) / self.a) ** 2))
        }
        material: Any = Elastic(modulus, rho=1.0, **flat)
        if mean == "harmonic":
            material = self.in_series(body, modulus, flat)
        return Scene(
            body=body,
            material=material,
            supports=[] if up == 0 else [jaxpd.moves(EVERYWHERE[0], x=0.0)],
            starts=[
                jaxpd.initially(EVERYWHERE[1], **{f"u{k}": f for k, f in pulse.items()})
            ],
            resolution=Bonds(
                dx=self.dx, m=3, kernel=fractional(-float(up)), nodes="cell"
            ),
        )

    def in_series(self, body: Any, modulus: Any, flat: dict[str, Any]) -> Any:
        """Bonds whose ends are springs in series: harmonic means of the moduli."""
        delta, omega = 3.0 * self.dx, Fractional(1.0 - self.d, self.d)
        nbr = np.asarray(find(body, delta, partial="linear").nbr)
        c = 2.0 / (1.0 / modulus + 1.0 / modulus[nbr])
        state, nu = flat["state"], flat.get("nu")
        c = c * micromodulus(1.0, nu, state, self.d, delta, omega)
        return jaxpd.Solid(Microelastic(c, omega), rho=1.0)

    def record(self, scene: Scene, h: float, sample: float, every: int = 0) -> Track:
        """Move a scene.

        Args:
            scene: of this body.
            h: where the upper face is (m).
            sample: time between samples (s).
            every: steps between them; 0 takes what 0.8 of the stable step asks for, and
                takes the time.
        """
        motion = jaxpd.prepare_motion(scene)
        longest, timed = longest_dt(motion), not every
        every = every or math.ceil(sample / (0.8 * longest))
        dt, records = sample / every, int(11.0 * self.a / sample)
        assert dt <= longest, (dt, longest)
        X = np.asarray(motion.X)
        depth = self.away + 0.5 * self.dx
        spots = []
        for y in (-depth, h + depth):
            off = np.abs(X[:, -1] - y) + (0.5 * np.abs(X[:, 0]) if self.d == 2 else 0.0)
            spots.append(int(np.argmin(off)))
        how = {
            "dt": dt,
            "every": every,
            "records": records,
            "measure": watch(tuple(spots), self.d - 1),
        }
        seconds = {}
        if timed:
            start = time.perf_counter()
            call: Any = march.lower(motion, motion.params, **how).compile()
            seconds["compile"] = time.perf_counter() - start
            start = time.perf_counter()
            seen = jax.block_until_ready(call(motion, motion.params))[2]
            seconds["steps"] = time.perf_counter() - start
        else:
            seen = march(motion, motion.params, **how)[2]
        return Track(motion, np.asarray(seen), dt, every, longest, seconds)


@lru_cache
def watch(spots: tuple[int, ...], axis: int) -> Callable[..., Any]:
    """What looks at some points; one function for the same points."""
    at = np.array(spots)
    return lambda u, _: u[jnp.asarray(at), axis]


@dataclass(frozen=True)
class Track:
    """What two points saw: u [t, 2] (m), below and above, every so many steps."""

    motion: Any
    u: Any
    dt: float
    every: int
    longest: float
    seconds: dict[str, float]

    @cached_property
    def omega(self) -> Any:
        """Frequencies of the padded samples (1/s)."""
        return layer.frequencies(PADDED, self.dt * self.every)

    @property
    def modulus(self) -> float:
        """Long-wave modulus of an unbroken body, by the forces of an even curvature."""
        X = np.asarray(self.motion.X)
        u = np.zeros_like(X)
        u[:, -1] = 0.5e-6 * X[:, -1] ** 2
        op, drive = self.motion.build(self.motion.params)
        force = op.commit(op.lay(u), self.motion.begin)[0] / drive.mass
        middle = int(np.argmin(np.abs(X).sum(axis=1)))
        return float(op.pick(force)[middle, -1] / 1e-6)

    def after(self, coefficient: Any) -> Any:
        """The upper signal times a coefficient at `omega`."""
        padded = np.zeros(PADDED)
        padded[: len(self.u)] = self.u[:, 1]
        found = layer.through(padded, self.dt * self.every, coefficient)
        return found[: len(self.u)]

    def exact(self, E: float, E_l: float, rho_l: float, h: float) -> tuple[Any, Any]:
        """What an unbroken body's signal becomes: reflected, transmitted (m)."""
        if rho_l == 0.0:
            pair = layer.spring(self.omega, E, 1.0, E_l / h)
        else:
            pair = layer.slab(self.omega, E, 1.0, E_l, rho_l, h)
        back, through = map(self.after, pair)
        return back, through


def errors(track: Track, whole: Track, exact: tuple[Any, Any]) -> dict[str, float]:
    """Peaks and largest errors over the incident peak; R, T."""
    peak = whole.u[:, 1].max()
    back = track.u[:, 0] - whole.u[:, 0]
    found = {}
    for name, seen, right in zip("RT", (back, track.u[:, 1]), exact, strict=True):
        found[f"{name} exact"] = float(np.abs(right).max() / peak)
        found[f"{name} peak"] = float(np.abs(seen).max() / peak)
        found[f"{name} error"] = float(np.abs(seen - right).max() / peak)
    return found
