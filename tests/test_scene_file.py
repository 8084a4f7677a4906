"""Scenes as files: strict keys, round trips, the command line, meshes."""

import json
import os
import signal
import subprocess
import sys
import time

import jax
import meshio
import numpy as np
import pytest

import jaxpd
from jaxpd import command, gallery
from jaxpd.__main__ import main
from jaxpd.geometry import read_points
from jaxpd.scene_file import load_scene, parse_scene, save_scene

PLATE = """
kinematics = "small"
body = { box = { lo = [0.0, 0.0], hi = [1.0, 1.0] } }
material = { Elastic = { E = 1.0, nu = 0.3333333333333333, state = "plane stress" } }
supports = [{ holds = { region = { below = { y = 0.0 } } } }]
loads = [{ pull = { region = { above = { y = 0.9 } }, y = 1e-3 } }]
resolution = { Bonds = { dx = 0.125, m = 3 } }
"""


def write(tmp_path, text, name="scene.toml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_a_file_says_what_python_would(tmp_path):
    file = load_scene(write(tmp_path, PLATE))
    same = jaxpd.Scene(
        body=jaxpd.box((0, 0), (1, 1)),
        material=jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress"),
        supports=[jaxpd.holds(jaxpd.below(y=0.0))],
        loads=[jaxpd.pull(jaxpd.above(y=0.9), y=1e-3)],
        resolution=jaxpd.Bonds(dx=0.125, m=3),
        kinematics="small",
    )
    np.testing.assert_array_equal(
        jaxpd.solve_static(file.scene).u, jaxpd.solve_static(same).u
    )
    assert (file.job, file.options) == ("auto", {})


WRONG = [
    ("suports = []\n", "scene.toml: suports: is no key here; did you mean 'supports'?"),
    ("[job.statik]\n", "job: statik: is no key here; did you mean 'static'?"),
    ("[job.static]\nrtoll = 1e-6\n", "job.static: rtoll: is no key here; did you"),
    ("[job.static]\nrtol = 'small'\n", "job.static.rtol: 'small' must be a number"),
    ("[job.static]\nmax_iterations = 2.5\n", "max_iterations: 2.5 must be a whole"),
    ("[job.motion]\ndt = 1e-7\n", "job.motion: duration: is missing"),
    ("[job]\nstatic = {}\nmotion = {duration = 1.0}\n", "must be one of"),
    ("[plan]\nacuracy = 0.1\n", "plan: acuracy: is no key here; did you mean"),
    ("[output]\nvtu = 1\n", "output.vtu: 1 must be true or false"),
    ("cracks = { segment = { a = [0, 0], b = [1, 0] } }\n", "must be a list"),
    ("cracks = [{ segment = { a = [0, 0] } }]\n", "cracks[0].segment: b: is missing"),
    (
        "cracks = [{ segment = { a = [0, 0], b = [0, 0] } }]\n",
        "cracks[0].segment: b: tips",
    ),
    ("cracks = [{ line = { a = [0, 0] } }]\n", "cracks[0]: line: is no key here"),
    (
        "no_fail = [{ above = { q = 0.5 } }]\n",
        "no_fail[0].above: q: is no key here",
    ),
    ("no_fail = [{ union = [{ bal = {} }] }]\n", "parts[0]: bal: is no key here"),
    (
        "starts = [{ initially = { region = { above = { x = 0 } }, ux = true } }]\n",
        "ux",
    ),
]


@pytest.mark.parametrize(("more", "words"), WRONG)
def test_what_is_not_known_is_refused_with_its_place(tmp_path, more, words):
    with pytest.raises(ValueError, match=r"scene\.toml") as error:
        load_scene(write(tmp_path, PLATE + more))
    assert words in str(error.value)


def prepared(path):
    file = load_scene(path)
    try:
        return jaxpd.prepare(file.scene)
    except ValueError as error:  # of a field that is read when it is used
        raise ValueError(f"scene.toml: {error}") from error


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("E = 1.0", "E = -1.0", "material.Elastic: E: -1.0"),
        ("E = 1.0", "E = 'soft'", "material.Elastic.E: 'soft' must be a number; func"),
        ("E = 1.0", "E = true", "material.Elastic.E: True must be a number"),
        ("E = 1.0, ", "", "material.Elastic: E: is missing"),
        ("Elastic", "elastic", "material: elastic: is no key here; did you mean 'Ela"),
        ("Elastic", "Solid", "material: Solid: only Python can say a law of your own"),
        ("box =", "mapped =", "body: mapped: only Python can say a body by a function"),
        ("m = 3", "m = 0.5", "m: 0.5 must be a number at least 1"),
        (
            "m = 3",
            "m = 3, kernel = { conical = { r = 1 } }",
            "kernel.conical: r: is no",
        ),
        ("[1.0, 1.0]", "[1.0, -1.0]", "body.box: hi:"),
        ("[1.0, 1.0]", "['a', 1.0]", "body.box.hi: ['a', 1.0] must be a list of num"),
        ("y = 1e-3", "y = [1e-3]", "loads[0].pull.y: [0.001] must be a number"),
        ("holds", "hold", "supports[0]: hold: is no key here; did you mean 'holds'?"),
        ('"small"', '"tiny"', "kinematics: 'tiny' must be"),
        ("kinematics =", "kinematics", "is no TOML file"),
    ],
)
def test_wrong_values_are_refused_with_their_place(tmp_path, old, new, words):
    assert old in PLATE
    with pytest.raises(ValueError, match=r"scene\.toml") as error:
        prepared(write(tmp_path, PLATE.replace(old, new)))
    assert words in str(error.value)


