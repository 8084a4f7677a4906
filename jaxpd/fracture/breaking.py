"""A scene made ready to break slowly: springs, their strength, what may fail.

Quasi-static fracture is of small displacements: bonds are springs that stand or are
gone. Cracks of the scene are springs that are gone from the start; surface corrections
are those of the body before, so that the faces of old and new cracks are alike.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from jaxpd._types import PointVector
from jaxpd.assembly import Params
from jaxpd.body import check_bonds, check_free, cloud_of
from jaxpd.checks import instance, number, word
from jaxpd.cuts import cut_bonds, unbreakable
from jaxpd.discretize.bulk import toughness_ratio
from jaxpd.laminate import Laminate
from jaxpd.operators import BondForce
from jaxpd.operators.springs import Springs, across, springs_of
from jaxpd.physics.damage import critical_stretch
from jaxpd.prepare import prepare
from jaxpd.problem import Problem
from jaxpd.scene import Elastic, Scene, Solid


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Fracture:
    """A body of springs that may break; bonds are (slot, i), each once.

    Attributes:
        params: defaults of what may be varied or differentiated: those of `problem`,
            and G0 [] or [n] (J/m^2) or s_crit [] (-).
        problem: the body without cracks, by index lists.
        slot: slot of each bond [b] at its end i.
        i: that end [b].
        cut: which bonds the cracks of the scene cut [b].
        may: which bonds may break [b].
        toughness: G over G0 that is divided out of the strength (-).
    """

    params: Params
    problem: Problem
    slot: Any
    i: Any
    cut: Any
    may: Any
    toughness: float = field(metadata={"static": True}, default=1.0)

    @property
    def X(self) -> PointVector:
        """Reference positions [n, d] (m)."""
        return self.problem.X

    @property
    def fixed(self) -> Any:
        """Mask of prescribed displacement components [n, d]."""
        return self.problem.fixed

    def bonds(self, params: Params) -> BondForce:
        """The operator of the body without cracks. Pure."""
        known = {name: params[name] for name in self.problem.params}
        bonds = self.problem.bonds(known)
        assert isinstance(bonds, BondForce)
        return bonds

    def springs(self, params: Params) -> Springs:
        """Bonds as springs [b]. Pure."""
        return springs_of(self.bonds(params), self.slot, self.i)

    def critical(self, params: Params) -> jax.Array:
        """Critical stretch of each bond [b] (-), inf where it never breaks. Pure."""
        if "s_crit" in params:
            s = jnp.asarray(params["s_crit"])
        else:
            d = self.X.shape[1]
            law = self.problem.law(params, d)
            c = law.c / self.problem.spec.stiffening
            s = critical_stretch(params["G0"], c, law.omega, d, params["delta"])
            s = jnp.asarray(s) / self.toughness**0.5
        if s.ndim:
            family: Any = self.problem.family
            i, j = self.i, family.nbr[self.slot, self.i]
            s = 0.5 * (s[i] + s[j])
        return jnp.where(self.may, s, math.inf)


def check_breaks(scene: Scene) -> None:
    """Refuse a scene that cannot break slowly.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    check_bonds(scene, "slow fracture")
    if isinstance(scene.body, Laminate):
        raise ValueError("body: a laminate; interlayers break in run_explicit")
    if scene.starts:
        raise ValueError("starts: are for run_explicit, which knows time")
    material = scene.material
    strong = isinstance(material, Elastic) and material.G0 is None
    memory = isinstance(material, Solid) and hasattr(material.law, "advance")
    if strong or memory or not isinstance(material, Elastic | Solid):
        raise ValueError(
            f"material: {material!r} never breaks, or has a memory of its own; use "
            "Elastic(.., G0=..), or Solid(law, rho, s_crit) of a law without memory"
        )
    if scene.resolution.correction == "fictitious":
        raise ValueError(
            "correction: 'fictitious' does not break; use 'lattice' or 'energy'"
        )


