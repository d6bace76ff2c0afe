"""An SRDF: groups, named postures, links that may touch, and files that are none."""

import numpy as np
import pytest

from calib.errors import RobotModelError
from calib.robots.description.srdf import allowed_contacts, load_srdf
from calib.robots.description.urdf import JointLinks
from calib.robots.shapes import Body, Sphere

SRDF = """<?xml version="1.0"?>
<robot name="duo">
  <group name="left_arm"><chain base_link="left_base" tip_link="left_tool0"/></group>
  <group name="right_arm"><chain base_link="right_base" tip_link="right_tool0"/></group>
  <group name="both"><group name="left_arm"/><group name="right_arm"/></group>
  <group name="hand"><joint name="finger"/></group>
  <group_state name="home" group="left_arm">
    <joint name="left_joint_1" value="0.5"/><joint name="left_joint_2" value="-1e-1"/>
  </group_state>
  <group_state name="home" group="right_arm"><joint name="right_joint_1" value="1"/></group_state>
  <group_state name="tucked" group="right_arm"><joint name="right_joint_1" value="2"/></group_state>
  <end_effector name="hand" parent_link="left_tool0" group="hand"/>
  <virtual_joint name="v" type="fixed" parent_frame="world" child_link="foot"/>
  <passive_joint name="p"/>
  <disable_collisions link1="a" link2="b" reason="Adjacent"/>
  <disable_collisions link1="b/x" link2="c" reason="Never"/>
  <disable_default_collisions link="d"/>
  <enable_collisions link1="d" link2="a"/>
</robot>
"""


@pytest.fixture
def load(tmp_path):
    def read(text: str | bytes):
        path = tmp_path / "duo.srdf"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_srdf(path)

    return read


def test_groups_and_states(load):
    srdf = load(SRDF)
    assert srdf.groups == ("left_arm", "right_arm", "both", "hand")
    assert srdf.chain("left_arm") == ("left_base", "left_tool0")
    assert dict(srdf.state("home", "left_arm")) == {"left_joint_1": 0.5, "left_joint_2": -0.1}
    assert dict(srdf.state("tucked")) == {"right_joint_1": 2.0}


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda s: s.chain("left"), "has no group 'left'"),
        (lambda s: s.chain("hand"), "lists no chain in the group 'hand'"),
        (lambda s: s.state("hom"), r"has no state 'hom' \(did you mean home"),
        (lambda s: s.state("tucked", "left_arm"), "no state 'tucked' of the group 'left_arm'"),
        (lambda s: s.state("home"), "state 'home' of the groups left_arm, right_arm"),
    ],
)
def test_names_that_it_does_not_have(load, ask, message):
    with pytest.raises(RobotModelError, match=message):
        ask(load(SRDF))


def test_links_that_may_touch_by_the_names_of_their_bodies(load):
    bodies = [Body(n, 0, np.eye(4), Sphere(1.0)) for n in ("a", "b", "b/1", "b/x/2", "c", "d", "e")]
    allowed = {frozenset(pair) for pair in allowed_contacts(bodies, load(SRDF))}
    expected = [("a", "b"), ("a", "b/1"), ("b/x/2", "c")]
    expected += [("d", other) for other in ("b", "b/1", "b/x/2", "c", "e")]  # not a: enabled
    assert allowed == {frozenset(pair) for pair in expected}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "not well-formed"),
        ("<robot>", "not well-formed"),
        ("<sdf/>", "the outermost element is <sdf>"),
        ('<robot><link name="a"/></robot>', r"element 'link' is not known .*is it a URDF"),
        ("<robot><disable_colisions/></robot>", "did you mean disable_collisions"),
        ('<robot><disable_collisions link1="a"/></robot>', "has link2=None, which names nothing"),
        ('<robot><group><chain base_link="a" tip_link="b"/></group></robot>', "has name=None"),
        ('<robot><group name="g"><chain base_link="a"/></group></robot>', "has tip_link=None"),
        (
            '<robot><group_state name="s" group="g"><joint name="j" value="1 b"/></group_state>'
            "</robot>",
            "has 'j' at '1 b', no number",
        ),
        (
            '<robot><group_state name="s" group="g"><joint name="j" value="nan"/></group_state>'
            "</robot>",
            "has 'j' at 'nan', no number",
        ),
        (
            '<!DOCTYPE r [<!ENTITY a "aaaa">]><robot><group name="&a;"/></robot>',
            "document types and entities are not accepted",
        ),
        (b"\xff\xfe\x00<", "not well-formed"),
    ],
)
def test_what_is_no_srdf_is_refused_in_one_line(load, text, message):
    with pytest.raises(RobotModelError, match=message) as caught:
        load(text)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(RobotModelError, match=r"cannot be read.*\.srdf of a MoveIt"):
        load_srdf(tmp_path / "no.srdf")


