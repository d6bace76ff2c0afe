"""What a correction can carry, against arms drawn and a search that knows no derivatives."""

import numpy as np
import pytest
from scipy.optimize import minimize

from calib import CalibrationModel, Robot
from calib.errors import InputError
from calib.identification import Carried, part_of
from calib.identification.prediction import ALIKE, Expectation, rigid_motions
from calib.identification.result import SIZES
from calib.model.measurements import TouchUp
from calib.model.parameters import (
    JointCompliance,
    JointHarmonics,
    LinkGeometry,
    ParameterBlock,
    Payload,
    TargetPoints,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import FloatArray, rotation_exp

SIZE = {"m": 5e-4, "rad": 1.5e-3, "rad/Nm": 3e-7, "rad/rad": 1e-3}
"""Of the errors of the arms."""

LOAD = [Payload(100.0, np.array([0.1, 0.0, 0.2]))]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return Robot.preset("r2000ic165f")


def model_of(robot: Robot, *blocks: ParameterBlock) -> CalibrationModel:
    tool, target = ToolPoint([0.2, -0.05, 0.35]), TargetPoints([[1.9, 0.05, 0.5]])
    return CalibrationModel(robot, [*blocks, tool, target], TouchUp(1e-5))


def whole(robot: Robot) -> CalibrationModel:
    joints = robot.joint_names
    return model_of(
        robot,
        ZeroOffsets(robot, joints),
        LinkGeometry(robot),
        JointCompliance(robot, joints, LOAD),
        JointHarmonics(robot, joints, (1.0,), 1e-4),
    )


def postures(robot: Robot, count: int = 40) -> FloatArray:
    base = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
    return np.asarray(base + np.random.default_rng(3).uniform(-0.4, 0.4, (count, robot.n)))


def errors_of(model: CalibrationModel, scale: float = 1.0) -> FloatArray:
    return scale * np.array([SIZE[unit] for unit in model.units]) * ~model.nuisance


def identified(model: CalibrationModel, seed: int = 0) -> tuple[FloatArray, FloatArray]:
    """Mean and covariance, of a third of the errors' size and correlated, as after measuring."""
    rng = np.random.default_rng(seed)
    size = errors_of(model) + model.nuisance * 2e-4
    x = model.nominal + size * rng.standard_normal(model.p)
    mixed = rng.standard_normal((model.p, model.p)) / np.sqrt(model.p)
    root = 0.3 * size[:, None] * (0.7 * mixed + 0.3 * np.eye(model.p))
    return x, root @ root.T


def base_anew(points: FloatArray, wanted: FloatArray) -> FloatArray:
    """Distances after the rigid motion that fits points best to those wanted: Kabsch's SVD."""
    a, b = points - points.mean(axis=0), wanted - wanted.mean(axis=0)
    U, _, Vt = np.linalg.svd(a.T @ b)
    turn = Vt.T @ np.diag([1.0, 1.0, np.linalg.det(Vt.T @ U.T)]) @ U.T
    return np.asarray(a @ turn.T - b)


def lost2(expectation: Expectation, model: CalibrationModel, x: FloatArray) -> float:
    """Mean square of what a correction does not carry, by Kabsch [m²]."""
    view = model.view(expectation.q, x)
    off = base_anew(view.tool_points, expectation.points)
    return float(np.mean(np.sum(off**2, axis=1)))


@pytest.fixture(scope="module")
def expectation(robot) -> Expectation:
    model = whole(robot)
    x, covariance = identified(model)
    return Expectation(model, x, covariance, postures(robot))


def corrections(robot: Robot, expectation: Expectation) -> dict[str, Carried]:
    joints = robot.joint_names[1:]
    offsets = model_of(robot, ZeroOffsets(robot, joints))
    chain = model_of(robot, ZeroOffsets(robot, joints), LinkGeometry(robot))
    as_it_is = model_of(robot)
    every = expectation.model
    return {
        "as it is": part_of(every, expectation.x, expectation.covariance, as_it_is),
        "offsets as identified": part_of(every, expectation.x, expectation.covariance, offsets),
        "offsets": expectation.carried(offsets, ~offsets.nuisance),
        "chain": expectation.carried(chain, ~chain.nuisance),
        "all": Carried(every, expectation.x, expectation.covariance),
    }


def test_expected_error_is_that_of_arms_drawn(robot, expectation):
    model, q = expectation.model, expectation.q
    rng, draws = np.random.default_rng(1), 400
    drawn = rng.multivariate_normal(expectation.x, expectation.covariance, draws, method="eigh")
    real = model.view(np.broadcast_to(q, (draws, *q.shape)), drawn).tool_points
    for name, own in corrections(robot, expectation).items():
        taken = own.model.view(q, own.x).tool_points
        squares = np.array(
            [np.mean(np.sum(base_anew(points, taken) ** 2, axis=1)) for points in real]
        )
        chance = squares.std(ddof=1) / np.sqrt(draws)
        expected = expectation.of(own.model, own.x).rms_m ** 2
        assert abs(squares.mean() - expected) < 4.0 * chance + 0.01 * expected, name


def test_the_best_values_are_those_of_a_search(robot, expectation):
    """By simplex, which knows no derivatives, from another start."""
    model = model_of(robot, ZeroOffsets(robot, robot.joint_names[1:4]))
    own = expectation.carried(model, ~model.nuisance)
    unknown2 = float(np.mean(expectation.of(model, own.x).unknown_m ** 2))
    tool_and_target = own.x[3:]

    def cost(milliradians: FloatArray) -> float:
        x = np.concatenate([1e-3 * milliradians, tool_and_target])
        return 1e12 * lost2(expectation, model, x)

    found = minimize(
        cost, [3.0, -3.0, 3.0], method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-3}
    )
    least = found.fun / 1e12
    ours = lost2(expectation, model, own.x)
    start = part_of(expectation.model, expectation.x, expectation.covariance, model)
    assert ours < 0.9 * lost2(expectation, model, start.x)
    assert least * (1 - 1e-3) < ours < least + 1.01 * ALIKE * (least + unknown2)


