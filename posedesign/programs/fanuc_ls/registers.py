"""FANUC position registers as a backup holds them (``POSREG.VA``): the reader.

For programs that keep the touched-up positions in registers: PR[n] becomes position n. Registers
without a position are passed over, and so is what belongs to other motion groups than the first.
The layout is that of public backups::

    [*POSREG*]$POSREG  Storage: SHADOW  Access: RW  : ARRAY[1,100] OF Position Reg
        [1,1] =   'HOME'   Group: 1
      J1 =    60.000 deg   J2 =   -50.000 deg   J3 =    10.000 deg
      J4 =   -10.000 deg   J5 =   -95.000 deg   J6 =   -50.000 deg

        [1,2] =   '' Uninitialized
        [1,3] =   ''
      Group: 1   Config: N U T, 0, 0, 0
      X:  -820.507   Y:  2309.503   Z:   945.836
      W:    90.594   P:    -1.149   R:  -160.248
"""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

from posedesign.programs.fanuc_ls.listing import Group
from posedesign.programs.fanuc_ls.reader import check_other_axes, recorded
from posedesign.programs.reading import refuse, text_lines
from posedesign.programs.recorded import PlanMark, RecordedProgram

_HEADING = re.compile(r"\s*\[\*POSREG\*\]\s*\$POSREG\b")
_OTHER = re.compile(r"\s*\[\*\w{1,12}\*\]")
_ENTRY = re.compile(r"\s*\[(\d{1,2}),(\d{1,5})\]\s*=\s*'([^']{0,60})'(.*)")
_GROUP = re.compile(r"\s*Group:\s*(\d{1,2})\s*(?:Config:\s*(.{0,40}))?")
_JOINT = re.compile(r"\s*(J\d)\s*=\s*(\S+)\s*(deg|mm)")
_AXIS = re.compile(r"\s*([XYZWPR]):\s*(\S+)")
_EXTENDED = re.compile(r"\s*EXT(\d):\s*(\S+)\s*(mm|deg)?")


@dataclass
class _Register:
    number: int
    name: str
    line: int
    group: Group | None = field(default=None)


def parse_registers(data: bytes, path: Path | str) -> RecordedProgram:
    """Positions of all registers that have one, by their numbers.

    Raises FileFormatError: the file is no such backup, holds no positions, or one that is damaged.
    """
    registers: list[_Register] = []
    numbers: set[int] = set()
    inside = found = False
    for row, line in enumerate(text_lines(data, path), start=1):
        if _HEADING.match(line):
            inside = found = True
        elif _OTHER.match(line):
            inside = False
        elif inside and line.strip():
            _take(registers, numbers, line, path, row)
    if not found:
        refuse("is no backup of position registers: there is no $POSREG", path, 1, "POSREG.VA")
    filled = [r for r in registers if r.group is not None]
    if not filled:
        refuse("holds no positions: all registers are empty", path, hint="save the backup again")
    groups = {f"PR[{r.number}]": r.group for r in filled if r.group is not None}
    check_other_axes({label: {1: group} for label, group in groups.items()}, path)
    positions = tuple(
        recorded(label, r.number, r.name, r.line, group, path)
        for r, (label, group) in zip(filled, groups.items(), strict=True)
    )
    return RecordedProgram("POSREG", "", PlanMark(), positions, "fanuc", in_registers=True)


def _take(
    registers: list[_Register], numbers: set[int], line: str, path: Path | str, row: int
) -> None:
    """Add one line of the table to what is known of its registers, and their numbers."""
    entry = _ENTRY.match(line)
    if entry:
        arm = int(entry[1]) == 1
        number = int(entry[2]) if arm else 0  # 0: of another group, which is passed over
        if arm and number in numbers:
            refuse(f"PR[{number}] is there twice", path, row, "remove one of them")
        numbers.add(number)
        registers.append(_Register(number, entry[3].strip(), row))
        line = entry[4]
        if line.strip() == "Uninitialized":
            return
    if not registers:
        refuse(f"cannot make sense of {line.strip()[:30]!r}", path, row)
    register = registers[-1]
    at = 0
    while line[at:].strip():
        at = _token(register, line, at, path, row)
    if register.number == 0:
        register.group = None


def _token(register: _Register, line: str, at: int, path: Path | str, row: int) -> int:
    """Take one field of a line; return where the next begins."""
    label = f"PR[{register.number}]"
    group = _GROUP.match(line, at)
    if group:
        if register.group is None:
            register.group = Group(row)
        register.group.config = group[2].strip() if group[2] else None
        return group.end()
    value = _JOINT.match(line, at) or _AXIS.match(line, at) or _EXTENDED.match(line, at)
    if value is None:
        refuse(f"{label}: cannot make sense of {line[at:].strip()[:30]!r}", path, row)
    if register.group is None:
        register.group = Group(row)
    name, text = value[1], value[2]
    unit = "mm" if name in "XYZ" else "deg"
    if value.re is _EXTENDED:
        name, unit = f"E{name}", value[3] or ""
    elif value.re is _JOINT:
        unit = value[3]
    if name in register.group.fields:
        refuse(f"{label} has {name} twice", path, row)
    register.group.fields[name] = (text, unit, row)
    return value.end()
