"""Lenses and boards of other tools: the same pixels by OpenCV, whoever wrote the numbers."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from calib.errors import FileFormatError, InputError
from calib.se3 import FloatArray
from calib.vision.camera import Camera
from posedesign.files import write_json_atomic
from posedesign.pairs.lenses import (
    FileLens,
    camera_info,
    opencv_lens,
    read_camchain,
    read_kalibr_target,
)

SIZE = (640, 480)
PINHOLE = FileLens("pinhole", 800.0, 790.0, 321.0, 242.5, (-0.2, 0.05, 1e-5, -0.002, 0.01), SIZE)
LENSES = {
    "pinhole": PINHOLE,
    "four numbers": replace(PINHOLE, distortion=(-0.2, 0.05, 0.001, -0.002)),
    "none": replace(PINHOLE, distortion=()),
    "rational": replace(
        PINHOLE,
        model="rational",
        distortion=(0.2, 0.05, 0.001, -0.002, 0.01, 0.3, 0.02, 0.001),
    ),
    "fisheye": replace(PINHOLE, model="fisheye", distortion=(0.01, -0.02, 0.003, 1e-4)),
}
POINTS = np.array([[0.1, 0.2, 1.0], [-0.2, 0.1, 0.9], [0.0, 0.0, 1.0], [0.15, -0.25, 0.8]])


def projected(lens: FileLens, K: FloatArray, distortion: FloatArray) -> FloatArray:
    points = POINTS[:, None]
    project: Any = cv2.fisheye.projectPoints if lens.model == "fisheye" else cv2.projectPoints
    pixels, _ = project(points, np.zeros(3), np.zeros(3), K, distortion)
    return np.asarray(pixels[:, 0])


def expected(lens: FileLens) -> FloatArray:
    """By the numbers of the lens itself, from the corner of the image."""
    distortion = np.array([*lens.distortion] or [0.0] * 4)
    K = np.array([[lens.fx, 0, lens.cx], [0, lens.fy, lens.cy], [0, 0, 1]])
    return projected(lens, K, distortion) - 0.5


@pytest.mark.parametrize("name", LENSES)
def test_ros_gets_the_same_pixels(name):
    lens = LENSES[name]
    content = yaml.safe_load(camera_info(lens, SIZE, "hand_eye"))

    def matrix(key: str) -> FloatArray:
        found = content[key]
        return np.array(found["data"], dtype=float).reshape(found["rows"], found["cols"])

    models = {"pinhole": ("plumb_bob", 5), "rational": ("rational_polynomial", 8)}
    model, count = models.get(lens.model, ("equidistant", 4))
    assert content["distortion_model"] == model
    assert matrix("distortion_coefficients").shape == (1, count)
    assert (content["image_width"], content["image_height"]) == SIZE
    assert content["camera_name"] == "hand_eye"
    K = matrix("camera_matrix")
    found = projected(lens, K, matrix("distortion_coefficients")[0])
    np.testing.assert_allclose(found, expected(lens), atol=1e-9)
    np.testing.assert_array_equal(matrix("projection_matrix"), np.hstack([K, np.zeros((3, 1))]))
    np.testing.assert_array_equal(matrix("rectification_matrix"), np.eye(3))


@pytest.mark.parametrize("name", LENSES)
def test_opencv_gets_the_same_pixels(tmp_path, name):
    lens = LENSES[name]
    path = write_json_atomic(tmp_path / "lens.json", opencv_lens(lens, SIZE))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K, distortion = (
        storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients")
    )
    np.testing.assert_allclose(projected(lens, K, distortion[0]), expected(lens), atol=1e-9)
    assert storage.getNode("image_width").real() == SIZE[0]
    assert storage.getNode("image_height").real() == SIZE[1]
    assert storage.getNode("fisheye_model").real() == (lens.model == "fisheye")


def test_our_own_camera_has_these_pixels():
    camera = Camera(
        *SIZE,
        PINHOLE.fx,
        PINHOLE.fy,
        (PINHOLE.cx, PINHOLE.cy),
        PINHOLE.distortion[:5],  # type: ignore[arg-type]
    )
    np.testing.assert_allclose(camera.project(POINTS) - 0.5, expected(PINHOLE), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"model": "pinhol"}, "there is no model 'pinhol'"),
        ({"distortion": (0.1,)}, "has 5 numbers of distortion, not 1"),
        ({"distortion": (0.1,) * 8}, "has 5 numbers of distortion, not 8"),
        ({"model": "fisheye", "distortion": (0.1,) * 5}, "has 4 numbers of distortion, not 5"),
    ],
)
def test_lenses_that_are_none(change, said):
    for write in (camera_info, opencv_lens):
        with pytest.raises(InputError, match=said) as caught:
            write(replace(PINHOLE, **change), SIZE)
        assert caught.value.hint


def camchain(**changes: Any) -> str:
    first = {
        "camera_model": "pinhole",
        "intrinsics": [800.0, 790.0, 320.5, 242.0],
        "distortion_model": "radtan",
        "distortion_coeffs": [-0.2, 0.05, 0.001, -0.002],
        "resolution": [640, 480],
        "rostopic": "/cam0/image_raw",
    }
    second = {**first, "distortion_model": "equidistant", "T_cn_cnm1": np.eye(4).tolist()}
    third = {**first, "distortion_model": "none", "distortion_coeffs": []}
    return json.dumps({"cam0": {**first, **changes}, "cam1": second, "cam2": third})


def test_lenses_of_kalibr(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(camchain())
    found = read_camchain(path)
    assert found["cam0"] == LENSES["four numbers"]
    assert found["cam1"] == replace(LENSES["four numbers"], model="fisheye")
    assert found["cam2"] == LENSES["none"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"camera_model": "omni"}, "key cam0: is of the model omni with radtan"),
        ({"distortion_model": ["fov"]}, "with ['fov']"),
        ({"intrinsics": [800.0, 790.0, 320.5]}, "has not 4 intrinsics"),
        ({"intrinsics": [-800.0, 790.0, 320.5, 242.0]}, "has not 4 intrinsics"),
        ({"distortion_coeffs": [1.0]}, "4 distortion_coeffs"),
        ({"resolution": "large"}, "2 numbers of resolution"),
    ],
)
def test_camchains_that_are_none(tmp_path, change, said):
    assert said in refused(read_camchain, tmp_path, camchain(**change))


def refused(read: Any, folder: Path, text: str) -> str:
    path = folder / "kalibr.yaml"
    path.write_text(text)
    with pytest.raises(FileFormatError) as caught:
        read(path)
    assert caught.value.hint
    return caught.value.message


TARGETS: dict[str, dict[str, Any]] = {
    "aprilgrid": {"tagCols": 6, "tagRows": 5, "tagSize": 0.088, "tagSpacing": 0.3},
    "checkerboard": {
        "targetCols": 8,
        "targetRows": 6,
        "rowSpacingMeters": 0.03,
        "colSpacingMeters": 0.025,
    },
    "circlegrid": {
        "targetCols": 4,
        "targetRows": 11,
        "spacingMeters": 0.02,
        "asymmetricGrid": True,
    },
}


@pytest.mark.parametrize("kind", TARGETS)
def test_boards_of_kalibr(tmp_path, kind):
    path = tmp_path / "target.yaml"
    board = {"target_type": kind, **TARGETS[kind]}
    path.write_text(yaml.safe_dump(board))
    found = read_kalibr_target(path)
    assert found == board
    assert all(type(found[key]) is type(value) for key, value in board.items())


def test_files_of_kalibr_that_are_others(tmp_path):
    for text in ("a: 1", "[1, 2]", "cam0: [1]"):
        assert "holds no camera of Kalibr" in refused(read_camchain, tmp_path, text)
        assert "key target_type: has the" in refused(read_kalibr_target, tmp_path, text)
    board = {"target_type": "aprilgrid", **TARGETS["aprilgrid"]}
    for key, value in (("tagCols", 6.5), ("tagSize", 0.0), ("tagRows", "many"), ("tagSize", None)):
        said = refused(read_kalibr_target, tmp_path, yaml.safe_dump({**board, key: value}))
        assert f"key {key}: " in said