def test_a_missing_file_and_a_missing_body(tmp_path):
    with pytest.raises(ValueError, match="cannot be read"):
        load_scene(tmp_path / "none.toml")
    with pytest.raises(ValueError, match="body: is missing"):
        parse_scene({"material": {"Elastic": {"E": 1.0, "state": "bar"}}})


ONLY_PYTHON = {
    "kernel_bar",
    "cantilever",
    "plate_under_tension",
    "pressed_ring",
    "plate_with_hole",
    "cook_panel",
    "plastic_beam",
    "plastic_bar",
}


@pytest.mark.parametrize("name", command.scenes())
def test_the_gallery_goes_to_a_file_and_back(tmp_path, name):
    scene = command.scenes()[name]()
    path = tmp_path / "scene.toml"
    if name in ONLY_PYTHON or name in ("bar_wave", "gaussian_wave"):
        with pytest.raises(ValueError, match="only Python can say"):
            save_scene(path, scene)
        return
    back = load_scene(save_scene(path, scene)).scene
    for field in ("supports", "loads", "cracks", "starts", "no_fail", "weak"):
        mine, its = getattr(scene, field), getattr(back, field)
        assert len(mine) == len(its)
        for a, b in zip(mine, its, strict=True):
            assert repr(a.region) == repr(b.region) if hasattr(a, "region") else True
            assert leaves(a) == pytest.approx(leaves(b), abs=1e-15)
    assert back.kinematics == scene.kinematics
    assert back.resolution == scene.resolution
    assert repr(back.material) == repr(scene.material)


def leaves(x):
    """Numbers of a frozen dataclass, None as NaN left out."""
    flat = jax.tree.leaves([list(v) if isinstance(v, tuple) else v for v in parts(x)])
    return [float(v) for v in flat if isinstance(v, int | float)]


def parts(x):
    if hasattr(x, "__dataclass_fields__"):
        return [p for name in x.__dataclass_fields__ for p in parts(getattr(x, name))]
    if isinstance(x, tuple | list):
        return [p for one in x for p in parts(one)]
    return [x]


