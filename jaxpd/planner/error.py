"""How wrong a model of a scene is, from what was measured on problems with answers.

Relative errors of displacements; re-entrant corners, jumps and cracks shorter than a
few horizons are worse. Where nothing that was measured applies it is None.

    bonds      a share of 2 delta / L from the surfaces and one of the lattice
    nodes      C (h / L)^p, the worst of what was measured
    waves      (m dx k)^2 / 24 of the phase speed, k the wave number
    fracture   what a lattice asks of a crack beyond G0
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from jaxpd.geometry import Box, HalfSpace
from jaxpd.laminate import Laminate
from jaxpd.planner.laws import breaks, elastic, projected, stiffening
from jaxpd.planner.look import Look
from jaxpd.resolution import MLS, Bonds
from jaxpd.scene import Scene

#: Error over 2 delta / L of bodies under loads, by correction: the worst of a bar
#: (work_precision.py) and a clamped, bent beam (tests/test_planner.py).
SURFACE = {
    "none": 0.5,
    "lattice": 0.4,
    "analytic": 0.25,
    "energy": 0.14,
    "force density": 0.6,
    "fictitious": 0.11,
}
#: The same where displacements alone are prescribed (convergence.py).
PRESCRIBED = 0.22
#: A clamped face of bonds holds a layer: what it takes of the length, over the horizon,
#: under forces on faces and all over (expected.py).
CLAMP = {"": 0.45, "density": 0.8}
#: Rows on the faces have whole volumes: bending stiffness is up by 3 dx / L.
EDGE = 3.0
#: Modulus in the middle of a strip, off the classical one, m = 4 (surfaces.py).
MIDDLE = {
    "analytic": 0.008,
    "energy": 0.007,
    "force density": 0.115,
    "fictitious": 0.007,
}
#: The same of the corrections that leave the lattice's own quadrature, by m.
QUADRATURE = {3: 0.10, 4: 0.09, 6: 0.06, 8: 0.05}
#: Opening of the cracked plate as h goes to 0 at fixed m, over the classical one, less
#: 1 (benchmarks/convergence.py): what is left of the lattice under displacements.
LATTICE = {3: 0.014, 4: 0.006, 6: 0.004, 8: 0.003}
#: Energy that a brittle crack dissipates over G0, less 1 (fracture_static.py).
TRAPPED = {3: 0.135, 4: 0.044, 5: 0.036, 6: 0.014}
#: Error C (h / L)^p of nodes where fields are smooth: kernels on boxes and elsewhere
#: (the plate with a hole), differences.
NODAL = {"QCNI": (0.07, 2.0), "QCNI, uneven": (0.2, 2.0), "SCNI": (1.0, 2.0)}
STRONG = {1: (6.0, 3.0), 2: (0.8, 1.0), 3: (0.8, 1.0)}
#: Kernels beside a clamped face, at whose ends stresses are infinite: C (h / L)^1.5
#: over the height of the face by the length that it holds, up to a most (expected.py).
CORNER, CORNER_MOST = 0.18, 0.48
#: Kernels lock mildly: their error grows with (lambda / mu)^(1/2) (expected.py).
LOCKING = 1.6
#: Differences with projected volumes.
PROJECTED = 1.6


def of_bonds(
    resolution: Bonds, look: Look, loaded: bool, held: float = 0.0
) -> tuple[float, str]:
    """Expected error of bonds at rest, and its basis.

    Args:
        resolution: of the body.
        look: its sizes.
        loaded: whether forces are prescribed, so that the modulus counts.
        held: share of a horizon that clamps take, over the length they hold (1/m).
    """
    correction = resolution.correction or ("lattice" if look.regular else "analytic")
    share = SURFACE[correction] if loaded else min(PRESCRIBED, SURFACE[correction])
    rim = max(share * 2.0 / look.least, held) * look.m * look.dx
    bulk = at(LATTICE, look.m)
    basis = f"surfaces ({correction}), lattice (m = {look.m:.3g})"
    if loaded and resolution.calibration != "lattice":
        bulk += MIDDLE.get(correction) or at(QUADRATURE, look.m)
        basis += ", modulus under loads"
    if loaded and resolution.nodes == "edge" and look.regular:
        bulk += EDGE * look.dx / look.least
        basis += ", whole volumes on faces"
    if not look.regular:
        bulk += 0.5 * look.spread / look.m
        basis += ", irregular points"
    return min(1.0, rim + bulk), basis


def of_differences(scene: Scene, look: Look) -> tuple[float, str]:
    """Expected error of the strong form, and its basis."""
    C, p = STRONG[look.d]
    C *= PROJECTED if projected(scene) else 1.0
    basis = "bar (work_precision.py)"
    if look.d > 1:
        basis = "rectangles (expected.py), hole (work_precision.py)"
    return C * (look.dx / look.least) ** p, basis


def of_kernels(scene: Scene, look: Look) -> tuple[float | None, str]:
    """Expected error of the weak form, None if it need not converge; and its basis."""
    scheme, size = scene.resolution.scheme, look.dx / look.least
    if scheme not in ("QCNI", "SCNI"):
        return None, f"{scheme} need not converge (paper_rkpm.py)"
    even = look.regular or look.d == 1
    basis = "rectangles (expected.py)" if even else "hole (work_precision.py)"
    C, p = NODAL[scheme if scheme == "SCNI" or even else "QCNI, uneven"]
    error = C * size**p
    held = clamped(scene, look)
    if look.d > 1 and held:
        error = max(error, min(CORNER * held, CORNER_MOST) * size**1.5)
        basis += ", ends of clamped faces"
    locking = LOCKING * stiffening(scene) ** 0.5
    if locking > 1.0:
        error, basis = error * locking, basis + ", nearly of one volume"
    return error, basis


def of_waves(look: Look, length: float | None) -> tuple[float | None, str]:
    """Error of the phase speed of waves of a length (m), and its basis."""
    if length is None:
        return None, "no wave length in the scene; (2 pi delta / length)^2 / 24 is lost"
    k = 2.0 * math.pi / length
    return (
        look.m * look.dx * k
    ) ** 2 / 24.0, f"dispersion of waves {length:.2g} m long"


def of_cracks(m: float) -> tuple[float, str]:
    """What a brittle lattice takes of energy beyond G0, and its basis."""
    return at(TRAPPED, m), "trapping of G0 (fracture_static.py); see jaxpd.trapping"


def at(known: dict[int, float], m: float) -> float:
    """A table of horizon ratios at any, by straight lines; ends are held."""
    keys = sorted(known)
    if m <= keys[0]:
        return known[keys[0]]
    if m >= keys[-1]:
        return known[keys[-1]]
    above = next(k for k in keys if k >= m)
    below = max(k for k in keys if k < m)
    share = (m - below) / (above - below)
    return known[below] + share * (known[above] - known[below])


def _held_faces(scene: Scene, look: Look) -> list[tuple[float, float]]:
    """Length that is held and height (m) of each face that holds all components.

    Of supports of all components elsewhere, the shortest side as both.
    """
    found = []
    for support in scene.supports:
        if None in support.components[: scene.d]:
            continue
        region, sides = support.region, np.asarray(look.sides)
        if isinstance(scene.body, Box):
            sides = np.subtract(scene.body.hi, scene.body.lo)
        if isinstance(region, HalfSpace):
            across = np.delete(sides, region.axis)
            found.append((float(sides[region.axis]), float(across.max(initial=0.0))))
        else:
            found.append((float(sides.min()),) * 2)
    return found


def clamped(scene: Scene, look: Look) -> float:
    """Height over length of clamped faces, the highest; 0 without any."""
    faces = _held_faces(scene, look)
    return max((height / length for length, height in faces), default=0.0)


def reach(scene: Scene, look: Look) -> float:
    """Share of a horizon that clamped faces take, over the length they hold (1/m)."""
    if not scene.loads:
        return 0.0
    share = CLAMP["density" if any(x.kind == "density" for x in scene.loads) else ""]
    return max((share / length for length, _ in _held_faces(scene, look)), default=0.0)


def of_scene(scene: Scene, job: str, seen: Look) -> tuple[float | None, str]:
    """Expected error of a scene with a resolution, None if unknown, and its basis."""
    given = scene.resolution
    first = given[0] if isinstance(given, list | tuple) else given
    if job in ("fracture", "motion"):
        return _of_breaking(scene, job, seen)
    own = isinstance(first, Bonds) and not elastic(scene.material)
    if own and not isinstance(scene.body, Laminate):
        return None, "the law is the user's own: refine(scene) measures"
    if isinstance(first, Bonds):
        return of_bonds(first, seen, bool(scene.loads), reach(scene, seen))
    of_nodes = of_differences if isinstance(first, MLS) else of_kernels
    return of_nodes(scene, seen)


def _of_breaking(scene: Scene, job: str, seen: Look) -> tuple[float, str]:
    """Of motion and fracture: the horizon over the body's features, waves, trapping."""
    given = scene.resolution
    first = given[0] if isinstance(given, list | tuple) else given
    error = PRESCRIBED * 2.0 * seen.m * seen.dx / feature(scene, seen)
    basis = "the horizon over the body's smallest feature"
    size = min((_extent(start.region, scene) for start in scene.starts), default=0.0)
    if size > 0.0:
        # half a row more or less; with rows on the faces a whole one
        rows = 1.1 if first.nodes == "edge" else 0.6
        error = max(error, rows * seen.dx / size)
        basis += "; rows in what starts to move"
    if job == "motion":
        waves, words = of_waves(seen, _wave_length(scene))
        basis += "; " + words
        error = max(error, waves or 0.0)
    if job == "fracture" or breaks(scene):
        trapped, words = of_cracks(seen.m)
        basis, error = f"{basis}; {words}", max(error, trapped)
    return error, basis


