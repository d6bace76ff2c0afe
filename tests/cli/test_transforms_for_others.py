"""What ``robot-world --transforms`` writes, as the programs that it is for read it."""

import json
import re
import shlex
from argparse import ArgumentParser
from pathlib import Path

import cv2
import numpy as np
import pinocchio
import pytest
import xacro
import yaml
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

from calib.robot_world import PairNoise, add_noise, random_problems
from calib.se3 import FloatArray
from posedesign.hand_eye.pairs import Pairs, write_pairs
from posedesign.hand_eye.pairs.transforms import FrameNames
from tests.cli.conftest import rows_of

CAMERAS = {"on-flange": ("flange camera", "base target"), "fixed": ("flange target", "base camera")}
FILES = ("transforms.launch.xml", "camera.launch", "camera.urdf", "camera.calib", "transforms.json")
WRITTEN = 2e-8
"""Digits that are written: nine decimals of quaternions, angles and metres."""


def rigid(place: list[float], quaternion_xyzw: list[float]) -> FloatArray:
    """A transform by SciPy, whose quaternions are x y z w."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_quat(quaternion_xyzw).as_matrix()
    T[:3, 3] = place
    return T


def of_table(path: Path) -> tuple[FloatArray, FloatArray]:
    """X and Z of the first row of the answers, by SciPy: W P R are about fixed x, y, z."""
    row = rows_of(path)[0]
    found = []
    for letter in "xz":
        turn = [float(row[f"{letter}_{axis}_deg"]) for axis in "wpr"]
        place = [float(row[f"{letter}_{axis}_mm"]) / 1e3 for axis in "xyz"]
        found.append(rigid(place, Rotation.from_euler("xyz", turn, degrees=True).as_quat()))
    return found[0], found[1]


@pytest.fixture
def solved(cli, tmp_path, request) -> tuple[str, Path, dict[str, FloatArray]]:
    """Where the camera is, the folder, and X and Z by their frames, of pairs with noise."""
    rng = np.random.default_rng(3)
    problem = random_problems(rng, 1, 15)
    noise = PairNoise(rotation_rad=5e-4, translation_m=2e-4, on="B")
    A, B = add_noise(rng, problem.A[0], problem.B[0], noise)
    pairs = write_pairs(tmp_path / "pairs.csv", Pairs(tuple(f"P{i}" for i in range(15)), A, B))
    said = cli(
        "robot-world", pairs, "--method", "ml", "--camera", request.param, "--transforms",
        "--out", tmp_path,
    )  # fmt: skip
    assert said.code == 0
    for name in FILES:
        assert str(tmp_path / name) in said.out
    answers = of_table(tmp_path / "robot_world.csv")
    return request.param, tmp_path, dict(zip(CAMERAS[request.param], answers, strict=True))


both_cameras = pytest.mark.parametrize("solved", CAMERAS, indirect=True)


def camera_of(expected: dict[str, FloatArray]) -> tuple[str, FloatArray]:
    """The frame that the camera is mounted in, and where it is in it."""
    return next((k.split()[0], T) for k, T in expected.items() if k.endswith("camera"))


@both_cameras
def test_opencv_reads_the_matrices(solved):
    _, folder, expected = solved
    storage = cv2.FileStorage(str(folder / "transforms.json"), cv2.FILE_STORAGE_READ)
    for frames, T in expected.items():
        read = storage.getNode("T_" + frames.replace(" ", "_")).mat()
        np.testing.assert_allclose(read, T, atol=1e-9)


@both_cameras
def test_the_launch_file_publishes_both_transforms_by_options_of_tf2(solved):
    _, folder, expected = solved
    parser = ArgumentParser()
    for option in ("x", "y", "z", "qx", "qy", "qz", "qw"):
        parser.add_argument(f"--{option}", type=float, required=True)
    for option in ("frame-id", "child-frame-id"):
        parser.add_argument(f"--{option}", required=True)
    nodes = ElementTree.parse(folder / "transforms.launch.xml").getroot().findall("node")
    assert {(n.get("pkg"), n.get("exec")) for n in nodes} == {
        ("tf2_ros", "static_transform_publisher")
    }
    published = {}
    for node in nodes:
        seen = parser.parse_args(shlex.split(node.get("args", "")))
        T = rigid([seen.x, seen.y, seen.z], [seen.qx, seen.qy, seen.qz, seen.qw])
        published[f"{seen.frame_id} {seen.child_frame_id}"] = T
    assert published.keys() == expected.keys()
    for frames, T in expected.items():
        np.testing.assert_allclose(published[frames], T, atol=WRITTEN)


@both_cameras
def test_ros_1_publishes_the_camera_from_ten_words(solved):
    """As MoveIt saves the camera's pose: x y z, qx qy qz qw, parent, child."""
    _, folder, expected = solved
    (node,) = ElementTree.parse(folder / "camera.launch").getroot().findall("node")
    assert (node.get("pkg"), node.get("type")) == ("tf2_ros", "static_transform_publisher")
    *numbers, parent, child = node.get("args", "").split()
    assert (parent, child) == (camera_of(expected)[0], "camera")
    x, y, z, *quaternion = map(float, numbers)
    np.testing.assert_allclose(rigid([x, y, z], quaternion), camera_of(expected)[1], atol=WRITTEN)


