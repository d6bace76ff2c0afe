"""INFORM as the strict validator knows it: first words of steps, and the form of some of them."""

from __future__ import annotations

import re

_WORDS = """
ABORT ADD ADVINIT ADVSTOP AND AOUT ARATIOF ARATION ARCCTOF ARCCTON ARCCUR ARCOF ARCON ARCSET
ARCVOL ASC ATAN AWELD BREAK CALL CALLEXP CASE CAT$ CHR$ CLEAR CLS CNVRT COMM COS DEC DEFAULT DIALOG
DIN DIV DOUT DROPVAL ELSE ELSEIF ELSEIFEXP END ENDFOR ENDIF ENDSWITCH ENDWHILE EVCMP FOR GETE
GETFILE GETPOS GETPRM GETREG GETS GETUALM GUNCHG GUNCL HAND HOLD HSEN IF IFTHEN IFTHENEXP IMOV INC
INIWIN INVMAT INTR JUMP LATCH LEN MACRO MFRAME MID$ MOVC MOVJ MOVL MOVS MSG MSHIFT MUL MULMAT NEXT
NOP NOT OR PALINI PAUSE PLATEON PLATEOF POINT PRINT PSTART PULSE PWAIT REFP RET SET SETE SETFILE
SETPRM SETREG SETTOOL SETUALM SFTOF SFTON SIN SKIP SMOVC SMOVJ SMOVL SPEED SPOT SQRT SRCH STRWAIT
SUB SVGUNCL SVSPOT SVSPOTMOV SWITCH SYEND SYMOVJ SYMOVL SYSTART TIMER TOOLOF TOOLON TSYNC UNTIL VAL
VWELD WAIT WAVEOF WAVEON WHILE WHILEEXP WVOF WVON XOR
"""

_KNOWN = frozenset(_WORDS.split())
"""Of the INFORM manuals, with handling, arc and spot welding."""

_MACRO = re.compile(r"[A-Z0-9_-]{1,32} MJ#\(\d{1,3}\).*")
"""Macros are called by their own names."""

_POSITION = r"L?(?:C|BC|EC|P|BP|EX)(?:\d{3,5}|\[[^\]\s]{1,20}\])"
_ITEM = re.compile(rf"{_POSITION}|(?:VJ|V|VR|VE|PL|CR|ACC|DEC)=\S+|NWAIT|ENWAIT|FPT|SMOV[LJC]?")
"""Behind MOVJ, MOVL, MOVC, MOVS."""

_WHOLE = {
    "TIMER": re.compile(r"TIMER T=\S+"),
    "SET": re.compile(r"SET \S+ \S.*"),
    "GETS": re.compile(r"GETS \S+ \S+"),
    "PULSE": re.compile(r"PULSE OG?H?T?#\(\S{1,20}\)(?: T=\S+)?"),
    "DOUT": re.compile(r"DOUT \S+ \S.*"),
    "CALL": re.compile(r"CALL \S+(?: .*)?"),
}


def step_fault(step: str) -> str:
    """What is wrong with the words of a step, without comments and labels; empty for nothing."""
    word, _, rest = step.partition(" ")
    if word not in _KNOWN:
        return "" if _MACRO.fullmatch(step) else f"{word[:30]!a} is no instruction"
    whole = _WHOLE.get(word)
    if whole is not None and not whole.fullmatch(step):
        return f"{step[:60]!a} is not a whole {word}"
    if word in ("MOVJ", "MOVL", "MOVC", "MOVS"):
        for item in rest.partition("+")[0].partition(" UNTIL ")[0].split():
            if not _ITEM.fullmatch(item):
                return f"{item[:30]!a} does not belong to {word}"
    return ""
