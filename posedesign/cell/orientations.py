"""Candidate poses: orientations varied while the tool point stays on the target."""

from __future__ import annotations

from collections.abc import Callable
from itertools import product

import numpy as np

from calib.errors import UnreachableError
from calib.robots import Robot
from calib.robots.inverse.few_axes import AXES_OF_A_POSE
from calib.se3 import FloatArray, rotation_exp, rotation_from_wpr, transform, wpr_from_rotation
from posedesign.constraints import Checker, nearest_postures

GRID = np.array(list(product((-1, 0, 1), repeat=3)), dtype=float)
"""i_W, i_P, i_R of Eq. 13 of Watanabe et al. 2006, ``(27, 3)``."""


def wpr_rotations(base_wpr: FloatArray, variation: FloatArray) -> FloatArray:
    """Orientations of Eq. 13: W, P, R each varied by -D, 0, +D, ``(27, 3, 3)``.

    Nine where one D is zero, three where two are.

    Parameters
    ----------
    base_wpr : array (3,)
        W, P, R of the base pose [rad].
    variation : array (3,)
        D_W, D_P, D_R [rad].
    """
    return rotation_from_wpr(base_wpr + np.unique(GRID * variation, axis=0))


def cone_rotations(
    R_base: FloatArray, tilt: float, count: int, rng: np.random.Generator
) -> FloatArray:
    """Orientations ``(count, 3, 3)`` tilted up to an angle, rolled freely about the tool's z.

    Parameters
    ----------
    R_base : array (3, 3)
        Orientation in the middle of the cone.
    tilt : float
        Largest angle between the tool's z and that of the base pose [rad].
    rng : numpy.random.Generator
        Directions are spread evenly over the cone, rolls over the full turn.
    """
    draws = rng.random(count), *rng.random((2, count))
    return cone_rotations_at(R_base, tilt, np.stack(draws, axis=-1))


def cone_rotations_at(R_base: FloatArray, tilt: float, points: FloatArray) -> FloatArray:
    """Orientations ``(N, 3, 3)`` of a cone at points of the unit cube that it is made of.

    Points spread evenly give directions spread evenly over the cone (their cosine is uniform) and
    rolls spread evenly over the full turn.

    Parameters
    ----------
    R_base : array (3, 3)
        Orientation in the middle of the cone.
    tilt : float
        Largest angle between the tool's z and that of the base pose [rad].
    points : array (N, 3)
        Place between the rim and the middle of the cone, heading and roll, each from 0 to 1.
    """
    rim = np.cos(tilt)
    cosine = rim + (1.0 - rim) * points[:, 0]
    sine = np.sqrt(1.0 - cosine**2)
    heading, roll = -np.pi + 2.0 * np.pi * points[:, 1:].T
    axis = np.stack([np.cos(heading), np.sin(heading), np.zeros(len(points))], axis=-1)
    tilted = rotation_exp(axis * np.arctan2(sine, cosine)[:, None])
    rolled = rotation_exp(np.stack([0 * roll, 0 * roll, roll], axis=-1))
    return np.asarray(R_base @ tilted @ rolled)


def touching_poses(R_base_tip: FloatArray, tool_m: FloatArray, target_m: FloatArray) -> FloatArray:
    """Tip poses ``(N, 4, 4)`` of orientations with the tool point (tip frame) on the target [m].

    ``tool_m``, ``target_m``: ``(3,)``, or one for each ``(N, 3)``.
    """
    return transform(R_base_tip, target_m - (R_base_tip @ tool_m[..., None])[..., 0])


def poses_about_tool(
    robot: Robot,
    R_base_tip: FloatArray,
    tool_m: FloatArray,
    target_m: FloatArray,
    near: FloatArray,
    margin: float = 0.0,
) -> FloatArray:
    """Return tip poses ``(N, 4, 4)`` with the tool point on the target, turned as the arm can.

    As :func:`touching_poses`; an arm of fewer than six axes takes the orientations nearest to those
    asked for, sought from a posture ``near`` ``(n,)`` [rad, m]. The same pose may come several
    times.
    """
    poses = touching_poses(R_base_tip, tool_m, target_m)
    return robot.nearest_poses(poses, tool_m, near, margin)


