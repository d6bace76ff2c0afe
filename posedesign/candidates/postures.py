"""Postures that take poses, and next to given ones; even draws, and why nothing is left of them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, UnreachableError, near_names
from calib.robots import InverseSolutions, Robot
from calib.robots.bounds import LIMIT_TOLERANCE, Bounds
from calib.robots.inverse import CLOSURE_TOLERANCE, first_per_group, pose_error
from calib.robots.inverse.few_axes import AXES_OF_A_POSE
from calib.robots.inverse.solutions import close_in
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_exp
from posedesign.cell import Cell, touching_poses
from posedesign.constraints import ROUNDING, Checker, Verdicts
from posedesign.constraints.checker import nearest_rows

Configurations = Literal["nearest", "front", "all"]
"""``nearest``: of each pose the one posture nearest to the base posture, as in the paper's loop.
``front``: every branch of the arm, elbow and wrist, with the first joint on the side of the base
posture. ``all``: those that reach over the arm's back, too."""

CONFIGURATIONS: tuple[Configurations, ...] = get_args(Configurations)

IN_WORDS = {
    "nearest": "the nearest posture of each",
    "front": "every branch with the arm in front",
    "all": "every branch, over the arm's back too",
}

FRONT_RAD = np.pi / 2
"""Turn of the first joint from the base posture up to which the arm is in front."""

MOST_PER_POSE = 8
"""Postures of one pose that a redundant arm gives a pool: as many as a six-axis arm has branches.
It has a hundred and more of each, most of which differ by a few degrees of its elbow."""

LOOKED_AT_PER_POSE = 2 * MOST_PER_POSE
"""Postures of one pose that are looked at first."""

_AT_ONCE = 10_000
"""Poses solved at once, so that what is looked at stays within some 20 MB."""

_REDUNDANT_AT_ONCE = 320
"""The same for arms of more than six axes, which take each pose in a hundred ways."""

_STEP_RAD = 0.05
"""Largest turn of the tool that is followed at once. Newton's steps then stay on the branch of the
arm that they started on unless a singularity lies in between."""

_NEWTON_STEPS = 12
"""Of each turn; away from singularities three or four are enough."""

_ITERATIONS = 60
"""Each brings the root nearer by a factor of four at least; 60 reach the last digit."""

MOST = 10_000_000
"""Points of a pool: more would fill the memory of a computer with their postures alone."""

SAME_RAD = 1e-6
"""Postures that differ by less in every joint are one: see
:data:`calib.robots.inverse.closed_form.SAME_POSTURE_RAD`."""

_LOOKED_AT = 200
"""Poses that the reason is sought at."""

_HINT = "make room around the base pose, or choose another base posture"


def check_configurations(name: str) -> Configurations:
    """One of :data:`CONFIGURATIONS`."""
    for known in CONFIGURATIONS:
        if known == name:
            return known
    raise InputError(
        f"there are no configurations {name!r}",
        hint=near_names(str(name), CONFIGURATIONS),
        name="configurations",
        value=name,
    )


def feasible_postures(
    checker: Checker, T_base_tip: FloatArray, base: FloatArray, configurations: Configurations
) -> tuple[FloatArray, IntArray]:
    """Postures ``(S, n)`` [rad] that take poses and keep every constraint, and the pose of each.

    Poses are in ascending order. Each joint takes that full turn inside the limits which lies
    nearest to ``base`` (n,).
    """
    postures, pose = [np.empty((0, len(base)))], [np.empty(0, dtype=np.intp)]
    at_once = _AT_ONCE if checker.robot.n <= 6 else _REDUNDANT_AT_ONCE
    for start in range(0, len(T_base_tip), at_once):
        part = T_base_tip[start : start + at_once]
        solutions = checker.robot.inverse(part, near=base, margin=checker.margin)
        if configurations == "nearest":
            row, _ = nearest_rows(checker, solutions)
            rows = row[row >= 0]
        else:
            rows = np.flatnonzero(solutions.inside & asked_for(solutions, configurations))
            rows = _some_feasible(checker, solutions, rows)
        postures.append(solutions.postures[rows])
        pose.append(solutions.pose[rows] + start)
    return np.concatenate(postures), np.concatenate(pose)


