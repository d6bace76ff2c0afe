"""ScoreTests of effects against dense algebra, and faults that have to be named."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.stats import multivariate_normal

from calib import Robot
from calib.identification.diagnosis import CHANCE, diagnose, likeliest
from calib.identification.effects import changes, incomplete, scales
from calib.identification.held import (
    Effect,
    Finding,
    Held,
    ScoreTests,
    Tuned,
    held_at,
    log_odds,
    tuned,
)
from calib.model import CalibrationModel, Setup, simulate
from calib.model.measurements import Measurements, Point, Pose
from calib.model.parameters import TargetFrame, ToolFrame, ToolPoint, ZeroOffsets
from calib.se3 import FloatArray, transform
from posedesign.identification.models import Models
from tests.fault_trials import Arm, draw_arm, table_of
from tests.positioners import beside_positioner


@pytest.fixture(scope="module")
def arm() -> Arm:
    """A small arm before a tracker."""
    return draw_arm("irb120", "point", np.random.default_rng(5), count=24)


@pytest.fixture(scope="module")
def model(arm) -> CalibrationModel:
    """What may be off in it."""
    return Models(arm.cell, table_of(arm, arm.measured(np.random.default_rng(6)))).of_arm()


@pytest.fixture(scope="module")
def found(arm, model) -> Tuned:
    """Its measurements, fitted."""
    solution = tuned(model, arm.measured(np.random.default_rng(6)))
    assert solution is not None
    return solution


@pytest.fixture(scope="module")
def held(found) -> Held:
    """The same without the noise and the priors that were found."""
    return found.held


def dense(held: Held) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Measurements over the noise, free of what nothing is known of; their covariance; the way."""
    p, prior = held.model.p, held.model.prior
    J = held.linear.white_jacobian.reshape(-1, p)
    y = J @ (held.x - held.model.nominal) - held.linear.white_rows.ravel()
    known = np.isfinite(prior)
    away = null_space(J[:, ~known].T)  # restricted likelihood: free parameters taken out
    V = np.eye(len(y)) + (J[:, known] * prior[known] ** 2) @ J[:, known].T
    return away.T @ y, away.T @ V @ away, away


def test_residuals_and_effects_are_those_of_the_whole_covariance(held):
    y, V, away = dense(held)
    inverse = away @ np.linalg.inv(V) @ away.T
    assert np.allclose(held.rows.ravel(), -inverse @ away @ y, atol=1e-6)
    assert held.squares == pytest.approx(y @ np.linalg.solve(V, y), rel=1e-6)
    Z = np.random.default_rng(1).standard_normal((*held.rows.shape, 2))
    assert np.allclose(held.without(Z).reshape(-1, 2), inverse @ Z.reshape(-1, 2), atol=1e-7)
    blocks = [inverse[3 * i : 3 * i + 3, 3 * i : 3 * i + 3] for i in range(len(held.rows))]
    assert np.allclose(held.blocks, blocks, atol=1e-7)


def test_odds_are_the_ratio_of_dense_marginal_likelihoods(found):
    """With noise and priors as they were, the gradient being nought there by the fit."""
    held = found.held
    y, V, away = dense(held)
    Z = np.random.default_rng(2).standard_normal((*held.rows.shape, 2))
    effect = Effect(changes(held)[0].effect().finding, Z, 0.5, np.zeros(2), 0.0)
    flat = away.T @ Z.reshape(-1, 2)
    wider = multivariate_normal(np.zeros(len(y)), V + 0.25 * flat @ flat.T).logpdf(y)
    fixed = float(wider - multivariate_normal(np.zeros(len(y)), V).logpdf(y))
    best = log_odds(found, effect)
    assert fixed - 1e-6 < best < fixed + 1.0  # found again, they can only be likelier


