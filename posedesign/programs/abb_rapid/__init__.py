r"""ABB RAPID modules (``.mod``): the writer.

Joint positions are moved to with ``MoveAbsJ``, which knows no arm position to choose and no work
object; poses with ``MoveJ`` and their confdata. Tool and work object have names and no numbers in
RAPID: where the arm's frames are those of the faceplate and of the world they are ``tool0`` and
``wobj0``, else they are declared by value, the tool with mass and centre of what the arm carries.
Where that is not known, joint positions are moved to with ``tool0``, and the tool that poses need
has a stand-in, with a comment that asks to set it on the pendant.

All motions go to a stop point (``fine``), and ``WaitTime\InPos``, with 0 where no time is asked
for, waits until the arm stands. A digital output is the signal ``do`` with its number.

The routine has the module's name and ``_run``, and is started with PP to Routine or called: a task
has one global ``main``, and a second one beside that of a loaded MainModule stops it with "Global
routine name main ambiguous" (as users of IRC5 and OmniCore report). RAPID knows no percentage of
joint speeds: speeds are of the tool [mm/s] and of its rotation [deg/s] in joint motions too, so
that ``speed_percent`` is that of ``vmax``. They are data of the module and not VelSet: that is a
state of the task, which an aborted program leaves changed for whatever goes on from there.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from calib.se3 import FloatArray
from posedesign.programs import writing
from posedesign.programs.abb_rapid.reader import parse_abb_rapid
from posedesign.programs.abb_rapid.rules import check_abb_rapid
from posedesign.programs.arm import Arm, Load
from posedesign.programs.dialect import Dialect
from posedesign.programs.notation import QUATERNION, Notation, texts_of
from posedesign.programs.program import Form, PoseProgram
from posedesign.programs.writing import Limits, NameRule, Phrases, check_call, plain, plain_all

_RESERVED = """
ALIAS AND BACKWARD BASE CASE CJOINTT CONFJ CONNECT CONST DEFAULT DIV DO ELSE ELSEIF ENDFOR ENDFUNC
ENDIF ENDMODULE ENDPROC ENDRECORD ENDTEST ENDTRAP ENDWHILE ERROR EXIT FALSE FINE FOR FROM FUNC GOTO
IF INOUT JMEASURED JOINTTARGET LOCAL MAIN MOD MODULE MOVEABSJ MOVEC MOVEJ MOVEL NOSTEPIN NOT NOVIEW
OR PERS PROC PULSEDO RAISE READONLY RECORD RETRY RETURN ROBTARGET STEP SYSMODULE TASK TCALIB TEST
THEN TO TOOL0 TOOLDATA TRAP TRUE TRYNEXT UNDO USER VAR VCALIB VELSET VIEWONLY VMAX WAITTIME WCALIB
WHILE WITH WOBJ0 WOBJDATA XOR
"""

NAMES = NameRule("a RAPID name", 32, small=True, reserved=frozenset(_RESERVED.split()))
"""Names of modules and routines; letters of either case are the same."""

TOOL, WORK_OBJECT, SPEED, MEASURED = "tCalib", "wCalib", "vCalib", "jMeasured"
"""Names of what the module declares beside positions."""

TEXT_LENGTH = 80  # characters of a comment
LIMITS = Limits(TEXT_LENGTH, TEXT_LENGTH, pulse_s=(0.001, 2000.0))
"""Pulses are those that PulseDO gives."""

FASTEST = 5000, 500, 5000, 1000
"""Of the tool [mm/s], of its rotation [deg/s], and of external axes [mm/s, deg/s]: ``vmax``."""

LEAST_MASS_KG = 0.001  # the controller refuses a tool without mass
NOTATION = Notation(joint=5, place=4, turned=9, turn=QUATERNION, counts_at=7)
"""The controller keeps numbers of 24 bits, whose steps at 180 deg and 2000 mm are 0.00002 and
0.0001."""

_TO_POSE = f"    MoveJ p{{number}},{SPEED},fine,{{tool}}\\WObj:={{frame}};"
_PHRASES = Phrases(
    note="    ! {}",
    named="P",
    unnamed=False,
    move=(f"    MoveAbsJ jp{{number}}\\NoEOffs,{SPEED},fine,{{tool}};",),
    wait="    WaitTime\\InPos,{time:.2f};",
    pulse=("    PulseDO\\PLength:={time:.3f},do{output};",),
    call=("    {call} {argument};",),
    bare=("    {call};",),
    keep=f"    {MEASURED}{{{{{{register}}}}}}:=CJointT();",
    least_s=0.01,
    still="    WaitTime\\InPos,0;",
)

_POSITION = re.compile(r"J?P\d+", re.IGNORECASE)
_NOT_CONNECTED = "[9E9,9E9,9E9,9E9,9E9,9E9]"
_UNKNOWN_LOAD = "[1,[0,0,1],[1,0,0,0],0,0,0]"
_LEAST_LOAD = f"[{LEAST_MASS_KG},[0,0,0.001],[1,0,0,0],0,0,0]"
_IDENTITY_WITHIN = 1e-12


def render_abb_rapid(program: PoseProgram, arm: Arm) -> dict[str, str]:
    """Text of the module: joints to 5e-6 deg, poses to 5e-5 mm and 1e-9 of the quaternion."""
    options = program.options
    check_call(NAMES, options, run_name(program.name), _POSITION)
    tool = _tool_name(arm, options.form)
    work_object = _frame_name(arm.T_world_user, WORK_OBJECT, "wobj0")
    lines = [f"MODULE {program.name}"]
    lines += [f"  ! {text}" for text in writing.title_lines(program, TEXT_LENGTH)]
    lines += (
        _frames(arm, tool, work_object, options.form)
        + _positions(program, arm)
        + _measured(program)
    )
    speeds = ",".join(f"{fastest * options.speed_percent / 100:g}" for fastest in FASTEST)
    lines.append(f"  LOCAL CONST speeddata {SPEED}:=[{speeds}];")
    routine = run_name(program.name)
    lines += [f"  ! * start it with PP to Routine {routine}", f"  PROC {routine}()"]
    if options.form == "cartesian":
        lines.append("    ConfJ\\On;")
    phrases = _PHRASES if options.form == "joint" else replace(_PHRASES, move=(_TO_POSE,))
    lines += phrases.visit(program, LIMITS, tool=tool, frame=work_object)
    lines += ["  ENDPROC", "ENDMODULE", ""]
    return {f"{program.name}.mod": "\n".join(lines)}


def run_name(name: str) -> str:
    """The routine of a module: its name, shortened where it is long, and ``_run``."""
    return name[: NAMES.length - 4] + "_run"


def _tool_name(arm: Arm, form: Form) -> str:
    """The tool: one of our own for what the arm says of it, and tool0 for what it does not.

    Joint positions do not depend on the tool's frame, so for them a tool would only stand for a
    load, and one that is made up is worse than none.
    """
    carries = arm.load is not None and arm.load.mass_kg >= LEAST_MASS_KG
    if form == "joint":
        return TOOL if carries else "tool0"
    return TOOL if carries else _frame_name(arm.T_tip_tool, TOOL, "tool0")


def _frame_name(T: FloatArray, name: str, usual: str) -> str:
    return usual if np.abs(T - np.eye(4)).max() <= _IDENTITY_WITHIN else name


def _frames(arm: Arm, tool: str, work_object: str, form: Form) -> list[str]:
    """Declarations of the frames that are not the usual ones; joints need no work object."""
    frames = NOTATION.pose_texts(np.stack([arm.T_tip_tool, arm.T_world_user]))
    place_tool, place_user = map(_pose, frames)
    lines = []
    if tool == TOOL and arm.load is None:
        lines.append(f"  ! the load of {TOOL} is not known: set its mass and centre")
    if tool == TOOL:
        load = _load(arm.load)
        lines.append(f"  TASK PERS tooldata {TOOL}:=[TRUE,[{place_tool}],{load}];")
    if work_object == WORK_OBJECT and form == "cartesian":
        lines.append(
            f"  TASK PERS wobjdata {WORK_OBJECT}:="
            f'[FALSE,TRUE,"",[{place_user}],[[0,0,0],[1,0,0,0]]];'
        )
    return lines


def _load(load: Load | None) -> str:
    """Mass [kg] and centre in the wrist's frame [mm], as a point mass; at least one gram."""
    if load is None:
        return _UNKNOWN_LOAD
    if load.mass_kg < LEAST_MASS_KG:
        return _LEAST_LOAD
    return (
        f"[{plain(load.mass_kg, 3)},[{','.join(plain_all(1e3 * load.com_m, 2))}],[1,0,0,0],0,0,0]"
    )


