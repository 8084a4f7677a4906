"""A scene laid on nodes: rows, supports, tractions, the checks with their cures. Host.

What comes out is a `NodalProblem`; everything after this may be traced.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.body import check_axes, check_free, supports_on, values_at
from jaxpd.discretize.collocate import Layout, lay_out
from jaxpd.geometry import (
    Box,
    Cloud,
    HalfSpace,
    box_nodes,
    lattice,
    pieces,
    row_normals,
)
from jaxpd.nodal import NodalProblem
from jaxpd.nodal_spec import NodalSpec
from jaxpd.operators.navier import check_law
from jaxpd.physics import Hooke, VonMises, elastic
from jaxpd.resolution import MLS
from jaxpd.scene import Elastic, Scene, Solid
from jaxpd.schedule import ALWAYS, Table
from jaxpd.solvers.linear import LinearSolver
from jaxpd.solvers.newton import Newton

#: Poisson's ratio above which volume="auto" projects.
STIFF = 0.48


def nodal_problem(
    scene: Scene,
    solver: str,
    tangent: str,
    newton: Newton,
    limits: tuple[float, int],
) -> NodalProblem:
    """The problem of a scene of nodes; `limits` are tolerance and iterations of solves.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    resolution = scene.resolution
    assert isinstance(resolution, MLS)
    cloud = cloud_with_rim(scene)
    law = law_of(scene, len(cloud.X))
    X, d = np.asarray(cloud.X), scene.d
    fixed, moved, courses = supports_on(scene, X)
    scheme = scheme_of(resolution, d)
    if scheme == "direct":
        check_law(law)
    layout = lay_out(
        cloud,
        fixed,
        degree=resolution.degree,
        support=resolution.support or (3.1 if d == 3 else 4.1),
        rim_support=resolution.rim_support or 4.1,
        scheme=scheme,
        projected=is_projected(resolution.volume, law, scheme),
    )
    check_free(X, pieces(np.asarray(layout.stars.nbr)), fixed)
    pulled, histories = _loads(scene, cloud, layout, fixed)
    real = jax.dtypes.canonicalize_dtype(float)
    params = {
        "X": jnp.asarray(X),
        "law": jax.tree.map(lambda x: np.asarray(x, real), law),
        "tau": np.asarray(resolution.tau if scheme == "double" else 0.0, real),
        "prescribed": moved.astype(X.dtype),
        "load": pulled.astype(X.dtype),
    }
    linear = isinstance(law, Hooke)
    memory = bool(jax.tree.leaves(law.history0()))
    spec = NodalSpec(tangent, newton, courses, histories, linear, memory)
    vol, rim = np.asarray(cloud.vol), cloud.rim
    assert rim is not None
    empty = LinearSolver(method="direct")
    problem = NodalProblem(params, layout, rim, fixed, X, vol, empty, spec)
    method = solver if solver != "auto" else "direct"
    return dataclasses.replace(problem, linear=problem.solver(method, *limits))


def check_forces(scene: Scene) -> None:
    """Refuse loads that nodes do not take, or along axes that are not there.

    Raises:
        ValueError: naming the loads.
    """
    for load in scene.loads:
        if load.kind == "resultant":
            raise ValueError(
                "loads: pull() spreads a force over volumes, and nodes take densities; "
                "use body_force(..) inside and traction(..) on the rim"
            )
        check_axes("loads", load.components, scene.d)


def cloud_with_rim(scene: Scene) -> Cloud:
    """Nodes with volumes and a rim: the scene's own, or a lattice on the box.

    Raises:
        ValueError: on what nodes cannot have: cracks, float32, a body without spacing.
    """
    if scene.cracks or scene.starts or scene.no_fail or scene.weak:
        raise ValueError(
            "cracks, starts, no_fail, weak: are for bonds; a body of nodes has none of "
            "them, leave them out or use resolution=Bonds(..)"
        )
    cloud = _cloud(scene)
    if cloud.X.dtype == jnp.float32:
        raise ValueError(
            "body: its positions are float32, out of reach of an implicit solve; make "
            "it after jax.config.update('jax_enable_x64', True)"
        )
    return cloud


def _cloud(scene: Scene) -> Cloud:
    if isinstance(scene.body, Cloud):
        body, dx = scene.body, scene.resolution.dx
        grid = body.lattice
        if dx is not None and (grid is None or abs(dx / grid.dx - 1.0) > 1e-6):
            has = "no lattice" if grid is None else f"a lattice of {grid.dx}"
            raise ValueError(
                f"dx: {dx} beside a body that is a cloud of nodes with {has}; leave dx "
                "out, its nodes are as far apart as they are, or give a box()"
            )
        if body.rim is None and body.regular and body.lattice is not None:
            vol, rim = box_nodes(body.lattice)
            return dataclasses.replace(body, vol=jnp.asarray(vol), rim=rim)
        return body
    if not isinstance(scene.body, Box):
        raise ValueError(
            f"body: {scene.body!r} must be a box(), or a cloud with a rim, as "
            "jaxpd.mapped(..) makes it; laminates are for bonds"
        )
    dx = scene.resolution.dx
    if dx is None:
        kind = type(scene.resolution).__name__
        raise ValueError(f"dx: None; a box needs a spacing, as in {kind}(dx=1/16)")
    grid = lattice(scene.body.lo, scene.body.hi, dx)
    assert grid.lattice is not None
    vol, rim = box_nodes(grid.lattice)
    return dataclasses.replace(grid, vol=jnp.asarray(vol), rim=rim)


