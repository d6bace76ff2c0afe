"""Zero offsets as controllers want them."""

from dataclasses import replace

import numpy as np
import pytest

from calib import CalibrationModel, Robot
from calib.model.measurements import TouchUp
from calib.model.parameters import TargetPoints, ToolPoint, ZeroOffsets
from calib.robots import POSITIVE_AXES, preset_info, preset_names
from calib.robots.controller import Coupling
from posedesign.pose_programs.correction import mastering
from tests.arms import DESCRIPTIONS, robot_of


def model_of(robot: Robot, joints: tuple[str, ...]) -> CalibrationModel:
    blocks = [ZeroOffsets(robot, joints), ToolPoint([0, 0, 0.1]), TargetPoints([[1, 0, 0.5]])]
    return CalibrationModel(robot, blocks, TouchUp(1e-5))


def with_offsets(model: CalibrationModel, degrees: list[float]) -> np.ndarray:
    x = model.nominal.copy()
    x[: len(degrees)] = np.deg2rad(degrees)
    return x


def test_every_maker_has_an_arm():
    makers = {preset_info(name)["controller"] for name in preset_names()}
    assert makers | set(DESCRIPTIONS) == set(POSITIVE_AXES)


@pytest.mark.parametrize("name", [*preset_names(), *DESCRIPTIONS])
def test_corrected_pendant_values_take_the_arm_where_the_nominal_one_goes(name):
    robot = robot_of(name) if name in DESCRIPTIONS else Robot.preset(name)
    assert robot.controller is not None
    rng = np.random.default_rng(0)
    model = model_of(robot, robot.joint_names)
    x = with_offsets(model, rng.uniform(-0.5, 0.5, robot.n).tolist())
    table = mastering(model, x, sigma=np.full(model.p, 1e-5))
    shown_deg = rng.uniform(-60, 60, (20, robot.n))
    typed = robot.controller.posture(shown_deg - np.rad2deg(table.correction))
    real = model.view(typed, x).T_base_tip
    nominal = robot.fk(robot.controller.posture(shown_deg))
    np.testing.assert_allclose(real, nominal, atol=1e-12)
    # and the other way about: where the joints are is what is shown, plus the correction
    q = robot.controller.posture(shown_deg)
    there = robot.controller.pendant(q + model.view(q, x).joint_errors)
    np.testing.assert_allclose(there, shown_deg + np.rad2deg(table.correction), atol=1e-9)


def test_fanucs_third_joint_has_a_part_of_the_second():
    robot = Robot.preset("r2000ic165f")
    model = model_of(robot, ("joint_2", "joint_3"))
    x = with_offsets(model, [0.1, 0.3])
    C = np.zeros((model.p, model.p))
    C[:2, :2] = np.deg2rad(0.01) ** 2 * np.array([[4.0, 1.5], [1.5, 1.0]])
    rows = mastering(model, x, C).rows()
    assert rows[1]["correction_deg"] == pytest.approx(0.1)
    assert rows[2]["correction_deg"] == pytest.approx(0.2)
    assert rows[1]["sigma_deg"] == pytest.approx(0.02)
    assert rows[2]["sigma_deg"] == pytest.approx(0.01 * np.sqrt(4.0 + 1.0 - 2 * 1.5))
    assert rows[1]["meaning"] == (
        "add +0.1000 deg to what the pendant shows as J2 to get where the joint is"
    )
    assert rows[2]["meaning"] == (
        "add +0.2000 deg to what the pendant shows as J3 to get where the joint is: its own offset "
        "less the offset of J2"
    )


def test_without_correlations_the_sigma_is_a_bound():
    robot = Robot.preset("r2000ic165f")
    model = model_of(robot, ("joint_2", "joint_3"))
    x, sigma = with_offsets(model, [0.1, 0.3]), np.full(model.p, np.deg2rad(0.01))
    table = mastering(model, x, sigma=sigma)
    assert table.bounded
    assert table.rows()[2]["sigma_deg"] == pytest.approx(0.02)
    assert not mastering(model, x, np.diag(sigma**2)).bounded
    assert mastering(model, x).rows()[2]["sigma_deg"] is None


def test_joints_that_were_not_identified_say_so():
    robot = Robot.preset("r2000ic165f")
    model = model_of(robot, ("joint_2",))
    rows = mastering(model, with_offsets(model, [0.1]), sigma=np.full(model.p, 1e-4)).rows()
    assert [row["pendant_joint"] for row in rows] == [f"J{j}" for j in range(1, 7)]
    for j in (0, 3, 4, 5):
        assert rows[j]["meaning"] == f"J{j + 1} was not identified: its zero is taken as it is"
        assert rows[j]["correction_deg"] == 0.0
        assert rows[j]["sigma_deg"] is None
    assert rows[2]["correction_deg"] == pytest.approx(-0.1)
    assert rows[2]["sigma_deg"] is not None
    assert str(rows[2]["meaning"]).endswith("(its own was not identified and counts as none)")
    assert all("\n" not in str(row["meaning"]) for row in rows)


def test_an_unknown_controller_has_the_signs_of_the_description():
    robot = replace(Robot.preset("r2000ic165f"), controller=None)
    model = model_of(robot, ("joint_2", "joint_3"))
    rows = mastering(model, with_offsets(model, [0.1, 0.3])).rows()
    assert rows[2]["correction_deg"] == pytest.approx(0.3)
    assert "joint_3, in the signs of the description" in str(rows[2]["meaning"])


@pytest.mark.parametrize("ratio", [1.0, 0.5, -1.0])
def test_a_coupled_joint_of_any_maker_is_mastered_with_the_other(ratio):
    """What is typed, less the correction, takes the arm where the nominal one goes."""
    robot = Robot.preset("irb120")
    robot = robot.controlled_by("abb", [Coupling("joint_3", "joint_2", ratio)])
    model = model_of(robot, robot.joint_names)
    x = with_offsets(model, [0.0, 0.1, 0.3, 0.0, 0.0, 0.0])
    table = mastering(model, x)
    np.testing.assert_allclose(np.rad2deg(table.correction[1:3]), [0.1, 0.3 + 0.1 * ratio])
    word = {1.0: "plus the offset", 0.5: "plus 0.5 of the offset", -1.0: "less the offset"}[ratio]
    assert table.rows()[2]["meaning"].endswith(f"its own offset {word} of J2")
    shown_deg = np.random.default_rng(0).uniform(-60, 60, (20, 6))
    typed = robot.controller.posture(shown_deg - np.rad2deg(table.correction))
    nominal = robot.fk(robot.controller.posture(shown_deg))
    np.testing.assert_allclose(model.view(typed, x).T_base_tip, nominal, atol=1e-12)
