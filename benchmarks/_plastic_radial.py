"""Thick-walled cylinder of J2 material in plane strain, along its radius.

Quadratic elements with two Gauss points over the radius, the hoop strain being
``u / r``; backward Euler over the given pressures, on the inner wall alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from _plastic_law import FloatArray, Material, State, return_map
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.linalg import solve_banded
from scipy.optimize import brentq


@dataclass(frozen=True)
class Cylinder:
    """History of a cylinder, one entry of the first axes for each pressure.

    Attributes:
        pressures: Inner pressures, shape ``[nstep]``.
        front: Radius out to which the wall has yielded so far, ``[nstep]``; the
            inner radius where it has not yielded.  Found from ``u(b)``: beyond
            the front the stresses are Lame's.
        nodes: Radii of the nodes, ascending, ``[nnode]``.
        u: Radial displacement of the nodes, ``[nstep, nnode]``.
        points: Radii of the Gauss points, ascending, ``[npoint]``.
        stress: Components ``rr, tt, zz, 0`` there, ``[nstep, npoint, 4]``.
        peeq: Equivalent plastic strain there, ``[nstep, npoint]``.
    """

    pressures: FloatArray
    front: FloatArray
    nodes: FloatArray = field(repr=False)
    u: FloatArray = field(repr=False)
    points: FloatArray = field(repr=False)
    stress: FloatArray = field(repr=False)
    peeq: FloatArray = field(repr=False)

    def displacement(self, r: ArrayLike, step: int = -1) -> FloatArray:
        """Radial displacement at radii ``r``, by the elements' own parabolas."""
        r, u = np.asarray(r, dtype=float), self.u[step]
        e = np.searchsorted(self.nodes[2:-1:2], r)
        first, last = self.nodes[2 * e], self.nodes[2 * e + 2]
        xi = (2.0 * r - first - last) / (last - first)
        left, middle, right = u[2 * e], u[2 * e + 1], u[2 * e + 2]
        bend = 0.5 * (left + right) - middle
        return middle + 0.5 * (right - left) * xi + bend * xi**2

    def stresses(self, r: ArrayLike, step: int = -1) -> FloatArray:
        """Stresses ``rr, tt, zz`` at radii ``r``, shape ``[..., 3]``."""
        through = PchipInterpolator(self.points, self.stress[step, :, :3])
        return np.asarray(through(np.asarray(r, dtype=float)))


