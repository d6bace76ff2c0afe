"""Collision geometry of URDFs: what is solid, where it is, and which files may be read for it."""

import os
import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from calib import Robot
from calib.errors import FileFormatError, RobotModelError
from calib.robots.description import urdf_geometry
from calib.robots.shapes import Box, Capsule, Cylinder, Mesh, Sphere

JOINT = (
    '<joint name="j{0}" type="{3}"><parent link="{1}"/><child link="{2}"/>'
    '<origin xyz="0.1 0 0.3" rpy="0 0.2 0"/><axis xyz="0 0 1"/>'
    '<limit lower="-1" upper="1.5" velocity="2"/></joint>'
)


def collision(geometry: str, origin: str = "", name: str = "") -> str:
    named = f' name="{name}"' if name else ""
    return f"<collision{named}>{origin}<geometry>{geometry}</geometry></collision>"


def mesh(name: str, scale: str = "") -> str:
    return collision(f'<mesh filename="{name}"{scale}/>')


def arm(a: str = "", b: str = "", tool: str = "", side: str = "") -> str:
    links = {"a": a, "b": b, "c": "", "tool": tool, "side": side}
    return (
        '<robot name="arm">'
        + "".join(f'<link name="{name}">{inside}</link>' for name, inside in links.items())
        + JOINT.format(1, "a", "b", "revolute")
        + JOINT.format(2, "b", "c", "revolute")
        + JOINT.format(3, "c", "tool", "fixed")
        + JOINT.format(4, "a", "side", "prismatic")
        + "</robot>"
    )


@pytest.fixture
def package(tmp_path) -> Path:
    """The folder of a ROS package, with an empty one and a plain folder beside it."""
    for name in ("arm_description", "grippers"):
        (tmp_path / "ws" / name / "meshes").mkdir(parents=True)
        (tmp_path / "ws" / name / "package.xml").write_text("<package/>")
        (tmp_path / "ws" / name / "meshes" / "m.stl").write_text(name)
    (tmp_path / "ws" / "plain").mkdir()
    (tmp_path / "ws" / "plain" / "m.stl").write_text("plain")
    (tmp_path / "ws" / "arm_description" / "urdf").mkdir()
    return tmp_path / "ws" / "arm_description"


@pytest.fixture
def read(package, capfd):
    def call(text: str, **frames: str) -> Robot:
        path = package / "urdf" / "arm.urdf"
        path.write_text(text)
        try:
            return Robot.from_urdf(path, tip=frames.pop("tip", "tool"), **frames)
        finally:
            assert capfd.readouterr() == ("", "")

    return call


@pytest.fixture
def meshes_read(monkeypatch) -> list[tuple[Path, tuple[float, ...]]]:
    """A reader of meshes that keeps what it is asked for; the word ``broken`` is no mesh."""
    asked: list[tuple[Path, tuple[float, ...]]] = []

    def read_mesh(path, scale):
        asked.append((path, scale))
        if path.read_text() == "broken":
            raise FileFormatError("is no mesh", path=path)
        return Mesh(np.eye(3), np.array([[0, 1, 2]]))

    module = ModuleType("calib.robots.description.mesh_file")
    module.read_mesh = read_mesh
    monkeypatch.setitem(sys.modules, "calib.robots.description.mesh_file", module)
    return asked


@pytest.mark.parametrize(
    ("geometry", "solid"),
    [
        ('<box size="1 2 0.5"/>', Box((1.0, 2.0, 0.5))),
        ('<cylinder radius="0.1" length="2"/>', Cylinder(0.1, 2.0)),
        ('<capsule radius="0.1" length="2"/>', Capsule(0.1, 2.0)),
        ('<sphere radius="1e-3"/>', Sphere(1e-3)),
    ],
)
def test_primitives(read, geometry, solid):
    (body,) = read(arm(b=collision(geometry))).bodies
    assert (body.name, body.link, body.solid) == ("b", 1, solid)
    np.testing.assert_array_equal(body.T_link_body, np.eye(4))


