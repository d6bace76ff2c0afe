"""Files with xacro macros: expanded within their packages, refused where they leave them."""

import os
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from calib import Robot
from calib.errors import RobotModelError
from calib.robots.description import urdf

pytest.importorskip("xacro", reason="needs xacro (posedesign[xacro])")

JOINT = """
<xacro:macro name="turn" params="name parent child up:=${radians(90)} *pose">
  <joint name="${prefix}${name}" type="revolute">
    <parent link="${parent}"/><child link="${child}"/><axis xyz="0 0 1"/>
    <xacro:insert_block name="pose"/>
    <limit lower="${-up}" upper="${up}" velocity="2"/>
  </joint>
</xacro:macro>
"""
ARM = """
<xacro:arg name="prefix" default="left_"/>
<xacro:property name="prefix" value="$(arg prefix)"/>
<xacro:property name="sizes" value="${xacro.load_yaml('sizes.yaml')}"/>
<xacro:include filename="$(find parts)/joint.xacro"/>
<xacro:include filename="none.xacro" optional="true"/>
<link name="a"/><link name="b"/><link name="c"/>
<xacro:turn name="j1" parent="a" child="b"><origin xyz="0 0 ${sizes.height}"/></xacro:turn>
<xacro:turn name="j2" parent="b" child="c" up="${sizes['turn']}">
  <origin xyz="${2 * 0.2 if prefix == 'left_' else 0} 0 0"/>
</xacro:turn>
<xacro:unless value="${prefix.startswith('left')}"><broken/></xacro:unless>
"""


def robot(inside: str) -> str:
    return f'<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">{inside}</robot>'


@pytest.fixture
def folder(tmp_path) -> Path:
    """A folder of descriptions with a package beside it, and a file out of their reach."""
    place = tmp_path / "ws" / "arm" / "urdf"
    place.mkdir(parents=True)
    (place / "sizes.yaml").write_text("height: !millimeters 300\nturn: !degrees 180\n")
    (tmp_path / "ws" / "parts").mkdir()
    (tmp_path / "ws" / "parts" / "package.xml").write_text("<package/>")
    (tmp_path / "ws" / "parts" / "joint.xacro").write_text(robot(JOINT))
    (tmp_path / "ws" / "outside.xacro").write_text(robot('<link name="secret"/>'))
    (tmp_path / "ws" / "outside.yaml").write_text("secret: 1")
    return place


def run_in_a_copy(module: str, data: bytes, **_: float) -> bytes:
    """What `run_limited` gives, by a copy of this process: nothing has to be imported again.

    Without limits of memory and time, which tests of :func:`expand` are about.
    """
    answer, child = os.pipe(), os.fork()
    if not child:
        try:
            with open(os.devnull, "wb") as silent, os.fdopen(answer[1], "wb") as out:
                os.dup2(silent.fileno(), 1)
                os.dup2(silent.fileno(), 2)
                out.write(import_module(module).run(data))
        finally:
            os._exit(0)
    os.close(answer[1])
    with os.fdopen(answer[0], "rb") as found:
        outcome = found.read()
    os.waitpid(child, 0)
    return outcome


@pytest.fixture
def quick(monkeypatch) -> None:
    monkeypatch.setattr(urdf, "run_limited", run_in_a_copy)


@pytest.fixture
def read(folder, quick, read_by_itself):
    return read_by_itself


@pytest.fixture
def read_by_itself(folder, capfd):
    """Read in a process of its own, with its limits."""

    def call(inside: str, name: str = "arm.xacro") -> Robot:
        path = folder / name
        path.write_text(robot(inside))
        try:
            return Robot.from_urdf(path, tip="c")
        finally:
            assert capfd.readouterr() == ("", "")

    return call


@pytest.mark.parametrize("name", ["arm.urdf.xacro", "arm.urdf"])
def test_what_it_expands_to_is_read(read_by_itself, name):
    arm = read_by_itself(ARM, name)
    assert arm.joint_names == ("left_j1", "left_j2")
    assert arm.notices == ("expanded from xacro, every argument at its default",)
    np.testing.assert_allclose(arm.upper, [np.pi / 2, np.pi])
    np.testing.assert_allclose(arm.fk([0, 0])[:3, 3], [0.4, 0, 0.3])


def test_meshes_of_packages_that_were_found(read, folder):
    mesh = '<collision><geometry><mesh filename="{}/{}.stl"/></geometry></collision>'
    text = ARM.replace(
        '<link name="a"/>', f'<link name="a">{mesh.format("$(find parts)", "none")}</link>'
    )
    place = folder.parents[1] / "parts" / "none.stl"
    assert read(text).notices[1] == f"no collision geometry for a: mesh not found: {place}"


