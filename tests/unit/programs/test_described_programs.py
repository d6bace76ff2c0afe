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
EXPORTS = {"epson-spel": "epson.prg", "hyundai-job": "hyundai.job", "comau-pdl": "comau.pdl"}


def parse(name: str, text: str) -> RecordedProgram:
    return DIALECTS[name].parse(text.encode(), Path("CALIB")).whole()


def check(name: str, text: str) -> list[Problem]:
    return DIALECTS[name].check(text.encode(), Path("CALIB"))


@pytest.mark.parametrize("name", DESCRIBED)
def test_the_head_says_that_signs_are_those_of_the_description(name: str) -> None:
    text = next(iter(DIALECTS[name].files(program_of(name)).values()))
    assert "NOT CHECKED: signs, zeros and couplings of the joints" in " ".join(text.split())


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
        (
            "hyundai-job",
            [
                [21.7, 55.2, -16.5, -315.0, 31.2, 223.7],
                [10, 90, 0, 0, -30, 0],
                [0, 90.5, 0, 0, 10, 0],
            ],
            [4, 14, 16],
        ),
        (
            "comau-pdl",
            [
                [-46.18419, -6.77518, -20.54925, 71.38674, 49.58727, -302.54752],
                [-41.62707, -8.89064, -30.01809, 60.62329, 49.66749, -258.98418],
            ],
            [13, 20],
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
    *("comau-pdl", "MOVE TO home + VEC(0, 0, 1)", "is computed"),
    *("comau-pdl", "MOVE TO {1, , 90, 4, 5, 6}", "no list of numbers"),
    *("comau-pdl", "MOVE TO {1, 2, 3, 4, 5, i}", "no list of numbers"),
    *("comau-pdl", "MOVE TO {1, 2, 3, 4, 5, 721}", "beyond"),
    *("comau-pdl", "MOVE TO {1, 2, 3, 4, 5}", "5 values"),
    *("comau-pdl", "MOVE CIRCULAR TO {1, 2, 3, 4, 5, 6} VIA {1, 2, 3, 4, 5, 7}", "no list of"),
    *("comau-pdl", "home[1] := 5\nMOVE TO home", "is changed by"),
    *("comau-pdl", "R_Change(home)\nMOVE TO home", "is changed by"),
    *(
        "comau-pdl",
        "WHILE i < 2 DO\nhome := {1, 2, 3, 4, 5, 6}\nMOVE TO home\nENDWHILE",
        "is changed by",
    ),
    *("comau-pdl", "MOVE RELATIVE VEC(0, 0, 1) IN TOOL", "cannot be read"),
    *("comau-pdl", "$PROG_SPD_OVR := 101", "not 1 to 100"),
    *("comau-pdl", "$TERM_TYP := FINE", "nearly"),
    *("comau-pdl", "$TERM_TYPE := FNE", "no value of"),
    *("comau-pdl", "DELAY -1", "not 0 to"),
    *("comau-pdl", "ENDIF", "does not close"),
    *("hyundai-job", "move P,tg=po1+Shift(0,0,5,0,0,0),spd=9%,accu=0,tool=1", "no list of numbers"),
    *("hyundai-job", "move P,tg=po1+s,spd=9%,accu=0,tool=1", "is computed"),
    *("hyundai-job", "po1.j2=po1.j2+5\nmove P,tg=po1,spd=9%,accu=0,tool=1", "is changed by"),
    *("hyundai-job", "call 12,po1\nmove P,tg=po1,spd=9%,accu=0,tool=1", "is changed by"),
    *(
        "hyundai-job",
        "for i=1 to 2\npo1=Pose(1,2,3,4,5,6)\nnext\nmove P,po1,spd=9%,accu=0,tool=1",
        "is changed by",
    ),
    *("hyundai-job", "if di1 then move P,tg=po1,spd=9%,accu=0,tool=1", "cannot be read"),
    *("hyundai-job", "move P,tg=Pose(1,2,3,4,5,x),spd=9%,accu=0,tool=1", "no list of numbers"),
    *("hyundai-job", "move P,tg=Pose(1,2,3,4,5,6),spd=9,accu=0,tool=1", "has no unit"),
    *("hyundai-job", "move P,tg=Pose(1,2,3,4,5,6),spd=900%,accu=0,tool=1", "not above 0 to 100"),
    *("hyundai-job", "move P,tg=Pose(1,2,3,4,5,6),spd=9%,accu=8,tool=1", "not 0 to 7"),
    *("hyundai-job", "MOVE P,S=60%,A=3,T=1  (1, 2, 3, 4, 5)A", "5 values"),
    *("hyundai-job", "MOVE P,S=60%,A=3,T=1  (1, 2, 3, 4, 5, 721)A", "beyond"),
    *("hyundai-job", "Pose(1,2,3,4,5,6),spd=9%", "cannot be read"),
]
AFTER = {
    "epson-spel": "\tGo pick +Z(50)\n",
    "hyundai-job": "     do5=1\n",
    "comau-pdl": "  WAIT FOR $DIN[1]\n",
}


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
