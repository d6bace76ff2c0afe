"""Joint lists of RoboDK: the writer, and that RoboDK's own library loads what it writes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calib import Robot
from calib.errors import InputError
from calib.robots import preset_names
from posedesign.programs import (
    Arm,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    find_dialect,
    read,
    validate,
    write,
)

ROBODK = find_dialect("robodk-csv")
OPTIONS = ProgramOptions(comment="cell 7", fingerprint="abcdef12")
POSES = (
    ProgramPose("T 1", np.radians([0, 15, -25, 0, -50, 1e-9])),
    ProgramPose("over", np.radians([-180, 0, 0, 0.5, -0.5, 700]), via=True),
    ProgramPose("", np.radians([1, 2, 3, 4, 5, 6]), "mind the cable"),
)
ROWS = """\
0.000000,15.000000,-40.000000,0.000000,-50.000000,0.000000
-180.000000,0.000000,0.000000,0.500000,-0.500000,700.000000
1.000000,2.000000,1.000000,4.000000,5.000000,6.000000
"""
BESIDE = """\
posedesign rows of CAL.csv
program: CAL
title: cell 7
PLAN abcdef12 2 2 c98fba8c
controller: fanuc
rows: 3
row 1: pose 1: T 1
row 2: via 3: over
remark: mind the cable
row 3: pose 2
"""


def small(*poses: ProgramPose, **options: object) -> PoseProgram:
    return PoseProgram(
        "CAL",
        poses or POSES,
        replace(OPTIONS, **options),  # type: ignore[arg-type]
        Arm.usual("fanuc"),
    )


def test_a_whole_list_is_as_the_pendant_shows_it(tmp_path: Path) -> None:
    paths = write(small(), "robodk-csv", tmp_path)
    assert [path.name for path in paths] == ["CAL.csv", "CAL.txt"]
    assert paths[0].read_text() == ROWS
    assert paths[1].read_text() == BESIDE
    assert validate(paths[0]) == []

    back = read(paths[0])
    assert (back.name, back.comment, back.maker) == ("CAL", "cell 7", "fanuc")
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    assert [(p.number, p.name, p.line) for p in back.positions] == [
        (1, "T 1", 1),
        (3, "over", 2),
        (2, "", 3),
    ]
    assert [p.number for p in back.measured] == [1, 2]
    np.testing.assert_allclose(back.postures(), small().postures_rad, atol=2e-8, rtol=0)


def test_robodk_loads_the_rows_as_numbers(tmp_path: Path) -> None:
    files = pytest.importorskip("robodk.robofileio", reason="robodk is RoboDK's own library")
    path = write(small(), "robodk-csv", tmp_path)[0]
    rows = files.LoadList(str(path))
    assert rows == [[float(v) for v in line.split(",")] for line in ROWS.splitlines()]
    matrix = files.LoadMat(str(path))
    assert matrix.size() == (3, 6)
    # what RoboDK saves comes back
    matrix.tr().SaveMat(str(tmp_path / "SAVED.csv"))
    saved = read(tmp_path / "SAVED.csv")
    assert [p.number for p in saved.positions] == [1, 2, 3]
    np.testing.assert_array_equal([p.shown_deg for p in saved.positions], rows)


@pytest.mark.parametrize(
    ("options", "poses", "message"),
    [
        ({"comment": "two\nlines"}, (), "cannot stand in a comment"),
        ({}, (ProgramPose("a\nb", np.zeros(6)),), "name of a pose"),
        ({}, (ProgramPose("P", np.zeros(6), "a\rb"),), "comment of pose 'P'"),
        ({}, (ProgramPose("P", np.full(6, 13.0)),), r"pose 'P': J1 is beyond \+-720"),
        ({}, (ProgramPose("P", np.zeros(7)),), "the poses have 7 joint values, the arm 6"),
        ({"measure_output": 3}, (), "switches no output"),
        ({"keep": "register"}, (), "has no registers"),
        ({"form": "cartesian"}, (), "has no cartesian form"),
    ],
)
def test_what_cannot_be_said_is_refused(
    options: dict[str, object], poses: tuple[ProgramPose, ...], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message) as caught:
        write(small(*poses, **options), "robodk-csv", tmp_path)
    assert caught.value.hint
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["7up", "a b", "x" * 65, ""])
def test_names_are_checked(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a name for a list"):
        write(replace(small(), name=name), "robodk-csv", tmp_path)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_written_and_read_back(name: str, tmp_path: Path) -> None:
    robot = Robot.preset(name)
    rng = np.random.default_rng(robot.n)
    # the pendant's J3 of a FANUC arm is a sum of two: within +-720 deg for all of these
    postures = rng.uniform(robot.lower, robot.upper, (9, robot.n))
    poses = tuple(ProgramPose(f"P{k}", q, via=k % 4 == 2) for k, q in enumerate(postures))
    arm = Arm.of(robot)
    path = write(PoseProgram("CAL", poses, OPTIONS, arm), "robodk-csv", tmp_path)[0]
    assert validate(path) == []
    back = read(path)
    assert back.maker == arm.maker
    np.testing.assert_allclose(back.postures(ROBODK.seen(arm)), postures, atol=2e-8, rtol=0)


def check_round_trip(postures: np.ndarray, via: list[bool], folder: Path) -> None:
    arm = Arm.of(Robot.preset("r2000ic165f"))
    stops = zip(postures, via, strict=False)
    poses = tuple(ProgramPose(f"P {k}", q, via=v) for k, (q, v) in enumerate(stops))
    program = PoseProgram("CAL", poses, OPTIONS, arm)
    path = write(program, "robodk-csv", folder)[0]
    assert validate(path) == []
    back = read(path)
    assert tuple(p.number for p in back.positions) == program.numbers
    shown = np.array([p.shown_deg for p in back.positions])
    np.testing.assert_allclose(shown, arm.shown(postures), atol=5.01e-7, rtol=0)
    np.testing.assert_allclose(back.postures(arm), postures, atol=2e-8, rtol=0)


postures_6 = arrays(float, st.tuples(st.integers(1, 8), st.just(6)), elements=st.floats(-6, 6))
stops_8 = st.lists(st.booleans(), min_size=8, max_size=8)


def test_random_plans_come_back(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("lists")
    given(postures_6, stops_8)(
        settings(max_examples=30)(lambda q, via: check_round_trip(q, via, folder))
    )()


@pytest.mark.slow
def test_many_random_plans_come_back(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("lists")
    given(postures_6, stops_8)(
        settings(max_examples=1000)(lambda q, via: check_round_trip(q, via, folder))
    )()