def _extent(region: Any, scene: Scene) -> float:
    """Shortest side of what a half-space or a box takes of a box (m); else 0."""
    if not isinstance(scene.body, Box) or not isinstance(region, Box | HalfSpace):
        return 0.0
    sides = np.subtract(scene.body.hi, scene.body.lo)
    if isinstance(region, HalfSpace):
        face = (scene.body.hi if region.sign > 0 else scene.body.lo)[region.axis]
        sides[region.axis] = min(sides[region.axis], region.sign * (face - region.at))
    else:
        low = np.maximum(region.lo, scene.body.lo)
        sides = np.minimum(region.hi, scene.body.hi) - low
    return float(sides.min())


def feature(scene: Scene, seen: Look) -> float:
    """The shortest side of a body, or of what a crack cuts or leaves (m)."""
    if not isinstance(scene.body, Box):
        return seen.least
    lengths = [hi - lo for lo, hi in zip(scene.body.lo, scene.body.hi, strict=True)]
    for crack in scene.cracks:
        for edge in crack.edges:
            length = float(np.linalg.norm(edge))
            axis = int(np.argmax(np.abs(edge)))
            side = scene.body.hi[axis] - scene.body.lo[axis]
            lengths += [x for x in (length, side - length) if x > 1e-9 * side]
    return min(lengths)


def _wave_length(scene: Scene) -> float | None:
    """Speed times the shortest rise of a history (m), of one elastic material."""
    many = scene.material
    material = many[0] if isinstance(many, list | tuple) else many
    E, rho = getattr(material, "E", None), getattr(material, "rho", None)
    tables = [c.time for c in (*scene.supports, *scene.loads)]
    rises = [
        float(gap)
        for t in tables
        for gap, step in zip(np.diff(t.times), np.diff(t.factors), strict=True)
        if step != 0 and np.isfinite(gap) and gap > 0
    ]
    if E is None or rho is None or not rises:
        return None
    speed = float(np.sqrt(np.max(np.asarray(E)) / np.min(np.asarray(rho))))
    return 2.0 * speed * min(rises)
