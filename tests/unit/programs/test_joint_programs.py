"""Programs of joint positions for four controllers: what is special to each."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from posedesign.programs import DIALECTS, PoseProgram, Problem, ProgramPose, RecordedProgram, read
from posedesign.programs.registry import dialect_of as dialect_of_file
from tests.unit.programs.dialects import arm_of, export, shown, three_poses

FILES = {
    "denso-pac": "denso.pcs",
    "doosan-drl": "doosan.drl",
    "kawasaki-as": "kawasaki.as",
    "mitsubishi-melfa": "melfa.mb5",
}
EXPORT = {name: export(file) for name, file in FILES.items()}
"""As controllers save them, and as people write them."""

WRITTEN = {
    "denso-pac": three_poses("denso-pac"),
    "doosan-drl": three_poses("doosan-drl"),
    "kawasaki-as": three_poses("kawasaki-as", keep="register", first_register=3),
    "mitsubishi-melfa": three_poses("mitsubishi-melfa", "CALIB"),
}


def parse(name: str, text: str) -> RecordedProgram:
    return DIALECTS[name].parse(text.encode(), Path("CALIB")).whole()


def check(name: str, text: str) -> list[Problem]:
    return DIALECTS[name].check(text.encode(), Path("CALIB"))


@pytest.mark.parametrize("name", FILES)
def test_a_program_breaks_no_rule_and_its_poses_come_back(name: str) -> None:
    program, text = WRITTEN[name]
    assert check(name, text) == []
    back = parse(name, text.replace("\n", "\r\n"))
    numbered = sorted((p.number, p.name) for p in back.positions)
    assert numbered == [(1, "T -1"), (2, "T 1"), (3, "T 0")]
    assert (back.mark.fingerprint, back.mark.measured) == ("abcdef12", 2)
    postures = dict(zip(program.numbers, program.postures_rad, strict=True))
    wanted = [postures[p.number] for p in back.positions]
    arm = DIALECTS[name].seen(arm_of(name, frames=False))
    np.testing.assert_allclose(back.postures(arm), wanted, atol=2e-7)


def test_drl_is_python() -> None:
    for text in (WRITTEN["doosan-drl"][1], EXPORT["doosan-drl"]):
        compile(text, "Calib.drl", "exec")


@pytest.mark.parametrize(
    ("name", "changes", "there"),
    [
        ("denso-pac", {"measure_argument": None}, "  Call MEASURE\n"),
        ("doosan-drl", {"measure_call": None}, "wait(0.500)\n"),
        ("mitsubishi-melfa", {"measure_argument": None}, 'CallP "MEASURE"\n'),
    ],
)
def test_calls_of_less(name: str, changes: dict[str, None], there: str) -> None:
    program = WRITTEN[name][0]
    bare = replace(program, options=replace(program.options, **changes))
    text = next(iter(DIALECTS[name].files(bare).values()))
    assert there in text
    assert "def " not in text
    assert check(name, text) == []


@pytest.mark.parametrize(
    ("name", "found", "lines", "levels"),
    [
        # moves that pass into the next one
        (
            "denso-pac",
            [[10, 20, 30, 40, 50, 60], [-1, 2.5, 90, 0, 45, 0]],
            [8, 13],
            {"note", "measuring"},
        ),
        # functions that are not known here
        ("doosan-drl", [[0, 0.01, 132.64, 0, 15, -0.01], [0, 0, 90, 0, 90, 0]], [7, 14], {"note"}),
        # no BREAK before a step that is measured
        (
            "kawasaki-as",
            [
                [1.5, 0, 90, 0, -90, 0],
                [-91.26519, 26.640381, -121.421951, 0.640723, -31.712723, 2.059593],
            ],
            [15, 25],
            {"note", "measuring"},
        ),
    ],
)
def test_a_program_of_others(name, found, lines, levels):
    back = parse(name, EXPORT[name])
    assert [*shown(back).values()] == found
    assert [p.line for p in back.positions] == lines
    assert {p.level for p in check(name, EXPORT[name])} == levels


def test_poses_of_melfa_are_read() -> None:
    back = parse("mitsubishi-melfa", EXPORT["mitsubishi-melfa"])
    assert [p.name for p in back.positions] == ["ppick", "J1"]
    T = back.positions[0].T_user_tool
    assert T is not None
    np.testing.assert_allclose(T[:3, 3], [-0.12053, -0.2839, 0.05122])
    turned = np.radians(156.09)
    np.testing.assert_allclose(T[:3, 2], [np.sin(turned), -np.cos(turned), 0], atol=1e-15)
    assert shown(back) == {2: [1.5, 0, 90, 0, 90, 0]}
    levels = {p.level for p in check("mitsubishi-melfa", EXPORT["mitsubishi-melfa"])}
    assert levels == {"note", "measuring"}  # a command of vision, and J1 is not moved to


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("denso-pac", "2.5", "2_5", "cannot stand behind"),
        ("denso-pac", "2.5", "721", "beyond"),
        ("denso-pac", "2.5", "2.5 * n", "no list of numbers"),
        ("denso-pac", ", 45, 0)", ")", "has 4 values"),
        (
            *("denso-pac", ", 60, 0, 0 )"),
            *(", 60, 5, 0 )\n  bbb = J(1, 2, 3, 4, 5, 6, 0)\n  Move P, bbb", "differs"),
        ),
        ("doosan-drl", "132.64", "132_64", "132_64 is no number"),
        ("doosan-drl", "132.64", "721", "beyond"),
        ("doosan-drl", "-0.01)", "-0.01 * 2)", "no list of numbers"),
        ("doosan-drl", ", -0.01)", ")", "has 5 values"),
        ("doosan-drl", "[0, 0, 90, 0, 90, 0]", "*given", "is changed by|no list of numbers"),
        ("kawasaki-as", "-91.265190", "-91_265190", "cannot be read"),
        ("kawasaki-as", "-91.265190", "-721", "beyond"),
        ("kawasaki-as", ".JOINTS\n", ".JOINTS\n#START_POS 1 2 3 4 5 6\n", "is there twice"),
        ("kawasaki-as", " 2.059593", " 2.059593 5\n#other 1 2 3 4 5 6 9", "differs"),
        ("kawasaki-as", " 2.059593", "", "has 5 values"),
        ("mitsubishi-melfa", "J1=(+1.50", "J1=(+1_50", "cannot be read"),
        ("mitsubishi-melfa", "+1.50", "+721", "beyond"),
        ("mitsubishi-melfa", "J1=", "ppick=", "is there twice"),
        ("mitsubishi-melfa", "-283.90,", "-283-.90,", "no list of numbers"),
        ("mitsubishi-melfa", ",+156.09)(4", ",+156.09,+5.00)(4", "axis 7 differs"),
        ("mitsubishi-melfa", ",+90.00,+0.00,+156.09)(4", ")(4", "has 3 values"),
    ],
)
def test_what_would_be_read_wrong_is_refused(name, old, new, message):
    assert old in EXPORT[name]
    with pytest.raises(FileFormatError, match=message):
        parse(name, EXPORT[name].replace(old, new)).postures()


Q = "posj(0, 0, 90, 0, 90, 0)"
COMPUTED = [
    f"movej({Q} + posj(1, 1, 1, 1, 1, 1))",
    f"movej(-{Q})",
    "movej(posj(-[0, 0, 90, 0, 90, 0]))",
    "q = posj(-[0, 0, 90, 0, 90, 0])\nmovej(q)",
    "movej(home[0])",
    "movej(vel=10)",
    "movej(*home)",
    *(f"movej({Q}, {mod})" for mod in ("mod=DR_MV_MOD_REL", "mod=1", "mod=m", "1, 1, 1, 1, 1")),
    *(
        f"home = {Q}\n{change}\nmovej(home)"
        for change in (
            "home[0] = 45",
            "home += [3]",
            "home, b = b, home",
            "home = b = c",
            "home: list = [1, 2, 3, 4, 5, 6]",
            "home.reverse()",
            "n[home.pop()] = 3",
            "n = home.pop() + 1",
            "home = other",
            "from mine import home",
            "for home in all:",
            "def go(home):",
            "go(home)",
            "n = 1 + go(n, where=[home])",
            "arm.go(home)",
            "def go():\n    home[0] = 45\nhome = [1, 2, 3, 4, 5, 6]\ngo()",
            "def go():\n    global home\nhome = [1, 2, 3, 4, 5, 6]\ngo()",
            "if n:\n    home = [1, 2, 3, 4, 5, 6]",
            "while n:\n    movej(home)\n    home += [3]",
            "def go():\n    movej(home)\nhome = [1, 2, 3, 4, 5, 6]\ngo()",
        )
    ),
    f'text = """\nmovej({Q})',
]


