"""Where camera and target are, from nothing: the first step of section 2.5 of Watanabe et al. 2006.

From one posture with the target in view the arm is inched around it. Small moves tell how the
camera is turned, how far the target is and how large (:mod:`calib.visual.jacobian`). Then the tip
is turned, a little at first, and the target touched up again: postures at which the same point of
the tip frame is on the same point of the base tell where both are, and each tells better where to
turn about for the next, wider turn.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from calib.camera.conic import ellipse_axes
from calib.robots import Robot
from calib.robots.inverse import NEAR_SINGULAR
from calib.se3 import FloatArray, rotation_exp, transform
from calib.visual.facing import Facing, find_normal
from calib.visual.following import follow, shifted
from calib.visual.jacobian import ImageJacobian, MeasuredJacobian
from calib.visual.pin import Pin, solve_pin
from calib.visual.relation import Relation
from calib.visual.servo import Loop, TouchUps
from calib.visual.station import Station

_PROBES_M = (2e-3, 6e-3, 18e-3)
"""First moves, of which nothing is known but that they are small: the next where the picture does
not show one."""

_CLEAR_PX = 4.0
"""What a move has to change in the picture to be told from the errors of picture and arm."""

_MIDDLE_PX = 1.0
"""Error across the picture at which the target is near enough to its middle for wide moves."""

_STEP_OF_ROOM = 0.4
"""Length of the moves that the Jacobian is measured by, of the way that the target has to the edge
of the picture: a twentieth of the distance of the target, which changes its size by a hundred
times the noise."""

_STEPS_OF_DISTANCE = (0.15, 0.07)
"""Moves along the view line, of the distance of the target: the second where there is no room for
the first."""

_ASIDE = 3.0
"""How far the arm goes aside to see its lost motion, in last movements."""

_LEAST_ROOM_PX = 10.0
"""Way to the edge of the picture with which a target can be moved about in it."""

_TURNS = (
    (0.13, ((1, 0, 0), (0, 1, 0))),
    (0.33, ((-1, 0, 0), (0, -1, 0), (0, 0, 1))),
    (
        1.0,
        (
            (1, 0, 0),
            (-1, 0, 0),
            (0, 1, 0),
            (0, -1, 0),
            (0, 0, 2),
            (0, 0, -2),
            (1, 1, 0),
            (-1, 1, 0),
        ),
    ),
)
"""Turns about the axes of the camera: parts of the widest, which grow as more is known."""

_HALVINGS = 3
"""How often a turn that fails is tried with half its angle."""

_FEWEST = 6
"""Touch-ups below which six numbers are not told from the errors of the arm."""

LARGEST_RMS_M = 5e-3
"""Rms distance by which touch-ups may miss each other. Zero offsets of half a degree stay below;
joint signs that are not the robot's do not."""

LARGEST_LEFT_M = 1e-3
"""What is left of that when zero offsets are taken out: links of another robot, a target that has
moved. Arms with usual errors leave a third of it."""

LARGEST_SIGMA_M = 2e-3
"""Standard deviation of the virtual pin tip above which planning with it makes no sense."""

LEAST_SIZE_PX = 24.0
"""Size of the target below which an error of a tenth of a pixel, which light and edges make, is one
of more than 2 mm at half a metre."""

SINGULAR = 5.0 * NEAR_SINGULAR
"""Smallest singular value of the arm's Jacobian below which its turns go through large angles of the
wrist, and the errors of the arm with them: a wrist bent by less than four degrees."""

LARGEST_PLAY_M = 1e-3
"""Distance between stops that were come to from one side and from the other, the last movement the
same: what is left of lost motion."""

LARGEST_DRIFT_M = 1e-3
"""How far the first touch-up may be from itself when it is made again at the end: an arm comes back
to a tenth of that, calibrated or not, with the lost motion taken up."""

LARGEST_OF_DISTANCE = 0.2
"""Diameter of the target in distances of it, above which the middle of its ellipse is too far from
the image of its own: at 350 mm, 3 mm on the target at the widest turns."""

LARGEST_BEND = 0.05
"""Part by which the size may grow otherwise on the way to the target than on the way from it."""

_CHECK_ROBOT = "check robot, joint signs and camera"

_FIXED = "check that camera and target are fixed, and that nothing gets before the lens"

_COUNT = sum(len(directions) for _, directions in _TURNS)


