"""Options that several commands have, and how commands print.

Tables for people, JSON for programs, progress on standard error. The one place where text leaves
for a terminal: names and paths come from files of others, so what would steer a terminal, or begin
another line, is shown by its code (:func:`plain`).
"""

from __future__ import annotations

import math
import os
import re
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TextIO

import typer

from posedesign.report.answer import Line

if TYPE_CHECKING:
    from pathlib import Path

    from posedesign.cell import Cell
    from posedesign.files import Results
    from posedesign.planning import PoseList
    from posedesign.report.answer import Answer


LARGEST_SEED = 2**63 - 1
"""As in a cell."""

CellFile = Annotated[Path, typer.Argument(help="The cell, made with: posedesign new > cell.toml")]
PlannedPoses = Annotated[Path, typer.Argument(help="The poses, from: posedesign plan")]
ListedPoses = Annotated[
    Path, typer.Argument(help="A list of poses with columns j1_deg, j2_deg, ...")
]
OutFolder = Annotated[Path, typer.Option("--out", help="Folder for the results.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON in place of the answer.")]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Print the tables and all notes, too.")
]
Overwrite = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace files that this command did not write, too; they are kept beside it as "
        "NAME.1, NAME.2, ...",
    ),
]
TrustUnits = Annotated[
    bool, typer.Option("--trust-units", help="Accept joint values that look like radians.")
]
JointsFile = Annotated[
    Path | None,
    typer.Option(
        "--joints",
        help="Joints for the file of an instrument: a table (j1_deg ..), a log (RTDE, EGM, "
        "RSI, ROS), a program.",
    ),
]
FileFormat = Annotated[
    str | None, typer.Option("--format", help="Of the files; default: what they look like.")
]
CameraPlace = Literal["on-flange", "fixed"]


PIPE_WIDTH = 200
"""Columns of a table that goes into a pipe: wide enough not to be cut."""

_ROUNDED = re.compile(r"-?\d+(\.\d+)?", re.ASCII)

DONE, NOT_REACHED, BAD_INPUT, FAULT, STOPPED = 0, 1, 2, 70, 130
"""Exit codes; a fault of this program has that of BSD's ``sysexits.h``, a command ended by Ctrl-C
that of shells."""


Advance = Callable[[str, float], None]
"""Is told what is being done, and which part of all work is done."""

_ARGUMENT = re.compile(r"`([a-z]+(?:_[a-z]+)*)`")
"""An argument of a function as the library's texts name it: here it is an option."""


def plain(text: str) -> str:
    r"""A text on one line, without what steers a terminal: spaces, or codes such as ``\x1b``.

    Arguments that the library names, as in \`trust_units\`, are options: ``--trust-units``.
    """
    text = _ARGUMENT.sub(lambda found: "--" + found[1].replace("_", "-"), text)
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in text)


def say(text: str) -> None:
    """Print one line of the result."""
    print(plain(text))


def show_file(text: str) -> None:
    """Print the text of a file as it is: one that this project has written."""
    print(text, end="")


def print_table(title: str, rows: Sequence[Mapping[str, object]], width: int | None = None) -> None:
    """Print rows as a table; columns as in the first row.

    In a narrow terminal, or in a pipe of ``width`` columns, headings and words are folded; numbers
    are never cut.
    """
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text  # plain text: [mm] is a unit, not markup

    if not rows:
        return
    console = Console(width=None if sys.stdout.isatty() else width or PIPE_WIDTH, highlight=False)
    table = Table(title=Text(plain(title)), title_justify="left", title_style="bold")
    for column in rows[0]:
        number = all(_is_number(row.get(column)) for row in rows)
        widest = max(len(_shown(row.get(column))) for row in rows) if number else None
        table.add_column(
            Text(plain(str(column))),
            justify="right" if number else "left",
            min_width=widest,
            overflow="fold",
        )
    for row in rows:
        table.add_row(*(Text(_shown(row.get(column))) for column in rows[0]))
    console.print(table, crop=False)


def print_json(content: object) -> None:
    """Print a value as JSON; numbers that JSON does not have become null."""
    from posedesign.files import json_text

    print(json_text(content))


def note(text: str) -> None:
    """Say something that is not the result, on standard error; nothing of an empty text."""
    if text:
        _print_line(Line("", text), sys.stderr)


def poses_of(
    cell: Cell | None, path: Path, *, trust_units: bool = False, of_any_robot: bool = False
) -> PoseList:
    """The poses of a list for the robot of a cell; says what is odd about it."""
    from calib.robots import NO_EXTERNAL_AXES
    from posedesign.planning.poses_file import read_poses

    robot = cell.robot if cell else None
    listed = read_poses(
        path,
        robot.n if robot else None,
        external=robot.external if robot else NO_EXTERNAL_AXES,
        controller=robot.controller if robot else None,
        trust_units=trust_units,
    )
    note_misfit(path, listed, None if of_any_robot else cell)
    return listed


def note_misfit(path: Path, listed: PoseList, cell: Cell | None) -> None:
    """Warn of a list that was changed after planning, is corrected, or looks like another's."""
    other = listed.other_robot(cell.robot) if cell else ""
    for said in (listed.misfit, other, listed.corrected, *listed.mistyped):
        if said:
            note(f"warning: {path}: {said}")


def results_in(
    out: Path, command: str, *inputs: Path | None, overwrite: bool, remakes: bool = False
) -> Results:
    """The folder that a command writes into, what it reads, and what it may replace."""
    from posedesign.files import Results

    read = tuple(path for path in inputs if path is not None)
    return Results(out, command, read, overwrite, lambda text: note(f"note: {text}"), remakes)


