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
EXPORTS = {
    "epson-spel": "epson.prg",
    "hyundai-job": "hyundai.job",
    "comau-pdl": "comau.pdl",
    "xarm-python": "xarm.py",
    "franky-python": "franky.py",
}


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
        (
            "xarm-python",
            [
                [90, 0, -60, 0, 0, 0],
                [0, -30.5, -60, 0, 0, 15],
                [0.5, -0.25, -1.0, 0, 0, 0],
            ],
            [16, 19, 20],
        ),
        (
            "franky-python",
            np.degrees(
                [
                    [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785],
                    [-0.3, 0.1, 0.3, -1.4, 0.1, 1.8, 0.7],
                    [0.0, 0.3, 0.3, -1.5, -0.2, 1.5, 0.8],
                    [0.1, 0.3, 0.3, -1.5, -0.2, 1.5, 0.8],
                ]
            ),
            [7, 9, 9, 13],
        ),
    ],
)
def test_a_program_of_others(name: str, found: list[list[float]], lines: list[int]) -> None:
    back = parse(name, export(EXPORTS[name]))
    np.testing.assert_allclose([*shown(back).values()], found, rtol=0, atol=1e-12)
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
    *("xarm-python", "arm.set_servo_angle(servo_id=1, angle=45)", "cannot be told"),
    *("xarm-python", "arm.set_servo_angle(angle=[1, 2, 3, 4, 5, 6], relative=True)", "is relative"),
    *("xarm-python", "arm.set_servo_angle(angle=[1, 2, 3, 4, 5, 6], relative=r)", "is relative"),
    *("xarm-python", "arm.set_servo_angle(angle=[1, 2, 3, 4, 5, 6], is_radian=r)", "be told"),
    *("xarm-python", "arm.set_servo_angle(angle=home, is_radian=True)", "home is in radians"),
    *("xarm-python", "arm.set_servo_angle(angle=[1, 2, 3, 4, 5, speed])", "no list of numbers"),
    *("xarm-python", "home[0] = 1\narm.set_servo_angle(angle=home)", "is changed by"),
    *("xarm-python", "turn(home)\narm.set_servo_angle(angle=home)", "is changed by"),
    *("xarm-python", "b = XArmAPI(ip)\nb.set_servo_angle(angle=home)", "one of several arms"),
    *(
        "xarm-python",
        "b = XArmAPI(ip, is_radian=True)\narm.set_servo_angle(angle=home)",
        "radians|beyond",
    ),
    *("xarm-python", "arm.set_servo_angle(angle=[1, 2, 3, 4, 5, 721])", "beyond"),
    *("xarm-python", "arm.set_servo_angle(angle=[1, 2, 3, 4])", "4 values"),
    *("xarm-python", "arm.set_servo_angle(angles=[1, 2, 3, 4, 5, 6])", "be told|has no angles"),
    *("xarm-python", "arm.set_servo_angl(angle=home)", "is nearly set_servo_angle"),
    *("xarm-python", "arm.set_servo_angle(angle=hom)", "hom is not known"),
    *("xarm-python", "arm.set_servo_angle(angle=home", "was never closed"),
    *("xarm-python", "arm.set_cgpio_digital(16, 1)", "not 0 to 15"),
    *("franky-python", "robot.move(JointMotion([0.1] * 7))", "no list of numbers"),
    *(
        "franky-python",
        "robot.move(JointMotion([1, 2, 3, 4, 5, 6, 7], ReferenceType.Relative))",
        "no list of numbers",
    ),
    *("franky-python", "robot.move(JointMotion([1, 2, 3, 4, 5, 6]))", "6 values"),
    *("franky-python", "robot.move(JointMotion([1, 2, 3, 4, 5, 6, 13]))", "beyond"),
    *("franky-python", "if n:\n    home = other()\nrobot.move(home)", "is changed by"),
    *("franky-python", "robot.relative_dynamics_factor = 5", "not above 0 to 1"),
    *("franky-python", "robot.move([1, 2, 3, 4, 5, 6, 7])", "no pose"),
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
    "xarm-python": "time.sleep(0.5)\n",
    "franky-python": "robot.recover_from_errors()\n",
}


@pytest.mark.parametrize(
    ("name", "line", "message"), [REFUSED[k : k + 3] for k in range(0, len(REFUSED), 3)]
)
def test_what_the_arm_would_not_go_to_is_refused(name: str, line: str, message: str) -> None:
    text = export(EXPORTS[name])
    assert AFTER[name] in text
    with pytest.raises(FileFormatError, match=message):
        parse(name, text.replace(AFTER[name], f"{line}\n"))


def test_a_program_in_python_is_python_and_ends_where_the_arm_does_not_move() -> None:
    for name in ("xarm-python", "franky-python"):
        text = next(iter(DIALECTS[name].files(program_of(name)).values()))
        compile(text, "CALIB.py", "exec")
    checked = "check(arm.set_servo_angle("
    text = next(iter(DIALECTS["xarm-python"].files(program_of("xarm-python")).values()))
    assert checked in text
    told = check("xarm-python", text.replace(checked, "(arm.set_servo_angle(", 1))
    assert [(p.rule, p.level) for p in told] == [("answer", "measuring")]


def test_radians_of_xarm_are_read_where_the_call_or_the_connection_says_so() -> None:
    text = export("xarm.py").replace("speed=5, is_radian=False", "is_radian=True")
    wanted = np.degrees([0.5, -0.25, -1.0, 0, 0, 0])
    np.testing.assert_allclose(shown(parse("xarm-python", text))[3], wanted, atol=1e-12)
    turned = text.replace("[0.5, -0.25, -1.0, 0,", "[math.radians(90), -0.25, np.deg2rad(-1.0), 0,")
    turned = turned.replace("import time", "import time\nimport math\nimport numpy as np")
    found = shown(parse("xarm-python", turned))[3]
    np.testing.assert_allclose(found, [90, np.degrees(-0.25), -1, 0, 0, 0], atol=1e-12)
    text = "from xarm import XArmAPI\na = XArmAPI(is_radian=True)\n"
    text += "a.set_servo_angle(angle=[0.5, -0.25, -1.0, 0, 0, 0])\n"
    np.testing.assert_allclose(shown(parse("xarm-python", text))[1], wanted, atol=1e-12)


def test_each_prg_has_one_language(tmp_path: Path) -> None:
    for name, file in (("epson-spel", "epson.prg"), ("mitsubishi-melfa", "melfa.mb5")):
        path = tmp_path / f"{name}.prg"
        path.write_text(export(file))
        assert dialect_of_file(path).name == name
        others = [d for d in DIALECTS.values() if ".prg" in d.suffixes and d.name != name]
        assert not any(d.recognises(path.read_bytes()) for d in others)
