"""The methods for A X = X B against their definitions, written out plainly, and against OpenCV."""

import itertools
import tracemalloc

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import se3
from calib.robot_world import METHODS, PairNoise, PairSets, add_noise, random_problems, solve_batch
from calib.robot_world.methods import relative_motions
from calib.robot_world.methods.relative_motions import all_motions

HAND_EYE = [name for name, method in METHODS.items() if method.equation == "AX=XB"]
NOISE = PairNoise(np.radians(0.5), 1e-3, "both")


def noisy(seed, trials, pairs, cone_deg=60.0, noise=NOISE):
    """Measured pairs; rotations between poses stay below 120 deg in the cone."""
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg)
    return (*add_noise(rng, problems.A, problems.B, noise), problems)


def motions(A, B, *, both_ways):
    """Motions of flange and camera between all pairs of poses, as 4 x 4 matrices."""
    pairs = itertools.permutations if both_ways else itertools.combinations
    return [
        (np.linalg.inv(A[j]) @ A[i], np.linalg.inv(B[j]) @ B[i]) for i, j in pairs(range(len(A)), 2)
    ]


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


def quaternions(pairs):
    """Of both rotations of each pair, ``(N, 2, 4)``, real part first."""
    both = np.array(pairs)[..., :3, :3].reshape(-1, 3, 3)
    return Rotation.from_matrix(both).as_quat(canonical=True)[:, [3, 0, 1, 2]].reshape(-1, 2, 4)


def left(q):
    w, v = q[0], q[1:]
    return np.block([[w, -v[None]], [v[:, None], w * np.eye(3) + cross(v)]])


def right(q):
    w, v = q[0], q[1:]
    return np.block([[w, -v[None]], [v[:, None], w * np.eye(3) - cross(v)]])


def rotation_of(q):
    return Rotation.from_quat([*q[1:], q[0]]).as_matrix()


def plain_translation(pairs, R):
    rows = [P[:3, :3] - np.eye(3) for P, _ in pairs]
    right_side = [R @ Q[:3, 3] - P[:3, 3] for P, Q in pairs]
    return np.linalg.lstsq(np.concatenate(rows), np.concatenate(right_side))[0]


def plain_tsai(pairs):
    rows, right_side = [], []
    for p, q in 2 * quaternions(pairs)[..., 1:]:
        rows.append(cross(p + q))
        right_side.append(q - p)
    x = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right_side))[0]
    p = 2 * x / np.sqrt(1 + x @ x)  # Eq. 14
    square = p @ p
    R = (1 - square / 2) * np.eye(3) + (  # Eq. 10
        np.outer(p, p) + np.sqrt(4 - square) * cross(p)
    ) / 2
    return R, plain_translation(pairs, R)


def plain_park(pairs):
    M = np.zeros((3, 3))
    for P, Q in pairs:
        alpha, beta = (Rotation.from_matrix(T[:3, :3]).as_rotvec() for T in (P, Q))
        M += np.outer(beta, alpha)
    values, vectors = np.linalg.eigh(M.T @ M)
    R = vectors @ np.diag(values**-0.5) @ vectors.T @ M.T
    return R, plain_translation(pairs, R)


def plain_horaud(pairs, *, unit_axes=False):
    total = np.zeros((4, 4))
    for p, q in quaternions(pairs):
        if unit_axes:
            p, q = (np.r_[0.0, v[1:] / np.linalg.norm(v[1:])] for v in (p, q))
        total += (left(p) - right(q)).T @ (left(p) - right(q))
    R = rotation_of(np.linalg.eigh(total)[1][:, 0])
    return R, plain_translation(pairs, R)


def plain_horaud_printed(pairs):
    return plain_horaud(pairs, unit_axes=True)


def plain_andreff(pairs):
    rows, right_side = [], []
    for P, Q in pairs:
        turn = np.eye(9) - np.kron(P[:3, :3], Q[:3, :3])
        shift = np.kron(np.eye(3), Q[:3, 3])
        rows.append(np.block([[turn, np.zeros((9, 3))], [shift, np.eye(3) - P[:3, :3]]]))
        right_side.append(np.r_[np.zeros(9), P[:3, 3]])
    u = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right_side))[0]
    V = u[:9].reshape(3, 3)
    U, _, Wt = np.linalg.svd(V / np.cbrt(np.linalg.det(V)))
    return U @ Wt, u[9:]


