"""Finite-element peer of the plastic bodies, built on scikit-fem.

Small-strain J2 plasticity with linear isotropic and kinematic hardening, or none, in
plane strain or plane stress, by backward Euler over the load steps.  Nothing is
imported from jaxpd.  The law at a point is in `_plastic_law`, the plane solver in
`_plastic_fe`, its meshes in `_plastic_meshes`, and the cylinder along its radius in
`_plastic_radial`.  Needs numpy, scipy and scikit-fem.  Example::

    mesh = quarter_hole(12, 24)
    steel = Material(E=2.1e5, nu=0.3, sigma_y=240.0, h_iso=2e3)
    fixed = [("left", 0, 0.0), ("bottom", 1, 0.0), ("top", 1, 0.003)]
    run = solve(mesh, steel, fixed, [], [0.25, 0.5, 1.0, 0.0], plane="stress")
    run.reaction("top")[:, 1]                   # force per thickness, each step
    run.displacement([[0.3, 0.0]], step=2)      # [[u_x, u_y]]
    run.points, run.stress[2], run.peeq[2]      # at the Gauss points

    wall = radial_cylinder(steel, [60.0, 120.0, 180.0])
    wall.displacement(1.0), wall.stresses([1.2, 1.8]), wall.front

Set ``OMP_NUM_THREADS=1`` in the environment for single-threaded timings.  Run as a
script, ``python benchmarks/_plastic_peer.py``, it prints checks against exact
solutions and under refinement, in under a minute.
"""

from __future__ import annotations

import time

import numpy as np
from _plastic_fe import Solution, solve
from _plastic_law import FloatArray, Material, State, mises, plane_map, return_map
from _plastic_meshes import cook, mapped, quarter_annulus, quarter_hole, rectangle
from _plastic_radial import (
    Cylinder,
    front_pressure,
    hill_pressure,
    radial_cylinder,
)

__all__ = [
    "STEEL",
    "Cylinder",
    "Material",
    "Solution",
    "State",
    "cook",
    "front_pressure",
    "hill_pressure",
    "mapped",
    "mises",
    "plane_map",
    "quarter_annulus",
    "quarter_hole",
    "radial_cylinder",
    "rectangle",
    "return_map",
    "solve",
    "uniaxial",
]

STEEL = Material(E=2.1e5, nu=0.3, sigma_y=240.0)
"""Perfectly plastic steel of the cylinder and of the plate, MPa."""


def uniaxial(material: Material, strains: FloatArray) -> FloatArray:
    """Axial stress along a history of axial strains, by the exact bar."""
    E, plastic, peeq, out = material.E, 0.0, 0.0, []
    total = E + material.h_iso + material.h_kin
    for strain in strains:
        over = E * (strain - plastic) - material.h_kin * plastic
        flow = max(abs(over) - material.sigma_y - material.h_iso * peeq, 0.0) / total
        plastic += flow * np.sign(over)
        peeq += flow
        out.append(E * (strain - plastic))
    return np.array(out)


def check_uniaxial() -> None:
    """One element pulled, pushed and pulled again, hardening both ways."""
    steel = Material(2.1e5, 0.3, 240.0, h_iso=3e3, h_kin=5e3)
    fixed = [("left", 0, 0.0), ("bottom", 1, 0.0), ("top", 1, 0.01)]
    factors = np.array([0.1, 0.5, 1.0, 0.6, -1.0, 0.2, 1.5])
    exact = uniaxial(steel, 0.01 * factors)
    run = solve(rectangle(1, 1), steel, fixed, [], factors, plane="stress")
    error = np.abs(run.stress[:, :, 1] - exact[:, None]).max() / steel.sigma_y
    print(f"bar, one element, cyclic      stress error / sigma_y {error:.1e}")

    # A skewed patch under a linear displacement equals a point under its strain.
    def linear(row: int):
        table = np.array([[1.0, 0.3], [0.5, -0.8]])
        return lambda x: table[row] @ x

    held = [
        (side, row, linear(row))
        for side in ("left", "right", "bottom", "top")
        for row in (0, 1)
    ]
    for plane in ("strain", "stress"):
        run = solve(cook(2, 2), steel, held, [], [2e-3, 5e-3, -1e-3], plane=plane)
        state, stress = State.virgin(1), np.zeros((1, 4))
        for factor in run.factors:
            strain = factor * np.array([[1.0, -0.8, 0.8]])
            stress, state, _ = plane_map(steel, strain, state, plane)
        error = np.abs(run.stress[-1] - stress).max() / steel.sigma_y
        print(f"patch, skewed, plane {plane}    stress error / sigma_y {error:.1e}")


