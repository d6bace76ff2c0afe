"""Models side by side: which one is taken, with what reason, and what is refused."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import t

from calib import CalibrationModel, Robot, identify
from calib.errors import NotIdentifiableError
from calib.identification import Candidate, Comparison, compare
from calib.identification.comparison import CHANCE
from calib.identification.cross_validation import targets_left_out
from calib.model import Setup, simulate
from calib.model.measurements import Measurement, Measurements, Point, Pose, TouchUp, touch_ups
from calib.model.parameters import (
    JointHarmonics,
    JointScale,
    ParameterBlock,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ToolPoints,
    ZeroOffsets,
)

ROBOT = Robot.preset("ur5e")
JOINTS = ROBOT.joint_names
NOISE_M, NOISE_RAD = 1e-4, 5e-3
REFLECTORS = np.array([[0.1, 0.0, 0.1], [0.0, 0.12, 0.1]])
IN_WORDS = r"([+-][\d.e+-]+) \+- ([\d.e+-]+) {unit}² in the mean square"


def model(*blocks: ParameterBlock, kind: Measurement | None = None) -> CalibrationModel:
    """Two reflectors seen by a tracker, which stands where it is nominal."""
    set_up = [ToolPoints(REFLECTORS, ("P", "Q")), TargetFrame(np.eye(4))]
    return CalibrationModel(ROBOT, [*blocks, *set_up], kind or Point(NOISE_M))


def offsets() -> ZeroOffsets:
    return ZeroOffsets(ROBOT, JOINTS[1:5])


def scale() -> JointScale:
    return JointScale(ROBOT, JOINTS[1:5])


def points(truth: CalibrationModel, x: np.ndarray, seed: int, count: int = 20) -> Measurements:
    """Both reflectors in each of some poses."""
    rng = np.random.default_rng(seed)
    q = np.repeat(rng.uniform(-2, 2, (count, ROBOT.n)), 2, axis=0)
    setup = Setup.of(2 * count, tool=np.tile([0, 1], count))
    read = simulate(truth, x, q, rng, setup=setup)
    names = tuple(f"C{i // 2}" for i in range(2 * count))
    return Measurements(q, setup, truth.targets, truth.tools, read.observed, names)


def three(data: Measurements) -> Comparison:
    tried = {"frames only": (), "offsets": (offsets(),), "both": (offsets(), scale())}
    return compare([Candidate(name, model(*blocks)) for name, blocks in tried.items()], data)


def squares(comparison: Comparison, name: str) -> np.ndarray:
    """Mean square of each pose [mm²]: what the two reflectors of a pose are off."""
    result = next(r for r in comparison.results if r.model == name)
    return np.asarray((1e6 * result.leave_one_out_m**2).reshape(-1, 2).mean(axis=1))


def no_worse(a: np.ndarray, b: np.ndarray) -> bool:
    more, error = paired(a, b)
    return more <= error * t.ppf(1.0 - CHANCE, len(a) - 1)


def paired(a: np.ndarray, b: np.ndarray) -> tuple[float, float]:
    return float((a - b).mean()), float((a - b).std(ddof=1) / np.sqrt(len(a)))


@pytest.mark.parametrize(
    ("error", "expected"), [(0.0, "frames only"), (2e-3, "offsets"), (4e-3, "both")]
)
def test_the_smallest_model_that_is_as_good_as_the_best(error, expected):
    truth = model(offsets(), scale())
    x = truth.nominal.copy()
    x[:4] = min(error, 2e-3)
    x[4:8] = error if expected == "both" else 0.0
    found = three(points(truth, x, seed=3))
    assert found.recommended == expected
    assert found.best.model == expected
    assert found.criterion == "leave-one-out"
    assert found.reason.startswith(f"{expected} leaves 0.")
    assert ("better than" in found.reason) == (expected != "frames only")
    assert ("larger models gain nothing in position beyond chance" in found.reason) == (
        expected != "both"
    )
    assert "orientation" not in found.reason


def test_the_rule_over_many_draws():
    """Whatever is drawn: the first, in order of size, within chance of the best."""
    truth = model(offsets(), scale())
    x = truth.nominal.copy()
    x[:4], x[4:8] = 2e-3, 1e-4  # so little scale that chance decides whether it is seen
    names, taken = ("frames only", "offsets", "both"), []
    for seed in range(16):
        found = three(points(truth, x, seed, count=12))
        each = [squares(found, name) for name in names]
        best = min(each, key=np.mean)
        able = [
            name
            for name, square in zip(names, each, strict=True)
            if square is best or no_worse(square, best)
        ]
        assert found.recommended == able[0]
        taken.append((able[0], names[[e is best for e in each].index(True)]))
        if taken[-1] == ("offsets", "both"):  # what is said is of the best, not of the one taken
            off, _ = paired(each[0], each[2])
            said = "smaller models are worse than the best by more than chance, as frames only"
            assert said in found.reason
            assert re.search(IN_WORDS.format(unit="mm"), found.reason)[1] == f"{off:+.3g}"
    assert {("offsets", "offsets"), ("offsets", "both"), ("both", "both")} <= set(taken)


def test_differences_are_paired_by_pose():
    """Two reflectors of one pose are one witness, not two."""
    truth = model(offsets(), scale())
    x = truth.nominal.copy()
    x[:4] = 3e-4
    found = three(points(truth, x, seed=5))
    assert found.recommended == "offsets"
    said = re.findall(IN_WORDS.format(unit="mm"), found.reason)
    assert len(said) == 2
    for (off, chance), other in zip(said, ("frames only", "both"), strict=True):
        expected = paired(squares(found, other), squares(found, "offsets"))
        assert off == f"{expected[0]:+.3g}"
        assert chance == f"{expected[1]:.2g}"


def posed(*blocks: ParameterBlock) -> CalibrationModel:
    kind = Pose([NOISE_M] * 3 + [NOISE_RAD] * 3)
    return CalibrationModel(ROBOT, [*blocks, ToolFrame(np.eye(4)), TargetFrame(np.eye(4))], kind)


@pytest.mark.parametrize("swing_rad", [0.0, 2e-2])
def test_what_is_gained_in_orientation_is_said(swing_rad):
    """Waves of the last joint turn a tool that sits on its axis, and do not move it.

    Angles are coarse: they say nothing of where the tracker stands that points do not say better.
    """
    swings = JointHarmonics(ROBOT, JOINTS[-1:], [1.0])
    truth = posed(swings)
    x = truth.nominal.copy()
    x[0] = swing_rad
    rng = np.random.default_rng(0)
    data = simulate(truth, x, rng.uniform(-2.5, 2.5, (25, ROBOT.n)), rng)
    found = compare([Candidate("frames only", posed()), Candidate("waves", posed(swings))], data)
    assert found.recommended == "frames only"
    assert "waves 0." in found.reason.partition("gain nothing in position")[2]
    small, large = found.results
    rms_mrad = 1e3 * small.leave_one_out_rms_rad
    said = f"frames only leaves {rms_mrad:.3f} mrad leave-one-out"
    assert found.reason.endswith(said)
    if not swing_rad:
        assert "no other is better in orientation beyond chance" in found.reason
        return
    off, chance = paired(1e6 * large.leave_one_out_rad**2, 1e6 * small.leave_one_out_rad**2)
    assert off < -chance
    expected = f"waves {1e3 * large.leave_one_out_rms_rad:.3f} mrad ({off:+.3g} +- {chance:.2g}"
    assert f"in orientation, which this choice does not weigh, {expected} mrad²" in found.reason
    assert "gains beyond chance" in found.reason


def touched(
    touching, make_model, targets: int = 3, each: int = 9
) -> tuple[CalibrationModel, Measurements]:
    truth = make_model((2, 3, 4, 5), TouchUp(NOISE_M), targets=targets)
    x = truth.nominal.copy()
    x[:4] = [3e-3, -2e-3, 1e-3, 2e-3]
    shifts = [np.array([0.0, 0.3, 0.4]) * k for k in range(targets)]
    q = np.vstack([touching(each, seed=k, shift=shift) for k, shift in enumerate(shifts)])
    setup = Setup.of(len(q), target=np.repeat(np.arange(targets), each))
    return truth, simulate(truth, x, q, np.random.default_rng(0), setup=setup)


def test_targets_left_out_are_those_of_refits(touching, make_model):
    """The arm from the other targets by a model that has no others, then the target's place."""
    free, data = touched(touching, make_model)
    found = targets_left_out(free, data, identify(free, data))
    robot, tool = free.robot, ToolPoint(free.parameters[1].position_m)
    for k in range(3):
        own = data.target == k
        others = touch_ups(data.postures[~own], np.repeat([0, 1], 9), ("A", "B"))
        blocks = [ZeroOffsets(robot, [f"joint_{j}" for j in (2, 3, 4, 5)]), tool]
        places = TargetPoints(np.zeros((2, 3)), ("A", "B"))
        refit = identify(CalibrationModel(robot, [*blocks, places], TouchUp(NOISE_M)), others)
        seen = CalibrationModel(robot, [*blocks, TargetPoints([[0, 0, 0]])], TouchUp(NOISE_M))
        values = np.append(refit.values[:7], np.zeros(3))
        touching_at = seen.view(data.postures[own], values).tool_points
        # the place is the mean of the others: nine, less the one predicted
        far = np.linalg.norm(touching_at - touching_at.mean(axis=0), axis=1) * 9 / 8
        np.testing.assert_allclose(np.linalg.norm(found[own], axis=1), far, rtol=1e-5)


