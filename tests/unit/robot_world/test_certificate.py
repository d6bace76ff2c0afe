"""The certificate of global optimality, as it is asked for."""

import numpy as np
import pytest
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from calib import se3
from calib.errors import InputError
from calib.robot_world import PairNoise, add_noise, random_problems, residuals
from calib.robot_world.certificate import certify, cost_weights, minimise
from calib.robot_world.certificate.certify import GAP_TOLERANCE, derivatives
from calib.robot_world.certificate.polynomial import quadratic_form


def noisy(rng, noise, trials, pairs, cone_deg=None):
    problems = random_problems(rng, trials, pairs, cone_deg)
    return problems, *add_noise(rng, problems.A, problems.B, noise)


def anywhere(rng, count=None):
    R = Rotation.random(count, rng=rng).as_matrix()
    return se3.transform(R, rng.uniform(-1.0, 1.0, size=(*R.shape[:-2], 3)))


def best_of_many(rng, A, B, noise, starts):
    """Least cost that descents from random rotations find, for noise on B."""
    costs = [
        minimise(A, B, *anywhere(rng, 2 * len(A))[:, :3, :3].reshape(2, -1, 3, 3), noise).cost
        for _ in range(starts)
    ]
    return np.min(costs, axis=0)


@pytest.mark.parametrize("side", ["A", "B"])
@pytest.mark.parametrize("cone_deg", [None, 40.0])
@pytest.mark.parametrize("pairs", [5, 10, 30])
def test_optimum_is_proven_at_usual_noise(side, cone_deg, pairs):
    rng = np.random.default_rng(1)
    noise = PairNoise(np.radians(0.5), 1e-3, side)
    problems, A, B = noisy(rng, noise, 5, pairs, cone_deg)
    for a, b, X, Z in zip(A, B, problems.X, problems.Z, strict=True):
        proof = certify(a, b, X, Z, noise)
        assert proof.certified
        assert proof.unique
        assert proof.status == "optimal"
        assert proof.smallest_eigenvalue > 0.0
        assert proof.bound <= proof.cost
        assert proof.relative_gap < 1e-8
        error = residuals(a, b, proof.X, proof.Z)
        if side == "B":  # the residuals over their standard deviations, to first order
            chi2 = ((error / noise.sigma) ** 2).sum()
            assert proof.cost == pytest.approx(chi2, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["A", "B"])
@pytest.mark.parametrize("cone_deg", [None, 40.0])
@pytest.mark.parametrize(
    ("noise_deg", "noise_m"), [(0.01, 1e-5), (0.05, 1e-4), (0.5, 1e-3), (2.0, 4e-3), (5.0, 1e-2)]
)
def test_optimum_is_proven_at_any_noise(side, cone_deg, noise_deg, noise_m):
    rng = np.random.default_rng(2)
    noise = PairNoise(np.radians(noise_deg), noise_m, side)
    proofs = []
    for pairs in (5, 10, 30):
        problems, A, B = noisy(rng, noise, 17, pairs, cone_deg)
        each = zip(A, B, problems.X, problems.Z, strict=True)
        proofs += [certify(a, b, X, Z, noise) for a, b, X, Z in each]
    assert all(proof.certified for proof in proofs)


def test_a_wrong_optimum_is_never_certified():
    rng = np.random.default_rng(3)
    noise = PairNoise(np.radians(2.0), 4e-3, "B")
    _, A, B = noisy(rng, noise, 8, 3, 40.0)
    best = best_of_many(rng, A, B, cost_weights(noise), starts=10)
    wrong = 0
    for t in range(8):
        proof = certify(A[t], B[t], anywhere(rng), anywhere(rng), noise)
        assert proof.bound <= best[t]
        assert proof.certified == (proof.cost <= best[t] * (1.0 + GAP_TOLERANCE))
        if proof.certified:
            assert proof.better is None
            continue
        wrong += 1
        assert proof.status == "not optimal"
        assert not proof.unique
        assert proof.better is not None
        assert proof.better.certified
        assert proof.better.cost == pytest.approx(best[t], rel=1e-6)
        assert f"{proof.better.cost:.5g}" in proof.message
    assert wrong >= 3


