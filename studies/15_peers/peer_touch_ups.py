"""Touch-ups of the study: what everybody is given, and what they are judged by."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from calib import CalibrationModel, Robot
from calib.model import simulate
from calib.model.measurements import Measurements, TouchUp
from calib.model.parameters import TargetPoints, ToolPoint, ZeroOffsets
from calib.se3 import FloatArray, apply, rotation_exp, transform


@dataclass(frozen=True, eq=False)
class TouchUps:
    """Touch-ups of one unknown point by an arm with errors."""

    model: CalibrationModel
    """Four zero offsets [rad], the tool point and the target [m], in this order."""
    truth: FloatArray  # (10,)
    data: Measurements  # with T trials
    held: FloatArray  # (K, n): postures where the tool point is compared [rad]

    @classmethod
    def drawn(cls, own: Mapping[str, Any], noise: str, trials: int, seed: int) -> TouchUps:
        """The problem of the study with one of its noises."""
        robot, rng = Robot.preset(own["robot"]), np.random.default_rng(seed)
        home, tool = np.radians(own["home_deg"]), np.array(own["tool_m"])
        T_home = robot.fk(home)
        target, found = apply(T_home, tool), []
        while len(found) < own["poses"]:
            turn = rotation_exp(rng.uniform(-own["tilt_rad"], own["tilt_rad"], 3))
            R = T_home[:3, :3] @ turn
            q, ok = robot.inverse(transform(R, target - R @ tool)[None], near=home).nearest()
            if ok[0]:
                found.append(q[0])
        offsets = ZeroOffsets(robot, robot.joint_names[1:5])
        kind = TouchUp(1e-3 * np.array(own["noise_mm"][noise]))
        model = CalibrationModel(robot, [offsets, ToolPoint(tool), TargetPoints([target])], kind)
        frames = 1e-3 * rng.uniform(-own["frames_mm"], own["frames_mm"], 6)
        truth = model.nominal + np.concatenate([np.radians(own["offsets_deg"]), frames])
        data = simulate(model, truth, np.array(found), rng, trials=trials)
        spread = rng.uniform(-own["held_rad"], own["held_rad"], (own["held_postures"], robot.n))
        return cls(model, truth, data, home + spread)

    def postures(self, trial: int) -> FloatArray:
        """Joint values ``(N, n)`` [rad] of one trial."""
        return np.asarray(self.data.postures[trial])

    def tool_error_mm(self, x: FloatArray) -> float:
        """Root mean square by which the tool point is off where the arm was not measured."""
        points = [self.model.view(self.held, v).point for v in (x, self.truth)]
        return 1e3 * float(np.sqrt(np.mean(np.sum((points[0] - points[1]) ** 2, axis=0))))

    def unweighted(self, x: FloatArray, trial: int) -> float:
        """Sum of squared distances [mm²] of tool point and target: what others minimise."""
        return 1e6 * float(np.sum(self.model.predict(self.postures(trial), x) ** 2))