def test_targets_left_out_are_the_criterion_where_there_are_enough(touching, make_model):
    truth, data = touched(touching, make_model)
    frames = make_model((), TouchUp(NOISE_M), targets=3)
    found = compare([Candidate("frames only", frames), Candidate("offsets", truth)], data)
    assert found.criterion == "leave-one-target-out"
    assert found.recommended == "offsets"
    assert np.isfinite(found.trials[1].target_out_m).all()
    out = found.trials[1].target_out_m
    assert found.trials[1].target_out_rms_m == pytest.approx(np.sqrt(np.mean(out**2)))
    two, fewer = touched(touching, make_model, targets=2)
    assert np.isnan(targets_left_out(two, fewer, identify(two, fewer))).all()


def test_a_candidate_that_cannot_be_identified_is_kept_with_its_error():
    truth = model(offsets())
    data = points(truth, truth.nominal, seed=1)
    blind = model(ZeroOffsets(ROBOT, JOINTS[:2]))  # the tracker may stand turned about joint 1
    found = compare([Candidate("frames only", model()), Candidate("blind", blind)], data)
    refused = found.trials[1]
    assert isinstance(refused.error, NotIdentifiableError)
    assert refused.result is None
    assert np.isnan(refused.target_out_rms_m)
    assert found.recommended == "frames only"
    assert [result.model for result in found.results] == ["frames only"]
    first = compare([Candidate("blind", blind), Candidate("frames only", model())], data)
    assert isinstance(first.trials[0].error, NotIdentifiableError)
    assert first.recommended == "frames only"


