import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.geometry import find, lattice, segment
from jaxpd.geometry.family import neighbourhood_volumes, partial_volumes
from jaxpd.operators import bond_weights

DELTA = jnp.asarray(0.375)


@pytest.fixture
def plate():
    cloud = lattice((-1.0, -1.0), (1.0, 1.0), 0.125)
    return cloud, find(cloud, 0.375, partial="linear")


def factors(cloud, family, V0, delta=DELTA):
    plain, scaled = (
        np.asarray(bond_weights(cloud.X, cloud.vol, family, delta, correction))
        for correction in ("none", V0)
    )
    return np.divide(scaled, plain, out=np.full_like(plain, np.nan), where=plain > 0)


def test_the_lattice_convention_leaves_the_interior_as_it_is(plate):
    cloud, family = plate
    G = factors(cloud, family, "lattice")
    inner = np.abs(np.asarray(cloud.X)).max(axis=1) <= 1 - 2 * 0.375
    np.testing.assert_allclose(G[:, inner], 1.0, rtol=1e-14)
    corner = np.argmin(np.asarray(cloud.X).sum(axis=1))
    assert np.nanmin(G[:, corner]) > 1.4  # a corner has about a quarter of a family
    assert np.nanmin(G) >= 1 - 1e-14


def test_the_analytic_convention_also_scales_the_interior():
    """Paper 002 at m = 4: V0 = pi delta^2 makes the interior stiffer by 8.9 %."""
    cloud = lattice((-1.0, -1.0), (1.0, 1.0), 0.125)
    family = find(cloud, 0.5, partial="linear")
    G = factors(cloud, family, "analytic", jnp.asarray(0.5))
    middle = np.argmin(np.abs(np.asarray(cloud.X)).sum(axis=1))
    near = G[np.asarray(family.present)[:, middle], middle]
    np.testing.assert_allclose(near, 1.08904, rtol=1e-5)


def test_a_crack_counts_as_a_surface():
    cloud = lattice((-1.0, -1.0), (1.0, 1.0), 0.125)
    crack = segment((-0.5, 0.0), (0.5, 0.0))
    family = find(cloud, 0.375, partial="linear", cracks=[crack])
    G = factors(cloud, family, "lattice")
    beta = partial_volumes(cloud.X, cloud.vol, family, DELTA)
    V = np.asarray(neighbourhood_volumes(cloud.vol, family, beta))
    X = np.asarray(cloud.X)
    face = np.argmin(np.linalg.norm(X - [0.0, 0.125], axis=1))
    middle = np.argmin(np.linalg.norm(X - [0.0, 0.5], axis=1))
    assert V[face] < 0.7 * V[middle]
    assert np.nanmin(G[:, face]) > 1.05


def test_an_unknown_convention_is_refused(plate):
    cloud, family = plate
    with pytest.raises(ValueError, match="V0: 'exact' must be 'lattice' or 'analytic'"):
        bond_weights(cloud.X, cloud.vol, family, DELTA, "exact")


def strip(correction, columns=9, rows=9, m=3, strain=1e-3, alpha=0.0, **parts):
    """A strip whose axial displacement is prescribed everywhere: free across."""
    dx = 0.02
    half = 0.5 * dx * np.array([columns - 1, rows - 1])
    body = jaxpd.box(tuple(-half), tuple(half))
    middle = jaxpd.box((-0.6 * dx, -0.6 * dx), (0.6 * dx, 0.6 * dx))
    return jaxpd.Scene(
        body=body,
        material=jaxpd.Elastic(2.0, nu=1 / 3, state="plane stress"),
        supports=[
            jaxpd.moves(body, x=lambda X: strain * X[:, 0]),
            jaxpd.moves(middle, y=0.0),
        ],
        resolution=jaxpd.Bonds(
            dx=dx, m=m, correction=correction, kernel=jaxpd.fractional(alpha)
        ),
        **{"kinematics": "small"} | parts,
    )


def section(correction):
    """Energy density of the rows of a long PMB strip at m = 4, over E strain^2 / 2."""
    scene = strip(correction, 41, 21, 4, alpha=-1.0)
    found = jaxpd.solve_static(scene, rtol=1e-7).checked()
    return np.asarray(found.energy_density).reshape(41, 21)[20] / 1e-6