@pytest.mark.parametrize("lines", COMPUTED)
def test_a_move_to_what_is_computed_is_refused(lines: str) -> None:
    before = EXPORT["doosan-drl"]
    with pytest.raises(
        FileFormatError, match=r"no list of numbers|cannot be read|is relative|is changed"
    ):
        parse("doosan-drl", before + lines)
    told = check("doosan-drl", before + lines)
    assert told != check("doosan-drl", before) or "movej(home)" in lines


LOST = [
    "Move P, @E aaa + J(1, 1, 1, 1, 1, 1)",
    "Move P, @E -J(1, 1, 1, 1, 1, 1)",
    "Move P, @E J(1, 1, 1, 1, 1, 1), aaa * 2",
    "If n > 1 Then Move P, J(1, 1, 1, 1, 1, 1)",
    "If n > 1 Then Move P, aaa",
    *(
        f"{change}\n  Move P, @E aaa"
        for change in (
            "LetJ 1, aaa = 90",
            "AAA = aaa + J(1, 1, 1, 1, 1, 1)",
            "aaa = other",
            "Call Turn(aaa)",
            "If n > 1 Then aaa = other",
            "If n > 1 Then\n    aaa = J(1, 1, 1, 1, 1, 1)\n  End If",
            "*again:\n  Move P, aaa\n  aaa = J(1, 1, 1, 1, 1, 1)\n  If n > 1 Then GoTo *again",
        )
    ),
    "Dim b As Joint = J(1, 1, 1, 1, 1, 1) + aaa\n  Move P, b",
    "#define b J(1, 1, 1, 1, 1, 1)\n  Move P, b",
    "b[1] = J(1, 1, 1, 1, 1, 1)\n  b[n] = J(2, 1, 1, 1, 1, 1)\n  Move P, b[1]",
    "b[n] = J(1, 1, 1, 1, 1, 1)\n  Move P, b[n]",
]


