"""The front desk: what it builds, and what it refuses with which words."""

import dataclasses
from itertools import pairwise

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, prepare, solve_static
from jaxpd.physics import Fractional
from jaxpd.problem import first_system
from tests.catalogue import Hardening, LogStrain


def random_points():
    """Points in the unit square, with rows on its faces."""
    x = np.linspace(0.0, 1.0, 9)
    X = np.stack(np.meshgrid(x, x, indexing="ij"), axis=-1).reshape(-1, 2)
    inner = (X[:, 1] > 0) & (X[:, 1] < 1)
    X[inner] += np.random.default_rng(0).uniform(-0.02, 0.02, X[inner].shape)
    return jaxpd.from_points(X, 1 / 64)


def block(**changes):
    """A unit square held below and moved above."""
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (1.0, 1.0)),
        material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
        supports=[
            jaxpd.holds(jaxpd.below(y=0.0)),
            jaxpd.moves(jaxpd.above(y=1.0), y=0.01),
        ],
        resolution=jaxpd.Bonds(dx=0.125, m=3),
    )
    return dataclasses.replace(scene, **changes)


#: Four cracks that cut a square of points out of the block.
CORNERS = [(0.3, 0.3), (0.7, 0.3), (0.7, 0.7), (0.3, 0.7)]
ISLAND = [jaxpd.segment(a, b) for a, b in pairwise([*CORNERS, CORNERS[0]])]


@pytest.mark.parametrize(
    ("changes", "options", "words"),
    [
        ({"supports": ()}, {}, r"supports: 3 rigid-body mode\(s\) .* are left free"),
        (
            {"supports": [jaxpd.moves(jaxpd.below(y=0.0), y=0.0)]},
            {},
            r"supports: 1 rigid-body mode",
        ),
        ({"cracks": ISLAND}, {}, r"3 rigid-body mode.* of a piece of 9 points"),
        (
            {"material": jaxpd.Elastic(1.0, 0.3, "plane stress")},
            {},
            r"nu: 0.3 is out of reach of a bond-based law",
        ),
        (
            {"material": jaxpd.Elastic(1.0, 0.25, "solid")},
            {},
            r"state: 'solid' is 3-D and the body is 2-D",
        ),
        (
            {"supports": [jaxpd.moves(jaxpd.below(y=0), z=1.0)]},
            {},
            r"supports: z=1.0 does not exist in 2-D",
        ),
        (
            {"loads": [jaxpd.pull(jaxpd.box((0, 0, 0), (1, 1, 1)), x=1.0)]},
            {},
            r"lo: .* is a point in 3-D and the points are in 2-D",
        ),
        (
            {"cracks": [jaxpd.rectangle((0, 0, 0), (1, 0, 0), (0, 1, 0))]},
            {},
            r"cracks: .* is in 3-D and the points are in 2-D",
        ),
        (
            {"supports": [jaxpd.holds(jaxpd.above(y=7.0))]},
            {},
            r"supports: no point lies in",
        ),
        ({"loads": [jaxpd.pull(jaxpd.above(y=7.0))]}, {}, r"loads: no point of"),
        (
            {"loads": [jaxpd.body_force(jaxpd.above(y=0.0), y=lambda X: X[:, 0] / 0)]},
            {},
            r"loads: .* must be finite numbers",
        ),
        (
            {"supports": [jaxpd.holds(jaxpd.above(y=-9.0))]},
            {},
            r"supports: every displacement is prescribed",
        ),
        ({"resolution": jaxpd.Bonds(dx=0.125)}, {}, r"m: give exactly one of m"),
        ({"resolution": jaxpd.Bonds(dx=0.125, m=1)}, {}, r"m: 1 bonds no diagonal"),
        ({"resolution": jaxpd.Bonds(delta=0.3)}, {}, r"dx: None; a box needs"),
        ({"resolution": jaxpd.Bonds(dx=0.125, m=1)}, {}, r"m: 1 .* resists no shear"),
        ({}, {"solver": "magic"}, r"solver: 'magic' must be one of"),
        ({}, {"operator": "magic"}, r"operator: 'magic' must be one of"),
        ({}, {"operator": "fft"}, r"operator: 'fft' is for kinematics='small'"),
        (
            {"material": Hardening(np.ones(81))},
            {"operator": "stencil"},
            r"operator: 'stencil' is for laws with shared numbers",
        ),
        (
            {"body": random_points(), "resolution": jaxpd.Bonds(delta=0.3)},
            {"operator": "fft"},
            r"operator: 'fft' needs a lattice",
        ),
        (
            {},
            {"operator": "gather", "solver": "multigrid"},
            r"solver: 'spectral' and 'multigrid' are for lattices",
        ),
        ({}, {"tangent": "magic"}, r"tangent: 'magic' must be one of"),
        ({}, {"rtol": 0.0}, r"rtol: 0.0 must lie between"),
        ({}, {"load_steps": 0}, r"load_steps: 0 must be a whole number, at least 1"),
    ],
)
def test_bad_scenes_are_refused_with_the_cure(changes, options, words):
    with (
        np.errstate(all="ignore"),
        pytest.raises(ValueError, match=words),
    ):
        prepare(block(**changes), **options)


