"""Moving arms by their controllers: nominal postures, and lost motion taken up on arrival.

Every move goes through here and is checked: before it against the limits, against what stands
around and against what was planned; after it the joints that the controller shows against those
that it was sent to.

Joint values that a controller shows, against those that it was sent to.

Everything downstream believes what is shown: the next move starts from it, and a touch-up is made
of it. A turn too many, a sign, degrees or a value of the move before is therefore told here, by
what it looks like.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from calib.errors import CalibError, InputError
from calib.robots import Robot
from calib.robots.bounds import LIMIT_TOLERANCE
from calib.robots.inverse import CLOSURE_TOLERANCE, pose_error
from calib.robots.inverse.solutions import close_in
from calib.robots.one_posture import OnePosture
from calib.se3 import BoolArray, FloatArray, IntArray, transform
from calib.vision.touch_up.arms import Arms

_ITERATIONS = 12
"""Newton steps of a shift by centimetres: three or four, more only where there is no posture."""


_CLOSED = 0.01 * CLOSURE_TOLERANCE
"""Distance [m] and angle [rad] from a pose at which nothing more is gained by a step."""


def follow(
    robot: Robot, q: FloatArray, T_wanted: FloatArray, one: OnePosture | None = None
) -> tuple[FloatArray, BoolArray]:
    """Postures next to ``(S, n)`` [rad] that bring the nominal tip to poses ``(S, 4, 4)``.

    As a controller runs a short straight move: the arm does not change its configuration, and what
    carries it stays. And which were found ``(S,)``: not where joint limits or a singularity are in
    the way.
    """
    first, arm = robot.n_external, robot.chain.arm
    if len(q) == 1 and not first:
        one = OnePosture(robot) if one is None else one
        posture, off = one.close_in(q[0], T_wanted[0], _CLOSED, _ITERATIONS)
        out, error = posture[None], np.array([off])
    else:
        T = robot.chain.at_rest(T_wanted, q[:, :first]) if first else T_wanted
        lower, upper = robot.lower[first:], robot.upper[first:]
        out = close_in(arm, q[:, first:], T, lower, upper, _ITERATIONS)
        error = np.abs(pose_error(arm, out, T)).max(axis=-1)
        out = np.hstack([q[:, :first], out])
    found = error < CLOSURE_TOLERANCE
    for limit in robot.coupled_limits:
        found &= limit.margin(out) >= 0.0
    return out, np.asarray(found)


def shifted(T_base_tip: FloatArray, shift_m: FloatArray) -> FloatArray:
    """Poses ``(..., 4, 4)`` of a tip moved by ``(..., 3)`` [m] in its own axes."""
    return T_base_tip @ transform(np.eye(3), shift_m)


Refuses = Callable[[FloatArray, FloatArray], list[str]]
"""Of straight joint moves from ``(K, n)`` to ``(K, n)`` [rad], why each must not be made; empty
where it may. A start that is NaN is not known: only the end can be told."""

Around = Callable[[FloatArray, FloatArray], list[FloatArray] | None]
"""Postures to pass from ``(n,)`` to ``(n,)`` [rad] where the straight move must not be made; None
where there is no other way either."""

SHOWN_WITHIN_RAD = np.deg2rad(0.1)
"""Joints that are shown farther than this from what was commanded were not moved there. Controllers
stop within some thousandths of a degree of a fine position and show hundredths at least, and an
encoder behind a reducer shows its lost motion besides; a hand on the jog keys, a turn, a sign or a
pendant's J3 in the place of the description's is far more."""

LARGEST_CORRECTION_RAD = np.deg2rad(45.0)
"""Turn of a joint that corrections may add to a planned posture: a shift by ten centimetres half a
metre from a joint is eleven degrees. What needs more passes a singularity."""


@dataclass(frozen=True, eq=False)
class Drive:
    """Arms, and how they are moved."""

    robot: Robot  # nominal: what the controller knows
    arms: Arms
    approach_rad: float = np.deg2rad(0.2)
    """Every stop is reached by a last movement of this angle in all joints, always in the positive
    sense, so that backlash and friction leave the joints on the same side; 0 for none. It has to be
    more than the lost motion of a joint."""
    refuses: Refuses | None = None
    """Asked before every move; the limits of the joints are always kept."""
    around: Around | None = None  # asked where the straight move to a posture is refused
    shown_within_rad: float = SHOWN_WITHIN_RAD
    """By which joints may be shown off what was commanded: rounding of the controller, width of its
    fine positions, lost motion where encoders see it."""
    largest_correction_rad: float = LARGEST_CORRECTION_RAD
    """By which corrections may turn a joint away from the posture that was planned."""
    tell: Callable[[str], None] = lambda text: None  # told what could not be checked
    _sent: FloatArray = field(init=False, repr=False)
    """Where each arm was sent last ``(S, n)`` [rad]; NaN before its first move."""
    _one: OnePosture = field(init=False, repr=False)
    _left: FloatArray = field(init=False, repr=False)
    """Where each arm was left by an earlier drive ``(S, n)`` [rad]; NaN where that is not known."""

    def __post_init__(self) -> None:
        if self.robot.n_external:
            raise InputError(
                f"{self.robot.joint_names[0]} is an external axis, and by sight only the "
                "joints of the arm are driven",
                hint="hold it where it is: robot.held_mm",
                name=self.robot.joint_names[0],
            )
        unknown = np.full((self.arms.count, self.robot.n), np.nan)
        object.__setattr__(self, "_one", OnePosture(self.robot))
        object.__setattr__(self, "_sent", unknown)
        object.__setattr__(self, "_left", unknown.copy())

    def was_left_at(self, which: IntArray, q: FloatArray) -> None:
        """Arms ``(K,)`` were at postures ``(K, n)`` [rad] when they were driven last."""
        self._left[which] = q

    def to_posture(self, which: IntArray, q: FloatArray) -> list[str]:
        """Move arms ``(K,)`` to postures ``(K, n)`` [rad]; of each, why it was not moved.

        Raises
        ------
        InputError
            Joints are shown that are not where the arm was sent; nothing is commanded after that.
        """
        return self._go(which, q, self.around)

    def _go(self, which: IntArray, q: FloatArray, around: Around | None) -> list[str]:
        """See :meth:`to_posture`."""
        entry = np.maximum(q - self.approach_rad, self.robot.lower)
        if self.approach_rad == 0.0:
            entry = q
        reasons = self._beyond(q)
        _first_of(reasons, self._beyond(entry))
        free = _free(reasons)
        start = np.full_like(q, np.nan)
        start[free] = self._standing(which[free], q[free])
        self._ask(reasons, entry, q)
        blocked = list(reasons)
        self._ask(blocked, start, entry)
        for k in range(len(q)):
            if reasons[k] or not blocked[k]:
                continue
            between = None if around is None else around(start[k], entry[k])
            if between is None:
                reasons[k] = blocked[k]
            for posture in between or ():
                self._move(which[k : k + 1], posture[None])
        free = _free(reasons)
        self._move(which[free], entry[free])
        if entry is not q:
            self._move(which[free], q[free])
        return reasons

    def _ask(self, reasons: list[str], start: FloatArray, end: FloatArray) -> None:
        """Add why moves from ``(K, n)`` to ``(K, n)`` [rad] must not be made."""
        free = _free(reasons)
        if self.refuses is not None and free.any():
            _first_of(reasons, self.refuses(start[free], end[free]), free)

    def tips(self, q: FloatArray) -> FloatArray:
        """Poses ``(K, 4, 4)`` of the nominal tip at postures ``(K, n)`` [rad]."""
        return self._one.tip(q[0])[None] if len(q) == 1 else self.robot.fk(q)

    def to_pose(
        self,
        which: IntArray,
        q: FloatArray,
        T_wanted: FloatArray,
        planned: FloatArray | None = None,
    ) -> list[str]:
        """Move the nominal tip from postures ``(K, n)`` [rad] to poses ``(K, 4, 4)``.

        No joint leaves the planned postures ``(K, n)`` [rad], by default those that it starts from,
        by more than a correction may turn it.
        """
        postures, found = follow(self.robot, q, T_wanted, self._one)
        reasons = ["" if ok else "joint limits or a singularity are in the way" for ok in found]
        turned = np.abs(postures - (q if planned is None else planned))
        far = turned.max(axis=1, initial=0.0) > self.largest_correction_rad
        for k in np.flatnonzero(far & found).tolist():
            joint = self.robot.joint_names[int(np.argmax(turned[k]))]
            degrees = np.rad2deg([turned[k].max(), self.largest_correction_rad])
            reasons[k] = (
                f"the correction turns {joint} by {degrees[0]:.0f} deg off the planned posture, "
                f"{degrees[1]:.0f} deg allowed"
            )
        free = _free(reasons)
        _first_of(reasons, self._go(which[free], postures[free], None), free)
        return reasons

    def _move(self, which: IntArray, q: FloatArray) -> None:
        """Command moves of arms ``(K,)`` to ``(K, n)`` [rad], and check that they were made."""
        if not which.size:
            return
        before = self._sent[which]
        self._sent[which] = np.nan  # until it is seen there
        self.arms.move(which, q)
        self._check(q, self._shown(which), "after the move to", before)
        self._sent[which] = q

    def _standing(self, which: IntArray, q: FloatArray) -> FloatArray:
        """Where arms ``(K,)`` stand ``(K, n)`` [rad] that are to go to ``(K, n)``.

        Where they were sent last, if that is what is shown; before the first move what is shown,
        NaN where that is nothing.
        """
        if not which.size:
            return np.empty_like(q)
        sent, shown = self._sent[which], self._shown(which)
        first = np.asarray(np.isnan(sent).any(axis=1))
        self._check(sent[~first], shown[~first], "where it was left at", None)
        for k in np.flatnonzero(first).tolist() if first.any() else ():
            if np.isnan(shown[k]).all():
                self.tell(
                    "where the arm stands at first is not known: the move from there to "
                    f"{_degrees(q[k])} deg is not checked"
                )
            else:
                left = self._left[which[k]]
                check_first(self.robot, q[k], shown[k], self.shown_within_rad, left)
        return np.where(first[:, None], shown, sent)

    def _check(
        self, asked: FloatArray, shown: FloatArray, event: str, before: FloatArray | None
    ) -> None:
        """Raise for the first arm of ``(K, n)`` [rad] that is not shown where it was sent."""
        fits = (np.abs(shown - asked) <= self.shown_within_rad).all(axis=1)
        if fits.all():
            return
        k = int(np.argmin(fits))
        known = before is not None and np.isfinite(before[k]).all()
        check_shown(
            self.robot,
            asked[k],
            shown[k],
            self.shown_within_rad,
            before=before[k] if before is not None and known else None,
            event=event,
        )

    def _shown(self, which: IntArray) -> FloatArray:
        """Joint values ``(K, n)`` [rad] that controllers show, as many as there are joints."""
        shown = np.asarray(self.arms.joints(which), dtype=float)
        if np.isnan(shown).all():
            return np.full((len(which), self.robot.n), np.nan)
        if shown.shape != (len(which), self.robot.n):
            raise InputError(
                f"joints() of the robot's adapter gave {shown.shape[-1]} values, the arm has "
                f"{self.robot.n} joints",
                hint="give the joints of the description, in its order",
                name="joints",
            )
        return shown

    def _beyond(self, q: FloatArray) -> list[str]:
        """Which limit each of postures ``(K, n)`` [rad] breaks; nothing where it keeps all."""
        inside = np.minimum(q - self.robot.lower, self.robot.upper - q).min(axis=1, initial=np.inf)
        for limit in self.robot.coupled_limits:
            inside = np.minimum(inside, limit.margin(q))
        reasons, kept = [""] * len(q), inside >= -LIMIT_TOLERANCE
        for k in [] if kept.all() else np.flatnonzero(~kept).tolist():
            try:
                self.robot.check_limits(q[k])
            except CalibError as error:
                reasons[k] = error.message
        return reasons


def _free(reasons: list[str]) -> BoolArray:
    """Where nothing is in the way ``(K,)``."""
    return np.array([not reason for reason in reasons], dtype=bool)


def _first_of(reasons: list[str], more: list[str], where: BoolArray | None = None) -> None:
    """Take over reasons, all or those of the rows ``(K,)`` where, for those that have none."""
    rows = range(len(reasons)) if where is None else np.flatnonzero(where).tolist()
    for k, reason in zip(rows, more, strict=True):
        reasons[k] = reasons[k] or reason


def _degrees(q: FloatArray) -> str:
    return "(" + ", ".join(f"{v:.1f}" for v in np.rad2deg(q).tolist()) + ")"


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
    """Refuse joint values that are not those of a posture, by what they can be recognised as.

    Parameters
    ----------
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
    raise _misplaced(robot, worst, asked, shown, event, reason, hint)


