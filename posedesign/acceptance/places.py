"""Poses of an acceptance test: places in the task box, and the postures that take them.

Two tests. ``iso``: the five poses of ISO 9283:1998 (6.8.2) in the largest cube of the task box, its
edges along the base: P1 in the middle, P2 to P5 on the diagonals of a diagonal plane, a tenth of
the diagonal from its corners; the tool turned alike at all five. ``places``: as many places as
prove a statement over the box, drawn at random, one in each of as many parts of equal volume.

All poses keep the constraints of the cell, with the marks of the tool in sight of the instrument,
and clear motions lead to them. Where the tool cannot be turned as at the base pose, it is turned
another way within the pool's cone. In a cell that touches its targets there are no places to go to:
the poses of the second test are then drawn from the pool of those that touch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.errors import InputError, UnreachableError, near_names
from calib.identification import tool_motion
from calib.identification.prediction import rigid_motions
from calib.robots import Robot
from calib.se3 import FloatArray, IntArray, transform
from posedesign.acceptance.sampling import chance_to_pass, places_needed, spread_points
from posedesign.candidates import box_of_cell, candidates_of
from posedesign.candidates.postures import even_points
from posedesign.cell import Cell, TaskBox, cone_rotations_at
from posedesign.cell.models import noise_of_kind
from posedesign.cell.observations import place_of, target_named
from posedesign.constraints import nearest_postures
from posedesign.identification.file import IdentifiedModel
from posedesign.motion import Router
from posedesign.motion.route import Route
from posedesign.planning import check_not_hand_eye
from posedesign.planning.loop import check_base_pose
from posedesign.planning.pose_plan import PoseSet

ISO, PLACES = "iso", "places"
TESTS = (ISO, PLACES)

PLANES = ("x=z", "x=-z", "y=z", "y=-z")
"""Diagonal planes of the cube of ISO 9283, each through two of its edges, by their equations about
the middle."""

ISO_CYCLES = 30

FROM_CORNER = 0.1
"""Distance of P2 to P5 from the corners over the diagonal (6.8.2: 10 % with 2 % either way)."""

SHRUNK = (1.0, 0.8, 0.6, 0.4)
"""Edges of the cube over the largest that are tried, until the arm can take all five poses."""

TURNS = 24
"""Orientations tried where that of the base pose cannot be taken."""

FEWEST_PLACES = 4
"""Of a proof: three give the frame of an instrument, in which a fourth is judged."""

REDRAWN = 8
"""Times that places are drawn in a part of the box before it counts as out of reach."""

ROUNDS = 6
"""Times that more parts are made of the box, where some were out of reach."""

DRAWN = 4000
"""Arms drawn for the chance to pass: known to a hundredth."""


@dataclass(frozen=True)
class AcceptanceRequest:
    """What is to be proven.

    ``test`` {"iso", "places"}. ``limit_m``: of the error of position [m]. ``content``,
    ``confidence``: part of the places that is to be within the limit, and the confidence of saying
    so. ``allowed``: places of the test that may be beyond it. ``plane``: of :data:`PLANES`; the
    first that can be taken by default. ``cycles``: times that each pose is measured. ``seed``: of
    the places.
    """

    test: str = PLACES
    limit_m: float = 2e-4
    content: float = 0.95
    confidence: float = 0.95
    allowed: int = 0
    plane: str | None = None
    cycles: int | None = None
    seed: int = 1

    def __post_init__(self) -> None:
        if self.test not in TESTS:
            raise InputError(
                f"there is no test {self.test[:40]!r}",
                hint=near_names(self.test, TESTS),
                name="test",
            )
        if not 1e-7 <= self.limit_m <= 1.0:
            raise InputError(
                f"a limit of {1e3 * self.limit_m:g} mm",
                hint="give a length from 0.0001 mm to a metre, such as 0.2mm",
                name="limit",
            )
        if self.plane is not None and self.plane not in PLANES:
            raise InputError(
                f"there is no plane {self.plane[:40]!r}",
                hint="one of " + ", ".join(PLANES),
                name="plane",
            )
        if (few := places_needed(self.content, self.confidence, self.allowed)) < FEWEST_PLACES:
            raise InputError(
                f"{few} places prove that, and they do not tell where the instrument is",
                hint="ask for a larger part, or more confidence",
                name="content",
            )
        if self.cycles is not None and not 1 <= self.cycles <= 1000:
            raise InputError(f"{self.cycles} cycles", hint="from 1 to 1000", name="cycles")

    @property
    def times(self) -> int:
        """Cycles: 30 by ISO 9283, 1 of a proof over places, where not said otherwise."""
        return self.cycles or (ISO_CYCLES if self.test == ISO else 1)

    @property
    def count(self) -> int:
        """Poses that it takes."""
        if self.test == ISO:
            return 5
        return places_needed(self.content, self.confidence, self.allowed)


@dataclass(frozen=True, eq=False)
class AcceptancePlan:
    """Poses of a test."""

    request: AcceptanceRequest
    poses: PoseSet
    route: Route
    where: str  # the places in words
    notes: tuple[str, ...] = ()
    chance: float = np.nan  # to pass, by what the identification says of the arm; NaN without one
    expected_m: float = np.nan
    """Root mean square error that it predicts at the poses [m]; NaN without one."""
    distances: bool = False
    """Whether distances alone are read: nothing is said of errors across them."""
    touched: tuple[str, ...] = ()
    """Targets that all poses touch; empty where places are free."""
    elsewhere: str = ""  # the places that a passed test says nothing of, in words
    expected_elsewhere_m: float = np.nan
    """Expected error of the tool point where the arm will work, by the identification [m]; NaN
    without one."""

    @property
    def sampled(self) -> str:
        """The poses that the statement is about, in words."""
        return sampled_words(self.touched)

    @property
    def statement(self) -> str:
        """What the test proves where it is passed."""
        asked, limit = self.request, f"{1e3 * self.request.limit_m:.4g} mm"
        if asked.test == ISO:
            what = "AD" if self.distances else "AP"
            said = f"{what} of ISO 9283 is at most {limit} at each of five poses"
        else:
            said = (
                f"at least {100 * asked.content:g} % of the {self.sampled} are within {limit}, "
                f"with confidence {100 * asked.confidence:g} %"
            )
        return said + ", by the distance from its foot alone" * self.distances


MOST_NAMED = 3
"""Targets that are named in a sentence."""


def sampled_words(touched: Sequence[str]) -> str:
    """The poses that a test of places is about, in words: those at targets, or places of a box."""
    if not touched:
        return "places"
    if len(touched) == 1:
        return f"orientations of the tool at the one point {touched[0]}"
    named = ", ".join(touched[:MOST_NAMED]) + " ..." * (len(touched) > MOST_NAMED)
    return f"poses at the {len(touched)} points {named}"


def plan_acceptance(
    cell: Cell,
    request: AcceptanceRequest,
    *,
    used: IdentifiedModel | None = None,
    known: IdentifiedModel | None = None,
) -> AcceptancePlan:
    """Plan the poses of an acceptance test.

    ``used``: what the arm is corrected by. ``known``: what says most of the arm: arms drawn from it
    give the chance to pass. Raises InputError: poses of ISO 9283 in a cell that touches targets, or
    fewer poses than the proof takes. UnreachableError: the arm cannot take the poses.
    """
    check_not_hand_eye(cell, "an acceptance test")
    check_base_pose(cell)
    reading = [k for k, seen in enumerate(cell.observations) if seen.reads]
    if request.test == ISO:
        if not reading:
            raise InputError(
                "the poses of ISO 9283 stand free in the task box, and this cell touches its "
                "targets",
                hint="take the test of places, or a cell with an instrument: measurement.kind",
                name="test",
            )
        plan = _iso(cell, request, reading[0])
    else:
        plan = _spread(cell, request, reading[0]) if reading else _touched(cell, request)
    kinds = {seen.kind for seen in cell.observations if seen.reads}
    plan = replace(plan, distances=kinds == {"distance"})
    if known is None or used is None or known.covariance is None:
        return plan
    return _with_chance(plan, cell, used, known, known.covariance)


def iso_points(box: TaskBox, plane: str, share: float = 1.0) -> FloatArray:
    """P1 to P5 ``(5, 3)`` [m] of ISO 9283 in the largest cube of a box, or a smaller one.

    Raises InputError: the box is flat: there is no cube in it.
    """
    edge = share * float((box.highest_m - box.lowest_m).min())
    if edge <= 0.0:
        raise InputError(
            "there is no cube in a flat task box", hint="give it three edges", name="task_box"
        )
    first, _, second = plane.partition("=")
    axes = {"x": 0, "y": 1, "z": 2}
    held, other = axes[first], axes[second[-1]]
    (along,) = {0, 1, 2} - {held, other}
    sign = -1.0 if second.startswith("-") else 1.0
    corners = np.zeros((5, 3))  # P1 stays in the middle
    for k, (a, b) in enumerate(((1, 1), (1, -1), (-1, -1), (-1, 1)), start=1):
        corners[k, along], corners[k, held], corners[k, other] = a, b, sign * b
    middle = (box.lowest_m + box.highest_m) / 2.0
    return np.asarray(middle + (0.5 - FROM_CORNER) * edge * corners)


def _turns(cell: Cell) -> FloatArray:
    """Orientations ``(1 + TURNS, 3, 3)`` of the tip: of the base pose, then within the cone."""
    R = cell.robot.fk(cell.base_posture)[:3, :3]
    tilt = float(np.deg2rad(cell.config.pool.tilt_deg))
    points = even_points(TURNS, 3, np.random.default_rng(cell.config.pool.seed))
    return np.concatenate([R[None], cone_rotations_at(R, tilt, points)])


def _tip_poses(cell: Cell, R: FloatArray, points: FloatArray) -> FloatArray:
    return transform(np.broadcast_to(R, (len(points), 3, 3)), points - R @ cell.tool_m)


def _iso(cell: Cell, request: AcceptanceRequest, which: int) -> AcceptancePlan:
    box, words = box_of_cell(cell)
    part, router, why = cell.parts[which], Router.of_cell(cell), ""
    planes = PLANES if request.plane is None else (request.plane,)
    for share in SHRUNK:
        for turn, R in enumerate(_turns(cell)):
            for plane in planes:
                points = iso_points(box, plane, share)
                tips = _tip_poses(cell, R, points)
                found = nearest_postures(part.checker, tips, cell.base_posture)
                if not found.feasible.all():
                    why = why or next(filter(None, found.reasons))
                    continue
                route = router.route(found.q)
                if route.lost:
                    why = why or next(iter(route.lost.values()))
                    continue
                edge = 1e3 * share * float((box.highest_m - box.lowest_m).min())
                middle = ", ".join(f"{v:.0f}" for v in 1e3 * points[0])
                where = (
                    f"P1 to P5 of ISO 9283 on the plane {plane} of a cube of {edge:.0f} mm about "
                    f"({middle}) mm, {words}"
                )
                notes = []
                if share < 1.0:
                    notes.append(
                        f"the cube is {100 * share:.0f} % of the largest in the box: {why}"
                    )
                if turn:
                    notes.append("the tool is turned otherwise than at the base pose")
                poses = _pose_set(cell, found.q, np.full(5, which))
                notes += where_axes_stood(cell.robot, poses.postures)
                other = f"places of {words} other than these five"
                return AcceptancePlan(request, poses, route, where, tuple(notes), elsewhere=other)
    raise UnreachableError(
        f"the five poses of ISO 9283 cannot all be taken: {why}",
        hint="give a smaller [task_box], in front of the arm",
        name="task_box",
    )


NOT_MOVED = 0.25
"""Part of its range that an external axis has to go for a test to be one of all its places."""


def where_axes_stood(robot: Robot, q: FloatArray) -> list[str]:
    """External axes that a test at postures ``(N, n)`` [rad, m] says nothing of, in words."""
    first = robot.n_external
    share = np.ptp(q, axis=0)[:first] / robot.joint_range[:first]
    labels = sorted(np.array(robot.joint_labels[:first])[share < NOT_MOVED].tolist())
    if not labels:
        return []
    return [f"{', '.join(labels)} hardly moved: of other places of the axes it proves nothing"]


def _pose_set(cell: Cell, q: FloatArray, which: IntArray) -> PoseSet:
    seen = cell.observations
    labels = [seen[k].labels for k in which] if len(seen) > 1 else []
    return PoseSet.of_chosen(q, cell.robot.fk(q)[:, :3, :3], labels)


def _spread(cell: Cell, request: AcceptanceRequest, which: int) -> AcceptancePlan:
    box, words = box_of_cell(cell)
    wanted = parts = request.count
    router, rng = Router.of_cell(cell), np.random.default_rng(request.seed)
    for _ in range(ROUNDS):
        cells = spread_points(box.lowest_m, box.highest_m, parts)
        q, turned, why = _in_each(cell, cells, which, rng)
        route = router.route(q) if len(q) else Route((), {})
        rows = np.arange(len(q))
        while route.lost:
            why = next(iter(route.lost.values()))
            rows = np.delete(rows, list(route.lost))
            route = router.route(q[rows])
        if len(rows) >= wanted:
            notes, elsewhere = [], ""
            if parts > len(rows):
                elsewhere = f"{parts - len(rows)} of {parts} equal parts of the box"
                notes.append(f"{elsewhere} are out of reach and no part of the statement: {why}")
            if turned:
                notes.append(
                    f"at {turned} places the tool is turned otherwise than at the base pose"
                )
            poses = _pose_set(cell, q[rows], np.full(len(rows), which))
            where = f"{len(rows)} places, one drawn in each of as many equal parts of {words}"
            notes += where_axes_stood(cell.robot, poses.postures)
            return AcceptancePlan(request, poses, route, where, tuple(notes), elsewhere=elsewhere)
        if not len(rows):
            break
        parts = min(4 * wanted, -(-parts * wanted // len(rows)) + 1)
    raise UnreachableError(
        f"no {wanted} places of the task box can be taken: {why}",
        hint="give a smaller [task_box], in front of the arm",
        name="task_box",
    )


def _in_each(
    cell: Cell, boxes: Sequence[tuple[FloatArray, ...]], which: int, rng: np.random.Generator
) -> tuple[FloatArray, int, str]:
    """A posture in each box that can be reached, how many are turned, and why others are not."""
    checker, turns = cell.parts[which].checker, _turns(cell)
    low, high = (np.array([box[k] for box in boxes]) for k in (0, 1))
    q = np.full((len(boxes), cell.robot.n), np.nan)
    why, turned = "", 0
    for attempt in range(REDRAWN):
        left = np.flatnonzero(np.isnan(q[:, 0]))
        if not len(left):
            break
        at = rng.uniform(low[left], high[left])
        # a place is given up only where no orientation takes it
        for turn in range(len(turns)):
            tips = _tip_poses(cell, turns[turn], at)
            found = nearest_postures(checker, tips, cell.base_posture)
            if turn == 0 and attempt == 0 and not found.feasible.all():
                why = next(filter(None, found.reasons))
            q[left[found.feasible]] = found.q[found.feasible]
            turned += int(turn > 0) * int(found.feasible.sum())
            left, at = left[~found.feasible], at[~found.feasible]
            if not len(left):
                break
    return q[np.isfinite(q[:, 0])], turned, why


def _touched(cell: Cell, request: AcceptanceRequest) -> AcceptancePlan:
    pool, wanted = candidates_of(cell), request.count
    router, rng = Router.of_cell(cell), np.random.default_rng(request.seed)
    order = rng.permutation(len(pool))
    rows = order[:wanted]
    route = router.route(pool.postures[rows], pool.loads[rows])
    used = wanted
    while route.lost and used < len(order):
        kept = np.delete(rows, list(route.lost))
        more = order[used : used + wanted - len(kept)]
        used += len(more)
        rows = np.concatenate([kept, more])
        route = router.route(pool.postures[rows], pool.loads[rows])
    if route.lost or len(rows) < wanted:
        raise UnreachableError(
            f"the proof takes {wanted} poses, and the pool has {len(pool)}",
            hint="ask for less confidence, or raise pool.candidates or pool.tilt_deg",
            name="pool",
        )
    chosen = pool.take(rows)
    named = dict.fromkeys(chosen.names_of_targets)
    touched = tuple(seen.target for seen in cell.observations if seen.target in named)
    touched = tuple(dict.fromkeys(touched)) or (cell.config.target.name,)
    at = "one point" if len(touched) == 1 else f"{len(touched)} points"
    where = f"{wanted} poses drawn at random from those that touch, all at {at}: {pool.description}"
    poses = PoseSet.of_chosen(chosen.postures, chosen.orientations, chosen.labels)
    elsewhere = f"other places, such as {box_of_cell(cell)[1]}"
    return AcceptancePlan(request, poses, route, where, touched=touched, elsewhere=elsewhere)


def frame_motions(points: FloatArray, *, turning: bool) -> FloatArray:
    """Orthonormal displacements ``(3 K, r)`` of points that a frame placed anew takes up.

    Those of a rigid body; of a target that is touched a shift alone.
    """
    if turning:
        return rigid_motions(points)
    return np.asarray(np.tile(np.eye(3), (len(points), 1)) / np.sqrt(len(points)))


def _with_chance(
    plan: AcceptancePlan,
    cell: Cell,
    used: IdentifiedModel,
    known: IdentifiedModel,
    covariance: FloatArray,
) -> AcceptancePlan:
    """The plan with the errors that arms drawn from an identification have at its poses."""
    q = plan.poses.kept
    points = known.model.view(q, known.x).tool_points
    J = tool_motion(known.model, q, x=known.x).reshape(-1, known.model.p)
    lost = (points - used.model.view(q, used.x).tool_points).ravel()
    values, vectors = np.linalg.eigh(covariance)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    rng = np.random.default_rng(0)
    off = lost + rng.standard_normal((DRAWN, known.model.p)) @ (J @ root).T
    first = cell.observations[0]
    seen = next((each for each in cell.observations if each.reads), first)
    sigma = noise_of_kind(cell, seen.kind).sigma[:3] / np.sqrt(plan.request.times)
    if len(sigma) == 1:  # a distance: along the way from its foot, which the test places anew
        target = target_named(cell.config, seen.target)
        away = points - (cell.target_m if target is None else place_of(cell, target))
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        off, taken = np.einsum("tkr,kr->tk", off.reshape(DRAWN, -1, 3), away), away
    else:  # the frame is placed where the test fits best
        taken = frame_motions(points, turning=seen.reads or len(cell.config.targets) > 1)
    off += np.resize(sigma, off.shape[1]) * rng.standard_normal(off.shape)
    base = np.linalg.qr(taken)[0]
    off -= (off @ base) @ base.T
    each = off.reshape(DRAWN, len(q), -1)
    if plan.request.test == PLACES and seen.kind != "distance":
        # in the frame of the others: what a place has drawn the frame to itself comes back
        own = base.reshape(len(q), -1, base.shape[1])
        kept = np.linalg.inv(np.eye(own.shape[1]) - own @ np.swapaxes(own, -1, -2))
        each = np.einsum("kij,tkj->tki", kept, each)
    errors = np.linalg.norm(each, axis=2)
    allowed = plan.request.allowed if plan.request.test == PLACES else 0
    return replace(
        plan,
        chance=chance_to_pass(errors, plan.request.limit_m, allowed),
        expected_m=float(np.sqrt(np.mean(errors**2))),
    )
