"""How fast A X = Z B is solved. Run with ``make bench``; figures are for one core
(OMP_NUM_THREADS=1).

Absolute times depend on the machine; ratios are of one run, both sides in turns.
"""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from calib.robot_world import (
    METHODS,
    PAPER_METHODS,
    PairNoise,
    add_noise,
    random_problems,
    solve,
    solve_batch,
)
from calib.se3 import FloatArray
from posedesign.hand_eye.pairs import Pairs, write_pairs
from posedesign.planning import plan
from posedesign.simulation import SimulatedRobot

NOISE = PairNoise(5e-3, 2e-3)

SHAH_RATIO = 15.0
"""A thousand pairs, OpenCV's time over ours: 16.5 to 18 at the fastest of both."""

BATCH_RATIO, ML_RATIO = 10.0, 3.0
LINEAR = 6.0
"""Four times the work, and half again for a busy machine; squares would make 16."""

Call = Callable[[], object]


def pairs(T: int, N: int) -> tuple[FloatArray, FloatArray]:
    """A and B ``(T, N, 4, 4)`` with noise on B."""
    rng = np.random.default_rng(1)
    problems = random_problems(rng, T, N)
    return add_noise(rng, problems.A, problems.B, NOISE)


def by_opencv(A: FloatArray, B: FloatArray, name: str) -> Call:
    """OpenCV's solution of one problem ``(N, 4, 4)``, its lists made beforehand."""
    cv2.setNumThreads(1)
    sides = [list(part) for T in (A, B) for part in (T[:, :3, :3], T[:, :3, 3])]
    method = getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}")
    return lambda: cv2.calibrateRobotWorldHandEye(*sides, method=method)


def in_turns(*calls: Call, turns: int = 6, rounds: int = 8) -> list[tuple[float, float]]:
    """Seconds of the fastest round and of the median one, of each call.

    A few rounds of one, then of the other, and again: the clock of the processor changes within a
    run. The first of a turn is not counted: memory is as the other call left it. Seconds are those
    of the processor, of one thread, so that what else runs on it counts less.
    """
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(turns):
        for call, own in zip(calls, times, strict=True):
            call()
            for _ in range(rounds):
                start = time.process_time()
                call()
                own.append(time.process_time() - start)
    return [(min(own), float(np.median(own))) for own in times]


def say(
    capsys: pytest.CaptureFixture[str],
    benchmark: BenchmarkFixture,
    what: str,
    theirs: tuple[float, ...],
    ours: tuple[float, ...],
    unit: float = 1e-3,
) -> float:
    """Print both sides, and return how many times longer theirs take at their fastest."""
    ratio = (theirs[0] / ours[0], theirs[1] / ours[1])
    name = {1e-3: "ms", 1e-6: "µs"}[unit]
    with capsys.disabled():
        print(
            f"\n{what}, fastest / median: OpenCV {theirs[0] / unit:.3g} / {theirs[1] / unit:.3g} "
            f"{name}, ours {ours[0] / unit:.3g} / {ours[1] / unit:.3g} {name}: "
            f"{ratio[0]:.2f} / {ratio[1]:.2f} times"
        )
    benchmark.extra_info["OpenCV over ours, fastest"] = ratio[0]
    benchmark.extra_info["OpenCV over ours, median"] = ratio[1]
    return ratio[0]


def test_shah_of_a_thousand_pairs(benchmark, capsys):
    """One problem, with checks of the input and verdicts on motion and fit, which OpenCV lacks."""
    A, B = (T[0] for T in pairs(1, 1000))
    theirs, ours = in_turns(by_opencv(A, B, "SHAH"), lambda: solve(A, B, "shah"))
    ratio = say(capsys, benchmark, "Shah, 1,000 pairs", theirs, ours)
    assert benchmark.pedantic(solve, args=(A, B, "shah"), rounds=20).status == "ok"
    assert ratio > SHAH_RATIO


def test_shah_of_a_thousand_sets_of_ten(benchmark, capsys):
    """Ours for a set of a batch; OpenCV has no batches."""
    A, B = pairs(1000, 10)
    singles = [by_opencv(*sides, "SHAH") for sides in zip(A[:100], B[:100], strict=True)]
    theirs, ours = in_turns(
        lambda: [call() for call in singles], lambda: solve_batch(A, B, "shah"), rounds=4
    )
    theirs, ours = (tuple(t / n for t in own) for own, n in ((theirs, 100), (ours, len(A))))
    ratio = say(capsys, benchmark, "Shah, 10 pairs, a set of 1,000", theirs, ours, 1e-6)
    assert benchmark.pedantic(solve_batch, args=(A, B, "shah"), rounds=5).ok.all()
    assert ratio > BATCH_RATIO


