"""A cell with an SRDF and a MoveIt scene."""

import numpy as np
import pytest

from calib import se3
from calib.errors import CalibError, FileFormatError
from calib.geometry import Box, Cylinder, Mesh, Sphere
from posedesign.cell import Cell, cell_template
from posedesign.cell.file import cell_text
from posedesign.cell.moveit_scene import LARGEST_SCENE_BYTES, read_scene
from tests.two_arms import two_arms

OLD = """(noname)
* table
1
box
1.5 0.8 0.04
0.75 0 -0.5
0 0 0 1
0 0 0 0
* post 2
2
cylinder
0.05 1
-0.5 0.4 0
0.7071068 0 0 0.7071068
0.5 0.5 0.5 1
sphere
0.1
-0.5 0.4 0.5
0 0 0 1
0 0 0 0
.
"""

NEW = """bench
* bench
0.5 0 0.2
0 0 0.7071068 0.7071068
1
mesh
4 4
0 0 0
0.3 0 0
0 0.3 0
0 0 0.3
0 2 1
0 1 3
1 2 3
2 0 3
0.1 0 0
0 0 0 1
0.2 0.2 0.2 1
2
edge
0 0 0
0 0 0 1
corner
0 0 0.1
0 0 0 1
.
"""

SRDF = """<robot name="duo">
<group name="left_arm"><chain base_link="left_base" tip_link="left_tool0"/></group>
<group_state name="ready" group="left_arm">{}</group_state>
<group_state name="half" group="left_arm"><joint name="left_joint_1" value="0"/></group_state>
<group_state name="tucked" group="right_arm"><joint name="right_joint_2" value="-0.5"/>
<joint name="lift" value="0.2"/><joint name="left_joint_2" value="1"/><joint name="no" value="1"/>
</group_state>
<disable_collisions link1="left_link_2" link2="left_link_5" reason="Never"/>
<disable_collisions link1="left_link_2" link2="gripper" reason="Never"/>
</robot>"""

READY_DEG = (0.0, 10.0, -30.0, 0.0, -60.0, 0.0)


@pytest.fixture
def write(tmp_path):
    def scene(text: str):
        path = tmp_path / "cell.scene"
        path.write_text(text)
        return path

    return scene


def test_a_scene_of_the_old_format(write):
    table, post, ball = read_scene(write(OLD))
    assert [name for name, _, _ in (table, post, ball)] == ["table", "post 2/1", "post 2/2"]
    assert table[2] == Box((1.5, 0.8, 0.04))
    np.testing.assert_allclose(table[1], se3.transform(np.eye(3), [0.75, 0, -0.5]))
    assert post[2] == Cylinder(0.05, 1.0)
    quarter = se3.rotation_exp(np.array([np.pi / 2, 0, 0]))
    np.testing.assert_allclose(post[1], se3.transform(quarter, [-0.5, 0.4, 0]), atol=1e-7)
    assert ball[2] == Sphere(0.1)