def plain_daniilidis(pairs):
    rows = []
    for (P, Q), (p, q) in zip(pairs, quaternions(pairs), strict=True):
        p_dual, q_dual = (left(np.r_[0.0, T[:3, 3]]) @ r / 2 for T, r in ((P, p), (Q, q)))
        S, S_dual = (
            np.column_stack([m[1:] - n[1:], cross(m[1:] + n[1:])])
            for m, n in ((p, q), (p_dual, q_dual))
        )
        rows.append(np.block([[S, np.zeros((3, 4))], [S_dual, S]]))  # Eq. 31
    v7, v8 = np.linalg.svd(np.concatenate(rows))[2][6:]
    quadratic = [v7[:4] @ v7[4:], v7[:4] @ v8[4:] + v8[:4] @ v7[4:], v8[:4] @ v8[4:]]
    solutions = [s * v7 + v8 for s in np.roots(quadratic)]
    u = max(solutions, key=lambda v: np.linalg.norm(v[:4]))
    u = u / np.linalg.norm(u[:4])
    p = 2 * right(u[:4] * [1, -1, -1, -1]) @ u[4:]
    return rotation_of(u[:4]), p[1:]


PLAIN = {
    "tsai-lenz": plain_tsai,
    "park-martin": plain_park,
    "horaud-dornaika": plain_horaud,
    "horaud-dornaika-literal": plain_horaud_printed,
    "andreff": plain_andreff,
    "daniilidis": plain_daniilidis,
}


def plain_Z(A, B, X):
    """Mean over the pairs of what they make of Z."""
    U, _, Vt = np.linalg.svd(
        sum(a[:3, :3] @ X[:3, :3] @ b[:3, :3].T for a, b in zip(A, B, strict=True))
    )
    Z = np.eye(4)
    Z[:3, :3] = U @ np.diag([1, 1, np.linalg.det(U @ Vt)]) @ Vt
    Z[:3, 3] = np.mean(
        [a[:3, :3] @ X[:3, 3] + a[:3, 3] - Z[:3, :3] @ b[:3, 3] for a, b in zip(A, B, strict=True)],
        axis=0,
    )
    return Z


@pytest.mark.parametrize("pairs", [3, 12])
@pytest.mark.parametrize("method", HAND_EYE)
def test_method_is_its_definition_over_all_motions_both_ways(method, pairs):
    A, B, _ = noisy(pairs, 2, pairs)
    found = solve_batch(A, B, method)
    for trial in range(2):
        R, p = PLAIN[method](motions(A[trial], B[trial], both_ways=True))
        np.testing.assert_allclose(found.X[trial, :3, :3], R, atol=1e-9)
        np.testing.assert_allclose(found.X[trial, :3, 3], p, atol=1e-9)
        Z = plain_Z(A[trial], B[trial], found.X[trial])
        np.testing.assert_allclose(found.Z[trial], Z, atol=1e-12)


OPENCV = {
    "tsai-lenz": "TSAI",
    "park-martin": "PARK",
    "horaud-dornaika": "HORAUD",
    "andreff": "ANDREFF",
    "daniilidis": "DANIILIDIS",
}


def opencv(cv2, method, A, B):
    T_camera_target = np.linalg.inv(B)
    R, p = cv2.calibrateHandEye(
        list(A[:, :3, :3]),
        list(A[:, :3, 3]),
        list(T_camera_target[:, :3, :3]),
        list(T_camera_target[:, :3, 3]),
        method=getattr(cv2, f"CALIB_HAND_EYE_{OPENCV[method]}"),
    )
    return R, p[:, 0]


CASES = [(m, n) for m in OPENCV for n in (4, 9, 20) if m != "tsai-lenz" or n == 4]


def of_medium_size(A, B):
    """Trials whose motions are all between 25 and 150 deg.

    OpenCV's Tsai (4.14) leaves out motions below some 18 deg, and those close to half a turn.
    """
    return [
        all(25 < np.degrees(Rotation.from_matrix(m[:3, :3]).magnitude()) < 150 for m, _ in every)
        for every in (motions(a, b, both_ways=False) for a, b in zip(A, B, strict=True))
    ]


