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
    from calib.vision.camera.conic import (
        circle_center,
        circle_center_bias,
        circle_image,
        circle_poses,
        ellipse_axes,
    )
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
    from calib.vision.camera.rendering import Glare, Imaging, Occluder, render
    from calib.vision.camera.target import CircleTarget
    from calib.vision.camera.target_pose import TargetPose, pose_from_image, pose_from_points

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
    name: f"{__name__}.{module}"
    for module, names in {
        "circle_pose": ("circle_center", "circle_center_bias", "circle_poses"),
        "conic": ("circle_image", "ellipse_axes"),
        "ellipse": ("EllipseMeasurement", "measure_ellipse"),
        "lens": ("Camera", "PinholeCamera"),
        "observers": (
            "FastObserver",
            "ImageObserver",
            "MeasurementNoise",
            "Observer",
            "Views",
            "make_observer",
            "noise_from_images",
        ),
        "pattern_pose": ("pose_from_image",),
        "pnp": ("TargetPose", "pose_from_points"),
        "rendering": ("Glare", "Imaging", "Occluder", "render"),
        "target": ("CircleTarget",),
    }.items()
    for name in names
}


def __getattr__(name: str) -> object:
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module 'calib.vision.camera' has no attribute {name!r}")
