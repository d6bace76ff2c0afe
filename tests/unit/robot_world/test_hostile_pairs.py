"""Sets of pairs with something wrong: an answer that is off and ok is never given in silence."""

import collections

import pytest

from tests.hostile_pairs import SPOILT, hostile_sets, is_silently_wrong

MOVES_MEANWHILE = ("target bumped", "camera bumped", "target drifts", "time offset")
"""What the order of the pairs alone tells: a single bump looks like noise of the size of it."""


def silent(seed, count):
    """What is wrong with the sets that are silently wrong."""
    return [hostile.what for hostile in hostile_sets(seed, count) if is_silently_wrong(hostile)]


def test_hardly_any_mistake_is_silent():
    """Three of each kind but of what moves meanwhile; 1,000 in the slow stage."""
    found = silent(3, 3 * len(SPOILT))
    assert [text for text in found if not text.startswith(MOVES_MEANWHILE)] == []
    assert len(found) <= 2


@pytest.mark.slow
def test_of_a_thousand_hardly_any_is_silent():
    """One when this was written: a scale that is 1.4 % off, with a probability by chance of 1.01
    ten-thousandths where less than one is named.
    """
    kinds = collections.Counter(text.split(";")[0] for text in silent(0, 1000))
    assert not kinds - collections.Counter({"scale of B": 1}), kinds
