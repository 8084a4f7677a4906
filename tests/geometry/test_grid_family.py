"""Families of a lattice by offsets against families by index lists."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.discretize.surface import relative_volumes
from jaxpd.geometry import (
    find,
    find_on_grid,
    from_points,
    grid_loose_points,
    grid_pieces,
    lattice,
    loose_points,
    pieces,
    rectangle,
    segment,
    without,
)
from jaxpd.geometry.family import bulk_volume, neighbourhood_volumes, partial_volumes
from jaxpd.geometry.grid_family import offset_sums

SLANTED = segment((-0.25, -0.3), (0.1, 0.33))
CASES = {
    "bar": (((0.0,), (1.0,), 1 / 16), 3, "continuous", []),
    "plate": (
        ((-0.5, -0.5), (0.5, 0.5), 1 / 16),
        4,
        "linear",
        [segment((-0.15, 0.0), (0.15, 0.0)), SLANTED],
    ),
    "narrow": (((0.0, 0.0), (1.0, 0.5), 0.25), 3.2, "none", []),
    "block": (
        ((0.0,) * 3, (1.0,) * 3, 1 / 7),
        3.015,
        "linear",
        [rectangle((0.2, 0.2, 0.45), (0.5, 0.0, 0.0), (0.0, 0.5, 0.1))],
    ),
}


@pytest.fixture(params=CASES, ids=str)
def both(request):
    (lo, hi, dx), m, partial, cracks = CASES[request.param]
    cloud = lattice(lo, hi, dx)
    how = {"partial": partial, "cracks": cracks}
    return cloud, m * dx, find(cloud, m * dx, **how), find_on_grid(cloud, m * dx, **how)


def test_the_bonds_are_those_of_the_index_lists(both):
    cloud, _, family, grid = both
    i, j, slot = grid.ends()
    nbr = np.asarray(family.nbr)
    k, first = np.nonzero(nbr > np.arange(cloud.n))
    np.testing.assert_array_equal(
        np.sort(i.astype(int) * cloud.n + j), np.sort(first * cloud.n + nbr[k, first])
    )
    assert grid.n_bonds == family.n_bonds == len(i)
    X = np.asarray(cloud.X)
    np.testing.assert_allclose(
        X[j] - X[i], grid.steps[slot] * cloud.lattice.dx, atol=1e-14
    )


def test_volumes_are_those_of_the_index_lists_on_the_host_and_in_a_trace(both):
    cloud, delta, family, grid = both
    beta = partial_volumes(cloud.X, cloud.vol, family, delta)
    V = neighbourhood_volumes(cloud.vol, family, beta)
    want = V / bulk_volume(family, cloud.vol, delta, cloud.d)
    dx = cloud.lattice.dx
    host = relative_volumes(grid, np.float64(delta), np.float64(dx), "lattice")
    assert isinstance(host, np.ndarray)
    traced = jax.jit(relative_volumes, static_argnums=3)(grid, delta, dx, "lattice")
    for v in (host, traced):
        np.testing.assert_allclose(v, want, rtol=1e-14)
    analytic = relative_volumes(grid, np.float64(delta), np.float64(dx), "analytic")
    assert np.ptp(analytic / host) <= 1e-14 * analytic.max() / host.min()


def test_sums_over_offsets_are_differentiable(both):
    cloud, delta, _, grid = both
    dx = cloud.lattice.dx
    value = lambda delta: relative_volumes(grid, delta, dx, "analytic").sum()  # noqa: E731
    slope = jax.jit(jax.grad(value))(delta)
    assert np.isfinite(slope)
    ones = offset_sums(grid, jnp.ones(len(grid.offsets)))
    assert float(ones.sum()) == 2 * grid.n_bonds


def test_pieces_and_loose_points_are_those_of_the_index_lists(both):
    cloud, _, family, grid = both
    X, nbr = np.asarray(cloud.X), np.asarray(family.nbr)
    fixed = np.zeros(X.shape, bool)
    assert grid_pieces(grid).max() == pieces(nbr).max()
    np.testing.assert_array_equal(
        grid_loose_points(grid, fixed), loose_points(X, nbr, fixed)
    )


def test_bonds_that_break_leave_the_family_once():
    grid = find_on_grid(lattice((0.0, 0.0), (1.0, 1.0), 0.125), 0.25)
    broken = np.array([[3, 3, 5], [0, 0, 2]])
    less = without(without(grid, broken), broken)
    assert less.n_bonds == grid.n_bonds - 2
    corner = np.flatnonzero(
        (np.asarray(grid.ends()[0]) == 0) | (np.asarray(grid.ends()[1]) == 0)
    )
    i, _, slot = (a[corner] for a in grid.ends())
    alone = without(grid, np.stack([i, slot]))
    assert grid_pieces(alone).max() == 1
    assert 0 in grid_loose_points(alone, np.zeros((grid.n, 2), bool))


def test_what_is_no_lattice_or_has_no_bonds_is_refused():
    points = from_points(np.eye(2), 1.0)
    with pytest.raises(ValueError, match="cloud: not a lattice"):
        find_on_grid(points, 1.0)
    cloud = lattice((0.0, 0.0), (1.0, 1.0), 0.25)
    with pytest.raises(ValueError, match="delta: no point has a bond"):
        find_on_grid(cloud, 0.1)
    with pytest.raises(ValueError, match="partial: 'some' must be one of"):
        find_on_grid(cloud, 0.5, partial="some")
    with pytest.raises(ValueError, match=r"cracks: .* is in 3-D"):
        find_on_grid(cloud, 0.5, cracks=[rectangle((0.0,) * 3, (1, 0, 0), (0, 1, 0))])
    grid = find_on_grid(cloud, 0.5)
    with pytest.raises(ValueError, match="V0: 'magic' must be"):
        relative_volumes(grid, np.float64(0.5), np.float64(0.25), "magic")
