"""Poses of the flange in the files that people have, all of which say the same poses."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image
from scipy.spatial.transform import Rotation

from calib.errors import CalibError, FileFormatError
from calib.se3 import FloatArray, inverse, transform
from posedesign.hand_eye.pairs import PairSource
from posedesign.hand_eye.pictures import read_picture_set

COUNT = 12
NAMES = [f"shot_{i}.png" for i in range(1, COUNT + 1)]
"""Names that sort 1, 10, 11, 12, 2 as texts."""

_RNG = np.random.default_rng(2)
TURNS = Rotation.random(COUNT, rng=_RNG)
T = transform(TURNS.as_matrix(), _RNG.uniform(0.2, 0.9, (COUNT, 3)))
MM = T.copy()
MM[:, :3, 3] *= 1e3
SEEN = transform(Rotation.random(COUNT, rng=_RNG).as_matrix(), _RNG.uniform(0.2, 0.9, (COUNT, 3)))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for i, name in enumerate(NAMES):
        Image.fromarray(np.full((4, 6), i, dtype=np.uint8)).save(pictures / name)
    return tmp_path


def dump(path: Path, content: object) -> Path:
    text = yaml.safe_dump(content, sort_keys=False) if path.suffix == ".yaml" else None
    path.write_text(text or json.dumps(content))
    return path


def message(M: FloatArray, q: FloatArray) -> dict[str, Any]:
    x, y, z, w = q.tolist()
    place = dict(zip("xyz", M[:3, 3].tolist(), strict=True))
    return {"position": place, "orientation": {"x": x, "y": y, "z": z, "w": w}}


MESSAGES = [message(M, q) for M, q in zip(T, TURNS.as_quat(), strict=True)]


def zivid(folder: Path) -> Path:
    (folder / "poses").mkdir()
    for i, M in enumerate(MM):
        path = folder / "poses" / f"pos{i + 1:02d}.yaml"
        storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        storage.write("PoseState", M)
        storage.release()
    return folder / "poses"


def newer_zivid(folder: Path) -> Path:
    (folder / "poses").mkdir()
    for i, M in enumerate(MM):
        content = {"__version__": {"serializer": 1, "data": 1}, "FloatMatrix": {"Data": M.tolist()}}
        dump(folder / "poses" / f"robot_pose_{i + 1}.yaml", content)
    return folder / "poses"


def robot_cal_tools(folder: Path) -> Path:
    (folder / "poses").mkdir()
    for i, (M, q) in enumerate(zip(T, TURNS.as_quat().tolist(), strict=True)):
        keys = ("x", "y", "z", "qz", "qx", "qw", "qy")
        values = [*M[:3, 3].tolist(), q[2], q[0], q[3], q[1]]
        dump(folder / "poses" / f"{i + 1}.yaml", dict(zip(keys, values, strict=True)))
    pairs = [
        {"image": f"images/{name}", "pose": f"poses/{i + 1}.yaml"} for i, name in enumerate(NAMES)
    ]
    return dump(folder / "cal_data.yaml", pairs[::-1])


def matrices_as_text(folder: Path) -> Path:
    (folder / "poses").mkdir()
    for i, M in enumerate(T):
        np.savetxt(folder / "poses" / f"shot_{i + 1}.txt", M, fmt="%.9f")
    return folder / "poses"


def opencv_list(folder: Path) -> Path:
    storage = cv2.FileStorage(str(folder / "poses.yaml"), cv2.FILE_STORAGE_WRITE)
    storage.write("rot_type", "rotation vector")
    storage.write("distance_unit", "mm")
    for i, row in enumerate(np.hstack([MM[:, :3, 3], TURNS.as_rotvec()])):
        storage.startWriteStruct(f"pose{i + 1}", cv2.FileNode_SEQ + cv2.FileNode_FLOW)
        for value in row.tolist():
            storage.write("", value)
        storage.endWriteStruct()
    storage.release()
    return folder / "poses.yaml"


def opencv_stacks(folder: Path) -> Path:
    storage = cv2.FileStorage(str(folder / "poses.yml"), cv2.FILE_STORAGE_WRITE)
    for name, part in (("R", T[:, :3, :3]), ("t", T[:, :3, 3:])):
        storage.startWriteStruct(f"{name}_gripper2base", cv2.FileNode_SEQ)
        for one in part:
            storage.write("", one.copy())
        storage.endWriteStruct()
    storage.release()
    return folder / "poses.yml"


def inverse_stacks(folder: Path) -> Path:
    other = inverse(T)
    keys = {"R_base2gripper": other[:, :3, :3].tolist(), "t_base2gripper": other[:, :3, 3].tolist()}
    return dump(folder / "poses.json", keys)


def numpy_stacks(folder: Path) -> Path:
    np.savez(folder / "p.npz", R_gripper2base=T[:, :3, :3], t_gripper2base=T[:, :3, 3:])
    return folder / "p.npz"


def numpy_array(folder: Path) -> Path:
    np.save(folder / "p.npy", MM)
    return folder / "p.npy"


def nerfstudio(folder: Path) -> Path:
    frames = [
        {"file_path": f"images/{name}", "transform_matrix": M.tolist()}
        for name, M in zip(NAMES, T, strict=True)
    ]
    return dump(folder / "transforms.json", {"fl_x": 600.0, "frames": frames[::-1]})


def rows(folder: Path, values: FloatArray, head: str = "") -> Path:
    path = folder / "poses.csv"
    np.savetxt(path, values, fmt="%.9f", delimiter=",", header=head, comments="")
    return path


def with_angles(order: str) -> FloatArray:
    return np.hstack([MM[:, :3, 3], TURNS.as_euler(order, degrees=True)])


FORMS: dict[str, tuple[Callable[[Path], Path], str]] = {
    "Zivid": (zivid, ""),
    "newer Zivid": (newer_zivid, ""),
    "robot_cal_tools": (robot_cal_tools, ""),
    "a text with 4x4 a picture": (matrices_as_text, ""),
    "OpenCV, a list each": (opencv_list, ""),
    "OpenCV, stacks": (opencv_stacks, ""),
    "stacks of inverses": (inverse_stacks, ""),
    "NumPy, stacks": (numpy_stacks, ""),
    "NumPy, an array": (numpy_array, ""),
    "nerfstudio": (nerfstudio, ""),
    "ROS": (lambda f: dump(f / "p.yaml", {"poses": MESSAGES}), ""),
    "by the name of the picture": (
        lambda f: dump(f / "p.json", dict(zip(NAMES[::-1], MESSAGES[::-1], strict=True))),
        "",
    ),
    "rvec and tvec": (
        lambda f: dump(
            f / "p.yaml",
            [
                {"image": name, "tvec": M[:3, 3].tolist(), "rvec": [[v] for v in turn]}
                for name, M, turn in zip(NAMES, T, TURNS.as_rotvec().tolist(), strict=True)
            ],
        ),
        "",
    ),
    "lists of six, KUKA": (
        lambda f: dump(f / "p.json", with_angles("ZYX").tolist()),
        "kuka-abc",
    ),
    "lists of seven": (
        lambda f: dump(f / "p.json", np.hstack([T[:, :3, 3], TURNS.as_quat()]).tolist()),
        "ros-quaternion",
    ),
    "columns without a header, Kawasaki": (lambda f: rows(f, with_angles("ZYZ")), "kawasaki-oat"),
    "bare names, Universal Robots": (
        lambda f: rows(f, np.hstack([T[:, :3, 3], TURNS.as_rotvec()]), "x,y,z,rx,ry,rz"),
        "ur-rotation-vector",
    ),
    "bare names, Staubli": (
        lambda f: rows(f, with_angles("XYZ"), "X,Y,Z,RX,RY,RZ"),
        "staubli-rxryrz",
    ),
    "Mech-Mind": (
        lambda f: dump(
            f / "p.json",
            [
                dict(zip(("x", "y", "z", "rx", "ry", "rz"), r, strict=True))
                for r in with_angles("xyz").tolist()
            ],
        ),
        "fanuc-wpr",
    ),
    "rows of matrices": (lambda f: rows(f, MM[:, :3].reshape(-1, 12)), "matrix,mm"),
}


@pytest.mark.parametrize("form", FORMS)
def test_all_say_the_same_poses(folder, form):
    write, said = FORMS[form]
    found = read_picture_set(folder / "pictures", write(folder), poses_are=said)
    assert found.names == tuple(NAMES)  # by the values of their numbers
    assert found.T_base_flange is not None
    np.testing.assert_allclose(found.T_base_flange, T, atol=2e-8)


@pytest.mark.parametrize(
    ("form", "unit"),
    [
        ("Zivid", None),
        ("newer Zivid", None),
        ("a text with 4x4 a picture", None),
        ("OpenCV, a list each", None),
        ("OpenCV, stacks", "m"),
        ("NumPy, stacks", "m"),
        ("ROS", None),
        ("rvec and tvec", None),
        ("lists of six, KUKA", None),
        ("columns without a header, Kawasaki", None),
        ("bare names, Universal Robots", None),
    ],
)
def test_they_are_a_side_of_pairs(folder, form, unit):
    write, said = FORMS[form]
    b = dump(folder / "b.json", MESSAGES[::-1])
    source = PairSource(a=write(folder), b=b, unit=unit, poses_are=f"{said}/")
    pairs = source.read()
    np.testing.assert_allclose(pairs.A, T, atol=2e-8)
    np.testing.assert_allclose(pairs.B, T[::-1], atol=2e-8)


@pytest.mark.parametrize("camera", ["on-flange", "fixed"])
@pytest.mark.parametrize("flange", ["gripper2base", "base2gripper"])
@pytest.mark.parametrize("seen", ["target2cam", "cam2target"])
def test_names_of_opencv_say_what_is_inverted(tmp_path, camera, flange, seen):
    A = T if flange == "gripper2base" else inverse(T)
    C = SEEN if seen == "target2cam" else inverse(SEEN)
    np.savez(
        tmp_path / "p.npz",
        **{f"R_{flange}": A[:, :3, :3], f"t_{flange}": A[:, :3, 3:]},
        **{
            f"rvec_{seen}": Rotation.from_matrix(C[:, :3, :3]).as_rotvec(),
            f"tvec_{seen}": C[:, :3, 3],
        },
    )
    found = PairSource(tmp_path / "p.npz", unit="m", camera=camera).read()
    np.testing.assert_allclose(found.A, T, atol=1e-9)
    expected = SEEN if camera == "fixed" else inverse(SEEN)
    np.testing.assert_allclose(found.B, expected, atol=1e-9)
    assert any(f"A is of {flange} and B of {seen}" in note for note in found.notes)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"pose": "../outside.yaml"}, "lies outside of the folder"),
        ({"pose": "no.yaml"}, "cannot be read"),
    ],
)
def test_a_list_that_names_files(folder, change, said):
    path = robot_cal_tools(folder)
    content = yaml.safe_load(path.read_text())
    content[3] |= change
    with pytest.raises(CalibError, match=said):
        read_picture_set(folder / "pictures", dump(path, content))


def test_files_that_hold_no_poses(folder):
    (folder / "empty").mkdir()
    with pytest.raises(FileFormatError, match="has no files with one pose each"):
        read_picture_set(folder / "pictures", folder / "empty")
    path = dump(folder / "p.json", [MESSAGES[0], {"rvec": [0, 0, 0.1], "tvec": [0, 0, 1]}])
    with pytest.raises(FileFormatError, match="has another form than the first"):
        read_picture_set(folder / "pictures", path)


def test_numbers_that_overlap_in_part_tell_nothing(folder):
    """Pictures from 1 and poses from 0: their order tells them, and a note says so."""
    (folder / "poses").mkdir()
    for i, one in enumerate(MESSAGES):
        dump(folder / "poses" / f"pos{i}.yaml", one)
    found = read_picture_set(folder / "pictures", folder / "poses")
    np.testing.assert_allclose(found.T_base_flange, T, atol=1e-9)
    assert any("taken in the order of their names" in note for note in found.notes)


def test_lengths_between_millimetres_and_metres_are_asked(folder):
    content = [{**message(M, q)} for M, q in zip(T, TURNS.as_quat(), strict=True)]
    for one in content:
        one["position"] = {axis: 40.0 * value for axis, value in one["position"].items()}
    path = dump(folder / "p.json", content)
    with pytest.raises(FileFormatError, match="may be mm or m") as caught:
        read_picture_set(folder / "pictures", path)
    assert "poses_are" in caught.value.hint
    found = read_picture_set(folder / "pictures", path, poses_are="mm")
    np.testing.assert_allclose(found.T_base_flange[:, :3, 3], 0.04 * T[:, :3, 3], atol=1e-9)
