"""Writing and reading programs: bounds are on the ratio of their times for more poses."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from posedesign.programs import DIALECTS, Arm, PoseProgram, ProgramOptions, ProgramPose

PULSES = (1434.2, -1434.2, 1600.0, 1137.8, -1137.8, 682.7)


def program_of(count: int) -> PoseProgram:
    rng = np.random.default_rng(1)
    q = np.deg2rad(rng.uniform(-80.0, 80.0, (count, 6)))
    poses = tuple(ProgramPose(f"P{i + 1}", posture) for i, posture in enumerate(q))
    options = ProgramOptions(fingerprint="abcdef12", pulses_per_deg=PULSES)
    return PoseProgram("MANY", poses, options)


def written_and_read(name: str, program: PoseProgram, folder: Path) -> int:
    dialect = DIALECTS[name].reading(PULSES)
    paths = dialect.write(program, folder)
    parts = len(list(dialect.parts(program)))
    return sum(len(dialect.read(path).positions) for path in paths[:parts])


@pytest.mark.parametrize("name", DIALECTS)
def test_ten_thousand_poses(name: str, benchmark: BenchmarkFixture, tmp_path: Path) -> None:
    program = program_of(10_000)
    assert Arm.usual(DIALECTS[name].maker, 6).n == 6
    found = benchmark.pedantic(written_and_read, (name, program, tmp_path), rounds=3)
    assert found == 10_000


@pytest.mark.parametrize("name", DIALECTS)
def test_cost_is_linear_in_poses(name: str, tmp_path: Path) -> None:
    def seconds(count: int) -> float:
        program = program_of(count)
        start = time.process_time()
        assert written_and_read(name, program, tmp_path) == count
        return time.process_time() - start

    seconds(100)
    few, many = (min(seconds(count) for _ in range(2)) for count in (1000, 8000))
    # eight times as much; quadratic work would take 64 times as long, Python's own gc some 1.5
    assert many < 16.0 * few
