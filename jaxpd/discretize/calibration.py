"""How stiff the bonds of a ghost interlayer must be: a static test, in closed form.

Between rigid plies the bonds' stiffness K = E / h is a sum. Plies are not rigid: bonds
from a ghost also reach points below the face, which the strain of the ply moves, and a
face with its missing bonds is itself softer or stiffer than the bulk. A stack pulled by
a traction sigma therefore opens by C sigma, C not 1 / K but off by up to three spacings
over the plies' modulus. Here C is computed, and the bonds are made to have the right
one.

Plane displacements normal to the layers, or along them, make a chain of rows. Near the
interlayer u = sigma (C psi0 + psi1 + w): a unit jump between the outermost rows, the
even strain of the plies, and what decays within some horizons. With A the stiffness of
the rows of both plies, s G that of the bonds, p = A psi1 (which ends at the face),

    (A + s G) w = -p - s G (C psi0 + psi1),    psi0 . s G (C psi0 + psi1 + w) = 1,

so that C is a quotient of sums over the modes G phi = lam A phi. A central spring k0
between the faces, of traction F, is one more force, e = e_B - e_A on the two rows.
All per area of the interlayer.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.linalg
import scipy.optimize
from jax import lax
from numpy.typing import NDArray

from jaxpd._types import Scalar, namespace

Floats = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class Rows:
    """The rows of a ply below a free face, under one kind of plane displacement; host.

    Attributes:
        K: stiffness of the first N rows against the first N + reach [N, N + reach], per
            area of the face (N/m^3); the face's row first.
        dx: distance of rows (m).
        inset: from the face to its first row (m).
    """

    K: Floats
    dx: float
    inset: float

    @property
    def strained(self) -> Floats:
        """Forces [N] per area (N/m^2) of the even strain 1, free face and all."""
        return self.K @ (self.dx * np.arange(self.K.shape[1]))

    @property
    def modulus(self) -> float:
        """Traction over strain far from the face (Pa)."""
        return -float(self.strained.sum())


def rows_of(matrix: Any, shape: Sequence[int], axis: int, along: int) -> Floats:
    """Stiffness between the rows of a lattice, seen by its middle column; host.

    Args:
        matrix: stiffness [n d, n d] (N/m).
        shape: of the lattice.
        axis: across the rows.
        along: direction of displacements and forces.

    Returns:
        [N, N] (N/m): the force on the point in the middle of each row where another row
        moves by 1.
    """
    d, rows = len(shape), shape[axis]
    place = np.indices(tuple(shape)).reshape(d, -1)
    moved = np.zeros((matrix.shape[0], rows))
    moved[d * np.arange(place.shape[1]) + along, place[axis]] = 1.0
    middle = np.ones(place.shape[1], bool)
    for a in set(range(d)) - {axis}:
        middle &= place[a] == shape[a] // 2
    return (matrix @ moved)[d * np.flatnonzero(middle) + along]


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Modes:
    """The static response of two plies and unit bonds to one kind of displacement.

    Attributes:
        lam: eigenvalues [r] (m^3/N).
        g0, g1: G psi0 and G psi1 in the modes [r].
        p, e: p and e in the modes [r].
        k00, k01, k11: psi0 . G psi0, psi0 . G psi1 and psi1 . G psi1 [].
        inset: compliance of the plies between face and outermost row [] (m^3/N).
    """

    lam: Any
    g0: Any
    g1: Any
    p: Any
    e: Any
    k00: Any
    k01: Any
    k11: Any
    inset: Any

    def compliance(self, s: Any) -> Any:
        """C between the outermost rows [] or [q] (m^3/N) with bonds s; NumPy's too."""
        top, own, _ = self._balance(s)
        return top / own

    def _balance(self, s: Any) -> tuple[Any, Any, Any]:
        """The terms of C own = top - F pull, F the traction of a spring."""
        at = namespace(s, self.lam).expand_dims(s, -1)
        soft = 1.0 / (1.0 + at * self.lam)
        top = 1.0 / s - self.k01 + (self.g0 * (self.p + at * self.g1) * soft).sum(-1)
        own = self.k00 - (at * self.g0**2 * soft).sum(-1)
        return top, own, 1.0 / s - (self.g0 * self.e * soft).sum(-1)

    def bonds_on_host(self, C: float) -> float | None:
        """As `bonds`, in NumPy; None if no s makes the compliance C."""
        low, high = 1e-9 * C, C
        while self.compliance(1.0 / high) < C:
            high *= 4.0
        if not self.compliance(1.0 / low) < C:
            return None
        root: Any = scipy.optimize.brentq(
            lambda r: float(self.compliance(1.0 / r)) - C, low, high, xtol=1e-14 * C
        )
        return 1.0 / root

    def bonds(self, C: Any) -> Any:
        """The s (N/m^3) that makes the compliance C; differentiable to any order."""
        return _bonds(self, jnp.asarray(C))

    def spring(self, C: Any, s: Any) -> Any:
        """The k0 (N/m^3) of the spring that makes it C beside bonds s; NumPy's too."""
        top, own, pull = self._balance(s)
        F = (top - C * own) / pull
        at, across, traction = (
            namespace(s, C, self.lam).expand_dims(x, -1) for x in (s, C, F)
        )
        w = self.p + at * (across * self.g0 + self.g1) + traction * self.e
        return F / (C - (self.e * w / (1.0 + at * self.lam)).sum(-1))

    def stored(self, C: Any, s: Any, k0: Any) -> Any:
        """Energy of bonds and spring over half the traction squared (m^3/N).

        That of bonds s and springs k0 that make the compliance C. A layer's own is
        h / E; here the plies' near the face is another, and theirs make up for it.
        """
        at, across = (jnp.expand_dims(jnp.asarray(x), -1) for x in (s, C))
        soft = 1.0 / (1.0 + at * self.lam)
        w = -(self.p + at * (across * self.g0 + self.g1)) * soft
        jump = C + jnp.sum(self.e * w, axis=-1)
        jump = jump / (1.0 + k0 * jnp.sum(self.e**2 * soft, axis=-1))
        w = w - jnp.expand_dims(k0 * jump, -1) * self.e * soft
        even = C * C * self.k00 + 2.0 * C * self.k01 + self.k11
        rest = 2.0 * (across * self.g0 + self.g1) * w + self.lam * w * w
        return s * (even + jnp.sum(rest, axis=-1)) + k0 * jump**2


