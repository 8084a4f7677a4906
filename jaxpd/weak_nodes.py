"""A scene laid on nodes for the weak form: cells, supports, loads, the checks. Host.

What comes out is a `GalerkinProblem`; everything after this may be traced.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.body import check_free, supports_on
from jaxpd.compiling import quickly
from jaxpd.discretize.boundary import Boundary, boundary_points
from jaxpd.discretize.layout import lay_out_cells
from jaxpd.discretize.quadrature import Rule, places_of
from jaxpd.discretize.schemes import SCHEMES
from jaxpd.galerkin import GalerkinProblem
from jaxpd.geometry import HalfSpace, pieces
from jaxpd.nodal_spec import NodalSpec
from jaxpd.nodes import check_forces, cloud_with_rim, law_of, values_inside
from jaxpd.operators.weak import evenhanded
from jaxpd.physics import Hooke
from jaxpd.resolution import RKPM
from jaxpd.scene import Scene
from jaxpd.schedule import ALWAYS, Table
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton

#: Nodes up to which sparse factors are ready before a hierarchy is.
DIRECT = 4000


def galerkin_problem(
    scene: Scene,
    solver: str,
    tangent: str,
    newton: Newton,
    limits: tuple[float, int],
) -> GalerkinProblem:
    """The problem of a scene of nodes; `limits` are tolerance and iterations of solves.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    resolution = scene.resolution
    assert isinstance(resolution, RKPM)
    cloud = cloud_with_rim(scene)
    law, scheme = law_of(scene, len(cloud.X)), SCHEMES[resolution.scheme]
    linear = isinstance(law, Hooke)
    if scheme.stabilisation != "none" and not linear:
        raise ValueError(
            f"scheme: {resolution.scheme!r} stabilises linear elasticity alone, and the"
            f" material is {type(law).__name__}; use 'QCNI'"
        )
    if scheme.stabilisation != "none" and any(map(np.ndim, jax.tree.leaves(law))):
        raise ValueError(
            f"material: {resolution.scheme!r} takes one modulus for the whole body, "
            "not one a node; use 'QCNI'"
        )
    X = np.asarray(cloud.X)
    fixed, moved, courses = supports_on(scene, X)
    layout = lay_out_cells(
        cloud, np.any(fixed, axis=1), scheme, resolution.degree, resolution.support
    )
    a, b = layout.ends[2:]
    check_free(X, pieces(np.asarray(layout.cover.nbr)[:, a:b]), fixed)
    traction, pressure, body, histories = _loads(scene, X, layout.rule, layout.boundary)
    real = jax.dtypes.canonicalize_dtype(float)
    params = {
        "X": jnp.asarray(X),
        "law": jax.tree.map(lambda x: np.asarray(x, real), law),
        "prescribed": moved.astype(X.dtype),
        "traction": traction,
        "pressure": pressure,
        "body": body,
        "alpha": np.asarray(resolution.alpha, real),
    }
    memory = bool(jax.tree.leaves(law.history0()))
    spec = NodalSpec(tangent, newton, courses, histories, linear, memory, "weak")
    empty = LinearSolver(method="direct")
    problem = GalerkinProblem(params, layout, fixed, X, empty, spec)
    if solver == "auto":
        even = scheme.symmetric and evenhanded(law)
        solver = "amg" if even and len(X) > DIRECT else "direct"
    return dataclasses.replace(problem, linear=problem.solver(solver, *limits))


def _spots(X: Any, rule: Rule, line: Boundary) -> Any:
    """Places of the rule, and places and normals of the boundary."""
    _, at, _, normal = boundary_points(X, line)
    return places_of(X, rule)[0], at, normal


def _loads(scene: Scene, X: np.ndarray, rule: Rule, line: Boundary) -> Any:
    """Tractions [r, b, d], pressures [r, b], body forces [r, g, c, d], r histories."""
    d = X.shape[1]
    place, at, normal = map(np.asarray, quickly(_spots)(jnp.asarray(X), rule, line))
    tables: tuple[Table, ...]
    tables = tuple(dict.fromkeys(load.time for load in scene.loads)) or (ALWAYS,)
    middle = X[np.asarray(line.edge)].mean(axis=1)
    nodal = np.asarray(line.size) > 0
    traction = np.zeros((len(tables), *at.shape))
    pressure, body = traction[..., 0].copy(), np.zeros((len(tables), *place.shape))
    check_forces(scene)
    for load in scene.loads:
        row, parts = tables.index(load.time), load.components
        if load.kind == "density":
            flat = place.reshape(-1, d)
            inside = load.region.contains(flat)
            hit = values_inside(parts[:d], inside, flat)
            body[row] += hit.reshape(place.shape)
        else:
            # a node belongs to two edges: the loaded one has its middle there too
            inside = load.region.contains(at)
            inside &= ~nodal | load.region.contains(middle)
            if isinstance(load.region, HalfSpace):
                face = load.region
                inside &= face.sign * normal[:, face.axis] > 0.7
            if load.kind == "pressure":
                hit = values_inside(parts[:1], inside, at)
                pressure[row] += hit[:, 0]
            else:
                hit = values_inside(parts[:d], inside, at)
                traction[row] += hit
        if not hit.any():
            raise ValueError(
                f"loads: the {load.kind} in {load.region} does nothing: it meets no "
                + ("place inside the body" if load.kind == "density" else "edge")
                + "; look at the region and at the values"
            )
    return traction, pressure, body, tables