_TRIAL_VARIATION = np.deg2rad([30.0, 30.0, 30.0])
"""Of the poses that a base posture is judged by."""

TRIALS = 27
"""Their number."""

_ROLLS = (0.0, np.pi)
_FRACTIONS = (0.45, 0.55, 0.65, 0.75)
_HEIGHTS = (-0.1, 0.1, 0.25, 0.4)
"""Where the tool point is tried: in front of the arm, as parts of its reach."""

_TRIED_PER_PLACE = 2
"""Postures of each place, the roomiest first, for which the trial poses are solved."""


def suggest_tool(robot: Robot) -> FloatArray:
    """A tool point ``(3,)`` [m] of the size that suits the arm, off the axis of its last joint.

    On the axis, turning the last joint would not move it, and would tell nothing.
    """
    size = robot.chain.reach_m
    return np.round(np.array([0.05 * size, 0.0, 0.1 * size]), 2)


def suggest_base_posture(
    robot: Robot,
    tool_m: FloatArray,
    *,
    ahead: bool = False,
    suits: Callable[[FloatArray], bool] = lambda q: True,
) -> FloatArray:
    """A posture with the tool pointing down in front of the arm, and room to turn it.

    Parameters
    ----------
    tool_m : array (3,)
        Tool point in the tip frame [m].
    ahead : bool
        With the tool pointing away from the arm, in place of down.
    suits : callable
        Whether a posture ``(n,)`` [rad] can be the one.

    Returns
    -------
    array (n,)
        [rad], rounded to whole degrees: of all places tried, the one where most of the poses
        varied by 30 deg can be taken, then the one farthest from its joint limits.

    Raises
    ------
    UnreachableError
        The arm cannot point its tool so anywhere in front of it.
    """
    still = np.round((robot.lower + robot.upper) / 2.0, 2)  # slides in the middle of their way
    first = robot.n_external
    still[~robot.sliding] = np.clip(0.0, robot.lower, robot.upper)[~robot.sliding]
    still[first:] = 0.0
    at_zero = robot.state(still)
    foot, *others = at_zero.origins[first:]
    size, height = robot.chain.reach_m, float((others or [foot])[0][2])
    front = _front(robot)
    places = list(product(_ROLLS, _FRACTIONS, _HEIGHTS))
    rolls = rotation_from_wpr([[0.0, 0.0, roll] for roll, _, _ in places])
    across = np.array([-front[1], front[0], 0.0])
    R = rolls @ rotation_from_wpr([np.pi, 0.0, 0.0])
    if ahead:
        R = np.column_stack([across, [0.0, 0.0, -1.0], -front]) @ R
    targets = np.array([part * size * front + [0, 0, height + up * size] for _, part, up in places])
    near = None
    if first:  # where they stand
        targets[:, :2] += foot[:2]
        near = np.concatenate([still[:first], ((robot.lower + robot.upper) / 2)[first:]])
    if robot.floor:
        R, targets = _above_plate(robot, still, foot, ahead)
    middle = (robot.lower + robot.upper) / 2.0 if near is None else near
    if robot.n < AXES_OF_A_POSE:
        R, targets = _where_it_reaches(robot, R, tool_m)
    for turned in (np.eye(3), _onto_last_axis(robot)):
        poses = poses_about_tool(robot, R @ turned, tool_m, targets, middle)
        solutions = robot.inverse(poses, near)
        tried: list[tuple[tuple[bool, float, float], FloatArray]] = []
        for place in range(len(R)):
            found = robot.of_shown(np.round(robot.shown(solutions.of(place))))
            aside = np.abs(found - still)[:, :first].max(axis=1, initial=0.0)
            found = found[aside < 1e-3]
            rooms = [_room(robot, q) for q in found]
            for k in np.argsort(rooms, kind="stable")[::-1][:_TRIED_PER_PLACE]:
                clear = (ahead or is_clear_below(robot, tool_m, found[k])) and (
                    robot.floor > 0 or _is_ahead(robot, tool_m, found[k], front)
                )
                key = clear, round(rooms[k], 2), -float(np.abs(found[k]).sum())
                tried.append((key, found[k]))
        best, most = None, -1
        for (clear, _, _), q in sorted(tried, key=lambda each: each[0], reverse=True):
            if most >= TRIALS + (_WORTH if clear else 0):  # all that follow have less room
                break
            count = trial_poses(robot, tool_m, q) + (_WORTH if clear else 0)
            if count > most and suits(q):
                best, most = q, count
        if best is not None:
            return best
    raise UnreachableError(
        f"{robot.name}: the tool cannot point {'ahead' if ahead else 'down'} in front of the arm",
        hint=f"is {robot.tip_frame} the mounting face? name another tip; or give a base posture of "
        "your own in [base_pose]",
        name="base_pose",
    )


