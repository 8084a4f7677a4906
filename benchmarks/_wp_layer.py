"""A pulse through a soft layer of a bar: ghost interlayers, a meshed one, elements.

Bar of E = rho = 1, layer of 0.04 with E_l = 0.01 and rho_l = 1; a Gaussian pulse of
width 0.8, displacements taken down 0.2 in front of and behind the layer. The answer is
the pulse times the exact coefficients of the slab, frequency by frequency, so that
dispersion of the lattice counts as error.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from _plane_waves import PADDED, Body, march, watch
from _wp import Job, Method, Problem

import jaxpd
from jaxpd import interlayer
from jaxpd.launch import longest_dt
from jaxpd.physics import layer

H, E_L, RHO_L, A, AWAY = 0.04, 0.01, 1.0, 0.8, 0.2
SAMPLE = A / 8.0
RECORDS = int(11.0 * A / SAMPLE)
T = SAMPLE * np.arange(1, RECORDS + 1)


def incident(t: Any) -> np.ndarray:
    """The pulse at the lower face, 4 from where it starts, over its peak."""
    return np.exp(-(((4.0 - t) / A) ** 2))


def exact(below: float, above: float) -> np.ndarray:
    """Displacements [t, 2] at two places over the peak of the incident pulse."""
    back, on = layer.slab(layer.frequencies(PADDED, SAMPLE), 1.0, 1.0, E_L, RHO_L, H)

    def after(delay: float, coefficient: Any) -> np.ndarray:
        t = SAMPLE * np.arange(1, PADDED + 1)
        return layer.through(incident(t - delay), SAMPLE, coefficient)[:RECORDS]

    return np.stack(
        [incident(T - below) + after(-below, back), after(above - H, on)], 1
    )


def judge(found: Any) -> tuple[float, int]:
    """Largest error of both signals over the incident peak."""
    seen, (below, above), points = found
    return float(np.abs(np.asarray(seen) - exact(below, above)).max()), points


def lattice(make: Callable[[Body], Any]) -> Callable[[int], Job]:
    """A scene of bonds, m = 3, with so many spacings in the thickness of the layer."""

    def job(n: float) -> Job:
        body = Body(1, H / n, A, away=AWAY)

        def call() -> Any:
            motion = jaxpd.prepare_motion(make(body))
            every = math.ceil(SAMPLE / (0.8 * longest_dt(motion)))
            X = np.asarray(motion.X)[:, 0]
            spots = [int(np.argmin(np.abs(X - y))) for y in (-AWAY, H + AWAY)]
            seen = march(
                motion,
                motion.params,
                dt=SAMPLE / every,
                every=every,
                records=RECORDS,
                measure=watch(tuple(spots), 0),
            )[2]
            return jax.block_until_ready(seen) / 0.5e-4, X[spots], len(X)

        return Job(call, judge)

    return job


def ghosts(rule: str, rho: float) -> Callable[[int], Job]:
    """An interlayer without points."""
    what = interlayer(E_L, rule=rule, rho=rho)
    return lattice(lambda body: body.scene(H, what))


def meshed(mean: str) -> Callable[[int], Job]:
    """The layer filled with points."""
    return lattice(lambda body: body.scene(H, None, E_L, mean))


def elements(inside: Callable[[float], int]) -> Callable[[float], Job]:
    """Linear elements, lumped mass, central differences; 0 inside is a spring.

    Sizes are spacings of the plies over the thickness of the layer.
    """

    def call(n: float) -> Any:
        plies = round(8.0 * n / H)
        low, high = (
            np.linspace(-8.0, 0.0, plies + 1),
            np.linspace(H, 8.0 + H, plies + 1),
        )
        cells = inside(n)
        middle = np.linspace(0.0, H, cells + 1)[1:-1] if cells else np.zeros(0)
        x = np.concatenate([low, middle, high])
        size = np.diff(x)
        soft = (x[:-1] > -1e-9) & (x[1:] < H + 1e-9)
        k = np.where(soft, E_L, 1.0) / size
        half = 0.5 * size * np.where(soft, RHO_L if cells else 0.0, 1.0)
        mass = np.append(half, 0.0) + np.insert(half, 0, 0.0)
        stable = 2.0 / math.sqrt(
            max((2 * k / mass[:-1]).max(), (2 * k / mass[1:]).max()) * 2.0
        )
        every = math.ceil(SAMPLE / (0.8 * stable))
        dt = SAMPLE / every
        u = 2.0 * np.exp(-(((x + 4.0) / A) ** 2))
        spots = [int(np.argmin(np.abs(x - y))) for y in (-AWAY, H + AWAY)]
        seen, step, force = np.zeros((RECORDS, 2)), dt * dt / mass, np.zeros(len(x))

        def pull() -> np.ndarray:
            bar = k * np.diff(u)
            force[:-1] = bar
            force[-1] = 0.0
            force[1:] -= bar
            return step * force

        before = u + 0.5 * pull()  # at rest: half a step's change either way
        for record in range(RECORDS):
            for _ in range(every):
                before += 2.0 * (u - before) + pull()
                before, u = u, before
            seen[record] = u[spots]
        return seen, x[spots], len(x)

    return lambda n: Job(lambda: call(n), judge)


COARSE, FINE = (0.5, 1, 2, 4), (1, 2, 3, 6, 12)
PROBLEM = Problem(
    "layer",
    "Pulse through a soft layer in a bar",
    "largest error of R and T over the incident peak (-)",
    (
        Method("ghosts, calibrated", "ghosts", ghosts("calibrated", RHO_L), COARSE),
        Method("ghosts, no mass", "ghosts", ghosts("calibrated", 0.0), COARSE),
        Method("ghosts, paper's rule", "ghosts", ghosts("paper", 0.0), COARSE),
        Method("bonds, layer meshed", "bonds", meshed("arithmetic"), FINE),
        Method("bonds, layer meshed, in series", "bonds", meshed("harmonic"), FINE),
        Method("FE, layer meshed", "peer", elements(round), FINE),
        Method(
            "FE, ten times finer in the layer",
            "peer",
            elements(lambda n: round(10 * n)),
            (0.5, 1, 2, 4),
        ),
        Method("FE, a spring for the layer", "peer", elements(lambda n: 0), COARSE),
    ),
    True,
    (
        "sizes: spacings of the plies over the layer's thickness; elements: linear, "
        "lumped mass, central differences, NumPy",
    ),
)
