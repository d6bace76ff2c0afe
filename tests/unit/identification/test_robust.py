"""Measurements that contradict the others: found by name, or kept from doing harm."""

from dataclasses import replace

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.errors import InputError
from calib.identification.robust import OUTLIER_CHANCE
from calib.model import Setup, simulate
from calib.model.measurements import Pose, TouchUp, touch_ups
from calib.model.parameters import TargetFrame, ToolFrame, ZeroOffsets
from calib.se3 import rotation_exp, transform

SIGMA_M = np.array([0.02, 0.02, 0.12]) / 3e3
OFFSETS = np.deg2rad([0.2, -0.3, 0.15, -0.25])
SIX = [2e-5] * 3 + [1e-4] * 3
SEEDS = range(1)


def touched(make_model, touching, seed: int, bad: int = 5):
    """27 touch-ups, some of them with the joints off by up to a degree; truth and culprits."""
    model = make_model()
    rng = np.random.default_rng(seed)
    x = model.nominal.copy()
    x[:4] = OFFSETS
    data = simulate(model, x, touching(27), rng)
    culprits = np.sort(rng.permutation(27)[:bad])
    q = data.postures.copy()
    q[culprits] += rng.uniform(-0.02, 0.02, (bad, 6))
    return model, x, replace(data, postures=q), culprits


def posed(robot, seed: int, bad: int = 5):
    """23 poses of a tracker, some of them read wrongly by centimetres or by degrees."""
    rng = np.random.default_rng(seed)
    model = CalibrationModel(
        robot,
        [
            ZeroOffsets(robot, [f"joint_{j}" for j in (2, 3, 4, 5)]),
            ToolFrame(transform(rotation_exp([0.1, 0.2, -0.1]), [0.1, 0.0, 0.3])),
            TargetFrame(transform(rotation_exp([0.2, -0.1, 2.0]), [2.0, -1.0, 0.5])),
        ],
        Pose(SIX),
    )
    x = model.nominal.copy()
    x[:4] = OFFSETS
    data = simulate(model, x, rng.uniform(-1, 1, (23, 6)), rng)
    culprits = np.sort(rng.permutation(23)[:bad])
    read = data.observed.copy()
    for k, i in enumerate(culprits):
        if k % 2:
            read[i, :3] += rng.uniform(-0.05, 0.05, 3)
        else:
            read[i, 3:] += rng.uniform(-0.05, 0.05, 3)
    return model, x, replace(data, observed=read), culprits


CASES = ["touch-ups", "poses"]


@pytest.fixture
def spoilt(make_model, touching, reference_robot):
    def make(case: str, seed: int, bad: int = 5):
        if case == "poses":
            return posed(reference_robot, seed, bad)
        return touched(make_model, touching, seed, bad)

    return make


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("case", CASES)
def test_gross_errors_are_left_out_by_name(spoilt, case, seed):
    model, x, data, culprits = spoilt(case, seed)
    result = identify(model, data, loss="graduated")
    np.testing.assert_array_equal(np.flatnonzero(result.outliers), culprits)
    assert result.explains_data
    np.testing.assert_array_less(np.abs(result.values - x), 4 * result.sigma)
    named = ", ".join(data.names[i] for i in culprits)
    assert f"left out because they contradict the others: {named}" in result.notes
    np.testing.assert_array_equal(result.weights, ~result.outliers)
    # exactly what the others give
    good = ~result.outliers
    clean = identify(model, data[np.flatnonzero(good)])
    np.testing.assert_array_less(np.abs(clean.values - result.values), 1e-4 * clean.sigma)
    np.testing.assert_allclose(result.sigma, clean.sigma, rtol=1e-5)
    assert result.degrees_of_freedom == clean.degrees_of_freedom
    assert result.chi2 == pytest.approx(clean.chi2, rel=1e-6)
    assert result.rms_m == pytest.approx(clean.rms_m, rel=1e-4)
    # what was left out is shown all the same
    assert np.linalg.norm(result.residuals[culprits], axis=1).min() > 10 * result.rms_m


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("loss", ["huber", "cauchy", "student-t"])
@pytest.mark.parametrize("case", CASES)
def test_weighing_down_keeps_the_estimate_near(spoilt, case, loss, seed):
    """Far nearer than least squares, and within what their own standard deviations say."""
    model, x, data, culprits = spoilt(case, seed)
    clean = identify(model, data[np.setdiff1d(np.arange(data.count), culprits)])
    result = identify(model, data, loss=loss)
    off = np.abs(result.values - x) / clean.sigma
    bound = {"huber": 40.0, "cauchy": 6.0, "student-t": 6.0}[loss]
    assert off.max() < bound
    assert result.weights[culprits].max() < 0.2
    assert np.median(result.weights) > 0.5
    assert not result.outliers.any()