def check_first(
    robot: Robot, asked: FloatArray, shown: FloatArray, within_rad: float, left: FloatArray
) -> None:
    """Refuse to begin where the first joint values ``(n,)`` [rad] that are shown cannot be right.

    Nothing was commanded yet to compare them with. Those outside the limits, those that are the
    posture ``(n,)`` [rad] asked for but for a turn, a sign or a unit, and those from which a joint
    would turn by more than half a turn are refused: it may well be a turn that is counted wrongly.
    That can be told where the arm was left ``(n,)`` [rad] is known; NaN where it is not.
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
        hint = (
            "nothing was commanded: jog the arm to the base posture, and compare what joints() "
            "gives with the pendant"
        )
        raise _misplaced(robot, worst, asked, shown, "before the first move, to", reason, hint)


def _misplaced(
    robot: Robot,
    joint: int,
    asked: FloatArray,
    shown: FloatArray,
    event: str,
    reason: str,
    hint: str,
) -> InputError:
    """The error of a joint that is not shown where it should be."""
    name, (value, bound) = robot.joint_names[joint], np.rad2deg([shown[joint], asked[joint]])
    said = f"{name} is shown at {_deg(value)} deg {event} {bound:.2f} deg: {reason}"
    return InputError(said, hint=hint, name=name, value=float(value), bound=float(bound))


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
