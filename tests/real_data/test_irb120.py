"""The IRB 120 under a measuring arm: what must be reached, by the study and the command line.

Measured by others (drliaowu/Minimal_Robot_Calibration_Using_Position, IEEE T-ASE 12(2), 2015).
Figures to compare with are those of an independent plain least-squares fit.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from posedesign.cli.main import run

pytestmark = pytest.mark.real_data

FOLDER = Path(__file__).parents[2] / "studies" / "03_irb120_measuring_arm"
FROM_COMMAND_LINE = (
    "frames only",
    "offsets",
    "offsets + compliance",
    "geometry",
    "geometry + compliance",
    "everything with priors",
)

Row = dict[str, Any]


@pytest.fixture(scope="module")
def tables(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("irb120")


@pytest.fixture(scope="module")
def found(study, data_folder, tables) -> Row:
    measured = data_folder / "identification" / "abb_irb120"
    if not measured.is_dir():
        pytest.skip(f"{measured} does not exist")
    return study.run(data_folder, tables)


@pytest.fixture(scope="module")
def rows(found) -> dict[str, Row]:
    return {row["model"]: row for row in found["models"]}


def test_the_bars_are_met(rows):
    """Of independent fits: 24 parameters, 30 parameters; and what is better than both."""
    assert rows["geometry, points pinned"]["leave_one_out_mm"] <= 0.346
    assert rows["geometry, shape of the points held"]["leave_one_out_mm"] <= 0.329
    assert rows["geometry"]["leave_one_out_mm"] <= 0.311
    assert rows["geometry + compliance"]["leave_one_out_mm"] <= 0.184
    assert rows["geometry, points pinned"]["check_mm"] <= 0.303
    assert rows["geometry, shape of the points held"]["check_mm"] <= 0.282
    assert rows["geometry + compliance"]["check_from_zero_mm"] <= 0.151


def test_the_references_are_reproduced(rows):
    """In the data's own protocol, and with base and points fitted; check points both ways."""
    for name, parameters, out in (
        ("nothing fitted", 0, 18.158),
        ("base, points held", 6, 14.315),
        ("offsets, base and points held", 6, 13.681),
        ("frames only", 15, 5.8186),
        ("offsets", 19, 0.6630),
        ("geometry, points pinned", 33, 0.3458),
        ("geometry, shape of the points held", 30, 0.3285),
        ("geometry", 33, 0.3101),
        ("geometry + compliance", 35, 0.1831),
    ):
        assert rows[name]["parameters"] == parameters
        assert rows[name]["leave_one_out_mm"] == pytest.approx(out, rel=5e-3), name
        # the reference refits without each configuration
        assert rows[name]["refitted_mm"] == pytest.approx(out, rel=4e-4), name
    for name, others, zero in (
        ("frames only", 5.6098, 5.5153),
        ("offsets", 0.6441, 0.6754),
        ("geometry, points pinned", 0.2931, 0.3152),
        ("geometry, shape of the points held", 0.2799, 0.3263),
        ("geometry", 0.2799, 0.3263),
        ("geometry + compliance", 0.1433, 0.1502),
    ):
        assert rows[name]["check_mm"] == pytest.approx(others, abs=1e-4), name
        assert rows[name]["check_from_zero_mm"] == pytest.approx(zero, abs=1e-4), name


def test_everything_is_recommended_and_compliance_is_no_chance(found, rows):
    assert found["recommended"] == "everything with priors"
    best, before = rows["everything with priors"], rows["geometry + compliance"]
    for name in ("leave_one_out_mm", "check_mm", "check_from_zero_mm"):
        assert best[name] < before[name] < rows["geometry"][name]
    assert best["refitted_mm"] == pytest.approx(best["leave_one_out_mm"], rel=5e-3)
    assert found["check_gain_mm2"] == pytest.approx(0.05778, abs=1e-4)
    assert found["check_gain_chance_mm2"] == pytest.approx(0.01622, abs=1e-4)


def test_the_study_is_as_written(found, written):
    assert found["recommended"] == written["recommended"]
    assert found["points_off_mm"] == pytest.approx(written["points_off_mm"], abs=0.01)
    for row, old in zip(found["models"], written["models"], strict=True):
        assert (row["model"], row["parameters"]) == (old["model"], old["parameters"])
        for name, value in row.items():
            if name.endswith("_mm"):
                assert value == pytest.approx(old[name], abs=written["tolerance_mm"]), name


def test_the_command_line_gives_the_same(found, rows, tables, capsys):
    del found  # it has written the tables
    names = [str(tables / name) for name in ("cell.toml", "measurements.csv")]
    assert run(["identify", *names, "--out", str(tables)]) == 0
    assert "recommended: everything with priors" in capsys.readouterr().out
    content = json.loads((tables / "identification.json").read_text(encoding="utf-8"))
    assert content["measurements"] == 108
    assert content["recommended"] == "everything with priors"
    assert tuple(model["name"] for model in content["models"]) == FROM_COMMAND_LINE
    for model in content["models"]:
        row = rows[model["name"]]
        assert len(model["parameters"]) == row["parameters"]
        assert model["rms_mm"] == pytest.approx(row["rms_mm"], abs=1e-6)
        assert model["leave_one_out_rms_mm"] == pytest.approx(row["leave_one_out_mm"], abs=1e-6)
    best = content["models"][-2]
    assert best["name"] == "geometry + compliance"
    value = {p["name"]: p["value"] for p in best["parameters"]}
    assert value["compliance.joint_2"] == pytest.approx(68.3, abs=0.5)  # urad/Nm
    assert value["compliance.joint_3"] == pytest.approx(267.7, abs=1.0)
    assert any("compliance.joint_1" in note for note in best["notes"])
