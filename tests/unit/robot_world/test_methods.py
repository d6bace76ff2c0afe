"""Each method against its definition, written out plainly here."""

import numpy as np
import pytest
from scipy import optimize

from calib import se3
from calib.batch_last import columns_of, quaternions_of
from calib.robot_world import (
    METHODS,
    PairNoise,
    PairSets,
    add_noise,
    pairs_from_opencv,
    random_problems,
    solve_batch,
)
from calib.robot_world.algebra import (
    conjugate,
    kronecker,
    kronecker_mean,
    least_squares,
    left_matrix,
    right_matrix,
)
from calib.robot_world.closed_form import assemble
from calib.robot_world.methods import hirsh, li_dual_quaternion, li_kronecker
from calib.robot_world.noise import perturb

NOISE = PairNoise(np.radians(0.5), 1e-3, "both")


def noisy(seed, trials, pairs, cone_deg=None, noise=NOISE):
    rng = np.random.default_rng(seed)
    problems = random_problems(rng, trials, pairs, cone_deg)
    return (*add_noise(rng, problems.A, problems.B, noise), problems)


def assert_transform(T, R, p, atol=1e-9):
    np.testing.assert_allclose(T[:3, :3], R, atol=atol)
    np.testing.assert_allclose(T[:3, 3], p, atol=atol)


def in_unit(T, per_metre):
    scaled = T.copy()
    scaled[..., :3, 3] *= per_metre
    return scaled


def hamilton(p, q):
    return np.array([
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] + p[2] * q[0] + p[3] * q[1] - p[1] * q[3],
        p[0] * q[3] + p[3] * q[0] + p[1] * q[2] - p[2] * q[1],
    ])  # fmt: skip


def test_quaternion_matrices_multiply():
    rng = np.random.default_rng(0)
    p, q = rng.normal(size=(2, 4))
    np.testing.assert_allclose(left_matrix(p) @ q, hamilton(p, q), atol=1e-15)
    np.testing.assert_allclose(right_matrix(q) @ p, hamilton(p, q), atol=1e-15)
    np.testing.assert_allclose(hamilton(p, conjugate(p)), [p @ p, 0.0, 0.0, 0.0], atol=1e-15)


def test_kronecker_products():
    A, B, _ = noisy(1, 2, 5)
    expected = np.array(
        [
            [np.kron(a[:3, :3], b[:3, :3]) for a, b in zip(*ab, strict=True)]
            for ab in zip(A, B, strict=True)
        ]
    )
    np.testing.assert_allclose(kronecker(A, B), expected, atol=1e-15)
    np.testing.assert_allclose(kronecker_mean(A, B), expected.mean(axis=1), atol=1e-15)


def test_least_squares_takes_the_shortest_solution_of_a_rank_deficient_problem():
    rng = np.random.default_rng(2)
    matrix = rng.normal(size=(3, 9, 4))
    matrix[1, :, 3] = matrix[1, :, 2]
    right_side = rng.normal(size=(3, 9))
    expected = [np.linalg.lstsq(M, y)[0] for M, y in zip(matrix, right_side, strict=True)]
    np.testing.assert_allclose(least_squares(matrix, right_side), expected, atol=1e-12)


@pytest.mark.parametrize("cone_deg", [None, 40.0])
def test_signs_agree_with_the_leading_eigenvector_of_the_sign_matrix(cone_deg):
    A, B, _ = noisy(3, 50, 8, cone_deg)
    a, b = PairSets(A, B).quaternions
    raw = se3.quaternion_from_rotation(B[..., :3, :3])
    sign = (b * raw).sum(axis=-1).round()
    weights = (a @ np.swapaxes(a, -1, -2)) * (raw @ np.swapaxes(raw, -1, -2))
    leading = np.sign(np.linalg.eigh(weights)[1][..., -1])
    agreement = (sign * leading).sum(axis=-1)
    np.testing.assert_array_equal(np.abs(agreement), 8)


def test_translations_are_the_least_squares_of_eq_16():
    A, B, _ = noisy(4, 3, 5)
    R_X, R_Z = PairSets(A, B).rotations
    X, Z = assemble(PairSets(A, B), R_X, R_Z)
    for trial in range(3):
        rows = np.concatenate([np.hstack([a[:3, :3], -np.eye(3)]) for a in A[trial]])
        right_side = np.concatenate(
            [R_Z[trial] @ b[:3, 3] - a[:3, 3] for a, b in zip(A[trial], B[trial], strict=True)]
        )
        expected = np.linalg.lstsq(rows, right_side)[0]
        np.testing.assert_allclose(np.r_[X[trial, :3, 3], Z[trial, :3, 3]], expected, atol=1e-12)


