"""The planner: choices that the scene asks for, in words; overrides; warnings."""

import dataclasses
import json

import numpy as np
import pytest

import jaxpd
from jaxpd import gallery
from jaxpd.planner import changed
from jaxpd.planner.look import look
from jaxpd.solvers import linear

STRIP = jaxpd.Scene(
    body=jaxpd.box((0.0, 0.0), (2.0, 1.0)),
    material=jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress"),
    supports=[jaxpd.holds(jaxpd.below(x=0.0))],
    loads=[jaxpd.traction(jaxpd.above(x=2.0), y=1e-3)],
    kinematics="small",
)


def test_what_a_lattice_is_solved_with():
    plan = jaxpd.plan(gallery.cracked_plate(64, 8, kinematics="small"))
    assert plan.choice["operator"] == "fft"
    assert plan.choice["memory"] == "none"
    assert "no Newton loop" in plan.reasons["kinematics"]
    assert jaxpd.plan(gallery.cracked_plate(64, 8)).choice["operator"] == "stencil"
    law = jaxpd.physics.pmb(1.0, 1 / 3, "plane stress", 2, 0.25)
    fields = dataclasses.replace(gallery.cracked_plate(16, 4), material=law)
    assert jaxpd.plan(fields).choice["operator"] == "stencil"


def test_the_plan_runs_as_it_says():
    plan = jaxpd.plan(gallery.cracked_plate(16, 4, kinematics="small"))
    solution = plan.run().checked()
    assert solution.problem.spec.operator == plan.choice["operator"]
    assert solution.problem.linear.method == plan.choice["solver"]
    assert len(solution.X) == plan.choice["points"]


@pytest.mark.parametrize(
    ("make", "job", "options"),
    [
        (lambda: gallery.cracked_plate(33, 5), "static", {}),
        (lambda: gallery.branching_plate(3, 4e-3), "motion", {"duration": 1e-6}),
        (gallery.struck_laminate, "motion", {"duration": 1e-6}),
        (lambda: gallery.cantilever((9, 5), jitter=0.3), "static", {}),
        (gallery.pressed_ring, "path", {"times": [0.5, 1.0]}),
        (gallery.double_cantilever, "fracture", {}),
    ],
)
def test_points_are_counted_without_being_made(make, job, options):
    scene = make()
    plan = jaxpd.plan(scene, job, **options)
    if job == "motion":
        n = len(jaxpd.prepare_motion(scene).X)
    elif job == "fracture":
        n = len(jaxpd.fracture.prepare_fracture(scene).X)
    else:
        n = len(jaxpd.prepare(scene).X)
    assert plan.choice["points"] == n
    assert plan.job == job
    assert plan.cost.seconds >= plan.cost.compile > 0
    assert plan.cost.bytes > 1e8


def test_the_job_follows_from_what_is_given():
    assert jaxpd.plan(gallery.branching_plate(), duration=1e-5).job == "motion"
    assert jaxpd.plan(gallery.plastic_bar()).job == "path"
    assert jaxpd.plan(gallery.cracked_plate()).job == "static"
    with pytest.raises(ValueError, match="duration: None; a scene with starts"):
        jaxpd.plan(gallery.bar_wave())
    with pytest.raises(ValueError, match="times: a path needs one"):
        jaxpd.plan(gallery.plastic_bar()).run()


def test_time_steps_are_close_to_the_stable_one():
    for scene in (gallery.branching_plate(), gallery.bar_wave(), gallery.peeled_beam()):
        motion = jaxpd.prepare_motion(scene)
        true = 0.8 * jaxpd.explicit.longest_dt(motion)
        plan = jaxpd.plan(scene, duration=100 * true)
        assert 0.7 < plan.choice["dt"] / true < 1.4


def test_precision_and_memory_follow_what_can_break():
    glass = jaxpd.plan(gallery.branching_plate(), duration=1e-5)
    assert glass.choice["dtype"] == "float32"
    assert glass.choice["memory"] == "one bit a bond"
    wave = jaxpd.plan(gallery.bar_wave(), duration=1.0)
    assert wave.choice["dtype"] == "float64"
    assert "no" in wave.choice["memory"]