def _some_feasible(checker: Checker, solutions: InverseSolutions, rows: IntArray) -> IntArray:
    """Of some rows those that keep every constraint, at most :data:`MOST_PER_POSE` of each pose.

    Of the hundreds of a redundant arm some of all kinds are looked at first, and the others only of
    poses of which these were not enough.
    """
    pose = solutions.pose[rows]
    first = evenly(pose, LOOKED_AT_PER_POSE)
    good = np.zeros(len(rows), dtype=bool)
    good[first] = checker.check(solutions.postures[rows[first]], every=False).feasible
    few = np.bincount(pose[good], minlength=len(solutions.gap_m)) < MOST_PER_POSE
    more = ~first & few[pose]
    good[more] = checker.check(solutions.postures[rows[more]], every=False).feasible
    rows = rows[good]
    return np.asarray(rows[evenly(solutions.pose[rows], MOST_PER_POSE)])


def asked_for(solutions: InverseSolutions, configurations: Configurations) -> BoolArray:
    """Whether each posture ``(S,)`` is of the configurations asked for."""
    if configurations != "front":
        return np.ones(len(solutions.pose), dtype=bool)
    first = solutions.chain.external.count
    return in_front(solutions.postures[:, first], float(solutions.near[first]))


def in_front(first: FloatArray, base: float) -> BoolArray:
    """Whether the first joint of the arm ``(S,)`` [rad] is on the side of the base posture."""
    turn = first - base
    return np.asarray(np.abs(np.remainder(turn + np.pi, 2.0 * np.pi) - np.pi) <= FRONT_RAD)