@both_cameras
def test_xacro_includes_the_camera_and_pinocchio_puts_it_where_it_is(solved):
    _, folder, expected = solved
    parent, T = camera_of(expected)
    (folder / "robot.urdf.xacro").write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<link name="{parent}"/><xacro:include filename="{folder}/camera.urdf"/></robot>'
    )
    urdf = xacro.process_file(str(folder / "robot.urdf.xacro")).toxml()
    model = pinocchio.buildModelFromXML(urdf)
    placed = model.frames[model.getFrameId("camera")].placement.homogeneous
    np.testing.assert_allclose(placed, T, atol=WRITTEN)


@both_cameras
def test_easy_handeye2_finds_its_keys_and_the_parent_that_it_takes(solved):
    camera, folder, expected = solved
    content = yaml.full_load((folder / "camera.calib").read_text())
    parameters = content["parameters"]
    # as in easy_handeye2's handeye_publisher.py
    in_hand = parameters["calibration_type"] == "eye_in_hand"
    parent = parameters["robot_effector_frame" if in_hand else "robot_base_frame"]
    assert in_hand == (camera == "on-flange")
    transform = content["transform"]
    T = rigid(
        [transform["translation"][axis] for axis in "xyz"],
        [transform["rotation"][axis] for axis in "xyzw"],
    )
    assert parent == camera_of(expected)[0]
    assert parameters["tracking_base_frame"] == "camera"
    np.testing.assert_allclose(T, camera_of(expected)[1], atol=1e-9)


@pytest.mark.parametrize("solved", ["on-flange"], indirect=True)
def test_what_is_not_to_be_trusted_goes_nowhere_and_leaves_nothing_old(cli, solved):
    _, folder, _ = solved
    rng = np.random.default_rng(4)
    problem = random_problems(rng, 1, 5)
    noise = PairNoise(rotation_rad=0.1, translation_m=0.05, on="B")
    A, B = add_noise(rng, problem.A[0], problem.B[0], noise)
    pairs = write_pairs(folder / "rough.csv", Pairs(tuple(f"P{i}" for i in range(5)), A, B))
    said = cli("robot-world", pairs, "--method", "ml", "--transforms", "--out", folder)
    assert said.code == 1
    assert not any((folder / name).exists() for name in FILES)


NAMED = {"base": "base_link", "flange": "tool0", "camera": "ns/camera-1.optical", "target": "tag_7"}


