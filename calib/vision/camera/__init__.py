"""The camera on the tool, and what it sees.

Planning needs no more than :class:`PinholeCamera`. :class:`Camera` adds the lens,
:class:`CircleTarget` what is looked at, :func:`render` the image, :func:`measure_ellipse` what is
measured in it. A simulation takes an :class:`Observer`: through images, or fast without.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

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
    from calib.vision.camera.target import CircleTarget, pose_from_image
    from calib.vision.camera.target_pose import TargetPose, pose_from_points
else:
    __getattr__ = load_when_asked(__name__)

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
