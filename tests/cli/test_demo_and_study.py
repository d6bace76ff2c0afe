"""The two long commands, once each with ten draws."""

import json
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from calib.robot_world import PAPER_METHODS
from posedesign.cell import Cell
from posedesign.cli.main import run
from posedesign.files.measurements import read_measurements
from posedesign.hand_eye.pairs import read_pairs
from posedesign.planning.poses_file import read_poses
from posedesign.programs import validate
from tests.cli.conftest import rows_of, unfolded

FILES = {
    "cell.toml",
    "poses.csv",
    "CALIB01.LS",
    "touchups.csv",
    "identification.json",
    "robot_world.csv",
    "accuracy_vs_condition.csv",
    "accuracy_vs_condition.png",
}
"""What the demo promises to leave behind."""


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> tuple[Path, str]:
    """``posedesign demo --draws 10`` with its folder and what it printed."""
    out = tmp_path_factory.mktemp("demo") / "posedesign-demo"
    said, aside = StringIO(), StringIO()
    with redirect_stdout(said), redirect_stderr(aside):
        code = run(["demo", "--out", str(out), "--draws", "10"])
    assert code == 0
    assert aside.getvalue() == ""  # no progress bar where nobody watches
    return out, said.getvalue()


def test_demo_leaves_its_files(demo):
    out, said = demo
    said = unfolded(said)
    names = {path.name for path in out.iterdir()}
    assert names >= FILES
    assert not [name for name in names if name.startswith(".") or name.endswith(".tmp")]
    assert all(name in said for name in FILES if not name.endswith(".png"))
    assert ", 4 pictures" in said
    assert "threshold reached: C_G 8.354e+04" in said
    assert "with 27 poses at D_W/D_P/D_R 40/40/40 deg" in said


def test_demo_files_can_be_read_back(demo):
    out, _ = demo
    cell = Cell.load(out / "cell.toml")
    poses = read_poses(out / "poses.csv", cell.robot.n)
    assert len(poses.measured.names) == 27
    np.testing.assert_allclose(poses.postures[-1], cell.base_posture, atol=1e-9)
    assert validate(out / "CALIB01.LS") == []
    assert read_measurements(out / "touchups.csv", cell.robot.n).data.count == 27
    assert len(read_pairs(out / "pairs.csv").names) == 27
    answer = json.loads((out / "identification.json").read_text())
    assert [m["name"] for m in answer["models"]][:2] == ["frames only", "offsets"]
    assert answer["recommended"] == "offsets + compliance"
    assert set(answer["models"][1]["parameters"][0]) >= {"name", "value", "unit", "sigma"}
    methods = [row["method"] for row in rows_of(out / "robot_world.csv")]
    assert methods == ["ml", "ml-robust", *PAPER_METHODS]
    assert (out / "accuracy_vs_condition.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_demo_files_feed_the_single_commands(demo, done):
    out, _ = demo
    done("score", out / "cell.toml", out / "poses.csv")


def test_study_covers_every_estimator_and_quantity(demo):
    rows = rows_of(demo[0] / "accuracy_vs_condition.csv")
    sets = {row["d_w_deg"] for row in rows}
    assert len(sets) >= 9  # 5 deg, 10 deg, ... until wider angles no longer help
    assert {float(d) for d in sets} <= {5.0 * (i + 1) for i in range(12)}
    assert {row["draws"] for row in rows} == {"10"}
    for d in sets:
        here = [row for row in rows if row["d_w_deg"] == d]
        found = {(row["estimator"], row["quantity"]) for row in here}
        for estimator in ("touch-up weighted", "touch-up unweighted", "view line"):
            for joint in range(2, 6):
                assert (estimator, f"zero_offset.joint_{joint}") in found
        for solver in PAPER_METHODS:
            assert (solver, "X translation") in found
            assert (solver, "Z rotation") in found
        assert ("uncalibrated", "plate distance worst") in found


def test_study_says_that_lower_condition_means_smaller_errors(demo):
    rows = [
        row
        for row in rows_of(demo[0] / "accuracy_vs_condition.csv")
        if (row["estimator"], row["quantity"], row["truth"])
        == ("touch-up weighted", "zero_offset.joint_2", "deflecting")
    ]
    rows.sort(key=lambda row: -float(row["c_g"]))
    predicted = np.array([float(row["predicted_sigma"]) for row in rows])
    spread = np.array([float(row["spread"]) for row in rows])
    assert (np.diff(predicted) < 0).all()
    assert spread[0] > 10 * spread[-1]
    # ten draws tell a standard deviation to a factor of about two
    assert ((spread > predicted / 3) & (spread < 3 * predicted)).all()


@pytest.mark.slow
@pytest.mark.usefixtures("rendered")
def test_study_command(cli, done, work):
    text = (work / "cell.toml").read_text()
    quick = text.replace("largest_deg = [60.0, 60.0, 60.0]", "largest_deg = [10.0, 10.0, 10.0]")
    (work / "cell.toml").write_text(quick)
    out = work / "study"
    said = cli("study", "accuracy", work / "cell.toml", "--draws", 10, "--out", out, "--json")
    assert (said.code, said.err) == (0, "")
    findings = json.loads(said.out)
    rows = rows_of(out / "accuracy_vs_condition.csv")
    assert len(findings) == len(rows)
    for finding, row in zip(findings, rows, strict=True):
        assert finding["quantity"] == row["quantity"]
        if row["error_median"]:
            median = finding["error_median"]
            assert float(row["error_median"]) == pytest.approx(median, abs=1e-9)
        else:
            assert finding["error_median"] is None
    table = done("study", "accuracy", work / "cell.toml", "--draws", 10, "--out", out)
    assert "10 draws a pose set" in table.out
    for name in ("accuracy_vs_condition.csv", "accuracy_vs_condition.png"):
        assert (out / name).stat().st_size > 1000
        assert str(out / name) in table.out


def test_study_depends_on_the_seed_alone(cli, work, monkeypatch):
    drawn = "posedesign.report.accuracy.draw_accuracy"
    monkeypatch.setattr(drawn, lambda study, path: path)  # longer than the studies
    text = (work / "cell.toml").read_text()
    quick = text.replace("largest_deg = [60.0, 60.0, 60.0]", "largest_deg = [5.0, 5.0, 5.0]")
    (work / "cell.toml").write_text(quick)
    answers = [
        cli("study", "accuracy", work / "cell.toml", "--draws", 10, "--seed", s, "--out", work)
        for s in (1, 1, 2)
    ]
    assert answers[0].out == answers[1].out
    assert answers[0].out != answers[2].out
