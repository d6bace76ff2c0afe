"""``posedesign check``: verdicts as a person reads them, and cells whose bounds make no sense."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from posedesign.cell import Cell
from posedesign.planning.checks import check_poses
from posedesign.planning.poses_file import PoseList, read_poses
from tests.cli.conftest import keys_of, refusals


@pytest.fixture
def work(demo_work) -> Path:
    """The reference cell with gun, camera, fixture and floor."""
    return demo_work


def test_planned_poses_pass(cli, done, work):
    said = done("check", work / "cell.toml", work / "poses.csv")
    assert "27 poses: 0 cannot be taken; 0 motions between them not clear" in said.out
    assert re.search(r"smallest distance, at P\d\d: gun [\d.]+ mm from fixture, 20 mm", said.out)
    told = json.loads(cli("check", work / "cell.toml", work / "poses.csv", "--json").out)
    assert told["feasible"] is True
    assert [row["via"] for row in told["poses"]] == [False] * 27 + [True]  # the way back
    assert told["not_checked"] == []


def test_every_pose_has_its_tightest_constraint(cli, work):
    """The table and the JSON say what the constraints say."""
    cell = Cell.load(work / "cell.toml")
    poses = read_poses(work / "poses.csv", 6).measured
    verdicts = cell.checker.check(poses.postures)
    parts = verdicts.margin / [constraint.comfort for constraint in verdicts.constraints]
    told = json.loads(cli("check", work / "cell.toml", work / "poses.csv", "--json").out)
    told = [row for row in told["poses"] if not row["via"]]
    for row, part, room in zip(told, parts, verdicts.margin, strict=True):
        tightest = verdicts.constraints[int(np.argmin(part))]
        assert row["tightest"] == tightest.name
        expected = room[int(np.argmin(part))] * tightest.display
        assert row["room"] == pytest.approx(expected, abs=1e-9)
    distance = cell.scene.others.clearance(poses.postures).distance_m
    np.testing.assert_allclose([row["distance_mm"] for row in told], 1e3 * distance)


def test_a_pose_in_the_floor(cli, work, change_csv):
    poses = change_csv("poses.csv", 2, "j2_deg", "70")
    said = cli("check", work / "cell.toml", poses)
    assert said.code == 1
    name = poses.read_text().splitlines()[2].split(",")[0]
    told = json.loads(cli("check", work / "cell.toml", poses, "--json").out)
    bad = [row for row in told["poses"] if not row["feasible"]]
    assert [row["name"] for row in bad] == [name]
    assert bad[0]["says"].startswith("the camera looks away from the target, by ")
    assert f"{name}" in said.out
    assert "1 cannot be taken" in said.out
    assert any(name in line for line in told["off_target"])


def test_a_way_through_the_fixture(make_demo_cell):
    """Two clear poses on either side of a wall, and the wall between them."""
    cell = make_demo_cell(camera=None)
    x = 1e3 * cell.target_m[0]
    wall = {"name": "wall", "size_mm": [800.0, 20.0, 3000.0], "at_mm": [x, 900.0, 1500.0]}
    cell = make_demo_cell(obstacle=[wall], camera=None)
    q = np.tile(cell.base_posture, (2, 1))
    q[1, 0] += np.deg2rad(60.0)
    there = check_poses(cell, PoseList(("P1", "P2"), q, np.zeros(2, dtype=bool)))
    assert [verdict.feasible for verdict in there] == [True, True]
    assert there[0].way_clear
    assert not there[1].way_clear
    assert "wall" in there[1].way
    assert not there[1].ok


def test_the_way_back_to_the_base_posture_is_checked(cli, refuse, work, change_csv):
    """The last stop moved to where the arm stands in the floor on its way: named, and refused."""
    poses = change_csv("poses.csv", 28, "j2_deg", "75")
    told = json.loads(cli("check", work / "cell.toml", poses, "--json").out)
    bad = [row for row in told["poses"] if not row["feasible"] or row["way_clear"] is False]
    assert [(row["name"], row["via"]) for row in bad] == [("V01", True)]
    assert "floor" in bad[0]["says"] or "fixture" in bad[0]["says"]
    # postures passed through are no poses: 27 poses of which 28 cannot be taken would be nonsense
    counted = "27 poses: 0 cannot be taken; of 1 passed through, 1 cannot"
    assert counted in cli("check", work / "cell.toml", poses).out
    words = ("program", poses, "--cell", work / "cell.toml", "--out", work)
    refuse(*words).says("pose V01")


def test_postures_on_the_way_need_not_see_the_target(make_demo_cell):
    cell = make_demo_cell()
    q = cell.base_posture + np.deg2rad([[0.0, 0, 0, 0, 0, 0], [10.0, -10, 0, 0, 40, 0]])
    names = ("P1", "V1")
    measured = check_poses(cell, PoseList(names, q, np.array([False, False])))
    assert not measured[1].feasible
    passing = check_poses(cell, PoseList(names, q, np.array([False, True])))
    assert passing[1].feasible, passing[1].says


def test_the_base_posture_itself_must_be_clear(refuse, demo_work, make_demo_cell):
    """A ball in the elbow: other branches take the base pose, but the arm is not in them."""
    cell = make_demo_cell()
    elbow = 1e3 * cell.robot.state(cell.base_posture).origins[2]
    path = demo_work / "cell.toml"
    ball = f'kind = "sphere"\nradius_mm = 30.0\nat_mm = {[float(v) for v in elbow]}'
    path.write_text(path.read_text() + f'\n[[obstacle]]\nname = "ball"\n{ball}\n')
    refuse("plan", path, "--out", demo_work / "x").says("the base pose cannot be taken", "ball")


def test_places_on_ways_are_counted_from_where_the_arm_comes_from(make_demo_cell):
    """A post at a third of the way there is at two thirds of the way back."""
    cell = make_demo_cell(camera=None, obstacle=None)
    q = np.tile(cell.base_posture, (2, 1))
    q[1, 0] += np.deg2rad(90.0)
    x, y, _ = 1e3 * cell.robot.fk(q[0] + np.deg2rad([30.0, 0, 0, 0, 0, 0]))[:3, 3]
    post = {"name": "post", "size_mm": [20.0, 20.0, 3000.0], "at_mm": [x, y, 1500.0]}
    cell = make_demo_cell(camera=None, obstacle=[post])
    there, back = cell.ways.check(q, q[::-1]).part
    assert there == pytest.approx(1.0 - back, abs=1e-9)
    assert 0.1 < there < 0.5


def test_a_program_of_poses_that_collide_is_refused(done, refuse, work, change_cell):
    cell = change_cell({"constraints.safety_distance_mm": "80.0"})
    words = ("program", work / "poses.csv", "--cell", cell, "--out", work)
    refuse(*words).says("pose P", "80 mm asked for", "more", "posedesign check", "--force")
    done(*words, "--force")
    assert (work / "CALIB01.LS").is_file()


# bounds that make no sense

CASES = refusals(r"""
a camera that looks away | camera.wpr_deg = [180.0, 0.0, 0.0] =>
  the camera looks away from the target, by 180 deg | correct camera.position_mm