def test_scene_values_are_checked_where_they_are_given():
    with pytest.raises(ValueError, match="kinematics: 'large' must be"):
        block(kinematics="large")
    with pytest.raises(ValueError, match=r"x: nan must be a number, and finite"):
        jaxpd.moves(jaxpd.above(y=0), x=np.nan)
    with pytest.raises(ValueError, match="needs at least one of"):
        jaxpd.moves(jaxpd.above(y=0))
    with pytest.raises(ValueError, match="alpha: 2 must be a number below 2"):
        jaxpd.fractional(2)
    with pytest.raises(ValueError, match="ratio: 0 must be positive"):
        jaxpd.gaussian(0)
    with pytest.raises(ValueError, match=r"E: -3 must be positive"):
        jaxpd.Elastic(-3, 0.3)
    with pytest.raises(ValueError, match="n: 2 must be a whole number"):
        gallery.cracked_plate(2)
    with pytest.raises(ValueError, match="loading: 'wind' must be"):
        gallery.cracked_plate(16, loading="wind")


def test_words_and_bodies_are_checked_where_they_are_given():
    with pytest.raises(ValueError, match="body: 'plate' must be a box"):
        block(body="plate")
    with pytest.raises(ValueError, match="correction: 'some' must be"):
        jaxpd.Bonds(dx=0.125, m=3, correction="some")
    with pytest.raises(ValueError, match=r"m: 0.5 must be a number at least 1"):
        jaxpd.Bonds(dx=0.125, m=0.5)


def test_single_precision_is_refused_with_the_line_to_add():
    with (
        jax.enable_x64(False),
        pytest.raises(ValueError, match=r"rtol: 1e-06 .*jax_enable_x64', True"),
    ):
        prepare(block())


def test_layers_follow_the_half_spaces_that_touch_the_body():
    assert block().layers() == ((0, 0), (2, 0))  # rollers on top get none
    cells = block(resolution=jaxpd.Bonds(dx=0.125, m=3, nodes="cell"))
    assert cells.layers() == ((0, 0), (3, 0))
    own = block(resolution=jaxpd.Bonds(dx=0.125, m=3, layers=((1, 0), (0, 4))))
    assert own.layers() == ((1, 0), (0, 4))
    inside = block(supports=[jaxpd.holds(jaxpd.below(y=0.5))])
    assert inside.layers() == ((0, 0), (0, 0))


def test_components_left_out_stay_free():
    problem = prepare(block())
    X, fixed = np.asarray(problem.X), np.asarray(problem.fixed)
    top = X[:, 1] > 1 - 1e-9
    assert fixed[top, 1].all()
    assert not fixed[top, 0].any()
    assert fixed[X[:, 1] < 1e-9].all()
    np.testing.assert_array_equal(
        np.asarray(problem.params["prescribed"])[top, 1], 0.01
    )


def test_loads_are_densities_or_resultants():
    top = jaxpd.box((0, 0.9), (1, 2))
    hold = [jaxpd.holds(jaxpd.below(y=0.0))]
    scene = block(
        supports=hold, loads=[jaxpd.body_force(top, y=3.0, x=lambda X: X[:, 0])]
    )
    load = np.asarray(prepare(scene).params["load"])
    np.testing.assert_allclose(load[load[:, 1] > 0, 1], 3.0 / 64, rtol=1e-12)
    assert load[:, 0].sum() == pytest.approx(9 * 0.5 / 64, rel=1e-12)
    scene = block(supports=hold, loads=[jaxpd.pull(top, y=3.0)])
    resultant = np.asarray(prepare(scene).params["load"])
    np.testing.assert_allclose(resultant.sum(axis=0), [0.0, 3.0], rtol=1e-12)


def test_a_resultant_pulls_at_free_points_of_the_body_alone():
    everywhere = jaxpd.pull(jaxpd.above(x=0.0), x=1.0)
    scene = block(supports=[jaxpd.holds(jaxpd.below(y=0.0))], loads=[everywhere])
    problem = prepare(scene)
    load, fixed = np.asarray(problem.params["load"]), np.asarray(problem.fixed)
    assert load[~fixed].sum() == pytest.approx(1.0, rel=1e-12)
    np.testing.assert_array_equal(load[fixed], 0.0)
    held = block(loads=[jaxpd.pull(jaxpd.box((0, 0.99), (1, 1.01)), y=1.0)])
    with pytest.raises(ValueError, match="is held along y; nothing is left"):
        prepare(held)