def test_the_volume_method_in_a_strip_as_an_independent_code_has_it():
    """21 rows at m = 4 with "analytic" V0, from a study in NumPy and C of its own.

    There with finite strains at the crest of a wave: 4.12654 / 3.50444 at the row next
    to the outermost, 2.24818 / 3.21791 at the outermost without correction; measured
    here 1.17737 and 0.69848.
    """
    w = section("analytic")
    np.testing.assert_allclose(w[1] / w[10], 4.12654 / 3.50444, rtol=3e-4)
    plain = section("none")
    np.testing.assert_allclose(plain[0] / plain[10], 2.24818 / 3.21791, rtol=3e-4)
    np.testing.assert_allclose(plain[10] / w[10], 3.21791 / 3.50444, rtol=3e-4)


@jax.jit
def built(problem, u):
    operator, _, _ = problem.build(problem.params)
    return operator.energy_per_point(u), operator.respond(u), operator


@pytest.mark.parametrize(
    "correction", ["energy", pytest.param("force density", marks=pytest.mark.slow)]
)
def test_factors_by_axis_are_the_same_for_index_lists_and_on_a_lattice(rng, correction):
    crack = segment((-0.03, 0.01), (0.03, 0.01))
    scene = strip(correction, 9, 9, cracks=[crack])
    u = jnp.asarray(rng.normal(scale=1e-4, size=(81, 2)))
    found = {}
    for kind in ("stencil", "gather"):
        problem = jaxpd.prepare(scene, operator=kind, solver="d-pcg")
        found[kind] = built(problem, u)
    (energy, force, op), (energy2, force2, op2) = found.values()
    np.testing.assert_allclose(energy, energy2, rtol=1e-12)
    np.testing.assert_allclose(force, force2, rtol=0, atol=1e-12 * abs(force).max())
    W = np.zeros((81, 81))
    W[np.asarray(op2.nbr), np.arange(81)] = np.asarray(op2.weight)
    np.fill_diagonal(W, 0.0)
    np.testing.assert_allclose(W, W.T, rtol=1e-14)  # either end has the same factor
    assert float(op.scale.min()) > 0.5
    np.testing.assert_allclose(np.asarray(force).sum(axis=0), 0, atol=1e-16)


def test_the_energy_method_gives_the_bulk_its_classical_energy():
    """All points whose bonds lead to whole neighbourhoods alone, to round-off."""
    problem = jaxpd.prepare(strip("energy", 15, 15), solver="d-pcg")
    X, e = np.asarray(problem.X), 1e-6
    u = e * X * [1.0, 0.0]
    W = np.asarray(built(problem, u)[0]).reshape(15, 15)[7, 7] / 0.02**2
    # E / (1 - nu^2) / 2 at E = 2; the finite strain adds about e
    np.testing.assert_allclose(W / e**2, 9 / 8, rtol=5e-6)


def test_factors_do_not_depend_on_the_modulus_and_follow_the_spacing():
    problem = jaxpd.prepare(strip("energy"), solver="d-pcg")

    @jax.jit
    def scale(E, size):
        params = problem.params
        new = {"E": E, "dx": size * params["dx"], "delta": size * params["delta"]}
        return problem.build(params | new)[0].scale

    one = scale(2.0, 1.0)
    np.testing.assert_allclose(scale(7.0, 3.0), one, rtol=1e-12)
    _, slope = jax.jvp(lambda E: scale(E, 1.0), (2.0,), (1.0,))
    np.testing.assert_array_equal(slope, 0.0)


def test_corrections_by_axis_say_what_they_cannot_do():
    with pytest.raises(ValueError, match=r"operator: 'fft' .* use 'stencil' or"):
        jaxpd.prepare(strip("energy"), operator="fft")
    for solver in ("spectral", "multigrid"):
        with pytest.raises(ValueError, match="correction 'energy' makes each its own"):
            jaxpd.prepare(strip("energy"), solver=solver)
    with pytest.raises(ValueError, match=r"alpha: 1.5 must be below 1"):
        jaxpd.prepare(strip("force density", alpha=1.5))
    scene = strip("energy")
    law = jaxpd.physics.Microelastic(np.asarray(1.0), jaxpd.physics.Constant())
    with pytest.raises(ValueError, match="needs an Elastic material; use 'lattice'"):
        jaxpd.prepare(dataclasses.replace(scene, material=law))
    with pytest.raises(ValueError, match="correction: 'energies' must be one of"):
        jaxpd.prepare(strip("energies"))
