"""Lenses and boards in the files of other tools: ROS, OpenCV, Kalibr.

Here a pixel's place counts from the left upper corner of the image, so that the middle of the first
pixel is (0.5, 0.5); these tools count from that middle. Their cx and cy are smaller by one half.

===========  ==================  =====================  ==========================================
model        ROS                 Kalibr                 distortion
===========  ==================  =====================  ==========================================
`pinhole`    plumb_bob           pinhole with radtan    k1 k2 p1 p2 and k3, or none
`rational`   rational_polynomial                        k1 k2 p1 p2 k3 k4 k5 k6
`fisheye`    equidistant         pinhole with           k1 k2 k3 k4 of the angle to the axis
                                 equidistant
===========  ==================  =====================  ==========================================

Files of OpenCV call the matrix, the distortion and the size of the image as their programs like:
see :data:`_NAMES`. Twelve and fourteen terms of OpenCV have thin prisms and a tilted sensor at
their end. Lenses with these are refused: projected without them, points lie up to some pixels off.
So are Kalibr's models ``omni``, ``eucm`` and ``ds``.

Sources: ``sensor_msgs/CameraInfo`` and ``distortion_models.hpp``; the wiki of Kalibr, "yaml
formats".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import yaml

from calib.errors import FileFormatError, InputError
from calib.lens import DISTORTION, Lens, LensName
from calib.se3 import FloatArray
from calib.vision.boards import Board, make_board
from posedesign.files.trees import number, numbers, read_tree
from posedesign.hand_eye.pairs.transforms import opencv_matrix

LENS_FILES = (("camera_info.yaml", "lens for ROS"), ("lens.json", "lens for OpenCV"))
"""Names of the files, and what they say that they are."""

_HALF = 0.5
"""From the corner of the first pixel to its middle [px]."""

_ROS_MODELS: Mapping[LensName, str] = MappingProxyType(
    {"pinhole": "plumb_bob", "rational": "rational_polynomial", "fisheye": "equidistant"}
)

_KALIBR_MODELS: Mapping[str, tuple[LensName, int]] = MappingProxyType(
    {"radtan": ("pinhole", 4), "equidistant": ("fisheye", 4), "none": ("pinhole", 0)}
)

_KALIBR_WORDS: Mapping[str, str] = MappingProxyType(
    {
        "omni": ": one mirror parameter, after Mei",
        "ds": ": double sphere",
        "eucm": ": extended unified",
    }
)
"""Models of Kalibr that are not known here, in words."""

_NAMES: Mapping[str, Sequence[str]] = MappingProxyType(
    {
        "matrix": ("camera_matrix", "cameramatrix", "intrinsic", "intrinsic_matrix", "k", "mtx"),
        "distortion": (
            "distortion_coefficients",
            "distcoeffs",
            "dist_coeffs",
            "distortion",
            "distortion_coeffs",
            "dist",
            "d",
        ),
        "size": ("imagesize", "image_size", "resolution", "size"),
    }
)
"""Names of what OpenCV's programs write of a lens, in small letters."""

_PRISM_AND_TILT = ("s1", "s2", "s3", "s4", "tau_x", "tau_y")
"""OpenCV's terms after the eight of the rational model."""

_TARGETS: Mapping[str, tuple[Sequence[str], Sequence[str]]] = MappingProxyType(
    {
        "aprilgrid": (("tagCols", "tagRows"), ("tagSize", "tagSpacing")),
        "checkerboard": (("targetCols", "targetRows"), ("rowSpacingMeters", "colSpacingMeters")),
        "circlegrid": (("targetCols", "targetRows"), ("spacingMeters",)),
    }
)
"""Counts and sizes of each board of Kalibr; sizes in m, ``tagSpacing`` in tags."""