def test_where_every_candidate_is_refused_the_first_error_is_raised():
    truth = model(offsets())
    data = points(truth, truth.nominal, seed=1)
    pan, last = (model(ZeroOffsets(ROBOT, [JOINTS[k]])) for k in (0, -1))
    with pytest.raises(NotIdentifiableError, match=f"zero_offset.{JOINTS[0]} is absorbed"):
        compare([Candidate("pan", pan), Candidate("last", last)], data)


def test_nothing_is_recommended_where_every_pose_is_needed(touching, make_model):
    frames = make_model((), TouchUp(NOISE_M))
    data = touch_ups(touching(3, seed=4))
    found = compare([Candidate("frames only", frames)], data)
    assert found.recommended is None
    assert "no measurement can be left out of every model" in found.reason
    assert found.best.model == "frames only"


def test_repeats_of_a_posture_are_one_witness():
    """Six readings of each posture, all with names of their own: as if they were named alike."""
    truth = model(JointHarmonics(ROBOT, JOINTS[1:5], [7.0]))
    rng = np.random.default_rng(0)
    x = truth.nominal.copy()
    x[:8] = 2e-3 * rng.normal(size=8)
    q = np.repeat(rng.uniform(-2, 2, (12, ROBOT.n)), 6, axis=0)
    q = q + rng.uniform(-1e-4, 1e-4, q.shape)
    data = simulate(truth, x, q, rng, setup=Setup.of(72, tool=np.tile([0, 1], 36)))
    named = replace(data, names=tuple(f"C{i // 6}" for i in range(72)))
    one, other = (three(each) for each in (data, named))
    assert one.recommended == other.recommended
    assert one.reason == other.reason


def test_the_choice_is_in_units_of_the_noise():
    """Touch-ups of a millimetre do not drown a tracker of ten micrometres."""
    kinds = [Point(1e-5), TouchUp(1e-3)]
    set_up = [ToolPoint([0, 0, 0.15]), TargetFrame(np.eye(4), "tracker")]
    set_up.append(TargetPoints([[0.5, 0.1, 0.3]], ["A"]))
    frames = CalibrationModel(ROBOT, set_up, kinds)
    truth = CalibrationModel(ROBOT, [offsets(), *set_up], kinds)
    x = truth.nominal.copy()
    x[:4] = [1e-4, -1e-4, 1e-4, 1e-4]
    rng = np.random.default_rng(0)
    touch = np.array([0.0, -1.2, 1.5, -0.6, -1.2, 0.3]) + rng.uniform(-0.5, 0.5, (20, 6))
    q = np.vstack([rng.uniform(-2, 2, (20, 6)), touch])
    target = np.repeat([truth.targets.index("tracker"), truth.targets.index("A")], 20)
    setup = Setup.of(40, kind=np.repeat([0, 1], 20), target=target)
    data = simulate(truth, x, q, rng, setup=setup)
    found = compare([Candidate("frames only", frames), Candidate("offsets", truth)], data)
    assert found.recommended == "offsets"
    assert "noise² in the mean square" in found.reason
    read = np.arange(40) < 20
    before, after = (1e3 * np.sqrt(np.mean(r.leave_one_out_m[read] ** 2)) for r in found.results)
    assert (
        f"in units of the noise point decides: {before:.3f} mm with frames only, {after:.3f} mm "
        "with offsets" in found.reason
    )


