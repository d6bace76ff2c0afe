"""KUKA KRL programs (``.src`` and ``.dat``): the writer.

The positions stand in the ``.dat``, as the pendant stores them: ``XP1`` and so on. They have no
values of external axes, which KRL then leaves where they are. Joint positions do not depend on the
tool and the base; poses of the tool do, so with them the plan's own frames are set by value, behind
those of the numbers, which bring the load data.

Joint positions stand in inline forms, with the data that these need (FDAT, PDAT), so that they can
be touched up at the pendant, which then stores a pose in the tool and base of the FDAT. The layout
is that of KSS 8 exports and of RoboDK's post-processor with a ``.dat``, whose PTP forms have axes,
too, and are reported to open on pendants. Poses stay without: their form would set the controller's
own frames of these numbers again, in the place of the plan's.

The first motion is the one to the first position (block coincidence, at reduced speed). No motion
is approximated, and ``WAIT SEC``, with 0 where no time is asked for, stops the advance run: the
measuring program is not called while the arm still moves.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.errors import InputError
from posedesign.programs import writing
from posedesign.programs.arm import Arm
from posedesign.programs.dialect import Dialect
from posedesign.programs.kuka_krl.reader import parse_kuka_krl
from posedesign.programs.kuka_krl.rules import check_kuka_krl
from posedesign.programs.kuka_krl.syntax import AXES, EXTERNAL, MOST_BASE, MOST_TOOL, POSE
from posedesign.programs.notation import ABC, Notation, Texts, texts_of
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem
from posedesign.programs.writing import Limits, NameRule, Phrases

_RESERVED = """
AND ANIN ANOUT AXIS B_AND B_EXOR B_NOT B_OR BAS BOOL BRAKE C_DIS C_ORI C_PTP C_SPL C_VEL CASE
CAST_FROM CAST_TO CCLOSE CHANNEL CHAR CIRC CIRC_REL CONFIRM CONST CONTINUE COPEN CREAD CWRITE DECL
DEF DEFAULT DEFDAT DEFFCT DELAY DIGIN DO E6AXIS E6POS ELSE END ENDDAT ENDFCT ENDFOR ENDIF ENDLOOP
ENDSPLINE ENDSWITCH ENDWHILE ENUM EXIT EXOR EXT EXTFCT FALSE FOR FRAME GLOBAL GOTO HALT IF IMPORT
INT INTERRUPT IS LIN LIN_REL LOOP MAXIMUM MINIMUM NOT OFF ON OR POS PRIO PTP PTP_REL PUBLIC PULSE
REAL REPEAT RESUME RETURN SCIRC SEC SIGNAL SLIN SPL SPLINE SPTP SREAD STEP STRUC SWITCH SWRITE THEN
TO TRIGGER TRUE UNTIL WAIT WHEN WHILE WITH XM
"""

NAMES = NameRule("a KUKA program name", 24, small=True, reserved=frozenset(_RESERVED.split()))
"""Names of modules; letters of either case are the same."""

TEXT_LENGTH = 80  # characters of a comment, so that its line has fewer than 120
LIMITS = Limits(
    text=TEXT_LENGTH,
    remark=TEXT_LENGTH,
    pulse_s=(0.1, 3.0),  # that every controller gives
    frames=(MOST_BASE, MOST_TOOL),
)

NOTATION = Notation(joint=5, place=4, turned=5, turn=ABC, counts_at=7)
"""The controller computes with numbers of 24 bits, whose steps at 180 and at 2000 are 0.00002 and
0.0001."""

_FOLD = re.compile(r"\s*(?:END)?FOLD", re.IGNORECASE)
_POSITION = re.compile(r"[XF]P\d+|PPDAT1", re.IGNORECASE)
_PHRASES = Phrases(
    note=";{}",
    named="P",
    unnamed=False,
    move=(
        ";FOLD PTP P{number} Vel={percent} % PDAT1 Tool[{tool}] Base[{base}]"
        ";%{{PE}}%R 8.3.42,%MKUKATPBASIS,%CMOVE,%VPTP,%P "
        "1:PTP, 2:P{number}, 3:, 5:{percent}, 7:PDAT1",
        "$BWDSTART=FALSE",
        "PDAT_ACT=PPDAT1",
        "FDAT_ACT=FP{number}",
        "BAS(#PTP_PARAMS,{percent})",
        "PTP XP{number}",
        ";ENDFOLD",
    ),
    wait="WAIT SEC {time:.2f}",
    pulse=("PULSE($OUT[{output}],TRUE,{time:.2f})",),
    call=("{call}({argument})",),
    bare=("{call}( )",),
    keep="XM[{register}]=$AXIS_ACT",
    least_s=0.01,
    still="WAIT SEC 0",
)
"""Joint positions are moved to in an inline form."""


def render_kuka_krl(program: PoseProgram, arm: Arm) -> dict[str, str]:
    """Texts of the ``.dat`` and the ``.src``: joints to 0.000005 deg, poses to 0.00005 mm."""
    _check_options(program)
    dat, src = _data(program, arm), _source(program, arm)
    return {f"{program.name}.dat": dat, f"{program.name}.src": src}


def _check_options(program: PoseProgram) -> None:
    for text in (program.options.comment, *(pose.comment for pose in program.poses)):
        if _FOLD.match(text):
            raise InputError(
                f"comment {text!a} would hide the lines behind it",
                hint="begin it with another word than FOLD and ENDFOLD",
                name="comment",
                value=text,
            )


def _head(program: PoseProgram) -> list[str]:
    title = program.options.comment
    return ["&ACCESS RVP", "&REL 1"] + ([f"&COMMENT {title}"] if title else [])


def _data(program: PoseProgram, arm: Arm) -> str:
    options = program.options
    lines = [*_head(program), f"DEFDAT {program.name}"]
    lines += [f";{program.mark}"] * bool(program.mark)
    lines.append(f";TOOL {options.tool_frame} BASE {options.user_frame}")
    lines.append("EXT BAS(BAS_COMMAND :IN,REAL :IN)")
    forms = options.form == "joint"
    if forms:
        speed = f"VEL {options.speed_percent}.0,ACC 100.0,APO_DIST 100.0"
        lines.append(f"DECL PDAT PPDAT1={{{speed},GEAR_JERK 50.0,EXAX_IGN 0}}")
    frames = f"TOOL_NO {options.tool_frame},BASE_NO {options.user_frame},IPO_FRAME #BASE"
    for texts in sorted(texts_of(program, arm, NOTATION, NOTATION.joint), key=lambda t: t.number):
        number = texts.number
        lines += _PHRASES.note_of(number, LIMITS.name_of(texts.pose))
        lines.append(f"DECL {'E6AXIS' if forms else 'E6POS'} XP{number}={_aggregate(texts)}")
        if forms:
            lines.append(f'DECL FDAT FP{number}={{{frames},POINT2[] " ",TQ_STATE FALSE}}')
    if program.registers:
        first, last = program.registers[0], program.registers[-1]
        lines += [f";XM[{first}] IS P{program.first}", f"DECL E6AXIS XM[{last}]"]
    return "\n".join([*lines, "ENDDAT"]) + "\n"


def _source(program: PoseProgram, arm: Arm) -> str:
    options = program.options
    lines = [*_head(program), f"DEF {program.name}( )"]
    lines += [f";{note}" for note in writing.head_lines(program, TEXT_LENGTH)]
    lines += [
        "BAS(#INITMOV,0)",
        f"BAS(#VEL_PTP,{options.speed_percent})",
        f"BAS(#TOOL,{options.tool_frame})",
        f"BAS(#BASE,{options.user_frame})",
    ]
    if options.form == "cartesian":
        frames = NOTATION.pose_texts(np.stack([arm.T_tip_tool, arm.T_world_user]))
        tool, base = (f"{{{_fields(POSE, texts)}}}" for texts in frames)
        lines += [f"$TOOL={tool}", f"$BASE={base}"]
    given = {
        "percent": options.speed_percent,
        "tool": options.tool_frame,
        "base": options.user_frame,
    }
    phrases = _PHRASES if options.form == "joint" else replace(_PHRASES, move=("PTP XP{number}",))
    lines += phrases.visit(program, LIMITS, **given)
    return "\n".join([*lines, "END"]) + "\n"


def _aggregate(texts: Texts) -> str:
    placed = _fields(POSE, texts.placed) if texts.placed else _fields(AXES, texts.joints)
    beside = _fields(EXTERNAL, texts.external)
    return "{" + ",".join(filter(None, [placed, texts.words, beside])) + "}"


def _fields(names: tuple[str, ...], values: list[str]) -> str:
    return ",".join(f"{name} {value}" for name, value in zip(names, values, strict=False))


class KukaKrl(Dialect):
    """KUKA KRL programs: a ``.src`` with the instructions, a ``.dat`` with the positions."""

    name = "kuka-krl"
    title = "KUKA KRL program"
    maker = "kuka"
    suffixes = (".dat", ".src")
    remark = (r"^[ \t]*(?:GLOBAL[ \t]+)?DEF(?:DAT)?[ \t][^\n]*\n", ";{words}")
    companions = (".src",)
    external_axes = 6
    turning_axes = True
    names = NAMES
    limits = LIMITS
    position_name = _POSITION
    newline = "\r\n"
    notation = NOTATION
    begins = re.compile(rb"^[ \t]*(?:GLOBAL[ \t]+)?(?:DEFDAT|DEF|DEFFCT)[ \t]", re.I | re.M)
    writer = render_kuka_krl
    reader = parse_kuka_krl
    rules = check_kuka_krl

    def errors_in(self, data: bytes, path: Path) -> list[Problem]:
        found = check_kuka_krl(data, path, alone=True)
        # a word that is wrong here may be declared in the other file
        return self.judge_data(data, path) if any(p.rule == "word" for p in found) else found
