"""Two streams with clocks of their own: the offset, its rate, jitter, and X and Z with them."""

import numpy as np
import pytest

from calib.errors import InputError
from calib.robot_world import PoseStream, difference, solve, solve_streams
from calib.robot_world.noise import perturb
from calib.se3 import inverse, rotation_exp, transform

X = transform(rotation_exp(np.array([0.3, 0.2, -0.4])), np.array([0.03, 0.05, 0.1]))
Z = transform(rotation_exp(np.array([0.1, 0.2, 1.0])), np.array([0.7, 0.1, 0.02]))


def path_of(rng):
    """A smooth motion: sums of sines of .05 to .4 Hz, some .7 rad and .25 m large."""
    often, phase = rng.uniform(0.05, 0.4, (6, 5)), rng.uniform(0.0, 2.0 * np.pi, (6, 5))
    size = rng.normal(size=(6, 5)) / np.sqrt(5)

    def at(times):
        turns = 2.0 * np.pi * often[..., None] * times + phase[..., None]
        values = (size[..., None] * np.sin(turns)).sum(axis=1).T
        return transform(rotation_exp(0.7 * values[:, :3]), 0.25 * values[:, 3:])

    return at


def streams_of(
    seed, offset=0.137, *, rate=0.0, jitter=0.0, wrong=0.0, seconds=15.0, noise=(2e-3, 1e-3)
):
    """An arm at 200 Hz and a camera at 25 Hz whose clock is later by the offset."""
    rng = np.random.default_rng(seed)
    at = path_of(rng)
    times = np.arange(0.0, seconds, 0.005)
    A = perturb(at(times), rng.normal(size=(len(times), 6)) * np.repeat([2e-4, 1e-4], 3))
    taken = np.arange(0.5, seconds - 0.5, 0.04)
    sigma = np.repeat(noise, 3)
    B = perturb(inverse(Z) @ at(taken) @ X, rng.normal(size=(len(taken), 6)) * sigma)
    bad = rng.random(len(taken)) < wrong
    B[bad] = perturb(B[bad], 0.3 * rng.normal(size=(int(bad.sum()), 6)))
    middle = 0.5 * (taken[0] + taken[-1])
    stamps = taken + offset + rate * (taken - middle) + jitter * rng.normal(size=len(taken))
    return PoseStream.of(times, A, "robot"), PoseStream.of(stamps, B, "camera")


def error_of(result):
    """Errors of X and Z over their covariance, a twelfth of chi²."""
    error = np.concatenate([difference(result.X, X), difference(result.Z, Z)])
    return error @ np.linalg.solve(result.covariance, error) / 12


@pytest.mark.parametrize("offset", [0.0, 0.137, -0.62])
def test_the_offset_is_found_to_a_fraction_of_a_sample(offset):
    result = solve_streams(*streams_of(1, offset))
    assert result.is_ok
    assert abs(result.offset_s - offset) < 4 * result.sigma_offset_s
    assert result.sigma_offset_s < 2e-4
    assert result.rate == result.jitter_s == 0.0
    assert error_of(result) < 3


def test_clocks_that_count_from_elsewhere_are_brought_together():
    robot, camera = streams_of(2)
    late = PoseStream(camera.times + 1.7e9, camera.T)
    result = solve_streams(robot, late)
    assert abs(result.offset_s - 1.7e9 - 0.137) < 4 * result.sigma_offset_s


def test_a_clock_that_is_faster_is_told():
    result = solve_streams(*streams_of(3, rate=2e-3))
    assert abs(result.rate - 2e-3) < 4 * result.sigma_rate
    assert result.sigma_rate < 1e-4
    assert abs(result.offset_s - 0.137) < 4 * result.sigma_offset_s


def test_stamps_that_jitter_are_told_and_weigh_fast_samples_less():
    found = [solve_streams(*streams_of(seed, jitter=0.008)) for seed in range(4)]
    for result in found:
        assert result.jitter_s == pytest.approx(0.008, rel=0.35)
        assert abs(result.offset_s - 0.137) < 4 * result.sigma_offset_s
    assert np.mean([error_of(result) for result in found]) < 2.0
    steady = solve_streams(*streams_of(0))
    assert found[0].sigma_offset_s > 3 * steady.sigma_offset_s


