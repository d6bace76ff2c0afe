"""Programs of joint positions for makers of whose arms no convention is known: what is special."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from posedesign.programs import DIALECTS, Arm, Problem, ProgramPose, RecordedProgram
from posedesign.programs.joint_programs import DescribedDialect
from posedesign.programs.registry import dialect_of as dialect_of_file
from tests.unit.programs.dialects import export, program_of, shown

DESCRIBED = [name for name, d in DIALECTS.items() if isinstance(d, DescribedDialect)]
EXPORTS = {"epson-spel": "epson.prg"}


def parse(name: str, text: str) -> RecordedProgram:
    return DIALECTS[name].parse(text.encode(), Path("CALIB")).whole()


def check(name: str, text: str) -> list[Problem]:
    return DIALECTS[name].check(text.encode(), Path("CALIB"))


@pytest.mark.parametrize("name", DESCRIBED)
def test_the_head_says_that_signs_are_those_of_the_description(name: str) -> None:
    text = next(iter(DIALECTS[name].files(program_of(name)).values()))
    assert "NOT CHECKED: signs and zeros of the joints" in " ".join(text.split())


@pytest.mark.parametrize("name", DESCRIBED)
def test_an_arm_of_other_joints_is_refused(name: str) -> None:
    poses = [ProgramPose("T1", np.zeros(4))]
    program = program_of(name, poses)
    with pytest.raises(InputError, match=r"arms that .* moves have"):
        DIALECTS[name].files(type(program)("X", program.poses, program.options, Arm.usual(None, 4)))


@pytest.mark.parametrize(
    ("name", "found", "lines"),
    [
        (
            "epson-spel",
            [
                [-46.18419, -6.77518, -20.54925, 71.38674, 49.58727, -302.54752],
                [-41.62707, -8.89064, -30.01809, 60.62329, 0.0, -258.98418],
            ],
            [14, 20],
        ),
    ],
)
def test_a_program_of_others(name: str, found: list[list[float]], lines: list[int]) -> None:
    back = parse(name, export(EXPORTS[name]))
    assert [*shown(back).values()] == found
    assert [p.line for p in back.positions] == lines
    assert {p.level for p in check(name, export(EXPORTS[name]))} <= {"note", "measuring"}


REFUSED = [
    # by the manual of SPEL+ joints 4 and 6 are then others
    *("epson-spel", "  Go JA(1, 2, 3, 90, 0, -90)", "joint 5 is at 0"),
    *("epson-spel", "  Go JA(1, 2, 3, 90, -0.0, -90)", "joint 5 is at 0"),
    *("epson-spel", "  P1 = JA(1, 2, 3, 4, 5, 6)\n  Go P1", "p1 is a point"),
    *("epson-spel", "  pick = AglToPls(1, 2, 3, 4, 5, 6)\n  Jump pick C1", "pick is a point"),
    *("epson-spel", "  Move AglToPls(1, 2, 3, 4, 5, 6)", "joints are not sure"),
    *("epson-spel", "  Go AglToPls(1, 2, 3, 4, 5, 6) +Z(5)", "joints are not sure"),
    *("epson-spel", "  Go AglToPls(1, 2, 3, 4, 5, j)", "no list of numbers"),
    *("epson-spel", "  If n > 1 Then Go JA(1, 2, 3, 4, 5, 6)", "joints are not sure"),
    *("epson-spel", "  Go AglToPls(1, 2, 3, 4, 5, 721)", "beyond"),
    *("epson-spel", "  Go AglToPls(1, 2, 3, 4, 5)", "5 values"),
    *("epson-spel", "  Speed 101", "not 1 to 100"),
    *("epson-spel", "  Wait -1", "not 0 to"),
    *("epson-spel", "  Go (1, 2, 3, 4, 5, 6)", "is no position"),
    *("epson-spel", "  Do\n  Fend", "does not close"),
]
AFTER = {"epson-spel": "\tGo pick +Z(50)\n"}


@pytest.mark.parametrize(
    ("name", "line", "message"), [REFUSED[k : k + 3] for k in range(0, len(REFUSED), 3)]
)
def test_what_the_arm_would_not_go_to_is_refused(name: str, line: str, message: str) -> None:
    text = export(EXPORTS[name])
    assert AFTER[name] in text
    with pytest.raises(FileFormatError, match=message):
        parse(name, text.replace(AFTER[name], f"{line}\n"))


def test_each_prg_has_one_language(tmp_path: Path) -> None:
    for name, file in (("epson-spel", "epson.prg"), ("mitsubishi-melfa", "melfa.mb5")):
        path = tmp_path / f"{name}.prg"
        path.write_text(export(file))
        assert dialect_of_file(path).name == name
        others = [d for d in DIALECTS.values() if ".prg" in d.suffixes and d.name != name]
        assert not any(d.recognises(path.read_bytes()) for d in others)
