"""What A, B, X and Z are called: camera on the flange, or fixed and looking at it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

Camera = Literal["on-flange", "fixed"]


@dataclass(frozen=True)
class Frames:
    """What the letters of A X = Z B mean.

    Attributes
    ----------
    A, B, X, Z : str
        Name of the transform and, in words, what it is.
    other_way : str
        What B often is in place of that, and what to do then.
    """

    A: str
    B: str
    X: str
    Z: str
    other_way: str


FRAMES: Mapping[Camera, Frames] = MappingProxyType(
    {
        "on-flange": Frames(
            A="T_base_flange: the flange in the base frame, as the controller shows it",
            B="T_target_camera: the camera in the frame of the target",
            X="T_flange_camera: the camera in the flange frame",
            Z="T_base_target: the target in the base frame",
            other_way="if B is T_camera_target, the target as the camera sees it (solvePnP, "
            "target2cam, tag detectors), pass --invert b",
        ),
        "fixed": Frames(
            A="T_base_flange: the flange in the base frame, as the controller shows it",
            B="T_camera_target: the target in the frame of the camera (solvePnP, target2cam)",
            X="T_flange_target: the target in the flange frame",
            Z="T_base_camera: the camera in the base frame",
            other_way="if B is T_target_camera, the camera in the frame of the target, pass "
            "--invert b",
        ),
    }
)
"""Frames of a camera on the flange that sees a fixed target, and of a fixed camera that sees a
target on the flange."""
