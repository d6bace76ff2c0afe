"""``posedesign calibrate``: rehearsed, stopped, gone on with, refused."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from posedesign.template import cell_template

CELL = (
    cell_template()
    .replace("image_px = [1280, 1024]", "image_px = [640, 480]")
    .replace("focal_px = 1800.0", "focal_px = 900.0")
    .replace('["zero_offsets", "compliance"], ["geometry"], ["geometry", "compliance"],', "")
    .replace('["geometry", "compliance", "priors"],', '["zero_offsets", "compliance"]')
)


@pytest.fixture
def cell(tmp_path: Path) -> Path:
    path = tmp_path / "cell.toml"
    path.write_text(CELL)
    return path


@pytest.mark.parametrize("images", ["--images", "--no-images"])
def test_rehearsal(cli, cell: Path, tmp_path: Path, images: str) -> None:
    out = tmp_path / "run"
    said = cli("calibrate", cell, "--out", out, images)
    assert said.code == 0, said.err
    for words in (
        "Camera and target, found by inching",
        "3 sigma of a touch-up, from repeats",
        "threshold reached",
        "touched up: 27 of 27 poses",
        "Before and after",
        "recommended: offsets + compliance",
        "Plate of 5 x 5 targets",
    ):
        assert words in said.out
    names = {path.name for path in out.iterdir()}
    expected = {"found_cell.toml", "identification.json", "journal.jsonl", "poses.csv"}
    expected |= {"rounds.csv", "touchups.csv"} | ({"pairs.csv"} if images == "--images" else set())
    assert names == expected
    # what was found serves every other command
    assert cli("check", out / "found_cell.toml", out / "poses.csv").code == 0
    again = cli("identify", out / "found_cell.toml", out / "touchups.csv", "--out", tmp_path / "id")
    assert again.code == 0
    first, second = (
        json.loads((folder / "identification.json").read_text())["models"]
        for folder in (out, tmp_path / "id")
    )
    for a, b in zip(first, second, strict=True):
        assert a["rms_mm"] == pytest.approx(b["rms_mm"], rel=1e-3)


def test_plate_is_better_after_than_before(cli, cell: Path, tmp_path: Path) -> None:
    """Below half of it, as in the paper, with offsets alone; far below with the deflection."""
    said = cli("calibrate", cell, "--out", tmp_path / "run", "--no-images", "--json")
    assert said.code == 0
    rows = {row["model"]: row["over 400 mm"] for row in json.loads(said.out)["plate_mm"]}
    assert rows["offsets"] < 0.5 * rows["frames only"]
    assert rows["offsets + compliance"] < 0.2 * rows["frames only"]


def test_stopped_and_gone_on(cli, cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    first = cli("calibrate", cell, "--out", out, "--no-images", "--json")
    journal = out / "journal.jsonl"
    lines = journal.read_text().splitlines(keepends=True)
    kept = "".join(lines[:30])
    journal.write_text(kept + lines[30][:50])  # the machine went down there
    second = cli("calibrate", cell, "--out", out, "--no-images", "--json")
    assert "going on from 29 measurements" in second.err
    assert second.out == first.out
    assert journal.read_text() == "".join(lines)
    anew = cli("calibrate", cell, "--out", out, "--no-images", "--json", "--restart")
    assert "going on" not in anew.err
    assert anew.out == first.out
    assert (out / "journal.1.jsonl").read_text() == "".join(lines)


def test_touch_ups_are_those_of_the_journal(cli, cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    cli("calibrate", cell, "--out", out, "--no-images")
    with (out / "touchups.csv").open() as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    entries = [json.loads(line) for line in (out / "journal.jsonl").read_text().splitlines()[1:]]
    answers = {entry["name"]: entry["answer"] for entry in entries}
    assert len(rows) == 27
    for row in rows:
        q = answers[row["pose"]]["q"][0]
        shown = [float(row[f"j{k + 1}_deg"]) for k in range(6)]
        assert shown == pytest.approx([v * 57.29577951308232 for v in q], abs=1e-5)


def test_refusals(refuse, cli, cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    refuse("calibrate", tmp_path / "none.toml").says("none.toml", "cannot be read")
    refuse("calibrate", cell, "--out", cell).says("cell.toml", "folder")
    refuse("calibrate", cell, "--out", out, "--robot-folder", tmp_path / "gone").says("gone")
    refuse("calibrate", cell, "--out", out, "--wait-s", "0").says("wait-s")
    cell.write_text(CELL.replace('kind = "touch-up"', 'kind = "view-line"', 1))
    cell.write_text(cell.read_text().replace('tool_axes = "xyz"', 'tool_axes = "xy"'))
    refuse("calibrate", cell, "--out", out).says("view-line", 'measurement.kind = "touch-up"')


def test_a_target_that_was_not_in_view_may_be_brought_there(
    cli, cell: Path, tmp_path: Path
) -> None:
    """What failed is not replayed: the same command looks again."""
    cell.write_text(CELL.replace("[5.0, -4.0, 2.0]", "[200.0, 0.0, 0.0]"))
    for _ in range(2):
        said = cli("calibrate", cell, "--out", tmp_path / "run", "--no-images")
        assert said.code == 2
        assert "not seen from the taught posture" in said.err
        assert "going on" not in said.err


def test_another_cell_in_the_same_folder(refuse, cli, cell: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert cli("calibrate", cell, "--out", out, "--no-images").code == 0
    refuse("calibrate", cell, "--out", out, "--no-images", "--seed", 5).says(
        "journal.jsonl", "another cell, robot or options", "--restart"
    )


def test_not_reached_is_told_by_the_exit_code(cli, cell: Path, tmp_path: Path) -> None:
    cell.write_text(CELL.replace("condition_threshold = 1.0e5", "condition_threshold = 1.0"))
    said = cli("calibrate", cell, "--out", tmp_path / "run", "--no-images")
    assert said.code == 1
    assert "planned: " in said.out
