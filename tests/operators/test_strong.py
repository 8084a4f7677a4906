"""The strong form as an operator: tangents, patch tests, what it refuses."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.geometry import mapped
from jaxpd.operators import NavierForce, StrongForce
from tests import manufactured

STRETCH = {1: 1.0, 2: np.array([2.0, 1.0]), 3: np.array([1.0, 0.8, 0.6])}
SHAPE = {1: (12,), 2: (9, 6), 3: (5, 5, 4)}
STATE = {1: "bar", 2: "plane strain", 3: "solid"}


def body(d, jitter=0.3):
    size = jnp.asarray(STRETCH[d])
    return mapped(SHAPE[d], lambda s: s * size, jitter=jitter, seed=4)


def plastic(d, **more):
    nu = None if d == 1 else 0.3
    state = more.pop("state", STATE[d])
    return jaxpd.von_mises(200.0, nu, 1.0, 20.0, 10.0, state=state, **more)


def scene(d, law, scheme="auto", **more):
    held = jaxpd.below(x=0.0)
    return jaxpd.Scene(
        body(d),
        law,
        supports=[jaxpd.holds(held)],
        loads=[jaxpd.traction(jaxpd.above(x=float(np.ravel(STRETCH[d])[0])), x=1.0)],
        resolution=jaxpd.MLS(scheme=scheme, **more),
    )


@pytest.mark.parametrize(
    ("d", "scheme", "more"),
    [
        (1, "double", {}),
        (1, "midpoint", {}),
        (2, "double", {}),
        (2, "double", {"volume": "projected"}),
        (2, "direct", {}),
        (3, "double", {}),
    ],
)
def test_tangent_is_the_slope_of_the_force_and_the_matrix_is_the_tangent(
    d, scheme, more, rng
):
    law = plastic(d)
    if scheme == "direct":
        law = jaxpd.Elastic(200.0, 0.3, STATE[d])
    problem = jaxpd.prepare(scene(d, law, scheme, **more))

    @jax.jit
    def look(problem, params, u, v):
        op, _, _ = problem.build(params)
        K = op.tangent(u)
        slope = -jax.jvp(op.respond, (u,), (v,))[1]
        back = jax.linear_transpose(K.mv, u)(v)[0]
        return op, K, slope, K.mv(v), back, K.diagonal()

    X = np.asarray(problem.X)
    u, v = 0.02 * rng.normal(size=X.shape), rng.normal(size=X.shape)
    u = u + 0.02 * X  # well into plasticity
    op, K, slope, product, back, diagonal = look(problem, problem.params, u, v)
    assert isinstance(op, NavierForce if scheme == "direct" else StrongForce)
    assert (op.symmetric, op.unit) == (False, "N/m^3")
    size = np.abs(slope).max()
    np.testing.assert_allclose(product, slope, rtol=0, atol=1e-13 * size)
    matrix = jax.tree.map(np.asarray, K).to_bsr()
    np.testing.assert_allclose(matrix @ v.ravel(), np.ravel(product), atol=1e-13 * size)
    np.testing.assert_allclose(
        matrix.T @ v.ravel(), np.ravel(back), atol=1e-13 * np.abs(back).max()
    )
    free = ~np.asarray(problem.fixed).ravel()
    inner = matrix.toarray()[free][:, free]
    assert np.abs(inner - inner.T).max() > 0.05 * np.abs(inner).max()  # and says so
    blocks = [
        matrix.toarray()[d * i : d * i + d, d * i : d * i + d] for i in range(len(X))
    ]
    if not more and scheme != "double":
        np.testing.assert_allclose(diagonal, blocks, atol=1e-12 * np.abs(blocks).max())


@pytest.mark.parametrize(
    ("d", "scheme"), [(1, "midpoint"), (2, "double"), (3, "double")]
)
def test_a_body_moved_as_a_whole_has_no_stress_and_no_force(d, scheme, rng):
    problem = jaxpd.prepare(scene(d, plastic(d), scheme))
    X = np.asarray(problem.X)
    W = rng.normal(size=(d, d))
    u = 1e-3 * (rng.normal(size=d) + X @ (W - W.T))

    @jax.jit
    def force(problem, params, u):
        return problem.operator(params).respond(u)

    # round-off of differences: E / h^2 times that of u
    assert np.abs(force(problem, problem.params, u)).max() < 1e-9


@pytest.mark.parametrize(
    "solver", [pytest.param("gmres", marks=pytest.mark.slow), "bicgstab"]
)
def test_linear_solvers_for_what_is_not_symmetric_agree(solver):
    found = jaxpd.solve_static(
        scene(2, jaxpd.Elastic(200.0, 0.3, "plane strain")), solver=solver, rtol=1e-10
    ).checked()
    exact = jaxpd.solve_static(
        scene(2, jaxpd.Elastic(200.0, 0.3, "plane strain")), rtol=1e-10
    )
    assert np.abs(found.u - exact.u).max() < 1e-7 * np.abs(exact.u).max()


@pytest.mark.parametrize("solver", ["cg", "d-pcg", "amg", "multigrid"])
def test_solvers_for_symmetric_tangents_are_refused(solver):
    with pytest.raises(ValueError, match="strong form's is not; use 'direct'"):
        jaxpd.prepare(scene(2, plastic(2)), solver=solver)


@pytest.mark.parametrize(
    "scheme", ["double", pytest.param("direct", marks=pytest.mark.slow)]
)
def test_elasticity_is_of_second_order_with_tractions_and_body_forces(scheme):
    errors = []
    for n in (13, 25):
        off, exact = manufactured.off(jaxpd.MLS(scheme=scheme), n, jitter=0.3, seed=1)
        errors.append(np.linalg.norm(off) / np.linalg.norm(exact))
    assert np.log2(errors[0] / errors[1]) > 1.7  # 1.97 and 1.9 measured
    assert errors[1] < 0.05


def test_a_law_of_each_node_and_a_bar_under_its_weight():
    """Midpoints: E u'' = -b with E(x), by the closed form, of second order."""
    errors = []
    for n in (21, 41):
        nodes = mapped((n,), lambda s: s)
        x = np.asarray(nodes.X)[:, 0]
        law = jaxpd.Elastic(10.0 * np.exp(x), None, "bar")
        found = jaxpd.solve_static(
            jaxpd.Scene(
                nodes,
                law,
                supports=[jaxpd.moves(jaxpd.below(x=0.0), x=0.0)],
                loads=[
                    jaxpd.body_force(jaxpd.box((-1,), (2,)), x=3.0),
                    jaxpd.traction(jaxpd.above(x=1.0), x=2.0),
                ],
                resolution=jaxpd.MLS(),
            )
        ).checked()
        # sigma = 2 + 3 (1 - x), u' = sigma / (10 e^x)
        exact = (2.0 - (2.0 - 3.0 * x) * np.exp(-x)) / 10.0
        errors.append(np.abs(found.u[:, 0] - exact).max() / exact.max())
        assert found.reaction[0, 0] == pytest.approx(-5.0, rel=1e-10)  # conservative
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_a_pressure_on_a_face_leaves_the_faces_beside_it_alone():
    square = mapped((7, 7), lambda s: s)
    sides = [
        jaxpd.moves(jaxpd.below(x=0.0), x=0.0),
        jaxpd.moves(jaxpd.below(y=0.0), y=0.0),
    ]

    def solve(supports, *loads):
        return jaxpd.solve_static(
            jaxpd.Scene(
                square,
                jaxpd.Elastic(1e6, 0.3, "plane strain"),
                supports=supports,
                loads=loads,
                resolution=jaxpd.MLS(),
            )
        ).checked()

    top, right = jaxpd.above(y=1.0), jaxpd.above(x=1.0)
    found = solve(sides, jaxpd.pressure(top, 100.0))
    stress = np.asarray(found.problem.stress(found.u))
    np.testing.assert_allclose(stress, np.tile([0, -100.0, 0], (49, 1)), atol=1e-9)
    np.testing.assert_allclose(
        found.reaction_on(jaxpd.below(y=0.0))[1], 100.0, rtol=1e-10
    )
    found = solve(sides, jaxpd.pressure(jaxpd.union(top, right), 5.0))
    stress = np.asarray(found.problem.stress(found.u))
    np.testing.assert_allclose(stress, np.tile([-5.0, -5.0, 0], (49, 1)), atol=1e-10)
    # what a load puts on a held node is no reaction of the other nodes
    clamped = solve([jaxpd.holds(jaxpd.below(x=0.0))], jaxpd.traction(top, x=100.0))
    assert clamped.reaction[:, 0].sum() == pytest.approx(-100.0, rel=0.04)


def test_scenes_that_nodes_cannot_have_are_refused_with_their_cure():
    good = scene(2, plastic(2))

    def refused(match, **change):
        with pytest.raises(ValueError, match=match):
            jaxpd.prepare(dataclasses.replace(good, **change))

    whole = body(2).rim
    parts = (whole.node, whole.normal, whole.area)
    half = jaxpd.geometry.rim(*(np.asarray(x)[:9] for x in parts))
    bare = jaxpd.from_points(np.asarray(body(2).X), 0.01)
    refused("no rim", body=bare)
    refused("cracks", cracks=[jaxpd.segment((0.1, 0.1), (0.5, 0.1))])
    refused("'solid' is 3-D", material=plastic(3))
    refused("must be Elastic, Solid or a law", material=object())
    refused(r"use body_force", loads=[jaxpd.pull(jaxpd.above(x=2.0), x=1.0)])
    refused("does nothing", loads=[jaxpd.pressure(jaxpd.ball((9.0, 9.0), 0.1), 1.0)])
    refused("does nothing", loads=[jaxpd.body_force(jaxpd.above(x=2.0), x=1.0)])
    refused("leave .* open", body=jaxpd.from_points(body(2).X, 0.01, half))
    refused("G0", material=jaxpd.Elastic(1.0, 0.3, "plane strain", G0=1.0))
    refused("shape", material=jaxpd.Elastic(np.ones(3), 0.3, "plane strain"))
    refused("rigid-body", supports=[jaxpd.moves(jaxpd.below(x=0.0), x=0.0)])
    refused("dx: None", body=jaxpd.box((0, 0), (1, 1)))
    refused(
        r"dx: 0\.1 .* no lattice; leave dx out, .* or give a box",
        resolution=jaxpd.MLS(dx=0.1),
    )
    square = jaxpd.lattice((0, 0), (2, 1), 0.125)
    refused(
        r"dx: 0\.1 .* a lattice of 0\.125", body=square, resolution=jaxpd.MLS(dx=0.1)
    )
    refused("'midpoint' is for bars", resolution=jaxpd.MLS(scheme="midpoint"))
    refused("'direct' has no stress", resolution=jaxpd.MLS(scheme="direct"))
    with pytest.raises(ValueError, match="scheme: 'triple'"):
        jaxpd.MLS(scheme="triple")
    with pytest.raises(ValueError, match="tau"):
        jaxpd.MLS(tau=-1.0)
    with pytest.raises(ValueError, match="pressure needs a rim"):
        jaxpd.prepare(
            jaxpd.Scene(
                jaxpd.box((0, 0), (1, 1)),
                jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
                supports=[jaxpd.holds(jaxpd.below(x=0.0))],
                loads=[jaxpd.pressure(jaxpd.above(x=1.0), 1.0)],
                resolution=jaxpd.Bonds(dx=0.1, m=3),
            )
        )