def stationary_points(rng, A, B, weights, tries):
    """Points X, Z (1, 4, 4) without slope, and the least curvature there, by a general solver."""
    for _ in range(tries):
        form = quadratic_form(A, B, anywhere(rng, 1), anywhere(rng, 1), weights)

        def at(w, form=form):
            turns = se3.rotation_exp(w.reshape(2, 3))[None]
            return derivatives(form.quadratic, form.linear, turns)

        found = root(lambda w, at=at: at(w)[0][0], np.zeros(6), tol=1e-14)
        if found.success:
            turns = se3.rotation_exp(found.x.reshape(2, 3))
            yield *form.transforms(turns[:1], turns[1:]), np.linalg.eigvalsh(at(found.x)[1])[0, 0]


@pytest.mark.slow
def test_a_saddle_is_never_certified():
    rng = np.random.default_rng(4)
    noise = PairNoise(np.radians(1.0), 2e-3, "B")
    weights = cost_weights(noise)
    _, A, B = noisy(rng, noise, 3, 6)
    best = best_of_many(rng, A, B, weights, starts=10)
    stayed = 0
    for t in range(3):
        for X, Z, curvature in stationary_points(rng, A[[t]], B[[t]], weights, 20):
            proof = certify(A[t], B[t], X[0], Z[0], noise)
            assert proof.bound <= best[t]
            assert proof.certified == (proof.cost < best[t] * (1.0 + GAP_TOLERANCE))
            # rounding may have let it roll off
            if curvature < 0.0 and proof.rotation_moved_rad.max() < 1e-6:
                stayed += 1
                assert proof.status == "not optimal"
                assert proof.smallest_eigenvalue < 0.0
                assert proof.better.cost == pytest.approx(best[t], rel=1e-9)
    assert stayed >= 5