def test_a_cloud_is_written_beside_and_functions_are_refused(tmp_path):
    X = np.random.default_rng(0).uniform(size=(30, 2))
    scene = jaxpd.Scene(
        body=jaxpd.from_points(X, np.full(30, 1 / 30)),
        material=jaxpd.Elastic(1.0, nu=1 / 3, state="plane stress"),
        resolution=jaxpd.Bonds(delta=0.4),
    )
    back = load_scene(save_scene(tmp_path / "cloud.toml", scene)).scene
    np.testing.assert_array_equal(back.body.X, X)
    moved = jaxpd.moves(jaxpd.above(x=0.5), x=lambda X: X[:, 0])
    for change, word in (
        ({"supports": [moved]}, "supports: x: a function"),
        ({"material": jaxpd.Elastic(np.ones(30), nu=1 / 3, state="plane stress")}, "E"),
    ):
        changed = jaxpd.Scene(**vars(scene) | change)
        with pytest.raises(ValueError, match="only Python can say") as error:
            save_scene(tmp_path / "no.toml", changed)
        assert word in str(error.value)


def test_plans_are_printed_without_running(tmp_path, capsys):
    path = str(write(tmp_path, PLATE))
    assert main([path, "--plan"]) == 0
    table = capsys.readouterr().out
    assert "operator    fft" in table
    assert main(["cracked_plate.toml", "--plan", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["choice"]["theory"] == "bonds"
    assert told["error"] <= 0.02
    assert os.listdir(tmp_path) == ["scene.toml"]


def test_a_file_is_run_and_drawn(tmp_path, capsys):
    path = str(write(tmp_path, PLATE))
    assert main([path, "--out", str(tmp_path / "out"), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["job"] == "static"
    assert "CONVERGED" in told["result"]
    picture = tmp_path / "out" / "scene.png"
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["cracked_plat"], "did you mean 'cracked_plate'?"),
        (["cracked_plate", "nn=3"], "did you mean 'n'?"),
        (["cracked_plate", "3"], "written as name=value"),
        (["nowhere.toml"], "there is no file 'nowhere.toml'"),
        (["cracked_plat.toml"], "did you mean 'cracked_plate.toml'?"),
        (["cracked_plate", "--resume"], "keeps no checkpoints"),
    ],
)
def test_mistakes_on_the_command_line_are_answered(words, told, capsys):
    with pytest.raises(SystemExit) as end:
        main(words)
    assert end.value.code == 2
    assert told in capsys.readouterr().err


def test_a_plan_is_printed_whatever_the_order_and_its_doubts_with_the_result(
    tmp_path, capsys
):
    text = PLATE + "[output]\npicture = false\n[plan]\naccuracy = 1e-4\n"
    path = str(write(tmp_path, text))
    assert main(["--plan", path]) == 0
    assert "warning: expected error" in capsys.readouterr().out
    assert main([path, "--out", str(tmp_path)]) == 0
    assert "warning: expected error" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["--gallery", "cracked_plate"])
    assert "python -m jaxpd cracked_plate` runs one" in capsys.readouterr().err


def test_checkpoints_are_gone_once_a_run_is_done_and_no_refusal_leaves_any(
    tmp_path, capsys
):
    text = WAVE.replace("keep = true", "").replace("20.0", "0.02")
    path = write(tmp_path, text.replace("400", "4"))
    for _ in range(2):  # nothing is left that a second run would stumble over
        assert main([str(path), "--out", str(tmp_path)]) == 0
    assert sorted(p.name for p in tmp_path.iterdir()) == ["scene.png", "scene.toml"]
    path = write(tmp_path, WAVE.replace("dx = 0.02", "dx = 0.03"))
    with pytest.raises(SystemExit):
        main([str(path), "--out", str(tmp_path)])
    assert not list(tmp_path.glob("*.checkpoints"))
    capsys.readouterr()


