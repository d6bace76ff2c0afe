"""Axes that carry the arm, in programs of joint positions: all dialects that have some."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError, InputError
from calib.robots import Controller, ExternalAxes
from posedesign.programs import DIALECTS, Arm, PoseProgram, ProgramPose, RecordedProgram
from posedesign.programs.yaskawa_jbi import YaskawaJbi
from tests.unit.programs.dialects import (
    CARRIED,
    HOW,
    PULSES_PER_MM,
    arm_on_slides,
    changed,
    dialect_of,
    options_of,
)


def moved_program(name: str, slides: int) -> PoseProgram:
    """Some poses by chance, on slides of some metres."""
    arm, rng = arm_on_slides(name, slides), np.random.default_rng(slides)
    q = rng.uniform(-2.0, 2.0, (5, arm.n)) * np.where(np.arange(arm.n) < slides, 2.0, 1.0)
    poses = tuple(ProgramPose(f"T{k}", row, via=k == 2) for k, row in enumerate(q))
    return PoseProgram(
        "CALPOSE", poses, options_of(name, pulses_per_mm=PULSES_PER_MM[:slides]), arm
    )


@pytest.mark.parametrize("slides", [1, 2])
@pytest.mark.parametrize("name", CARRIED)
def test_where_slides_stand_is_written_checked_and_read(name, slides, tmp_path):
    program, dialect = moved_program(name, slides), dialect_of(name)
    assert program.arm is not None
    paths = dialect.write(program, tmp_path)
    assert dialect.validate(paths[0]) == []
    back = dialect.read(paths[0])
    order = [back_number(program, p.number) for p in back.positions]
    off = np.abs(back.postures(dialect.seen(program.arm)) - program.postures_rad[order])
    assert off[:, :slides].max() <= 1e-6  # micrometres
    assert off.max() <= np.radians(2 * HOW[name].joint_deg)
    with pytest.raises(CalibError, match=r"differs|stand elsewhere|is this the program of"):
        back.postures(dialect.seen(arm_on_slides(name, 0)))
    more = arm_on_slides(name, slides + 1)
    with pytest.raises(InputError, match=r"has no value \[mm\] of E|joint values, the arm"):
        back.postures(dialect.seen(more))


def back_number(program: PoseProgram, number: int) -> int:
    """Index of the pose of this number."""
    return program.numbers.index(number)


YASKAWA = moved_program("yaskawa-jbi", 1)
(JOB,) = YaskawaJbi().files(YASKAWA).values()


def parse(text: str, dialect: YaskawaJbi | None = None) -> RecordedProgram:
    return (dialect or YaskawaJbi()).parse(text.encode(), Path("X.JBI"))


def test_the_base_axis_of_a_yaskawa_stands_beside_the_arm():
    assert "///NPOS 5,5,0,0,0,0\n" in JOB
    assert "///GROUP1 RB1,BS1\n" in JOB
    assert "'PULSES E1 1310.72\n" in JOB
    assert "MOVJ C00004 BC00004 VJ=" in JOB
    q = YASKAWA.poses[0].posture_rad
    assert f"\nBC00000={round(1e3 * q[0] * 1310.72)}\n" in JOB


def test_pulses_of_a_base_axis_are_asked_for(tmp_path):
    without = PoseProgram(
        "A", YASKAWA.poses, options_of("yaskawa-jbi", pulses_per_mm=()), YASKAWA.arm
    )
    with pytest.raises(InputError, match=r"pulses_per_mm has 0 values: .* one for each of E1"):
        YaskawaJbi().files(without)
    assert YaskawaJbi(pulses_per_mm=PULSES_PER_MM[:1]).files(without) == {
        "A.JBI": JOB.replace("CALPOSE", "A")
    }
    huge = options_of("yaskawa-jbi", pulses_per_mm=(1e6,))
    with pytest.raises(InputError, match="more pulses than 32 bits have"):
        YaskawaJbi().files(PoseProgram("A", YASKAWA.poses, huge, YASKAWA.arm))
    silent = changed(JOB, "'PULSES E1 1310.72\n", "")
    with pytest.raises(InputError, match=r"has no value .* of E1") as caught:
        parse(silent).postures(YASKAWA.arm)
    assert "give pulses_per_mm" in caught.value.hint
    given = YaskawaJbi().reading((), PULSES_PER_MM[:1])
    np.testing.assert_array_equal(
        parse(silent, given).postures(YASKAWA.arm), parse(JOB).postures(YASKAWA.arm)
    )
    with pytest.raises(FileFormatError, match="the pulses/mm of its comments are not those given"):
        parse(JOB, YaskawaJbi().reading((), (1310.0,)))


def test_a_touched_up_variable_has_the_base_axis_beside_it():
    kept = changed(JOB, "\nCALL JOB:MEASURE\n", "\nCALL JOB:MEASURE\nGETS PX001 $PX000\n")
    kept = changed(kept, "NPOS 5,5,0,0", "NPOS 5,5,0,1")
    kept = changed(kept, "//INST", "P00001=0,0,0,0,0,0\n//INST")
    with pytest.raises(InputError, match=r"has no value .* of E1"):
        parse(kept).postures(YASKAWA.arm)
    beside = changed(changed(kept, "5,5,0,1,0", "5,5,0,1,1"), "//INST", "BP00001=131072\n//INST")
    assert parse(beside).positions[0].external_mm == pytest.approx((100.0,))


def test_a_melfa_has_additional_axes_behind_six_joints():
    five = Arm(Controller("", np.eye(6), np.eye(4), ExternalAxes(slides=1)))
    poses = (ProgramPose("T1", np.zeros(6)),)
    with pytest.raises(InputError, match="stand behind six joints, the arm has 5"):
        DIALECTS["mitsubishi-melfa"].files(PoseProgram("A", poses, arm=five))
    program = moved_program("mitsubishi-melfa", 1)
    (text,) = DIALECTS["mitsubishi-melfa"].files(program).values()
    assert "NOT CHECKED: zero, direction and unit of J7, taken to be those of joint_7" in text
    with pytest.raises(InputError, match=r"the external axes of .* are not written"):
        DIALECTS["mitsubishi-melfa"].files(moved_program("mitsubishi-melfa", 3))
