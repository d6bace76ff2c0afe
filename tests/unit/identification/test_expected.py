"""The error expected of an arm, the reference that it is expected by, and the noise it finds."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import multivariate_t

from calib import CalibrationModel, Robot
from calib.identification import Candidate, PriorGroup, Workplace, fit_reference
from calib.identification.candidate import DrawnArms, Posterior, fit
from calib.identification.prediction import Expectation
from calib.identification.robust import STUDENT_FREEDOM, gain_of_student
from calib.model import Setup, simulate
from calib.model.measurements import Measurements, Point, TouchUp
from calib.model.parameters import (
    JointCompliance,
    JointHarmonics,
    LinkGeometry,
    TargetFrame,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import FloatArray

TOOL = np.array([0.08, -0.02, 0.14])
NOISE_M = 2e-5
LENGTH_M, ANGLE_RAD, OFFSET_RAD = 2.5e-4, 5e-4, 3e-3


@pytest.fixture(scope="module")
def arm() -> Robot:
    return Robot.preset("ur5e")


def model_of(arm: Robot, sigma: float, *, held: bool = True) -> CalibrationModel:
    """Offsets and links held by priors of twice their true size, ball and three sockets."""
    joints = list(arm.joint_names)
    links = [name for name in LinkGeometry(arm).names if not name.endswith("rz")]
    priors = (2 * LENGTH_M, 2 * ANGLE_RAD) if held else (None, None)
    blocks = [
        ZeroOffsets(arm, joints, 2 * OFFSET_RAD if held else None),
        LinkGeometry(arm, links, *priors),
        ToolPoint(TOOL),
        TargetPoints(PLACES, ["T1", "T2", "T3"]),
    ]
    return CalibrationModel(arm, blocks, TouchUp(sigma))


PLACES = np.array([[-0.45, -0.15, 0.2], [-0.3, -0.4, 0.3], [-0.5, 0.1, 0.4]])


def postures(arm: Robot, rng: np.random.Generator, each: int = 14) -> tuple[FloatArray, FloatArray]:
    """Postures that touch each of the places, the tool turned by up to 40 deg, and which."""
    down = Rotation.from_euler("x", np.pi)
    found, which = [], []
    for k, place in enumerate(PLACES):
        count = 0
        while count < each:
            turn = Rotation.from_rotvec(rng.uniform(-0.7, 0.7, 3)) * down
            T = np.eye(4)
            T[:3, :3] = turn.as_matrix()
            T[:3, 3] = place - T[:3, :3] @ TOOL
            near = np.deg2rad([0.0, -90.0, 100.0, -100.0, -90.0, 0.0])
            q = arm.inverse(T[None], near=near).postures
            if len(q):
                found.append(q[np.argmin(np.abs(q - near).sum(axis=1))])
                which.append(k)
                count += 1
    return np.array(found), np.array(which)


def drawn(model: CalibrationModel, rng: np.random.Generator) -> FloatArray:
    """A true arm: errors of half the size of the priors, a set-up some millimetres off."""
    size = np.where(np.isfinite(model.prior), 0.5 * model.prior, 2e-3)
    return np.asarray(model.nominal + size * rng.standard_normal(model.p))


def groups_of(model: CalibrationModel) -> tuple[PriorGroup, ...]:
    units = dict(zip(model.names, model.units, strict=True))
    kinds: dict[tuple[str, str], list[str]] = {}
    for name, prior in zip(model.names, model.prior, strict=True):
        if np.isfinite(prior):
            kinds.setdefault((name.partition(".")[0], units[name]), []).append(name)
    size = dict(zip(model.names, model.prior, strict=True))
    return tuple(
        PriorGroup(" ".join(kind), tuple(names), 0.05 * size[names[0]], 2.0 * size[names[0]])
        for kind, names in kinds.items()
    )


def measured(
    arm: Robot, seed: int, sigma: float = NOISE_M
) -> tuple[CalibrationModel, FloatArray, Measurements]:
    rng = np.random.default_rng(seed)
    truth = model_of(arm, sigma)
    x = drawn(truth, rng)
    q, which = postures(arm, rng)
    return truth, x, simulate(truth, x, q, rng, setup=Setup.of(len(q), target=which))


def everything(model: CalibrationModel) -> Candidate:
    return Candidate("all", model, (), groups_of(model))


def there(data: Measurements) -> Workplace:
    return Workplace(data.postures, Setup.of(data.count), "there")


def aligned_rms(a: FloatArray, b: FloatArray) -> float:
    """Distance of points after the best rigid motion (Kabsch, by another library)."""
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    turn, _ = Rotation.align_vectors(b, a)
    return float(np.sqrt(np.mean(np.sum((turn.apply(a) - b) ** 2, axis=1))))


def test_the_expected_error_is_the_mean_over_arms_drawn_from_what_is_known(arm):
    truth, _, data = measured(arm, 3)
    fitted = fit(everything(truth), data)
    rng = np.random.default_rng(0)
    q = data.postures[::2] + rng.uniform(-0.2, 0.2, (21, 6))
    at = Workplace(q, Setup.of(len(q)), "near")
    x, C = fitted.result.values, fitted.result.covariance
    other = fitted.model.nominal.copy()
    other[truth.nuisance] = x[truth.nuisance]
    arms = DrawnArms([Posterior(fitted.model, x, C)], at)
    draws = rng.multivariate_normal(x, C, size=300, method="eigh")
    for values in (x, other):
        points = fitted.model.view(q, values).tool_points
        off = np.array(
            [aligned_rms(points, drawn) for drawn in fitted.model.view(q, draws).tool_points]
        )
        found = arms.error_of(fitted.model, values)
        spread = np.std(off**2) / np.sqrt(300) / (2.0 * np.sqrt(np.mean(off**2)))
        assert found.rms_m == pytest.approx(np.sqrt(np.mean(off**2)), abs=5.0 * spread + 1e-6)
        low, high = np.quantile(off, [0.025, 0.975])
        assert found.low_m == pytest.approx(low, rel=0.15)
        assert found.high_m == pytest.approx(high, rel=0.15)


def test_where_the_base_stands_does_not_count(arm):
    truth, x, data = measured(arm, 4)
    arms = DrawnArms([Posterior(truth, x, np.zeros((truth.p, truth.p)))], there(data))
    turned = x.copy()
    turned[truth.names.index(f"zero_offset.{arm.joint_names[0]}")] += 1e-5
    assert arms.error_of(truth, turned).rms_m < 1e-9
    elbow = x.copy()
    elbow[truth.names.index(f"zero_offset.{arm.joint_names[2]}")] += 1e-5
    assert arms.error_of(truth, elbow).rms_m > 1e-7


@pytest.mark.slow
def test_expected_errors_are_those_that_come(arm):
    """Mean square of the true error over the expected one, over arms: 1 within its statistics."""
    ratios = []
    for seed in range(8):
        truth, x, data = measured(arm, 100 + seed)
        rng = np.random.default_rng(seed)
        q = data.postures[rng.integers(42, size=30)] + rng.uniform(-0.15, 0.15, (30, 6))
        at = Workplace(q, Setup.of(30), "near")
        found = fit_reference(everything(truth), data, at)
        came = aligned_rms(
            truth.view(q, x).tool_points,
            found.fitted.model.view(q, found.fitted.result.values).tool_points,
        )
        expected = found.arms.error_of(found.fitted.model, found.fitted.result.values)
        ratios.append((came / expected.rms_m) ** 2)
    # squares of few effective degrees of freedom, some three an arm: sigma of the mean .3
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.72)


def test_noise_that_does_not_explain_the_residuals_is_found(arm):
    truth, _, data = measured(arm, 5, sigma=12 * NOISE_M)
    given = replace_noise(truth, NOISE_M)
    found = fit_reference(everything(given), data, there(data))
    kind = found.fitted.model.measurements[0]
    assert kind.found
    assert not kind.estimated
    # 126 rows less some 20 that the parameters use up, over three axes of 42
    assert np.sqrt(np.mean(kind.sigma**2)) == pytest.approx(12 * NOISE_M, rel=0.2)
    assert found.fitted.result.noise[0].estimated
    assert found.fitted.result.explains_data


def test_noise_that_explains_the_residuals_is_left_as_given(arm):
    truth, _, data = measured(arm, 6)
    found = fit_reference(everything(truth), data, there(data))
    np.testing.assert_array_equal(found.fitted.model.measurements[0].sigma, NOISE_M)
    assert not found.fitted.result.noise[0].estimated
    assert found.loss == "least-squares"


def replace_noise(model: CalibrationModel, sigma: float) -> CalibrationModel:
    return model.with_measurements([TouchUp(sigma)])


def test_touches_by_hand_with_heavy_tails_are_weighed_by_students_loss(arm):
    truth, x, data = measured(arm, 7)
    rng = np.random.default_rng(7)
    # a few slips of a tenth of a degree: postures are what touch-ups report
    slipped = data.postures.copy()
    for row in (3, 11, 18, 25, 33):
        slipped[row] += rng.standard_normal(6) * 2e-4
    dirty = replace(data, postures=slipped)
    candidate = everything(truth)
    found = fit_reference(candidate, dirty, there(data))
    assert found.loss == "student-t"
    asked = fit_reference(candidate, dirty, there(data), loss="least-squares")
    assert asked.loss == "least-squares"
    points = truth.view(data.postures, x).tool_points

    def off(values: FloatArray) -> float:
        return aligned_rms(points, truth.view(data.postures, values).tool_points)

    assert off(found.fitted.result.values) < off(asked.fitted.result.values)


def test_a_compliance_held_by_a_prior_is_not_negative(arm):
    joints = list(arm.joint_names)[1:4]
    truth = CalibrationModel(
        arm,
        [
            JointCompliance(arm, joints, prior=5e-6),
            ToolPoint(TOOL),
            TargetPoints(PLACES, ["T1", "T2", "T3"]),
        ],
        TouchUp(NOISE_M),
    )
    x = truth.nominal.copy()
    x[:3] = [-4e-6, 3e-6, 2e-6]  # the first as no reducer is
    rng = np.random.default_rng(8)
    q, which = postures(arm, rng)
    data = simulate(truth, x, q, rng, setup=Setup.of(len(q), target=which))
    found = fit(Candidate("compliance", truth, (), groups_of(truth)), data).result
    free = fit(Candidate("compliance", truth), data).result
    assert found.values[0] > -2e-8
    assert found.values[1] > 0
    assert free.values[0] > -2e-8


@pytest.mark.parametrize("heavy", [False, True])
def test_the_gain_of_students_noise_is_that_of_the_densities(heavy):
    rng = np.random.default_rng(1)
    rows = 3
    white = rng.standard_normal((400, rows))
    if heavy:
        white *= np.sqrt(STUDENT_FREEDOM / rng.chisquare(STUDENT_FREEDOM, 400))[:, None]
    found = gain_of_student(np.sum(white**2, axis=1), np.full(400, rows))
    scales = np.geomspace(0.3, 3.0, 400)
    student = max(
        multivariate_t(np.zeros(rows), s**2 * np.eye(rows), STUDENT_FREEDOM).logpdf(white).sum()
        for s in scales
    )
    sigma = np.sqrt(np.mean(white**2))
    gauss = float(np.sum(-0.5 * (white / sigma) ** 2 - np.log(sigma) - 0.5 * np.log(2 * np.pi)))
    assert found == pytest.approx(student - gauss, abs=0.05)
    assert (found > 3.0) == heavy


def test_arms_of_several_kinds_are_drawn_as_they_are_probable(arm: Robot) -> None:
    truth, x, data = measured(arm, 4)
    none = np.zeros((truth.p, truth.p))
    elbow = x.copy()
    elbow[truth.names.index(f"zero_offset.{arm.joint_names[2]}")] += 1e-4
    kinds = [Posterior(truth, x, none, 0.75), Posterior(truth, elbow, none, 0.25)]
    off = DrawnArms([Posterior(truth, elbow, none)], there(data)).error_of(truth, x).rms_m
    assert off > 1e-6
    found = DrawnArms(kinds, there(data)).error_of(truth, x)
    assert found.rms_m == pytest.approx(0.5 * off, rel=1e-6)
    assert (found.low_m, found.high_m) == pytest.approx((0.0, off), rel=1e-6, abs=1e-12)


def waves(arm: Robot) -> JointHarmonics:
    return JointHarmonics(arm, arm.joint_names, [1.0, 2.0], np.deg2rad(0.01))


def test_errors_that_the_arm_has_not_are_improbable(arm: Robot) -> None:
    """Arms that run evenly, and arms that do not: each is told from the other by its tracker."""
    right = []
    for seed in range(6):
        uneven = bool(seed % 2)
        rng = np.random.default_rng(300 + seed)
        blocks = [
            ZeroOffsets(arm, arm.joint_names, np.deg2rad(0.2)),
            LinkGeometry(arm, None, 2e-4, np.deg2rad(0.02)),
            ToolPoint([0.1, -0.05, 0.2]),
            TargetFrame(np.eye(4)),
        ]
        plain = CalibrationModel(arm, blocks, Point(2e-5))
        whole = CalibrationModel(arm, [waves(arm), *blocks], Point(2e-5))
        true = whole if uneven else plain
        q = rng.uniform(-1.5, 1.5, (42, 6))
        data = simulate(true, drawn(true, rng), q, rng)
        even = Candidate("even", plain, (), groups_of(plain))
        found = fit_reference(everything(whole), data, there(data), [even])
        assert sum(found.probabilities.values()) == pytest.approx(1.0)
        right.append(found.probabilities["all" if uneven else "even"])
    # the mean logarithm of what was given to the truth, of a coin -.69
    assert np.mean(np.log(right)) > -0.2


def test_where_the_arm_stops_off_is_part_of_the_error_of_every_correction(arm):
    """By Monte Carlo: a shift and a turn of the tip at each posture."""
    truth, x, data = measured(arm, 3)
    none = np.zeros((truth.p, truth.p))
    shift, turn = 2e-4, 3e-4
    found = Expectation(truth, x, none, data.postures, None, (shift, turn)).of(truth, x)
    view = truth.view(data.postures, x)
    lever = view.tool_points - view.T_base_tip[:, :3, 3]
    rng = np.random.default_rng(8)
    draws = rng.standard_normal((4000, len(lever), 6))
    off = shift * draws[..., :3] + np.cross(turn * draws[..., 3:], lever)
    rms = np.sqrt(np.mean(np.sum(off**2, axis=2), axis=0))
    np.testing.assert_allclose(found.points_m, rms, rtol=0.05)
    assert found.lost_rms_m < 1e-12
