"""Measurements kept as they are made: a calibration that is stopped goes on where it was.

One line of JSON a measurement, pushed to the disk before the next one begins. A process that asks
for the same measurements in the same order is run again from the start and finds its answers here,
up to the one it was stopped at. A line that was cut off when the machine went down is dropped, and
what failed at the end is tried again: somebody may have brought the target into view since.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, TypeVar, get_args
from zlib import crc32

import numpy as np

from calib.errors import FileFormatError, InputError, OutputError
from calib.se3 import FloatArray
from calib.vision.camera import Camera, Views
from calib.vision.camera.observers import Target
from calib.vision.touch_up import Drive, ImageJacobian, Loop, Relation, Station, TouchUps
from calib.vision.touch_up.jacobian import MeasuredJacobian
from calib.vision.touch_up.servo import Bias, Status
from posedesign.files import identity_of, json_text, load_json, not_written, read_bytes_bounded

MOST_BYTES = 50_000_000
"""A touch-up takes half a kilobyte: a hundred thousand of them are no calibration of a robot."""

_VERSION = 2
_HEAD = b'{"posedesign": "calibration"'
"""How the first line begins."""

_SAME_RAD = 1e-9
"""Joint values asked for that differ by less are the same: they come out of the same arithmetic."""

T = TypeVar("T")


class Journal:
    """A file of named measurements, each with what was asked.

    One process may have it open at a time; see :func:`~posedesign.files.locking.held`.

    ``path``: made where it does not exist. ``about``: what the measurements are of, each under a
    word for it: robot, description, cell. Where the journal has another one under a word, it is
    named. Raises FileFormatError: the file is of another calibration, of another version, damaged,
    or no journal; it is left as it is. OutputError: it cannot be written, or is a link.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self._kept: dict[str, dict[str, Any]] = {}
        lines, length = self._read()
        if lines:
            self._check_head(lines[0], about)
        while len(lines) > 1 and _failed(lines[-1]):
            lines.pop()  # what it was stopped by, and may be mended now
        for entry in lines[1:]:
            self._kept[str(entry.get("name"))] = entry
        try:
            # no buffer: what could not be written must not be tried again when it is closed
            self._stream = open(path, "ab", buffering=0, opener=open_no_link)  # noqa: SIM115 -- closed by __exit__
            self._stream.truncate(length)  # a line was cut off when the machine went down
        except OSError as error:
            raise not_written(path, error, "choose another `out`") from error
        self._length = length
        self._folder = identity_of(path.parent)
        if not lines:
            head = {"posedesign": "calibration", "version": _VERSION, "about": dict(about)}
            try:
                self._append(head)
            except BaseException:
                self._stream.close()
                raise

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.close()

    def __len__(self) -> int:
        return len(self._kept)

    def recall(
        self,
        name: str,
        asked: FloatArray,
        measure: Callable[[], Mapping[str, Any]],
        read: Callable[[dict[str, Any]], T],
    ) -> T:
        """The answer kept under a name, or that of measuring now, which is kept.

        ``asked`` (k,): what is asked for, joint values first [rad]. ``measure``: makes the
        measurement; what it raises comes out as it is. ``read``: what an answer says; a KeyError,
        TypeError, ValueError or IndexError of it means that the answer is damaged. Raises
        InputError: something else was asked for under this name. FileFormatError: the answer cannot
        be read. OutputError: the answer cannot be written.
        """
        if name not in self._kept:
            self.check_place()  # before an arm moves for what could not be kept
            # as it will be read, so that it is the same whether it was measured now or before
            self._kept[name] = self._append({"name": name, "asked": asked, "answer": measure()})
        entry = self._kept[name]
        try:
            before = np.asarray(entry["asked"], dtype=float)
            same = before.shape == asked.shape and np.allclose(
                before, asked, rtol=0, atol=_SAME_RAD
            )
            if same:
                return read(dict(entry["answer"]))
        except (KeyError, TypeError, ValueError, IndexError, OverflowError) as error:
            raise FileFormatError(
                f"the measurement {name} cannot be read",
                path=self.path,
                hint="remove its line and all after it to measure from there on, or `restart`",
            ) from error
        raise InputError(
            f"{self.path}: {name} was measured at another posture than it is asked for now",
            hint="go on with the cell and the options that it was begun with, or `restart`",
            name=name,
        )

    def check_place(self) -> None:
        """Refuse to go on where the file, or the folder that it is in, is no longer the same.

        Raises OutputError: it was removed, or replaced by another one or by a link: what is
        measured would be lost.
        """
        own = os.fstat(self._stream.fileno())
        same = (
            not self.path.is_symlink()
            and identity_of(self.path) == (own.st_dev, own.st_ino)
            and identity_of(self.path.parent) == self._folder
        )
        if not same:
            raise OutputError(
                f"{self.path} was removed or replaced while it was written",
                hint="put its folder back, and start the same command again",
                name=str(self.path),
            )

    def _append(self, entry: dict[str, Any]) -> dict[str, Any]:
        written: dict[str, Any] = json.loads(json_text(entry))
        line = json.dumps(written).encode() + b"\n"
        self.check_place()
        left = line
        try:
            while left:
                left = left[self._stream.write(left) :]
            os.fsync(self._stream.fileno())
        except OSError as error:
            with suppress(OSError):  # the part of a line: whoever reads it drops it as well
                self._stream.truncate(self._length)
            raise not_written(
                self.path, error, "make room, then start the same command again"
            ) from error
        self._length += len(line)
        return written

    def _read(self) -> tuple[list[dict[str, Any]], int]:
        """Whole lines, and how many bytes they take."""
        if not self.path.exists():
            return [], 0
        data = read_bytes_bounded(self.path, most_bytes=MOST_BYTES)
        *whole, cut = data.split(b"\n")
        if not whole and not cut.startswith(_HEAD[: len(cut)]):
            raise self._no_journal()
        lines = [self._entry(number, line) for number, line in enumerate(whole, start=1) if line]
        return lines, len(data) - len(cut)

    def _entry(self, number: int, line: bytes) -> dict[str, Any]:
        try:
            entry = load_json(line)
        except ValueError:
            entry = None
        if isinstance(entry, dict):
            return entry
        if number == 1:
            raise self._no_journal()
        raise FileFormatError(
            "is damaged",
            path=self.path,
            row=number,
            hint="remove this line and all after it to measure from there on, or `restart`",
        )

    def _check_head(self, head: dict[str, Any], about: Mapping[str, str]) -> None:
        if head.get("posedesign") != "calibration":
            raise self._no_journal()
        if head.get("version") != _VERSION:
            raise FileFormatError(
                f"is a journal of version {head.get('version')!r:.20}, this program has {_VERSION}",
                path=self.path,
                hint="go on with the program that it was begun with, or choose another `out`",
            )
        begun = head.get("about")
        for what, own in about.items():
            other = begun.get(what) if isinstance(begun, dict) else None
            if other != own:
                shown, wanted = "", f"the {what} that there is now"
                if what == "robot":
                    shown, wanted = f" ({other!s:.200})", own
                raise FileFormatError(
                    f"was begun with another {what}{shown}, not with {wanted}",
                    path=self.path,
                    hint="choose another `out`, or `restart`",
                    value=other,
                    bound=own,
                )

    def _no_journal(self) -> FileFormatError:
        return FileFormatError(
            "is no journal of a calibration", path=self.path, hint="choose another `out`"
        )