def test_what_is_left_out_is_chosen_by_accuracy():
    coarse, fine = (jaxpd.plan(STRIP, accuracy=a) for a in (1e-2, 1e-4))
    assert coarse.choice["theory"] != "bonds"
    assert coarse.error <= 1e-2
    assert fine.error <= 1e-4
    assert fine.choice["points"] > coarse.choice["points"]
    assert fine.cost.seconds > coarse.cost.seconds
    assert coarse.run().checked().u.shape == (coarse.choice["points"], 2)


def test_a_crack_asks_for_bonds_and_its_plane_lies_between_rows():
    cracked = dataclasses.replace(STRIP, cracks=[jaxpd.segment((0.5, 0.4), (1.0, 0.4))])
    plan = jaxpd.plan(cracked, accuracy=0.05)
    assert plan.choice["theory"] == "bonds"
    assert "absent" in plan.reasons["theory"]
    X = np.asarray(jaxpd.prepare(plan.scene).X)
    gap = np.abs(X[:, 1] - 0.4).min()
    assert gap == pytest.approx(0.5 * plan.scene.resolution.dx, rel=1e-9)


def test_time_may_be_what_is_given():
    cracked = dataclasses.replace(STRIP, cracks=[jaxpd.segment((0.5, 0.5), (1.0, 0.5))])
    little, much = (jaxpd.plan(cracked, seconds=s) for s in (2.0, 20.0))
    assert little.cost.seconds <= 2.0
    assert much.error < little.error
    short = jaxpd.plan(gallery.cracked_plate(), seconds=0.01)
    assert "above the 0.01 asked" in short.warnings[-1]
    none = jaxpd.plan(cracked, accuracy=1e-6)
    assert "none of" in none.warnings[0]


def test_every_field_can_be_overridden():
    plan = jaxpd.plan(gallery.cracked_plate(32, 4, kinematics="small"))
    other = changed(plan, solver="multigrid", operator="stencil")
    assert other.choice["solver"] == "multigrid"
    assert other.choice["operator"] == "stencil"
    assert other.reasons["solver"] == "as asked"
    assert changed(other, solver=None).choice["solver"] == plan.choice["solver"]
    assert changed(plan, kinematics="finite").scene.kinematics == "finite"
    bonds = jaxpd.Bonds(dx=1 / 16, m=4)
    assert changed(plan, resolution=bonds).scene.resolution == bonds
    motion = jaxpd.plan(gallery.bar_wave(), duration=1.0)
    assert changed(motion, dtype="float32", dt=1e-3).run().dt <= 1e-3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"job": "statik"}, "job: 'statik' must be"),
        ({"accuracy": -1.0}, "accuracy: -1.0 must be positive"),
        ({"accuracy": 2.0}, "accuracy: 2.0 must be"),
        ({"seconds": float("nan")}, "seconds: nan must be positive"),
        ({"duration": 0.0}, "duration: 0.0 must be positive"),
        ({"solvr": "amg"}, "solvr: is no field of a plan"),
        ({"dt": 1.0}, "dt: 1.0 is no choice of a static"),
    ],
)
def test_what_makes_no_plan_is_refused(arguments, words):
    with pytest.raises(ValueError, match=words):
        jaxpd.plan(gallery.cracked_plate(16, 4), **arguments)


PINS = [
    jaxpd.moves(jaxpd.ball((0.0, 0.0, 0.0), 1e-3), y=0.0, z=0.0),
    jaxpd.moves(jaxpd.ball((0.0, 1.0, 0.0), 1e-3), z=0.0),
]


CRACK = jaxpd.segment((0.5, 0.5), (1.0, 0.5))
FAR = jaxpd.ball((9.0, 9.0), 0.1)


