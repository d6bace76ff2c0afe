"""Poses in the files that people have: lists and maps of YAML and JSON, and a folder of them.

==================================  ============================================================
a pose                              how it stands
==================================  ============================================================
a map of numbers                    ``x y z`` with ``qx qy qz qw``, ``rx ry rz``, ``a b c``,
                                    ``roll pitch yaw`` .. (robot_cal_tools)
a map of two                        ``position`` and ``orientation``, ``translation`` and
                                    ``rotation``, ``tvec`` and ``rvec``, ``t`` and ``R``: maps,
                                    lists or matrices (messages of ROS, OpenCV)
a matrix                            4x4 or 3x4 in rows, 16 or 12 numbers in one list, or a matrix
                                    of OpenCV; it may lie in maps of its own (``PoseState`` and
                                    ``FloatMatrix`` of Zivid)
a list                              six numbers, position and angles, or seven with a quaternion
==================================  ============================================================

A file has a list of poses, a map of them by name, ``frames`` with ``file_path`` and
``transform_matrix`` (nerfstudio), ``image`` and ``pose``, one of which may be another file (robot
_cal_tools' ``cal_data.yaml``), stacks ``R_gripper2base`` and ``t_gripper2base`` of OpenCV, or one
matrix with a pose a row. A folder has a file a picture, each with one pose, or four lines of four
numbers. ``distance_unit``, ``angle_unit`` and ``rot_type`` beside them are heeded.

Sources: data of robot_cal_tools (``rct_examples``), samples of Zivid
(``robotTransform.yaml``), ``cv2.calibrateHandEye``, nerfstudio's "data conventions".
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.files.csv_tables import a_few
from posedesign.files.trees import matrix, numbers, read_tree
from posedesign.hand_eye.conventions import UNKNOWN, Convention
from posedesign.hand_eye.pairs.forms import Place, WrittenPoses
from posedesign.hand_eye.pairs.stacks import (
    StackFile,
    open_blocks,
    open_mat,
    open_npz,
    pick_one,
    rows_of,
    vector_of,
)

TREES = (".yaml", ".yml", ".json", ".xml")
"""Endings of files of keys and lists."""

STACKS = (".npz", ".npy", ".mat")
"""Endings of files of matrices."""

_TEXTS = (".txt", ".csv", ".dat")
_MOST_FILES = 20_000
_DEEPEST = 4
"""Maps that a pose may lie in."""

_SIX = (
    ("rx", "ry", "rz"),
    ("a", "b", "c"),
    ("w", "p", "r"),
    ("roll", "pitch", "yaw"),
    ("o", "a", "t"),
    ("u", "v", "w"),
)
_PLACES = ("position", "translation", "tvec", "trans", "xyz", "pos", "t", "p")
_TURNS = (
    "orientation",
    "rotation",
    "quaternion",
    "quat",
    "rvec",
    "rotation_vector",
    "rotation_matrix",
    "rot",
    "euler",
    "rpy",
    "q",
    "r",
)
_VECTORS = ("rvec", "rotation_vector")
_PICTURES = ("image", "picture", "file_path", "img", "image_path", "filename", "file", "image_name")
_JOINTS = ("joint", "positions", "velocities", "accelerations", "effort")
"""Beginnings of keys of joint values: a list of six of them is no pose."""

_LENGTHS = {"mm": "mm", "millimeter": "mm", "m": "m", "meter": "m", "cm": "cm", "inch": "inch"}
_ANGLES = {"rad": "rad", "radian": "rad", "deg": "deg", "degree": "deg"}
_TYPES = {
    "rotationvector": "rotation-vector",
    "rotvec": "rotation-vector",
    "rodrigues": "rotation-vector",
    "axisangle": "rotation-vector",
    "quaternionwxyz": "quaternion-wxyz",
    "quaternionxyzw": "quaternion-xyzw",
}


@dataclass(frozen=True, eq=False)
class _Pose:
    """One pose as it stands."""

    place: FloatArray  # (3,)
    numbers: FloatArray  # (k,)
    turn: str


def read_written(path: Path) -> WrittenPoses:
    """Read the poses of a file of keys and lists, or of a folder with a file each.

    Raises FileFormatError: there are none, or not all have one form.
    """
    if path.is_dir():
        return _of_folder(path)
    if path.suffix.casefold() in STACKS:
        file = open_npz(path) if path.suffix.casefold() in (".npz", ".npy") else open_mat(path)
        return _of_stacks(file)
    written = written_tree(path, read_tree(path))
    if written is None:
        raise FileFormatError(
            "holds no list of poses",
            path=path,
            hint="give maps with x y z qx qy qz qw, 4x4 matrices, or six or seven numbers a pose",
        )
    return written


def _of_stacks(file: StackFile) -> WrittenPoses:
    """Return the poses of the flange of a file of matrices."""
    known = [name for name in ("gripper2base", "base2gripper") if name in file.variables]
    name = known[0] if known else pick_one(file, "")
    written = file.written(name)
    inverse = name == "base2gripper"
    return replace(written, convention=replace(written.convention, inverse=inverse))


def written_tree(path: Path, tree: Any) -> WrittenPoses | None:
    """Return the poses of a file that was read, and of those that it names; None without any.

    Raises FileFormatError: not all have one form.
    """
    found = _listed(tree, path.parent)
    if not found:
        return None
    names = tuple(name for name, _ in found)
    return _together(path, names, [pose for _, pose in found], _said(tree))


def natural(name: str) -> tuple[list[tuple[int, int | str]], str]:
    """Return what names sort by: numbers in them by their value, capitals as small letters."""
    parts = re.findall(r"[0-9]{1,18}|[^0-9]+", name.casefold())
    return [(0, int(p)) if p[0] in "0123456789" else (1, p) for p in parts], name


def _of_folder(folder: Path) -> WrittenPoses:
    endings = (*TREES, *_TEXTS)
    files = sorted(
        (f for f in folder.iterdir() if f.suffix.casefold() in endings and f.is_file()),
        key=lambda f: natural(f.name),
    )
    if len(files) > _MOST_FILES:
        raise FileFormatError("has too many files", path=folder, hint="give the poses in one file")
    found = [(file, _of_file(file)) for file in files]
    poses = [(file, pose) for file, pose in found if pose is not None]
    if not poses:
        raise FileFormatError(
            "has no files with one pose each",
            path=folder,
            hint=f"name the folder with the files {' '.join(endings)}",
        )
    names = tuple(file.name for file, _ in poses)
    other = [file.name for file, pose in found if pose is None]
    written = _together(folder, names, [pose for _, pose in poses], Convention(UNKNOWN))
    notes = (f"{folder}: no pose, passed over: {a_few(other)}",) if other else ()
    return replace(written, notes=notes)


def _of_file(path: Path) -> _Pose | None:
    """Return the pose of a file; None where it has none, or several."""
    if path.suffix.casefold() in TREES:
        return _pose(read_tree(path))
    blocks = open_blocks(path)
    if blocks is not None:
        (variable,) = blocks.variables.values()
        array = variable.array
        return None if array is None or array.shape[-1] != 1 else _of_matrix(array[..., 0])
    try:
        words = re.split(r"[;,\s]+", path.read_text("utf-8").strip())
    except (OSError, UnicodeDecodeError):
        return None
    return _of_list(list(words)) if len(words) in (6, 7, 12, 16) else None


def _listed(tree: Any, folder: Path, depth: int = 0) -> list[tuple[str, _Pose]]:
    """Return the poses of a tree by their names, empty where they have none."""
    if depth > _DEEPEST:
        return []
    if isinstance(tree, list):
        found = [_item(item, folder) for item in tree]
        return [one for one in found if one is not None] if all(found) else []
    rows = matrix(tree)
    if rows is not None:
        each = [_of_list([float(v) for v in row]) for row in rows] if len(rows) > 1 else []
        return [("", pose) for pose in each if pose is not None]
    if not isinstance(tree, dict):
        return []
    stacked = _stacked(tree)
    if stacked:
        return stacked
    if any(key.casefold().startswith(_JOINTS) for key in tree):
        return []
    by_name = [(name, _pose(value)) for name, value in tree.items() if not _is_number(value)]
    poses = [(name, pose) for name, pose in by_name if pose is not None]
    if len(poses) > 1:
        return poses
    inside = [own for value in tree.values() if (own := _listed(value, folder, depth + 1))]
    return inside[0] if len(inside) == 1 else []


def _item(item: Any, folder: Path) -> tuple[str, _Pose] | None:
    """Return the pose of an item of a list with the name of its picture."""
    if not isinstance(item, dict):
        pose = _pose(item)
        return None if pose is None else ("", pose)
    name = next((str(item[key]) for key in _PICTURES if isinstance(item.get(key), str)), "")
    file = item.get("pose")
    if isinstance(file, str):
        inside = (folder / file).resolve()
        if not inside.is_relative_to(folder.resolve()):
            raise FileFormatError(
                "lies outside of the folder of the list",
                path=folder / file,
                hint="move it into that folder",
            )
        pose = _of_file(inside)
    else:
        pose = _pose({key: value for key, value in item.items() if key not in _PICTURES})
    return None if pose is None else (name, pose)


def _stacked(tree: Mapping[str, Any]) -> list[tuple[str, _Pose]]:
    """Return poses of the flange in stacks of rotations and translations, as OpenCV takes them."""
    for stem, is_inverse in (("gripper2base", False), ("base2gripper", True)):
        turns, places = (
            next((tree[k] for k in tree if k.casefold() == f"{word}_{stem}"), None)
            for word in ("r", "t")
        )
        if turns is None or places is None:
            continue
        R, t = rows_of(turns, (9, 3)), rows_of(places, (3,))
        if R is None or t is None or len(R) != len(t):
            continue
        poses = [
            _Pose(p, n, "matrix" if len(n) == 9 else "rotation-vector")
            for p, n in zip(t, R, strict=True)
        ]
        if is_inverse:
            poses = [replace(one, turn=one.turn + _INVERTED) for one in poses]
        return [("", one) for one in poses]
    return []


_INVERTED = ",inverse"


def _is_number(value: Any) -> bool:
    return not isinstance(value, (dict, list))


def _pose(value: Any, depth: int = 0) -> _Pose | None:
    """Return the pose that a value is, or that alone lies in its maps."""
    whole = matrix(value)
    if whole is not None:
        return _of_matrix(whole) if whole.shape in ((4, 4), (3, 4)) else None
    if isinstance(value, list):
        return _of_list(value)
    if not isinstance(value, dict) or depth > _DEEPEST:
        return None
    small = {key.casefold(): item for key, item in value.items()}
    place = numbers([small.get(axis) for axis in "xyz"], 3)
    if place is not None:
        for names, turn in (
            (("qw", "qx", "qy", "qz"), "quaternion-wxyz"),
            *((names, UNKNOWN) for names in _SIX),
        ):
            turned = numbers([small.get(name) for name in names], len(names))
            if turned is not None:
                return _Pose(place, turned, turn)
    both = _of_two(small)
    if both is not None:
        return both
    inside = [
        found
        for key, item in small.items()
        if not key.startswith(_JOINTS) and (found := _pose(item, depth + 1)) is not None
    ]
    return inside[0] if len(inside) == 1 else None


def _of_two(small: Mapping[str, Any]) -> _Pose | None:
    """Return the pose of a map with a position and an orientation."""
    place = next((p for k in _PLACES if (p := vector_of(small.get(k), 3)) is not None), None)
    if place is None:
        return None
    for key in _TURNS:
        value = small.get(key)
        if value is None:
            continue
        matrices = vector_of(value, 9)
        if matrices is not None:
            return _Pose(place, matrices, "matrix")
        four = vector_of(value, 4)
        if four is not None:
            return _Pose(place, four, "quaternion-xyzw" if isinstance(value, dict) else UNKNOWN)
        three = vector_of(value, 3)
        if three is not None:
            return _Pose(place, three, "rotation-vector" if key in _VECTORS else UNKNOWN)
    return None


def _of_matrix(M: FloatArray) -> _Pose | None:
    """Return the pose of a matrix 4x4 or 3x4 row by row; None where its last row is another."""
    if M.shape[0] == 4 and not np.allclose(M[3], [0.0, 0.0, 0.0, 1.0]):
        return None
    return _Pose(M[:3, 3].copy(), M[:3, :3].ravel(), "matrix")


def _of_list(value: list[Any]) -> _Pose | None:
    """Return the pose of a list of numbers."""
    for shape in ((4, 4), (3, 4)):
        M = numbers(value, *shape)
        if M is not None:
            return _of_matrix(M)
    for count in (6, 7):
        row = numbers(value, count)
        if row is not None:
            return _Pose(row[:3], row[3:], UNKNOWN)
    return None


def _said(tree: Any) -> Convention:
    """Return what the keys beside the poses say of their form."""
    words = tree if isinstance(tree, dict) else {}

    def said(known: Mapping[str, str], *keys: str) -> str:
        for key in keys:
            word = re.sub(r"[^a-z]", "", str(words.get(key, "")).casefold())
            if word in known or word.removesuffix("s") in known:
                return known.get(word) or known[word.removesuffix("s")]
        return ""

    return Convention(
        said(_TYPES, "rot_type", "rotation_type", "orientation_type") or UNKNOWN,
        said(_ANGLES, "angle_unit", "rotation_unit", "angle_units"),
        said(_LENGTHS, "distance_unit", "translation_unit", "length_unit", "units", "unit"),
    )


def _together(
    path: Path, names: tuple[str, ...], poses: Sequence[_Pose], said: Convention
) -> WrittenPoses:
    place = Place(path, names=tuple(name or f"pose {i + 1}" for i, name in enumerate(names)))
    for i, pose in enumerate(poses):
        if pose.turn != poses[0].turn or len(pose.numbers) != len(poses[0].numbers):
            raise place.error(i, "has another form than the first", hint="give all in one form")
    turn, _, inverse = poses[0].turn.partition(",")
    count = len(poses[0].numbers)
    if turn == UNKNOWN:
        fits = said.turn != UNKNOWN and ("quaternion" in said.turn) == (count == 4)
        turn = said.turn if fits else UNKNOWN
    angle = "rad" if not said.angle and turn == "rotation-vector" else said.angle
    convention = Convention(turn, angle, said.length, bool(inverse))
    return WrittenPoses(
        place,
        np.stack([pose.place for pose in poses]),
        np.stack([pose.numbers for pose in poses]),
        convention,
        names if any(names) else (),
    )
