"""Arms before they are measured: the error to expect of them, against drawn arms."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from calib import CalibrationModel
from calib.identification import tool_motion
from calib.identification.prediction import placed_anew
from calib.identification.prior_arms import SHARE, PriorArms, UsualSize
from calib.model import Setup
from calib.model.measurements import TouchUp
from calib.model.parameters import JointCompliance, TargetPoints, ToolPoints, ZeroOffsets

JOINTS = [f"joint_{k}" for k in range(1, 7)]
DEVIATION = 2e-5
USUAL = {"offsets": UsualSize(0.5, 3.0), "compliance": UsualSize(0.8, 1.6)}


def model_of(robot, target_m, order: int = 1) -> CalibrationModel:
    """Six joints and two that give way, with priors; ``order`` of -1: all the other way round."""
    blocks = [
        ZeroOffsets(robot, JOINTS[::order], 2e-3, 1e-3),
        JointCompliance(robot, ["joint_2", "joint_3"][::order], prior=3e-7),
        ToolPoints([[0.2, -0.05, 0.35], [0.1, 0.2, 0.3]], ["R1", "R2"]),
        TargetPoints([target_m], ["A"]),
    ]
    return CalibrationModel(robot, blocks[::order], TouchUp(1e-5))


@pytest.fixture(scope="module")
def arms(reference_robot, target_m) -> PriorArms:
    return PriorArms.of(model_of(reference_robot, target_m), USUAL, DEVIATION)


def linear_of(arms, q, together: int = 2):
    """Of postures at which both reflectors are read at once, or each at every second one."""
    tool = np.resize([0, 1], together * len(q))
    return arms.model.linearise(q, setup=replace(Setup.of(len(tool), tool=tool), together=together))


@pytest.fixture(scope="module", params=[1, 2], ids=["one by one", "together"])
def linear(request, arms, touching):
    return linear_of(arms, touching(9), request.param)


@pytest.fixture(scope="module")
def functions(arms, reference_robot) -> np.ndarray:
    return functions_of(arms.model, reference_robot)


def functions_of(model, robot) -> np.ndarray:
    q = np.random.default_rng(7).uniform(robot.lower / 2, robot.upper / 2, (12, robot.n))
    return placed_anew(tool_motion(model, q), model.view(q).tool_points)


def offsets_of(J):
    """Columns of the zero offsets."""
    return J[..., :6]


def posterior_of(J, prior) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of parameters, and their gain by readings: by normal equations and inverses."""
    D = DEVIATION * offsets_of(J)
    weight = np.linalg.inv(np.eye(J.shape[1]) + D @ np.swapaxes(D, 1, 2))
    # in units of the columns, which differ by ten orders of magnitude
    unit = np.linalg.norm(J.reshape(-1, J.shape[2]), axis=0)
    G = J / unit
    told = np.einsum("nap,nab,nbq->pq", G, weight, G) + np.diag((prior * unit) ** -2.0)
    C = np.linalg.inv(told) / np.outer(unit, unit)
    return C, np.einsum("pq,naq,nab->pnb", C, J, weight)


def test_priors_are_root_mean_squares_over_arms(arms, reference_robot, target_m):
    given = model_of(reference_robot, target_m)
    held = np.isfinite(given.prior)
    assert held.sum() == 8
    assert not np.isfinite(arms.model.prior[~held]).any()
    assert arms.must_be_told == (~held).sum() == 9
    rng = np.random.default_rng(0)
    for columns, size in ((range(6), USUAL["offsets"]), (range(6, 8), USUAL["compliance"])):
        drawn = size.share * size.factor ** rng.standard_normal(400_000)
        for k in columns:
            rms = given.prior[k] * np.sqrt(np.mean(drawn**2))
            assert arms.model.prior[k] == pytest.approx(rms, rel=0.1)
            exact = size.share * np.exp(np.log(size.factor) ** 2)
            assert arms.model.prior[k] == pytest.approx(given.prior[k] * exact, rel=1e-12)


def test_the_covariance_is_the_inverse_of_all_information(arms, linear):
    C, _ = posterior_of(linear.white_jacobian, arms.model.prior)
    found = arms.covariance(arms.blocks(linear))
    scale = np.sqrt(np.diag(C))
    np.testing.assert_allclose(
        found / np.outer(scale, scale), C / np.outer(scale, scale), atol=1e-6
    )


def test_the_deviation_is_of_the_joints_and_shared_by_all_that_is_read(arms, touching):
    """Its columns are what a turn of the joints does to both reflectors of a stop."""
    q = touching(3)
    J = linear_of(arms, q).white_jacobian
    assert J.shape[:2] == (3, 6)
    step = 1e-6 * np.eye(6)
    for k in range(6):
        ahead, behind = (linear_of(arms, q + s * step[k]).white_rows for s in (1.0, -1.0))
        slope = (ahead - behind).reshape(3, 6) / 2e-6
        np.testing.assert_allclose(J[..., k], slope, rtol=1e-5, atol=1.0)


def test_a_deviation_integrated_out_is_one_more_parameter_at_each_pose(arms, linear):
    J = linear.white_jacobian
    N, m, p = J.shape
    rows = np.zeros((N * m, p + 6 * N))
    rows[:, :p] = J.reshape(-1, p)
    for i in range(N):
        rows[i * m : (i + 1) * m, p + 6 * i : p + 6 * (i + 1)] = offsets_of(J[i])
    prior = np.concatenate([arms.model.prior, np.full(6 * N, DEVIATION)])
    unit = np.linalg.norm(rows, axis=0)
    told = rows / unit
    C = np.linalg.inv(told.T @ told + np.diag((prior * unit) ** -2.0))
    marginal = (C / np.outer(unit, unit))[:p, :p]
    found = arms.covariance(arms.blocks(linear))
    scale = np.sqrt(np.diag(marginal))
    relative = (found - marginal) / np.outer(scale, scale)
    np.testing.assert_allclose(relative, 0.0, atol=1e-6)
    # and it counts
    without = replace(arms, deviation_rad=0.0)
    assert np.diag(without.covariance(without.blocks(linear)) / marginal).min() < 0.9


