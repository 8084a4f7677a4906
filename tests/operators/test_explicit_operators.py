"""The operators of motion: one force, one memory, whichever way it is swept."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.motion import Motion

GLASS = jaxpd.Elastic(72e9, nu=1 / 3, state="plane stress", rho=2440.0, G0=3.8)


def scene(**more):
    return jaxpd.Scene(
        body=jaxpd.box((0.0, 0.0), (6e-3, 5e-3)),
        material=GLASS,
        cracks=[jaxpd.segment((0.0, 2.5e-3), (2e-3, 2.5e-3))],
        no_fail=[jaxpd.above(y=4.7e-3)],
        resolution=jaxpd.Bonds(
            dx=5e-4, m=2.5, kernel=jaxpd.fractional(-0.5), nodes="cell"
        ),
        **more,
    )


@jax.jit
def commit(motion, params, u, history, ct):
    op, drive = motion.build(params)
    u = u.astype(drive.mass.dtype)
    force, after = op.commit(op.lay(u), history)
    measures = op.pick(op.energy(op.lay(u), after)), op.pick(op.intact(after))
    released = op.released(after, history)
    return op.pick(force), after, measures, released, op.diagonal(history)


@pytest.fixture(scope="module")
def motions():
    kinds = ("halves", "slots", "memory")
    return {kind: jaxpd.prepare_motion(scene(), operator=kind) for kind in kinds}


@pytest.fixture(scope="module")
def responses(motions):
    rng = np.random.default_rng(3)
    found, E = {}, rng.uniform(50e9, 90e9, len(motions["halves"].X))
    # stretches of some 1e-4, the critical one is 3e-4
    u = jnp.asarray(rng.normal(scale=1e-7, size=motions["halves"].X.shape))
    for kind, motion in motions.items():
        params = motion.params | {"E": E}
        found[kind] = commit(motion, params, u, motion.begin, u)
    return found


def test_all_sweeps_give_the_same_force_energy_damage_and_blocks(responses):
    halves = responses["halves"]
    for kind in ("slots", "memory"):
        force, _, (energy, volume), released, blocks = responses[kind]
        for ours, theirs in (
            (force, halves[0]),
            (energy, halves[2][0]),
            (released, halves[3]),
            (blocks, halves[4]),
        ):
            size = float(jnp.abs(theirs).max())
            assert size > 0
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-13 * size)
        np.testing.assert_allclose(volume, halves[2][1], rtol=1e-12)


def test_momentum_is_conserved_while_bonds_break(responses, motions):
    for kind, (force, after, *_) in responses.items():
        X = np.asarray(motions[kind].X)
        force = np.asarray(force)
        scale = np.abs(force).sum()
        assert np.abs(force.sum(axis=0)).max() <= 1e-15 * scale
        spin = np.sum(X[:, 0] * force[:, 1] - X[:, 1] * force[:, 0])
        assert abs(spin) <= 1e-3 * scale * np.abs(X).max()  # u turns it: 1e-7 of 1e-3
        before = motions[kind].begin
        count = [np.asarray(jax.tree.leaves(h)[0]) for h in (before, after)]
        if kind == "memory":
            count = [x & np.asarray(before[1]) for x in count]
        broken = np.subtract(*(np.unpackbits(x.astype(np.uint8)).sum() for x in count))
        assert broken > 20


def test_bonds_never_heal_and_zones_without_failure_hold(motions):
    motion = motions["halves"]
    params, far = motion.params, jnp.asarray(np.asarray(motion.X) * 0.5)
    zero = jnp.zeros_like(far)
    _, bits, _, _, _ = commit(motion, params, far, motion.begin, far)
    force, again, (_, volume), _, _ = commit(motion, params, zero, bits, far)
    np.testing.assert_array_equal(again, bits)
    kept = np.asarray(volume) > 0
    # only bonds with an end in the zone are left after a stretch of 50 %
    near = np.asarray(motion.X)[:, 1] > 4.7e-3 - 2.5 * 5e-4 - 1e-9
    np.testing.assert_array_equal(kept, near)
    assert np.abs(force).max() < 1e-280  # 0 but for what marks a bond as intact


@pytest.mark.parametrize("kind", ["halves", "slots"])
def test_the_hand_derived_rule_is_plain_ad_of_the_sweep(motions, kind):
    motion = motions[kind]
    rng = np.random.default_rng(5)
    E = jnp.asarray(rng.uniform(50e9, 90e9, len(motion.X)))
    u, ct = jnp.asarray(rng.normal(scale=1e-7, size=(2, *motion.X.shape)))

    @jax.jit
    def both(motion, u, E, alpha, ct, history):
        def power(u, E, alpha, reverse):
            op = motion.operator(motion.params | {"E": E, "alpha": alpha})
            op = op if reverse else op.plain()
            return jnp.sum(op.commit(op.lay(u), history)[0] * op.lay(ct))

        return [jax.grad(power, (0, 1, 2))(u, E, alpha, rule) for rule in (True, False)]

    ruled, plain = both(motion, u, E, jnp.asarray(-0.5), ct, motion.begin)
    for a, b in zip(ruled, plain, strict=True):
        size = np.abs(np.asarray(b)).max()
        assert size > 0
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * size)


def test_float32_keeps_small_strains(motions):
    narrow = jaxpd.prepare_motion(scene(), dtype="float32")
    u = jnp.asarray(np.asarray(narrow.X) @ np.array([[1e-6, 0], [0, -1e-6]]))
    wide = motions["halves"]
    exact = commit(wide, wide.params, u, wide.begin, u)[2][0]
    ours = commit(narrow, narrow.params, u, narrow.begin, u)[2][0]
    assert ours.dtype == jnp.float32
    # positions of 5e-3 carry displacements of 5e-9: differences keep 6 digits
    np.testing.assert_allclose(ours, exact, rtol=2e-6)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class OneSided:
    """Breaks from the end that sees the bond point up alone."""

    law: object
    start = True

    def advance(self, xi, eta, h):
        return h & (xi[1] <= 0.0)

    def share(self, h):
        return jnp.where(h, 1.0, 0.0)


def test_a_law_may_break_a_bond_from_one_side():
    law = OneSided(jaxpd.physics.pmb(1.0, 1 / 3, "plane stress", 2, 0.3))
    body = jaxpd.box((0.0, 0.0), (1.0, 1.0))
    one = jaxpd.Scene(
        body=body,
        material=jaxpd.Solid(law, rho=1.0),
        resolution=jaxpd.Bonds(dx=0.1, m=3, correction="none"),
    )
    motion = jaxpd.prepare_motion(one)
    assert motion.course.kind == "memory"
    u = jnp.asarray(1e-3 * np.asarray(motion.X)[:, ::-1] ** 2)
    force, after, *_ = commit(motion, motion.params, u, motion.begin, u)
    flags, there = map(np.asarray, after)
    nbr = np.asarray(motion.problem.family.nbr)
    up = np.asarray(motion.X)[nbr][..., 1] - np.asarray(motion.X)[None, :, 1] > 1e-12
    np.testing.assert_array_equal(flags & there, there & ~up)
    # momentum is that of the law: not conserved
    assert np.abs(np.asarray(force).sum(axis=0)).max() > 1e-3 * np.abs(force).max()


def test_build_and_motion_compile_once_for_new_parameters(motions):
    motion = motions["halves"]
    rest = jnp.zeros(motion.X.shape)
    commit(motion, motion.params, rest, motion.begin, rest)
    before = commit._cache_size()
    params = motion.params | {"G0": np.asarray(5.0), "rho": np.asarray(1000.0)}
    commit(motion, params, rest, motion.begin, rest)
    assert commit._cache_size() == before
    with pytest.raises(ValueError, match=r"params: \['nonsense'\]"):
        Motion.build(motion, params | {"nonsense": 1.0})
