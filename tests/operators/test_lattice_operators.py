"""Gather, stencil and FFT over the same problems, and the separated correction."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, prepare
from jaxpd.operators import LatticeTangent, convolution, pivots
from jaxpd.operators.fft import SEPARATION, separated
from jaxpd.operators.patches import covering, rim, rim_boxes, share, slices
from jaxpd.problem import Problem, first_system, host_system

pytestmark = pytest.mark.usefixtures("compiled_quickly")


def block(correction):
    return jaxpd.Scene(
        body=jaxpd.box((0.0,) * 3, (1.0,) * 3),
        material=jaxpd.Elastic(1.0, 1 / 4, "solid"),
        supports=[
            jaxpd.holds(jaxpd.below(z=0.0)),
            jaxpd.moves(jaxpd.above(z=1.0), z=1e-3),
        ],
        cracks=[jaxpd.rectangle((0.2, 0.2, 0.5), (0.5, 0, 0), (0, 0.5, 0.2))],
        resolution=jaxpd.Bonds(dx=1 / 6, m=2, correction=correction),
        kinematics="small",
    )


def bar(correction):
    return jaxpd.Scene(
        body=jaxpd.box((0.0,), (1.0,)),
        material=jaxpd.Elastic(1.0, None, "bar"),
        supports=[jaxpd.holds(jaxpd.below(x=0.0))],
        loads=[jaxpd.body_force(jaxpd.above(x=0.5), x=1.0)],
        resolution=jaxpd.Bonds(dx=1 / 20, m=3, correction=correction),
        kinematics="small",
    )


SCENES = {
    "plate": lambda c: gallery.cracked_plate(
        12, 4, 0.0, kinematics="small", correction=c
    ),
    "block": block,
    "bar": bar,
}
CASES = [(s, c) for s in SCENES for c in ("none", "lattice")]


@pytest.mark.parametrize(("scene", "correction"), CASES)
@pytest.mark.parametrize(
    "uneven",
    [
        pytest.param(False, marks=pytest.mark.slow, id="even"),
        pytest.param(True, id="uneven"),
    ],
)
def test_gather_stencil_and_fft_are_one_operator(scene, correction, uneven, rng):
    found = {}
    for name in ("gather", "stencil", "fft"):
        problem = prepare(SCENES[scene](correction), operator=name, solver="pcg")
        if uneven:  # bonds take the mean of the moduli of their ends
            E = np.random.default_rng(1).uniform(1.0, 5.0, len(problem.X))
            problem = dataclasses.replace(problem, params=problem.params | {"E": E})
        found[name] = first_system(problem)
    v = rng.normal(size=found["fft"][2].shape)
    apply = jax.jit(lambda K, v: (K.mv(v), K.diagonal()))
    (want, own), A = apply(found["gather"][0], v), found["gather"][0].to_bsr()
    # bonds: 1e-13 by the stencil and by exact transforms, else what was asked for
    exact = correction == "none"
    for name, bound in (("stencil", 1e-13), ("fft", 1e-13 if exact else SEPARATION)):
        K, _, b = found[name]
        got, diagonal = apply(K, v)
        np.testing.assert_allclose(got, want, rtol=0, atol=bound * abs(want).max())
        np.testing.assert_allclose(diagonal, own, rtol=0, atol=bound * abs(own).max())
        gap = abs(b - found["gather"][2]).max()
        assert gap <= 10 * bound * abs(b).max()
        difference = abs(K.to_bsr() - A).max()
        assert difference <= 1e-13 * abs(A).max()


def slanted(correction):
    cracks = [
        jaxpd.segment((0.35, 0.3), (0.6, 0.5)),
        jaxpd.segment((0.0, 0.8), (0.2, 0.8)),
    ]
    return jaxpd.Scene(
        body=jaxpd.box((0.0,) * 2, (1.0, 1.25)),
        material=jaxpd.Elastic(1.0, 1 / 3, "plane stress"),
        supports=[jaxpd.holds(jaxpd.below(y=0.0))],
        loads=[jaxpd.body_force(jaxpd.above(y=0.9), y=1.0)],
        cracks=cracks,
        resolution=jaxpd.Bonds(dx=1 / 24, m=3, correction=correction),
        kinematics="small",
    )


@pytest.mark.parametrize("scene", [slanted, block, bar])
@pytest.mark.parametrize("uneven", [False, True], ids=["even", "uneven"])
def test_patches_do_what_whole_lattices_do(scene, uneven, rng):
    problem = prepare(scene("lattice"), solver="pcg")
    rest = problem.rest()
    boxes = covering(rest.family)
    count = np.zeros(rest.family.shape, int)
    for box in boxes:
        count[slices(box)] += 1
    assert count.max() == 1
    assert (count == 1)[rim(rest.family)].all()
    c = rng.uniform(1.0, 5.0, len(problem.X)) if uneven else None
    rest = dataclasses.replace(rest, c=c)
    u, v = rng.normal(size=(2, *problem.X.shape))
    want = np.asarray(jax.jit(lambda K, u: K.mv(u))(rest, u))
    host = convolution(rest, problem.spec.pivots, boxes)
    assert host.patches
    assert len(host.left) == 1 + uneven
    made = jax.jit(convolution, static_argnums=(1, 2))
    trace = made(jax.device_put(rest), problem.spec.pivots, boxes)
    product = jax.jit(lambda K, u: K.mv(u))
    for K, mv in ((host, lambda K, u: K.mv(u)), (trace, product)):
        got, other = np.asarray(mv(K, u)), np.asarray(mv(K, v))
        np.testing.assert_allclose(got, want, rtol=0, atol=SEPARATION * abs(want).max())
        assert abs(np.vdot(v, got) - np.vdot(u, other)) <= 1e-12 * np.vdot(u, got)
        still = np.asarray(mv(K, np.ones_like(u)))
        assert abs(still).max() <= 1e-12 * abs(K.own).max()


def test_patches_are_used_where_they_pay():
    large = prepare(gallery.cracked_plate(200, 4, kinematics="small"), solver="pcg")
    small = prepare(gallery.cracked_plate(50, 4, kinematics="small"), solver="pcg")
    assert small.spec.patches == rim_boxes(small.rest().family) == ()
    assert len(large.spec.patches) == 5
    assert share(large.rest().family, large.spec.patches) < 0.5
    K, _, b = host_system(large)
    u = np.random.default_rng(0).normal(size=b.shape)
    whole = convolution(large.rest(), large.spec.pivots).mv(u)
    gap = abs(K.mv(u) - whole).max()
    assert gap <= 1e-12 * abs(whole).max()


def test_the_analytic_volume_is_what_index_lists_make_of_it(rng):
    fft, gather = (
        prepare(SCENES["plate"]("analytic"), operator=name, solver="pcg")
        for name in ("fft", "gather")
    )
    u = rng.normal(size=fft.X.shape)
    want = np.asarray(gather.stiffness().mv(u))
    got = host_system(fft)[0].mv(u)
    np.testing.assert_allclose(got, want, rtol=0, atol=SEPARATION * abs(want).max())
    v = np.asarray(fft.rest().v)
    assert v.max() == pytest.approx(1.0, abs=1e-14)


def test_the_host_makes_what_the_trace_makes():
    problem = prepare(SCENES["plate"]("lattice"), solver="pcg")
    host, trace = host_system(problem), first_system(problem)
    assert all(isinstance(x, np.ndarray) for x in jax.tree.leaves(host))
    for a, b in zip(jax.tree.leaves(host), jax.tree.leaves(trace), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * max(1.0, abs(b).max()))


def test_volume_correction_is_separated_to_what_was_asked(rng):
    v = rng.uniform(0.25, 1.02, 400)
    exact = 2.0 / (v[:, None] + v[None, :])
    for bound, most in ((1e-3, 3), (1e-6, 5), (1e-9, 7), (1e-12, 9)):
        at = pivots(v, bound)
        f = separated(v, at)
        assert len(at) <= most
        assert abs((f.T @ f) / exact - 1.0).max() <= bound
    assert pivots(np.ones(5)) == (1.0,)
    assert pivots(v)[0] == 1.0  # the bulk's


def test_gradients_of_a_product_reach_the_parameters():
    """Stiffness times a vector by FFT, differentiated in the order of the kernel."""
    problem = prepare(SCENES["plate"]("lattice"), solver="pcg")
    gather = prepare(SCENES["plate"]("lattice"), operator="gather", solver="pcg")
    v = np.random.default_rng(0).normal(size=problem.X.shape)

    def work(problem: Problem, alpha, E):
        params = problem.params | {"alpha": alpha, "E": E}
        return (v * problem.stiffness(params).mv(v)).sum()

    slope = jax.jit(jax.grad(work, argnums=(1, 2)))
    a, b = (slope(p, 0.3, np.full(len(v), 2.0)) for p in (problem, gather))
    np.testing.assert_allclose(a[0], b[0], rtol=1e-7)
    np.testing.assert_allclose(a[1], b[1], rtol=0, atol=1e-7 * abs(b[1]).max())


def test_float32_gives_float32(rng):
    rest = prepare(SCENES["plate"]("none"), solver="pcg").rest()
    fft = convolution(rest)
    u = rng.normal(size=(rest.family.n, 2))
    single = jax.tree.map(
        lambda x: x.astype(np.float32) if x.dtype.kind == "f" else x, fft
    )
    got = jax.jit(lambda K, u: K.mv(u))(single, u.astype(np.float32))
    want = fft.mv(u)
    assert got.dtype == np.float32
    np.testing.assert_allclose(got, want, rtol=0, atol=3e-6 * abs(want).max())


def test_rest_refuses_what_is_not_shared():
    problem = prepare(SCENES["plate"]("none"), solver="pcg")
    operator, _, _ = problem.build(problem.params)
    assert isinstance(operator.rest(), LatticeTangent)
    gather = prepare(SCENES["plate"]("none"), operator="gather", solver="pcg")
    with pytest.raises(ValueError, match="are for lattices"):
        gather.rest()
