"""Arms of fewer than six axes, from their description to the corrected robot, as people type it."""

import csv
import json
import tomllib

import numpy as np
import pytest

from calib import Robot
from posedesign.cell import Cell
from tests.few_axes import urdf_of_axes
from tests.unit.robots.test_followers import PALLETISER, urdf

TOLD = {
    # joints of offsets, axes of the tool, kind, of what touches or an instrument
    "scara": (["j2"], "xy", "touch-up"),
    "five axes": (["j2", "j3", "j4"], "xyz", "touch-up"),
    "four axes": (["j3"], "xz", "touch-up"),
    "stanford": (["j2", "j3", "j4", "j5"], "xyz", "touch-up"),
    "palletiser": (["j2", "j3"], "xy", "touch-up"),
    "cartesian": ([], "", "point"),
    "cylindrical": ([], "xy", "point"),
}


@pytest.mark.parametrize("name", TOLD)
def test_new_plan_identify_and_correct_go_through(name, cli, done, tmp_path):
    offsets, axes, kind = TOLD[name]
    text = urdf(PALLETISER) if name == "palletiser" else urdf_of_axes(name)
    (tmp_path / "arm.urdf").write_text(text)
    text = done("new", "--robot", tmp_path / "arm.urdf").out
    text = text.replace("collisions = true", "collisions = false", 1)
    cell = tmp_path / "cell.toml"
    cell.write_text(text.replace("candidates = 1500", "candidates = 200"))
    read = tomllib.loads(text)
    assert read["parameters"]["zero_offsets"] == offsets
    assert read["parameters"]["tool_axes"] == axes
    assert read["measurement"]["kind"] == kind
    by_grid = cli("plan", cell, "--out", tmp_path / "grid")
    if kind == "point":
        assert by_grid.code == 2
        assert "method exchange" in by_grid.err
    else:
        assert by_grid.code in (0, 1)  # 1: C_G is above what was asked for
        _check_touched(cell, tmp_path / "grid" / "poses.csv")
    done("plan", cell, "--method", "exchange", "--out", tmp_path)
    if kind == "touch-up":
        _check_touched(cell, tmp_path / "poses.csv")
    if name == "four axes":  # one zero, hardly told by poses of one plane
        return
    done("simulate", cell, tmp_path / "poses.csv", "--out", tmp_path)
    measured = tmp_path / ("touchups.csv" if kind == "touch-up" else "measurements.csv")
    done("identify", cell, measured, "--out", tmp_path)
    found = json.loads((tmp_path / "identification.json").read_text())
    assert found["recommended"]
    robot = Robot.from_urdf(tmp_path / "arm.urdf")
    loaded = Cell.load(cell)
    middle = 1e3 * robot.state(loaded.base_posture).point(loaded.tool_m)
    box = ",".join(f"{v:.1f}" for v in [*(middle - 10), *(middle + 10)])
    done(
        *("correct", cell, tmp_path / "identification.json", tmp_path / "poses.csv"),
        *(f"--box={box}", "--out", tmp_path / "corrected"),
    )
    corrected = _rows(tmp_path / "corrected" / "corrected_poses.csv")
    assert all(row["status"] != "dropped" for row in corrected)
    mastering = _rows(tmp_path / "corrected" / "mastering.csv")
    assert [row["joint"] for row in mastering] == list(robot.joint_names)
    assert ("correction_mm" in mastering[0]) == bool(robot.sliding.any())


def _rows(path):
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def _check_touched(cell, path):
    """The tool point of every pose is on the target, within the limits of the joints."""
    read, rows = Cell.load(cell), [r for r in _rows(path) if r["status"] != "dropped"]
    labels = zip(read.robot.joint_labels, read.robot.joint_units, strict=True)
    columns = [f"{label.lower()}_{unit}" for label, unit in labels]
    q = read.robot.of_shown([[float(row[c]) for c in columns] for row in rows])
    off = read.robot.state(q).point(read.tool_m) - read.target_m
    assert np.linalg.norm(off, axis=1).max() < 1e-8
    assert ((q >= read.robot.lower) & (q <= read.robot.upper)).all()
    assert len(rows) >= 2
