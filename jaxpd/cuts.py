"""The memory of bonds at time 0: whole, or cut by the cracks of a scene. Host only."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from jaxpd.geometry import Cloud, GridFamily, find_on_grid
from jaxpd.geometry.crack import check_dimension
from jaxpd.operators.row import places_taken, row_of, start_bits
from jaxpd.scene import Scene


def cut_bonds(scene: Scene, cloud: Cloud, X: Any, family: Any, delta: float) -> Any:
    """Bonds that the cracks cut: (point, slot) [2, b], or a mask [k, n]."""
    if not scene.cracks:
        return None
    if isinstance(family, GridFamily):
        cracked = find_on_grid(
            cloud, delta, partial=family.partial, cracks=scene.cracks
        )
        return np.asarray(cracked.cut)
    nbr = np.asarray(family.nbr)
    here = np.arange(len(X), dtype=np.int32)
    cut = np.zeros(nbr.shape, bool)
    check_dimension(scene.cracks, X.shape[1])
    for crack in scene.cracks:
        for row, hit in zip(nbr, cut, strict=True):
            hit |= crack.cuts(X, here, row)
    return cut


def memory_of(
    family: Any, cut: Any, order: Any, kind: str, start: Any, dtype: str, whole: bool
) -> Any:
    """The memory of the bonds at time 0, as the operator of that kind keeps it.

    Args:
        family: the bonds.
        cut: which of them cracks cut, or None.
        order: numbers of the points along a curve, for "slots".
        kind: of the operator.
        start: memory of an untouched bond.
        dtype: of numbers.
        whole: whether no bond is ever cut: then none has a flag on a lattice.
    """
    if kind == "halves" and whole:
        return jax.device_put(places_taken(row_of(family.shape, family.offsets)))
    if kind == "halves":
        return jax.device_put(start_bits(row_of(family.shape, family.offsets), cut))
    nbr = np.asarray(family.nbr)
    there = nbr != np.arange(nbr.shape[1])
    if cut is not None:
        there &= ~cut
    if kind == "slots":
        return jax.device_put(there[:, order])
    real = bool if isinstance(start, bool) else dtype
    return jax.device_put((np.full(nbr.shape, start, real), there))


def unbreakable(scene: Scene, X: np.ndarray) -> np.ndarray:
    """Mask of the points whose bonds never break [n]."""
    found = np.zeros(len(X), bool)
    for region in scene.no_fail:
        inside = region.contains(X)
        if not inside.any():
            raise ValueError(f"no_fail: no point lies in {region}")
        found |= inside
    return found
