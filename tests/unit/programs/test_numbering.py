"""Numbers of named positions: an operator's own one is never taken for one of the plan."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib.errors import FileFormatError
from posedesign.programs import PlanMark
from posedesign.programs.numbering import Named, Numbering

PATH = Path("X.dat")


def stored(variable: str, line: int = 1) -> Named:
    return Named(variable, line)


def numbering(
    measured: int | None, first: tuple[int, int] | None = None, poses: int = 0
) -> Numbering:
    return Numbering(
        re.compile(r"P(\d+)"),
        re.compile(r"R(\d+)"),
        None if measured is None else PlanMark("abcdef12", measured),
        {n: f"T{n}" for n in range(1, poses + 1)},
        first,
    )


@given(
    st.integers(0, 12),
    st.integers(0, 4),
    st.sets(st.integers(1, 16)),
    st.lists(st.sampled_from(["", "HOME", "LEFT", "P2", "P9"]), max_size=4),
    st.randoms(use_true_random=False),
)
def test_an_own_position_is_none_of_the_plan(measured, vias, deleted, extra, shuffle):
    planned = [stored(f"P{n}") for n in range(1, measured + vias + 1) if n not in deleted]
    taken = {p.variable for p in planned}
    own = [stored(name) for name in extra if name in taken or not name.startswith("P")]
    mixed = planned + own
    shuffle.shuffle(mixed)  # type: ignore[attr-defined]
    found = numbering(measured, poses=measured + vias).of(mixed, PATH)
    assert sorted(map(id, (p for _, p in found))) == sorted(map(id, mixed))
    numbers = [n for n, _ in found]
    assert len(set(numbers)) == len(numbers)
    by_name = {p.variable: n for n, p in found if not p.other and p.variable}
    assert by_name == {p.variable: int(p.variable[1:]) for p in planned}
    for n, position in found:
        if position.other or not position.variable:
            assert n > measured + vias
            assert position.name == position.variable
        else:
            assert position.name == f"T{n}"


def test_touched_up_positions_are_those_of_their_poses() -> None:
    places = [stored("P1"), stored("P2"), stored("P3"), stored("R12", 5), stored("HOME")]
    rule = numbering(2, (11, 1), 3)
    found = rule.of(places, PATH)
    assert [(n, p.variable, p.name) for n, p in found] == [
        (2, "R12", "T2"),
        (3, "P3", "T3"),
        (4, "HOME", "HOME"),
    ]
    assert not rule.is_untouched(places)
    assert rule.is_untouched(places[:3])
    assert not numbering(2).is_untouched(places)


@pytest.mark.parametrize("place", ["R10", "R13"])
def test_a_touched_up_position_of_no_pose_is_refused(place: str) -> None:
    # R13 would be the place of a position that is passed, and not measured
    with pytest.raises(FileFormatError, match="the place of no pose that is measured") as caught:
        numbering(2, (11, 1)).of([stored("P3"), stored(place, 7)], PATH)
    assert caught.value.row == 7
