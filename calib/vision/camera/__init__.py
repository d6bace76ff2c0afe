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
    from calib.vision.camera.circle_pose import circle_center, circle_center_bias, circle_poses
    from calib.vision.camera.conic import circle_image, ellipse_axes
    from calib.vision.camera.ellipse import EllipseMeasurement, measure_ellipse
    from calib.vision.camera.lens import Camera, PinholeCamera
    from calib.vision.camera.observers import (
        FastObserver,
        ImageObserver,
        MeasurementNoise,
        Observer,
        Views,
        make_observer,
        noise_from_images,
    )
    from calib.vision.camera.pattern_pose import pose_from_image
    from calib.vision.camera.pnp import TargetPose, pose_from_points
    from calib.vision.camera.rendering import Glare, Imaging, Occluder, render
    from calib.vision.camera.target import CircleTarget

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
    "Camera": "calib.vision.camera.lens",
    "CircleTarget": "calib.vision.camera.target",
    "EllipseMeasurement": "calib.vision.camera.ellipse",
    "FastObserver": "calib.vision.camera.observers",
    "Glare": "calib.vision.camera.rendering",
    "ImageObserver": "calib.vision.camera.observers",
    "Imaging": "calib.vision.camera.rendering",
    "MeasurementNoise": "calib.vision.camera.observers",
    "Observer": "calib.vision.camera.observers",
    "Occluder": "calib.vision.camera.rendering",
    "PinholeCamera": "calib.vision.camera.lens",
    "TargetPose": "calib.vision.camera.pnp",
    "Views": "calib.vision.camera.observers",
    "circle_center": "calib.vision.camera.circle_pose",
    "circle_center_bias": "calib.vision.camera.circle_pose",
    "circle_image": "calib.vision.camera.conic",
    "circle_poses": "calib.vision.camera.circle_pose",
    "ellipse_axes": "calib.vision.camera.conic",
    "make_observer": "calib.vision.camera.observers",
    "measure_ellipse": "calib.vision.camera.ellipse",
    "noise_from_images": "calib.vision.camera.observers",
    "pose_from_image": "calib.vision.camera.pattern_pose",
    "pose_from_points": "calib.vision.camera.pnp",
    "render": "calib.vision.camera.rendering",
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'calib.vision.camera' has no attribute {name!r}")
