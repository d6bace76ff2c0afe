"""The UR10 under motion capture: next to nothing to gain in position, and that is what is said.

Measured by others (thanhndv212/figaroh-examples). Figures to compare with are those of an
independent plain least-squares fit, refitted without each pose.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from posedesign.cli.main import run

pytestmark = pytest.mark.real_data

FOLDER = Path(__file__).parents[2] / "studies" / "04_ur10_motion_capture"
NOISES = {"estimated": "cell.toml", "given": "cell_given_noise.toml"}

Row = dict[str, Any]


@pytest.fixture(scope="module")
def study(load_study: Callable[[Path], ModuleType]) -> ModuleType:
    return load_study(FOLDER)


@pytest.fixture(scope="module")
def written() -> Row:
    return json.loads((FOLDER / "expected.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("ur10")


@pytest.fixture(scope="module")
def found(study: ModuleType, data_folder: Path, tables: Path) -> Row:
    measured = data_folder / "identification" / "ur10"
    if not measured.is_dir():
        pytest.skip(f"{measured} does not exist")
    return study.run(data_folder, tables)


def rows(found: Row, noise: str) -> dict[str, Row]:
    return {row["model"]: row for row in found[noise]["models"]}


@pytest.mark.parametrize(
    ("model", "parameters", "out_mm", "out_mrad"),
    [
        ("frames only", 12, 4.1176, 9.973),
        ("offsets", 16, 4.0313, 10.178),
        ("geometry", 30, 4.1017, 7.397),
    ],
)
def test_the_references_are_reproduced(
    found: Row, model: str, parameters: int, out_mm: float, out_mrad: float
) -> None:
    row = rows(found, "given")[model]
    assert row["parameters"] == parameters
    assert row["leave_one_out_mm"] == pytest.approx(out_mm, abs=1e-3)
    assert row["leave_one_out_mrad"] == pytest.approx(out_mrad, abs=1e-2)
    assert row["refitted_mm"] == pytest.approx(row["leave_one_out_mm"], rel=1e-3)
    assert (row["sigma_mm"], row["sigma_mrad"]) == pytest.approx((1.0, 2.0))


def test_a_before_with_frames_that_were_never_fitted_flatters(found: Row) -> None:
    nominal, frames = (rows(found, "estimated")[name] for name in ("nothing fitted", "frames only"))
    assert nominal["rms_mm"] == pytest.approx(134.5, abs=0.1)
    assert frames["rms_mm"] < 3.7


@pytest.mark.parametrize("noise", NOISES)
def test_frames_only_is_recommended_and_what_angles_gain_is_said(found: Row, noise: str) -> None:
    of = found[noise]
    assert of["recommended"] == "frames only"
    position, _, angles = of["reason"].partition("; in orientation, which this choice does not ")
    idle = position.partition("larger models gain nothing in position beyond chance: ")[2]
    assert [said.rpartition(" mm (")[0].rpartition(" ")[0] for said in idle.split("; ")] == [
        "offsets", "offsets + compliance", "geometry", "geometry + compliance",
    ]  # fmt: skip
    assert angles.startswith("weigh, geometry 7.39")
    assert "gains beyond chance" in angles
    moved = of["geometry_gains_mm2"]
    assert abs(moved["gain"]) < moved["chance"]
    turned = of["geometry_gains_mrad2"]
    assert turned["gain"] > 2.0 * turned["chance"]
    if noise == "given":
        assert turned["gain"] == pytest.approx(44.7, abs=0.3)
        assert turned["chance"] == pytest.approx(18.9, abs=0.2)


def test_noise_is_estimated_for_lengths_and_angles_apart(found: Row) -> None:
    """Residuals over redundancy, by the independent fit: 2.18 mm and 5.55 mrad an axis."""
    row = rows(found, "estimated")["frames only"]
    assert row["sigma_mm"] == pytest.approx(2.18, abs=0.01)
    assert row["sigma_mrad"] == pytest.approx(5.55, abs=0.02)
    # of 138 equations 12 are used up
    squares = 23 * ((row["rms_mm"] / row["sigma_mm"]) ** 2 + (row["rms_mrad"] / 5.5537) ** 2)
    assert squares == pytest.approx(138 - 12, abs=0.1)


def test_the_study_is_as_written(found: Row, written: Row) -> None:
    for noise in NOISES:
        assert found[noise]["recommended"] == written[noise]["recommended"]
        for row, old in zip(found[noise]["models"], written[noise]["models"], strict=True):
            assert (row["model"], row["parameters"]) == (old["model"], old["parameters"])
            for name in ("rms_mm", "leave_one_out_mm", "rms_mrad", "leave_one_out_mrad"):
                assert row[name] == pytest.approx(old[name], abs=written["tolerance_mm"]), name


@pytest.mark.parametrize("noise", NOISES)
def test_the_command_line_gives_the_same(
    found: Row, tables: Path, noise: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names = [str(tables / NOISES[noise]), str(tables / "measurements.csv")]
    assert run(["identify", *names, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "recommended: frames only" in said
    assert "in orientation" in said
    content = json.loads((tmp_path / "identification.json").read_text(encoding="utf-8"))
    assert content["measurements"] == 23
    assert content["recommended"] == "frames only"
    of_study = rows(found, noise)
    del of_study["nothing fitted"]
    assert [model["name"] for model in content["models"]] == list(of_study)
    for model in content["models"]:
        row = of_study[model["name"]]
        assert len(model["parameters"]) == row["parameters"]
        assert model["leave_one_out_rms_mm"] == pytest.approx(row["leave_one_out_mm"], abs=1e-6)
        out_mrad = 1e3 * np.deg2rad(model["leave_one_out_rms_deg"])
        assert out_mrad == pytest.approx(row["leave_one_out_mrad"], abs=1e-6)
        assert model["noise"][0]["estimated"] == (noise == "estimated")


def test_the_table_that_people_read_is_the_result(study: ModuleType, written: Row) -> None:
    assert study.table(written) in (FOLDER / "README.md").read_text(encoding="utf-8")
