"""The camera on the tool, and what it sees.

Planning needs no more than :class:`PinholeCamera`. :class:`Camera` adds the lens,
:class:`CircleTarget` what is looked at, :func:`render` the image, :func:`measure_ellipse` what is
measured in it. A simulation takes an :class:`Observer`: through images, or fast without.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calib.doors import load_when_asked

if TYPE_CHECKING:
    from calib.vision.camera.conic import circle_center as circle_center
    from calib.vision.camera.conic import circle_center_bias as circle_center_bias
    from calib.vision.camera.conic import circle_image as circle_image
    from calib.vision.camera.conic import circle_poses as circle_poses
    from calib.vision.camera.conic import ellipse_axes as ellipse_axes
    from calib.vision.camera.ellipse import EllipseMeasurement as EllipseMeasurement
    from calib.vision.camera.ellipse import measure_ellipse as measure_ellipse
    from calib.vision.camera.lens import Camera as Camera
    from calib.vision.camera.lens import PinholeCamera as PinholeCamera
    from calib.vision.camera.observers import FastObserver as FastObserver
    from calib.vision.camera.observers import ImageObserver as ImageObserver
    from calib.vision.camera.observers import MeasurementNoise as MeasurementNoise
    from calib.vision.camera.observers import Observer as Observer
    from calib.vision.camera.observers import Views as Views
    from calib.vision.camera.observers import make_observer as make_observer
    from calib.vision.camera.observers import noise_from_images as noise_from_images
    from calib.vision.camera.rendering import Glare as Glare
    from calib.vision.camera.rendering import Imaging as Imaging
    from calib.vision.camera.rendering import Occluder as Occluder
    from calib.vision.camera.rendering import render as render
    from calib.vision.camera.target import CircleTarget as CircleTarget
    from calib.vision.camera.target import pose_from_image as pose_from_image
    from calib.vision.camera.target_pose import TargetPose as TargetPose
    from calib.vision.camera.target_pose import pose_from_points as pose_from_points
else:
    __getattr__ = load_when_asked(__name__)
