"""Where explicit runs fail, or used to: each failure shown to be kept out."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.launch import longest_dt
from jaxpd.motion import Motion
from jaxpd.solvers.explicit import largest_dt

UNIT = jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress", rho=1.0)


def sheet(material=UNIT, m=2.0, **more):
    return jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (1.0, 0.5)),
        material=material,
        resolution=jaxpd.Bonds(dx=0.1, m=m, correction="none", nodes="cell"),
        **more,
    )


def breakable(G0=1e-6):
    return dataclasses.replace(UNIT, G0=G0)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class ForceAlone:
    """A law without an energy: springs of the first neighbours push, others pull."""

    first: jax.Array
    second: jax.Array

    def force(self, xi, eta):
        r2 = xi @ xi
        k = jnp.where(r2 < 0.15**2, self.first, self.second)
        return k * (xi @ eta) / r2 * xi


def test_a_body_at_rest_stays_at_rest_in_float32():
    motion = jaxpd.prepare_motion(sheet(breakable()), dtype="float32")
    run = jaxpd.run_explicit(motion, 100.0, records=2).checked()
    assert run.steps > 1000
    assert np.abs(run.u).max() == 0.0
    assert run.damage().max() == 0.0


def test_bonds_break_at_their_critical_stretch_in_float32():
    # strains of 1e-6: the difference of lengths has no digits left in float32
    motion = jaxpd.prepare_motion(sheet(breakable(1e-12)), dtype="float32")
    op, _ = jax.jit(Motion.build)(motion, motion.params)
    X = jnp.asarray(motion.X, jnp.float32)
    commit = jax.jit(lambda op, u, bits: op.commit(op.lay(u), bits)[1])
    for factor, whole in ((0.9999, True), (1.0001, False)):
        bits = commit(op, X * (op.s_crit * factor), motion.begin)
        assert bool((bits == motion.begin).all()) == whole


def test_derivatives_are_finite_when_a_body_has_flown_by_its_spacing():
    flying = sheet(starts=[jaxpd.initially(jaxpd.above(x=-1.0), vx=0.1)])
    motion = jaxpd.prepare_motion(flying)

    @jax.jit
    def slope(params, motion):
        def end(params):
            return jnp.sum(motion.march(params, dt=0.05, every=10, records=2)[0] ** 2)

        return jax.grad(end)(params)

    found = slope(jax.tree.map(jnp.asarray, motion.params), motion)
    for name, gradient in found.items():
        assert np.isfinite(gradient).all(), name
    assert np.abs(found["v0"]).max() > 0


@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.slow
def test_zones_without_failure_hold_for_own_laws_too():
    law = jaxpd.physics.pmb(1.0, 1 / 3, "plane stress", 2, 0.2)
    torn = [jaxpd.initially(jaxpd.above(x=0.5), vx=0.05)]
    solid = jaxpd.Solid(law, rho=1.0, s_crit=1e-2)
    free = jaxpd.run_explicit(sheet(solid, starts=torn), 2.0, records=4)
    held = sheet(solid, starts=torn, no_fail=[jaxpd.above(x=-1.0)])
    assert free.damage().max() > 0.1
    assert jaxpd.run_explicit(held, 2.0, records=4).damage().max() == 0.0
    brittle = jaxpd.Solid(jaxpd.physics.damage.Brittle(law, jnp.asarray(1.0)), rho=1.0)
    with pytest.raises(ValueError, match="no_fail"):
        jaxpd.prepare_motion(dataclasses.replace(held, material=brittle))
    with pytest.raises(ValueError, match="no_fail: no point"):
        jaxpd.prepare_motion(sheet(breakable(), no_fail=[jaxpd.above(x=9.0)]))
    # the smoothed law in a zone that cannot fail costs nothing, and says so
    soft = jaxpd.prepare_motion(
        dataclasses.replace(held, material=breakable()), softening=0.3
    )
    run = jaxpd.run_explicit(soft, 1.0, records=2)
    np.testing.assert_array_equal(run.released, 0.0)


@pytest.mark.slow
def test_a_run_that_was_stopped_stays_stopped(tmp_path):
    motion = jaxpd.prepare_motion(
        sheet(starts=[jaxpd.initially(jaxpd.above(x=0.5), vx=0.01)])
    )
    dt = 1.3 * longest_dt(motion)
    options = {"dt": dt, "records": 20, "unstable_dt": True, "folder": tmp_path / "run"}
    first = jaxpd.run_explicit(motion, 2000 * dt, **options)
    again = jaxpd.run_explicit(motion, 2000 * dt, **options)
    assert first.stopped == again.stopped is not None
    assert first.steps == again.steps < 2000
    with pytest.raises(jaxpd.Diverged):
        again.checked()


@pytest.mark.slow
def test_a_law_by_its_force_alone_runs_without_a_balance():
    law = ForceAlone(jnp.asarray(100.0), jnp.asarray(50.0))
    start = [jaxpd.initially(jaxpd.above(x=0.5), vx=0.01)]
    run = jaxpd.run_explicit(
        sheet(jaxpd.Solid(law, rho=1.0, s_crit=1e-3), starts=start), 1.0, records=4
    ).checked()
    assert np.isnan(run.balance).all()
    assert run.kinetic[-1] > 0
    assert run.damage().max() > 0


@pytest.mark.slow
def test_the_stable_step_holds_where_some_bonds_push():
    law = ForceAlone(jnp.asarray(100.0), jnp.asarray(-20.0))
    motion = jaxpd.prepare_motion(sheet(jaxpd.Solid(law, rho=1.0)))
    op, drive = jax.jit(Motion.build)(motion, motion.params)
    ratio = longest_dt(motion) / largest_dt(op.plain(), drive, motion.begin)
    assert 0.5 < ratio <= 1.0


@pytest.mark.slow
def test_the_swing_of_verlets_energy_is_no_alarm():
    chain = jaxpd.gallery.bar_wave(n=40, m=1)
    zigzag = jaxpd.initially(
        jaxpd.above(x=-1.0), vx=lambda X: 1e-3 * (-1.0) ** np.arange(len(X))
    )
    chain = dataclasses.replace(chain, starts=[zigzag])
    motion = jaxpd.prepare_motion(chain)
    dt = 0.8 * longest_dt(motion)
    run = jaxpd.run_explicit(motion, 50 * dt, dt=dt, records=50).checked()
    assert np.abs(run.balance).max() > 0.2  # it does swing


@pytest.mark.slow
def test_a_point_that_cracks_cut_loose_is_not_damaged():
    around = [(0.2, 0.2), (0.3, 0.2), (0.3, 0.3), (0.2, 0.3)]
    ends = zip(around, [*around[1:], around[0]], strict=True)
    cracks = [jaxpd.segment(a, b) for a, b in ends]
    run = jaxpd.run_explicit(sheet(breakable(), m=1.5, cracks=cracks), 0.2, records=1)
    assert run.damage0.max() == 1.0
    assert run.damage().max() == 0.0
    block = jaxpd.lattice((0, 0, 0), (1, 1, 1), 0.25)
    wrong = jaxpd.Scene(
        body=jaxpd.from_points(block.X, block.vol),
        material=jaxpd.Elastic(1.0, nu=1 / 4, rho=1.0),
        cracks=cracks[:1],
        resolution=jaxpd.Bonds(delta=0.4),
    )
    with pytest.raises(ValueError, match=r"2-D and the points are in 3-D"):
        jaxpd.prepare_motion(wrong)


@pytest.mark.slow
def test_float32_follows_prescribed_motion_over_many_steps():
    bar = dataclasses.replace(
        jaxpd.gallery.bar_wave(20, 2),
        starts=(),
        supports=[
            jaxpd.holds(jaxpd.below(x=-0.45)),
            jaxpd.moves(jaxpd.above(x=0.45), x=1e-3, time=jaxpd.ramp(300.0)),
        ],
    )
    motion = jaxpd.prepare_motion(bar, dtype="float32")
    run = jaxpd.run_explicit(motion, 300.0, records=20).checked()
    assert run.steps > 5000
    end = np.asarray(motion.X)[:, 0] > 0.45
    np.testing.assert_allclose(run.u[end, 0], 1e-3, rtol=1e-6)
    assert np.abs(run.balance).max() < 1e-2


def test_relaxation_of_nonsense_does_not_converge():
    scene = sheet(
        supports=[
            jaxpd.holds(jaxpd.below(x=0.1)),
            jaxpd.moves(jaxpd.above(x=0.9), x=0.01),
        ]
    )
    motion = jaxpd.prepare_motion(scene)
    bad = dataclasses.replace(motion, params=motion.params | {"E": np.asarray(np.nan)})
    with pytest.raises(jaxpd.NotConverged):
        jaxpd.solve_relaxed(bad).checked()
    with pytest.raises(ValueError, match="nonsense"):
        jaxpd.solve_relaxed(motion, nonsense=1)
    with pytest.raises(ValueError, match="E: shape"):
        jax.jit(Motion.build)(motion, motion.params | {"E": np.ones(7)})
    with pytest.raises(ValueError, match="dt: a traced number"):
        jax.jit(lambda dt: motion.march(dt=dt, every=1, records=1)[0])(0.1)


@pytest.mark.slow
def test_relaxation_breaks_no_bond_on_the_way():
    aluminium = jaxpd.Elastic(70e9, nu=1 / 3, state="plane stress", rho=2700.0, G0=1e4)
    scene = jaxpd.Scene(
        body=jaxpd.box((-0.05, -0.05), (0.05, 0.05)),
        material=aluminium,
        supports=[
            jaxpd.holds(jaxpd.below(y=-0.05)),
            jaxpd.moves(jaxpd.above(y=0.05), x=0.0, y=1e-4),
        ],
        resolution=jaxpd.Bonds(dx=0.1 / 16, m=3, correction="none"),
    )
    found = jaxpd.solve_relaxed(scene, rtol=1e-8).checked()
    exact = jaxpd.solve_static(scene, rtol=1e-10).checked()
    assert found.damage.max() < 1e-12
    size = np.abs(exact.u).max()
    np.testing.assert_allclose(found.u, exact.u, rtol=0, atol=1e-5 * size)
    with pytest.raises(ValueError, match="out of reach of float32"):
        jaxpd.solve_relaxed(scene, dtype="float32")


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1.3, 2.0, 4.0])
def test_a_step_too_long_is_told_though_all_bonds_break(factor):
    glass = jaxpd.Elastic(72e9, nu=1 / 3, state="plane stress", rho=2440.0, G0=3.8)
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (0.02, 0.01)),
        material=glass,
        loads=[
            jaxpd.traction(jaxpd.above(y=0.01), y=2e6),
            jaxpd.traction(jaxpd.below(y=0.0), y=-2e6),
        ],
        resolution=jaxpd.Bonds(dx=1e-3, m=3, nodes="cell"),
    )
    motion = jaxpd.prepare_motion(scene)
    dt = factor * longest_dt(motion)
    run = jaxpd.run_explicit(motion, 4e-4, dt=dt, records=100, unstable_dt=True)
    with pytest.raises(jaxpd.Diverged, match=r"energy from nowhere|not finite"):
        run.checked()


def test_what_is_no_list_is_refused_by_its_name():
    with pytest.raises(ValueError, match="cracks: Crack"):
        sheet(cracks=jaxpd.segment((0.2, 0.2), (0.4, 0.2)))
    with pytest.raises(ValueError, match="supports: "):
        sheet(supports=[jaxpd.above(x=0.5)])