def test_steps_at_all_places_are_those_one_by_one(held, monkeypatch):
    """Also in another order of the poses, where all that parameters take up is looked at."""
    monkeypatch.setattr("calib.identification.held.MOST_TAKEN", 1000)
    assert {tried.thing.part for tried in changes(held)} >= {"tool", "instrument", "joint"}
    every = np.zeros(1, dtype=np.intp)
    order = np.random.default_rng(4).permutation(24)
    for tried in changes(held):
        if tried.cause != "step" or tried.thing.part == "payload":
            continue
        tests = tried.tests
        assert tests.starts.tolist() == list(range(3, 22))
        one_by_one, reordered = [], []
        for start in tests.starts:
            after = (np.arange(24) >= start).astype(float)
            for course, out in ((after, one_by_one), (after[np.argsort(order)], reordered)):
                alone = ScoreTests(held, tests.columns, course, every)
                out.append(alone.odds_of_all(held.rows[..., None])[0])
        mean = np.logaddexp.reduce(one_by_one) - np.log(19.0)
        assert tried.log_odds == pytest.approx(mean - tried.tried, abs=1e-6)
        orders = np.array([np.arange(24), order])
        mean = [mean, np.logaddexp.reduce(reordered) - np.log(19.0)]
        assert np.allclose(tests.odds_in_orders(orders), mean, atol=1e-6)


def faults(arm: Arm) -> Iterator[tuple[str, tuple[int, ...], FloatArray, FloatArray]]:
    """Cause, rows, postures and readings of one fault each."""
    data = arm.measured(np.random.default_rng(6))
    q, read = data.postures, np.array(data.observed)
    yield "none", (), q, read
    yield "step", (11,), q, read + 1e-3 * (np.arange(24) >= 11)[:, None] * [1.0, -0.5, 0.2]
    yield "scale", (), q, read * 1.01
    yield "mirrored axis", (), q, read * [1.0, -1.0, 1.0]
    order = np.arange(24)
    order[[3, 17]] = 17, 3
    yield "swapped rows", (3, 17), q, read[order]
    coupled = q.copy()
    coupled[:, 2] -= q[:, 1]
    yield "coupling", (), coupled, read
    turned = q.copy()
    turned[:, 2] = -turned[:, 2]
    yield "sign", (), turned, read
    mistyped = q.copy()
    mistyped[7, 3] += 0.1
    yield "mistyped joint", (7,), mistyped, read
    geared = q.copy()
    geared[:, 2] -= 0.02 * q[:, 1]
    yield "coupled joints", (), geared, read
    yield "joint unit", (), 10.0 * q, read


@pytest.mark.parametrize("index", range(10))
def test_faults_are_named(arm, model, index):
    cause, rows, q, read = list(faults(arm))[index]
    data = replace(arm.measured(np.random.default_rng(6)), postures=q, observed=read)
    named = diagnose(model, data)
    assert [f.cause for f in named] == ([] if cause == "none" else [cause])
    for finding in named:
        assert finding.rows == rows
        assert finding.log_odds > 10.0
        assert not finding.also
        if cause == "coupled joints":
            assert finding.things == ("joint_3", "joint_2")
            assert finding.size == pytest.approx(0.02, abs=1e-3)
        if cause == "scale":
            assert finding.size == pytest.approx(0.01, abs=1e-3)
        if cause == "step":
            assert finding.size == pytest.approx(1.136e-3, rel=0.1)
            assert finding.part == "instrument"


def test_hypotheses_that_explain_as_well_count_together():
    def finding(cause, share):
        odds = float(np.log(share / CHANCE))
        return Finding(cause, ("tool",), "tool", (), 1e-4, "m", 1e-4, 5e-5, odds)

    assert likeliest([]) == ()
    assert likeliest([finding("drift", 0.9)]) == ()
    assert likeliest([finding("drift", 0.2), finding("step", 0.3)]) == ()
    (best,) = likeliest([finding("drift", 0.5), finding("warm-up", 0.6)])
    assert best.cause == "warm-up"
    assert [other.cause for other in best.also] == ["drift"]


