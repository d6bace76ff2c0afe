"""Yaskawa jobs: the reader takes what controllers save, and says the line of what it refuses."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError
from posedesign.programs import RecordedProgram
from posedesign.programs.configurations import YaskawaConfiguration
from posedesign.programs.yaskawa_jbi import YaskawaJbi
from tests.unit.programs.dialects import changed, export, shown

PULSES = (1000.0, -2000.0, 500.0, 100.0, -100.0, 50.0)
PATH = Path("X.JBI")

# In the manner of a controller with a rail, a station and a second robot: comments in another
# character set, tabs, steps added by hand, variables of several kinds.
EXPORT = export("yaskawa.JBI")


def parse(text: str, dialect: YaskawaJbi | None = None) -> RecordedProgram:
    return (dialect or YaskawaJbi()).parse(text.encode("latin-1"), PATH).whole()


def test_a_controllers_job_is_read() -> None:
    program = parse(EXPORT.replace("\n", "\r\n"))
    assert (program.name, program.comment) == ("Touch-up_1", "after service")
    assert (program.mark.fingerprint, program.mark.measured) == ("00c0ffee", 2)
    # C00001, C00004, C00005 and P00008 belong to no pose; C00002 is the second robot's
    assert [p.number for p in program.positions] == [1, 3, 2, 4, 5, 6]
    assert [p.name for p in program.positions] == ["", "", "left of it", "", "", ""]
    assert shown(program) == {
        1: [3, 0, 0, 0, 0, 0],  # what GETS stored behind the call
        3: [2, 2, 0, 0, 0, 0],
        6: [0] * 6,
    }
    assert [p.user_frame for p in program.positions] == [None, None, 0, 12, 0, None]
    in_base = [p.T_world_user is not None for p in program.positions]
    assert in_base == [False, False, True, False, True, False]
    np.testing.assert_array_equal(program.positions[2].T_world_user, np.eye(4))
    assert [p.tool_frame for p in program.positions] == [4, 3, 3, 4, 4, 4]
    at_base = program.positions[2]
    assert at_base.configuration == YaskawaConfiguration(1, 0, 0, 0, 0, 0)
    assert at_base.T_user_tool is not None
    np.testing.assert_allclose(at_base.T_user_tool[:3, 3], [0.82, 0, 0.614])
    np.testing.assert_allclose(at_base.T_user_tool[:3, :3], np.diag([1, -1, -1]), atol=1e-15)
    lines = EXPORT.splitlines()
    names = [lines[p.line - 1].split("=")[0] for p in program.positions]
    assert names == ["P00007", "C00001", "C00003", "C00004", "C00005", "P00008"]


SMALL = """\
/JOB
//NAME CAL
//POS
///NPOS 2,0,0,0,0,0
///TOOL 0
///POSTYPE PULSE
///PULSE
C00000=1000,2000,500,100,100,50
C00001=2000,2000,500,100,100,50
//INST
///DATE 2026/01/01 00:00
///ATTR SC,RW
///GROUP1 RB1
NOP
MOVJ C00000 VJ=10.00
MOVJ C00001 VJ=10.00
END
"""


def test_touched_up_positions_in_variables() -> None:
    kept = NOTED.replace(
        "MOVJ C00000 VJ=10.00\n", "MOVJ C00000 VJ=10.00\nGETS PX001 $PX000\n"
    ).replace("MOVJ C00001 VJ=10.00\n", "MOVJ C00001 VJ=10.00\nGETS PX002 $PX000\n")
    planned = parse(kept)
    assert planned.empty_registers
    assert shown(planned) == shown(parse(NOTED))
    assert not parse(NOTED).empty_registers
    one = kept.replace("NPOS 2,0,0,0", "NPOS 2,0,0,1").replace(
        "//INST", "P00002=4000,2000,500,100,100,50\n//INST"
    )
    # the planned position of a pose that was not measured is not taken for a measured one
    assert shown(parse(one)) == {2: [4.0, -1, 1, 1, -1, 1]}
    assert not parse(one).empty_registers


RATIOS = "".join(f"'PULSES {a} {v}\n" for a, v in zip("SLURBT", PULSES, strict=True))
NOTED = SMALL.replace("NOP\n", "NOP\n" + RATIOS + "'POSE 1\n").replace(
    "MOVJ C00001", "'POSE 2\nMOVJ C00001"
)
RECTAN = SMALL.replace(
    "POSTYPE PULSE\n///PULSE", "POSTYPE BASE\n///RECTAN\n///RCONF 1,0,0,0,0,0,0,0"
)


def test_jobs_without_ratios_need_them() -> None:
    with pytest.raises(FileFormatError, match="does not say how many are a degree") as caught:
        parse(SMALL)
    assert caught.value.row == 8
    assert "the six of S L U R B T as pulses_per_deg" in caught.value.hint
    given = YaskawaJbi().reading(PULSES)
    assert given.reading(()) is given
    expected = {1: [1.0, -1, 1, 1, -1, 1], 2: [2.0, -1, 1, 1, -1, 1]}
    assert (
        shown(parse(SMALL, given)) == shown(parse(NOTED)) == shown(parse(NOTED, given)) == expected
    )
    with pytest.raises(FileFormatError, match="are not those given"):
        parse(NOTED, YaskawaJbi((*PULSES[:5], 51.0)))
    assert len(parse(RECTAN).positions) == 2  # poses need none


def test_joints_in_degrees_need_no_ratios() -> None:
    text = SMALL.replace("PULSE\n///PULSE", "ANGLE\n///ANGLE").replace("00,2000,500,", "0.25,-2,5,")
    assert shown(parse(text)) == {
        1: [100.25, -2, 5, 100, 100, 50],
        2: [200.25, -2, 5, 100, 100, 50],
    }
    with pytest.raises(FileFormatError, match="S is 1000, 1000 deg"):
        parse(text.replace("100.25", "1000"))


@pytest.mark.parametrize(
    ("source", "old", "new", "line", "message"),
    [
        (NOTED, "/JOB\n", "", 24, "is no whole job: .* there is //POS, //INST, END"),
        (NOTED, "END\n", "", 10, "is no whole job"),
        (NOTED, "END\n", "END\n/JOB\n", 26, "is no whole job"),
        (NOTED, "//POS\n", "//INST\n", 25, "is no whole job"),
        (NOTED, "//NAME CAL\n", "", 1, "has no name"),
        (NOTED.replace("\n", "\r\n"), "END", "\0", 25, "holds the byte 0x00"),
        (NOTED, "CAL", "C\0L", 2, "holds the byte 0x00"),
        (NOTED, "///NPOS 2,0,0,0,0,0\n", "", 3, "has no ///NPOS"),
        (NOTED, "NPOS 2,", "NPOS 3,", 4, "says 3 C positions, there are 2"),
        (NOTED, "NPOS 2,0,0,0", "NPOS 2,0,0,1", 4, "says 1 P positions, there are 0"),
        (NOTED, "NPOS 2,", "NPOS x,", 4, "cannot stand behind '///NPOS"),
        (NOTED, "///TOOL 0", "///NPOS 2,0,0,0,0,0", 5, "has a second ///NPOS"),
        (NOTED, "TOOL 0", "TOOL x", 5, "cannot stand behind '///TOOL"),
        (NOTED, "TOOL 0", "TOOL 1000", 8, "///TOOL '1000' is not a number"),
        (NOTED, "///TOOL", "///TOL", 5, "did you mean ///TOOL"),
        (NOTED, "C00001=", "C00000=", 9, "C00000 is there twice"),
        (NOTED, "C00001=", "rubbish", 9, "rubbish"),
        (NOTED, "C00001=", "C100000=", 9, "too large a number"),
        (NOTED, "///PULSE\n", "", 7, "neither in pulses nor in a frame"),
        (NOTED, "POSTYPE PULSE", "POSTYPE BASE", 8, "neither in pulses nor in a frame"),
        (NOTED, "=1000,", "=", 8, "C00000 has 5 values"),
        (NOTED, "=1000,", "=1,2,", 8, "C00000 has 7 values"),
        (NOTED, "=1000,", "=1000.5,", 8, "S is '1000.5', not a whole number"),
        (NOTED, "=1000,", "=1e3,", 8, "'1e3,2000.* cannot stand"),
        (NOTED, "=1000,", "=,", 8, "cannot stand behind 'C00000="),
        (NOTED, "=1000,", "=720001,", 8, "S is 720001 pulses, 720 deg"),
        (NOTED, "'PULSES B -100.0\n", "", 8, "'PULSES B is lost"),
        (NOTED, "'PULSES B", "'PULSES T", 20, "the pulses/deg of T twice"),
        (NOTED, "'PULSES B -100.0", "'PULSES B 0.0", 8, "pulses_per_deg of B is 0"),
        (NOTED, "MOVJ C00000", "MOVJ C00009", 22, "C00009 is moved to, but not there"),
        (NOTED, "MOVJ C00000 VJ=10.00\n", "", 21, "POSE 1 is not followed by a move"),
        (NOTED, "MOVJ C00001 VJ=10.00\n", "", 23, "POSE 2 is not followed by a move"),
        (NOTED, "MOVJ C00000", "MOVJ P[I000]", 21, "POSE 1 is not followed by a move"),
        (NOTED, "'POSE 2", "'POSE 1", 23, "POSE 1 stands before two moves"),
        (NOTED, "'POSE 2", "'POSE 0", 23, "counted from 1"),
        (NOTED, "MOVJ C00001", "MOVJ C00000", 23, "position of POSE 1 and of POSE 2"),
        (RECTAN, "///RCONF 1,0,0,0,0,0,0,0\n", "", 8, "C00000 has no ///RCONF above"),
        (RECTAN, "RCONF 1,", "RCONF 2,", 9, "is not one of a six-axis"),
        (RECTAN, "POSTYPE BASE", "POSTYPE USER", 9, "no ///USER says which"),
        (RECTAN, "POSTYPE BASE", "POSTYPE MTOOL", 9, "in the frame 'MTOOL'"),
        (RECTAN, "=1000,", "=nan,", 9, "'nan,2000.* cannot stand"),
        (RECTAN, "=1000,", "=1000000,", 9, "beyond"),
        (RECTAN, "=1000,2000,500,100", "=1000,2000,500,721", 9, "Rx .* beyond"),
        (RECTAN, "2,0,0,0,0,0", "0,0,0,0,0,0", 4, "says 0 C positions"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(source, old, new, line, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(changed(source, old, new))
    assert caught.value.row == line
    assert caught.value.hint
    assert "X.JBI" in str(caught.value)


def test_a_job_without_positions() -> None:
    text = re.sub(r"(?m)^(C0000|MOVJ).*\n", "", SMALL).replace("NPOS 2", "NPOS 0")
    with pytest.raises(FileFormatError, match="holds no positions"):
        parse(text)


def test_axes_that_carry_the_arm_stand_still() -> None:
    moved = EXPORT.replace("C00003 BC00000", "C00003 BC00001")
    with pytest.raises(FileFormatError, match="base axes stand elsewhere") as caught:
        parse(moved).postures()
    # the poses are compared in the order of their positions, C00000 first
    assert moved.splitlines()[(caught.value.row or 0) - 1].startswith("MOVL C00003")
    with pytest.raises(FileFormatError, match="station axes stand elsewhere"):
        parse(EXPORT.replace("EC00001=15505", "EC00001=15506"))
    with pytest.raises(FileFormatError, match="base axes stand elsewhere"):
        parse(EXPORT.replace("C00003 BC00000 EC00000", "C00003 EC00000")).postures()


def test_positions_are_counted_without_comments() -> None:
    text = re.sub(r"(?m)^' ?POSE.*\n", "", EXPORT).replace("BC00001 EC", "BC00000 EC")
    assert [p.number for p in parse(text).positions] == [1, 2, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("MOVJ C00001 VJ", "MOVJJ C00001 VJ", "'MOVJJ' is no instruction"),
        ("MOVJ C00001 VJ=10.00", "MOVJ C00001 VJ=1_0", "cannot stand"),
        ("MOVJ C00001 VJ=10.00\n", "MOVJ C00001 VJ=10.00END C00000\n", "cannot stand"),
    ],
)
def test_a_step_that_is_no_inform_and_names_a_position(old: str, new: str, message: str) -> None:
    with pytest.raises(FileFormatError, match=message) as caught:
        parse(NOTED.replace(old, new))
    assert caught.value.row == 24
    others = NOTED.replace("END\n", "MY-OPTION P001 3\nEND\n")
    assert shown(parse(others)) == shown(parse(NOTED))


def test_what_controllers_leave_out_is_read() -> None:
    """The frame changes without another ///RECTAN; a job has arguments; RCONF as of NX100."""
    text = RECTAN.replace("1,0,0,0,0,0,0,0", "1,0,0,0,0,0").replace(
        "C00001=", "///USER 3\n///POSTYPE USER\nC00001="
    )
    names = "\n".join(["Tool", "", "C00000=1"])
    argued = text.replace("//INST", f"//ARGINFO\n///ARGTYPE B,,\n///COMMENT\n{names}\n//INST")
    read = parse(argued).positions
    assert [p.user_frame for p in read] == [0, 3]
    assert [p.configuration for p in read] == [YaskawaConfiguration(1, 0, 0, 0, 0, 0)] * 2


def test_steps_of_another_robot_may_have_their_own_line() -> None:
    text = NOTED.replace("NPOS 2", "NPOS 3").replace("//INST", "C00002=7,7,7,7,7,7\n//INST")
    assert shown(parse(text.replace("END\n", "+MOVJ C00002 VJ=1.00\nEND\n"))) == shown(parse(NOTED))


@pytest.mark.parametrize("step", ["SET P007 P008", "SETE P007 (1) 100", "ADD P007 P008"])
def test_a_variable_that_the_job_changes_is_unread(step: str) -> None:
    moved = EXPORT.replace("*LOOP\n", "*LOOP\nMOVJ P007 VJ=10.00\n")
    assert moved != EXPORT
    before = YaskawaJbi().parse(moved.encode("latin-1"), PATH)
    after = YaskawaJbi().parse(moved.replace("*LOOP\n", f"*LOOP\n{step}\n").encode("latin-1"), PATH)
    assert len(after.positions) == len(before.positions) - 1
    assert "P007 is changed by the job" in after.unread[0].message.replace("P00007", "P007")
