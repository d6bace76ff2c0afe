"""Files from step to step: what one command writes, the next one reads."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from posedesign.cell import Cell
from tests.cli.conftest import Cli, offsets_only, rows_of, with_camera

RIGID = {
    "truth.deflection": "false",
    "measurement.three_sigma_mm": "[1e-4, 1e-4, 1e-4]",
    "measurement.camera_three_sigma_deg": "1e-6",
    "measurement.camera_three_sigma_mm": "1e-5",
}
"""A robot without deflection, measured as good as without noise."""


def chain(cli: Cli, cell: Path, out: Path) -> dict[str, Any]:
    """All steps on files alone; what identification says."""
    for line in (
        ("plan", cell),
        ("program", out / "poses.csv", "--cell", cell),
        ("simulate", with_camera(cell), out / "poses.csv"),
        ("identify", cell, out / "touchups.csv"),
        ("robot-world", out / "pairs.csv"),
    ):
        said = cli(*line, "--out", out)
        assert said.code == 0, (line, said)
    answer: dict[str, Any] = json.loads((out / "identification.json").read_text())
    return answer


def test_identified_offsets_are_the_true_ones(cli, change_cell, work):
    cell = offsets_only(change_cell(RIGID), judged=True)
    answer = chain(cli, cell, work / "out")
    truth = Cell.load(cell).config.truth
    model = next(m for m in answer["models"] if m["name"] == "offsets")
    found = {p["name"]: p for p in model["parameters"]}
    assert truth.zero_offsets_deg is not None
    for joint in range(2, 6):
        offset = found[f"zero_offset.joint_{joint}"]
        assert offset["sigma"] < 1e-4
        miss = offset["value"] - truth.zero_offsets_deg[joint - 1]
        assert abs(miss) < 5.0 * offset["sigma"], offset
    assert model["rms_mm"] < 3e-4
    assert 0.5 < model["noise_scale"] < 1.5
    before = next(m for m in answer["models"] if m["name"] == "frames only")
    assert before["rms_mm"] > 0.1


def test_true_camera_and_target_are_found(cli, change_cell, work):
    keys = {**RIGID, "truth.zero_offsets_deg": "[0.0, 0.0, 0.0, 0.0, 0.0, 0.0]"}
    cell = offsets_only(change_cell(keys))
    answer = chain(cli, cell, work / "out")
    offsets = answer["models"][1]["parameters"][:4]
    assert all(abs(p["value"]) < 5.0 * p["sigma"] for p in offsets)
    rows = rows_of(work / "out" / "robot_world.csv")
    loaded = Cell.load(cell)
    tool = 1e3 * loaded.tool_m + loaded.config.truth.tool_error_mm
    camera = tool - [0.0, 0.0, loaded.config.tool.camera_stand_off_mm]
    target = 1e3 * loaded.target_m + loaded.config.truth.target_error_mm
    assert len(rows) == 6
    for row in rows:
        x = [float(row[f"x_{axis}_mm"]) for axis in "xyz"]
        z = [float(row[f"z_{axis}_mm"]) for axis in "xyz"]
        np.testing.assert_allclose(x, camera, atol=2e-3)
        np.testing.assert_allclose(z, target, atol=2e-3)
        np.testing.assert_allclose([float(row[f"x_{a}_deg"]) for a in "wpr"], 0.0, atol=1e-4)


@pytest.mark.slow
def test_the_same_files_twice(cli, work):
    cell = offsets_only(work / "cell.toml", judged=True)
    chain(cli, cell, work / "one")
    chain(cli, cell, work / "two")
    for path in (work / "one").iterdir():
        assert path.read_bytes() == (work / "two" / path.name).read_bytes(), path.name


def test_view_line_touch_ups(cli, change_cell, work):
    keys = {**RIGID, "measurement.kind": '"view-line"', "parameters.tool_axes": '"xy"'}
    answer = chain(cli, offsets_only(change_cell(keys)), work / "out")
    names = [p["name"] for p in answer["models"][1]["parameters"]]
    assert "tool.z" not in names
    truth = (0.08, -0.06, 0.05, 0.10)
    for parameter, true in zip(answer["models"][1]["parameters"][:4], truth, strict=True):
        assert abs(parameter["value"] - true) < 5.0 * parameter["sigma"]


def test_spreadsheet_round_trip_changes_nothing(cli, work):
    """Excel writes a byte order mark and CRLF; people add comment lines."""
    cell = offsets_only(work / "cell.toml")
    assert cli("identify", cell, work / "touchups.csv", "--out", work / "a").code == 0
    plain = (work / "touchups.csv").read_text()
    touched = "# measured on Monday\n" + plain.replace("\n", "\n\n", 3)
    (work / "excel.csv").write_bytes(("\ufeff" + touched).replace("\n", "\r\n").encode())
    assert cli("identify", cell, work / "excel.csv", "--out", work / "b").code == 0
    one, two = (json.loads((work / d / "identification.json").read_text()) for d in "ab")
    for answer in (one, two):
        del answer["origin"], answer["data"]
    assert one == two


@pytest.mark.slow
@pytest.mark.parametrize("name", ["#1", "=T1", "-1", "Zapfen 3, links", 'the "old" one', "'x"])
def test_any_target_name_survives_the_files(cli, change_cell, work, name):
    cell = offsets_only(change_cell({"target.name": json.dumps(name)}))
    answer = chain(cli, cell, work / "out")
    assert answer["targets"] == [name]
    assert answer["measurements"] == 27


def test_several_targets(cli, work):
    """The touch-ups say which targets there are; the cell need not."""
    lines = (work / "touchups.csv").read_text().splitlines()
    named = [lines[0], *(f"S{i % 2}" + row[2:] for i, row in enumerate(lines[1:]))]
    (work / "two.csv").write_text("\n".join(named) + "\n")
    assert (
        cli("identify", offsets_only(work / "cell.toml"), work / "two.csv", "--out", work).code == 0
    )
    answer = json.loads((work / "identification.json").read_text())
    assert answer["targets"] == ["S0", "S1"]
    names = [p["name"] for p in answer["models"][1]["parameters"]]
    assert "target.S0.x" in names
    assert "target.S1.z" in names
