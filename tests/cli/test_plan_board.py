"""``posedesign plan``, ``next``, ``score``, ``check`` and ``program`` for pictures of a board."""

import json
from pathlib import Path

import numpy as np
import pytest

from posedesign.cell import Cell, cell_template
from posedesign.planning.optimal import refinement
from posedesign.planning.poses_file import read_poses
from tests.board_cells import check_constraints
from tests.cli.conftest import rows_of

BOARD = """
[board]
kind = "charuco"
columns = 8
rows = 6
square_mm = 15.0
marker_mm = 11.0
dictionary = "DICT_5X5_100"

[camera]
farthest_mm = 700.0
"""


def board_text(*changes: tuple[str, str]) -> str:
    text = cell_template(surroundings=False) + BOARD
    for old, new in (
        ('kind = "touch-up"', 'kind = "board"'),
        ("candidates = 1500", "candidates = 80"),
        *changes,
    ):
        assert old in text
        text = text.replace(old, new, 1)
    return text


@pytest.fixture(autouse=True)
def _few_sweeps(monkeypatch) -> None:
    """What more of them would still gain decides nothing here."""
    monkeypatch.setattr(refinement, "MOST_SWEEPS", 3)


@pytest.fixture
def cell(tmp_path) -> Path:
    path = tmp_path / "cell.toml"
    path.write_text(board_text())
    return path


def test_poses_are_chosen_checked_continued_and_written(cli, cell, tmp_path):
    out, poses = tmp_path / "plan", tmp_path / "plan" / "poses.csv"
    said = cli("plan", cell, "--poses", 8, "--no-refine", "--out", out, "--json")
    assert said.code == 0
    told = json.loads(said.out)
    assert len(told["predicted"]) == 21
    assert [row["unit"] for row in told["predicted"][-9:]] == [*["px"] * 4, *[""] * 5]
    assert told["task_box"] == "the picture at 350 mm"
    assert "the lens marginalised" in told["scaling"]["c_g"]
    q = read_poses(poses, 6).measured.postures
    check_constraints(Cell.load(cell), q)
    margins = [float(row["view_margin_px"]) for row in rows_of(poses) if row["status"] != "via"]
    assert min(margins) >= 30.0
    scored = json.loads(cli("score", cell, poses, "--json").out)
    assert scored["off_target"] == scored["not_feasible"] == []
    values = [row["predicted sigma"] for row in told["predicted"]]
    assert [row["predicted sigma"] for row in scored["predicted"]] == pytest.approx(
        values, rel=1e-4
    )
    assert json.loads(cli("check", cell, poses, "--json").out)["feasible"] is True
    following = json.loads(
        cli("next", cell, poses, "--poses", 2, "--out", tmp_path / "n", "--json").out
    )
    assert following["identified"] is True
    assert following["poses"] == ["P09", "P10"]
    assert following["tcp_rms_mm"][0] == pytest.approx(told["tcp_rms_mm"], rel=1e-4)
    assert cli("program", poses, "--cell", cell, "--out", out).code == 0


def test_people_are_told_what_the_camera_will_see(cli, tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(board_text(("[camera]\n", '[camera]\nmount = "fixed"\n')))
    out = cli("plan", path, "--poses", 8, "--no-refine", "--out", tmp_path / "plan").out
    for words in (
        "seen from the base",
        "tool: X = T_flange_board",
        "target: Z = T_base_camera",
        "lens: focal length ",
        "what the camera sees, rms over the picture [mm]",
    ):
        assert words in out


def test_the_loop_turns_until_camera_and_board_are_conditioned(cli, cell, tmp_path):
    said = cli("plan", cell, "--out", tmp_path / "plan", "--json")
    told = json.loads(said.out)
    assert said.code == 0
    assert told["rounds"][-1]["c_g"] < 100.0 <= told["rounds"][-2]["c_g"]
    assert told["rounds"][-1]["grid"] == 27
    assert np.isfinite(told["chosen_tcp_rms_mm"])


def test_the_fewest_poses_for_what_is_wanted(cli, tmp_path):
    path = tmp_path / "cell.toml"
    path.write_text(board_text(("estimate_lens = true", "estimate_lens = false")))
    wanted = ("--wanted-sigma-mm", 0.2, "--wanted-sigma-deg", 0.05)
    told = json.loads(cli("plan", path, "--out", tmp_path / "few", *wanted, "--json").out)
    assert told["reached"] is True
    for row in told["predicted"]:
        assert row["predicted sigma"] <= {"mm": 0.2, "deg": 0.05}[row["unit"]] * (1 + 1e-6)
    assert any(row[f"with {told['poses'] - 1} poses"] > row["wanted"] for row in told["predicted"])


REFUSED = {
    "no board": ([(BOARD.split("[camera]")[0], "")], ("key board", "no board is described")),
    "no camera": ([("[camera]\nfarthest_mm = 700.0\n", "")], ("key camera", "focal_px")),
    "a pair of mounts": (
        [('kind = "board"', 'kind = "touch-up"'), ("[camera]\n", '[camera]\nmount = "fixed"\n')],
        ("key camera.mount", "a touch-up has its camera on the flange"),
    ),
    "not wholly in view": (
        [
            (
                BOARD,
                BOARD.replace("15.0", "40.0")
                .replace("charuco", "chessboard")
                .replace('marker_mm = 11.0\ndictionary = "DICT_5X5_100"\n', ""),
            )
        ],
        ("25 of 35 points of the board in the image", "35 needed"),
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_planned_for_is_refused_in_a_line(refuse, tmp_path, case):
    changes, words = REFUSED[case]
    path = tmp_path / "cell.toml"
    path.write_text(board_text(*changes))
    refuse("plan", path, "--poses", 8).says(*words)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--criterion", "C_G"), "C_G is of the entries of every row"),
        (("--robust", "average"), "tried by touching"),
    ],
)
def test_what_pictures_are_not_chosen_by_is_refused(refuse, cell, words, says):
    refuse("plan", cell, "--poses", 8, *words).says(says)
