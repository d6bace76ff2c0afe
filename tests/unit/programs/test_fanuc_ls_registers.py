"""FANUC position registers: kept by the program, and read back from a backup."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.errors import FileFormatError, InputError
from posedesign.programs import DIALECTS, PoseProgram, ProgramOptions, ProgramPose, read, validate
from posedesign.programs.fanuc_ls.registers import parse_registers

BACKUP = """\
[*POSREG*]$POSREG  Storage: SHADOW  Access: RW  : ARRAY[2,8] OF Position Reg
    [1,1] =   'HOME'   Group: 1
  J1 =    60.000 deg   J2 =   -50.000 deg   J3 =    10.000 deg
  J4 =   -10.000 deg   J5 =   -95.000 deg   J6 =     -.500 deg
  EXT1:     0.000 mm

    [1,2] =   '' Uninitialized
    [1,3] =   'pin'
  Group: 1   Config: N U T, 0, 0, 1
  X:  -820.507   Y:  2309.503   Z:   945.836
  W:    90.594   P:    -1.149   R:  -160.248
  EXT1:     0.000 mm
    [1,8] = '' Uninitialized
    [2,1] =   'turn'   Group: 2
  J1 =    45.000 deg
[*POSREG*]$MAXPREGNUM  Storage: CMOS  Access: RW  : INTEGER = 100
"""
POSES = tuple(ProgramPose(f"P{i}", np.radians([i, 20, -30, 0, -50, 60])) for i in range(3))


def test_a_backup_is_read_by_register(tmp_path: Path) -> None:
    path = tmp_path / "POSREG.VA"
    path.write_bytes(BACKUP.replace("\n", "\r\n").encode())
    program = read(path)
    assert [(p.number, p.name, p.line) for p in program.positions] == [
        (1, "HOME", 2),
        (3, "pin", 8),
    ]
    joints, pose = program.positions
    np.testing.assert_allclose(joints.shown_deg, [60, -50, 10, -10, -95, -0.5])
    assert pose.T_user_tool is not None
    np.testing.assert_allclose(pose.T_user_tool[:3, 3], [-0.820507, 2.309503, 0.945836])
    assert pose.configuration is not None
    assert pose.configuration.words == "N U T, 0, 0, 1"
    assert not program.fingerprint


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("[*POSREG*]$POSREG", "[*NUMREG*]$NUMREG", 1, r"there is no \$POSREG"),
        ("J3 =    10.000", "J3 =   *******", 3, r"PR\[1\]: J3 has no value"),
        ("J3 =    10.000 deg", "", 2, r"PR\[1\]: J3 is missing"),
        ("J3 =    10.000", "J3 =    1e.000", 3, "not a number"),
        ("J3 =", "J2 =", 3, r"PR\[1\] has J2 twice"),
        ("W:    90.594", "", 9, r"PR\[3\]: W is missing"),
        ("Config: N U T", "Config: N Q T", 9, r"PR\[3\]"),
        ("EXT1:     0.000 mm\n    [1,8]", "EXT1:     1.000 mm\n    [1,8]", 12, "E1 differs"),
        ("    [1,1] =   'HOME'   Group: 1\n", "", 2, "cannot make sense of"),
        ("J3 =", "?3 =", 3, "cannot make sense of"),
        ("    [1,8] = '' Uni", "    [1,1] = '' Uni", 13, r"PR\[1\] is there twice"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    assert BACKUP.count(old) == 1
    with pytest.raises(FileFormatError, match=message) as caught:
        parse_registers(BACKUP.replace(old, new).encode(), "POSREG.VA")
    assert caught.value.row == line


def test_empty_registers_are_no_positions() -> None:
    text = BACKUP.splitlines()[0] + "\n    [1,1] = '' Uninitialized\n"
    with pytest.raises(FileFormatError, match="all registers are empty"):
        parse_registers(text.encode(), "POSREG.VA")


@settings(max_examples=100, deadline=None)
@given(st.integers(0, len(BACKUP)), st.integers(0, 20), st.text(max_size=5))
def test_damaged_backups_are_refused_or_read(at: int, length: int, piece: str) -> None:
    text = BACKUP[:at] + piece + BACKUP[at + length :]
    try:
        program = parse_registers(text.encode("utf-8", "surrogatepass"), "POSREG.VA")
    except FileFormatError:
        return
    assert program.positions


def test_a_program_keeps_the_touched_up_positions_in_registers(tmp_path: Path) -> None:
    dialect = DIALECTS["fanuc-ls"]
    options = ProgramOptions(keep="register", first_register=41, measure_argument=7)
    (path,) = dialect.write(PoseProgram("CAL", POSES, options), tmp_path)
    assert validate(path) == []
    kept = re.findall(r"CALL (MEASURE\(7\)) ;\r?\n +\d+:  (PR\[\d+\]=JPOS) ;", path.read_text())
    assert [register for _, register in kept] == [f"PR[{k}]=JPOS" for k in (41, 42, 43)]
    with pytest.raises(InputError, match=r"would need PR\[102\]"):
        dialect.files(
            PoseProgram("CAL", POSES, ProgramOptions(keep="register", first_register=100))
        )


def test_an_output_is_pulsed_and_the_argument_is_the_users() -> None:
    dialect = DIALECTS["fanuc-ls"]

    def body(**options: object) -> str:
        program = PoseProgram("CAL", POSES[:1], ProgramOptions(**options))  # type: ignore[arg-type]
        (text,) = dialect.files(program).values()
        return text

    assert "  DO[3]=PULSE,0.5sec ;" in body(measure_output=3, measure_pulse_s=0.5)
    assert "CALL MEASURE ;" in body(measure_argument=None)
    assert "CALL MEASURE((-4)) ;" in body(measure_argument=-4)
