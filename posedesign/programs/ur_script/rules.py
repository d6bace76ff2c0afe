"""Universal Robots URScript programs (``.script``): the strict validator.

Sources: the URScript manual's functions, public post-processors, scripts that PolyScope generates.
Nothing was run on a controller.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``ascii``              plain ASCII characters
``log``                it is a script: there are no rules for the log of a run
``program``            ``def NAME():`` first, and its end or the call ``NAME()`` last; the name a
                       letter, then letters, digits, _
``blocks``             each def, thread, if, for, while is closed by its end
``brackets``           brackets and quotes are closed on their line
``known-function``     each function that is called is one of URScript's, or defined above
``arguments``          calls that move, wait or measure have as many arguments as they need, and no
                       keywords but theirs
``joints``             a list of joints that is moved to has six numbers within +-363 deg [rad]
``pose``               a pose has six numbers, within 10 m and two turns
``arm-position``       no ``movej(p[...])``; ``get_inverse_kin`` has qnear: else the controller
                       chooses the arm position
``speed``              a > 0 up to 40 rad/s2 and v > 0 up to 6.3 rad/s for ``movej``
``number``             plain decimal numbers: no exponent, no NaN, no ``-0.000``
``stop-to-measure``    no blend radius in the last move before a report or a popup
``report``             each ``POSE n q=`` is reported once, with the actual joint positions
``output``             standard digital outputs are 0 to 7
``tcp``                the TCP is set before poses are moved to
=====================  ==========================================================================
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import islice

from posedesign.programs.recorded import Problem
from posedesign.programs.ur_script.functions import FUNCTIONS
from posedesign.programs.ur_script.listing import Statement, arguments, statements

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no script has one in each of its lines."""

_KNOWN = FUNCTIONS | {"if", "elif", "while", "for", "not", "and", "or", "return"}

_DEF = re.compile(r"def ([A-Za-z]\w{0,63})\(\w*(?:, ?\w+)*\):", re.ASCII)
_OPENS = re.compile(r"(?:def|thread|if|for|while|sec|switch)\b.*:")
_LIST = re.compile(r"(?<!\w)(p?)\[([^\[\]]*)\]")
_NUMBER = re.compile(r"-?(?:\d{1,6}(?:\.\d{0,20})?|\.\d{1,20})", re.ASCII)
_ODD = re.compile(r"(?<![\w.])(?:\d[\d.]{0,39}[eE][-+]?\d|nan\b|inf\b|-0(?:\.0*)?(?![\d.]))", re.I)
_REPORT = re.compile(r"POSE (\d{1,6}) q=")
_MOST_JOINT_RAD = math.radians(363.0) + 1e-6


_LOG = re.compile(rb"\bPOSE {1,9}\d{1,6} {0,9}q {0,9}= {0,9}\[")
_KEYWORD = re.compile(r"([A-Za-z_]\w{0,99})=(?!=)", re.ASCII)
_SIGNATURES = {
    "movej": (1, "q pose a v t r"),
    "movel": (1, "pose q a v t r"),
    "movep": (1, "pose q a v r"),
    "movec": (2, "pose_via pose_to a v r mode"),
    "get_inverse_kin": (1, "x qnear maxPositionError maxOrientationError tcp"),
    "pose_trans": (2, "p_from p_from_to"),
    "set_tcp": (1, "pose tcp_name"),
    "set_payload": (1, "m cog inertia_matrix"),
    "sleep": (1, "t"),
    "popup": (1, "s title warning error blocking"),
    "textmsg": (1, "s1 s2"),
    "set_standard_digital_out": (2, "n b"),
    "set_digital_out": (2, "n b"),
    "get_actual_joint_positions": (0, ""),
    "freedrive_mode": (0, "freeAxes feature"),
    "end_freedrive_mode": (0, ""),
}
"""Arguments that a call must have, and the names of all that it can have."""


