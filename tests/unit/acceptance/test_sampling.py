"""Numbers of places against tables, and what they prove against simulation."""

import numpy as np
import pytest
from scipy import stats

from calib.errors import InputError
from posedesign.acceptance.sampling import (
    MOST_PLACES,
    chance_to_pass,
    content_proven,
    places_needed,
    spread_points,
)


@pytest.mark.parametrize(
    ("content", "confidence", "allowed", "count"),
    [
        (0.95, 0.95, 0, 59),  # Wilks 1941; the usual tables of demonstration tests
        (0.95, 0.95, 1, 93),
        (0.90, 0.90, 0, 22),
        (0.90, 0.95, 0, 29),
        (0.99, 0.95, 0, 299),
        (0.99, 0.90, 0, 230),
    ],
)
def test_numbers_are_those_of_the_tables(content, confidence, allowed, count):
    assert places_needed(content, confidence, allowed) == count


def test_what_is_proven_is_the_lower_end_of_clopper_and_pearson():
    for count, beyond in ((59, 0), (93, 1), (40, 7)):
        tested = stats.binomtest(count - beyond, count, alternative="greater")
        low = tested.proportion_ci(0.95, method="exact").low
        assert content_proven(count, beyond, 0.95) == pytest.approx(low)
    assert content_proven(3, 3, 0.95) == 0.0


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"content": 1.0}, "a content of 1"),
        ({"content": float("nan")}, "a content of nan"),
        ({"confidence": 0.0}, "a confidence of 0"),
        ({"content": 0.9999}, f"takes more than {MOST_PLACES} places"),
        ({"allowed": -1}, "-1 places beyond the limit"),
    ],
)
def test_numbers_that_prove_nothing_are_refused(words, said):
    with pytest.raises(InputError, match=said):
        places_needed(**{"content": 0.95, "confidence": 0.95} | words)


def test_parts_of_a_box_are_equal_fill_it_and_are_no_splinters():
    low, high = np.array([0.0, -1.0, 2.0]), np.array([1.0, 1.0, 5.0])
    parts = spread_points(low, high, 59)
    sizes = np.array([b - a for a, b in parts])
    assert sizes.prod(axis=1) == pytest.approx(6.0 / 59)
    assert sizes.max() / sizes.min() < 3.5
    centres = np.array([(a + b) / 2 for a, b in parts])
    inside = [((centres > a) & (centres < b)).all(axis=1).sum() for a, b in parts]
    assert inside == [1] * 59


def test_places_in_parts_prove_no_more_than_places_anywhere():
    """Bad places in a corner, 6 % of the box: a test of 59 passes in less than 5 % of 4,000."""
    low, high = np.zeros(3), np.ones(3)
    rng, parts = np.random.default_rng(2), spread_points(low, high, 59)
    a, b = (np.array([part[k] for part in parts]) for k in (0, 1))
    places = rng.uniform(a, b, (4000, 59, 3))
    bad = (places < 0.06 ** (1 / 3)).all(axis=2)
    assert np.mean(bad.sum(axis=1) == 0) < 0.05
    # errors that grow from place to place: never more often than of places drawn anywhere
    far = np.linalg.norm(places, axis=2)
    limit = np.quantile(np.linalg.norm(rng.uniform(size=(400_000, 3)), axis=1), 0.95)
    assert np.mean((far > limit).sum(axis=1) == 0) < 0.05


def test_chance_to_pass_counts_tests_with_no_more_beyond_than_allowed():
    errors = np.array([[1.0, 1.0], [1.0, 3.0], [3.0, 3.0], [1.0, 1.0]])
    assert chance_to_pass(errors, 2.0) == 0.5
    assert chance_to_pass(errors, 2.0, 1) == 0.75