@pytest.mark.parametrize("above", ["ws", "home"])
def test_a_folder_above_is_no_package_by_its_name_alone(folder, read, above):
    """``$(find home)/.netrc`` of a file somewhere below: its text would stand in the cell."""
    place = folder.parents[1].rename(folder.parents[2] / above)
    (place / ".netrc").write_text("password: secret")
    path = place / "arm" / "urdf" / "arm.xacro"
    inside = f"<link name=\"${{load_yaml('$(find {above})/.netrc')}}\"/>"
    path.write_text(robot(inside))
    with pytest.raises(RobotModelError, match=f"package {above} is not among") as caught:
        Robot.from_urdf(path)
    assert "secret" not in str(caught.value)


def test_arguments(folder, quick):
    path = folder / "arm.xacro"
    path.write_text(robot(ARM))
    arm = Robot.from_urdf(path, tip="c", xacro_args=["prefix:=right_"])
    assert arm.joint_names == ("right_j1", "right_j2")
    told = "expanded from xacro, prefix:=right_, every other argument at its default"
    assert arm.notices == (told,)
    with pytest.raises(RobotModelError, match=r"no argument prefx \(known: prefix\)"):
        Robot.from_urdf(path, tip="c", xacro_args=["prefx:=right_"])
    for words in (["prefix"], [":=a"], ["a:=b", "a:=c"]):
        with pytest.raises(RobotModelError, match=r"the xacro argument .* (is not NAME|twice)"):
            Robot.from_urdf(path, tip="c", xacro_args=words)
    (folder / "bare.urdf").write_text("<robot name='arm'><link name='a'/></robot>")
    with pytest.raises(RobotModelError, match="is no xacro file, and has no arguments"):
        Robot.from_urdf(folder / "bare.urdf", xacro_args=["prefix:=right_"])


def test_packages_of_other_repositories(folder, quick, monkeypatch):
    """By the name that ``package.xml`` says, in a folder to search or in the environment."""
    parts = folder.parents[1] / "parts"
    parts.rename(folder.parents[2] / "parts-2.0")
    parts = folder.parents[2] / "parts-2.0"
    (parts / "package.xml").write_text("<package><name>parts</name></package>")
    (folder.parents[2] / "other").mkdir()
    parts = parts.rename(folder.parents[2] / "other" / "parts-2.0")
    path = folder / "arm.xacro"
    path.write_text(robot(ARM))
    with pytest.raises(RobotModelError, match="package parts is not among the folders above"):
        Robot.from_urdf(path, tip="c")
    assert Robot.from_urdf(path, tip="c", packages=[parts.parent]).n == 2
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(parts.parent))
    assert Robot.from_urdf(path, tip="c").n == 2


def test_the_checks_of_a_urdf_hold_for_what_comes_out(read):
    with pytest.raises(RobotModelError, match="joint 'left_j2' has its limits reversed"):
        read(ARM.replace("${sizes['turn']}", "-1"))
    with pytest.raises(RobotModelError, match="has no links") as caught:
        read(JOINT)
    assert "macros needs the file that calls them" in caught.value.hint


