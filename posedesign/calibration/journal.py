"""Measurements kept as they are made: a calibration that is stopped goes on where it was.

One line of JSON a measurement, pushed to the disk before the next one begins. A process that asks
for the same measurements in the same order is run again from the start and finds its answers here,
up to the one it was stopped at. A line that was cut off when the machine went down is dropped, and
what failed at the end is tried again: somebody may have brought the target into view since.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, get_args
from zlib import crc32

import numpy as np

from calib.camera.lens import Camera
from calib.camera.observers import Views
from calib.camera.target import CircleTarget
from calib.errors import FileFormatError, InputError, OutputError
from calib.se3 import FloatArray
from calib.visual.drive import Drive
from calib.visual.jacobian import ImageJacobian, MeasuredJacobian
from calib.visual.relation import Relation
from calib.visual.servo import Bias, Loop, Status, TouchUps
from calib.visual.station import Station
from posedesign.files import json_text, read_bytes_bounded

try:
    import fcntl
except ImportError:  # not on Windows, where nothing keeps two commands apart
    fcntl = None  # type: ignore[assignment]

MOST_BYTES = 50_000_000
"""A touch-up takes half a kilobyte: a hundred thousand of them are no calibration of a robot."""

_VERSION = 1
_STATUS: tuple[Status, ...] = get_args(Status)
_SAME_RAD = 1e-9
"""Joint values asked for that differ by less are the same: they come out of the same arithmetic."""


class Journal:
    """A file of named measurements, each with what was asked.

    Parameters
    ----------
    path : Path
        Made where it does not exist.
    about : str
        What the measurements are of: a digest of cell and robot.

    Raises
    ------
    FileFormatError
        The file is of another calibration, or no journal.
    """

    def __init__(self, path: Path, about: str) -> None:
        self.path = path
        self._about = about
        self._kept: dict[str, dict[str, Any]] = {}
        self._stream = self._opened()
        try:
            lines = self._read()
            if lines:
                self._check_head(lines[0])
                while len(lines) > 1 and _failed(lines[-1]):
                    lines.pop()  # what it was stopped by, and may be mended now
                for entry in lines[1:]:
                    self._kept[str(entry.get("name"))] = entry
            else:
                self._append({"posedesign": "calibration", "version": _VERSION, "about": about})
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
        self, name: str, asked: FloatArray, measure: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        """The answer kept under a name, or that of measuring now, which is kept.

        Raises
        ------
        InputError
            Something else was asked for under this name.
        """
        if name in self._kept:
            entry = self._kept[name]
            before = np.asarray(entry.get("asked"), dtype=float)
            if before.shape != asked.shape or not np.allclose(
                before, asked, rtol=0, atol=_SAME_RAD
            ):
                raise InputError(
                    f"{self.path}: {name} was measured at another posture than it is asked for now",
                    hint="go on with the cell and the options that it was begun with, or --restart",
                    name=name,
                )
            return dict(entry["answer"])
        # as it will be read, so that it is the same whether it was measured now or before
        entry = {"name": name, "asked": asked, "answer": measure()}
        self._kept[name] = self._append(entry)
        return dict(self._kept[name]["answer"])

    @contextmanager
    def reading(self) -> Iterator[None]:
        """Turn what a damaged answer leads to into an error of the file."""
        try:
            yield
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise FileFormatError(
                "has a measurement that cannot be read", path=self.path, hint="--restart"
            ) from error

    def _opened(self) -> IO[bytes]:
        """The file, held until it is closed: two that write into it would lose touch-ups."""
        try:
            stream = open(self.path, "ab")  # noqa: SIM115 -- closed by __exit__
        except OSError as error:
            raise OutputError(
                f"{self.path}: cannot be written: {error.strerror}",
                hint="choose another --out",
                name=str(self.path),
            ) from error
        if fcntl is not None:
            try:
                fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                stream.close()
                raise InputError(
                    f"{self.path}: another calibration is writing it",
                    hint="wait for it, or choose another --out",
                    name=str(self.path),
                ) from error
        return stream

    def _append(self, entry: dict[str, Any]) -> dict[str, Any]:
        written: dict[str, Any] = json.loads(json_text(entry))
        line = json.dumps(written) + "\n"
        try:
            self._stream.write(line.encode())
            self._stream.flush()
            os.fsync(self._stream.fileno())
        except OSError as error:
            raise OutputError(
                f"{self.path}: cannot be written: {error.strerror}",
                hint="make room, then start the same command again",
                name=str(self.path),
            ) from error
        return written

    def _read(self) -> list[dict[str, Any]]:
        data = read_bytes_bounded(self.path, most_bytes=MOST_BYTES)
        whole, _, cut = data.rpartition(b"\n")
        found = []
        for number, line in enumerate(whole.split(b"\n"), start=1):
            if not line:
                continue
            try:
                entry = json.loads(line)
            except (ValueError, RecursionError):
                entry = None
            if not isinstance(entry, dict):
                raise FileFormatError(
                    "is no journal of a calibration",
                    path=self.path,
                    row=number,
                    hint="choose another --out, or --restart",
                )
            found.append(entry)
        if cut:  # the machine went down while it was written
            self._stream.truncate(len(data) - len(cut))
        return found

    def _check_head(self, head: dict[str, Any]) -> None:
        if head.get("posedesign") != "calibration" or head.get("version") != _VERSION:
            raise FileFormatError(
                "is no journal of a calibration", path=self.path, hint="choose another --out"
            )
        if head.get("about") != self._about:
            raise FileFormatError(
                "was begun with another cell, robot or options",
                path=self.path,
                hint="choose another --out, or --restart",
            )


class KeptStation(Station):
    """A station whose measurements are kept in a journal and never made twice.

    Parameters
    ----------
    drive : Drive
    journal : Journal
    seed : int
        Simulated arms draw the noise of each measurement from this and its name, so that a
        calibration comes out the same whether it was stopped or not.
    """

    def __init__(self, drive: Drive, journal: Journal, seed: int = 0) -> None:
        super().__init__(drive)
        self._journal = journal
        self._seed = seed
        self._image_px: tuple[int, int] | None = None
        self._passing: list[tuple[str, FloatArray]] = []
        self._has_moved = False

    @property
    def image_px(self) -> tuple[int, int]:
        """See :attr:`Station.image_px`."""
        return super().image_px if self._image_px is None else self._image_px

    def look(self, name: str, q: FloatArray) -> Views:
        """See :meth:`Station.look`."""

        def measure() -> dict[str, Any]:
            self._prepare(name)
            seen = super(KeptStation, self).look(name, q)
            return {
                "ellipses": seen.ellipses,
                "reasons": list(seen.reasons),
                "image_px": super(KeptStation, self).image_px,
            }

        with self._journal.reading():
            answer = self._recall(name, q, measure)
            width, height = (int(v) for v in answer["image_px"])
            self._image_px = (width, height)
            return Views(_array(answer["ellipses"], (1, 5)), _texts(answer["reasons"]))

    def jacobian(
        self, name: str, q: FloatArray, relation: Relation, step_m: float, *, both_ways: bool
    ) -> MeasuredJacobian:
        """See :meth:`Station.jacobian`."""

        def measure() -> dict[str, Any]:
            self._prepare(name)
            found = super(KeptStation, self).jacobian(
                name, q, relation, step_m, both_ways=both_ways
            )
            matrix = None if found.jacobian is None else found.jacobian.matrix
            return {"matrix": matrix, "reason": found.reason, "status": found.status}

        asked = np.array([*q, *relation.center_px, relation.size_px, step_m])
        with self._journal.reading():
            answer = self._recall(name, asked, measure)
            jacobian = None
            if answer["matrix"] is not None:
                jacobian = ImageJacobian(_array(answer["matrix"], (3, 3)), relation)
            return MeasuredJacobian(jacobian, str(answer["reason"]), str(answer["status"]))

    def touch_up(
        self,
        name: str,
        q: FloatArray,
        jacobian: ImageJacobian,
        loop: Loop,
        bias: Bias | None = None,
    ) -> TouchUps:
        """See :meth:`Station.touch_up`."""

        def measure() -> dict[str, Any]:
            self._prepare(name)
            done = super(KeptStation, self).touch_up(name, q, jacobian, loop, bias)
            return {
                "q": done.q,
                "error_px": done.error_px,
                "ellipses": done.ellipses,
                "moves": done.moves,
                "status": list(done.status),
                "reasons": list(done.reasons),
            }

        with self._journal.reading():
            answer = self._recall(name, q, measure)
            return TouchUps(
                _array(answer["q"], (1, len(q))),
                _array(answer["error_px"], (1, 3)),
                _array(answer["ellipses"], (1, 5)),
                np.array(answer["moves"], dtype=np.intp),
                tuple(_STATUS[_STATUS.index(status)] for status in answer["status"]),
                _texts(answer["reasons"]),
            )

    def target_pose(
        self, name: str, camera: Camera, target: CircleTarget, about: FloatArray
    ) -> FloatArray | None:
        """See :meth:`Station.target_pose`; where the arm stands after what was measured last."""

        def measure() -> dict[str, Any]:
            if not self._has_moved:
                return {"T": None}  # stopped between the touch-up and this: the arm may be anywhere
            return {"T": super(KeptStation, self).target_pose(name, camera, target, about)}

        with self._journal.reading():
            answer = self._journal.recall(name, np.zeros(0), measure)
            return None if answer["T"] is None else _array(answer["T"], (4, 4))

    def pass_through(self, name: str, q: FloatArray) -> None:
        """See :meth:`Station.pass_through`: kept until something is measured after it.

        What lies before a measurement that was made already is not gone through again.
        """
        self._passing.append((name, q))

    def rest(self) -> None:
        """See :meth:`Station.rest`."""
        if self._has_moved:
            self._pass()

    def _pass(self) -> None:
        for name, q in self._passing:
            super().pass_through(name, q)
        self._passing.clear()

    def _recall(
        self, name: str, asked: FloatArray, measure: Callable[[], dict[str, Any]]
    ) -> dict[str, Any]:
        answer = self._journal.recall(name, asked, measure)
        self._passing.clear()
        return answer

    def _prepare(self, name: str) -> None:
        self._has_moved = True
        self._pass()
        reseed = getattr(self.drive.arms, "reseed", None)
        if reseed is not None:
            reseed(np.random.default_rng([self._seed, crc32(name.encode())]))


def _failed(entry: dict[str, Any]) -> bool:
    """Whether an entry is of a measurement that saw nothing, or did not arrive."""
    answer = entry.get("answer")
    if not isinstance(answer, dict):
        return False
    reasons = answer.get("reasons")
    return bool(answer.get("reason")) or (isinstance(reasons, list) and any(reasons))


def _array(value: object, shape: tuple[int, ...]) -> FloatArray:
    """Numbers as an array; what JSON has as null was no number."""
    return np.array(value, dtype=float).reshape(shape)


def _texts(value: object) -> tuple[str, ...]:
    return tuple(str(text) for text in np.atleast_1d(np.array(value, dtype=object)))
