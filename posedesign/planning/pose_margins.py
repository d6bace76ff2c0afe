"""How far poses are from what they must keep clear of, as the cell's own constraints say.

The checker gives the room inside each bound that the cell asks for. Here stand the distances
themselves, so that they can be read without knowing what was asked for.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from calib.se3 import BoolArray, FloatArray
from posedesign.constraints import (
    Checker,
    Collision,
    Constraint,
    Distance,
    InImage,
    SelfCollision,
    Tilt,
)
from posedesign.constraints.joints import CoupledLimits, JointLimits
from posedesign.motion.route import Route

if TYPE_CHECKING:
    from posedesign.cell import Cell

COLUMN_OF: dict[type[Constraint], str] = {
    Collision: "clearance_mm",
    SelfCollision: "self_clearance_mm",
    JointLimits: "limit_margin_deg",
    CoupledLimits: "limit_margin_deg",
    InImage: "view_margin_px",
    Tilt: "tilt_margin_deg",
    Distance: "camera_distance_margin_mm",
}
"""The column of each constraint; of those that share one, the smaller counts."""

MARGIN_COLUMNS = tuple(dict.fromkeys(COLUMN_OF.values()))

CLEARANCE_DECIMALS = 6
"""Of clearances in mm. They are found by iteration: what comes after that depends on what was
looked at before, and would be another after a stop."""


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of poses, by the column that they stand in.

    ``columns`` (S,): in the unit that the name ends with; NaN where a pose has none. Only columns
    that the cell knows of are there. Negative where a bound is broken.
    """

    columns: Mapping[str, FloatArray]

    @classmethod
    def of(cls, cell: Cell, postures: FloatArray, via: BoolArray) -> Margins:
        """Margins of postures ``(S, n)`` [rad]; those passed through have none of the view."""
        found: dict[str, FloatArray] = {}
        for checker, rows in (
            (cell.checker, np.flatnonzero(~via)),
            (cell.passing, np.flatnonzero(via)),
        ):
            if not len(rows):
                continue
            verdicts = checker.check(postures[rows])
            for k, constraint in enumerate(verdicts.constraints):
                column = COLUMN_OF.get(type(constraint))
                if column is None:
                    continue
                margin = verdicts.room[:, k] + _kept(cell, checker, constraint)
                # what has no limit has no margin
                margin = np.where(np.isposinf(margin), np.nan, margin * constraint.display)
                if isinstance(constraint, Collision):
                    margin = np.round(margin, CLEARANCE_DECIMALS)
                into = found.setdefault(column, np.full(len(postures), np.nan))
                into[rows] = np.fmin(into[rows], margin)
        return cls({column: found[column] for column in MARGIN_COLUMNS if column in found})

    @classmethod
    def of_route(cls, cell: Cell, route: Route) -> Margins:
        """Margins at the stops of a route."""
        via = np.array([stop.pose is None for stop in route.stops], dtype=bool)
        return cls.of(cell, np.array([stop.posture for stop in route.stops]), via)


def _kept(cell: Cell, checker: Checker, constraint: Constraint) -> float:
    """What a constraint keeps of the distance itself [SI]: its room is what is left."""
    if isinstance(constraint, (JointLimits, CoupledLimits)):
        return checker.margin
    if isinstance(constraint, Collision):
        return constraint.keep_m
    if isinstance(constraint, InImage) and cell.config.camera is not None:
        return cell.config.camera.border_px
    return 0.0
