"""Slow fracture of brittle bonds: exact paths, load steps, solvers, replay."""

import dataclasses
import signal
import subprocess
import sys
import textwrap

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.fracture.breaking import Fracture, prepare_fracture
from jaxpd.fracture.growth import Unfinished
from jaxpd.fracture.live import DirectLive
from jaxpd.gradcheck import taylor
from jaxpd.operators import BondTangent
from jaxpd.operators.springs import SpringForce
from jaxpd.physics import pmb


def notched(W=16, a0=6, h=12, m=3, G0=1e-4, **more):
    """A plate with an edge notch, torn by rigid grips."""
    fields = {
        "material": jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress", G0=G0),
        "cracks": [jaxpd.segment((-1, 0), (a0, 0))],
        "supports": [
            jaxpd.moves(jaxpd.box((0, h - m), (W, h)), y=+0.5),
            jaxpd.moves(jaxpd.box((0, -h), (W, m - h)), y=-0.5),
            jaxpd.moves(jaxpd.box((W / 2 - 1, h - 1), (W / 2, h)), x=0.0),
        ],
        "no_fail": [
            jaxpd.box((0, h - m - 2), (W, h)),
            jaxpd.box((0, -h), (W, m + 2 - h)),
        ],
    }
    resolution = jaxpd.Bonds(
        dx=1.0,
        m=m,
        kernel=jaxpd.fractional(-1.0),
        nodes="cell",
        calibration="lattice",
    )
    body = jaxpd.box((0, -h), (W, h))
    return jaxpd.Scene(body=body, resolution=resolution, **(fields | more))


@pytest.fixture(scope="module")
def torn():
    """The exact path of the notched plate."""
    return jaxpd.solve_fracture(notched())


def test_springs_are_the_bonds_at_rest():
    """Stiffness of springs and of gathered bonds: the same products and matrices."""
    fracture = prepare_fracture(notched(W=8, a0=3, h=8))
    params = fracture.params
    bonds, springs = jax.jit(lambda f, p: (f.bonds(p), f.springs(p)))(fracture, params)
    n, d = fracture.X.shape
    u = jnp.asarray(np.random.default_rng(1).normal(size=(n, d)))
    K = bonds.tangent(jnp.zeros((n, d)))
    assert isinstance(K, BondTangent)
    mine = SpringForce(springs, jnp.ones(len(springs.k)), n)
    scale = float(jnp.abs(K.mv(u)).max())
    np.testing.assert_allclose(mine.respond(u), -K.mv(u), rtol=0, atol=1e-14 * scale)
    own, blocks = mine.tangent(u), K.diagonal()
    atol = 1e-14 * float(jnp.abs(blocks).max())
    np.testing.assert_allclose(own.diagonal(), blocks, rtol=0, atol=atol)
    host = jax.tree.map(np.asarray, own).to_bsr() - K.to_bsr()
    assert abs(host).max() <= atol


def test_the_exact_path_balances_and_ends_in_two_pieces(torn):
    """Work = stored + released to round-off; each event stands at the strength."""
    assert torn.checked().stopped.startswith("severed")
    assert np.abs(torn.balance).max() < 1e-12
    assert (np.diff(torn.factor) < 0).sum() > 20  # snap-backs are followed
    assert torn.force[-1] < 1e-6 * torn.force.max()
    np.testing.assert_allclose(torn.stored, 0.5 * torn.factor * torn.force, atol=1e-15)
    up = torn.reaction_on(jaxpd.above(y=0.0))[:, 1]
    down = torn.reaction_on(jaxpd.below(y=0.0))[:, 1]
    np.testing.assert_allclose(up, -down, atol=1e-15)
    np.testing.assert_allclose(up, torn.force, atol=1e-15)
    assert torn.damage(0).max() == 0.0
    assert torn.damage().max() > 0.3
    assert torn.damage(0, precracks=True).max() > 0.3
    # the grips move: the peak is that of the force, on the envelope
    assert torn.force[torn.peak] == torn.force[torn.envelope].max()
    jump = max(torn.jumps, key=lambda jump: jump["broken"])
    assert jump["surplus"] > 0.0
    assert jump["broken"] > 50


