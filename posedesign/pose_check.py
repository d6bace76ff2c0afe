"""Whether the robot can really take the poses of a list, and go from each to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import IntArray
from posedesign.cell import Cell
from posedesign.feasibility import Checker
from posedesign.feasibility.ways import WayVerdicts
from posedesign.tables import PoseList


@dataclass(frozen=True)
class PoseVerdict:
    """What the constraints say of one pose, and of the way to it.

    Attributes
    ----------
    name : str
    via : bool
        The arm only passes through: nothing has to be seen or touched.
    feasible : bool
        Whether the pose keeps every constraint.
    tightest : str
        Name of the constraint that has least room, or is broken most.
    room : float or None
        How far the pose is inside that constraint; negative outside; None where nothing is near.
    unit : str
        Of ``room``.
    says : str
        The same in words.
    way_clear : bool
        Whether the straight joint-space way from the pose before keeps the safety distance.
    way : str
        What is wrong with the way; empty where it is clear.
    travel_deg : float
        Largest joint travel on the way; zero for the first pose.
    """

    name: str
    via: bool
    feasible: bool
    tightest: str
    room: float | None
    unit: str
    says: str
    way_clear: bool
    way: str
    travel_deg: float

    @property
    def ok(self) -> bool:
        """Whether the pose can be taken, and reached from the one before."""
        return self.feasible and self.way_clear


def check_poses(cell: Cell, poses: PoseList) -> tuple[PoseVerdict, ...]:
    """Verdicts on poses in the order in which they are visited."""
    ways = cell.ways.check(poses.postures[:-1], poses.postures[1:])
    judged: dict[int, PoseVerdict] = {}
    for checker, rows in (
        (cell.checker, np.flatnonzero(~poses.via)),
        (cell.passing, np.flatnonzero(poses.via)),
    ):
        judged |= _judge(checker, poses, ways, rows)
    return tuple(judged[i] for i in range(len(poses.names)))


def _judge(
    checker: Checker, poses: PoseList, ways: WayVerdicts, rows: IntArray
) -> dict[int, PoseVerdict]:
    verdicts = checker.check(poses.postures[rows])
    found = {}
    for i, row in enumerate(rows.tolist()):
        k = int(verdicts.tightest[i])
        constraint, room = verdicts.constraints[k], float(verdicts.room[i, k])
        found[row] = PoseVerdict(
            name=poses.names[row],
            via=bool(poses.via[row]),
            feasible=bool(verdicts.feasible[i]),
            tightest=constraint.name,
            room=room * constraint.display if np.isfinite(room) else None,
            unit=constraint.unit,
            says=verdicts.says(i),
            way_clear=bool(ways.clear[row - 1]) if row else True,
            way=ways.reasons[row - 1] if row else "",
            travel_deg=float(np.rad2deg(ways.travel[row - 1])) if row else 0.0,
        )
    return found
