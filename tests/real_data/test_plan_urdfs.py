"""``posedesign new`` and ``plan`` on URDFs of real arms."""

import csv
import json

import numpy as np
import pytest

from calib.robots import Robot
from posedesign.cell import Cell
from posedesign.cli.main import run
from posedesign.planning.poses_file import read_poses
from tests.board_cells import check_constraints

pytestmark = pytest.mark.real_data

ARMS = (
    "irb120_3_58", "irb6640_185_280", "irb6700_200_260", "kr6r900sixx", "lrmate200id", "m20ia",
    "mh5", pytest.param("panda", marks=pytest.mark.slow), "r2000ic165f", "tx2_60", "ur10e", "ur5e",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("mount", ["flange", "fixed"])
@pytest.mark.parametrize("arm", ARMS)
def test_a_cell_with_camera_and_board_is_planned_as_it_is(
    data_folder, tmp_path, capsys, arm, mount
):
    """But for shapes that a person has to give."""
    urdf = data_folder / "urdf" / f"{arm}.urdf"
    if not urdf.exists():
        pytest.skip(f"{urdf} does not exist")
    assert run(["new", "--robot", str(urdf), "--camera", mount]) == 0
    text = capsys.readouterr().out
    assert ("# DECIDE FIRST" in text) == (arm in RADII_MM)
    if arm in RADII_MM:
        text = text.replace("# capsule_radius_mm = ", f"capsule_radius_mm = {SLIM_MM} # ")
    (tmp_path / "cell.toml").write_text(text)
    assert run(["plan", str(tmp_path / "cell.toml"), "--out", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["reached"]
    cell = Cell.load(tmp_path / "cell.toml")
    check_constraints(cell, read_poses(tmp_path / "poses.csv", cell.robot.n).measured.postures)


SLIM_MM = [300, 200, 250, 120, 80, 60]
"""Of a wrist that does not hide what is on it."""

RADII_MM = {"irb6640_185_280": [300, 200, 250, 200, 100, 100]}


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_plan_reaches_the_threshold(data_folder, tmp_path, capsys, arm):
    urdf = data_folder / "urdf" / f"{arm}.urdf"
    if not urdf.exists():
        pytest.skip(f"{urdf} does not exist")
    assert run(["new", "--robot", str(urdf)]) == 0
    text = capsys.readouterr().out
    # none of these files has shapes: of one arm there is no preset, and a person has to decide
    assert ("# DECIDE FIRST" in text) == (arm in RADII_MM) == ("\nshapes = " not in text)
    if arm in RADII_MM:
        text = text.replace("# capsule_radius_mm = ", f"capsule_radius_mm = {RADII_MM[arm]} # ")
    (tmp_path / "cell.toml").write_text(text)
    code = run(["plan", str(tmp_path / "cell.toml"), "--out", str(tmp_path), "--json"])
    report = json.loads(capsys.readouterr().out)
    assert code == 0
    assert report["reached"]
    # every pose, as written, inside the limits and with the tool point on the target
    cell = Cell.load(tmp_path / "cell.toml")
    robot = Robot.from_urdf(urdf)
    with (tmp_path / "poses.csv").open() as stream:
        table = csv.DictReader(line for line in stream if not line.startswith("#"))
        rows = [row for row in table if row["status"] != "dropped"]
    q = np.deg2rad([[float(row[f"j{i + 1}_deg"]) for i in range(robot.n)] for row in rows])
    assert len(q) >= 20
    assert (q >= robot.lower - 1e-9).all()
    assert (q <= robot.upper + 1e-9).all()
    assert np.abs(robot.state(q).point(cell.tool_m) - cell.target_m).max() < 1e-9
