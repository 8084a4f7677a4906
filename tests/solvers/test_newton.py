"""Newton's method: rates, prescribed motion, fallbacks, and honest failures."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import Status, gallery, solve_static

pytestmark = pytest.mark.usefixtures("compiled_quickly")


def plate(**options):
    return gallery.cracked_plate(16, 4, 0.0, **options)


@pytest.mark.parametrize("strain", [1e-3, 1e-2, -1e-2])
@pytest.mark.parametrize("tangent", ["ad", "axial"])
def test_two_to_three_steps_up_to_one_per_cent(strain, tangent):
    solution = solve_static(plate(strain=strain), tangent=tangent).checked()
    assert 2 <= solution.iterations <= 3
    assert solution.residuals[-1] <= 1e-6


def test_exact_tangents_converge_quadratically_and_the_axial_one_linearly():
    tight = {"rtol": 1e-12, "linear_rtol": 1e-13}
    strain = 0.02
    ad, hand, axial = (
        solve_static(plate(strain=strain), tangent=how, **tight).checked()
        for how in ("ad", "hand", "axial")
    )
    r = ad.residuals
    # r_{k+1} <= C r_k^2 with C of order one in relative residuals
    assert ad.iterations <= 4
    assert r[1] <= 2.0 * r[0] ** 2
    np.testing.assert_allclose(hand.u, ad.u, rtol=0, atol=1e-13)
    # eq. 20 leaves out the geometric part: a factor of about twice the strain a step
    factors = axial.residuals[3:-1] / axial.residuals[2:-2]
    assert axial.iterations > 2 * ad.iterations
    assert (factors < 3.0 * strain).all()
    assert (factors > 1.5 * strain).all()
    np.testing.assert_allclose(axial.u, ad.u, rtol=0, atol=1e-10 * abs(ad.u).max())


@pytest.mark.slow
def test_load_steps_arrive_at_the_same_equilibrium():
    one = solve_static(plate(strain=0.02), rtol=1e-10).checked()
    four = solve_static(plate(strain=0.02), rtol=1e-10, load_steps=4).checked()
    np.testing.assert_allclose(four.u, one.u, rtol=0, atol=1e-9 * abs(one.u).max())
    loads = np.asarray(four.info.loads)[: four.iterations]
    assert sorted(set(loads.tolist())) == [0.25, 0.5, 0.75, 1.0]
    assert float(four.info.load_factor) == 1.0


def test_small_displacements_are_one_linear_solve():
    scene = plate(strain=0.02, kinematics="small")
    solution = solve_static(scene).checked()
    assert solution.iterations == 1
    finite = solve_static(plate(strain=1e-7, kinematics="finite")).checked()
    ratio = np.asarray(solution.u) / 0.02 - np.asarray(finite.u) / 1e-7
    assert np.abs(ratio).max() <= 1e-5  # of a displacement of 0.5 a unit strain


@pytest.mark.slow
def test_too_few_iterations_are_rescued_by_halving_the_load_step():
    hard = solve_static(plate(strain=0.3), max_iterations=3)
    easy = solve_static(plate(strain=0.3), max_iterations=30).checked()
    hard.checked()
    assert int(hard.info.halvings) >= 1
    np.testing.assert_allclose(hard.u, easy.u, rtol=0, atol=1e-6 * abs(easy.u).max())


def column(strain, tangent="ad"):
    """A slender column: it buckles, the exact tangent loses definiteness."""
    scene = jaxpd.Scene(
        body=jaxpd.box((-0.05, 0.0), (0.05, 1.0)),
        material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
        supports=[
            jaxpd.holds(jaxpd.below(y=0.0)),
            jaxpd.moves(jaxpd.above(y=1.0), y=-strain),
        ],
        # a small side load makes the buckle choose
        loads=[jaxpd.body_force(jaxpd.above(y=0.5), x=1e-6)],
        resolution=jaxpd.Bonds(dx=0.05, m=3),
    )
    return solve_static(scene, tangent=tangent)


def test_buckling_is_reported_as_negative_curvature():
    solution = column(0.05)
    assert solution.status is Status.NEGATIVE_CURVATURE
    assert 0.0 < float(solution.info.load_factor) < 1.0
    with pytest.raises(jaxpd.NotConverged, match=r"NEGATIVE_CURVATURE .* buckled") as e:
        solution.checked()
    assert e.value.status is Status.NEGATIVE_CURVATURE
    assert len(e.value.residuals) == solution.iterations


def test_a_law_undefined_at_its_strain_says_so():
    @jax.tree_util.register_dataclass
    @dataclasses.dataclass(frozen=True, eq=False)
    class Fragile:
        c: object

        def energy(self, xi, eta):
            s = jaxpd.physics.stretch(xi, eta)
            return -self.c * jnp.sqrt(1.0 - (s / 1e-3) ** 2)  # locks at 0.1 %

    scene = dataclasses.replace(plate(strain=0.01), material=Fragile(jnp.asarray(1.0)))
    solution = solve_static(scene)
    assert solution.status in (Status.NOT_FINITE, Status.STEP_TOO_SMALL)
    with pytest.raises(jaxpd.NotConverged, match="load factor 0"):
        solution.checked()


def test_linear_failures_are_not_hidden():
    solution = solve_static(plate(), linear_maxiter=3)
    assert solution.status is Status.MAX_ITERATIONS
    with pytest.raises(jaxpd.NotConverged, match="raise it"):
        solution.checked()
