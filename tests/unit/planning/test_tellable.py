"""Parameters that no pose can tell are named, with the remedy, before anything is planned."""

from dataclasses import replace

import numpy as np
import pytest

from calib.errors import FileFormatError, NotIdentifiableError
from posedesign.cell import Cell
from posedesign.planning import plan
from posedesign.planning.optimal import Request, plan_optimal
from posedesign.planning.optimal.outlook import outlook_of
from posedesign.planning.tellable import untold_of
from posedesign.report.plans import answer_of_choice

ARM = """
[robot]
preset = "{preset}"
[tool]
point_mm = {tool}
[base_pose]
posture_deg = {posture}
[constraints]
collisions = false
[measurement]
kind = "touch-up"
[parameters]
"""
POSTURES = {
    "kr6r900sixx": "[0.0, -75.0, 100.0, 0.0, 60.0, 0.0]",
    "ur10e": "[0.0, -75.0, 100.0, -115.0, -90.0, 0.0]",
}
J6 = 'zero_offsets = ["joint_a2", "joint_a3", "joint_a4", "joint_a5", "joint_a6"]\n'


def cell_of(parameters="", tool="[0.0, 0.0, 150.0]", preset="kr6r900sixx", more=""):
    text = ARM.format(preset=preset, tool=tool, posture=POSTURES[preset])
    return Cell.from_text(text + parameters + more)


def refusal(cell, request=None):
    with pytest.raises(NotIdentifiableError) as error:
        plan(cell) if request is None else plan_optimal(cell, request)
    return str(error.value)


def test_a_tool_on_the_flange_axis_with_the_last_joint_free_is_refused_before_planning():
    said = refusal(cell_of(J6))
    assert said == (
        "no pose can tell zero_offset.joint_a6: the tool point lies on the axis of joint_a6 at "
        "every pose (leave joint_a6 out of parameters.zero_offsets)"
    )


def test_an_offset_of_the_tool_is_advised_only_where_it_helps():
    known = J6 + 'tool_axes = "z"\n'
    said = refusal(cell_of(known))
    assert "or give the tool point an offset from that axis, such as 49 mm" in said
    assert untold_of(cell_of(known, tool="[50.0, 0.0, 150.0]")) is None
    # a free tool point takes the offset of the last joint up, wherever it is
    assert "is absorbed by the tool point" in refusal(cell_of(J6, tool="[50.0, 0.0, 150.0]"))


def test_the_first_joint_is_taken_up_by_the_target():
    first = 'zero_offsets = ["joint_a1", "joint_a2", "joint_a3", "joint_a4", "joint_a5"]\n'
    said = refusal(cell_of(first, tool="[50.0, 0.0, 150.0]"))
    assert "zero_offset.joint_a1 is absorbed by the targets" in said
    assert "leave joint_a1 out of parameters.zero_offsets" in said


@pytest.mark.parametrize("request_", [Request(count=12, criterion="C_G"), Request(count=12)])
def test_chosen_poses_are_refused_where_they_are_for_these_parameters(request_):
    planned = "" if request_.criterion == "C_G" else 'planned = ["zero_offsets"]\n'
    assert "no pose can tell zero_offset.joint_a6" in refusal(cell_of(J6 + planned), request_)


def test_chosen_poses_for_the_arm_that_is_fitted_warn():
    cell = cell_of(J6, more="[pool]\ncandidates = 100\n")
    found = plan_optimal(cell, Request(count=10, beside=0, refine=False))
    warnings = answer_of_choice(cell, found).warnings
    assert any("no pose can tell zero_offset.joint_a6" in said for said in warnings)


@pytest.mark.parametrize("preset", POSTURES)
def test_the_usual_parameters_are_told(preset):
    assert untold_of(cell_of(preset=preset)) is None


def test_few_poses_accuse_no_parameter():
    cell = cell_of()
    narrow = replace(cell.robot, lower=cell.base_posture - 0.01, upper=cell.base_posture + 0.01)
    assert untold_of(replace(cell, robot=narrow)) is None


def test_a_second_target_is_not_judged_by_the_first_alone():
    second = '[[target]]\nname = "a"\n[[target]]\nname = "b"\nposition_mm = [600.0, 200.0, 500.0]\n'
    first = 'zero_offsets = ["joint_a1", "joint_a2", "joint_a3"]\nplanned = ["zero_offsets"]\n'
    assert untold_of(cell_of(first, more=second)) is None


@pytest.mark.parametrize("words", ['"compliance"', '"zero_offsets", "bearings"'])
def test_plans_for_what_gravity_does_need_masses(words):
    with pytest.raises(FileFormatError) as error:
        cell_of(f"planned = [{words}]\n")
    said = str(error.value)
    assert "parameters.planned" in said
    assert "need the masses of the links" in said
    assert "<inertial>" in said
    load = '[[payload]]\nname = "weight"\nmass_kg = 3.0\ncom_mm = [0, 0, 50]\n'
    cell_of(f"planned = [{words}]\n", more=load)  # poses with and without it do tell
    cell_of(f"planned = [{words}]\n", preset="ur10e")


def test_the_outlook_of_a_plan_leaves_out_what_its_poses_do_not_tell():
    cell = cell_of('planned = ["zero_offsets", "compliance"]\n', "[50, 0, 150]", "ur10e")
    planned = plan(cell)
    found = outlook_of(cell, planned.postures)
    assert np.isfinite(found.tcp_m)
    assert 0.0 < found.tcp_m < 1e-2