@pytest.mark.parametrize(
    ("scene", "asked", "words"),
    [
        ({"supports": [jaxpd.holds(FAR)]}, {}, "supports: no point lies in"),
        ({"supports": []}, {}, "supports: 3 rigid-body mode"),
        ({"supports": [jaxpd.moves(jaxpd.below(x=0.0), x=0.0)]}, {}, "1 rigid-body"),
        ({"loads": [jaxpd.body_force(FAR, y=1.0)]}, {}, "loads: the density in"),
        ({"loads": [jaxpd.traction(jaxpd.above(x=2.0), z=1.0)]}, {}, "loads: z=1.0"),
        ({"cracks": [jaxpd.segment((5, 5), (6, 5))]}, {}, "cracks: .* lies beside"),
        ({"cracks": [CRACK]}, {"times": [0.5, 1.0]}, "job: 'path' is load steps"),
        ({"weak": [CRACK]}, {"job": "static"}, "starts, no_fail, weak"),
        ({"resolution": jaxpd.MLS(dx=1 / 8)}, {"solver": "amg"}, "solver: 'amg' is"),
        ({"resolution": jaxpd.RKPM(dx=1 / 8)}, {"solver": "spectral"}, "solver: 'spec"),
        (
            {"resolution": jaxpd.Bonds(dx=1 / 16, m=3, correction="energy")},
            {"solver": "multigrid"},
            "solver: 'multigrid' is",
        ),
        ({"resolution": jaxpd.MLS(dx=1 / 8)}, {"job": "fracture"}, "resolution: MLS"),
        ({"resolution": jaxpd.Bonds(dx=1 / 16, m=3)}, {"job": "fracture"}, "material:"),
        ({"resolution": jaxpd.Bonds(dx=0.2, m=6)}, {}, "delta: a traction is spread"),
        (
            {
                "material": jaxpd.Elastic(np.ones(50), 1 / 3, "plane stress"),
                "resolution": jaxpd.MLS(dx=1 / 8),
            },
            {},
            r"E: shape \(50,\) must be",
        ),
    ],
)
def test_no_plan_is_made_that_its_driver_would_refuse(scene, asked, words):
    with pytest.raises(ValueError, match=words):
        jaxpd.plan(dataclasses.replace(STRIP, **scene), **asked)


GLASS = jaxpd.Elastic(72e9, 1 / 3, "plane stress", rho=2440.0)


@pytest.mark.parametrize(
    ("scene", "asked"),
    [
        (
            {
                "body": jaxpd.box((-0.5, -1.0), (0.5, 1.0)),
                "cracks": [jaxpd.segment((-0.1, 0.0), (0.1, 0.0))],
                "supports": [
                    jaxpd.holds(jaxpd.below(y=-1.0)),
                    jaxpd.moves(jaxpd.above(y=1.0), y=1e-3),
                ],
            },
            {"accuracy": 0.1},
        ),
        (
            {"supports": [jaxpd.drives(jaxpd.below(x=0.0), x=5.0)]},
            {"duration": 1e-5, "accuracy": 0.3},
        ),
        (
            {
                "supports": [
                    jaxpd.drives(jaxpd.box((-0.1, 0.4), (0.01, 0.6)), x=5.0),
                ]
            },
            {"duration": 1e-5, "accuracy": 0.3},
        ),
    ],
)
def test_rows_lie_on_faces_that_are_held_there_alone(scene, asked):
    scene = dataclasses.replace(STRIP, material=GLASS, loads=(), **scene)
    plan = jaxpd.plan(scene, **asked)
    assert plan.scene.resolution.nodes == "edge"
    driver = jaxpd.prepare_motion if plan.job == "motion" else jaxpd.prepare
    driver(plan.scene)


def test_what_starts_to_move_has_rows_enough():
    bar = jaxpd.Scene(
        jaxpd.box((0.0,), (1.0,)),
        jaxpd.Elastic(1.0, None, "bar", rho=1.0),
        starts=[jaxpd.initially(jaxpd.below(x=0.1), vx=10.0)],
    )
    plan = jaxpd.plan(bar, duration=1.0, accuracy=0.02)
    motion = jaxpd.prepare_motion(plan.scene)
    asked = 0.1 * 10.0
    v0, rho = np.asarray(motion.params["v0"]), 1.0
    momentum = float((rho * np.asarray(motion.vol)[:, None] * v0).sum())
    assert abs(momentum / asked - 1.0) <= plan.error


def test_solvers_of_one_s_own_are_planned_with(monkeypatch):
    known = linear.PRECONDITIONERS
    monkeypatch.setitem(known, "jacobi again", known["d-pcg"])
    scene = dataclasses.replace(STRIP, resolution=jaxpd.Bonds(dx=1 / 16, m=3))
    assert jaxpd.plan(scene, solver="jacobi again").options["solver"] == "jacobi again"


