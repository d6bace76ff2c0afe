"""``posedesign plan`` for a camera on the tool, and for an accuracy that is wanted."""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.robot_world import PairNoise, design
from calib.se3 import inverse
from posedesign.cell import Cell, cell_template
from posedesign.hand_eye.pairs import read_pairs
from posedesign.planning import NEAR_TARGET_M
from posedesign.planning.poses_file import read_poses
from tests.cli.conftest import rows_of, with_keys

CAMERA = {"measurement.kind": '"camera-pose"'}
ONE_AXIS = {"variations.start_deg": "[0.0, 0.0, 5.0]", "variations.largest_deg": "[0.0, 0.0, 60.0]"}


@pytest.fixture
def cell(change_cell) -> Path:
    """The reference cell with a camera in place of the pin."""
    return change_cell(CAMERA | {"plan.condition_threshold": "40.0"})


def test_the_loop_turns_farther_until_X_and_Z_are_conditioned(cli, cell, tmp_path):
    said = cli("plan", cell, "--out", tmp_path / "plan", "--json")
    assert said.code == 0
    told = json.loads(said.out)
    assert told["reached"] is True
    assert told["rounds"][-1]["c_g"] < 40.0 <= told["rounds"][-2]["c_g"]
    assert "rows over noise" in told["scaling"]["c_g"]
    assert len(told["predicted"]) == 12
    loaded = Cell.load(cell)
    q = read_poses(tmp_path / "plan" / "poses.csv", 6).measured.postures
    # noise of the target as seen: the equation read backwards
    noise = PairNoise(np.deg2rad(0.02), 1e-4, "B")
    blocks = design.blocks(
        inverse(loaded.robot.fk(q)), loaded.T_base_target, loaded.T_tip_camera, noise
    )
    sigma = np.sqrt(np.diag(design.covariance(blocks)))
    for k, axis in enumerate("xyz"):
        row = next(r for r in told["predicted"] if r["parameter"] == f"tool.{axis}")
        assert row["predicted sigma"] == pytest.approx(1e3 * sigma[9 + k], rel=1e-5)
    assert "robot is taken to be exact" in said.err


def test_people_are_told_which_is_X_and_which_is_Z(cli, cell, tmp_path):
    out = cli("plan", cell, "--out", tmp_path / "plan").out
    assert "tool: X = T_flange_camera" in out
    assert "target: Z = T_base_target" in out


def test_the_usual_threshold_of_touch_ups_is_spoken_of(cli, change_cell):
    path = change_cell(CAMERA | {"plan.condition_threshold": "1e5"})
    said = cli("plan", path, "--out", path.parent / "plan")
    assert said.code == 0
    assert "set plan.condition_threshold to 100 or less" in said.err


def test_threshold_and_dwell_follow_the_kind_of_measurement(change_cell):
    """Of a cell that was written for touch-ups, when nothing but the kind is changed."""
    of_touch_ups, of_poses = (Cell.load(change_cell(keys)).config.plan for keys in ({}, CAMERA))
    assert (of_touch_ups.condition_threshold, of_touch_ups.dwell_s) == (1e5, 20.0)
    assert (of_poses.condition_threshold, of_poses.dwell_s) == (50.0, 2.0)
    given = Cell.load(change_cell(CAMERA | {"plan.dwell_s": "20.0"})).config.plan
    assert (given.condition_threshold, given.dwell_s) == (50.0, 20.0)


def test_poses_that_see_the_target_from_anywhere_are_written_and_rehearsed(cli, demo_work):
    """The tool point is not on the target then: nothing is touched."""
    path = demo_work / "cell.toml"
    keys = CAMERA | {"pool.kind": '"joints"', "pool.candidates": "200"}
    path.write_text(with_keys(path.read_text(), keys))
    plan = ("plan", path, "--method", "exchange", "--criterion", "D", "--poses", 8, "--no-refine")
    assert cli(*plan, "--out", demo_work / "plan").code == 0
    poses, cell = demo_work / "plan" / "poses.csv", Cell.load(path)
    points = cell.robot.state(read_poses(poses, 6).measured.postures).point(cell.tool_m)
    assert np.linalg.norm(points - cell.target_m, axis=1).max() > NEAR_TARGET_M
    checked = cli("check", path, poses)
    assert checked.code == 0
    assert "from the target" not in checked.err
    assert cli("program", poses, "--cell", path, "--out", demo_work / "plan").code == 0
    said = cli("simulate", path, poses, "--out", demo_work / "seen")
    assert said.code == 0
    assert f"next: posedesign robot-world {demo_work / 'seen' / 'pairs.csv'} --out " in said.out
    assert len(read_pairs(demo_work / "seen" / "pairs.csv").A) == 8


