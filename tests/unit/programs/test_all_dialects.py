"""Programs of every dialect: damaged, mutated, hostile; what is special to one is tested beside.

Damaged ones end in a clear error, or in numbers that really stand in the file. A mutant has one
token broken, as a slip of the hand or of a transfer breaks it; all are refused that are no legal
programs.
"""

from __future__ import annotations

import re
import tracemalloc
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calib.errors import CalibError, FileFormatError, InputError
from posedesign.programs import DIALECTS, Arm, Dialect, ProgramPose, RecordedProgram, language
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.registry import dialect_of as dialect_of_file
from posedesign.programs.ur_script.reader import LANGUAGE as UR_SCRIPT
from tests.marks import by_stage
from tests.unit.programs.dialects import (
    CARRIED,
    CASES,
    EXPORTS,
    HOW,
    PULSES,
    arm_on_slides,
    dialect_of,
    each_case,
    each_dialect,
    program_of,
    robot_of,
)

RUBBISH = [b"", b"\0", b"\xff\xfe\x00", b"a" * 100_000, b"\n" * 30_000, b"- " * 20_000]
RUBBISH += [b"{" * 10_000, b"[" * 10_000, b"(" * 30_000, b'"' * 30_000, b"1," * 30_000]
RUBBISH += [b"<!--" * 10_000, b"P[" * 10_000, b"[[" * 10_000, b" " * 100_000]
_TOKEN = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")


@cache
def written(name: str, form: str) -> tuple[str, str]:
    """Name and text of the file with the positions."""
    robot = robot_of(name)
    rng = np.random.default_rng(5)
    q = rng.uniform(-0.35, 0.35, (6, robot.n)) * (robot.upper - robot.lower) * 0.5
    q += (robot.lower + robot.upper) / 2.0
    poses = [ProgramPose(f"P0{i}", posture, via=i == 3) for i, posture in enumerate(q)]
    program = program_of(name, poses, "FUZZED", form=form, user_frame=0)
    plain = replace(program, arm=Arm.of(robot))
    return next(iter(DIALECTS[name].files(plain).items()))


def damaged(text: str, rng: np.random.Generator) -> str:
    """One to three changes: characters, lines, or the end of the file."""
    pieces = ["", "e5", "NaN", *' -.,9}{[]=;\n\0"']
    for _ in range(rng.integers(1, 4)):
        lines = text.split("\n")
        i, j = rng.integers(len(lines), size=2)
        at, length = int(rng.integers(len(text) + 1)), int(rng.integers(8))
        match rng.integers(6):
            case 0:
                text = text[:at] + str(rng.choice(pieces)) + text[at + length :]
            case 1:
                text = text[:at] + chr(int(rng.integers(32, 127))) + text[at + 1 :]
            case 2:
                lines[i], lines[j] = lines[j], lines[i]
                text = "\n".join(lines)
            case 3:
                text = "\n".join([*lines[:i], lines[i], *lines[i:]])
            case 4:
                text = "\n".join([*lines[:i], *lines[i + 1 :]])
            case _:
                text = text[:at] if rng.random() < 0.3 else text[:at] + text[at + length :]
    return text


def numbers_of(program: RecordedProgram) -> np.ndarray:
    """Everything that was read, as numbers: joints in deg, places in mm."""
    found = [p.shown_deg for p in program.positions if p.shown_deg is not None]
    places = [1e3 * p.T_user_tool[:3, 3] for p in program.positions if p.T_user_tool is not None]
    return np.concatenate([np.ravel(values) for values in [*found, *places]])


