"""Names for array shapes, so that a signature says what it takes.

The letters: `n` points, `d` dimensions (1, 2 or 3), `k` slots of a family (the most
neighbours that a point has) or offsets of a lattice. Families are stored slot by slot,
`[k, n]`: a loop over slots then reads memory in order, which on a CPU is several times
faster than `[n, k]`. `Any` stands for arrays of NumPy or JAX, see `namespace`.
"""

from typing import Annotated, Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

Scalar: TypeAlias = Annotated[Any, "[]"]
Vector: TypeAlias = Annotated[jax.Array, "[d]"]
Tensor: TypeAlias = Annotated[jax.Array, "[d, d]"]
PointScalar: TypeAlias = Annotated[Any, "[n]"]
PointVector: TypeAlias = Annotated[Any, "[n, d]"]
PointTensor: TypeAlias = Annotated[jax.Array, "[n, d, d]"]
BondIndex: TypeAlias = Annotated[jax.Array, "[k, n] int32"]
BondScalar: TypeAlias = Annotated[Any, "[k, n]"]
BondVector: TypeAlias = Annotated[jax.Array, "[k, n, d]"]
BondTensor: TypeAlias = Annotated[jax.Array, "[k, n, d, d]"]


def namespace(*arrays: Any) -> Any:
    """`numpy` if none of the arrays is JAX's, else `jax.numpy`.

    What is written with it runs on the host without compilation, or inside a trace.
    """
    return jnp if any(isinstance(a, jax.Array) for a in arrays) else np
