"""Rotations and transforms: conversions there and back, an independent oracle, refusals."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib import se3
from calib.errors import InputError
from calib.model.parameters import TargetFrame, ToolFrame
from calib.se3 import FloatArray
from posedesign.hand_eye.pairs import Pairs, write_pairs


def rotations(count: int, seed: int = 0) -> np.ndarray:
    q = np.random.default_rng(seed).standard_normal((count, 4))
    return se3.rotation_from_quaternion(q)


def test_wpr_is_roll_pitch_yaw_of_pinocchio():
    wpr = np.random.default_rng(0).uniform(-np.pi, np.pi, (200, 3))
    expected = np.array([pin.rpy.rpyToMatrix(*angles) for angles in wpr])
    np.testing.assert_allclose(se3.rotation_from_wpr(wpr), expected, atol=1e-15)


def test_wpr_turns_about_the_fixed_axes_x_y_z_in_that_order():
    quarter = np.pi / 2
    np.testing.assert_allclose(
        se3.rotation_from_wpr([quarter, 0, 0]) @ [0, 1, 0], [0, 0, 1], atol=1e-15
    )
    np.testing.assert_allclose(
        se3.rotation_from_wpr([0, quarter, 0]) @ [0, 0, 1], [1, 0, 0], atol=1e-15
    )
    np.testing.assert_allclose(
        se3.rotation_from_wpr([0, 0, quarter]) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )
    # y -> z by W, z -> z by P about y would be x: first W, then P
    np.testing.assert_allclose(
        se3.rotation_from_wpr([quarter, quarter, 0]) @ [0, 1, 0], [1, 0, 0], atol=1e-15
    )


def test_wpr_there_and_back():
    wpr = np.random.default_rng(1).uniform([-3.1, -1.5, -3.1], [3.1, 1.5, 3.1], (4, 50, 3))
    np.testing.assert_allclose(se3.wpr_from_rotation(se3.rotation_from_wpr(wpr)), wpr, atol=1e-13)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("off", [0.0, 1e-12, 1e-9, 3e-9, 1e-8, 1e-7, 1e-5, 1e-3])
def test_matrices_come_back_at_and_near_the_degenerate_pitch(pitch, off):
    rng = np.random.default_rng(2)
    wpr = rng.uniform(-3, 3, (200, 3))
    wpr[:, 1] = pitch * (1 - off * 2 / np.pi)
    Q = rotations(200)
    R = Q @ (np.swapaxes(Q, -1, -2) @ se3.rotation_from_wpr(wpr))  # as rounded as any product
    back = se3.wpr_from_rotation(R)
    # where R is set to zero, P is given up to the cosine that counts as zero
    np.testing.assert_allclose(se3.rotation_from_wpr(back), R, atol=3e-9 if off <= 1e-9 else 1e-13)
    if off == 0.0:
        assert (back[:, 2] == 0.0).all()


def test_wpr_stays_in_its_range_and_has_no_negative_zero():
    R = np.stack([np.eye(3), np.diag([1.0, -1.0, -1.0]), np.diag([-1.0, -1.0, 1.0])])
    wpr = se3.wpr_from_rotation(R)
    np.testing.assert_array_equal(wpr, [[0, 0, 0], [np.pi, 0, 0], [0, 0, np.pi]])
    assert not np.signbit(wpr).any()
    # -180 deg by rounding is +180 deg
    assert se3.wpr_from_rotation(se3.rotation_from_wpr([-np.pi, 0, 0]))[0] == np.pi


def test_quaternions_there_and_back():
    R = rotations(60).reshape(3, 20, 3, 3)
    q = se3.quaternion_from_rotation(R)
    assert q.shape == (3, 20, 4)
    assert (q[..., 0] >= 0).all()
    np.testing.assert_allclose(np.linalg.norm(q, axis=-1), 1.0, atol=1e-15)
    np.testing.assert_allclose(se3.rotation_from_quaternion(q), R, atol=1e-14)
    np.testing.assert_allclose(se3.rotation_from_quaternion(-3.0 * q), R, atol=1e-14)


def test_quaternions_are_scalar_first():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(
        se3.rotation_from_quaternion([half, 0, 0, half]) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


def test_logarithm_and_exponential():
    v = np.random.default_rng(3).standard_normal((7, 30, 3))
    v *= (np.random.default_rng(4).uniform(0, 3.1, (7, 30)) / np.linalg.norm(v, axis=-1))[..., None]
    np.testing.assert_allclose(se3.rotation_log(se3.rotation_exp(v)), v, atol=1e-13)
    expected = np.array([pin.exp3(x) for x in v.reshape(-1, 3)]).reshape(7, 30, 3, 3)
    np.testing.assert_allclose(se3.rotation_exp(v), expected, atol=1e-14)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-8, 1e-4, 3.0, np.pi - 1e-8, np.pi])
def test_angle_is_accurate_at_both_ends(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3.0
    assert se3.rotation_angle(se3.rotation_exp(angle * axis)) == pytest.approx(
        angle, abs=1e-15, rel=1e-8
    )


def test_skew_is_the_cross_product():
    a, b = np.random.default_rng(5).standard_normal((2, 4, 3))
    np.testing.assert_allclose((se3.skew(a) @ b[..., None])[..., 0], np.cross(a, b), atol=1e-15)


def test_inverse_and_apply():
    rng = np.random.default_rng(6)
    T = se3.transform(rotations(5), rng.standard_normal((5, 3)))
    np.testing.assert_allclose(se3.inverse(T), np.linalg.inv(T), atol=1e-14)
    points = rng.standard_normal((5, 3))
    homogeneous = np.concatenate([points, np.ones((5, 1))], axis=-1)
    expected = np.einsum("nij,nj->ni", T, homogeneous)[:, :3]
    np.testing.assert_allclose(se3.apply(T, points), expected, atol=1e-14)


def test_transform_broadcasts_rotation_against_translation():
    T = se3.transform(np.eye(3), np.arange(12.0).reshape(4, 3))
    assert T.shape == (4, 4, 4)
    np.testing.assert_array_equal(T[2, :3, 3], [6, 7, 8])
    np.testing.assert_array_equal(T[:, 3], np.tile([0, 0, 0, 1], (4, 1)))


def test_projection_is_the_nearest_rotation():
    rng = np.random.default_rng(7)
    matrices = rng.standard_normal((6, 3, 3))
    nearest = se3.project_to_rotation(matrices)
    np.testing.assert_allclose(np.linalg.det(nearest), 1.0, atol=1e-14)
    np.testing.assert_allclose(nearest @ np.swapaxes(nearest, -1, -2) - np.eye(3), 0.0, atol=1e-14)
    others = rotations(5_000, seed=8)
    for matrix, best in zip(matrices, nearest, strict=True):
        distance = np.linalg.norm(others - matrix, axis=(-2, -1))
        closest = others[np.argmin(distance)]
        assert np.linalg.norm(best - matrix) <= distance.min()
        # the search ends near it: it is no other stationary point
        refined = closest @ se3.rotation_exp(rng.uniform(-0.1, 0.1, (5_000, 3)))
        shortest = np.linalg.norm(refined - matrix, axis=(-2, -1)).min()
        assert np.linalg.norm(best - matrix) <= shortest < np.linalg.norm(best - matrix) + 0.02


def test_projection_leaves_a_rotation_and_turns_no_mirror_image_into_itself():
    R = rotations(10)
    np.testing.assert_allclose(se3.project_to_rotation(R), R, atol=1e-14)
    np.testing.assert_allclose(np.linalg.det(se3.project_to_rotation(-R)), 1.0, atol=1e-14)


def good(count: int = 3) -> np.ndarray:
    return se3.transform(rotations(count), np.full((count, 3), 0.5))


def test_rigid_transforms_pass_unchanged():
    T = good()
    np.testing.assert_array_equal(se3.check_transforms(T.tolist(), "T"), T)
    assert se3.check_transforms(np.empty((0, 4, 4)), "T").shape == (0, 4, 4)


def change(index, value):
    T = good()
    T[index] = value
    return T


@pytest.mark.parametrize(
    ("T", "message"),
    [
        (np.eye(3), r"^A has shape \(3, 3\), not \(..., 4, 4\)$"),
        (np.zeros(4), r"A has shape \(4,\)"),
        (change((1, 0, 2), np.nan), r"^A\[1, 0, 2\] is not a finite number$"),
        (change((2, 2, 3), np.inf), r"A\[2, 2, 3\] is not a finite number"),
        (np.swapaxes(good(), -1, -2), r"the last row of a transform must be 0 0 0 1 .*transposed"),
        (change((1, slice(3), slice(3)), 1.001 * np.eye(3)), r"^A\[1\]: .* not orthonormal"),
        (change((2, slice(3), slice(3)), np.diag([1, 1, -1])), r"^A\[2\]: .* left-handed"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), r"^A: the rotation part is left-handed"),
        (np.diag([1.0, 2.0, 1.0, 1.0]), r"^A: the rotation part is not orthonormal \(off by 3\)"),
    ],
)
def test_what_is_no_rigid_transform_is_refused(T, message):
    with pytest.raises(InputError, match=message) as caught:
        se3.check_transforms(T, "A")
    assert caught.value.name == "A"


def test_rounding_in_a_file_passes_but_a_shear_does_not():
    T = good(500)
    se3.check_transforms(np.round(T, 6), "T")
    T[7, 0, 1] += 2e-4
    with pytest.raises(InputError, match=r"T\[7\]") as caught:
        se3.check_transforms(T, "T")
    assert caught.value.value > caught.value.bound


ANGLES = [0.0, 1e-9, 1e-5, 1e-3, 0.9e-2, 1.1e-2, 0.3, 2.0, np.pi - 1e-6, np.pi]


@pytest.mark.parametrize("angle", ANGLES)
def test_jacobians_of_the_vector_of_a_turn(angle):
    """Of a turn by a change of the vector, and of the vector by a turn, against differences."""
    v = np.random.default_rng(9).standard_normal((20, 3))
    v *= angle / np.linalg.norm(v, axis=1, keepdims=True)
    right, left = np.empty((2, 20, 3, 3))
    for k, step in enumerate(1e-5 * np.eye(3)):
        ahead, behind = (se3.rotation_exp(v + s * step) for s in (1, -1))
        right[:, :, k] = se3.rotation_log(np.swapaxes(behind, 1, 2) @ ahead) / 2e-5
        ahead, behind = (
            se3.rotation_log(se3.rotation_exp(s * step) @ se3.rotation_exp(v)) for s in (1, -1)
        )
        left[:, :, k] = (ahead - behind) / 2e-5
    # second order of the difference, and rounding of a difference of 1e-5
    np.testing.assert_allclose(se3.right_jacobian(v), right, atol=1e-10)
    if angle < np.pi - 1e-3:  # beyond, the vector of a turn leaps
        np.testing.assert_allclose(se3.inverse_left_jacobian(v), left, atol=1e-10)


@pytest.mark.parametrize("angle", [*ANGLES, 5.0])
def test_the_two_jacobians_are_inverses(angle):
    """``J_l(v) = J_r(-v)``; at a half turn too, where differences of logarithms break."""
    v = angle * np.array([2.0, -1.0, 2.0]) / 3.0
    product = se3.inverse_left_jacobian(v) @ se3.right_jacobian(-v)
    np.testing.assert_allclose(product, np.eye(3), atol=3e-12)


def test_jacobians_take_batches():
    v = np.random.default_rng(11).standard_normal((4, 5, 3))
    for jacobian in (se3.right_jacobian, se3.inverse_left_jacobian):
        many = jacobian(v)
        assert many.shape == (4, 5, 3, 3)
        np.testing.assert_array_equal(many[2, 3], jacobian(v[2, 3]))


angle = st.floats(-np.pi, np.pi)
component = st.floats(-1, 1, allow_subnormal=False)
quaternions = st.tuples(component, component, component, component).filter(
    lambda q: np.linalg.norm(q) > 1e-3
)
few = settings(max_examples=30, deadline=None)


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


Take = Callable[[FloatArray, Path], object]


def _pairs(T: FloatArray) -> FloatArray:
    return np.stack([np.eye(4), np.eye(4), T])


ENTRANCES: dict[str, Take] = {
    "ToolFrame": lambda T, _: ToolFrame(T),
    "TargetFrame": lambda T, _: TargetFrame(T),
    "pairs.csv": lambda T, folder: write_pairs(
        folder / "pairs.csv", Pairs(("a", "b", "c"), _pairs(np.eye(4)), _pairs(T))
    ),
}


def moved(row: int, column: int, by: float) -> FloatArray:
    """The unit transform with one number changed."""
    T = np.eye(4)
    T[row, column] += by
    return T


WRONG = {
    "left-handed": (np.diag([1.0, 1.0, -1.0, 1.0]), "left-handed"),
    "scaled": (np.diag([1.01, 1.01, 1.01, 1.0]), "not orthonormal"),
    "transposed": (moved(3, 0, 0.2), "last row"),
    "not a number": (moved(0, 3, np.nan), "not a finite number"),
}


@pytest.mark.parametrize("entrance", ENTRANCES)
@pytest.mark.parametrize("kind", WRONG)
def test_every_entrance_refuses_what_is_no_rigid_transform(tmp_path, entrance, kind):
    T, message = WRONG[kind]
    with pytest.raises(InputError, match=message):
        ENTRANCES[entrance](T, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_frame_about_an_axis_is_a_rotation_with_it():
    axes = np.vstack([np.eye(3), -np.eye(3), np.random.default_rng(0).normal(size=(20, 3))])
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    R = se3.frame_about(axes)
    np.testing.assert_allclose(R[..., 2], axes, atol=1e-15)
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.tile(np.eye(3), (26, 1, 1)), atol=1e-15)
    np.testing.assert_allclose(np.linalg.det(R), 1.0)
    np.testing.assert_array_equal(se3.frame_about(axes[7]), R[7])