def rehearsed_words(*inputs: Path | None) -> str:
    """What to say before any result where one of the files read is of a simulated robot."""
    from posedesign.files import rehearsed

    return rehearsed(inputs)


def tell(
    answer: Answer,
    good: bool = True,
    *,
    verbose: bool = False,
    then: str = "",
    first: str = "",
    content: object = None,
    as_json: bool = False,
) -> int:
    """Print an answer: what fits at a glance, or all of it with its tables; give the exit code.

    Warnings and notes go to standard error. As JSON ``content`` is printed in place of the result;
    what was not checked then goes to standard error as well.
    """
    if as_json:
        note(first)
        print_json(content)
        for line in answer.all_lines():
            if line.is_remark:
                _print_line(line, sys.stderr)
        return DONE if good else NOT_REACHED
    if verbose:
        for text in Line("", first).wrapped(plain) if first else ():
            print(text)
        for table in answer.tables:
            print_table(table.title, table.rows)
        lines = replace(answer, then=then).all_lines()
    else:
        lines = replace(answer, then=then, first=first).short("see --verbose")
    for line in lines:
        _print_line(line, sys.stdout if line.goes_with_result else sys.stderr)
    return DONE if good else NOT_REACHED


def _print_line(line: Line, stream: TextIO) -> None:
    for text in line.wrapped(plain):
        print(text, file=stream, flush=True)


def command_line(*words: object) -> str:
    """A command as a person types it, paths quoted where they have to be."""
    return "posedesign " + " ".join(shlex.quote(str(word)) for word in words)


def to_folder(out: Path) -> tuple[object, ...]:
    """Words of a next command that writes where this one was told to; none where it was not."""
    return () if out == Path() else ("--out", out)


PROVED_BY = {"acceptance poses": "prove", "recheck poses": "recheck"}
"""Command that judges what is measured at poses, by the purpose that their list states."""


def after_measuring(cell: Path, poses: Path | None, measured: str | Path) -> tuple[object, ...]:
    """Words of the command that uses measurements at poses: identify, or prove or recheck.

    A test is judged by the identification that it was planned with, where that is found beside it,
    and by the rule beside its poses.
    """
    from posedesign.acceptance.file import RULE
    from posedesign.files import origin_of

    there = None if poses is None else origin_of(poses)
    command = PROVED_BY.get(there.purpose) if there is not None else None
    if poses is None or there is None or command is None:
        return "identify", cell, measured
    identified = _input_named("identification", there.inputs, (poses.parent, cell.parent))
    rule = poses.parent / RULE
    elsewhere = command == "prove" and rule.is_file() and Path(measured).parent != rule.parent
    given = (("--identification", identified) if identified else (), ("--rule", rule) * elsewhere)
    return command, cell, measured, *given[0], *given[1]


def _input_named(
    word: str, inputs: Sequence[tuple[str, str]], folders: Sequence[Path]
) -> Path | None:
    """The file of this name that a list was made from; looked for in folders and beside them."""
    from posedesign.files.origin import checksum

    for name, mark in inputs:
        if word not in name:
            continue
        for folder in folders:
            beside = (path / name for path in sorted(folder.parent.iterdir()) if path.is_dir())
            inside = (path / name for path in sorted(folder.iterdir()) if path.is_dir())
            for path in (folder / name, folder.parent / name, *inside, *beside):
                if path.is_file() and checksum(path) == mark:
                    return path
        return Path(name)
    return None


def refuse_given(options: Mapping[str, object], why: str) -> None:
    """Refuse options that would do nothing: the first that is given, by ``why``."""
    from calib.errors import InputError

    name = next((name for name, value in options.items() if value is not None), None)
    if name is not None:
        raise InputError(f"`{name}` {why}", hint="leave it out", name=name)


@contextmanager
def knowing(cell: Cell) -> Iterator[None]:
    """Say what is to be known of a cell before the error that ends work on it."""
    from calib.errors import CalibError

    try:
        yield
    except CalibError:
        say_what_to_know(cell)
        raise


def say_what_to_know(cell: Cell) -> None:
    """Say where the target of a cell is, what was decided, what is odd, and what is not checked."""
    note(f"target: {cell.whereabouts.words}")
    for said in cell.doubts:
        note(f"warning: {said}")
    for said in cell.remarks:
        note(f"note: {said}")
    for said in cell.not_checked:
        note(f"not checked: {said}")


@contextmanager
def progress(title: str, *, with_time_left: bool = False, quiet: bool = False) -> Iterator[Advance]:
    """A progress bar on standard error, if that is a terminal, while something long runs."""
    # rich, which is slow to load, may be told to take anything for a terminal
    if quiet or not (sys.stderr.isatty() or os.environ.get("FORCE_COLOR")):
        yield lambda what, part: None
        return
    from rich import progress as bars
    from rich.console import Console

    columns = [bars.TextColumn("{task.description}", markup=False), bars.BarColumn()]
    columns.append(bars.TimeElapsedColumn())
    if with_time_left:
        columns += [bars.TextColumn("left"), bars.TimeRemainingColumn()]
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=1.0)

        def advance(what: str, part: float) -> None:
            bar.update(task, description=plain(f"{title}: {what}"), completed=part)

        yield advance


def _is_number(value: object) -> bool:
    """Whether a cell is a number, or one that was rounded to the decimals that it deserves."""
    if isinstance(value, str):
        return _ROUNDED.fullmatch(value) is not None
    return value is None or isinstance(value, (int, float))


def _shown(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        if not math.isfinite(value):
            return "-" if math.isnan(value) else "inf"
        return f"{value:.4g}" if abs(value) >= 1e4 or 0 < abs(value) < 1e-4 else f"{value:.5g}"
    return plain(str(value))