@pytest.mark.parametrize("lines", LOST)
def test_a_move_of_denso_to_what_is_computed_is_refused(lines: str) -> None:
    with pytest.raises(
        FileFormatError, match=r"no list of numbers|cannot be read|is changed|is no position"
    ):
        parse("denso-pac", EXPORT["denso-pac"].replace("GiveArm", lines))


def test_a_declared_value_is_read() -> None:
    lines = "Depart P, J(1, 2)\n  #define c J(1, 2)\n  Move L, P[1]\n  Move L, P(1, 2)\n  "
    lines += "Dim n As Integer = 2, b As Joint = J(1, 2, 3, 4, 5, 6)\n  b[1] = J(1, 2, 3, 4, 5, 7)"
    lines += "\n  Move P, @E B\n  Move P, b[1]\n  Move P, J[2]"
    found = shown(parse("denso-pac", EXPORT["denso-pac"].replace("GiveArm", lines)))
    assert [*found.values()][2:] == [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 7]]


def test_positions_by_name_are_read_and_those_of_long_texts_are_not() -> None:
    more = f'''"""
# POSE 1 no pose
movej({Q})
"""
note = """
movej({Q})"""
movej(pos=posj(1, 2, 3, 4, 5, 6), mod=DR_MV_MOD_ABS)
movej([1, 2, 3, 4, 5, 7], 10, 10, mod=0)
movej(posj(home))
'''
    back = parse("doosan-drl", EXPORT["doosan-drl"] + more)
    found = [*shown(back).values()][2:]
    assert found == [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 7], [0, 0, 90, 0, 90, 0]]
    assert [p.line for p in back.positions][2:] == [23, 24, 25]
    told = check("doosan-drl", EXPORT["doosan-drl"] + more)
    assert not [p for p in told if p.level == "error"]


def test_a_pose_of_a_plan_is_there_once() -> None:
    with pytest.raises(FileFormatError, match="pose 1 is there twice"):
        parse("doosan-drl", WRITTEN["doosan-drl"][1].replace("POSE 2", "POSE 1"))
    text = WRITTEN["kawasaki-as"][1]
    with pytest.raises(FileFormatError, match="two programs"):
        parse("kawasaki-as", text + text.replace("Calib", "other"))


