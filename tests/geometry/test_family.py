import itertools

import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.geometry import find, from_points, lattice, rectangle, segment
from jaxpd.geometry.family import (
    ball_volume,
    bond_vectors,
    bulk_volume,
    neighbourhood_volumes,
    partial_volumes,
)


def bonds(family):
    """The bonds as a set of pairs, both directions."""
    nbr = np.asarray(family.nbr)
    slot, i = np.nonzero(nbr != np.arange(nbr.shape[1]))
    return set(zip(i.tolist(), nbr[slot, i].tolist(), strict=True))


def test_a_square_ball_of_lattice_points_is_counted_right():
    """Lattice points in a disc: 28, 196 and 796 others at m = 3, 8, 16."""
    for m, count in [(1, 4), (2, 12), (3, 28), (8, 196), (16, 796)]:
        cloud = lattice((0, 0), (2 * m, 2 * m), 1.0)
        family = find(cloud, float(m))
        middle = (2 * m + 1) * m + m
        assert (np.asarray(family.nbr)[:, middle] != middle).sum() == count
        assert family.bulk.shape == (count,)


@pytest.mark.parametrize("partial", ["none", "linear", "continuous"])
@pytest.mark.parametrize("d", [1, 2, 3])
def test_lattice_and_tree_find_the_same_bonds(d, partial):
    # 0.1 is no binary fraction: round-off must not decide who is in a horizon of 0.3
    cloud = lattice([0.0] * d, [1.0] * d, 0.1)
    points = from_points(cloud.X, cloud.vol)
    a, b = (find(c, 0.3, partial=partial) for c in (cloud, points))
    assert bonds(a) == bonds(b)
    assert a.n_bonds == len(bonds(a)) / 2
    share_a, share_b = (
        np.asarray(partial_volumes(c.X, c.vol, f, jnp.asarray(0.3))).sum(axis=0)
        for c, f in ((cloud, a), (points, b))
    )
    np.testing.assert_allclose(share_a, share_b, rtol=1e-12)


@pytest.mark.parametrize("m", [2.0, 3.0, 3.015, 4.5])
def test_a_horizon_finds_what_brute_force_finds(rng, m):
    X = rng.uniform(size=(150, 2))
    delta = m / 12
    family = find(from_points(X, 1 / 150), delta)
    want = {
        (i, j)
        for i, j in itertools.permutations(range(150), 2)
        if np.linalg.norm(X[i] - X[j]) <= delta
    }
    assert bonds(family) == want


def test_padded_bonds_are_harmless():
    cloud = lattice((0, 0), (1, 1), 0.25)
    family = find(cloud, 0.5)
    beta = np.asarray(partial_volumes(cloud.X, cloud.vol, family, jnp.asarray(0.5)))
    padded = ~np.asarray(family.present)
    assert padded.any()
    np.testing.assert_array_equal(beta[padded], 0.0)
    for nbr, pad in zip(family.nbr, padded, strict=True):
        xi = np.asarray(bond_vectors(cloud.X, nbr, jnp.asarray(0.5)))
        np.testing.assert_array_equal(xi[pad], np.tile([0.5, 0.0], (pad.sum(), 1)))
        assert np.linalg.norm(xi, axis=1).min() >= 0.25


def test_linear_partial_volumes_halve_a_neighbour_on_the_horizon():
    cloud = lattice((-4.0,), (4.0,), 1.0)
    family = find(cloud, 3.0, partial="linear")
    beta = partial_volumes(cloud.X, cloud.vol, family, jnp.asarray(3.0))
    nbr = np.asarray(family.nbr)[:, 4]
    share = dict(zip((nbr - 4).tolist(), np.asarray(beta)[:, 4].tolist(), strict=True))
    assert share == {-3: 0.5, -2: 1.0, -1: 1.0, 1: 1.0, 2: 1.0, 3: 0.5}


def test_the_continuous_rule_is_continuous_where_a_neighbour_enters():
    """V of the middle point against delta: no jump, unlike the two other rules."""
    cloud = lattice((-6.0, -6.0), (6.0, 6.0), 1.0)
    deltas = np.arange(2.3, 4.0, 0.01)
    jump = {}
    for rule in ("none", "linear", "continuous"):
        V = []
        for delta in deltas:
            family = find(cloud, delta, partial=rule)
            delta = jnp.asarray(delta)
            V.append(float(bulk_volume(family, cloud.vol, delta, 2)))
        jump[rule] = np.abs(np.diff(V)).max()
    # measured 8, 4.1 and 0.32, the last a slope of 32 times the step of 0.01
    assert jump["none"] > 3
    assert jump["linear"] > 1.5
    assert jump["continuous"] < 0.4


