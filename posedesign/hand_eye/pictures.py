"""Pictures of a calibration board with the joints, or the poses of the flange, of each.

A table says them by the names of the pictures (column ``picture``), or in their order: the natural
one of their names (2 before 10), or that of the times in their EXIF. A robot program or a list for
ROS or RoboDK says them in order. Files of keys and lists, and folders with a file for each picture
(:mod:`.pairs.pose_files`), say them by names, by the numbers in their names, or in order. What is
taken for granted in this is said in a note.

Of an arm that moved the table is a record of its joints, or of the poses of its flange, by the
column ``time_s``, by one clock: rows as they were recorded, and rows of pictures with the time that
each was taken at, with or without joints. Those of a picture are those of the record at its time.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PureWindowsPath
from typing import Literal

import numpy as np

from calib.errors import FileFormatError, InputError
from calib.hand_eye.pictures import FEWEST_NEAR, NEAR_S, motion_at, rows_near
from calib.robots import Robot, flange_robot, posture_of_pose
from calib.se3 import FloatArray, IntArray
from posedesign.files.csv_tables import (
    LARGEST_CSV_BYTES,
    LONGEST_SHOWN,
    Row,
    a_few,
    is_number,
    numbers_of,
    read_table,
)
from posedesign.files.pictures import ENDINGS, PictureHead, read_grey, read_head
from posedesign.files.postures import find_form, postures_in_any_form
from posedesign.files.safe import read_bytes_bounded
from posedesign.files.trees import read_tree
from posedesign.hand_eye.conventions import Convention, convention_of
from posedesign.hand_eye.pairs.file import read_numbers
from posedesign.hand_eye.pairs.forms import (
    POSE_COLUMNS,
    Poses,
    WrittenPoses,
    pose_columns,
    read_poses_of,
)
from posedesign.hand_eye.pairs.pose_files import STACKS, TREES, natural, read_written, written_tree
from posedesign.hand_eye.pairs.stacks import open_blocks

__all__ = ["PictureSet", "read_grey", "read_picture_set"]

Order = Literal["name", "time"]

_TABLES = (".csv", ".txt", ".tsv", ".dat")
"""Endings of tables; all others are of programs and lists."""

_NOT_MEASURED = ("via", "dropped")
"""Status of rows of a ``poses.csv`` at which no picture was taken."""


@dataclass(frozen=True, eq=False)
class PictureSet:
    """Pictures by one lens, and how the arm stood when each was taken."""

    paths: tuple[Path, ...]  # their files, in order
    names: tuple[str, ...]  # names of the files; each is there once
    size_px: tuple[int, int]  # width and height of all
    postures: FloatArray | None
    """(N, n): joint values [rad]; NaN for a picture without, which serves the lens only. None where
    poses of the flange are given, or nothing."""
    T_base_flange: FloatArray | None
    """(N, 4, 4): poses of the flange in the base frame [m], likewise."""
    motion: FloatArray | None
    """(N, 2, n): velocity [rad/s] and acceleration [rad/s²] of the joints, where a record has them;
    of the postures of :func:`calib.robots.flange_robot`, where it is of poses."""
    notes: tuple[str, ...]  # what is odd about them, or was taken for granted, in words
    written: Poses | None = None
    """Poses of the flange as they stand in the file, where they are of single pictures."""
    written_rows: IntArray | None = None
    """(N,): which of these is that of each picture; -1 where there is none."""


def read_picture_set(
    pictures: Path | Sequence[Path],
    poses: Path | None = None,
    robot: Robot | None = None,
    *,
    order: Order = "name",
    trust_units: bool = False,
    poses_are: str = "",
) -> PictureSet:
    """Read which pictures there are, and the joints or poses that belong to them.

    The pixels are read later, one picture at a time, by `read_grey`.

    ``pictures``: a folder, or files and folders in any order. ``poses``: a table (CSV) with joint
    columns (:mod:`posedesign.files.postures`) or the pose of the flange (:mod:`.pairs.forms`); a
    robot program, or a list for ROS or RoboDK, of joint values; a file or a folder of
    :mod:`.pairs.pose_files`. Without it the pictures serve the
    lens only. ``robot``: the arm that joint values are of. ``order`` {"name", "time"}: order of the
    pictures: by name, numbers in it by their value, or by the time in their EXIF. ``trust_units``:
    do not refuse values that look like those of another unit. ``poses_are``: convention of the
    poses of the flange, see :func:`~posedesign.hand_eye.conventions.convention_of`. Raises
    FileFormatError: a picture cannot be read, has another size than the others, or is there twice
    at different poses; rows do not fit the pictures, or hold something else than numbers.
    InputError: there are no pictures, two have one name, or joint values and no robot.
    """
    said = convention_of(poses_are) if poses_are.strip() else None
    paths, notes = _files_of([pictures] if isinstance(pictures, Path) else pictures, poses)
    heads = _heads_of(paths)
    if order == "time":
        paths, heads = _by_time(paths, heads, notes)
    turned = [path.name for path, head in zip(paths, heads, strict=True) if head.is_turned]
    if turned:
        notes.append(
            f"{a_few(turned)}: a note in the file asks to turn the picture; it stays as the "
            "sensor had it, as the lens does"
        )
    found = None
    if poses is not None:
        found = _Poses.read(poses, robot, trust_units, said).of_pictures(paths, order, notes)
    kept = _without_copies(paths, heads, None if found is None else found.values, notes)
    values = None if found is None else found.values[kept]
    if values is not None:
        without = [paths[i].name for i, v in zip(kept, values, strict=True) if np.isnan(v).any()]
        if without:
            notes.append(f"{a_few(without)}: no pose is given, used for the lens only")
    return PictureSet(
        tuple(paths[i] for i in kept),
        tuple(paths[i].name for i in kept),
        heads[0].size_px,
        values if found is not None and found.joints else None,
        values if found is not None and not found.joints else None,
        found.motion[kept] if found is not None and found.motion is not None else None,
        tuple(notes),
        None if found is None else found.written,
        None if found is None else found.rows[kept],
    )


def cameras_in(folder: Path) -> dict[str, Path]:
    """Folders of pictures by the name of their camera: those in a folder that has no pictures.

    A folder that has pictures is of one, called ``camera``.
    """
    if folder.is_dir():
        entries = sorted(folder.iterdir())
        inside = [entry for entry in entries if entry.is_dir() and not entry.name.startswith(".")]
        if inside and not any(entry.suffix.lower() in ENDINGS for entry in entries):
            return {entry.name: entry for entry in inside}
    return {"camera": folder}


def _files_of(given: Iterable[Path], poses: Path | None) -> tuple[list[Path], list[str]]:
    """The pictures in their natural order, and a note of what else is in their folders."""
    paths: list[Path] = []
    other: list[str] = []
    for place in given:
        if not place.is_dir():
            paths.append(place)
            continue
        try:
            entries = [e for e in place.iterdir() if not e.name.startswith(".") and e.is_file()]
        except OSError as error:
            raise FileFormatError(
                f"cannot be listed: {error.strerror or error}",
                path=place,
                hint="check that the folder can be read",
            ) from error
        paths += [entry for entry in entries if entry.suffix.casefold() in ENDINGS]
        other += [entry.name for entry in entries if entry.suffix.casefold() not in ENDINGS]
    if not paths:
        raise InputError(
            "there are no pictures" + (f", only {a_few(sorted(other))}" if other else ""),
            hint=f"name the folder with the files {' '.join(ENDINGS)}",
            name="pictures",
        )
    paths = sorted(dict.fromkeys(paths), key=lambda path: natural(path.name))
    double = [name for name, count in Counter(path.name for path in paths).items() if count > 1]
    if double:
        raise InputError(
            f"several pictures have the name {a_few(double)}",
            hint="rename those of one folder: rows and messages tell pictures by name",
            name="pictures",
            value=double[0],
        )
    passed = sorted(name for name in other if poses is None or name != poses.name)
    return paths, [f"no pictures, passed over: {a_few(passed)}"] if passed else []


def _heads_of(paths: Sequence[Path]) -> list[PictureHead]:
    """What the files say of their pictures, all of which can be read and have one size."""
    heads: list[PictureHead] = []
    faults: list[FileFormatError] = []
    for path in paths:
        try:
            heads.append(read_head(path))
        except FileFormatError as error:
            faults.append(error)
    if faults:
        more = [fault.path.name for fault in faults[1:]]
        said = faults[0].message.removeprefix(f"{faults[0].path}: ")
        raise FileFormatError(
            said + (f"; nor can {a_few(more)} be read" if more else ""),
            path=faults[0].path,
            hint=f"{faults[0].hint}, or take it out",
        ) from faults[0]
    sizes = Counter(head.size_px for head in heads)
    usual, count = sizes.most_common(1)[0]
    odd = [i for i, head in enumerate(heads) if head.size_px != usual]
    if odd:
        width, height = heads[odd[0]].size_px
        others = [paths[i].name for i in odd[1:]]
        raise FileFormatError(
            f"has {width} by {height} pixels, where {count} others have {usual[0]} by {usual[1]}"
            + (f"; so have other sizes {a_few(others)}" if others else ""),
            path=paths[odd[0]],
            hint="it was turned when it was saved: save it as the camera gives it"
            if (height, width) == usual
            else "a lens is estimated from pictures of one size: take those of others out",
        )
    return heads


def _by_time(
    paths: list[Path], heads: list[PictureHead], notes: list[str]
) -> tuple[list[Path], list[PictureHead]]:
    silent = [path.name for path, head in zip(paths, heads, strict=True) if not head.taken]
    if silent:
        raise InputError(
            f"{a_few(silent)}: the file does not say when it was taken (no time in its EXIF)",
            hint="take the order of names",
            name="order",
        )
    ranks = sorted(range(len(paths)), key=lambda i: heads[i].taken)  # keeps names in order
    times = Counter(head.taken for head in heads)
    same = [path.name for path, head in zip(paths, heads, strict=True) if times[head.taken] > 1]
    if same:
        notes.append(f"{a_few(same)}: taken at the same time as another, in the order of names")
    return [paths[i] for i in ranks], [heads[i] for i in ranks]


@dataclass(frozen=True, eq=False)
class _Poses:
    """Joint values or poses of the flange, row by row of a file."""

    path: Path
    joints: bool  # whether they are joint values
    values: FloatArray  # (R, n) or (R, 4, 4): NaN in rows that give none
    lines: list[int]
    pictures: list[str]  # the picture of each row; empty where the file does not say
    notes: tuple[str, ...] = ()
    motion: FloatArray | None = None
    """(R, 2, n): how the joints moved, where the file is a record of them."""
    written: Poses | None = None  # poses of the flange as they stand
    rows: IntArray = field(default_factory=lambda: np.zeros(0, dtype=np.intp))
    """Which of these is that of each row; -1 where there is none."""
    called: tuple[str, ...] = ()  # what the poses are called, where that may be their pictures

    @classmethod
    def read(
        cls, path: Path, robot: Robot | None, trust_units: bool, said: Convention | None
    ) -> _Poses:
        """Read a table, a program of joint values, or poses in a file or a folder of people."""
        written = _written(path)
        # six bare numbers a line of a robot that is known are joint values
        if written is not None and not (robot and written.is_bare and said is None):
            return cls._of_people(written, said, trust_units)
        if path.suffix.casefold() not in _TABLES:
            return cls._of_program(path, robot, None)
        blocks = open_blocks(path)
        if blocks is not None:
            length = said.length if said is not None else ""
            return cls._of_people(blocks.written("blocks", length), said, trust_units)
        bare = said is not None or robot is None
        table = read_numbers(path, bare=True) if bare else read_table(path, loose=True)
        columns, notes = table.columns, table.notes
        rows = [row for row in table.rows if row.cells.get("status") not in _NOT_MEASURED]
        if len(rows) < len(table.rows):
            notes += (
                f"{path}: {len(table.rows) - len(rows)} rows are via or dropped, passed over",
            )
        if all(is_number(name) for name in columns):
            return cls._of_program(path, robot, "robodk-csv")
        shown = POSE_COLUMNS & {*columns}
        if not shown and (said or robot is None) and pose_columns(columns, said) is not None:
            shown = frozenset(name for part in pose_columns(columns, said) or () for name in part)
        needed = () if robot is None else find_form(columns, robot)[1]
        joints = robot is not None and bool({*needed} & {*columns} or not shown)
        if not (joints or shown):
            raise FileFormatError(
                "has no pose of the flange, and joint values need the robot",
                path=path,
                row=1,
                hint="name the robot, or call columns x_mm y_mm z_mm and w_deg p_deg r_deg, say",
            )
        taken = [column for column in columns if column in (needed if joints else shown)]
        full = [not taken or any(row.cells[column] for column in taken) for row in rows]
        posed = [row for row, is_full in zip(rows, full, strict=True) if is_full]
        if not posed:
            raise FileFormatError("gives no pose in any row", path=path, hint="fill its cells in")
        poses = None
        if joints and robot is not None:
            found = postures_in_any_form(path, columns, posed, robot, trust_units)
            if shown:
                notes += (f"{path} gives joints and poses: the joints are taken",)
        else:
            poses = read_poses_of(path, columns, posed, "", trust_units=trust_units, said=said)
            found, notes = poses.T, notes + poses.notes
        values = np.full((len(rows), *found.shape[1:]), np.nan)
        values[full] = found
        pictures = _pictures_of(path, columns, rows)
        index = np.where(full, np.cumsum(full) - 1, -1)
        lines = [row.line for row in rows]
        given = cls(path, joints, values, lines, pictures, notes, None, poses, index)
        if pictures and "time_s" in columns:
            return given._out_of_record(numbers_of(path, rows, ["time_s"])[:, 0])
        return given

    def _out_of_record(self, times: FloatArray) -> _Poses:
        """The rows of pictures, with the joints or poses of a record at their times."""
        recorded = np.asarray(np.isfinite(self.values).reshape(len(times), -1).all(axis=1))
        rise, first = np.unique(times[recorded], return_index=True)
        record = self.values[recorded][first]
        named = np.flatnonzero([bool(picture) for picture in self.pictures])
        fine = np.array([len(rows_near(rise, time)) > 0 for time in times[named]])
        if recorded[named].all() and not fine.any():
            return self._rows(named)  # an arm that stood still, and when it did
        if not fine.all():
            raise FileFormatError(
                f"has no {FEWEST_NEAR} rows of {'joints' if self.joints else 'poses'} within "
                f"{NEAR_S:g} s of this picture",
                path=self.path,
                row=self.lines[named[~fine][0]],
                column="time_s",
                hint="record them more often, from before the first picture to after the last, "
                "by the same clock in seconds",
            )
        find = motion_at if self.joints else _flange_motion_at
        values, motion = find(rise, record, times[named])
        return replace(self._rows(named), values=values, motion=motion, written=None)

    def _rows(self, some: IntArray) -> _Poses:
        lines, pictures = ([of[i] for i in some] for of in (self.lines, self.pictures))
        return replace(
            self, values=self.values[some], lines=lines, pictures=pictures, rows=self.rows[some]
        )

    @classmethod
    def _of_program(cls, path: Path, robot: Robot | None, dialect: str | None) -> _Poses:
        if robot is None:
            # a file that cannot be read says so before it is called one of joint values
            if path.suffix.casefold() in TREES:
                read_tree(path)
            else:
                read_bytes_bounded(path, most_bytes=LARGEST_CSV_BYTES)
            raise InputError(
                f"{path} has no pose of the flange, and for joint values the robot is not known",
                hint="is it the right file? name the robot, or give poses of its flange in a table",
                name="robot",
            )
        hint = "give joint values, or poses of the flange in a table"
        from posedesign.programs.registry import read_joints  # all dialects: a tenth of a start

        postures, lines = read_joints(path, robot, dialect, hint=hint)
        return cls(path, True, postures, lines, [], rows=np.full(len(lines), -1))

    @classmethod
    def _of_people(cls, file: WrittenPoses, said: Convention | None, trust_units: bool) -> _Poses:
        poses = file.read(said, trust_units=trust_units)
        rows = np.arange(len(poses.T))
        return cls(
            file.place.path, False, poses.T, [], [], poses.notes, None, poses, rows, file.names
        )

    def of_pictures(self, paths: Sequence[Path], order: Order, notes: list[str]) -> _Poses:
        """The same, a row for each picture."""
        notes += self.notes
        if self.pictures:
            return self._by_name(paths, notes)
        if self.called:
            which = _pictures_called(self.called, paths)
            if which is not None:
                row_of, how = which
                if how:
                    notes.append(f"{self.path}: {how}")
                picked = _picked(self.values, row_of)
                return replace(self, values=picked, rows=_index(self.rows, row_of))
        if len(self.values) != len(paths):
            raise FileFormatError(
                f"has {len(self.values)} rows, and there are {len(paths)} pictures",
                path=self.path,
                hint="name the picture of each row in a column picture",
                value=len(self.values),
                bound=len(paths),
            )
        by = {"name": "names", "time": "times"}[order]
        notes.append(
            f"{self.path} does not name pictures: its rows are taken in the order of their {by}, "
            f"from {paths[0].name} in {self._stands(0)} to {paths[-1].name} in {self._stands(-1)}"
        )
        return self

    def _stands(self, k: int) -> str:
        """Where a row stands, in words."""
        if self.written is not None and not self.lines:
            return self.written.place.name(k)
        return f"line {self.lines[k]}"

    def _by_name(self, paths: Sequence[Path], notes: list[str]) -> _Poses:
        index: dict[str, list[int]] = {}
        for i, path in enumerate(paths):
            for name in {path.name.casefold(), path.stem.casefold()}:
                index.setdefault(name, []).append(i)
        exact = {path.name: [i] for i, path in enumerate(paths)}
        row_of = np.full(len(paths), -1)
        lines: dict[int, int] = {}
        lost: list[str] = []
        for k, (cell, line) in enumerate(zip(self.pictures, self.lines, strict=True)):
            name = PureWindowsPath(cell).name  # takes both slashes for what they are
            fits = exact.get(name) or index.get(name.casefold(), [])
            if not fits:
                lost.append(f"line {line} {cell[:LONGEST_SHOWN]!r}")
                continue
            if len(fits) > 1:
                raise self._fault(line, f"may be {a_few([paths[i].name for i in fits])}")
            if fits[0] in lines:
                raise self._fault(
                    line, f"gives a second pose of {name}, after line {lines[fits[0]]}"
                )
            lines[fits[0]] = line
            row_of[fits[0]] = k
        if not lines:
            raise self._fault(
                self.lines[0], f"no row names a picture that is there; the first is {paths[0].name}"
            )
        if lost:
            notes.append(f"{self.path}: there is no such picture, passed over: {a_few(lost)}")
        values = _picked(self.values, row_of)
        motion = None if self.motion is None else _picked(self.motion, row_of)
        rows = _index(self.rows, row_of)
        return replace(self, values=values, lines=[], pictures=[], motion=motion, rows=rows)

    def _fault(self, line: int, message: str) -> FileFormatError:
        return FileFormatError(
            message,
            path=self.path,
            row=line,
            column="picture",
            hint="name each picture in one row, by its file with the ending",
        )


def _flange_motion_at(
    times_s: FloatArray, T_base_flange: FloatArray, at_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """As :func:`calib.hand_eye.motion_at`, of poses ``(M, 4, 4)``: poses, and how postures move.

    Each rotation has two vectors of less than a whole turn. Of the rows about a picture those are
    taken that belong to the shorter one of the picture, which its posture is.
    """
    robot = flange_robot()
    T, motion = np.empty((len(at_s), 4, 4)), np.empty((len(at_s), 2, robot.n))
    for i, time in enumerate(at_s.tolist()):
        near = rows_near(times_s, time)
        rows = posture_of_pose(T_base_flange[near])
        about = rows[np.argmin(np.abs(times_s[near] - time))]
        for _ in range(2):  # the picture itself may be on the other side of half a turn
            q, moved = motion_at(times_s[near], _near_vectors(rows, about), np.array([time]))
            T[i], motion[i] = robot.fk(q[0]), moved[0]
            about = posture_of_pose(T[i])
    return T, motion


def _near_vectors(postures: FloatArray, about: FloatArray) -> FloatArray:
    """Postures ``(M, 6)`` with that of both rotation vectors that is nearer to a posture's."""
    out = postures.copy()
    angle = np.linalg.norm(out[:, 3:], axis=1, keepdims=True)
    other = out[:, 3:] * (1.0 - 2.0 * np.pi / np.maximum(angle, np.finfo(float).tiny))
    far, near = (np.linalg.norm(v - about[3:], axis=1) for v in (out[:, 3:], other))
    out[near < far, 3:] = other[near < far]
    return out