@dataclass(frozen=True, eq=False)
class SetUp:
    """Where camera and target are, roughly, as the nominal arm sees them.

    Attributes
    ----------
    jacobian : ImageJacobian
    tool_m : array (3,)
        Virtual pin tip in the tip frame [m].
    target_m : array (3,)
        In the base frame [m].
    facing : Facing
        How the target's face is turned.
    postures : array (N, n)
        Touched up on the way [rad].
    rms_m : float
        Distance by which the touch-ups miss each other, three axes together.
    sigma_tool_m : float
        Largest standard deviation of the virtual pin tip, from what the touch-ups miss.
    notes : tuple of str
        Turns that could not be made, and why.
    """

    jacobian: ImageJacobian
    tool_m: FloatArray
    target_m: FloatArray
    facing: Facing
    postures: FloatArray
    rms_m: float
    sigma_tool_m: float
    notes: tuple[str, ...]

    @property
    def T_tip_camera(self) -> FloatArray:
        """The camera in the tip frame: the lens, z along the view, x right and y down."""
        R = self.jacobian.R_tip_camera
        return transform(R, self.tool_m - self.jacobian.distance_m * R[:, 2])


@dataclass(frozen=True)
class NoSetUp:
    """Why camera and target were not found.

    Attributes
    ----------
    reason : str
    hint : str
        What to do about it.
    """

    reason: str
    hint: str


def find_set_up(
    station: Station,
    q: FloatArray,
    loop: Loop,
    *,
    widest: float = np.deg2rad(15.0),
    size_px: float | None = None,
    progress: Callable[[str, float], None] = lambda what, part: None,
) -> SetUp | NoSetUp:
    """Find camera and target from a taught posture ``(n,)`` [rad] with the target in view.

    Parameters
    ----------
    station : Station
    q : array (n,)
    loop : Loop
    widest : float
        Largest turn about the target [rad]; about the line of sight it is twice that.
    size_px : float, optional
        Size of the target in the designated relation; by default as it is seen at the posture.
    progress : callable
        Called with what is being done and the part of the step that is done.
    """
    return _Inching(station, loop, widest, progress).run(q, size_px)


