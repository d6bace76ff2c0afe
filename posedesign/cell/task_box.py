"""Accuracy to expect over the volume that an arm works in, before it is measured.

Points of a box, the tool oriented as at the base pose: each is reached with the posture nearest to
the base posture, and the covariance of the plan is carried there
(:mod:`calib.identification.prediction`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError, UnreachableError
from calib.identification import ExpectedError, tool_motion
from calib.identification.prediction import PLACED_BASE, placed_anew
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Setup
from calib.se3 import BoolArray, FloatArray, skew
from calib.shown import Shown
from posedesign.cell.cell import Cell
from posedesign.cell.orientations import poses_about_tool
from posedesign.constraints import Postures, nearest_postures

MOST_POINTS = 20_000
LARGEST_MM = 1e6

BOX_OF_REACH = 0.1
"""Part of the reach that the usual task box extends to each side of the target."""


@dataclass(frozen=True, eq=False)
class TaskBox:
    """A box along the axes of the base, and how many points of it are looked at."""

    lowest_m: FloatArray
    highest_m: FloatArray  # lowest_m, highest_m (3,): corners in the base frame [m]
    steps: tuple[int, int, int] = (3, 3, 3)
    """Points along x, y and z, the faces included; 1 is the middle."""

    def __post_init__(self) -> None:
        corners = np.array([self.lowest_m, self.highest_m], dtype=float)
        if corners.shape != (2, 3) or not (np.abs(corners) <= LARGEST_MM / 1e3).all():
            raise InputError(
                "a task box needs two corners of three numbers", hint="in mm", name="task_box"
            )
        for axis, low, high in zip("xyz", *corners.tolist(), strict=True):
            if low > high:
                raise InputError(
                    f"the task box is upside down along {axis}: {low * 1e3:g} is above "
                    f"{high * 1e3:g}",
                    hint="give the lowest corner first",
                    name="task_box",
                )
        if min(self.steps) < 1 or np.prod(self.steps, dtype=float) > MOST_POINTS:
            raise InputError(
                f"a task box of {' x '.join(map(str, self.steps))} points: at least one along "
                f"each axis, {MOST_POINTS} in all",
                name="steps",
            )
        object.__setattr__(self, "lowest_m", corners[0])
        object.__setattr__(self, "highest_m", corners[1])

    @classmethod
    def of_text(cls, text: str, steps: tuple[int, int, int] = (3, 3, 3)) -> TaskBox:
        """The box of six numbers with commas between them: its lowest, then its highest corner.

        Raises
        ------
        InputError
        """
        try:
            numbers = np.array([float(word) for word in text.split(",")])
        except ValueError:
            numbers = np.empty(0)
        if numbers.shape != (6,) or not np.isfinite(numbers).all():
            raise InputError(
                f"the box {text[:60]!r} is not six numbers",
                hint='give the corners in mm: "x1,y1,z1,x2,y2,z2"',
                name="box",
            )
        return cls(numbers[:3] / 1e3, numbers[3:] / 1e3, steps)

    @property
    def points_m(self) -> FloatArray:
        """Its points ``(N, 3)`` [m] in the base frame; z goes fastest."""
        pairs = zip(self.lowest_m, self.highest_m, self.steps, strict=True)
        axes = [np.linspace(a, b, k) if k > 1 else np.array([(a + b) / 2]) for a, b, k in pairs]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


@dataclass(frozen=True, eq=False, repr=False)
class BoxAccuracy(Shown):
    """Predicted accuracy of the tool point over a task box."""

    points_m: FloatArray  # (N, 3) [m], in the base frame
    postures: FloatArray  # (N, n) [rad]; NaN where there is none
    covariance: FloatArray
    """(N, 3, 3): of the position of the tool point [m²], base axes; NaN without a posture."""
    to_target_m: FloatArray
    """(N,): root mean square error [m] of the vector from the target, as identified, to the tool
    point, the base turned anew about the target; NaN without a posture."""
    reasons: tuple[str, ...]  # why a point cannot be reached; empty where it can
    reference: str  # what the accuracy is one against, in words
    expected: ExpectedError | None = None
    """Its root mean square over the points reached, with its range over arms; None of a model that
    is taken to be all that is off."""

    @property
    def reached(self) -> BoolArray:
        """Whether each point can be reached, ``(N,)``."""
        return np.array([not reason for reason in self.reasons], dtype=bool)

    @property
    def sigma_m(self) -> FloatArray:
        """Standard deviations ``(N, 3)`` [m] along x, y and z of the base."""
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def worst_m(self) -> FloatArray:
        """Standard deviation ``(N,)`` [m] along the axis in which it is largest."""
        out = np.full(len(self.points_m), np.nan)
        found = np.linalg.eigvalsh(self.covariance[self.reached])
        out[self.reached] = np.sqrt(np.maximum(found[:, -1], 0.0))
        return out

    @property
    def rms_m(self) -> FloatArray:
        """Root mean square distance ``(N,)`` [m] from where the tool point should be."""
        return np.asarray(np.sqrt(np.trace(self.covariance, axis1=1, axis2=2)))

    def rows(self) -> list[dict[str, object]]:
        """One row a point, in mm."""
        columns = np.column_stack(
            [self.points_m, self.sigma_m, self.worst_m, self.rms_m, self.to_target_m]
        )
        return [
            {
                **{key: _or_none(v) for key, v in zip(COLUMNS, row, strict=True)},
                "reason": reason,
            }
            for row, reason in zip((1e3 * columns).tolist(), self.reasons, strict=True)
        ]

    @property
    def headline(self) -> str:
        return self.summary()

    def summary(self) -> str:
        """Best, middle and worst of the box in one line."""
        rms = 1e3 * self.rms_m[self.reached]
        return (
            f"{self.reached.sum()} of {len(self.points_m)} points reached: rms "
            f"{rms.min():.4f} to {rms.max():.4f} mm, {np.median(rms):.4f} mm in the median"
        )


COLUMNS = (
    *("x_mm", "y_mm", "z_mm"),
    *("sigma_x_mm", "sigma_y_mm", "sigma_z_mm"),
    *("worst_sigma_mm", "rms_mm", "rms_to_target_mm"),
)


def _or_none(value: float) -> float | None:
    return value if np.isfinite(value) else None


def predict_box(
    cell: Cell,
    arms: PriorArms,
    blocks: FloatArray,
    box: TaskBox,
) -> BoxAccuracy:
    """Predict the error of the tool point at the points of a box, once blocks have been measured.

    The base is placed anew over all points, see :mod:`calib.identification.prediction`.

    Parameters
    ----------
    cell : Cell
        Whose limits and solids decide what can be reached.
    arms : PriorArms
    blocks : array (N, m, p)
        Whitened, of the measuring poses: as :meth:`PriorArms.blocks` has them.

    Raises
    ------
    UnreachableError
        No point of the box can be reached.
    """
    found, model, C = reached_points(cell, box), arms.model, arms.covariance(blocks)
    there = found.feasible
    at, q = Setup.of(int(there.sum())), found.q[there]
    points = model.view(q, None, at).tool_points
    motion = placed_anew(tool_motion(model, q, at), points)
    spread = np.full((len(found.q), 3, 3), np.nan)
    spread[there] = motion @ C @ np.swapaxes(motion, -1, -2)
    apart = tool_motion(model, q, at, against="target").reshape(-1, model.p)
    turns = np.linalg.qr(-skew(points - cell.target_m).reshape(-1, 3))[0]
    apart -= turns @ (turns.T @ apart)
    squares = np.sum((apart @ C) * apart, axis=1).reshape(-1, 3).sum(axis=1)
    to_target = np.full(len(found.q), np.nan)
    to_target[there] = np.sqrt(squares)
    expected = arms.expected_error(blocks, motion)
    return BoxAccuracy(
        box.points_m, found.q, spread, to_target, found.reasons, PLACED_BASE, expected
    )


def box_functions(cell: Cell, model: CalibrationModel, box: TaskBox) -> FloatArray:
    """How the tool point moves with the parameters at the points of a box, ``(K, 3, p)``.

    In base axes [m per unit], at the points that can be reached: the functions whose deviations
    are the accuracy over the box.

    Raises
    ------
    UnreachableError
        No point of the box can be reached.
    """
    found = reached_points(cell, box)
    return tool_motion(model, found.q[found.feasible])


def reached_points(cell: Cell, box: TaskBox) -> Postures:
    """Postures at the points of a box, the tool oriented as at the base pose.

    Raises
    ------
    UnreachableError
        No point of the box can be reached.
    """
    points = box.points_m
    R = np.tile(cell.robot.fk(cell.base_posture)[:3, :3], (len(points), 1, 1))
    near = cell.base_posture
    poses = poses_about_tool(cell.robot, R, cell.tool_m, points, near, cell.passing.margin)
    found = nearest_postures(cell.passing, poses, cell.base_posture)
    if not found.feasible.any():
        raise UnreachableError(
            f"no point of the task box can be reached: {found.reasons[0]}",
            hint="give a box in mm, in the base frame, in front of the arm; the tool is oriented "
            "as at the base pose",
            name="task_box",
        )
    return found