def test_events_are_those_of_dense_algebra():
    """The first twenty factors, each by a fresh dense solve and the worst bond."""
    scene = notched(W=8, a0=3, h=6, no_fail=())
    found = jaxpd.solve_fracture(scene, max_states=21)
    assert not found.done
    with pytest.raises(Unfinished, match="limit of 21 states"):
        found.checked()
    fracture = found.fracture
    s = found.springs
    s_crit = np.asarray(jax.jit(Fracture.critical)(fracture, fracture.params))
    n = len(found.X)
    B = s.differences(n).toarray()
    fixed = np.asarray(fracture.fixed).ravel()
    intact = ~np.asarray(fracture.cut)
    for k in range(1, 20):
        K = B.T @ (np.where(intact, s.k, 0.0)[:, None] * B)
        u = np.where(fixed, np.asarray(fracture.params["prescribed"]).ravel(), 0.0)
        u[~fixed] = np.linalg.solve(K[~fixed][:, ~fixed], -(K @ u)[~fixed])
        ratio = np.where(intact, B @ u / s.length / s_crit, 0.0)
        assert found.factor[k] == pytest.approx(1.0 / ratio.max(), rel=1e-9)
        intact &= ratio < ratio.max() * (1.0 - 1e-7)
        np.testing.assert_array_equal(intact, ~found.broken_by(k + 1))


@pytest.mark.parametrize("few", [None, 1])
def test_load_steps_agree_with_the_exact_path(torn, few):
    """Fine steps find the peak; passes balance too."""
    steps = jaxpd.solve_fracture(notched(), factors=0.005, few=few).checked()
    assert np.abs(steps.balance).max() < 1e-12
    peak = steps.force[steps.accepted].max()
    seen = torn.force[torn.envelope].max()  # what monotone loading sees
    assert seen * (1.0 - 1e-9) <= peak <= 1.02 * seen
    assert not steps.accepted.all()
    given = jaxpd.solve_fracture(notched(), factors=[0.03, 0.06], few=few)
    assert given.stopped == "all load steps are done"
    np.testing.assert_allclose(given.factor[given.accepted], [0.0, 0.03, 0.06])
    assert not given.broken.any()  # the first bond goes at 0.0656


@pytest.mark.parametrize(
    ("solver", "operator"),
    [
        ("d-pcg", "gather"),
        ("amg", "gather"),
        ("multigrid", "stencil"),
        ("multigrid", "fft"),
    ],
)
def test_the_path_does_not_depend_on_solver_and_operator(torn, solver, operator):
    scene = notched()
    found = jaxpd.solve_fracture(scene, solver=solver, operator=operator, max_states=60)
    np.testing.assert_allclose(found.factor, torn.factor[:60], rtol=1e-7)
    np.testing.assert_array_equal(found.broken_by(59), torn.broken_by(59))
    assert np.abs(found.balance).max() < 1e-8
    assert found.fallbacks["direct"] == 0


def test_the_path_does_not_depend_on_the_numbering(rng):
    """The same points in another order, with the same weights."""
    cloud = jaxpd.lattice(notched().body.lo, notched().body.hi, 1.0, nodes="cell")
    order = rng.permutation(cloud.n)
    X, vol = np.asarray(cloud.X), np.asarray(cloud.vol)
    free = dataclasses.replace(
        notched().resolution, dx=None, m=None, delta=3.0, calibration="continuum"
    )
    found = [
        jaxpd.solve_fracture(
            dataclasses.replace(
                notched(), body=jaxpd.from_points(X[at], vol[at]), resolution=free
            ),
            max_states=80,
        )
        for at in (np.arange(cloud.n), order)
    ]
    np.testing.assert_allclose(found[1].factor, found[0].factor, rtol=1e-9)
    np.testing.assert_allclose(found[1].damage(), found[0].damage()[order], atol=1e-12)


def test_strength_scales_with_the_root_of_the_fracture_energy(torn):
    double = jaxpd.solve_fracture(notched(G0=4e-4), max_states=50)
    np.testing.assert_allclose(double.factor, 2.0 * torn.factor[:50], rtol=1e-9)
    held = jaxpd.solve_fracture(notched(), toughness=4.0, max_states=50)
    np.testing.assert_allclose(held.factor, 0.5 * torn.factor[:50], rtol=1e-9)


