"""OpenCV's closed forms of A X = Z B and A X = X B, given what their documentation asks for.

A is ``T_base_flange``, B ``T_target_camera``; X is ``T_flange_camera``, Z ``T_base_target``.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from calib import se3
from calib.se3 import FloatArray

ROBOT_WORLD = {"SHAH": "shah", "LI": "li-kronecker"}
HAND_EYE = {
    "TSAI": "tsai-lenz",
    "PARK": "park-martin",
    "HORAUD": "horaud-dornaika",
    "ANDREFF": "andreff",
    "DANIILIDIS": "daniilidis",
}
"""OpenCV's methods, with the names that the same ones have here."""

Answer = tuple[FloatArray, FloatArray | None]


def caller(name: str, A: FloatArray, B: FloatArray) -> Callable[[], Answer]:
    """What solves pairs ``(N, 4, 4)``, its lists made beforehand: X, and Z or None ``(4, 4)``."""
    flange, seen = _lists(A), _lists(se3.inverse(B))
    if name in HAND_EYE:
        number = getattr(cv2, f"CALIB_HAND_EYE_{name}")
        return lambda: (_joined(*cv2.calibrateHandEye(*flange, *seen, method=number)), None)
    number = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
    to_flange = _lists(se3.inverse(A))

    def robot_world() -> Answer:
        found = cv2.calibrateRobotWorldHandEye(*seen, *to_flange, method=number)
        T_target_base, T_camera_flange = _joined(*found[:2]), _joined(*found[2:])
        return np.linalg.inv(T_camera_flange), np.linalg.inv(T_target_base)

    return robot_world


def _lists(T: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    return list(T[:, :3, :3]), list(T[:, :3, 3])


def _joined(R: FloatArray, p: FloatArray) -> FloatArray:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R, p.ravel()
    return T
