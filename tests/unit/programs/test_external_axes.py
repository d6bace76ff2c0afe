"""Axes that carry the arm, in programs of joint positions: all dialects that have some."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError, InputError
from calib.robots import Controller, ExternalAxes
from calib.se3 import inverse, rotation_exp, transform
from posedesign.pose_programs.correcting import correct_positions
from posedesign.programs import (
    DIALECTS,
    Arm,
    PoseProgram,
    ProgramPose,
    RecordedProgram,
    postures_of,
)
from posedesign.programs.yaskawa_jbi import YaskawaJbi
from tests.unit.correction.test_compensation import clear_postures
from tests.unit.pose_programs.test_corrected_programs import errors_of, on_a_rail
from tests.unit.programs.dialects import (
    CARRIED,
    HOW,
    PULSES_PER_MM,
    TOOL,
    USER,
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


WORLD = transform(rotation_exp(np.array([0.1, -0.2, 2.0])), [0.4, -1.2, 0.3])


@pytest.mark.parametrize("name", ["kuka-krl", "abb-rapid"])
def test_poses_have_the_rail_beside_them_in_a_world_that_stands(name, tmp_path):
    robot, dialect = on_a_rail(name), dialect_of(name)
    arm = Arm.of(robot, USER, TOOL)
    arm = replace(arm, controller=replace(arm.controller, T_base_world=WORLD), world_stands=True)
    q = clear_postures(robot, 8)
    # the tool in the same place, with the rail farther on
    user_tool = inverse(USER) @ inverse(WORLD) @ robot.fk(q) @ TOOL
    along = q[:1, :1] + 0.05
    there = arm.postures_at(user_tool[:1], [None], np.hstack([along, q[:1, 1:]]), places=along)
    np.testing.assert_allclose(robot.fk(there), robot.fk(q[:1]), atol=1e-8)
    q, wanted = np.vstack([q, there]), np.vstack([user_tool, user_tool[:1]])
    poses = tuple(ProgramPose(f"T{k}", row) for k, row in enumerate(q))
    program = PoseProgram("CALPOSE", poses, options_of(name, form="cartesian"), arm)
    paths = dialect.write(program, tmp_path)
    assert [p for path in paths for p in dialect.validate(path)] == []
    back = dialect.read(paths[0])
    T = np.stack([p.T_user_tool for p in back.positions if p.T_user_tool is not None])
    np.testing.assert_allclose(T, wanted, atol=3e-7)
    rail = np.array([p.external_shown for p in back.positions])[:, 0]
    np.testing.assert_allclose(rail, 1e3 * q[:, 0], atol=6e-5)
    np.testing.assert_allclose(back.postures(arm), q, atol=2e-5)
    with pytest.raises(InputError, match=r"has no value \[mm\] of E1"):
        postures_of((replace(back.positions[1], external_shown=()),), arm)
    with pytest.raises(InputError, match="where an external axis has the arm is not in it"):
        back.postures(replace(arm, world_stands=False))
    model, x = errors_of(robot)
    how = {"tool_m": TOOL[:3, 3]}
    done = correct_positions(dialect, paths[0].read_bytes(), paths[0], arm, model, x, **how)
    assert done.ok, done.reasons
    assert done.moved_m.max() > 1e-3
    assert done.written_m.max() < 1e-6
    again = dialect.parse(done.data, paths[0]).positions
    assert [p.external_shown for p in again] == [p.external_shown for p in back.positions]


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
    (two,) = YaskawaJbi().files(moved_program("yaskawa-jbi", 2)).values()
    with pytest.raises(FileFormatError, match="the comment 'PULSES E1 is lost"):
        parse(changed(two, "'PULSES E1 1310.72\n", ""))
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
    assert parse(beside).positions[0].external_shown == pytest.approx((100.0,))


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


@pytest.mark.parametrize("name", ["yaskawa-jbi", "mitsubishi-melfa"])
def test_axes_in_millimetres_are_not_read_as_a_table_in_degrees(name):
    on_slide, dialect = arm_on_slides(name, 1), dialect_of(name)
    beside = replace(on_slide.controller, external=ExternalAxes(positioner=1))
    with pytest.raises(InputError, match=r"turns what is measured, .* not written, nor read"):
        dialect.seen(replace(on_slide, controller=beside))
    assert dialect.seen(on_slide).n_external == 1