@pytest.mark.parametrize(("method", "pairs"), CASES)
def test_opencv_takes_each_motion_one_way_only(method, pairs):
    cv2 = pytest.importorskip("cv2", reason="comparison with OpenCV")
    A, B, _ = noisy(pairs + 100, 60 if pairs == 4 else 3, pairs)
    if pairs == 4:
        medium = of_medium_size(A, B)
        A, B = A[medium], B[medium]
        assert len(A) > 3
    found = solve_batch(A, B, method)
    for trial in range(len(A)):
        R, p = opencv(cv2, method, A[trial], B[trial])
        expected = PLAIN[method](motions(A[trial], B[trial], both_ways=False))
        np.testing.assert_allclose(R, expected[0], atol=1e-9)
        np.testing.assert_allclose(p, expected[1], atol=1e-9)
        # Rotation equations say the same both ways, and so do all of the dual quaternions.
        if method != "andreff":
            np.testing.assert_allclose(found.X[trial, :3, :3], R, atol=1e-9)
        if method == "daniilidis":
            np.testing.assert_allclose(found.X[trial, :3, 3], p, atol=1e-9)


@pytest.mark.parametrize("method", OPENCV)
def test_opencv_changes_with_the_order_of_the_samples_unless_dual(method):
    cv2 = pytest.importorskip("cv2", reason="comparison with OpenCV")
    A, B, _ = noisy(1, 1, 6)
    forward, backward = (
        opencv(cv2, method, *T)[1] for T in ((A[0], B[0]), (A[0, ::-1], B[0, ::-1]))
    )
    assert (np.abs(forward - backward).max() < 1e-9) == (method == "daniilidis")
    ours = solve_batch(A, B, method), solve_batch(A[:, ::-1], B[:, ::-1], method)
    np.testing.assert_allclose(ours[0].X, ours[1].X, atol=1e-12)


@pytest.mark.parametrize("at_once", [1, 7, 10**6])
@pytest.mark.parametrize("pairs", [3, 4, 7, 8])
def test_every_pair_of_poses_is_taken_once(monkeypatch, pairs, at_once):
    monkeypatch.setattr(relative_motions, "_MOTIONS_AT_ONCE", at_once)
    A, B, _ = noisy(2, 2, pairs)
    p, q = (np.concatenate(m, axis=-1) for m in zip(*all_motions(PairSets(A, B)), strict=True))
    for trial in range(2):
        every = motions(A[trial], B[trial], both_ways=False)
        for found, side in ((p, 0), (q, 1)):
            angle = 2 * np.arctan2(
                np.linalg.norm(found[1:, trial], axis=0), np.abs(found[0, trial])
            )
            expected = [Rotation.from_matrix(m[side][:3, :3]).magnitude() for m in every]
            np.testing.assert_allclose(np.sort(angle), np.sort(expected), atol=1e-12)


@pytest.mark.parametrize("method", HAND_EYE)
def test_memory_is_that_of_the_poses_not_of_their_pairs(method):
    """An array of one number for each of the 500,000 motions would take 4 MB."""
    A, B, _ = noisy(3, 1, 1000)
    tracemalloc.start()
    try:
        METHODS[method].estimate(PairSets(A, B))
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 16e6


def test_quaternions_of_motions_turn_x_as_the_closed_form_of_all_pairs_does():
    A, B, _ = noisy(4, 50, 7, cone_deg=None)
    by_motions = solve_batch(A, B, "horaud-dornaika")
    by_pairs = solve_batch(A, B, "dornaika-horaud")
    np.testing.assert_allclose(by_motions.X[:, :3, :3], by_pairs.X[:, :3, :3], atol=1e-9)


@pytest.mark.parametrize("method", HAND_EYE)
def test_noise_next_to_half_turns_between_poses_does_no_harm(method):
    """Where the shorter way round is another one in A than in B, the printed forms go astray."""
    rng = np.random.default_rng(5)
    axes = rng.normal(size=(5, 3))
    axes /= np.linalg.norm(axes, axis=-1, keepdims=True)
    R = se3.rotation_exp(np.concatenate([np.zeros((1, 3)), np.pi * axes]))
    problems = random_problems(rng, 100, 6)
    A = se3.transform(R, problems.A[..., :3, 3])
    B = se3.inverse(problems.Z)[:, None] @ A @ problems.X[:, None]
    A, B = add_noise(rng, A, B, NOISE)
    turned = np.swapaxes(problems.X[:, :3, :3], 1, 2)
    found = solve_batch(A, B, method).X[:, :3, :3]
    assert np.quantile(np.degrees(se3.rotation_angle(found @ turned)), 0.9) < 1.5
    if method in ("andreff", "daniilidis"):
        return  # no quaternions, and no answer at all in real numbers
    printed = np.array(
        [PLAIN[method](motions(a, b, both_ways=False))[0] for a, b in zip(A, B, strict=True)]
    )
    as_printed = se3.rotation_angle(se3.project_to_rotation(printed) @ turned)
    assert np.quantile(np.degrees(as_printed), 0.9) > 30.0