def test_frames_for_paraview_are_of_any_job_that_has_them(tmp_path, capsys):
    path = write(tmp_path, PLATE + "[output]\nvtu = true\npicture = false\n")
    assert main([str(path), "--out", str(tmp_path)]) == 0
    assert (tmp_path / "scene" / "series.pvd").exists()
    text = WAVE.replace("keep = true", "vtu = true").replace("frames = 4", "")
    path = write(tmp_path, text)
    with pytest.raises(SystemExit):
        main([str(path), "--out", str(tmp_path)])
    assert "vtu: needs frames" in capsys.readouterr().err


def test_what_a_driver_refuses_is_told_with_its_place(tmp_path, capsys):
    path = write(tmp_path, PLATE + "[job.static]\nrtol = 2.0\n")
    with pytest.raises(SystemExit):
        main([str(path), "--out", str(tmp_path)])
    assert "scene.toml: job.static.rtol: rtol: 2.0" in capsys.readouterr().err


def test_the_gallery_is_listed(capsys):
    assert main(["--gallery"]) == 0
    table = capsys.readouterr().out
    for name in (*command.scenes(), "breaking_glass.toml", "plastic_strip.toml"):
        assert name in table
    assert set(command.HOW) <= set(command.scenes())


@pytest.mark.parametrize("path", sorted(command.EXAMPLES.glob("*.toml")))
def test_examples_are_read_and_planned(path):
    file = load_scene(path)
    assert command.planned(file).cost.seconds < 60