def test_noise_on_A_is_the_same_problem_from_the_other_side():
    rng = np.random.default_rng(5)
    on_A, on_B = (PairNoise(np.radians(0.5), 1e-3, side) for side in ("A", "B"))
    problems, A, B = noisy(rng, on_A, 1, 8)
    X, Z = problems.X[0], problems.Z[0]
    one = certify(A[0], B[0], X, Z, on_A)
    other = certify(B[0], A[0], se3.inverse(X), se3.inverse(Z), on_B)
    assert one.cost == pytest.approx(other.cost, rel=1e-12)
    assert one.bound == pytest.approx(other.bound, rel=1e-9)
    np.testing.assert_allclose(one.X @ other.X, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(one.Z @ other.Z, np.eye(4), atol=1e-14)
    # not the same optimum as if the noise were on the other side
    assert np.abs(certify(A[0], B[0], X, Z, on_B).X - one.X).max() > 1e-6


def test_it_says_how_far_the_candidate_was():
    rng = np.random.default_rng(6)
    noise = PairNoise(np.radians(0.1), 1e-3, "B")
    problems, A, B = noisy(rng, noise, 1, 10)
    optimum = certify(A[0], B[0], problems.X[0], problems.Z[0], noise)
    X, Z = optimum.X.copy(), optimum.Z.copy()
    X[:3, :3] = se3.rotation_exp([0.0, 0.02, 0.0]) @ X[:3, :3]
    Z[:3, :3] = se3.rotation_exp([0.03, 0.0, 0.0]) @ Z[:3, :3]
    X[:3, 3] += [0.0, 0.003, 0.004]
    Z[:3, 3] -= [0.001, 0.0, 0.0]
    proof = certify(A[0], B[0], X, Z, noise)
    np.testing.assert_allclose(proof.rotation_moved_rad, [0.02, 0.03], atol=1e-10)
    np.testing.assert_allclose(proof.translation_moved_m, [0.005, 0.001], atol=1e-10)
    np.testing.assert_allclose(proof.X, optimum.X, atol=1e-12)
    assert proof.certified


def test_data_without_noise_are_proven():
    problems = random_problems(np.random.default_rng(7), 1, 5)
    noise = PairNoise(np.radians(0.5), 1e-3, "B")
    proof = certify(problems.A[0], problems.B[0], problems.X[0], problems.Z[0], noise)
    assert proof.cost < 1e-18
    assert proof.certified
    assert proof.unique
    np.testing.assert_allclose(proof.X, problems.X[0], atol=1e-12)


def about_axes(rng, axes, angles):
    R = se3.rotation_exp(np.asarray(axes, dtype=float) * np.asarray(angles)[:, None])
    A = se3.transform(R, rng.uniform(-0.5, 0.5, size=(len(R), 3)))
    X, Z = anywhere(rng), anywhere(rng)
    return A, se3.inverse(Z) @ A @ X, X, Z


@pytest.mark.parametrize("angles", [[0.1, 0.7, -0.4, 1.2, 2.0], [0.0] * 5])
def test_rotations_about_one_axis_leave_a_choice(angles):
    rng = np.random.default_rng(8)
    noise = PairNoise(np.radians(0.5), 1e-3, "B")
    A, B, X, Z = about_axes(rng, [[0.6, 0.0, 0.8]] * 5, angles)
    exact = certify(A, B, X, Z, noise)  # nothing costs less than nothing
    assert exact.certified
    assert not exact.unique
    assert "others may have the same" in exact.message
    _, B = add_noise(rng, A, B, noise)
    proof = certify(A, B, X, Z, noise)
    assert not proof.certified
    assert proof.status == "not proven"
    assert "leaves a translation free" in proof.message


def test_two_optima_are_told_from_one():
    # half turns at right angles to the axis of the others: X may be turned by π about that axis
    rng = np.random.default_rng(9)
    noise = PairNoise(np.radians(0.5), 1e-3, "B")
    axes = [[0, 0, 1], [0, 0, 1], [0, 0, 1], [1, 0, 0], [0, 1, 0], [0.6, 0.8, 0]]
    A, B, X, Z = about_axes(rng, axes, [0.3, 0.9, -1.1, np.pi, np.pi, np.pi])
    A[:, :3, 3] = X[:3, 3] = 0.0
    B = se3.inverse(Z) @ A @ X
    turn = se3.transform(se3.rotation_exp([0.0, 0.0, np.pi]), np.zeros(3))
    np.testing.assert_allclose(A @ turn @ X, turn @ Z @ B, atol=1e-12)
    for candidate in ((X, Z), (turn @ X, turn @ Z)):
        proof = certify(A, B, *candidate, noise)
        assert proof.certified
        assert not proof.unique
        np.testing.assert_allclose(proof.X, candidate[0], atol=1e-9)


def test_input_that_cannot_be_used_is_refused():
    rng = np.random.default_rng(10)
    problems = random_problems(rng, 1, 4)
    A, B, X, Z = (a[0] for a in (problems.A, problems.B, problems.X, problems.Z))
    noise = PairNoise(0.01, 0.001, "B")
    with pytest.raises(InputError, match="moves the origin of X"):
        certify(A, B, X, Z, PairNoise(0.01, 0.001, "both"))
    for none in (PairNoise(0.0, 0.001, "B"), PairNoise(0.01, 0.0, "B")):
        with pytest.raises(InputError, match="no finite weight"):
            certify(A, B, X, Z, none)
    with pytest.raises(InputError, match="2 pose pairs cannot identify"):
        certify(A[:2], B[:2], X, Z, noise)
    with pytest.raises(InputError, match=r"A has shape \(4, 4, 4\) and B has \(3, 4, 4\)"):
        certify(A, B[:3], X, Z, noise)
    with pytest.raises(InputError, match=r"A has shape \(1, 4, 4, 4\), not \(N, 4, 4\)"):
        certify(A[None], B, X, Z, noise)
    with pytest.raises(InputError, match=r"X has shape \(1, 4, 4\), not \(4, 4\)"):
        certify(A, B, X[None], Z, noise)
    with pytest.raises(InputError, match="Z: the rotation part is left-handed"):
        certify(A, B, X, Z @ np.diag([-1.0, 1.0, 1.0, 1.0]), noise)