def test_an_arm_beside_a_positioner_bends_towards_the_floor(tmp_path):
    """Down is that of the floor, which turns in the base, and reach is from the arm's foot."""
    path = tmp_path / "robot.urdf"
    path.write_text(beside_positioner("ur10e"))
    robot = Robot.from_urdf(path, tip=Robot.preset("ur10e").tip_frame, base="plate")
    offsets, fixed = ZeroOffsets(robot, robot.arm_joints[2:4]), TargetFrame(np.eye(4), free=())
    tool = ToolPoint([0.04, 0.01, 0.12], "xyz")
    model = CalibrationModel(robot, [fixed, offsets, tool], Point(1e-5))
    q = np.random.default_rng(2).uniform(-1.5, 1.5, (40, robot.n))
    state = robot.state(q)
    points = state.point(model.nominal[-3:])
    up = robot.T_base_floor(q)[:, :3, :3] @ (-robot.gravity / np.linalg.norm(robot.gravity))
    out = points - state.origins[:, robot.n_external]
    out -= up * (out * up).sum(axis=1, keepdims=True)
    reach = np.linalg.norm(out, axis=1, keepdims=True)
    read = points - 2e-3 * (reach / reach.max()) ** 2 * up
    data = Measurements(q, Setup.of(len(q)), model.targets, observed=read)
    bent = incomplete(held_at(model, data, model.nominal))[-1].effect().finding
    assert bent.cause == "reach"
    assert bent.size == pytest.approx(2e-3, rel=0.02)
    assert bent.after_m < 0.02 * bent.before_m


PAN_TILT = """<robot name="pan_tilt">
<link name="base"/><link name="k1"/><link name="k2"/><link name="tip"/>
<joint name="a" type="revolute"><origin xyz="0 0 0.3"/><parent link="base"/><child link="k1"/>
<axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<joint name="b" type="revolute"><origin xyz="0 0 0"/><parent link="k1"/><child link="k2"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="c" type="fixed"><origin xyz="0 0 0.1"/><parent link="k2"/><child link="tip"/></joint>
</robot>"""


@pytest.mark.parametrize("kind", [Point(3e-5), Pose([3e-4] * 3 + [1e-3] * 3)])
def test_a_scale_is_not_found_where_no_length_is_seen(tmp_path, kind):
    """The axes meet: tool and frame of the instrument grow with the readings, whatever these are.

    Neither a scale, which would explain noise by noise, nor another unit.
    """
    path = tmp_path / "robot.urdf"
    path.write_text(PAN_TILT)
    robot = Robot.from_urdf(path, tip="tip")
    tool = transform(np.eye(3), np.array([0.05, 0.03, 0.1]))
    on_tool = ToolFrame(tool) if kind.turns else ToolPoint(tool[:3, 3])
    there = TargetFrame(transform(np.eye(3), np.array([2.0, -1.0, 0.7])))
    offsets = ZeroOffsets(robot, robot.joint_names, 0.01)
    model = CalibrationModel(robot, [offsets, on_tool, there], kind)
    rng = np.random.default_rng(2)
    q = rng.uniform(robot.lower, robot.upper, (40, 2))
    data = simulate(model, model.nominal, q, rng)
    (scale,) = scales(held_at(model, data, model.nominal))
    assert scale.log_odds == -np.inf
    named = diagnose(model, data)
    assert not {f.cause for first in named for f in (first, *first.also)} & {
        "scale",
        "reading unit",
    }


def in_poses(arm: Arm, each: int) -> Measurements:
    """The measurements of an arm, so many in a row as readings of one pose: of several marks."""
    data = arm.measured(np.random.default_rng(6))
    names = tuple(f"P{i // each:02d}" for i in range(data.count))
    q = data.postures[np.arange(data.count) // each * each]
    read = simulate(arm.truth, arm.x, q, np.random.default_rng(7), setup=arm.setup).observed
    return Measurements(q, data.setup, data.targets, data.tools, read, names)


@pytest.mark.parametrize("fault", ["shifted rows", "swapped rows"])
def test_whole_poses_are_put_right(arm, model, fault):
    """Three readings a pose: joints that stand one pose off, and poses that were exchanged."""
    data = in_poses(arm, 2)
    q, read = data.postures, np.array(data.observed)
    if fault == "shifted rows":
        q = np.roll(q, 2, axis=0)
    else:
        read[[4, 5, 18, 19]] = read[[18, 19, 4, 5]]
    (named,) = diagnose(model, replace(data, postures=q, observed=read))
    assert named.cause == fault
    assert named.rows == ((4, 18) if fault == "swapped rows" else ())
    assert named.grade == "not to be trusted"


def test_one_pose_that_is_off_is_no_step(arm, model):
    """Its readings are off together, at the end of the measurements."""
    data = in_poses(arm, 3)
    read = np.array(data.observed)
    read[-3:] += [1e-3, -5e-4, 2e-4]
    assert not {f.cause for f in diagnose(model, replace(data, observed=read))} & {"step", "drift"}