def test_a_plan_that_takes_hours_says_so():
    scene = dataclasses.replace(
        STRIP, material=GLASS, resolution=jaxpd.Bonds(dx=1 / 64, m=3)
    )
    assert any("a coarser" in w for w in jaxpd.plan(scene, duration=9.0).warnings)


@pytest.mark.parametrize(
    ("scene", "asked", "words"),
    [
        ({}, {"times": 3}, "times: 3 must rise"),
        ({}, {"times": [2.0, 1.0]}, "times: .* must rise strictly"),
        ({}, {"times": "abc"}, "times: 'abc' must be a number"),
        (
            {
                "material": jaxpd.Elastic(1.0, 0.3, "plane stress"),
                "kinematics": "finite",
            },
            {},
            "kinematics: 'finite' is for bonds",
        ),
        (
            {"body": jaxpd.box((0, 0, 0), (1, 1, 1)), "cracks": [CRACK]},
            {},
            "cracks: .* is in 2-D",
        ),
        (
            {"body": jaxpd.box((0, 0), (2e3, 1e3)), "cracks": [CRACK]},
            {},
            "body: its sides",
        ),
    ],
)
def test_what_no_plan_can_have_is_answered_by_name(scene, asked, words):
    with pytest.raises(ValueError, match=words):
        jaxpd.plan(dataclasses.replace(STRIP, **scene), **asked)


def test_loads_say_which_theory_can():
    pulled = [jaxpd.pull(jaxpd.above(x=1.9), y=1e-3)]
    plan = jaxpd.plan(dataclasses.replace(STRIP, loads=pulled), accuracy=0.3)
    assert plan.choice["theory"] == "bonds"
    assert "pull()" in plan.reasons["theory"]
    pressed = [jaxpd.pressure(jaxpd.above(x=2.0), 1e-3)]
    plan = jaxpd.plan(dataclasses.replace(STRIP, loads=pressed), accuracy=0.3)
    assert plan.choice["theory"] != "bonds"


def test_wrong_options_of_a_run_are_answered():
    plan = jaxpd.plan(gallery.cracked_plate(16, 4), accuracy=0.3)
    with pytest.raises(ValueError, match=r"rtoll: is no option .* mean 'rtol'"):
        plan.run(rtoll=1e-3)
    with pytest.raises(ValueError, match=r"found: .* must be a Plan"):
        changed(gallery.cracked_plate(16, 4), accuracy=0.1)


def block(**change):
    given = {
        "supports": [jaxpd.moves(jaxpd.below(x=0.0), x=0.0), *PINS],
        "loads": [jaxpd.traction(jaxpd.above(x=1.0), x=1e-3)],
    }
    return jaxpd.Scene(
        body=jaxpd.box((0, 0, 0), (1, 1, 1)),
        material=jaxpd.Elastic(1.0, nu=0.25, state="solid"),
        resolution=jaxpd.Bonds(dx=1 / 16, m=3),
        kinematics="small",
        **(given | change),
    )


def superfluous(scene):
    found = jaxpd.plan(scene).warnings
    return {w.split()[3][0] for w in found if w.startswith("nothing depends on")}


def test_a_plane_scene_in_3d_is_told():
    assert superfluous(block()) == {"y", "z"}
    held = [jaxpd.holds(jaxpd.below(x=0.0))]  # keeps the face from contracting
    assert superfluous(block(supports=held)) == set()
    everywhere = jaxpd.moves(jaxpd.box((-1, -1, -1), (2, 2, 2)), z=0.0)
    roller = jaxpd.moves(jaxpd.below(x=0.0), x=0.0)
    pin = jaxpd.moves(jaxpd.ball((0.0, 0.0, 0.0), 1e-3), y=0.0)
    strain = block(supports=[roller, everywhere, pin])
    assert any("plane strain" in w for w in jaxpd.plan(strain).warnings)
    half = [jaxpd.traction(jaxpd.above(y=1.0), x=1e-3)]
    assert superfluous(block(loads=half)) == {"z"}
    crack = jaxpd.rectangle((0.5, 0.0, 0.0), (0.0, 0.5, 0.0), (0.0, 0.0, 1.0))
    assert superfluous(block(cracks=[crack])) == {"z"}
    ball = [jaxpd.body_force(jaxpd.ball((0.5, 0.5, 0.5), 0.2), x=1e-3)]
    assert superfluous(block(loads=ball)) == set()