def test_averaged_translations_converge_to_the_least_squares():
    A, B, _ = noisy(5, 1, 6)
    found = solve_batch(A, B, "hirsh")
    R_A, p_A, p_B = A[0, :, :3, :3], A[0, :, :3, 3], B[0, :, :3, 3]
    R_Z, p_Z = found.Z[0, :3, :3], np.zeros(3)
    for _ in range(500):  # section 3 of the paper
        p_X = (np.swapaxes(R_A, 1, 2) @ (p_B @ R_Z.T + p_Z - p_A)[..., None])[..., 0].mean(axis=0)
        p_Z = (R_A @ p_X + p_A - p_B @ R_Z.T).mean(axis=0)
    np.testing.assert_allclose(found.X[0, :3, 3], p_X, atol=1e-12)
    np.testing.assert_allclose(found.Z[0, :3, 3], p_Z, atol=1e-12)


def literal_eq_19(A, B):
    """Eq. 19 with all its 24 unknowns and 12 N rows."""
    rows, right_side = [], []
    for a, b in zip(A, B, strict=True):
        R_A, R_B, p_B = a[:3, :3], b[:3, :3], b[:3, 3]
        top = [np.kron(R_A, np.eye(3)), -np.kron(np.eye(3), R_B.T), np.zeros((9, 6))]
        bottom = [np.zeros((3, 9)), np.kron(np.eye(3), p_B), -R_A, np.eye(3)]
        rows += [np.hstack(top), np.hstack(bottom)]
        right_side += [np.zeros(9), a[:3, 3]]
    u = np.linalg.lstsq(np.vstack(rows), np.concatenate(right_side))[0]
    X, Z = np.eye(4), np.eye(4)
    X[:3, :3] = se3.project_to_rotation(u[:9].reshape(3, 3))
    Z[:3, :3] = se3.project_to_rotation(u[9:18].reshape(3, 3))
    X[:3, 3], Z[:3, 3] = u[18:21], u[21:]
    return X, Z


def test_literal_kronecker_is_eq_19():
    A, B, _ = noisy(6, 4, 6)
    found = solve_batch(A, B, "li-kronecker-literal")
    for trial in range(4):
        X, Z = literal_eq_19(A[trial], B[trial])
        np.testing.assert_allclose(found.X[trial], X, atol=1e-12)
        np.testing.assert_allclose(found.Z[trial], Z, atol=1e-12)


def test_literal_kronecker_changes_with_the_unit():
    A, B, problems = noisy(8, 200, 20, noise=PairNoise(np.radians(0.5), 1e-3, "B"))
    metres = li_kronecker.estimate_literal(PairSets(A, B))
    millimetres = li_kronecker.estimate_literal(PairSets(in_unit(A, 1e3), in_unit(B, 1e3)))
    true_t = np.swapaxes(problems.Z[:, :3, :3], 1, 2)
    error_m = np.median(se3.rotation_angle(metres.Z[:, :3, :3] @ true_t))
    error_mm = np.median(se3.rotation_angle(millimetres.Z[:, :3, :3] @ true_t))
    # Metres leave the precise translations next to no weight.
    assert error_mm < 0.5 * error_m


def test_scaled_kronecker_beats_the_literal_form_in_either_unit():
    A, B, problems = noisy(9, 300, 5)
    scaled = li_kronecker.estimate(PairSets(A, B))
    metres = li_kronecker.estimate_literal(PairSets(A, B))
    millimetres = li_kronecker.estimate_literal(PairSets(in_unit(A, 1e3), in_unit(B, 1e3)))
    for literal in (metres.Z, in_unit(millimetres.Z, 1e-3)):
        closer = np.linalg.norm(scaled.Z - problems.Z, axis=(1, 2)) < np.linalg.norm(
            literal - problems.Z, axis=(1, 2)
        )
        # Four standard deviations of a fair coin over 300 trials
        assert closer.mean() > 0.5 + 4.0 * 0.5 / np.sqrt(300)