a target seen too slantwise | target.normal = [1.0, 0.0, 0.2] =>
  the base pose cannot be taken: target seen at a tilt of 78.7 deg
a safety distance that shuts out the base pose | constraints.safety_distance_mm = 500.0 =>
  the base pose cannot be taken: | 500 mm asked for | constraints.safety_distance_mm
a workspace that shuts out the base pose
  | constraints.workspace_lowest_mm = [-3000.0, -3000.0, 800.0]
  | constraints.workspace_highest_mm = [3000.0, 3000.0, 3000.0] =>
  link_2 315 mm outside the workspace, beyond z = 800 mm | widen constraints.
a singular value that no posture has | constraints.smallest_singular_value = 0.9 =>
  smallest singular value 0. | bound 0.9 | constraints.smallest_singular_value
a camera too near | camera.nearest_mm = 400.0 =>
  target 250 mm from the camera, nearest allowed 400 mm
""")


@pytest.mark.parametrize(("given", "words"), CASES)
def test_bounds_that_shut_out_the_base_pose(refuse, change_cell, work, given, words):
    refuse("plan", change_cell(keys_of(given)), "--out", work / "out").says(*words)


KEYS = refusals(r"""
target inside its fixture | target.position_mm = [1915.4, 50.0, 400.0] =>
  key target.position_mm | the target lies inside the obstacle 'fixture'
half a workspace | constraints.workspace_lowest_mm = [0.0, 0.0, 0.0] =>
  give both workspace_lowest_mm and workspace_highest_mm
an empty workspace
  | constraints.workspace_lowest_mm = [0.0, 5.0, 0.0]
  | constraints.workspace_highest_mm = [9.0, 5.0, 9.0] =>
  the workspace is empty along y: 5 to 5
pairs of unknown bodies | constraints.ignore = [["gunn", "fixture"]] =>
  constraints.ignore | 'gunn' | did you mean gun?
a border that leaves nothing | camera.border_px = 600.0 => border_px 600 leaves nothing of the image
nearest beyond farthest | camera.nearest_mm = 900.0 => nearest_mm 900 is not below farthest_mm 700
a lens on its target | camera.position_mm = [200.0, -50.0, 350.0] =>
  camera.position_mm | the lens of the camera lies on the target
a preset with a locked joint | robot.lock = ["joint_6"] => joints can be locked in a urdf only
a coupled limit of five joints
  | robot.coupled_limit = [{name="J23",coefficients=[0,1,1,0,0],lower_deg=-9,upper_deg=9}] =>
  robot.coupled_limit | J23: 5 coefficients for 6 joints
a coupled limit without a range
  | robot.coupled_limit = [{name="J",coefficients=[0,1,1,0,0,0],lower_deg=10,upper_deg=10}] =>
  lower_deg 10 is not below upper_deg 10
