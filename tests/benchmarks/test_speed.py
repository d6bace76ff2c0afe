"""How fast the main job is. Run with ``make bench``; figures are in the README.

Absolute times depend on the machine: the fastest round is the one to compare.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
from pytest_benchmark.fixture import BenchmarkFixture

from calib.identification import identify, identify_batch
from posedesign.cell import Cell
from posedesign.planning.loop import grid_poses, plan
from posedesign.selection.indices import condition_inf
from posedesign.simulation import SimulatedRobot


def test_one_round_of_the_loop(benchmark: BenchmarkFixture, reference_cell: Cell) -> None:
    """27 poses: inverse kinematics, limits, G, C_G. To be at most 2 ms."""
    model = reference_cell.model()
    variation = np.full(3, 40.0)

    def one_round() -> float:
        return condition_inf(model.jacobian(grid_poses(reference_cell, variation).kept))

    assert benchmark(one_round) < 1e5


def test_the_whole_plan(benchmark: BenchmarkFixture, reference_cell: Cell) -> None:
    """The plan of the demo cell, 8 rounds. To be under 100 ms; the paper's controller took 15 s."""
    assert benchmark(plan, reference_cell).reached


def test_help(benchmark: BenchmarkFixture) -> None:
    """``posedesign --help`` as a process. To be under 0.4 s."""
    code = "from posedesign.cli.main import main; main()"
    command = [sys.executable, "-c", code, "--help"]
    benchmark.pedantic(
        lambda: subprocess.run(command, check=True, capture_output=True),
        rounds=7,
        warmup_rounds=1,
    )


def test_one_identification(benchmark: BenchmarkFixture, reference_cell: Cell) -> None:
    """Ten parameters from 27 touch-ups, with covariance and leave-one-out."""
    robot = SimulatedRobot.of(reference_cell)
    touched = robot.touch_up(plan(reference_cell).postures, np.random.default_rng(1))
    model = reference_cell.model()
    assert benchmark(identify, model, touched).status == "converged"


def test_a_thousand_identifications(benchmark: BenchmarkFixture, reference_cell: Cell) -> None:
    """The same for 1,000 noise draws at once."""
    robot = SimulatedRobot.of(reference_cell)
    q = plan(reference_cell).postures
    touched = robot.touch_up(q, np.random.default_rng(1), trials=1000)
    model = reference_cell.model()
    values = benchmark.pedantic(identify_batch, args=(model, touched), rounds=5)
    assert values.shape == (1000, 10)