def test_what_an_operator_adds_comes_behind_the_plan() -> None:
    added = f"MEASURE(1)\nmovej({Q})"
    back = parse("doosan-drl", WRITTEN["doosan-drl"][1].replace("MEASURE(1)", added))
    assert [(p.number, p.name) for p in back.positions][2:] == [(3, "T 0"), (4, "")]
    assert len(back.measured) == 2
    # J1 and J3 are planned; the operator's own, and J2 written otherwise, stand behind all
    text = WRITTEN["mitsubishi-melfa"][1].replace("J2", "JV")
    back = parse("mitsubishi-melfa", text.replace("\nJ1=(", "\nJ01=(0,0,0,0,0,0)\nJ1=("))
    numbers = [(p.number, p.name) for p in back.positions]
    assert numbers == [(1, "T -1"), (3, "T 0"), (4, "J01"), (5, "JV")]


def test_touched_up_positions_of_kawasaki_take_the_place_of_planned_ones() -> None:
    saved = WRITTEN["kawasaki-as"][1].replace("Calib", "calib")  # as controllers do
    assert parse("kawasaki-as", saved).empty_registers
    kept = "#calib.m[4] 1.1 2.1 3.1 -4.1 5.1 6.1\n#calib.m[3] 9 8 7 6 5 4\n"
    text = saved.replace(".JOINTS\n", ".JOINTS\n#park 0 0 0 0 0 0\n" + kept)
    back = parse("kawasaki-as", text)
    assert not back.empty_registers
    found = {p.name: p.shown_deg.tolist() for p in back.measured if p.shown_deg is not None}
    assert found == {"T -1": [9, 8, 7, 6, 5, 4], "T 1": [1.1, 2.1, 3.1, -4.1, 5.1, 6.1]}


# Retyped in small from public programs of people and of controllers
OTHERS = [
    (
        "denso-pac",
        """\
PROGRAM main(index%)
DEFINT li1, state(11)
DIM p1 AS POSITION
TAKEARM
li1 = 5
Set IO[24], 40
Reset IO[104 To 110]
j0 = (10, 20, 30, 40, 50, 60)
FOR li1 = 1 TO 3
  IF IO[1] = ON THEN GOTO *again
  MOVE P, @e j0
  move l, @e J2P((1, 2, 3, 4, 5, 6)), s = li1
NEXT li1
*again:
CALL Hand.Get(0, state(), F9)
IF state(0) = 1 THEN
  STOP
ENDIF
GIVEARM
END
""",
        [[10, 20, 30, 40, 50, 60], [1, 2, 3, 4, 5, 6]],
    ),
    (
        "mitsubishi-melfa",
        """\
1 ' -- pick --
2 Def Plt 1, PA, PB, PC, , 3, n%, 1
3 Def Io Lamp = Bit, 17    'Lampe
4 Def Act 1, M_In(17) = 1 GoSub *Stop, L
5 If M_In(1) = 1 Then M_Out(8) = 1 Else GoTo *Stop
6 Mov J1 Wth M_Out(17) = 1
7 Mvs (Plt 1, n%), -50 Type 0, 0
8 M1 = &HFF + 10000&
9 Ovrd M1 * 2
10 Select M1
11 End Select
12 *Stop:Dly(0.1)
13 GoTo *Elsewhere
14 Return 0
J1=(+1.00,+2.00,+3.00,+4.00,+5.00,+6.00)
""",
        [[1, 2, 3, 4, 5, 6]],
    ),
    (
        "mitsubishi-melfa",
        "Servo On\n*MAIN\nMov J1\nP2 = P1\nGoTo *MAIN\nJ1=(+1,+2,+3,+4,+5,+6)\n",
        [[1, 2, 3, 4, 5, 6]],
    ),
    (
        "kawasaki-as",
        """\
.PROGRAM a.main(.n)@25/10/31 16:24 #0
  SPEED 100 MM/S, 30 DEG/S ALWAYS
  JOINT SPEED9 ACCU1 TIMER0 TOOL1 WORK0 CLAMP1 (OFF,0,0,O) OX= WX= #[0,0,-90,0,-90,4.6e-05] ;
  LINEAR 250. ACCU1 TIMER0 TOOL1 WORK0 CLAMP OX= WX= #[1,2,3,4,5,6] ;
  SCASE $a OF
   SVALUE "GO":
    PULSE 2500
  END
  again:
  IF SIG(1) GOTO again
  IF .n > 0
    $s = $s + $ENCODE(/L, -SIG(33)) + "\\n"
  END
  POINT/X p = q
  POINT/7 p = q
  POINT p = q,#r
.END
""",
        [[0, 0, -90, 0, -90, 4.6e-05], [1, 2, 3, 4, 5, 6]],
    ),
    (
        "doosan-drl",
        """\
#!/usr/bin/env python3
import time
from DSR_ROBOT2 import (posj, movej)
global home
home = posj( 1 , 2 , 3 , 4 , 5 , 6 )
cfg = {'ip': '10.0.0.1', "port": 502}
class Hand( ):
    def __init__(self , *given, port = 1) :
        self.n, self.ip = port, cfg['ip']
    def open(self) :
        with lock: self.n += 1
        return self.n if self.n & 0x0F else -1
a = b = [i * 2 for i in range(3)]
if not a[0] == 1 or len(a[1:]) > 2 : tp_log('a: %d %s' % (a[0], "b"))
for i in range(3): wait(0.1)
s = str(a[-1]) + f"{b}"; n = -a[0]
movej(home, vel=30, acc=30)
""",
        [[1, 2, 3, 4, 5, 6]],
    ),
    (
        "doosan-drl",
        """\
def Spray(value: int, long: bool = True):
    output = 5
    if value == 0:
        set_digital_output(output, 0)
    else:
        set_digital_output(output, 1)
set_velj(50); set_accj(50)
movejx(posx(400, 0, 500, 0, 180, 0), vel=30, acc=30, sol=2)
movej(posj(0, 0.00001, 90,
           0, 90, 0), 30, 30, 0, 0)
""",
        [[0, 0.00001, 90, 0, 90, 0]],
    ),
]