def test_joints_of_several_values_and_blanks_about_names(load):
    """As srdfdom reads them: a planar base has three values, and names are trimmed."""
    srdf = load(
        '<robot><group name=" g "><chain base_link=" a " tip_link="b"/></group>'
        '<group_state name="s" group="g"><joint name="base" value="0 1 2"/>'
        '<joint name=" j " value=" 0.5 "/></group_state></robot>'
    )
    assert srdf.chain("g") == ("a", "b")
    assert dict(srdf.state("s")) == {"j": 0.5}


def test_a_xacro_is_expanded(tmp_path):
    pytest.importorskip("xacro", reason="needs xacro (posedesign[xacro])")
    path = tmp_path / "duo.srdf.xacro"
    path.write_text(
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="p" default="l_"/>'
        '<group name="arm"><chain base_link="$(arg p)base" tip_link="$(arg p)tip"/></group>'
        "</robot>"
    )
    assert load_srdf(path).chain("arm") == ("l_base", "l_tip")


JOINTS = {
    "rail": JointLinks("world", "car", True),
    "foot": JointLinks("car", "base", False),
    "a1": JointLinks("base", "l1", True),
    "a2": JointLinks("l1", "l2", True),
    "a3": JointLinks("l2", "l3", True),
    "mount": JointLinks("l3", "tool0", False),
    "finger": JointLinks("tool0", "tip", True),
}


def grouped(load, inside: str):
    return load(f'<robot name="a"><group name="arm">{inside}</group></robot>')


@pytest.mark.parametrize(
    ("inside", "ends"),
    [
        ('<joint name="a1"/><joint name="a2"/><joint name="a3"/>', ("base", "l3")),
        (
            '<joint name="mount"/><joint name="a3"/><joint name="a1"/><joint name="a2"/>',
            ("base", "tool0"),
        ),
        (
            '<joint name="rail"/><joint name="a1"/><joint name="a2"/><joint name="a3"/>',
            ("world", "l3"),
        ),
        (
            '<link name="l1"/><link name="l2"/><link name="l3"/><link name="tool0"/>',
            ("base", "tool0"),
        ),
    ],
)
def test_a_group_that_lists_joints_or_links_is_their_chain(load, inside, ends):
    assert grouped(load, inside).chain("arm", JOINTS) == ends


@pytest.mark.parametrize(
    ("inside", "joints", "message"),
    [
        ('<joint name="a1"/><joint name="a3"/>', JOINTS, "leaves a2, amid its chain, out of"),
        (
            '<joint name="a1"/><joint name="b"/>',
            JOINTS | {"b": JointLinks("base", "b", True)},
            "joints or links that are no chain in the group 'arm'",
        ),
        ('<joint name="other"/>', JOINTS, "lists no chain in the group 'arm'"),
    ],
)
def test_a_group_that_is_no_chain_is_refused(load, inside, joints, message):
    with pytest.raises(RobotModelError, match=message):
        grouped(load, inside).chain("arm", joints)
