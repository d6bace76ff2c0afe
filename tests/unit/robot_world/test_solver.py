"""Checks of the input, the result object and its text, OpenCV's names."""

import numpy as np
import pytest

from calib import se3
from calib.errors import InputError
from calib.robot_world import (
    METHODS,
    PairNoise,
    add_noise,
    difference,
    pairs_from_opencv,
    random_problems,
    result_to_opencv,
    solve,
    solve_batch,
)
from calib.robot_world.methods import hirsh
from calib.robot_world.noise import perturb


@pytest.fixture
def problem():
    return random_problems(np.random.default_rng(0), 1, 6)


def refused(call, *args, **kwargs):
    with pytest.raises(InputError) as caught:
        call(*args, **kwargs)
    return caught.value


def test_unknown_method_lists_the_near_ones(problem):
    error = refused(solve, problem.A[0], problem.B[0], "li-kroneker")
    assert "no method 'li-kroneker'" in error.message
    assert "li-kronecker" in error.hint
    error = refused(solve_batch, problem.A, problem.B, "?")
    assert all(name in error.hint for name in METHODS)


def test_methods_have_names_and_descriptions():
    assert list(METHODS) == [
        "ml",
        "ml-robust",
        "li-kronecker",
        "li-kronecker-literal",
        "li-dual-quaternion",
        "zhuang",
        "zhuang-literal",
        "hirsh",
        "hirsh-literal",
        "dornaika-horaud",
        "dornaika-horaud-nonlinear",
        "shah",
        "tsai-lenz",
        "park-martin",
        "horaud-dornaika",
        "horaud-dornaika-literal",
        "andreff",
        "daniilidis",
    ]
    for name, method in METHODS.items():
        assert method.name == name
        assert method.description
        assert method.source
    with pytest.raises(TypeError):
        METHODS["mine"] = METHODS["zhuang"]


@pytest.mark.parametrize("pairs", [1, 2])
def test_too_few_pairs(problem, pairs):
    error = refused(solve, problem.A[0, :pairs], problem.B[0, :pairs])
    assert f"{pairs} pose pairs cannot identify" in error.message
    assert "at least 3" in error.hint
    assert error.value == pairs


def test_wrong_number_of_dimensions(problem):
    error = refused(solve, problem.A, problem.B)
    assert "A has shape (1, 6, 4, 4), not (N, 4, 4)" in error.message
    assert "solve_batch" in error.hint
    error = refused(solve_batch, problem.A[0], problem.B[0])
    assert "A has shape (6, 4, 4), not (T, N, 4, 4)" in error.message


def test_shapes_that_differ(problem):
    error = refused(solve, problem.A[0], problem.B[0, :5])
    assert "A has shape (6, 4, 4) and B has (5, 4, 4)" in error.message
    assert error.hint == "give one B for each A"


def test_empty_batch(problem):
    assert "no trial" in refused(solve_batch, problem.A[:0], problem.B[:0]).message


@pytest.mark.parametrize("side", ["A", "B"])
@pytest.mark.parametrize(
    ("entry", "value", "message"),
    [
        ((2, 0, 3), np.nan, "is not a finite number"),
        ((2, 3, 0), 0.1, "last row"),
        ((2, slice(0, 3), 0), 2.0, "not orthonormal"),
    ],
)
def test_matrices_that_are_no_transforms(problem, side, entry, value, message):
    pairs = {"A": problem.A[0].copy(), "B": problem.B[0].copy()}
    pairs[side][entry] = value
    error = refused(solve, pairs["A"], pairs["B"])
    assert message in error.message
    assert error.name == side


@pytest.mark.parametrize("side", ["A", "B"])
def test_left_handed_matrices(problem, side):
    pairs = {"A": problem.A[0].copy(), "B": problem.B[0].copy()}
    pairs[side][1, :3, 2] *= -1.0
    assert "left-handed" in refused(solve, pairs["A"], pairs["B"]).message


@pytest.mark.parametrize("method", [name for name in METHODS if name != "hirsh-literal"])
def test_matrices_with_seven_decimals(problem, method):
    result = solve(problem.A[0].round(7), problem.B[0].round(7), method)
    assert result.status == "ok"
    for T, truth in ((result.X, problem.X[0]), (result.Z, problem.Z[0])):
        np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-14)
        np.testing.assert_allclose(T, truth, atol=1e-5)


def test_noise_must_be_a_standard_deviation():
    assert "rotation_rad of the noise is -0.1" in refused(PairNoise, -0.1, 1e-3).message
    assert "translation_m of the noise is nan" in refused(PairNoise, 0.1, np.nan).message
    error = refused(PairNoise, 0.1, 1e-3, on="a")
    assert "noise on 'a'" in error.message
    assert "A" in error.hint


