"""Sums over the bonds of a lattice's bulk, and what they calibrate."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpd
from jaxpd.discretize.bulk import energy_ratio, toughness_ratio
from jaxpd.physics import Fractional


@pytest.mark.parametrize(
    ("m", "energy", "toughness"),
    [(3, 0.869, 0.947), (4, 0.880, 0.951), (5, 0.935, 0.982), (6, 0.930, 0.978)],
)
def test_lattice_sums_of_plane_stress(m, energy, toughness):
    """Measured by an independent prototype with the same shares, to its digits."""
    omega, sizes = Fractional(-1.0, 2), (m * 0.1, 0.1, "linear")
    found = energy_ratio(1 / 3, "plane stress", omega, 2, sizes)
    assert found == pytest.approx(energy, abs=6e-4)
    assert toughness_ratio(omega, 2, sizes) / found == pytest.approx(
        toughness, abs=6e-4
    )


@pytest.mark.parametrize(
    ("d", "nu", "state"),
    [(1, None, "bar"), (2, 1 / 3, "plane stress"), (3, 0.25, "solid")],
)
def test_sums_tend_to_the_integrals(d, nu, state):
    """As m grows at any dimension; alpha = 0 and the PMB material."""
    m = {1: 200, 2: 60, 3: 16}[d]
    for alpha in (0.0, 1.0 - d):
        omega, sizes = Fractional(alpha, d), (1.0, 1.0 / m, "continuous")
        assert energy_ratio(nu, state, omega, d, sizes) == pytest.approx(1.0, abs=0.03)
        assert toughness_ratio(omega, d, sizes) == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("d", "nu", "state"), [(2, 1 / 3, "plane stress"), (3, 0.25, "solid")]
)
def test_calibration_gives_the_bulk_its_classical_energy(d, nu, state):
    """An equal strain, the energy of a point whose neighbourhood is whole."""
    n, m = {2: 9, 3: 7}[d], {2: 4, 3: 3}[d]
    resolution = jaxpd.Bonds(
        dx=1.0,
        m=m,
        kernel=jaxpd.fractional(0.5),
        correction="none",
        calibration="lattice",
    )
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0,) * d, (float(n - 1),) * d),
        material=jaxpd.Elastic(2.0, nu, state),
        supports=[jaxpd.holds(jaxpd.below(x=0.0))],
        resolution=dataclasses.replace(resolution, layers=((0, 0),) * d),
        kinematics="small",
    )
    problem = jaxpd.prepare(scene, operator="gather")
    strain = 1e-3
    W = problem.energy(strain * np.asarray(problem.X)) / problem.vol
    middle = np.ravel_multi_index((n // 2,) * d, (n,) * d)
    exact = {2: 2.0 / (1 - nu), 3: 1.5 * 2.0 / (1 - 2 * nu)}[d] * strain**2
    assert float(W[middle]) == pytest.approx(exact, rel=2e-3)


def test_calibration_leaves_the_critical_stretch_alone():
    """In motion too: the strength is that of the continuum's micromodulus."""
    found = []
    for calibration in ("continuum", "lattice"):
        scene = jaxpd.gallery.branching_plate(m=3, delta=3e-3)
        bonds = dataclasses.replace(scene.resolution, calibration=calibration)
        motion = jaxpd.prepare_motion(dataclasses.replace(scene, resolution=bonds))
        op, _ = jax.jit(lambda m: m.build(m.params))(motion)
        factor = motion.problem.spec.stiffening
        found.append((float(op.s_crit), float(op.stiff[0]), factor))
    (s0, k0, _), (s1, k1, factor) = found
    assert s1 == pytest.approx(s0, rel=1e-12)
    assert abs(factor - 1.0) > 0.01
    assert k1 == pytest.approx(factor * k0, rel=1e-12)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"calibration": "exact"}, "calibration: 'exact'"),
        ({"correction": "energy"}, "both scale the interior"),
        ({"correction": "analytic"}, "both scale the interior"),
    ],
)
def test_calibrations_that_mean_nothing_are_refused(changes, words):
    def prepared():
        bonds = {"dx": 0.25, "m": 2, "calibration": "lattice"} | changes
        scene = jaxpd.Scene(
            body=jaxpd.box((0.0, 0.0), (2.0, 2.0)),
            material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
            supports=[jaxpd.holds(jaxpd.below(y=0.0))],
            resolution=jaxpd.Bonds(**bonds),
        )
        return jaxpd.prepare(scene)

    with pytest.raises(ValueError, match=words):
        prepared()
