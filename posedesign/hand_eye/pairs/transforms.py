"""X and Z in the files of other programs: ROS, URDF, MoveIt, easy_handeye2, OpenCV.

Frames are named as in `FRAMES`; who loads a file gives them the names of the robot's own tree.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
import yaml

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


def write_transforms(claims: list[Claim], result: Solved, camera: Camera) -> None:
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
      OpenCV's persistence; the keys are names such as ``T_flange_camera``.
    """
    frames = FRAMES[camera]
    named = {
        title.partition(":")[0]: T for title, T in ((frames.X, result.X), (frames.Z, result.Z))
    }
    launch, ros_1, urdf, easy_handeye2, opencv = claims
    seen = "T_flange_camera" if camera == "on-flange" else "T_base_camera"
    parent = seen.split("_")[1]
    nodes = []
    for name, T in named.items():
        _, a, b = name.split("_")
        arguments = forms_of(T, a, b)["ROS 2"].partition("static_transform_publisher ")[2]
        nodes.append(
            f'  <node pkg="tf2_ros" exec="static_transform_publisher" name="{a}_to_{b}"\n'
            f'        args="{arguments}"/>\n'
        )
    write_text_atomic(launch, f"<launch>\n{''.join(nodes)}</launch>\n")
    placed = forms_of(named[seen], parent, "camera")
    numbers = placed["x y z [m], quaternion x y z w"].replace(",", "")
    write_text_atomic(
        ros_1,
        '<launch>\n  <node pkg="tf2_ros" type="static_transform_publisher" '
        f'name="camera_link_broadcaster"\n        args="{numbers} {parent} camera"/>\n</launch>\n',
    )
    write_text_atomic(
        urdf,
        '<robot name="camera">\n  <link name="camera"/>\n'
        f'  <joint name="{parent}_to_camera" type="fixed">\n'
        f'    <parent link="{parent}"/>\n    <child link="camera"/>\n'
        f"    {placed['URDF']}\n  </joint>\n</robot>\n",
    )
    write_text_atomic(easy_handeye2, _easy_handeye2(named[seen], camera))
    write_json_atomic(opencv, {name: opencv_matrix(T) for name, T in named.items()})


def _easy_handeye2(T: FloatArray, camera: Camera) -> str:
    """A calibration of easy_handeye2: YAML of its message, quaternion x y z w."""
    w, x, y, z = quaternion_from_rotation(T[:3, :3]).tolist()
    content = {
        "parameters": {
            "name": "camera",
            "calibration_type": "eye_in_hand" if camera == "on-flange" else "eye_on_base",
            "robot_base_frame": "base",
            "robot_effector_frame": "flange",
            "tracking_base_frame": "camera",
            "tracking_marker_frame": "target",
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