def test_origins_are_roll_pitch_yaw_about_fixed_axes(read):
    ball = '<sphere radius="1"/>'
    origin = '<origin xyz="1 2 3" rpy="0.3 -0.4 0.5"/>'
    (body,) = read(arm(b=collision(ball, origin))).bodies

    def turn(axis: int, angle: float) -> np.ndarray:
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        R = np.eye(3)
        R[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
        return R

    np.testing.assert_allclose(body.T_link_body[:3, 3], [1, 2, 3])
    np.testing.assert_allclose(
        body.T_link_body[:3, :3], turn(2, 0.5) @ turn(1, -0.4) @ turn(0, 0.3), atol=1e-15
    )


def test_bodies_move_with_the_joint_that_carries_them(read):
    ball = collision('<sphere radius="1"/>', '<origin xyz="0 0 0.2"/>')
    robot = read(arm(a=ball, b=ball, tool=ball, side=ball), base="a")
    links = {body.name: body.link for body in robot.bodies}
    assert links == {"a": 0, "b": 1, "tool": 2, "side": 0}
    side, tool = (next(b for b in robot.bodies if b.name == n) for n in ("side", "tool"))
    np.testing.assert_allclose(
        side.T_link_body[:3, 3], [0.1 + 0.2 * np.sin(0.2), 0, 0.3 + 0.2 * np.cos(0.2)]
    )
    np.testing.assert_allclose(tool.T_link_body @ [0, 0, -0.2, 1], robot.chain.T_link_tip[:, 3])


def test_several_bodies_of_a_link_have_names_of_their_own(read):
    ball = '<sphere radius="1"/>'
    plain, named, same = collision(ball), collision(ball, name="shell"), collision(ball, name="b")
    robot = read(arm(a=named, b=plain + named + named + plain + same, tool=same))
    assert [body.name for body in robot.bodies] == [
        *("a/shell", "b/1", "b/shell", "b/shell/2", "b/2", "b/3", "tool/b")
    ]


@pytest.mark.parametrize(
    ("geometry", "said"),
    [
        ('<sphere radius="0"/>', "<sphere radius='0'>"),
        ('<sphere radius="-1"/>', "<sphere radius='-1'>"),
        ('<sphere radius="nan"/>', "<sphere radius='nan'>"),
        ('<sphere radius="inf"/>', "<sphere radius='inf'>"),
        ('<sphere radius="1e9"/>', "<sphere radius='1e9'>"),
        ("<sphere/>", "<sphere radius=None>"),
        ('<cylinder radius="1" length="0"/>', "<cylinder length='0'>"),
        ('<capsule radius="?" length="1"/>', "<capsule radius='?'>"),
        ('<box size="1 2"/>', "<box size='1 2'>"),
        ('<box size="1 -2 3"/>', "<box size='1 -2 3'>"),
        ('<mesh filename="m.stl" scale="1 1"/>', "<mesh scale='1 1'>"),
        ('<mesh filename="m.stl" scale="1 0 1"/>', "<mesh scale='1 0 1'>"),
        ('<mesh filename="m.stl" scale="1 1 1e9"/>', "<mesh scale='1 1 1e9'>"),
    ],
)
def test_sizes_that_make_no_sense_are_refused_by_link(read, meshes_read, geometry, said):
    with pytest.raises(RobotModelError) as caught:
        read(arm(b=collision(geometry)))
    assert f"link 'b' has collision geometry of {said}" in caught.value.message
    assert caught.value.name == "b"
    assert caught.value.hint


@pytest.mark.parametrize("origin", ['xyz="1 2"', 'rpy="0 nan 0"', 'xyz="1e6 0 0"'])
def test_poses_that_make_no_sense_are_refused_by_link(read, origin):
    with pytest.raises(RobotModelError, match=r"link 'b' has collision geometry of .*origin"):
        read(arm(b=collision('<sphere radius="1"/>', f"<origin {origin}/>")))


def test_too_many_bodies(read, monkeypatch):
    monkeypatch.setattr(urdf_geometry, "MOST_BODIES", 3)
    ball = collision('<sphere radius="1"/>')
    assert len(read(arm(a=ball, b=ball * 2)).bodies) == 3
    with pytest.raises(RobotModelError, match="has 4 collision bodies, more than 3"):
        read(arm(a=ball * 2, b=ball * 2))


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("../meshes/m.stl", "arm_description/meshes/m.stl"),
        ("package://arm_description/meshes/m.stl", "arm_description/meshes/m.stl"),
        ("package://arm_description//meshes/m.stl", "arm_description/meshes/m.stl"),
        ("model://arm_description/meshes/m.stl", "arm_description/meshes/m.stl"),
        ("package://grippers/meshes/m.stl", "grippers/meshes/m.stl"),
        ("file://{}/meshes/m.stl", "arm_description/meshes/m.stl"),
        ("file://localhost{}/meshes/%6d.stl", "arm_description/meshes/m.stl"),
        ("{}/meshes/m.stl", "arm_description/meshes/m.stl"),
    ],
)
def test_where_meshes_are_looked_for(read, package, meshes_read, name, where):
    robot = read(arm(b=mesh(name.format(package), ' scale="0.001 0.001 -0.001"')))
    assert meshes_read == [(package.parent / where, (0.001, 0.001, -0.001))]
    assert [type(body.solid) for body in robot.bodies] == [Mesh]
    assert robot.notices == ("locked at zero, not between base and tip: j4",)


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("none.stl", "mesh not found: none.stl"),
        ("", "mesh not found: "),
        ("../meshes", "mesh not found: ../meshes"),
        ("../../plain/m.stl", "mesh outside of its package: ../../plain/m.stl"),
        ("{}/../plain/m.stl", "mesh outside of its package: {}/../plain/m.stl"),
        ("file://{}/../plain/m.stl", "mesh outside of its package: file://{}/../plain/m.stl"),
        ("leak.stl", "mesh outside of its package: leak.stl"),
        ("x" * 300 + ".stl", "mesh not found: " + "x" * 200),
        (
            "package://arm_description/../plain/m.stl",
            "mesh outside of its package: package://arm_description/../plain/m.stl",
        ),
        (
            "package://grippers/%2e%2e/plain/m.stl",
            "mesh not found: package://grippers/%2e%2e/plain/m.stl",
        ),
        *(
            (
                f"package://{p}",
                f"mesh not found, package not among the folders above or to search: package://{p}",
            )
            for p in ("none/m.stl", "plain/m.stl", "../plain/m.stl", "/etc/passwd", "etc/passwd")
        ),
        ("http://x.org/m.stl", "mesh not a file: http://x.org/m.stl"),
        ("file://x.org/m.stl", "mesh not a file: file://x.org/m.stl"),
        ("a&#10;b.stl", "mesh not found: a b.stl"),
    ],
)
def test_meshes_that_are_not_read(read, package, meshes_read, name, why):
    (package / "urdf" / "leak.stl").symlink_to(package.parent / "plain" / "m.stl")
    robot = read(arm(b=mesh(name.format(package))))
    assert robot.notices[0] == "no collision geometry for b: " + why.format(package)
    assert robot.bodies == ()
    assert meshes_read == []


