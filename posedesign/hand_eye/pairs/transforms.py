"""X and Z in the files of other programs: ROS, URDF, MoveIt, easy_handeye2, OpenCV.

Frames have the names of the robot's tree where these are known (:class:`FrameNames`), else those
of `FRAMES`.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from typing import Protocol

import numpy as np
import yaml

from calib.errors import InputError, near_names
from calib.se3 import FloatArray, quaternion_from_rotation, wpr_from_rotation
from posedesign.files import Claim, Results, write_json_atomic, write_text_atomic
from posedesign.hand_eye.pairs.certificate import FRAMES, Camera

DIGITS = 9
"""Decimals of metres and of quaternions: far below what anything measures."""

TRANSFORMS = (
    ("transforms.launch.xml", "static transforms for ROS 2"),
    ("camera.launch", "camera pose for ROS 1"),
    ("camera.urdf", "camera joint for URDF"),
    ("camera.calib", "camera pose for easy_handeye2"),
    ("transforms.json", "matrices for OpenCV"),
)
"""Names of the files, and what they say that they are."""


_FRAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,99}(?:/[A-Za-z0-9_.-]{1,100}){0,5}")
"""Name of a frame that tf2 takes and that is one word in XML and in a shell: tf2 refuses names that
are empty or begin with a slash (``validateFrameId`` of its ``buffer_core.cpp``)."""


@dataclass(frozen=True)
class FrameNames:
    """Names of the four frames in the files of other programs."""

    base: str = "base"
    flange: str = "flange"
    camera: str = "camera"
    target: str = "target"

    def of(self, frame: str) -> str:
        """Return the name of a frame of `FRAMES`; any other one as it is."""
        return str(getattr(self, frame)) if frame in FRAME_KEYS else frame

    def arm(self, base: str, flange: str) -> FrameNames:
        """Return the names with those of the links of an arm, where a frame may be called so."""
        if base == flange or not (_FRAME.fullmatch(base) and _FRAME.fullmatch(flange)):
            return self
        return replace(self, base=base, flange=flange)

    def said(self, words: Iterable[str]) -> FrameNames:
        """Return the names with those that words such as ``base=base_link`` say.

        Raises
        ------
        InputError
            A frame that is not known or is named twice, a name that ROS does not take, or one name
            for two frames.
        """
        given: dict[str, str] = {}
        for word in words:
            frame, mark, name = (part.strip() for part in word.partition("="))
            fault, hint = "", f"say {_EXAMPLE}"
            if not mark:
                fault = f"{word!r} is not a frame and its name"
            elif frame not in FRAME_KEYS:
                fault, hint = f"there is no frame {frame!r}", near_names(frame, FRAME_KEYS)
            elif frame in given:
                fault, hint = f"{frame} is named twice", "name it once"
            elif not _FRAME.fullmatch(name):
                fault = f"ROS takes no frame {name!r}"
                hint = "name it with letters, digits, _ - . and / between them, not before them"
            if fault:
                raise InputError(f"`frames`: {fault}", hint=hint, name="frames", value=word)
            given[frame] = name
        found = replace(self, **given)
        names = [found.of(frame) for frame in FRAME_KEYS]
        double = next((name for name in names if names.count(name) > 1), None)
        if double is not None:
            both = " and ".join(frame for frame in FRAME_KEYS if found.of(frame) == double)
            raise InputError(
                f"`frames`: {both} are both called {double}",
                hint="give each frame a name of its own",
                name="frames",
                value=double,
            )
        return found


FRAME_KEYS = tuple(field.name for field in fields(FrameNames))
"""Frames that can be given a name."""

_EXAMPLE = "base=base_link,flange=tool0,camera=camera_optical_frame,target=tag"


def claim_transforms(out: Results) -> list[Claim]:
    """Claim the files before the work."""
    return out.claim("computed", *TRANSFORMS)


def opencv_matrix(M: FloatArray) -> dict[str, object]:
    """A matrix in the JSON of OpenCV's persistence, row by row."""
    rows, columns = M.shape
    return {"type_id": "opencv-matrix", "rows": rows, "cols": columns, "dt": "d", "data": M.ravel()}


class Solved(Protocol):
    """What has an X and a Z ``(4, 4)`` [m]."""

    @property
    def X(self) -> FloatArray: ...
    @property
    def Z(self) -> FloatArray: ...


