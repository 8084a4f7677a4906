"""Pay for what you use: what a scene does not have is neither stored nor computed."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery
from jaxpd.geometry import GridFamily
from jaxpd.physics import Hooke

GLASS = gallery.branching_plate(3, 4e-3)
FREE = dataclasses.replace(
    GLASS, material=dataclasses.replace(GLASS.material, G0=None), cracks=[]
)


def built(scene, **options):
    motion = jaxpd.prepare_motion(scene, dtype="float64", **options)
    op, _ = jax.jit(lambda m: m.build(m.params))(motion)
    return motion, op, motion.first(op, motion.params)


def operations(f, *arguments):
    told = jax.jit(f).lower(*arguments).compile().cost_analysis()
    return (told[0] if isinstance(told, list) else told)["flops"]


def commit(op, u, history):
    return op.commit(u, history)


def test_a_lattice_that_cannot_break_carries_no_flags_of_bonds():
    flagged, op, first = built(GLASS)
    free, lean, start = built(FREE)
    row = lean.row
    # one byte a place that may hold a point, whatever the horizon
    assert [x.shape for x in jax.tree.leaves(start.history)] == [
        (2 * row.margin + row.length,)
    ]
    wide, *_, far = built(
        dataclasses.replace(
            FREE, resolution=dataclasses.replace(FREE.resolution, delta=8e-3)
        )
    )
    assert far.history.ndim == 1
    assert first.history.ndim == 2
    full = operations(commit, op, first.u, first.history)
    assert operations(commit, lean, start.u, start.history) < 0.8 * full
    assert wide.course.breaks is free.course.breaks is False
    assert flagged.course.breaks


def test_it_moves_as_the_one_with_flags():
    """The same plate, unbroken, with a strength far above and with none."""
    strong = dataclasses.replace(
        FREE, material=dataclasses.replace(FREE.material, G0=1e12)
    )
    runs = [
        jaxpd.run_explicit(s, 4e-6, records=2, frames=2, dtype="float64").checked()
        for s in (FREE, strong)
    ]
    u, w = (run.frames["u"][-1] for run in runs)
    np.testing.assert_allclose(u, w, rtol=0, atol=1e-12 * np.abs(w).max())
    np.testing.assert_allclose(runs[0].elastic, runs[1].elastic, rtol=1e-10)
    assert not runs[0].damage().any()
    assert not np.any(runs[0].released)


def test_its_reverse_rule_is_that_of_plain_derivatives():
    motion, op, state = built(FREE)
    rng = np.random.default_rng(2)
    u = jnp.asarray(op.lay(1e-6 * rng.normal(size=motion.X.shape)))
    ct = jnp.asarray(op.lay(rng.normal(size=motion.X.shape)))

    @jax.jit
    def slope(op, u):
        return jax.grad(lambda u: jnp.sum(ct * op.commit(u, state.history)[0]))(u)

    ruled, plain = slope(op, u), slope(op.plain(), u)
    atol = 1e-12 * float(np.abs(plain).max())
    np.testing.assert_allclose(op.pick(ruled), op.pick(plain), rtol=0, atol=atol)


def test_elastic_nodes_have_no_history():
    hooke = Hooke(2.1e5, 0.3, "plane strain")
    elastic, plastic = (
        jaxpd.prepare(gallery.pressed_ring((5, 9), law=law)) for law in (hooke, None)
    )
    assert jax.tree.leaves(elastic.history0()) == []
    assert not elastic.spec.memory
    assert plastic.spec.memory
    assert len(jax.tree.leaves(plastic.history0())) > 0


def loops(problem):
    """Loops of a compiled solve."""
    text = str(jax.make_jaxpr(type(problem).solve)(problem))
    return text.count(" while[")


def test_small_displacements_have_no_newton_loop():
    small, finite = (
        jaxpd.prepare(gallery.cracked_plate(16, 3, kinematics=kind), solver="d-pcg")
        for kind in ("small", "finite")
    )
    assert loops(small) == 1  # that of CG
    assert loops(finite) > loops(small)


def test_a_lattice_has_no_index_lists():
    problem = jaxpd.prepare(gallery.cracked_plate(32, 4, kinematics="small"))
    assert isinstance(problem.family, GridFamily)
    bonds = problem.family.n_bonds
    largest = max(np.size(leaf) for leaf in jax.tree.leaves(problem))
    assert largest < 0.1 * bonds
    lists = jaxpd.prepare(
        gallery.cracked_plate(32, 4, kinematics="small"), operator="gather"
    )
    assert max(np.size(leaf) for leaf in jax.tree.leaves(lists)) >= bonds


def test_one_body_has_no_interlayer():
    glued = gallery.struck_laminate()
    laminate, *_, state = built(glued)
    assert isinstance(state.history, tuple)
    assert not hasattr(built(GLASS)[0].problem, "glue")
    assert len(laminate.problem.glue) == 1


@pytest.mark.parametrize(
    ("word", "most"), [("none", 1.0), ("lattice", 0.5), ("analytic", 0.5)]
)
def test_a_correction_is_paid_for_by_those_who_ask(word, most):
    plain, other = (
        jaxpd.prepare(
            gallery.cracked_plate(16, 3, kinematics="small", correction=c),
            solver="d-pcg",
        )
        for c in ("none", word)
    )
    solve = type(plain).solve
    assert operations(solve, plain) <= most * operations(solve, other)