def test_rollers_do_not_add_material():
    """Rollers get no layers; with layers that may slide, tension is too stiff."""
    scene = block(
        supports=[
            jaxpd.moves(jaxpd.below(x=0.0), x=0.0),
            jaxpd.moves(jaxpd.below(y=0.0), y=0.0),
            jaxpd.moves(jaxpd.above(y=1.0), y=1e-3),
        ],
    )
    assert scene.layers() == ((0, 0), (0, 0))
    loaded = dataclasses.replace(scene.resolution, layers=((2, 0), (0, 0)))
    thick = dataclasses.replace(scene, resolution=loaded)
    lean, fat = (
        solve_static(s).checked().reaction_on(jaxpd.above(y=1.0))[1]
        for s in (scene, thick)
    )
    # two columns more beside nine: the section that carries load grows by 2 / 9
    assert fat / lean == pytest.approx(11 / 9, rel=0.05)


def test_a_law_without_symmetry_is_not_given_to_cg():
    @jax.tree_util.register_dataclass
    @dataclasses.dataclass(frozen=True, eq=False)
    class Sideways:
        c: jax.Array

        def force(self, xi, eta):
            turned = jnp.stack([-eta[1], eta[0]])
            return self.c * (eta + 0.5 * turned)

    scene = block(material=Sideways(jnp.asarray(1.0)))
    with pytest.raises(ValueError, match="is for symmetric tangents"):
        solve_static(scene, solver="d-pcg")
    solution = solve_static(scene).checked()  # the automatic choice knows
    assert solution.problem.linear.method == "direct"
    assert prepare(block(material=Hardening(jnp.asarray(1.0)))).spec.symmetric


DIVERGENT = Fractional(jnp.asarray(2.5), 2)
GRID = jaxpd.lattice((0, 0), (1, 1), 0.125)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"material": 3.0}, r"material: 3.0 must be Elastic, Solid or a law"),
        ({"material": LogStrain(jnp.asarray(jnp.nan))}, r"material.c: .* a number"),
        ({"material": LogStrain(jnp.asarray(0.0))}, r"no positive stiffness"),
        (
            {"resolution": jaxpd.Bonds(dx=0.125, m=3, kernel=DIVERGENT)},
            r"kernel: the undeformed body has no positive stiffness",
        ),
        (
            {"body": GRID, "resolution": jaxpd.Bonds(dx=0.25, m=3)},
            r"dx: 0.25 is not the spacing 0.125",
        ),
    ],
)  # fmt: skip
def test_stiffness_and_spacing_are_checked_before_solving(changes, words):
    with pytest.raises(ValueError, match=words):
        prepare(block(**changes))


def test_reactions_balance_the_loads_and_hold_the_body():
    scene = block(
        supports=[jaxpd.holds(jaxpd.below(y=0.0))],
        loads=[jaxpd.pull(jaxpd.box((0, 0.99), (1, 1.1)), x=1e-4, y=2e-4)],
    )
    solution = solve_static(scene, rtol=1e-10).checked()
    support = solution.reaction_on(jaxpd.below(y=0.0))
    np.testing.assert_allclose(support, [-1e-4, -2e-4], rtol=1e-7)
    np.testing.assert_array_equal(
        solution.reaction[~np.asarray(solution.problem.fixed)], 0
    )


@pytest.mark.parametrize(
    "law", [LogStrain(jnp.asarray(3.0)), Hardening(jnp.asarray(3.0))]
)
def test_a_users_law_is_solved_like_any_other(law):
    solution = solve_static(block(material=law)).checked()
    assert solution.iterations <= 4
    assert np.isfinite(np.asarray(solution.energy)).all() == hasattr(law, "energy")
    assert solution.reaction_on(jaxpd.above(y=1.0))[1] > 0


def test_a_cloud_of_points_is_solved_like_a_lattice(rng):
    lattice = jaxpd.lattice((0, 0), (1, 1), 0.0625)
    X = np.asarray(lattice.X)
    inner = np.abs(X - 0.5).max(axis=1) < 0.4
    X = X + inner[:, None] * rng.uniform(-0.015, 0.015, X.shape)
    edge = [
        jaxpd.holds(jaxpd.below(y=0.15)),
        jaxpd.moves(jaxpd.above(y=0.85), x=0, y=0.01),
    ]
    bodies = {
        None: jaxpd.from_points(X, 0.0625**2),
        0.0625: jaxpd.box((0, 0), (1, 1)),
    }
    scenes = []
    for dx, body in bodies.items():
        bonds = jaxpd.Bonds(dx=dx, delta=0.25, correction="analytic")
        scenes.append(block(body=body, supports=edge, resolution=bonds))
    a, b = (solve_static(s, solver="amg").checked() for s in scenes)
    forces = [s.reaction_on(jaxpd.above(y=0.85))[1] for s in (a, b)]
    assert forces[0] == pytest.approx(forces[1], rel=0.02)  # positions moved by 1/4 dx
    assert max(a.linear_iterations) <= 10