def test_a_link_to_itself_is_not_read(read, package, meshes_read):
    """Where such a path lies depends on the version of Python."""
    (package / "urdf" / "ring.stl").symlink_to(package / "urdf" / "ring.stl")
    robot = read(arm(b=mesh("ring.stl")))
    assert re.fullmatch(
        r".* b: mesh (outside of its package|not found): ring.stl", robot.notices[0]
    )
    assert robot.bodies == ()
    assert meshes_read == []


def test_a_linked_folder_is_no_way_out_of_the_package(read, package, meshes_read):
    (package / "plain").symlink_to(package.parent / "plain")
    robot = read(arm(b=mesh("package://plain/m.stl")))
    assert "package not among the folders above" in robot.notices[0]
    assert meshes_read == []


def test_missing_geometry_is_summed_up_by_reason(read, package, meshes_read):
    (package / "meshes" / "b.stl").write_text("broken")
    none = "".join(mesh(f"{i}.stl") for i in range(5))
    robot = read(
        arm(
            a=mesh("0.stl") + collision('<sphere radius="1"/>'),
            b=none + collision("<plane/>") + collision(""),
            tool=mesh("../meshes/b.stl") + mesh("../meshes/m.stl"),
        )
    )
    assert robot.notices[:4] == (
        "no collision geometry for a, b: mesh not found: 0.stl, 1.stl, 2.stl and 2 more",
        "no collision geometry for b: not a shape known here: <plane>",
        "no collision geometry for b: no shape in it: <geometry>",
        "no collision geometry for tool: mesh cannot be read: ../meshes/b.stl (is no mesh)",
    )
    assert [body.link for body in robot.bodies] == [0, 2]


def test_a_mesh_is_read_once_for_each_scale(read, meshes_read):
    half = mesh("../meshes/m.stl", ' scale="0.5 0.5 0.5"')
    robot = read(arm(a=mesh("../meshes/m.stl"), b=mesh("../meshes/../meshes/m.stl") + half))
    assert [scale for _, scale in meshes_read] == [(1, 1, 1), (0.5, 0.5, 0.5)]
    assert robot.bodies[0].solid is robot.bodies[1].solid