def radial_cylinder(
    material: Material,
    pressures: ArrayLike,
    *,
    a: float = 1.0,
    b: float = 2.0,
    n: int = 4000,
    tolerance: float = 1e-12,
) -> Cylinder:
    """Take a thick-walled cylinder through a history of inner pressures.

    Args:
        material: The material.
        pressures: Inner pressures, one backward Euler step each, in any order.
        a: Inner radius.
        b: Outer radius.
        n: Elements over the wall, of equal length; 4000 keep ``u`` to about 1e-8.
        tolerance: Largest residual force over ``max |pressure| a``, or round-off if
            that is larger.

    Raises:
        RuntimeError: If a step does not converge, above the limit load say.
    """
    p = np.asarray(pressures, dtype=float)
    nodes = np.linspace(a, b, 2 * n + 1)
    h = (b - a) / n
    xi = np.array([-1.0, 1.0]) / np.sqrt(3.0)
    shape = np.stack([0.5 * xi * (xi - 1), 1 - xi**2, 0.5 * xi * (xi + 1)], axis=-1)
    slope = np.stack([xi - 0.5, -2.0 * xi, xi + 0.5], axis=-1) * 2.0 / h
    r = nodes[1:-1:2, None] + 0.5 * h * xi  # [n, 2]
    weight = 0.5 * h * r
    gradient = np.empty((n, 2, 2, 3))  # element, point, component, node
    gradient[:, :, 0] = slope
    gradient[:, :, 1] = shape / r[:, :, None]
    index = 2 * np.arange(n)[:, None] + np.arange(3)
    rows = np.repeat(index, 3, axis=1).ravel()
    columns = np.tile(index, (1, 3)).ravel()
    place = (2 + rows - columns) * nodes.size + columns

    def assemble(u: FloatArray, state: State):
        strain = np.zeros((n, 2, 4))
        strain[:, :, :2] = np.einsum("eqci,ei->eqc", gradient, u[index])
        stress, new, tangent = return_map(material, strain.reshape(-1, 4), state)
        flux = stress[:, :2].reshape(n, 2, 2) * weight[:, :, None]
        force = np.einsum("eqci,eqc->ei", gradient, flux)
        force = np.bincount(index.ravel(), force.ravel(), nodes.size)
        stiff = tangent[:, :2, :2].reshape(n, 2, 2, 2) * weight[:, :, None, None]
        local = (np.swapaxes(gradient, 2, 3) @ stiff @ gradient).sum(axis=1)
        band = np.bincount(place, local.ravel(), 5 * nodes.size)
        return force, band.reshape(5, -1), stress, new

    u, state = np.zeros(nodes.size), State.virgin(2 * n)
    history, load = [], np.zeros(nodes.size)
    scale = max(np.abs(p).max(), np.finfo(float).tiny) * a
    for step, pressure in enumerate(p):
        load[0] = pressure * a
        quiet = False
        for _ in range(60):
            force, band, stress, new = assemble(u, state)
            noise = 4.0 * np.finfo(float).eps * band[2].max() * np.abs(u).max()
            error = np.abs(load - force).max()
            if error <= tolerance * scale or (error <= noise and quiet):
                break
            quiet = error <= noise  # once at round-off, one last iteration
            u = u + solve_banded((2, 2), band, load - force)
        else:
            raise RuntimeError(f"step {step}, pressure {pressure}: no convergence")
        state = new
        history.append((u, stress, state.peeq))
    u_all, stresses, peeq = (np.stack(part) for part in zip(*history, strict=True))
    tip = material.E * b * np.abs(u_all[:, -1]) / (2.0 * (1.0 - material.nu**2))
    front = _front(material, tip, a, b)
    return Cylinder(p, front, nodes, u_all, r.ravel(), stresses, peeq)


def _front(material: Material, tip: FloatArray, a: float, b: float) -> FloatArray:
    """Where Lame's stresses ``A -+ B / r^2``, free at ``b``, reach the yield stress."""
    mean = (1.0 - 2.0 * material.nu) * tip / b**2
    room = np.maximum(material.sigma_y**2 - mean**2, 1e-300)
    front = np.clip((3.0 * tip**2 / room) ** 0.25, a, b)
    return np.maximum.accumulate(front)


def hill_pressure(
    material: Material, c: float, *, a: float = 1.0, b: float = 2.0
) -> float:
    """Hill's pressure for a front at ``c``: perfectly plastic, incompressible."""
    k = material.sigma_y / np.sqrt(3.0)
    return float(2.0 * k * np.log(c / a) + k * (1.0 - (c / b) ** 2))


def front_pressure(
    material: Material,
    c: float = 1.5,
    *,
    a: float = 1.0,
    b: float = 2.0,
    steps: int = 10,
    n: int = 500,
) -> float:
    """Pressure that takes the front of yielding to radius ``c``.

    Args:
        material: The material.
        c: Radius of the front, between ``a`` and ``b``.
        a: Inner radius.
        b: Outer radius.
        steps: Equal steps of pressure on the way.  The answer depends on them: the
            axial stress does not grow in proportion.
        n: Elements over the wall.
    """
    guess = hill_pressure(material, c, a=a, b=b)

    def excess(p: float) -> float:
        path = p * np.arange(1, steps + 1) / steps
        return float(radial_cylinder(material, path, a=a, b=b, n=n).front[-1]) - c

    return float(brentq(excess, 0.97 * guess, 1.01 * guess, xtol=1e-11 * guess))  # pyright: ignore