LAUGHS = "".join(
    f'<xacro:macro name="m{i + 1}">{f"<xacro:m{i}/>" * 10}</xacro:macro>' for i in range(9)
)
REFUSED = {
    "attributes of Python": (
        '<link name="${().__class__}"/>',
        "two underscores in a row are not accepted",
    ),
    "attributes of Python, put together": (
        """<xacro:property name="u" value="_"/><link name="${('{0._'+u+'class'+u+'_').x}"/>""",
        "is not defined",
    ),
    "frames of Python": (
        '<link name="${[g.gi_frame for g in [(1 for i in [1])]]}"/>',
        "'g.gi_frame' is not defined",
    ),
    "a function as a value": ("<link name=\"${'%s' % load_yaml}\"/>", "'load_yaml' is not a value"),
    "eval": ('<link name="$(eval 1+1)"/>', r"\$\(eval 1\+1\) is not accepted"),
    "command": ('<link name="$(command ls)"/>', r"\$\(command ls\) is not accepted"),
    "environment": ('<link name="$(env HOME)"/>', r"\$\(env HOME\) is not accepted"),
    "include outside": (
        '<xacro:include filename="../../outside.xacro"/>',
        "outside.xacro lies outside of the packages of arm.xacro",
    ),
    "include of a whole path": (
        '<xacro:include filename="/etc/hosts"/>',
        "/etc/hosts lies outside",
    ),
    "include through a link": ('<xacro:include filename="link.xacro"/>', "link.xacro lies outside"),
    "include by pattern": ('<xacro:include filename="../../*.xacro"/>', "lies outside of the pack"),
    "table outside": (
        "<link name=\"${load_yaml('../../outside.yaml')}\"/>",
        "outside.yaml lies outside of the packages of arm.xacro",
    ),
    "table that is none": ("<link name=\"${load_yaml('bad.yaml')}\"/>", "bad.yaml: is not YAML"),
    "table with objects": (
        "<link name=\"${load_yaml('object.yaml')}\"/>",
        "could not determine a constructor",
    ),
    "package outside": ('<link name="$(find urdf)/$(find none)"/>', "package none is not among"),
    "entities": ('<xacro:include filename="entity.xacro"/>', "entities are not accepted"),
    "not well-formed": ('<xacro:include filename="bad.yaml"/>', "in .*bad.yaml: syntax error"),
    "missing file": ('<xacro:include filename="none.xacro"/>', "No such file .*none.xacro"),
    "argument": ('<link name="$(arg length)"/>', "argument length has no default"),
    "name": ('<link name="${length}"/>', "name 'length' is not defined"),
    "division": ('<link name="${1/0}"/>', "division by zero"),
    "macro": ("<xacro:none/>", "unknown macro name: xacro:none"),
    "own error": ("<link name=\"${xacro.fatal('no', 1)}\"/>", "no 1"),
    "circle": (
        '<xacro:property name="p" value="${q}"/><xacro:property name="q" value="${p}"/>${p}',
        "circular variable definition",
    ),
    "macro in itself": (
        '<xacro:macro name="m"><xacro:m/></xacro:macro><xacro:m/>',
        "its macros call each other without end",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_in_one_line(read, folder, case):
    (folder / "link.xacro").symlink_to(folder.parents[1] / "outside.xacro")
    (folder / "bad.yaml").write_text("a: {b")
    (folder / "object.yaml").write_text("a: !!python/object/apply:os.getcwd []")
    (folder / "entity.xacro").write_text('<!DOCTYPE r [<!ENTITY x "y">]>' + robot("&x;"))
    inside, message = REFUSED[case]
    with pytest.raises(RobotModelError, match=message) as caught:
        read(inside)
    assert "xacro cannot be expanded: " in caught.value.message
    assert "\n" not in str(caught.value)
    assert Path(caught.value.name).name == "arm.xacro"


@pytest.mark.parametrize(
    "inside",
    [
        f'<xacro:macro name="m0"><link name="x"/></xacro:macro>{LAUGHS}<xacro:m9/>',
        '<link name="${9**9**9}"/>',
        '<link name="${sum(range(10**12))}"/>',
    ],
    ids=["macros of macros", "a power", "a loop"],
)
def test_what_never_ends_is_ended(read_by_itself, monkeypatch, inside):
    monkeypatch.setattr(urdf, "SECONDS", 0.5)
    with pytest.raises(RobotModelError, match=r"not done in 0.5 s|broke off"):
        read_by_itself(inside)


def test_memory_is_bounded(read_by_itself, monkeypatch):
    inside = "<g a=\"${len('a' * 10 ** 8)}\"/>" + ARM
    assert read_by_itself(inside).n == 2
    monkeypatch.setattr(urdf, "MEMORY_BYTES", 100_000_000)
    with pytest.raises(RobotModelError, match="too large when evaluating") as caught:
        read_by_itself(inside)
    assert "\n" not in str(caught.value)


def test_the_outcome_is_bounded(folder, quick):
    path = folder / "arm.xacro"
    path.write_text(robot("<g name=\"${'a' * 2000}\"/>"))
    assert len(urdf.expand_xacro(path, 3000).text) > 2000
    with pytest.raises(RobotModelError, match="expands to more than 2000 characters"):
        urdf.expand_xacro(path, 2000)


def test_neither_environment_nor_working_folder_are_seen(folder, monkeypatch):
    path = folder / "arm.xacro"
    path.write_text(robot('<g a="$(optenv HOME none at all)" b="$(dirname)" c="$(optenv HOME)"/>'))
    monkeypatch.chdir(os.sep)
    text = urdf.expand_xacro(path, 10_000).text
    assert f'<g a="none at all" b="{folder}" c=""/>' in text


def test_without_the_package(read, monkeypatch):
    monkeypatch.setattr(urdf, "find_spec", lambda _: None)
    with pytest.raises(RobotModelError, match="the package xacro is not installed") as caught:
        read(ARM)
    assert 'pip install "posedesign[xacro]"' in caught.value.hint


def test_a_process_that_cannot_be_started(read_by_itself, monkeypatch):
    monkeypatch.setattr(sys, "executable", os.devnull)
    with pytest.raises(RobotModelError, match="the process that expands it broke off"):
        read_by_itself(ARM)