def test_gross_errors_take_no_part():
    result = solve_streams(*streams_of(4, wrong=0.2))
    assert result.is_ok
    assert 0.15 < 1 - result.pairs.used.mean() < 0.3
    assert abs(result.offset_s - 0.137) < 4 * result.sigma_offset_s


def test_pairs_at_the_true_offset_give_the_same_frames():
    """By the solver of pairs, told the clock."""
    robot, camera = streams_of(5)
    A, inside = robot.at(camera.times - 0.137)
    known = solve(A[inside], camera.T[inside], "ml-robust", "B")
    result = solve_streams(robot, camera)
    sigma = np.sqrt(np.diag(known.covariance))
    both = ((result.X, known.X), (result.Z, known.Z))
    off = np.concatenate([difference(*frames) for frames in both])
    assert (np.abs(off) < 2 * sigma).all()
    assert (np.diag(result.covariance) >= np.diag(known.covariance) * 0.9).all()


@pytest.mark.slow
def test_the_standard_deviations_are_those_of_the_errors():
    off, errors = [], []
    for seed in range(40):
        result = solve_streams(*streams_of(100 + seed))
        off.append((result.offset_s - 0.137) / result.sigma_offset_s)
        errors.append(error_of(result))
    assert 0.6 < np.sqrt(np.mean(np.square(off))) < 1.4
    assert 0.6 < np.mean(errors) < 1.5


def test_an_arm_that_stands_does_not_tell_the_clock_but_the_frames():
    """Twelve stations that the arm jumps between, the clock off by less than it stands."""
    rng = np.random.default_rng(6)
    stations = path_of(rng)(np.arange(12) * 7.0)
    times = np.arange(0.0, 12.0, 0.05)
    A = stations[np.minimum(times.astype(int), 11)]
    stamps = np.arange(0.45, 12.0, 1.0)
    true = inverse(Z) @ stations[stamps.astype(int)] @ X
    B = perturb(true, rng.normal(size=(12, 6)) * np.repeat([1e-3, 5e-4], 3))
    robot, camera = (
        PoseStream.of(times, A, "robot"),
        PoseStream.of(stamps + 0.05, B, "camera"),
    )
    result = solve_streams(robot, camera, largest_offset_s=0.3)
    assert not result.is_ok
    assert any("does not tell the offset" in one.text for one in result.findings)
    assert np.linalg.norm(difference(result.X, X)[3:]) < 5e-3


def test_times_in_any_order_are_sorted_and_gaps_are_not_bridged():
    times = np.array([0.0, 0.1, 0.3, 0.2, 10.0, 10.1, 0.1])
    T = transform(np.eye(3), np.c_[times, 0 * times, 0 * times])
    stream = PoseStream.of(times, T, "robot")
    assert (np.diff(stream.times) > 0).all()
    A, inside = stream.at(np.array([0.25, 5.0, 10.05, 11.0]))
    assert inside.tolist() == [True, False, True, False]
    np.testing.assert_allclose(A[[0, 2], 0, 3], [0.25, 10.05])


def test_a_turn_is_interpolated_about_its_axis():
    angle = np.array([0.0, 1.0, 2.0])
    T = transform(rotation_exp(np.c_[0 * angle, 0 * angle, angle]), np.zeros((3, 3)))
    A, _ = PoseStream.of(angle, T, "robot").at(np.array([0.3, 1.7]))
    np.testing.assert_allclose(A[:, 1, 0], np.sin([0.3, 1.7]), atol=1e-12)


def test_streams_without_common_motion_are_refused_in_words():
    robot, _ = streams_of(7)
    short = PoseStream(robot.times[:30], robot.T[:30])
    with pytest.raises(InputError, match="of times that the arm has"):
        solve_streams(short, PoseStream(robot.times[:9] * 0.01, robot.T[:9]))
    with pytest.raises(InputError, match=r"times \(2,\) and poses"):
        PoseStream.of(np.zeros(2), robot.T, "robot")
