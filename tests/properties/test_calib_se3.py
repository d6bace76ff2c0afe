"""Rotations: what holds for every one of them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import se3

angle = st.floats(-np.pi, np.pi)
component = st.floats(-1, 1, allow_subnormal=False)
quaternions = st.tuples(component, component, component, component).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)
few = settings(max_examples=60, deadline=None)


@few
@given(angle, st.floats(-np.pi / 2, np.pi / 2), angle)
def test_every_w_p_r_gives_its_matrix_back(w, p, r):
    R = se3.rotation_from_wpr([w, p, r])
    back = se3.wpr_from_rotation(R)
    assert abs(back[1]) <= np.pi / 2
    assert -np.pi < back[0] <= np.pi
    assert -np.pi < back[2] <= np.pi
    np.testing.assert_allclose(se3.rotation_from_wpr(back), R, atol=3e-9)


@few
@given(quaternions)
def test_all_ways_of_writing_a_rotation_agree(q):
    R = se3.rotation_from_quaternion(q)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    back = se3.quaternion_from_rotation(R)
    unit = np.array(q) / np.linalg.norm(q)
    assert abs(back @ unit) > 1 - 1e-12
    np.testing.assert_allclose(se3.rotation_exp(se3.rotation_log(R)), R, atol=1e-13)
    wpr = se3.wpr_from_rotation(R)
    np.testing.assert_allclose(se3.rotation_from_wpr(wpr), R, atol=3e-9)


@few
@given(quaternions, quaternions)
def test_the_angle_is_the_same_seen_from_any_frame(q, other):
    R, Q = se3.rotation_from_quaternion(q), se3.rotation_from_quaternion(other)
    expected = se3.rotation_angle(R)
    np.testing.assert_allclose(se3.rotation_angle(Q @ R @ Q.T), expected, atol=1e-7)
    np.testing.assert_allclose(se3.rotation_angle(R.T), expected, atol=1e-7)


@few
@given(quaternions, st.floats(1e-3, 1e3))
def test_projection_takes_out_a_scale(q, scale):
    R = se3.rotation_from_quaternion(q)
    np.testing.assert_allclose(se3.project_to_rotation(scale * R), R, atol=1e-13)