def law_of(scene: Scene, n: int) -> Any:
    """The law of n nodes: that of the scene, or Hooke's of an `Elastic`.

    Raises:
        ValueError: naming what no law of nodes has, or a field that is not nodal.
    """
    law = scene.material
    if isinstance(law, Solid):
        if np.isfinite(law.s_crit):
            raise ValueError("s_crit: bonds break; nodes do not, leave it out")
        law = law.law
    if isinstance(law, Elastic):
        if law.G0 is not None:
            raise ValueError("G0: bonds break; nodes do not, leave it out")
        law = Hooke(law.E, law.nu, law.state)
    if not all(hasattr(law, name) for name in ("step", "history0", "shear")):
        raise ValueError(
            f"material: {law!r} must be Elastic, von_mises(..), or a law with methods "
            "history0() and step(strain, history) and a modulus `shear`; see "
            "jaxpd.physics.node"
        )
    if isinstance(law, Hooke | VonMises):
        for name in ("E", "nu", "h_kin"):
            given = getattr(law, name, None)
            shape = () if given is None else np.shape(given)
            if shape not in ((), (n,)):
                raise ValueError(f"{name}: shape {shape} must be [] or [{n}], nodal")
    state = getattr(law, "state", None)
    if state is not None and elastic.DIMENSIONS[state] != scene.d:
        raise ValueError(
            f"state: {state!r} is {elastic.DIMENSIONS[state]}-D and the body is "
            f"{scene.d}-D; see jaxpd.physics.elastic"
        )
    return law


def scheme_of(resolution: MLS, d: int) -> str:
    """The scheme asked for, or that of so many dimensions."""
    if resolution.scheme != "auto":
        return resolution.scheme
    return "midpoint" if d == 1 else "double"


def is_projected(asked: str, law: Any, scheme: str) -> bool:
    """Whether changes of volume are smoothed over stars."""
    if scheme != "double":
        if asked == "projected":
            raise ValueError(f"volume: 'projected' is not for the scheme {scheme!r}")
        return False
    if asked != "auto":
        return asked == "projected"
    nu, state = getattr(law, "nu", None), getattr(law, "state", "")
    thick = state in ("plane strain", "solid")
    return bool(thick and nu is not None and np.max(np.asarray(nu)) > STIFF)


def _loads(
    scene: Scene, cloud: Cloud, layout: Layout, fixed: np.ndarray
) -> tuple[np.ndarray, tuple[Table, ...]]:
    """Right-hand sides [r, n, d] of the rows, of r histories, and those.

    Rows of balance take force densities, rows of traction t / h; those of the midpoint
    scheme are half a cell and take both.
    """
    X, (n, d) = np.asarray(cloud.X), np.shape(cloud.X)
    tables = tuple(dict.fromkeys(load.time for load in scene.loads)) or (ALWAYS,)
    total = np.zeros((len(tables), n, d))
    rim: Any = cloud.rim
    node, faces = np.asarray(rim.node), np.asarray(rim.normal)
    on = np.zeros(n, bool)
    on[node] = True
    midpoint = layout.scheme == "midpoint"
    check_forces(scene)
    for load in scene.loads:
        row = total[tables.index(load.time)]
        inside, before = load.region.contains(X), row.copy()
        if load.kind == "density":
            b = values_inside(load.components[:d], inside, X)
            # rows of traction hold no body force, but for the half cells of midpoints
            held = np.where(on[:, None] & (not midpoint), 0.0, b)
            own = np.where(np.asarray(layout.pulled) & (not midpoint), 0.0, b)
            row += np.where(fixed, held * np.asarray(cloud.vol)[:, None], own)
        else:
            hit = inside[node]
            if isinstance(load.region, HalfSpace):
                face = load.region
                hit &= face.sign * faces[:, face.axis] > 0.7
            if load.kind == "pressure":
                p = values_inside(load.components[:1], inside, X)[node]
                t = np.where(hit[:, None], -p * faces, 0.0)
            else:
                t = values_inside(load.components[:d], inside, X)[node]
                t = np.where(hit[:, None], t, 0.0)
            row += _rows(t, cloud, layout, fixed)
        if not (np.where(fixed, 0.0, row - before) != 0.0).any():
            raise ValueError(
                f"loads: the {load.kind} in {load.region} does nothing: it meets no "
                "free component of a node"
                + (" inside the body" if load.kind == "density" else " on the rim")
                + "; look at the region, and at what is prescribed there"
            )
    return total, tables


def _rows(t: np.ndarray, cloud: Cloud, layout: Layout, fixed: np.ndarray) -> np.ndarray:
    """What tractions [q, d] (Pa) on the faces of the rim put into the rows [n, d].

    t / h of the face that a free component's row has, and the force (N) of all faces
    where the component is prescribed.
    """
    n, d = fixed.shape
    rim: Any = cloud.rim
    entry, on = row_normals(rim, n, d)
    row = np.where(on[:, None], t[entry, np.arange(d)[None]], 0.0)
    force = np.zeros((n, d))
    np.add.at(force, np.asarray(rim.node), t * np.asarray(rim.area)[:, None])
    return np.where(fixed, force, row / np.asarray(layout.h)[:, None])


def values_inside(parts: Any, inside: np.ndarray, X: np.ndarray) -> np.ndarray:
    """Values [n, d] of components inside a region, zero outside."""
    out = np.zeros((len(X), len(parts)))
    for a, value in enumerate(parts):
        out[inside, a] = values_at("loads", value, X[inside])
    return out