@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.slow
def test_three_dimensions_and_a_penny_of_a_crack():
    scene = jaxpd.Scene(
        body=jaxpd.box((0, 0, 0), (1, 1, 1)),
        material=jaxpd.Elastic(1.0, 0.25),
        supports=[
            jaxpd.holds(jaxpd.below(z=0)),
            jaxpd.moves(jaxpd.above(z=1), x=0, y=0, z=0.01),
        ],
        cracks=[jaxpd.rectangle((-1, -1, 0.45), (3, 0, 0), (0, 1.5, 0))],
        resolution=jaxpd.Bonds(dx=0.125, m=2),
    )
    cracked = solve_static(scene, solver="amg").checked()
    whole = solve_static(dataclasses.replace(scene, cracks=()), solver="amg").checked()
    top = jaxpd.above(z=1)
    ratio = cracked.reaction_on(top)[2] / whole.reaction_on(top)[2]
    assert 0.3 < ratio < 0.9  # half the section is cut
    assert max(whole.linear_iterations) <= 10


def test_one_dimension_meets_the_closed_form():
    """A bar with an end load: the elongation F L / E A away from its ends."""
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0,), (1.0,)),
        material=jaxpd.Elastic(5.0, state="bar"),
        supports=[jaxpd.holds(jaxpd.below(x=0.0))],
        loads=[jaxpd.pull(jaxpd.box((0.98,), (1.1,)), x=1e-3)],
        resolution=jaxpd.Bonds(dx=0.01, m=3, partial="continuous"),
        kinematics="small",
    )
    solution = solve_static(scene).checked()
    X, u = np.asarray(solution.X)[:, 0], np.asarray(solution.u)[:, 0]
    middle = (X > 0.3) & (X < 0.7)
    slope = np.polyfit(X[middle], u[middle], 1)[0]
    # away from the ends the bar is exact: no quadrature error is left in 1-D
    assert slope == pytest.approx(1e-3 / 5.0, rel=1e-6)


def test_problem_is_a_pytree_whose_indices_are_arguments():
    problem = prepare(block())

    def size(scene):
        problem = prepare(scene, operator="gather")
        passed = jax.jit(lambda p: p.solve()[0]).lower(problem).as_text()
        closed = jax.jit(lambda: problem.solve()[0]).lower().as_text()
        return len(passed), len(closed)

    small, large = size(block()), size(block(resolution=jaxpd.Bonds(dx=1 / 32, m=3)))
    assert large[0] < 1.1 * small[0]  # no neighbour list became a constant
    assert large[1] > 1.5 * large[0]  # as they do where the problem is closed over
    floats = jax.tree.leaves(problem.params)
    assert all(jnp.issubdtype(leaf.dtype, jnp.floating) for leaf in floats)
    stiffer = problem.params | {"E": 2.0 * problem.params["E"]}
    solve = jax.jit(lambda p, q: p.solve(q)[0])
    u, u2 = (solve(problem, q) for q in (problem.params, stiffer))
    np.testing.assert_allclose(
        u, u2, rtol=0, atol=1e-9
    )  # prescribed motion: E drops out
    K, _, _ = first_system(problem)
    assert K.symmetric


@pytest.mark.slow
def test_what_each_correction_does_to_the_stiffness_of_a_bar():
    """Force over slope of a bar with E A = 1, held and pulled at its ends."""
    stiffness = {}
    for correction in ("lattice", "analytic", "none"):
        scene = jaxpd.Scene(
            body=jaxpd.box((0, 0), (2, 1)),
            material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
            supports=[
                jaxpd.holds(jaxpd.below(x=0.0)),
                jaxpd.moves(jaxpd.above(x=2.0), x=2e-3, y=0.0),
            ],
            resolution=jaxpd.Bonds(dx=1 / 40, m=3, correction=correction, nodes="cell"),
            kinematics="small",
        )
        solution = solve_static(scene).checked()
        X, u = np.asarray(solution.X), np.asarray(solution.u)
        middle = np.abs(X[:, 0] - 1.0) < 0.2
        slope = np.polyfit(X[middle, 0], u[middle, 0], 1)[0]
        pulled = solution.reaction_on(jaxpd.above(x=2.0))[0]
        stiffness[correction] = pulled / slope
    # measured 0.918, 1.010 and 0.886
    assert stiffness["lattice"] == pytest.approx(0.918, abs=0.005)
    assert stiffness["analytic"] == pytest.approx(1.010, abs=0.005)
    assert stiffness["none"] == pytest.approx(0.886, abs=0.005)
