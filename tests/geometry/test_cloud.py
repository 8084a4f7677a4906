import numpy as np
import pytest

import jaxpd
from jaxpd.geometry import from_points, lattice


@pytest.mark.parametrize("d", [1, 2, 3])
def test_lattice_has_points_on_its_faces_and_layers_outside(d):
    layers = [(0, 0)] * (d - 1) + [(1, 2)]
    cloud = lattice([-0.5] * d, [0.5] * d, 0.125, layers=layers)
    X = np.asarray(cloud.X)
    assert cloud.lattice.shape == (9,) * (d - 1) + (12,)
    assert X.shape == (9 ** (d - 1) * 12, d)
    np.testing.assert_array_equal(X[:, -1].min(), -0.5 - 0.125)
    np.testing.assert_array_equal(X[:, -1].max(), 0.5 + 0.25)
    assert (X == 0.0).all(axis=1).sum() == 1  # the middle is hit exactly
    np.testing.assert_allclose(cloud.vol, 0.125**d, rtol=1e-15)
    # point (i, j, ..) has the number that ravel_multi_index gives it
    index = np.ravel_multi_index((3,) * d, cloud.lattice.shape)
    origin = np.asarray(cloud.lattice.origin)
    np.testing.assert_allclose(X[index], origin + 3 * 0.125, atol=1e-15)


def test_cell_centred_volumes_add_up_to_the_box():
    cloud = lattice((0, 0, 0), (1, 2, 0.5), 0.25, nodes="cell")
    np.testing.assert_allclose(cloud.vol.sum(), 1.0, rtol=1e-14)
    np.testing.assert_allclose(np.asarray(cloud.X).min(axis=0), 0.125)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: lattice((0,), (1,), 0.3), r"dx: 0.3 does not divide"),
        (lambda: lattice((0,), (1,), -0.1), r"dx: -0.1 must be positive"),
        (lambda: lattice((0,), (1, 1), 0.1), r"hi: "),
        (lambda: lattice((0,), (1,), 0.1, nodes="x"), r"nodes: 'x' must be"),
        (lambda: lattice((0,), (1,), 0.1, layers=[(1, -1)]), r"layers: "),
        (lambda: from_points(np.zeros((3, 4)), 1.0), r"X: shape \(3, 4\)"),
        (lambda: from_points(np.eye(2), [1.0, 0.0]), r"vol: point 1 has volume 0"),
        (lambda: from_points(np.eye(2), [1.0] * 3), r"vol: shape \(3,\)"),
        (lambda: from_points([[np.nan, 0.0]], 1.0), r"X: point 0 .* not finite"),
        (lambda: jaxpd.box((0, 0), (1, 0)), r"hi: .* must be above"),
        (lambda: jaxpd.above(q=1), r"coordinate: "),
        (lambda: jaxpd.ball((0, 0), 0.0), r"radius: 0"),
        (lambda: jaxpd.segment((0, 0), (0, 0)), r"b: tips .* coincide"),
        (lambda: jaxpd.rectangle((0, 0, 0), (1, 0, 0), (1, 1, 0)), r"edge2: "),
    ],
)
def test_bad_input_is_named(call, words):
    with pytest.raises(ValueError, match=words):
        call()


def test_regions_include_their_boundary_and_unite():
    X = np.array([[0.0, 0.0], [0.1 + 0.2, 0.0], [0.5, 0.5]])
    assert jaxpd.above(x=0.3).contains(X).tolist() == [False, True, True]
    assert jaxpd.below(x=0.3).contains(X).tolist() == [True, True, False]
    assert jaxpd.ball((0.0, 0.0), 0.3).contains(X).tolist() == [True, True, False]
    both = jaxpd.union(jaxpd.box((0, 0), (0.1, 0.1)), jaxpd.above(y=0.5))
    assert both.contains(X).tolist() == [True, False, True]
    with pytest.raises(ValueError, match=r"axis: 'z' does not exist in 2-D"):
        jaxpd.above(z=0.0).contains(X)
