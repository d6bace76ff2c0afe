"""How the picture moves with the arm, from nothing but one view of the target.

The first part of the first step: the Jacobian from moves that grow as more is known, and all that
makes one doubt that arm, camera and target are what they are taken for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.robots import Robot
from calib.robots.inverse import NEAR_SINGULAR
from calib.se3 import FloatArray, frame_about, transform
from calib.vision.camera import Camera, CircleTarget, circle_image, ellipse_axes
from calib.vision.camera.conic import ellipse_vhs
from calib.vision.camera.observers import Target
from calib.vision.touch_up.drive import follow, shifted
from calib.vision.touch_up.jacobian import ImageJacobian, MeasuredJacobian, Relation
from calib.vision.touch_up.servo import Loop, Station, TouchUps


@dataclass(frozen=True, eq=False)
class SetUp:
    """Where camera and target are, roughly, as the nominal arm sees them."""

    jacobian: ImageJacobian
    tool_m: FloatArray  # (3,): virtual pin tip in the tip frame [m]
    target_m: FloatArray  # (3,): in the base frame [m]
    facing: Facing  # how the target's face is turned
    postures: FloatArray  # (N, n): touched up on the way [rad]
    rms_m: float  # distance by which the touch-ups miss each other, three axes together
    sigma_tool_m: float
    """Largest standard deviation of the virtual pin tip, from what the touch-ups miss."""
    notes: tuple[str, ...]  # turns that could not be made, and why

    @property
    def T_tip_camera(self) -> FloatArray:
        """The camera in the tip frame: the lens, z along the view, x right and y down."""
        R = self.jacobian.R_tip_camera
        return transform(R, self.tool_m - self.jacobian.distance_m * R[:, 2])


@dataclass(frozen=True)
class NoSetUp:
    """Why camera and target were not found, and what to do about it."""

    reason: str
    hint: str


class Refused(Exception):
    """Ends the first step from within: its outcome is no error, and callers never see this."""

    def __init__(self, reason: str, hint: str) -> None:
        super().__init__(reason)
        self.outcome = NoSetUp(reason, hint)


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

LEAST_SIZE_PX = 24.0
"""Size of the target below which an error of a tenth of a pixel, which light and edges make, is one
of more than 2 mm at half a metre."""

SINGULAR = 5.0 * NEAR_SINGULAR
"""Smallest singular value of the arm's Jacobian below which turns go through large angles of the
wrist, and the errors of the arm with them: a wrist bent by less than four degrees."""

LARGEST_PLAY_M = 1e-3
"""Distance between stops that were come to from one side and from the other, the last movement the
same: what is left of lost motion."""

LARGEST_OF_DISTANCE = 0.2
"""Diameter of the target in distances of it, above which the middle of its ellipse is too far from
the image of its own: at 350 mm, 3 mm on the target at the widest turns."""

LARGEST_SCALE = 0.05
"""Part by which a board may be seen larger or smaller than described: arms with usual errors leave
a hundredth, and prints that were fitted to the paper are off by more."""

LARGEST_BEND = 0.05
"""Part by which the size may grow otherwise on the way to the target than on the way from it."""

FIXED = "check that camera and target are fixed, and that nothing gets before the lens"
"""What to do where a target is not where it was."""

_CHECK_ROBOT = "check robot, joint signs and camera"


@dataclass(frozen=True, eq=False)
class Sighting:
    """A target as it is followed from its first touch-up."""

    jacobian: ImageJacobian
    q: FloatArray  # (n,): of the first touch-up [rad]
    ellipse: FloatArray  # (5,): that it ended with [px]
    noise_m: float  # what the loop leaves along the view line [m]
    step_m: float  # length of the moves that the Jacobian was measured by


CIRCLE: Target = CircleTarget()
"""What is looked at unless it is said: a circle, of a diameter that is found."""


def sight(
    station: Station, q: FloatArray, loop: Loop, size_px: float | None, target: Target = CIRCLE
) -> Sighting:
    """Follow the target from a taught posture ``(n,)`` [rad], to its first touch-up.

    Small moves bring it to the middle of the picture, wide ones there tell the Jacobian, and long
    ones along the view line how far it is.

    Raises
    ------
    Refused
        It cannot be followed, or not as a camera on an arm follows it.
    """
    relation = _relation(station, q, size_px)
    probe = _probe(station, q, relation)
    _check_play(station, q, probe)
    # of small moves only what they do across the picture stands out of its noise
    across = replace(loop, center_px=max(loop.center_px, _MIDDLE_PX), view_line=True)
    middle = _touched(station.touch_up("middle", q, probe, across))
    step = _widest_step(station, middle, probe)
    wide = _wide(station, middle.q[0], relation, step)
    first = _touched(station.touch_up("S01", middle.q[0], wide, loop))
    robot, posture, ellipse = station.drive.robot, first.q[0], first.ellipses[0]
    if robot.chain.smallest_singular_values(robot.state(first.q))[0] < SINGULAR:
        raise Refused(
            "the arm stands next to a singularity", "bend the wrist by ten degrees or more"
        )
    jacobian = _in_depth(station, posture, ellipse, wide)
    _check_size(jacobian, target)
    noise = loop.size_px / relation.size_px * jacobian.distance_m
    return Sighting(jacobian, posture, ellipse, noise, step)


def posture_at(robot: Robot, q: FloatArray, T: FloatArray) -> tuple[FloatArray, str]:
    """Posture ``(n,)`` next to another that takes a pose ``(4, 4)``, or why there is none."""
    posture, found = follow(robot, q[None], T[None])
    return posture[0], "" if found[0] else "joint limits or a singularity are in the way"


def _relation(station: Station, q: FloatArray, size_px: float | None) -> Relation:
    """The target in the middle of the picture, by default as large as it is seen first."""
    view = station.look("taught", q)
    if view.reasons[0]:
        raise Refused(
            f"the target is not seen from the taught posture: {view.reasons[0]}",
            "bring the whole target into the picture, and nothing else that looks like it",
        )
    width, height = station.image_px
    seen_px = float(view.vhs_px[0, 2])
    size = seen_px if size_px is None else size_px
    if min(size, seen_px) < LEAST_SIZE_PX:
        raise Refused(
            f"the target is {min(size, seen_px):.0f} px large in the picture: too small to tell "
            "its distance",
            f"take a larger target or a nearer camera, for {LEAST_SIZE_PX:g} px or more",
        )
    return Relation((width / 2.0, height / 2.0), size)


def _probe(station: Station, q: FloatArray, relation: Relation) -> ImageJacobian:
    """How the picture follows moves, the smallest that it follows clearly."""
    found, probe = None, MeasuredJacobian(None)
    for k, step in enumerate(_PROBES_M):
        probe = station.jacobian(f"probe {k + 1}", q, relation, step, both_ways=False)
        if probe.jacobian is not None:
            found = probe.jacobian
            if np.linalg.norm(found.matrix[:2], axis=1).min() * step > _CLEAR_PX:
                break
        elif probe.status != "unmoved":
            break
    if found is None:
        raise Refused(
            f"the picture could not be followed: {probe.reason}",
            "bring the target nearer to the middle of the picture, and away from joint limits",
        )
    return found


def _check_play(station: Station, q: FloatArray, probe: ImageJacobian) -> None:
    """Come to the taught posture from both sides: it has to be the same."""
    robot, aside = station.drive.robot, _ASIDE * station.drive.approach_rad
    seen = []
    for name, way in (("below", -aside), ("above", aside)):
        station.pass_through(name, np.clip(q + way, robot.lower, robot.upper))
        view = station.look(f"from {name}", q)
        if view.reasons[0]:
            raise Refused(f"the target was lost at the taught posture: {view.reasons[0]}", FIXED)
        seen.append(probe.relation.error(view.ellipses)[0])
    apart = float(np.linalg.norm(probe.shift(seen[1] - seen[0], view_line=True)))
    if apart > LARGEST_PLAY_M:
        raise Refused(
            f"the arm stops {1e3 * apart:.1f} mm apart from one side and from the other",
            "enlarge touch_up.approach_deg, and check the reducers",
        )


def _widest_step(station: Station, middle: TouchUps, probe: ImageJacobian) -> float:
    """Length of moves [m] with which a target in the middle of the picture stays in it."""
    size_px = float(ellipse_axes(middle.ellipses[0])[0])
    room_px = (min(station.image_px) - max(size_px, probe.relation.size_px)) / 2.0
    if room_px < _LEAST_ROOM_PX:
        raise Refused(
            "the target nearly fills the picture", "move the camera away, or take a smaller one"
        )
    return _STEP_OF_ROOM * room_px / float(np.linalg.norm(probe.matrix[:2], axis=1).max())


def _wide(station: Station, q: FloatArray, relation: Relation, step_m: float) -> ImageJacobian:
    """The Jacobian by moves that are long enough for all of it to be clear."""
    wide = station.jacobian("moves", q, relation, step_m, both_ways=True)
    if wide.jacobian is None:
        raise Refused(f"the picture could not be followed: {wide.reason}", "give the arm more room")
    _check(wide.jacobian)
    return wide.jacobian


def _in_depth(
    station: Station, q: FloatArray, ellipse: FloatArray, jacobian: ImageJacobian
) -> ImageJacobian:
    """The Jacobian after long ways along the view line, which the size follows but little."""
    relation, robot = jacobian.relation, station.drive.robot
    here, reason = relation.error(ellipse), ""
    for part in _STEPS_OF_DISTANCE:
        along = part * jacobian.distance_m * jacobian.R_tip_camera[:, 2]
        errors = []
        for name, shift in (("nearer", along), ("farther", -along)):
            posture, reason = posture_at(robot, q, shifted(robot.fk(q), shift))
            if not reason:
                view = station.look(f"{name} {part:g}", posture)
                reason = view.reasons[0]
                errors.append(relation.error(view.ellipses)[0])
            if reason:
                break
        if not reason:
            return _lengthened(jacobian, along, here, *errors)
    raise Refused(
        f"the target could not be followed along the view line: {reason}",
        "choose a posture with more room before and behind it, and a target of a third of the "
        "picture or less",
    )


def _lengthened(
    jacobian: ImageJacobian, along: FloatArray, here: FloatArray, near: FloatArray, far: FloatArray
) -> ImageJacobian:
    """The Jacobian that says of a way ``(3,)`` [m] to either side what was seen there."""
    change = near - far
    if not abs((near + far - 2.0 * here)[2]) <= LARGEST_BEND * abs(change[2]):
        raise Refused(
            "the size of the target does not follow its distance",
            "clear what hides or lights a part of the target, and take a larger one if it is small "
            "in the picture",
        )
    found = jacobian.updated(2.0 * along, change)
    _check(found)
    return found


def _check_size(found: ImageJacobian, target: Target) -> None:
    """Refuse a target that is too large for what is made of it, or another than described."""
    if target.is_biased and found.diameter_m > LARGEST_OF_DISTANCE * found.distance_m:
        raise Refused(
            f"the target is {1e3 * found.diameter_m:.0f} mm across at "
            f"{1e3 * found.distance_m:.0f} mm: the middle of its picture is not its own",
            "take a target of a tenth of its distance or less",
        )
    if target.is_known and abs(found.diameter_m / target.diameter_m - 1.0) > LARGEST_SCALE:
        raise Refused(
            f"the target is {1e3 * found.diameter_m:.0f} mm across as the arm moves, "
            f"{1e3 * target.diameter_m:.0f} mm as described",
            "measure the print and correct [board], and check that it is this robot",
        )


def _check(jacobian: ImageJacobian) -> None:
    flaw = jacobian.flaw()
    if flaw:
        raise Refused(flaw, _CHECK_ROBOT)


def _touched(done: TouchUps) -> TouchUps:
    if not done.touched[0]:
        raise Refused(
            f"the target could not be touched up from the taught posture: {done.reasons[0]}",
            "choose a posture with more room, or a larger touch_up.farthest_mm",
        )
    return done


LARGEST_RMS_PX = 0.2
"""Rms by which half axes of the ellipses may differ from those of a circle: ten times their noise
and what a lens bends. A target that is not round, or a wrist that turns the other way, is far off.
"""

LARGEST_RMS = 2e-3
"""The same of a board, in parts of its size: it is larger than a circle is, and so is what the
errors of the arm's orientations make of it."""