def test_tsai_lenz_fails_where_x_is_half_a_turn_and_says_so():
    problems = random_problems(np.random.default_rng(6), 20, 6)
    half = se3.rotation_exp([[np.pi, 0.0, 0.0], [0.0, 0.6 * np.pi, 0.8 * np.pi]])
    X = se3.transform(half[np.arange(20) % 2], problems.X[:, :3, 3])
    B = se3.inverse(problems.Z)[:, None] @ problems.A @ X[:, None]
    found = solve_batch(problems.A, B, "tsai-lenz")
    wrong = np.abs(found.X - X).max(axis=(1, 2)) > 1e-6
    assert wrong.any()
    assert not found.ok[wrong].any()
    for method in set(HAND_EYE) - {"tsai-lenz"}:
        np.testing.assert_allclose(solve_batch(problems.A, B, method).X, X, atol=1e-9)


def test_target_in_one_place_of_the_view_hides_a_scale_from_andreff_only():
    problems = random_problems(np.random.default_rng(7), 20, 6)
    place = np.array([0.1, -0.2, 0.5])
    B = problems.B.copy()
    B[..., :3, 3] = -(B[..., :3, :3] @ place)
    A = problems.Z[:, None] @ B @ se3.inverse(problems.X)[:, None]
    found = solve_batch(A, B, "andreff")
    assert not found.ok.any()
    off = found.X[:, :3, 3] - problems.X[:, :3, 3]
    direction = problems.X[:, :3, :3] @ place
    np.testing.assert_allclose(np.cross(off, direction), 0.0, atol=1e-9)
    for method in set(HAND_EYE) - {"andreff"}:
        np.testing.assert_allclose(solve_batch(A, B, method).X, problems.X, atol=1e-9)


def test_unit_axes_suffer_from_small_motions():
    """Poses in close pairs: the axes between the two of a pair are noise."""
    rng = np.random.default_rng(8)
    problems = random_problems(rng, 200, 6)
    hair = se3.transform(se3.rotation_exp([1e-3, 2e-3, -1e-3]), np.zeros(3))
    A = np.concatenate([problems.A, problems.A @ hair], axis=1)
    B = se3.inverse(problems.Z)[:, None] @ A @ problems.X[:, None]
    A, B = add_noise(rng, A, B, NOISE)
    true_t = np.swapaxes(problems.X[:, :3, :3], 1, 2)
    printed, weighted = (
        se3.rotation_angle(solve_batch(A, B, method).X[:, :3, :3] @ true_t)
        for method in ("horaud-dornaika-literal", "horaud-dornaika")
    )
    # four standard deviations of a fair coin over 200 trials
    assert (weighted < printed).mean() > 0.5 + 4.0 * 0.5 / np.sqrt(200)


def test_identical_poses_have_no_axis_and_do_no_harm():
    problems = random_problems(np.random.default_rng(9), 10, 5)
    A, B = (np.concatenate([T, T[:, :2]], axis=1) for T in (problems.A, problems.B))
    for method in HAND_EYE:
        found = solve_batch(A, B, method)
        np.testing.assert_allclose(found.X, problems.X, atol=1e-9)
        np.testing.assert_allclose(found.Z, problems.Z, atol=1e-9)


@pytest.mark.parametrize("method", HAND_EYE)
def test_a_set_without_rotations_does_not_stop_the_others(method):
    problems = random_problems(np.random.default_rng(10), 2, 5)
    A = problems.A.copy()
    A[0, :, :3, :3] = A[0, 0, :3, :3]
    B = se3.inverse(problems.Z)[:, None] @ A @ problems.X[:, None]
    found = METHODS[method].estimate(PairSets(A, B))
    assert np.isfinite(found.X).all()
    np.testing.assert_allclose(found.X[1], problems.X[1], atol=1e-9)