@pytest.mark.parametrize(
    "loss", ["huber", pytest.param("cauchy", marks=pytest.mark.slow), "student-t", "graduated"]
)
def test_gross_errors_do_not_choose(loss):
    """One in five is off by centimetres: what the loss weighs down is weighed down here, too."""
    truth = model(offsets(), scale())
    x = truth.nominal.copy()
    x[:4] = [2e-3, -2e-3, 1e-3, 3e-3]
    data = points(truth, x, seed=4, count=25)
    rng = np.random.default_rng(5)
    observed = data.observed.copy()
    bad = rng.permutation(50)[:10]
    observed[bad] += rng.uniform(-0.1, 0.1, (10, 3))
    tried = {"frames only": (), "offsets": (offsets(),), "both": (offsets(), scale())}
    candidates = [Candidate(name, model(*blocks)) for name, blocks in tried.items()]
    found = compare(candidates, replace(data, observed=observed), loss=loss)
    assert found.recommended == "offsets"
    result = found.best
    weights = np.minimum(result.weights, 1.0) * result.used
    mean = weights @ result.leave_one_out_m**2 / weights.sum()
    assert result.weighed_leave_one_out_rms_m == pytest.approx(np.sqrt(mean))
    plain = np.sqrt(np.mean(result.leave_one_out_m[result.used] ** 2))
    assert result.leave_one_out_rms_m == pytest.approx(plain)
    assert np.sqrt(mean) < 0.1 * np.sqrt(np.mean(result.leave_one_out_m**2))
    assert result.weighed_rms_m < result.weighed_leave_one_out_rms_m


@pytest.mark.slow
def test_chance_is_never_taken_for_a_gain_and_a_gain_mostly():
    """Nothing to gain, and four offsets of three standard deviations each: 77 % of 150 draws."""
    truth, taken = model(offsets()), {0.0: 0, 3.0: 0}
    for gain in taken:
        for seed in range(20):
            x = truth.nominal.copy()
            sigma = identify(truth, points(truth, x, seed, count=10)).sigma[:4]
            x[:4] = gain * sigma * np.random.default_rng(seed).choice([-1, 1], 4)
            taken[gain] += three(points(truth, x, seed, count=10)).recommended != "frames only"
    assert taken[0.0] == 0
    assert taken[3.0] >= 10  # of 20, by chance once in four hundred


def test_models_with_priors_are_as_large_as_what_measurements_tell():
    """Six offsets that are known beforehand are less to tell than four that are not."""
    known = model(ZeroOffsets(ROBOT, JOINTS[1:5], 1e-7), scale())
    free = model(offsets())
    data = points(free, free.nominal, seed=6)
    few, many = identify(known, data), identify(free, data)
    assert known.p == free.p + 4
    assert many.effective_parameters == free.p
    J = known.linearise(data.postures, few.values, data.setup, data.observed).white_jacobian
    J = J.reshape(-1, known.p)
    assert few.effective_parameters == pytest.approx(np.trace(J.T @ J @ few.covariance))
    assert few.effective_parameters == pytest.approx(known.p - 4, abs=0.01)


def test_with_targets_left_out_chance_is_that_of_the_targets(touching, make_model):
    """What is said is the standard error from target to target where that reaches farther."""
    truth, data = touched(touching, make_model)
    frames = make_model((), TouchUp(NOISE_M), targets=3)
    found = compare([Candidate("frames only", frames), Candidate("offsets", truth)], data)
    small, large = (1e6 * trial.target_out_m**2 for trial in found.trials)
    off = small - large
    each = (off - off.mean()).reshape(3, 9).sum(axis=1)
    by_target = np.sqrt(3 / 2 * each @ each) / 27
    by_pose = off.std(ddof=1) / np.sqrt(27)
    said = re.search(IN_WORDS.format(unit="mm"), found.reason)
    far = by_target * t.ppf(1 - CHANCE, 2) > by_pose * t.ppf(1 - CHANCE, 26)
    assert said[2] == f"{by_target if far else by_pose:.2g}"
