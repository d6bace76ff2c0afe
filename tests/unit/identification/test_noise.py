"""Noise that nobody has given: what the residuals say of it, kind by kind."""

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.errors import InputError, NotIdentifiableError
from calib.identification.robust import LEAST_NOISE
from calib.model import Setup, simulate
from calib.model.measurements import Distance, Point, Pose, TouchUp
from calib.model.parameters import (
    LengthOffsets,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import rotation_exp, transform

TRIALS = 4
T_TOOL = transform(rotation_exp([0.1, 0.2, -0.1]), [0.2, -0.05, 0.35])
T_TRACKER = transform(rotation_exp([0.2, -0.1, 2.0]), [2.0, -1.0, 0.5])
JOINTS = ["joint_2", "joint_3", "joint_4", "joint_5"]


def estimates(model, q, setup=None, **options):
    """Estimated noise of each kind, ``(TRIALS, kinds, rows)``, and the results."""
    unknown = model.with_measurements([type(kind)(None) for kind in model.measurements])
    data = simulate(model, model.nominal, q, np.random.default_rng(0), trials=TRIALS, setup=setup)
    return [identify(unknown, data.trials(t), **options) for t in range(TRIALS)]


def assert_about(found: list[float], true: float, freedom: float) -> None:
    """The root of the mean variance, within five standard deviations of that many squares."""
    spread = np.sqrt(1.0 / (2.0 * freedom * len(found)))
    assert np.sqrt(np.mean(np.square(found))) == pytest.approx(true, rel=5 * spread)


def test_of_touch_ups(make_model, touching):
    model = make_model(measurement=TouchUp(3e-5))
    results = estimates(model, touching(20))
    assert_about([r.noise[0].sigma[0] for r in results], 3e-5, 50)
    for r in results:
        assert r.noise[0].estimated
        assert np.ptp(r.noise[0].sigma) == 0.0
        assert r.noise[0].scale == pytest.approx(1.0, abs=1e-3)
        assert r.noise_scale == pytest.approx(1.0, abs=1e-3)
        assert "the noise was not given" in r.message
    # redundancy is considered: the root mean square of the residuals alone is less
    rms = [np.sqrt(np.mean(r.residuals**2)) for r in results]
    assert_about(rms, 3e-5 * np.sqrt(50 / 60), 50)


def pose_model(robot, kinds, extra=()) -> CalibrationModel:
    blocks = [ZeroOffsets(robot, JOINTS), ToolFrame(T_TOOL), TargetFrame(T_TRACKER), *extra]
    return CalibrationModel(robot, blocks, kinds)


def test_of_poses_lengths_and_angles_apart(reference_robot):
    model = pose_model(reference_robot, Pose([3e-5] * 3 + [4e-4] * 3))
    q = np.random.default_rng(1).uniform(-1, 1, (23, 6))
    results = estimates(model, q)
    lengths = [r.noise[0].sigma[0] for r in results]
    angles = [r.noise[0].sigma[3] for r in results]
    # 138 equations for 16 parameters: each part has more than 50 left
    assert_about(lengths, 3e-5, 55)
    assert_about(angles, 4e-4, 55)
    assert abs(np.corrcoef(lengths, angles)[0, 1]) < 0.7


def test_readings_without_noise_show_the_least_there_is(reference_robot):
    """Their rounding is none: in units of it no fit would come to rest."""
    q = np.random.default_rng(7).uniform(-1, 1, (30, 6))
    blocks = [ZeroOffsets(reference_robot, JOINTS), ToolPoint([0.2, -0.05, 0.35])]
    model = CalibrationModel(reference_robot, [*blocks, TargetFrame(T_TRACKER)], Point(None))
    x = model.nominal.copy()
    x[:4] = [2e-3, -3e-3, 1e-3, 2e-3]
    result = identify(model, simulate(model, x, q))
    np.testing.assert_array_equal(result.noise[0].sigma, LEAST_NOISE)
    np.testing.assert_allclose(result.values, x, atol=1e-11)
    assert result.iterations < 10


def mixed(robot) -> tuple[CalibrationModel, Setup]:
    """60 measurements: touch-ups of a point, poses, and distances from a third place."""
    kinds = [TouchUp(2e-5), Pose([5e-5] * 3 + [3e-4] * 3), Distance(1e-4)]
    model = pose_model(
        robot,
        kinds,
        [
            TargetPoints([[1.9, 0.1, 0.5], [1.2, -1.5, 0.3]], ["pin", "wire"]),
            LengthOffsets(["wire"]),
        ],
    )
    which = np.arange(60) % 3
    return model, Setup.of(60, kind=which, target=np.array([1, 0, 2])[which])


def test_of_three_kinds_at_once(reference_robot, touching):
    model, setup = mixed(reference_robot)
    q = touching(60)
    # the pin stands where the tool frame's origin touches it
    q[setup.kind != 0] = np.random.default_rng(2).uniform(-1, 1, (40, 6))
    x = model.nominal.copy()
    data = simulate(model, x, q, np.random.default_rng(3), trials=TRIALS, setup=setup)
    unknown = model.with_measurements([TouchUp(None), Pose(None), Distance(None)])
    results = [identify(unknown, data.trials(t)) for t in range(TRIALS)]
    assert_about([r.noise[0].sigma[0] for r in results], 2e-5, 45)
    assert_about([r.noise[1].sigma[0] for r in results], 5e-5, 45)
    assert_about([r.noise[1].sigma[3] for r in results], 3e-4, 50)
    assert_about([r.noise[2].sigma[0] for r in results], 1e-4, 14)
    assert [noise.kind for noise in results[0].noise] == ["touch-up", "pose", "distance"]
    # and with it the weights are nearly those of the true noise
    best = identify(model, data.trials(0))
    np.testing.assert_array_less(np.abs(results[0].values - best.values), 1.0 * best.sigma)


def test_one_kind_given_and_one_not(reference_robot):
    model = pose_model(reference_robot, [Point(2e-5), Pose([5e-5] * 3 + [3e-4] * 3)])
    setup = Setup.of(40, kind=np.arange(40) % 2)
    q = np.random.default_rng(4).uniform(-1, 1, (40, 6))
    half = model.with_measurements([Point(2e-5), Pose(None)])
    data = simulate(model, model.nominal, q, np.random.default_rng(5), trials=TRIALS, setup=setup)
    results = [identify(half, data.trials(t)) for t in range(TRIALS)]
    assert_about([r.noise[1].sigma[0] for r in results], 5e-5, 45)
    for r in results:
        np.testing.assert_array_equal(r.noise[0].sigma, 2e-5)
        assert not r.noise[0].estimated
        assert r.noise[1].estimated
        assert r.noise[1].scale == pytest.approx(1.0, abs=1e-3)
    # what is given is not changed, but what the residuals say of it is told
    louder = model.with_measurements([Point(1e-5), Pose(None)])
    told = [identify(louder, data.trials(t)).noise[0].scale for t in range(TRIALS)]
    assert_about(told, 2.0, 40)


@pytest.mark.parametrize("wrong", [1e-9, 1e-1])
def test_the_first_guess_of_the_noise_does_not_matter(make_model, touching, wrong):
    """Nor does the size of the noise: a micrometre, or ten centimetres."""
    data = simulate(make_model(), make_model().nominal, touching(20), np.random.default_rng(6))
    kind = TouchUp(None)
    far = kind.with_noise(wrong / kind.sigma)
    near = identify(make_model(measurement=TouchUp(None)), data)
    other = identify(make_model(measurement=far), data)
    np.testing.assert_array_less(np.abs(other.values - near.values), 1e-3 * near.sigma)
    np.testing.assert_allclose(other.sigma, near.sigma, rtol=1e-3)


def test_poses_much_alike_are_judged_by_the_noise_that_there_is(make_model, touching):
    """By no guess of it: what a noise of a tenth of a millimetre would hide is seen by a finer."""
    q = touching(20, tilt=0.03)
    quiet, loud = (make_model(measurement=TouchUp(sigma)) for sigma in (1e-6, 4e-4))
    unknown = make_model(measurement=TouchUp(None))
    with pytest.raises(NotIdentifiableError, match="stays uncertain by"):
        identify(make_model(measurement=TouchUp(1e-4)), simulate(quiet, quiet.nominal, q))
    rng = np.random.default_rng(9)
    result = identify(unknown, simulate(quiet, quiet.nominal, q, rng))
    np.testing.assert_array_less(np.abs(result.values - quiet.nominal), 4 * result.sigma)
    with pytest.raises(NotIdentifiableError, match="stays uncertain by"):
        identify(unknown, simulate(loud, loud.nominal, q, rng))


def test_covariance_comes_from_the_residuals(make_model, touching):
    """The standard deviations of an unknown noise are those of least squares of equal rows."""
    model = make_model(measurement=TouchUp(None))
    true = make_model(measurement=TouchUp(5e-5))
    data = simulate(true, true.nominal, touching(20), np.random.default_rng(7))
    result, given = identify(model, data), identify(true, data)
    scale = result.noise[0].sigma[0] / 5e-5
    np.testing.assert_allclose(result.sigma, scale * given.sigma, rtol=1e-3)
    np.testing.assert_allclose(result.values, given.values, atol=1e-9)
    assert scale == pytest.approx(given.noise_scale, rel=1e-3)


@pytest.mark.parametrize("count", [3, 6])
def test_with_nothing_left_over_there_is_no_noise_to_find(
    reference_robot, count, target_m, touching
):
    """Nine equations for nine parameters say nothing of a noise; twice as many do."""
    blocks = [
        ZeroOffsets(reference_robot, JOINTS[:3]),
        ToolPoint([0.2, -0.05, 0.35]),
        TargetPoints(target_m),
    ]
    model = CalibrationModel(reference_robot, blocks, TouchUp(None))
    data = simulate(model, model.nominal, touching(count), np.random.default_rng(8))
    if count == 3:
        with pytest.raises(InputError, match="noise of the kind touch-up cannot be estimated from"):
            identify(model, data)
        return
    result = identify(model, data)
    assert result.degrees_of_freedom == 9
    assert 0.3e-4 < result.noise[0].sigma[0] < 2e-4
