"""The loop of Watanabe et al. 2006, section 2.4: vary, check, repair, evaluate, vary more.

Steps 1 to 6 of the paper are the functions below, in that order.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.errors import CalibError, InputError, UnreachableError, check_type
from calib.identification import check_identifiable, covariance_of, reduce
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Linearisation
from calib.model.measurements import Measurements
from calib.model.parameters import ReadingParameters
from calib.one_thread import one_numpy_thread
from calib.robots.inverse.few_axes import AXES_OF_A_POSE
from calib.se3 import (
    BoolArray,
    FloatArray,
    IntArray,
    rotation_angle,
    rotation_exp,
    wpr_from_rotation,
)
from posedesign.candidates import candidates_of
from posedesign.candidates.postures import once
from posedesign.cell import Cell, poses_about_tool, touching_poses, wpr_rotations
from posedesign.cell.cell import posture_section
from posedesign.cell.models import PAPER
from posedesign.cell.observations import touched_by_tool
from posedesign.cell.orientations import GRID, cone_rotations
from posedesign.cell.reference import reference_of
from posedesign.constraints import Checker, nearest_postures
from posedesign.motion import Router
from posedesign.motion.route import Route
from posedesign.planning.assignment import least_assignment
from posedesign.planning.pose_plan import PosePlan, PoseSet, PoseStatus, Round, StopReason
from posedesign.planning.tellable import check_tellable
from posedesign.selection import condition_inf, evaluate
from posedesign.selection.indices import (
    SCALING,
    SCALING_OF_POSES,
    SCALING_WITH_LENS,
    condition_2,
)

POOL_ORIENTATIONS = 400
"""Orientations that the pool is made of; twice as many lower C_G by less than a tenth."""

MORE_ORIENTATIONS = 3000
"""Orientations all around that are tried where those near the base pose do not do."""

ENOUGH = 3
"""Postures in the pool for each one that is wanted, so that there is something to choose from."""

NEARLY = 60
"""Orientations nearest to being feasible that are varied while none is."""

_GROWTH_ROUNDS = 30
_GROWTH_TILTS = np.deg2rad([0.5, 30.0])
"""Smallest and largest turn by which postures are varied where few can be found."""

_SAME_PLACE_RAD = np.deg2rad(1.0)
"""A posture that differs by less from one that no clear way leads to shares its fate."""

_POOL_SEED = 2006

IMPROVEMENT = 0.99
"""A round counts as better when it brings C_G below this part of the best so far."""

FARTHEST_M = 0.5
"""Distance of the target from the tool point at the base posture beyond which one of the two is a
mistake: metres for millimetres, or another frame."""

ASIDE_OF_REACH = 0.3
"""How far the grid has an arm go along its slides to either side, of its reach."""

ASIDE_RAD = float(np.deg2rad(40.0))
"""How far it turns the axes of a positioner to either side: an arm that comes from above still
comes to a target from above, and an axis is told well by 80 deg of it."""

BESIDE_RAD = tuple(np.deg2rad([15.0, 30.0, 45.0]))
"""Turns in W, P and R by which another base posture is looked for where that of the cell is not
free; a base pose turned farther is no more the one that was meant."""

FLIP_DEG = 90.0
"""A joint that moves by more than this belongs to another arm configuration."""

PATIENCE = 3
"""Rounds without improvement after which the loop ends."""

REPLACEMENTS = 6
"""How often poses that no clear way leads to are replaced before they are left out. From the second
time on by postures that a clear way from the base posture leads to."""

Progress = Callable[[Round], None]


class Replacements:
    """Postures that replacements are taken from, found when they are first needed.

    First all arm configurations over a cone of orientations around the base pose, rolled freely,
    inside the limits less the repair margin, with the first joint near its base value, so that no
    replacement reaches over the arm's back. Where they are too few: the pool that the best poses
    are chosen out of; then orientations all around, the first joint anywhere, less the margin of
    the plan only. Where they are still too few: small turns of those that were found, or of those
    that came nearest to keeping every constraint.
    """

    def __init__(self, cell: Cell) -> None:
        self._cell = cell
        self._rng = np.random.default_rng(_POOL_SEED)  # fixed: the same cell gives the same plan
        self._stage = 0
        self._found = np.empty((0, cell.robot.n))
        self._nearly: list[tuple[float, FloatArray]] = []
        self._excluded = np.empty((0, cell.robot.n))
        self._reached: Callable[[FloatArray], BoolArray] | None = None

    def postures(self, wanted: int) -> FloatArray:
        """Postures ``(K, n)`` [rad] to choose that many from; fewer where there are no more."""
        while len(self._found) < ENOUGH * wanted and self._stage < 3 + _GROWTH_ROUNDS:
            more = self._offered(self._more(self._stage))
            self._found = np.concatenate([self._found, more])
            self._stage += 1
        return self._found

    def exclude(self, postures: FloatArray) -> None:
        """Offer postures ``(K, n)`` [rad] no more, nor any so near that they would do no better."""
        self._excluded = np.concatenate([self._excluded, postures])
        self._found = self._offered(self._found)

    def offer_only(self, reached: Callable[[FloatArray], BoolArray]) -> None:
        """Offer only postures ``(K, n)`` [rad] that are reached by this, ``(K,)``, from now on."""
        self._reached = reached
        self._found = self._offered(self._found)

    def _offered(self, postures: FloatArray) -> FloatArray:
        apart = np.abs(postures[:, None] - self._excluded[None]).max(axis=-1, initial=0.0)
        left = postures[(apart > _SAME_PLACE_RAD).all(axis=1)]
        return np.asarray(left if self._reached is None else left[self._reached(left)])

    def _more(self, stage: int) -> FloatArray:
        plan, base = self._cell.config.plan, self._cell.robot.fk(self._cell.base_posture)[:3, :3]
        if stage == 0:
            tilt = float(np.deg2rad(plan.repair_tilt_deg))
            rotations = cone_rotations(base, tilt, POOL_ORIENTATIONS, self._rng)
            margin = float(np.deg2rad(max(plan.repair_margin_deg, plan.limit_margin_deg)))
            return self._feasible(rotations, margin, float(np.deg2rad(plan.repair_base_joint_deg)))
        if stage == 1:
            try:
                return candidates_of(self._cell).postures
            except CalibError:  # there is no such pool
                return np.empty((0, self._cell.robot.n))
        if stage == 2:
            # a redundant arm takes each orientation in a hundred ways, and longer to find them
            count = MORE_ORIENTATIONS // (1 if self._cell.robot.n == 6 else 10)
            rotations = cone_rotations(base, np.pi, count, self._rng)
        else:
            seeds = self._found if len(self._found) else self._cell.base_posture[None]
            known = [*self._cell.robot.fk(seeds)[:, :3, :3], *(R for _, R in self._nearly)]
            rotations = self._vary(np.array(known))
        return self._feasible(rotations, self._cell.margin, np.inf)

    def _vary(self, rotations: FloatArray) -> FloatArray:
        """Orientations turned a little, some more than others."""
        picked = rotations[self._rng.integers(len(rotations), size=POOL_ORIENTATIONS)]
        low, high = np.log(_GROWTH_TILTS)
        angle = np.exp(self._rng.uniform(low, high, POOL_ORIENTATIONS))
        axis = self._rng.standard_normal((POOL_ORIENTATIONS, 3))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        return np.asarray(picked @ rotation_exp(axis * angle[:, None]))

    def _feasible(self, rotations: FloatArray, margin: float, swing: float) -> FloatArray:
        """All postures with these orientations that keep every constraint."""
        cell, base = self._cell, self._cell.base_posture
        poses = poses_about_tool(cell.robot, rotations, cell.tool_m, cell.target_m, base, margin)
        solutions = cell.robot.inverse(poses, near=base, margin=margin)
        first = cell.robot.n_external
        near = np.abs(solutions.postures[:, first] - base[first]) <= swing
        rows = np.flatnonzero(solutions.inside & near)
        verdicts = cell.checker.check(solutions.postures[rows], every=False)
        feasible = verdicts.feasible
        if not len(self._found) and not feasible.any():
            # how many constraints are kept, and how far the first that is not is broken
            kept = verdicts.nearness
            best = np.argsort(-kept, kind="stable")[:NEARLY]
            ranked = zip(kept[best], rotations[solutions.pose[rows[best]]], strict=True)
            self._nearly += [(float(score), R) for score, R in ranked]
            self._nearly = sorted(self._nearly, key=lambda entry: -entry[0])[:NEARLY]
        return np.asarray(solutions.postures[rows[feasible]])


def repair(cell: Cell, poses: PoseSet, pool: Replacements) -> PoseSet:
    """Replace each dropped pose by a posture of the pool, each as far as possible from all others.

    Of the replacements each pose gets the one that is turned least against it; its reason says
    what shut the pose out and by how much the replacement is turned.
    """
    gaps = np.flatnonzero([status is PoseStatus.DROPPED for status in poses.status])
    available = pool.postures(len(gaps))
    found = farthest_postures(available, poses.kept, len(gaps), cell.robot.joint_range)
    postures, status, turned = poses.postures.copy(), list(poses.status), poses.turned.copy()
    R_found = cell.robot.fk(found)[:, :3, :3]
    turn = rotation_angle(np.swapaxes(poses.orientations[gaps][:, None], -1, -2) @ R_found)
    for row, k in zip(*least_assignment(turn), strict=True):
        i = int(gaps[row])
        postures[i], turned[i] = found[k], turn[row, k]
        status[i] = PoseStatus.REPAIRED
    return replace(poses, postures=postures, status=tuple(status), turned=turned, searched=True)


def farthest_postures(
    pool: FloatArray, chosen: FloatArray, count: int, joint_range: FloatArray
) -> FloatArray:
    """Pick postures [rad] one by one, each as far as possible from all chosen before it.

    Fewer than ``count`` where the pool ``(K, n)`` runs out. Joint differences are divided by
    ``joint_range``, so that every joint counts by how far it can turn.
    """
    points = pool / joint_range
    distance = np.full(len(pool), np.inf)
    for posture in chosen / joint_range:
        distance = np.minimum(distance, np.linalg.norm(points - posture, axis=1))
    picked: list[int] = []
    for _ in range(min(count, len(pool))):
        best = int(np.argmax(distance))
        if distance[best] == 0.0:  # only repetitions are left
            break
        picked.append(best)
        distance = np.minimum(distance, np.linalg.norm(points - points[best], axis=1))
    return pool[picked]


@one_numpy_thread
def plan(cell: Cell, progress: Progress | None = None) -> PosePlan:
    """Plan measuring poses until C_G falls below the threshold of the cell.

    ``progress``: called with each :class:`Round` as it is done. Raises UnreachableError: the base
    pose itself does not bring the tool point to the target, or breaks the margin.
    NotIdentifiableError: no poses can identify some of the parameters, which are named.
    """
    check_type(cell, Cell, "cell")
    if not cell.is_hand_eye and cell.observations[0].kind in ("plane", "distance"):
        raise InputError(
            "the loop turns the tool about one point, which shows no more of a "
            f"{cell.observations[0].kind} than its place does",
            hint="choose poses all over it: take the method exchange",
            name="method",
        )
    if cell.robot.n < AXES_OF_A_POSE and not (cell.is_hand_eye or touched_by_tool(cell.config)):
        raise InputError(
            f"the loop turns the tool about one point, and {cell.robot.name} has "
            f"{cell.robot.n} axes: what an instrument reads there tells little",
            hint="choose poses all over its range: take the method exchange",
            name="method",
        )
    return _Loop(cell, progress).run()


class _Loop:
    """State of one planning run: the rounds so far, the best of them, the repair pool."""

    def __init__(self, cell: Cell, progress: Progress | None) -> None:
        self._labels: list[Mapping[str, str]] = []
        if not cell.is_hand_eye and len(cell.observations) > 1:
            self._labels = [cell.observations[0].labels]
            cell = cell.parts[0]
        self.cell = cell
        self.model = cell.model()
        if cell.config.parameters.planned not in (None, PAPER):
            widest = grid_poses(cell, np.array(cell.config.variations.largest_deg)).kept
            self.model = told_by(cell, self.model, widest, np.zeros(len(widest), dtype=np.intp))
        self.progress = progress
        self.rounds: list[Round] = []
        self.sets: list[PoseSet] = []
        self.routes: list[Route | None] = []
        self._pool = Replacements(cell)
        self._cut_off = 0  # poses and replacements that no clear way leads to
        self._router = Router.of_cell(cell)
        check_base_pose(cell)
        check_tellable(cell, _stations(cell))

    def run(self) -> PosePlan:
        section = self.cell.config.variations
        variation = np.array(section.start_deg)  # step 1
        largest = np.array(section.largest_deg)
        while True:
            self._round(variation)
            stop = self._stop()
            if stop is None:
                following = self._raise(variation)
                if following is None:
                    stop = StopReason.VARIATION_LIMIT
                else:
                    variation = np.minimum(following, largest)
                    continue
            return self._finish(stop)

    def _round(self, variation: FloatArray) -> None:
        poses = self._generate(variation)
        self.sets.append(poses)
        self.routes.append(None)
        self.rounds.append(self._evaluate(poses, variation.tolist(), len(self.rounds) + 1))
        if self.rounds[-1].c_g < self.cell.config.plan.condition_threshold:
            self._connect(len(self.rounds) - 1)
        if self.progress is not None:
            self.progress(self.rounds[-1])

    def _evaluate(self, poses: PoseSet, variation: Sequence[float], number: int) -> Round:
        model, kept = self.model, poses.kept
        setup = self.cell.setup(model, kept)
        blocks = identification_jacobian(model.linearise(kept, setup=setup))
        c_g = condition_inf(blocks) if len(kept) else float("inf")
        if np.isfinite(c_g) and len(kept) * self.cell.rows(model) >= model.p:
            weighted = self.cell.config.measurement.weighted
            found = covariance_of(model, kept, setup=setup, weighted=weighted)
            sigma = np.sqrt(np.diag(found))
        else:
            c_g, sigma = float("inf"), np.full(model.p, np.inf)
        return Round(
            number=number,
            variation_deg=(float(variation[0]), float(variation[1]), float(variation[2])),
            grid=poses.count(PoseStatus.GRID),
            repaired=poses.count(PoseStatus.REPAIRED),
            dropped=poses.count(PoseStatus.DROPPED),
            c_g=c_g,
            cond_2_g=condition_2(blocks) if len(kept) else float("inf"),
            sigma=sigma,
        )

    def _connect(self, k: int) -> Route:
        """Find the route of round k; poses that no way leads to are replaced, or dropped."""
        known = self.routes[k]
        if known is not None:
            return known
        cell, poses = self.cell, self.sets[k]
        replacements = REPLACEMENTS if cell.config.plan.repair else 0
        while True:
            route = self._router.route(poses.kept)
            if not route.lost:
                break
            self._cut_off += len(route.lost)
            self._pool.exclude(poses.kept[list(route.lost)])
            if replacements < REPLACEMENTS:  # others were no better
                self._pool.offer_only(self._router.reached)
            rows = [i for i, s in enumerate(poses.status) if s is not PoseStatus.DROPPED]
            poses = poses.without({rows[i]: why for i, why in route.lost.items()})
            if replacements:
                poses = repair(cell, poses, self._pool)
                replacements -= 1
        self.routes[k] = route
        if poses is not self.sets[k]:
            self.sets[k] = poses
            done = self.rounds[k]
            self.rounds[k] = self._evaluate(poses, done.variation_deg, done.number)
        return route

    def _generate(self, variation: FloatArray) -> PoseSet:
        """Steps 2 to 4: the grid, what of it can be reached, and replacements for the rest."""
        poses = grid_poses(self.cell, variation)
        if PoseStatus.DROPPED in poses.status and self.cell.config.plan.repair:
            poses = repair(self.cell, poses, self._pool)
        return poses

    def _stop(self) -> StopReason | None:
        """Step 5."""
        values = [r.c_g for r in self.rounds]
        if values[-1] < self.cell.config.plan.condition_threshold:
            return StopReason.THRESHOLD
        recent, before = values[-PATIENCE:], values[:-PATIENCE]
        if before and min(recent) > IMPROVEMENT * min(before) and np.isfinite(min(before)):
            return StopReason.NO_IMPROVEMENT
        return None

    def _raise(self, variation: FloatArray) -> FloatArray | None:
        """Step 6: all angles by their steps, or the one that lowers C_G most; None at the limit."""
        section = self.cell.config.variations
        step, largest = np.array(section.step_deg), np.array(section.largest_deg)
        if (variation >= largest).all():
            return None
        if section.raise_ == "together":
            return np.asarray(variation + step)
        options = [
            np.minimum(variation + step * axis, largest)
            for k, axis in enumerate(np.eye(3))
            if variation[k] < largest[k]
        ]
        scores = [
            condition_inf(
                identification_jacobian(
                    self.cell.linearise(self.model, self._generate(option).kept)
                )
            )
            for option in options
        ]
        return np.asarray(options[int(np.argmin(scores))])

    def _best(self, stop: StopReason) -> int:
        """The round to take, its poses connected: with the threshold reached it is the last."""
        if stop is StopReason.THRESHOLD:
            return len(self.rounds) - 1
        while True:
            values = [r.c_g for r in self.rounds]
            best = int(np.argmin(values))
            if not np.isfinite(values[best]):
                best = int(np.argmax([len(poses.kept) for poses in self.sets]))
            if self.routes[best] is not None:
                return best
            self._connect(best)  # may lose poses, and leave another round the best

    def _finish(self, stop: StopReason) -> PosePlan:
        best = self._best(stop)
        if self.rounds[best].c_g < self.cell.config.plan.condition_threshold:
            stop = StopReason.THRESHOLD  # replacements on the way may have brought it there
        elif not np.isfinite(self.rounds[best].c_g):
            stop = StopReason.INFEASIBLE
        route, poses = self._connect(best), self.sets[best]
        postures = poses.kept
        linear = self.cell.linearise(self.model, postures)
        blocks, white = identification_jacobian(linear), linear.white_jacobian
        if stop is StopReason.INFEASIBLE and blocks[..., 0].size >= self.model.p:
            # enough poses, and still something is hidden: no angle will show it
            told = np.vstack([white.reshape(-1, self.model.p), self.model.known_rows])
            check_identifiable(told, self.model.names, self.model.nuisance)
        labels = tuple(self._labels * len(poses.status))
        return PosePlan(
            poses=replace(poses, labels=labels),
            route=route,
            best=best,
            rounds=tuple(self.rounds),
            history=tuple(self.sets),
            indices=evaluate(blocks, white),
            model=self.model,
            threshold=self.cell.config.plan.condition_threshold,
            stop=stop,
            advice=_advice(stop, self.rounds[best], self._cut_off),
            not_checked=self.cell.not_checked,
            setup=self.cell.setup(self.model, postures[route.order]),
        )


def check_base_pose(cell: Cell) -> None:
    """Check that the base posture touches the target and keeps the margin from the limits.

    Where there are several targets, or instruments that see the tool anywhere, the base pose is
    where the tour begins, and touches nothing.
    """
    q, robot = cell.base_posture, cell.robot
    several = not cell.is_hand_eye and len(cell.observations) > 1
    if several or not (cell.is_hand_eye or cell.is_plain):
        start = Checker(robot, cell.solid, cell.margin).check(q[None])
        if not start.feasible[0]:
            raise _base_pose_error(cell, start.reason(0), start.hint(0))
        return
    if cell.target_offset_m > FARTHEST_M:
        raise UnreachableError(
            f"the target is {cell.target_offset_m * 1e3:.0f} mm from where the base posture puts "
            "the tool point",
            hint="give target.position_mm in mm in the base frame, or a base posture that touches",
            name="target.position_mm",
        )
    rotation = robot.fk(q)[:3, :3]
    pose = touching_poses(rotation[None], cell.tool_m, cell.target_m)
    there = nearest_postures(cell.checker, pose, q)
    start = Checker(robot, cell.solid, cell.margin).check(q[None])
    reason, hint = there.reasons[0], there.hints[0]
    if there.feasible[0] and not start.feasible[0]:  # only another branch can: the arm is not in it
        reason, hint = start.reason(0), start.hint(0)
    if reason:
        raise _base_pose_error(cell, reason, hint)


def _base_pose_error(cell: Cell, reason: str, hint: str) -> UnreachableError:
    return UnreachableError(
        f"the base pose cannot be taken: {reason}",
        hint="move the target (target.position_mm) or the base posture (base_pose.posture_deg)"
        + f"; or {hint}" * bool(hint)
        + _free_beside(cell),
        name="base_pose",
    )


def _free_beside(cell: Cell) -> str:
    """A base posture that can be taken, turned as little as there is one, in words; or nothing."""
    q = cell.base_posture
    wpr = wpr_from_rotation(cell.robot.fk(q)[:3, :3])
    for angle in BESIDE_RAD:
        rotations = wpr_rotations(wpr, np.full(3, angle))
        poses = poses_about_tool(cell.robot, rotations, cell.tool_m, cell.target_m, q)
        found = nearest_postures(cell.checker, poses, q)
        robot, first = cell.robot, cell.robot.n_external
        shown = np.round(robot.shown(found.q[found.feasible]), 2)  # as a person writes it
        moved_deg = np.abs(shown - robot.shown(q))[:, first:].max(axis=1)
        good = cell.checker.check(robot.of_shown(shown)).feasible & (moved_deg < FLIP_DEG)
        if good.any():
            best = shown[np.where(good, moved_deg, np.inf).argmin()] + 0.0
            section = posture_section(robot, robot.of_shown(best))
            parts = [
                f"{key} = [{', '.join(f'{v:g}' for v in np.round(values, 6))}]"
                for key in ("positioner_deg", "slides_mm", "posture_deg")
                if (values := getattr(section, key))
            ]
            return f"; free is {', '.join(parts)}"
    return ""


def grid_poses(cell: Cell, variation_deg: FloatArray) -> PoseSet:
    """Steps 2 and 3: the 27 poses of Eq. 13, with those that cannot be taken marked dropped.

    ``variation_deg`` (3,): D_W, D_P, D_R [deg].
    """
    wpr = wpr_from_rotation(cell.robot.fk(cell.base_posture)[:3, :3])
    rotations = wpr_rotations(wpr, np.deg2rad(variation_deg))
    base, robot = cell.base_posture, cell.robot
    poses = poses_about_tool(robot, rotations, cell.tool_m, cell.target_m, base, cell.margin)
    if robot.n < AXES_OF_A_POSE:  # it turns about fewer axes than three: many are the same
        poses = poses[once(poses.reshape(-1, 16))]
        rotations = poses[:, :3, :3]
    if cell.estimates_lens:
        poses = spread_over_image(cell, poses, variation_deg)
    stations, n = _stations(cell), len(poses)
    q, reasons = np.empty((n, cell.robot.n)), [""] * n
    for k, near in enumerate(stations):
        own = slice(k, None, len(stations))
        found = nearest_postures(cell.checker, poses[own], near)
        q[own], reasons[own] = found.q, found.reasons
    return PoseSet.of_grid(q, tuple(reasons), rotations)


def _stations(cell: Cell) -> FloatArray:
    """Base posture, and the same with each external axis to either side ``(K, n)`` [rad, m].

    The grid takes them in turn: what measures from one place on a rail tells nothing of the rail,
    nor how the arm stands on it; nor does one angle of a table tell anything of its axis.
    """
    robot, found = cell.robot, [cell.base_posture]
    by = np.where(robot.sliding, ASIDE_OF_REACH * robot.chain.reach_m, ASIDE_RAD)
    for j in range(robot.n_external):
        for way in (-1.0, 1.0):
            aside = cell.base_posture.copy()
            aside[j] += way * by[j]
            found.append(np.clip(aside, robot.lower, robot.upper))
    return np.array(found)


def spread_over_image(cell: Cell, T_base_tip: FloatArray, variation_deg: FloatArray) -> FloatArray:
    """Move the tips ``(N, 4, 4)`` of the poses of a grid so that the board is elsewhere in each.

    A lens is seen by a board at all places of the image and at several distances. Columns, rows and
    distances, three of each, go through the grid so that every place meets every angle of W, P and
    R as often (an orthogonal array); the base pose stays as it is.
    """
    w, p, r = np.sign(np.unique(GRID * variation_deg, axis=0)).astype(int).T + 1
    levels = np.stack([w + p + 2, p + r + 2, w + 2 * r + 1], axis=-1) % 3 - 1
    there = cell.board_set_up
    T_middle_camera = there.cameras(T_base_tip)
    straight = -T_middle_camera[:, :3, 3]
    distance = np.linalg.norm(straight, axis=1)
    sight = T_middle_camera[:, :3, :3]
    # the camera as it is turned for a board in the middle; its distance as far as focus allows
    half_m = float(np.linalg.norm(there.board.size_m)) / 2.0
    bounds = there.nearest_m + half_m, max(there.nearest_m, there.farthest_m - half_m)
    moved_m = np.clip(distance * DISTANCES[levels[:, 2] + 1], *bounds)
    found = there.views(SPREAD * levels[:, :2], moved_m, sight)
    at_rest = ~levels.any(axis=1)
    found[at_rest] = T_middle_camera[at_rest]
    return there.tip_poses(found)


SPREAD = 0.8
"""Part of the room in the image that the poses of a grid move a board by."""

DISTANCES = np.array([0.8, 1.0, 1.25])
"""Their distances from it, over that of the base pose."""


def identification_jacobian(linear: Linearisation) -> FloatArray:
    """Blocks ``(N, m, p)`` that the condition numbers of a set of poses are those of.

    Where the lens of a camera is estimated, too, its values are marginalised: what of the others
    they do not take up is left, ``(N, m, p')``. Terms of a distortion resemble each other whatever
    the poses, and would hide how well these show camera and board.
    """
    blocks, model = regressor(linear), linear.model
    read = [isinstance(block, ReadingParameters) for block in model.parameters for _ in block.names]
    if not any(read):
        return blocks
    stacked = blocks.reshape(-1, model.p)
    lens, others = stacked[:, read], stacked[:, np.logical_not(read)]
    length = np.linalg.norm(lens, axis=0)
    Q = np.linalg.qr(lens / np.where(length > 0.0, length, 1.0))[0]
    others = others - Q @ (Q.T @ others)
    return others.reshape(*blocks.shape[:2], -1)


def told_by(
    cell: Cell, model: CalibrationModel, postures: FloatArray, which: IntArray
) -> CalibrationModel:
    """The model of a plan less what of the arm postures ``(N, n)`` [rad] do not tell.

    Zero offsets that the cell lists by name are left as they are: a plan that cannot tell one of
    them is refused. Nothing is left out of the arm that is fitted either: priors hold it.
    """
    if cell.is_hand_eye or cell.config.parameters.planned in (None, PAPER):
        return model
    data = to_be_measured(cell, model, postures, which)
    return reduce(model, data, model.nominal).model


def arms_told_by(cell: Cell, postures: FloatArray, which: IntArray) -> PriorArms:
    """The arms that are fitted to poses ``(N, n)`` [rad] of observations ``(N,)``."""
    seen = None if cell.is_hand_eye else cell.observations_among(which)
    arms = reference_of(cell, seen)
    told = told_by(cell, arms.model, postures, which)
    return arms if told is arms.model else PriorArms(told)


def to_be_measured(
    cell: Cell, model: CalibrationModel, postures: FloatArray, which: IntArray
) -> Measurements:
    """What is measured at postures ``(N, n)`` [rad] of observations ``(N,)``, nothing read yet."""
    rows, setup = cell.one_by_one(model, postures, which)
    read = None
    if any(kind.reads for kind in model.measurements):
        read = np.zeros((len(rows), model.rows))
    return Measurements(postures[rows], setup, model.targets, model.tools, read)


def regressor(linear: Linearisation) -> FloatArray:
    """Blocks ``(N, m, p)`` that condition numbers are those of.

    Not weighted, as in the paper, where all rows are lengths. Rows that are lengths and rows that
    are angles have nothing but the noise to be compared by, and pixels of a picture are off
    together by what the arm stops off.
    """
    return linear.white_jacobian if _is_mixed(linear.model) else linear.jacobian


def scaling_of(model: CalibrationModel) -> dict[str, str]:
    """In words, the scaling of each index of plans for a model."""
    if any(isinstance(block, ReadingParameters) for block in model.parameters):
        return SCALING_WITH_LENS
    return SCALING_OF_POSES if _is_mixed(model) else SCALING


def _is_mixed(model: CalibrationModel) -> bool:
    """Whether some rows are lengths and others angles, or all are pixels."""
    return any(kind.turns or kind.unit == "px" for kind in model.measurements)


def _advice(stop: StopReason, best: Round, cut_off: int) -> str:
    if stop is StopReason.THRESHOLD:
        return ""
    if cut_off and best.dropped:
        return (
            f"{best.dropped} poses were dropped, most because no clear way leads to them: move the "
            "base posture to the side of the target that has room, or what stands in the way"
        )
    if stop is StopReason.INFEASIBLE:
        return (
            "no set of these poses identifies the parameters: free fewer of them, or move the base "
            "pose to where more orientations can be reached"
        )
    if stop is StopReason.VARIATION_LIMIT:
        return "raise variations.largest_deg or plan.condition_threshold"
    lost = f" ({best.dropped} poses were dropped there)" if best.dropped else ""
    return (
        f"wider angles no longer help{lost}: raise plan.condition_threshold, or choose a base pose "
        "with more room around it"
    )
