"""The controllers that programs can be written for, and how a file finds its own."""

from __future__ import annotations

from collections.abc import Collection
from os import PathLike
from pathlib import Path

from calib.errors import FileFormatError, InputError, check_type, near_names
from calib.robots import Robot
from calib.se3 import FloatArray
from posedesign.programs.abb_rapid import AbbRapid
from posedesign.programs.arm import Arm
from posedesign.programs.comau_pdl import ComauPdl
from posedesign.programs.denso_pac import DensoPac
from posedesign.programs.dialect import Dialect
from posedesign.programs.doosan_drl import DoosanDrl
from posedesign.programs.epson_spel import EpsonSpel
from posedesign.programs.fanuc_ls import FanucLs
from posedesign.programs.franky_python import FrankyPython
from posedesign.programs.hyundai_job import HyundaiJob
from posedesign.programs.kawasaki_as import KawasakiAs
from posedesign.programs.kuka_krl import KukaKrl
from posedesign.programs.mitsubishi_melfa import MitsubishiMelfa
from posedesign.programs.program import Planned, PoseProgram, ProgramOptions
from posedesign.programs.reading import read_program_bytes
from posedesign.programs.recorded import Level, Problem, RecordedProgram, postures_of
from posedesign.programs.robodk_csv import RobodkCsv
from posedesign.programs.ros import MoveitJoints, RobotCalibration, RosTrajectory
from posedesign.programs.staubli_val3 import StaubliVal3
from posedesign.programs.ur_script import UrScript
from posedesign.programs.ur_urp import UrUrp
from posedesign.programs.xarm_python import XarmPython
from posedesign.programs.yaskawa_jbi import YaskawaJbi

DIALECTS: dict[str, Dialect] = {
    dialect.name: dialect
    for dialect in (
        FanucLs(),
        KukaKrl(),
        AbbRapid(),
        UrScript(),
        UrUrp(),
        YaskawaJbi(),
        StaubliVal3(),
        RosTrajectory(),
        MoveitJoints(),
        RobotCalibration(),
        RobodkCsv(),
        MitsubishiMelfa(),
        KawasakiAs(),
        DoosanDrl(),
        DensoPac(),
        EpsonSpel(),
        HyundaiJob(),
        ComauPdl(),
        XarmPython(),
        FrankyPython(),
    )
}
"""All dialects by name. A new controller is a new file and one entry here."""


def write(
    program: PoseProgram | Planned,
    dialect: str,
    folder: Path | str,
    options: ProgramOptions | None = None,
    name: str = "CALIB01",
) -> tuple[Path, ...]:
    """Write a program for a controller.

    Parameters
    ----------
    program : PoseProgram, PosePlan or OptimalPlan
        What to write.
    dialect : str
        Name of the controller's format, a key of `DIALECTS`.
    folder : Path or str
        Where to. Files in it are replaced whole or not at all.
    options : ProgramOptions, optional
        How the poses of a plan are visited and measured; a program has its own.
    name : str
        Of the program of a plan.

    Returns
    -------
    tuple of Path
        The files written: those with the positions first, several where a program is too long for
        one.

    Raises
    ------
    InputError
        An unknown dialect, or a program that the controller would refuse.
    OutputError
        The file cannot be written.
    """
    chosen = find_dialect(dialect)
    check_type(folder, (str, PathLike), "folder")
    if not isinstance(program, PoseProgram):
        program = PoseProgram.of_plan(program, name, options)
    return chosen.write(program, Path(folder))


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
    check_type(path, (str, PathLike), "path")
    return dialect_of(Path(path), dialect).read(Path(path))


