"""The UR10 under motion capture: next to nothing to gain by free links, something by held ones.

Measured by others (thanhndv212/figaroh-examples). Figures to compare with are those of an
independent plain least-squares fit, refitted without each pose.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib import identify
from calib.identification import reduce
from posedesign.cell import Cell
from posedesign.cli.main import run
from posedesign.files.measurements import read_measurements
from posedesign.identification.models import Models, kinds_of

pytestmark = pytest.mark.real_data

FOLDER = Path(__file__).parents[2] / "studies" / "04_ur10_motion_capture"
NOISES = {"estimated": "cell.toml", "given": "cell_given_noise.toml"}

Row = dict[str, Any]


@pytest.fixture(scope="module")
def tables(tmp_path_factory) -> Path:
    return tmp_path_factory.mktemp("ur10")


@pytest.fixture(scope="module")
def found(study, data_folder, tables) -> Row:
    measured = data_folder / "identification" / "ur10"
    if not measured.is_dir():
        pytest.skip(f"{measured} does not exist")
    return study.run(data_folder, tables)


def rows(found: Row, noise: str) -> dict[str, Row]:
    return {row["model"]: row for row in found[noise]["models"]}


@pytest.mark.parametrize(
    ("words", "parameters", "out_mm", "out_mrad"),
    [
        ((), 12, 4.1176, 9.973),
        (("zero_offsets",), 16, 4.0313, 10.178),
        (("geometry",), 30, 4.1017, 7.397),
    ],
)
def test_the_references_are_reproduced(found, tables, words, parameters, out_mm, out_mrad):
    """Without priors and weighed by the noise given, as the independent fit is."""
    del found  # it has written the tables
    cell = Cell.load(tables / NOISES["given"])
    table = read_measurements(tables / "measurements.csv", cell.robot.n)
    whole = Models(cell, table).of(words, kinds_of(cell, table.kinds))
    result = identify(reduce(whole, table.data).model, table.data)
    assert len(result.names) == parameters
    assert 1e3 * result.leave_one_out_rms_m == pytest.approx(out_mm, abs=1e-3)
    assert 1e3 * result.leave_one_out_rms_rad == pytest.approx(out_mrad, abs=1e-2)
    assert result.noise[0].sigma == pytest.approx([1e-3] * 3 + [2e-3] * 3)


def test_a_before_with_frames_that_were_never_fitted_flatters(found):
    nominal, frames = (rows(found, "estimated")[name] for name in ("nothing fitted", "frames only"))
    assert nominal["rms_mm"] == pytest.approx(134.5, abs=0.1)
    assert frames["rms_mm"] < 3.7


@pytest.mark.parametrize("noise", NOISES)
def test_priors_of_the_right_size_gain_what_free_links_do_not(found, noise):
    """In position by two standard errors, and in orientation by more."""
    of = found[noise]
    assert of["recommended"] == "geometry with priors"
    assert "frames only" in of["reason"]
    for gains in (of["geometry_gains_mm2"], of["geometry_gains_mrad2"]):
        assert gains["gain"] > 2.0 * gains["chance"]
    row = rows(found, noise)
    assert row["geometry with priors"]["leave_one_out_mm"] < row["frames only"]["leave_one_out_mm"]


def test_noise_that_is_given_wrong_is_found(found):
    """A millimetre was given where no model leaves less than two: the same comes out of both."""
    given, estimated = (rows(found, noise) for noise in ("given", "estimated"))
    for name in ("frames only", "geometry with priors"):
        for key in ("sigma_mm", "sigma_mrad"):
            assert given[name][key] == pytest.approx(estimated[name][key], rel=2e-3)
        assert given[name]["sigma_mm"] > 1.8


def test_the_study_is_as_written(found, written):
    for noise in NOISES:
        assert found[noise]["recommended"] == written[noise]["recommended"]
        for row, old in zip(found[noise]["models"], written[noise]["models"], strict=True):
            assert (row["model"], row["parameters"]) == (old["model"], old["parameters"])
            for name in ("rms_mm", "leave_one_out_mm", "rms_mrad", "leave_one_out_mrad"):
                assert row[name] == pytest.approx(old[name], abs=written["tolerance_mm"]), name


@pytest.mark.parametrize("noise", ["given", pytest.param("estimated", marks=pytest.mark.slow)])
def test_the_command_line_gives_the_same(found, tables, noise, tmp_path, capsys):
    names = [str(tables / NOISES[noise]), str(tables / "measurements.csv")]
    assert run(["identify", *names, "--out", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "recommended: geometry with priors" in said
    content = json.loads((tmp_path / "identification.json").read_text(encoding="utf-8"))
    assert content["measurements"] == 23
    assert content["recommended"] == "geometry with priors"
    of_study = rows(found, noise)
    del of_study["nothing fitted"]
    assert [model["name"] for model in content["models"]] == list(of_study)
    for model in content["models"]:
        row = of_study[model["name"]]
        assert len(model["parameters"]) == row["parameters"]
        assert model["leave_one_out_rms_mm"] == pytest.approx(row["leave_one_out_mm"], abs=1e-6)
        out_mrad = 1e3 * np.deg2rad(model["leave_one_out_rms_deg"])
        assert out_mrad == pytest.approx(row["leave_one_out_mrad"], abs=1e-6)
        assert model["noise"][0]["estimated"]
