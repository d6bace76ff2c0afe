"""The command of two streams: tables and trajectories of TUM."""

import json

import numpy as np
import pytest

from calib.se3 import quaternion_from_rotation
from posedesign.files.csv_tables import write_table
from tests.cli.conftest import rows_of
from tests.unit.robot_world.test_streams import X, streams_of


@pytest.fixture(scope="module")
def numbers():
    """Times, places, and quaternions x y z w of arm and camera."""
    found = []
    for stream in streams_of(11, seconds=10.0):
        q = np.roll(quaternion_from_rotation(stream.T[:, :3, :3]), -1, axis=1)
        found.append(np.c_[stream.times, stream.T[:, :3, 3], q])
    return found


def tum(path, rows):
    np.savetxt(path, rows, fmt="%.7f", header="timestamp tx ty tz qx qy qz qw")
    return path


def table(path, rows, time="time_s", factor=1.0):
    columns = [time, "x_mm", "y_mm", "z_mm", "qx", "qy", "qz", "qw"]
    scaled = rows * [factor, 1e3, 1e3, 1e3, 1, 1, 1, 1]
    cells = [dict(zip(columns, (repr(v) for v in row.tolist()), strict=True)) for row in scaled]
    return write_table(path, columns, cells)


def test_trajectories_and_tables_give_the_same(cli, numbers, tmp_path):
    robot, camera = numbers
    pairs = (
        (tum(tmp_path / "a.txt", robot), tum(tmp_path / "b.txt", camera)),
        (
            table(tmp_path / "a.csv", robot, "time_ms", 1e3),
            table(tmp_path / "b.csv", camera),
        ),
    )
    found = []
    for k, files in enumerate(pairs):
        said = cli("streams", *files, "--out", tmp_path / str(k), "--json")
        assert said.code == 0, said.err
        found.append(json.loads(said.out))
        (row,) = rows_of(tmp_path / str(k) / "streams.csv")
        assert float(row["offset_ms"]) == pytest.approx(137.0, abs=1.0)
        off = np.array([float(row[f"x_{axis}"]) for axis in ("x_mm", "y_mm", "z_mm")])
        np.testing.assert_allclose(off, 1e3 * X[:3, 3], atol=1.5)
        assert len(rows_of(tmp_path / str(k) / "streams_pairs.csv")) > 200
    assert found[0]["offset_ms"] == pytest.approx(found[1]["offset_ms"], abs=0.02)


def test_the_answer_says_what_the_clocks_are(cli, numbers, tmp_path):
    files = (tum(tmp_path / "a.txt", numbers[0]), tum(tmp_path / "b.txt", numbers[1]))
    said = cli("streams", *files, "--out", tmp_path)
    assert said.code == 0, said.err
    assert "solved: A X = Z B from " in said.out
    assert "clocks: the camera's is 13" in said.out
    assert "later than the arm's" in " ".join(said.out.split())
    assert (tmp_path / "streams.png").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("untimed.csv", "b.txt"), "has no column of time"),
        (("bad.csv", "b.txt"), "is no time"),
        (("a.txt", "none.txt"), "none.txt"),
        (("a.txt", "b.txt", "--largest-offset-s", "0"), "give seconds above 0"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(refuse, numbers, tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    tum(tmp_path / "a.txt", numbers[0])
    tum(tmp_path / "b.txt", numbers[1])
    table(tmp_path / "untimed.csv", numbers[0], "number")
    rows = (tmp_path / "untimed.csv").read_text().replace("number", "time_s").splitlines()
    rows[5] = "never" + rows[5][rows[5].index(",") :]
    (tmp_path / "bad.csv").write_text("\n".join(rows) + "\n")
    refuse("streams", *words).says(said)