def assert_stand_in(values: np.ndarray, text: str) -> None:
    """Each number read is one of the file: as it is, in radians, in metres, or in pulses."""
    raw = np.array([float(token) for token in _TOKEN.findall(text)])
    raw = np.concatenate([raw, -raw])  # a sign may be taken for an operator by this test's pattern
    pulses = (raw[:, None] / np.array(PULSES)).ravel()
    scales = re.findall(r"PULSES?\D*([-\d.]+(?:[ ,]+[-\d.]+)*)", text)
    own = [float(t) for line in scales for t in _TOKEN.findall(line)]
    more = [raw / scale for scale in own if scale]
    known = np.sort(np.concatenate([raw, np.rad2deg(raw), 1e3 * raw, pulses, *more]))
    known = known[np.isfinite(known)]
    at = np.clip(np.searchsorted(known, values), 1, len(known) - 1)
    off = np.minimum(np.abs(known[at] - values), np.abs(known[at - 1] - values))
    assert (off <= 1e-6 * np.maximum(1.0, np.abs(values))).all(), values[np.argmax(off)]


def run(dialect: Dialect, file: str, data: bytes, count: int) -> tuple[int, int]:
    text = data.decode("utf-8" if file.endswith(".dtx") else "latin-1")
    rng = np.random.default_rng(sum(map(ord, text)))
    refused, said = 0, [""]
    for _ in range(count):
        broken = damaged(text, rng)
        data = broken.encode("utf-8", "surrogatepass")
        found = dialect.check(data, Path(file))
        try:
            program = dialect.parse(data, Path(file))
        except (FileFormatError, InputError) as error:
            assert found  # nothing passes that cannot be read
            refused += 1
            said.append(error.message)
            continue
        # and nothing is read that is refused, but of lists, which run on no controller
        assert not dialect.controlled or all(p.level != "error" for p in found)
        numbers = [p.number for p in program.positions]
        assert len(set(numbers)) == len(numbers) > 0
        assert min(numbers) >= 1
        assert np.isfinite(numbers_of(program)).all()
        assert_stand_in(numbers_of(program), broken)
    assert max(map(len, said)) < 1000
    assert not any("\n" in message for message in said)
    assert all(re.match(r"\S+\.\w+(, line \d+)?: .", message) for message in said[1:])
    return refused, count


@each_case
@pytest.mark.parametrize("count", by_stage(80, 100, 5000))
def test_damaged_programs(name: str, form: str, count: int) -> None:
    file, text = written(name, form)
    assert_stand_in(numbers_of(dialect_of(name).parse(text.encode(), Path(file))), text)
    refused, tried = run(dialect_of(name), file, text.encode(), count)
    assert 0 < refused < tried


each_export = pytest.mark.parametrize("file", sorted(path.name for path in EXPORTS.iterdir()))


def dialect_of_export(file: str) -> Dialect:
    named = {".log": "ur-script"}.get(Path(file).suffix)
    return dialect_of_file(EXPORTS / file, named)


@each_export
@pytest.mark.parametrize("count", by_stage(20, 75, 1000))
def test_programs_of_others_are_read_and_refused_where_they_are_damaged(file, count):
    dialect, data = dialect_of_export(file), (EXPORTS / file).read_bytes()
    assert dialect.recognises(data)
    assert dialect.parse(data, Path(file)).positions
    refused, tried = run(dialect, file, data, count)
    assert 0 < refused < tried


