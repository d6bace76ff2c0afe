"""Yaskawa INFORM jobs (``.JBI``): the strict validator.

Sources: "Job data format" of the NX100 and DX100 manuals, the maker's page on INFORM headers,
public post-processors and jobs. Nothing was loaded on a controller.

=====================  ==========================================================================
rule                   what it asks
=====================  ==========================================================================
``ascii``              plain ASCII characters
``crlf``               each line ended by CR LF
``sections``           /JOB, //POS, //INST in this order; the steps from NOP to END
``job-name``           //NAME: a letter or digit, then others, _ and -, 32 in all (DX100 on; NX100
                       takes 8)
``header``             ///DATE, ///ATTR with SC and RW or RO, ///GROUP1, and ///COMM of at most 32
                       characters
``npos``               ///NPOS: the number of positions of each kind
``position-format``    each position with tool, ///POSTYPE and ///PULSE or ///RECTAN above, and six
                       values if it is the robot's; tools and user frames 0 to 63
``number``             pulses whole; poses with at most 3 decimals of a mm and 4 of a degree; no
                       exponent, no ``-0.000``; degrees in [-180, 180]
``rconf``              a pose has ///RCONF of 8 or 24 values, the first six 0 or 1, the others 0
``relative-job``       poses need RJ in ///ATTR and a ////FRAME that is theirs
``instruction``        steps begin with instructions of INFORM, and those that move, wait, set,
                       pulse and store are whole
``position-unique``    each position is there once
``position-defined``   each position that is moved to is there
``position-used``      each position that is there is moved to
``stop-before-call``   the last move before a CALL has PL=0: the arm has arrived
``argument``           VJ= 0.01 to 100.00 with two decimals, times 0.01 to 655.35 s, I variables
                       within 16 bits, names of called jobs of at most 32 characters
``comment``            a comment has at most 32 characters
``length``             at most 9999 steps: the pendant shows four digits
=====================  ==========================================================================
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from itertools import islice

from posedesign.programs.recorded import Problem
from posedesign.programs.yaskawa_jbi.instructions import step_fault
from posedesign.programs.yaskawa_jbi.listing import Data, Listing, split_job

MOST_PROBLEMS = 1000
"""Most problems told by one check: a file that is no job has one in each of its lines."""

_KINDS = ("C", "BC", "EC", "P", "BP", "EX")
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,31}", re.ASCII)
_MOST_FRAME = 63
_COUNTS = re.compile(r"\d{1,5}(?:,\d{1,5}){5}")
_DATE = re.compile(r"///DATE \d{4}/\d\d/\d\d \d\d:\d\d")
_ATTRIBUTES = re.compile(r"///ATTR SC,R[WO](,RJ)?")
_GROUP = re.compile(r"///GROUP\d (?:RB|BS|ST)\d(?:,(?:RB|BS|ST)\d)*")
_FRAME = re.compile(r"/{3,4}FRAME (BASE|ROBOT|USER \d{1,2})")
_PULSES = re.compile(r"0|-?[1-9]\d{0,9}")
_DECIMAL = re.compile(r"(-?)(\d{1,6})\.(\d{1,4})")
_RCONF = re.compile(r"[01](?:,[01]){5}(?:(?:,0){2}|(?:,0){18})")
_TARGET = re.compile(r"(?<![\w$#])(C|BC|EC)(\d{5})\b")
_STOPPED = re.compile(r" PL=0\b")
_CHECKED = {
    "T=": (re.compile(r"(?:TIMER|PULSE OT#\(\d{1,4}\)) T=(-?[\d.]\S*)"), 0.01, 655.35, 2),
    "an I variable": (re.compile(r"SET I\d{3} (-?\d\S*)"), -32768, 32767, 0),
}
_SPEED = re.compile(r"MOVJ .*?VJ=([-+\d.]\S*)")
_CALL = re.compile(r"CALL JOB:(\S{1,32})(?: ARGF\S.*| IF .*)?")


def check_yaskawa_jbi(data: bytes) -> list[Problem]:
    """Problems in the content of a file, at most 1000; none is a good job. Never fails."""
    listing = split_job(data.decode("latin-1"))  # any byte is a character: none is lost
    checks = (
        _check_bytes(data),
        _check_sections(listing),
        _check_header(listing),
        _check_positions(listing),
        _check_values(listing),
        _check_frames(listing),
        _check_use(listing),
        _check_steps(listing),
    )
    return list(islice((problem for check in checks for problem in check), MOST_PROBLEMS))


def _check_bytes(data: bytes) -> Iterator[Problem]:
    lines = data.split(b"\n")
    bare = [row for row, line in enumerate(lines[:-1], start=1) if not line.endswith(b"\r")]
    if lines[-1]:
        bare.append(len(lines))
    if bare:
        reason = f"{len(bare)} lines are not ended by CR LF, this the first"
        yield Problem(bare[0], "crlf", reason)
    for row, line in enumerate(lines, start=1):
        body = line.removesuffix(b"\r")
        if b"\r" in body:
            yield Problem(row, "crlf", "CR inside the line")
        bad = re.search(rb"[^\t\r -~]", body)
        if bad:
            yield Problem(row, "ascii", f"the byte 0x{bad[0][0]:02x} is not plain ASCII text")


def _check_sections(listing: Listing) -> Iterator[Problem]:
    order = [text for _, text in listing.headings]
    if order != ["/JOB", "//POS", "//INST"]:
        row = listing.headings[-1][0] if listing.headings else 1
        yield Problem(row, "sections", f"the sections are {' '.join(order)[:100] or 'none'}")
    for row, line in listing.faults:
        yield Problem(row, "sections", f"{line[:30]!a} belongs nowhere")
    if listing.steps:
        for place, word in ((0, "NOP"), (-1, "END")):
            row, text = listing.steps[place]
            if text != word:
                yield Problem(row, "sections", f"{text[:30]!a} where {word} is due")
    else:
        yield Problem(1, "sections", "there are no steps, not even NOP and END")
    names = [text for _, text in listing.names]
    if len(names) != 1 or not _NAME.fullmatch(names[0]):
        row = listing.names[0][0] if listing.names else 1
        reason = "one //NAME: letters, digits, _ and -, 32 characters in all"
        yield Problem(row, "job-name", reason)


def _check_header(listing: Listing) -> Iterator[Problem]:
    lines = [text for _, text in listing.pseudo]
    for pattern, what in ((_DATE, "///DATE"), (_ATTRIBUTES, "///ATTR"), (_GROUP, "///GROUP1")):
        found = [row for row, text in listing.pseudo if text.startswith(what)]
        if not any(pattern.fullmatch(text) for text in lines if text.startswith(what)):
            row = found[0] if found else 1
            yield Problem(row, "header", f"{what} is missing or malformed")
    for row, text in listing.pseudo:
        if text.startswith("///COMM ") and len(text) > len("///COMM ") + 32:
            yield Problem(row, "header", "the job's comment is longer than 32 characters")


def _check_positions(listing: Listing) -> Iterator[Problem]:
    counts = Counter(data.kind for data in listing.data)
    found = ",".join(str(counts[kind]) for kind in _KINDS)
    stated = [text for _, text in listing.counts]
    if len(stated) != 1 or not _COUNTS.fullmatch(stated[0]) or stated[0] != found:
        row = listing.counts[0][0] if listing.counts else 1
        yield Problem(row, "npos", f"///NPOS is {' '.join(stated)[:60]!a}, there are {found}")
    seen: set[tuple[str, int]] = set()
    for data in listing.data:
        in_pulses = data.postype == "PULSE"
        if not data.tool.split(",")[0].isdecimal():
            yield Problem(data.line, "position-format", f"{data.label} has no ///TOOL above")
        for word, texts in (("TOOL", data.tool.split(",")), ("USER", [data.user])):
            if any(text.isdecimal() and int(text) > _MOST_FRAME for text in texts):
                reason = (
                    f"{data.label}: ///{word} is {','.join(texts)[:20]}, not 0 to {_MOST_FRAME}"
                )
                yield Problem(data.line, "position-format", reason)
        if data.form not in ("PULSE", "RECTAN") or in_pulses != (data.form == "PULSE"):
            reason = f"{data.label} is in {data.postype or 'nothing'} and {data.form or 'nothing'}"
            yield Problem(data.line, "position-format", reason)
        if data.kind in ("C", "P") and len(data.values) != 6:
            reason = f"{data.label} has {len(data.values)} values, not six"
            yield Problem(data.line, "position-format", reason)
        if (data.kind, data.number) in seen:
            yield Problem(data.line, "position-unique", f"{data.label} is there twice")
        seen.add((data.kind, data.number))


def _check_values(listing: Listing) -> Iterator[Problem]:
    for data in listing.data:
        for k, text in enumerate(data.values):
            fault = _pulse_fault(text) if data.form == "PULSE" else _decimal_fault(text, k)
            if fault:
                yield Problem(data.line, "number", f"{data.label}: {text[:30]!a} {fault}")
                break


def _pulse_fault(text: str) -> str:
    if not _PULSES.fullmatch(text) or abs(int(text)) >= 2**31:
        return "is not a whole number of pulses"
    return ""


def _decimal_fault(text: str, k: int) -> str:
    found = _DECIMAL.fullmatch(text)
    if not found or len(found[3]) > (3 if k < 3 else 4):
        return "is not a plain number of at most 3 decimals of a mm, 4 of a degree"
    if found[1] and not (found[2] + found[3]).strip("0"):
        return "is minus zero"
    if k >= 3 and not -180.0 <= float(text) <= 180.0:
        return "is not in [-180, 180] deg"
    return ""


def _check_frames(listing: Listing) -> Iterator[Problem]:
    relative = any((m := _ATTRIBUTES.fullmatch(t)) and m[1] for _, t in listing.pseudo)
    frames = [found[1] for _, text in listing.pseudo if (found := _FRAME.fullmatch(text))]
    for data in listing.data:
        if data.form != "RECTAN" or data.kind not in ("C", "P"):
            continue
        if not _RCONF.fullmatch(data.rconf):
            reason = f"{data.label}: ///RCONF is {data.rconf[:60]!a}"
            yield Problem(data.line, "rconf", reason)
        own = f"USER {data.user}" if data.postype == "USER" else data.postype
        if data.kind == "C" and (not relative or frames != [own]):
            frame = f"////FRAME {frames[0]}" if frames else "no ////FRAME"
            reason = f"{data.label} is in {own}, the job is{' ' if relative else ' not '}relative"
            yield Problem(data.line, "relative-job", f"{reason} and has {frame}")


def _check_use(listing: Listing) -> Iterator[Problem]:
    there: dict[tuple[str, int], Data] = {(d.kind, d.number): d for d in listing.data}
    used: set[tuple[str, int]] = set()
    for row, text in listing.steps:
        if not text.lstrip(" \t").startswith(("MOV", "SMOV", "+")):
            continue
        names = {(kind, int(number)) for kind, number in _TARGET.findall(text)}
        for kind, number in sorted(names - there.keys()):
            yield Problem(row, "position-defined", f"{kind}{number:05d} is not there")
        used |= names
    for key, data in there.items():
        if data.kind in ("C", "BC", "EC") and key not in used:
            yield Problem(data.line, "position-used", f"{data.label} is never moved to")


def _check_steps(listing: Listing) -> Iterator[Problem]:
    stands = False
    for row, text in listing.steps:
        step = text.strip(" \t")
        if step.startswith("'"):
            if len(step) > 33:
                yield Problem(row, "comment", "the comment is longer than 32 characters")
            continue
        fault = "" if step.startswith(("*", "+")) else step_fault(step)
        if fault:
            yield Problem(row, "instruction", fault)
        if step.startswith(("MOV", "SMOV", "IMOV")):
            stands = _STOPPED.search(step) is not None
        if step.startswith("CALL "):
            if not stands:
                reason = "no move with PL=0 before the CALL: the arm may not have arrived"
                yield Problem(row, "stop-before-call", reason)
            if not _CALL.fullmatch(step):
                yield Problem(row, "argument", f"{step[:60]!a} calls no job")
        yield from _argument_faults(row, step)
    if len(listing.steps) > 9999:
        row = listing.steps[9999][0]
        yield Problem(row, "length", f"{len(listing.steps)} steps, at most 9999 fit")


def _argument_faults(row: int, step: str) -> Iterator[Problem]:
    speed = _SPEED.match(step)
    if speed:
        good = re.fullmatch(r"\d{1,3}\.\d\d", speed[1], re.ASCII)
        if not good or not 0.01 <= float(speed[1]) <= 100.0:
            reason = f"VJ= is {speed[1][:20]!a}, not 0.01 to 100.00 with two decimals"
            yield Problem(row, "argument", reason)
    for what, (pattern, least, most, decimals) in _CHECKED.items():
        found = pattern.match(step)
        if not found:
            continue
        form = rf"-?\d{{1,5}}(?:\.\d{{1,{decimals}}})?" if decimals else r"-?\d{1,6}"
        if not re.fullmatch(form, found[1], re.ASCII) or not least <= float(found[1]) <= most:
            yield Problem(row, "argument", f"{what} is {found[1][:20]!a}, not {least} to {most}")