def drawn_errors(arms, J, functions, rng, trials, sizes=False):
    """Mean square errors of drawn arms, each measured and fitted with its own sizes."""
    p, L = arms.model.p, functions.reshape(-1, arms.model.p)
    _, gain = posterior_of(J, arms.model.prior)
    squares = np.empty(trials)
    for trial in range(trials):
        prior = arms.model.prior.copy()
        if sizes:
            for columns, size in arms.kinds:
                usual = prior[columns[0]] / np.exp(np.log(size.factor) ** 2)
                prior[columns] = usual * size.factor ** rng.standard_normal()
            _, gain = posterior_of(J, prior)
        held = np.isfinite(prior)
        x = np.where(held, prior, 1e-3) * rng.standard_normal(p)
        d = DEVIATION * rng.standard_normal((len(J), 6))
        read = J @ x + np.einsum("nmk,nk->nm", offsets_of(J), d) + rng.standard_normal(J.shape[:2])
        off = L @ (np.einsum("pnb,nb->p", gain, read) - x)
        squares[trial] = off @ off / len(functions)
    return squares


def test_the_error_to_expect_is_that_of_drawn_arms(arms, linear, functions):
    squares = drawn_errors(
        arms, linear.white_jacobian, functions, np.random.default_rng(1), trials=4000
    )
    expected = arms.expected_error(arms.blocks(linear), functions).rms_m ** 2
    standard_error = squares.std() / np.sqrt(len(squares))
    assert abs(squares.mean() - expected) < 5.0 * standard_error
    assert standard_error < 0.03 * expected


def test_eighty_per_cent_of_other_arms_are_in_the_range(arms, linear, functions):
    """Each has sizes of its own."""
    trials = 3000
    squares = drawn_errors(
        arms, linear.white_jacobian, functions, np.random.default_rng(2), trials, sizes=True
    )
    found = arms.expected_error(arms.blocks(linear), functions)
    assert found.share == SHARE == 0.8
    error = np.sqrt(squares)
    inside = np.mean((error >= found.low_m) & (error <= found.high_m))
    # of these arms, and of the 1,200 that the ends are quantiles of
    five = 5.0 * np.sqrt(0.8 * 0.2 * (1 / trials + 1 / 1200))
    assert inside == pytest.approx(0.8, abs=five)
    below = np.mean(error < found.low_m)
    assert below == pytest.approx(0.1, abs=5.0 * np.sqrt(0.09 * (1 / trials + 1 / 1200)))
    assert np.mean(error < found.median_m) == pytest.approx(
        0.5, abs=5.0 * np.sqrt(0.25 * (1 / trials + 1 / 1200))
    )
    assert found.low_m < found.median_m < found.high_m


def test_the_error_by_mean_squares_is_not_below_the_mean_over_sizes(arms, linear, functions):
    """The covariance after measuring is concave in the prior's."""
    L, rng = functions.reshape(-1, arms.model.p), np.random.default_rng(3)
    squares = []
    for _ in range(2000):
        prior = arms.model.prior.copy()
        for columns, size in arms.kinds:
            usual = prior[columns[0]] / np.exp(np.log(size.factor) ** 2)
            prior[columns] = usual * size.factor ** rng.standard_normal()
        C, _ = posterior_of(linear.white_jacobian, prior)
        squares.append(np.trace(L @ C @ L.T) / len(functions))
    mean, spread = np.mean(squares), np.std(squares) / np.sqrt(len(squares))
    rms = arms.expected_error(arms.blocks(linear), functions).rms_m
    assert mean + 5.0 * spread < rms**2


def same(found, expected):
    for name in ("rms_m", "low_m", "median_m", "high_m"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=1e-7), name


def test_the_order_of_parameters_and_poses_changes_nothing(
    arms, reference_robot, target_m, touching, functions
):
    q = touching(9)
    expected = arms.expected_error(arms.blocks(linear_of(arms, q)), functions)
    other = PriorArms.of(model_of(reference_robot, target_m, -1), USUAL, DEVIATION)
    assert other.model.names != arms.model.names
    assert sorted(other.model.names) == sorted(arms.model.names)
    moved = functions_of(other.model, reference_robot)
    same(other.expected_error(other.blocks(linear_of(other, q)), moved), expected)
    same(arms.expected_error(arms.blocks(linear_of(arms, q[::-1])), functions), expected)


def test_the_units_of_parameters_change_nothing(arms, linear, functions):
    """Columns by 1e-6 to 1e6: a micrometre or a megaradian is as good a unit as another."""
    unit = 10.0 ** np.random.default_rng(4).uniform(-6.0, 6.0, arms.model.p)
    model, blocks = arms.model, arms.blocks(linear)
    rescaled = SimpleNamespace(p=model.p, names=model.names, known_rows=model.known_rows * unit)
    other = replace(arms, model=rescaled)
    same(
        other.expected_error(blocks * unit, functions * unit),
        arms.expected_error(blocks, functions),
    )
    C, scale = arms.covariance(blocks), np.sqrt(np.diag(arms.covariance(blocks)))
    found = other.covariance(blocks * unit) * np.outer(unit, unit)
    np.testing.assert_allclose(
        found / np.outer(scale, scale), C / np.outer(scale, scale), atol=1e-7
    )