@both_cameras
def test_frames_have_the_names_of_a_tree_in_every_file(cli, solved):
    """The transforms stay, and so do the keys of the file for OpenCV: a map has the names."""
    camera, folder, expected = solved
    words = ",".join(f"{frame}={name}" for frame, name in NAMED.items())
    typed = ("robot-world", folder / "pairs.csv", "--method", "ml", "--camera", camera)
    said = cli(*typed, "--transforms", "--frames", words, "--out", folder, "--verbose")
    assert said.code == 0, said.err
    links = [tuple(NAMED[frame] for frame in frames.split()) for frames in expected]
    parent, camera_frame = NAMED[camera_of(expected)[0]], NAMED["camera"]
    for a, b in links:
        assert f"--frame-id {a} --child-frame-id {b}" in said.out + said.err
    nodes = ElementTree.parse(folder / "transforms.launch.xml").getroot().findall("node")
    ends = [shlex.split(node.get("args", ""))[-4:] for node in nodes]
    assert [(a, b) for _, a, _, b in ends] == links
    assert all(re.fullmatch(r"[A-Za-z_]\w*", node.get("name", "")) for node in nodes)
    (node,) = ElementTree.parse(folder / "camera.launch").getroot().findall("node")
    assert node.get("args", "").split()[-2:] == [parent, camera_frame]
    model = pinocchio.buildModelFromXML(
        (folder / "camera.urdf").read_text().replace("<link", f'<link name="{parent}"/><link', 1)
    )
    placed = model.frames[model.getFrameId(camera_frame)].placement.homogeneous
    np.testing.assert_allclose(placed, camera_of(expected)[1], atol=WRITTEN)
    parameters = yaml.full_load((folder / "camera.calib").read_text())["parameters"]
    keys = ("robot_base_frame", "robot_effector_frame", "tracking_base_frame")
    assert [parameters[key] for key in (*keys, "tracking_marker_frame")] == list(NAMED.values())
    storage = cv2.FileStorage(str(folder / "transforms.json"), cv2.FILE_STORAGE_READ)
    for frames, T in expected.items():
        read = storage.getNode("T_" + frames.replace(" ", "_")).mat()
        np.testing.assert_allclose(read, T, atol=1e-9)
    for frame, name in NAMED.items():
        assert storage.getNode("frames").getNode(frame).string() == name


@pytest.mark.parametrize("solved", ["on-flange"], indirect=True)
def test_without_names_the_file_for_opencv_has_matrices_only(solved):
    _, folder, _ = solved
    content = json.loads((folder / "transforms.json").read_text())
    assert content.keys() == {"origin", "T_flange_camera", "T_base_target"}


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        ("bas=x", ("there is no frame 'bas'", "did you mean base?")),
        ("world=x", ("there is no frame 'world'", "known: base, flange, camera, target")),
        ("base", ("'base' is not a frame and its name", "say base=base_link,")),
        ("base=", ("ROS takes no frame ''",)),
        ("base=/world", ("ROS takes no frame '/world'", "not before them")),
        ("base=a b", ("ROS takes no frame 'a b'",)),
        ("camera=-x", ("ROS takes no frame '-x'",)),
        ('camera=c"/><x y="', ("ROS takes no frame",)),
        ("camera=$(env HOME)", ("ROS takes no frame",)),
        ("base=a,base=b", ("base is named twice",)),
        ("base=flange", ("base and flange are both called flange", "a name of its own")),
    ],
)
def test_names_that_are_none_are_refused_before_any_work(refuse, tmp_path, frames, said):
    refuse("robot-world", tmp_path / "none.csv", "--frames", frames).says("--frames: ", *said)


def test_links_that_ros_would_not_take_leave_the_usual_names():
    usual = FrameNames()
    assert usual.arm("base_link", "tool0").of("flange") == "tool0"
    for base, flange in (("base link", "tool0"), ("base_link", "/tool0"), ("same", "same")):
        assert usual.arm(base, flange) == usual
    assert usual.of("board") == "board"
