"""The catalogue of derivatives: every parameter of every operator by every solver.

A row is a problem; it is checked along every parameter that it has. Rows cover every
pair of operator, solver, kinematics, crack and direction of differentiation that can be
combined. What cannot:

- "fft" is for small displacements;
- "spectral" and "multigrid" need a lattice's operators, "stencil" or "fft";
- positions X and volumes vol are parameters of "gather" alone, dx of the others.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.gradcheck import check, taylor
from jaxpd.solvers.linear import GENERAL, METHODS
from tests.catalogue import LogStrain

pytestmark = pytest.mark.usefixtures("compiled_quickly")
slow = pytest.mark.slow
#: kinematics, operator, solver, cracked, mode; with `SECOND`
ROWS = [
    ("small", "fft", "multigrid", True, "reverse"),
    ("finite", "gather", "d-pcg", False, "reverse"),
    pytest.param("finite", "stencil", "multigrid", True, "reverse", marks=slow),
    pytest.param("small", "gather", "amg", True, "forward", marks=slow),
    pytest.param("small", "fft", "cg", True, "reverse", marks=slow),
    pytest.param("small", "fft", "pcg", False, "forward", marks=slow),
    pytest.param("small", "fft", "d-pcg", True, "forward", marks=slow),
    pytest.param("small", "fft", "block-pcg", False, "reverse", marks=slow),
    pytest.param("small", "fft", "spectral", False, "forward", marks=slow),
    pytest.param("small", "fft", "amg", False, "reverse", marks=slow),
    pytest.param("small", "fft", "direct", True, "forward", marks=slow),
    pytest.param("small", "stencil", "multigrid", False, "forward", marks=slow),
    pytest.param("small", "stencil", "cg", False, "forward", marks=slow),
    pytest.param("small", "stencil", "d-pcg", True, "reverse", marks=slow),
    pytest.param("finite", "stencil", "pcg", True, "reverse", marks=slow),
    pytest.param("finite", "stencil", "block-pcg", True, "forward", marks=slow),
    pytest.param("finite", "stencil", "amg", True, "forward", marks=slow),
    pytest.param("finite", "stencil", "direct", False, "reverse", marks=slow),
    pytest.param("finite", "gather", "cg", True, "forward", marks=slow),
    pytest.param("small", "gather", "pcg", True, "reverse", marks=slow),
    pytest.param("small", "gather", "block-pcg", True, "reverse", marks=slow),
    pytest.param("finite", "gather", "amg", False, "reverse", marks=slow),
]
#: The same rows to second order, whose expansions need the first derivative as well.
SECOND = [
    ("small", "fft", "multigrid"),
    ("finite", "stencil", "spectral"),
    ("small", "gather", "amg"),
    ("finite", "gather", "direct"),
]


def plate(kinematics, cracked=True, *, material=None, kernel=None, correction=None):
    """Prescribed motion, body forces, and a crack that is no line of the lattice."""
    return jaxpd.Scene(
        body=jaxpd.box((-0.5, -0.5), (0.5, 0.5)),
        material=material or jaxpd.Elastic(3.0, 1 / 3, "plane stress"),
        supports=[
            jaxpd.moves(jaxpd.above(y=0.5), x=0.002, y=0.01),
            jaxpd.moves(jaxpd.below(y=-0.5), x=lambda X: 0.004 * X[:, 0], y=-0.003),
        ],
        loads=[jaxpd.body_force(jaxpd.box((0.0, -0.3), (0.4, 0.3)), x=0.05, y=0.03)],
        cracks=[jaxpd.segment((-0.5, 0.0), (0.1, 0.05))] if cracked else [],
        resolution=jaxpd.Bonds(
            dx=1 / 8,
            m=3.3,  # no neighbour enters at a small change of the horizon
            kernel=kernel or jaxpd.fractional(0.3),
            correction=correction,
        ),
        kinematics=kinematics,
    )


def field(problem):
    """A modulus that varies from point to point."""
    n = len(problem.X)
    return {"E": 3.0 + np.random.default_rng(5).uniform(-1.0, 1.0, n)}


def assert_all(found, operator):
    expected = {"E", "alpha", "delta", "load", "prescribed"}
    assert set(found) == expected | ({"X", "vol"} if operator == "gather" else {"dx"})


def assert_slopes(found):
    for name, one in found.items():
        assert one.slope == pytest.approx(2.0, abs=0.05), f"{name}: {one.slope}\n{one}"


@pytest.mark.parametrize(("kinematics", "operator", "solver", "cracked", "mode"), ROWS)
def test_taylor_slopes(kinematics, operator, solver, cracked, mode):
    scene = plate(kinematics, cracked)
    # sparse LU factorises the stiffness itself, of which the FFT keeps 1e-9
    coarse = (operator, solver) == ("fft", "direct")
    rtol, noise = (1e-8, 1e-8) if coarse else (1e-12, 1e-11)
    problem = jaxpd.prepare(scene, operator=operator, solver=solver, rtol=rtol)
    at = problem.params | field(problem)
    found = check(problem, params=at, mode=mode, noise=noise)
    assert_all(found, operator)
    assert_slopes(found)


@pytest.mark.slow
@pytest.mark.parametrize(("kinematics", "operator", "solver"), SECOND)
def test_second_derivatives(kinematics, operator, solver):
    """Hessian-vector products, forward over reverse, through host solvers as well."""
    problem = jaxpd.prepare(
        plate(kinematics), operator=operator, solver=solver, rtol=1e-12
    )
    found = check(problem, params=problem.params | field(problem), order=2)
    assert_all(found, operator)
    linear = {"load", "prescribed"} if kinematics == "small" else set()
    for name, one in found.items():  # the functional is quadratic in u
        exact = name in linear and one.slope == np.inf
        assert exact or one.slope > 2.9, f"{name}: {one.slope}\n{one}"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"kernel": jaxpd.gaussian(0.4)}, "ratio"),
        ({"kernel": jaxpd.physics.Gaussian(0.15)}, "omega"),
        ({"material": LogStrain(3.0)}, "law"),
        ({"correction": "none"}, "delta"),
        ({"correction": "analytic"}, "delta"),
    ],
)
@pytest.mark.parametrize("operator", ["gather", "stencil"])
def test_taylor_slopes_of_other_models(options, name, operator):
    problem = jaxpd.prepare(plate("finite", **options), operator=operator, rtol=1e-12)
    assert_slopes(check(problem, (name,)))


@pytest.mark.slow
def test_reactions_and_energy_have_derivatives():
    problem = jaxpd.prepare(plate("finite"), operator="gather", rtol=1e-12)

    def measure(problem, params, u):
        pull = problem.reaction(u, params)
        return jnp.sum(pull[:, 1] ** 2) + jnp.sum(problem.energy(u, params))

    assert_slopes(check(problem, measure=measure))


def test_a_wrong_derivative_has_slope_one():
    @jax.custom_jvp
    def square(x):
        return jnp.sum(x**2)

    square.defjvp(lambda p, t: (square(*p), 2.001 * jnp.sum(p[0] * t[0])))
    at, along = np.array([1.0, 2.0]), np.array([1.0, 0.5])
    one = taylor(square, at, {"x": along}, steps=0.5 ** np.arange(4, 20))["x"]
    assert one.slope == pytest.approx(1.0, abs=0.01)
    assert not one.right
    two = taylor(lambda x: jnp.sum(x**3), at, {"x": along})["x"]
    assert two.slope == pytest.approx(2.0, abs=0.01)
    line = taylor(jnp.sum, at, {"x": along})["x"]
    assert line.slope == np.inf
    assert line.right
    assert "noise" in str(line)
    broken = taylor(lambda x: jnp.sum(x) / 0.0 * 0.0, at, {"x": along})["x"]
    assert np.isnan(broken.slope)
    assert not broken.right


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"mode": "sideways"}, "mode: 'sideways'"),
        ({"order": 3}, "order: 3"),
        ({"names": ("nu",)}, "names: \\['nu'\\]"),
    ],
)
def test_bad_requests_are_refused(options, says):
    problem = jaxpd.prepare(plate("small"))
    with pytest.raises(ValueError, match=says):
        check(problem, **options)


def test_the_rows_cover_every_pair_that_can_be_combined():
    rows = [getattr(row, "values", row) for row in ROWS]
    rows += [(*row, True, "reverse") for row in SECOND]
    choices = [
        ("small", "finite"),
        ("gather", "stencil", "fft"),
        [m for m in METHODS if m not in GENERAL],  # those: tests/operators/test_strong
        (True, False),
        ("reverse", "forward"),
    ]

    def fits(row):
        lattice = row[2] in ("spectral", "multigrid")
        return not (
            (row[0] == "finite" and row[1] == "fft") or (row[1] == "gather" and lattice)
        )

    missing = []
    for a, b in itertools.combinations(range(5), 2):
        can = {(row[a], row[b]) for row in itertools.product(*choices) if fits(row)}
        missing += sorted(map(str, can - {(row[a], row[b]) for row in rows}))
    assert not missing