@pytest.mark.parametrize(("name", "text", "joints"), OTHERS)
def test_what_others_write_has_no_error_and_its_joints_are_read(name, text, joints):
    assert [p for p in check(name, text) if p.level == "error"] == []
    assert [*shown(parse(name, text)).values()] == joints


RULES = [
    ("denso-pac", "syntax", "Delay", "Dely"),
    ("denso-pac", "syntax", "Move P, ", "P, "),
    ("denso-pac", "syntax", "Call ", ""),
    ("denso-pac", "block", "End Sub", ""),
    ("denso-pac", "main", "Sub Main", "Sub Other"),
    ("denso-pac", "arm", "  TakeArm Keep = 0\n", ""),
    ("denso-pac", "position", "J(-1.000000, ", "J("),
    ("denso-pac", "position", "-1.000000", "-1.000000 * 2"),
    ("denso-pac", "position", "J(-1", "(-1"),
    ("denso-pac", "range", "(-1.000000", "(-721.000000"),
    ("denso-pac", "range", "Speed 10", "Speed 0"),
    ("denso-pac", "standstill", "@E", "@P"),
    ("denso-pac", "standstill", "6.000000)", "6.000000), Next"),
    ("denso-pac", "wait-to-measure", "Delay 1000", "Speed 10"),
    ("doosan-drl", "syntax", "mwait()", "mwait("),
    ("doosan-drl", "indent", "    tp_log", "  tp_log"),
    ("doosan-drl", "indent", "mwait()", "  mwait()"),
    ("doosan-drl", "name", "MEASURE(1)", "MEASURES(1)"),
    ("doosan-drl", "name", "vel=", "vel=="),
    ("doosan-drl", "arguments", "vel=", "speed="),
    ("doosan-drl", "arguments", "wait(1.000)", "wait()"),
    ("doosan-drl", "arguments", "movej(posj(", "movej(("),
    ("doosan-drl", "arguments", "5, ON", "5% ON"),
    ("doosan-drl", "arguments", "str(number)", "(number)"),
    ("doosan-drl", "arguments", "str(number)", "str()"),
    ("doosan-drl", "position", "posj(-1.000000, ", "posj("),
    ("doosan-drl", "position", "-1.000000,", "--1.000000,"),
    ("doosan-drl", "range", "(-1.00", "(-721.00"),
    ("doosan-drl", "range", "wait(1.000)", "wait(-1.000)"),
    ("doosan-drl", "arguments", "acc=17.19)", "acc=17.19, pos=0)"),
    ("doosan-drl", "arguments", " + str", " ++ str"),
    ("doosan-drl", "arguments", 'str(number) + " q="', 'str(number) % " q="'),
    ("doosan-drl", "range", "output(5", "output(17"),
    ("doosan-drl", "standstill", "acc=17.19)\nmwait()", "acc=17.19, r=5)"),
    ("doosan-drl", "wait-to-measure", "wait(1.000)", "mwait()"),
    ("kawasaki-as", "syntax", "BREAK", "BREAKE"),
    ("kawasaki-as", "syntax", "TWAIT 1.000", "TWAIT 1.000 1"),
    ("kawasaki-as", "syntax", "CALL ", ""),
    ("kawasaki-as", "block", ".END\n.J", ".J"),
    ("kawasaki-as", "block", "  BREAK", "  END"),
    ("kawasaki-as", "position", "6.000000\n", "6.000000 0.5\n"),
    ("kawasaki-as", "range", "] -1.000000", "] -721.000000"),
    ("kawasaki-as", "range", "SPEED 10", "SPEED 0"),
    ("kawasaki-as", "arguments", "PULSE 5", "PULSE 5.5"),
    ("kawasaki-as", "range", "PULSE 5", "PULSE 1000"),
    ("kawasaki-as", "range", "TWAIT 1.000", "TWAIT -1.000"),
    ("kawasaki-as", "arguments", "TWAIT 1.000", 'TWAIT "x"'),
    ("denso-pac", "range", "Delay 1000", "Delay -1000"),
    ("denso-pac", "arguments", "Speed 10", 'Speed "x"'),
    ("mitsubishi-melfa", "range", "Dly 1.000", "Dly -1.000"),
    ("mitsubishi-melfa", "arguments", "JOvrd 10", 'JOvrd "x"'),
    ("kawasaki-as", "target", "JMOVE #Calib.p[1]", "JMOVE #Calib.p[9]"),
    ("kawasaki-as", "target", "JMOVE #Calib.p[1]", "JMOVE Calib.p[1]"),
    ("kawasaki-as", "standstill", "BREAK", "TWAIT 1"),
    ("kawasaki-as", "wait-to-measure", "TWAIT 1.000", "SPEED 10 ALWAYS"),
    ("kawasaki-as", "speed", " ALWAYS", ""),
    ("kawasaki-as", "unused", "JMOVE #Calib.p[1]", "JMOVE #Calib.p[2]"),
    ("mitsubishi-melfa", "syntax", "Cnt 0", "Cnt 0 0"),
    ("mitsubishi-melfa", "syntax", "5 Cnt", "5 Cntt"),
    ("mitsubishi-melfa", "step", "9 Dly", "8 Dly"),
    ("mitsubishi-melfa", "position", ",2.00000,", "-2.00000,"),
    ("mitsubishi-melfa", "range", "(-1.00000", "(-721.00000"),
    ("mitsubishi-melfa", "range", "JOvrd 10", "JOvrd 0"),
    ("mitsubishi-melfa", "target", "Mov J1", "Mov J9"),
    ("mitsubishi-melfa", "wait-to-measure", "9 Dly 1.000", "9 Cnt 0"),
    ("mitsubishi-melfa", "unused", "Mov J1", "Mov J2"),
]


