"""Weights between nodes and the places where a weak form is sampled. Traced.

Gradients are those of the shape functions, or, in cells of nodes, the polynomial that
answers

    sum over the cell  w Psi~_I,k tau  =  boundary integral of  Psi_I tau n_k
                                        - sum over the cell  w Psi_I tau_,k

for tau = 1, which is Chen's stabilised conforming nodal integration, or for all linear
tau, Duan's quadratically consistent one. The rules of cell and boundary are exact as
far as it takes to reproduce gradients of polynomials of degree 1 or 2; the sum over
cells is the discrete divergence theorem, so that stresses of degree 0 or 1 are in
equilibrium with their tractions and body forces: the patch test, whatever the nodes.
One gradient serves trial and test, and shape functions still add up to one: the
stiffness is symmetric, forces balance.

Other gradients are mended by `jaxpd.discretize.consistency` and `projection`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointScalar, PointVector
from jaxpd.discretize.boundary import boundary_points
from jaxpd.discretize.consistency import consistent
from jaxpd.discretize.dual import cell_moments, face_points
from jaxpd.discretize.layout import CellLayout
from jaxpd.discretize.projection import projected
from jaxpd.discretize.quadrature import places_of, simplex, stretch
from jaxpd.discretize.rkpm import shape_functions


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Sampling:
    """Weights of a layout.

    Attributes:
        nodes_of: nodes that reach each cell [K, c], int32.
        w: weights of the places [g, c] (m^d).
        B: trial gradients there [d, K, g, c] (1/m).
        T: test gradients [d, K, g, c] (1/m); None where they are the same.
        psi: shape functions there [K, g, c].
        place: [g, c, d] (m).
        rim_nodes: nodes that reach the places of the boundary [k, b], int32.
        rim_psi: shape functions there [k, b].
        rim_w: weights of those places [b] (m^(d-1)).
        normal: outward normals there [b, d].
        near: nodes that reach each node [k, n], int32.
        value: shape functions at nodes [k, n].
    """

    nodes_of: jax.Array
    w: jax.Array
    B: jax.Array
    T: jax.Array | None
    psi: jax.Array
    place: jax.Array
    rim_nodes: jax.Array
    rim_psi: jax.Array
    rim_w: PointScalar
    normal: jax.Array
    near: jax.Array
    value: jax.Array

    @property
    def q(self) -> int:
        """Number of places."""
        return self.w.size

    def field(self, a: PointVector) -> PointVector:
        """Values at the nodes [n, d] of coefficients [n, d]."""
        return jnp.einsum("kn,kna->na", self.value, a[self.near])

    def traction(self, t: jax.Array) -> PointVector:
        """Nodal forces [n, d] (N) of tractions [b, d] (Pa) at the boundary's places."""
        out = jnp.zeros((self.value.shape[1], t.shape[1]), t.dtype)
        force = (self.rim_w[:, None] * t)[None] * self.rim_psi[..., None]
        return out.at[self.rim_nodes].add(force)

    def body_force(self, b: jax.Array) -> PointVector:
        """Nodal forces [n, d] (N) of force densities [g, c, d] (N/m^3) at places."""
        out = jnp.zeros((self.value.shape[1], b.shape[-1]), b.dtype)
        force = jnp.einsum("gc,kgc,gca->kca", self.w, self.psi, b)
        return out.at[self.nodes_of].add(force)


