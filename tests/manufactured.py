"""A smooth elastic field on the unit square, with the loads that belong to it."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxpd
from jaxpd.geometry import mapped


def _u(x):
    return jnp.stack([jnp.sin(2 * x[0] + x[1]), jnp.cos(x[0] - 2 * x[1])])


def _stress(x):
    law = jaxpd.physics.Hooke(1.0, 0.3, "plane strain")
    G = jax.jacfwd(_u)(x)
    s = law.step(jnp.array([G[0, 0], G[1, 1], G[0, 1] + G[1, 0]]), ())[0]
    return jnp.array([[s[0], s[2]], [s[2], s[1]]])


def _b(x):
    return -jnp.einsum("abb->a", jax.jacfwd(_stress)(x))


FIELDS = {
    name: jax.jit(jax.vmap(f)) for name, f in (("u", _u), ("s", _stress), ("b", _b))
}


def off(resolution, n=17, jitter=0.0, seed=5):
    """Error and exact displacements [n^2, 2]; three edges are under traction."""

    def part(name, *k, sign=1):
        return lambda X: (
            sign * np.asarray(FIELDS[name](jnp.asarray(X)))[(slice(None), *k)]
        )

    def pulled(f):
        x, y = (part("s", a, f.axis, sign=f.sign) for a in range(2))
        return jaxpd.traction(f, x=x, y=y)

    faces = [jaxpd.above(x=1.0), jaxpd.above(y=1.0), jaxpd.below(y=0.0)]
    everywhere = jaxpd.box((-1, -1), (2, 2))
    scene = jaxpd.Scene(
        mapped((n, n), lambda s: s, jitter=jitter, seed=seed),
        jaxpd.Elastic(1.0, 0.3, "plane strain"),
        supports=[jaxpd.moves(jaxpd.below(x=0.0), x=part("u", 0), y=part("u", 1))],
        loads=[
            jaxpd.body_force(everywhere, x=part("b", 0), y=part("b", 1)),
            *map(pulled, faces),
        ],
        resolution=resolution,
    )
    found = jaxpd.solve_static(scene).checked()
    exact = np.asarray(FIELDS["u"](found.X))
    return found.u - exact, exact
