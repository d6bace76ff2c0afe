"""Pose pairs as others published them, read by the options that say what they are."""

import csv
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from calib.se3 import FloatArray, rotation_angle
from posedesign.cli.main import run
from posedesign.hand_eye.pairs import Pairs, PairSource, write_pairs
from posedesign.hand_eye.pairs.forms import PoseForm
from tests.cli.conftest import unfolded

pytestmark = pytest.mark.real_data


def rows_of(path: Path) -> dict[str, dict[str, str]]:
    with path.open(newline="") as stream:
        return {
            row["method"]: row
            for row in csv.DictReader(line for line in stream if not line.startswith("#"))
        }


def assert_left_over(row: dict[str, str], deg: float, mm: float, rel: float = 0.01) -> None:
    assert float(row["residual_rotation_deg"]) == pytest.approx(deg, rel=rel)
    assert float(row["residual_translation_mm"]) == pytest.approx(mm, rel=rel)


@pytest.mark.slow
def test_matlab_file_of_a_ur3e(data_folder, tmp_path, capsys):
    """A = T_cam, B = inverse of T_hand: what is left over as other solvers have it."""
    path = str(data_folder / "robot_world" / "ur3e_hand_camera" / "T_handcam_UR3e210506.mat")
    common = ["robot-world", path, "--unit", "mm", "--invert", "b", "--out", str(tmp_path)]
    methods = ["--method", "ml,shah,zhuang"]
    # other solvers take the noise as that of B, in all directions
    of_others = ["--variables", "T_cam,T_hand", "--noise-on", "b"]
    assert run([*common, *of_others, *methods]) == 0
    rows = rows_of(tmp_path / "robot_world.csv")
    assert_left_over(rows["shah"], 0.478, 6.03)
    assert_left_over(rows["ml"], 0.480, 5.96, rel=0.03)
    assert_left_over(rows["zhuang"], 0.486, 5.99, rel=0.02)
    # the same pairs, from the side of this project, in two ways: X is the camera on the flange
    assert run([*common, "--variables", "T_hand,T_cam", "--method", "ml"]) == 0
    flange = rows_of(tmp_path / "robot_world.csv")["ml"]
    opencv = ["--variables", "T_cam,T_hand", "--convention", "opencv"]
    assert run([*common, *opencv, "--method", "ml"]) == 0
    same = rows_of(tmp_path / "robot_world.csv")["ml"]
    for key in ("x_x_mm", "x_w_deg", "z_z_mm", "sigma_x_x_mm"):
        assert float(same[key]) == pytest.approx(float(flange[key]), rel=1e-5)
    assert abs(float(flange["x_z_mm"])) < 200.0  # a camera on a small arm's flange
    # nothing is wrong with how the pairs are read; a few stand out, and noise of B is not all
    said = (
        "times as far off as the median",
        "residuals show other noise than the one of B",
        "would go unnoticed",
    )
    for line in unfolded(capsys.readouterr().err).splitlines():
        assert any(words in line for words in said), line


@pytest.mark.parametrize(("tag", "count"), [("tag_15_cam_1", 142), ("tag_22_cam_2", 228)])
def test_two_files_without_headers(data_folder, tag, count):
    folder = data_folder / "robot_world" / "multi_tag"
    paths = [folder / f"{tag}_{side}.csv" for side in "AB"]
    columns = ["qw", "qx", "qy", "qz", "x_m", "y_m", "z_m"]
    found = PairSource(a=paths[0], b=paths[1], columns=columns).read()
    assert found.notes == ()
    for path, T in zip(paths, (found.A, found.B), strict=True):
        raw = np.loadtxt(path, delimiter=",")
        assert len(T) == len(raw) == count
        np.testing.assert_array_equal(T[:, :3, 3], raw[:, 4:])
        w = np.abs(raw[:, 0]) / np.linalg.norm(raw[:, :4], axis=1)
        np.testing.assert_allclose(np.cos(rotation_angle(T[:, :3, :3]) / 2), w, atol=1e-9)


def blocks_of(path: Path) -> FloatArray:
    """4x4 blocks with a count before them."""
    numbers = path.read_text().split()
    return np.array(numbers[1:], dtype=float).reshape(int(numbers[0]), 4, 4)


