"""Settings of all tests.

Compilation is most of their time: unless XLA_FLAGS is set, even to nothing, code is
compiled without optimisation and by the older emitters of fused loops, which take half
the time of the newer ones. `.ci/run` sets it to nothing for the slow tests.

Compiled code is kept as memory maps, thousands a test, and Linux ends a process that
has more than 65 530 of them; so what was compiled is dropped in time.
"""

import gc
import os
from importlib.metadata import version
from pathlib import Path

os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0"
    + (
        " --xla_cpu_use_fusion_emitters=false"
        if version("jaxlib").startswith(("0.9.", "0.10."))
        else ""  # a flag that XLA does not know ends the process
    ),
)

import jax
import numpy as np
import pytest
from jax._src import compiler

from jaxpd import compiling

if os.environ["XLA_FLAGS"].startswith("--xla_backend_optimization_level=0"):
    # what is compiled to run once, too
    compiling.QUICK["xla_backend_optimization_level"] = 0

jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

MAPS = Path("/proc/self/maps")
MAPS_KEPT = 20_000  # one test may add 8 000


@pytest.fixture(autouse=True)
def maps_are_few():
    yield
    if MAPS.exists() and MAPS.read_bytes().count(b"\n") > MAPS_KEPT:
        jax.clear_caches()
        gc.collect()


@pytest.fixture
def compiled_quickly(monkeypatch):
    """Compile as without XLA_FLAGS, for slow tests whose time is compilation.

    Of all that is compiled meanwhile; JAX itself has options for a `jax.jit` alone.
    """
    options = {"xla_backend_optimization_level": 0}
    if version("jaxlib").startswith(("0.9.", "0.10.")):
        options["xla_cpu_use_fusion_emitters"] = False
    plain = compiler.get_compile_options

    def quick(*args, env_options_overrides=None, **more):
        changed = options | dict(env_options_overrides or {})
        return plain(*args, env_options_overrides=changed, **more)

    monkeypatch.setattr(compiler, "get_compile_options", quick)


@pytest.fixture
def rng():
    return np.random.default_rng(20261122)