def test_residuals_are_those_of_the_equation(problem):
    rng = np.random.default_rng(1)
    A, B = add_noise(rng, problem.A[0], problem.B[0], PairNoise(0.01, 1e-3))
    result = solve(A, B)
    np.testing.assert_allclose(perturb(result.Z @ B, result.residuals), A @ result.X, atol=1e-12)
    angle = se3.rotation_angle(
        (A @ result.X)[:, :3, :3] @ np.swapaxes((result.Z @ B)[:, :3, :3], 1, 2)
    )
    np.testing.assert_allclose(result.residual_rotation_rad, angle, atol=1e-12)
    assert result.rotation_rms_rad == pytest.approx(np.sqrt((angle**2).mean()))
    distance = np.linalg.norm((A @ result.X - result.Z @ B)[:, :3, 3], axis=-1)
    np.testing.assert_allclose(result.residual_translation_m, distance, atol=1e-12)
    assert result.translation_rms_m == pytest.approx(np.sqrt((distance**2).mean()))


def test_difference_undoes_perturb(problem):
    error = np.random.default_rng(2).normal(size=(6, 6))
    error[:, :3] *= 0.5
    moved = perturb(problem.A[0], error)
    np.testing.assert_allclose(difference(moved, problem.A[0]), error, atol=1e-12)


def test_summary_speaks_of_degrees_and_millimetres():
    X = se3.transform(se3.rotation_from_wpr(np.radians([10.0, 20.0, 30.0])), [0.1, 0.2, 0.3])
    A = random_problems(np.random.default_rng(3), 1, 5).A[0]
    result = solve(A, A @ X, "hirsh", noise=PairNoise(np.radians(0.1), 1e-3))
    text = result.summary()
    assert f"A X = Z B by hirsh: ok, {result.iterations} cycles" in text
    assert "X  x y z    100.0000    200.0000    300.0000 mm" in text
    assert "W P R     10.0000     20.0000     30.0000 deg" in text
    assert f"{result.sigma_X[3] * 1e3:.4f}" in text
    assert f"{np.degrees(result.sigma_Z[2]):.4f}" in text
    assert "residuals of 5 pairs, rms: 0.0000 deg, 0.0000 mm" in text
    assert "probability" in text
    plain = solve(A, A @ X, "zhuang").summary()
    assert "probability" not in plain
    assert "cycles" not in plain


def test_summary_of_a_failure_has_no_deviations(problem, monkeypatch):
    monkeypatch.setattr(hirsh, "CYCLE_LIMIT", 2)
    text = solve(problem.A[0], problem.B[0], "hirsh").summary()
    assert "hirsh: not converged, 2 cycles" in text
    assert "sigma" not in text
    assert "known least" not in text


def test_status_of_an_iteration_that_stops_early(problem, monkeypatch):
    monkeypatch.setattr(hirsh, "CYCLE_LIMIT", 2)
    result = solve(problem.A[0], problem.B[0], "hirsh", noise=PairNoise(0.01, 1e-3))
    assert result.status == "not converged"
    assert "still moving after 2 cycles" in result.message
    assert result.iterations == 2
    assert result.covariance is None
    assert result.sigma_X is None
    assert result.sigma_Z is None


def test_opencv_names_the_same_equation_from_the_other_side(problem):
    T_camera_target = se3.inverse(problem.B[0])
    T_flange_base = se3.inverse(problem.A[0])
    result = solve(*pairs_from_opencv(T_camera_target, T_flange_base))
    base2world, gripper2cam = result_to_opencv(result)
    # Its own equation: world2cam · base2world = gripper2cam · base2gripper
    np.testing.assert_allclose(T_camera_target @ base2world, gripper2cam @ T_flange_base, atol=1e-9)
    np.testing.assert_allclose(result.X, problem.X[0], atol=1e-9)
    error = refused(pairs_from_opencv, T_camera_target * np.nan, T_flange_base)
    assert error.name == "world2cam"


@pytest.mark.slow
@pytest.mark.parametrize("side", ["A", "B", "both"])
def test_residuals_beyond_the_noise_given_widen_the_deviations(side):
    noise = PairNoise(np.radians(0.1), 1e-3, on=side)
    rng = np.random.default_rng(4)
    problems = random_problems(rng, 30, 12)
    A, B = add_noise(rng, problems.A, problems.B, noise)
    found = [solve(a, b, "hirsh", noise) for a, b in zip(A, B, strict=True)]
    # the right noise explains the residuals: one chance in ten thousand for each of 30 sets
    assert sum("times the noise" in result.message for result in found) <= 1
    small = PairNoise(noise.rotation_rad / 10, noise.translation_m / 10, on=side)
    doubted = solve(A[0], B[0], "hirsh", small)
    assert "times the noise given" in doubted.message
    ratio = doubted.sigma_X / found[0].sigma_X
    # 60 degrees of freedom: the scale is known to a tenth
    np.testing.assert_allclose(ratio, 1.0, atol=0.4)
