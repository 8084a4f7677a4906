"""Multigrid, spectral preconditioner and the choice between solvers on lattices."""

import dataclasses

import jax
import numpy as np
import pytest

import jaxpd
from jaxpd import gallery, prepare
from jaxpd.problem import Problem, host_system
from jaxpd.run import equilibrium
from jaxpd.solvers import Status
from jaxpd.solvers.choice import cheapest, expected
from jaxpd.solvers.linear import solve_system

#: Iterations of the paper's multigrid, m = 8: Table 4, columns alpha = -3 .. 1.9.
PRINTED = dict(zip(gallery.ALPHAS, gallery.PRINTED_MG[32], strict=True))


def plate(n, m=8, alpha=0.0, **how):
    return prepare(
        gallery.cracked_plate(n, m, alpha, kinematics="small", **how), solver="pcg"
    )


def solved(problem, method, system=None):
    """Iterations to a residual of 1e-6 that the exact stencil confirms."""
    K, constraints, b = system or host_system(problem)
    x, info = solve_system(problem.solver(method), K, constraints, b)
    assert Status(int(info.status)) is Status.CONVERGED
    left = np.where(constraints.fixed, 0.0, b - true_product(K.lattice, x))
    assert np.linalg.norm(left) <= 1.1e-6 * np.linalg.norm(b)
    return int(info.iterations)


true_product = jax.jit(lambda lattice, x: lattice.mv(x))


@pytest.mark.parametrize("alpha", gallery.ALPHAS)
def test_counts_are_at_most_the_printed_ones(alpha):
    problem = plate(32, alpha=alpha, loading="band")
    assert solved(problem, "multigrid") <= PRINTED[alpha]


@pytest.mark.slow
@pytest.mark.parametrize("loading", ["band", "displacement"])
@pytest.mark.parametrize("alpha", gallery.ALPHAS)
def test_counts_do_not_grow(alpha, loading):
    for n in (64, 128):
        problem = plate(n, alpha=alpha, loading=loading)
        assert solved(problem, "multigrid") <= PRINTED[alpha]


@pytest.mark.parametrize("method", ["multigrid", "spectral"])
@pytest.mark.parametrize("supports", ["clamped", "rollers"])
def test_cycles_are_symmetric_and_positive(method, supports, rng):
    scene = gallery.cracked_plate(32, 4, 1.0, kinematics="small")
    if supports == "rollers":
        scene = dataclasses.replace(
            scene,
            supports=[
                jaxpd.moves(jaxpd.below(x=-0.5), x=0.0),
                jaxpd.moves(jaxpd.below(y=-0.5), y=0.0),
                jaxpd.moves(jaxpd.above(y=0.5), y=1e-3),
            ],
        )
    problem = prepare(scene, solver=method)
    cycle = jax.jit(lambda solver, r: solver.hierarchy.cycle(r))
    a, b = np.where(problem.fixed, 0.0, rng.normal(size=(2, *problem.fixed.shape)))
    za, zb = (np.asarray(cycle(problem.linear, v)) for v in (a, b))
    scale = np.linalg.norm(a) * np.linalg.norm(zb)
    assert abs((a * zb).sum() - (b * za).sum()) <= 1e-5 * scale  # in float32
    assert (a * za).sum() > 0
    np.testing.assert_array_equal(za[problem.fixed], 0.0)
    np.testing.assert_allclose(cycle(problem.linear, 1e-9 * a), 1e-9 * za, rtol=1e-4)
    assert solved(problem, method) <= {"multigrid": 10, "spectral": 40}[method]


def test_three_dimensions_and_three_levels():
    scene = jaxpd.Scene(
        body=jaxpd.box((-0.5,) * 3, (0.5,) * 3),
        material=jaxpd.Elastic(1.0, 1 / 4, "solid"),
        supports=[
            jaxpd.holds(jaxpd.below(z=-0.5)),
            jaxpd.moves(jaxpd.above(z=0.5), x=0.0, y=0.0, z=1e-3),
        ],
        cracks=[jaxpd.rectangle((-0.2, -0.2, 0.0), (0.4, 0, 0), (0, 0.4, 0))],
        resolution=jaxpd.Bonds(dx=1 / 24, m=2),
        kinematics="small",
    )
    problem = prepare(scene, solver="multigrid")
    assert len(problem.linear.hierarchy.sizes) == 3
    assert solved(problem, "multigrid") <= 8  # measured 6


