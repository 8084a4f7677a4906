"""Properties of a bond's kinematics over all sizes of bonds and displacements."""

import jax
import jax.numpy as jnp
import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from jaxpd.physics import extension

kinematics = jax.jit(extension)
exponent = st.integers(-12, 3)
unit = st.tuples(*[st.floats(-1.0, 1.0) for _ in range(3)]).filter(
    lambda v: np.linalg.norm(v) > 0.1
)


@settings(deadline=None, max_examples=200, derandomize=True)
@given(unit, unit, st.integers(-6, 6), exponent)
def test_extension_keeps_its_digits_whatever_the_scales(a, b, size, ratio):
    """Against extended precision: relative error of round-off, not of cancellation."""
    xi = np.array(a) * 10.0**size
    eta = np.array(b) * 10.0 ** (size + ratio)
    long = np.longdouble
    y = xi.astype(long) + eta.astype(long)
    X, r = np.sqrt((xi.astype(long) ** 2).sum()), np.sqrt((y**2).sum())
    if r < 1e-3 * X:
        return  # a bond squeezed to nothing has no direction
    product = eta.astype(long) * (2 * xi.astype(long) + eta.astype(long))
    exact = product.sum() / (X + r)
    e, M = kinematics(jnp.asarray(xi), jnp.asarray(eta))
    # the scalar product may cancel, never the lengths: round-off of its largest term
    bound = 1e-14 * float(np.abs(product).max() / (X + r))
    assert abs(float(e) - float(exact)) <= bound
    # direction of a unit vector; round-off of the sum xi + eta over its length
    slack = 1e-15 * float((X + np.sqrt((eta.astype(long) ** 2).sum())) / r) + 1e-15
    assert np.abs(np.asarray(M) - (y / r).astype(float)).max() <= slack
    back, _ = kinematics(jnp.asarray(-xi), jnp.asarray(-eta))
    assert float(back) == float(e)
