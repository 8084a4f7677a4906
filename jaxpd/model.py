"""What the bonds of a scene are: which model, its numbers, its surface correction."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.assembly import Params
from jaxpd.body import free_faces
from jaxpd.discretize.bulk import energy_ratio
from jaxpd.discretize.directional import DIRECTIONAL
from jaxpd.discretize.surface import CORRECTIONS
from jaxpd.geometry import Cloud
from jaxpd.geometry.crack import check_inside
from jaxpd.physics import bond_block, elastic
from jaxpd.resolution import Kernel
from jaxpd.scene import Elastic, Scene, Solid


def correction_of(scene: Scene, cloud: Cloud, operator: str = "auto") -> str:
    """The surface correction asked for, or the default; checked."""
    correction = scene.resolution.correction
    if correction is None:
        correction = "lattice" if cloud.lattice is not None else "analytic"
    check_correction(correction, scene, cloud, operator)
    return correction


def check_correction(
    correction: str, scene: Scene, cloud: Cloud, operator: str
) -> None:
    """Refuse a surface correction that the scene or the operator cannot have.

    Raises:
        ValueError: naming the argument, its value and the cure.
    """
    if correction not in CORRECTIONS:
        raise ValueError(f"correction: {correction!r} must be one of {CORRECTIONS}")
    if correction in DIRECTIONAL:
        if not isinstance(scene.material, Elastic):
            raise ValueError(
                f"correction: {correction!r} compares with classical elasticity and "
                "needs an Elastic material; use 'lattice' or 'analytic' with own laws"
            )
        kernel = scene.resolution.kernel
        steep = isinstance(kernel, Kernel) and kernel.name == "fractional"
        alpha = float(getattr(kernel, "parameter", 0.0))
        if correction == "force density" and steep and alpha >= 1:
            raise ValueError(
                f"alpha: {alpha:g} must be below 1 with the correction 'force density',"
                " whose pull of a half neighbourhood diverges from there on; use "
                "correction='energy'"
            )
        if operator == "fft":
            raise ValueError(
                f"operator: 'fft' needs bonds that are alike, and the correction "
                f"{correction!r} makes each its own; use 'stencil' or 'gather'"
            )
    if correction == "fictitious":
        if operator not in ("auto", "gather"):
            raise ValueError(
                f"operator: {operator!r} does not know of the correction 'fictitious';"
                " use 'gather'"
            )
        if np.ndim(getattr(scene.material, "E", 0.0)):
            raise ValueError(
                "E: a modulus of every point cannot be continued beyond the body by "
                "the correction 'fictitious'; use correction='energy'"
            )
        if not any(map(any, free_faces(scene))):
            raise ValueError(
                "correction: 'fictitious' finds no free face; use 'none' or 'lattice'"
            )


def model_of(scene: Scene) -> tuple[tuple[str, float | None, str], Params]:
    """What the bonds are: "elastic" or "law" with nu and state, and their numbers."""
    material = scene.material
    if isinstance(material, Elastic):
        if elastic.DIMENSIONS[material.state] != scene.d:
            raise ValueError(
                f"state: {material.state!r} is {elastic.DIMENSIONS[material.state]}-D "
                f"and the body is {scene.d}-D; see jaxpd.physics.elastic"
            )
        elastic.check_bond_based(material.nu, material.state)
        kernel = scene.resolution.kernel
        model = ("elastic", material.nu, material.state)
        return model, _elastic_params(material, kernel)
    law = material.law if isinstance(material, Solid) else material
    inside = getattr(law, "law", law) if hasattr(law, "advance") else law
    if not (hasattr(inside, "energy") or hasattr(inside, "force")):
        raise ValueError(
            f"material: {material!r} must be Elastic, or a law with a method "
            "energy(xi, eta) or force(xi, eta); see jaxpd.physics.bond"
        )
    return ("law", None, ""), {"law": _floats("material", law)}


def check_given(scene: Scene, X: np.ndarray) -> None:
    """Refuse fields that are not one number a point, and cracks beside the body.

    Raises:
        ValueError: naming the field, or the crack.
    """
    check_inside(scene.cracks, X)
    for name in ("E", "rho", "G0", "s_crit"):
        given: Any = getattr(scene.material, name, None)
        shape = np.shape(given)
        if shape not in ((), (len(X),)):
            raise ValueError(
                f"{name}: of shape {shape} must be one number, or one for each of the "
                f"{len(X)} points [{len(X)}]"
            )


def check_whole(scene: Scene) -> None:
    """Refuse what a static solve, in which nothing breaks, does not know.

    Raises:
        ValueError: naming the door for it.
    """
    if scene.starts or scene.no_fail or scene.weak:
        raise ValueError(
            "starts, no_fail, weak: nothing moves or breaks in statics; leave them "
            "out, or use run_explicit, or solve_fracture"
        )


def stiffening_of(scene: Scene, cloud: Cloud) -> float:
    """Factor on the micromodulus by which the lattice's bulk has the classical energy.

    Raises:
        ValueError: naming what does not go with `calibration="lattice"`.
    """
    asked, material = scene.resolution.calibration, scene.material
    if asked not in ("continuum", "lattice"):
        raise ValueError(f"calibration: {asked!r} must be 'continuum' or 'lattice'")
    if asked == "continuum":
        return 1.0
    resolution = scene.resolution
    if cloud.lattice is None or not isinstance(material, Elastic):
        raise ValueError(
            "calibration: 'lattice' is for Elastic on a lattice; leave it out"
        )
    if correction_of(scene, cloud) not in ("none", "lattice"):
        raise ValueError(
            f"calibration: 'lattice' and correction={resolution.correction!r} would "
            "both scale the interior; take correction='lattice' or 'none'"
        )
    kernel, delta, d = resolution.kernel, resolution.horizon, scene.d
    omega = kernel.influence(d, delta) if isinstance(kernel, Kernel) else kernel
    sizes = (delta, cloud.lattice.dx, resolution.partial)
    return 1.0 / energy_ratio(material.nu, material.state, omega, d, sizes)


def _floats(name: str, tree: Any) -> Any:
    real = jax.dtypes.canonicalize_dtype(float)
    try:
        return jax.tree.map(lambda x: np.asarray(x, real), tree)
    except TypeError as error:
        raise ValueError(
            f"{name}: {tree!r} must be Elastic, a Kernel or a frozen dataclass of "
            "numbers registered with jax.tree_util.register_dataclass"
        ) from error


def is_symmetric(law: Any, d: int) -> bool:
    """Whether tangent blocks are symmetric: by energy, or looked at on random bonds."""
    if law is None or hasattr(law, "energy"):
        return True
    one = jax.tree.map(lambda x: jnp.ravel(x)[0], law)
    xi, eta = np.random.default_rng(0).normal(size=(2, 8, d))
    B = np.asarray(jax.vmap(lambda x, e: bond_block(one, x, 0.01 * e))(xi, eta))
    return bool(np.abs(B - B.transpose(0, 2, 1)).max() <= 1e-8 * np.abs(B).max())


def _elastic_params(material: Elastic, kernel: Any) -> Params:
    params: Params = {"E": _floats("E", material.E)}
    if not isinstance(kernel, Kernel):
        params["omega"] = _floats("kernel", kernel)
    elif kernel.name == "fractional":
        params["alpha"] = _floats("kernel", kernel.parameter)
    elif kernel.name == "gaussian":
        params["ratio"] = _floats("kernel", kernel.parameter)
    return params