def _positions(program: PoseProgram, arm: Arm) -> list[str]:
    lines = []
    for texts in sorted(texts_of(program, arm, NOTATION, NOTATION.place), key=lambda t: t.number):
        if texts.placed:
            kind, value = "robtarget p", f"{_pose(texts.placed)},{texts.words}"
        else:
            kind, value = "jointtarget jp", f"[{','.join(texts.joints)}]"
        # external axes, eax_a first; the others are not connected
        axes = ",".join([*texts.external, *["9E9"] * (6 - len(texts.external))])
        name = LIMITS.name_of(texts.pose)
        lines += [note[2:] for note in _PHRASES.note_of(texts.number, name)]
        lines.append(f"  LOCAL CONST {kind}{texts.number}:=[{value},[{axes}]];")
    return lines


def _pose(texts: list[str]) -> str:
    """``[x,y,z],[q1,q2,q3,q4]`` [mm]."""
    return f"[{','.join(texts[:3])}],[{','.join(texts[3:])}]"


def _measured(program: PoseProgram) -> list[str]:
    """The array of touched-up positions, without values at first."""
    if not program.registers:
        return []
    first, last = program.registers[0], program.registers[-1]
    empty = f"[{_NOT_CONNECTED},{_NOT_CONNECTED}]"
    return [
        f"  ! {MEASURED}{{{first}}} IS P{program.first}",
        f"  LOCAL PERS jointtarget {MEASURED}{{{last}}}:=[",
        *[f"    {empty},"] * (last - 1),
        f"    {empty}];",
    ]


class AbbRapid(Dialect):
    """ABB RAPID modules. Plain ASCII, so that a ``.modx`` (UTF-8) has the same content."""

    name = "abb-rapid"
    title = "ABB RAPID module"
    maker = "abb"
    suffixes = (".mod", ".modx", ".prg", ".sys", ".sysx")
    remark = (r"^[ \t]*MODULE[ \t][^\n]*\n", "  ! {words}")
    external_axes = 6
    turning_axes = True
    names = NAMES
    limits = LIMITS
    position_name = _POSITION
    newline = "\r\n"
    notation = NOTATION
    begins = re.compile(rb"^[ \t]*MODULE[ \t]", re.IGNORECASE | re.MULTILINE)
    writer = render_abb_rapid
    reader = parse_abb_rapid
    rules = check_abb_rapid
