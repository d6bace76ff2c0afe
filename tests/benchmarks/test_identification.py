"""How fast identification is. Run with ``make bench``; bars are for one core (OMP_NUM_THREADS=1).

Absolute times depend on the machine; ratios are of one run.
"""

import time
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from scipy.optimize import least_squares

from calib import CalibrationModel, Robot, identify
from calib.identification import identify_batch
from calib.identification.identifiability import sort_out
from calib.model import Linearisation, simulate
from calib.model.measurements import Measurements, Pose, TouchUp
from calib.model.parameters import (
    LinkGeometry,
    TargetFrame,
    TargetPoints,
    ToolFrame,
    ToolPoint,
    ZeroOffsets,
)
from calib.se3 import apply, rotation_exp, transform

TOOL_M = np.array([0.2, -0.05, 0.35])
HOME = np.deg2rad([0.0, 15.0, -25.0, 0.0, -50.0, 0.0])
ONE_BY_ONE = 60
"""Identifications by scipy, which takes some 10 ms for each."""


def fastest(call: Callable[[], object], rounds: int = 5) -> float:
    """Seconds of the fastest round."""
    times = []
    for _ in range(rounds):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return min(times)


@lru_cache(maxsize=1)
def thirty_parameters() -> tuple[CalibrationModel, Measurements]:
    """A UR10e, 23 full poses, and the 30 parameters of frames and links that can be told apart."""
    robot = Robot.preset("ur10e")
    rng = np.random.default_rng(0)
    frames = [
        ToolFrame(transform(rotation_exp([0.1, 0.2, -0.1]), [0.05, 0.0, 0.15])),
        TargetFrame(transform(rotation_exp([0.2, -0.1, 2.0]), [1.5, -1.0, 0.5])),
    ]
    kind = Pose([2e-5] * 3 + [1e-4] * 3)
    q = rng.uniform(-1.5, 1.5, (23, 6))
    full = CalibrationModel(robot, [*frames, LinkGeometry(robot)], kind)
    kept = sort_out(full.jacobian(q).reshape(-1, full.p), full.names, first=full.nuisance).kept
    links = [full.names[k] for k in kept if full.names[k].startswith("link.")]
    model = CalibrationModel(robot, [*frames, LinkGeometry(robot, links[:18])], kind)
    assert model.p == 30
    x = model.nominal + rng.uniform(-1e-3, 1e-3, model.p)
    return model, simulate(model, x, q, rng)


@lru_cache(maxsize=4)
def ten_parameters(poses: int = 27, trials: int = 2000) -> tuple[CalibrationModel, Measurements]:
    """The reference model: touch-ups with a tool tilted at random."""
    robot = Robot.preset("r2000ic165f")
    rng = np.random.default_rng(0)
    target = apply(robot.fk(HOME), TOOL_M)
    R_home, found = robot.fk(HOME)[:3, :3], []
    while len(found) < poses:
        R = R_home @ rotation_exp(rng.uniform(-0.6, 0.6, 3))
        q, ok = robot.inverse(transform(R, target - R @ TOOL_M)[None], near=HOME).nearest()
        if ok[0]:
            found.append(q[0])
    blocks = [ZeroOffsets(robot, robot.joint_names[1:5]), ToolPoint(TOOL_M), TargetPoints([target])]
    model = CalibrationModel(robot, blocks, TouchUp(np.array([0.02, 0.02, 0.12]) / 3e3))
    x = model.nominal + np.r_[np.deg2rad([0.2, -0.3, 0.15, -0.25]), rng.uniform(-3e-3, 3e-3, 6)]
    return model, simulate(model, x, np.array(found), rng, trials=trials)


def test_thirty_parameters_from_23_poses(benchmark):
    """The whole of identify. To be at most 10 ms."""
    model, data = thirty_parameters()
    result = benchmark(identify, model, data)
    assert result.explains_data


def test_monte_carlo_against_scipy_one_by_one(benchmark, capsys):
    """At least 5,000 a second on one core, and 30 times scipy with the same model and Jacobian."""
    model, data = ten_parameters()
    found = benchmark.pedantic(identify_batch, args=(model, data), rounds=5, warmup_rounds=1)

    def by_scipy(trial: int) -> np.ndarray:
        q = data.postures[trial]

        @lru_cache(maxsize=2)  # rows and Jacobian of the same parameters are asked for in turn
        def linear(x: tuple[float, ...]) -> Linearisation:
            return model.linearise(q, np.array(x))

        solved = least_squares(
            lambda x: linear(tuple(x)).white_rows.ravel(),
            model.nominal,
            lambda x: linear(tuple(x)).white_jacobian.reshape(-1, model.p),
            method="lm",
            x_scale="jac",
            xtol=1e-10,
            ftol=1e-10,
        )
        return np.asarray(solved.x)

    start = time.perf_counter()
    alone = np.array([by_scipy(trial) for trial in range(ONE_BY_ONE)])
    each = (time.perf_counter() - start) / ONE_BY_ONE
    np.testing.assert_allclose(found[:ONE_BY_ONE], alone, atol=1e-6)
    together = fastest(lambda: identify_batch(model, data)) / len(data.postures)
    with capsys.disabled():
        print(
            f"\n{1 / together:.0f} identifications a second; scipy one by one {1 / each:.0f}: "
            f"{each / together:.0f} times"
        )
    benchmark.extra_info["times scipy"] = each / together
    assert each / together > 30


@pytest.mark.parametrize("what", ["postures", "trials"])
def test_cost_grows_linearly(benchmark, capsys, what):
    """Four times the work takes about four times as long."""
    model, data = ten_parameters()
    order = np.tile(np.arange(data.count), 4)
    more = data[order] if what == "postures" else data.trials(np.tile(np.arange(2000), 4))
    benchmark.pedantic(identify_batch, args=(model, more), rounds=3, warmup_rounds=1)
    once, four = (fastest(lambda d=d: identify_batch(model, d), 3) for d in (data, more))
    with capsys.disabled():
        print(f"\n4 times the {what}: {four / once:.2f} times as long")
    benchmark.extra_info["time ratio for 4x"] = four / once
    assert four / once < 5.0