_START_TILTS = np.deg2rad([0.0, 25.0, 50.0])
_START_SIDES = 8


@dataclass(frozen=True, eq=False)
class Facing:
    """The face of a target."""

    normal: FloatArray  # (3,): unit vector out of it, in base axes
    sigma_rad: float  # larger of the two standard deviations of its direction, from the residuals
    rms_px: float  # what is left of the half axes
    flaw: str  # why the ellipses are not those of one flat circle; empty where they are


@dataclass(frozen=True, eq=False)
class TiltBias:
    """What a tilt does to the ellipse of a circle, where the tilt is known.

    The centre of the ellipse is not the image of the middle, and the long axis is a little longer
    than Eq. 1 has it: the near half is seen larger. At 45 deg a circle of 20 mm seen from 350 mm is
    off by as much as the paper's Table 3.
    """

    robot: Robot  # nominal: its orientation is right to a tenth of a degree
    jacobian: ImageJacobian
    """Of which the focal length, the distance and the diameter of the target are taken."""
    normal: FloatArray  # (3,): of the target, in base axes

    def __call__(self, q: FloatArray) -> FloatArray:
        """Of postures ``(K, n)`` [rad], ellipse less middle and size ``(K, 3)`` [px]: V, H, s.

        Nothing where the circle shows its back.
        """
        R = self.robot.fk(q)[:, :3, :3] @ self.jacobian.R_tip_camera
        place = np.array([0.0, 0.0, self.jacobian.distance_m])
        faces = _faces(np.einsum("nji,j->ni", R, self.normal), place)
        seen = circle_image(camera_of(self.jacobian), self.jacobian.diameter_m, faces)
        right, down = self.jacobian.relation.center_px
        off = ellipse_vhs(seen) - [down, right, self.jacobian.relation.size_px]
        return np.asarray(np.nan_to_num(off))


