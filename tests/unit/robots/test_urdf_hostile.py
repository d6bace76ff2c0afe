"""Damaged URDFs: an arm or an error that a person can use, and never a word from elsewhere."""

import os
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from calib import Robot
from calib.errors import CalibError

VALID = (
    '<robot name="arm">'
    + "".join(
        f'<link name="l{i}"><inertial><origin xyz="0 0 0.1"/><mass value="2"/>'
        '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
        '<collision><origin xyz="0 0 0" rpy="0 0.1 0"/><geometry><box size="0.1 0.2 0.3"/>'
        "</geometry></collision></link>"
        for i in range(4)
    )
    + "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<origin xyz="0.1 0 0.3" rpy="0 0.2 0"/><axis xyz="0 0 1"/>'
        '<limit lower="-1" upper="1.5" velocity="2" effort="1"/></joint>'
        for i, kind in enumerate(["revolute", "continuous", "fixed"])
    )
    + "</robot>"
)
PIECES = [
    *("revolute", "prismatic", "floating", "planar", "fixed", "l0", "l1", "l3", "j1", "tool0"),
    *("nan", "inf", "-1", "0", "1e308", "-1e-308", "1e999", "0x1", "1_0", "٣", "", " ", '"', "<"),
    *("/>", "&amp;", "&x;", "<g>", "</link>", "<sphere radius='1'/>", "<mimic joint='j0'/>", "\0"),
    *("<mesh filename='../../../etc/passwd'/>", "<mesh filename='package://a/b'/>", "<?x y?>"),
    *("<!-- ", "<![CDATA[", "xmlns='x'", "${1}", "1 2 3 4", "9" * 400),
]


@st.composite
def damaged(draw: st.DrawFn) -> str:
    """The valid file with a few stretches left out, doubled or replaced; perhaps cut short."""
    text = VALID
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, max(0, len(text) - 1)))
        length = draw(st.sampled_from([0, 1, 2, 4, 10, 60]))
        piece = draw(st.sampled_from(PIECES) | st.just(text[start : start + 2 * length]))
        text = text[:start] + piece + text[start + length :]
    return text[: draw(st.integers(0, len(text)))] if draw(st.booleans()) else text


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=damaged())
def test_an_arm_or_an_error(capfd, text):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.urdf")
        path.write_text(text, encoding="utf-8")
        robot, error = None, None
        try:
            robot = Robot.from_urdf(path)
        except CalibError as caught:
            error = caught
    if error is not None:
        assert "\n" not in str(error)
        assert error.hint
    if robot is not None:
        assert np.isfinite(robot.fk((robot.lower + robot.upper) / 2)).all()
        assert all("\n" not in said for said in robot.notices)
    assert capfd.readouterr() == ("", "")


NUMBERS = [i for i in range(len(VALID)) if VALID[i - 1] == '"' and VALID[i] in "-0123456789"]


@settings(max_examples=80, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.sampled_from(NUMBERS), value=st.floats().map(repr) | st.text(max_size=5))
def test_a_strange_number(capfd, place, value):
    end = VALID.index('"', place)
    escaped = value.replace("&", "&amp;").replace("<", "&lt;").replace('"', "&quot;")
    test_an_arm_or_an_error.hypothesis.inner_test(capfd, VALID[:place] + escaped + VALID[end:])


@pytest.mark.slow
def test_elements_nested_without_end(tmp_path, capfd):
    depth = 300_000
    path = tmp_path / "arm.urdf"
    path.write_text(VALID.replace("</robot>", "<g>" * depth + "</g>" * depth + "</robot>"))
    assert Robot.from_urdf(path).n == 2
    assert capfd.readouterr() == ("", "")


def test_the_longest_chain(tmp_path, capfd):
    count = 1000
    links = "".join(f'<link name="l{i}"/>' for i in range(count))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="l{i}"/><child link="l{i + 1}"/></joint>'
        for i in range(count - 1)
    )
    path = tmp_path / "arm.urdf"
    path.write_text(f"<robot>{links}{joints}</robot>")
    with pytest.raises(CalibError, match="there is no moving joint"):
        Robot.from_urdf(path)
    path.write_text(f"<robot>{links}{joints}</robot>".replace("fixed", "continuous"))
    with pytest.raises(CalibError, match="has 999 joints between base and tip, more than 100"):
        Robot.from_urdf(path)
    assert Robot.from_urdf(path, "l100").n == 100
    assert capfd.readouterr() == ("", "")


def test_a_robot_is_read_by_its_path_as_text(tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(VALID)
    assert Robot.from_urdf(os.fspath(path)).joint_names == ("j0", "j1")
