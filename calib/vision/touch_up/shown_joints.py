"""Joint values that a controller shows, against those that it was sent to.

Everything downstream believes what is shown: the next move starts from it, and a touch-up is made
of it. A turn too many, a sign, degrees or a value of the move before is therefore told here, by
what it looks like.
"""

from __future__ import annotations

import numpy as np

from calib.errors import InputError
from calib.robots import Robot
from calib.se3 import FloatArray

SHOWN_WITHIN_RAD = np.deg2rad(0.1)
"""Joints that are shown farther than this from what was commanded were not moved there. Controllers
stop within some thousandths of a degree of a fine position and show hundredths at least, and an
encoder behind a reducer shows its lost motion besides; a hand on the jog keys, a turn, a sign or a
pendant's J3 in the place of the description's is far more."""

_TURN = 2.0 * np.pi
_MOST_TURNS = 9
"""That are named as such: no controller counts more."""


def check_shown(
    robot: Robot,
    asked: FloatArray,
    shown: FloatArray,
    within_rad: float,
    *,
    before: FloatArray | None = None,
    event: str,
    hint: str = "nothing more was commanded: look where the arm stands, and mend joints() or the "
    "robot description before it is moved again",
) -> None:
    """Refuse joint values that are not those of a posture.

    Parameters
    ----------
    robot : Robot
    asked : array (n,)
        The posture [rad].
    shown : array (n,)
        What the controller shows [rad].
    within_rad : float
        By which they may differ.
    before : array (n,), optional
        Where the arm stood before it was sent to the posture [rad].
    event : str
        Words before the value asked for: "after the move to".
    hint : str
        What to do about it.

    Raises
    ------
    InputError
        Naming the joint and, where it can be recognised, what is wrong with it.
    """
    off = np.abs(shown - asked)
    if (off <= within_rad).all():
        return
    worst = int(np.argmax(np.where(np.isnan(off), np.inf, off)))
    reason = (
        _of_all(robot, asked, shown, within_rad)
        or _unmoved(asked, shown, within_rad, before)
        or _of_one(asked[worst], shown[worst], within_rad)
        or _on_its_way(asked[worst], shown[worst], None if before is None else before[worst])
    )
    value, bound = np.rad2deg([shown[worst], asked[worst]]).tolist()
    raise InputError(
        f"{robot.joint_names[worst]} is shown at {_deg(value)} deg {event} {bound:.2f} deg: "
        f"{reason}",
        hint=hint,
        name=robot.joint_names[worst],
        value=value,
        bound=bound,
    )


def check_first(
    robot: Robot, asked: FloatArray, shown: FloatArray, within_rad: float, left: FloatArray
) -> None:
    """Refuse to begin where the first joint values ``(n,)`` [rad] that are shown cannot be right.

    Nothing was commanded yet to compare them with. Those outside the limits, those that are the
    posture ``(n,)`` [rad] asked for but for a turn, a sign or a unit, and those from which a joint
    would turn by more than half a turn are refused: it may well be a turn that is counted wrongly.
    That can be told where the arm was left ``(n,)`` [rad] is known; NaN where it is not.

    Raises
    ------
    InputError
    """
    places = [asked] if np.isnan(left).any() else [asked, left]
    if any((np.abs(shown - place) <= within_rad).all() for place in places):
        return
    reason, worst = next(
        (found for place in places if (found := _taken_for(robot, place, shown, within_rad))[0]),
        ("", 0),
    )
    beyond = ~((shown >= robot.lower - within_rad) & (shown <= robot.upper + within_rad))
    if not reason and beyond.any():
        worst = int(np.argmax(beyond))
        reason = _out_of_limits(robot, worst, shown)
    far = np.fmin(np.abs(asked - shown), np.abs(left - shown)) > np.pi + within_rad
    if not reason and far.any():
        worst = int(np.argmax(np.abs(asked - shown)))
        turned = np.rad2deg(abs(asked[worst] - shown[worst]))
        reason = f"the first move would turn it by {turned:.0f} deg, 180 deg allowed"
    if reason:
        value, bound = np.rad2deg([shown[worst], asked[worst]]).tolist()
        raise InputError(
            f"{robot.joint_names[worst]} is shown at {_deg(value)} deg before the first move, to "
            f"{bound:.2f} deg: {reason}",
            hint="nothing was commanded: jog the arm to the base posture, and compare what "
            "joints() gives with the pendant",
            name=robot.joint_names[worst],
            value=value,
            bound=bound,
        )