@pytest.mark.slow
@pytest.mark.parametrize("path", sorted(command.EXAMPLES.glob("*.toml")))
def test_examples_run(path, tmp_path):
    assert main([path.name, "--out", str(tmp_path)]) == 0
    assert (tmp_path / f"{path.stem}.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["bar_wave", "kernel_bar", "struck_laminate"])
def test_gallery_scenes_run_by_name(name, tmp_path):
    assert main([name, "--out", str(tmp_path)]) == 0
    assert (tmp_path / f"{name}.png").exists()


WAVE = """
body = { box = { lo = [0.0, 0.0], hi = [1.0, 0.2] } }
material = { Elastic = { E = 1.0, nu = 0.3333333333333333, state = "plane stress", rho = 1.0 } }
starts = [{ initially = { region = { below = { x = 0.2 } }, vx = 1e-3 } }]
resolution = { Bonds = { dx = 0.02, m = 3, nodes = "cell" } }
[job.motion]
duration = 20.0
records = 400
frames = 4
[output]
keep = true
"""  # noqa: E501


@pytest.mark.slow
def test_a_run_that_is_killed_goes_on_to_the_same_bits(tmp_path):
    path = write(tmp_path, WAVE)
    call = [sys.executable, "-m", "jaxpd", str(path), "--json", "--out"]

    def run(folder, *more):
        done = subprocess.run(
            [*call, str(tmp_path / folder), *more], capture_output=True, text=True
        )
        return done

    whole = run("whole")
    assert whole.returncode == 0, whole.stderr
    process = subprocess.Popen([*call, str(tmp_path / "part")])
    kept = tmp_path / "part" / "scene.checkpoints"
    while not (kept.is_dir() and any(kept.iterdir())):
        time.sleep(0.05)
    process.send_signal(signal.SIGKILL)
    process.wait()
    again = run("part")
    assert again.returncode == 2
    assert "say --resume to go on" in again.stderr
    assert run("part", "--resume").returncode == 0
    for file in sorted((tmp_path / "whole" / "scene.checkpoints").iterdir()):
        other = kept / file.name
        if file.suffix != ".npz":
            continue
        with np.load(file) as a, np.load(other) as b:
            for name in a.files:
                np.testing.assert_array_equal(a[name], b[name])


def gmsh(tmp_path, kind, points, cells):
    path = tmp_path / f"mesh.{kind}"
    meshio.write_points_cells(path, points, cells)
    return path


def grid(n):
    s = np.linspace(0, 1, n + 1)
    X = np.stack(np.meshgrid(2 * s, s, indexing="ij"), -1).reshape(-1, 2)
    i = np.arange((n + 1) ** 2).reshape(n + 1, n + 1)
    quads = np.stack([i[:-1, :-1], i[1:, :-1], i[1:, 1:], i[:-1, 1:]], -1).reshape(
        -1, 4
    )
    return X, quads


@pytest.mark.parametrize("kind", ["inp", "msh"])
def test_meshes_become_points_with_the_right_volume(tmp_path, kind):
    X, quads = grid(4)
    X3 = np.column_stack([X, np.zeros(len(X))])
    half = len(quads) // 2
    triangles = quads[half:][:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)
    cells = [("quad", quads[:half]), ("triangle", triangles)]
    cloud = jaxpd.from_mesh(gmsh(tmp_path, kind, X3, cells))
    assert (cloud.n, cloud.d) == (half + len(triangles), 2)
    vol, at = np.asarray(cloud.vol), np.asarray(cloud.X)
    assert vol.sum() == pytest.approx(2.0, rel=1e-12)
    np.testing.assert_allclose(vol @ at / 2.0, [1.0, 0.5], rtol=1e-12)
    body = jaxpd.from_mesh(tmp_path / f"mesh.{kind}", points="nodes")
    assert body.n == len(X)
    assert np.asarray(body.vol).sum() == pytest.approx(2.0, rel=1e-12)
    scene = jaxpd.Scene(
        body=body,
        material=jaxpd.Elastic(1.0, nu=0.3, state="plane stress"),
        supports=[
            jaxpd.moves(jaxpd.below(x=0.0), x=0.0),
            jaxpd.moves(jaxpd.below(y=0.0), y=0.0),
            jaxpd.moves(jaxpd.above(x=2.0), x=0.02),
        ],
        resolution=jaxpd.RKPM(),
    )
    u = np.asarray(jaxpd.solve_static(scene).checked().u)
    np.testing.assert_allclose(u, X * [0.01, -0.003], atol=1e-12)


def test_solid_meshes(tmp_path):
    corner = np.array(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij")).reshape(3, -1)
    X = corner.T * [1.0, 2.0, 3.0] + 0.1 * corner.T[:, [1, 2, 0]]
    hexahedron = np.array([[0, 4, 6, 2, 1, 5, 7, 3]])
    path = gmsh(tmp_path, "vtu", X, [("hexahedron", hexahedron)])
    cloud = jaxpd.from_mesh(path)
    frame = np.diag([1.0, 2.0, 3.0])
    frame[[0, 1, 2], [1, 2, 0]] += 0.1
    assert float(cloud.vol[0]) == pytest.approx(abs(np.linalg.det(frame)), rel=1e-12)
    np.testing.assert_allclose(cloud.X[0], X.mean(axis=0), rtol=1e-12)
    with pytest.raises(ValueError, match="'nodes' are for plane meshes"):
        jaxpd.from_mesh(path, points="nodes")


def test_files_that_hold_no_cloud_are_refused(tmp_path):
    with pytest.raises(ValueError, match="there is no"):
        jaxpd.from_mesh(tmp_path / "none.msh")
    with pytest.raises(ValueError, match="points: 'faces' must be"):
        jaxpd.from_mesh(tmp_path / "none.msh", points="faces")
    path = gmsh(tmp_path, "vtu", np.zeros((1, 3)), [("vertex", np.array([[0]]))])
    with pytest.raises(ValueError, match="of which none is"):
        jaxpd.from_mesh(path)
    with pytest.raises(ValueError, match="columns must be"):
        read_points(write(tmp_path, "1\n2\n", "one.csv"))
    cloud = read_points(write(tmp_path, "x,y,vol\n0,0,1\n1,0,2\n", "two.csv"))
    np.testing.assert_array_equal(cloud.vol, [1, 2])


def test_a_picture_of_each_result(tmp_path):
    bar = jaxpd.solve_static(gallery.kernel_bar())
    jaxpd.picture(bar).savefig(tmp_path / "bar.png")
    assert (tmp_path / "bar.png").stat().st_size > 5000
