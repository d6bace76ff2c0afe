"""What any set of poses promises at the tool point, and what a choice of as many would."""

from __future__ import annotations

from dataclasses import dataclass, replace

from calib.errors import CalibError
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.candidates import away_from_singularities, functions_over_box, pool_of
from posedesign.cell import Cell
from posedesign.planning.optimal.objective import IN_MM, accuracy_of, goal_of
from posedesign.planning.optimal.request import Request
from posedesign.selection import select

CANDIDATES = 300
"""Draws of the pool that a choice is compared with: a tenth of the usual ones, in a tenth of a
second. On the reference cell and a KR 6 the best out of them was 12 % worse than out of all."""

NOTICEABLE = 0.9
"""Part of the predicted error below which a choice is worth a word."""


@dataclass(frozen=True)
class Outlook:
    """Predicted error of the tool point over the task box, from the noise alone.

    ``tcp_m``, ``tcp_worst_m``: root mean square error of the poses, in the mean over the box and
    where it is largest [m]; infinite where they do not identify everything. ``chosen_tcp_m``: in
    the mean, of the best choice of as many poses out of a small pool that keeps all constraints but
    those on the motions between poses; None where there is no such choice. ``box_words``: the task
    box in words.
    """

    tcp_m: float
    tcp_worst_m: float
    chosen_tcp_m: float | None
    box_words: str

    @property
    def chosen_is_better(self) -> bool:
        """Whether chosen poses promise noticeably less error: by a tenth or more."""
        return self.chosen_tcp_m is not None and self.chosen_tcp_m < NOTICEABLE * self.tcp_m


def outlook_of(cell: Cell, model: CalibrationModel, postures: FloatArray) -> Outlook:
    """Predict what postures ``(N, n)`` [rad] are worth, and what chosen ones would be.

    ``model``: what is identified. ``postures`` (N, n).
    """
    box, words = functions_over_box(cell, model)
    count = len(postures)
    goal = goal_of(Request(count=count), model, box)
    own = accuracy_of(model, goal, box, model.linearise(postures))
    if not cell.config.measurement.weighted:  # such an estimate cannot be chosen for pose by pose
        return Outlook(own.tcp_m, own.tcp_worst_m, None, words)
    pool_section = cell.config.pool.model_copy(update={"candidates": CANDIDATES})
    smaller = replace(cell, config=cell.config.model_copy(update={"pool": pool_section}))
    try:
        linear = pool_of(away_from_singularities(smaller)).linearise(model)
        found = select(goal.blocks(linear), count, goal.criterion, starts=1, bound=False)
    except CalibError:  # no pool, or too small a one: there is nothing to compare with
        return Outlook(own.tcp_m, own.tcp_worst_m, None, words)
    return Outlook(own.tcp_m, own.tcp_worst_m, found.value / IN_MM, words)
