"""Pools for measurements that need no touch: the tool point may be anywhere."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from calib.errors import InputError, UnreachableError
from calib.robots import InverseSolutions
from calib.se3 import BoolArray, FloatArray, inverse, rotation_exp, transform
from posedesign.candidates.branches import MOST_PER_POSE, evenly
from posedesign.candidates.draws import check_count, even_points, no_pose, no_posture, once
from posedesign.candidates.pool import Pool
from posedesign.cell import CameraSection, Cell, cone_rotations_at

LARGEST_TURN_RAD = np.pi
"""Of a joint from the base posture: beyond it the arm is where it has been, a full turn apart."""

_FEWEST, _MOST = 1_000, 20_000
"""Draws made at once."""


def joint_pool(
    cell: Cell, count: int, rng: np.random.Generator, largest_turn: float = LARGEST_TURN_RAD
) -> Pool:
    """Postures around the base posture that keep every constraint, wherever the tool point is.

    Drawn evenly in the joints; or, where the cell has a camera, evenly in what it sees of its
    target: over image, distance, tilt and roll, in every branch of the arm within the same bounds.
    Of the two, that is taken of which more draws are feasible: of a thousand postures in all of the
    joints' ranges hardly one sees the target.

    ``count``: postures wanted. Where most draws break a constraint, fewer may be given.
    ``largest_turn``: how far each joint may turn from the base posture [rad]. Raises InputError: an
    argument cannot be used. UnreachableError: none of the postures drawn keeps every constraint.
    """
    count = check_count(count)
    if not largest_turn > 0.0:
        raise InputError(
            f"joints that turn by {largest_turn:g} rad give one posture",
            hint="give how far each joint may turn from the base posture, in radians",
            name="largest_turn",
            value=largest_turn,
            bound=0.0,
        )
    ways: list[_Draws] = [_JointDraws(cell, count, largest_turn, rng)]
    if cell.config.camera is not None:
        ways.append(_ViewDraws(cell, count, largest_turn, rng, cell.config.camera))
    first = [way.feasible() for way in ways]
    shares = [len(q) / way.at_once for q, way in zip(first, ways, strict=True)]
    best = int(np.argmax(shares))
    draws, found = ways[best], [first[best]]
    while sum(map(len, found)) < count and draws.tried < draws.each * max(count, draws.at_once):
        found.append(draws.feasible())
    postures = np.concatenate(found)
    postures = postures[once(postures)][:count]
    if not len(postures):
        raise ways[-1].nothing()
    return Pool(
        postures=postures,
        orientations=cell.robot.fk(postures)[:, :3, :3],
        target=np.zeros(len(postures), dtype=np.intp),
        targets_m=cell.target_m[None],
        target_names=(cell.config.target.name,),
        tried=draws.tried,
        description=f"joints within {np.rad2deg(largest_turn):g} deg of the base posture"
        + ", the target in view" * (cell.config.camera is not None),
    )


class _Draws(ABC):
    """One way to draw postures inside bounds.

    ``each``: draws made at most for each posture that is wanted. ``at_once``: draws made at a time.
    ``tried``: draws made so far.
    """

    each = 64

    def __init__(
        self, cell: Cell, count: int, largest_turn: float, rng: np.random.Generator
    ) -> None:
        robot, base, margin = cell.robot, cell.base_posture, cell.margin
        self._cell, self._rng = cell, rng
        self._lower = np.maximum(robot.lower + margin, base - largest_turn)
        self._upper = np.minimum(robot.upper - margin, base + largest_turn)
        self.at_once = int(np.clip(count, _FEWEST, _MOST))
        self.tried = 0

    def feasible(self) -> FloatArray:
        """Those of some more draws that keep every constraint, ``(S, n)`` [rad]."""
        q = self.draw()
        self.tried += self.at_once
        return np.asarray(q[self._cell.checker.check(q, every=False).feasible])

    @abstractmethod
    def draw(self) -> FloatArray:
        """Postures ``(S, n)`` [rad] of as many draws as are made at a time."""

    @abstractmethod
    def nothing(self) -> UnreachableError:
        """The error where none of the draws was feasible."""


class _JointDraws(_Draws):
    """Every joint evenly over its range."""

    def draw(self) -> FloatArray:
        points = even_points(self.at_once, self._cell.robot.n, self._rng)
        return np.asarray(self._lower + (self._upper - self._lower) * points)

    def nothing(self) -> UnreachableError:
        return no_posture(self._cell.checker, self.draw(), self.tried)


class _ViewDraws(_Draws):
    """What a camera sees evenly, in every branch of the arm."""

    def __init__(
        self,
        cell: Cell,
        count: int,
        largest_turn: float,
        rng: np.random.Generator,
        camera: CameraSection,
    ) -> None:
        super().__init__(cell, count, largest_turn, rng)
        self._camera = camera
        if cell.robot.n > 6:
            # a redundant arm takes each view in many ways, and long to find them
            self.at_once = int(np.clip(count // MOST_PER_POSE, _FEWEST // 10, _FEWEST))
            self.each = 8

    def draw(self) -> FloatArray:
        cell = self._cell
        views = self._views()
        solutions = cell.robot.inverse(views, near=cell.base_posture, margin=cell.margin)
        rows = np.flatnonzero(solutions.inside & self._within(solutions))
        return np.asarray(solutions.postures[rows[evenly(solutions.pose[rows], MOST_PER_POSE)]])

    def nothing(self) -> UnreachableError:
        return no_pose(
            self._cell.checker,
            self._views(),
            self._cell.base_posture,
            self._within,
            ("only with joints turned farther from the base posture", "raise largest_turn"),
        )

    def _views(self) -> FloatArray:
        points = even_points(self.at_once, COORDINATES, self._rng)
        return viewing_poses(self._cell, self._camera, points)

    def _within(self, solutions: InverseSolutions) -> BoolArray:
        q = solutions.postures
        return np.asarray(((q >= self._lower) & (q <= self._upper)).all(axis=1))


COORDINATES = 6
"""Of a view: the place in the image (2), the distance, and what :func:`cone_rotations_at` takes."""


def viewing_poses(cell: Cell, camera: CameraSection, points: FloatArray) -> FloatArray:
    """Tip poses ``(N, 4, 4)`` that see the target, at points ``(N, 6)`` of the unit cube.

    All that a cell allows its camera: the middle of the target anywhere in the image less its
    border, at any distance, the face of the target tilted any way, and the camera rolled freely
    about the line of sight.
    """
    u, v, distance = points[:, :3].T
    room_px = np.array(camera.image_px) / 2.0 - camera.border_px
    across = (2.0 * np.stack([u, v], axis=-1) - 1.0) * room_px / camera.focal_px
    nearest_m, farthest_m = camera.nearest_mm / 1e3, camera.farthest_mm / 1e3
    away_m = nearest_m + (farthest_m - nearest_m) * distance
    # a frame whose z is the line of sight: tilted against the normal, and in the camera's own frame
    tilt = float(np.deg2rad(camera.largest_tilt_deg))
    R_base_sight = cone_rotations_at(_with_z(-cell.target_normal), tilt, points[:, 3:])
    R_camera_sight = _towards(across)
    R_base_camera = R_base_sight @ np.swapaxes(R_camera_sight, -1, -2)
    lens = cell.target_m - away_m[:, None] * R_base_sight[:, :, 2]
    return np.asarray(transform(R_base_camera, lens) @ inverse(cell.T_tip_camera))


def _towards(across: FloatArray) -> FloatArray:
    """Rotations ``(N, 3, 3)`` that turn z to the rays through points ``(N, 2)`` at depth one."""
    slope = np.linalg.norm(across, axis=1)
    angle = np.arctan(slope) / np.maximum(slope, np.finfo(float).tiny)
    axis = np.stack([-across[:, 1], across[:, 0], np.zeros(len(across))], axis=-1)
    return np.asarray(rotation_exp(axis * angle[:, None]))


def _with_z(z: FloatArray) -> FloatArray:
    """A rotation ``(3, 3)`` with this third column, a unit vector."""
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
