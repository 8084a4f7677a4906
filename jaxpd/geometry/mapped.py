"""Grids of nodes that follow a map of the unit cube: rings, plates with holes, panels.

The map gives positions; its derivative gives volumes, normals and areas. Nodes lie on
the faces. Inner nodes may be moved at random, which is how meshfree methods are tried.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.checks import number, vector, whole
from jaxpd.geometry.cloud import Cloud, Lattice, from_points
from jaxpd.geometry.rim import Rim, rim_of_grid


def mapped(
    shape: Sequence[int],
    place: Callable[[Any], Any],
    *,
    jitter: float = 0.0,
    seed: int = 0,
) -> Cloud:
    """A grid of nodes at place(s), s [d] from 0 to 1 along each axis, with its rim.

    Args:
        shape: nodes along each axis, at least 2; node (i, j, ..) has the number
            `ravel_multi_index((i, j, ..), shape)`.
        place: position x [d] (m) of s [d], written with `jax.numpy`; must not fold, and
            keep right-handed axes right-handed.
        jitter: inner nodes are moved along each axis of s by up to this share of a
            spacing, below 0.5.
        seed: of the moves.

    Raises:
        ValueError: on a grid too small, a jitter out of range, or a map that folds.
    """
    shape = tuple(whole("shape", n, 2) for n in vector("shape", shape))
    d = len(shape)
    number("jitter", jitter, least=0, below=0.5)
    whole("seed", seed, 0)
    if not callable(place):
        raise ValueError(f"place: {place!r} must be a function of s [{d}]")
    ends = np.array(shape) - 1
    step = 1.0 / ends
    at = np.indices(shape).reshape(d, -1).T
    rim: Any = (at == 0) | (at == ends)
    inner = ~rim.any(axis=1)
    s = at * step
    moves = np.random.default_rng(seed).uniform(-jitter, jitter, s.shape)
    s = np.where(inner[:, None], s + moves * step, s)
    s = np.where(at == ends, 1.0, s)  # faces come out exactly
    X = np.asarray(jax.vmap(place)(jnp.asarray(s)))
    J = np.asarray(jax.vmap(jax.jacfwd(place))(jnp.asarray(s)))
    size = np.linalg.det(J)
    if X.shape != s.shape or not (np.isfinite(size) & (size > 0)).all():
        raise ValueError(
            f"place: it gives positions {X.shape} with a determinant down to "
            f"{size.min():.3g}; it must map [{d}] to [{d}] and not fold"
        )
    cofactor = np.linalg.inv(J) * size[:, None, None]  # rows: normal times area
    area = np.linalg.norm(cofactor, axis=2)
    cell = step.prod() / step
    faces = rim_of_grid(shape, cofactor / area[:, :, None], area * cell)
    share = np.where(rim, 0.5, 1.0).prod(axis=1)
    cloud = from_points(X, size * step.prod() * share)
    return dataclasses.replace(cloud, rim=faces)


def box_nodes(lattice: Lattice) -> tuple[np.ndarray, Rim]:
    """Volumes [n] (m^d) of a lattice's cells inside the box that it spans, its rim."""
    shape, d, dx = lattice.shape, len(lattice.shape), lattice.dx
    at, n = np.indices(shape).reshape(d, -1), math.prod(shape)
    ends = np.array(shape)[:, None] - 1
    share = np.where((at == 0) | (at == ends), 0.5, 1.0).prod(axis=0)
    normals = np.broadcast_to(np.eye(d), (n, d, d))
    faces = rim_of_grid(shape, normals, np.full((n, d), dx ** (d - 1)))
    return share * dx**d, faces
