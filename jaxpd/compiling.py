"""How code that runs once is compiled: ready soon rather than fast."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

import jax

#: Options of XLA's CPU compiler for what runs once: less time to compile, more to run.
QUICK = {"xla_cpu_use_fusion_emitters": False, "xla_backend_optimization_level": 1}


@functools.cache
def quickly(function: Callable[..., Any], **how: Any) -> Callable[..., Any]:
    """`jax.jit` of a function that is to be ready soon rather than to run fast.

    `how` are further arguments of `jax.jit`. Plain `jax.jit` where the platform or its
    compiler does not know the options.
    """
    if jax.default_backend() == "cpu":
        try:
            jax.jit(lambda x: x, compiler_options=QUICK).lower(0.0).compile()
        except Exception:  # whatever a compiler says of options that it does not know
            return jax.jit(function, **how)
        return jax.jit(function, compiler_options=QUICK, **how)
    return jax.jit(function, **how)
