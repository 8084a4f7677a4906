"""Which linear solver is ready first: compilation, set-up and iterations added up.

A rough model, which is enough: where two solvers are close it does not matter which one
is taken. Plain diagonally preconditioned CG on a fast product
is ready first for small, well-conditioned systems; a preconditioner that compiles in
little time for one larger solve; multigrid for large or many ones. The constants are
fits to single runs on two busy cores, for ranking and not for prediction.
"""

from __future__ import annotations

import math
from typing import Any

from jaxpd.operators.lattice import LatticeTangent
from jaxpd.solvers.spectral import symbols

#: Seconds of processor time to trace and compile the iteration.
COMPILE = {"d-pcg": 1.3, "spectral": 1.4, "multigrid": 2.7}
#: Seconds for a transform there and back, per padded point and component.
TRANSFORM = 2.2e-8
#: Seconds for a product with waves, per multiplication.
PRODUCT = 4e-11

#: Points along an axis beyond which waves and hats take too much memory.
LONGEST = 4100


def expected(
    lattice: LatticeTangent, fixed: Any, terms: int
) -> dict[str, tuple[float, float]]:
    """Expected seconds of (compilation and set-up, one solve) of each method."""
    family, d = lattice.family, lattice.d
    ends = [
        (symbol[symbol > 1e-9 * symbol.max()].min(), symbol.max())
        for symbol, _ in symbols(lattice, fixed)
        if symbol.size
    ]
    # the ratio of the ends of the spectrum, without crack and surface
    condition = float(max(high for _, high in ends) / min(low for low, _ in ends))
    padded = math.prod(n + r for n, r in zip(family.shape, family.reach, strict=True))
    force = terms * padded * d * TRANSFORM + 2e-8 * d * family.cut.shape[1]
    back = 4 * d * family.n * sum(family.shape) * PRODUCT
    cycle = 7 * (0.7 * padded * d * TRANSFORM + 1e-8 * d * family.cut.shape[1]) + 1e-3
    count = {
        "d-pcg": 2.5 * condition**0.5,
        "spectral": 6.0 * condition ** (1 / 6),
        "multigrid": 6.0,
    }
    each = {"d-pcg": force, "spectral": force + back, "multigrid": force + cycle}
    setup = {"d-pcg": 0.0, "spectral": 0.0, "multigrid": 3e-6 * family.n}
    if max(family.shape) > LONGEST:  # waves and hats are dense along an axis
        count = {"d-pcg": count["d-pcg"]}
    return {
        name: (COMPILE[name] + setup[name], count[name] * each[name]) for name in count
    }


def cheapest(
    lattice: LatticeTangent, fixed: Any, solves: int = 1, terms: int = 1
) -> str:
    """The method with the least expected time for a number of solves.

    Args:
        lattice: stiffness of the undeformed lattice, in NumPy arrays.
        fixed: mask of prescribed entries [n, d].
        solves: linear solves that one compilation and set-up serve.
        terms: terms of the factor of a bond, see `jaxpd.operators.fft`.
    """
    cost = expected(lattice, fixed, terms)
    return min(cost, key=lambda name: cost[name][0] + solves * cost[name][1])
