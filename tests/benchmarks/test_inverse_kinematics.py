"""How fast inverse kinematics and the forward kernel are. Run with ``make bench``.

Absolute times depend on the machine: the fastest round is the one to compare, and the times of
1,000 and of 10,000 poses side by side show that the cost a pose does not grow.
"""

from pathlib import Path

import numpy as np
import pytest

from calib import Robot, preset_names
from calib.robots.inverse.closed_form import compare
from posedesign.cell.orientations import suggest_base_posture, suggest_tool


def random_poses(robot: Robot, count: int) -> np.ndarray:
    q = np.random.default_rng(0).uniform(robot.lower, robot.upper, (count, robot.n))
    return robot.fk(q)


@pytest.fixture(scope="module")
def reference() -> Robot:
    return Robot.preset("r2000ic165f")


@pytest.mark.parametrize("count", [1, 27, 1_000, 10_000])
def test_every_branch(benchmark, reference, count):
    """All of it: to be at most 0.2 ms for one pose, 10 us a pose in 10,000 (100 ms), and linear."""
    poses = random_poses(reference, count)
    answers = benchmark(reference.inverse, poses)
    assert set(answers.pose.tolist()) == set(range(count))


def test_every_turn(benchmark, reference):
    """Each branch in all its full turns, 10,000 poses."""
    poses = random_poses(reference, 10_000)
    answers = benchmark(reference.inverse, poses, every_turn=True)
    assert len(answers.postures) > 100_000


def test_closed_form_alone(benchmark, reference):
    """EAIK and its answers as one array, 10,000 poses."""
    poses = random_poses(reference, 10_000)
    solver = reference._inverse._solver
    assert len(benchmark(solver.branches, poses)[0]) > 50_000


def test_check_of_the_answers_alone(benchmark, reference):
    """The forward kinematics and the comparison of all answers of 10,000 poses."""
    poses = random_poses(reference, 10_000)
    postures, pose = reference._inverse._solver.branches(poses)
    distance, _, _ = benchmark(compare, reference.chain, postures, poses, pose)
    assert len(distance) == len(postures)


def test_singular_flags(benchmark, reference):
    """Of all answers of 1,000 poses; worked out only when asked for."""
    poses = random_poses(reference, 1_000)
    flags = benchmark.pedantic(
        lambda answers: answers.singular, setup=lambda: ((reference.inverse(poses),), {}), rounds=5
    )
    assert flags.any()


@pytest.mark.parametrize("count", [1, 27, 1_000, 100_000])
def test_forward(benchmark, reference, count):
    """Every frame, axis and the tip: 100,000 postures to be well below a second."""
    rng = np.random.default_rng(0)
    q = rng.uniform(reference.lower, reference.upper, (count, reference.n))
    assert benchmark(reference.chain.forward, q).origins.shape == (count, 6, 3)


SEVEN = [name for name in preset_names() if Robot.preset(name).n == 7]


@pytest.mark.parametrize("name", SEVEN)
@pytest.mark.parametrize("count", [1, 50])
def test_redundant_arm(benchmark, name, count):
    """Sweep and walk of a seven-axis arm: to be under 50 ms for one pose."""
    robot = Robot.preset(name)
    poses = random_poses(robot, count)
    answers = benchmark(robot.inverse, poses)
    assert set(answers.pose.tolist()) == set(range(count))


def test_real_panda(benchmark):
    """The same for the description of a real arm, where the data lie beside the project."""
    path = Path(__file__).parents[2].parent / "shared" / "data" / "urdf" / "panda.urdf"
    if not path.exists():
        pytest.skip(f"{path} does not exist")
    robot = Robot.from_urdf(path)
    poses = random_poses(robot, 1)
    assert benchmark(robot.inverse, poses).inside.any()


def test_a_base_posture_of_seven_axes(benchmark):
    """What `posedesign new` takes longest for. To be below 0.5 s."""
    robot = Robot.preset("panda")
    assert len(benchmark(suggest_base_posture, robot, suggest_tool(robot))) == 7
