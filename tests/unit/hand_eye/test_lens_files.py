"""Lenses and boards of other tools: the same pixels by OpenCV, whoever wrote the numbers."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from calib.errors import FileFormatError
from calib.lens import Lens
from calib.se3 import FloatArray
from calib.vision.camera import Camera
from posedesign.files import write_json_atomic
from posedesign.hand_eye.lens_files import (
    camera_info,
    kalibr_board,
    opencv_lens,
    read_camchain,
    read_kalibr_target,
    read_lens,
)
from posedesign.hand_eye.pairs.transforms import opencv_matrix

SIZE = (640, 480)
LINEAR = (800.0, 790.0, 321.0, 242.5)
PINHOLE = Lens("pinhole", *SIZE, (*LINEAR, -0.2, 0.05, 1e-5, -0.002, 0.01))
LENSES = {
    "pinhole": PINHOLE,
    "rational": Lens("rational", *SIZE, (*LINEAR, 0.2, 0.05, 0.001, -0.002, 0.01, 0.3, 0.02, 1e-3)),
    "fisheye": Lens("fisheye", *SIZE, (*LINEAR, 0.01, -0.02, 0.003, 1e-4)),
}
POINTS = np.array([[0.1, 0.2, 1.0], [-0.2, 0.1, 0.9], [0.0, 0.0, 1.0], [0.15, -0.25, 0.8]])


def projected(lens: Lens, K: FloatArray, distortion: FloatArray) -> FloatArray:
    points = POINTS[:, None]
    project: Any = cv2.fisheye.projectPoints if lens.name == "fisheye" else cv2.projectPoints
    pixels, _ = project(points, np.zeros(3), np.zeros(3), K, distortion)
    return np.asarray(pixels[:, 0])


def expected(lens: Lens) -> FloatArray:
    """By the numbers of the lens itself, from the corner of the image."""
    fx, fy, cx, cy, *distortion = lens.values
    K = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])
    return projected(lens, K, np.array(distortion)) - 0.5


@pytest.mark.parametrize("name", LENSES)
def test_ros_gets_the_same_pixels(name):
    lens = LENSES[name]
    content = yaml.safe_load(camera_info(lens, "hand_eye"))

    def matrix(key: str) -> FloatArray:
        found = content[key]
        return np.array(found["data"], dtype=float).reshape(found["rows"], found["cols"])

    models = {"pinhole": ("plumb_bob", 5), "rational": ("rational_polynomial", 8)}
    model, count = models.get(lens.name, ("equidistant", 4))
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
    path = write_json_atomic(tmp_path / "lens.json", opencv_lens(lens))
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    K, distortion = (
        storage.getNode(key).mat() for key in ("camera_matrix", "distortion_coefficients")
    )
    np.testing.assert_allclose(projected(lens, K, distortion[0]), expected(lens), atol=1e-9)
    assert storage.getNode("image_width").real() == SIZE[0]
    assert storage.getNode("image_height").real() == SIZE[1]
    assert storage.getNode("fisheye_model").real() == (lens.name == "fisheye")


def test_our_own_camera_has_these_pixels():
    fx, fy, cx, cy, *distortion = PINHOLE.values
    camera = Camera(*SIZE, fx, fy, (cx, cy), tuple(distortion))  # type: ignore[arg-type]
    np.testing.assert_allclose(camera.project(POINTS) - 0.5, expected(PINHOLE), atol=1e-9)


@pytest.mark.parametrize("name", LENSES)
def test_what_is_written_is_read_again(tmp_path, name):
    lens = LENSES[name]
    ros = tmp_path / "camera_info.yaml"
    ros.write_text(camera_info(lens))
    opencv = write_json_atomic(tmp_path / "lens.json", opencv_lens(lens))
    for path in (ros, opencv):
        again = read_lens(path)
        assert (again.name, again.width_px, again.height_px) == (name, *SIZE)
        np.testing.assert_allclose(again.values, lens.values, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{}", "has no lens"),
        ("picture,j1_deg", "has no lens"),
        ('{"camera_matrix": [1, 2], "image_width": 5}', "no camera_matrix of nine numbers"),
        ('{"lens": {"model": "wide"}}', "not all the numbers of a lens"),
        (
            '{"lens": {"model": "pinhole", "fx": -1, "fy": 1, "cx": 1, "cy": 1, "width_px": 9, '
            '"height_px": 9, "distortion": {"a": 0, "b": 0, "c": 0, "d": 0, "e": 0}}}',
            "cannot be",
        ),
    ],
)
def test_files_without_a_lens(tmp_path, text, said):
    path = tmp_path / "lens.json"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=said):
        read_lens(path)


def test_several_lenses_are_refused(tmp_path):
    path = tmp_path / "camchain.yaml"
    path.write_text(camchain())
    with pytest.raises(FileFormatError, match="which is meant cannot be told"):
        read_lens(path)


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
    bent = (-0.2, 0.05, 0.001, -0.002)
    assert found["cam0"] == Lens("pinhole", *SIZE, (*LINEAR, *bent, 0.0))
    assert found["cam1"] == Lens("fisheye", *SIZE, (*LINEAR, *bent))
    assert found["cam2"] == Lens("pinhole", *SIZE, (*LINEAR, *[0.0] * 5))


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


def test_boards_of_kalibr_as_boards(tmp_path):
    path = tmp_path / "target.yaml"
    said = {
        "aprilgrid": "AprilGrid of Kalibr of 6 x 5 every 114.4 mm, markers 0 to 29 of "
        "DICT_APRILTAG_36H11, 88 mm",
        "checkerboard": "chessboard of 9 x 7 squares of 30 mm",
        "circlegrid": "asymmetric grid of 11 rows of 4 circles",
    }
    for kind, words in said.items():
        board = {"target_type": kind, **TARGETS[kind]}
        if kind == "checkerboard":
            path.write_text(yaml.safe_dump(board))
            with pytest.raises(FileFormatError, match="has oblong fields"):
                kalibr_board(path)
            board["colSpacingMeters"] = board["rowSpacingMeters"]
        path.write_text(yaml.safe_dump(board))
        assert kalibr_board(path).words.startswith(words)
    many = {"target_type": "aprilgrid", **TARGETS["aprilgrid"], "tagCols": 99, "tagRows": 9}
    path.write_text(yaml.safe_dump(many))
    with pytest.raises(FileFormatError, match="the board has markers 0 to 890"):
        kalibr_board(path)


def test_files_of_kalibr_that_are_others(tmp_path):
    for text in ("a: 1", "[1, 2]", "cam0: [1]"):
        assert "holds no camera of Kalibr" in refused(read_camchain, tmp_path, text)
        assert "key target_type: has the" in refused(read_kalibr_target, tmp_path, text)
    board = {"target_type": "aprilgrid", **TARGETS["aprilgrid"]}
    for key, value in (("tagCols", 6.5), ("tagSize", 0.0), ("tagRows", "many"), ("tagSize", None)):
        said = refused(read_kalibr_target, tmp_path, yaml.safe_dump({**board, key: value}))
        assert f"key {key}: " in said


NAMES_OF_OTHERS = {
    "ROS": ("camera_matrix", "distortion_coefficients", {"image_width": 640, "image_height": 480}),
    "a program": ("Intrinsic", "Distortion", {"ImageSize": [640, 480]}),
    "camelCase": ("cameraMatrix", "distCoeffs", {"image_size": [640, 480]}),
    "letters": ("K", "D", {"resolution": [640, 480]}),
}


@pytest.mark.parametrize("case", NAMES_OF_OTHERS.values(), ids=NAMES_OF_OTHERS)
@pytest.mark.parametrize("nested", [False, True])
def test_names_that_programs_of_opencv_write(tmp_path, case, nested):
    matrix, distortion, size = case
    K, terms = PINHOLE.to_opencv()
    given: dict[str, Any] = {
        matrix: K.tolist() if nested else opencv_matrix(K),
        distortion: [terms.tolist()] if nested else opencv_matrix(terms[None]),
        **size,
    }
    found = read_lens(write_json_atomic(tmp_path / "lens.json", given))
    assert found.name == "pinhole"
    np.testing.assert_allclose(found.values, PINHOLE.values)


@pytest.mark.parametrize("count", [8, 12, 14])
def test_terms_of_opencv_are_read_or_refused(tmp_path, count):
    """Thin prism and tilt are up to some pixels: they are not dropped."""
    lens = LENSES["rational"]
    K, eight = lens.to_opencv()
    size = {"image_width": 640, "image_height": 480}
    terms = np.zeros(count)
    terms[:8] = eight

    def path(terms: FloatArray) -> Path:
        given = {
            "camera_matrix": opencv_matrix(K),
            "distortion_coefficients": opencv_matrix(terms[None]),
            **size,
        }
        return write_json_atomic(tmp_path / "lens.json", given)

    np.testing.assert_allclose(read_lens(path(terms)).values, lens.values)
    if count == 8:
        return
    for k in range(8, count):
        terms[8:] = 0.0
        terms[k] = 1e-3
        with pytest.raises(FileFormatError, match=f"has {count} terms of distortion") as caught:
            read_lens(path(terms))
        assert caught.value.hint


def test_more_terms_than_a_model_of_ros_has(tmp_path):
    info = yaml.safe_load(camera_info(PINHOLE))
    info["distortion_coefficients"] = {"rows": 1, "cols": 8, "data": [0.1] * 8}
    path = tmp_path / "camera_info.yaml"
    path.write_text(yaml.safe_dump(info))
    with pytest.raises(FileFormatError, match="8 terms of distortion, and a pinhole lens has 5"):
        read_lens(path)


@pytest.mark.parametrize(("kind", "word"), [("omni", "mirror"), ("ds", "double"), ("eucm", "unif")])
def test_models_of_kalibr_that_are_not_known_are_named(tmp_path, kind, word):
    path = tmp_path / "camchain.yaml"
    numbers = [0.5, 800.0, 800.0, 320.0, 240.0]
    camera = {"camera_model": kind, "intrinsics": numbers, "distortion_model": "none"}
    path.write_text(yaml.safe_dump({"cam0": {**camera, "resolution": [640, 480]}}))
    with pytest.raises(FileFormatError, match=word):
        read_lens(path)


def test_a_lens_without_a_size_is_named(tmp_path):
    path = tmp_path / "camera_intr.yaml"
    path.write_text("intrinsics:\n  fx: 1400.0\n  fy: 1400.0\n  cx: 800.0\n  cy: 600.0\n")
    with pytest.raises(FileFormatError, match="no size of the image"):
        read_lens(path)
