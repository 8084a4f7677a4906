"""Ghost interlayers that are as soft as they should be, whatever the plies do."""

import dataclasses
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxpd
from jaxpd.glue import glue_of
from jaxpd.plies import ply_scenes
from tests.operators.test_ghosts import stack

BAR = jaxpd.Elastic(1.0, state="bar", rho=1.0)


def bars(layer, *, m=3, nodes="cell", correction="none", gap=0.02, ratio=1.0):
    """Two bars of 0.5 m, pulled; the upper one `ratio` finer, with as many m."""
    each = [
        jaxpd.Bonds(
            dx=dx, m=m, nodes=nodes, correction=correction, kernel=jaxpd.fractional(0.0)
        )
        for dx in (0.01, 0.01 / ratio)
    ]
    body = [jaxpd.box((0.0,), (0.5,)), jaxpd.box((0.5 + gap,), (1.0 + gap,))]
    return jaxpd.Scene(
        body=jaxpd.laminate(body, layer),
        material=BAR,
        resolution=each,
        kinematics="small",
        supports=[
            jaxpd.holds(jaxpd.box((0.0,), (0.05,))),
            jaxpd.moves(jaxpd.box((0.95 + gap,), (2.0,)), x=1.0),
        ],
    )


def opening(scene):
    """Opening between the faces over the traction, from the strained middles."""
    solution = jaxpd.solve_static(scene, solver="direct").checked()
    x, u = solution.X[:, 0], np.asarray(solution.u)[:, 0]
    below, above = scene.body.plies
    at = [(x > 0.2) & (x < 0.35), (x > 0.67) & (x < 0.82)]
    lines = [np.polyfit(x[a], u[a], 1) for a in at]
    jump = np.polyval(lines[1], above.lo[0]) - np.polyval(lines[0], below.hi[0])
    np.testing.assert_allclose(lines[0][0], lines[1][0], rtol=2e-3)
    return jump / lines[0][0]


@pytest.mark.parametrize("E", [1.0, 1e-2])
@pytest.mark.parametrize(
    "how",
    [
        {},
        {"nodes": "edge", "correction": "lattice", "m": 4},
        {"ratio": 2.0, "correction": "lattice"},
    ],
    ids=["cells", "edges, m = 4", "1 : 2"],
)
def test_calibrated_layers_open_by_h_over_E(E, how):
    """4e-8 measured at m = 4; bonds as stiff between rigid plies miss by 83 %."""
    found = opening(bars(jaxpd.interlayer(E), **how))
    np.testing.assert_allclose(found, 0.02 / E, rtol=1e-7)


def test_rigid_calibration_misses_where_the_layer_is_as_stiff_as_the_plies():
    """Which is why the default is another: the opening is off by 1.7 spacings."""
    found = opening(bars(jaxpd.interlayer(1.0, rule="rigid")))
    assert found < 0.2 * 0.02
    found = opening(bars(jaxpd.interlayer(1e-2, rule="rigid")))
    np.testing.assert_allclose(found, 2.0, rtol=0.02)


@pytest.mark.usefixtures("compiled_quickly")
@pytest.mark.slow
def test_faces_with_other_corrections_are_calibrated_too():
    for correction in ("energy", "fictitious"):
        scene = bars(jaxpd.interlayer(0.1), correction=correction)
        np.testing.assert_allclose(opening(scene), 0.2, rtol=1e-7)


@pytest.mark.parametrize("d", [2, 3])
def test_shear_and_tension_are_both_as_asked_for(d):
    """The closed form against a direct solve of the chain of rows it came from."""
    layer = jaxpd.interlayer(0.3, shear=0.05, rule="calibrated")
    scene = stack(d, layers=layer)
    plies = [jaxpd.prepare(ply, solver="cg") for ply in held(scene)]
    (joint, calibration), *_ = glue_of(scene, plies)
    s, k0 = jax.jit(lambda c: c(jnp.asarray(0.3), jnp.asarray(0.05)))(calibration)
    h = calibration.h
    shear = calibration.shear.compliance(s)
    np.testing.assert_allclose(shear, h / 0.05 + calibration.shear.inset, rtol=1e-10)
    normal = with_spring(calibration.normal, float(s), float(k0))
    np.testing.assert_allclose(normal, h / 0.3 + calibration.normal.inset, rtol=1e-10)
    # bonds alone are too soft across the layer: the spring is there for the rest
    assert calibration.normal.compliance(s) > normal
    assert joint.rigid.shape == joint.area.shape


def held(scene):
    """Its plies with something to hold them, so that they can be prepared alone."""
    for ply in ply_scenes(scene):
        low = ply.body.lo[-1] + 0.2
        half = jaxpd.below(y=low) if ply.d == 2 else jaxpd.below(z=low)
        layers = ((0, 0),) * ply.d
        resolution = dataclasses.replace(ply.resolution, layers=layers)
        yield dataclasses.replace(
            ply, supports=[jaxpd.holds(half)], resolution=resolution
        )


def with_spring(modes, s, k0):
    """Compliance with bonds s and springs k0, from the unreduced linear system.

    Unknowns: C, the amplitudes of the modes, the traction F of the springs.
    """
    lam, g0, g1, p, e = (
        np.asarray(getattr(modes, name)) for name in ("lam", "g0", "g1", "p", "e")
    )
    r = len(lam)
    A, b = np.zeros((r + 2, r + 2)), np.zeros(r + 2)
    A[:r, :r] = np.diag(1.0 + s * lam)  # (A + s G) w = ..
    A[:r, r], A[:r, r + 1], b[:r] = s * g0, e, -p - s * g1
    A[r, :r], A[r, r], A[r, r + 1] = s * g0, s * modes.k00, 1.0  # balance
    b[r] = 1.0 - s * modes.k01
    A[r + 1, :r], A[r + 1, r], A[r + 1, r + 1] = -k0 * e, -k0, 1.0  # F = k0 (C + e w)
    return np.linalg.solve(A, b)[r]


def test_the_calibration_is_smooth_to_second_order():
    """Bonds of a wanted compliance come from Newton's method, derivatives and all."""
    scene = bars(jaxpd.interlayer(0.2))
    modes = jaxpd.prepare(scene, solver="direct").glue[0][1].normal

    @jax.jit
    @partial(jax.vmap, in_axes=(None, 0))
    def back(modes, C):
        there_and_back = lambda C: modes.compliance(modes.bonds(C))  # noqa: E731
        slope = jax.grad(there_and_back)
        return there_and_back(C), slope(C), jax.grad(slope)(C)

    C = jnp.asarray([0.02, 0.2, 20.0])
    there, slope, curvature = back(modes, C)
    np.testing.assert_allclose(there, C, rtol=1e-12)
    np.testing.assert_allclose(slope, 1.0, rtol=1e-10)
    np.testing.assert_allclose(curvature * C, 0.0, atol=1e-9)


def test_what_cannot_be_calibrated_is_refused():
    with pytest.raises(ValueError, match=r"no bonds make layer 0"):
        jaxpd.prepare(bars(jaxpd.interlayer(1e5), gap=0.05), solver="direct")
    with pytest.raises(ValueError, match="leave room for"):
        jaxpd.prepare(stack(layers=jaxpd.interlayer(0.3, shear=0.29)))
    with pytest.raises(ValueError, match="a bar has none"):
        jaxpd.prepare(bars(jaxpd.interlayer(0.3, shear=0.1)), solver="direct")
    thick = jaxpd.interlayer(0.3)
    with pytest.raises(ValueError, match="mesh it"):
        jaxpd.prepare(bars(thick, gap=0.1), solver="direct")
