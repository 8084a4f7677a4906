"""Mapped grids and rims: volumes, areas, normals, which face a corner's row has."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.geometry import box_nodes, lattice, mapped, rim, row_normals


def ring(s):
    angle = 0.5 * jnp.pi * s[1]
    return (1 + s[0]) * jnp.stack([jnp.cos(angle), jnp.sin(angle)])


def test_a_ring_has_its_area_its_boundary_and_its_normals():
    body = mapped((11, 25), ring, jitter=0.4, seed=3)
    X, faces = np.asarray(body.X), body.rim
    node, normal = np.asarray(faces.node), np.asarray(faces.normal)
    assert float(faces.area.sum()) == pytest.approx(1.5 * np.pi + 2.0, rel=1e-12)
    assert float(body.vol.sum()) == pytest.approx(0.75 * np.pi, rel=0.02)
    r = np.linalg.norm(X[node], axis=1)
    radial = (normal * X[node]).sum(axis=1) / r
    for side, on in ((-1.0, np.abs(r - 1) < 1e-12), (1.0, np.abs(r - 2) < 1e-12)):
        # 25 nodes look along the radius; both corners also across it
        assert np.sum(np.abs(radial[on] - side) < 1e-12) == 25
        assert np.sum(np.abs(radial[on]) < 1e-12) == 2
    # a closed surface: the normals balance, to the order of the trapezoidal rule
    assert np.abs((normal * np.asarray(faces.area)[:, None]).sum(0)).max() < 2e-3


@pytest.mark.parametrize("d", [1, 2, 3])
def test_a_box_of_nodes_has_the_volume_and_surface_of_the_box(d):
    body = lattice((0.0,) * d, (1.0,) * d, 0.25)
    vol, faces = box_nodes(body.lattice)
    assert vol.sum() == pytest.approx(1.0)
    assert float(faces.area.sum()) == pytest.approx(2 * d)
    moment = np.einsum(
        "qa,q,qb->ab", faces.normal, faces.area, np.asarray(body.X)[faces.node]
    )
    np.testing.assert_allclose(moment, np.eye(d), atol=1e-14)  # Gauss


def test_jitter_moves_inner_nodes_alone():
    still, moved = (mapped((6, 7), ring, jitter=j, seed=1) for j in (0.0, 0.3))
    on = np.zeros(42, bool)
    on[np.asarray(still.rim.node)] = True
    away = np.linalg.norm(np.asarray(still.X) - np.asarray(moved.X), axis=1)
    assert away[on].max() == 0.0
    assert away[~on].min() > 0.0


def test_a_corner_takes_for_each_component_the_face_that_looks_along_it():
    body = mapped((3, 3), lambda s: s)
    entry, on = row_normals(body.rim, 9, 2)
    normal = np.asarray(body.rim.normal)[entry]
    assert on.sum() == 8
    corner = 8  # (1, 1)
    np.testing.assert_array_equal(normal[corner], np.eye(2))
    np.testing.assert_array_equal(normal[7], [[1, 0], [1, 0]])  # (1, 1/2): one face


def test_bad_grids_are_refused_with_their_cure():
    with pytest.raises(ValueError, match="shape"):
        mapped((1, 4), ring)
    with pytest.raises(ValueError, match=r"jitter: 0\.5"):
        mapped((4, 4), ring, jitter=0.5)
    with pytest.raises(ValueError, match="not fold"):
        mapped((4, 4), lambda s: s[::-1])
    with pytest.raises(ValueError, match="normal, area"):
        rim([0], [[0.0, 0.0]], [1.0])
    with pytest.raises(ValueError, match="node"):
        rim([-1], [[0.0, 1.0]], [1.0])
    with pytest.raises(ValueError, match="rim"):
        jaxpd.from_points([[0.0], [1.0]], 1.0, rim([2], [[1.0]], [1.0]))
