"""What pools are made of, against brute force."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from posedesign.candidates.branches import evenly
from posedesign.candidates.draws import even_points, once


@given(st.integers(0, 10_000), st.integers(0, 60), st.integers(1, 7))
def test_each_row_is_kept_once(seed: int, count: int, width: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.integers(-2, 3, (count, width)) * 0.3 + rng.uniform(-2e-7, 2e-7, (count, width))
    kept = once(rows, 1e-6)
    apart = np.abs(rows[:, None] - rows).max(axis=-1, initial=0.0) < 1e-6
    # the noise is so small that being the same goes over from one to the next
    expected = [not apart[i, :i].any() for i in range(count)]
    assert kept.tolist() == expected


@given(st.lists(st.integers(0, 30), max_size=12), st.integers(1, 9))
def test_rows_of_a_group_are_thinned_evenly(sizes: list[int], most: int) -> None:
    group = np.repeat(np.arange(len(sizes)), sizes)
    kept = evenly(group, most)
    for k, size in enumerate(sizes):
        rows = np.flatnonzero(kept[group == k])
        assert len(rows) == min(size, most)
        if 1 <= most <= size:
            gaps = np.diff(np.append(rows, size + rows[0]))
            assert gaps.max() - gaps.min() <= 1
            assert rows[0] == 0


@given(st.integers(1, 500), st.integers(1, 8), st.integers(0, 10_000))
def test_even_points_are_in_the_cube_and_apart(count: int, dimensions: int, seed: int) -> None:
    points = even_points(count, dimensions, np.random.default_rng(seed))
    assert points.shape == (count, dimensions)
    assert points.min() >= 0.0
    assert points.max() < 1.0
    if count > 1 and dimensions == 1:
        # the golden section leaves gaps of at most three lengths (Steinhaus)
        gaps = np.diff(np.sort(points[:, 0]), append=points.min() + 1.0)
        assert len(np.unique(gaps.round(9))) <= 3
