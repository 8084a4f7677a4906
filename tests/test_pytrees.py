"""What JAX must keep apart for `jit` to be trusted with more than one law."""

import jax
import jax.numpy as jnp
import pytest

from jaxpd.physics import Conical, Gaussian, Microelastic
from tests.catalogue import Hardening, LogStrain

PAIRS = [
    (LogStrain(jnp.ones(())), Hardening(jnp.ones(()))),
    (
        Microelastic(jnp.ones(()), Conical(jnp.ones(()))),
        Microelastic(jnp.ones(()), Gaussian(jnp.ones(()))),
    ),
]


@pytest.mark.parametrize("pair", PAIRS, ids=["laws", "influences"])
def test_classes_of_equal_leaves_have_unequal_structures(pair):
    """Equal in jax 0.10.0 to 0.10.2, whose jit cache then mixes laws up."""
    a, b = map(jax.tree.structure, pair)
    assert a != b