def test_the_lattice_calibration_gives_bonds_between_rows_G0():
    """Five columns of a weak plane, two horizons away from the faces."""
    scene = notched(W=30, h=8, weak=[jaxpd.segment((-1, 0), (31, 0))])
    fracture = prepare_fracture(scene, "lattice")
    springs, s_crit = jax.tree.map(
        np.asarray,
        jax.jit(lambda f, p: (f.springs(p), f.critical(p)))(fracture, fracture.params),
    )
    X = np.asarray(fracture.X)
    x = 0.5 * (X[springs.i, 0] + X[springs.j, 0])
    held = np.asarray(fracture.may) & (x > 12.76) & (x < 17.76)
    energy = 0.5 * (springs.k * (springs.length * s_crit) ** 2)[held].sum() / 5.0
    assert energy == pytest.approx(1e-4, rel=1e-9)
    assert fracture.toughness == pytest.approx(0.947, abs=5e-4)


def test_a_loose_piece_is_held_without_force_and_a_loaded_one_ends_the_path():
    """A flap between two cracks comes off; dead loads tear a bar apart."""
    W, h = 14, 7
    flap = [
        jaxpd.segment((W - 4, -h - 1), (W - 4, 0.0)),
        jaxpd.segment((W - 4, 0.0), (W - 1, 0.0)),
    ]
    scene = notched(
        W=W,
        a0=4,
        h=h,
        cracks=[jaxpd.segment((-1, 0), (4, 0)), *flap],
        no_fail=(),
        supports=[
            jaxpd.moves(jaxpd.box((0, h - 2), (W - 4, h)), x=0.0, y=+0.5),
            jaxpd.moves(jaxpd.box((0, -h), (W - 4, 2 - h)), x=0.0, y=-0.5),
        ],
    )
    found = jaxpd.solve_fracture(scene)
    assert np.abs(found.balance).max() < 1e-9
    bar = notched(
        W=W,
        a0=4,
        h=h,
        no_fail=(),
        supports=[jaxpd.holds(jaxpd.box((0, -h), (W, 2 - h)))],
        loads=[jaxpd.pull(jaxpd.box((0, h - 2), (W, h)), y=1e-3)],
    )
    dead = jaxpd.solve_fracture(bar)
    assert dead.stopped.startswith(("torn", "severed"))
    assert np.abs(dead.balance).max() < 1e-9


def test_states_again_have_the_right_derivatives(torn):
    """Peak force and factor in E, a field of E, G0, nodes, volumes, supports."""
    replay = torn.replay([torn.peak, int(np.argmax(torn.force))])
    seen, info = replay.solve()
    assert int(info.status) == 0
    at = [torn.peak, int(np.argmax(torn.force))]
    np.testing.assert_allclose(seen.factor, torn.factor[at], rtol=1e-10)
    np.testing.assert_allclose(seen.force, torn.force[at], rtol=1e-9)
    np.testing.assert_allclose(seen.stretch, 1.0, rtol=1e-9)
    n = len(torn.X)
    params = jax.tree.map(jnp.asarray, replay.params) | {"E": jnp.ones(n)}
    rng = np.random.default_rng(3)
    nothing = jax.tree.map(jnp.zeros_like, params)
    directions = {
        name: nothing
        | {
            name: 0.1
            * jnp.abs(params[name]).max()
            * jnp.asarray(rng.uniform(0.0, 1.0, params[name].shape))
        }
        for name in ("E", "G0", "vol", "prescribed")
    } | {"X": nothing | {"X": 0.05 * jnp.asarray(rng.normal(size=(n, 2)))}}

    def force(params, replay):
        return replay.solve(params)[0].force[1]

    for name, found in taylor(force, params, directions, replay).items():
        assert abs(found.slope - 2.0) < 0.05, (name, found)


def test_fracture_energy_from_a_curve_of_load_and_opening(torn):
    """G0 of the envelope, measured with 1 % of noise, to 1 %."""
    rng = np.random.default_rng(5)
    replay = torn.replay()
    truth = torn.force[torn.envelope[1:]]
    data = truth * (1.0 + 0.01 * rng.normal(size=len(truth)))
    seen = jaxpd.observe.observation(data, _force, 0.01 * truth)
    start = {"G0": jaxpd.inverse.positive(3e-4)}
    found = jaxpd.fit(replay, start, seen).checked()
    assert float(found.values["G0"]) == pytest.approx(1e-4, rel=0.02)
    exact = jaxpd.fit(
        replay, start, jaxpd.observe.observation(truth, _force, 0.01 * truth)
    )
    assert float(exact.values["G0"]) == pytest.approx(1e-4, rel=1e-6)