a target without a face | target.normal = [0.0, 0.0, 0.0] => no direction
a box without a size | camera.image_px = [0, 480] => greater than 0
an unknown controller | robot.controller = "fanucc" =>
  robot.controller | no controller 'fanucc' | did you mean fanuc
a controller of other arms | robot.controller = "staubli" =>
  joint 4 at zero does not turn about the axis
""")


@pytest.mark.parametrize(("given", "words"), KEYS)
def test_surroundings_that_make_no_sense(refuse, change_cell, work, given, words):
    refuse("check", change_cell(keys_of(given)), work / "poses.csv").says(*words)


SOLIDS: dict[str, tuple[str, tuple[str, ...]]] = {
    "box without size": ('name = "b"', ("a box needs size_mm",)),
    "sphere with height": (
        'name = "b"\nkind = "sphere"\nradius_mm = 5.0\nheight_mm = 3.0',
        ("a sphere has no height_mm",),
    ),
    "unknown kind": ('name = "b"\nkind = "cone"', ("'box', 'cylinder'",)),
    "size of zero": ('name = "b"\nsize_mm = [0.0, 1.0, 1.0]', ("greater than 0",)),
    "mistyped key": ('name = "b"\nsize_m = [1.0, 1.0, 1.0]', ("no such key", "size_mm")),
    "a name twice": (
        'name = "gun"\nsize_mm = [9.0, 9.0, 9.0]',
        ("two solids have the name 'gun'",),
    ),
    "mesh that is not there": ('name = "b"\nkind = "mesh"\nmesh = "nowhere.stl"', ("nowhere.stl",)),
    "mesh that is none": ('name = "b"\nkind = "mesh"\nmesh = "poses.csv"', ("poses.csv",)),
}


@pytest.mark.parametrize(("text", "words"), SOLIDS.values(), ids=SOLIDS)
@pytest.mark.parametrize("table", ["obstacle", "tool.body"])
def test_solids_that_make_no_sense(refuse, work, text, words, table):
    path = work / "cell.toml"
    path.write_text(path.read_text() + f"\n[[{table}]]\n{text}\n")
    refuse("check", path, work / "poses.csv").says(*words)


CUBE = """solid cube
{facets}endsolid cube
"""


def cube_stl(size: float) -> str:
    """A cube about the origin, as ASCII STL."""
    corners = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1], indexing="ij")).reshape(3, -1).T
    facets = ""
    for axis in range(3):
        for side in (-1, 1):
            face = corners[corners[:, axis] == side]
            a, b, c, d = face * size / 2.0
            for triangle in ((a, b, c), (b, d, c)):
                vertices = "".join("vertex {} {} {}\n".format(*point) for point in triangle)
                facets += f"facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n"
    return CUBE.format(facets=facets)


@pytest.mark.parametrize(
    ("size", "scale", "noted"), [(400.0, 1.0, False), (0.4, 1000.0, False), (0.4, 1.0, True)]
)
def test_meshes_in_another_unit_are_noted(cli, work, size, scale, noted):
    """A cube of 400 mm where the gun is: seen in mm and in metres, but for the wrong scale."""
    (work / "cube.stl").write_text(cube_stl(size))
    path = work / "cell.toml"
    x, y, z = 1e3 * Cell.load(path).target_m
    place = f'mesh = "cube.stl"\nscale = {scale}\nat_mm = [{x - 250.0}, {y + 200.0}, {z + 250.0}]'
    path.write_text(path.read_text() + f'\n[[obstacle]]\nname = "cube"\nkind = "mesh"\n{place}\n')
    base = work / "base.csv"
    base.write_text("".join((work / "poses.csv").read_text().splitlines(keepends=True)[:2]))
    said = cli("check", path, base)
    assert ("the mesh of cube is 0.4 mm large: is its file in mm?" in said.err) == noted
    assert ("gun and cube run" in said.out) == (not noted)
    assert said.code == (0 if noted else 1)


def test_a_tool_is_no_half_space(refuse, work):
    path = work / "cell.toml"
    path.write_text(path.read_text() + '\n[[tool.body]]\nname = "b"\nkind = "half-space"\n')
    refuse("plan", path, "--out", work / "x").says("b: a tool cannot be a half-space")


def test_what_is_not_checked_is_said(cli, done, make_urdf, work):
    new = done("new", "--robot", make_urdf())
    cell = work / "own.toml"
    cell.write_text(new.out)
    refused = cli("plan", cell, "--out", work / "own")
    assert refused.code == 2
    assert "small has no collision geometry for l2, l3, l4, l5: what they run into" in refused.err
    cell.write_text(new.out.replace("collisions = true", "collisions = false"))
    assert cli("plan", cell, "--out", work / "own").code in (0, 1)
    said = cli("check", cell, work / "own" / "poses.csv")
    assert "not checked: collisions: constraints.collisions is false" in said.out
    assert "not checked: the view of the target: no [camera] is described" in said.out
