"""posedesign camera from bags of ROS 2 and videos: the same as from a folder of their stills."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.lens import Lens
from calib.se3 import rotation_exp, transform
from posedesign.cell import Cell, cell_template
from tests import recordings as r
from tests.board_pictures import Camera, take_pictures

pytest.importorskip("rosbags", reason="bags are written and read by rosbags, the extra bags")

LENS = Lens("pinhole", 640, 480, (560.0, 562.0, 322.0, 238.0, -0.12, 0.06, 5e-4, -3e-4, 0.0))
X = transform(rotation_exp(np.array([0.02, -0.03, 0.5])), np.array([0.05, 0.02, 0.06]))
Z = transform(rotation_exp(np.array([np.pi, 0.0, 0.2])), np.array([-0.75, 0.05, 0.0]))
NEAR = np.deg2rad([0.0, -90.0, 90.0, -90.0, -90.0, 0.0])
BOARD = "kind=charuco,columns=7,rows=5,square_mm=30,marker_mm=22,dictionary=DICT_4X4_50"
STOPS = 9


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A cell, and a run of its arm from stop to stop as bags, a video and a folder."""
    folder = tmp_path_factory.mktemp("recordings")
    cell = folder / "cell.toml"
    board = "\n[board]\n" + BOARD.replace(",", "\n").replace("=", " = ")
    board = board.replace("= charuco", '= "charuco"').replace("DICT_4X4_50", '"DICT_4X4_50"')
    cell.write_text(cell_template("ur10e", surroundings=False) + board)
    loaded = Cell.load(cell)
    camera = Camera(LENS, loaded.board, blur_px=0.8, noise=2.0, light=0.1)
    rng = np.random.default_rng(4)
    q = take_pictures(folder / "stops", loaded.robot, camera, X, Z, STOPS, rng, near=NEAR)
    run = r.Run(loaded.robot, camera, X, Z, q, stand_s=0.6, move_s=0.5)
    arm = np.arange(0.0, run.length_s, 0.02)
    joints = run.joints_at(arm)
    names = loaded.robot.joint_names
    pictures = list(run.pictures())
    times = run.picture_times()
    sent = [
        *(
            ("/cam/image_raw", r.IMAGE, t + 0.03, r.image(t, picture))
            for t, picture in zip(times, pictures, strict=True)
        ),
        *(
            ("/joint_states", r.JOINTS, t + 0.001, r.joint_state(t, names[::-1], v[::-1]))
            for t, v in zip(arm, joints, strict=True)
        ),
        ("/cam/camera_info", r.LENS, 0.1, r.lens_message(0.1, LENS)),
    ]
    r.write_bag(folder / "mcap", "mcap", sent)
    poses = [
        ("/flange_pose", r.POSE, t + 0.001, r.pose_stamped(t, T))
        for t, T in zip(arm, loaded.robot.fk(joints), strict=True)
    ]
    small = [
        ("/cam/image/compressed", r.COMPRESSED, t + 0.03, r.compressed(t, picture, ".png"))
        for t, picture in zip(times, pictures, strict=True)
    ]
    tree = [
        ("/tf", r.TF, t + 0.001, r.transforms(r.transform_stamped(t, T, "base_link", "tool0")))
        for t, T in zip(arm, loaded.robot.fk(joints), strict=True)
    ]
    r.write_bag(folder / "sqlite3", "sqlite3", [*small, *poses, *tree])
    writer = cv2.VideoWriter(
        str(folder / "run.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), run.rate_hz, (640, 480)
    )
    for picture in pictures:
        writer.write(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    head = ",".join(f"j{k}_deg" for k in range(1, 7))
    (folder / "stops.csv").write_text(
        "\n".join([head, *(",".join(map(repr, row)) for row in np.degrees(q).tolist())])
    )
    return folder


@pytest.fixture
def there(taken: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The same, with results in a folder of its own, which is the present one."""
    for name in ("cell.toml", "stops.csv", "run.mp4"):
        shutil.copy(taken / name, tmp_path / name)
    for name in ("mcap", "sqlite3"):
        (tmp_path / name).symlink_to(taken / name)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check_frames(found: dict) -> None:
    """Camera and board are where they were within four standard deviations."""
    for name, true in (("T_flange_camera", X), ("T_base_board", Z)):
        frame = found[name]
        apart = (np.array(frame["xyz_mm"]) - 1e3 * true[:3, 3]) / frame["sigma_xyz_mm"]
        assert np.abs(apart).max() < 4.0, name


def check_same(first: Path, second: Path) -> None:
    """Two results differ by rounding only."""
    one, other = (json.loads((path / "camera.json").read_text()) for path in (first, second))
    for name in ("T_flange_camera", "T_base_board"):
        np.testing.assert_allclose(one[name]["matrix_m"], other[name]["matrix_m"], atol=1e-9)
    assert [p["picture"] for p in one["pictures"]] == [p["picture"] for p in other["pictures"]]


def test_a_bag_gives_what_the_folder_of_its_stills_gives(there, done):
    said = done("camera", "cell.toml", "mcap", "--out", "run")
    assert said.out.startswith(f"calibrated: camera and board from {STOPS} of {STOPS} pictures")
    assert said.err.splitlines() == [
        "note: 9 stills of 94 pictures of /cam/image_raw are in run/pictures"
    ]
    check_frames(json.loads((there / "run" / "camera.json").read_text()))
    done("camera", "cell.toml", "run/pictures", "--joints", "run/joints.csv", "--out", "folder")
    check_same(there / "run", there / "folder")


def test_a_bag_of_poses_needs_no_cell(there, done):
    said = done("camera", "--bag", "sqlite3/sqlite3.db3", "--target", BOARD, "--out", "run")
    assert said.out.startswith(f"calibrated: camera and board from {STOPS} of {STOPS} pictures")
    assert "poses are taken for those of the flange in base" in said.err
    check_frames(json.loads((there / "run" / "camera.json").read_text()))
    done("camera", "run/pictures", "--poses", "run/poses.csv", "--target", BOARD, "--out", "folder")
    check_same(there / "run", there / "folder")


def test_frames_of_a_tree_are_named_as_in_the_tree(there, done):
    words = ("--bag", "sqlite3", "--target", BOARD, "--tf", "base_link,tool0", "--transforms")
    done("camera", *words, "--frames", "target=board_1", "--out", "run")
    check_frames(json.loads((there / "run" / "camera.json").read_text()))
    content = json.loads((there / "run" / "transforms.json").read_text())
    names = {"base": "base_link", "flange": "tool0", "camera": "camera", "target": "board_1"}
    assert content["frames"] == names


def test_the_lens_of_the_bag_is_taken_as_known(there, done):
    done("camera", "cell.toml", "--bag", "mcap", "--lens", "camera_info", "--out", "run")
    found = json.loads((there / "run" / "camera.json").read_text())
    assert not found["lens"]["estimated"]
    assert found["lens"]["fx"] == pytest.approx(LENS.values[0])
    check_frames(found)


def test_a_video_with_the_poses_that_the_arm_stopped_at(there, done):
    said = done("camera", "cell.toml", "run.mp4", "--joints", "stops.csv", "--out", "run")
    assert said.out.startswith(f"calibrated: camera and board from {STOPS} of {STOPS} pictures")
    assert "9 stills of 94 pictures of run.mp4 are in run/pictures" in said.err
    found = json.loads((there / "run" / "camera.json").read_text())
    off = np.array(found["T_flange_camera"]["xyz_mm"]) - 1e3 * X[:3, 3]
    assert np.abs(off).max() < 0.5  # the codec costs some
    done("camera", "cell.toml", "run/pictures", "--joints", "stops.csv", "--out", "folder")
    check_same(there / "run", there / "folder")


def test_stills_are_there_for_whoever_has_no_poses_yet(there, cli):
    said = cli("camera", "cell.toml", "run.mp4", "--out", "run")
    assert said.code == 2
    assert "the pictures have no joints and no poses of the flange" in said.err
    assert len(list((there / "run" / "pictures").iterdir())) == STOPS


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ("--bag mcap pictures", "--pictures is not taken with a bag"),
        ("--bag mcap --joints stops.csv", "--joints is not taken with a bag"),
        ("--bag mcap --image-topic /cam/image", "there is no topic /cam/image"),
        ("--bag mcap --joint-topic /cam/image_raw", "/cam/image_raw is of sensor_msgs/msg/Image"),
        ("--bag mcap --tf base,tool0", "has no transforms (tf)"),
        ("--bag none", "there is no such file or folder"),
        ("--bag mcap --stand-s 5", "the arm never stands still for 5 s"),
        ("--bag mcap --stand-s -1", "--stand-s is -1"),
        ("--bag mcap --time-offset-s nan", "--time-offset-s is nan"),
        ("pictures --image-topic /cam", "--image-topic is for a bag, and there is none: --bag"),
        ("pictures --stand-s 1", "--stand-s is for a bag or a video"),
        ("run.mp4 --moving", "--moving is for a bag, and there is none: --bag"),
        ("run.mp4 --lens camera_info", "there is no such lens"),
    ],
)
def test_options_that_do_not_go_together_are_refused(there, cli, options, message):
    (there / "pictures").mkdir()
    said = cli("camera", "cell.toml", *options.split(), "--out", "run")
    assert said.code == 2
    assert message in " ".join(said.err.split())
    assert not (there / "run").exists()


def test_without_pictures_what_to_give_is_said(cli):
    said = cli("camera")
    assert said.code == 2
    assert "no cell is given" in said.err or "there are no pictures" in said.err