def plain_power_iteration(a, b, cycles):
    z = np.array([1.0, 0.0, 0.0, 0.0])
    for _ in range(cycles):
        x = np.mean([hamilton(hamilton(conjugate(p), z), q) for p, q in zip(a, b, strict=True)], 0)
        x /= np.linalg.norm(x)
        z = np.mean([hamilton(hamilton(p, x), conjugate(q)) for p, q in zip(a, b, strict=True)], 0)
        z /= np.linalg.norm(z)
    return z


def test_iterates_in_closed_form_are_those_of_the_loop():
    A, B, _ = noisy(10, 3, 5)
    a, b = PairSets(A, B).quaternions
    found = solve_batch(A, B, "hirsh")
    for trial in range(3):
        limit = plain_power_iteration(a[trial], b[trial], 1000)
        np.testing.assert_allclose(
            se3.rotation_from_quaternion(limit), found.Z[trial, :3, :3], atol=1e-10
        )
        for tolerance_rad in (1e-2, 1e-4):
            count = hirsh.cycles(PairSets(A[trial, None], B[trial, None]), tolerance_rad)[0]
            after = plain_power_iteration(a[trial], b[trial], count)
            before = plain_power_iteration(a[trial], b[trial], count - 1)
            assert half_angle(after, limit) <= tolerance_rad < half_angle(before, limit)


def half_angle(p, q):
    return np.arctan2(np.linalg.norm(p - (p @ q) * q), abs(p @ q))


@pytest.mark.parametrize("cone_deg", [None, 40.0])
def test_cycles_are_predicted_by_the_ratio_of_singular_values(cone_deg):
    problems = random_problems(np.random.default_rng(12), 300, 10, cone_deg)
    counted = hirsh.cycles(problems.pairs, 1e-10)
    predicted = hirsh.predicted_cycles(problems.pairs, 1e-10)
    assert (counted <= np.ceil(predicted)).all()
    # The other singular vectors only speed up the start.
    assert np.median(counted / predicted) > 0.9


def test_hirsh_says_that_it_did_not_converge(monkeypatch):
    problems = random_problems(np.random.default_rng(13), 5, 4, 40.0)
    monkeypatch.setattr(hirsh, "CYCLE_LIMIT", 3)
    found = solve_batch(problems.A, problems.B, "hirsh")
    assert not found.converged.any()
    assert not found.ok.any()
    np.testing.assert_array_equal(found.iterations, 3)


def test_printed_average_takes_the_identity_where_it_vanishes():
    opposite = np.array([[[0.0, 1.0, 0.0, 0.0], [0.0, -1.0, 0.0, 0.0]]])
    np.testing.assert_array_equal(hirsh._printed_average(opposite), [[1.0, 0.0, 0.0, 0.0]])


def test_constant_camera_position_is_a_misfit_of_the_kronecker_method_only():
    """Eq. 19 does not fix the scale of R_Z where the camera stays in one place."""
    rng = np.random.default_rng(14)
    problems = random_problems(rng, 10, 6)
    B = problems.B.copy()
    B[..., :3, 3] = [0.1, -0.2, 0.5]
    A = problems.Z[:, None] @ B @ se3.inverse(problems.X)[:, None]
    for method in ("zhuang", "hirsh"):
        found = solve_batch(A, B, method)
        np.testing.assert_allclose(found.X, problems.X, atol=1e-9)
    found = solve_batch(A, B, "li-kronecker")
    wrong = np.abs(found.X - problems.X).max(axis=(1, 2)) > 1e-6
    assert wrong.any()
    assert not found.ok[wrong].any()


@pytest.mark.parametrize("cone_deg", [None, 30.0])
def test_closed_form_is_the_smallest_eigenvalue_of_both_quaternions(cone_deg):
    """``Σ |a x - z b|²`` over unit x and z, by the eigenvectors of CᵀC and CCᵀ."""
    A, B = noisy(1, 5, 7, cone_deg)[:2]
    found = solve_batch(A, B, "dornaika-horaud")
    a, b = PairSets(A, B).quaternions
    for trial in range(5):
        C = sum(left_matrix(p).T @ right_matrix(q) for p, q in zip(a[trial], b[trial], strict=True))
        x, z = np.linalg.eigh(C @ C.T)[1][:, 3], np.linalg.eigh(C.T @ C)[1][:, 3]
        np.testing.assert_allclose(
            found.X[trial, :3, :3], se3.rotation_from_quaternion(x), atol=1e-9
        )
        np.testing.assert_allclose(
            found.Z[trial, :3, :3], se3.rotation_from_quaternion(z), atol=1e-9
        )


