"""What a calibration did and saw, for people: a log, and the pictures.

Nothing is read from here again but how far the log has come: what a calibration goes on from is its
journal. The log has a row for each command, each posture shown, each look, and each decision; a
picture is named after its pose and its round, the number of the look there.
"""

from __future__ import annotations

import csv
import io
import os
import re
import shutil
from collections.abc import Callable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from typing import Any

import cv2
import numpy as np

from calib.errors import CalibError, FileFormatError, OutputError
from calib.se3 import FloatArray, IntArray
from calib.vision.camera import Views
from calib.vision.camera.rendering import GreyImage
from calib.vision.touch_up import Arms
from posedesign.autonomous.journal import open_no_link
from posedesign.files import Claim, make_folder, not_written, read_bytes_bounded

LOG = ("log.csv", "log")
PICTURES = "pictures"
"""Folder of the pictures, beside the log."""

USUAL_MB = 1000.0
"""That pictures may take: some hundreds of 1280 x 1024 take 300."""

MOST_LOG_BYTES = 50_000_000
"""A row takes 150: a hundred thousand moves are no calibration of a robot."""

_LEFT_FREE_BYTES = 500_000_000
"""Of the disk, for the journal and the results."""

_MAKE_ROOM = "make room, then start the same command again"

_PNG = [cv2.IMWRITE_PNG_COMPRESSION, 1]