def test_the_quick_way_solves_what_the_traced_way_solves():
    problem = prepare(gallery.cracked_plate(16, 4, kinematics="small"))
    assert problem.linear.method == "d-pcg"
    quick, record = equilibrium(problem)
    traced, info = jax.jit(Problem.solve)(problem)
    np.testing.assert_allclose(quick, traced, rtol=0, atol=1e-8 * abs(traced).max())
    for a, b in zip(jax.tree.leaves(record), jax.tree.leaves(info), strict=True):
        assert a.shape == b.shape
        assert a.dtype == b.dtype
    solution = jaxpd.solve_static(gallery.cracked_plate(16, 4, kinematics="small"))
    up, down = (
        solution.reaction_on(r) for r in (jaxpd.above(y=0.5), jaxpd.below(y=-0.5))
    )
    assert up[1] == pytest.approx(-down[1], rel=1e-5)
    work = 0.5 * (up[1] - down[1]) * 0.5e-3
    assert float(solution.energy.sum()) == pytest.approx(work, rel=2e-3)


def test_the_choice_goes_from_little_compilation_to_few_iterations():
    small, large = plate(16, 4, -1.0), plate(192, 8, 1.9)
    assert cheapest(small.rest(), small.fixed) == "d-pcg"
    assert cheapest(large.rest(), large.fixed, terms=6) in ("spectral", "multigrid")
    assert cheapest(large.rest(), large.fixed, solves=1000) == "multigrid"
    cost = expected(large.rest(), large.fixed, 6)
    assert cost["d-pcg"][1] > cost["spectral"][1] > cost["multigrid"][1]
    cloud = jaxpd.from_points(np.asarray(small.X), np.full(len(small.X), 1 / 256))
    scene = gallery.cracked_plate(16, 4, kinematics="small")
    points = dataclasses.replace(scene, body=cloud, resolution=jaxpd.Bonds(delta=0.25))
    assert prepare(points).spec.operator == "gather"


def test_compiled_code_is_kept(tmp_path):
    names = (
        "jax_compilation_cache_dir",
        "jax_persistent_cache_min_compile_time_secs",
        "jax_persistent_cache_min_entry_size_bytes",
    )
    before = {name: getattr(jax.config, name) for name in names}
    try:
        folder = jaxpd.keep_compiled(tmp_path / "kept")
        jax.block_until_ready(jax.jit(lambda x: x * 3.0 + 0.125)(np.ones(7)))
        assert any(folder.iterdir())
        (tmp_path / "file").touch()
        with pytest.raises(ValueError, match=r"folder: .* cannot be made"):
            jaxpd.keep_compiled(tmp_path / "file" / "below")
    finally:
        for name, value in before.items():
            jax.config.update(name, value)


def test_a_plate_without_cracks_has_coarse_levels_too():
    """Nothing irregular in the lattice, and three levels: counts as with a crack."""
    counts = []
    for cracks in ((), [jaxpd.segment((-0.15, 0.0), (0.15, 0.0))]):
        scene = jaxpd.Scene(
            body=jaxpd.box((-0.5, -0.5), (0.5, 0.5)),
            material=jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress"),
            supports=[jaxpd.holds(jaxpd.below(y=-0.5))],
            loads=[jaxpd.pull(jaxpd.above(y=0.45), x=1.0, y=1.0)],
            cracks=cracks,
            resolution=jaxpd.Bonds(dx=1 / 80, m=3),
            kinematics="small",
        )
        solution = jaxpd.solve_static(scene, solver="multigrid", rtol=1e-8).checked()
        assert len(solution.problem.linear.hierarchy.levels) >= 2
        counts.append(int(solution.linear_iterations[0]))
    assert max(counts) <= 15
