"""Bad inputs are answered by an error that names the argument; none is let in.

The tables are `tests.bad_inputs`, `tests.bad_scenes` and `tests.bad_doors`. An answer
counts as named if it is a `ValueError` whose message has the name of the argument
before the first colon.
"""

import collections
import re
from pathlib import Path

import pytest

from tests import bad_doors, bad_inputs, bad_scenes

README = Path(__file__).parent.parent / "README.md"
CASES = bad_inputs.CASES + bad_scenes.CASES + bad_doors.CASES


def door_of(label):
    """The door of a case."""
    return re.split(r"[(,]", label)[0]


def answer(name, call):
    """What a bad input was answered by: "named", or what else happened."""
    try:
        given = call()
    except ValueError as error:
        head = str(error).split(": ")[0]
        told = re.search(rf"\b({name})\b", head)
        return "named" if told else f"unnamed: {error}"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return f"silent: {given!r}"


@pytest.mark.parametrize("door", sorted({door_of(label) for label, *_ in CASES}))
def test_every_bad_input_is_answered_by_an_error_that_names_the_argument(door):
    mine = [case for case in CASES if door_of(case[0]) == door]
    answers = {label: answer(name, call) for label, name, call in mine}
    assert {k: v for k, v in answers.items() if v != "named"} == {}


def test_the_table_is_long_and_has_every_kind_of_door():
    doors = collections.Counter(door_of(label) for label, *_ in CASES)
    assert len(CASES) >= 1000
    assert f"the cure: {len(CASES)}\nbad inputs" in README.read_text()
    assert len(doors) >= 40
    assert len({label for label, *_ in CASES}) == len(CASES)
