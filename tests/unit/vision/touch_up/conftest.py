"""An ideal cell that the tests of visual touch-up share: nothing is off but what a test asks."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from calib.model import CalibrationModel
from calib.model.measurements import TouchUp
from calib.model.parameters import TargetPoints, ToolPoint, ZeroOffsets
from calib.robots import Robot
from calib.se3 import FloatArray, rotation_exp, transform
from calib.vision.camera import Camera, CircleTarget, FastObserver, MeasurementNoise
from calib.vision.touch_up import Drive, ImageJacobian, Relation, SimulatedArms, TrueCell
from calib.vision.touch_up.arms import LostMotion
from calib.vision.touch_up.jacobian import measure_jacobian
from tests.visual_cells import preset, usual_posture

DISTANCE_M = 0.35
SILENT = MeasurementNoise.from_sigma([0.0, 0.0, 0.0])
ONE = np.zeros(1, dtype=np.intp)


@dataclass(frozen=True, eq=False)
class Bench:
    """An arm with a camera before a target, and what the tests know of them."""

    robot: Robot
    q: FloatArray
    true: TrueCell
    camera: Camera
    target: CircleTarget

    @property
    def relation(self) -> Relation:
        """The target in the middle of the picture, as large as from the designated distance."""
        size = self.camera.focal_px * self.target.diameter_m / DISTANCE_M
        return Relation(tuple(self.camera.center_px), size)

    def arms(
        self, count: int = 1, noise: MeasurementNoise = SILENT, seed: int = 0
    ) -> SimulatedArms:
        """Simulated arms at the base posture, with fast observers."""
        observer = FastObserver(self.camera, self.target, noise)
        return SimulatedArms(self.true, observer, count, np.random.default_rng(seed), self.q)

    def drive(self, arms: SimulatedArms | None = None, approach_rad: float = 0.0) -> Drive:
        """By the nominal robot."""
        return Drive(self.robot, self.arms() if arms is None else arms, approach_rad)


@pytest.fixture(scope="session")
def make_bench() -> Callable[..., Bench]:
    """A bench: ``make_bench(tilt_deg=20, offsets_deg=0.1, lost_motion=...)``."""

    def bench(
        tilt_deg: float = 0.0,
        offsets_deg: float = 0.0,
        lost_motion: LostMotion | None = None,
        vibration_m: float = 0.0,
        at_m: tuple[float, float, float] = (0.0, 0.0, DISTANCE_M),
        name: str = "m20ia",
    ) -> Bench:
        robot, q = preset(name), usual_posture(name)
        tool, place = ToolPoint([0.0, 0.0, 0.1]), TargetPoints([np.zeros(3)], ["T"])
        offsets = ZeroOffsets(robot, robot.joint_names)
        model = CalibrationModel(robot, [offsets, tool, place], TouchUp(1e-4))
        errors = np.deg2rad(offsets_deg) * np.resize([1.0, -1.0, 0.6], robot.n)
        values = np.concatenate([errors, tool.nominal, place.nominal])
        lean = rotation_exp(np.deg2rad([20.0, -10.0, 0.0]))
        roll = rotation_exp(np.deg2rad([0.0, 0.0, 70.0]))
        T_tip_camera = transform(lean @ roll, [0.05, -0.08, 0.12])
        tilted = rotation_exp(np.deg2rad([tilt_deg, 0.0, 0.0])) @ np.diag([1.0, -1.0, -1.0])
        T_base_tip = model.view(q[None], values).T_base_tip[0]
        T_base_target = T_base_tip @ T_tip_camera @ transform(tilted, at_m)
        lost = LostMotion.of(robot.n) if lost_motion is None else lost_motion
        true = TrueCell(model, values, T_tip_camera, T_base_target, lost, vibration_m=vibration_m)
        return Bench(robot, q, true, Camera.paper(), CircleTarget())

    return bench


@pytest.fixture(scope="session")
def bench(make_bench) -> Bench:
    """The ideal one."""
    return make_bench()


@pytest.fixture(scope="session")
def jacobian(bench) -> ImageJacobian:
    """Of the ideal bench."""
    return measure_jacobian(bench.drive(), bench.q, bench.relation, 0.01, both_ways=True).jacobian
