"""What a result says of itself: intervals, correlations, singular values, text."""

from __future__ import annotations

import numpy as np
import pytest

from calib import CalibrationModel, identify
from calib.identification.result import STRONG_CORRELATION
from calib.model.measurements import Distance, Pose, Setup, TouchUp, touch_ups
from calib.model.measurements.simulate import simulate
from calib.model.parameters import (
    JointCompliance,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import rotation_exp, transform

TRIALS = 80
SIX = [2e-5] * 3 + [1e-4] * 3


def coverage(model, fitted, q) -> tuple[float, float]:
    """Share of 95 % intervals that hold the truth, and its standard error over the trials."""
    x = model.nominal.copy()
    x[:4] = np.deg2rad([0.2, -0.3, 0.15, -0.25])
    data = simulate(model, x, q, np.random.default_rng(0), trials=TRIALS)
    inside = []
    for t in range(TRIALS):
        low, high = identify(fitted, data.trials(t)).interval
        inside.append(np.mean((low <= x) & (x <= high)))
    return float(np.mean(inside)), float(np.std(inside) / np.sqrt(TRIALS))


@pytest.mark.parametrize(("noise", "count"), [("given", 14), ("estimated", 14), ("estimated", 6)])
def test_the_interval_holds_the_truth_in_95_of_100(make_model, touching, noise, count):
    """Student's distribution where the noise is taken from few residuals: 8 degrees of freedom."""
    model = make_model(measurement=TouchUp(7e-6))
    fitted = model if noise == "given" else make_model(measurement=TouchUp(None))
    share, error = coverage(model, fitted, touching(count, tilt=0.8))
    assert share == pytest.approx(0.95, abs=4 * error)


def test_with_the_normal_distribution_the_interval_would_be_too_short(make_model, touching):
    model = make_model(measurement=TouchUp(None))
    data = simulate(model, model.nominal, touching(4), np.random.default_rng(1))
    result = identify(model, data)
    assert result.degrees_of_freedom == 2
    reach = (result.interval[1] - result.values) / result.sigma
    np.testing.assert_allclose(reach, 4.303, atol=1e-3)  # Student's t, 2 degrees, 97.5 %
    given = identify(make_model(measurement=TouchUp(1e-4)), data)
    np.testing.assert_allclose((given.interval[1] - given.values) / given.sigma, 1.960, atol=1e-3)


def test_strong_correlations_are_listed_the_strongest_first(make_model, touching):
    model = make_model()
    result = identify(model, simulate(model, model.nominal, touching(20, tilt=0.3)))
    C = result.covariance
    expected = C / np.sqrt(np.outer(np.diag(C), np.diag(C)))
    np.testing.assert_allclose(result.correlations, expected, atol=1e-12)
    listed = result.strong_correlations
    assert listed
    sizes = [abs(value) for _, _, value in listed]
    assert sizes == sorted(sizes, reverse=True)
    found = {frozenset((a, b)) for a, b, _ in listed}
    wanted = {
        frozenset((model.names[i], model.names[j]))
        for i in range(model.p)
        for j in range(i)
        if abs(expected[i, j]) > STRONG_CORRELATION
    }
    assert found == wanted
    assert len(listed) == len(wanted)
    assert frozenset(("zero_offset.joint_2", "target.T1.z")) in found


def test_singular_values_are_those_of_columns_of_unit_length(make_model, touching):
    model = make_model()
    q = simulate(model, model.nominal, touching(20)).postures
    result = identify(model, simulate(model, model.nominal, touching(20)))
    white = model.linearise(q).white_jacobian.reshape(-1, model.p)
    values = np.linalg.svd(white / np.linalg.norm(white, axis=0), compute_uv=False)
    np.testing.assert_allclose(result.singular_values, values, rtol=1e-6)
    assert result.singular_values.shape == (model.p,)
    # what priors add counts
    held = identify(
        model.with_prior(np.full(10, 1e-9)), simulate(model, model.nominal, touching(20))
    )
    np.testing.assert_allclose(held.singular_values, 1.0, atol=1e-2)


def test_angles_and_lengths_are_told_apart(reference_robot):
    T = transform(rotation_exp([0.2, -0.1, 2.0]), [2.0, -1.0, 0.5])
    blocks = [
        ZeroOffsets(reference_robot, ["joint_2", "joint_3", "joint_4", "joint_5"]),
        ToolFrame(np.eye(4)),
        TargetFrame(T),
    ]
    model = CalibrationModel(reference_robot, blocks, [Pose(SIX), Distance(1e-4)])
    setup = Setup.of(30, kind=np.arange(30) % 2)
    rng = np.random.default_rng(2)
    data = simulate(model, model.nominal, rng.uniform(-1, 1, (30, 6)), rng, setup=setup)
    result = identify(model, data)
    assert result.angles.shape == (30, 6)
    assert result.angles[0].tolist() == [False] * 3 + [True] * 3
    assert not result.angles[1].any()
    poses, wires = result.residuals[::2], result.residuals[1::2]
    np.testing.assert_allclose(result.distances_m[::2], np.linalg.norm(poses[:, :3], axis=1))
    np.testing.assert_allclose(result.distances_m[1::2], np.abs(wires[:, 0]))
    assert result.rms_rad == pytest.approx(
        np.sqrt(np.mean(np.sum(poses[:, 3:] ** 2, axis=1))), rel=1e-12
    )
    assert result.rms_rad < result.leave_one_out_rms_rad < 2 * result.rms_rad
    assert result.rms_m == pytest.approx(np.sqrt(np.mean(np.square(result.distances_m))))
    assert result.degrees_of_freedom == 15 * 6 + 15 - 16
    assert [kind.kind for kind in result.noise] == ["pose", "distance"]


def test_without_angles_there_is_no_turn(make_model, touching):
    model = make_model()
    result = identify(model, simulate(model, model.nominal, touching(10)))
    assert np.isnan(result.rms_rad)
    assert np.isnan(result.leave_one_out_rms_rad)


def test_the_summary_has_intervals_in_the_units_of_people(make_model, touching, reference_robot):
    soft = JointCompliance(reference_robot, ["joint_3"])
    model = make_model(extra=(soft,))
    result = identify(model, simulate(model, model.nominal, touching(20), np.random.default_rng(3)))
    lines = {line.split()[0]: line for line in result.summary().splitlines()[1 : 1 + model.p]}
    low, high = result.interval
    k = model.names.index("compliance.joint_3")
    assert "urad/Nm" in lines["compliance.joint_3"]
    assert f"95 % {low[k] * 1e6:.5f} to {high[k] * 1e6:.5f}" in lines["compliance.joint_3"]
    k = model.names.index("tool.y")
    assert f"{result.values[k] * 1e3:.5f} +- {result.sigma[k] * 1e3:.5f} mm" in lines["tool.y"]


def test_measurements_of_another_arm_are_said_to_be(reference_robot, touching, target_m):
    """Decimetres left over are no calibration."""
    blocks = [
        ZeroOffsets(reference_robot, ["joint_2", "joint_3"]),
        ToolPoint([0.2, -0.05, 0.35], ""),
        TargetPoints([target_m], free=False),
    ]
    model = CalibrationModel(reference_robot, blocks, TouchUp(1e-5))
    q = touching(30) + np.random.default_rng(4).uniform(-0.2, 0.2, (30, 6))
    result = identify(model, touch_ups(q))
    assert result.rms_m > 0.05
    assert result.message == (
        f"the residuals are {result.rms_m * 1e3:.0f} mm: these measurements are not of this robot, "
        "this tool or these joint signs"
    )