def test_values_that_are_alike_are_the_ones_nearest_to_those_identified(robot, expectation):
    model = model_of(robot, ZeroOffsets(robot, robot.joint_names[1:]), LinkGeometry(robot))
    own = expectation.carried(model, ~model.nuisance)
    start = part_of(expectation.model, expectation.x, expectation.covariance, model)
    far = np.abs(own.x - start.x) / [SIZES[unit].natural for unit in model.units]
    # the very best values, all combinations free, are far away and hardly better
    free = ~model.nuisance
    x = start.x.copy()
    for _ in range(5):
        off, R = expectation.displaced(model, x)
        J = expectation._moved(model, x, R)[:, free]
        x[free] += np.linalg.pinv(J, rcond=1e-9) @ off
    best = expectation.of(model, x).rms_m
    assert expectation.of(model, own.x).rms_m < (1.0 + ALIKE) * best
    assert far.max() < 5.0
    assert (np.abs(x - start.x) / [SIZES[unit].natural for unit in model.units]).max() > 10.0


def test_more_parameters_leave_less(robot, expectation):
    rms = {
        name: expectation.of(own.model, own.x).rms_m
        for name, own in corrections(robot, expectation).items()
    }
    assert list(rms) == sorted(rms, key=lambda name: -rms[name])
    assert expectation.of(expectation.model, expectation.x).lost_rms_m < 1e-14


@pytest.mark.slow
def test_sigma_of_the_best_values_is_their_scatter(robot):
    """Over identifications that scatter as their covariance says."""
    model, q = whole(robot), postures(robot)
    x, covariance = identified(model)
    offsets = model_of(robot, ZeroOffsets(robot, robot.joint_names[1:5]))
    free, rng = ~offsets.nuisance, np.random.default_rng(2)
    own = Expectation(model, x, covariance, q).carried(offsets, free)
    found = []
    for drawn in rng.multivariate_normal(x, covariance, 120, method="eigh"):
        found.append(Expectation(model, drawn, covariance, q).carried(offsets, free).x)
    ratio = np.std(found, axis=0, ddof=1)[free] / np.sqrt(np.diag(own.covariance))[free]
    # a standard deviation of 120 draws is known to 6.5 per cent
    np.testing.assert_allclose(ratio, 1.0, atol=4 * 0.065)


def test_what_a_correction_holds_stays_as_identified(robot):
    model = model_of(robot, ZeroOffsets(robot, robot.joint_names[1:]))
    x, covariance = identified(model)
    expectation = Expectation(model, x, covariance, postures(robot))
    chain = model_of(robot, ZeroOffsets(robot, robot.joint_names[1:]), LinkGeometry(robot))
    own = expectation.carried(chain, ~chain.nuisance)
    np.testing.assert_array_equal(own.x[: robot.n - 1], x[: robot.n - 1])
    assert expectation.of(chain, own.x).lost_rms_m < 1e-12
    np.testing.assert_allclose(
        own.covariance[: robot.n - 1, : robot.n - 1], covariance[: robot.n - 1, : robot.n - 1]
    )


def test_a_base_that_stands_elsewhere_is_no_error(robot):
    """Neither for what is known of it, nor for what is not."""
    first = LinkGeometry(robot, [f"link.{robot.joint_names[0]}.{a}" for a in ("x", "z", "rx")])
    model = model_of(robot, first)
    x = model.nominal.copy()
    x[:3] = [2e-2, -3e-2, 1e-2]
    covariance = np.diag([1e-6, 1e-6, 1e-6] + [0.0] * (model.p - 3))
    expectation = Expectation(model, x, covariance, postures(robot))
    unmoved = expectation.of(model, model.nominal)
    assert unmoved.unknown_m.max() < 1e-9
    assert unmoved.lost_rms_m < 1e-12


def test_rigid_motions_are_orthonormal_and_of_a_body():
    rng = np.random.default_rng(0)
    points = rng.standard_normal((7, 3))
    U = rigid_motions(points)
    np.testing.assert_allclose(U.T @ U, np.eye(6), atol=1e-12)
    small = 1e-7 * rng.standard_normal(3)
    moved = points @ rotation_exp(small).T + 1e-7 - points
    np.testing.assert_allclose(U @ (U.T @ moved.ravel()), moved.ravel(), atol=1e-12)
    line = np.outer(np.arange(4.0), [1.0, 2.0, 3.0])
    assert rigid_motions(line).shape == (12, 5)
    assert rigid_motions(points[:1]).shape == (3, 3)


def test_a_covariance_that_is_none_is_refused(robot):
    model = model_of(robot, ZeroOffsets(robot, robot.joint_names[1:]))
    for bad in (np.eye(3), np.full((model.p, model.p), np.nan)):
        with pytest.raises(InputError, match=r"11 parameters|is not finite"):
            Expectation(model, model.nominal, bad, postures(robot))