def _picked(rows: FloatArray, which: IntArray) -> FloatArray:
    """Rows by index; NaN where that is below zero."""
    missing = (which < 0).reshape(-1, *[1] * (rows.ndim - 1))
    return np.where(missing, np.nan, rows[which])


def _index(rows: IntArray, which: IntArray) -> IntArray:
    """Rows by index; -1 where that is below zero."""
    return np.where(which < 0, -1, rows[which]) if len(rows) else which


def _written(path: Path) -> WrittenPoses | None:
    """Poses of a folder, or of a file of keys and lists; None where it is another file."""
    if path.is_dir() or path.suffix.casefold() in STACKS:
        return read_written(path)
    if path.suffix.casefold() not in TREES:
        return None
    try:
        tree = read_tree(path)
    except FileFormatError:
        return None  # who reads programs says better what is wrong
    return written_tree(path, tree)


def _pictures_called(names: Sequence[str], paths: Sequence[Path]) -> tuple[IntArray, str] | None:
    """The pose of each picture by the names of poses, and what was taken for granted.

    By the names of the pictures, with their endings or without; else by the one number in each
    name. None where neither tells.
    """
    stems = [PureWindowsPath(name).stem.casefold() for name in names]
    if len({*stems}) < len(stems):
        return None
    index = {stem: k for k, stem in enumerate(stems)}
    row_of = np.array([index.get(path.stem.casefold(), -1) for path in paths])
    if (row_of >= 0).any():
        return row_of, ""
    found = [
        [re.findall(r"[0-9]{1,18}", name) for name in part]
        for part in (stems, [path.stem for path in paths])
    ]
    if not all(len(numbers) == 1 for part in found for numbers in part):
        return None
    of_poses, of_paths = ([int(numbers[0]) for numbers in part] for part in found)
    sets = {*of_poses}, {*of_paths}
    unique = len(sets[0]) == len(of_poses) and len(sets[1]) == len(of_paths)
    # where numbers overlap in part, one side counts from 0 and the other from 1
    if not unique or not (sets[0] <= sets[1] or sets[1] <= sets[0]):
        return None
    by_number = {number: k for k, number in enumerate(of_poses)}
    row_of = np.array([by_number.get(number, -1) for number in of_paths])
    first = int(np.flatnonzero(row_of >= 0)[0])
    how = f"poses belong to pictures by the numbers in their names, {names[row_of[first]]} to "
    return row_of, how + paths[first].name