_WORTH = 9
"""Trial poses that a place is worth in front of the arm and with nothing of it below the target."""

_CLEAR_OF_REACH = 0.12
"""Distance of the arm's links from what carries a target, of the arm's reach."""

_BELOW_OF_REACH = 0.03
"""Height from which on that stands, below the target."""

_POINTS_OF_LINK = np.linspace(0.0, 1.0, 21)[:, None]
"""Points of each link that are looked at, from joint to joint."""


def is_clear_below(robot: Robot, tool_m: FloatArray, q: FloatArray) -> bool:
    """Return True if no link of an arm at a posture ``(n,)`` is next to a post under its target.

    Links are taken for the lines between their joints.
    """
    state = robot.state(q)
    up = (robot.T_base_floor(q) @ robot.T_floor_world)[:3, 2] if robot.floor else np.eye(3)[2]
    corners = state.origins[robot.n_external :]
    steps = np.diff(corners, axis=0)[:, None]
    points = (corners[:-1, None] + steps * _POINTS_OF_LINK).reshape(-1, 3)
    size = robot.chain.reach_m
    away = points - (state.point(tool_m) - _BELOW_OF_REACH * size * up)
    above = np.maximum(away @ up, 0.0)
    across = np.linalg.norm(away - np.outer(away @ up, up), axis=1)
    return bool(np.hypot(across, above).min(initial=np.inf) > _CLEAR_OF_REACH * size)


def _is_ahead(robot: Robot, tool_m: FloatArray, q: FloatArray, front: FloatArray) -> bool:
    """Return True if the tool point is within 60 deg of the front of an arm, seen from its foot."""
    state = robot.state(q)
    out = (state.point(tool_m) - state.origins[robot.n_external]) * [1.0, 1.0, 0.0]
    return bool(out @ front >= 0.5 * np.linalg.norm(out))


def _onto_last_axis(robot: Robot) -> FloatArray:
    """Return the rotation ``(3, 3)`` of the tip that has the last joint's axis where its z was.

    Descriptions may have the z of their last link across the axis that the flange turns about.
    """
    state = robot.state(np.zeros(robot.n))
    axis = state.R_base_tip.T @ state.axes[-1]
    out = state.R_base_tip.T @ (state.p_base_tip - state.origins[max(robot.n - 3, 0)])
    axis = axis if axis @ out >= 0.0 else -axis
    turn = np.cross(axis, [0.0, 0.0, 1.0])
    sine = float(np.linalg.norm(turn))
    if sine < 1e-6:
        return np.eye(3)
    return np.asarray(rotation_exp(turn / sine * np.arctan2(sine, axis[2])))


_PLACES_OF_FEW_AXES = 24
_INNER = 0.25
"""Of the range of each joint, to either side, that postures of an arm of few axes keep out of."""


