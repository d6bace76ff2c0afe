"""Of statements of one form few are judged: the same is said as where each one is."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from posedesign.programs import DIALECTS, ProgramPose, rules
from posedesign.programs.recorded import Problem
from tests.marks import by_stage
from tests.unit.programs.dialects import dialect_of, program_of, robot_of, shown

JUDGED = [
    "abb-rapid",
    "denso-pac",
    "doosan-drl",
    "fanuc-ls",
    "kawasaki-as",
    "kuka-krl",
    "mitsubishi-melfa",
    "staubli-val3",
    "ur-script",
    "yaskawa-jbi",
]
POSES = 30
ODD = ("-0", "00", "7.5", "1000000", "-1000000", "0.123456", "-1", "7e3", "- 3", "")
NUMBER = re.compile(r"(?<![\w.])-?\d+(?:\.\d+)?(?![\w.])")


def of_many_poses(name: str) -> dict[str, str]:
    """Texts of a program in which each form of statement is there many times."""
    robot, rng = robot_of(name), np.random.default_rng(3)
    q = rng.uniform(robot.lower, robot.upper, (POSES, robot.n)) * 0.9
    poses = [ProgramPose(f"T{k}", posture) for k, posture in enumerate(q)]
    program = program_of(name, poses, "CALMANY", measure_output=3, settle_s=0.5)
    return DIALECTS[name].files(program)


def with_odd_numbers(text: str, count: int) -> Iterator[str]:
    """The text with another number in the place of one."""
    rng = np.random.default_rng(4)
    found = [*NUMBER.finditer(text)]
    for k in rng.integers(len(found), size=count):
        start, end = found[int(k)].span()
        yield text[:start] + str(rng.choice(ODD)) + text[end:]


@pytest.mark.parametrize("count", by_stage(15, 40, 500))
@pytest.mark.parametrize("name", JUDGED)
def test_the_odd_one_of_many_is_found(name, count, tmp_path, monkeypatch):
    dialect, files = dialect_of(name), of_many_poses(name)
    found = 0
    for file, text in files.items():
        path = tmp_path / file
        path.parent.mkdir(exist_ok=True)
        for other, content in files.items():
            (tmp_path / other).write_text(content)
        for odd in with_odd_numbers(text, count) if NUMBER.search(text) else ():
            path.write_text(odd)
            said: list[list[Problem]] = []
            for few in (rules._FEW, 10**9):
                monkeypatch.setattr(rules, "_FEW", few)
                said.append(dialect.check(odd.encode(), path))
            monkeypatch.undo()
            assert said[0] == said[1], odd
            found += bool(said[0])
    assert found


def test_a_move_of_a_form_that_was_read_has_its_own_signs() -> None:
    zeros = "movej([- 0, 0, 0, 0, 0, 0])\n"
    text = zeros + "movej([- 5, 1, 2, 3, 4, 5])\n" + "movej([-5, 1, 2, 3, 4, 5])\n"
    read = dialect_of("doosan-drl").parse(text.encode(), Path("X.drl"))
    assert [row[0] for row in shown(read).values()] == [0.0, -5.0, -5.0]


def test_a_move_that_is_relative_by_its_place_is_not_read_as_one_before() -> None:
    text = "movej([1, 2, 3, 4, 5, 6], 9, 9, 0, 0, 0)\nmovej([1, 2, 3, 4, 5, 7], 9, 9, 0, 0, 1)\n"
    read = dialect_of("doosan-drl").parse(text.encode(), Path("X.drl"))
    assert len(read.positions) == len(read.unread) == 1