@pytest.mark.parametrize("loss", ["huber", "cauchy", "student-t", "graduated"])
@pytest.mark.parametrize("case", CASES)
def test_good_measurements_are_hardly_touched(spoilt, case, loss):
    model, x, data, _ = spoilt(case, 11, bad=0)
    plain, robust = identify(model, data), identify(model, data, loss=loss)
    np.testing.assert_array_less(np.abs(robust.values - plain.values), 0.7 * plain.sigma)
    np.testing.assert_array_less(np.abs(robust.values - x), 4 * robust.sigma)
    if loss == "graduated":
        np.testing.assert_allclose(robust.values, plain.values, atol=1e-12)
        assert robust.notes == ()


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize(("case", "bad"), [("touch-ups", 14), ("poses", 17)])
def test_when_most_contradict_each_other_that_is_said_in_one_line(spoilt, case, bad, seed):
    model, _, data, _ = spoilt(case, seed, bad)
    with pytest.raises(InputError, match=r"contradict (the others|each other): ") as caught:
        identify(model, data, loss="graduated")
    assert "\n" not in str(caught.value)
    assert caught.value.hint
    assert caught.value.value > caught.value.bound


@pytest.mark.parametrize("case", CASES)
def test_nearly_half_may_be_wrong(spoilt, case):
    model, x, data, culprits = spoilt(case, 1, 11)
    result = identify(model, data, loss="graduated")
    np.testing.assert_array_equal(np.flatnonzero(result.outliers), culprits)
    np.testing.assert_array_less(np.abs(result.values - x), 4 * result.sigma)


def test_a_model_that_leaves_something_out_is_no_reason_to_refuse(spoilt):
    """Ten times the noise given, and gross errors beside: these are found."""
    model, _, data, culprits = spoilt("touch-ups", 3)
    result = identify(model.with_measurements([TouchUp(SIGMA_M / 10)]), data, loss="graduated")
    np.testing.assert_array_equal(np.flatnonzero(result.outliers), culprits)
    assert result.noise_scale == pytest.approx(10, rel=0.3)


def left_out(make_model, touching, seeds) -> int:
    model, q = make_model(), touching(27)
    x = model.nominal.copy()
    x[:4] = OFFSETS
    total = 0
    for seed in seeds:
        data = simulate(model, x, q, np.random.default_rng(1000 + seed))
        total += int(identify(model, data, loss="graduated").outliers.sum())
    return total


def test_where_nothing_is_wrong_nothing_is_left_out(make_model, touching):
    # 4 sets of 27: at the chance that is meant, 0.01 measurements
    assert left_out(make_model, touching, range(4)) == 0


@pytest.mark.slow
def test_where_nothing_is_wrong_nothing_is_left_out_of_many_sets(make_model, touching):
    expected = 60 * 27 * OUTLIER_CHANCE
    assert left_out(make_model, touching, range(60)) <= expected + 4 * np.sqrt(expected)


def test_gross_errors_of_a_noise_that_nobody_gave(spoilt):
    model, x, data, culprits = spoilt("touch-ups", 13)
    unknown = model.with_measurements([TouchUp(None)])
    result = identify(unknown, data, loss="graduated")
    np.testing.assert_array_equal(np.flatnonzero(result.outliers), culprits)
    np.testing.assert_array_less(np.abs(result.values - x), 4 * result.sigma)


def test_one_kind_does_not_hide_the_errors_of_another(make_model, reference_robot, touching):
    """A gross error of a precise kind is small in the unit of a coarse one."""
    base = make_model()
    kinds = [TouchUp(2e-6), TouchUp(1e-3)]
    model = base.with_measurements(kinds)
    setup = Setup.of(30, kind=np.arange(30) % 2)
    data = simulate(model, model.nominal, touching(30), np.random.default_rng(14), setup=setup)
    q = data.postures.copy()
    q[4] += 1e-4  # a few tenths of a millimetre
    result = identify(model, replace(data, postures=q), loss="graduated")
    assert np.flatnonzero(result.outliers).tolist() == [4]


@pytest.mark.parametrize(
    ("options", "sigma", "message"),
    [
        ({"method": "newton"}, 1e-5, r"unknown method 'newton' \(one of gauss-newton, newton-r"),
        ({"loss": "tukey"}, 1e-5, r"unknown loss 'tukey' \(one of least-squares, huber"),
        ({"loss": "huber", "weighted": False}, 1e-5, "the loss huber needs rows that are weighted"),
        ({"method": "newton-raphson", "loss": "cauchy"}, 1e-5, "knows no robust loss and no unkn"),
        ({"method": "newton-raphson"}, None, "knows no robust loss and no unknown"),
    ],
)
def test_options_that_exclude_each_other(make_model, touching, options, sigma, message):
    with pytest.raises(InputError, match=message):
        identify(make_model(measurement=TouchUp(sigma)), touch_ups(touching(8)), **options)
