"""Poses of the target beside its touch-ups: pairs of A X = Z B out of the same pictures."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, inverse, rotation_exp, transform
from calib.vision.touch_up import Station
from calib.vision.touch_up.facing import camera_of
from calib.vision.touch_up.set_up import SetUp
from posedesign.cell import Cell
from posedesign.simulation import circle_target

_ROLL_STEP = np.deg2rad(5.0)
"""Turns of the pattern about its normal that are tried: its edges are found from that far off."""

_QUARTER = np.pi / 2.0
"""In which the pattern, a cross, looks the same."""


class TargetPoses:
    """Collects A = T_base_tip and B = T_target_camera at touched-up postures.

    Parameters
    ----------
    cell : Cell
        With camera and target as they were found.
    station : Station
    set_up : SetUp
    """

    def __init__(self, cell: Cell, station: Station, set_up: SetUp) -> None:
        self._robot = cell.robot
        self._station = station
        self._set_up = set_up
        self._target = circle_target(cell)
        self._camera = camera_of(set_up.jacobian)
        self._T_base_target: FloatArray | None = None
        self.names: list[str] = []
        self.A: list[FloatArray] = []
        self.B: list[FloatArray] = []

    def add(self, name: str, q: FloatArray) -> None:
        """Take the pose of the target from where the arm stands, touched up at ``(n,)`` [rad]."""
        T_base_tip = self._robot.fk(q)
        T_base_camera = T_base_tip @ self._set_up.T_tip_camera
        found = self._station.target_pose(
            f"{name} pose", self._camera, self._target, inverse(T_base_camera) @ self._guesses()
        )
        if found is None:
            return
        if self._T_base_target is None:
            self._T_base_target = T_base_camera @ found
        self.names.append(name)
        self.A.append(T_base_tip)
        self.B.append(inverse(found))

    def _guesses(self) -> FloatArray:
        """Where the target may be, ``(K, 4, 4)`` [m]: at first turned anyhow about its normal."""
        if self._T_base_target is not None:
            return self._T_base_target[None]
        normal = self._set_up.facing.normal
        aside = np.eye(3)[int(np.argmin(np.abs(normal)))]
        x = np.cross(aside, normal)
        x /= np.linalg.norm(x)
        R = np.column_stack([x, np.cross(normal, x), normal])
        rolls = np.arange(0.0, _QUARTER, _ROLL_STEP)
        turned = rotation_exp(rolls[:, None] * np.array([0.0, 0.0, 1.0]))
        return transform(R @ turned, np.tile(self._set_up.target_m, (len(rolls), 1)))
