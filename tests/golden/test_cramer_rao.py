"""The covariance that a plan promises is the scatter of what is identified: for every model.

Scatter of simulated identifications over the Cramér-Rao bound, parameter by parameter. ``-s``
prints the ratios.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest
from scipy.stats import chi2

from calib import CalibrationModel, Robot
from calib.identification import covariance_of, identify_batch
from calib.identification.identifiability import sort_out
from calib.model import Setup, simulate, touch
from calib.model.measurements import Distance, PlaneContact, Point, Pose, TouchUp
from calib.model.parameters import (
    JointCompliance,
    JointHarmonics,
    JointScale,
    LengthOffsets,
    LinkGeometry,
    ParameterBlock,
    Payload,
    TargetFrame,
    TargetPlane,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ToolPoints,
    ZeroOffsets,
)
from calib.se3 import apply, rotation_exp, transform
from tests.marks import rest_in_full

CHANCE = 1e-4
"""Probability that a right covariance fails a test of all parameters."""

BAR = (0.97, 1.03)
FEW, MANY = 1_000, 16_000
"""Trials: 16,000 leave 0.56 % of sampling in a standard deviation, of which the bar is five."""

TOOL_M = np.array([0.2, -0.05, 0.35])
T_TOOL = transform(rotation_exp([0.1, 0.2, -0.1]), TOOL_M)
T_TRACKER = transform(rotation_exp([0.2, -0.1, 2.0]), [2.0, -1.0, 0.5])
HOME = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
CAMERA = np.array([0.02, 0.02, 0.12]) / 3e3
SIX = [2e-5, 2e-5, 3e-5, 1e-4, 1e-4, 2e-4]
SIZES = {"rad": 2e-3, "m": 1e-3, "rad/Nm": 3e-7, "rad/rad": 1e-4}
"""Of the errors that are simulated."""


@dataclass(frozen=True, eq=False)
class Case:
    """A model, and postures and set-up of what is measured."""

    model: CalibrationModel
    q: np.ndarray
    setup: Setup


def robot() -> Robot:
    return Robot.preset("r2000ic165f")


def target_m() -> np.ndarray:
    return apply(robot().fk(HOME), TOOL_M)


def touching(count: int, seed: int, shift=(0.0, 0.0, 0.0), tilt: float = 0.7) -> np.ndarray:
    """Postures with the tool point on a target and the tool tilted at random."""
    arm, rng, found = robot(), np.random.default_rng(seed), []
    R_home = arm.fk(HOME)[:3, :3]
    while len(found) < count:
        R = R_home @ rotation_exp(rng.uniform(-tilt, tilt, 3))
        pose = transform(R, target_m() + np.asarray(shift) - R @ TOOL_M)
        q, ok = arm.inverse(pose[None], near=HOME).nearest()
        if ok[0]:
            found.append(q[0])
    return np.array(found)


def wide(count: int, seed: int = 0) -> np.ndarray:
    return HOME + np.random.default_rng(seed).uniform(-1.0, 1.0, (count, 6))


def identifiable(
    model: CalibrationModel, links: LinkGeometry, q: np.ndarray, setup: Setup
) -> list[ParameterBlock]:
    """The blocks with only those link parameters that the measurements can tell apart."""
    J = model.linearise(q, setup=setup).white_jacobian.reshape(-1, model.p)
    largest = np.where(np.isin(model.units, ["m"]), 2e-3, 5e-3)
    found = sort_out(J, model.names, first=model.nuisance, least=1.0 / largest)
    kept = [model.names[k] for k in found.kept]
    freed = LinkGeometry(model.robot, [name for name in links.names if name in kept])
    return [freed if block is links else block for block in model.parameters]


def offsets() -> Case:
    arm = robot()
    blocks = [ZeroOffsets(arm, arm.joint_names[1:5]), ToolPoint(TOOL_M), TargetPoints(target_m())]
    return Case(CalibrationModel(arm, blocks, TouchUp(CAMERA)), touching(27, 0), Setup.of(27))


def two_payloads() -> Case:
    arm = robot()
    loads = [Payload(165.0, np.array([0.1, 0.0, 0.2])), Payload(20.0, np.array([0.0, 0.0, 0.1]))]
    blocks = [
        ZeroOffsets(arm, arm.joint_names[1:5]),
        JointCompliance(arm, arm.joint_names[1:4], loads),
        ToolPoint(TOOL_M),
        TargetPoints(target_m()),
    ]
    model = CalibrationModel(arm, blocks, TouchUp(CAMERA))
    return Case(model, touching(40, 1), Setup.of(40, payload=np.arange(40) % 2))


def harmonics_and_scale() -> Case:
    arm = robot()
    blocks = [
        ZeroOffsets(arm, arm.joint_names[1:5]),
        JointScale(arm, arm.joint_names[:5]),
        JointHarmonics(arm, arm.joint_names[1:4], [2, 17]),
        ToolPoint(TOOL_M),
        TargetFrame(T_TRACKER),
    ]
    return Case(CalibrationModel(arm, blocks, Point([2e-5, 2e-5, 3e-5])), wide(60), Setup.of(60))


def geometry_by_touch_ups() -> Case:
    arm = robot()
    shifts = np.array([[0, 0, 0], [0, 0.4, 0.4], [0.3, -0.4, 0.3]])
    q = np.concatenate([touching(16, k, shift=s, tilt=0.9) for k, s in enumerate(shifts)])
    setup = Setup.of(48, target=np.repeat([0, 1, 2], 16))
    places = TargetPoints(target_m() + shifts, ["A", "B", "C"], free=False)
    links = LinkGeometry(arm)
    model = CalibrationModel(arm, [links, ToolPoint(TOOL_M), places], TouchUp(CAMERA))
    return Case(model.with_parameters(identifiable(model, links, q, setup)), q, setup)


def geometry_by_points() -> Case:
    arm, names = robot(), ["A", "B", "C"]
    reflectors = np.add(TOOL_M, [[0.0, 0.0, 0.0], [0.15, 0.0, -0.05], [0.0, 0.2, 0.05]])
    links = LinkGeometry(arm)
    blocks = [links, ToolPoints(reflectors, names), TargetFrame(T_TRACKER)]
    model = CalibrationModel(arm, blocks, Point([2e-5, 2e-5, 3e-5]))
    setup = Setup.of(60, tool=np.arange(60) % 3)
    q = wide(60, 2)
    return Case(model.with_parameters(identifiable(model, links, q, setup)), q, setup)


def geometry_by_poses() -> Case:
    arm = robot()
    links = LinkGeometry(arm)
    blocks = [JointScale(arm, arm.joint_names), links, ToolFrame(T_TOOL), TargetFrame(T_TRACKER)]
    model = CalibrationModel(arm, blocks, Pose(SIX))
    q, setup = wide(40, 3), Setup.of(40)
    return Case(model.with_parameters(identifiable(model, links, q, setup)), q, setup)


def distances() -> Case:
    arm, names = robot(), ["left", "right"]
    anchors = TargetPoints([[1.2, -1.8, 0.2], [1.5, 1.6, -0.1]], names)
    blocks = [ZeroOffsets(arm, arm.joint_names[1:5]), ToolPoint(TOOL_M), anchors]
    model = CalibrationModel(arm, [*blocks, LengthOffsets(names)], Distance(2e-5))
    return Case(model, wide(60, 4), Setup.of(60, target=np.arange(60) % 2))


def plane() -> Case:
    arm = robot()
    surface = TargetPlane(target_m(), [0.1, -0.05, 1.0])
    blocks = [ZeroOffsets(arm, arm.joint_names[1:5]), ToolPoint(TOOL_M), surface]
    model = CalibrationModel(arm, blocks, PlaneContact(1e-5))
    rng = np.random.default_rng(5)
    shifts = rng.uniform(-0.4, 0.4, (50, 3)) * [1, 1, 0]
    q = np.concatenate([touching(1, k, shift=s) for k, s in enumerate(shifts)])
    return Case(model, touch(model, q, model.nominal)[0], Setup.of(50))


def mixed() -> Case:
    """Touch-ups of a pin, poses by a tracker, distances by a wire, in turn."""
    arm = robot()
    blocks = [
        ZeroOffsets(arm, arm.joint_names[1:5]),
        JointScale(arm, arm.joint_names[1:3]),
        ToolFrame(T_TOOL),
        TargetFrame(T_TRACKER),
        TargetPoints([target_m(), [1.2, -1.8, 0.2]], ["pin", "wire"]),
    ]
    kinds = [TouchUp(CAMERA), Pose(SIX), Distance(4e-5)]
    kind = np.arange(60) % 3
    q = wide(60, 6)
    q[kind == 0] = touching(20, 7)
    setup = Setup.of(60, kind=kind, target=np.array([1, 0, 2])[kind])
    return Case(CalibrationModel(arm, blocks, kinds), q, setup)


CASES: dict[str, tuple[Callable[[], Case], int]] = {
    "offsets": (offsets, 10),
    "two payloads": (two_payloads, 13),
    "harmonics and scale": (harmonics_and_scale, 30),
    "geometry by touch-ups": (geometry_by_touch_ups, 27),
    "geometry by points": (geometry_by_points, 33),
    "geometry by poses": (geometry_by_poses, 36),
    "distances": (distances, 15),
    "plane": (plane, 10),
    "mixed kinds": (mixed, 24),
}
"""Each with its number of parameters."""


LONG = ("two payloads", "geometry by touch-ups", "plane", "mixed kinds")
"""Seconds each: their arms are moved until they touch, draw by draw."""


@pytest.fixture(params=[pytest.param(k, marks=pytest.mark.slow) if k in LONG else k for k in CASES])
def case(request) -> Case:
    make, parameters = CASES[request.param]
    found = make()
    assert found.model.p == parameters
    return found


def scatter(case: Case, trials: int) -> tuple[np.ndarray, np.ndarray]:
    """Errors ``(trials, p)`` of what is identified, and their covariance as promised."""
    model = case.model
    rng = np.random.default_rng(11)
    size = np.array([SIZES[unit] for unit in model.units])
    x = model.nominal + size * rng.uniform(-1, 1, model.p)
    data = simulate(model, x, case.q, rng, trials=trials, setup=case.setup)
    clean = simulate(model, x, case.q, setup=case.setup)
    return identify_batch(model, data) - x, covariance_of(model, clean.postures, x, case.setup)


def ratios(case: Case, trials: int) -> np.ndarray:
    error, covariance = scatter(case, trials)
    assert np.isfinite(error).all()
    found = np.std(error, axis=0, ddof=1) / np.sqrt(np.diag(covariance))
    rms = np.sqrt(np.mean(found**2))
    print(f"\n{case.model.p} parameters: {found.min():.4f} to {found.max():.4f}, rms {rms:.4f}")
    return found


@pytest.mark.slow
def test_scatter_is_the_bound(case):
    """Within what these draws tell: each parameter, its mean, and all of them together (NEES)."""
    error, covariance = scatter(case, FEW)
    p = case.model.p
    sigma = np.sqrt(np.diag(covariance))
    tail = CHANCE / p / 2
    low, high = np.sqrt(chi2.ppf([tail, 1 - tail], FEW - 1) / (FEW - 1))
    ratio = np.std(error, axis=0, ddof=1) / sigma
    assert (low < ratio).all()
    assert (ratio < high).all()
    assert (np.abs(error.mean(axis=0)) < 5 * sigma / np.sqrt(FEW)).all()
    scaled, correlation = error / sigma, covariance / np.outer(sigma, sigma)
    nees = np.einsum("ti,ij,tj->t", scaled, np.linalg.inv(correlation), scaled)
    low, high = chi2.ppf([CHANCE / 2, 1 - CHANCE / 2], FEW * p) / FEW
    assert low < nees.mean() < high


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", rest_in_full(CASES, ("distances", "harmonics and scale")), indirect=True
)
def test_every_parameter_is_within_three_hundredths_of_the_bound(case):
    found = ratios(case, MANY)
    assert BAR[0] < found.min()
    assert found.max() < BAR[1]
