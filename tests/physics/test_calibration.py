"""Micromoduli proved by energy: nonlocal against classical, dilation and shear."""

import jax.numpy as jnp
import numpy as np
import pytest

from jaxpd.geometry import find, lattice
from jaxpd.physics import (
    Conical,
    Constant,
    Fractional,
    Gaussian,
    check_order,
    elastic,
    micromodulus,
)
from jaxpd.physics.influence import moment

DELTA = 0.3
CASES = [
    ("bar", None),
    ("plane stress", 1 / 3),
    ("plane strain", 1 / 4),
    ("solid", 1 / 4),
]
INFLUENCES = {
    "alpha -3": lambda d: Fractional(jnp.asarray(-3.0), d),
    "alpha 0": lambda d: Fractional(jnp.asarray(0.0), d),
    "alpha 1.9": lambda d: Fractional(jnp.asarray(1.9), d),
    "pmb": lambda d: Fractional(jnp.asarray(1.0 - d), d),
    "constant": lambda d: Constant(),
    "conical": lambda d: Conical(jnp.asarray(DELTA)),
    "gaussian": lambda d: Gaussian(jnp.asarray(DELTA / 3)),
}


def gauss(n, a, b):
    x, w = np.polynomial.legendre.leggauss(n)
    return 0.5 * (b - a) * (x + 1) + a, 0.5 * (b - a) * w


def nonlocal_energy(strain, c, omega, d):
    """W = int c omega (n . strain n |xi|)^2 / 4 dV by quadrature over the ball.

    The substitution r = delta t^10 tames the singularity of alpha = 1.9.
    """
    t, wt = gauss(60, 0.0, 1.0)
    r, wr = DELTA * t**10, DELTA * 10 * t**9 * wt
    if d == 1:
        n, wn = np.array([[1.0], [-1.0]]), np.ones(2)
    elif d == 2:
        a = 2 * np.pi * np.arange(64) / 64
        n, wn = np.stack([np.cos(a), np.sin(a)], 1), np.full(64, 2 * np.pi / 64)
    else:
        z, wz = gauss(16, -1.0, 1.0)
        a = 2 * np.pi * np.arange(32) / 32
        s = np.sqrt(1 - z**2)
        n = np.stack(
            [np.outer(s, np.cos(a)), np.outer(s, np.sin(a)), np.outer(z, np.ones(32))],
            2,
        ).reshape(-1, 3)
        wn = np.repeat(wz, 32) * 2 * np.pi / 32
    along = np.einsum("qi,ij,qj->q", n, strain, n)
    radial = np.sum(np.asarray(omega(jnp.asarray(r))) * r ** (d + 1) * wr)
    return 0.25 * c * radial * np.sum(wn * along**2)


def classical_energy(strain, E, nu, state):
    d = len(strain)
    D = np.asarray(elastic.stiffness(E, nu or 0.0, state))
    shear = [2 * strain[a, b] for a, b in ((0, 1), (1, 2), (0, 2)) if b < d]
    e = np.concatenate([np.diag(strain), shear])[: len(D)]
    return 0.5 * e @ D @ e


@pytest.mark.parametrize("name", INFLUENCES)
@pytest.mark.parametrize(("state", "nu"), CASES)
def test_energy_is_classical_under_any_strain(rng, state, nu, name):
    d = elastic.DIMENSIONS[state]
    omega = INFLUENCES[name](d)
    c = float(micromodulus(210e9, nu, state, d, jnp.asarray(DELTA), omega))
    A = rng.normal(size=(d, d))
    shear = np.zeros((d, d))
    if d > 1:
        shear[0, 1] = shear[1, 0] = 1.0
    for strain in (np.eye(d), np.diag(np.arange(d) + 1.0), shear, A + A.T):
        want = classical_energy(strain, 210e9, nu, state)
        got = nonlocal_energy(strain, c, omega, d)
        assert got == pytest.approx(want, rel=1e-11)  # measured 1e-13


def test_another_poisson_ratio_would_be_wrong_in_shear():
    """The negative control: the calibration meets dilation alone at nu = 0.2."""
    c = float(micromodulus(1.0, 0.2, "plane stress", 2, jnp.asarray(DELTA), Constant()))
    dilation, shear = np.eye(2), np.array([[0.0, 1.0], [1.0, 0.0]])
    energies = [
        nonlocal_energy(e, c, Constant(), 2)
        / classical_energy(e, 1.0, 0.2, "plane stress")
        for e in (dilation, shear)
    ]
    assert energies[0] == pytest.approx(1.0, rel=1e-9)
    assert abs(energies[1] - 1.0) > 0.1


def test_the_papers_equation_13_is_met():
    for alpha in (-3.0, 0.0, 1.9):
        for state, nu, k in (
            ("plane stress", 1 / 3, 30e9 / (2 * (1 - 1 / 3))),
            ("plane strain", 1 / 4, 30e9 / (2 * (1 - 1 / 4 - 2 / 16))),
        ):
            omega = Fractional(jnp.asarray(alpha), 2)
            got = micromodulus(30e9, nu, state, 2, jnp.asarray(DELTA), omega)
            want = 4 * k * (2 - alpha) / (np.pi * DELTA ** (2 - alpha))
            assert float(got) == pytest.approx(want, rel=1e-14)


@pytest.mark.parametrize("d", [1, 2, 3])
def test_moments_in_closed_form_agree_with_quadrature(d):
    for name in ("constant", "conical", "gaussian", "alpha -3"):
        omega = INFLUENCES[name](d)
        closed = float(moment(omega, d, jnp.asarray(DELTA)))
        numeric = float(moment(lambda r, omega=omega: omega(r), d, jnp.asarray(DELTA)))
        assert numeric == pytest.approx(closed, rel=1e-12)


def test_a_lattice_holds_the_energy_of_uniform_strain():
    """Bulk energy density of a lattice against theory: the error of its quadrature."""
    m, dx = 6, 0.05
    cloud = lattice((-0.6, -0.6), (0.6, 0.6), dx)
    family = find(cloud, m * dx, partial="continuous")
    X, nbr = np.asarray(cloud.X), np.asarray(family.nbr)
    i = int(np.argmin(np.abs(X).sum(axis=1)))
    xi = X[nbr[:, i]] - X[i]
    r = np.linalg.norm(xi, axis=1)
    beta = np.clip(m + 0.5 - r / dx, 0, 1)
    c = float(
        micromodulus(1.0, 1 / 3, "plane stress", 2, jnp.asarray(m * dx), Constant())
    )
    W = 0.25 * c * np.sum(beta * dx**2 * (0.01 * r) ** 2)
    classical = 1e-4 / (1 - 1 / 3)
    assert pytest.approx(classical, rel=0.02) == W


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: check_order(2.0), r"alpha: 2.0 must be a number below 2"),
        (lambda: elastic.check(-1.0, 0.3, "solid"), r"E: -1.0 must be positive"),
        (lambda: elastic.check(1.0, 0.5, "solid"), r"nu: 0.5 must lie between"),
        (lambda: elastic.check(1.0, 0.3, "shell"), r"state: 'shell' must be one of"),
        (
            lambda: elastic.check_bond_based(0.3, "plane stress"),
            r"nu: 0.3 is out of reach .* set nu=1/3",
        ),
        (
            lambda: elastic.check_bond_based(1 / 3, "solid"),
            r"fix Poisson's ratio at 1/4 in solid",
        ),
    ],
)
def test_bad_constants_are_refused_with_the_cure(call, words):
    with pytest.raises(ValueError, match=words):
        call()
