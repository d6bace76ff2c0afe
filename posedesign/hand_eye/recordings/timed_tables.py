"""Tables whose rows belong to pictures of a video by their time or their number."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.errors import FileFormatError
from calib.se3 import FloatArray
from posedesign.files.csv_tables import Row, Table, number_of, numbers_of, read_table
from posedesign.hand_eye.recordings.stills import StandStill, nearest

_SLACK_S = 0.25
"""A row of a table belongs to a stand-still that it is no further away from in time."""

_AGREE = 0.01
"""Cells of rows of one stand-still differ by less than this part of their range in the table."""


_NO_ROW = "no row of the table is of it"
_MOVES = "the arm moves by the table meanwhile"


@dataclass(frozen=True, eq=False)
class TimedTable:
    """A table whose rows are of times or pictures of a video."""

    path: Path
    table: Table
    column: str  # time_s or frame
    values: FloatArray  # (R,): of the column
    numbers: FloatArray  # (R, c): cells of the columns that have nothing but numbers

    @classmethod
    def read(cls, path: Path) -> TimedTable | None:
        """Read it; None where it has neither column, or names pictures."""
        if not path.is_file() or path.suffix.casefold() not in (".csv", ".txt", ".tsv", ".dat"):
            return None
        try:
            table = read_table(path, loose=True)
        except FileFormatError:
            return None  # who reads poses says better what is wrong
        column = next((name for name in ("time_s", "frame") if name in table.columns), None)
        if column is None or "picture" in table.columns:
            return None
        values = numbers_of(path, table.rows, [column])[:, 0]
        cells = np.array(
            [[number_of(row.cells[name]) for name in table.columns] for row in table.rows]
        )
        others = np.array(table.columns) != column
        return cls(path, table, column, values, cells[:, others & np.isfinite(cells).all(axis=0)])

    def of_stands(
        self, stands: Sequence[StandStill], seconds: FloatArray, numbers: FloatArray
    ) -> tuple[list[StandStill], list[Row]]:
        """Return the stand-stills that have a row, or why they have none; and these rows."""
        by_time = self.column == "time_s"
        span = np.ptp(self.numbers, axis=0)
        kept: list[StandStill] = []
        rows: list[Row] = []
        for one in stands:
            if one.picture < 0:
                kept.append(one)
                continue
            inside = (seconds >= one.begin_s) & (seconds <= one.end_s)
            about = seconds[inside] if by_time else numbers[inside]
            slack = _SLACK_S if by_time else 0.0
            own = np.flatnonzero(
                (self.values >= about.min() - slack) & (self.values <= about.max() + slack)
            )
            within = own[(self.values[own] >= about.min()) & (self.values[own] <= about.max())]
            own = within if len(within) else own
            at = seconds[one.picture] if by_time else numbers[one.picture]
            if not len(own):
                kept.append(replace(one, picture=-1, reason=_NO_ROW))
            elif (np.ptp(self.numbers[own], axis=0) > _AGREE * span).any():
                kept.append(replace(one, picture=-1, reason=_MOVES))
            else:
                kept.append(one)
                rows.append(self.table.rows[int(own[nearest(self.values[own], float(at))])])
        return kept, rows