def sampling(X: PointVector, layout: CellLayout) -> Sampling:
    """Weights of a layout in the positions X [n, d]."""
    d = X.shape[1]
    scheme, rule, cover = layout.scheme, layout.rule, layout.cover
    place, w = places_of(X, rule)
    at, middle, s, out = boundary_points(X, layout.boundary)
    spots = [place.reshape(-1, d), at, X]
    smooth = scheme.gradient != "direct"
    face = flux = jnp.zeros((0, d))
    if smooth:
        assert rule.dual is not None
        face, flux = (x.reshape(-1, d) for x in face_points(X, rule.dual))
        spots.insert(1, face)
    order = 0 if smooth else 1
    found = shape_functions(jnp.concatenate(spots), X, cover, layout.degree, order)
    a, b, c, e = layout.ends
    psi = _grouped(found[0][:, :a], layout, w.shape)
    on_rim, value = found[0][:, b:c], found[0][:, c:e]
    test = None
    if smooth:
        fluxes = [
            (found[0][:, a:b], face, flux, layout.beside[0]),
            (found[0][:, a:b], face, -flux, layout.beside[1]),
            (on_rim, middle, s[:, None] * out, layout.along),
        ]
        B = _smoothed(X, layout, psi, fluxes)
    else:
        B = _grouped(found[1][:, :, :a], layout, w.shape)
    if scheme.correction != "none":
        places = (place, w, B, psi)
        rim = (middle, s[:, None] * out, cover.nbr[:, b:c], on_rim)
        nodes = (X, cover.radius, layout.nodes_of)
        if scheme.correction == "both":
            B = projected(*nodes, places, rim, scheme.order + 1)
        else:
            test = consistent(*nodes, places, rim, scheme.order)
    return Sampling(
        layout.nodes_of, w, B, test, psi, place,
        cover.nbr[:, b:c], on_rim, s, out, cover.nbr[:, c:e], value,
    )  # fmt: skip


def _grouped(values: jax.Array, layout: CellLayout, shape: Any) -> jax.Array:
    """Values [.., k, g c] at the places of the rule by cell [.., K, g, c]."""
    k, (g, c) = values.shape[-2], shape
    out = jnp.zeros((*values.shape[:-2], len(layout.nodes_of), g, c), values.dtype)
    slot = layout.within.slot.reshape(k, g, c)
    at = (..., slot, jnp.arange(g)[None, :, None], jnp.arange(c)[None, None])
    return out.at[at].add(values.reshape(*values.shape[:-1], g, c), mode="drop")


def _smoothed(
    X: PointVector, layout: CellLayout, psi: jax.Array, fluxes: list[Any]
) -> jax.Array:
    """Gradients [d, K, g, c] that satisfy the divergence theorem in each cell."""
    d, g = X.shape[1], psi.shape[1]
    shape = layout.nodes_of.shape
    assert layout.rule.dual is not None
    volume, centroid, spread = cell_moments(X, layout.rule.dual)
    mean: Any = jnp.zeros((d, *shape))
    for value, _, flux, slots in fluxes:
        mean += slots.put(value[None] * flux.T[:, None, :], shape)
    mean = mean / volume[None, None]
    if layout.scheme.gradient == "constant":
        return jnp.broadcast_to(mean[:, :, None], (d, shape[0], g, shape[1]))
    inverse = _inverse(stretch(spread))  # zeta = L^-1 (x - centroid)
    # slopes of the gradient along zeta, [zeta, d, K, c]
    slope: Any = jnp.zeros((d, d, *shape))
    for value, where, flux, slots in fluxes:
        far = where - centroid[slots.cell]
        zeta = jnp.einsum("qab,qb->aq", inverse[slots.cell], far)
        both = zeta[:, None] * flux.T[None]
        slope += slots.put(value[None, None] * both[:, :, None], shape)
    # less the mean of Psi grad zeta
    inner = jnp.einsum("kc,cab->abkc", psi.mean(axis=1), inverse)
    slope = slope / volume[None, None, None] - inner
    return mean[:, :, None] + jnp.einsum("ga,abkc->bkgc", simplex(d), slope)


def _inverse(L: jax.Array) -> jax.Array:
    """Inverses of lower triangles [n, d, d], d = 1 or 2."""
    if L.shape[-1] == 1:
        return 1.0 / L
    a, b, c = L[:, 0, 0], L[:, 1, 0], L[:, 1, 1]
    rows = [[1.0 / a, jnp.zeros_like(a)], [-b / (a * c), 1.0 / c]]
    return jnp.stack([jnp.stack(row, axis=-1) for row in rows], axis=-2)