def check_ur_script(data: bytes) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good script. Never fails."""
    log = _LOG.search(data)
    if log and not re.search(rb"^[ \t]*def\b", data, re.MULTILINE):
        row = data.count(b"\n", 0, log.start()) + 1
        return [Problem(row, "log", "this is the log of a run, for which there are no rules")]
    found = list(statements(data.decode("latin-1")))  # any byte is a character: none is lost
    checks = (
        _check_bytes(data),
        _check_program(found),
        _check_blocks(found),
        _check_functions(found),
        _check_arguments(found),
        _check_moves(found),
        _check_numbers(found),
        _check_measuring(found),
    )
    return list(islice((problem for check in checks for problem in check), MOST_PROBLEMS))


def _check_bytes(data: bytes) -> Iterator[Problem]:
    for row, line in enumerate(data.split(b"\n"), start=1):
        bad = re.search(rb"[^\t -~]", line.removesuffix(b"\r"))
        if bad:
            yield Problem(row, "ascii", f"the byte 0x{bad[0][0]:02x} is not plain ASCII text")


def _check_program(found: list[Statement]) -> Iterator[Problem]:
    if not found:
        yield Problem(1, "program", "there is nothing in it")
        return
    first, last = found[0], found[-1]
    definition = _DEF.fullmatch(first.code)
    if not definition or not first.code.endswith("():"):
        yield Problem(first.line, "program", f"{first.code[:40]!a} where def NAME(): is due")
    elif last.code not in (f"{definition[1]}()", "end"):
        reason = f"{last.code[:40]!a} where the call {definition[1]}() is due"
        yield Problem(last.line, "program", reason)


def _check_blocks(found: list[Statement]) -> Iterator[Problem]:
    opened: list[Statement] = []
    for statement in found:
        if statement.fault:
            yield Problem(statement.line, "brackets", statement.fault)
        if _OPENS.fullmatch(statement.code):
            opened.append(statement)
        elif statement.code == "end":
            if not opened:
                yield Problem(statement.line, "blocks", "end of nothing")
            else:
                opened.pop()
    for statement in opened:
        yield Problem(statement.line, "blocks", f"{statement.code[:40]!a} has no end")


def _check_functions(found: list[Statement]) -> Iterator[Problem]:
    defined = set(_KNOWN)
    for statement in found:
        definition = re.match(r"(?:def|thread) ([A-Za-z]\w{0,99})\(", statement.code, re.ASCII)
        if definition:
            defined.add(definition[1])
        for name in statement.calls:
            if name not in defined:
                yield Problem(statement.line, "known-function", f"{name} is not defined above")


def _check_arguments(found: list[Statement]) -> Iterator[Problem]:
    for statement in found:
        if statement.fault:
            continue
        for name in dict.fromkeys(statement.calls):
            given = arguments(statement.code, name) if name in _SIGNATURES else None
            if given is None:
                continue
            least, names = _SIGNATURES[name]
            count = 0 if given == [""] else len(given)
            # a name beside that of the first argument is the same one's: q or pose
            most = len(names.split()) - (name in ("movej", "movel", "movep"))
            keywords = [word[1] for text in given if (word := _KEYWORD.match(text))]
            odd = sorted(set(keywords) - set(names.split()))
            empty = count > 0 and "" in given
            if odd or empty or len(set(keywords)) < len(keywords):
                what = f"{name} has no {odd[0][:30]}" if odd else f"{name}: one is empty or twice"
                yield Problem(statement.line, "arguments", what)
            elif not least <= count <= most:
                reason = f"{name} has {count} arguments, not {least} to {most}"
                yield Problem(statement.line, "arguments", reason)


def _check_moves(found: list[Statement]) -> Iterator[Problem]:
    has_tcp = False
    for statement in found:
        calls = statement.calls
        has_tcp = has_tcp or "set_tcp" in calls
        move = next((name for name in calls if name in ("movej", "movel", "movep")), "")
        for rule, reason in _list_faults(statement.code, joints=bool(move)):
            yield Problem(statement.line, rule, reason)
        if not move:
            continue
        given = arguments(statement.code, move) or [""]
        for rule, reason in _target_faults(move, given[0], statement.code):
            yield Problem(statement.line, rule, reason)
        if "p[" in statement.code and not has_tcp:
            yield Problem(statement.line, "tcp", "no set_tcp above: whose pose is it?")
        if move == "movej":
            yield from _speed_faults(statement.line, given)


def _target_faults(move: str, target: str, code: str) -> Iterator[tuple[str, str]]:
    if move == "movej" and target.startswith("p["):
        yield "arm-position", "movej to a pose: the controller chooses the arm position"
    if "get_inverse_kin(" in code:
        given = arguments(code, "get_inverse_kin") or []
        if len(given) < 2 or not given[1]:
            yield "arm-position", "get_inverse_kin without qnear"


def _list_faults(code: str, *, joints: bool) -> Iterator[tuple[str, str]]:
    """Of poses, and of lists of joints in a move."""
    for is_pose, body in _LIST.findall("".join(code.split())):
        if not is_pose and not joints:
            continue
        values = [float(part) if _NUMBER.fullmatch(part) else None for part in body.split(",")]
        if any(value is None for value in values):
            continue  # an expression, or a number that another rule refuses
        numbers = [value for value in values if value is not None]
        if is_pose:
            wrong = any(abs(v) > 10.0 for v in numbers[:3]) or any(
                abs(v) > 12.6 for v in numbers[3:]
            )
            if len(numbers) != 6 or wrong:
                yield "pose", f"p[{body[:60]}] is not six numbers in metres and radians"
        elif len(numbers) != 6 or any(abs(v) > _MOST_JOINT_RAD for v in numbers):
            yield "joints", f"[{body[:60]}] is not six joint values in radians"


def _speed_faults(line: int, given: list[str]) -> Iterator[Problem]:
    named = dict(part.split("=", 1) for part in given[1:] if "=" in part)
    for key, most in (("a", 40.0), ("v", 6.3)):
        text = named.get(key)
        if text is not None and _NUMBER.fullmatch(text) and not 0 < float(text) <= most:
            yield Problem(line, "speed", f"{key} is {text[:20]}, not above 0 up to {most:g}")


def _check_numbers(found: list[Statement]) -> Iterator[Problem]:
    for statement in found:
        odd = _ODD.search(statement.code)
        if odd:
            yield Problem(statement.line, "number", f"{odd[0][:30]!a} is not a plain number")


def _check_measuring(found: list[Statement]) -> Iterator[Problem]:
    reported: set[str] = set()
    blended = False
    for statement in found:
        calls = statement.calls
        if any(name in ("movej", "movel", "movep") for name in calls):
            move = next(name for name in calls if name in ("movej", "movel", "movep"))
            blended = _is_blended(arguments(statement.code, move) or [])
        report = next((m for text in statement.texts if (m := _REPORT.fullmatch(text))), None)
        if blended and (report or "popup" in calls):
            reason = "the move before has a blend radius: the arm does not stop"
            yield Problem(statement.line, "stop-to-measure", reason)
        if report:
            if report[1] in reported:
                yield Problem(statement.line, "report", f"POSE {report[1]} is reported twice")
            if "get_actual_joint_positions" not in calls:
                reason = "without the actual joint positions: get_actual_joint_positions()"
                yield Problem(statement.line, "report", reason)
            reported.add(report[1])
        for name in ("set_standard_digital_out", "set_digital_out"):
            given = arguments(statement.code, name) if name in calls else None
            if given and re.fullmatch(r"-?\d{1,9}", given[0]) and not 0 <= int(given[0]) <= 7:
                yield Problem(statement.line, "output", f"output {given[0]}, not 0 to 7")


def _is_blended(given: list[str]) -> bool:
    radius = next((part[2:] for part in given if part.startswith("r=")), None)
    if radius is None and len(given) > 4 and "=" not in given[4]:
        radius = given[4]
    return radius is not None and not re.fullmatch(r"0*\.?0*", radius)