def test_closed_form_is_where_hirsh_ends():
    A, B = noisy(2, 50, 6)[:2]
    closed, iterated = (solve_batch(A, B, name) for name in ("dornaika-horaud", "hirsh"))
    np.testing.assert_allclose(closed.X, iterated.X, atol=1e-9)
    np.testing.assert_allclose(closed.Z, iterated.Z, atol=1e-9)


def residuals(A, B, R_X, p_X, R_Z, p_Z):
    turn = A[:, :3, :3] @ R_X - R_Z @ B[:, :3, :3]
    shift = A[:, :3, :3] @ p_X + A[:, :3, 3] - B[:, :3, 3] @ R_Z.T - p_Z
    return np.concatenate([turn.ravel(), shift.ravel()])


@pytest.mark.parametrize("pairs", [3, 8])
def test_nonlinear_is_the_minimum_of_the_sum_of_both(pairs):
    A, B = noisy(3, 4, pairs)[:2]
    found = solve_batch(A, B, "dornaika-horaud-nonlinear")
    assert found.converged.all()
    for trial in range(4):
        X, Z = found.X[trial], found.Z[trial]
        start = np.random.default_rng(trial).normal(scale=0.02, size=12)

        def cost(error, a=A[trial], b=B[trial], X=X, Z=Z):
            X, Z = perturb(X, error[:6]), perturb(Z, error[6:])
            return residuals(a, b, X[:3, :3], X[:3, 3], Z[:3, :3], Z[:3, 3])

        end = optimize.least_squares(cost, start, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
        np.testing.assert_allclose(end, 0.0, atol=1e-7)


def test_penalties_of_the_paper_lead_to_the_same_place():
    """All 24 numbers free, |RᵀR - 1|² weighted by 1e6, as printed."""
    A, B = noisy(4, 1, 8)[:2]
    found = solve_batch(A, B, "dornaika-horaud-nonlinear")
    start = np.concatenate(
        [part.ravel() for T in (found.X[0], found.Z[0]) for part in (T[:3, :3], T[:3, 3])]
    )

    def cost(u):
        R_X, R_Z = u[:9].reshape(3, 3), u[12:21].reshape(3, 3)
        penalties = [1e3 * (R.T @ R - np.eye(3)).ravel() for R in (R_X, R_Z)]
        return np.concatenate([residuals(A[0], B[0], R_X, u[9:12], R_Z, u[21:]), *penalties])

    moved = start + np.random.default_rng(5).normal(scale=1e-3, size=24)
    end = optimize.least_squares(cost, moved, xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    np.testing.assert_allclose(end, start, atol=1e-6)


def plain_shah(A, B):
    """Sum of Kronecker products, singular vectors, determinants, then 3N linear equations."""
    total = sum(np.kron(a[:3, :3], b[:3, :3]) for a, b in zip(A, B, strict=True))
    U, _, Vt = np.linalg.svd(total)
    R_X, R_Z = (nearest(v.reshape(3, 3)) for v in (Vt[0], U[:, 0]))
    rows = np.concatenate([np.hstack([a[:3, :3], -np.eye(3)]) for a in A])
    right_side = np.concatenate([R_Z @ b[:3, 3] - a[:3, 3] for a, b in zip(A, B, strict=True)])
    p = np.linalg.lstsq(rows, right_side)[0]
    return R_X, R_Z, p[:3], p[3:]


def nearest(V):
    U, _, Wt = np.linalg.svd(V / np.cbrt(np.linalg.det(V)))
    return U @ Wt


@pytest.mark.parametrize("cone_deg", [None, 30.0])
@pytest.mark.parametrize("pairs", [3, 8, 25])
def test_shah_is_its_definition(pairs, cone_deg):
    A, B = noisy(pairs, 4, pairs, cone_deg)[:2]
    found = solve_batch(A, B, "shah")
    for trial in range(4):
        R_X, R_Z, p_X, p_Z = plain_shah(A[trial], B[trial])
        assert_transform(found.X[trial], R_X, p_X)
        assert_transform(found.Z[trial], R_Z, p_Z)


@pytest.mark.parametrize(("method", "name"), [("shah", "SHAH"), ("li-kronecker-literal", "LI")])
def test_opencv_solves_the_same_equation_read_from_the_other_side(method, name):
    """Its residual is that of the inverse equation, so the inverses are what to give us."""
    cv2 = pytest.importorskip("cv2", reason="comparison with OpenCV")
    world2cam, base2gripper = noisy(1, 5, 9)[:2]
    for ours, theirs in zip(world2cam, base2gripper, strict=True):
        R_X, p_X, R_Z, p_Z = cv2.calibrateRobotWorldHandEye(
            list(ours[:, :3, :3]),
            list(ours[:, :3, 3]),
            list(theirs[:, :3, :3]),
            list(theirs[:, :3, 3]),
            method=getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}"),
        )
        found = solve_batch(ours[None], theirs[None], method)
        assert_transform(found.X[0], R_X, p_X[:, 0])
        assert_transform(found.Z[0], R_Z, p_Z[:, 0])
        # From our side the rotations of Shah are the same, the translations are not.
        mine = solve_batch(*(T[None] for T in pairs_from_opencv(ours, theirs)), method)
        if method == "shah":
            np.testing.assert_allclose(np.linalg.inv(mine.Z[0])[:3, :3], R_X, atol=1e-9)
        assert np.abs(np.linalg.inv(mine.Z[0])[:3, 3] - p_X[:, 0]).max() > 1e-6


def test_poses_that_hardly_tilt_cost_no_digits():
    """Three poses whose common axis tilts by 1e-4: singular vectors of the mean lose 1e-16/1e-8."""
    rng = np.random.default_rng(3)
    problems = random_problems(rng, 50, 3)
    start = problems.A[:, :1, :3, :3]
    turns = se3.rotation_exp([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1e-4, 0.0, 2.0]])
    A = se3.transform(start @ turns, problems.A[..., :3, 3])
    B = se3.inverse(problems.Z)[:, None] @ A @ problems.X[:, None]
    found = METHODS["shah"].estimate(PairSets(A, B))
    np.testing.assert_allclose(found.X[:, :3, :3], problems.X[:, :3, :3], atol=1e-10)
    mean = np.array(
        [
            sum(np.kron(a[:3, :3], b[:3, :3]) for a, b in zip(*T, strict=True))
            for T in zip(A, B, strict=True)
        ]
    )
    by_mean = np.array([nearest(v.reshape(3, 3)) for v in np.linalg.svd(mean)[2][:, 0]])
    assert np.abs(by_mean - problems.X[:, :3, :3]).max() > 1e-9