class _Inching:
    """State of the first step: the touch-ups so far and what follows from them."""

    def __init__(
        self,
        station: Station,
        loop: Loop,
        widest: float,
        progress: Callable[[str, float], None],
    ) -> None:
        self.station, self.loop, self.widest = station, loop, widest
        self.robot: Robot = station.drive.robot
        self.progress = progress
        self.postures: list[FloatArray] = []
        self.ellipses: list[FloatArray] = []
        self.notes: list[str] = []

    def run(self, q: FloatArray, size_px: float | None) -> SetUp | NoSetUp:
        self.progress("looking", 0.0)
        view = self.station.look("taught", q)
        if view.reasons[0]:
            return NoSetUp(
                f"the target is not seen from the taught posture: {view.reasons[0]}",
                "bring the whole target into the picture, and nothing else that looks like it",
            )
        width, height = self.station.image_px
        size = float(view.vhs_px[0, 2]) if size_px is None else size_px
        relation = Relation((width / 2.0, height / 2.0), size)
        if min(size, float(view.vhs_px[0, 2])) < LEAST_SIZE_PX:
            return NoSetUp(
                f"the target is {size:.0f} px large in the picture: too small to tell its distance",
                f"take a larger target or a nearer camera, for {LEAST_SIZE_PX:g} px or more",
            )
        jacobian = self._jacobian(q, relation)
        if isinstance(jacobian, NoSetUp):
            return jacobian
        for k, (turn, name) in enumerate(self._turns()):
            self.progress(f"touch-up {name}", 0.2 + 0.8 * k / _COUNT)
            self._inch(turn, name, jacobian)
        found = self._solved(jacobian)
        if isinstance(found, NoSetUp):
            return found
        return self._again(jacobian) or found

    def _jacobian(self, q: FloatArray, relation: Relation) -> ImageJacobian | NoSetUp:
        """The Jacobian: small moves to bring the target to the middle, then wide ones there."""
        self.progress("finding how the picture moves", 0.05)
        probe = self._probe(q, relation)
        if probe.jacobian is None:
            return NoSetUp(
                f"the picture could not be followed: {probe.reason}",
                "bring the target nearer to the middle of the picture, and away from joint limits",
            )
        # of small moves only what they do across the picture stands out of its noise
        across = replace(self.loop, center_px=max(self.loop.center_px, _MIDDLE_PX), view_line=True)
        middle = self.station.touch_up("middle", q, probe.jacobian, across)
        if not middle.touched[0]:
            return _untouched(middle)
        size_px = float(ellipse_axes(middle.ellipses[0])[0])
        room_px = (min(self.station.image_px) - size_px) / 2.0
        px_per_m = float(np.linalg.norm(probe.jacobian.matrix[:2], axis=1).max())
        if room_px < _LEAST_ROOM_PX:
            return NoSetUp(
                "the target nearly fills the picture", "move the camera away, or take a smaller one"
            )
        step = _STEP_OF_ROOM * room_px / px_per_m
        wide = self.station.jacobian("moves", middle.q[0], relation, step, both_ways=True)
        if wide.jacobian is None:
            return NoSetUp(
                f"the picture could not be followed: {wide.reason}", "give the arm more room"
            )
        flaw = wide.jacobian.flaw()
        if flaw:
            return NoSetUp(flaw, _CHECK_ROBOT)
        first = self.station.touch_up("S01", middle.q[0], wide.jacobian, self.loop)
        if not first.touched[0]:
            return _untouched(first)
        self._keep(first.q[0], first.ellipses[0])
        if self.robot.chain.smallest_singular_values(self.robot.state(first.q))[0] < SINGULAR:
            return NoSetUp(
                "the arm stands next to a singularity", "bend the wrist by ten degrees or more"
            )
        return self._play(wide.jacobian) or self._in_depth(wide.jacobian)

    def _play(self, jacobian: ImageJacobian) -> NoSetUp | None:
        """Come to the first touch-up from both sides: why that is not the same, if it is not."""
        q = self.postures[0]
        aside = _ASIDE * self.station.drive.approach_rad
        seen = []
        for name, way in (("below", -aside), ("above", aside)):
            self.station.pass_through(name, np.clip(q + way, self.robot.lower, self.robot.upper))
            view = self.station.look(f"from {name}", q)
            if view.reasons[0]:
                return NoSetUp(f"the first touch-up was lost: {view.reasons[0]}", _FIXED)
            seen.append(jacobian.relation.error(view.ellipses)[0])
        apart = float(np.linalg.norm(jacobian.shift(seen[1] - seen[0])))
        if apart > LARGEST_PLAY_M + 2.0 * self._noise_m(jacobian):
            return NoSetUp(
                f"the arm stops {1e3 * apart:.1f} mm apart from one side and from the other",
                "enlarge touch_up.approach_deg, and check the reducers",
            )
        return None

    def _noise_m(self, jacobian: ImageJacobian) -> float:
        """What the loop leaves along the view line [m]."""
        return self.loop.size_px / jacobian.relation.size_px * jacobian.distance_m

    def _in_depth(self, jacobian: ImageJacobian) -> ImageJacobian | NoSetUp:
        """The Jacobian after long ways along the view line, which the size follows but little."""
        reason = ""
        for part in _STEPS_OF_DISTANCE:
            along = part * jacobian.distance_m * jacobian.R_tip_camera[:, 2]
            near, reason = self._error_at(f"nearer {part:g}", along, jacobian.relation)
            if reason:
                continue
            far, reason = self._error_at(f"farther {part:g}", -along, jacobian.relation)
            if reason:
                continue
            here = jacobian.relation.error(self.ellipses[0])
            bend = (near + far - 2.0 * here)[2] / (near - far)[2]
            if not abs(bend) <= LARGEST_BEND:
                return NoSetUp(
                    "the size of the target does not follow its distance",
                    "clear what hides or lights a part of the target, and take a larger one if it "
                    "is small in the picture",
                )
            found = jacobian.updated(2.0 * along, near - far)
            flaw = found.flaw()
            if flaw:
                return NoSetUp(flaw, _CHECK_ROBOT)
            if found.diameter_m > LARGEST_OF_DISTANCE * found.distance_m:
                return NoSetUp(
                    f"the target is {1e3 * found.diameter_m:.0f} mm across at "
                    f"{1e3 * found.distance_m:.0f} mm: the middle of its picture is not its own",
                    "take a target of a tenth of its distance or less",
                )
            return found
        return NoSetUp(
            f"the target could not be followed along the view line: {reason}",
            "choose a posture with more room before and behind it, and a target of a third of the "
            "picture or less",
        )

    def _error_at(self, name: str, shift: FloatArray, relation: Relation) -> tuple[FloatArray, str]:
        """Error of the relation ``(3,)`` [px] a shift from the first touch-up, or why there is none."""
        q = self.postures[0]
        posture, found = _posture(self.robot, q, shifted(self.robot.fk(q), shift))
        if not found:
            return np.full(3, np.nan), "joint limits or a singularity are in the way"
        view = self.station.look(name, posture)
        return relation.error(view.ellipses)[0], view.reasons[0]

    def _probe(self, q: FloatArray, relation: Relation) -> MeasuredJacobian:
        """How the picture follows moves, the smallest that it follows clearly."""
        probe = MeasuredJacobian(None)
        for k, step in enumerate(_PROBES_M):
            last, probe = (
                probe,
                self.station.jacobian(f"probe {k + 1}", q, relation, step, both_ways=False),
            )
            if probe.jacobian is None:
                if probe.status != "unmoved":
                    return last if last.jacobian is not None else probe
            elif np.linalg.norm(probe.jacobian.matrix[:2], axis=1).min() * step > _CLEAR_PX:
                return probe
        return probe

    def _turns(self) -> Iterator[tuple[FloatArray, str]]:
        """Turns about camera axes as rotation vectors ``(3,)`` [rad], and their names."""
        number = 2
        for part, directions in _TURNS:
            for direction in directions:
                yield self.widest * part * np.array(direction, dtype=float), f"S{number:02d}"
                number += 1

    def _inch(self, turn: FloatArray, name: str, jacobian: ImageJacobian) -> None:
        """Turn about the target as far as it is known, and touch up; half of it where that fails."""
        tool = self._pin(jacobian).tool_m
        about = jacobian.R_tip_camera @ turn
        reason = ""
        for halving in range(_HALVINGS):
            R = rotation_exp(about / 2**halving)
            T = self.robot.fk(self.postures[0]) @ transform(R, tool - R @ tool)
            q, found = _posture(self.robot, self.postures[0], T)
            if not found:
                reason = "joint limits or a singularity are in the way"
                continue
            done = self.station.touch_up(f"{name}{'abc'[halving]}", q, jacobian, self.loop)
            if done.touched[0]:
                self._keep(done.q[0], done.ellipses[0])
                return
            reason = done.reasons[0]
        self.notes.append(f"{name}: {reason}")

    def _keep(self, q: FloatArray, ellipse: FloatArray) -> None:
        self.postures.append(q)
        self.ellipses.append(ellipse)

    def _pin(self, jacobian: ImageJacobian) -> Pin:
        guess = jacobian.distance_m * jacobian.R_tip_camera[:, 2]
        return solve_pin(self.robot, np.array(self.postures), guess)

    def _solved(self, jacobian: ImageJacobian) -> SetUp | NoSetUp:
        pin = self._pin(jacobian)
        count = len(self.postures)
        if count < _FEWEST:
            return NoSetUp(
                f"only {count} touch-ups around the target succeeded: {'; '.join(self.notes)}",
                "choose a posture with more room around the target",
            )
        if pin.rms_m > LARGEST_RMS_M:
            return NoSetUp(
                f"touch-ups of one target miss each other by {1e3 * pin.rms_m:.0f} mm",
                "check the robot description and its joint signs, and that camera and target are "
                "fixed",
            )
        if pin.left_m > LARGEST_LEFT_M + self._noise_m(jacobian):
            return NoSetUp(
                f"touch-ups of one target miss each other by {1e3 * pin.left_m:.1f} mm that no zero "
                "offsets explain",
                "check that the description is of this robot, and that camera and target are fixed",
            )
        if not pin.sigma_tool_m <= LARGEST_SIGMA_M:
            return NoSetUp(
                "the arm could not turn enough: the virtual pin tip is known to "
                f"{1e3 * pin.sigma_tool_m:.0f} mm only",
                "choose a posture with more room around the target",
            )
        R = self.robot.fk(np.array(self.postures))[:, :3, :3]
        facing = find_normal(jacobian, R, np.array(self.ellipses))
        if facing.flaw:
            return NoSetUp(facing.flaw, "take a flat, round target, and check the joint signs")
        return SetUp(
            jacobian,
            pin.tool_m,
            pin.target_m,
            facing,
            np.array(self.postures),
            pin.rms_m,
            pin.sigma_tool_m,
            tuple(self.notes),
        )

    def _again(self, jacobian: ImageJacobian) -> NoSetUp | None:
        """Touch up once more from the first posture: why that is not where it was, if it is not."""
        done = self.station.touch_up("again", self.postures[0], jacobian, self.loop)
        if not done.touched[0]:
            return NoSetUp(f"the first touch-up could not be made again: {done.reasons[0]}", _FIXED)
        first, last = self.robot.fk(np.array([self.postures[0], done.q[0]]))[:, :3, 3]
        drift = float(np.linalg.norm(last - first))
        if drift > LARGEST_DRIFT_M + 2.0 * self._noise_m(jacobian):
            return NoSetUp(
                f"the first touch-up made again is {1e3 * drift:.1f} mm from where it was", _FIXED
            )
        return None


def _posture(robot: Robot, q: FloatArray, T: FloatArray) -> tuple[FloatArray, bool]:
    posture, found = follow(robot, q[None], T[None])
    return posture[0], bool(found[0])


def _untouched(done: TouchUps) -> NoSetUp:
    return NoSetUp(
        f"the target could not be touched up from the taught posture: {done.reasons[0]}",
        "choose a posture with more room, or a larger touch_up.farthest_mm",
    )