@pytest.mark.parametrize(("name", "rule", "old", "new"), RULES)
def test_a_program_that_breaks_a_rule(name: str, rule: str, old: str, new: str) -> None:
    text = WRITTEN[name][1]
    assert old in text
    assert rule in {p.rule for p in check(name, text.replace(old, new, 1))}


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("denso-pac", {"keep": "register"}, "keep no registers"),
        ("doosan-drl", {"keep": "register"}, "keep no registers"),
        ("doosan-drl", {"measure_output": 17}, "measure_output is 17"),
    ],
)
def test_what_a_language_does_not_have_is_refused(name, changes, message):
    program = WRITTEN[name][0]
    with pytest.raises(InputError, match=message):
        DIALECTS[name].files(replace(program, options=replace(program.options, **changes)))


def test_a_position_of_melfa_has_eight_values_at_most() -> None:
    program = PoseProgram("CAL", (ProgramPose("T", np.zeros(9)),))
    with pytest.raises(InputError, match="at most 8 values"):
        DIALECTS["mitsubishi-melfa"].files(program)


def test_names_that_are_words_or_leave_no_room_for_their_ending() -> None:
    with pytest.raises(InputError, match="'movej' is not a DRL name"):
        DIALECTS["doosan-drl"].files(replace(WRITTEN["doosan-drl"][0], name="movej"))
    longest = replace(WRITTEN["kawasaki-as"][0], name="a" * 13)
    assert f"#{'a' * 13}.p[1]" in next(iter(DIALECTS["kawasaki-as"].files(longest).values()))
    assert not DIALECTS["kawasaki-as"].names.is_legal("a" * 14)


