"""Table 3: a pose by visual touch-up less the pose by touching up with a pin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from calib.se3 import FloatArray, inverse
from calib.vision.camera import Camera, circle_center, circle_center_bias, circle_image
from calib.vision.touch_up import ImageJacobian, Loop, Relation, TiltBias, touch_up

from .visual_bench import Bench, exact

PIN = 5
"""Stream of random numbers, apart from those of the other tables."""

_PIN_STEPS = 5
"""Corrections of a pin by what its tip is off: each leaves a thousandth."""

VARIANTS = ("as in the paper", "centre by its ellipse", "tilt taken off")
"""Nothing is done about the tilt; :func:`circle_center` in the loop; :class:`TiltBias` in it, which
takes off V, H and s what the nominal orientation says."""

_LEFT = ((1.0, 1.0, 1.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
"""What of the prediction each of them leaves, along the tip's axes: z is the line of sight."""


@dataclass(frozen=True)
class CircleRelation(Relation):
    """The relation of the middle of the circle, not of the middle of its ellipse.

    Focal length and diameter are those that the Jacobian shows: nothing is calibrated besides.
    """

    focal_px: float = 0.0
    diameter_m: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """About how the face is turned, in the camera frame."""

    def error(self, ellipses: FloatArray, bias: ArrayLike = 0.0) -> FloatArray:
        right, down = self.center_px
        camera = Camera(
            round(2 * right), round(2 * down), self.focal_px, principal_px=self.center_px
        )
        middle = circle_center(camera, self.diameter_m, ellipses, self.normal)
        moved = np.concatenate([middle, ellipses[..., 2:]], axis=-1)
        return super().error(moved, bias)


def touch_with_pin(bench: Bench, posture: FloatArray) -> FloatArray:
    """Nominal tip ``(4, 4)`` with the true pin on the target, turned as at a posture ``(n,)``."""
    quiet = exact(bench)
    drive = quiet.drive(1, bench.rng(0))
    only = np.zeros(1, dtype=np.intp)
    T_tip_camera = bench.true.T_tip_camera
    pin = (inverse(T_tip_camera) @ np.append(bench.tool_m, 1.0))[:3]
    q = posture[None]
    drive.to_posture(only, q)
    for _ in range(_PIN_STEPS):
        off = drive.arms.T_camera_target(only)[0, :3, 3] - pin  # type: ignore[attr-defined]
        wanted = bench.cell.robot.fk(q[0])
        wanted[:3, 3] += wanted[:3, :3] @ T_tip_camera[:3, :3] @ off
        reason = drive.to_pose(only, q, wanted[None])[0]
        if reason:
            raise RuntimeError(reason)
        q = drive.arms.joints(only)
    return np.asarray(bench.cell.robot.fk(q[0]))


def predicted(bench: Bench, posture: FloatArray) -> FloatArray:
    """What the picture of a circle does to a touch-up ``(3,)`` [mm], in tip axes, to first order.

    Where the ellipse is in the middle and of the designated size, the middle of the circle is not.
    """
    camera, target = bench.observer.camera, bench.observer.target  # type: ignore[attr-defined]
    T_base_tip = bench.true.model.view(posture[None], bench.true.values).T_base_tip[0]
    R = bench.true.T_tip_camera[:3, :3]
    seen = inverse(T_base_tip @ bench.true.T_tip_camera) @ bench.true.T_base_target
    relation = bench.jacobian.relation
    distance = camera.focal_px * target.diameter_m / relation.size_px
    seen[:3, 3] = [0.0, 0.0, distance]
    bias = circle_center_bias(camera, target.diameter_m, seen)
    ellipse = circle_image(camera, target.diameter_m, seen)
    in_camera = np.append(bias * distance / camera.focal_px, 0.0)
    ds = relation.error(ellipse)[2]
    in_camera[2] = ds * distance / relation.size_px
    return np.asarray(1e3 * R @ in_camera)


def differences(
    benches: Sequence[Bench], settings: dict[str, Any], trials: int
) -> list[dict[str, Any]]:
    """Table 3 for each turn and variant, in tip axes [mm]: mean, deviation, prediction.

    Trials are shared among the set-ups. The mean is that of the set-ups, and so is its interval.
    """
    part = settings["pin"]
    count = trials // len(benches)
    rows = []
    for number, turn_deg in enumerate(part["turns_deg"]):
        placed = []
        for bench in benches:
            posture = bench.turned(np.deg2rad(turn_deg))
            placed.append((bench, posture, touch_with_pin(bench, posture)))
        expected = np.mean([predicted(bench, posture) for bench, posture, _ in placed], axis=0)
        for variant, says in enumerate(VARIANTS):
            done = [_visual(*at, part, variant, count, number) for at in placed]
            means = np.array([off.mean(axis=0) for off, _ in done])
            variance = np.mean([off.var(axis=0, ddof=1) for off, _ in done], axis=0)
            rows.append(
                {
                    "turn_deg": turn_deg,
                    "variant": says,
                    "mean_mm": means.mean(axis=0).tolist(),
                    "mean_error_mm": (means.std(axis=0, ddof=1) / np.sqrt(len(means))).tolist(),
                    "sigma_mm": np.sqrt(variance).tolist(),
                    "predicted_mm": (expected * _LEFT[variant]).tolist(),
                    "trials": count * len(benches),
                    "failed": sum(failed for _, failed in done),
                }
            )
    return rows


def _visual(
    bench: Bench,
    posture: FloatArray,
    pin: FloatArray,
    part: dict[str, Any],
    variant: int,
    trials: int,
    number: int,
) -> tuple[FloatArray, int]:
    """Places of the nominal tip less that of the pin ``(S, 3)`` [mm], in tip axes."""
    rng = bench.rng(PIN, number)
    J, bias = bench.jacobian, None
    face = bench.true.T_base_target[:3, 2]
    if VARIANTS[variant] == "tilt taken off":
        bias = TiltBias(bench.cell.robot, J, face)
    elif VARIANTS[variant] == "centre by its ellipse":
        normal = (pin[:3, :3] @ J.R_tip_camera).T @ face
        relation = CircleRelation(
            J.relation.center_px,
            J.relation.size_px,
            J.focal_px,
            J.diameter_m,
            tuple(normal.tolist()),
        )
        J = ImageJacobian(J.matrix, relation)
    loop = Loop(part["center_px"], part["size_px"], iterations=20)
    done = touch_up(bench.drive(trials, rng), bench.starts(posture, trials, rng), J, loop, bias)
    T = bench.cell.robot.fk(done.q[done.touched])
    off = np.einsum("ji,kj->ki", pin[:3, :3], T[:, :3, 3] - pin[:3, 3])
    return 1e3 * off, int((~done.touched).sum())


def largest(
    rows: list[dict[str, Any]], settings: dict[str, Any], rng: np.random.Generator
) -> dict[str, float]:
    """Largest of the nine figures of such a table [mm], the pin being as good as it is."""
    part = settings["pin"]
    plain = [row for row in rows if row["variant"] == VARIANTS[0]]
    means = np.array([row["mean_mm"] for row in plain])
    spread = np.hypot([row["sigma_mm"] for row in plain], part["three_sigma_mm"] / 3.0)
    drawn = means + spread * rng.standard_normal((part["drawn"], *means.shape))
    low, middle, high = np.quantile(np.abs(drawn).max(axis=(1, 2)), [0.025, 0.5, 0.975])
    return {
        "without_pin_mm": float(np.abs(means).max()),
        "low_mm": float(low),
        "median_mm": float(middle),
        "high_mm": float(high),
    }
