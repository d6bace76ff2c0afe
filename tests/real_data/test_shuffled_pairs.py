"""Shuffled rows of real pairs: nothing that changes along their sequence is left to be named."""

import numpy as np
import pytest

from calib.judgement import FALSE_ALARMS
from calib.robot_world import solve
from studies.real_data import real_pairs
from tests.unit.robot_world.test_false_alarms import least_rate

pytestmark = [pytest.mark.real_data, pytest.mark.slow]


@pytest.mark.parametrize("name", ["UR3e", "Tabb"])
def test_no_motion_is_named(data_folder, name):
    A, B = real_pairs(data_folder)[name]
    rng, trials, named = np.random.default_rng(0), 200, 0
    for _ in range(trials):
        rows = rng.permutation(len(A))
        named += bool(solve(A[rows], B[rows]).drift)
    assert least_rate(named, trials) < FALSE_ALARMS