def _force(problem, params, seen):
    return seen.force


def test_a_path_that_was_killed_goes_on_to_the_same_bits(torn, tmp_path):
    script = textwrap.dedent(
        f"""
        import os, signal, jax
        jax.config.update("jax_enable_x64", True)
        import jaxpd
        from tests.test_growth import notched
        from jaxpd import io

        kept, count = io.save_state, [0]

        def save(*args):
            kept(*args)
            count[0] += 1
            if count[0] == 2:
                os.kill(os.getpid(), signal.SIGKILL)

        io.save_state = save
        jaxpd.solve_fracture(notched(), folder={str(tmp_path / "path")!r})
        """
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    again = jaxpd.solve_fracture(notched(), folder=tmp_path / "path")
    whole = jaxpd.solve_fracture(notched(), folder=tmp_path / "other")
    for name in ("factor", "force", "released", "reaction", "broken_at", "u"):
        np.testing.assert_array_equal(getattr(again, name), getattr(whole, name))
    np.testing.assert_allclose(whole.factor, torn.factor, rtol=1e-9)
    with pytest.raises(ValueError, match="delete it or name another"):
        jaxpd.solve_fracture(notched(G0=2e-4), folder=tmp_path / "path")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"factors": [2.0, 1.0]}, "factors: .* must rise"),
        ({"few": 2}, "few: 2"),
        ({"ties": 0.0}, "ties: 0.0"),
        ({"solver": "lu"}, "solver: 'lu'"),
        ({"toughness": "tough"}, "toughness: 'tough'"),
        ({"toughness": -1.0}, "toughness: -1.0"),
        ({"max_states": 1}, "max_states: 1"),
        ({"severed": 2.0}, "severed: 2.0"),
        ({"watch": [jaxpd.above(y=99.0)]}, "watch: no point"),
    ],
)
def test_arguments_out_of_range_are_named(options, words):
    with pytest.raises(ValueError, match=words):
        jaxpd.solve_fracture(notched(W=8, a0=3, h=6), **options)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"material": jaxpd.Elastic(1.0, 1 / 3, "plane stress")}, "never breaks"),
        ({"starts": [jaxpd.initially(jaxpd.above(y=0.0), vy=1.0)]}, "starts"),
        ({"no_fail": [jaxpd.above(y=-99.0)]}, "no bond is left"),
        ({"no_fail": [jaxpd.above(y=99.0)]}, "no_fail: no point"),
        (
            {
                "cracks": [jaxpd.segment((-1, 0), (99, 0))],
                "supports": [
                    jaxpd.holds(jaxpd.above(y=5.0)),
                    jaxpd.moves(jaxpd.below(y=-5.0), y=-1.0),
                ],
            },
            "left free",
        ),
    ],
)
def test_scenes_that_cannot_break_slowly_are_refused(changes, words):
    with pytest.raises(ValueError, match=words):
        jaxpd.solve_fracture(notched(W=8, a0=3, h=8, **changes))


def test_other_doors_say_where_weak_surfaces_belong():
    scene = notched(W=8, a0=3, h=6, weak=[jaxpd.segment((-1, 0), (9, 0))], no_fail=())
    with pytest.raises(ValueError, match="solve_fracture"):
        jaxpd.solve_static(scene)
    moving = dataclasses.replace(
        scene, material=dataclasses.replace(scene.material, rho=1.0)
    )
    with pytest.raises(ValueError, match="weak: is for solve_fracture"):
        jaxpd.prepare_motion(moving)


def test_a_law_of_ones_own_breaks_at_its_critical_stretch():
    """A quadratic bond law without Poisson's ratio, of a scene with a Solid."""
    law = pmb(1.0, 1 / 3, "plane stress", 2, 3.0)
    own = jaxpd.Solid(law, rho=1.0, s_crit=0.01)
    bonds = dataclasses.replace(notched().resolution, calibration="continuum")
    found = jaxpd.solve_fracture(
        dataclasses.replace(notched(), material=own, resolution=bonds), max_states=20
    )
    assert found.broken.any()
    assert np.abs(found.balance).max() < 1e-12
    live = DirectLive(
        found.springs,
        np.asarray(found.fracture.fixed),
        np.asarray(found.fracture.params["prescribed"]),
        np.asarray(found.fracture.params["load"]),
        ~np.asarray(found.fracture.cut),
    )
    worst = found.springs.stretch(live.u)[~np.asarray(found.fracture.cut)].max()
    assert found.factor[1] * worst >= 0.01 * (1.0 - 1e-9)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Stiff:
    """A bond that resists across itself as it does along."""

    c: jax.Array

    def force(self, xi, eta):
        return self.c * eta / jnp.sqrt(xi @ xi)


