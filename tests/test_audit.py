import dataclasses

import numpy as np
import pytest

import jaxpd
from tests.discretize.test_surface import strip


@pytest.fixture(scope="module")
def found():
    return jaxpd.audit(strip("none", 11, 11, 2), ["none", "energy", "fictitious"])


def test_the_bulk_has_the_constants_of_the_lattice_sum(found):
    """By hand, m = 2, linear shares 1, 1, 1/2 of lengths 1, sqrt 2, 2, omega = r^-2.

    The sums of share n_1^4 and of share n_1^2 n_2^2 over the 12 bonds.
    """
    place = found.places("none")
    C11 = 2 * 1.0 + 4 * 0.25 + 2 * 0.5
    C12 = 4 * 0.25
    c = 4.0 / (1 - 1 / 3) / (np.pi * 2.0**2)  # 4 k' (2 - alpha) / (pi delta^2) / 2
    E = 0.5 * c * (C11 - C12**2 / C11)
    np.testing.assert_allclose(place["E"]["bulk"], E, rtol=1e-6)
    np.testing.assert_allclose(place["nu"]["bulk"], 3 * C12 / C11, rtol=1e-6)
    np.testing.assert_allclose(place["G"]["bulk"], 0.5 * c * C12 * 8 / 3, rtol=1e-6)


def test_surfaces_are_soft_and_fictitious_points_cure_it(found):
    E = found.places("none")["E"]
    assert E["across"] < E["along"] < E["bulk"]
    assert found.places("energy")["E"]["rim min"] > E["rim min"]
    cured = found.places("fictitious")["E"]
    np.testing.assert_allclose(list(cured.values()), cured["bulk"], rtol=1e-9)
    lines = str(found).splitlines()
    assert len(lines) == 1 + 3 * 3
    assert lines[0].split() == ["bulk", "along", "across", "rim", "min", "rim", "max"]


def test_what_a_scene_cannot_have_is_listed_or_refused():
    scene = strip("none", 9, 9, 2)
    points = jaxpd.from_points(scene.body.lo + np.random.default_rng(0).uniform(
        size=(60, 2)) * 0.16, 0.16**2 / 60)  # fmt: skip
    resolution = jaxpd.Bonds(delta=0.06)
    cloud = dataclasses.replace(
        scene, body=points, resolution=resolution,
        supports=[jaxpd.holds(jaxpd.below(x=-0.04))],
    )  # fmt: skip
    with pytest.raises(ValueError, match="'fictitious' needs a lattice"):
        jaxpd.audit(cloud, ["fictitious"])
    law = jaxpd.physics.pmb(1.0, 1 / 3, "plane stress", 2, 0.1)
    with pytest.raises(ValueError, match=r"material: .* must be Elastic with one"):
        jaxpd.audit(dataclasses.replace(scene, material=law))
    with pytest.raises(ValueError, match="corrections: give at least one"):
        jaxpd.audit(scene, [])
