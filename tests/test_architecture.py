"""The order of the rooms: no import upstream, no circle, no drawer file."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

import jaxpd

PACKAGE = Path(jaxpd.__file__).parent
ROOMS = [
    "_types", "checks", "compiling", "geometry", "physics", "discretize", "operators",
    "solvers", "schedule", "course", "conditions", "laminate", "resolution", "scene",
    "gallery", "body", "assembly", "model", "problem", "plies", "glue", "stack",
    "nodal_spec", "nodal", "nodes", "galerkin", "weak_nodes", "prepare", "motion",
    "cuts", "launch", "run", "audit", "progress", "io", "fracture", "replay", "walk",
    "path", "record", "explicit", "relaxed", "planner", "crack_path", "plot",
    "picture", "scene_file", "gradcheck",
    "convergence", "refinement",
    "observe", "inverse", "descent", "fitting", "uncertainty", "resample", "__init__",
    "command", "main_job", "__main__",
]  # fmt: skip
FILES = sorted(PACKAGE.rglob("*.py"))
EXTRAS = {"matplotlib", "meshio", "tqdm"}
OWNERS = {"pyamg": {"solvers/amg.py"}, "optax": {"descent.py"}}


def room(path):
    return path.relative_to(PACKAGE).parts[0].removesuffix(".py")


def imports(tree):
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((node, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are absolute"
            if node.module == "jaxpd":
                yield from ((node, f"jaxpd.{alias.name}") for alias in node.names)
            else:
                yield node, node.module or ""


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_a_module_imports_only_from_its_room_or_one_before_it(path):
    tree = ast.parse(path.read_text())
    here = ROOMS.index(room(path))
    for node, name in imports(tree):
        parts = name.split(".")
        if parts[0] == "jaxpd" and len(parts) > 1 and parts[1] in ROOMS:
            assert ROOMS.index(parts[1]) <= here, f"line {node.lineno} imports {name}"
        where = str(path.relative_to(PACKAGE))
        assert where in OWNERS.get(parts[0], {where}), f"{name} has a home"
        if parts[0] in EXTRAS:
            assert node.col_offset > 0, f"line {node.lineno}: {name} is an extra"


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_modules_stay_small_and_have_no_drawer(path):
    assert len(path.read_text().splitlines()) <= 310
    assert path.stem not in {"utils", "util", "helpers", "common", "misc"}
    assert ast.get_docstring(ast.parse(path.read_text()))


def test_importing_does_nothing():
    code = (
        "import jaxpd, jax, sys; "
        "assert not jax.config.jax_enable_x64; "
        "assert not {'matplotlib', 'meshio', 'tqdm'} & set(sys.modules)"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env=dict(os.environ),
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
