"""Mistakes with pictures are refused or named, and nothing is named where there is none."""

from collections import Counter

import pytest

from tests.picture_mistakes import FAR_OFF, MISTAKES, case_of, judge

STAGES = pytest.mark.parametrize("trials", [72, pytest.param(504, marks=pytest.mark.full)])

SAID = {
    "40 % of the rows wrong": "contradict",
    "swapped files": "contradict|do not fit together",
    "board moved half-way": "moved|contradict",
    "squares off by 1 %": "than described",
    "squares off by 3 %": "than described",
    "squares in another unit": "times as large",
    "mirrored": "mirrored",
    "mirrored chessboard": "mirrored",
    "lens of another camera": "the lens given is not",
    "bent board": "bent",
    "joints in another unit": "do not (fit|belong) together|cannot identify",
    "one picture again": "contradict|do not fit together|cannot identify",
}
"""What is said of each, as a regular expression."""

MOSTLY = 0.95


@pytest.mark.parametrize("name", MISTAKES)
def test_one_of_each_is_refused_or_named(name):
    assert judge(case_of(name, 0)).kind in ("refused", "named", "silent right")


@pytest.mark.slow
@STAGES
def test_of_hundreds_none_is_wrong_in_silence(trials):
    """Of 12 mistakes in turn; most are said to be what they are.

    Where one of twenty-four were silently wrong, 72 would show it with a probability of 95 %.
    """
    import re

    found = Counter(), Counter()
    names = list(MISTAKES)
    for trial in range(trials):
        name = names[trial % len(names)]
        one = judge(case_of(name, 1000 + trial // len(names)))
        found[0][one.kind] += 1
        found[1][name] += bool(re.search(SAID[name], one.text))
    assert found[0]["silent wrong"] == 0
    for name in names:
        assert found[1][name] >= MOSTLY * trials / len(names), name


@pytest.mark.slow
@pytest.mark.parametrize("trials", [100, pytest.param(200, marks=pytest.mark.full)])
def test_nothing_is_named_where_there_is_nothing(trials):
    said = [judge(case_of("none", 1000 + trial)) for trial in range(trials)]
    assert sum(one.kind != "silent right" for one in said) <= 0.01 * trials
    assert all(one.far < FAR_OFF for one in said)
