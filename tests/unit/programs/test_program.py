"""Measuring programs: what can be put into one, and the registry of controllers."""

from __future__ import annotations

import gc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import ValidationError

from calib.errors import FileFormatError, InputError
from posedesign.cell.schema import ProgramSection
from posedesign.files.program_numbers import (
    ARGUMENT,
    FRAME,
    OUTPUT,
    REGISTER,
    SECONDS,
    SPEED_PERCENT,
)
from posedesign.programs import (
    DIALECTS,
    Arm,
    Dialect,
    PoseProgram,
    ProgramOptions,
    ProgramPose,
    RecordedProgram,
    find_dialect,
    read,
    validate,
    write,
)
from posedesign.programs.robodk_csv import RobodkCsv

POSE = ProgramPose("T1", np.zeros(6))
FANUC = Arm.usual("fanuc")


def test_a_posture_is_copied_and_closed() -> None:
    posture = np.zeros(6)
    pose = ProgramPose("T1", posture)
    posture[0] = 1.0
    assert pose.posture_rad[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        pose.posture_rad[0] = 1.0


@pytest.mark.parametrize("shape", [(), (0,), (2, 6)])
def test_a_posture_is_one_row(shape: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"'T1': the posture has shape"):
        ProgramPose("T1", np.zeros(shape))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_joint_value_is_finite(value: float) -> None:
    with pytest.raises(InputError, match=r"'T1': J2 is .* not a finite number") as caught:
        ProgramPose("T1", np.array([0, value, 0, 0, 0, 0]))
    assert caught.value.name == "T1"


def test_a_program_has_poses_of_one_arm() -> None:
    with pytest.raises(InputError, match="has no poses"):
        PoseProgram("CAL", ())
    with pytest.raises(InputError, match="'T2' has 7 joint values, pose 'T1' has 6"):
        PoseProgram("CAL", (POSE, ProgramPose("T2", np.zeros(7))))
    program = PoseProgram("CAL", [POSE, POSE])  # type: ignore[arg-type]
    assert program.poses == (POSE, POSE)
    assert program.postures_rad.shape == (2, 6)


@pytest.mark.parametrize(
    ("stops", "parts"),
    [
        ("PPPPPPP", ["PPPPP", "PP"]),
        ("vPvPvPvP", ["vPvP", "vPvP"]),
        ("vPvvPvvPv", ["vPv", "vPv", "vPv"]),
        ("vvvvvvP", ["vvvvv", "vP"]),
    ],
    ids=["poses", "approached", "backed off", "none in reach"],
)
def test_parts_of_a_program_end_at_a_pose_or_backed_off_from_it(stops, parts):
    poses = tuple(ProgramPose("T1", np.zeros(6), via=stop == "v") for stop in stops)
    found = list(PoseProgram("CAL", poses).split(5))
    assert ["".join("Pv"[pose.via] for pose in part.poses) for part in found] == parts
    measured = [part.numbers[i] for part in found for i, p in enumerate(part.poses) if not p.via]
    assert measured == list(range(1, stops.count("P") + 1))


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("user_frame", 1.0, "not a whole number"),
        ("tool_frame", True, "not a whole number"),
        ("speed_percent", 0, "outside 1 to 100"),
        ("speed_percent", 101, "outside 1 to 100"),
        ("settle_s", -0.1, "outside 0 to 1e\\+06"),
        ("settle_s", np.nan, "outside 0 to 1e\\+06"),
        ("fingerprint", "xyz1", "not hexadecimal"),
        ("fingerprint", "abc", "not hexadecimal"),
    ],
)
def test_options_are_checked(option: str, value: object, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        ProgramOptions(**{option: value})  # type: ignore[arg-type]
    assert caught.value.name == option


@pytest.mark.parametrize(
    ("option", "least", "most"),
    [
        ("user_frame", *FRAME),
        ("tool_frame", *FRAME),
        ("speed_percent", *SPEED_PERCENT),
        ("measure_output", *OUTPUT),
        ("measure_argument", *ARGUMENT),
        ("first_register", *REGISTER),
        ("settle_s", *SECONDS),
        ("measure_pulse_s", *SECONDS),
    ],
)
def test_a_cell_has_the_numbers_that_programs_take(option, least, most):
    for value in (least, most):
        ProgramOptions(**{option: value})
        ProgramSection(**{option: value})
    for value in (least - 1, most + 1):
        with pytest.raises(InputError):
            ProgramOptions(**{option: value})
        with pytest.raises(ValidationError):
            ProgramSection(**{option: value})


def test_pendant_j3_is_the_angle_to_the_horizontal() -> None:
    posture = np.radians([0, 15, -25, 0, -50, 0])
    np.testing.assert_allclose(FANUC.shown(posture), [0, 15, -40, 0, -50, 0], atol=1e-12)


def test_moving_j2_alone_on_the_pendant_turns_both_urdf_joints() -> None:
    start = np.array([0.0, 10, -20, 0, 0, 0])
    moved = start + np.array([0, 5, 0, 0, 0, 0])
    change = np.degrees(FANUC.postures(moved) - FANUC.postures(start))
    np.testing.assert_allclose(change, [0, 5, 5, 0, 0, 0], atol=1e-12)


@given(arrays(float, (3, 6), elements=st.floats(-10, 10)))
def test_pendant_and_urdf_are_inverse(postures_rad: np.ndarray) -> None:
    back = FANUC.postures(FANUC.shown(postures_rad))
    np.testing.assert_allclose(back, postures_rad, atol=1e-12)


@pytest.mark.parametrize("convert", [FANUC.shown, FANUC.postures])
@pytest.mark.parametrize("n", [5, 7])
def test_only_six_joints_have_a_fanuc_view(convert: object, n: int) -> None:
    with pytest.raises(InputError, match=f"has {n} joint values"):
        convert(np.zeros((2, n)))  # type: ignore[operator]
    with pytest.raises(InputError, match=f"has {n} joint values, an arm of fanuc has 6"):
        Arm.usual("fanuc", n)


def test_dialects_are_listed_under_their_names() -> None:
    assert "fanuc-ls" in DIALECTS
    for name, dialect in DIALECTS.items():
        assert isinstance(dialect, Dialect)
        assert dialect.name == name
        assert all(suffix == suffix.lower() for suffix in dialect.suffixes)


def test_an_unknown_dialect_lists_the_near_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown dialect 'fanuc'.*did you mean fanuc-ls\?"):
        write(PoseProgram("CAL", (POSE,)), "fanuc", tmp_path)
    with pytest.raises(InputError, match="unknown dialect"):
        find_dialect("")


def test_the_ending_names_the_dialect(tmp_path: Path) -> None:
    program = PoseProgram("CAL", (POSE,))
    for call in (read, validate):
        with pytest.raises(InputError, match=r"no controller's programs end in \.exe"):
            call(tmp_path / "CAL.exe")
    (path,) = write(program, "fanuc-ls", str(tmp_path))
    assert path == tmp_path / "CAL.LS"
    renamed = path.rename(tmp_path / "CAL.txt")
    assert read(renamed, "fanuc-ls").name == "CAL"
    assert validate(renamed, "fanuc-ls") == []


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    for call in (read, validate):
        with pytest.raises(FileFormatError, match=r"CAL\.LS: cannot be read: No such file"):
            call(tmp_path / "CAL.LS")


def test_reading_pauses_the_collector_and_gives_it_back(tmp_path: Path) -> None:
    class Watching(RobodkCsv):
        def parse(self, data: bytes, path: Path) -> RecordedProgram:
            assert not gc.isenabled()
            raise FileFormatError("is broken", path=path)

    path = tmp_path / "X.csv"
    path.write_text("1,2\n")
    assert gc.isenabled()
    with pytest.raises(FileFormatError):
        Watching().read(path)
    assert gc.isenabled()
    gc.disable()
    try:
        with pytest.raises(FileFormatError):
            Watching().read(path)
        assert not gc.isenabled()
    finally:
        gc.enable()
