"""One scene: the camera's place from pixels, and by every method from poses of the board."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np

from calib.errors import CalibError
from calib.hand_eye import calibrate
from calib.lens import Lens
from calib.model import CalibrationModel
from calib.model.measurements import BoardShape, BoardView
from calib.model.parameters import LensParameters, TargetFrame, ToolFrame
from calib.robot_world import METHODS, solve
from calib.robots.flange_poses import posture_of_pose
from calib.se3 import FloatArray, inverse, rotation_exp, rotation_log, transform
from studies.board_scenes import FLANGE, Scene, draw_scene

PIXELS = "pixels"
LENSES = ("lens given", "lens from the pictures")

HAND_EYE = {
    "OpenCV Tsai": cv2.CALIB_HAND_EYE_TSAI,
    "OpenCV Park": cv2.CALIB_HAND_EYE_PARK,
    "OpenCV Horaud": cv2.CALIB_HAND_EYE_HORAUD,
    "OpenCV Andreff": cv2.CALIB_HAND_EYE_ANDREFF,
    "OpenCV Daniilidis": cv2.CALIB_HAND_EYE_DANIILIDIS,
}
ROBOT_WORLD = {
    "OpenCV Shah": cv2.CALIB_ROBOT_WORLD_HAND_EYE_SHAH,
    "OpenCV Li": cv2.CALIB_ROBOT_WORLD_HAND_EYE_LI,
}
EVERY = (PIXELS, *METHODS, *HAND_EYE, *ROBOT_WORLD)

Found = tuple[FloatArray, FloatArray | None]
"""X ``(4, 4)`` and its covariance ``(6, 6)``: place, then rotation in the axes of the flange."""


def trial_rows(
    pictures: int, sigma_px: float, arm: tuple[float, float], rng: np.random.Generator
) -> list[dict[str, Any]]:
    """A row for each lens and method: what X is off, in parts of the bound."""
    scene = draw_scene(rng, pictures)
    pixels = scene.seen(rng, sigma_px, arm)
    middle = scene.poses(scene.flange) @ np.append(scene.points.mean(axis=0), 1.0)
    distance = float(np.median(np.linalg.norm(middle[:, :3], axis=1)))
    rows = []
    for lens in LENSES:
        bound = bound_of(scene, sigma_px, arm, free_lens=lens != LENSES[0])
        mm, deg = sizes(bound, scene.X, distance)
        for method, found in estimates(scene, pixels, lens):
            row = {"lens": lens, "method": method, "bound_mm": mm, "bound_deg": deg}
            rows.append(row | judged(found, scene.X, distance))
    return rows


def bound_of(
    scene: Scene, sigma_px: float, arm: tuple[float, float], *, free_lens: bool
) -> FloatArray:
    """Cramér-Rao bound ``(6, 6)`` of X: place, then rotation in its own axes."""
    kind = BoardView(
        sigma_px, BoardShape(scene.points), scene.lens, "camera", arm if any(arm) else None
    )
    blocks = [ToolFrame(scene.X), TargetFrame(scene.Z)]
    free = [LensParameters(scene.lens)] if free_lens else []
    model = CalibrationModel(FLANGE, [*blocks, *free], kind)
    J = model.linearise(posture_of_pose(scene.flange)).white_jacobian.reshape(-1, model.p)
    bound = np.linalg.inv(J.T @ J)[:6, :6]
    turn = np.block([[np.eye(3), np.zeros((3, 3))], [np.zeros((3, 3)), scene.X[:3, :3]]])
    return np.asarray(turn @ bound @ turn.T)


def estimates(scene: Scene, pixels: FloatArray, lens: str) -> Iterator[tuple[str, Found | None]]:
    """X by every method; None where it gives none."""
    given = lens == LENSES[0]
    yield PIXELS, _from_pixels(scene, pixels, scene.lens if given else None)
    poses = _poses_of_board(scene, pixels, scene.lens if given else None)
    for method in METHODS:
        yield method, _solved(scene.flange, inverse(poses), method)
    for name, how in HAND_EYE.items():
        yield name, _hand_eye(scene.flange, poses, how)
    for name, how in ROBOT_WORLD.items():
        yield name, _robot_world(scene.flange, poses, how)


def _from_pixels(scene: Scene, pixels: FloatArray, lens: Lens | None) -> Found | None:
    try:
        result = calibrate(scene.shown(pixels), lens or "pinhole")
    except CalibError:
        return None
    turn = np.kron(np.diag([0.0, 1.0]), result.X[:3, :3]) + np.diag([1.0] * 3 + [0.0] * 3)
    return result.X, turn @ result.covariance_of("X") @ turn.T


def _solved(A: FloatArray, B: FloatArray, method: str) -> Found | None:
    try:
        result = solve(A, B, method)
    except CalibError:
        return None
    covariance = result.covariance
    if covariance is None or not np.isfinite(covariance).all():
        return result.X, None
    order = np.r_[3:6, 0:3]
    return result.X, covariance[np.ix_(order, order)]


def _poses_of_board(scene: Scene, pixels: FloatArray, lens: Lens | None) -> FloatArray:
    """``T_camera_board`` ``(N, 4, 4)``, as people take them: by OpenCV's solvePnP.

    Where the lens is not given, with the poses that come with it from calibrateCamera.
    """
    corners = (pixels - 0.5).astype(np.float32)
    if lens is None:
        size = scene.lens.width_px, scene.lens.height_px
        objects = [scene.points.astype(np.float32)] * len(corners)
        _, _, _, turns, places = cv2.calibrateCamera(
            objects, list(corners), size, np.eye(3), np.zeros(5)
        )
    else:
        K, terms = lens.to_opencv()
        found = [cv2.solvePnP(scene.points, own, K, terms) for own in corners.astype(float)]
        turns, places = zip(*(one[1:] for one in found), strict=True)
    return transform(
        rotation_exp(np.array(turns)[..., 0].astype(float)), np.array(places)[..., 0].astype(float)
    )


def _parts(T: FloatArray) -> tuple[list[FloatArray], list[FloatArray]]:
    return list(T[:, :3, :3]), list(T[:, :3, 3])


def _hand_eye(flange: FloatArray, poses: FloatArray, how: int) -> Found | None:
    return _called(lambda: cv2.calibrateHandEye(*_parts(flange), *_parts(poses), method=how))


def _robot_world(flange: FloatArray, poses: FloatArray, how: int) -> Found | None:
    found = _called(
        lambda: cv2.calibrateRobotWorldHandEye(
            *_parts(poses), *_parts(inverse(flange)), method=how
        )[2:]
    )
    return None if found is None else (inverse(found[0]), None)


def _called(what: Callable[[], Any]) -> Found | None:
    try:
        R, p = what()
    except cv2.error:
        return None
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = R, np.ravel(p)
    return (X, None) if np.isfinite(X).all() else None


def judged(found: Found | None, true: FloatArray, distance: float) -> dict[str, float]:
    """What X is off: mm at the board's distance, deg, and over its stated covariance."""
    nothing = {"off_mm": np.nan, "off_deg": np.nan, "nees": np.nan}
    if found is None:
        return nothing
    X, covariance = found
    ahead = np.array([0.0, 0.0, distance, 1.0])
    turn = rotation_log(X[:3, :3] @ true[:3, :3].T)
    off = {
        "off_mm": 1e3 * float(np.linalg.norm(((X - true) @ ahead)[:3])),
        "off_deg": float(np.degrees(np.linalg.norm(turn))),
    }
    if covariance is None:
        return nothing | off
    error = np.append(X[:3, 3] - true[:3, 3], turn)
    return off | {"nees": float(error @ np.linalg.solve(covariance, error)) / 6.0}


def sizes(covariance: FloatArray, X: FloatArray, distance: float) -> tuple[float, float]:
    """Rms of :func:`judged`'s errors by a covariance: mm and deg."""
    arm = distance * X[:3, 2]
    # a turn w moves the point by w x arm
    cross = np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
    G = np.hstack([np.eye(3), -cross])
    moved = np.sqrt(np.trace(G @ covariance @ G.T))
    return 1e3 * float(moved), float(np.degrees(np.sqrt(np.trace(covariance[3:, 3:]))))
