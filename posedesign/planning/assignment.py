"""Which of some is given which of others so that all together costs least."""

from __future__ import annotations

import numpy as np

from calib.se3 import FloatArray, IntArray


def least_assignment(cost: FloatArray) -> tuple[IntArray, IntArray]:
    """Return rows and columns ``(min(R, C),)`` of the pairs whose cost ``(R, C)`` is least in sum.

    Each row and each column is in one pair at most. By shortest augmenting paths (Jonker and
    Volgenant 1987), as ``linear_sum_assignment`` of scipy, which takes a third of a second to be
    loaded; of the tens of poses of a plan this takes a millisecond.
    """
    if cost.shape[0] > cost.shape[1]:
        columns, rows = least_assignment(cost.T)
        order = np.argsort(rows)
        return rows[order], columns[order]
    count, others = cost.shape
    of_row = np.zeros(count)  # dual values
    of_column = np.zeros(others)
    owner = np.full(others, -1)  # row that has each column
    for start in range(count):
        least = np.full(others, np.inf)  # of a path to each column
        before = np.full(others, -1)  # column before it on that path
        done = np.zeros(others, dtype=bool)
        row, column, length = start, -1, 0.0
        while row >= 0:
            onward = length + cost[row] - of_row[row] - of_column
            shorter = ~done & (onward < least)
            least[shorter], before[shorter] = onward[shorter], column
            column = int(np.argmin(np.where(done, np.inf, least)))
            length, row = float(least[column]), int(owner[column])
            done[column] = True
        passed = np.flatnonzero(done & (owner >= 0))
        of_row[start] += length
        of_row[owner[passed]] += length - least[passed]
        of_column[done] -= length - least[done]
        while column >= 0:  # each column goes to the row of the one before it
            last = int(before[column])
            owner[column] = start if last < 0 else owner[last]
            column = last
    columns = np.flatnonzero(owner >= 0)
    order = np.argsort(owner[columns])
    return owner[columns][order], columns[order]
