"""The controllers that programs can be written for, and how a file finds its own."""

from __future__ import annotations

from pathlib import Path

from calib.errors import InputError, near_names
from posedesign.pose_plan import PosePlan
from posedesign.programs.dialect import Dialect
from posedesign.programs.fanuc_ls import FanucLs
from posedesign.programs.program import PoseProgram
from posedesign.programs.recorded import Problem, RecordedProgram

DIALECTS: dict[str, Dialect] = {dialect.name: dialect for dialect in (FanucLs(),)}
"""All dialects by name. A new controller is a new file and one entry here."""


def write(program: PoseProgram | PosePlan, dialect: str, path: Path | str) -> Path:
    """Write a program for a controller.

    Parameters
    ----------
    program : PoseProgram or PosePlan
        What to write. A plan becomes a program of the usual options, named after the file.
    dialect : str
        Name of the controller's format, a key of `DIALECTS`.
    path : Path or str
        The file, with the ending of the dialect. It is replaced whole or not at all.

    Returns
    -------
    Path
        The file written.

    Raises
    ------
    InputError
        An unknown dialect, another ending, or a program that the controller would refuse.
    OutputError
        The file cannot be written.
    """
    chosen = find_dialect(dialect)
    path = Path(path)
    if path.suffix.lower() not in chosen.suffixes:
        raise InputError(
            f"{path} does not end in {chosen.suffixes[0]}",
            hint=f"name it {path.with_suffix(chosen.suffixes[0]).name}" if path.name else "",
            name="path",
            value=str(path),
        )
    if isinstance(program, PosePlan):
        program = PoseProgram.of_plan(program, path.stem.upper())
    chosen.write(program, path)
    return path


def read(path: Path | str, dialect: str | None = None) -> RecordedProgram:
    """Read a program back, in URDF signs.

    Parameters
    ----------
    path : Path or str
        The file.
    dialect : str, optional
        Name of its format; by default the ending of the file tells.

    Returns
    -------
    RecordedProgram
        Its positions, at least one.

    Raises
    ------
    InputError
        No dialect has this ending.
    FileFormatError
        The file is not such a program.
    """
    return _dialect_of(Path(path), dialect).read(Path(path))


def validate(path: Path | str, dialect: str | None = None) -> list[Problem]:
    """Check a program file strictly against the rules of its controller.

    Parameters
    ----------
    path : Path or str
        The file.
    dialect : str, optional
        Name of its format; by default the ending of the file tells.

    Returns
    -------
    list of Problem
        In the order of the lines; empty for a good file.

    Raises
    ------
    InputError
        No dialect has this ending.
    FileFormatError
        The file cannot be opened.
    """
    return _dialect_of(Path(path), dialect).validate(Path(path))


def find_dialect(name: str) -> Dialect:
    """Return the dialect of this name; InputError with the near names where there is none."""
    if name not in DIALECTS:
        raise InputError(
            f"unknown dialect {name!r}", hint=near_names(name, DIALECTS), name="dialect", value=name
        )
    return DIALECTS[name]


def _dialect_of(path: Path, name: str | None) -> Dialect:
    if name is not None:
        return find_dialect(name)
    for dialect in DIALECTS.values():
        if path.suffix.lower() in dialect.suffixes:
            return dialect
    known = ", ".join(f"{d.suffixes[0]} ({d.name})" for d in DIALECTS.values())
    raise InputError(
        f"{path}: no controller's programs end in {path.suffix or 'nothing'}",
        hint=f"known: {known}; or name the dialect",
        name="path",
        value=str(path),
    )
