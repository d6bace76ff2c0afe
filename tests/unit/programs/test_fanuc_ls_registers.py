"""FANUC position registers: kept by the program, and read back from a backup."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from calib.errors import FileFormatError, InputError
from posedesign.programs import DIALECTS, PoseProgram, ProgramOptions, ProgramPose, read, validate
from posedesign.programs.fanuc_ls.reader import parse_registers
from tests.unit.programs.dialects import changed, export, refused

BACKUP = export("fanuc_registers.VA")
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
        ("J3 =    10.000", "J3 =    1e.000", 3, "cannot stand behind"),
        ("J3 =", "J2 =", 3, r"PR\[1\] has J2 twice"),
        ("W:    90.594", "", 8, r"PR\[3\]: W is missing"),
        ("Config: N U T", "Config: N Q T", 8, r"PR\[3\]"),
        ("EXT1:     0.000 mm\n    [1,8]", "EXT1:     1.000 mm\n    [1,8]", 12, "E1 differs"),
        ("    [1,1] =   'HOME'   Group: 1\n", "", 2, "cannot make sense of"),
        ("J3 =", "?3 =", 3, "cannot make sense of"),
        ("    [1,8] = '' Uni", "    [1,1] = '' Uni", 13, r"PR\[1\] is there twice"),
    ],
)
def test_what_is_wrong_is_named_with_its_line(old: str, new: str, line: int, message: str) -> None:
    refused("fanuc-ls", "POSREG.VA", changed(BACKUP, old, new), line, message)


def test_empty_registers_are_no_positions() -> None:
    text = BACKUP.splitlines()[0] + "\n    [1,1] = '' Uninitialized\n"
    with pytest.raises(FileFormatError, match="all registers are empty"):
        parse_registers(text.encode(), "POSREG.VA")


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
