"""Camera, board, lens and robot from pictures against the Cramér-Rao bound over their pixels."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import pytest

from calib.chance import chi2_quantile, normal_quantile
from calib.hand_eye import calibrate
from calib.model import CalibrationModel, Setup
from calib.model.measurements import BoardShape, BoardView
from calib.model.measurements.board_view import Carried
from calib.model.parameters import LensParameters, TargetFrame, TimeOffsets, ToolFrame, ZeroOffsets
from calib.robots import Robot
from calib.robots.flange_poses import posture_of_pose
from calib.se3 import FloatArray
from calib.vision.boards import make_board
from studies.board_scenes import EXACT, FLANGE, SIGMA_PX, STOPS_OFF, Scene, draw_scene, reached

PICTURES = 15
CHANCE = 1e-3
LOWEST, HIGHEST = 0.97, 1.05
"""Rms error over the bound."""

GROUPS = {"X": slice(0, 6), "Z": slice(6, 12), "lens": slice(12, 21)}


@dataclass(frozen=True, eq=False)
class Trials:
    """Errors of many sets of pictures."""

    errors: FloatArray  # (T, p)
    bounds: FloatArray  # (T, p, p): of their covariance, with the noise as it is
    stated: FloatArray  # (T, p, p): as each result states it
    inside: FloatArray  # (T, p): whether the 95 % intervals hold the truth

    def over_bound(self, part: slice = slice(None)) -> float:
        """Rms of the errors of some parameters over their bound, in its own axes."""
        own, bounds = self.errors[:, part], self.bounds[:, part, part]
        return float(np.sqrt(np.mean(squares(own, bounds)) / own.shape[1]))

    @property
    def nees(self) -> float:
        """Normalised squared error: one where covariances are right."""
        return float(np.mean(squares(self.errors, self.stated)) / self.errors.shape[1])


def squares(errors: FloatArray, covariances: FloatArray) -> FloatArray:
    return np.einsum("tp,tp->t", errors, np.linalg.solve(covariances, errors[..., None])[..., 0])


def run(
    trials: int,
    carried: Carried,
    arm: tuple[float, float],
    seed: int,
    points: FloatArray | None = None,
) -> Trials:
    """Sets of 15 pictures, each of another scene; lens and noise are found with X and Z."""
    found = []
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        scene = draw_scene(rng, PICTURES, carried, points=points)
        result = calibrate(scene.shown(scene.seen(rng, arm=arm)))
        assert result.used.all()
        model = true_model(scene, arm, [])
        postures = posture_of_pose(scene.flange)
        found.append(trial_of(model, postures, scene.errors(result), result.estimate))
    return Trials(*(np.array(part) for part in zip(*found, strict=True)))


def true_model(scene: Scene, arm, blocks, robot=FLANGE) -> CalibrationModel:
    shape = BoardShape(scene.points)
    kind = BoardView(SIGMA_PX, shape, scene.lens, scene.carried, arm if any(arm) else None)
    frames = [ToolFrame(scene.X), TargetFrame(scene.Z), *blocks, LensParameters(scene.lens)]
    return CalibrationModel(robot, frames, kind)


def trial_of(model, postures, error, estimate):
    J = model.linearise(postures).white_jacobian.reshape(-1, model.p)
    low, high = estimate.interval
    inside = np.abs(error) <= (high - low) / 2.0
    return error, np.linalg.inv(J.T @ J), estimate.covariance, inside


def band(trials: int, parameters: int, power: float = 0.5) -> tuple[float, float]:
    """Where the mean of so many χ² over their freedom is, to that power, unless by chance."""
    freedom = trials * parameters
    low, high = chi2_quantile([CHANCE / 2, 1 - CHANCE / 2], freedom) / freedom
    return float(low**power), float(high**power)


def check(done: Trials, *, efficient: float = HIGHEST) -> None:
    """Bars: the error, and what is said of it."""
    T, p = done.errors.shape
    low, high = band(T, p)
    assert LOWEST * low < done.over_bound() < efficient * high
    low, high = band(T, p, power=1.0)
    assert LOWEST**2 * low < done.nees < HIGHEST**2 * high
    # intervals of one set are correlated: as if there were three of their own
    error = normal_quantile(1 - CHANCE / 2) * np.sqrt(0.95 * 0.05 / (3 * T))
    assert 0.93 - error < done.inside.mean() < 0.97 + error


def together(each: Sequence[Trials]) -> Trials:
    return Trials(*(np.concatenate([getattr(t, f.name) for t in each]) for f in fields(Trials)))


CASES: tuple[tuple[Carried, tuple[float, float]], ...] = (
    ("camera", EXACT), ("camera", STOPS_OFF), ("board", EXACT), ("board", STOPS_OFF),
)  # fmt: skip
ROUND = make_board("round-target", diameter_m=0.16).points
"""24 points on 115 mm, where the ChArUco has 35 on 180 mm x 120 mm."""


@pytest.mark.parametrize(
    ("carried", "arm", "points"),
    [("camera", STOPS_OFF, None), ("board", EXACT, None), ("board", STOPS_OFF, ROUND)],
)
def test_a_few_sets_are_as_near_as_they_say(carried, arm, points):
    check(run(2, carried, arm, 50, points))


@pytest.mark.slow
@pytest.mark.parametrize("trials", [50, pytest.param(200, marks=pytest.mark.full)])
@pytest.mark.parametrize(
    ("seed", "points"), [(51, None), (56, ROUND)], ids=["charuco", "round target"]
)
def test_errors_are_those_of_the_bound_and_covariances_are_right(seed, points, trials):
    """Two hundred sets, of four set-ups: all of them, and each, with each of X, Z and the lens."""
    each = [run(trials, carried, arm, seed, points) for carried, arm in CASES]
    done = together(each)
    assert LOWEST < done.over_bound() < HIGHEST
    assert 0.93 < done.inside.mean() < 0.97
    for one in each:
        check(one)
        for part in GROUPS.values():
            low, high = band(len(one.errors), part.stop - part.start)
            assert LOWEST * low < one.over_bound(part) < HIGHEST * high


def run_moving(trials: int, carried: Carried, seed: int) -> Trials:
    """The same while the arm moves, each picture up to 60 ms before or after its joints."""
    found = []
    for trial in range(trials):
        rng = np.random.default_rng([seed, trial])
        scene, late = draw_scene(rng, PICTURES, carried), rng.uniform(-0.06, 0.06)
        q = posture_of_pose(scene.flange)
        velocity = rng.standard_normal(q.shape) * np.repeat([0.1, 0.3], 3)
        motion = np.stack([velocity, 2.0 * velocity * rng.standard_normal(q.shape)], axis=1)
        shown = q - late * velocity + late**2 / 2.0 * motion[:, 1]
        motion[:, 0] -= late * motion[:, 1]
        pictures = scene.shown(scene.seen(rng, arm=STOPS_OFF), postures=shown, motion=motion)
        result = calibrate(pictures)
        assert result.used.all()
        assert result.warnings == ()
        model = true_model(scene, STOPS_OFF, [TimeOffsets({"camera": WHERE[carried]})])
        views = replace(Setup.of(PICTURES), motion=motion)
        error = np.insert(scene.errors(result), 12, result.time_offsets_s["camera"][0] - late)
        x = model.nominal + late * (np.arange(model.p) == 12)
        J = model.linearise(shown, x, views).white_jacobian.reshape(-1, model.p)
        low, high = result.estimate.interval
        inside = np.abs(error) <= (high - low) / 2.0
        found.append((error, np.linalg.inv(J.T @ J), result.estimate.covariance, inside))
    return Trials(*(np.array(part) for part in zip(*found, strict=True)))


WHERE = {"camera": ("tool", 0), "board": ("target", 0)}


@pytest.mark.parametrize("carried", ["camera", "board"])
def test_the_time_between_joints_and_pictures_is_found_as_near_as_can_be(carried):
    done = run_moving(2, carried, 53)
    check(done)
    low, high = band(2, 1)
    assert LOWEST * low < done.over_bound(slice(12, 13)) < HIGHEST * high


@pytest.mark.slow
@pytest.mark.parametrize("trials", [50, pytest.param(200, marks=pytest.mark.full)])
def test_errors_with_a_time_offset_are_those_of_the_bound(trials):
    each = [run_moving(trials, carried, 54) for carried in WHERE]
    assert LOWEST < together(each).over_bound() < HIGHEST
    for done in each:
        check(done)
        low, high = band(len(done.errors), 1)
        assert LOWEST * low < done.over_bound(slice(12, 13)) < HIGHEST * high


JOINTS = slice(1, 5)
OFFSET = np.deg2rad(0.3)


def run_robot(trials: int, carried: Carried, seed: int, first: int = 0) -> Trials:
    """The same with zero offsets of an exact arm, by its joint values."""
    robot, found = Robot.preset("ur10e"), []
    names = robot.joint_names[JOINTS]
    for trial in range(first, first + trials):
        rng = np.random.default_rng([seed, trial])
        scene, q = reached(robot, draw_scene(rng, 40, carried), PICTURES)
        true = OFFSET * rng.standard_normal(len(names))
        shown = q.copy()
        shown[:, JOINTS] -= true
        pictures = scene.shown(scene.seen(rng), robot=robot, postures=shown)
        result = calibrate(pictures, free=[ZeroOffsets(robot, names)])
        assert result.used.all()
        offsets = result.estimate.values[12:16] - true
        error = np.insert(scene.errors(result), 12, offsets)
        model = true_model(scene, EXACT, [ZeroOffsets(robot, names)], robot)
        found.append(trial_of(model, q, error, result.estimate))
    return Trials(*(np.array(part) for part in zip(*found, strict=True)))


@pytest.mark.parametrize("trial", [61, 130])
def test_two_deviations_of_the_arm_that_are_as_likely_do_not_take_turns(trial):
    """Each followed from the fit with the other, without end, and good pictures were left out."""
    run_robot(1, "board", 52, trial)  # all pictures are used


@pytest.mark.slow
@pytest.mark.parametrize("trials", [50, pytest.param(200, marks=pytest.mark.full)])
def test_zero_offsets_of_the_robot_are_found_as_near_as_can_be(trials):
    each = [run_robot(trials, carried, 52) for carried in WHERE]
    assert together(each).over_bound() < HIGHEST
    for done in each:
        check(done)
        low, high = band(len(done.errors), 4)
        assert LOWEST * low < done.over_bound(slice(12, 16)) < HIGHEST * high