def find_normal(
    jacobian: ImageJacobian, R_base_tip: FloatArray, ellipses: FloatArray, target: Target = CIRCLE
) -> Facing:
    """Normal of a target seen in the designated relation from orientations ``(N, 3, 3)``.

    The half axes of the ellipses ``(N, 5)`` [px] against those of the circle's image. One picture
    has two answers; the turns between several leave one.
    """
    from scipy.optimize import least_squares

    R_base_camera = R_base_tip @ jacobian.R_tip_camera
    camera = camera_of(jacobian)
    place = np.array([0.0, 0.0, jacobian.distance_m])
    towards = -R_base_camera[0, :, 2]
    across = np.linalg.svd(towards[None])[2][1:]

    def normals(x: FloatArray) -> FloatArray:
        n = towards + x @ across
        return np.asarray(n / np.linalg.norm(n))

    def missed(x: FloatArray) -> FloatArray:
        in_camera = np.einsum("nji,j->ni", R_base_camera, normals(x))
        seen = target.image(camera, _faces(in_camera, place), jacobian.diameter_m)
        # a face turned away is seen as nothing: as far off as an ellipse can be
        off = np.where(np.isnan(seen), 0.0, seen)[:, 2:] - ellipses[:, 2:]
        return np.asarray(off.ravel())

    starts = [np.zeros(2)]
    for tilt in _START_TILTS[1:]:
        angle = np.arange(_START_SIDES) * 2.0 * np.pi / _START_SIDES
        starts += list(np.tan(tilt) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    best = min(starts, key=lambda x: float((missed(x) ** 2).sum()))
    fit = least_squares(missed, best, method="lm", x_scale=0.1)
    mirrored = least_squares(missed, -fit.x, method="lm", x_scale=0.1)
    fit = min(fit, mirrored, key=lambda f: float(f.cost))
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    J = np.asarray(fit.jac)
    sigma = float(rms * np.sqrt(1.0 / max(np.linalg.eigvalsh(J.T @ J)[0], 1e-300)))
    flaw = ""
    if not rms <= max(LARGEST_RMS_PX, target.is_known * LARGEST_RMS * jacobian.relation.size_px):
        flaw = (
            "the pictures are not those of a flat circle seen from the arm's orientations: "
            f"{rms:.1f} px are left over"
        )
    return Facing(normals(fit.x), sigma, rms, flaw)


def camera_of(jacobian: ImageJacobian) -> Camera:
    """The camera as it was found: an ideal lens, its axis through the place of the relation."""
    right, down = jacobian.relation.center_px
    size = (2 * int(np.ceil(right)), 2 * int(np.ceil(down)))
    return Camera(*size, jacobian.focal_px, principal_px=(right, down))


def _faces(normals: FloatArray, place: FloatArray) -> FloatArray:
    """Poses ``(N, 4, 4)`` at a place ``(3,)`` whose z axes are ``(N, 3)``."""
    return transform(frame_about(normals), np.tile(place, (len(normals), 1)))