def test_text_files_of_tabb(data_folder, tmp_path, capsys):
    """World to camera and base to gripper, as OpenCV's own test takes them."""
    folder = data_folder / "robot_world" / "tabb_ds1"
    subset = np.loadtxt(folder / "cali_subset24.txt")
    index = subset[:, 0].astype(int)
    lines = [",".join(map(repr, row)) for row in subset[:, 1:].tolist()]
    (tmp_path / "A.csv").write_text("\n".join(lines) + "\n")
    base2gripper = blocks_of(folder / "robot_cali.txt")[index]
    blocks = [",".join(map(repr, T)) for T in base2gripper.reshape(-1, 16).tolist()]
    (tmp_path / "B.csv").write_text("\n".join(blocks) + "\n")
    rotation = [f"a_r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    columns = ",".join([*rotation, "a_x_mm", "a_y_mm", "a_z_mm", "b_matrix16_mm"])
    words = ["--a", str(tmp_path / "A.csv"), "--b", str(tmp_path / "B.csv"), "--columns", columns]
    # other solvers take the noise as that of B, in all directions
    out = ["--out", str(tmp_path), "--method", "shah,ml", "--noise-on", "b"]
    assert run(["robot-world", *words, *out]) == 0
    rows = rows_of(tmp_path / "robot_world.csv")
    assert_left_over(rows["shah"], 0.357, 12.9)
    assert float(rows["ml"]["residual_translation_mm"]) < 12.9
    # the reference of the publisher, from the images: base to world, gripper to camera
    text = (folder / "transformations.txt").read_text().split()
    for letter in "xz":
        first = text.index(letter.upper()) + (1 if letter == "x" else 2)
        reference = np.array(text[first : first + 16], dtype=float).reshape(4, 4)
        found = [float(rows["ml"][f"{letter}_{axis}_mm"]) for axis in "xyz"]
        # an image says the distance of 2 m to the target to a few hundredths
        assert np.linalg.norm(found - reference[:3, 3]) < 80.0
    assert run(["robot-world", *words, "--convention", "opencv", "--verbose", *out]) == 0
    assert "base2world" in capsys.readouterr().out


def test_text_files_of_tabb_as_they_are(data_folder, tmp_path):
    """Blocks of four lines with their count before them, and rows with spaces and a comment."""
    folder = data_folder / "robot_world" / "tabb_ds1"
    hand, seen = folder / "robot_cali.txt", folder / "cali_subset24.txt"
    found = PairSource(a=hand, b=hand, unit="mm").read()
    expected = blocks_of(hand)
    np.testing.assert_allclose(found.A[:, :3, 3], expected[:, :3, 3] / 1e3, atol=1e-12)
    np.testing.assert_allclose(found.A[:, :3, :3], expected[:, :3, :3], atol=2e-6)
    assert found.places[1] == "line 7"
    rotation = [f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    columns = ["-", *rotation, "x_mm", "y_mm", "z_mm"]
    # both kinds of file at once
    with pytest.raises(FileFormatError, match=r"has 24 poses, .*robot_cali\.txt has 88"):
        PairSource(a=hand, b=seen, columns=columns, unit="mm").read()
    found = PairSource(a=seen, b=seen, columns=columns).read()
    numbers = np.loadtxt(seen)
    np.testing.assert_allclose(found.B[:, :3, 3], numbers[:, 10:] / 1e3, atol=1e-12)
    assert any("spaces stand between the cells" in note for note in found.notes)


def test_real_pairs_come_back_from_every_kind_of_file(data_folder, tmp_path):
    path = data_folder / "robot_world" / "ur3e_hand_camera" / "T_handcam_UR3e210506.mat"
    read = PairSource(path, variables=["T_hand", "T_cam"], unit="mm", invert="b").read()
    pairs = Pairs(read.names, read.A, read.B)
    form = PoseForm("m", "quaternion")
    again = PairSource(write_pairs(tmp_path / "p.csv", pairs, form, form)).read()
    np.testing.assert_allclose(again.A, read.A, atol=5e-9)
    np.testing.assert_allclose(again.B, read.B, atol=5e-9)
