"""Bodies of kernels: patch tests, what a solution tells, solvers, paths, refusals."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, gradcheck

PASS = ("QCNI", "V2-MNI")
FIELDS = ("linear", "quadratic")


def relative(u, exact):
    return float(np.linalg.norm(u - exact) / np.linalg.norm(exact))


def missed(body, held, field, scheme):
    scene = gallery.patch(body, held, field, resolution=jaxpd.RKPM(scheme=scheme))
    solution = jaxpd.solve_static(scene).checked()
    return relative(solution.u, gallery.patch_exact(solution.X, field))


def plate(jitter, seed=3, shape=(9, 6)):
    size = jnp.array([2.0, 1.25])
    return jaxpd.mapped(shape, lambda s: size * s, jitter=jitter, seed=seed)


def test_the_default_passes_linear_and_quadratic_patch_tests():
    for jitter in (0.0, 0.15, 0.3, 0.45):
        for field in FIELDS:
            assert missed(plate(jitter), "l", field, "QCNI") < 1e-12
    assert missed(gallery.l_shape(4, jitter=0.3), "l", "quadratic", "QCNI") < 1e-12


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.parametrize("scheme", PASS)
@pytest.mark.parametrize("held", ["lrbt", "", "l", "lt"])
def test_patch_tests(scheme, held):
    """Dirichlet, Neumann and mixed; a corner that looks inwards."""
    bodies = [plate(j, seed=7) for j in (0.0, 0.15, 0.3, 0.45)]
    bodies += [gallery.l_shape(5, jitter=j, seed=2) for j in (0.0, 0.3)]
    for body in bodies:
        for field in FIELDS:
            assert missed(body, held, field, scheme) < 1e-12


def solved(scheme="QCNI", jitter=0.3, shape=(9, 5), **options):
    resolution = jaxpd.RKPM(scheme=scheme)
    scene = gallery.cantilever(shape, jitter=jitter, seed=1, resolution=resolution)
    return jaxpd.solve_static(scene, **options).checked()


def matrices(problem):
    """K by products with unit vectors, as a BSR matrix, by AD of the force."""
    operator = jax.jit(problem.operator)(problem.params)
    zero = jnp.zeros(problem.X.shape)
    K = operator.tangent(zero)
    n = zero.size
    unit = jnp.eye(n).reshape(n, *zero.shape)
    products = jax.jit(jax.vmap(K.mv))(unit).reshape(n, n).T
    by_ad = -jax.jit(jax.jacfwd(operator.respond))(zero).reshape(n, n)
    return products, jax.tree.map(np.asarray, K).to_bsr().toarray(), by_ad, K


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.parametrize(
    "scheme",
    ["QCNI"],
)
def test_tangents_agree_with_the_derivative_of_the_force(scheme):
    problem = jaxpd.prepare(
        gallery.cantilever((5, 4), jitter=0.3, resolution=jaxpd.RKPM(scheme=scheme))
    )
    products, bsr, by_ad, K = matrices(problem)
    size = np.abs(bsr).max()
    np.testing.assert_allclose(bsr, products, rtol=0, atol=1e-13 * size)
    np.testing.assert_allclose(by_ad, products, rtol=0, atol=1e-13 * size)
    far = np.abs(bsr - bsr.T).max() / size
    assert far < 1e-13 if K.symmetric else far > 1e-4
    assert K.symmetric == problem.layout.scheme.symmetric
    row, column, block = jax.jit(lambda K: K.coo())(K)  # on coefficients
    n, d = problem.X.shape
    full = np.zeros((n, d, n, d))
    np.add.at(full, (np.asarray(row), slice(None), np.asarray(column)), block)
    E = jax.tree.map(np.asarray, K.essential).matrix(n, d).toarray()
    full = E.T @ full.reshape(n * d, n * d) @ E
    np.testing.assert_allclose(full, bsr, rtol=0, atol=1e-13 * size)
    diagonal = jax.jit(lambda K: K.diagonal())(K)
    free = np.setdiff1d(np.arange(n), np.asarray(problem.layout.cover.nbr))
    assert not len(free)  # every node reaches a place
    assert np.trace(diagonal, axis1=1, axis2=2).min() > 0


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_forces_and_moments_balance_and_energy_is_half_the_work():
    solution = solved()
    X, R = np.asarray(solution.X), np.asarray(solution.reaction)
    assert R.sum(axis=0) == pytest.approx([0.0, 1.0], abs=1e-11)  # the load is -1
    moment = (X[:, 0] * R[:, 1] - X[:, 1] * R[:, 0]).sum()
    assert moment == pytest.approx(2.0, abs=1e-10)  # of the load about the left end
    problem = solution.problem
    tip = problem.operator(problem.params).loads[0]
    a = problem.operator(problem.params).essential.coefficients(solution.unknowns)
    work = float(jnp.sum(tip * a) + jnp.sum(solution.reaction * solution.unknowns))
    assert float(solution.energy.sum()) == pytest.approx(0.5 * work, rel=1e-11)
    assert float(problem.vol.sum()) == pytest.approx(2.0, rel=1e-13)
    assert float(solution.energy_density.min()) > 0


def test_what_is_asked_of_unknowns_is_that_of_a_linear_field():
    body = plate(0.3)
    problem = jaxpd.prepare(gallery.patch(body, "l", "linear"))
    unknowns, _ = problem.unknowns()
    stress = np.asarray(problem.stress(unknowns))
    exact = gallery.patch_stress(problem.places(), "linear")
    np.testing.assert_allclose(stress, exact, rtol=0, atol=1e-12)
    strain = np.asarray(problem.strain(unknowns))
    np.testing.assert_allclose(
        strain, np.broadcast_to([0.2, -0.25, 0.4], strain.shape), rtol=0, atol=1e-12
    )
    at = np.array([[0.3, 0.4], [1.99, 1.2], [2.0, 0.0]])
    u, slope = problem.at(at, unknowns)
    np.testing.assert_allclose(u, gallery.patch_exact(at, "linear"), atol=1e-13)
    exact = np.broadcast_to([[0.2, 0.3], [0.1, -0.25]], slope.shape)
    np.testing.assert_allclose(slope, exact, atol=1e-12)
    assert float(problem.rough(problem.solve()[0])) < 1e-12


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_solvers_agree():
    u = solved(solver="direct").u
    for solver in ("amg", "d-pcg", "gmres"):
        other = solved(solver=solver, rtol=1e-11)
        np.testing.assert_allclose(other.u, u, rtol=0, atol=1e-7 * np.abs(u).max())
    with pytest.raises(ValueError, match="symmetric tangents"):
        solved("V2-MNI", solver="amg")
    with pytest.raises(ValueError, match="lattices"):
        solved(solver="spectral")


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_a_modulus_of_every_node():
    scene = gallery.cantilever((5, 4), jitter=0.2)
    one = jaxpd.solve_static(scene).checked()
    field = jaxpd.Elastic(np.full(20, 1.0), 0.3, "plane stress")
    two = jaxpd.solve_static(dataclasses.replace(scene, material=field)).checked()
    np.testing.assert_allclose(two.u, one.u, rtol=0, atol=1e-12 * np.abs(one.u).max())
    at = np.asarray(one.X)[:, 0]
    stiff = jaxpd.Elastic(np.where(at > 1.0, 2.0, 1.0), 0.3, "plane stress")
    three = jaxpd.solve_static(dataclasses.replace(scene, material=stiff)).checked()
    far = at > 1.9  # less bent there, as much at the root
    assert np.abs(three.u[far, 1]).max() < 0.98 * np.abs(one.u[far, 1]).max()


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.parametrize("scheme", ["QCNI", "MNI"])
def test_taylor_slopes(scheme, rng):
    """Compliance along positions, modulus, Poisson's ratio, tractions, supports."""
    scene = gallery.cantilever(
        (6, 4), jitter=0.3, seed=4, resolution=jaxpd.RKPM(scheme=scheme)
    )
    problem = jaxpd.prepare(scene, rtol=1e-13)
    at = jax.tree.map(jnp.asarray, problem.params)
    still = jax.tree.map(jnp.zeros_like, at)
    law = still["law"]
    ways = {
        "E": still | {"law": dataclasses.replace(law, E=at["law"].E)},
        "nu": still | {"law": dataclasses.replace(law, nu=at["law"].nu)},
        "X": still | {"X": 0.05 * rng.normal(size=at["X"].shape)},
        "traction": still | {"traction": at["traction"]},
        "prescribed": still | {"prescribed": at["prescribed"]},
    }
    weights = rng.normal(size=at["X"].shape)

    def measure(params, problem, weights):
        u, _ = problem.solve(params)
        return jnp.sum(weights * u) + jnp.sum(u**2)

    for mode in ("forward", "reverse"):
        found = gradcheck.taylor(
            measure, at, ways, problem, jnp.asarray(weights), mode=mode
        )
        for name, test in found.items():
            assert test.right, f"{name}: {test}"