ASSIGNED = """\
1 Ovrd 10
2 J1 = (10.0,20.0,80.0,5.0,30.0,15.0)
3 Mov J1
4 Mov J2
5 End
J1=(0.0,0.0,0.0,0.0,0.0,0.0)
J2=(1.0,2.0,3.0,4.0,5.0,6.0)
"""


@pytest.mark.parametrize("numbered", [True, False])
def test_a_value_is_the_one_of_the_move(numbered: bool) -> None:
    text = ASSIGNED if numbered else "\n".join(re.sub(r"^\d ", "", s) for s in ASSIGNED.split("\n"))
    back = parse("mitsubishi-melfa", text)
    assert shown(back) == {1: [10, 20, 80, 5, 30, 15], 2: [1, 2, 3, 4, 5, 6]}
    assert [p.line for p in back.positions] == [2, 7]
    assert [p for p in check("mitsubishi-melfa", text) if p.level == "error"] == []


@pytest.mark.parametrize(
    "step",
    [
        "J2 = J_Curr",
        "J2.J1 = 3",
        "J2 = J1 + J3",
        "If M1 = 1 Then J2 = J1",
    ],
)
def test_a_position_of_melfa_that_steps_change_is_unread(step: str) -> None:
    text = ASSIGNED.replace("4 Mov J2", f"4 {step}\n5 Mov J2").replace("5 End", "6 End")
    back = DIALECTS["mitsubishi-melfa"].parse(text.encode(), Path("CALIB"))
    assert [p.name for p in back.positions if p.name != "J1"] == []
    assert "J2" in " ".join(error.message for error in back.unread)
    assert "J2 is" in " ".join(p.message for p in check("mitsubishi-melfa", text))


def test_what_a_loop_changes_is_not_what_it_was_the_first_time() -> None:
    text = ASSIGNED.replace("1 Ovrd 10", "1 *on").replace("5 End", "5 GoTo *on")
    back = DIALECTS["mitsubishi-melfa"].parse(text.encode(), Path("CALIB"))
    assert [p.name for p in back.positions] == ["J2"]
    assert [error.row for error in back.unread] == [3]


def test_a_prg_is_the_language_that_it_is_written_in(tmp_path: Path) -> None:
    module = export("abb.mod")
    for name, text in (("mitsubishi-melfa", ASSIGNED), ("abb-rapid", module)):
        path = tmp_path / "CALIB.prg"
        path.write_bytes(text.encode("latin-1"))
        assert dialect_of_file(path).name == name
        assert read(path).positions
    path.write_text("Print 1\n")
    with pytest.raises(FileFormatError, match="is none of abb-rapid"):
        read(path)


@pytest.mark.parametrize("change", ["POINT #b = #a", "HERE #b", "IF n > 0\n HERE #b\n END"])
def test_a_position_of_kawasaki_that_steps_change_is_unread(change: str) -> None:
    head = f".PROGRAM x()\n  JMOVE #a\n  {change}\n  JMOVE #b\n.END\n"
    text = f"{head}.JOINTS\n#a 1 2 3 4 5 6\n#b 6 5 4 3 2 1\n.END\n"
    back = DIALECTS["kawasaki-as"].parse(text.encode(), Path("x.as"))
    assert [p.name for p in back.positions] == ["#a"]
    assert "#B is changed by the program" in back.unread[0].message
    given = text.replace(change, "POINT #b = #[9,8,7,6,5,4]")
    assert shown(parse("kawasaki-as", given))[2] == [9, 8, 7, 6, 5, 4]
