"""Statistics of repeated readings, against SciPy, brute force, and draws of nothing but noise."""

import numpy as np
import pytest
from scipy import stats

from posedesign.identification.instruments.joining import in_ranges, match_times, stops_of
from posedesign.identification.instruments.scatter import (
    SIGNIFICANT,
    Scatter,
    drift_of,
    pooled,
    trend_with,
)

TRIALS = 1200


def at_most(rate: float) -> float:
    """Four standard deviations above what a rate gives in so many trials."""
    return rate + 4.0 * np.sqrt(rate * (1.0 - rate) / TRIALS)


def test_means_and_pooled_scatter_of_groups():
    rng = np.random.default_rng(1)
    group = np.repeat(np.arange(7), [1, 2, 3, 4, 5, 1, 6])
    values = 3.0 + 1e-5 * rng.standard_normal((len(group), 3))
    order = rng.permutation(len(group))
    mean, count, scatter = pooled(values[order], group[order])
    squares = np.zeros(3)
    for k in range(7):
        own = values[group == k]
        np.testing.assert_allclose(mean[k], own.mean(axis=0), rtol=0, atol=1e-15)
        squares += ((own - own.mean(axis=0)) ** 2).sum(axis=0)
    assert scatter.freedom == len(group) - 7 == 15
    np.testing.assert_allclose(scatter.sigma, np.sqrt(squares / 15), rtol=1e-6)
    assert count.tolist() == [1, 2, 3, 4, 5, 1, 6]
    assert pooled(values[:1], group[:1])[2] is None


def test_a_scatter_as_stated_is_seldom_doubted_and_twice_of_it_is():
    rng = np.random.default_rng(2)
    stated, freedom = np.array([1e-5, 2e-5, 3e-5]), 30
    doubted = 0
    for _ in range(TRIALS):
        sigma = stated * np.sqrt(rng.chisquare(freedom, 3) / freedom)
        doubted += Scatter(sigma, freedom).probability(stated) < SIGNIFICANT
    assert doubted / TRIALS <= at_most(SIGNIFICANT)
    assert Scatter(2.0 * stated, freedom).probability(stated) < 1e-6
    assert Scatter(0.4 * stated, freedom).probability(stated) < 1e-4
    assert Scatter(stated, freedom).probability(stated) == 1.0


def test_noise_alone_seldom_drifts():
    """At the probability that is said, and not at a hundredth of it either."""
    rng = np.random.default_rng(3)
    found = [
        drift_of(1e-5 * rng.standard_normal((9, 3)) * [1, 2, 5], np.arange(9.0)).probability
        for _ in range(TRIALS)
    ]
    for level in (SIGNIFICANT, 0.1):
        rate = np.mean(np.array(found) < level)
        assert level / 10 < rate <= at_most(level)


def test_drifts_and_steps_are_told_with_their_sizes():
    rng = np.random.default_rng(4)
    times = np.arange(12.0)
    noise = 1e-5 * rng.standard_normal((12, 3))
    drifted = drift_of(noise + np.outer(times, [1e-5, 0, -1e-5]), times)
    assert drifted.cause == "drift"
    assert drifted.size == pytest.approx(np.sqrt(2) * 11e-5, rel=0.15)
    assert drifted.probability < 1e-4
    stepped = drift_of(noise + np.outer(times >= 7, [0, 2e-4, 0]), times)
    assert (stepped.cause, stepped.at) == ("step", 7)
    assert stepped.size == pytest.approx(2e-4, rel=0.15)
    assert stepped.probability < 1e-6
    slope = stats.linregress(times, noise[:, 1] + 1e-5 * times)
    alone = noise * [0, 1, 0]
    alone[:, 1] += 1e-5 * times
    assert drift_of(alone, times).probability == pytest.approx(6 * slope.pvalue, rel=1e-6)
    assert drift_of(noise[:3], times[:3]) is None
    assert drift_of(np.zeros((5, 3)), np.arange(5.0)).probability == 1.0


