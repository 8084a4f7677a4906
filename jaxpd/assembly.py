"""Bonds, weights and law of a problem made into its operator; pure, and traced."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jaxpd.discretize import Extension, bond_factors, share_of_body
from jaxpd.discretize.surface import VOLUMES, over_bulk, relative_volumes
from jaxpd.geometry import Family
from jaxpd.geometry.grid_family import GridFamily, offset_shares
from jaxpd.operators import BondForce, Pulled, StencilForce, bond_weights
from jaxpd.operators.fft import pivots
from jaxpd.operators.patches import Box, rim_boxes
from jaxpd.physics import Microelastic
from jaxpd.solvers.newton import Newton

Params = dict[str, Any]


@dataclass(frozen=True)
class Spec:
    """What of a problem is known when it is traced; hashable."""

    material: str
    nu: float | None
    state: str
    kernel: str
    correction: str
    tangent: str
    kinematics: str
    symmetric: bool
    newton: Newton
    operator: str
    cuts: int = 0
    pivots: tuple[float, ...] = ()
    patches: tuple[Box, ...] = ()
    stiffening: float = 1.0


def separate(family: GridFamily, params: Params, correction: str) -> dict[str, Any]:
    """How the volume correction of a lattice is separated: fields of a `Spec`."""
    cuts = {"cuts": int(family.cut.shape[1])}
    if correction not in VOLUMES[1:]:
        return cuts
    v = relative_volumes(family, params["delta"], params["dx"], "lattice")
    boxes = rim_boxes(family)
    return cuts | {"pivots": pivots(np.asarray(v)), "patches": boxes}


def bond_operator(
    spec: Spec,
    family: Family | GridFamily,
    extension: Extension | None,
    params: Params,
    law: Any,
    one: Microelastic | None,
) -> BondForce | StencilForce | Pulled:
    """The operator of a problem, surface correction included.

    Args:
        spec: how it is modelled.
        family: bonds; with an extension those of all points.
        extension: of the correction "fictitious".
        params: `delta` with `dx`, or with the body's `X` and `vol`.
        law: the bond law.
        one: the law with E = 1, None for a law of the user's own.
    """
    n = 0
    if extension is not None:
        n = len(params["X"])
        new = {name: extension(params[name]) for name in ("X", "vol")}
        params = params | new
    factors, delta = None, params["delta"]
    if one is not None and spec.correction not in VOLUMES:
        args = (spec.nu, spec.state, spec.correction)
        factors = bond_factors(family, params, one, *args)
    volumes = spec.correction if spec.correction in VOLUMES else "none"
    if isinstance(family, GridFamily):
        dx, v = params["dx"], None
        weight = offset_shares(family, delta, dx) * dx ** (2 * len(family.shape))
        if volumes != "none":
            # relative to the bulk, so that v is 1 there whatever the convention
            v = relative_volumes(family, delta, dx, "lattice")
            weight = weight * over_bulk(family, delta, dx, volumes)
        how = (spec.tangent, spec.symmetric)
        return StencilForce(family, dx, weight, v, factors, law, *how)
    X, nbr = params["X"], family.nbr
    weight = bond_weights(X, params["vol"], family, delta, volumes)
    if factors is not None:
        weight = weight * factors
    if extension is not None:
        weight = weight * share_of_body(nbr, n)
    force = BondForce(X, nbr, weight, law, delta, spec.tangent, spec.symmetric)
    return force if extension is None else Pulled(force, extension, credited=True)
