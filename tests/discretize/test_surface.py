import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize import volume_correction
from jaxpd.geometry import find, lattice, segment
from jaxpd.geometry.family import neighbourhood_volumes, partial_volumes
from jaxpd.operators import bond_weights

DELTA = jnp.asarray(0.375)


@pytest.fixture
def plate():
    cloud = lattice((-1.0, -1.0), (1.0, 1.0), 0.125)
    return cloud, find(cloud, 0.375, partial="linear")


def factors(cloud, family, V0):
    beta = partial_volumes(cloud.X, cloud.vol, family, DELTA)
    G = volume_correction(cloud.X, cloud.vol, family, beta, DELTA, V0)
    return np.where(np.asarray(family.present), np.asarray(G), np.nan), beta


def test_the_lattice_convention_leaves_the_interior_as_it_is(plate):
    cloud, family = plate
    G, _ = factors(cloud, family, "lattice")
    inner = np.abs(np.asarray(cloud.X)).max(axis=1) <= 1 - 2 * 0.375
    np.testing.assert_allclose(G[:, inner], 1.0, rtol=1e-14)
    corner = np.argmin(np.asarray(cloud.X).sum(axis=1))
    assert np.nanmin(G[:, corner]) > 1.4  # a corner has about a quarter of a family
    assert np.nanmin(G) >= 1 - 1e-14


def test_the_analytic_convention_also_scales_the_interior():
    """Paper 002 at m = 4: V0 = pi delta^2 makes the interior stiffer by 8.9 %."""
    cloud = lattice((-1.0, -1.0), (1.0, 1.0), 0.125)
    delta = jnp.asarray(0.5)
    family = find(cloud, 0.5, partial="linear")
    beta = partial_volumes(cloud.X, cloud.vol, family, delta)
    G = volume_correction(cloud.X, cloud.vol, family, beta, delta, "analytic")
    middle = np.argmin(np.abs(np.asarray(cloud.X)).sum(axis=1))
    near = np.asarray(G)[np.asarray(family.present)[:, middle], middle]
    np.testing.assert_allclose(near, 1.08904, rtol=1e-5)


def test_a_crack_counts_as_a_surface():
    cloud = lattice((-1.0, -1.0), (1.0, 1.0), 0.125)
    crack = segment((-0.5, 0.0), (0.5, 0.0))
    family = find(cloud, 0.375, partial="linear", cracks=[crack])
    G, beta = factors(cloud, family, "lattice")
    V = np.asarray(neighbourhood_volumes(cloud.vol, family, beta))
    X = np.asarray(cloud.X)
    face = np.argmin(np.linalg.norm(X - [0.0, 0.125], axis=1))
    middle = np.argmin(np.linalg.norm(X - [0.0, 0.5], axis=1))
    assert V[face] < 0.7 * V[middle]
    assert np.nanmin(G[:, face]) > 1.05


def test_an_unknown_convention_is_refused(plate):
    cloud, family = plate
    with pytest.raises(ValueError, match="V0: 'exact' must be 'lattice' or 'analytic'"):
        bond_weights(cloud.X, cloud.vol, family, DELTA, "exact")