@pytest.mark.parametrize("d", [1, 2, 3])
def test_neighbourhood_volumes_approach_the_ball(d):
    m = {1: 40, 2: 20, 3: 7}[d]
    cloud = lattice([-1.0] * d, [1.0] * d, 1.0 / m)
    family = find(cloud, 1.0, partial="continuous")
    delta = jnp.asarray(1.0)
    beta = partial_volumes(cloud.X, cloud.vol, family, delta)
    V = np.asarray(neighbourhood_volumes(cloud.vol, family, beta))
    whole = float(ball_volume(delta, d))
    bulk = float(bulk_volume(family, cloud.vol, delta, d))
    np.testing.assert_allclose(V.max(), bulk, rtol=1e-12)  # the middle point
    np.testing.assert_allclose(bulk, whole, rtol=0.02)
    # a corner: one of 2^d parts, and the halves of cells that stick out of the body
    assert whole / 2**d < V.min() < 1.4 * whole / 2**d


def test_bulk_volume_needs_a_lattice(rng):
    cloud = from_points(rng.uniform(size=(50, 2)), 0.02)
    family = find(cloud, 0.5)
    with pytest.raises(ValueError, match=r"V0: 'lattice' needs a cloud made by"):
        bulk_volume(family, cloud.vol, jnp.asarray(0.5), 2)


def test_a_crack_along_a_row_leaves_the_row_below():
    cloud = lattice((-1, -1), (1, 1), 0.25)
    X = np.asarray(cloud.X)
    whole = bonds(find(cloud, 0.5))
    open_ = bonds(find(cloud, 0.5, cracks=[segment((-2, 0), (2, 0))]))
    cut = whole - open_
    upper = X[:, 1] > 0
    assert cut == {(i, j) for i, j in whole if upper[i] != upper[j]}
    # nodes on the crack keep their bonds downwards and along it, and lose those upwards
    assert open_ == {(i, j) for i, j in whole if upper[i] == upper[j]}


def test_a_short_crack_cuts_what_crosses_it_tips_included():
    X = np.array([[0.0, -0.1], [0.0, 0.1], [0.3, -0.1], [0.3, 0.1], [0.2, 0.3]])
    cloud = from_points(X, 1.0)
    family = find(cloud, 1.0, cracks=[segment((-0.15, 0.0), (0.15, 0.0))])
    # 2-1 crosses the crack line at x = 0.15, the very tip; 0-4 at 0.05; 2-3 at 0.3
    cut = {(0, 1), (0, 3), (2, 1), (0, 4)}
    every = set(itertools.permutations(range(5), 2))
    assert bonds(family) == every - cut - {(j, i) for i, j in cut}


def test_a_slanted_crack_cuts_the_same_bonds_as_a_turned_body(rng):
    X = rng.uniform(-1, 1, size=(200, 2))
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    flat = find(from_points(X, 0.01), 0.5, cracks=[segment((-0.4, 0.1), (0.5, 0.1))])
    tips = np.array([[-0.4, 0.1], [0.5, 0.1]]) @ turn.T
    slanted = find(from_points(X @ turn.T, 0.01), 0.5, cracks=[segment(*tips)])
    assert bonds(flat) == bonds(slanted)
    assert flat.n_bonds < find(from_points(X, 0.01), 0.5).n_bonds


def test_a_rectangle_in_3d_cuts_inside_alone():
    cloud = lattice((-1, -1, -1), (1, 1, 1), 0.5)
    X = np.asarray(cloud.X)
    crack = rectangle((-2, -2, 0.1), (4, 0, 0), (0, 2.1, 0))  # y <= 0.1 only
    cut = bonds(find(cloud, 0.5)) - bonds(find(cloud, 0.5, cracks=[crack]))
    upper = X[:, 2] > 0.1
    want = {
        (i, j) for i, j in bonds(find(cloud, 0.5)) if upper[i] != upper[j]
    }  # fmt: skip
    assert cut == {(i, j) for i, j in want if X[i, 1] <= 0.1}
    assert len(cut) == 2 * 5 * 3


def test_points_that_cannot_be_used_are_named(rng):
    with pytest.raises(ValueError, match=r"X: points . and . coincide"):
        find(from_points([[0.0, 0.0], [1.0, 0.0], [1.0, 0.0]], 1.0), 2.0)
    with pytest.raises(ValueError, match=r"1 of 3 points have no bond .* point 2"):
        find(from_points([[0.0, 0.0], [1.0, 0.0], [9.0, 0.0]], 1.0), 2.0)
    with pytest.raises(ValueError, match=r"delta: 81 of 81 points have no bond"):
        find(lattice((0, 0), (1, 1), 0.125), 0.1)
    with pytest.raises(ValueError, match=r"delta: -1 must be"):
        find(lattice((0, 0), (1, 1), 0.125), -1)
    with pytest.raises(ValueError, match=r"partial: 'half' must be one of"):
        find(lattice((0, 0), (1, 1), 0.125), 0.5, partial="half")