def evenly(pose: IntArray, most: int) -> BoolArray:
    """Rows to keep ``(S,)`` so that no pose has more than so many, spread over its rows."""
    first = np.searchsorted(pose, pose)
    count = np.searchsorted(pose, pose, side="right") - first
    rank, wanted = np.arange(len(pose)) - first, np.minimum(count, most)
    return np.asarray(rank * wanted // count > (rank - 1) * wanted // count)


def local_poses(
    cell: Cell,
    postures: FloatArray,
    turns: ArrayLike,
    touched_m: FloatArray | None = None,
    tool_m: FloatArray | None = None,
) -> FloatArray:
    """Postures ``(N, n)`` [rad] with the tool turned about the point that it touches.

    Of the same branch of the arm as those given and next to them, for they are followed along the
    turn. A redundant arm moves its joints as little as it can.

    ``turns`` (N, 3) are rotation vectors r [rad] in the axes of the tip: its orientation becomes
    ``R exp(r)``, as in :mod:`calib.model.parameters.frames`; in base axes it would be ``R.T @ r``.
    ``touched_m`` (N, 3): where the tool point stays [m], base frame; by default where it is. Given,
    the rounding of one step after another does not add up. ``tool_m`` (N, 3): the point [m] that
    the tool is turned about, in the tip frame; the cell's by default. NaN where no such posture
    lies inside the limits less the margin of the cell, or where the turn leads into a singularity;
    other constraints are not looked at: see :func:`~posedesign.candidates.feasible`.
    """
    robot = cell.robot
    q = np.atleast_2d(robot.check_posture(postures))
    by = np.asarray(turns, dtype=float)
    if by.shape != (len(q), 3) or not np.isfinite(by).all():
        raise InputError(
            f"{len(q)} postures need turns of shape ({len(q)}, 3), not {by.shape}",
            hint="give a rotation vector in radians for each",
            name="turns",
        )
    state = robot.state(q)
    tool = np.broadcast_to(cell.tool_m if tool_m is None else tool_m, (len(q), 3))
    if touched_m is None:
        touched_m = (state.T_base_tip @ np.append(tool, np.ones((len(q), 1)), axis=1)[..., None])[
            :, :3, 0
        ]
    place = np.asarray(touched_m, dtype=float)
    if place.shape != (len(q), 3):
        raise InputError(f"{len(q)} postures touch places ({len(q)}, 3)", name="touched_m")
    bounds = Bounds.within(
        robot.lower, robot.upper, robot.coupled_limits, cell.margin, robot.external
    )
    steps = np.maximum(1.0, np.ceil(np.linalg.norm(by, axis=1) / _STEP_RAD))
    found = q.copy()
    for k in range(1, int(steps.max(initial=0.0)) + 1):
        rows = np.flatnonzero(steps >= k)
        turned = state.R_base_tip[rows] @ rotation_exp(by[rows] * (k / steps[rows, None]))
        T = touching_poses(turned, tool[rows], place[rows])
        if robot.n < AXES_OF_A_POSE:
            there = np.isfinite(found[rows]).all(axis=1)
            rows, T = rows[there], T[there]
            T = robot.nearest_poses(T, tool[rows], found[rows], same_branch=True)
        found[rows] = _followed(robot, found[rows], T, bounds)
    found[~_same_branch(robot, q, found)] = np.nan
    found[~(bounds.excess(found).max(axis=1) <= LIMIT_TOLERANCE)] = np.nan
    return found


def _followed(robot: Robot, q: FloatArray, T_base_tip: FloatArray, bounds: Bounds) -> FloatArray:
    """Postures closed in on poses, NaN where that failed."""
    there = np.flatnonzero(np.isfinite(q).all(axis=1))
    # only a redundant arm can go on where a joint is at its limit
    free = robot.n <= 6
    lower, upper = (np.full(robot.n, sign * np.inf) for sign in (-1, 1))
    if not free:
        lower, upper = bounds.lower, bounds.upper
    T = T_base_tip[there]
    closed = close_in(robot.chain, q[there], T, lower, upper, _NEWTON_STEPS)
    miss = np.abs(pose_error(robot.chain, closed, T)).max(axis=1, initial=0.0)
    out = np.full(q.shape, np.nan)
    out[there[miss < CLOSURE_TOLERANCE]] = closed[miss < CLOSURE_TOLERANCE]
    return out


def _same_branch(robot: Robot, q: FloatArray, moved: FloatArray) -> BoolArray:
    """Whether no singularity lies between postures: there the Jacobian's determinant is zero."""
    if robot.n != 6:
        return np.ones(len(q), dtype=bool)
    signs = np.full(len(q), np.nan)
    there = np.isfinite(moved).all(axis=1)
    signs[there] = np.linalg.slogdet(robot.jacobian(moved[there]))[0]
    return np.asarray(signs == np.linalg.slogdet(robot.jacobian(q))[0])


def even_points(count: int, dimensions: int, rng: np.random.Generator) -> FloatArray:
    """Points ``(count, dimensions)`` of the unit cube, spread more evenly than independent ones.

    The additive sequence of Kronecker with the steps of [Roberts2018]_: powers of the root of
    ``x**(d + 1) = x + 1``. A random shift makes each point alone uniform over the cube. Of 3,000
    points in three dimensions the largest gap is 0.060, that of scrambled Sobol points 0.075, and
    of independent ones 0.094; from 100 points on and up to seven dimensions the order is the same.

    References
    ----------
    .. [Roberts2018] M. Roberts, "The unreasonable effectiveness of quasirandom sequences", 2018.
    """
    root = 2.0
    for _ in range(_ITERATIONS):
        root = (1.0 + root) ** (1.0 / (dimensions + 1))
    steps = root ** -np.arange(1.0, dimensions + 1.0)
    return np.asarray(np.remainder(rng.random(dimensions) + np.arange(count)[:, None] * steps, 1.0))


def check_count(count: int) -> int:
    """A number of draws that can be made."""
    if not (1 <= count <= MOST and count == int(count)):
        raise InputError(
            f"{count} draws: a pool is made of 1 to {MOST}", name="count", value=count, bound=1
        )
    return int(count)


def once(rows: FloatArray, tolerance: float = SAME_RAD) -> BoolArray:
    """Whether rows ``(S, k)`` are there for the first time, ``(S,)``.

    Those of which no number differs by as much as the tolerance are the same.
    """
    # along any line the same rows lie together, and hardly any others
    line = np.sqrt(np.arange(2.0, rows.shape[1] + 2.0))
    place = rows @ line
    order = np.argsort(place, kind="stable")
    width = tolerance * line.sum()
    first = np.ones(len(rows), dtype=bool)
    later, back = np.arange(len(rows)), 1
    while len(later):
        later = later[later >= back]
        one, other = order[later], order[later - back]
        near = place[one] - place[other] <= width
        later, one, other = later[near], one[near], other[near]
        same = np.abs(rows[one] - rows[other]).max(axis=1, initial=0.0) < tolerance
        first[np.maximum(one, other)[same]] = False
        back += 1
    return first


def no_pose(
    checker: Checker,
    T_base_tip: FloatArray,
    base: FloatArray,
    asked_for: Callable[[InverseSolutions], BoolArray],
    otherwise: tuple[str, str],
) -> UnreachableError:
    """The error of a pool of poses ``(N, 4, 4)`` without a posture: the reason met most often.

    Of each pose the branch counts that comes nearest to being possible, and of the poses that break
    the same constraint the one that comes nearest is told of.

    ``asked_for`` tells which postures would have been taken; ``otherwise`` is the reason where
    there are only others, and the hint then.
    """
    some = T_base_tip[_some(len(T_base_tip))]
    solutions = checker.robot.inverse(some, near=base, margin=checker.margin)
    verdicts = checker.check(solutions.postures)
    branch = first_per_group(solutions.pose, -verdicts.nearness, len(some))
    reached = branch >= 0
    unasked = np.zeros(len(some), dtype=bool)
    unasked[solutions.pose[verdicts.feasible & ~asked_for(solutions)]] = True
    count, *why = _commonest(verdicts, branch[reached & ~unasked])
    counts = [count, int((~reached).sum()), int(unasked.sum())]
    most = int(np.argmax(counts))
    reason, hint = (why, ("out of reach", "move the target, or the base posture"), otherwise)[most]
    return _error(len(T_base_tip), "poses can be taken", counts[most] / len(some), reason, hint)


def no_posture(checker: Checker, postures: FloatArray, tried: int) -> UnreachableError:
    """The same for postures ``(S, n)`` [rad] that were drawn, of so many."""
    verdicts = checker.check(postures[_some(len(postures))])
    count, reason, hint = _commonest(verdicts, rows := np.arange(len(verdicts.margin)))
    return _error(tried, "postures keep every constraint", count / len(rows), reason, hint)


def _some(count: int) -> IntArray:
    return np.linspace(0, count - 1, min(count, _LOOKED_AT)).astype(np.intp)


def _commonest(verdicts: Verdicts, rows: IntArray) -> tuple[int, str, str]:
    """How many postures break the constraint that most do; of the nearest, the reason and a hint.

    Of several constraints the one that is broken worst.
    """
    broken = (verdicts.margin[rows] < -ROUNDING).sum(axis=0)
    worst = np.bincount(verdicts.tightest[rows], minlength=len(broken))
    k = int(np.lexsort((worst, broken))[-1])
    rows = rows[verdicts.margin[rows, k] < -ROUNDING]
    if not len(rows):
        return 0, "", ""
    best = int(rows[np.argmax(verdicts.nearness[rows])])
    reason = f"{verdicts.constraints[k].name}, e.g. {verdicts.reason(best, k)}"
    return int(broken[k]), reason, verdicts.hint(best, k)


def _error(tried: int, what: str, share: float, reason: str, hint: str) -> UnreachableError:
    return UnreachableError(
        f"none of {tried} {what}; {share:.0%} of them: {reason}", hint=hint or _HINT, name="pool"
    )
