"""VAL 3 as the strict validator knows it: words that a line of a program can begin with."""

from __future__ import annotations

import re

_KEYWORDS = """
begin end call if else elseif endif for endfor while endwhile do until switch case break default
endswitch return wait watch
"""

_FUNCTIONS = """
abs accel acos aioget aiolink aioset align append appro asc asin atan autoconnectmove band bnot bor
bxor chr clearbuffer clock close cls compose cos delay delete diolink dioget dioset disablepower
distance enablepower esstatus exp find first frombinary get getdate getdisplaylen getkey getlanguage
getlatch getmonitorspeed getmoveid getpositionerr getprofile getspeed getversion gotoxy help here
herej insert interpolatec interpolatel iscalibrated isdefined isempty isin isinrange iskeypressed
ispowered issettled jointtopoint last left len libdelete libexist liblist libload libpath libsave
limit link ln log logmsg max mid min movec movej movel next open pointtojoint popupmsg position pow
prev put putln random replace resetmotion resetturn resize restartmove right round rounddown roundup
sel setframe setlanguage setlatch setmonitorspeed setmoveid setmutex setprofile sin sioctrl sioget
siolink sioset size sqrt stopmove tan taskcreate taskcreatesync taskkill taskresume taskstatus
tasksuspend title tobinary tonum tostring trunc userpage waitendmove workingmode
"""

_KNOWN = frozenset(_KEYWORDS.split())
_CALLABLE = frozenset(_FUNCTIONS.split())

_WORD = re.compile(r"([A-Za-z]\w{0,99})\s{0,9}(\(?)", re.ASCII)
_ASSIGNED = re.compile(
    r"(?:[A-Za-z]\w{0,31}:)?[A-Za-z]\w{0,31}(?:\[[^\[\]]{0,80}\])?(?:\.\w{1,31}){0,4}\s{0,9}=(.*)",
    re.ASCII,
)


def line_fault(line: str) -> str:
    """What is wrong with the words of a line, without comment and spaces; empty for nothing."""
    assigned = _ASSIGNED.fullmatch(line)
    word = _WORD.match((assigned[1] if assigned else line).strip())
    if word and word[2] and word[1].lower() not in _CALLABLE | _KNOWN:
        return f"{word[1][:30]} is no function of VAL 3"
    if not assigned and (word is None or (not word[2] and word[1].lower() not in _KNOWN)):
        return f"{line[:40]!a} is no instruction"
    return ""