@pytest.mark.parametrize(
    ("file", "name", "found"),
    [
        ("ws/robots/arm.urdf", "../meshes/m.stl", True),  # the folder above one called robots
        ("ws/arm/arm.urdf", "meshes/m.stl", True),
        ("ws/arm/arm.urdf", "../meshes/m.stl", False),
        ("ws/arm/urdf/arm.urdf", "package://arm/meshes/m.stl", True),
        ("ws/robots/arm.urdf", "package://arm/meshes/m.stl", True),  # inside that folder
        ("ws/other/arm.urdf", "package://arm/meshes/m.stl", False),  # beside it, no package.xml
        ("ws/other/deep/er/arm.urdf", "package://ws/meshes/m.stl", True),  # above it
    ],
)
def test_packages_without_a_package_file(tmp_path, meshes_read, file, name, found):
    for folder in ("ws", "ws/arm"):
        (tmp_path / folder / "meshes").mkdir(parents=True)
        (tmp_path / folder / "meshes" / "m.stl").write_text("mesh")
    path = tmp_path / file
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(arm(b=mesh(name)))
    assert len(Robot.from_urdf(path, tip="tool").bodies) == found


@pytest.fixture
def elsewhere(tmp_path) -> Path:
    """A description in one repository, its package of meshes in another under another name."""
    for folder, name in (
        ("src/one/arm_description-humble", "arm_description"),
        ("src/two/deep/hands", "grippers"),
    ):
        (tmp_path / folder / "meshes").mkdir(parents=True)
        (tmp_path / folder / "meshes" / "m.stl").write_text("mesh")
        text = f"<package format='3'>\n  <name> {name} </name></package>"
        (tmp_path / folder / "package.xml").write_text(text)
    path = tmp_path / "src/one/arm_description-humble/urdf/arm.urdf"
    path.parent.mkdir()
    path.write_text(
        arm(
            a=mesh("package://arm_description/meshes/m.stl"),
            b=mesh("package://grippers/meshes/m.stl"),
        )
    )
    return path


def test_a_package_that_was_cloned_under_another_name(elsewhere, meshes_read):
    """Its ``package.xml`` says its name; a package in a neighbouring repository has to be told."""
    robot = Robot.from_urdf(elsewhere, tip="tool")
    assert [body.name for body in robot.bodies] == ["a"]
    assert "package not among the folders above or to search: package://grip" in robot.notices[0]


@pytest.mark.parametrize("how", ["given", "ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"])
def test_folders_to_search_for_packages(elsewhere, meshes_read, monkeypatch, how):
    source = elsewhere.parents[3]
    if how == "AMENT_PREFIX_PATH":
        (source.parent / "share").symlink_to(source)
        source = source.parent
    if how != "given":
        monkeypatch.setenv(how, os.pathsep.join(("", "/none/such", str(source))))
    packages = [source] if how == "given" else []
    robot = Robot.from_urdf(elsewhere, tip="tool", packages=packages)
    assert [body.name for body in robot.bodies] == ["a", "b"]
    assert not any("no collision geometry" in said for said in robot.notices)


def test_a_folder_to_search_that_is_none(elsewhere):
    with pytest.raises(RobotModelError, match="where packages are to be searched, is no folder"):
        Robot.from_urdf(elsewhere, packages=[elsewhere])


def test_files_by_their_whole_path_may_lie_below_a_folder_to_search(elsewhere, meshes_read):
    file = elsewhere.parents[2].parent / "two/deep/hands/meshes/m.stl"
    elsewhere.write_text(arm(b=mesh(f"file://{file}")))
    robot = Robot.from_urdf(elsewhere, tip="tool")
    assert not robot.bodies
    assert "mesh outside of its package" in robot.notices[0]
    robot = Robot.from_urdf(elsewhere, tip="tool", packages=[file.parents[2]])
    assert [body.name for body in robot.bodies] == ["b"]
    # no way out of the folder
    robot = Robot.from_urdf(elsewhere, tip="tool", packages=[file.parents[3] / "deep/hands/.."])
    assert [body.name for body in robot.bodies] == ["b"]
    (file.parent / "out.stl").symlink_to("/etc/passwd")
    elsewhere.write_text(arm(b=mesh(f"file://{file.parent}/out.stl")))
    assert not Robot.from_urdf(elsewhere, tip="tool", packages=[file.parents[2]]).bodies