def test_a_plate_that_is_a_bar_is_told_and_is_one():
    ends = {
        "supports": [jaxpd.moves(jaxpd.below(x=0.0), x=0.0)],
        "loads": [jaxpd.traction(jaxpd.above(x=2.0), x=1e-3)],
        "resolution": jaxpd.RKPM(dx=0.25),
    }
    plate = dataclasses.replace(STRIP, **ends)
    hold = jaxpd.moves(jaxpd.ball((0.0, 0.0), 1e-6), y=0.0)
    held = dataclasses.replace(plate, supports=[*plate.supports, hold])
    assert superfluous(held) == {"y"}
    clamped = dataclasses.replace(STRIP, loads=ends["loads"])
    assert superfluous(clamped) == set()
    long = dataclasses.replace(
        clamped,
        body=jaxpd.box((0.0, 0.0), (50.0, 1.0)),
        loads=[jaxpd.traction(jaxpd.above(x=50.0), x=1e-3)],
    )
    assert any("50 times as long as wide" in w for w in jaxpd.plan(long).warnings)
    u = np.asarray(jaxpd.solve_static(held).checked().u)
    X = np.asarray(jaxpd.prepare(held).X)
    np.testing.assert_allclose(u[:, 0], 1e-3 * X[:, 0], atol=1e-12)  # of a bar


def test_other_warnings():
    strength = jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress", G0=1.0)
    scene = dataclasses.replace(
        STRIP, material=strength, resolution=jaxpd.Bonds(dx=0.125, m=2)
    )
    found = " ".join(jaxpd.plan(scene).warnings)
    assert "bonds of a static solve do not break" in found
    assert "below 3 a lattice has few directions" in found
    wide = dataclasses.replace(STRIP, resolution=jaxpd.Bonds(dx=0.125, m=4))
    assert "surfaces are everywhere" in " ".join(jaxpd.plan(wide).warnings)


def test_a_plan_prints_and_is_data():
    plan = jaxpd.plan(STRIP, accuracy=0.01)
    table = str(plan)
    for name in (*plan.choice, "job", "time", "error"):
        assert f"\n{name} " in f"\n{table}"
    for why in plan.reasons.values():
        assert why.split()[0] in table
    json.dumps(plan.as_dict())


def test_irregular_nodes_are_measured():
    even, moved = (
        look(gallery.cantilever((25, 13), jitter=j)).spread for j in (0.0, 0.3)
    )
    assert even < 1e-9
    assert 0.1 < moved < 0.3
    plan = jaxpd.plan(gallery.cantilever((25, 13), jitter=0.3))
    assert "nodes uneven by" in plan.reasons["scheme"]


def mean_end(solution):
    """Deflection of the end x = 2, from the columns of points near it."""
    X, u = np.asarray(solution.X), np.asarray(solution.u)
    columns = np.unique(np.round(X[X[:, 0] > 1.0, 0], 9))[-3:]
    mean = [u[np.abs(X[:, 0] - x) < 1e-6, 1].mean() for x in columns]
    return float(np.polyval(np.polyfit(columns, mean, 2), 2.0))


#: Deflection of `STRIP`'s end, by kernels on 1/40; 1/28 gives 0.0380072.
DEFLECTION = 0.0380082