@jax.custom_jvp
def _bonds(modes: Modes, C: jax.Array) -> jax.Array:
    def step(_: int, r: jax.Array) -> jax.Array:  # Newton's method for 1 / s
        value, slope = jax.jvp(
            lambda r: modes.compliance(1.0 / r), (r,), (jnp.ones_like(r),)
        )
        return jnp.clip(r - (value - C) / slope, 0.2 * r, 5.0 * r)

    return 1.0 / lax.fori_loop(0, 60, step, C)


@_bonds.defjvp
def _bonds_slope(at: Any, along: Any) -> tuple[jax.Array, jax.Array]:
    (modes, C), (dmodes, dC) = at, along
    s = _bonds(modes, C)
    _, change = jax.jvp(lambda m: m.compliance(s), (modes,), (dmodes,))
    _, slope = jax.jvp(modes.compliance, (s,), (jnp.ones_like(s),))
    return s, (dC - change) / slope


def modes_of(below: Rows, above: Rows, shares: tuple[Floats, Floats]) -> Modes:
    """Modes of two plies and the unit bonds between them; host.

    Args:
        below: rows of the lower ply.
        above: rows of the upper ply.
        shares: stiffness of the unit bonds from a ghost to each row of the lower and of
            the upper ply, per area [rows] (-).
    """
    sides, N = (below, above), (len(below.K), len(above.K))
    A = scipy.linalg.block_diag(*(side.K[:, : len(side.K)] for side in sides))
    A = 0.5 * (A + A.T)
    sign = np.repeat((-1.0, 1.0), N)
    depth = np.concatenate(
        [s.dx * np.arange(n) / s.modulus for s, n in zip(sides, N, strict=True)]
    )
    p = sign * np.concatenate([side.strained / side.modulus for side in sides])
    face = np.zeros(sum(N))
    face[[0, N[0]]] = 0.5
    bond = np.eye(sum(N)) - face
    kept = [
        np.pad(x[:n], (0, max(0, n - len(x)))) for x, n in zip(shares, N, strict=True)
    ]
    G = bond.T @ (np.concatenate(kept)[:, None] * bond)
    psi0, psi1, e = 0.5 * sign, sign * depth, 2.0 * sign * face
    lam, phi = scipy.linalg.eigh(G, A)
    return Modes(
        lam=np.maximum(lam, 0.0),
        g0=phi.T @ G @ psi0,
        g1=phi.T @ G @ psi1,
        p=phi.T @ p,
        e=phi.T @ e,
        k00=psi0 @ G @ psi0,
        k01=psi0 @ G @ psi1,
        k11=psi1 @ G @ psi1,
        inset=sum(side.inset / side.modulus for side in sides),
    )


