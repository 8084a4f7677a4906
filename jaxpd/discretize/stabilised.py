"""What is added to nodal integration against short waves: rows of second derivatives.

Sampled at its nodes alone, a weak form hardly sees waves as short as the spacing. Two
remedies for linear elasticity, both quadratic in second derivatives of displacement:

    residual   the balance r = div(C eps) + b of every node squared (Beissel and
               Belytschko 1996; paper 004, eq. 20 to 29), with a number alpha to choose
    natural    the strain energy of gradients of strain within the node's circle, its
               sector at the boundary (Hillman and Chen 2016), nothing to choose

Neither satisfies the divergence theorem, so neither mends patch tests; `residual` locks
towards nu = 1/2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp

from jaxpd._types import PointVector, Scalar
from jaxpd.discretize.layout import CellLayout
from jaxpd.discretize.quadrature import body_moments, places_of, volumes_of
from jaxpd.discretize.rkpm import Cover, shape_functions
from jaxpd.geometry.outline import angles
from jaxpd.physics.voigt import voigt


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Penalty:
    """Rows beside the strains: energy 1/2 sum v (R u)^2 of nodal coefficients u.

    Attributes:
        R: rows of each place [m, d, K, g, c], of the nodes of its cell.
        v: their weights [m, g, c].
    """

    R: jax.Array
    v: jax.Array

    def rows(self, nodes_of: jax.Array, a: PointVector) -> jax.Array:
        """R a [m, g, c] of coefficients [n, d]."""
        return jnp.einsum("mdkgc,kcd->mgc", self.R, a[nodes_of])

    def energy(self, nodes_of: jax.Array, a: PointVector) -> Any:
        """Energy [] (J) of coefficients [n, d]."""
        return 0.5 * jnp.sum(self.v * self.rows(nodes_of, a) ** 2)

    def force(self, nodes_of: jax.Array, a: PointVector) -> PointVector:
        """Derivative [n, d] (N) of the energy: minus the internal force."""
        f = jnp.einsum("mdkgc,mgc->kcd", self.R, self.v * self.rows(nodes_of, a))
        return jnp.zeros_like(a).at[nodes_of].add(f)

    def diagonal(self, nodes_of: jax.Array, n: int) -> jax.Array:
        """Block diagonal [n, d, d] (N/m) of the stiffness."""
        block = jnp.einsum("mdkgc,mgc,mekgc->kcde", self.R, self.v, self.R)
        out = jnp.zeros((n, *block.shape[2:]), block.dtype)
        return out.at[nodes_of].add(block)

    def coo(self) -> jax.Array:
        """Blocks [K, K, c, d, d] (N/m) of the stiffness between nodes of a cell."""
        return jnp.einsum("mdkgc,mgc,melgc->klcde", self.R, self.v, self.R)


def stabilising(
    X: PointVector, layout: CellLayout, law: Any, alpha: Any, body: jax.Array
) -> tuple[Penalty | None, Any]:
    """What a scheme adds for a linear elastic law: rows, and loads [r, n, d] (N).

    Args:
        X: nodes [n, d] (m).
        layout: of the scheme.
        law: with `stiffness()`, and `E` for "residual".
        alpha: weight of "residual" (-).
        body: body forces at the places [r, g, c, d] (N/m^3).
    """
    what = layout.scheme.stabilisation
    if what == "none":
        return None, 0.0
    C = law.stiffness()
    if what == "natural":
        return natural(X, layout, C), 0.0
    rows = residual(X, layout, C, law.E, alpha)
    n, nodes_of = len(X), layout.nodes_of
    return rows, jnp.stack([residual_load(rows, nodes_of, b, n) for b in body])


def residual(
    X: PointVector, layout: CellLayout, C: Any, E: Scalar, alpha: Scalar = 0.05
) -> Penalty:
    """Squares of the balance: alpha l^2 / E sum w |div(C eps)|^2 (J). Traced.

    Args:
        X: nodes [n, d] (m).
        layout: with the rule "nodes" and a basis of degree 2.
        C: stiffness in Voigt notation [s, s] (Pa), of the whole body.
        E: the modulus that it is measured in (Pa).
        alpha: weight (-). No value suits all nodes; paper 004 names none.

    Returns:
        Rows div(C eps) [d, d, K, 1, n] (Pa/m^2) and weights 2 alpha l^2 / E w, with
        l^d the volume of a node on average.
    """
    n, d = X.shape
    bend = _bends(X, layout)
    V = voigt(d)
    C4 = jnp.einsum("sae,st,tbf->aebf", V, jnp.asarray(C), V)
    R = jnp.einsum("aebf,efkc->abkc", C4, bend)[:, :, :, None]
    w = places_of(X, layout.rule)[1]
    length = (body_moments(X, layout.rule.edge, 0)[0] / n) ** (1.0 / d)
    v = (2.0 * alpha * length**2 / E) * w
    return Penalty(R, jnp.broadcast_to(v[None], (d, *v.shape)))


def residual_load(penalty: Penalty, nodes_of: jax.Array, b: Any, n: int) -> jax.Array:
    """The load [n, d] (N) of body forces b [g, c, d] (N/m^d) that goes with `residual`.

    Minus the sum of v R^T b: rows and load vanish together where the body balances.
    """
    f = jnp.einsum("agc,abkgc,gca->kcb", penalty.v, penalty.R, b)
    return jnp.zeros((n, f.shape[-1])).at[nodes_of].add(-f)


def natural(X: PointVector, layout: CellLayout, C: Any) -> Penalty:
    """Energy of gradients of strain: 1/2 sum over k  M_kk eps_,k : C : eps_,k. Traced.

    Args:
        X: nodes [n, d] (m).
        layout: with the rule "nodes" and a basis of degree 2.
        C: stiffness in Voigt notation [s, s] (Pa), of the whole body.

    Returns:
        Rows L^T eps_,k [d s, d, K, 1, n], C = L L^T, and weights M_kk: second moments
        along the axes of the node's circle, or its sector, about the node.
    """
    d = X.shape[1]
    bend = _bends(X, layout)
    low = jnp.linalg.cholesky(jnp.asarray(C))
    R = jnp.einsum("ts,tbf,fekc->esbkc", low, voigt(d), bend)
    R = R.reshape(-1, *R.shape[2:])[:, :, :, None]
    M = second_moments(X, layout)
    return Penalty(R, jnp.repeat(M, len(low), axis=0)[:, None])


def second_moments(X: PointVector, layout: CellLayout) -> jax.Array:
    """Integrals of x^2, y^2 over the circle or sector of each node, about it [d, n]."""
    volume = volumes_of(X, layout.rule)
    if X.shape[1] == 1:
        f = jnp.ones(len(X)).at[layout.rule.edge.ravel()].set(0.5)
        return (volume**3 / (12.0 * f**2))[None]
    start, sweep = angles(X, layout.rule.edge)
    scale = 0.125 * (2.0 * volume / sweep) ** 2  # of the radius to the fourth
    turn = 0.5 * (jnp.sin(2.0 * (start + sweep)) - jnp.sin(2.0 * start))
    return jnp.stack([scale * (sweep + turn), scale * (sweep - turn)])


def _bends(X: PointVector, layout: CellLayout) -> jax.Array:
    """Second derivatives of shape functions at nodes [d, d, K, n] (1/m^2)."""
    if layout.rule.kind != "nodes":
        raise ValueError(
            f"layout: its rule is {layout.rule.kind!r}; second derivatives are added "
            "to plain nodal integration, kind 'nodes'"
        )
    a, b = layout.ends[2:]
    nodal = Cover(
        layout.cover.nbr[:, a:b],
        layout.cover.there[:, a:b],
        layout.cover.radius,
        layout.cover.scale[a:b],
    )
    found = shape_functions(X, X, nodal, layout.degree, 2)[2]
    K, c = layout.nodes_of.shape
    return layout.within.put(found, (K, c))
