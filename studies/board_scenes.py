"""Pictures of a board by numbers: cameras on arms and in front of them, noise, and mistakes."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from calib.hand_eye import HandEyeResult, Pictures
from calib.lens import Lens
from calib.model.measurements.board_view import Carried
from calib.robots import Robot
from calib.robots.flange_poses import flange_robot, posture_of_pose
from calib.se3 import FloatArray, inverse, rotation_exp, rotation_log, transform

SIZE = 1920, 1080
LENS = Lens("pinhole", *SIZE, (1500.0, 1505.0, 965.0, 545.0, -0.1, 0.05, 1e-3, -5e-4, 0.01))
OTHER_LENS = Lens("pinhole", *SIZE, (1450.0, 1455.0, 960.0, 540.0, 0.0, 0.0, 0.0, 0.0, 0.0))
FLANGE = flange_robot()

SIGMA_PX = 0.2
EXACT, STOPS_OFF = (0.0, 0.0), (3e-4, 5e-4)
"""Arms: one that stops where it says, one with deviations [m, rad] along and about each axis."""

X = transform(rotation_exp(np.array([0.02, -0.03, 0.8])), np.array([0.05, 0.02, 0.06]))
AROUND: dict[str, FloatArray] = {
    "camera": transform(rotation_exp(np.array([np.pi, 0.0, 0.2])), np.array([-0.55, -0.2, 0.0])),
    "board": transform(rotation_exp(np.array([0.0, np.pi / 2, 0.0])), np.array([-1.2, -0.2, 0.5])),
}
"""The board of a carried camera, the camera of a carried board, in the base."""


def inner_corners(columns: int = 8, rows: int = 6, square_m: float = 0.03) -> FloatArray:
    """Points ``(K, 3)`` [m] of a board of so many squares."""
    x, y = np.meshgrid(np.arange(1, columns), np.arange(1, rows))
    return square_m * np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=-1)


@dataclass(frozen=True, eq=False)
class Scene:
    """Where everything is."""

    flange: FloatArray
    """(N, 4, 4): where the arm is, and where it says that it is unless it stops off."""
    carried: Carried = "camera"
    points: FloatArray = field(default_factory=inner_corners)
    lens: Lens = LENS
    X: FloatArray = field(default_factory=X.copy)
    Z: FloatArray = field(default_factory=AROUND["camera"].copy)

    def poses(self, flange: FloatArray) -> FloatArray:
        """``T_camera_board`` ``(N, 4, 4)`` [m]."""
        if self.carried == "camera":
            return inverse(flange @ self.X) @ self.Z
        return inverse(self.Z) @ flange @ self.X

    def seen(
        self, rng: np.random.Generator, sigma_px: float = SIGMA_PX, arm: tuple[float, float] = EXACT
    ) -> FloatArray:
        """Pixels ``(N, K, 2)``, with noise, of an arm that stops off."""
        N = len(self.flange)
        place = self.flange[:, :3, 3] + arm[0] * rng.standard_normal((N, 3))
        turned = rotation_exp(arm[1] * rng.standard_normal((N, 3))) @ self.flange[:, :3, :3]
        T = self.poses(transform(turned, place))
        points = np.einsum("nij,kj->nki", T[:, :3, :3], self.points) + T[:, None, :3, 3]
        pixels = self.lens.project(points)
        return pixels + sigma_px * rng.standard_normal(pixels.shape)

    def shown(self, pixels: FloatArray, **changes: object) -> Pictures:
        """The pictures, with the poses of the flange, or with what is given."""
        given = {
            "robot": FLANGE,
            "postures": posture_of_pose(self.flange),
            "pixels": pixels,
            "board": self.points,
            "size_px": SIZE,
            "carried": self.carried,
        }
        return Pictures(**given | changes)  # type: ignore[arg-type]

    def errors(self, result: HandEyeResult) -> FloatArray:
        """Errors of X, then Z, then the lens where it was estimated, as parameters ``(p,)``."""
        lens = np.array(result.lens.values) - self.lens.values
        parts = [pose_error(result.X, self.X), pose_error(result.Z, self.Z)]
        return np.concatenate([*parts, lens[: len(lens) if result.lens_estimated else 0]])


def pose_error(found: FloatArray, true: FloatArray) -> FloatArray:
    """Place in the axes of the parent [m], then rotation [rad] in its own, ``(6,)``."""
    return np.append(found[:3, 3] - true[:3, 3], rotation_log(true[:3, :3].T @ found[:3, :3]))


def draw_scene(
    rng: np.random.Generator,
    count: int = 15,
    carried: Carried = "camera",
    *,
    points: FloatArray | None = None,
    lens: Lens = LENS,
    tilt: float = 0.6,
    far_m: tuple[float, float] = (0.4, 0.6),
) -> Scene:
    """A scene in which all points of the board are in all pictures."""
    board = inner_corners() if points is None else points
    scene = Scene(np.empty((0, 4, 4)), carried, board, lens, X, AROUND[carried])
    middle, found = board.mean(axis=0), list[FloatArray]()
    size = np.array([lens.width_px, lens.height_px])
    while len(found) < count:
        R = rotation_exp(rng.uniform(-tilt, tilt, 3) * [1.0, 1.0, 2.0])
        place = np.array([*rng.uniform(-1, 1, 2) * [0.08, 0.04], rng.uniform(*far_m)]) - R @ middle
        pixels = lens.project(board @ R.T + place)
        if not ((pixels > 10) & (pixels < size - 10)).all():
            continue
        T = transform(R, place)
        if carried == "camera":
            found.append(scene.Z @ inverse(T) @ inverse(X))
        else:
            found.append(scene.Z @ T @ inverse(X))
    return replace(scene, flange=np.array(found))


def reached(robot: Robot, scene: Scene, count: int) -> tuple[Scene, FloatArray]:
    """The first poses of a scene that a robot reaches, and its joints ``(count, n)`` [rad]."""
    q, found = robot.inverse(scene.flange, near=(robot.lower + robot.upper) / 2).nearest()
    some = np.flatnonzero(found)[:count]
    if len(some) < count:
        raise ValueError(f"{robot.name} reaches {len(some)} of {len(found)} poses, not {count}")
    return replace(scene, flange=scene.flange[some]), q[some]