def camera_info(lens: Lens, name: str = "camera") -> str:
    """A lens as ROS loads it (``camera_info_manager``): YAML.

    The image that ROS makes of it without distortion has the same focal lengths and centre.
    """
    K, distortion = lens.to_opencv()
    content = {
        "image_width": lens.width_px,
        "image_height": lens.height_px,
        "camera_name": name,
        "camera_matrix": _ros_matrix(K),
        "distortion_model": _ROS_MODELS[lens.name],
        "distortion_coefficients": _ros_matrix(distortion[None]),
        "rectification_matrix": _ros_matrix(np.eye(3)),
        "projection_matrix": _ros_matrix(np.hstack([K, np.zeros((3, 1))])),
    }
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def opencv_lens(lens: Lens) -> dict[str, object]:
    """A lens for ``cv2.FileStorage``: its JSON, with the keys of OpenCV's calibration sample.

    ``fisheye_model`` is 1 where the numbers are for the functions of ``cv2.fisheye``.
    """
    K, distortion = lens.to_opencv()
    return {
        "image_width": lens.width_px,
        "image_height": lens.height_px,
        "fisheye_model": int(lens.name == "fisheye"),
        "camera_matrix": opencv_matrix(K),
        "distortion_coefficients": opencv_matrix(distortion[None]),
    }


def _ros_matrix(M: FloatArray) -> dict[str, object]:
    return {"rows": M.shape[0], "cols": M.shape[1], "data": M.ravel().tolist()}


def read_lens(path: Path) -> Lens:
    """The lens of a ``camera.json``, of ROS's camera_info, of OpenCV, or the one of a camchain.

    Raises FileFormatError: there is no lens in it, or more than one, or a number is missing.
    """
    tree = read_tree(path)
    found = tree if isinstance(tree, dict) else {}
    if isinstance(found.get("lens"), dict):
        return _own_lens(path, found["lens"])
    small = {key.casefold(): value for key, value in found.items()}
    if any(name in small for name in _NAMES["matrix"]):
        return ros_lens(path, small)
    if isinstance(small.get("intrinsics"), dict):
        raise FileFormatError(
            "gives focal lengths and centre, but no size of the image",
            path=path,
            key="intrinsics",
            hint="write camera_matrix, distortion_coefficients, image_width and image_height; or "
            "have the lens estimated with the camera",
        )
    if not any(isinstance(value, dict) for value in found.values()):
        raise FileFormatError(
            "has no lens",
            path=path,
            hint="give a camera.json of posedesign camera, a camera_info of ROS, a calibration of "
            "OpenCV, or a camchain of Kalibr",
        )
    cameras = read_camchain(path)
    if len(cameras) > 1:
        raise FileFormatError(
            f"holds the lenses of {', '.join(cameras)[:60]}: which is meant cannot be told",
            path=path,
            hint="keep one of them in it",
        )
    return next(iter(cameras.values()))


def _own_lens(path: Path, found: Mapping[str, Any]) -> Lens:
    terms = found.get("distortion")
    values = [found.get(key) for key in ("fx", "fy", "cx", "cy")]
    values += list(terms.values()) if isinstance(terms, dict) else []
    size = [found.get("width_px"), found.get("height_px")]
    return _lens(path, "lens", found.get("model"), values, size)


def ros_lens(path: Path, found: Mapping[str, Any]) -> Lens:
    """Return the lens of ROS, or of OpenCV's programs, which name no model; keys in small letters.

    Raises FileFormatError: a number is missing, or the model is not known.
    """
    models = {ros: name for name, ros in _ROS_MODELS.items()}
    matrix, distortion, size = (
        next((found[name] for name in _NAMES[what] if name in found), None) for what in _NAMES
    )
    K, terms = _data_of(matrix), _data_of(distortion)
    if len(K) == 3 and all(isinstance(row, list) for row in K):
        K = [value for row in K for value in row]
    if len(terms) == 1 and isinstance(terms[0], list):
        terms = terms[0]
    model = models.get(str(found.get("distortion_model")))
    if "distortion_model" not in found:
        fisheye = number(found.get("fisheye_model", 0)) > 0
        model = "fisheye" if fisheye else ("rational" if len(terms) > 5 else "pinhole")
    if len(K) != 9 or model is None:
        raise FileFormatError(
            "has no camera_matrix of nine numbers, or a distortion_model that is not known",
            path=path,
            key="camera_matrix",
            hint=f"known are {', '.join(models)}",
        )
    count = len(DISTORTION[model])
    _check_more_terms(path, terms, model)
    terms = [*terms[:count], *(0.0 for _ in range(count - len(terms)))]
    pixels = [found.get("image_width"), found.get("image_height")]
    if None in pixels:
        pixels = _data_of(size)
    return _lens(path, "camera_matrix", model, [K[0], K[4], K[2], K[5], *terms], pixels)


