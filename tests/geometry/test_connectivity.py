import numpy as np
import pytest

from jaxpd.geometry import (
    find,
    free_modes,
    from_points,
    lattice,
    loose_points,
    pieces,
    rigid_modes,
    segment,
)


@pytest.mark.parametrize(("d", "count"), [(1, 1), (2, 3), (3, 6)])
def test_rigid_modes_do_not_stretch_any_bond(rng, d, count):
    X = rng.uniform(5, 9, size=(20, d))
    modes = rigid_modes(X)
    assert modes.shape == (20 * d, count)
    assert np.linalg.matrix_rank(modes) == count
    for mode in modes.T.reshape(count, 20, d):
        xi, eta = X[1:] - X[0], mode[1:] - mode[0]
        np.testing.assert_allclose((xi * eta).sum(axis=1), 0.0, atol=1e-13)


def test_a_crack_through_the_body_leaves_two_pieces():
    cloud = lattice((-1, -1), (1, 1), 0.25)
    family = find(cloud, 0.5, cracks=[segment((-2, 0), (2, 0))])
    label = pieces(np.asarray(family.nbr))
    upper = np.asarray(cloud.X)[:, 1] > 0
    assert len(set(label)) == 2
    assert len(set(label[upper])) == len(set(label[~upper])) == 1


def test_modes_left_free_are_counted_piece_by_piece():
    cloud = lattice((-1, -1), (1, 1), 0.25)
    X = np.asarray(cloud.X)
    family = find(cloud, 0.5, cracks=[segment((-2, 0), (2, 0))])
    label = pieces(np.asarray(family.nbr))
    fixed = np.zeros(X.shape, bool)
    assert [modes for _, modes in free_modes(X, fixed, label)] == [3, 3]
    fixed[X[:, 1] == 1.0, 1] = True  # rollers along the top: may slide
    assert sorted(modes for _, modes in free_modes(X, fixed, label)) == [1, 3]
    fixed[X[:, 1] == 1.0, 0] = True
    assert [modes for _, modes in free_modes(X, fixed, label)] == [3]
    fixed[X[:, 1] == -1.0] = True
    assert free_modes(X, fixed, label) == []


def test_points_on_a_string_have_no_stiffness_across():
    cloud = from_points([[0.0, 0], [1, 0], [2, 0], [1.5, 1]], 1.0)
    nbr = np.asarray(find(cloud, 1.2).nbr)
    fixed = np.zeros((4, 2), bool)
    assert loose_points(np.asarray(cloud.X), nbr, fixed).tolist() == [0]
    fixed[0, 1] = True
    assert loose_points(np.asarray(cloud.X), nbr, fixed).tolist() == []
