"""Whether the robot can really take the poses of a list, and go from each to the next."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.se3 import BoolArray, IntArray
from posedesign.cell import Cell
from posedesign.constraints import Collision, Verdicts
from posedesign.constraints.motions import WayVerdicts
from posedesign.planning.tables import PoseList


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
        How far the pose is inside that constraint; negative outside; None where it says
        yes or no only.
    unit : str
        Of ``room``.
    says : str
        The same in words.
    distance_mm : float or None
        Smallest distance between tool, obstacles and arm; None where that is not checked.
    nearest : str
        The same in words, with the two bodies.
    way_clear : bool or None
        Whether the straight joint-space way to the pose keeps what ways must keep: from the pose
        before, or from the base posture to the first pose. None where a pose at one of its ends
        cannot be taken: the rest of the way is then not looked at.
    way : str
        What is wrong with the way; empty where it is clear.
    travel_deg : float
        Largest joint travel on the way.
    """

    name: str
    via: bool
    feasible: bool
    tightest: str
    room: float | None
    unit: str
    says: str
    distance_mm: float | None
    nearest: str
    way_clear: bool | None
    way: str
    travel_deg: float

    @property
    def ok(self) -> bool:
        """Whether the pose can be taken, and reached from the one before."""
        return self.feasible and self.way_clear is not False


def check_poses(cell: Cell, poses: PoseList) -> tuple[PoseVerdict, ...]:
    """Verdicts on poses in the order in which they are visited."""
    ways = _motions(cell, poses)
    judged: list[tuple[Verdicts, IntArray]] = []
    # poses that are to blame where a way ends in them: not those that touch, as no way may
    blamed = np.ones(len(poses.names), dtype=bool)
    for checker, rows in (
        (cell.checker, np.flatnonzero(~poses.via)),
        (cell.passing, np.flatnonzero(poses.via)),
    ):
        verdicts = checker.check(poses.postures[rows])
        judged.append((verdicts, rows))
        if cell.solid is not cell.solid_passing:
            blamed[rows] = ~verdicts.feasible
    before = np.append(False, blamed[:-1])  # the base posture is none of the list
    at_a_pose = (ways.part == 1.0) & blamed | (ways.part == 0.0) & before
    found: dict[int, PoseVerdict] = {}
    for verdicts, rows in judged:
        found |= _judge(verdicts, poses, ways, rows, at_a_pose)
    return tuple(found[i] for i in range(len(poses.names)))


def _motions(cell: Cell, poses: PoseList) -> WayVerdicts:
    """Verdicts on the motions to each pose; those along the tool to one that touches apart."""
    start, end = np.vstack([cell.base_posture, poses.postures[:-1]]), poses.postures
    ways = cell.ways.check(start, end)
    if cell.retreat is None:
        return ways
    from_touch, to_touch = np.append(True, ~poses.via[:-1]), ~poses.via
    away = np.where(to_touch[:, None], start, end)
    touching = np.where(to_touch[:, None], end, start)
    rows = np.flatnonzero((from_touch != to_touch) & cell.retreat.is_along(away, touching))
    along = cell.retreat.check(away[rows], touching[rows])
    clear, part, reasons = ways.clear.copy(), ways.part.copy(), list(ways.reasons)
    clear[rows] = along.clear
    part[rows] = np.where(to_touch[rows], along.part, 1.0 - along.part)
    for row, why in zip(rows.tolist(), along.reasons, strict=True):
        reasons[row] = why
    return WayVerdicts(clear, ways.travel, part, tuple(reasons))


def refuse_blocked(cell: Cell, poses: PoseList, *, force: bool) -> tuple[str, ...]:
    """Refuse poses that break a constraint of the cell, or cannot be reached one from the next.

    Returns
    -------
    tuple of str
        Those that are let through, each with its reason.

    Raises
    ------
    InputError
        Unless ``force`` says that it is meant so.
    """
    broken = [verdict for verdict in check_poses(cell, poses) if not verdict.ok]
    said = tuple(
        f"{v.name}: " + (f"on the way to it: {v.way}" if v.feasible else v.says) for v in broken
    )
    if said and not force:
        more = f", and {len(said) - 1} more" if len(said) > 1 else ""
        raise InputError(
            f"pose {said[0]}{more}",
            hint="look at them with posedesign check; --force writes the program all the same",
            name="poses",
        )
    return said


def _judge(
    verdicts: Verdicts, poses: PoseList, ways: WayVerdicts, rows: IntArray, at_a_pose: BoolArray
) -> dict[int, PoseVerdict]:
    found = {}
    for i, row in enumerate(rows.tolist()):
        k = int(verdicts.tightest[i])
        constraint, room = verdicts.constraints[k], float(verdicts.room[i, k])
        distance_mm, nearest = _nearest(verdicts, i)
        found[row] = PoseVerdict(
            name=poses.names[row],
            via=bool(poses.via[row]),
            feasible=bool(verdicts.feasible[i]),
            tightest=constraint.name,
            room=room * constraint.display if constraint.measured and np.isfinite(room) else None,
            unit=constraint.unit,
            says=verdicts.says(i),
            distance_mm=distance_mm,
            nearest=nearest,
            way_clear=None if at_a_pose[row] else bool(ways.clear[row]),
            way="" if at_a_pose[row] else _on_the_way(ways, row),
            travel_deg=float(np.rad2deg(ways.travel[row])),
        )
    return found


def _nearest(verdicts: Verdicts, i: int) -> tuple[float | None, str]:
    """Smallest distance [mm] between tool, obstacles and arm at posture i, and in words."""
    for k, constraint in enumerate(verdicts.constraints):
        if type(constraint) is Collision:
            room, which = float(verdicts.room[i, k]), int(verdicts.which[i, k])
            return 1e3 * (room + constraint.keep_m), constraint.says(verdicts.arm, i, room, which)
    return None, ""


def _on_the_way(ways: WayVerdicts, row: int) -> str:
    place = f" at {ways.part[row]:.0%} of the way" if np.isfinite(ways.part[row]) else ""
    return ways.reasons[row] + place if ways.reasons[row] else ""
