"""Where the one-way ghosts of paper 002, eq. 13, fail, and the variational do not."""

import numpy as np
import pytest

import jaxpd
from jaxpd.launch import longest_dt


def strip(E, one_way):
    """Two plies of 9 x 9 points that tremble by 1e-12, with a layer of modulus E."""
    rng = np.random.default_rng(7)
    noise = jaxpd.initially(
        jaxpd.above(y=-1.0), uy=lambda X: 1e-12 * rng.normal(size=len(X))
    )
    plies = [jaxpd.box((0, 0), (0.16, 0.16)), jaxpd.box((0, 0.2), (0.16, 0.36))]
    glue = jaxpd.interlayer(E, rule="paper", one_way=one_way)
    return jaxpd.Scene(
        body=jaxpd.laminate(plies, glue),
        material=jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress", rho=1.0),
        starts=[noise],
        resolution=jaxpd.Bonds(
            dx=0.02, m=4, kernel=jaxpd.fractional(-1.0), correction="analytic"
        ),
    )


@pytest.mark.parametrize("one_way", [True, False])
def test_a_stiff_layer_blows_up_one_way_and_not_both_ways(one_way):
    """Whatever the time step: eigenvalues are complex without the reaction."""
    motion = jaxpd.prepare_motion(strip(100.0, one_way))
    dt = 0.5 * longest_dt(motion)
    run = jaxpd.run_explicit(motion, 12.0, dt=dt, records=4)
    energy = run.kinetic + np.nan_to_num(run.elastic)
    if one_way:
        assert run.stopped or energy[-1] > 1e6 * energy[1]
    else:
        assert run.stopped is None
        np.testing.assert_allclose(energy, energy[0], rtol=0.1)
        scale = 1e-12 * 2 * 81 * 0.02**2
        assert np.abs(run.momentum - run.momentum[0]).max() < 1e-12 * scale
