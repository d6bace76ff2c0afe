"""Links without a shape: which they are, and what can stand in for them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import RobotModelError
from calib.geometry import Capsule
from calib.geometry.enclosure import outer_points
from calib.robots import Robot, preset_names
from calib.robots.arm_shapes import (
    bare_links,
    centre_lines,
    makers_like,
    presets_like,
    unshaped_links,
    with_capsules,
    with_shapes_of,
)
from calib.robots.urdf_anew import urdf_of


def without_shapes(preset: str, folder: Path) -> Robot:
    """The arm of a preset as a URDF of its kinematics alone."""
    path = folder / f"{preset}.urdf"
    path.write_bytes(urdf_of(Robot.preset(preset), "kinematics"))
    return Robot.from_urdf(path)


@pytest.mark.parametrize("name", preset_names())
def test_every_preset_knows_all_of_its_links(name):
    robot = Robot.preset(name)
    assert unshaped_links(robot) == ()
    assert not bare_links(robot)


def test_links_without_length_need_no_shape(tmp_path):
    robot = without_shapes("ur10e", tmp_path)
    # shoulder and last wrist: the next joint, or the flange, sits where theirs does
    assert unshaped_links(robot) == tuple(robot.link_names[j] for j in (2, 3, 4, 5))
    assert bare_links(robot) == (robot.link_names[0],)


def test_a_calibrated_wrist_is_still_one_without_length(tmp_path):
    """Its frames have the errors of the arm in them, of a millimetre or two."""
    bare = without_shapes("tx2_60", tmp_path)
    placements = bare.chain.placements.copy()
    placements[1::2, :3, 3] += 1e-3
    placements[2::2, :3, 3] -= 1e-3
    calibrated = replace(bare, chain=replace(bare.chain, placements=placements))
    assert unshaped_links(calibrated) == unshaped_links(bare)
    assert unshaped_links(with_shapes_of(calibrated, "tx2_60")) == ()


@pytest.mark.parametrize("name", preset_names())
def test_the_maker_of_an_arm_is_that_of_the_preset_with_its_kinematics(name, tmp_path):
    controller = Robot.preset(name).controller
    assert controller is not None
    robot = replace(without_shapes(name, tmp_path), name="arm")
    assert makers_like(robot)[:1] == (controller.maker,)


NAMED = [
    ("motoman_gp25", "motoman_gp25_support", "yaskawa"),
    ("arm", "denso_robot_descriptions", None),  # axes are counted otherwise there
    ("gp25", "models", "yaskawa"),
    ("kuka_kr10r1420", "kuka_kr10_support", "kuka"),
    ("rv2fr", "melfa_description", None),
    ("indy7", "indy_description", None),
    ("arm", "jaka_description", None),
    ("armor", "fanciful", None),
]


@pytest.mark.parametrize(("name", "package", "maker"), NAMED)
def test_the_maker_is_named_by_the_description_or_not_guessed(name, package, maker, tmp_path):
    robot = without_shapes("r2000ic165f", tmp_path)
    if maker == "kuka":
        axes = robot.chain.axes * np.array([-1, 1, -1, 1, -1, 1])[:, None]
        robot = replace(robot, chain=replace(robot.chain, axes=axes))
    longer = robot.chain.placements.copy()
    longer[2, :3, 3] *= 1.3  # the arm of no preset
    robot = replace(robot, chain=replace(robot.chain, placements=longer))
    robot = replace(robot, name=name, packages=(package,))
    assert makers_like(robot) == ((maker,) if maker else ())


def test_the_packages_of_a_description_are_known(tmp_path):
    folder = tmp_path / "motoman_gp25_support" / "urdf"
    folder.mkdir(parents=True)
    (folder.parent / "package.xml").write_text("<package><name>motoman</name></package>")
    mesh = '<visual><geometry><mesh filename="package://other/meshes/gp25/a.stl"/></geometry>'
    (folder / "arm.urdf").write_text(
        f'<robot name="arm"><link name="a">{mesh}</visual></link><link name="b"/>'
        '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint></robot>'
    )
    robot = Robot.from_urdf(folder / "arm.urdf")
    assert robot.packages == ("motoman_gp25_support", "other", "meshes", "gp25")


@pytest.mark.parametrize("name", ["r2000ic165f", "ur10e", "panda"])
def test_shapes_of_the_preset_of_the_same_kinematics(name, tmp_path):
    preset, bare = Robot.preset(name), without_shapes(name, tmp_path)
    assert name in presets_like(bare)
    robot = with_shapes_of(bare, name)
    assert unshaped_links(robot) == ()
    assert [body.name for body in robot.bodies] == [body.name for body in preset.bodies]
    for one, other in zip(robot.bodies, preset.bodies, strict=True):
        np.testing.assert_allclose(one.T_link_body, other.T_link_body, atol=1e-9)


def test_another_arm_lends_no_shapes(tmp_path):
    with pytest.raises(RobotModelError, match=r"is another arm than .*: at zero, axis 2") as error:
        with_shapes_of(without_shapes("ur10e", tmp_path), "ur5e")
    assert error.value.hint == "of the same kinematics: ur10e"


def test_capsules_run_from_joint_to_joint(tmp_path):
    bare = without_shapes("r2000ic165f", tmp_path)
    robot = with_capsules(bare, [0.1])
    assert unshaped_links(robot) == ()
    assert robot.fitted_links == tuple(dict.fromkeys(b.name.split("/")[0] for b in robot.bodies))
    state = robot.state(np.linspace(-0.3, 0.4, robot.n))
    for j in range(1, robot.n):
        step = state.origins[j] - state.origins[j - 1]
        if np.linalg.norm(step) < 1e-3:
            continue
        # both joints are on the line of the capsules of the link between them
        own = [body for body in robot.bodies if body.link == j]
        ends = []
        for body in own:
            assert isinstance(body.solid, Capsule)
            assert body.solid.radius_m == 0.1
            half = body.T_link_body[:3, 2] * body.solid.length_m / 2.0
            both = body.T_link_body[:3, 3] + np.array([-half, half])
            ends.append(both @ state.rotations[j - 1].T + state.origins[j - 1])
        line = np.concatenate(ends)
        for joint in (state.origins[j - 1], state.origins[j]):
            assert np.linalg.norm(line - joint, axis=1).min() < 1e-9


def test_capsules_go_round_corners_along_the_axes():
    """An elbow that is higher than the forearm's axis: up first, then along it."""
    chain = Robot.preset("r2000ic165f").chain
    lines = centre_lines(chain)
    legs = [np.diff(line, axis=0) for line in lines if len(line)]
    turns = [legs_of[0] @ legs_of[1] for legs_of in legs if len(legs_of) > 1]
    np.testing.assert_allclose(turns, 0.0, atol=1e-9)


def test_a_radius_for_each_link_or_one_for_all(tmp_path):
    bare = without_shapes("ur10e", tmp_path)
    robot = with_capsules(bare, [0.1, 0.2, 0.3, 0.4, 0.5, 0.6])
    for body in robot.bodies:
        assert outer_points(body.solid)[1] == pytest.approx(0.1 * max(body.link, 1))
    with pytest.raises(RobotModelError, match="2 radii for the 6 links"):
        with_capsules(bare, [0.1, 0.2])


def test_a_lost_shape_is_one_that_is_not_there(tmp_path):
    """Also of a link without length, and of what hangs on a link beside its other bodies."""
    whole = Robot.preset("ur10e")
    name = whole.link_names[6]
    lost = replace(whole, lost_shapes=((6, name), (6, "gripper"), (0, "table")))
    assert set(unshaped_links(lost)) == {name, "gripper", "table"}
    # neither capsules nor a preset know of gripper and table
    assert set(unshaped_links(with_capsules(lost, [0.1]))) == {"gripper", "table"}
    assert set(unshaped_links(with_shapes_of(lost, "ur10e"))) == {"gripper", "table"}