def open_no_link(path: str, flags: int) -> int:
    """Open a file for writing, and no link: what stands behind it is somebody else's."""
    return os.open(path, flags | getattr(os, "O_NOFOLLOW", 0), 0o666)


def _failed(entry: dict[str, Any]) -> bool:
    """Whether an entry is of a measurement that saw nothing, or did not arrive."""
    answer = entry.get("answer")
    if not isinstance(answer, dict):
        return False
    reasons = answer.get("reasons")
    return bool(answer.get("reason")) or (isinstance(reasons, list) and any(reasons))


_STATUS: tuple[Status, ...] = get_args(Status)

_ONLY = np.zeros(1, dtype=np.intp)


class KeptStation(Station):
    """A station whose measurements are kept in a journal and never made twice.

    ``seed``: simulated arms draw the noise of each measurement from this and its name, so that a
    calibration comes out the same whether it was stopped or not.
    """

    def __init__(self, drive: Drive, journal: Journal, seed: int = 0) -> None:
        super().__init__(drive)
        self._journal = journal
        self._seed = seed
        self._image_px: tuple[int, int] | None = None
        self._passing: list[tuple[str, FloatArray]] = []
        self._has_moved = False
        self._left: FloatArray | None = None

    @property
    def image_px(self) -> tuple[int, int]:
        """See :attr:`Station.image_px`."""
        return super().image_px if self._image_px is None else self._image_px

    def look(self, name: str, q: FloatArray) -> Views:
        def measure() -> dict[str, Any]:
            seen = Station.look(self, name, q)
            # of an arm that was not moved there is no picture
            size = None if any(seen.reasons) else Station(self.drive).image_px
            return vars(seen) | {"image_px": size}

        def read(answer: dict[str, Any]) -> Views:
            if answer["image_px"] is not None:
                width, height = (int(v) for v in answer["image_px"])
                self._image_px = (width, height)
            return Views(_array(answer["ellipses"], (1, 5)), _texts(answer["reasons"]))

        return self._recall(name, q, measure, read)

    def jacobian(
        self, name: str, q: FloatArray, relation: Relation, step_m: float, *, both_ways: bool
    ) -> MeasuredJacobian:
        def measure() -> dict[str, Any]:
            found = Station.jacobian(self, name, q, relation, step_m, both_ways=both_ways)
            matrix = None if found.jacobian is None else found.jacobian.matrix
            return {"matrix": matrix, "reason": found.reason, "status": found.status}

        def read(answer: dict[str, Any]) -> MeasuredJacobian:
            matrix, jacobian = answer["matrix"], None
            if matrix is not None:
                jacobian = ImageJacobian(_array(matrix, (3, 3), finite=True), relation)
            return MeasuredJacobian(jacobian, str(answer["reason"]), str(answer["status"]))

        asked = np.array([*q, *relation.center_px, relation.size_px, step_m])
        return self._recall(name, asked, measure, read)

    def touch_up(
        self,
        name: str,
        q: FloatArray,
        jacobian: ImageJacobian,
        loop: Loop,
        bias: Bias | None = None,
    ) -> TouchUps:
        def measure() -> dict[str, Any]:
            return vars(Station.touch_up(self, name, q, jacobian, loop, bias))

        def read(answer: dict[str, Any]) -> TouchUps:
            (status,) = answer["status"]
            joints, within = _array(answer["q"], (1, len(q))), self.drive.shown_within_rad
            low, high = self.drive.robot.lower - within, self.drive.robot.upper + within
            if status == "touched" and not ((joints >= low) & (joints <= high)).all():
                raise ValueError("outside the joint limits")
            return TouchUps(
                joints,
                _array(answer["error_px"], (1, 3)),
                _array(answer["ellipses"], (1, 5)),
                np.array(answer["moves"], dtype=np.intp),
                (_STATUS[_STATUS.index(status)],),
                _texts(answer["reasons"]),
            )

        return self._recall(name, q, measure, read)

    def target_pose(
        self, name: str, camera: Camera, target: Target, about: FloatArray
    ) -> FloatArray | None:
        """See :meth:`Station.target_pose`; where the arm stands after what was measured last."""

        def measure() -> dict[str, Any]:
            if not self._has_moved:
                return {"T": None}  # stopped between the touch-up and this: the arm may be anywhere
            return {"T": Station.target_pose(self, name, camera, target, about)}

        def read(answer: dict[str, Any]) -> FloatArray | None:
            return None if answer["T"] is None else _array(answer["T"], (4, 4), finite=True)

        return self._journal.recall(name, np.zeros(0), measure, read)

    def pass_through(self, name: str, q: FloatArray) -> None:
        """See :meth:`Station.pass_through`: kept until something is measured after it.

        What lies before a measurement that was made already is not gone through again.
        """
        self._passing.append((name, q))

    def rest(self) -> None:
        if self._has_moved:
            self._pass()

    def _pass(self) -> None:
        for name, q in self._passing:
            super().pass_through(name, q)
        self._passing.clear()

    def _recall(
        self,
        name: str,
        asked: FloatArray,
        measure: Callable[[], dict[str, Any]],
        read: Callable[[dict[str, Any]], T],
    ) -> T:
        """A measurement that the arm moves for, if it was not made before."""

        def move_and_measure() -> dict[str, Any]:
            self._prepare(name)
            record = getattr(self.drive.arms, "record", None)
            if record is None:
                return measure()
            record.begin(name)
            answer = measure()
            record.ended(answer)
            return answer

        answer = self._journal.recall(name, asked, move_and_measure, read)
        self._left = answer.q[0] if isinstance(answer, TouchUps) else asked[: self.drive.robot.n]
        self._passing.clear()
        return answer

    def _prepare(self, name: str) -> None:
        if not self._has_moved and self._left is not None and np.isfinite(self._left).all():
            self.drive.was_left_at(_ONLY, self._left[None])
            stand = getattr(self.drive.arms, "stand", None)
            if stand is not None:
                stand(_ONLY, self._left[None])
        self._has_moved = True
        self._pass()
        reseed = getattr(self.drive.arms, "reseed", None)
        if reseed is not None:
            reseed(np.random.default_rng([self._seed, crc32(name.encode())]))


def _array(value: object, shape: tuple[int, ...], *, finite: bool = False) -> FloatArray:
    """Numbers as an array; what JSON has as null was no number."""
    found = np.array(value, dtype=float).reshape(shape)
    if finite and not np.isfinite(found).all():
        raise ValueError("not a finite number")
    return found


def _texts(value: object) -> tuple[str, ...]:
    return tuple(str(text) for text in np.atleast_1d(np.array(value, dtype=object)))
