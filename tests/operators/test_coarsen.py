"""Galerkin products by pieces against P^T K P of the whole matrix."""

import numpy as np
import pytest
import scipy.sparse as sp

from jaxpd.geometry import find_on_grid, lattice, rectangle, segment, without
from jaxpd.operators.coarsen import carried, irregular, scaled, uniform
from jaxpd.operators.lattice import LatticeTangent
from jaxpd.operators.transfer import axis_nodes, cut_keys, interpolation, torn_pairs


def stiffness(parts, family):
    """P^T K P needs K by components: [q] CSR matrices [n, n]."""
    i, j, slot = family.ends()
    found = []
    for q in range(parts.shape[1]):
        W = sp.csr_array((parts[slot, q], (i, j)), shape=(family.n,) * 2)
        W = W + W.T
        found.append(sp.csr_array(sp.diags_array(np.asarray(W.sum(axis=1))) - W))
    return found


def body(d, rng):
    if d == 2:
        cloud = lattice((0.0, 0.0), (1.0, 0.75), 1 / 16)
        cracks = [segment((0.3, 0.2), (0.7, 0.45))]
        m = 4
    else:
        cloud = lattice((0.0,) * 3, (1.0,) * 3, 1 / 8)
        cracks = [rectangle((0.3, 0.3, 0.5), (0.5, 0, 0), (0, 0.5, 0))]
        m = 2
    family = find_on_grid(cloud, m * cloud.lattice.dx, cracks=cracks)
    return family, rng.normal(size=(len(family.offsets), d * (d + 1) // 2))


@pytest.mark.parametrize("d", [2, 3])
def test_two_levels_are_galerkin_products(d, rng):
    family, parts = body(d, rng)
    held = np.zeros(family.shape, bool)
    held[..., :2] = True
    held[2:4, 3] = True  # held points under the hats of free coarse ones
    K, keys, shape = stiffness(parts, family), cut_keys(family), family.shape
    tangent = LatticeTangent(parts, None, None, family)
    smooth = rough = hats = None
    flat = held.ravel()
    for reach in (2, 1):
        nodes = axis_nodes(flat.reshape(shape), 2)
        move = interpolation(shape, nodes, flat, keys)
        P = move.matrix
        if hats is None:
            hats, rough = move.hats, irregular(tangent, move)
        else:
            hats = [a @ b for a, b in zip(hats, move.hats, strict=True)]
            rough = carried(smooth, rough, move)
        smooth = uniform(family, parts, hats)
        K = [P.T @ k @ P for k in K]
        for k, a, b in zip(K, smooth, rough, strict=True):
            np.testing.assert_allclose(
                (a + b).toarray(), k.toarray(), rtol=0, atol=1e-12 * abs(k).max()
            )
        keys = torn_pairs(keys, shape, nodes, reach)
        coarse = np.ravel_multi_index(np.meshgrid(*nodes, indexing="ij"), shape)
        flat, shape = flat[coarse.ravel()], move.shape


def test_interpolation_crosses_no_crack_and_is_exact_for_linear_fields(rng):
    family, _ = body(2, rng)
    held = np.zeros(family.n, bool)
    nodes = axis_nodes(held.reshape(family.shape), 4)
    move = interpolation(family.shape, nodes, held, cut_keys(family))
    P = move.matrix
    np.testing.assert_allclose(np.asarray(P.sum(axis=1)), 1.0, atol=1e-14)
    x = np.stack(np.unravel_index(np.arange(family.n), family.shape), axis=1)
    coarse = np.ravel_multi_index(np.meshgrid(*nodes, indexing="ij"), family.shape)
    plain = np.setdiff1d(np.arange(family.n), move.change.coords[0])
    np.testing.assert_allclose((P @ x[coarse.ravel()])[plain], x[plain], atol=1e-12)
    i, j = family.cut_ends()
    cut = set(zip(i.tolist(), j.tolist(), strict=True))
    near = sp.coo_array(P)
    for a, b in zip(near.coords[0], coarse.ravel()[near.coords[1]], strict=True):
        row = P[[a]].toarray()
        assert ((a, b) not in cut and (b, a) not in cut) or (row > 0).sum() == 4


def test_coarse_points_torn_apart_are_found_across_two_levels():
    cloud = lattice((0.0, 0.0), (1.0, 1.0), 1 / 16)
    family = find_on_grid(cloud, 4 / 16, cracks=[segment((-1.0, 0.53), (2.0, 0.53))])
    keys, shape = cut_keys(family), family.shape
    height = np.arange(shape[1])  # fine index of the points along the second axis
    for ratio, reach in ((4, 2), (2, 1)):
        nodes = axis_nodes(np.zeros(shape, bool), ratio)
        keys = torn_pairs(keys, shape, nodes, reach)
        shape, height = tuple(map(len, nodes)), height[nodes[1]]
        i, j = np.divmod(keys, np.prod(shape))
        above = [height[np.unravel_index(k, shape)[1]] > 0.53 * 16 for k in (i, j)]
        # every adjacent pair across, and no other: 3 ways up or down, less at the ends
        assert (above[0] != above[1]).all()
        assert len(keys) == 2 * (3 * shape[0] - 2)


def test_fields_scale_couplings_and_leave_translations_free(rng):
    family, parts = body(2, rng)
    family = without(family, np.array([[3], [1]]))
    K = stiffness(np.abs(parts), family)
    g, c = rng.uniform(1.0, 2.0, (2, family.n))
    for k, scaled_ in zip(K, scaled(K, g, c), strict=True):
        np.testing.assert_allclose(
            np.asarray(scaled_.sum(axis=1)), 0.0, atol=1e-12 * abs(k).max()
        )
        want = k.toarray() * np.outer(g, g) * 0.5 * (c[:, None] + c[None, :])
        np.fill_diagonal(want, 0.0)
        got = scaled_.toarray()
        np.fill_diagonal(got, 0.0)
        np.testing.assert_allclose(got, want, rtol=1e-12)
