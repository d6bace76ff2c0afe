"""What a result says of itself: intervals, correlations, singular values, text."""

import numpy as np
import pytest

from calib import CalibrationModel, Robot, identify, se3
from calib.identification.identifiability import unseen_scale
from calib.identification.result import STRONG_CORRELATION
from calib.model import KnownDistance, Setup, simulate
from calib.model.measurements import Distance, Measurement, Point, Pose, TouchUp, touch_ups
from calib.model.parameters import (
    JointCompliance,
    LinkGeometry,
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


@pytest.mark.parametrize(
    ("noise", "count"), [pytest.param("given", 14, marks=pytest.mark.slow), ("estimated", 6)]
)
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


ROBOT = Robot.preset("panda")  # its flange is 107 mm off the last joint: no link, and no tool
POSTURE = np.deg2rad([0.0, -30.0, 10.0, -130.0, 20.0, 100.0, 30.0])
BALL_M = np.array([0.02, 0.01, 0.1])
APART_M = 0.2


def model_of(kind: Measurement, *, links: bool, distances: tuple[KnownDistance, ...] = ()):
    place = se3.apply(ROBOT.fk(POSTURE), BALL_M)
    places = [place, place + np.array([0.0, APART_M, 0.0])]
    blocks = [ZeroOffsets(ROBOT, ROBOT.joint_names[1:6], 1e-2)]
    if links:
        blocks.append(LinkGeometry(ROBOT, prior_m=1e-3, prior_rad=2e-3))
    blocks += [ToolPoint(BALL_M), TargetPoints(places, ["a", "b"])]
    return CalibrationModel(ROBOT, blocks, kind, distances)


def scale_of(model: CalibrationModel) -> tuple[float, bool]:
    """What the linearisation leaves open, and whether the result says so."""
    rng = np.random.default_rng(0)
    q = POSTURE + rng.uniform(-0.35, 0.35, (40, ROBOT.n))
    setup = Setup.of(40, target=[0, 1] * 20)
    data = simulate(model, model.nominal, q, rng, setup=setup)
    result = identify(model, data)
    linear = model.linearise(data.postures, result.values, setup, data.observed)
    notes = [n for n in result.notes if "the scale of arm and set-up together is not seen" in n]
    assert all("a known length" in n and n in result.summary() for n in notes)
    assert len(notes) == sum("scale" in n for n in result.notes) <= 1
    return unseen_scale(linear), len(notes) == 1


def test_touch_ups_say_nothing_of_it():
    share, said = scale_of(model_of(TouchUp(1e-4), links=True))
    assert share > 1.0
    assert said


def test_links_that_are_held_carry_it():
    assert scale_of(model_of(TouchUp(1e-4), links=False)) == (0.0, False)


@pytest.mark.parametrize("sigma_m", [1e-4, 2e-3])
def test_a_known_distance_shows_it(sigma_m):
    """As well as it is known, and as both targets are touched twenty times each."""
    known = KnownDistance("a", "b", APART_M, sigma_m)
    share, said = scale_of(model_of(TouchUp(1e-4), links=True, distances=(known,)))
    expected = np.sqrt(sigma_m**2 + 2 * 1e-4**2 / 20) / APART_M
    assert share == pytest.approx(expected, rel=0.02)
    assert said == (sigma_m > 1e-3)


def test_an_instrument_shows_it():
    share, said = scale_of(model_of(Point(1e-4), links=True))
    assert share < 2e-4
    assert not said