def _check_more_terms(path: Path, terms: Sequence[object], model: LensName) -> None:
    """Refuse terms of distortion that the model does not have, unless they are zero."""
    count = len(DISTORTION[model])
    more = numbers(list(terms[count:]), len(terms) - count) if len(terms) > count else np.zeros(0)
    if more is not None and not more.any():
        return
    names = (*DISTORTION["rational"], *_PRISM_AND_TILT)
    shown = ", ".join(f"{name} = {value}" for name, value in zip(names, terms, strict=False))
    said = f"has {len(terms)} terms of distortion, and a {model} lens has {count}"
    if model != "fisheye" and count < len(terms) <= len(names):
        said += f" ({shown})"
    raise FileFormatError(
        said,
        path=path,
        key="distortion_coefficients",
        hint="calibrate it without thin prism and tilted sensor, CALIB_RATIONAL_MODEL alone, or "
        "have it estimated with the camera: `lens` rational",
        value=len(terms),
        bound=count,
    )


def _data_of(matrix: object) -> list[Any]:
    """Numbers of a matrix, in the forms of ROS and OpenCV."""
    if isinstance(matrix, dict):
        matrix = matrix.get("data")
    if isinstance(matrix, np.ndarray):
        return list(matrix.ravel().tolist())
    return list(matrix) if isinstance(matrix, list) else []


def _lens(
    path: Path,
    key: str,
    model: object,
    values: Sequence[object],
    size: Sequence[object],
) -> Lens:
    """A lens of numbers that may be none."""
    name = next((known for known in _ROS_MODELS if known == model), None)
    given, pixels = numbers(list(values), len(values)), numbers(list(size), 2)
    if name is None or given is None or pixels is None:
        raise FileFormatError(
            "has not all the numbers of a lens, or a model that is not known",
            path=path,
            key=key,
            hint=f"models are {', '.join(_ROS_MODELS)}",
        )
    width, height = (int(value) for value in pixels)
    try:
        given[2:4] += _HALF
        return Lens(name, width, height, tuple(given.tolist()))
    except InputError as error:
        raise FileFormatError(str(error), path=path, key=key, hint=error.hint) from error


def read_camchain(path: Path) -> dict[str, Lens]:
    """Lenses of a camchain of Kalibr by the names of the cameras, say ``cam0``.

    Raises FileFormatError: there is none, or one of a model that is not known here, or without its
    numbers.
    """
    tree = read_tree(path)
    cameras = {
        name: value
        for name, value in (tree.items() if isinstance(tree, dict) else ())
        if isinstance(value, dict) and "intrinsics" in value
    }
    if not cameras:
        raise FileFormatError(
            "holds no camera of Kalibr", path=path, hint="is it the camchain of a calibration?"
        )
    return {name: _kalibr_lens(path, name, value) for name, value in cameras.items()}


