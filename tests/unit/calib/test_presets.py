"""The robots that come with the library, against what is published of them."""

from __future__ import annotations

import numpy as np
import pytest

from calib import Robot, preset_names, se3
from calib.errors import RobotModelError
from calib.robots import preset_info
from calib.robots.presets import load_preset

FIG7 = "r2000ia165f_fig7"


def test_pin_tip_of_the_reference_cell(reference_robot):
    """The check value that independent code gave for the reference cell."""
    T_base_tip = reference_robot.fk(np.deg2rad([0, 15, -25, 0, -50, 0]))
    tip_mm = 1e3 * se3.apply(T_base_tip, np.array([0.2, -0.05, 0.35]))
    np.testing.assert_allclose(tip_mm, [1915.4, 50.0, 493.0], atol=0.05)
    expected = se3.rotation_from_wpr(np.deg2rad([180, 0, 0]))
    np.testing.assert_allclose(T_base_tip[:3, :3], expected, atol=1e-14)


def test_pendant_position_of_the_real_controller():
    """Pendant J (0, 0, 0, 0, -90, 0), where URDF and pendant agree: X 1592, Z 1085 mm."""
    robot = Robot.preset("r2000ic165f", base="base")
    T = robot.fk(np.deg2rad([0, 0, 0, 0, -90, 0]))
    np.testing.assert_allclose(T[:3, 3], [1.592, 0, 1.085], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3], np.diag([1, -1, -1]), atol=1e-14)


def test_public_dimensions(reference_robot):
    origins = reference_robot.state(np.zeros(6)).origins
    np.testing.assert_allclose(origins[1], [0.312, 0, 0.670], atol=1e-15)
    np.testing.assert_allclose(origins[2] - origins[1], [0, 0, 1.075], atol=1e-15)
    np.testing.assert_allclose(origins[4] - origins[2], [1.280, 0, 0.225], atol=1e-15)
    tip = reference_robot.fk(np.zeros(6))[:3, 3]
    np.testing.assert_allclose(tip - origins[4], [0.215, 0, 0], atol=1e-15)


def test_lengths_of_figure_7():
    robot = Robot.preset(FIG7)
    origins = robot.state(np.zeros(6)).origins
    np.testing.assert_allclose(origins[1], [0, 0, 0.479], atol=1e-15)  # L1
    np.testing.assert_allclose(origins[2] - origins[1], [0, 0, 1.075], atol=1e-15)  # L2
    np.testing.assert_allclose(origins[4] - origins[2], [1.300, 0, 0], atol=1e-15)  # L3, L4
    tip = robot.fk(np.zeros(6))[:3, 3]
    np.testing.assert_allclose(tip - origins[4], [0.260, 0, 0], atol=1e-15)  # L5, L6


def test_the_figure_folds_the_elbow_offset_into_the_forearm(reference_robot):
    public = reference_robot.state(np.zeros(6)).origins
    assert np.linalg.norm(public[4] - public[2]) == pytest.approx(1.300, abs=5e-4)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_is_complete_and_stands_inside_its_limits(name):
    preset, robot = load_preset(name), Robot.preset(name)
    assert preset.source
    assert preset.confidence
    assert preset.missing
    assert robot.name == name
    assert robot.notices == ()
    robot.check_limits(np.deg2rad(preset.base_posture_deg))
    # the tool points down in front of the arm
    T = robot.fk(np.deg2rad(preset.base_posture_deg))
    np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=1e-12)
    assert T[0, 3] > 1.0
    assert (robot.lower < robot.upper).all()
    assert (robot.speed > 0).all()
    assert (robot.stiffness == [preset.stiffness[j] for j in robot.joint_names]).all()
    masses = [joint["mass_kg"] for joint in preset_info(name)["joint"]]
    np.testing.assert_array_equal(robot.link_mass, masses)
    np.testing.assert_allclose(
        robot.link_com, [np.array(j["com_mm"]) / 1e3 for j in preset_info(name)["joint"]]
    )


def test_unknown_preset_lists_the_near_ones():
    with pytest.raises(RobotModelError, match="there is no preset 'r2000ic165'") as caught:
        Robot.preset("r2000ic165")
    assert "r2000ic165f" in caught.value.hint
    with pytest.raises(RobotModelError, match="known: r2000ia165f_fig7, r2000ic165f"):
        preset_info("../../secret")