@pytest.mark.slow
def test_the_fewest_poses_for_an_accuracy(cli, cell, tmp_path):
    wanted = ("--wanted-sigma-mm", 0.05, "--wanted-sigma-deg", 0.02)
    said = cli("plan", cell, "--out", tmp_path / "few", *wanted, "--json")
    assert said.code == 0
    told = json.loads(said.out)
    assert told["reached"] is True
    assert told["poses"] < 27
    over = []
    for row in told["predicted"]:
        limit = {"mm": 0.05, "deg": 0.02}[row["unit"]]
        assert row["wanted"] == pytest.approx(limit)
        assert row["predicted sigma"] <= limit * (1 + 1e-6)
        over.append(row[f"with {told['poses'] - 1} poses"] > limit)
    assert any(over)
    assert told["at_least"] <= told["poses"]
    part = [r["predicted sigma"] / r["wanted"] for r in told["predicted"]]
    assert told["decides"] == told["predicted"][part.index(max(part))]["parameter"]
    assert f"({told['decides']} decides)" in told["message"]
    rows = rows_of(tmp_path / "few" / "poses.csv")
    assert sum(row["status"] != "via" for row in rows) == told["poses"]
    scored = json.loads(cli("score", cell, tmp_path / "few" / "poses.csv", "--json").out)
    assert scored["off_target"] == []
    assert scored["predicted"] == [
        {
            "parameter": r["parameter"],
            "predicted sigma": pytest.approx(r["predicted sigma"], rel=1e-4),
            "unit": r["unit"],
        }
        for r in told["predicted"]
    ]
    checked = json.loads(cli("check", cell, tmp_path / "few" / "poses.csv", "--json").out)
    assert checked["feasible"] is True


@pytest.mark.slow
def test_a_finer_accuracy_takes_more_poses(cli, cell, tmp_path):
    counts = [
        json.loads(
            cli("plan", cell, "--out", tmp_path / "few", "--wanted-sigma-mm", mm, "--json").out
        )["poses"]
        for mm in (0.1, 0.07)
    ]
    assert counts == sorted(set(counts))


def test_what_is_out_of_reach_is_said_with_all_poses(cli, cell, tmp_path):
    said = cli("plan", cell, "--out", tmp_path / "none", "--wanted-sigma-mm", 0.001)
    assert said.code == 1
    assert "all " in said.out
    assert "times the deviation wanted" in said.out
    assert " decides): each would have to be measured " in said.out
    assert "wrote: nothing" in said.out
    assert not (tmp_path / "none").exists()


def test_touch_ups_may_be_planned_for_an_accuracy_too(cli, work):
    told = json.loads(
        cli(
            "plan", work / "cell.toml", "--out", work / "few", "--wanted-sigma-deg", 0.01, "--json"
        ).out
    )
    assert told["reached"] is True
    assert told["predicted"][0]["parameter"].startswith("zero_offset")
    assert told["predicted"][0]["predicted sigma"] <= 0.01 * (1 + 1e-6)
    assert told["predicted"][-1]["wanted"] is None  # any length will do


def test_what_is_simulated_are_pairs(cli, cell, tmp_path):
    out = tmp_path / "few"
    assert cli("plan", cell, "--out", out, "--wanted-sigma-mm", 0.06).code == 0
    said = cli("simulate", cell, out / "poses.csv", "--out", out)
    assert said.code == 0
    assert "pairs of A X = Z B" in said.out
    assert not (out / "touchups.csv").exists()
    pairs = read_pairs(out / "pairs.csv")
    np.testing.assert_allclose(
        pairs.A,
        Cell.load(cell).robot.fk(read_poses(out / "poses.csv", 6).measured.postures),
        atol=1e-9,
    )


@pytest.mark.parametrize("words", [(), ("--wanted-sigma-mm", 1.0)])
def test_turning_about_one_axis_is_refused(refuse, change_cell, words):
    path = change_cell(CAMERA | ONE_AXIS | {"plan.repair": "false"})
    refuse("plan", path, *words).says("cannot identify target.T1.z, target.T1.rz", "absorbed by")


def test_camera_poses_are_weighted(refuse, change_cell):
    path = change_cell(CAMERA | {"measurement.weighted": "false"})
    refuse("plan", path).says("mm and deg have no common unit", "measurement")


def test_what_needs_a_robot_to_identify_is_refused(refuse, cell, work):
    box = ("--box", "1700,-200,300,2000,200,700")
    refuse("predict", cell, work / "poses.csv", *box).says('measurement.kind = "touch-up"')
    refuse("study", "accuracy", cell).says('measurement.kind = "touch-up"')


def test_an_arm_whose_camera_looks_is_not_let_go(cli, tmp_path):
    """Nothing is to be brought to a target by hand, and the arm would sink under its camera."""
    text = cell_template("ur5e", surroundings=False)
    scripts = []
    for kind in ("touch-up", "camera-pose"):
        out = tmp_path / kind
        out.mkdir()
        (out / "cell.toml").write_text(with_keys(text, {"measurement.kind": f'"{kind}"'}))
        assert cli("plan", out / "cell.toml", "--out", out).code == 0
        words = ("program", out / "poses.csv", "--cell", out / "cell.toml", "--out", out)
        assert cli(*words).code == 0
        assert cli("validate", out / "CALIB01.script").out.endswith(": no problem found\n")
        scripts.append((out / "CALIB01.script").read_text())
    by_hand, by_sight = scripts
    assert "  freedrive_mode()\n" in by_hand
    assert "freedrive" not in by_sight
    assert 'request_boolean_from_primary_client("Is this pose measured?")' in by_sight
