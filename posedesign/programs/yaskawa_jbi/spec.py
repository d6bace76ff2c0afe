"""INFORM as reader, writer and validator know it: words, names, and pulses of a degree.

Jobs store joint values as encoder pulses, without the ratio: it belongs to the model of the arm and
stands in the controller's parameter file (ALL.PRM), with its sign. For arms whose motors turn
several joints at once the controller has further parameters; six numbers do not state those arms.
Base axes (BC, BP), which carry the arm, are in pulses, too.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from calib.errors import InputError
from posedesign.programs.writing import NameRule

KINDS = ("C", "BC", "EC", "P", "BP", "EX")
"""Of positions, in the order of ///NPOS: of the job, and variables; of arms, bases, stations."""

_HEADINGS = """
///NPOS ///TOOL ///USER ///POSTYPE ///PULSE ///RECTAN ///RCONF ///MTOOL ///DATE ///COMM ///ATTR
///FRAME ////FRAME ///GROUP ///LVARS ///ARGTYPE ///COMMENT ///FOLDERNAME
"""
_INSTRUCTIONS = """
ABORT ADD ADVINIT ADVSTOP AND ANTOUT AOUT ARATIOF ARATION ARCCTE ARCCTOF ARCCTON ARCCTS ARCCUR ARCOF
ARCON ARCSET ARCVOL ASC ATAN AWELD BREAK CALL CASE CAT$ CHR$ CLEAR CLS CNVRT COMM COS CWAIT DEC
DEFAULT DELETEJ DI DIALOG DIN DIV DOUT DROPVAL EI ELSE ELSEIF ELSEIFEXP END ENDFOR ENDIF ENDSWITCH
ENDWHILE EVCMP FOR FORMAPR FORMCUT GETARG GETE GETFILE GETNAME GETPOS GETPRM GETREG GETS GETTOOL
GETUALM GUNCHG GUNCL HAND HOLD HPMMVOF HPMMVON HPVELOF HPVELON HSEN HTRAJOF HTRAJON IF IFTHEN
IFTHENEXP IMOV INC INIWIN INPUT INTR INVMAT JUMP LATCH LATESTJOB LEN LOADJ LOADV MACRO MFRAME MID$
MOVC MOVJ MOVL MOVS MSG MSHIFT MUL MULMAT NEXT NOP NOT NSRCH OR PALINI PAUSE PLATEOF PLATEON POINT
PRINT PSTART PULSE PWAIT REFP REPLAY RET RETRY SAVEJ SAVEV SET SETE SETFILE SETPRM SETREG SETTM
SETTOOL SETUALM SFTOF SFTOF3D SFTON SFTON3D SHCKRST SHCKSET SIN SKILLSND SKIP SMOOTH SMOVC SMOVJ
SMOVL SMOVS SPEED SPOT SQRT SRCH SSFTOF SSFTON STRSTR STROKE STRWAIT SUB SVGUNCL SVSPOT SVSPOTMOV
SWAIT SWITCH SYEND SYMOVC SYMOVJ SYMOVL SYSTART TIMER TOOLOF TOOLON TSYNC UNTIL VAL VAL2STR VWELD
WAIT WAVEOF WAVEON WHILE WHILEEXP WVOF WVON XOR
"""
HEADINGS = frozenset(_HEADINGS.split())
INSTRUCTIONS = frozenset(_INSTRUCTIONS.split())
"""First words of steps: of the INFORM manuals, with the options for handling, cutting, welding."""

NAMES = NameRule("a Yaskawa job name", 8)
"""What every controller takes, NX100 too."""

MOST_COMMENT = 32
"""Characters of a job's comment and of a comment line."""

MOST_FRAME = 63
"""NX100 has fewer frames."""

AXES = ("S", "L", "U", "R", "B", "T")
"""Yaskawa's names of the six axes, from the base on."""

EXTERNAL = ("E1", "E2", "E3")
"""Our names of the base axes, in the order of a BC position, which has up to three values."""

DECIMALS = 9
"""Decimals of a ratio that are kept: 1e-9 pulses in 720 deg are none."""

_LEAST, _MOST = 1.0, 1e6
"""Arms have some hundreds to thousands of pulses a degree, base axes of pulses a millimetre."""

_COMMENT = re.compile(r"PULSES\s+([SLURBT]|E[1-3])\s+([-+]?\d{1,7}(?:\.\d{0,12})?)\s*", re.ASCII)

_HINTS = {
    "pulses_per_deg": "give six signed numbers, S L U R B T in pulses/deg: of the controller's "
    "parameter file (ALL.PRM), or a pulse count that the pendant shows divided by its angle",
    "pulses_per_mm": "give a signed number for each base axis in pulses/mm: a pulse count that the "
    "pendant shows divided by the way from the axis's zero",
}


def checked(
    pulses: Sequence[float], name: str = "pulses_per_deg", axes: Sequence[str] = AXES
) -> tuple[float, ...]:
    """The ratios of axes, rounded as they are written; InputError where they are none of an arm."""
    values = tuple(pulses)
    if len(values) != len(axes):
        raise InputError(
            f"{name} has {len(values)} values: joints are written in encoder pulses, "
            f"which need one for each of {', '.join(axes)}",
            hint=_HINTS[name],
            name=name,
            value=values,
            bound=len(axes),
        )
    for axis, value in zip(axes, values, strict=True):
        if not (math.isfinite(value) and _LEAST <= abs(value) <= _MOST):
            raise InputError(
                f"{name} of {axis} is {value}, not {_LEAST:g} to {_MOST:g} either way",
                hint=_HINTS[name],
                name=name,
                value=value,
                bound=(_LEAST, _MOST),
            )
    return tuple(round(float(value), DECIMALS) for value in values)


def comments(pulses: Sequence[float]) -> list[str]:
    """Texts of the comments, one an axis, that carry the ratios in a job: ``PULSES S 1638.4``.

    ``pulses``: of S, L, U, R, B, T in a degree, then of the base axes in a millimetre.
    """
    texts = (f"{value:.{DECIMALS}f}".rstrip("0").rstrip(".") for value in pulses)
    return [f"PULSES {axis} {text}" for axis, text in zip((*AXES, *EXTERNAL), texts, strict=False)]


def found_in(text: str) -> tuple[str, float] | None:
    """Axis and ratio of such a comment, or None."""
    found = _COMMENT.fullmatch(text)
    return (found[1], float(found[2])) if found else None