def test_bonds_that_are_no_springs_are_refused():
    bonds = dataclasses.replace(notched().resolution, calibration="continuum")
    own = jaxpd.Solid(Stiff(np.asarray(1.0)), rho=1.0, s_crit=0.01)
    scene = dataclasses.replace(notched(), material=own, resolution=bonds)
    with pytest.raises(ValueError, match="resist across themselves"):
        jaxpd.solve_fracture(scene, max_states=3)


def test_bonds_without_weight_never_break():
    """The conical kernel is zero at the horizon, where the lattice has bonds."""
    bonds = dataclasses.replace(notched().resolution, kernel=jaxpd.conical())
    scene = dataclasses.replace(notched(), resolution=bonds)
    found = jaxpd.solve_fracture(scene, max_states=40)
    assert (found.springs.k == 0).any()
    assert (found.springs.k[found.broken] > 0).all()
    assert np.abs(found.balance).max() < 1e-12


@pytest.mark.parametrize("d", [1, 3])
def test_bars_and_solids_break_too(d):
    """A bar under its own ends; a notched block between clamps."""
    if d == 1:
        scene = jaxpd.Scene(
            body=jaxpd.box((0.0,), (30.0,)),
            material=jaxpd.Elastic(1.0, None, "bar", G0=1e-4),
            supports=[
                jaxpd.moves(jaxpd.below(x=0.0), x=0.0),
                jaxpd.moves(jaxpd.above(x=30.0), x=1.0),
            ],
            resolution=jaxpd.Bonds(dx=1.0, m=3),
        )
    else:
        scene = jaxpd.Scene(
            body=jaxpd.box((0, 0, 0), (5, 5, 16)),
            material=jaxpd.Elastic(1.0, 0.25, "solid", G0=1e-4),
            cracks=[jaxpd.rectangle((-1, -1, 8), (3, 0, 0), (0, 7, 0))],
            supports=[
                jaxpd.moves(jaxpd.below(z=2.0), x=0, y=0, z=0.0),
                jaxpd.moves(jaxpd.above(z=14.0), x=0, y=0, z=1.0),
            ],
            no_fail=[jaxpd.below(z=4.0), jaxpd.above(z=12.0)],
            resolution=jaxpd.Bonds(
                dx=1.0, m=2, kernel=jaxpd.fractional(-2.0), nodes="cell"
            ),
        )
    found = jaxpd.solve_fracture(scene).checked()
    assert found.stopped.startswith("severed")
    assert np.abs(found.balance).max() < 1e-12


def test_replay_is_the_derivative_of_whole_new_paths(rng):
    """Fields of E and G0 without symmetry: no ties, the same bonds break."""
    n = 16 * 24
    E, G0 = 1.0 + 0.2 * rng.random(n), 1e-4 * (1.0 + 0.1 * rng.random(n))
    along = rng.normal(size=n)

    def path(h):
        material = jaxpd.Elastic(E + h * along, 1 / 3, "plane stress", G0=G0)
        return jaxpd.solve_fracture(notched(material=material), max_states=12)

    middle, up, down = (path(h) for h in (0.0, 1e-6, -1e-6))
    replay = middle.replay([10])
    slope = jax.grad(lambda p: replay.solve(p)[0].force[0])(
        jax.tree.map(jnp.asarray, replay.params)
    )["E"]
    np.testing.assert_array_equal(up.broken_by(10), down.broken_by(10))
    found = (up.force[10] - down.force[10]) / 2e-6
    assert float(slope @ along) == pytest.approx(found, rel=1e-6)


