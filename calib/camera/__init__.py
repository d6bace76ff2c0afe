"""The camera on the tool, and what it sees.

Planning needs no more than :class:`PinholeCamera`. :class:`Camera` adds the lens,
:class:`CircleTarget` what is looked at, :func:`render` the image, :func:`measure_ellipse` what is
measured in it. A simulation takes an :class:`Observer`: through images, or fast without.

Names are loaded when they are first used: planning must not wait for OpenCV.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calib.camera.circle_pose import circle_center, circle_center_bias, circle_poses
    from calib.camera.conic import circle_image, ellipse_axes
    from calib.camera.ellipse import EllipseMeasurement, measure_ellipse
    from calib.camera.lens import Camera
    from calib.camera.observers import (
        FastObserver,
        ImageObserver,
        MeasurementNoise,
        Observer,
        Views,
        make_observer,
        noise_from_images,
    )
    from calib.camera.pattern_pose import pose_from_image
    from calib.camera.pinhole import PinholeCamera
    from calib.camera.pnp import TargetPose, pose_from_points
    from calib.camera.rendering import Glare, Imaging, Occluder, render
    from calib.camera.target import CircleTarget

__all__ = [
    "Camera",
    "CircleTarget",
    "EllipseMeasurement",
    "FastObserver",
    "Glare",
    "ImageObserver",
    "Imaging",
    "MeasurementNoise",
    "Observer",
    "Occluder",
    "PinholeCamera",
    "TargetPose",
    "Views",
    "circle_center",
    "circle_center_bias",
    "circle_image",
    "circle_poses",
    "ellipse_axes",
    "make_observer",
    "measure_ellipse",
    "noise_from_images",
    "pose_from_image",
    "pose_from_points",
    "render",
]

_WHERE = {
    "Camera": "calib.camera.lens",
    "CircleTarget": "calib.camera.target",
    "EllipseMeasurement": "calib.camera.ellipse",
    "FastObserver": "calib.camera.observers",
    "Glare": "calib.camera.rendering",
    "ImageObserver": "calib.camera.observers",
    "Imaging": "calib.camera.rendering",
    "MeasurementNoise": "calib.camera.observers",
    "Observer": "calib.camera.observers",
    "Occluder": "calib.camera.rendering",
    "PinholeCamera": "calib.camera.pinhole",
    "TargetPose": "calib.camera.pnp",
    "Views": "calib.camera.observers",
    "circle_center": "calib.camera.circle_pose",
    "circle_center_bias": "calib.camera.circle_pose",
    "circle_image": "calib.camera.conic",
    "circle_poses": "calib.camera.circle_pose",
    "ellipse_axes": "calib.camera.conic",
    "make_observer": "calib.camera.observers",
    "measure_ellipse": "calib.camera.ellipse",
    "noise_from_images": "calib.camera.observers",
    "pose_from_image": "calib.camera.pattern_pose",
    "pose_from_points": "calib.camera.pnp",
    "render": "calib.camera.rendering",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'calib.camera' has no attribute {name!r}")
