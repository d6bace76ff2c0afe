"""Where a clearance is asked for and part of the arm has no shape, nothing is said to be clear."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from calib.descriptions.urdf_anew import urdf_of
from calib.robots import Robot
from tests.cli.conftest import Cli

CELL = """[robot]
urdf = "arm.urdf"
{robot}
[tool]
point_mm = [60, 0, 150]
[[tool.body]]
name = "gripper"
size_mm = [60, 60, 100]
at_mm = [0, 0, 60]
[base_pose]
posture_deg = [0, -70, 90, -110, -90, 0]
[[obstacle]]
name = "table"
kind = "half-space"
at_mm = [0, 0, -100]
{constraints}
"""


@pytest.fixture
def bare_cell(tmp_path: Path) -> Callable[..., Path]:
    """A UR10e as a URDF of its kinematics alone, with a table."""
    (tmp_path / "arm.urdf").write_bytes(urdf_of(Robot.preset("ur10e"), "kinematics"))

    def make(robot: str = "", constraints: str = "") -> Path:
        path = tmp_path / "cell.toml"
        path.write_text(CELL.format(robot=robot, constraints=constraints))
        return path

    return make


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    """One pose, with the forearm in the table."""
    path = tmp_path / "poses.csv"
    path.write_text(
        "name,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n"
        "P01,0,-70,90,-110,-90,0\nP02,0,20,30,-110,-90,0\n"
    )
    return path


def only_the_first(poses: Path) -> Path:
    """A list of the first pose, which touches the target."""
    path = poses.with_name("first.csv")
    path.write_text("".join(poses.read_text().splitlines(keepends=True)[:2]))
    return path


@pytest.mark.parametrize(
    "words",
    [
        ("plan", "{cell}"),
        ("plan", "{cell}", "--method", "exchange"),
        ("check", "{cell}", "{poses}"),
        ("score", "{cell}", "{poses}"),
        ("program", "{first}", "--cell", "{cell}", "--format", "ros-trajectory"),
        ("calibrate", "{cell}"),
    ],
)
def test_links_without_a_shape_are_refused_by_name(
    words: tuple[str, ...],
    cli: Cli,
    bare_cell: Callable[..., Path],
    poses: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"cell": bare_cell(), "poses": poses, "first": only_the_first(poses)}
    before = set(tmp_path.iterdir())
    typed = [word.format(**places) for word in words]
    said = cli(*typed)
    assert said.code == 2
    names = "upper_arm_link, forearm_link, wrist_1_link, wrist_2_link"
    assert f"no collision geometry for {names}: what they run into is not seen" in said.err
    for way_out in (
        'robot.shapes = "ur10e"',
        "robot.capsule_radius_mm",
        "in the URDF with its meshes",
        "constraints.collisions = false",
    ):
        assert way_out in said.err
    left = {path.name for path in set(tmp_path.iterdir()) - before}
    assert not [name for name in left if name.endswith((".csv", ".yaml", ".json"))]


@pytest.mark.parametrize("robot", ['shapes = "ur10e"', "capsule_radius_mm = 80"])
def test_with_shapes_the_forearm_is_seen_in_the_table(
    robot: str, cli: Cli, bare_cell: Callable[..., Path], poses: Path
) -> None:
    said = cli("check", bare_cell(robot), poses)
    assert said.code == 1
    assert "2 poses: 1 cannot be taken" in said.out
    assert "into each other" in said.out
    fitted = "what sticks out of the capsules along the chain that stand for base_link"
    assert (fitted in said.err) == ("capsule" in robot)


def test_a_person_may_say_that_nothing_is_checked(
    cli: Cli, bare_cell: Callable[..., Path], poses: Path
) -> None:
    said = cli("check", bare_cell("", "[constraints]\ncollisions = false"), poses)
    assert "not checked: collisions: constraints.collisions is false" in said.err
    assert "2 poses: 0 cannot be taken" in said.out


def test_the_shapes_of_another_arm_are_refused(
    cli: Cli, bare_cell: Callable[..., Path], poses: Path
) -> None:
    said = cli("check", bare_cell('shapes = "ur5e"'), poses)
    assert said.code == 2
    assert "key robot.shapes: the preset ur5e is another arm" in said.err
    assert "of the same kinematics: ur10e" in said.err


def test_meshes_that_are_gone_after_planning_are_refused(
    cli: Cli, bare_cell: Callable[..., Path], poses: Path, tmp_path: Path
) -> None:
    """A pose that ran into the table before must not be a good one since its mesh is away."""
    cell, urdf, mesh = bare_cell(), tmp_path / "arm.urdf", tmp_path / "forearm.stl"
    mesh.write_text(
        "solid t\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex -0.5 0 0\n"
        "vertex -0.5 0.1 0\nendloop\nendfacet\nendsolid t\n"
    )
    text = urdf.read_text()
    for link, solid in (
        ("upper_arm_link", '<sphere radius="0.05"/>'),
        ("forearm_link", '<mesh filename="forearm.stl"/>'),
        ("wrist_1_link", '<sphere radius="0.05"/>'),
        ("wrist_2_link", '<sphere radius="0.05"/>'),
    ):
        shaped = f'<link name="{link}"><collision><geometry>{solid}</geometry></collision>'
        text = text.replace(f'<link name="{link}">', shaped)
    urdf.write_text(text)
    said = cli("check", cell, poses)
    assert said.code == 1
    assert "2 poses: 1 cannot be taken" in said.out
    mesh.unlink()
    said = cli("check", cell, poses)
    assert said.code == 2
    assert "no collision geometry for forearm_link: what they run into is not seen" in said.err
    refused = cli("program", only_the_first(poses), "--cell", cell, "--format", "ros-trajectory")
    assert refused.code == 2
    assert "no collision geometry for forearm_link" in refused.err
