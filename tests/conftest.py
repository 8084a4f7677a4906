"""Settings of all tests.

Compilation is most of their time: unless XLA_FLAGS is set, even to nothing, code is
compiled without optimisation. `.ci/run` sets it to nothing for the slow tests.
"""

import os

os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")

import jax
import numpy as np
import pytest

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture
def rng():
    return np.random.default_rng(20261122)
