"""Leave-one-out in closed form, against the fits that it spares."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import CalibrationModel, identify
from calib.identification import Candidate, compare, minimise
from calib.identification.cross_validation import measured_points, targets_left_out
from calib.model import KnownDistance, Setup, simulate
from calib.model.measurements import Distance, Measurements, Point, Pose, TouchUp
from calib.model.measurements.data import SAME_POSTURE_RAD, repeated_together, same_posture
from calib.model.parameters import TargetFrame, TargetPoints, ToolFrame, ToolPoints, ZeroOffsets
from calib.se3 import rotation_exp, transform

T_TOOL = transform(rotation_exp([0.1, 0.2, -0.1]), [0.2, -0.05, 0.35])
T_TRACKER = transform(rotation_exp([0.2, -0.1, 2.0]), [2.0, -1.0, 0.5])
JOINTS = ["joint_2", "joint_3", "joint_4", "joint_5"]


def refitted(model: CalibrationModel, data: Measurements, **options) -> np.ndarray:
    """Residuals of the measurements of each pose by the fit to those of all others."""
    out = np.empty((data.count, model.rows))
    for pose in range(data.pose.max() + 1):
        own, rest = np.flatnonzero(data.pose == pose), np.flatnonzero(data.pose != pose)
        fit = identify(model, data[rest], **options)
        part = data[own]
        read = part.observed
        out[own] = model.linearise(part.postures, fit.values, part.setup, read).rows
    return out


def assert_spared(model, data, **options) -> None:
    """What the closed form leaves out is of second order in the noise."""
    result = identify(model, data, **options)
    expected = refitted(model, data, **options)
    for angles in (False, True):
        rows = np.where(result.angles == angles, 1.0, 0.0)
        if rows.any():
            size = np.sqrt(np.sum(rows * expected**2) / rows.sum())
            np.testing.assert_allclose(
                rows * result.leave_one_out, rows * expected, atol=2e-3 * size
            )
    assert result.indispensable == 0


def three_reflectors(robot, seed: int, poses: int = 9) -> tuple[CalibrationModel, Measurements]:
    """Each pose measured at three reflectors, and one of them a second time."""
    names = ["A", "B", "C"]
    rng = np.random.default_rng(seed)
    places = rng.uniform(-0.3, 0.4, (3, 3))
    blocks = [ZeroOffsets(robot, JOINTS), ToolPoints(places, names), TargetFrame(T_TRACKER)]
    model = CalibrationModel(robot, blocks, Point([1e-6, 2e-6, 4e-6]))
    q = np.repeat(rng.uniform(-1, 1, (poses, 6)), 4, axis=0)
    setup = Setup.of(4 * poses, tool=np.tile([0, 1, 2, 0], poses))
    data = simulate(model, model.nominal, q, rng, setup=setup)
    return model, replace(data, names=tuple(f"P{k // 4}" for k in range(4 * poses)))


@pytest.mark.parametrize(("count", "weighted"), [(6, True), (20, False)])
def test_touch_ups_are_left_out_one_by_one(make_model, touching, weighted, count):
    model = make_model(measurement=TouchUp(np.array([0.02, 0.02, 0.12]) / 3e4))
    data = simulate(model, model.nominal, touching(count), np.random.default_rng(1))
    assert_spared(model, data, weighted=weighted)


@pytest.mark.parametrize("seed", range(3))
def test_measurements_of_one_pose_are_left_out_together(reference_robot, seed):
    model, data = three_reflectors(reference_robot, seed)
    assert_spared(model, data)
    # one by one it would be too good to be true: the others of the pose tell it
    alone = identify(model, replace(data, names=()))
    together = identify(model, data)
    # whatever they are called: a posture that is taken again is no other witness
    assert alone.leave_one_out_rms_m == together.leave_one_out_rms_m


def test_poses_of_different_size(reference_robot):
    model, data = three_reflectors(reference_robot, 3)
    kept = np.setdiff1d(np.arange(data.count), [1, 4, 5, 6, 11])
    some = np.random.default_rng(0).permutation(kept)  # in any order, too
    assert sorted(set(np.bincount(data[some].pose))) == [1, 3, 4]
    assert_spared(model, data[some])


def test_mixed_kinds_of_one_pose(reference_robot):
    robot = reference_robot
    kinds = [Pose([2e-6] * 3 + [1e-5] * 3), Distance(5e-6)]
    blocks = [
        ZeroOffsets(robot, JOINTS),
        ToolFrame(T_TOOL),
        TargetFrame(T_TRACKER),
        TargetPoints([[1.2, -1.5, 0.3]], ["wire"]),
    ]
    model = CalibrationModel(robot, blocks, kinds)
    rng = np.random.default_rng(1)
    q = np.repeat(rng.uniform(-1, 1, (12, 6)), 2, axis=0)
    setup = Setup.of(24, kind=np.arange(24) % 2, target=np.arange(24) % 2)
    data = simulate(model, model.nominal, q, rng, setup=setup)
    assert_spared(model, replace(data, names=tuple(f"P{k // 2}" for k in range(24))))


def test_with_priors_and_a_known_distance(reference_robot, target_m, touching):
    """These are known whichever pose is left out, and count as much each time."""
    shifts = np.array([[0, 0, 0], [0, 0.3, 0.4]])
    blocks = [
        ZeroOffsets(reference_robot, ["joint_1", *JOINTS], prior_rad=2e-5),
        ToolPoints([[0.2, -0.05, 0.35]], ["tool"], prior_m=1e-4),
        TargetPoints(target_m + shifts, ["A", "B"]),
    ]
    model = CalibrationModel(
        reference_robot, blocks, TouchUp([1e-6, 2e-6, 8e-6]), [KnownDistance("A", "B", 0.5, 1e-6)]
    )
    q = np.concatenate([touching(5, seed=k, shift=s) for k, s in enumerate(shifts)])
    setup = Setup.of(10, target=np.repeat([0, 1], 5))
    data = simulate(model, model.nominal, q, np.random.default_rng(2), setup=setup)
    assert_spared(model, data)


def test_what_was_left_out_for_good_is_predicted_all_the_same(make_model, touching):
    model = make_model()
    data = simulate(model, model.nominal, touching(20), np.random.default_rng(3))
    q = data.postures.copy()
    q[7] += 0.01
    result = identify(model, replace(data, postures=q), loss="graduated")
    np.testing.assert_array_equal(result.leave_one_out[7], result.residuals[7])
    clean = identify(model, data[np.delete(np.arange(20), 7)])
    np.testing.assert_allclose(
        np.delete(result.leave_one_out, 7, axis=0), clean.leave_one_out, atol=1e-10
    )
    assert result.leave_one_out_rms_m == pytest.approx(clean.leave_one_out_rms_m, rel=1e-6)


def test_a_pose_that_alone_holds_a_parameter_is_not_a_number(reference_robot):
    """The only pose at which one of the reflectors was measured."""
    model, data = three_reflectors(reference_robot, 4)
    own = np.flatnonzero((data.setup.tool != 2) | (data.pose == 5))
    result = identify(model, data[own])
    lost = data[own].pose == 5
    assert np.isnan(result.leave_one_out[lost]).all()
    assert np.isfinite(result.leave_one_out[~lost]).all()
    assert result.indispensable == 1
    assert np.isfinite(result.leave_one_out_rms_m)


def repeated_poses(robot, times: int, poses: int = 9) -> tuple[CalibrationModel, Measurements]:
    """Poses that are each measured many times: more rows a pose than the model has parameters."""
    rng = np.random.default_rng(4)
    blocks = [
        ZeroOffsets(robot, JOINTS),
        ToolPoints([[0.1, 0.0, 0.2]], ["A"]),
        TargetFrame(T_TRACKER),
    ]
    model = CalibrationModel(robot, blocks, Point([1e-6, 2e-6, 4e-6]))
    q = np.repeat(rng.uniform(-1, 1, (poses, 6)), times, axis=0)
    return model, simulate(model, model.nominal, q, rng)


def test_a_pose_with_more_rows_than_there_are_parameters(reference_robot):
    model, data = repeated_poses(reference_robot, 12)
    data = replace(data, names=tuple(f"P{k // 12}" for k in range(data.count)))
    assert 12 * model.rows > model.p
    assert_spared(model, data)


def test_memory_grows_with_the_rows_not_with_their_square(reference_robot):
    model, data = repeated_poses(reference_robot, 600, poses=5)
    peaks = []
    for rows in (slice(0, None, 4), slice(None)):
        tracemalloc.start()
        identify(model, data[rows])
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 6.0 * peaks[0]  # of four times the rows; sixteen times with their square
    assert peaks[1] < 60e6


def test_of_one_name_or_at_one_posture():
    q = np.array([[0.0, 1.0], [1.0, 1.0], [0.001, 1.001], [0.002, 1.0], [0.0, 1.0], [2.0, 2.0]])
    data = Measurements(q, Setup.of(6), names=("A", "B", "C", "D", "E", "B"))
    # A, C and E are at one posture; D is too far in one joint; B has one name
    np.testing.assert_array_equal(data.groups == data.groups[:, None], expected())
    np.testing.assert_array_equal(data[np.array([5, 1, 3])].groups, [0, 0, 1])


def expected() -> np.ndarray:
    index = np.array([0, 1, 0, 2, 0, 1])
    return index == index[:, None]


def test_a_slow_path_is_not_one_posture():
    q = np.linspace(0.0, 1.0, 5000)[:, None] * np.ones(6)
    index = same_posture(q)
    assert np.abs(q - q[np.unique(index, return_index=True)[1]][0]).max() == 1.0
    assert len(np.unique(index)) > 250
    for each in np.unique(index):
        assert np.ptp(q[index == each], axis=0).max() <= 2 * SAME_POSTURE_RAD


def test_many_at_one_posture():
    """Pairs are not counted one by one: there are fifty million of them."""
    q = np.zeros((10_000, 6))
    assert not repeated_together(np.arange(10_000), q).any()


@given(st.integers(0, 10_000), st.integers(1, 30))
def test_the_order_of_measurements_does_not_matter(seed, count):
    rng = np.random.default_rng(seed)
    q = rng.uniform(0, 4 * SAME_POSTURE_RAD, (count, 2))
    pose = rng.integers(0, count, count)
    order = rng.permutation(count)
    groups = repeated_together(pose, q)
    again = repeated_together(pose[order], q[order])
    np.testing.assert_array_equal(again == again[:, None], groups[order] == groups[order][:, None])


NOISE_M = 1e-4


def test_places_are_fitted_to_other_poses_by_the_noise(touching, make_model):
    """Axes of unlike noise, weights, a pose touched twice: as refits of the place without it."""
    kind = TouchUp([1e-4, 2e-4, 5e-4])
    truth = make_model((2, 3, 4, 5), kind, targets=3)
    shifts = [np.array([0.0, 0.3, 0.4]) * k for k in range(3)]
    q = np.vstack([touching(7, seed=k, shift=shift) for k, shift in enumerate(shifts)])
    setup = Setup.of(21, target=np.repeat(np.arange(3), 7))
    data = simulate(truth, truth.nominal, q, np.random.default_rng(0), setup=setup)
    data = replace(data, names=tuple(f"P{max(i, 1)}" for i in range(21)))
    fitted = identify(truth, data)
    result = replace(fitted, weights=np.random.default_rng(1).uniform(0.1, 1.0, 21))
    found = targets_left_out(truth, data, result)
    place = np.zeros(truth.p, dtype=bool)
    place[measured_points(truth, data)[0]] = True
    start = fitted.values[None]
    others = minimise(
        truth, data.trials(None), start, weights=(result.weights * (data.target != 0))[None]
    ).x
    for pose in (0, 3):
        own = np.flatnonzero(data.pose == pose)
        rest = result.weights * (data.target == 0) * (data.pose != pose)
        x = minimise(truth, data.trials(None), others, weights=rest[None], free=place).x[0]
        rows = truth.linearise(data.postures[own], x, data.setup[own]).rows
        np.testing.assert_allclose(found[own], rows, rtol=1e-4, atol=1e-9)


def test_a_target_touched_once_says_nothing(touching, make_model, target_m):
    """Fourteen touches at one target and one at each of five: once all errors came out as zero."""
    each = (14, 1, 1, 1, 1, 1)
    shifts = np.array([0.0, 0.06, 0.08]) * np.arange(6)[:, None]
    places = TargetPoints(target_m + shifts, tuple("ABCDEF"))
    frames, truth = (
        CalibrationModel(m.robot, [*m.parameters[:-1], places], TouchUp(NOISE_M))
        for m in (make_model((), TouchUp(NOISE_M)), make_model((2, 3, 4, 5), TouchUp(NOISE_M)))
    )
    x = truth.nominal.copy()
    x[:4] = [10e-3, -10e-3, 8e-3, 15e-3]
    q = np.vstack([touching(n, seed=k, shift=shifts[k]) for k, n in enumerate(each)])
    setup = Setup.of(19, target=np.repeat(np.arange(6), each))
    data = simulate(truth, x, q, np.random.default_rng(0), setup=setup)
    found = compare([Candidate("frames only", frames), Candidate("offsets", truth)], data)
    assert np.isnan(found.trials[0].target_out_m[14:]).all()
    assert found.criterion == "leave-one-out"
    assert found.recommended == "offsets"
    assert "of 19 measurements can be predicted with their target left out" in found.reason