@pytest.mark.parametrize("correction", ["lattice", "energy"])
def test_bodies_too_large_for_factors_are_iterated(correction, monkeypatch):
    """Bonds that are alike by multigrid; corrections that make each its own by AMG."""
    monkeypatch.setattr("jaxpd.fracture.solve.DIRECT", {2: 10})
    calibration = "lattice" if correction == "lattice" else "continuum"
    bonds = dataclasses.replace(
        notched().resolution, correction=correction, calibration=calibration
    )
    scene = dataclasses.replace(notched(), resolution=bonds)
    found = jaxpd.solve_fracture(scene, max_states=8)
    assert found.cost["iterations"].sum() > 0
    monkeypatch.setattr("jaxpd.fracture.solve.DIRECT", {2: 10**6})
    exact = jaxpd.solve_fracture(scene, max_states=8)
    assert exact.cost["iterations"].sum() == 0
    np.testing.assert_allclose(found.factor, exact.factor, rtol=1e-7)


def test_load_steps_that_were_given_have_an_envelope_and_their_last_state():
    """Each accepted factor once; the last displacements are in equilibrium."""
    factors = [0.03, 0.06, 0.07, 0.08]
    found = jaxpd.solve_fracture(notched(), factors=factors)
    np.testing.assert_allclose(found.factor[found.envelope], [0.0, *factors])
    assert all(jump["surplus"] > 0.0 for jump in found.jumps)
    for how in ({"max_states": 21}, {"factors": factors}, {"max_factor": 0.07}):
        found = jaxpd.solve_fracture(notched(), **how)
        s, intact = found.springs, ~found.broken_by()
        pull = s.force(np.where(intact, s.k * s.elongation(found.u), 0.0), len(found.u))
        pull[np.asarray(found.fracture.fixed)] = 0.0
        assert np.abs(pull).max() < 1e-10 * np.abs(found.reaction).max()


def test_a_largest_factor_is_reached_with_what_breaks_there():
    found = jaxpd.solve_fracture(notched(), factors=[0.05, 0.2], max_factor=0.075)
    assert found.done
    assert found.accepted[-1]
    assert found.factor[-1] == 0.075
    assert found.broken.sum() > 10


@pytest.mark.parametrize(
    "how", [{}, {"factors": 0.1}, {"factors": [0.1]}, {"softening": 10.0}]
)
def test_a_body_that_nothing_stretches_is_refused(how):
    still = [
        jaxpd.holds(jaxpd.box((0, 9), (16, 12))),
        jaxpd.holds(jaxpd.box((0, -12), (16, -9))),
    ]
    with pytest.raises(ValueError, match="nothing stretches a bond"):
        jaxpd.solve_fracture(notched(supports=still), **how)


def test_softening_bonds_unload_through_zero_and_load_again():
    found = jaxpd.solve_fracture(
        notched(), softening=10.0, factors=[0.04, -1e-3, 0.05]
    ).checked()
    assert found.stopped.startswith("load factor 0.05")
    assert np.abs(found.balance).max() < 1e-2


def test_hinges_that_cracks_leave_are_held_without_force():
    """A point on one bond alone, cut free by the cracks of the scene."""
    scene = notched(W=8, a0=3, h=8, no_fail=())
    fracture = prepare_fracture(scene)
    springs = jax.tree.map(
        np.asarray, jax.jit(Fracture.springs)(fracture, fracture.params)
    )
    n = len(fracture.X)
    point = int(np.argmin(np.abs(np.asarray(fracture.X) - [5.5, 3.5]).sum(axis=1)))
    mine = np.flatnonzero((springs.i == point) | (springs.j == point))
    intact = ~np.asarray(fracture.cut)
    intact[mine[1:]] = False
    args = [np.asarray(fracture.params[k]) for k in ("prescribed", "load")]
    live = DirectLive(springs, np.asarray(fracture.fixed), *args, intact)
    assert live.floppy[point]
    assert not live.torn
    pull = springs.force(
        np.where(intact, springs.k * springs.elongation(live.u), 0.0), n
    )
    pull[np.asarray(fracture.fixed)] = 0.0
    assert np.abs(pull).max() < 1e-9 * np.abs(springs.k * 1.0).max()


def test_a_body_that_moves_as_a_whole_is_refused():
    one = [jaxpd.moves(jaxpd.box((0, 9), (16, 12)), x=0.0, y=0.5)]
    with pytest.raises(ValueError, match="nothing stretches a bond"):
        jaxpd.solve_fracture(notched(supports=one))
