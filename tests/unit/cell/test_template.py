"""The example cell that ``posedesign new`` prints."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, RobotModelError
from calib.robots import Robot, preset_names
from posedesign.cell import Cell, cell_template, template
from posedesign.cell.template import REFERENCE
from posedesign.planning import plan
from posedesign.planning.loop import check_base_pose
from tests.board_cells import check_constraints
from tests.marks import rest_in_slow

ARM = """<robot name="arm">
  <link name="base"/>{links}
{joints}</robot>
"""
JOINT = """  <joint name={name} type="{kind}">
    <parent link={parent}/><child link={child}/><origin xyz="{xyz}"/><axis xyz="{axis}"/>
    <limit lower="-2.8" upper="2.8" velocity="3" effort="0"/>
  </joint>
"""
PLACES = (
    ("0 0 0.3", "0 0 1"),
    ("0 0 0", "0 1 0"),
    ("0 0 0.3", "0 1 0"),
    ("0.1 0 0.07", "1 0 0"),
    ("0.2 0 0", "0 1 0"),
    ("0.07 0 0", "1 0 0"),
)


def write_arm(path: Path, suffix: str = "", kind: str = "revolute") -> Path:
    """A small arm whose joints and links end in ``suffix``, an XML attribute's text."""
    links = [f'"l{i}{suffix}"' for i in range(7)]
    joints = "".join(
        JOINT.format(
            name=f'"a{i + 1}{suffix}"',
            kind=kind,
            parent=links[i],
            child=links[i + 1],
            xyz=xyz,
            axis=axis,
        )
        for i, (xyz, axis) in enumerate(PLACES)
    )
    text = "".join(f"<link name={link}/>" for link in links)
    path.write_text(ARM.format(links=text, joints=joints).replace('<link name="base"/>', ""))
    return path


MOUNTED = [f"{name} {mount}" for name in preset_names() for mount in ("flange", "fixed")]


@pytest.mark.parametrize("mounted", rest_in_slow(MOUNTED, ["ur5e flange", "panda fixed"]))
def test_a_cell_with_camera_and_board_is_planned_as_it_is(mounted):
    """And keeps all that it asks for, by a check that is not ours to plan by."""
    name, mount = mounted.split()
    text = cell_template(name, camera=mount)
    cell = Cell.from_text(text)
    assert cell.sees_board
    assert cell.config.camera.mount == mount
    found = plan(cell)
    assert found.reached
    assert len(found.postures) > 20
    check_constraints(cell, found.postures)


def test_reference_is_the_default():
    assert cell_template() == cell_template(REFERENCE) == cell_template("")
    assert tomllib.loads(cell_template())["robot"]["preset"] == REFERENCE


@pytest.mark.parametrize("name", preset_names())
def test_presets_have_a_base_pose_that_can_be_planned_from(name):
    cell = Cell.from_text(cell_template(name))
    check_base_pose(cell)
    assert cell.robot.name == Robot.preset(name).name
    assert cell.offset_joints == cell.robot.joint_names[1:-1]


def test_every_line_fits_and_every_key_says_its_unit():
    text = cell_template()
    assert max(map(len, text.splitlines())) <= 110
    for keys in tomllib.loads(text).values():
        for key, value in (keys[0] if isinstance(keys, list) else keys).items():
            numbers = value if isinstance(value, list) else [value]
            if all(isinstance(v, float) for v in numbers):
                units = ("_mm", "_deg", "_kg", "_s", "_px", "_urad_nm", "threshold", "_value")
                assert key.endswith(units), key


def test_a_urdf_gets_a_base_pose_of_its_own(tmp_path):
    urdf = write_arm(tmp_path / "arm.urdf")
    text = cell_template(str(urdf))
    assert "# DECIDE FIRST: the URDF has no collision geometry for l2, l3, l4, l5:" in text
    cell = Cell.from_text(text.replace("# capsule_radius_mm = ", "capsule_radius_mm = 40.0 # ", 1))
    check_base_pose(cell)
    down = cell.robot.fk(cell.base_posture)[:3, 2]
    np.testing.assert_allclose(down, [0.0, 0.0, -1.0], atol=0.05)
    assert not cell.config.truth.deflection  # nothing is known of its masses


@pytest.mark.parametrize(
    ("suffix", "name"),
    [("&quot;", '"'), ("\\", "\\"), ("{0}", "{0}"), ("é", "é"), ("#", "#"), ("'''", "'''")],
)
def test_names_that_mean_something_in_toml(tmp_path, suffix, name):
    urdf = write_arm(tmp_path / f'ro"b\\o{len(suffix)}t.urdf', suffix)
    cell = Cell.from_text(cell_template(str(urdf)))
    assert cell.offset_joints == tuple(f"a{i}{name}" for i in range(2, 6))
    assert cell.robot.tip_frame == f"l6{name}"


def test_line_ends_in_names_do_not_write_keys(tmp_path):
    urdf = write_arm(tmp_path / "arm.urdf", "&#10;mass_kg = 5")
    try:
        text = cell_template(str(urdf))
    except CalibError:
        return
    assert tomllib.loads(text)["tool"]["mass_kg"] == 0.0
    with pytest.raises(CalibError):
        Cell.from_text(text)


def test_what_was_assumed_of_the_urdf_stands_in_the_cell(tmp_path):
    text = cell_template(str(write_arm(tmp_path / "arm.urdf", kind="continuous")))
    assert "# tip taken to be l6, the last link of the longest chain\n" in text
    assert "# continuous joint a1 is read as one of +-360 deg\n" in text
    assert "# " not in cell_template().split("[robot]\n")[1].splitlines()[0]


@pytest.mark.parametrize(
    ("name", "said", "hint"),
    [
        ("r2000ic165", "neither a preset nor a URDF", "did you mean r2000ic165f"),
        ("robot", "neither a preset nor a URDF", "r2000ic165f"),
        ("no.urdf", "cannot be read", "preset"),
    ],
)
def test_unknown_robots(name, said, hint):
    with pytest.raises(RobotModelError, match=said) as caught:
        cell_template(name)
    assert hint in caught.value.hint


@pytest.mark.parametrize(
    ("axes", "written"),
    [
        ({2: "0 -1 0", 3: "-1 0 0", 4: "0 -1 0", 5: "-1 0 0"}, 'controller = "fanuc"'),
        (
            {3: "0 0 1"},
            "# controller: the description names no maker known here that counts joints",
        ),
    ],
)
def test_only_a_controller_that_fits_is_proposed(axes, written, tmp_path, monkeypatch):
    """A description that is named after FANUC's may have another zero posture."""
    monkeypatch.setattr(template, "suggest_base_posture", lambda *given, **more: np.full(6, 0.3))
    path = write_arm(tmp_path / "arm.urdf")
    text = path.read_text().replace('name="arm"', 'name="fanuc_lr"')
    for k, axis in axes.items():
        old = JOINT.format(
            name=f'"a{k + 1}"',
            kind="revolute",
            parent=f'"l{k}"',
            child=f'"l{k + 1}"',
            xyz=PLACES[k][0],
            axis=PLACES[k][1],
        )
        assert old in text
        text = text.replace(old, old.replace(f'axis xyz="{PLACES[k][1]}"', f'axis xyz="{axis}"'))
    path.write_text(text)
    text = cell_template(str(path))
    assert written in text
    Cell.from_text(text)  # it is never one that the arm is refused for
