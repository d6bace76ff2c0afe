"""A robot of which only poses of the flange are known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calib.errors import CalibError
from calib.robots.flange_poses import NAMES, flange_robot, posture_of_pose
from calib.se3 import transform


@given(seed=st.integers(0, 2**32 - 1))
def test_the_flange_is_where_the_posture_says(seed):
    """Half turns, and next to them, too."""
    rng = np.random.default_rng(seed)
    angles = rng.choice([0.0, 1e-9, 1.0, np.pi - 1e-9, np.pi], 6)
    axes = rng.standard_normal((6, 3))
    vectors = axes / np.linalg.norm(axes, axis=1)[:, None] * angles[:, None]
    T = transform(Rotation.from_rotvec(vectors).as_matrix(), rng.uniform(-2, 2, (6, 3)))
    q = posture_of_pose(T)
    assert q.shape == (6, 6)
    np.testing.assert_allclose(flange_robot().fk(q), T, atol=1e-7)
    np.testing.assert_array_equal(posture_of_pose(T[0]), q[0])


def test_a_posture_is_a_place_and_a_rotation_vector():
    q = np.array([0.1, -0.2, 0.3, 0.4, 0.5, -0.6])
    T = flange_robot().fk(q)
    np.testing.assert_allclose(T[:3, 3], q[:3])
    np.testing.assert_allclose(Rotation.from_matrix(T[:3, :3]).as_rotvec(), q[3:], atol=1e-12)
    assert flange_robot().n == len(NAMES) == 6


def test_what_is_no_pose_is_refused():
    with pytest.raises(CalibError, match="T_base_flange"):
        posture_of_pose(np.diag([1.0, 1.0, -1.0, 1.0]))