class Record:
    """Log and pictures of one calibration, appended to; nothing in them is ever replaced.

    ``log``: the file; made where it does not exist. ``n``: number of joints. ``keep_mb``: that all
    pictures may take, those of before included; 0 for none. ``say``: told when pictures are kept no
    longer. Raises FileFormatError: what is there is no such log. OutputError: it cannot be written,
    or it or the folder of the pictures is a link.
    """

    def __init__(
        self, log: Claim, n: int, keep_mb: float, say: Callable[[str], None] = lambda text: None
    ) -> None:
        self.path, self.folder = log.path, log.path.with_name(PICTURES)
        self._columns = ["time_utc", "pose", "round", "event", *(f"j{k + 1}_deg" for k in range(n))]
        self._columns += ["right_px", "down_px", "size_px", "picture", "said"]
        self._say, self._most, self._used = say, keep_mb * 1e6, 0
        self._pose = ""
        for place in (self.path, self.folder):
            if place.is_symlink():
                raise OutputError(
                    f"{place} is a link", hint="choose another output folder", name=str(place)
                )
        self._is_empty = not self.path.exists()
        if self._is_empty:
            log.write(self._line(self._columns))
        self._rounds: dict[str, int] = self._rounds_before()
        try:
            self._stream = open(  # noqa: SIM115 -- closed by __exit__
                self.path, "ab", buffering=0, opener=open_no_link
            )
        except OSError as error:
            raise not_written(self.path, error, _MAKE_ROOM) from error
        if self._most > 0.0:
            make_folder(self.folder)
            self._used = sum(entry.stat().st_size for entry in os.scandir(self.folder))

    def __enter__(self) -> Record:
        return self

    def __exit__(self, *error: object) -> None:
        self._stream.close()
        if self._is_empty:  # refused before the arm did anything: there is nothing to tell
            self.path.unlink(missing_ok=True)
            with suppress(OSError):
                self.folder.rmdir()

    def begin(self, pose: str) -> None:
        """What follows is of a pose; its rounds count on from those of before."""
        self._pose = pose

    def ended(self, answer: Mapping[str, Any]) -> None:
        """What was decided of the pose, as the journal has it."""
        reasons = [answer.get("reason"), *answer.get("reasons", [])]
        why = "; ".join(text for text in reasons if text)
        if "moves" in answer:
            corrections = int(answer["moves"][0])
            said = f"{answer['status'][0]} after {corrections} correction" + "s" * (
                corrections != 1
            )
        elif "matrix" in answer:
            said = "no Jacobian" if why else "Jacobian measured"
        else:
            said = "not seen" if why else "seen"
        self.row("decided", said=": ".join(text for text in (said, why) if text))

    def row(
        self,
        event: str,
        joints: FloatArray | None = None,
        vhs: FloatArray | None = None,
        picture: str = "",
        said: str = "",
    ) -> None:
        """Append a row at once; joints ``(n,)`` in radians, V, H and s ``(3,)`` in pixels.

        Raises OutputError: the log cannot be written.
        """
        n = len(self._columns) - 9
        degrees = [""] * n
        if joints is not None and joints.shape == (n,):
            degrees = [f"{v:.4f}" for v in np.rad2deg(joints).tolist()]
        seen = [""] * 3
        if vhs is not None and np.isfinite(vhs).all():
            down, right, size = vhs.tolist()
            seen = [f"{v:.3f}" for v in (right, down, size)]
        now = datetime.now(UTC).isoformat(timespec="milliseconds").removesuffix("+00:00")
        number = self._rounds.get(self._pose, 0) + (event in ("command", "shown"))
        line = self._line([now, self._pose, number, event, *degrees, *seen, picture, said])
        try:
            if os.fstat(self._stream.fileno()).st_size + len(line) <= MOST_LOG_BYTES:
                self._stream.write(line)
                self._is_empty = False
        except OSError as error:
            raise not_written(self.path, error, _MAKE_ROOM) from error

    def looked(self, joints: FloatArray, seen: Views, image: GreyImage | None) -> None:
        """A look of the arm ``(n,)`` [rad] that stands at the pose: a round more."""
        self._rounds[self._pose] = self._rounds.get(self._pose, 0) + 1
        picture = "" if image is None else self._keep(image)
        self.row("look", joints, seen.vhs_px[0], picture, seen.reasons[0])

    def _keep(self, image: GreyImage) -> str:
        """Name of the picture that was kept; empty where there is no room for it."""
        if self._most <= 0.0:
            return ""
        done, data = cv2.imencode(".png", image, _PNG)
        stem = re.sub(r"[^\w.-]+", "_", self._pose)
        name = f"{stem}_{self._rounds[self._pose]:02d}.png"
        path, aside = self.folder / name, self.folder / f".{name}.part"
        try:
            if self._used + len(data) > self._most:
                return self._kept_no_longer(f"they take {self._most / 1e6:g} MB, as allowed")
            if shutil.disk_usage(self.folder).free < _LEFT_FREE_BYTES + len(data):
                return self._kept_no_longer("the disk is nearly full")
            if not done or os.path.lexists(path):
                return ""
            aside.write_bytes(data.tobytes())
            aside.rename(path)
        except OSError as error:
            with suppress(OSError):
                aside.unlink(missing_ok=True)
            return self._kept_no_longer(error.strerror or str(error))
        self._used += len(data)
        return name

    def _kept_no_longer(self, why: str) -> str:
        self._most = 0.0
        self._say(f"pictures are kept no longer, from {self._pose} on: {why}")
        return ""

    def _rounds_before(self) -> dict[str, int]:
        """Rounds of each pose in the log that is there; what a stop has cut off counts, too."""
        text = read_bytes_bounded(self.path, most_bytes=2 * MOST_LOG_BYTES).decode(errors="replace")
        lines = (line for line in text.splitlines() if not line.startswith("#"))
        rows = csv.reader(lines)
        if next(rows, []) != self._columns:
            raise FileFormatError(
                "is no log of a calibration of this robot",
                path=self.path,
                hint="choose another output folder",
            )
        rounds: dict[str, int] = {}
        for row in rows:
            if len(row) > 2 and row[2].isdecimal() and len(row[2]) < 6:
                rounds[row[1]] = max(rounds.get(row[1], 0), int(row[2]))
        if text and not text.endswith("\n"):
            with open(self.path, "ab", opener=open_no_link) as stream:
                stream.write(b"\n")
        return rounds

    @staticmethod
    def _line(cells: list[Any]) -> bytes:
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerow(cells)
        return text.getvalue().encode()


class RecordedArms:
    """Arms of one whose moves and looks are recorded; else as they are.

    ``arms``: of one arm.
    """

    def __init__(self, arms: Arms, record: Record) -> None:
        self._arms, self.record = arms, record
        self._sent = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._arms, name)

    def move(self, which: IntArray, q: FloatArray) -> None:
        """See :meth:`Arms.move`."""
        self.record.row("command", q[0])
        self._sent = True
        try:
            self._arms.move(which, q)
        except CalibError as error:
            self.record.row("stopped", said=error.message)
            raise

    def joints(self, which: IntArray) -> FloatArray:
        """See :meth:`Arms.joints`."""
        shown = self._arms.joints(which)
        if self._sent:
            self._sent = False
            self.record.row("shown", shown[0])
        return shown

    def look(self, which: IntArray, near_px: FloatArray | None = None) -> Views:
        """See :meth:`Arms.look`."""
        seen = self._arms.look(which, near_px)
        self.record.looked(self._arms.joints(which)[0], seen, getattr(self._arms, "seen", None))
        return seen
