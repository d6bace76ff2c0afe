"""Streams of poses with times: tables with a column of time, and TUM's trajectories."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np

from calib.errors import FileFormatError
from calib.robot_world import PoseStream
from calib.se3 import inverse
from posedesign.files.csv_tables import is_number, number_of
from posedesign.hand_eye.conventions import Convention
from posedesign.hand_eye.pairs.file import expanded, read_numbers, read_side

TIMES = {
    "time_s": 1.0,
    "t_s": 1.0,
    "stamp_s": 1.0,
    "timestamp": 1.0,
    "time": 1.0,
    "t": 1.0,
    "time_ms": 1e-3,
    "time_us": 1e-6,
    "time_ns": 1e-9,
    "stamp_ns": 1e-9,
}
"""Columns of time, and their units in seconds."""

TUM_COLUMNS = ("timestamp", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
"""Numbers of a line of a trajectory of TUM's RGB-D benchmark, between blanks."""


def read_stream(
    path: Path,
    side: Literal["a", "b"],
    columns: Sequence[str] = (),
    *,
    inverted: bool = False,
    trust_units: bool = False,
    said: Convention | None = None,
) -> PoseStream:
    """Read the poses of an arm (a) or of a camera (b) with their times.

    Parameters
    ----------
    columns : sequence of str
        Names of the columns of a table without a header line. Eight numbers a line without any are
        those of TUM.
    inverted : bool
        Whether the file has the poses the other way round.

    Raises
    ------
    FileFormatError
        The file has no column of time, or cannot be read.
    """
    named = list(columns)
    if not named and _is_tum(path):
        named = list(TUM_COLUMNS)
    table = read_numbers(path, expanded(named))
    column = next((name for name in TIMES if name in table.columns), None)
    if column is None:
        raise FileFormatError(
            "has no column of time",
            path=path,
            row=1,
            hint="name it time_s, or time_ns; lines of TUM have eight numbers: time, x y z, qx qy "
            "qz qw",
        )
    # not bounded as other numbers are: nanoseconds since 1970 are above 1e18
    cells = [row.cells[column].strip().replace(",", ".") for row in table.rows]
    times = np.array([float(cell) if is_number(cell) else np.nan for cell in cells])
    bad = np.flatnonzero(~np.isfinite(times))
    if len(bad):
        raise FileFormatError(
            "is no time", path=path, row=table.rows[int(bad[0])].line, column=column
        )
    T = read_side(path, side, named, trust_units=trust_units, said=said).T
    return PoseStream.of(TIMES[column] * times, inverse(T) if inverted else T, path.name)


def _is_tum(path: Path) -> bool:
    """Return True if the first line that is no comment has eight numbers and nothing else."""
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            for _ in range(100):
                line = file.readline(_LONGEST)
                if not line:
                    return False
                if line.strip() and not line.startswith("#"):
                    cells = line.split()
                    return len(cells) == len(TUM_COLUMNS) and all(
                        np.isfinite(number_of(cell)) for cell in cells
                    )
    except OSError:
        return False
    return False


_LONGEST = 2000
"""Characters of a line that are looked at."""