def test_likeliest_of_fifty_pairs_against_li(benchmark, capsys):
    """The maximum of the likelihood takes at most three times as long as OpenCV's Li."""
    A, B = (T[0] for T in pairs(1, 50))
    theirs, ours = in_turns(by_opencv(A, B, "LI"), lambda: solve(A, B, "ml", NOISE), rounds=15)
    ratio = say(capsys, benchmark, "ml, noise given, against Li, 50 pairs", theirs, ours)
    assert benchmark.pedantic(solve, args=(A, B, "ml", NOISE), rounds=20).status == "ok"
    assert ratio > 1.0 / ML_RATIO


@pytest.mark.parametrize("what", ["pairs", "sets"])
@pytest.mark.parametrize("method", ["ml", "shah", "li-kronecker", "hirsh"])
def test_cost_grows_linearly(benchmark, capsys, method, what):
    """Four times the pairs of a set, or four times the sets, take about four times as long."""
    T, N = (90, 250) if what == "pairs" else (800, 27)  # more than a cache holds, both times
    more = (T, 4 * N) if what == "pairs" else (4 * T, N)
    noise = NOISE if METHODS[method].likelihood else None

    def call(shape: tuple[int, int]) -> Call:
        A, B = pairs(*shape)
        return lambda: solve_batch(A, B, method, noise)

    (once, _), (four, _) = in_turns(call((T, N)), call(more), turns=3, rounds=2)
    with capsys.disabled():
        print(f"\n{method}, 4 times the {what}: {four / once:.2f} times as long")
    benchmark.extra_info["time ratio for 4x"] = four / once
    benchmark.pedantic(call(more), rounds=2)
    assert four / once < LINEAR


@pytest.mark.parametrize("method", ["ml", "ml-robust", *PAPER_METHODS])
def test_all_that_is_said_of_thousands_of_pairs(capsys, method):
    """Answer, covariance, residuals of pairs left out and doubts: at most linear in the pairs.

    Of the six methods together to be below 2 s for 1,000 pairs, and 10 s for 5,000.
    """

    def call(N: int) -> Call:
        A, B = (T[0] for T in pairs(1, N))

        def say() -> None:
            found = solve(A, B, method)
            assert found.covariance is not None
            assert np.isfinite(found.left_out_residuals).all()
            assert found.warnings is not None

        return say

    (few, _), (many, _) = in_turns(call(1_000), call(4_000), turns=1, rounds=2)
    with capsys.disabled():
        print(f"\n{method}: 1,000 pairs {few:.2f} s, 4,000 over it {many / few:.2f}")
    assert many < LINEAR * few


def test_the_command_on_thousands_of_pairs(tmp_path, capsys):
    """All methods that it takes by default, files and figure: seconds of the processor in all.

    5,000 pairs to be below 10 s; 1,000 below 2 s.
    """
    seconds = []
    for N in (1_000, 5_000):
        A, B = (T[0] for T in pairs(1, N))
        path = write_pairs(tmp_path / f"{N}.csv", Pairs(tuple(map(str, range(N))), A, B))
        before = os.times()
        command = [sys.executable, "-m", "posedesign", "robot-world", path, "--out", tmp_path / "o"]
        subprocess.run([*command, "--overwrite"], check=True, capture_output=True)
        after = os.times()
        spent = after.children_user + after.children_system
        seconds.append(spent - before.children_user - before.children_system)
    with capsys.disabled():
        print(f"\nrobot-world: 1,000 pairs {seconds[0]:.1f} s, 5,000 pairs {seconds[1]:.1f} s")
    assert seconds[1] < 10.0
    assert seconds[1] < 5.0 * seconds[0]


@pytest.fixture(scope="module")
def measured(reference_cell) -> tuple[FloatArray, FloatArray]:
    """A and B ``(1000, 27, 4, 4)``: noise draws of the planned poses of the reference cell."""
    robot = SimulatedRobot.of(reference_cell)
    rng = np.random.default_rng(1)
    touched = robot.touch_up(plan(reference_cell).postures, rng, trials=1000)
    return robot.camera_poses(touched.postures, rng)


@pytest.mark.parametrize("method", METHODS)
def test_a_thousand_sets_of_27(benchmark, measured, method):
    """A X = Z B for 1,000 noise draws of 27 pairs at once."""
    rounds = 1 if METHODS[method].robust else 5  # a minute each
    found: Any = benchmark.pedantic(solve_batch, args=(*measured, method), rounds=rounds)
    assert found.X.shape == (1000, 4, 4)
