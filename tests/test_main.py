"""The main job through its command line, as a user runs it."""

import functools
import json
import os
import subprocess
import sys

import pytest

import jaxpd
import jaxpd.main_job
from jaxpd.__main__ import main


def run(*arguments, **environment):
    return subprocess.run(
        [sys.executable, "-W", "error", "-m", "jaxpd", *arguments],
        capture_output=True,
        text=True,
        env=os.environ | environment,
    )


def test_the_main_job_in_small(tmp_path):
    done = run("--n", "16", "--m", "4", "--json", "--out", str(tmp_path / "new"))
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    report = json.loads(done.stdout)
    assert report["AD against hand-derived blocks"] <= 1e-13
    assert report["Newton steps"] <= 3
    assert report["solvers"]["AMG-PCG"]["iterations"] <= 10
    picture = tmp_path / "new" / "cracked_plate.png"
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert report["picture"] == str(picture)


@pytest.mark.slow
def test_the_table_is_for_people(tmp_path, capsys):
    assert main(["--n", "32", "--out", str(tmp_path), "--solver", "amg"]) == 0
    table = capsys.readouterr().out
    rows = dict(line.rsplit("  ", 1) for line in table.splitlines() if "  " in line)
    rows = {name.strip(): value for name, value in rows.items()}
    assert rows["condition number, printed"] == "153"
    assert float(rows["condition number, ours"]) == pytest.approx(153, rel=0.015)
    assert "AMG-PCG iterations to 1e-06" in table


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--n", "2"], "--n: 2 must lie between 8 and 256"),
        (["--n", "many"], "invalid int value"),
        (["--m", "1"], "--m: 1 must lie between 2 and n / 2 = 32"),
        (["--n", "256", "--m", "20"], "more than 2e7"),
        (["--alpha", "2"], "--alpha: 2 must be below 2"),
        (["--alpha", "nan"], "--alpha: nan must be below 2"),
        (["--strain", "0"], "--strain: 0 must be non-zero"),
        (["--solver", "magic"], "invalid choice: 'magic'"),
        (["--out", "/dev/null/x"], "Not a directory"),
    ],
)
def test_absurd_values_are_refused_with_the_cure(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        main(arguments)
    assert end.value.code == 2
    assert words in capsys.readouterr().err


def test_a_missing_extra_is_named(tmp_path):
    (tmp_path / "matplotlib.py").write_text("raise ModuleNotFoundError('matplotlib')")
    done = run("--n", "16", PYTHONPATH=str(tmp_path))
    assert done.returncode == 2
    assert "pip install 'jaxpd[plot]'" in done.stderr


def test_a_solve_that_fails_says_so(capsys, tmp_path, monkeypatch):
    limited = functools.partial(jaxpd.solve_static, linear_maxiter=3)
    monkeypatch.setattr(jaxpd.main_job, "solve_static", limited)
    assert main(["--n", "16", "--m", "3", "--out", str(tmp_path)]) == 1
    err = capsys.readouterr().err
    assert "Newton: MAX_ITERATIONS after" in err
    assert not (tmp_path / "cracked_plate.png").exists()
