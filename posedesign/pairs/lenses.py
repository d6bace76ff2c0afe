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

Sources: ``sensor_msgs/CameraInfo`` and ``distortion_models.hpp``; the wiki of Kalibr, "yaml
formats".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import yaml

from calib.errors import FileFormatError, InputError, near_names
from calib.se3 import FloatArray
from posedesign.files.trees import number, numbers, read_tree

_HALF = 0.5
"""From the corner of the first pixel to its middle [px]."""

_MODELS: Mapping[str, tuple[str, int]] = MappingProxyType(
    {
        "pinhole": ("plumb_bob", 5),
        "rational": ("rational_polynomial", 8),
        "fisheye": ("equidistant", 4),
    }
)
"""Name of each model in ROS, and how many numbers of distortion it has there."""

_KALIBR_MODELS: Mapping[str, tuple[str, int]] = MappingProxyType(
    {"radtan": ("pinhole", 4), "equidistant": ("fisheye", 4), "none": ("pinhole", 0)}
)

_TARGETS: Mapping[str, tuple[Sequence[str], Sequence[str]]] = MappingProxyType(
    {
        "aprilgrid": (("tagCols", "tagRows"), ("tagSize", "tagSpacing")),
        "checkerboard": (("targetCols", "targetRows"), ("rowSpacingMeters", "colSpacingMeters")),
        "circlegrid": (("targetCols", "targetRows"), ("spacingMeters",)),
    }
)
"""Counts and sizes of each board of Kalibr; sizes in m, ``tagSpacing`` in tags."""


class Lens(Protocol):
    """What all lenses have: focal lengths and principal point [px], model, distortion."""

    @property
    def model(self) -> str: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def distortion(self) -> Sequence[float]: ...


@dataclass(frozen=True)
class FileLens:
    """A lens as it was read.

    Attributes
    ----------
    model : {"pinhole", "rational", "fisheye"}
    fx, fy, cx, cy : float
        [px], from the left upper corner of the image.
    distortion : tuple of float
    size_px : tuple of int
        Width and height of the image.
    """

    model: str
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...]
    size_px: tuple[int, int]


def camera_info(lens: Lens, size_px: tuple[int, int], name: str = "camera") -> str:
    """A lens as ROS loads it (``camera_info_manager``): YAML.

    The image that ROS makes of it without distortion has the same focal lengths and centre.

    Raises
    ------
    InputError
        The model is unknown, or has not as many numbers of distortion.
    """
    width, height = size_px
    K, distortion = _opencv_numbers(lens)
    content = {
        "image_width": width,
        "image_height": height,
        "camera_name": name,
        "camera_matrix": _ros_matrix(K),
        "distortion_model": _MODELS[lens.model][0],
        "distortion_coefficients": _ros_matrix(distortion),
        "rectification_matrix": _ros_matrix(np.eye(3)),
        "projection_matrix": _ros_matrix(np.hstack([K, np.zeros((3, 1))])),
    }
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None))


def opencv_lens(lens: Lens, size_px: tuple[int, int]) -> dict[str, object]:
    """A lens for ``cv2.FileStorage``: its JSON, with the keys of OpenCV's calibration sample.

    ``fisheye_model`` is 1 where the numbers are for the functions of ``cv2.fisheye``.

    Raises
    ------
    InputError
        As of `camera_info`.
    """
    K, distortion = _opencv_numbers(lens)
    return {
        "image_width": size_px[0],
        "image_height": size_px[1],
        "fisheye_model": int(lens.model == "fisheye"),
        "camera_matrix": opencv_matrix(K),
        "distortion_coefficients": opencv_matrix(distortion),
    }


def opencv_matrix(M: FloatArray) -> dict[str, object]:
    """A matrix in the JSON of OpenCV's persistence, row by row."""
    rows, columns = M.shape
    return {"type_id": "opencv-matrix", "rows": rows, "cols": columns, "dt": "d", "data": M.ravel()}


def _opencv_numbers(lens: Lens) -> tuple[FloatArray, FloatArray]:
    """Camera matrix (3, 3) and distortion (1, k), counted from the middle of the first pixel."""
    if lens.model not in _MODELS:
        raise InputError(
            f"there is no model {lens.model!r} of a lens",
            hint=near_names(lens.model, _MODELS),
            name="model",
            value=lens.model,
        )
    count = _MODELS[lens.model][1]
    given = list(lens.distortion)
    if len(given) > count or len(given) not in (0, 4, 5, 8):
        raise InputError(
            f"a lens of the model {lens.model} has {count} numbers of distortion, not {len(given)}",
            hint="give all that the model has, or the first 4 or 5, or none",
            name="distortion",
            value=len(given),
            bound=count,
        )
    K = np.array([[lens.fx, 0, lens.cx - _HALF], [0, lens.fy, lens.cy - _HALF], [0, 0, 1.0]])
    return K, np.array([given + [0.0] * (count - len(given))])


def _ros_matrix(M: FloatArray) -> dict[str, object]:
    return {"rows": M.shape[0], "cols": M.shape[1], "data": M.ravel().tolist()}


def read_camchain(path: Path) -> dict[str, FileLens]:
    """Lenses of a camchain of Kalibr by the names of the cameras, say ``cam0``.

    Raises
    ------
    FileFormatError
        There is none, or one of a model that is not known here, or without its numbers.
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


def _kalibr_lens(path: Path, name: str, camera: Mapping[str, Any]) -> FileLens:
    kind, distorted = (str(camera.get(f"{what}_model"))[:40] for what in ("camera", "distortion"))
    if kind != "pinhole" or distorted not in _KALIBR_MODELS:
        raise FileFormatError(
            f"is of the model {kind} with {distorted}",
            path=path,
            key=name,
            hint="known are pinhole with radtan, equidistant or none",
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
    return FileLens(model, fx, fy, cx + _HALF, cy + _HALF, tuple(bent.tolist()), (width, height))


def read_kalibr_target(path: Path) -> dict[str, Any]:
    """The board that a target of Kalibr describes: its keys, with numbers.

    ``target_type``; ``tagCols``, ``tagRows``, ``targetCols``, ``targetRows`` (inner corners, or
    circles) as whole numbers; lengths [m]; ``tagSpacing``, the gap in lengths of a tag; and
    ``asymmetricGrid``.

    Raises
    ------
    FileFormatError
        The kind of board is not known, or a number is missing or not above zero.
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