def _pictures_of(path: Path, columns: Sequence[str], rows: Sequence[Row]) -> list[str]:
    """The picture of each row; FileFormatError where a column of another name has them."""
    for column in columns:
        if column.casefold() == "picture":
            return [row.cells[column] for row in rows]
    for column in columns:
        if rows[0].cells[column].casefold().endswith(ENDINGS):
            raise FileFormatError(
                "names pictures, and is not called picture",
                path=path,
                row=1,
                column=column,
                hint="call the column picture",
            )
    return []


def _without_copies(
    paths: Sequence[Path], heads: Sequence[PictureHead], values: FloatArray | None, notes: list[str]
) -> list[int]:
    """Which pictures to keep, each once; FileFormatError where one is there at two poses."""
    bare = np.full(len(paths), False)
    if values is not None:
        bare = np.asarray(np.isnan(values).reshape(len(paths), -1).any(axis=1))
    first: dict[str, int] = {}
    for i in sorted(range(len(paths)), key=lambda i: bool(bare[i])):  # those with a pose first
        k = first.setdefault(heads[i].digest, i)
        if k == i:
            continue
        if values is not None and not bare[i] and not np.array_equal(values[i], values[k]):
            raise FileFormatError(
                f"is the same file as {paths[k].name}, byte for byte, at another pose of the arm",
                path=paths[i],
                hint="did the camera stand still? take out those whose pose is not theirs",
            )
        notes.append(
            f"{paths[i].name} is left out: the same file as {paths[k].name}, byte for byte"
        )
    return sorted(first.values())