def test_steps_of_a_plastic_bar_are_exact():
    scene = gallery.plastic_bar(9, jitter=0.3, seed=1, resolution=jaxpd.RKPM())
    t = np.array([0.25, 0.6, 0.8, 1.0])
    path = jaxpd.solve_path(scene, t).checked()
    strain = 0.02 * t
    E, sigma_y = gallery.YOON[:2]
    elastic = strain < 0.01
    stress = np.where(
        elastic, E * strain, sigma_y + gallery.YOON_MODULUS * (strain - 0.01)
    )
    np.testing.assert_allclose(path.stress[:, :, 0] - stress[:, None], 0, atol=1e-6)
    exact = strain[:, None] * path.X[None, :, 0]
    np.testing.assert_allclose(path.u[:, :, 0], exact, rtol=0, atol=1e-13)
    end = path.reaction_on(jaxpd.below(x=0.0))[:, 0]
    np.testing.assert_allclose(-end, stress, rtol=1e-10)
    assert path.rough.max() < 1e-10


@pytest.mark.slow
@pytest.mark.usefixtures("compiled_quickly")
def test_a_plastic_ring_and_its_derivative(tmp_path):
    law = jaxpd.von_mises(2.1e5, 0.3, 240.0, 2e3, state="plane strain")
    scene = gallery.pressed_ring(
        (5, 9), 170.0, jitter=0.2, seed=2, law=law, resolution=jaxpd.RKPM()
    )
    times = [0.5, 0.8, 1.0]
    path = jaxpd.solve_path(scene, times, rtol=1e-12, folder=tmp_path).checked()
    assert path.peeq[-1].max() > 1e-4
    again = jaxpd.solve_path(scene, times, rtol=1e-12, folder=tmp_path).checked()
    np.testing.assert_array_equal(again.u, path.u)
    r = np.linalg.norm(path.X, axis=1)
    out = (path.u[-1] * path.X).sum(axis=1) / r
    bore = out[r < 1.001]
    assert np.ptp(bore) < 0.02 * bore.mean()  # round, whatever the nodes
    replay = path.replay()

    def bulge(params):
        return replay.solve(params)[0].u[-1, 0, 0]

    at = jax.tree.map(jnp.asarray, replay.params)
    slope = jax.grad(bulge)(at)
    for name, size in (("sigma_y", 1e-2), ("h_iso", 1.0)):

        def moved(t, name=name):
            hard = at["law"].hardening
            hard = dataclasses.replace(hard, **{name: getattr(hard, name) + t})
            law = dataclasses.replace(at["law"], hardening=hard)
            return float(bulge(at | {"law": law}))

        by_hand = (moved(size) - moved(-size)) / (2 * size)
        by_ad = float(getattr(slope["law"].hardening, name))
        assert by_ad == pytest.approx(by_hand, rel=1e-4)