def prepare_fracture(scene: Scene, toughness: str | float = "nominal") -> Fracture:
    """Do the host work of a scene that breaks slowly once.

    Args:
        scene: what breaks: `Elastic` with a fracture energy G0, or a `Solid` of a law
            without memory and a critical stretch. Supports and loads are those at the
            load factor 1. `weak` and `no_fail` say what may fail. Displacements are
            small, whatever `kinematics` says.
        toughness: what the critical stretch is calibrated to. "nominal" is G0 of the
            integral over the horizon; "lattice" gives the bonds between two rows of the
            lattice G0 exactly; a number is a ratio G / G0 that was measured for nominal
            stretches, as by `jaxpd.trapping`, and is divided out.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    instance("scene", scene, Scene, "a Scene(..)")
    if isinstance(toughness, str):
        word("toughness", toughness, ("nominal", "lattice"), "or a ratio")
    else:
        number("toughness", toughness, above=0, cure="or 'nominal', 'lattice'")
    check_breaks(scene)
    material, resolution = scene.material, scene.resolution
    more: Params = {}
    law: Any = material
    if isinstance(material, Elastic):
        more["G0"] = np.asarray(material.G0, float)
    else:
        law, more["s_crit"] = material.law, np.asarray(material.s_crit, float)
    whole = dataclasses.replace(
        scene, material=law, cracks=(), no_fail=(), weak=(), kinematics="small"
    )
    problem = prepare(whole, operator="gather", solver="direct")
    X, family = np.asarray(problem.X), problem.family
    nbr = np.asarray(family.nbr)
    slot, i = (x.astype(np.int32) for x in np.nonzero(nbr > np.arange(len(X))))
    order = np.lexsort((nbr[slot, i], i))
    slot, i = slot[order], i[order]
    j = nbr[slot, i]
    cut = cut_bonds(scene, cloud_of(scene), X, family, resolution.horizon)
    cut = np.zeros(len(i), bool) if cut is None else cut[slot, i]
    may = np.ones(len(i), bool)
    if scene.weak:
        may = np.any([surface.cuts(X, i, j) for surface in scene.weak], axis=0)
    strong = unbreakable(scene, X)
    may &= ~(strong[i] | strong[j])
    if not (may & ~cut).any():
        raise ValueError(
            "weak, no_fail: no bond is left that may break; make regions smaller, or "
            "surfaces longer"
        )
    ratio = _toughness(toughness, scene, problem)
    made = Fracture(problem.params | more, problem, slot, i, cut, may, ratio)
    # bonds at the rim of a horizon may have no weight: nothing breaks there
    return dataclasses.replace(made, may=may & (_stiff(made, j) > 0.0))


def piece_labels(i: np.ndarray, j: np.ndarray, n: int) -> np.ndarray:
    """Label [n] of the piece that every point belongs to, by bonds i, j [b]."""
    graph = sp.coo_array((np.ones(len(i), np.int8), (i, j)), shape=(n, n))
    return connected_components(graph, directed=False)[1]


def _toughness(asked: str | float, scene: Scene, problem: Problem) -> float:
    """G over G0 that is divided out."""
    if isinstance(asked, str):
        if asked == "nominal":
            return 1.0
        grid = cloud_of(scene).lattice
        if grid is None or not isinstance(scene.material, Elastic):
            raise ValueError(
                "toughness: 'lattice' is for Elastic on a lattice; use 'nominal', or "
                "a number"
            )
        d, params = scene.d, problem.params
        delta = float(params["delta"])
        sizes = (delta, grid.dx, scene.resolution.partial)
        ratio = toughness_ratio(problem.law(params, d).omega, d, sizes)
        return ratio * problem.spec.stiffening
    return float(asked)


@jax.jit
def _look(made: Fracture) -> tuple[jax.Array, jax.Array]:
    bonds = made.bonds(made.params)
    return made.springs(made.params).k, across(bonds, made.slot, made.i)


def _stiff(made: Fracture, j: np.ndarray) -> np.ndarray:
    """Stiffness of the bonds [b] (N/m), checked.

    Raises:
        ValueError: on bonds that are no springs, or pieces that are free from the
            start.
    """
    k, side = map(np.asarray, _look(made))
    if not (np.isfinite(k) & (k >= 0)).all():
        raise ValueError(
            f"material: {int((~(k >= 0)).sum())} bonds have a negative stiffness at "
            "rest, or none that is a number; slow fracture takes bonds as springs"
        )
    if not side <= 1e-9:
        raise ValueError(
            f"material: its bonds resist across themselves ({side:.2g} of what they "
            "do along); slow fracture takes bonds as springs, use run_explicit"
        )
    X = np.asarray(made.X)
    live = ~np.asarray(made.cut) & (k > 0)
    label = piece_labels(np.asarray(made.i)[live], j[live], len(X))
    check_free(X, label, np.asarray(made.fixed))
    return k