@pytest.mark.parametrize("name", [name for name, how in HOW.items() if how.ends])
def test_every_cut_is_noticed(name: str) -> None:
    file, text = written(name, "joint")
    *_, last, _, _ = (m.end() for m in re.finditer("\n", text))
    cuts = {*range(len(text) // 4, last, 1 + len(text) // 60), *range(last - 12, last)}
    for at in cuts:
        with pytest.raises(FileFormatError):
            dialect_of(name).parse(text[:at].encode(), Path(file))


LONG = 50_000
# Quadratic work on a line like these would take minutes.
HOSTILE = {
    "abb-rapid": [
        *("CONST " + " " * LONG + "x", "CONST jointtarget jp3" + " " * LONG + ":=[[1"),
        *("CONST jointtarget jp3:=[[" + "1," * 6_250, "CONST jointtarget jp3:=" + "[" * LONG),
        *("CONST jointtarget jp3:=[[" + "9" * LONG + "]];", "CONST jointtarget " * 5_000),
        *("CONST jointtarget " + "x" * LONG + ":=[[1]];", "CONST " * 10_000, "!" * LONG),
        *(";" * 5_000, "MoveAbsJ" + "\\x" * 6_250, "MoveJ " * 10_000, "PROC a(" * 10_000),
        *("PROC a " * 10_000, "[1,2,3,4,5" * 5_000, "%%%" * 15_000, "x{" * 6_250),
        *("x " * 6_250, "-0" * 6_250, "END" * 17_500),
    ],
    "kuka-krl": [
        *("DECL " + " " * LONG + "x", "DECL E6AXIS XP3" + " " * LONG + "={A1 1"),
        *("XP3={A1 1," + " " * LONG + "x", "XP3={" + "A1 1," * 10_000, "BAS(" + " " * LONG),
        *("XP3={A1 " + "9" * LONG + "}", "X" * LONG + "={A1 1}", '"' * LONG + '";'),
        *("PTP " + " " * LONG + "x", ";P1" + " " * LONG, "P[" * 25_000, "DEF " * 12_500),
        "DECL E6AXIS " + "X[" * 25_000,
    ],
    "staubli-val3": [
        *("<a>" * 7_500, "<a>" * 7_500 + "</a>" * 7_500, f'<Value key="{"1" * LONG}" />'),
        *(f'<Value key="0" j1="{"1" * LONG}" />', "&#65;" * 12_500),
        f'<Data name="{"x" * LONG}" type="jointRx" size="1" />',
        f'<Data name="y" type="jointRx" size="{"9" * LONG}" />',
    ],
    "ur-script": [
        *("movej(" + "get_inverse_kin(" * 7_500, "movej([" + "9" * 6000 + ",1,1,1,1,1])"),
        "(\n" * 24_999,
    ],
    "robodk-csv": ["1" * LONG, "," * LONG, "J" * LONG, "1e" * LONG],
}
LINES = [(name, k) for name, lines in HOSTILE.items() for k in range(len(lines))]


@pytest.mark.slow
@pytest.mark.parametrize(("name", "k"), LINES)
def test_a_damaged_line_is_not_tried_in_every_way(name: str, k: int) -> None:
    file, text = written(name, "joint")
    rows = text.split("\n")
    for at in (1, len(rows) // 2):
        data = "\n".join([*rows[:at], HOSTILE[name][k], *rows[at:]]).encode()
        with suppress(FileFormatError):
            assert dialect_of(name).parse(data, Path(file)).positions
        dialect_of(name).check(data, Path(file))


FREE = {
    "fanuc-ls": r'!.*|"[^"]*"|/PROG.*|MEASURE|MNEDITOR',
    "yaskawa-jbi": r"'.*|(?<=COMM).*|//NAME.*|JOB:.*|////(?=FRAME)",
    "ur-urp": r'#.*|"[^"]*"|not |request_boolean_from_primary_client|/programs/.*(?=</file)',
    "ur-script": r'#.*|"[^"]*"|not |request_boolean_from_primary_client',
    "staubli-val3": r'//.*|popUpMsg\("[^"]*"|(?:link|version)="[^"]*"|(?<= value=)"[^"]*"|xmlns.*'
    r'|(?<=Data name=)"[^"]*"|(?<=Parameter name=)"[^"]*"|(?:ioLink|size|xsi)="[^"]*"',
    "kuka-krl": r";.*|&.*|MEASURE|DECL|(?<=AXIS )XP\d|(?<=POS )XP\d|(?<=DAT )\w+",
    "mitsubishi-melfa": r"'.*|MEASURE",
    "denso-pac": r"'.*|MEASURE",
    "franky-python": r'#.*|f?"[^"]*"',
    "xarm-python": r'#.*|f?"[^"]*"',
    "comau-pdl": r"--.*|'[^']*'|R_MEASURE",
    "hyundai-job": r"#.*|MEASURE",
    "epson-spel": r"'.*|MEASURE|MUTATED|Call",
    "doosan-drl": r'#.*|"[^"]*"',
    "kawasaki-as": r";.*|MEASURE|(?<=PROGRAM )\w+",
    "abb-rapid": r'!.*|"[^"]*"|MEASURE|9E9|LOCAL|MUTATED\w*|speeddata.*|ConfJ.On',
}
"""Comments, texts, names of the user and words that may be left out: a mutant there is legal."""

LEGAL = {
    "comau-pdl": r" *MOVE +TO \{.*",
    "hyundai-job": r" *call MEASURE[\d#].*",
    "mitsubishi-melfa": r"\d+ Ovrd 10\s*",
    "doosan-drl": r"def MEASURE\(number:0\):",
}
"""Lines that a mutant may become: the override of all motions, in the place of the joints'; an
annotation."""

WORD = re.compile(r"[A-Za-z_]\w*|\d+(?:\.\d*)?|\.\d+|[^\w\s]")


def mutants(text: str, count: int, free: re.Pattern[str]) -> Iterator[tuple[str, str]]:
    """The changed line and the whole text of so many mutants."""
    rng = np.random.default_rng(3)
    lines = text.split("\n")
    tokens = [
        (row, *token.span())
        for row, line in enumerate(lines)
        for token in WORD.finditer(line)
        if not any(a <= token.start() < b for a, b in (f.span() for f in free.finditer(line)))
    ]
    while count:
        row, start, end = tokens[int(rng.integers(len(tokens)))]
        changed = mutant(lines[row], start, end, int(rng.integers(5)), rng)
        if changed not in ("", lines[row]):
            count -= 1
            yield changed, "\n".join([*lines[:row], changed, *lines[row + 1 :]])


def mutant(line: str, start: int, end: int, how: int, rng: np.random.Generator) -> str:
    """The line with one token broken; empty where this way does not fit the token."""
    before, mark, behind = line[:start], line[start:end], line[end:]
    word, number = mark[0].isalpha(), mark[0].isdigit() or mark[0] == "."
    if how == 0 and not number and not (mark == "-" and behind[:1].isdigit()):
        return before + behind
    if how == 1:
        return before + mark + (" " if word or number else "") + mark + behind
    if how == 2 and word and len(mark) > 2:
        at = int(rng.integers(len(mark)))
        return before + mark[:at] + mark[at + 1 :] + behind
    if how == 3 and number:
        return before + mark + str(rng.choice(["_0", ".1.2", "e", "x"])) + behind
    if how == 4 and not word and not number:
        return before + str(rng.choice([*"()[]{},:=%#?"])) + behind
    return ""


def passing_mutants(name: str, form: str, arm: Arm, count: int, folder: Path) -> list[str]:
    """Lines of the mutants that a validator takes for good programs."""
    dialect, robot = DIALECTS[name], robot_of(name)
    turning = (robot.lower + robot.upper) / 2.0
    middle = np.concatenate([np.full(arm.n_external, 0.4), turning])
    postures = middle + np.array([[0.1], [0.2], [-0.3]])
    poses = [ProgramPose(f"P0{i}", q, via=i == 1) for i, q in enumerate(postures)]
    program = replace(program_of(name, poses, "MUTATED", form=form, user_frame=0), arm=arm)
    paths = dialect.write(program, folder)
    passing = []
    for path in paths:
        text = read_program_bytes(path).decode()
        assert [p for p in dialect.check(text.encode(), path) if p.level != "note"] == []
        for changed, whole in mutants(text, count, re.compile(FREE[name])):
            found = dialect.check(whole.encode(), path)
            legal = re.fullmatch(LEGAL.get(name, "(?!)"), changed)
            if not legal and not [p for p in found if p.level != "note"]:
                passing.append(changed)
    return passing


@pytest.mark.parametrize("count", by_stage(30, 75, 1000))
@pytest.mark.parametrize(("name", "form"), [case for case in CASES if case[0] in FREE])
def test_light_mutants_are_refused(name: str, form: str, count: int, tmp_path: Path) -> None:
    assert passing_mutants(name, form, Arm.of(robot_of(name)), count, tmp_path) == []


@pytest.mark.parametrize("count", by_stage(25, 100, 1000))
@pytest.mark.parametrize("name", [name for name in CARRIED if name in FREE])
def test_light_mutants_of_programs_on_slides_are_refused(name, count, tmp_path):
    assert passing_mutants(name, "joint", arm_on_slides(name), count, tmp_path) == []


BOMBS = [b"\n" * 18_000_000, b"," * 3_000_000, b",\n" * 1_500_000, b"X1=" + b"9" * 400 + b"\n"]


@pytest.mark.slow
@pytest.mark.full  # memory is traced, which takes minutes
@each_dialect
@pytest.mark.parametrize("data", BOMBS, ids=range(len(BOMBS)))
def test_hostile_files_end_soon_and_small(name: str, data: bytes) -> None:
    dialect = dialect_of(name)
    path = Path(f"X{dialect.suffixes[0]}")
    file, text = written(name, dialect.forms[0])
    middle = text.index("\n", len(text) // 2) + 1
    inside = text[:middle].encode() + data + text[middle:].encode()
    tracemalloc.start()
    try:
        for hostile, place in ((data, path), (inside, Path(file))):
            assert isinstance(dialect.check(hostile, place), list)
            with suppress(FileFormatError, InputError):
                dialect.parse(hostile, place)
        assert tracemalloc.get_traced_memory()[1] < 300e6
    finally:
        tracemalloc.stop()


@each_dialect
@pytest.mark.parametrize("data", RUBBISH, ids=range(len(RUBBISH)))
def test_rubbish_is_refused_at_once(name: str, data: bytes) -> None:
    dialect = dialect_of(name)
    path = Path(f"X{dialect.suffixes[0]}")
    with pytest.raises(CalibError) as caught:
        dialect.parse(data, path)
    assert isinstance(caught.value, FileFormatError | InputError)
    assert dialect.check(data, path)


@each_dialect
def test_a_huge_file_is_refused_without_being_read(name: str, tmp_path: Path) -> None:
    dialect = DIALECTS[name]
    path = tmp_path / f"X{dialect.suffixes[0]}"
    with path.open("wb") as stream:
        stream.truncate(100_000_000)
    for call in (dialect.read, dialect.validate):
        with pytest.raises(FileFormatError, match="is larger than 20 MB"):
            call(path)


@each_dialect
def test_marks_of_editors_and_of_dos_are_no_part_of_a_program(name: str, tmp_path: Path) -> None:
    file, text = written(name, dialect_of(name).forms[0])
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"\xef\xbb\xbf" + text.encode() + b"\x1a\r\n")
    assert read_program_bytes(path) == text.encode()
    assert [p for p in dialect_of(name).validate(path) if p.rule == "text"] == []


@pytest.mark.parametrize(
    ("bound", "line"), [("MOST_NUMBERS", "q{0}=[0,0,0,0,0,0]"), ("MOST_PARSED", "{0}({0})")]
)
def test_what_is_read_of_a_file_is_bounded(monkeypatch, bound, line):
    # numbers of many lines, and lines that are each another one, cost their time each
    monkeypatch.setattr(language, bound, 3000)
    names = ["a" + np.base_repr(k, 2).translate({48: "b", 49: "c"}) for k in range(5000)]
    text = "\n".join(line.format(k if "q" in line else names[k]) for k in range(5000))
    faults = [s.fault for s in UR_SCRIPT.statements(text)]
    assert faults[100] == ""
    assert faults[-1] == "the program is too long to be read so far"
    assert len(faults) < 2500