def test_residuals_that_go_with_the_temperature():
    rng = np.random.default_rng(5)
    T = 20.0 + rng.uniform(0, 3, 40)
    rows = 1e-5 * rng.standard_normal((40, 3))
    rows[:, 2] += 2e-5 * T
    found = trend_with(rows, np.append(T[:39], np.nan))
    expected = stats.pearsonr(T[:39], rows[:39, 2])
    assert found.axis == 2
    assert found.correlation == pytest.approx(expected.statistic)
    assert found.probability == pytest.approx(3 * expected.pvalue, rel=1e-6)
    assert found.slope == pytest.approx(2e-5, rel=0.3)
    assert trend_with(rows, np.full(40, 20.0)) is None


def slow_stops(times, values, still_s, bound):
    """Rows in any window of the length that is still."""
    width = round(still_s / np.median(np.diff(times))) + 1
    still = np.zeros(len(times), dtype=bool)
    for i in range(len(times) - width + 1):
        if np.ptp(values[i : i + width], axis=0).max() <= bound:
            still[i : i + width] = True
    return still


@pytest.mark.parametrize("width", [0.3, 0.5, 0.55])
def test_standstills_of_a_record(width):
    rng = np.random.default_rng(6)
    times = np.arange(0, 60, 0.05)
    place = np.interp(times, [0, 5, 8, 20, 23, 40, 41, 60], [0, 0, 30, 30, -20, -20, 5, 5])
    values = np.stack([place, 0.5 * place], axis=1) + 0.002 * rng.standard_normal((1200, 2))
    found = stops_of(times, values, width, 0.02)
    inside = np.zeros(len(times), dtype=bool)
    for a, b in zip(found.first, found.last, strict=True):
        inside[a : b + 1] = True
    np.testing.assert_array_equal(inside, slow_stops(times, values, width, 0.02))
    assert len(found.first) == 4
    np.testing.assert_allclose(found.middle.mean(values)[:, 0], [0, 30, -20, 5], atol=1e-3)


def test_a_gap_ends_a_standstill_and_creeping_is_none():
    times = np.concatenate([np.arange(0, 5, 0.05), np.arange(8, 12, 0.05)])
    found = stops_of(times, np.zeros((len(times), 1)), 0.5, 0.02)
    assert found.first.tolist() == [0, 100]
    assert found.last.tolist() == [99, 179]
    times = np.arange(0, 20, 0.05)
    slow = stops_of(times, 0.01 * times[:, None], 0.5, 0.02)
    assert len(slow.first) == 0
    assert slow.creeping == (0,)


def test_matching_by_time_is_that_of_brute_force():
    rng = np.random.default_rng(7)
    start = np.sort(rng.uniform(0, 100, 15))
    end = start + 0.4 * np.diff(np.append(start, 110.0))
    times = rng.uniform(-5, 115, 300)
    found = match_times(times, start, end, np.zeros(0), 1.0)
    for t, k, why in zip(times, found.stop, found.reason, strict=True):
        off = np.maximum(np.maximum(start - t, t - end), 0.0)
        assert (k >= 0) == (off.min() <= 1.0)
        assert (why == "") == (k >= 0)
        if k >= 0:
            assert off[k] == pytest.approx(off.min())
    record = np.concatenate([np.arange(0, 50, 0.1), np.arange(60, 111, 0.1)])
    strict = match_times(times, start, end, record, 1.0)
    inside = ((start <= times[:, None]) & (times[:, None] <= end)).any(axis=1)
    np.testing.assert_array_equal(strict.is_found, inside)
    said = {why for why in strict.reason if why}
    assert said == {
        "read before the record of joints begins",
        "read after the record of joints ends",
        "in a gap of the record of joints",
        "the arm was not at rest",
    }


def test_lines_as_ranges():
    assert in_ranges([4, 5, 6, 9]) == "lines 4 to 6, 9"
    assert in_ranges([7]) == "line 7"
    assert in_ranges([1, 3, 5, 7, 8, 9]) == "lines 1, 3, 5 and 3 more"