@pytest.mark.parametrize("method", [hirsh, li_kronecker, li_dual_quaternion])
def test_sums_of_products_tell_as_much_as_all_rows(method, monkeypatch):
    """Where they do not, in a narrow cone, the rows are factorised: the same as ever."""
    A, B, _ = noisy(3, 4, 20)
    sums = method.estimate(PairSets(A, B))
    A_narrow, B_narrow, _ = noisy(3, 4, 20, cone_deg=2.0)
    narrow = method.estimate(PairSets(A_narrow, B_narrow))
    monkeypatch.setattr(method, "LEAST_SQUARE", np.inf)
    for found, sides in ((sums, (A, B)), (narrow, (A_narrow, B_narrow))):
        rows = method.estimate(PairSets(*sides))
        np.testing.assert_allclose(found.X, rows.X, atol=1e-11)
        np.testing.assert_allclose(found.Z, rows.Z, atol=1e-11)
    np.testing.assert_array_equal(narrow.X, rows.X)


def test_quaternions_of_many_rotations_are_those_of_each():
    rng = np.random.default_rng(4)
    R = se3.rotation_exp(rng.uniform(-3.0, 3.0, (200, 3)))
    R[:4] = np.eye(3), np.diag([1, -1, -1]), np.diag([-1, 1, -1]), np.diag([-1, -1, 1])
    q = quaternions_of(columns_of(R)).T
    np.testing.assert_allclose(se3.rotation_from_quaternion(q), R, atol=1e-15 * 4)
    assert (q[:, 0] >= 0.0).all()
    np.testing.assert_allclose(q[4:], se3.quaternion_from_rotation(R[4:]), atol=1e-15 * 4)