@jax.tree_util.register_dataclass
@dataclass(frozen=True, eq=False)
class Calibration:
    """From the moduli of an interlayer to the stiffness of its bonds and springs.

    Attributes:
        h: thickness [] (m).
        unit: normal stiffness of the unit bonds between rigid plies [] (N/m^3).
        ratio: their shear stiffness over that [] (-).
        normal, shear: responses of the stack; None for the rules "rigid" and "paper".
        rule: "calibrated", "rigid" or "paper", see `jaxpd.laminate.interlayer`.
    """

    h: Any
    unit: Any
    ratio: Any
    normal: Modes | None
    shear: Modes | None
    rule: str = field(metadata={"static": True})

    def __call__(self, E: Scalar, shear: Scalar | None) -> tuple[Any, Any]:
        """Stiffness s of the bonds over the unit, and k0 of the springs (N/m^3).

        NaN where none do: no s is stiff enough, or k0 would be negative.

        Args:
            E: normal modulus, any shape (Pa).
            shear: shear modulus, or None (Pa).
        """
        if self.rule == "paper":
            return E, jnp.zeros_like(E)
        if self.normal is None or self.shear is None:
            if shear is None:
                return E / self.h, jnp.zeros_like(E / self.h)
            s = shear / (self.h * self.ratio)
            return s, _positive(E / self.h - s)
        across = self.h / E + self.normal.inset
        if shear is None:
            s = _met(self.normal, across)
            return s, jnp.zeros_like(s)
        s = _met(self.shear, self.h / shear + self.shear.inset)
        return s, _positive(self.normal.spring(across, s))

    def stored(self, E: Scalar, s: Any, k0: Any) -> tuple[Any, Any]:
        """Energy per area over half the squared normal and shear traction (m^3/N).

        Args:
            E: normal modulus (Pa).
            s: stiffness of the bonds over the unit.
            k0: that of the springs (N/m^3).
        """
        if self.normal is None or self.shear is None:
            normal = s * self.unit
            # a bar has no shear
            shear: Any = jnp.where(self.ratio > 0.0, normal * self.ratio, jnp.inf)
            return 1.0 / (normal + k0), 1.0 / shear
        across = self.h / E + self.normal.inset
        along = self.shear.compliance(s)
        return self.normal.stored(across, s, k0), self.shear.stored(along, s, 0.0 * s)


def _met(modes: Modes, C: Any) -> Any:
    s = modes.bonds(C)
    return jnp.where(jnp.abs(modes.compliance(s) / C - 1.0) < 1e-6, s, jnp.nan)


def _positive(k0: Any) -> Any:
    return jnp.where(k0 >= 0.0, k0, jnp.nan)
