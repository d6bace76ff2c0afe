"""Zero offsets as a controller wants them: in its own signs, with its own coupling of joints.

An offset is added to what the pendant shows to get where the joint is. It goes through the same
matrix as joint values do: FANUC's J3 is the angle of the forearm to the horizontal, ``J3 = q3 -
q2``, so that its offset is that of joint 3 less that of joint 2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.model import CalibrationModel
from calib.robots import Robot
from calib.se3 import BoolArray, FloatArray

_STEM = "zero_offset."


@dataclass(frozen=True, eq=False)
class Mastering:
    """Corrections of the zero points of a robot, as its pendant shows joints.

    Attributes
    ----------
    robot : Robot
    correction : array (n,)
        To be added to what the pendant shows to get where each joint is [rad].
    sigma : array (n,)
        Standard deviation of each [rad]; NaN where it is not known.
    identified : array (n,) of bool
        Whether a joint's own zero offset was identified. Others count as none: target or tool
        take it up, or it was not asked for.
    bounded : bool
        Correlations were not known: where several offsets make one correction, its standard
        deviation is the largest that is possible.
    """

    robot: Robot
    correction: FloatArray
    sigma: FloatArray
    identified: BoolArray
    bounded: bool = False

    def rows(self) -> list[dict[str, object]]:
        """One row a joint of the pendant, in degrees."""
        return [
            {
                "pendant_joint": f"J{j + 1}",
                "joint": name,
                "correction_deg": float(np.rad2deg(self.correction[j])),
                "sigma_deg": self._sigma_deg(j),
                "meaning": self._meaning(j),
            }
            for j, name in enumerate(self.robot.joint_names)
        ]

    def _sigma_deg(self, j: int) -> float | None:
        known = self._is_corrected(j) and np.isfinite(self.sigma[j])
        return float(np.rad2deg(self.sigma[j])) if known else None

    def _is_corrected(self, j: int) -> bool:
        """Whether any offset that was identified has a part in a joint of the pendant."""
        return bool(self.identified[pendant_from_joints(self.robot)[j] != 0].any())

    def _meaning(self, j: int) -> str:
        """In one sentence."""
        matrix = pendant_from_joints(self.robot)
        others = [k for k in np.flatnonzero(matrix[j]) if k != j]
        shown = f"what the pendant shows as J{j + 1}"
        if self.robot.controller is None:
            shown = f"the value of {self.robot.joint_names[j]}, in the signs of the description"
        if not self._is_corrected(j):
            return f"J{j + 1} was not identified: its zero is taken as it is"
        degrees = float(np.rad2deg(self.correction[j]))
        text = f"add {degrees:+.4f} deg to {shown} to get where the joint is"
        parts = [f"{'less' if matrix[j, k] < 0 else 'plus'} the offset of J{k + 1}" for k in others]
        if parts:
            text += f": its own offset {' and '.join(parts)}"
        if not self.identified[j]:
            text += " (its own was not identified and counts as none)"
        return text


def pendant_from_joints(robot: Robot) -> FloatArray:
    """Joint values on the pendant ``(n, n)`` of those of the description; the same if not known."""
    return np.eye(robot.n) if robot.controller is None else robot.controller.pendant_from_joints


def mastering(
    model: CalibrationModel,
    x: FloatArray,
    covariance: FloatArray | None = None,
    sigma: FloatArray | None = None,
) -> Mastering:
    """Corrections of the zero points from what was identified.

    Parameters
    ----------
    model : CalibrationModel
    x : array (p,)
        Identified parameters [SI].
    covariance : array (p, p), optional
        [SI]
    sigma : array (p,), optional
        Standard deviations [SI], where correlations are not known.
    """
    robot = model.robot
    names = [f"{_STEM}{joint}" for joint in robot.joint_names]
    places = [model.names.index(name) if name in model.names else -1 for name in names]
    identified = np.array(places) >= 0
    at = np.array(places)[identified]
    matrix = pendant_from_joints(robot)
    through = matrix[:, identified]
    spread = np.full(robot.n, np.nan)
    if covariance is not None:
        spread = np.sqrt(np.einsum("ji,ik,jk->j", through, covariance[np.ix_(at, at)], through))
    elif sigma is not None:
        spread = np.abs(through) @ sigma[at]
    return Mastering(robot, through @ x[at], spread, identified, bounded=covariance is None)
