"""Where a clearance is asked for and part of the arm has no shape, nothing is said to be clear."""

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib.robots import Robot
from calib.robots.urdf_anew import urdf_of

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
def bare_cell(tmp_path) -> Callable[..., Path]:
    """A UR10e as a URDF of its kinematics alone, with a table."""
    (tmp_path / "arm.urdf").write_bytes(urdf_of(Robot.preset("ur10e"), "kinematics"))

    def make(robot: str = "", constraints: str = "") -> Path:
        path = tmp_path / "cell.toml"
        path.write_text(CELL.format(robot=robot, constraints=constraints))
        return path

    return make


@pytest.fixture
def poses(tmp_path) -> Path:
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
        ("plan", "{cell}", "--out", "planned"),
        ("plan", "{cell}", "--out", "planned", "--method", "exchange"),
        ("check", "{cell}", "{poses}"),
        ("score", "{cell}", "{poses}"),
        ("program", "{first}", "--cell", "{cell}", "--format", "ros-trajectory"),
        ("calibrate", "{cell}"),
    ],
)
def test_links_without_a_shape_are_refused_by_name(
    words, cli, bare_cell, poses, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    camera = "[camera]" if "calibrate" in words else ""
    places = {"cell": bare_cell("", camera), "poses": poses, "first": only_the_first(poses)}
    before = set(tmp_path.rglob("*"))
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
    left = set(tmp_path.rglob("*")) - before
    assert not [path for path in left if path.suffix in (".csv", ".yaml", ".json")]


@pytest.mark.parametrize("robot", ['shapes = "ur10e"', "capsule_radius_mm = 80"])
def test_with_shapes_the_forearm_is_seen_in_the_table(robot, cli, bare_cell, poses):
    said = cli("check", bare_cell(robot), poses)
    assert said.code == 1
    assert "2 poses: 1 cannot be taken" in said.out
    assert "into each other" in said.out
    fitted = "what sticks out of the capsules along the chain that stand for base_link"
    assert (fitted in said.out) == ("capsule" in robot)


def test_a_person_may_say_that_nothing_is_checked(cli, bare_cell, poses):
    said = cli("check", bare_cell("", "[constraints]\ncollisions = false"), poses)
    assert "not checked: collisions: constraints.collisions is false" in said.out
    assert "2 poses: 0 cannot be taken" in said.out


def test_the_shapes_of_another_arm_are_refused(cli, bare_cell, poses):
    said = cli("check", bare_cell('shapes = "ur5e"'), poses)
    assert said.code == 2
    assert "key robot.shapes: the preset ur5e is another arm" in said.err
    assert "of the same kinematics: ur10e" in said.err


def test_meshes_that_are_gone_after_planning_are_refused(cli, bare_cell, poses, tmp_path):
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


def test_what_is_not_checked_goes_with_the_poses(cli, done, bare_cell, tmp_path):
    """Verdict, JSON, list of poses, and the program that is written from it without the cell."""
    cell, out = bare_cell('shapes = "ur10e"'), tmp_path / "out"
    said = cli("plan", cell, "--out", out, "--json")
    told = json.loads(said.out)
    view = "the view of the target: no [camera] is described"
    assert view in told["not_checked"]
    assert f"NOT CHECKED: {'; '.join(told['not_checked'])}" in told["message"]
    assert f"not checked: {view}" in said.err
    assert told["target"]["nearest_obstacle"] == "table"
    assert told["target"]["apart_mm"] == 0.0
    for line in told["not_checked"]:
        assert f"\n# not checked: {line}\n" in (out / "poses.csv").read_text()
    alone = done("program", out / "poses.csv", "--format", "ros-trajectory", "--out", out)
    assert f"not checked: {view}" in alone.out
    assert f"# * NOT CHECKED: {view}" in (out / "CALIB01.yaml").read_text()
    for words in (("check", cell, out / "poses.csv"), ("score", cell, out / "poses.csv")):
        assert json.loads(cli(*words, "--json").out)["not_checked"] == told["not_checked"]


def test_what_force_lets_through_is_named(cli, done, bare_cell, poses, tmp_path):
    cell, first = bare_cell('shapes = "ur10e"'), only_the_first(poses)
    elbow = Robot.preset("ur10e").state(np.deg2rad([0, -70, 90, -110, -90, 0])).origins[2]
    at_mm = np.round(1e3 * elbow).tolist()
    post = f'[[obstacle]]\nname = "post"\nkind = "sphere"\nradius_mm = 50\nat_mm = {at_mm}'
    cell.write_text(f"{cell.read_text()}\n{post}\n")
    words = ["program", first, "--cell", cell, "--format", "ros-trajectory", "--out", tmp_path]
    refused = cli(*words)
    assert refused.code == 2
    forced = done(*words, "--force", "--json")
    (spite,) = json.loads(forced.out)["forced"]
    assert spite.startswith("P01: ")
    assert "post" in spite
    assert f"warning: written in spite of {spite}" in forced.err
    assert f"# * WRITTEN IN SPITE OF: {spite[:40]}" in (tmp_path / "CALIB01.yaml").read_text()


def test_units_of_limits_and_speeds_are_named_before_anything_is_planned(cli, refuse, tmp_path):
    text = urdf_of(Robot.preset("ur10e"), "kinematics").decode()
    in_degrees = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="-170" upper="170"', text)
    (tmp_path / "arm.urdf").write_text(in_degrees)
    typed = ("new", "--robot", str(tmp_path / "arm.urdf"))
    refuse(*typed).says("shoulder_pan_joint", "-9740 to 9740 deg", "typed in degrees")
    fast = re.sub(r'velocity="[^"]*"', 'velocity="120"', text)
    (tmp_path / "arm.urdf").write_text(fast)
    said = cli(*typed)
    assert said.code == 0
    assert "turn at up to 120 rad/s: were the speeds typed in degrees?" in " ".join(
        said.err.split()
    )
