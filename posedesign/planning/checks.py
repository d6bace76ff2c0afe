"""Checks of poses made elsewhere or by hand: they belong to the cell, the robot can take them and
go from each to the next, and how good they are.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.errors import InputError, JointLimitError, NotIdentifiableError
from calib.identification import (
    ExpectedError,
    check_identifiable,
    covariance_of,
    is_identifiable,
)
from calib.model import CalibrationModel
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.candidates import functions_over_work
from posedesign.cell import Cell
from posedesign.cell.observations import miss_m
from posedesign.constraints import Collision, Verdicts
from posedesign.constraints.space import MotionVerdicts
from posedesign.planning.loop import arms_told_by, identification_jacobian, told_by
from posedesign.planning.pose_plan import displayed
from posedesign.planning.poses_file import PoseList
from posedesign.selection import Indices, evaluate

ON_TARGET_M = 1e-3
"""Distance of the tool point from the target at which a pose is still one for touching it: far
above the rounding of a program, far below what would change an index."""

NEAR_TARGET_M = 0.05
"""Distance from which touch-up may start: a servo that is farther off does not see the target."""


def outside_limits(cell: Cell, names: Sequence[str], postures: FloatArray) -> list[str]:
    """Name and broken limit of each posture ``(N, n)`` [rad] that the robot cannot take."""
    said = []
    for name, q in zip(names, postures, strict=True):
        try:
            cell.robot.check_limits(q)
        except JointLimitError as error:
            said.append(f"{name}: {error.message}")
    return said


def off_target(
    cell: Cell,
    names: Sequence[str],
    postures: FloatArray,
    far_m: float,
    which: IntArray | None = None,
) -> list[str]:
    """Name and distance [mm] of each posture ``(N, n)`` [rad] off the target by more than that.

    ``which`` (N,): the observation of each; not given, the target that is nearest. None in a cell
    of hand-eye calibration: nothing is touched, and what the camera has to see is a constraint of
    its own.
    """
    if cell.is_hand_eye:
        return []
    each = np.array([miss_m(cell, seen, postures) for seen in cell.observations])
    distance = each.min(axis=0) if which is None else each[which, np.arange(len(postures))]
    return [
        f"{name}: the tool point is {far * 1e3:.4g} mm from the target"
        for name, far in zip(names, distance, strict=True)
        if far > far_m
    ]


def check_fit(cell: Cell, poses: PoseList) -> None:
    """Refuse poses that the robot is to be sent to and that do not belong to this cell.

    Those are of a robot of another name, outside the joint limits, or have the tool point far from
    the target.
    """
    if other := poses.other_robot(cell.robot):
        raise InputError(
            other,
            hint="plan in this cell, or, if it is the same arm, change the name before the header",
            name="poses",
        )
    outside = outside_limits(cell, poses.names, poses.postures)
    _refuse(outside, "are these poses of this robot, in URDF signs? FANUC pendants show J3 less J2")
    measured = poses.measured
    which = cell.which(measured.labels)
    far = off_target(cell, measured.names, measured.postures, NEAR_TARGET_M, which)
    _refuse(far, "are these poses of this cell, its tool and its target, in URDF signs?")


def check_not_hand_eye(cell: Cell, what: str) -> None:
    """Refuse to do with a cell of hand-eye calibration what needs a robot to be identified."""
    if cell.is_hand_eye:
        raise InputError(
            f"{what} needs a robot that is identified; this cell calibrates a camera",
            hint='set measurement.kind = "touch-up"',
            name="measurement.kind",
            value=cell.config.measurement.kind,
        )


def check_plain(cell: Cell, what: str) -> None:
    """Refuse to do with instruments, or several targets, what is of one target that is touched."""
    if not cell.is_hand_eye and not cell.is_plain:
        raise InputError(
            f"{what} is of one target that the tool point touches, and this cell measures "
            + "; ".join(map(str, cell.observations[:4])),
            hint='make a cell with one [target] and measurement.kind = "touch-up" for it',
            name="measurement.kind",
        )


def _refuse(poses: Sequence[str], hint: str) -> None:
    if poses:
        more = f", and {len(poses) - 1} more" if len(poses) > 1 else ""
        raise InputError(f"pose {poses[0]}{more}", hint=hint, name="poses")


@dataclass(frozen=True)
class PoseVerdict:
    """What the constraints say of one pose, and of the way to it."""

    name: str
    via: bool  # the arm only passes through: nothing has to be seen or touched
    feasible: bool  # whether the pose keeps every constraint
    tightest: str  # name of the constraint that has least margin, or is broken most
    room: float | None
    """How far the pose is inside that constraint; negative outside; None where it says yes or no
    only."""
    unit: str  # of ``room``
    says: str  # the same in words
    distance_mm: float | None
    """Smallest distance between tool, obstacles and arm; None where that is not checked."""
    nearest: str  # the same in words, with the two bodies
    way_clear: bool | None
    """Whether the straight joint-space way to the pose keeps what motions must keep: from the pose
    before, or from the base posture to the first pose. None where a pose at one of its ends cannot
    be taken: the rest of the way is then not looked at."""
    way: str  # what is wrong with the way; empty where it is clear
    travel_deg: float  # largest joint travel on the way

    @property
    def ok(self) -> bool:
        """Whether the pose can be taken, and reached from the one before."""
        return self.feasible and self.way_clear is not False


def check_poses(cell: Cell, poses: PoseList) -> tuple[PoseVerdict, ...]:
    """Verdicts on poses in the order in which they are visited."""
    motions = _motions(cell, poses)
    judged: list[tuple[Verdicts, IntArray]] = []
    # poses that are to blame where a way ends in them: not those that touch, as no way may
    blamed = np.ones(len(poses.names), dtype=bool)
    measured = np.flatnonzero(~poses.via)
    which = cell.which(poses.measured.labels)
    for checker, rows in (
        *((checker, measured[own]) for checker, own in cell.checkers(which)),
        (cell.passing, np.flatnonzero(poses.via)),
    ):
        verdicts = checker.check(poses.postures[rows])
        judged.append((verdicts, rows))
        if cell.solid is not cell.solid_passing:
            blamed[rows] = ~verdicts.feasible
    before = np.append(False, blamed[:-1])  # the base posture is none of the list
    at_a_pose = (motions.part == 1.0) & blamed | (motions.part == 0.0) & before
    found: dict[int, PoseVerdict] = {}
    for verdicts, rows in judged:
        found |= _judge(verdicts, poses, motions, rows, at_a_pose)
    return tuple(found[i] for i in range(len(poses.names)))


def _motions(cell: Cell, poses: PoseList) -> MotionVerdicts:
    """Verdicts on the motions to each pose; those along the tool to one that touches apart."""
    start, end = np.vstack([cell.base_posture, poses.postures[:-1]]), poses.postures
    motions = cell.ways.check(start, end)
    if cell.retreat is None:
        return motions
    from_touch, to_touch = np.append(True, ~poses.via[:-1]), ~poses.via
    away = np.where(to_touch[:, None], start, end)
    touching = np.where(to_touch[:, None], end, start)
    rows = np.flatnonzero((from_touch != to_touch) & cell.retreat.is_along(away, touching))
    along = cell.retreat.check(away[rows], touching[rows])
    clear, part, reasons = motions.clear.copy(), motions.part.copy(), list(motions.reasons)
    clear[rows] = along.clear
    part[rows] = np.where(to_touch[rows], along.part, 1.0 - along.part)
    for row, why in zip(rows.tolist(), along.reasons, strict=True):
        reasons[row] = why
    return MotionVerdicts(clear, motions.travel, part, tuple(reasons))


def check_clear(cell: Cell, poses: PoseList, *, force: bool) -> tuple[str, ...]:
    """Refuse poses that break a constraint of the cell, or cannot be reached one from the next.

    With ``force`` they are let through, and returned, each with its reason.
    """
    broken = [verdict for verdict in check_poses(cell, poses) if not verdict.ok]
    said = tuple(
        f"{v.name}: " + (f"on the way to it: {v.way}" if v.feasible else v.says) for v in broken
    )
    if said and not force:
        more = f", and {len(said) - 1} more" if len(said) > 1 else ""
        raise InputError(
            f"pose {said[0]}{more}",
            hint="look at them with posedesign check; `force` writes the program all the same",
            name="poses",
        )
    return said


def _judge(
    verdicts: Verdicts,
    poses: PoseList,
    motions: MotionVerdicts,
    rows: IntArray,
    at_a_pose: BoolArray,
) -> dict[int, PoseVerdict]:
    found = {}
    for i, row in enumerate(rows.tolist()):
        k = int(verdicts.tightest[i])
        constraint, margin = verdicts.constraints[k], float(verdicts.margin[i, k])
        distance_mm, nearest = _nearest(verdicts, i)
        found[row] = PoseVerdict(
            name=poses.names[row],
            via=bool(poses.via[row]),
            feasible=bool(verdicts.feasible[i]),
            tightest=constraint.name,
            room=margin * constraint.display
            if constraint.measured and np.isfinite(margin)
            else None,
            unit=constraint.unit,
            says=verdicts.reason(i),
            distance_mm=distance_mm,
            nearest=nearest,
            way_clear=None if at_a_pose[row] else bool(motions.clear[row]),
            way="" if at_a_pose[row] else _on_the_way(motions, row),
            travel_deg=float(np.rad2deg(motions.travel[row])),
        )
    return found


def _nearest(verdicts: Verdicts, i: int) -> tuple[float | None, str]:
    """Smallest distance [mm] between tool, obstacles and arm at posture i, and in words."""
    for k, constraint in enumerate(verdicts.constraints):
        if type(constraint) is Collision:
            margin, which = float(verdicts.margin[i, k]), int(verdicts.which[i, k])
            return 1e3 * (margin + constraint.keep_m), constraint.reason(
                verdicts.arm, i, margin, which
            )
    return None, ""


def _on_the_way(motions: MotionVerdicts, row: int) -> str:
    place = f" at {motions.part[row]:.0%} of the way" if np.isfinite(motions.part[row]) else ""
    return motions.reasons[row] + place if motions.reasons[row] else ""


@dataclass(frozen=True)
class Score:
    """How good a list of poses is for a cell."""

    indices: Indices
    sigma: list[tuple[str, str, float]]
    """(name, unit, value): predicted standard deviations as people read them; empty where not
    identifiable."""
    problem: str  # what the poses cannot identify; empty where they can
    not_feasible: tuple[str, ...]
    """Poses that break a constraint of the cell, with the one that is broken most. The motions
    between them are not looked at: a list that is scored need not be in order."""
    off_target: tuple[str, ...]
    """Poses that do not bring the tool point to the target, with the distance."""
    expected: ExpectedError | None = None
    """Error to expect of the tool point where the arm will work; None where the poses do not place
    tool and target, or no arm is identified."""
    where: str = ""  # in words


def score_poses(cell: Cell, poses: PoseList) -> Score:
    """Indices and predicted standard deviations of any pose list."""
    which = cell.which(poses.labels)
    model = told_by(cell, cell.model_for(which), poses.postures, which)
    setup = cell.setup(model, poses.postures, which)
    linear = model.linearise(poses.postures, setup=setup)
    white = linear.white_jacobian
    problem = _what_is_hidden(model, white)
    sigma: list[tuple[str, str, float]] = []
    if not problem:
        weighted = cell.config.measurement.weighted
        covariance = covariance_of(model, poses.postures, setup=setup, weighted=weighted)
        sigma = displayed(model, np.sqrt(np.diag(covariance)))
    broken = []
    for checker, rows in cell.checkers(which):
        verdicts = checker.check(poses.postures[rows])
        broken += [
            f"{poses.names[rows[i]]}: {verdicts.reason(i)}"
            for i in np.flatnonzero(~verdicts.feasible).tolist()
        ]
    off = off_target(cell, poses.names, poses.postures, ON_TARGET_M, which)
    expected, where = _expected(cell, poses.postures, which)
    return Score(
        evaluate(identification_jacobian(linear), white),
        sigma,
        problem,
        tuple(broken),
        tuple(off),
        expected,
        where,
    )


def _expected(
    cell: Cell, postures: FloatArray, which: IntArray
) -> tuple[ExpectedError | None, str]:
    """Error to expect after measuring at postures ``(N, n)`` [rad], and where it is of."""
    if cell.is_hand_eye:
        return None, ""
    arms = arms_told_by(cell, postures, which)
    functions, where = functions_over_work(cell, arms.model)
    setup = cell.setup(arms.model, postures, which)
    blocks = arms.blocks(arms.model.linearise(postures, setup=setup))
    told = np.vstack([blocks.reshape(-1, arms.model.p), arms.known_rows])
    if len(told) < arms.model.p or not is_identifiable(told):
        return None, where
    return arms.expected_error(blocks, functions), where


def _what_is_hidden(model: CalibrationModel, white: FloatArray) -> str:
    """What whitened blocks ``(N, m, p)`` cannot identify, in words; empty where they can."""
    if white[..., 0].size < model.p:
        return f"{len(white)} poses give {white[..., 0].size} equations for {model.p} parameters"
    try:
        told = np.vstack([white.reshape(-1, model.p), model.known_rows])
        check_identifiable(told, model.names, model.nuisance)
    except NotIdentifiableError as error:
        return error.message
    return ""
