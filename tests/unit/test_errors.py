"""Errors: what they say, what they carry, and that they survive the way back from a worker."""

import pickle
from pathlib import Path

import pytest

from calib import errors
from calib.errors import (
    CalibError,
    FileFormatError,
    InputError,
    JointLimitError,
    NotIdentifiableError,
    limit_reason,
    near_names,
)


def test_the_hint_stands_in_brackets_behind_the_message():
    assert str(CalibError("it is wrong", hint="mend it")) == "it is wrong (mend it)"
    assert str(CalibError("it is wrong")) == "it is wrong"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (131.2, "J5 131.2 deg is above 125.0 deg"),
        (-131.25, "J5 -131.2 deg is below -125.0 deg"),
        (125.04, "J5 125.04 deg is above 125.00 deg"),
        (-125.0004, "J5 -125.0004 deg is below -125.0000 deg"),
    ],
)
def test_limits_are_told_with_as_many_decimals_as_it_takes(value, said):
    assert limit_reason("J5", value, -125.0, 125.0) == said


def test_joint_limit_error_carries_its_numbers():
    error = JointLimitError("J5", 131.2, -125.0, 125.0, hint="turn back")
    assert error.message == "J5 131.2 deg is above 125.0 deg"
    assert (error.name, error.value, error.bound) == ("J5", 131.2, (-125.0, 125.0))
    assert error.hint == "turn back"


@pytest.mark.parametrize(
    ("place", "start"),
    [
        ({}, "a.csv: "),
        ({"row": 3}, "a.csv, line 3: "),
        ({"column": "j1_deg"}, "a.csv, column j1_deg: "),
        ({"row": 3, "column": "j1_deg"}, "a.csv, line 3, column j1_deg: "),
    ],
)
def test_file_errors_say_where(place, start):
    error = FileFormatError("not a number", path="a.csv", value="x", **place)
    assert error.message == start + "not a number"
    assert error.path == Path("a.csv")
    assert (error.row, error.column) == (place.get("row"), place.get("column"))
    assert error.name == place.get("column", "a.csv")
    assert error.value == "x"


def test_not_identifiable_names_all_parameters_and_reasons():
    error = NotIdentifiableError(["a", "b"], ["a is absorbed by c", "nothing depends on b"])
    assert error.parameters == ("a", "b")
    assert error.combinations == ("a is absorbed by c", "nothing depends on b")
    assert error.name == "a"
    assert error.message == (
        "these measurements cannot identify a, b: a is absorbed by c; nothing depends on b"
    )
    assert error.hint.startswith("leave them out")
    assert NotIdentifiableError(["a"], ["x"]).hint.startswith("leave it out")


@pytest.mark.parametrize(
    ("name", "hint"),
    [
        ("joint_11", "did you mean joint_1 or joint_2?"),
        ("JOINT_2", "did you mean joint_2 or joint_1?"),
        ("wrist", "known: joint_1, joint_2, Flange"),
        ("flange", "did you mean Flange?"),
    ],
)
def test_near_names(name, hint):
    assert near_names(name, ["joint_1", "joint_2", "Flange"]) == hint


def test_near_names_of_none_and_of_many():
    assert near_names("x", []) == "there are none"
    assert near_names("x", (f"name{i}" for i in range(100))).count(",") == 29
    assert near_names("joint", [f"joint_{i}" for i in range(9)], most=2).count(" or ") == 1
    assert "ur-script" in near_names("UR", ["abb-rapid", "ur-script", "ur-urp"])  # short of it


@pytest.mark.parametrize(
    "error",
    [
        InputError("m", hint="h", name="n", value=1, bound=2),
        JointLimitError("J5", 131.2, -125.0, 125.0, hint="h"),
        FileFormatError("m", path="a.csv", row=3, column="c", hint="h"),
        NotIdentifiableError(["a"], ["b"]),
        errors.ConvergenceError("m"),
    ],
    ids=lambda e: type(e).__name__,
)
def test_errors_come_back_whole_from_a_worker_process(error):
    back = pickle.loads(pickle.dumps(error))  # noqa: S301
    assert type(back) is type(error)
    assert str(back) == str(error)
    assert vars(back) == vars(error)


def test_one_family():
    kinds = [k for k in vars(errors).values() if isinstance(k, type) and issubclass(k, Exception)]
    assert len(kinds) >= 9
    assert all(issubclass(kind, CalibError) for kind in kinds)