def _taken_for(
    robot: Robot, place: FloatArray, shown: FloatArray, within_rad: float
) -> tuple[str, int]:
    """What is wrong with joint values that would be those of a posture without it; a joint."""
    off = np.flatnonzero(~(np.abs(shown - place) <= within_rad)).tolist()
    each = [_of_one(place[j], shown[j], within_rad) for j in off]
    return _of_all(robot, place, shown, within_rad) or each[0] * all(map(bool, each)), off[0]


def _of_all(robot: Robot, asked: FloatArray, shown: FloatArray, within_rad: float) -> str:
    """What all joint values together look like; nothing where it is not recognised."""
    if (np.abs(np.deg2rad(shown) - asked) <= within_rad).all():
        return "the joint values are in degrees, radians are asked for"
    controller = robot.controller
    if controller is not None and controller.differs:
        pendant = np.deg2rad(controller.pendant(asked))
        if (np.abs(pendant - shown) <= within_rad).all():
            return "the joint values are those of the pendant, the description's are asked for"
    return ""


def _unmoved(
    asked: FloatArray, shown: FloatArray, within_rad: float, before: FloatArray | None
) -> str:
    """Whether joints that had to move are shown where they were."""
    if before is None:
        return ""
    had_to = np.abs(asked - before) > within_rad
    stays = np.abs(shown - before) <= within_rad
    if stays.all():
        return "the arm did not move, or the joint values are from before the move"
    off = ~(np.abs(shown - asked) <= within_rad)
    return "it did not move, the others did" if (stays & had_to)[off].all() else ""


def _of_one(asked: float, shown: float, within_rad: float) -> str:
    """What the value of a joint looks like; nothing where it is not recognised."""
    off = shown - asked
    if abs(off) <= within_rad or not np.isfinite(off):
        return ""
    turns = round(min(max(off / _TURN, -_MOST_TURNS), _MOST_TURNS))
    if turns and abs(off - _TURN * turns) <= within_rad:
        many = "one turn" if abs(turns) == 1 else f"{abs(turns)} turns"
        return f"that is {many} of 360 deg {'on' if turns > 0 else 'back'}"
    if abs(shown + asked) <= within_rad:
        return "its sign is the opposite"
    return ""


def _on_its_way(asked: float, shown: float, before: float | None) -> str:
    """A joint that is off by an amount that nothing explains."""
    if before is not None and 0.0 < (shown - before) / (asked - before) < 1.0:
        return (
            "it has not arrived: move() returned before the arm stood still, or the arm was stopped"
        )
    return f"{np.rad2deg(abs(shown - asked)):.2f} deg off"


def _out_of_limits(robot: Robot, joint: int, shown: FloatArray) -> str:
    lower, upper, value = robot.lower[joint], robot.upper[joint], shown[joint]
    turns = [k for k in (-1, 1) if lower <= value + _TURN * k <= upper]
    if turns:
        way = "on" if turns[0] > 0 else "back"
        return f"outside its limits, and inside them one turn of 360 deg {way}"
    in_degrees = np.deg2rad(shown)
    if (
        np.abs(shown).max() > _TURN
        and ((in_degrees >= robot.lower) & (in_degrees <= robot.upper)).all()
    ):
        return "outside its limits: joint values in degrees, where radians are asked for?"
    return "outside its limits"


def _deg(value: float) -> str:
    return f"{value:.2f}" if abs(value) < 1e5 else f"{value:.3g}"
