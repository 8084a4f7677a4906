"""Gather and stencil are one operator: on a lattice they agree to round-off."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.geometry import find, lattice, rectangle, segment
from jaxpd.geometry.family import bulk_volume, neighbourhood_volumes, partial_volumes
from jaxpd.geometry.grid_family import find_on_grid, offset_shares
from jaxpd.operators import BondForce, bond_weights, stencil
from jaxpd.operators.lattice import LatticeTangent
from jaxpd.operators.stencil import StencilForce
from jaxpd.operators.stored import StencilBlocks
from jaxpd.physics import Fractional, Microelastic
from tests.catalogue import Hardening, LogStrain

# box, spacing, horizon, cracks, partial rule, law, blocks
MICRO = {
    d: Microelastic(jnp.asarray(2.0), Fractional(jnp.asarray(0.5), d))
    for d in (1, 2, 3)
}
CASES = {
    "bar": ((1.0,), 1 / 19, 3 / 19, [], "none", LogStrain(jnp.asarray(3.0)), "ad"),
    "plate": (
        (1.0, 0.5), 1 / 16, 3.2 / 16, [segment((0.2, 0.26), (0.7, 0.3))], "linear",
        MICRO[2], "hand",
    ),
    "block": (
        (1.0, 0.75, 0.5), 1 / 8, 2 / 8,
        [rectangle((0.3, -0.1, 0.2), (0.4, 0.0, 0.0), (0.0, 0.6, 0.1))], "none",
        Hardening(jnp.asarray(3.0)), "ad",
    ),
}  # fmt: skip


@dataclasses.dataclass
class Pair:
    gather: BondForce
    stencil: StencilForce
    slots: np.ndarray  # [k, n] slot of the lattice family, for either direction
    first: np.ndarray  # [k, n] first end of that bond


@functools.cache
def pair(name):
    hi, dx, delta, cracks, partial, law, blocks = CASES[name]
    d = len(hi)
    cloud = lattice((0.0,) * d, hi, dx)
    family = find(cloud, delta, partial=partial, cracks=cracks)
    grid = find_on_grid(cloud, delta, partial=partial, cracks=cracks)
    assert grid.n_bonds == family.n_bonds
    v, w = nodal_volumes_and_bond_weights(cloud, family, jnp.asarray(delta))
    gather = BondForce(cloud.X, family.nbr, w, law, jnp.asarray(delta), blocks)
    weight = jnp.asarray(offset_shares(grid, delta, dx) * dx ** (2 * d))
    stencil = StencilForce(grid, jnp.asarray(dx), weight, v, None, law, blocks)
    nbr = np.asarray(family.nbr)
    here = np.broadcast_to(np.arange(cloud.n), nbr.shape)
    i, j, slot = grid.ends()
    number = {(a, b): s for a, b, s in zip(i, j, slot, strict=True)}
    first = np.minimum(nbr, here)
    ends = zip(first.flat, np.maximum(nbr, here).flat, strict=True)
    slots = [number.get(bond, 0) for bond in ends]
    return Pair(gather, stencil, np.reshape(slots, nbr.shape), first)


@jax.jit
def nodal_volumes_and_bond_weights(cloud, family, delta):
    beta = partial_volumes(cloud.X, cloud.vol, family, delta)
    V = neighbourhood_volumes(cloud.vol, family, beta)
    w = bond_weights(cloud.X, cloud.vol, family, delta, "lattice")
    return V / bulk_volume(family, cloud.vol, delta, cloud.d), w


@jax.jit
def response(op, u, du):
    K = op.tangent(u)
    return op.respond(u), K.mv(du), K.diagonal(), K


@jax.jit
def tangent(op, u):
    return op.tangent(u)


@jax.jit
def computed_again(op, u, du):
    K = dataclasses.replace(op, stored=False).tangent(u)
    return K.mv(du), K.diagonal()


@jax.jit
def energies(op, u):
    return op.energy_per_point(u), jax.grad(op.energy)(u)


def equal(a, b, digits=1e-13):
    np.testing.assert_allclose(a, b, rtol=0, atol=digits * np.abs(b).max())


def agree(gather, stencil, rng):
    n, d = gather.X.shape
    dx = float(stencil.dx)
    u, du = (jnp.asarray(x) for x in rng.normal(scale=0.1 * dx, size=(2, n, d)))
    force, Kdu, own, K = response(stencil, u, du)
    expected, K0 = gather_response(gather, u)
    equal(force, expected)
    A, B = K0.to_bsr(), K.to_bsr()
    equal(Kdu.ravel(), A @ np.asarray(du).ravel())
    equal(own, diagonal(A))
    assert B.has_sorted_indices
    np.testing.assert_array_equal(A.indptr, B.indptr)
    np.testing.assert_array_equal(A.indices, B.indices)
    equal(B.data, A.data)
    return u, du, force, Kdu, own


@jax.jit
def gather_response(op, u):
    return op.respond(u), op.tangent(u)


def diagonal(A):
    rows = np.repeat(np.arange(len(A.indptr) - 1), np.diff(A.indptr))
    return A.data[rows == A.indices]


def dense(coo, n):
    rows, cols, blocks = map(np.asarray, coo)
    d = blocks.shape[-1]
    A = np.zeros((n, n, d, d))
    np.add.at(A, (rows, cols), blocks)
    return A.transpose(0, 2, 1, 3).reshape(n * d, n * d)


@pytest.mark.parametrize("name", CASES)
def test_gather_and_stencil_agree_at_finite_displacements(rng, name):
    both = pair(name)
    u, du, force, *stored = agree(both.gather, both.stencil, rng)
    # both momenta
    scale = np.abs(force).sum()
    x = np.asarray(both.gather.X + u)
    moment = x.T @ np.asarray(force)
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-14 * scale)
    np.testing.assert_allclose(moment - moment.T, 0.0, atol=1e-14 * scale)
    if name != "block":
        for again, kept in zip(
            computed_again(both.stencil, u, du), stored, strict=True
        ):
            equal(again, kept)
    if name == "plate":
        energy, gradient = energies(both.stencil, u)
        equal(energy, jax.jit(lambda op, u: op.energy_per_point(u))(both.gather, u))
        equal(gradient, -force)


def test_leaves_a_point_leaves_a_bond_and_scaled_bonds_agree(rng):
    both = pair("plate")
    n, k = both.gather.X.shape[0], len(both.stencil.family.offsets)
    c = jnp.asarray(rng.uniform(1.0, 5.0, n))
    scale, alpha = rng.uniform(size=(2, k, n))
    at = (both.slots, both.first)
    law = Microelastic(c, Fractional(jnp.asarray(alpha), 2))
    gather = dataclasses.replace(
        both.gather,
        law=Microelastic(c, Fractional(jnp.asarray(alpha[at]), 2)),
        weight=both.gather.weight * scale[at],
        blocks="axial",
    )
    stencil = dataclasses.replace(
        both.stencil, law=law, scale=jnp.asarray(scale), blocks="axial"
    )
    agree(gather, stencil, rng)
    with pytest.raises(ValueError, match="scale: bonds of an offset differ"):
        stencil.rest()
    with pytest.raises(ValueError, match="law: bonds of an offset differ by leaves"):
        dataclasses.replace(stencil, scale=None).rest()
    wrong = dataclasses.replace(law, c=jnp.ones(3))
    with pytest.raises(ValueError, match=r"law: a leaf .* \(3,\)"):
        dataclasses.replace(stencil, law=wrong).respond(both.gather.X)


# every branch of the factor, every number of dimensions
LATTICES = [("bar", "vc"), ("plate", ""), ("plate", "v"), ("block", "c")]


@pytest.mark.parametrize(("name", "fields"), LATTICES)
def test_lattice_tangent_is_that_of_the_undeformed_body(rng, name, fields):
    op, n, d = rest_case(rng, name, fields)
    K, du = op.rest(), jnp.asarray(rng.normal(size=(n, d)))
    force, own = lattice_response(K, du)
    # the tangent at u = 0, which agrees with that of the gather operator: see above
    A = tangent(op, jnp.zeros((n, d))).to_bsr()
    equal(force.ravel(), A @ np.asarray(du).ravel())
    B = K.to_bsr()
    equal(B.toarray(), A.toarray())
    equal(own, diagonal(A))


def rest_case(rng, name, fields):
    op = pair(name).stencil
    n, d = op.family.n, len(op.family.shape)
    c = jnp.asarray(rng.uniform(1.0, 5.0, n)) if "c" in fields else jnp.asarray(2.0)
    law, v = dataclasses.replace(MICRO[d], c=c), op.v if "v" in fields else None
    return dataclasses.replace(op, law=law, v=v, blocks="hand"), n, d


@jax.jit
def lattice_response(K, du):
    return K.mv(du), K.diagonal()


def test_lattice_tangent_in_single_precision_with_gradients_and_host_leaves(rng):
    op, n, d = rest_case(rng, "bar", "vc")
    K, du = op.rest(), jnp.asarray(rng.normal(size=(n, d)))

    def work(parts, v, c, family, du):
        return jnp.vdot(LatticeTangent(parts, v, c, family).mv(du), du)

    leaves = (K.parts, K.v, K.c, K.family)
    slopes = jax.jit(jax.grad(work, (0, 1, 2)))(*leaves, du)
    force64 = K.to_bsr() @ np.asarray(du)
    assert all(np.isfinite(slope).all() for slope in slopes)
    # work is linear in the blocks and in the modulus
    for leaf, slope in ((leaves[0], slopes[0]), (leaves[2], slopes[2])):
        equal(np.vdot(leaf, slope), jnp.vdot(force64, du))
    host = LatticeTangent(*jax.tree.map(np.asarray, leaves))
    force = jax.jit(host.mv)(du.astype(jnp.float32))
    assert force.dtype == jnp.float32
    equal(force, force64, 1e-6)


def test_cuts_in_traced_and_concrete_patterns(rng):
    op, n, d = rest_case(rng, "plate", "v")
    K = op.rest()
    A = K.to_bsr().toarray()
    concrete = jax.jit(K.coo)()
    assert len(concrete[0]) == n + 2 * op.family.n_bonds
    equal(dense(concrete, n), A)
    equal(dense(jax.jit(lambda K: K.coo())(K), n), A)  # cut bonds are cancelled
    S = tangent(op, jnp.asarray(rng.normal(scale=0.005, size=(n, d))))
    traced = jax.jit(lambda S: S.coo())(S)
    equal(dense(traced, n), S.to_bsr().toarray())


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class ForceAlone:
    law: Microelastic

    def force(self, xi, eta):
        return self.law.force(xi, eta)


def test_rest_on_the_host_compiles_nothing_and_is_that_by_autodiff(rng, monkeypatch):
    op, *_ = rest_case(rng, "plate", "vc")
    bare = ForceAlone(dataclasses.replace(op.law, c=jnp.asarray(1.0)))
    expected = dataclasses.replace(op, law=bare, blocks="ad").rest().parts
    monkeypatch.setattr(stencil, "_compiled_rest_parts", None)
    K = jax.tree.map(np.asarray, op).rest()
    assert all(type(leaf) is np.ndarray for leaf in jax.tree.leaves(K))
    equal(K.parts, expected)


def test_stored_blocks_take_any_value_a_bond_and_give_gradients(rng):
    op = pair("plate").stencil
    n, k = op.family.n, len(op.family.offsets)
    i, _, slot = op.family.ends()
    entries = np.zeros((k, 4, n))
    entries[slot, :, i] = rng.normal(size=(len(i), 4))
    K = StencilBlocks.lay(entries, op.family, symmetric=False)
    np.testing.assert_array_equal(K.blocks[slot, i].reshape(-1, 4), entries[slot, :, i])
    A, (du, w) = K.to_bsr(), jnp.asarray(rng.normal(size=(2, n, 2)))

    @jax.jit
    def products(K, du, w):
        work, slopes = jax.value_and_grad(lambda K: jnp.vdot(w, K.mv(du)), allow_int=1)(
            K
        )
        return K.mv(du), K.diagonal(), work, slopes.parts

    force, own, work, slope = products(K, du, w)
    equal(force.ravel(), A @ np.asarray(du).ravel())
    equal(own, diagonal(A))
    equal(np.vdot(slope, K.parts), work)  # work is linear in the blocks
