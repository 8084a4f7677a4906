"""What tests of weak forms share: bodies, layouts, sums by hand."""

import functools

import jax
import jax.numpy as jnp
import numpy as np

from jaxpd.discretize.boundary import boundary_points
from jaxpd.discretize.layout import lay_out_cells
from jaxpd.discretize.sampling import sampling
from jaxpd.discretize.schemes import Scheme
from jaxpd.geometry import mapped


@functools.lru_cache
def cloud(d, jitter=0.3, seed=1):
    return mapped((7, 6)[:d], lambda s: s, jitter=jitter, seed=seed)


@functools.lru_cache
def layout(d, kind, gradient="direct", points=None, exact=False):
    points = points or ((2, 6) if kind == "cells" else (1, 4))
    body = cloud(d)
    held = np.asarray(body.X)[:, 0] < 1e-9
    scheme = Scheme(kind, gradient, points=points, exact=exact)
    return lay_out_cells(body, held, scheme, 2, 2.6)


def parts(X, lay):
    """What `consistent` takes: radius, nodes_of, places, rim. Traced."""
    S = sampling(X, lay)
    at = boundary_points(X, lay.boundary)[1]
    rim = (at, S.rim_w[:, None] * S.normal, S.rim_nodes, S.rim_psi)
    return lay.cover.radius, lay.nodes_of, (S.place, S.w, S.B, S.psi), rim


@jax.jit
def sampled(X, lay):
    return parts(X, lay)


def of_nodes(B, nodes_of, u):
    """Gradients [.., g, c, d] of nodal values u [n]."""
    return jnp.einsum("akgc,kc->gca", B, u[nodes_of])