@pytest.mark.slow
@pytest.mark.parametrize(
    "resolution",
    [
        jaxpd.RKPM(dx=1 / 8),
        jaxpd.MLS(dx=1 / 8),
        jaxpd.MLS(dx=1 / 24),
        jaxpd.Bonds(dx=1 / 12, m=3, correction="energy", nodes="cell"),
        jaxpd.Bonds(dx=1 / 24, m=3, correction="energy", nodes="cell"),
        jaxpd.Bonds(dx=1 / 12, m=3, correction="analytic", nodes="cell"),
        jaxpd.Bonds(dx=1 / 24, m=3, calibration="lattice", nodes="cell"),
        jaxpd.Bonds(dx=1 / 12, m=3, correction="fictitious", nodes="cell"),
        jaxpd.Bonds(dx=1 / 24, m=3, correction="fictitious", nodes="cell"),
        jaxpd.Bonds(dx=1 / 24, m=4, correction="energy", nodes="cell"),
        jaxpd.Bonds(dx=1 / 12, m=3, correction="energy", nodes="edge"),
    ],
    ids=repr,
)
def test_a_clamped_beam_errs_no_more_than_expected(resolution):
    plan = jaxpd.plan(dataclasses.replace(STRIP, resolution=resolution))
    error = abs(mean_end(plan.run().checked()) / DEFLECTION - 1.0)
    assert error <= plan.error <= 12 * max(error, 1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("accuracy", [0.05, 0.01])
def test_what_is_planned_is_as_accurate_as_asked(accuracy):
    found = jaxpd.plan(STRIP, accuracy=accuracy)
    assert abs(mean_end(found.run().checked()) / DEFLECTION - 1.0) <= accuracy


def test_a_body_of_nearly_one_volume_and_a_short_one_ask_for_more():
    def error(nu, length, resolution):
        scene = dataclasses.replace(
            STRIP,
            body=jaxpd.box((0.0, 0.0), (length, 1.0)),
            material=jaxpd.Elastic(1.0, nu, "plane strain"),
            loads=[jaxpd.traction(jaxpd.above(x=length), y=1e-3)],
            resolution=resolution,
        )
        return jaxpd.plan(scene).error

    kernels, differences = jaxpd.RKPM(dx=1 / 8), jaxpd.MLS(dx=1 / 8)
    assert error(0.499, 2.0, kernels) > 10 * error(0.3, 2.0, kernels)
    assert error(0.499, 2.0, differences) < 2 * error(0.3, 2.0, differences)
    assert error(0.3, 0.5, kernels) > 2 * error(0.3, 2.0, kernels)


def test_rollers_on_a_face_have_points_there():
    rollers = dataclasses.replace(
        STRIP,
        supports=[
            jaxpd.moves(jaxpd.below(x=0.0), x=0.0),
            jaxpd.moves(jaxpd.below(y=0.0), y=0.0),
        ],
        kinematics="finite",  # so that bonds are taken
    )
    plan = jaxpd.plan(rollers, accuracy=0.3)
    assert plan.scene.resolution.nodes == "edge"
    jaxpd.prepare(plan.scene)


def test_fields_of_moduli_and_laws_of_one_s_own():
    scene = gallery.branching_plate(3, 4e-3)
    n = len(jaxpd.prepare_motion(scene).X)
    E = np.linspace(70e9, 74e9, n)
    field = dataclasses.replace(
        scene, material=dataclasses.replace(scene.material, E=E)
    )
    plan = jaxpd.plan(field, duration=1e-6)
    assert plan.run(records=1).checked().damage().shape == (n,)
    law = jaxpd.physics.pmb(72e9, 1 / 3, "plane stress", 2, 4e-3)
    own = dataclasses.replace(scene, material=jaxpd.Solid(law, rho=2440.0))
    plan = jaxpd.plan(own, duration=1e-6)
    assert plan.choice["dt"] == "of the law"
    plan.run(records=1).checked()


def test_a_given_resolution_that_misses_the_accuracy_is_told():
    coarse = dataclasses.replace(STRIP, resolution=jaxpd.RKPM(dx=1 / 4))
    assert "above the 1e-06 asked" in jaxpd.plan(coarse, accuracy=1e-6).warnings[-1]
    assert jaxpd.plan(coarse, accuracy=0.1).warnings == ()


PANE = jaxpd.Scene(
    body=jaxpd.box((0.0, -0.02), (0.1, 0.02)),
    material=jaxpd.Elastic(E=72e9, nu=1 / 3, state="plane stress", rho=2440.0, G0=3.8),
    cracks=[jaxpd.segment((0.0, 0.0), (0.05, 0.0))],
    loads=[
        jaxpd.traction(jaxpd.above(y=0.02), y=2e6),
        jaxpd.traction(jaxpd.below(y=-0.02), y=-2e6),
    ],
)


def test_a_planned_motion_moves_and_its_horizon_is_short():
    """Wide horizons let opposite tractions cancel: nothing moved."""
    plan = jaxpd.plan(PANE, accuracy=0.05, duration=1e-6)
    assert plan.scene.resolution.horizon <= 0.01
    run = plan.run(records=1).checked()
    assert run.work[-1] > 0


def test_planned_fracture_resolves_the_crack():
    glass = jaxpd.Elastic(E=72e9, nu=1 / 3, state="plane stress", G0=3.8)
    scene = jaxpd.Scene(
        body=jaxpd.box((0.0, -0.02), (0.02, 0.02)),
        material=glass,
        cracks=[jaxpd.segment((0.0, 0.0), (0.008, 0.0))],
        supports=[
            jaxpd.moves(jaxpd.above(y=0.017), x=0.0, y=+1e-5),
            jaxpd.moves(jaxpd.below(y=-0.017), x=0.0, y=-1e-5),
        ],
        no_fail=[jaxpd.above(y=0.015), jaxpd.below(y=-0.015)],
    )
    plan = jaxpd.plan(scene, "fracture", seconds=60.0)
    assert plan.scene.resolution.horizon <= 0.25 * 0.008 * (1 + 1e-9)
    with pytest.raises(ValueError, match="say job='fracture'"):
        jaxpd.plan(scene)


def test_what_cannot_run_is_not_planned():
    crack = [jaxpd.segment((0.5, 0.5), (1.0, 0.5))]
    steel = jaxpd.Elastic(1.0, nu=0.3, state="plane stress")
    cracked = dataclasses.replace(STRIP, cracks=crack, material=steel)
    solid = dataclasses.replace(
        STRIP, material=jaxpd.Elastic(1.0, nu=0.25, state="solid")
    )
    for scene, words in (
        (cracked, "nu: 0.3 is out of reach"),
        (solid, "state: 'solid' is 3-D and the body is 2-D"),
    ):
        with pytest.raises(ValueError, match=words):
            jaxpd.plan(scene)
    plan = jaxpd.plan(STRIP, accuracy=0.01)
    with pytest.raises(ValueError, match="solver: 'foo' must be"):
        changed(plan, solver="foo")
    with pytest.raises(ValueError, match="operator: 'fft'; nodes have one"):
        changed(plan, operator="fft")


def test_times_are_handed_on():
    plan = jaxpd.plan(gallery.plastic_bar(), times=[0.1, 0.2])
    assert plan.options["times"] == [0.1, 0.2]
    assert len(plan.run().checked().t) == 2


BLOCK = jaxpd.Scene(
    body=jaxpd.box((0, 0, 0), (2, 1, 1)),
    material=jaxpd.Elastic(1.0, nu=0.25, state="solid"),
    supports=[jaxpd.holds(jaxpd.below(x=0.0))],
    loads=[jaxpd.traction(jaxpd.above(x=2.0), z=1e-3)],
    kinematics="small",
)
#: Mean deflection of its end: scikit-fem, quadratic hexahedra, 12 x 6 x 6.
BLOCK_DEFLECTION = 0.03719


@pytest.mark.slow
@pytest.mark.parametrize(
    "resolution",
    [
        jaxpd.MLS(dx=1 / 6),
        jaxpd.Bonds(dx=1 / 12, m=3, correction="energy", nodes="cell"),
        jaxpd.Bonds(dx=1 / 12, m=3, correction="fictitious", nodes="cell"),
        jaxpd.Bonds(dx=1 / 24, m=3, correction="energy", nodes="cell"),
    ],
    ids=repr,
)
def test_a_clamped_block_errs_no_more_than_expected(resolution):
    plan = jaxpd.plan(dataclasses.replace(BLOCK, resolution=resolution))
    solution = plan.run().checked()
    X, u = np.asarray(solution.X), np.asarray(solution.u)
    columns = np.unique(np.round(X[X[:, 0] > 1.0, 0], 9))[-3:]
    mean = [u[np.abs(X[:, 0] - x) < 1e-6, 2].mean() for x in columns]
    end = np.polyval(np.polyfit(columns, mean, 2), 2.0)
    assert abs(end / BLOCK_DEFLECTION - 1.0) <= plan.error