BOX = jaxpd.box((0.0, 0.0), (1.0, 1.0))
SOFT = jaxpd.Elastic(1.0, 0.3, "plane stress")
LEFT = jaxpd.holds(jaxpd.below(x=0.0))


def refused(match, body=BOX, material=SOFT, resolution=None, call=None, **more):
    scene = jaxpd.Scene(
        body,
        material,
        supports=[LEFT],
        resolution=resolution or jaxpd.RKPM(dx=0.25),
        **more,
    )
    with pytest.raises(ValueError, match=match):
        (call or jaxpd.prepare)(scene)


def test_refusals():
    cut = [jaxpd.segment((0.4, 0.5), (0.6, 0.5))]
    refused("cracks", cracks=cut)
    refused("dx: None", resolution=jaxpd.RKPM())
    refused("bonds", call=lambda s: jaxpd.run_explicit(s, 1.0))
    law = jaxpd.von_mises(1.0, 0.3, 1e-3, state="plane stress")
    refused("stabilises linear", material=law, resolution=jaxpd.RKPM(0.25, "NIS"))
    refused("memory", material=law, call=jaxpd.solve_static)
    field = jaxpd.Elastic(np.ones(25), 0.3, "plane stress")
    body = jaxpd.mapped((5, 5), lambda s: s)
    refused("one modulus", body, field, jaxpd.RKPM(scheme="NSNI"))
    far = jaxpd.traction(jaxpd.box((3, 3), (4, 4)), x=1.0)
    refused("does nothing", loads=[far])
    refused("body_force", loads=[jaxpd.pull(jaxpd.above(x=1.0), x=1.0)])
    loose = jaxpd.from_points(body.X, 1 / 25)
    refused("outline", loose, resolution=jaxpd.RKPM())
    solid = jaxpd.Elastic(1.0, 0.3, "solid")
    refused("3-D", jaxpd.box((0, 0, 0), (1, 1, 1)), solid)
    for bad in ({"scheme": "XX"}, {"degree": 4}, {"support": 0.9}, {"alpha": -1.0}):
        with pytest.raises(ValueError, match=next(iter(bad))):
            jaxpd.RKPM(**bad)
    with pytest.raises(ValueError, match="second derivatives"):
        jaxpd.RKPM(scheme="NIS", degree=1)