def check_radial() -> None:
    """The cylinder on its radius against Lame and Hill."""
    r = np.linspace(1.0, 2.0, 38)
    elastic = Material(2.1e5, 0.3)
    exact = 1.3 / 2.1e5 * 100.0 / 3.0 * (0.4 * r + 4.0 / r)
    wall = radial_cylinder(elastic, [100.0])
    error = np.abs(wall.displacement(r) / exact - 1.0).max()
    off = np.abs(wall.stresses(r)[:, 1] / (100.0 / 3.0 * (1.0 + 4.0 / r**2)) - 1.0)
    print(
        f"radius, elastic, Lame         u error {error:.1e}"
        f"  hoop stress error {off.max():.1e}"
    )
    for nu in (0.49, 0.499, 0.4999):
        steel = Material(2.1e5, nu, 240.0)
        p = hill_pressure(steel, 1.5)
        wall = radial_cylinder(steel, np.linspace(0.1, 1.0, 10) * p)
        inner = wall.stresses(1.0)
        hoop = 2.0 * 240.0 / np.sqrt(3.0) - p
        print(
            f"radius, nu = {nu:<6}, Hill     front - 1.5"
            f" {wall.front[-1] - 1.5:+.1e}"
            f"  hoop stress at a / exact - 1 {inner[1] / hoop - 1:+.1e}"
        )
    fine = radial_cylinder(STEEL, np.linspace(17.2, 172.0, 10), n=8000)
    for n in (500, 1000, 2000, 4000):
        wall = radial_cylinder(STEEL, np.linspace(17.2, 172.0, 10), n=n)
        error = np.abs(wall.displacement(r) / fine.displacement(r) - 1.0).max()
        print(f"radius, nu = 0.3, n = {n:<4}    u against n = 8000 {error:.1e}")
    for steps in (1, 10, 40):
        p = front_pressure(STEEL, 1.5, steps=steps)
        print(f"radius, front 1.5, nu = 0.3   {steps:3d} steps: p = {p:.6f}")


def check_annulus() -> None:
    """The quarter ring against the cylinder on its radius, loaded and unloaded."""
    steel, factors = Material(2.1e5, 0.3, 240.0, 2e3, 2e3), [0.5, 0.75, 1.0, 0.0]
    for law, name in ((STEEL, "perfect"), (steel, "hardening")):
        p = 172.3
        wall = radial_cylinder(law, p * np.array(factors), n=4000)
        for n in (4, 8, 16, 32):
            start = time.perf_counter()
            fixed = [("bottom", 1, 0.0), ("left", 0, 0.0)]
            run = solve(quarter_annulus(n, n), law, fixed, [("inner", p)], factors)
            seconds = time.perf_counter() - start
            radius, angle = np.meshgrid([1.0, 1.3, 1.6, 2.0], np.linspace(0, 1.57, 7))
            points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1)
            r = radius.ravel()
            parts = []
            for step in (2, 3):
                u = run.displacement(points.reshape(-1, 2), step)
                radial = (u * points.reshape(-1, 2)).sum(axis=1) / r
                exact = wall.displacement(r, step)
                parts.append(np.abs(radial - exact).max() / np.abs(exact).max())
            mean = wall.stresses(np.hypot(*run.points.T), 2)
            off = run.stress[2, :, :2].sum(axis=1) - mean[:, :2].sum(axis=1)
            print(
                f"ring, {name:9s}, {n:2d} x {n:<2d}     u error {parts[0]:.1e},"
                f" unloaded {parts[1]:.1e}  xx + yy error / sigma_y"
                f" {np.abs(off).max() / law.sigma_y:.1e}  {seconds:.2f} s"
            )


def check_hole() -> None:
    """Limit load of the plate with a hole in plane stress: the net section's."""
    fixed = [("bottom", 1, 0.0), ("left", 0, 0.0), ("top", 1, 0.003)]
    for n in (4, 8, 12):
        start = time.perf_counter()
        factors = [0.2, 0.4, 0.7, 1.0, 2.0, 4.0]
        mesh = quarter_hole(n, 2 * n)
        run = solve(mesh, STEEL, fixed, [], factors, plane="stress")
        force = run.reaction("top")[:, 1] / 240.0
        net = run.reaction("bottom")[:, 1] / 240.0
        print(
            f"hole, {n:2d} x {2 * n:<2d}, plane stress  limit / (b sigma_y)"
            f" {force[-2]:.5f}, {force[-1]:.5f} (exact 0.7)"
            f"  balance {abs(force + net).max():.0e}"
            f"  {time.perf_counter() - start:.2f} s"
        )


def check_cook() -> None:
    """Cook's panel: elastic (23.96 known) and hardening, under refinement."""
    panel = Material(70.0, 1.0 / 3.0, 0.243, h_iso=0.135, h_kin=0.015)
    held = [("left", 0, 0.0), ("left", 1, 0.0)]
    for n in (4, 8, 16, 24):
        load = [("right", (0.0, 1.0 / 16.0))]
        soft = Material(1.0, 1.0 / 3.0)
        run = solve(cook(n, n), soft, held, load, [1.0], plane="stress")
        tips = [run.displacement([[48.0, 52.0]])[0, 1]]
        start = time.perf_counter()
        for plane in ("stress", "strain"):
            factors = np.array([0.6, 1.2, 1.8, 0.0])
            run = solve(cook(n, n), panel, held, load, factors, plane=plane)
            tips += [run.displacement([[48.0, 60.0]], i)[0, 1] for i in (2, 3)]
        print(
            f"Cook, {n:2d} x {n:<2d}  elastic {tips[0]:.4f}  F = 1.8, then 0:"
            f" plane stress {tips[1]:.5f}, {tips[2]:.5f}"
            f"  plane strain {tips[3]:.5f}, {tips[4]:.5f}"
            f"  {time.perf_counter() - start:.2f} s"
        )


def main() -> None:
    """Print the checks."""
    start = time.perf_counter()
    check_uniaxial()
    check_radial()
    check_annulus()
    check_hole()
    check_cook()
    print(f"all: {time.perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
