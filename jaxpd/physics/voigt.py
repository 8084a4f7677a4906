"""Voigt notation: symmetric tensors as vectors, shears last, engineering shear strain.

1-D (xx), 2-D (xx, yy, xy), 3-D (xx, yy, zz, yz, xz, xy)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Components of the Voigt vector by dimension.
PAIRS = {
    1: ((0, 0),),
    2: ((0, 0), (1, 1), (0, 1)),
    3: ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)),
}


def voigt(d: int) -> NDArray[np.floating]:
    """The map V [s, d, d] between tensors and Voigt vectors.

    Of a displacement gradient G the strain is the sum over ab of V[s, a, b] G[a, b],
    with engineering shear; of a Voigt stress the tensor is the sum over s of
    V[s, a, b] times stress s.
    """
    V = np.zeros((len(PAIRS[d]), d, d))
    for s, (a, b) in enumerate(PAIRS[d]):
        V[s, a, b] = V[s, b, a] = 1.0
    return V