def test_a_scene_of_the_new_format_places_shapes_in_their_object(write):
    ((name, T, mesh),) = read_scene(write(NEW))
    assert name == "bench"
    assert isinstance(mesh, Mesh)
    assert len(mesh.triangles) == 4
    quarter = se3.rotation_exp(np.array([0, 0, np.pi / 2]))
    np.testing.assert_allclose(T, se3.transform(quarter, [0.5, 0.1, 0.2]), atol=1e-7)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("box", "cone", "'cone' as a shape of 'table', which is no solid"),
        ("box", "plane", "'plane' as a shape of 'table', which is no solid"),
        ("box", "boxx", r"'boxx' .* not known .*did you mean box"),
        ("1.5 0.8 0.04", "1.5 0.8 -0.04", "sizes"),
        ("1.5 0.8 0.04", "1.5 0.8 nan", "not finite"),
        ("1.5 0.8 0.04", "1.5 0.8", "no number where|length 1"),
        ("1.5 0.8 0.04", "1.5 0.8 1e9", "sizes"),
        ("0 0 0 1\n0 0 0 0\n*", "0 0 0 0\n0 0 0 0\n*", "quaternion that is not of length 1"),
        ("0.75 0 -0.5", "0.75 0 -5e5", "beyond 1000 m"),
        ("* table\n1\n", "* table\n1000001\n", "as its number of shapes"),
        ("* table\n1\n", "* table\n-1\n", "as its number of shapes"),
        ("* table\n1\n", "* table\n\u0661\n", "as its number of shapes"),
        ("* post 2", "* table", "an object named 'table'"),
        ("* post 2", "*", "an object named ''"),
        ("* post 2", "+ post", "where an object"),
        ("\n.\n", "\n", "ends where an object or the end should be"),
        (OLD, "", "ends where"),
        (OLD, "(noname)\n.\n", "has no objects"),
    ],
)
def test_what_is_not_understood_in_a_scene_is_refused_by_name(write, old, new, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        read_scene(write(OLD.replace(old, new, 1)))
    assert "\n" not in str(caught.value)


def test_meshes_of_scenes_are_checked(write):
    for old, new in (("0 2 1", "0 2 9"), ("0 2 1", "0 2 1.5"), ("0.3 0 0", "inf 0 0")):
        with pytest.raises(FileFormatError):
            read_scene(write(NEW.replace(old, new, 1)))
    with pytest.raises(FileFormatError, match="number of vertices"):
        read_scene(write(NEW.replace("4 4", "99999999 4")))
    with pytest.raises(FileFormatError):
        read_scene(write(NEW + " " * LARGEST_SCENE_BYTES))


@pytest.fixture
def cell_with(tmp_path):
    (tmp_path / "duo.urdf").write_text(two_arms())
    joints = "".join(
        f'<joint name="left_joint_{k}" value="{np.deg2rad(deg)}"/>'
        for k, deg in enumerate(READY_DEG, start=1)
    )
    (tmp_path / "duo.srdf").write_text(SRDF.format(joints))
    (tmp_path / "cell.scene").write_text(OLD)

    def build(robot: str, pose: str, more: str = "") -> Cell:
        text = f"""
[robot]
urdf = "duo.urdf"
srdf = "duo.srdf"
{robot}
[tool]
point_mm = [0.0, 0.0, 100.0]
[base_pose]
{pose}
{more}
"""
        return Cell.from_text(text, tmp_path / "cell.toml")

    return build


IN_THE_GROUP = 'group = "left_arm"\nheld_deg = { waist = 20.0 }\nheld_mm = { lift = 100.0 }'


def test_group_state_and_pairs_of_an_srdf(cell_with):
    cell = cell_with(IN_THE_GROUP, 'state = "ready"')
    assert (cell.robot.base_frame, cell.robot.tip_frame) == ("left_base", "left_tool0")
    np.testing.assert_allclose(np.rad2deg(cell.base_posture), READY_DEG, atol=1e-12)
    assert cell.robot.allowed_contacts == (("left_link_2", "left_link_5"),)
    left_out = {frozenset(cell.scene.names(k)) for k in range(len(cell.scene.pairs))}
    assert frozenset(("left_link_2", "left_link_5")) not in left_out
    assert frozenset(("left_link_2", "left_link_6")) in left_out
    assert "1 pairs of links: robot.srdf lets them touch" in cell.not_checked


def test_other_joints_are_held_in_named_states(cell_with):
    """Those of the arm itself are left to it, and what else is asked goes before."""
    held = 'group = "left_arm"\nheld_states = ["tucked"]\nheld_mm = { lift = 100.0 }'
    robot = cell_with(held, 'state = "ready"').robot
    assert robot.n == 6
    said = next(notice for notice in robot.notices if notice.startswith("held"))
    assert said == "held: lift at 100 mm, right_joint_2 at -28.6479 deg"
    locked = cell_with(
        held.replace("held_mm = { lift = 100.0 }", 'lock = ["lift"]'), 'state = "ready"'
    )
    assert "held: right_joint_2 at -28.6479 deg" in locked.robot.notices
    with pytest.raises(CalibError, match="has no state 'tuck'"):
        cell_with(held.replace("tucked", "tuck"), 'state = "ready"')


def test_a_scene_stands_in_the_root_of_the_description(cell_with):
    obstacle = '[[obstacle]]\nname = "hall"\nkind = "scene"\nscene = "cell.scene"\n'
    obstacle += "at_mm = [0.0, 0.0, 3000.0]"
    cell = cell_with(IN_THE_GROUP, 'state = "ready"', obstacle)
    names = [body.name for body in cell.obstacles]
    assert names == ["hall/table", "hall/post 2/1", "hall/post 2/2"]
    T_root_table = se3.transform(np.eye(3), [0.75, 0, 2.5])
    waist = se3.transform(
        se3.rotation_exp(np.array([0, 0, np.deg2rad(20)])), [0, 0, 0.1 + 0.1 + 0.9]
    )
    mount = se3.transform(se3.rotation_exp(np.array([-0.6, 0, 0])), [0, 0.3, 0])
    expected = se3.inverse(waist @ mount) @ T_root_table
    np.testing.assert_allclose(cell.obstacles[0].T_link_body, expected, atol=1e-12)


def test_such_a_cell_is_written_and_read_again(cell_with, tmp_path):
    obstacle = '[[obstacle]]\nname = "hall"\nkind = "scene"\nscene = "cell.scene"\n'
    cell = cell_with(IN_THE_GROUP, 'state = "ready"', obstacle + "at_mm = [0.0, 0.0, 3000.0]")
    back = Cell.from_text(cell_text(cell.config, tmp_path))
    np.testing.assert_array_equal(back.base_posture, cell.base_posture)
    np.testing.assert_array_equal(back.robot.chain.placements, cell.robot.chain.placements)
    assert back.robot.allowed_contacts == cell.robot.allowed_contacts
    assert len(back.obstacles) == 3


@pytest.mark.parametrize(
    ("robot", "pose", "message"),
    [
        (IN_THE_GROUP, 'state = "redy"', "did you mean ready"),
        (IN_THE_GROUP, 'state = "half"', "has no value of left_joint_2"),
        (IN_THE_GROUP, 'state = "ready"\nposture_deg = [0.0]', "either posture_deg or state"),
        (IN_THE_GROUP, "", "either posture_deg or state"),
        ('group = "arm"', 'state = "ready"', "has no group 'arm'"),
        ('group = "left_arm"\nheld_mm = { waist = 1.0 }', 'state = "ready"', "joint waist turns"),
    ],
)
def test_what_an_srdf_does_not_have(cell_with, robot, pose, message):
    with pytest.raises(CalibError, match=message):
        cell_with(robot, pose)


def test_a_state_needs_an_srdf():
    text = cell_template().replace("posture_deg = ", 'state = "home"  # ', 1)
    with pytest.raises(FileFormatError, match="the cell has no SRDF"):
        Cell.from_text(text)


def test_new_names_tip_base_and_what_is_held(tmp_path):
    path = tmp_path / "duo.urdf"
    path.write_text(two_arms())
    cell = Cell.from_text(cell_template(str(path), tip="right_tool0", base="right_base"))
    assert cell.robot.joint_names[0] == "right_joint_1"
    with_waist = Cell.from_text(cell_template(str(path), tip="right_tool0", lock=["lift"]))
    assert with_waist.robot.n == 7
    with pytest.raises(CalibError, match="leave them out"):
        cell_template("ur5e", tip="tool0")


def test_new_says_that_an_srdf_lies_beside_the_urdf(tmp_path):
    path = tmp_path / "duo.urdf"
    path.write_text(two_arms())
    said = {"tip": "right_tool0", "base": "right_base"}
    assert '# srdf = "arm.srdf"' in cell_template(str(path), **said)
    (tmp_path / "duo.srdf").write_text(SRDF.format(""))
    text = cell_template(str(path), **said)
    line = next(line for line in text.splitlines() if line.startswith("# srdf"))
    assert line.startswith(f'# srdf = "{tmp_path / "duo.srdf"}"')
    cell = Cell.from_text(text.replace("# srdf", "srdf", 1))
    assert cell.config.robot.srdf is not None