def _where_it_reaches(
    robot: Robot, R: FloatArray, tool_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return orientations ``(K, 3, 3)`` and the places ``(K, 3)`` [m] of an arm of few axes.

    Where its joints bring the tool point, from the middle of their ranges on: a Cartesian robot has
    no front, and a SCARA no choice of heights.
    """
    rng = np.random.default_rng(0)
    share = rng.uniform(_INNER, 1.0 - _INNER, (_PLACES_OF_FEW_AXES, robot.n))
    share[0] = 0.5
    places = robot.state(robot.lower + share * robot.joint_range).point(tool_m)
    turns = R[np.unique(R.reshape(len(R), 9).round(6), axis=0, return_index=True)[1]]
    return np.tile(turns, (len(places), 1, 1)), np.repeat(places, len(turns), axis=0)


_ASIDE = (0.06, 0.12)
_ABOVE = (0.06, 0.12, 0.25)
"""Where it is tried above what a positioner carries, towards the arm: as parts of its reach."""


def _above_plate(
    robot: Robot, still: FloatArray, foot: FloatArray, ahead: bool
) -> tuple[FloatArray, FloatArray]:
    """Orientations ``(K, 3, 3)`` of the tip and points ``(K, 3)`` [m], in the base that turns.

    Off the axis of the table, or turning it would tell nothing.
    """
    W = (robot.T_base_floor(still) @ robot.T_floor_world)[:3, :3]  # upright, as the floor is
    front = (W.T @ -foot) * [1.0, 1.0, 0.0]
    front /= max(float(np.linalg.norm(front)), 1e-9)
    places = list(product(_ROLLS, _ASIDE, _ABOVE))
    R = rotation_from_wpr([[0.0, 0.0, roll] for roll, _, _ in places])
    R = R @ rotation_from_wpr([np.pi, 0.0, 0.0])
    if ahead:
        across = np.array([-front[1], front[0], 0.0])
        R = np.column_stack([across, [0.0, 0.0, -1.0], -front]) @ R
    up = np.array([0.0, 0.0, 1.0])
    points = np.array([above * up - aside * front for _, aside, above in places])
    return W @ R, robot.chain.reach_m * points @ W.T


def trial_poses(robot: Robot, tool_m: FloatArray, q: FloatArray) -> int:
    """How many poses of the trial grid around a posture can be taken."""
    state = robot.state(q)
    rotations = wpr_rotations(wpr_from_rotation(state.R_base_tip), _TRIAL_VARIATION)
    poses = poses_about_tool(robot, rotations, tool_m, state.point(tool_m), q)
    return int(nearest_postures(Checker(robot), poses, q).feasible.sum())


def _room(robot: Robot, q: FloatArray) -> float:
    """How far a posture is from its limits and from a singularity, about 0 to 0.5."""
    inside = np.minimum(q - robot.lower, robot.upper - q) / robot.joint_range
    limits = inside[robot.n_external :].min()
    dexterity = robot.chain.smallest_singular_values(robot.state(q))
    return float(min(limits, dexterity))


def _front(robot: Robot) -> FloatArray:
    """Horizontal unit vector to where the arm reaches with its first joint in mid-range.

    Where it points at zero, if it is stretched out then; else where its other joints bring the tip
    on average: an arm that stands upright at zero may lean back a little.
    """
    middle, first = (robot.lower + robot.upper) / 2.0, robot.n_external
    q = np.tile(middle, (_DRAWN_FOR_FRONT, 1))
    q[0, first + 1 :] = np.clip(0.0, robot.lower, robot.upper)[first + 1 :]
    share = np.random.default_rng(0).random((_DRAWN_FOR_FRONT - 1, robot.n - first - 1))
    q[1:, first + 1 :] = robot.lower[first + 1 :] + share * robot.joint_range[first + 1 :]
    state = robot.state(q)
    forward = state.p_base_tip * [1.0, 1.0, 0.0]
    if first:
        forward = forward - state.origins[:, first] * [1.0, 1.0, 0.0]
    size = robot.chain.reach_m
    at_zero, usual = forward[0], forward[1:].mean(axis=0)
    for out, least in ((at_zero, _STRETCHED), (usual, 0.05), (at_zero, 0.05)):
        length = float(np.linalg.norm(out))
        if length > least * size:
            return np.asarray(out / length)
    return np.array([1.0, 0.0, 0.0])


_DRAWN_FOR_FRONT = 201
_STRETCHED = 0.3
"""Of the reach: an arm whose tip is farther from its foot at zero points to its front."""