def _kalibr_lens(path: Path, name: str, camera: Mapping[str, Any]) -> Lens:
    kind, distorted = (str(camera.get(f"{what}_model"))[:40] for what in ("camera", "distortion"))
    if kind != "pinhole" or distorted not in _KALIBR_MODELS:
        raise FileFormatError(
            f"is of the model {kind} with {distorted}{_KALIBR_WORDS.get(kind, '')}",
            path=path,
            key=name,
            hint="known are pinhole with radtan, equidistant or none: calibrate it as "
            "pinhole-equi, or have a fisheye lens estimated with the camera",
        )
    model, count = _KALIBR_MODELS[distorted]
    found = numbers(camera["intrinsics"], 4)
    bent = numbers(camera.get("distortion_coeffs", []), count)
    size = numbers(camera.get("resolution"), 2)
    if found is None or bent is None or size is None or not (found[:2] > 0).all():
        raise FileFormatError(
            f"has not 4 intrinsics, {count} distortion_coeffs and 2 numbers of resolution",
            path=path,
            key=name,
            hint="copy the camchain again",
        )
    fx, fy, cx, cy = found.tolist()
    width, height = (int(value) for value in size)
    terms = [*bent.tolist(), *(0.0 for _ in range(len(DISTORTION[model]) - count))]
    return Lens(model, width, height, (fx, fy, cx + _HALF, cy + _HALF, *terms))


def read_kalibr_target(path: Path) -> dict[str, Any]:
    """The board that a target of Kalibr describes: its keys, with numbers.

    ``target_type``; ``tagCols``, ``tagRows``, ``targetCols``, ``targetRows`` (inner corners, or
    circles) as whole numbers; lengths [m]; ``tagSpacing``, the gap in lengths of a tag; and
    ``asymmetricGrid``.

    Raises FileFormatError: the kind of board is not known, or a number is missing or not above
    zero.
    """
    tree = read_tree(path)
    kind = str(tree.get("target_type"))[:40] if isinstance(tree, dict) else ""
    if kind not in _TARGETS:
        raise FileFormatError(
            f"has the target_type {kind!r}",
            path=path,
            key="target_type",
            hint=f"known are {', '.join(_TARGETS)}",
        )
    board: dict[str, Any] = {"target_type": kind}
    counts, sizes = _TARGETS[kind]
    for key in (*counts, *sizes):
        value = number(tree.get(key))
        if not value > 0 or (key in counts and value % 1):
            raise FileFormatError(
                f"{str(tree.get(key))[:40]!r} is no {'count' if key in counts else 'size'}",
                path=path,
                key=key,
                hint="give a number above zero, lengths in metres",
            )
        board[key] = int(value) if key in counts else value
    if kind == "circlegrid":
        board["asymmetricGrid"] = str(tree.get("asymmetricGrid")).casefold() in ("true", "yes", "1")
    return board


def kalibr_board(path: Path) -> Board:
    """The board that a target of Kalibr describes.

    Raises FileFormatError: it describes none that can be found here.
    """
    found = read_kalibr_target(path)
    if found["target_type"] == "aprilgrid":
        side = found["tagSize"]
        kind, columns, rows = "kalibr-aprilgrid", found["tagCols"], found["tagRows"]
        lengths = {"marker_m": side, "spacing_m": side * (1.0 + found["tagSpacing"])}
    elif found["target_type"] == "checkerboard":
        if found["rowSpacingMeters"] != found["colSpacingMeters"]:
            raise FileFormatError(
                "has oblong fields",
                path=path,
                key="rowSpacingMeters",
                hint="boards of squares are found: both spacings are the same",
            )
        kind, lengths = "chessboard", {"square_m": found["rowSpacingMeters"]}
        columns, rows = found["targetCols"] + 1, found["targetRows"] + 1  # it counts inner corners
    else:
        kind = "asymmetric-circles" if found["asymmetricGrid"] else "circles"
        columns, rows = found["targetCols"], found["targetRows"]
        lengths = {"spacing_m": found["spacingMeters"]}
    try:
        return make_board(kind, columns=columns, rows=rows, **lengths)
    except InputError as error:
        raise FileFormatError(error.message, path=path, hint=error.hint) from error