def write_transforms(
    claims: list[Claim], result: Solved, camera: Camera, names: FrameNames | None = None
) -> None:
    """Write X and Z for ROS 2 and OpenCV, and where the camera is for the others.

    - ``transforms.launch.xml``: ``ros2 launch`` of it publishes both with tf2's
      ``static_transform_publisher`` (its options since ROS 2 Humble).
    - ``camera.launch``: ``roslaunch`` of it publishes where the camera is, in the form in which
      MoveIt's calibration saves the camera's pose (``x y z qx qy qz qw parent child``, as tf2's
      publisher takes them in ROS 1).
    - ``camera.urdf``: the camera's link and its fixed joint, for a ``xacro:include`` in the robot's
      description, which has the parent link.
    - ``camera.calib``: in ``~/.ros2/easy_handeye2/calibrations``, for ``ros2 launch easy_handeye2
      publish.launch.py name:=camera``. The keys are those of its messages ``HandeyeCalibration``
      and ``HandeyeCalibrationParameters``; its publisher takes the effector as parent for
      ``eye_in_hand``, else the base, and ``tracking_base_frame`` as child (easy_handeye2,
      ``handeye_calibration.py``, ``handeye_publisher.py``).
    - ``transforms.json``: matrices [m] for ``cv2.FileStorage``, row by row, in the JSON form of
      OpenCV's persistence; the keys are names such as ``T_flange_camera``. Where frames have other
      names than in the keys, ``frames`` has them.

    ``names``: of the frames in the robot's tree.
    """
    names = names or FrameNames()
    frames = FRAMES[camera]
    named = {
        title.partition(":")[0]: T for title, T in ((frames.X, result.X), (frames.Z, result.Z))
    }
    launch, ros_1, urdf, easy_handeye2, opencv = claims
    seen = "T_flange_camera" if camera == "on-flange" else "T_base_camera"
    parent, child = (names.of(frame) for frame in seen.split("_")[1:])
    nodes = []
    for name, T in named.items():
        a, b = (names.of(frame) for frame in name.split("_")[1:])
        arguments = forms_of(T, a, b)["ROS 2"].partition("static_transform_publisher ")[2]
        node = f"{_word(a)}_to_{_word(b)}"
        nodes.append(
            f'  <node pkg="tf2_ros" exec="static_transform_publisher" name="{node}"\n'
            f'        args="{arguments}"/>\n'
        )
    write_text_atomic(launch, f"<launch>\n{''.join(nodes)}</launch>\n")
    placed = forms_of(named[seen], parent, child)
    numbers = placed["x y z [m], quaternion x y z w"].replace(",", "")
    write_text_atomic(
        ros_1,
        '<launch>\n  <node pkg="tf2_ros" type="static_transform_publisher" '
        f'name="camera_link_broadcaster"\n        args="{numbers} {parent} {child}"/>\n</launch>\n',
    )
    write_text_atomic(
        urdf,
        f'<robot name="camera">\n  <link name="{child}"/>\n'
        f'  <joint name="{parent}_to_{child}" type="fixed">\n'
        f'    <parent link="{parent}"/>\n    <child link="{child}"/>\n'
        f"    {placed['URDF']}\n  </joint>\n</robot>\n",
    )
    write_text_atomic(easy_handeye2, _easy_handeye2(named[seen], camera, names))
    called = {} if names == FrameNames() else {"frames": {key: names.of(key) for key in FRAME_KEYS}}
    matrices = {name: opencv_matrix(T) for name, T in named.items()}
    write_json_atomic(opencv, {**matrices, **called})


def _word(frame: str) -> str:
    """Return the name of a frame as a part of the name of a node of ROS 2."""
    return re.sub(r"\W", "_", frame, flags=re.ASCII)


def _easy_handeye2(T: FloatArray, camera: Camera, names: FrameNames) -> str:
    """A calibration of easy_handeye2: YAML of its message, quaternion x y z w."""
    w, x, y, z = quaternion_from_rotation(T[:3, :3]).tolist()
    content = {
        "parameters": {
            "name": "camera",
            "calibration_type": "eye_in_hand" if camera == "on-flange" else "eye_on_base",
            "robot_base_frame": names.base,
            "robot_effector_frame": names.flange,
            "tracking_base_frame": names.camera,
            "tracking_marker_frame": names.target,
        },
        "transform": {
            "translation": dict(zip("xyz", T[:3, 3].tolist(), strict=True)),
            "rotation": {"x": x, "y": y, "z": z, "w": w},
        },
    }
    return str(yaml.safe_dump(content, sort_keys=False))


def forms_of(T: FloatArray, parent: str, child: str) -> dict[str, str]:
    """The transform ``T_parent_child`` (4, 4) [m] as text, by the name of the form.

    ROS names frames from the parent: its static transform ``parent -> child`` is the place of the
    child in the parent, which is this one (REP 103, 105; tf2's ``static_transform_publisher``).
    """
    w, x, y, z = (_plain(value) for value in quaternion_from_rotation(T[:3, :3]))
    place = [_plain(value) for value in T[:3, 3]]
    roll, pitch, yaw = (_plain(value) for value in wpr_from_rotation(T[:3, :3]))
    rows = (", ".join(_plain(value) for value in row) for row in T)
    turned = f"--qx {x} --qy {y} --qz {z} --qw {w}"
    moved = " ".join(f"--{axis} {value}" for axis, value in zip("xyz", place, strict=True))
    return {
        "matrix [m]": "[" + ", ".join(f"[{row}]" for row in rows) + "]",
        "x y z [m], quaternion x y z w": ", ".join([*place, x, y, z, w]),
        "ROS 2": f"ros2 run tf2_ros static_transform_publisher {moved} {turned} "
        f"--frame-id {parent} --child-frame-id {child}",
        "URDF": f'<origin xyz="{" ".join(place)}" rpy="{roll} {pitch} {yaw}"/>',
    }


def _plain(value: float) -> str:
    """A number in decimals, without an exponent and without minus zero."""
    return np.format_float_positional(round(float(value), DIGITS) + 0.0, trim="-")
