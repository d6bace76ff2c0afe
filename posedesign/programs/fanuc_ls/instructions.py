"""FANUC ``.LS``, what the strict validator knows of instructions and motions.

Words of the base language in English, from public programs and post-processors; instructions of
applications (arc, spot, dispensing) are not among them, and a measuring program has none.
"""

from __future__ import annotations

import re

_INDEX = r"\[(?:[^\[\]]|\[[^\[\]]{0,40}\]){1,60}\]"
_NAME = r"[A-Z][A-Z0-9_]{0,35}"
_ITEM = rf"(?:R|PR|SR|AR|DI|DO|RI|RO|UI|UO|SI|SO|GI|GO|AI|AO|WI|WO|F|M|VR){_INDEX}"
_DECIMAL = r"(?:\d{1,5}(?:\.\d{0,3})?|\.\d{1,3})"

_INSTRUCTIONS = [
    rf"U(?:FRAME|TOOL)_NUM(?:\[GP\d\])? ?= ?(?:\d{{1,3}}|{_ITEM})",
    rf"WAIT +(?:{_DECIMAL}|{_ITEM})\(sec\)",
    rf"WAIT +(?:R{_INDEX}|.{{0,9}}(?:{_ITEM}|ERR_NUM|\$).*)",
    rf"(?:CALL|RUN) (?:{_NAME}|SR\[[^\]]{{1,40}}\])(?:\(.*\))?",
    rf"(?:{_ITEM}|(?:UFRAME|UTOOL|TIMER|TIMER_OVERFLOW){_INDEX}) ?=.+",
    r"\$[\w$.\[\],:]{1,60} ?=.+",
    r"(?:IF|SELECT|FOR) .+",
    r"=.+",
    r"ELSE(?:,.+)?",
    r"(?:ENDIF|ENDFOR|END|ABORT|PAUSE|RESET|THEN)",
    r"(?:JMP )?LBL\[.{1,40}\]",
    rf"OVERRIDE ?= ?(?:\d{{1,3}}%|{_ITEM})",
    r"(?:PAYLOAD|UALM|MESSAGE|MONITOR|TIMER|STICK|MUTE)\[.*\].*",
    r"(?:SKIP CONDITION|OFFSET CONDITION|TOOL_OFFSET CONDITION|VOFFSET CONDITION) .+",
    r"(?:MONITOR(?: END)?|CLEAR|LOCK|UNLOCK|SEMAPHORE|ERROR_PROG|RESUME_PROG|RSR|DIAG_REC) ?.*",
    r"COL (?:DETECT|GUARD).*",
    r"(?:TC_ONLINE|CYCLE TIMER|PRINT|STOP_TRACKING|POINT_LOGIC|DEFAULT_GROUP) ?.*",
    rf"(?:JOINT_MAX_SPEED|LINEAR_MAX_SPEED|ACC_OVERRIDE|JOINT_SPEED|FINE|CNT)\b.*|{_ITEM}",
]
_KNOWN = re.compile("|".join(f"(?:{pattern})" for pattern in _INSTRUCTIONS))

_TARGET = rf"PR?{_INDEX}"
_SPEEDS = {
    "J": rf"(?:\d{{1,3}}(?:\.\d)?%|{_DECIMAL}(?:sec|msec)|{_ITEM} ?(?:%|sec|msec))",
    "L": rf"(?:{_DECIMAL} ?(?:mm/sec|cm/min|inch/min|deg/sec|sec|msec)|{_ITEM} ?(?:mm/sec|cm/min"
    r"|inch/min|deg/sec|sec|msec)|max_speed|WELD_SPEED)",
}
_ENDING = rf"(?:FINE|CNT ?(?:\d{{1,3}}|{_ITEM})|CR ?\d{{1,4}}|CD ?\d{{1,4}})"
_MOTIONS = {
    letter: re.compile(
        rf"{letter} {_TARGET}(?: *:? *{_TARGET})? +(?P<speed>{_SPEEDS.get(letter, _SPEEDS['L'])}) "
        rf"+(?P<ending>{_ENDING})(?P<options>(?: .*)?)"
    )
    for letter in "JLCAS"
}
_OPTION = re.compile(
    rf"(?:ACC ?(?:\d{{1,3}}|{_ITEM})|PTH|Wjnt|BREAK|COORD|RTCP|MROT|EV ?\d{{1,3}}%|AP_LD\d{{1,4}}"
    r"|RT_LD\d{1,4}|PSPD ?\d{1,3}|(?:TB|TA|DB) .+|Skip,.+)"
)
_ELSEWHERE = re.compile(r"(?:INC|Offset|Tool_Offset|VOFFSET)\b.*")


def instruction_fault(code: str) -> str:
    """What is wrong with an instruction that is no motion; empty for nothing."""
    if not code or _KNOWN.fullmatch(code):
        return ""
    return f"there is no instruction {code[:40]!a}"


def motion_fault(letter: str, code: str) -> str:
    """What is wrong with a motion; empty for nothing."""
    found = _MOTIONS[letter].fullmatch(code)
    if found is None:
        return f"a motion has a position, a speed and FINE or CNT: {code[:60]!a}"
    speed = re.fullmatch(r"(\d{1,3}(?:\.\d)?)%", found["speed"])
    if speed and not 0 < float(speed[1]) <= 100:
        return f"a speed of {speed[1]}%: from 1% to 100%"
    for option in found["options"].split():
        if _ELSEWHERE.fullmatch(option):
            return f"{option[:40]} moves to another place than that of the position"
    left = found["options"].strip()
    if left and not _OPTION.match(left):
        return f"the motion option {left[:40]!a} is not known"
    return ""
