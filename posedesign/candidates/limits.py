"""What a cell asks of a choice of poses: shares of targets, sides and zones, and times."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from calib.errors import InputError, near_names
from calib.se3 import BoolArray, FloatArray, apply
from posedesign.candidates.candidate_poses import CandidatePoses
from posedesign.candidates.postures import in_front
from posedesign.cell import Cell
from posedesign.cell.schema_sections import LimitSection

if TYPE_CHECKING:
    from scipy.optimize import LinearConstraint


def limits_of(cell: Cell, pool: CandidatePoses) -> list[LinearConstraint]:
    """The limits of ``[[pool.limit]]`` on the times that each candidate is measured.

    Raises
    ------
    InputError
        One of them is of a target, a tool or a payload that the cell has not, or asks for poses
        that the pool has none of.
    """
    found = []
    for k, section in enumerate(cell.config.pool.limit):
        counted = _counted(cell, pool, section)
        if section.least and not counted.any():
            raise InputError(
                f"limit {k + 1} asks for {section.least} poses, and none of {len(pool)} candidates "
                "is one of these",
                hint="loosen what it counts, or widen the pool",
                name="pool.limit",
            )
        from scipy.optimize import LinearConstraint  # takes long to import, and few ask for limits

        most = np.inf if section.most is None else section.most
        found.append(LinearConstraint(counted[None].astype(float), section.least, most))
    return found


def _counted(cell: Cell, pool: CandidatePoses, section: LimitSection) -> BoolArray:
    """Which candidates ``(N,)`` a limit counts."""
    counted = np.ones(len(pool), dtype=bool)
    if not cell.is_hand_eye:
        each = [seen.labels for seen in cell.observations]
        for column in ("target", "tool", "payload"):
            wanted = getattr(section, column)
            if wanted is None:
                continue
            known = [label[column] for label in each]
            if wanted not in known:
                raise InputError(
                    f"a limit is of the {column} {wanted!r}, which no pose is of",
                    hint=near_names(wanted, known),
                    name=f"pool.limit.{column}",
                )
            counted &= np.array([label == wanted for label in known])[pool.of]
    if section.side is not None:
        first = cell.robot.n_external
        front = in_front(pool.postures[:, first], float(cell.base_posture[first]))
        counted &= front == (section.side == "front")
    if section.lowest_mm is not None and section.highest_mm is not None:
        at_mm = 1e3 * apply(cell.robot.fk(pool.postures), pool.tools_m(cell.tool_m))
        counted &= ((at_mm >= section.lowest_mm) & (at_mm <= section.highest_mm)).all(axis=1)
    return counted


def dwell_of(cell: Cell, pool: CandidatePoses) -> FloatArray:
    """How long the arm stands at each candidate ``(N,)`` [s]."""
    usual = cell.config.plan.dwell_s
    if cell.is_hand_eye:
        return np.full(len(pool), usual)
    given = {t.name: usual if t.dwell_s is None else t.dwell_s for t in cell.config.targets}
    each = np.array([given.get(seen.target, usual) for seen in cell.observations])
    return np.asarray(each[pool.of])