def validate(
    path: Path | str, dialect: str | None = None, levels: Collection[Level] | None = None
) -> list[Problem]:
    """Check a program file against the rules of its controller.

    Parameters
    ----------
    path : Path or str
        The file.
    dialect : str, optional
        Name of its format; by default the ending of the file tells.
    levels : collection of {"error", "measuring", "note"}, optional
        Of the problems that are told. By default errors; of programs that carry the mark of a plan
        also what would not measure as planned.

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
    check_type(path, (str, PathLike), "path")
    return dialect_of(Path(path), dialect).validate(Path(path), levels)


def find_dialect(name: str) -> Dialect:
    """Return the dialect of this name; InputError with the near names where there is none."""
    check_type(name, str, "dialect")
    if name not in DIALECTS:
        raise InputError(
            f"unknown dialect {name!r}", hint=near_names(name, DIALECTS), name="dialect", value=name
        )
    return DIALECTS[name]


def dialect_of(path: Path, name: str | None = None) -> Dialect:
    """The dialect of a file: the one that is named, or what its ending and content tell.

    Raises InputError: there is none of this name, or none has this ending. Raises FileFormatError:
    several have this ending, and the content is none of theirs.
    """
    if name is not None:
        return find_dialect(name)
    if path.is_dir():
        raise InputError(
            f"{path} is a folder",
            hint="name the program's file in it",
            name="path",
            value=str(path),
        )
    beside = [
        d for d in DIALECTS.values() if path.suffix.lower() in {*d.companions} - {*d.suffixes}
    ]
    for dialect in beside if path.is_file() else ():
        if dialect.is_companion(read_program_bytes(path)):
            return dialect
    fitting = [d for d in DIALECTS.values() if path.suffix.lower() in d.suffixes]
    if len(fitting) == 1:
        return fitting[0]
    if fitting:
        data = read_program_bytes(path)
        for dialect in fitting:
            if dialect.recognises(data):
                return dialect
        raise FileFormatError(
            "is none of " + ", ".join(f"{d.name} ({d.title})" for d in fitting),
            path=path,
            hint="name the dialect with `format`",
        )
    known = " ".join(dict.fromkeys(end for d in DIALECTS.values() for end in d.suffixes))
    raise InputError(
        f"{path}: no controller's programs end in {path.suffix or 'nothing'}",
        hint=f"give a program ({known}), or name the dialect",
        name="path",
        value=str(path),
    )


def title_of(path: Path) -> str:
    """Return the title of the language that a file is a program of; empty for any other file.

    A table (CSV) is no program here, though RoboDK has its lists in that form.
    """
    ending = path.suffix.lower()
    if ending == ".csv" or not path.is_file():
        return ""
    fitting = [d for d in DIALECTS.values() if ending in d.suffixes]
    data = read_program_bytes(path) if fitting else b""
    return next((d.title for d in fitting if d.recognises(data)), "")


def said_of_program(error: FileFormatError) -> FileFormatError:
    """Return the error of a file that was read as a table, or that it is a program where it is."""
    title = title_of(error.path)
    if not title:
        return error
    return FileFormatError(
        f"is a {title}, and a table (CSV) is read here",
        path=error.path,
        hint="read positions back from it with: posedesign import",
    )


def read_joints(
    path: Path, robot: Robot, dialect: str | None = None, *, hint: str
) -> tuple[FloatArray, list[int]]:
    """Postures ``(N, n)`` [rad] of the joint positions of a file, and their lines.

    Raises FileFormatError: a position is the pose of a tool, with the hint what to give instead.
    """
    endings = {ending for d in DIALECTS.values() for ending in d.suffixes}
    if dialect is None and path.is_file() and path.suffix.lower() not in endings:
        raise FileFormatError(
            "is no table of joints (CSV) and no program of a controller, by its ending",
            path=path,
            hint="give a table with the columns j1_deg j2_deg ..",
        )
    chosen = dialect_of(path, dialect)
    positions = chosen.read(path).whole().measured
    posed = next((p.line for p in positions if p.shown_deg is None), None)
    if posed is not None:
        raise FileFormatError(
            "is the pose of a tool, whose place on the flange it does not say",
            path=path,
            row=posed,
            hint=hint,
        )
    return postures_of(positions, chosen.seen(Arm.of(robot))), [p.line for p in positions]
