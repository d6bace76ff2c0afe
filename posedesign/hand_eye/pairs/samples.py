"""Samples of hand-eye calibrations as MoveIt and easy_handeye save them.

All are in metres, and say what their frames are, so that A and B of A X = Z B follow from where the
camera is: with it on the flange B is ``T_target_camera``, with a fixed one ``T_camera_target``.

MoveIt
    A list of maps with ``effector_wrt_world`` (``T_base_flange``) and ``object_wrt_sensor``
    (``T_camera_target``), each of 16 numbers row by row: "Save samples" of moveit_calibration
    (``handeye_control_widget.cpp``). Its test data in JSON has lists of the two as 4x4
    (``pose_samples.json``).
easy_handeye2
    ``samples``, a list of maps with ``robot`` and ``tracking``, each a message
    ``geometry_msgs/Transform``, and ``parameters`` with ``calibration_type``
    (``easy_handeye2_msgs/Sample``).
easy_handeye
    ``hand_world_samples`` and ``camera_marker_samples``, lists of such messages
    (``easy_handeye_msgs/SampleList``), as its services answer.

Both easy_handeye look up ``robot`` the other way round where the camera is fixed: there it is
``T_flange_base`` (``handeye_sampler.py``).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, inverse, transform
from posedesign.files.trees import numbers
from posedesign.hand_eye.pairs.certificate import Camera
from posedesign.hand_eye.pairs.forms import (
    Place,
    Poses,
    check_lengths,
    refuse_endless,
    rotations_from_quaternions,
    transforms_from_matrices,
)

_MOVEIT = ("effector_wrt_world", "object_wrt_sensor")
_EASY = ("hand_world_samples", "camera_marker_samples")
_TYPES = {"eye_in_hand": "on-flange", "eye_on_hand": "on-flange", "eye_on_base": "fixed"}
"""Where the camera is by the words of easy_handeye2, and where its older versions said it."""


@dataclass(frozen=True)
class Samples:
    """Both sides of a file of samples, as A X = Z B takes them."""

    a: Poses
    b: Poses


def samples_of(tree: Any, path: Path, camera: Camera, *, trust_units: bool) -> Samples | None:
    """The samples of a file, of which `read_tree` is known; None where they are none of these."""
    found = _sides_of(tree)
    if found is None:
        return None
    robot, seen, names, inverted = found
    said = _TYPES.get(str(_at(_at(tree, "parameters"), "calibration_type")))
    if said not in (None, camera):
        raise InputError(
            f"{path} says that the camera is {'fixed' if said == 'fixed' else 'on the flange'}",
            hint=f"say `camera` {said}",
            name="camera",
        )
    a = _poses(robot, Place(path, variable=names[0], marks=("[", "]"), first=0), trust_units)
    b = _poses(seen, Place(path, variable=names[1], marks=("[", "]"), first=0), trust_units)
    if said is None:  # a wrong guess may fit, too, with X and Z in each other's place
        taken = "fixed" if camera == "fixed" else "on the flange"
        note = f"{path} does not say where the camera is: taken as {taken}, by `camera`"
        a = replace(a, notes=(note, *a.notes))
    if camera == "fixed":
        return Samples(replace(a, T=inverse(a.T)) if inverted else a, b)
    return Samples(a, replace(b, T=inverse(b.T)))


def _sides_of(tree: Any) -> tuple[list[Any], list[Any], Sequence[str], bool] | None:
    """Transforms of both sides, their names, and whether those of a fixed camera are inverted."""
    if isinstance(tree, list) and tree:
        if all(isinstance(item, dict) and {*_MOVEIT} <= item.keys() for item in tree):
            robot, seen = ([item[name] for item in tree] for name in _MOVEIT)
            return robot, seen, _MOVEIT, False
        if all(isinstance(item, list) and len(item) == 2 for item in tree):
            return [item[0] for item in tree], [item[1] for item in tree], _MOVEIT, False
        return None
    samples = _at(tree, "samples")
    if isinstance(samples, list) and samples:
        optical = "tracking" if _at(samples[0], "tracking") is not None else "optical"
        robot, seen = ([_at(item, name) for item in samples] for name in ("robot", optical))
        return robot, seen, ("robot", optical), True
    robot, seen = (_at(_at(tree, "samples") or tree, name) for name in _EASY)
    robot, seen = (_at(side, "transforms") or side for side in (robot, seen))
    if isinstance(robot, list) and isinstance(seen, list) and robot:
        return robot, seen, _EASY, True
    return None


def _at(tree: Any, key: str) -> Any:
    return tree.get(key) if isinstance(tree, dict) else None


def _poses(given: list[Any], place: Place, trust_units: bool) -> Poses:
    found = [numbers(item, 4, 4) if isinstance(item, list) else _message(item) for item in given]
    shapes = [None if item is None else item.shape for item in found]
    odd = [i for i, shape in enumerate(shapes) if shape is None or shape != shapes[0]]
    if odd:
        raise place.error(
            odd[0],
            "is no transform: neither 16 numbers, nor a translation x y z and a rotation x y z w",
            hint="save the samples again, or take this one out",
        )
    T = np.stack([item for item in found if item is not None])
    if T.shape[1:] == (4, 4):
        T, note = transforms_from_matrices(T, place)
    else:
        R, note = rotations_from_quaternions(np.roll(T[:, 3:], 1, axis=-1), place, "rotation")
        T = transform(R, T[:, :3])
    refuse_endless(place, T[:, :3, 3])
    if not trust_units:
        check_lengths(place, T[:, :3, 3], "m", "divide them by 1000")
    notes = (f"{place.path}, {place.variable}: {note}",) if note else ()
    # nothing is said of other readings: the forms are fixed by who writes them
    return Poses(T, place, (), notes, "", np.zeros((len(T), 0)))


def _message(item: Any) -> FloatArray | None:
    """Translation and quaternion x y z w ``(7,)`` of a ``geometry_msgs/Transform``."""
    item = _at(item, "transform") or item
    moved, turned = _at(item, "translation"), _at(item, "rotation")
    return numbers([*(_at(moved, k) for k in "xyz"), *(_at(turned, k) for k in "xyzw")], 7)
