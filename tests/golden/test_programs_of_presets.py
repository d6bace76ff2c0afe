"""Every preset in its own controller's language: written, checked, scored again, touched up."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot, preset_names
from posedesign.cell import Cell, cell_template
from posedesign.planning import plan
from posedesign.planning.poses_file import PoseList
from posedesign.pose_programs import import_touch_ups, program_options, write_program
from posedesign.pose_programs.from_plan import arm_of
from posedesign.programs import DIALECTS, PoseProgram, ProgramPose
from posedesign.simulation import SimulatedRobot

PULSES = "[1434.2, -1434.2, 1600.0, 1137.8, -1137.8, 682.7]"
"""Per degree: no arm's own, which are in its controller, but of their size and signs."""


@cache
def planned(preset: str) -> tuple[Cell, PoseList]:
    text = cell_template(preset, surroundings=False)
    text = text.replace("# pulses_per_deg = [..] ", f"pulses_per_deg = {PULSES} ")
    cell = Cell.from_text(text)
    found = plan(cell)
    return cell, PoseList.of_route(found.poses, found.route)


def own_dialects() -> list[tuple[str, str, str]]:
    """Preset, dialect and form: those of its controller, and all that are for any robot."""
    found = []
    for preset in preset_names():
        robot = Robot.preset(preset)
        controller = robot.controller
        for name, dialect in DIALECTS.items():
            if robot.n not in getattr(dialect, "counts", (robot.n,)):
                continue
            if dialect.maker is None or (controller and dialect.maker == controller.maker):
                found += [(preset, name, form) for form in dialect.forms]
    return found


def test_every_preset_has_a_controller_with_a_dialect() -> None:
    own = {preset for preset, name, _ in own_dialects() if DIALECTS[name].maker is not None}
    assert set(preset_names()) == own


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "dialect", "form"), own_dialects())
def test_a_plan_is_written_checked_and_as_good_as_before(preset, dialect, form, tmp_path):
    cell, poses = planned(preset)
    options = program_options(cell, poses, form)
    written = write_program(poses, tmp_path, dialect, options, "CALIB01", cell)
    assert written.problems == ()
    assert written.poses == len(poses.measured.names)
    assert written.c_g_rounded == pytest.approx(written.c_g, rel=0.01)
    # a pulse is up to 1/680 deg, and so is what follows from a pose of 0.0005 mm in a small arm
    assert written.largest_rounding_deg < 0.01


@pytest.mark.parametrize(
    ("preset", "dialect", "form"),
    [case for case in own_dialects() if DIALECTS[case[1]].maker is not None],
)
def test_a_touched_up_program_comes_back(preset, dialect, form, tmp_path):
    cell, poses = planned(preset)
    measured = poses.measured
    touched = SimulatedRobot.of(cell).touch_up(measured.postures, np.random.default_rng(0)).postures
    arrived = iter(touched)
    stops = tuple(
        ProgramPose(name, q if via else next(arrived), via=bool(via))
        for name, q, via in zip(poses.names, poses.postures, poses.via, strict=True)
    )
    program = PoseProgram("CALIB01", stops, program_options(cell, poses, form), arm_of(cell))
    path, *_ = DIALECTS[dialect].write(program, tmp_path)
    back = import_touch_ups(cell, [path], poses)
    assert back.touch_ups.names == measured.names
    assert np.abs(np.rad2deg(back.touch_ups.postures - touched)).max() < 0.01
    assert back.untouched == back.missing == ()


@pytest.mark.parametrize("dialect", [name for name, d in DIALECTS.items() if d.maker is None])
def test_lists_come_back_for_any_robot(dialect: str, tmp_path: Path) -> None:
    joints = getattr(DIALECTS[dialect], "counts", (7,))
    cell, poses = planned("panda" if 7 in joints else "ur5e")
    moved = replace(poses, postures=poses.postures + np.deg2rad(0.1) * ~poses.via[:, None])
    stops = tuple(
        ProgramPose(name, q, via=bool(via))
        for name, q, via in zip(moved.names, moved.postures, moved.via, strict=True)
    )
    program = PoseProgram("CALIB01", stops, program_options(cell, poses), arm_of(cell))
    path, *_ = DIALECTS[dialect].write(program, tmp_path)
    back = import_touch_ups(cell, [path], poses, dialect)
    np.testing.assert_allclose(
        back.touch_ups.postures, moved.measured.postures, atol=np.deg2rad(1e-3)
    )
