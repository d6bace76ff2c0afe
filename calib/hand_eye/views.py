"""Error to expect at other views of the board, the arm as its controller has it.

A camera says where a point is, and the arm is sent there. Its controller takes the arm to be as
described, whatever errors it has. At a view of the board that no picture was taken from, a point of
the board is at one place by the camera and at another by the arm,

    e(q) = Z p_camera - T(q) X p_board,

with the board on the flange; likewise with the camera on it. The joints q reach the point by the
description T, and the camera sees it where the true arm brings it. The camera and the board of the
controller are the X and Z for which the mean of e² over such views is least. What pictures leave
unknown of camera, board, lens and arm comes to it, and the deviation of the arm at the view:

    E² = mean over views of |e|² + tr(L C Lᵀ) + deviation,

with C the covariance of all parameters, those of the arm among them, and L the derivative of e.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib import se3
from calib.batch_last import cross, turn
from calib.hand_eye.pictures import Pictures
from calib.hand_eye.points import poses_of, seen_point_motion
from calib.lens import Lens
from calib.model import CalibrationModel, Setup
from calib.model.measurements.board_view import Carried
from calib.robots import Robot, posture_of_pose
from calib.robots.flange_poses import NAMES as FLANGE_POSE
from calib.se3 import FloatArray

VIEWS = 60
"""Number of views: their mean square is known to some ten per cent."""

_DRAWN = 3
"""Views that are drawn for each that is wanted, as not all are reached."""

_FEWEST = 10
"""Views that have to be reached; else those of the pictures are taken."""

_ACROSS = 0.6
"""Part of the width and height of the picture that the middle of the board is drawn in."""

_NEAR, _FAR = 0.6, 2.0
"""Distances of views over that of the pictures, where these were not nearer or farther."""

_TILTED_RAD, _TURNED_RAD = 0.6, 1.0
"""Tilt of the board about two axes, and its rotation about the line of sight against that in a
picture, at most."""

_STEPS = 3
_SHIFT = 1e-6
"""Steps of Gauss-Newton, and difference of poses for a derivative [m, rad]."""


@dataclass(frozen=True, eq=False)
class Views:
    """Other views of the board of a camera."""

    robot: Robot
    carried: Carried
    labels: tuple[str, str]  # of what is on the flange, and of what stands around the arm
    points: FloatArray  # (K, 3): of the board [m], its middle first
    postures: FloatArray  # (V, n) [rad]

    @classmethod
    def drawn(
        cls,
        pictures: Pictures,
        lens: Lens,
        poses: Mapping[str, FloatArray],
        postures: FloatArray,
    ) -> Views:
        """Draw views of the board as a camera may have them, all over its picture.

        Nearer and farther than in the pictures, tilted, and turned about the line of sight: an arm
        is sent where no picture was taken from, too.

        Parameters
        ----------
        poses : mapping of str to array (4, 4)
            Where the camera and the board are [m].
        postures : array (N, n)
            Of the pictures that were used [rad].
        """
        robot, carried, labels = pictures.robot, pictures.carried, pictures.labels
        board = pictures.board
        X, Z = (poses[label] for label in labels)
        low, high = board.min(axis=0), board.max(axis=0)
        corners = [np.where(which, high, low) for which in np.ndindex(2, 2, 1)]
        points = np.array([(low + high) / 2.0, *corners])
        flange = robot.fk(postures)
        in_hand = carried == "camera"
        T = se3.inverse(flange @ X) @ Z if in_hand else se3.inverse(Z) @ flange @ X
        far = np.linalg.norm(_points(T, points[:1])[:, 0], axis=1)
        rng = np.random.default_rng(0)  # the same for all: results can be had again
        count = _DRAWN * VIEWS
        as_seen = T[rng.integers(len(T), size=count), :3, :3]
        about = np.zeros((2, count, 3))
        about[0, :, 2] = np.arctan2(as_seen[:, 1, 0], as_seen[:, 0, 0])
        about[0, :, 2] += rng.uniform(-_TURNED_RAD, _TURNED_RAD, count)
        about[1, :, :2] = rng.uniform(-_TILTED_RAD, _TILTED_RAD, (count, 2))
        R = se3.rotation_exp(about[1]) @ se3.rotation_exp(about[0])
        size = np.array([lens.width_px, lens.height_px])
        pixels = size * (0.5 + _ACROSS * rng.uniform(-0.5, 0.5, (count, 2)))
        rays = np.append(lens.rays(pixels), np.ones((count, 1)), axis=1)
        middle = float(np.median(far))
        nearest, farthest = min(far.min(), _NEAR * middle), max(far.max(), _FAR * middle)
        away = rng.uniform(nearest, farthest, (count, 1))
        place = away * rays / np.linalg.norm(rays, axis=1, keepdims=True) - R @ points[0]
        there = se3.transform(R, place)
        wanted = Z @ se3.inverse(X @ there) if in_hand else Z @ there @ se3.inverse(X)
        usual = postures[np.argmin(np.linalg.norm(postures - postures.mean(axis=0), axis=1))]
        if robot.joint_names == FLANGE_POSE:
            return cls(robot, carried, labels, points, posture_of_pose(wanted[:VIEWS]))
        q, found = robot.inverse(wanted, near=usual).nearest()
        q = q[found][:VIEWS]
        return cls(robot, carried, labels, points, q if len(q) >= _FEWEST else postures)

    def apart(
        self, true: Mapping[str, FloatArray], flange: FloatArray, taken: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return ``e (V, K, 3)`` [m] in base axes.

        ``true``: where camera and board are; ``flange`` ``(V, 4, 4)``: where the flange is.
        ``taken``: where the controller takes camera and board to be.
        """
        X, Z = (true[label] for label in self.labels)
        XC, ZC = (taken[label] for label in self.labels)
        T = self.robot.fk(self.postures)
        if self.carried == "camera":
            seen = se3.inverse(flange @ X) @ Z
            return _points(T @ XC @ seen, self.points) - _points(ZC, self.points)
        seen = se3.inverse(Z) @ flange @ X
        return _points(ZC @ seen, self.points) - _points(T @ XC, self.points)

    def best_poses(
        self, true: Mapping[str, FloatArray], flange: FloatArray
    ) -> dict[str, FloatArray]:
        """Return where the controller best takes camera and board to be, by Gauss-Newton."""
        taken = dict(true)
        for _ in range(_STEPS):
            off = self.apart(true, flange, taken).ravel()
            columns = []
            for label in self.labels:
                for six in _SHIFT * np.eye(6, dtype=float):
                    moved = taken | {label: moved_pose(taken[label], six)}
                    columns.append((self.apart(true, flange, moved).ravel() - off) / _SHIFT)
            step = -np.linalg.lstsq(np.array(columns).T, off, rcond=1e-9)[0]
            for label, six in zip(self.labels, step.reshape(2, 6), strict=True):
                taken[label] = moved_pose(taken[label], six)
        return taken

    def unknown(
        self, model: CalibrationModel, x: FloatArray, camera: str, lens: Lens
    ) -> tuple[FloatArray, FloatArray]:
        """Return the derivative of e by the parameters at the middle of the board, and its lever.

        ``L (V, 3, p)`` [m per unit], and the distance ``(V,)`` of that point from the flange [m].
        """
        tool, target = self.labels
        setup = Setup.of(
            len(self.postures), tool=model.tools.index(tool), target=model.targets.index(target)
        )
        view, motion = (
            model.view(self.postures, x, setup),
            np.zeros((model.p, 6, len(self.postures))),
        )
        for block, part in zip(model.parameters, model.slices, strict=True):
            if block.size:
                block.move(x[part, None], view, motion[part])
        in_hand = self.carried == "camera"
        middle = self.points[0]
        arm = turn(view.target if in_hand else view.tool, middle[:, None])
        if in_hand:
            arm = arm - view.error
        L = motion[:, :3] + cross(motion[:, 3:], arm)
        L = np.ascontiguousarray(L.transpose(2, 1, 0))
        poses = poses_of(model, x)
        flange = model.tip_poses(self.postures, x)
        X, Z = poses[tool], poses[target]
        seen = se3.inverse(flange @ X) @ Z if in_hand else se3.inverse(Z) @ flange @ X
        in_camera = se3.apply(seen, middle)
        lens_columns = [k for k, n in enumerate(model.names) if n.startswith("lens")]
        if lens_columns:
            by_lens = seen_point_motion(model, x, camera, lens, in_camera, camera)[
                ..., lens_columns
            ]
            L[..., lens_columns] = flange[:, :3, :3] @ by_lens if in_hand else -by_lens
        point = se3.apply(Z if in_hand else flange @ X, middle)
        return L, np.linalg.norm(point - flange[:, :3, 3], axis=1)


def _points(T: FloatArray, points: FloatArray) -> FloatArray:
    """Points ``(K, 3)`` mapped by each of the poses ``(..., 4, 4)``: ``(..., K, 3)``."""
    return np.asarray(se3.apply(T[..., None, :, :], points))


def moved_pose(T: FloatArray, six: NDArray[np.floating[Any]]) -> FloatArray:
    """Return a pose shifted [m] in the axes of its parent and turned [rad] in its own."""
    return se3.transform(T[:3, :3] @ se3.rotation_exp(six[3:]), T[:3, 3] + six[:3])
