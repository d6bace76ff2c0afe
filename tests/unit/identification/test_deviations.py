"""The deviation of an arm from pose to pose, shared by all that is measured at a pose."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from calib import CalibrationModel, Robot, identify
from calib.identification.candidate import Candidate, Workplace, fit_reference
from calib.identification.deviations import SURELY, components
from calib.identification.evidence import groups_of, linear_evidence
from calib.model import Setup, simulate
from calib.model.measurements import Measurement, Measurements, Point, Pose, TouchUp
from calib.model.parameters import TargetFrame, TargetPoints, ToolFrame, ToolPoints, ZeroOffsets
from calib.se3 import rotation_exp, transform

ROBOT = Robot.preset("ur5e")
MARKS = [[0.05, 0.0, 0.1], [-0.05, 0.06, 0.15], [0.0, -0.08, 0.2]]
NOISE_M = 5e-5
ARM = (3e-4, 6e-4)
POSES = 40


def model_of(
    kind: Measurement | None = None, *, marks: int = 3, zeros: bool = True
) -> CalibrationModel:
    blocks = [
        ToolPoints(MARKS[:marks], [f"M{k}" for k in range(marks)]),
        TargetFrame(transform(np.eye(3), [2.0, 0.5, 0.3])),
    ]
    if zeros:
        blocks.insert(0, ZeroOffsets(ROBOT, ROBOT.joint_names[1:5], 1e-3))
    return CalibrationModel(ROBOT, blocks, kind or Point(NOISE_M))


def measured(
    model: CalibrationModel, rng: np.random.Generator, *, marks: int = 3, poses: int = POSES
) -> Measurements:
    """All marks at every pose."""
    q = np.repeat(rng.uniform(-2.0, 2.0, (poses, ROBOT.n)), marks, axis=0)
    setup = replace(
        Setup.of(len(q), tool=np.tile(range(marks), poses)),
        stop=np.repeat(np.arange(poses), marks),
    )
    return simulate(model, model.nominal, q, rng, setup=setup)


def found_at(model: CalibrationModel, data: Measurements) -> CalibrationModel | None:
    result = identify(model, data)
    return components(model.linearise_at(data, result.values), np.ones(data.count))


def test_whitening_is_that_of_the_explicit_covariance():
    """Of points and a pose that share a stop, by differences of where the tip is."""
    kinds = [Point([1e-4, 2e-4, 3e-4]), Pose([1e-4] * 3 + [2e-4] * 3)]
    frame = ToolFrame(transform(rotation_exp(np.array([0.1, 0.2, 0.3])), MARKS[2]), "frame")
    blocks = [ToolPoints(MARKS[:2], ["a", "b"]), frame, TargetFrame(np.eye(4))]
    robot = Robot.preset("ur5e")
    model = CalibrationModel(robot, blocks, kinds).with_deviation(ARM)
    q = np.repeat(np.random.default_rng(0).uniform(-2, 2, (2, 6)), 3, axis=0)
    setup = Setup.of(6, kind=[0, 0, 1] * 2, tool=[0, 1, 2] * 2)
    setup = replace(setup, stop=np.repeat([0, 1], 3))
    view = model.view(q, None, setup)
    # a shift or turn of the tip is one of everything on it: of the tool frames in the tip's axes
    step = 1e-6
    T_tip = robot.fk(q[0])
    D = np.zeros((6, 6, 6))
    sigma = np.zeros((6, 6))
    for k in range(6):
        six = step * np.eye(6)[k]
        ends = []
        for sign in (1.0, -1.0):
            off = transform(rotation_exp(sign * six[3:]), np.zeros(3))
            moved = T_tip.copy()
            moved[:3, :3] = off[:3, :3] @ T_tip[:3, :3]
            moved[:3, 3] += sign * six[:3]
            rows = np.zeros((3, 6))
            for i in (0, 1):
                rows[i, :3] = (moved @ np.append(MARKS[i], 1.0))[:3]
            T = moved @ frame.T_nominal[0]
            rows[2, :3] = T[:3, 3]
            ends.append((rows, T))
        (ahead, T_ahead), (behind, T_behind) = ends
        D[:3, :, k] = (ahead - behind) / (2 * step)
        turned = T_ahead[:3, :3] @ T_behind[:3, :3].T
        vee = np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
        D[2, 3:, k] = vee / (2 * step)
    sigma[:2, :3], sigma[2] = kinds[0].sigma, kinds[1].sigma
    there = sigma[:3] > 0
    A = D[:3][there] @ np.diag(np.repeat(ARM, 3))
    covariance = A @ A.T + np.diag(sigma[:3][there] ** 2)
    unit = np.zeros((len(A), 3, 6))
    unit[:, there] = np.eye(len(A))
    last = np.zeros((len(A), 6, 6))
    last[:, :, :3] = unit.transpose(0, 2, 1)
    white = model.whiten_last(last, view).transpose(0, 2, 1)[:, :3][:, there]
    np.testing.assert_allclose(white.T @ covariance @ white, np.eye(len(A)), atol=1e-6)
    np.testing.assert_allclose(
        model.colour_last(model.whiten_last(last, view), view), last, atol=1e-12
    )


def test_evidence_is_the_density_of_what_is_measured_together():
    model = model_of().with_deviation(ARM)
    held = model.with_prior(np.full(model.p, 1e-3))
    rng = np.random.default_rng(1)
    data = measured(held, rng, poses=5)
    linear = held.linearise_at(data, held.nominal)
    found = linear_evidence(linear, [], np.ones(data.count)).log_evidence(np.zeros(0))[0]
    J = linear.jacobian.reshape(-1, held.p)
    view = linear.view
    D = NOISE_M * held.by_deviation(view).transpose(2, 0, 1) * np.repeat(ARM, 3)
    stop = data.setup.stops
    shared = np.einsum("imt,jnt,ij->imjn", D, D, stop[:, None] == stop)
    size = J.shape[0]
    covariance = 1e-6 * J @ J.T + NOISE_M**2 * np.eye(size) + shared.reshape(size, size)
    wanted = multivariate_normal(np.zeros(size), covariance).logpdf(linear.rows.ravel())
    assert found == pytest.approx(wanted, abs=1e-6)


def test_noise_and_deviation_are_found():
    """Their standard deviations, to what 40 poses tell of them."""
    truth, rng = model_of().with_deviation(ARM), np.random.default_rng(2)
    noise, arm = [], []
    for _ in range(20):
        model = found_at(model_of(Point(2 * NOISE_M)), measured(truth, rng))
        assert model is not None
        noise.append(model.measurement.sigma[0])
        arm.append(model.arm_sigma)
    # of 40 poses three coordinates each, in which the parameters have their share
    sure = 4.0 / np.sqrt(2 * 20 * 3 * POSES * 0.8)
    assert np.sqrt(np.mean(np.square(noise))) == pytest.approx(NOISE_M, rel=sure)
    np.testing.assert_allclose(np.sqrt(np.mean(np.square(arm), axis=0)), ARM, rtol=sure)


@pytest.mark.slow
def test_an_arm_that_stops_where_it_says_shows_none():
    truth, rng = model_of(), np.random.default_rng(3)
    seen = sum(found_at(model_of(Point(3 * NOISE_M)), measured(truth, rng)) is not None
               for _ in range(400))  # fmt: skip
    assert seen <= 400 * SURELY + 4.0 * np.sqrt(400 * SURELY)


def test_one_measurement_a_pose_tells_nothing_apart():
    truth, rng = model_of(marks=1).with_deviation(ARM), np.random.default_rng(4)
    assert found_at(model_of(marks=1), measured(truth, rng, marks=1)) is None
    pins = CalibrationModel(ROBOT, [ToolPoints(MARKS[:1], ["tool"]), TargetPoints([[0.5, 0, 0.3]])],
                            TouchUp(NOISE_M))  # fmt: skip
    q = rng.uniform(-0.1, 0.1, (20, 6)) + np.array([0.0, -1.5, 1.5, -1.5, -1.5, 0.0])
    data = Measurements(q, Setup.of(20), pins.targets, pins.tools).at_stops()
    assert components(pins.linearise_at(data, pins.nominal), np.ones(20)) is None


def test_poses_that_come_back_are_one_stop():
    """Whatever they are called, and in whatever order."""
    q = np.random.default_rng(5).uniform(-1, 1, (4, 6))
    data = Measurements(np.vstack([q, q[::-1] + 1e-5]), Setup.of(8)).at_stops()
    assert data.setup.stop is not None
    assert data.setup.stop[:4].tolist() == data.setup.stop[:3:-1].tolist()
    assert len(set(data.setup.stop.tolist())) == 4


def reference_errors(trials: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors of all parameters over their standard deviations, and what was said of the arm."""
    truth, rng = model_of().with_deviation(ARM), np.random.default_rng(seed)
    over, said = [], []
    for _ in range(trials):
        data = measured(truth, rng)
        x = truth.nominal
        candidate = Candidate("all", model_of(), (), groups_of(model_of(), 0.05, 2.0))
        at = Workplace(data.postures, data.setup, "there")
        result = fit_reference(candidate, data, at).fitted.result
        over.append((result.values - x) / result.sigma)
        said.append(result.noise[0].arm_sigma)
    return np.array(over), np.array(said, dtype=float)


@pytest.mark.slow
def test_errors_are_as_large_as_said_where_marks_share_a_deviation():
    """By one noise for all marks, sigma is three fifths of what it has to be."""
    over, said = reference_errors(40, 6)
    frames = over[:, 4:]  # zeros are held by priors whose size is found: none here
    assert 0.9 < np.sqrt(np.mean(frames**2)) < 1.1
    np.testing.assert_allclose(np.sqrt(np.mean(said**2, axis=0)), ARM, rtol=0.1)
