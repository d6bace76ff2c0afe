"""How good any list of poses is, wherever it comes from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import NotIdentifiableError
from calib.identification import check_identifiable, covariance_of
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.planning.checks import ON_TARGET_M, off_target
from posedesign.planning.loop import regressor
from posedesign.planning.pose_plan import displayed
from posedesign.planning.tables import PoseList
from posedesign.selection import Indices, evaluate


@dataclass(frozen=True)
class Score:
    """How good a list of poses is for a cell.

    Attributes
    ----------
    indices : Indices
    sigma : list of (name, unit, value)
        Predicted standard deviations as people read them; empty where not identifiable.
    problem : str
        What the poses cannot identify; empty where they can.
    not_feasible : tuple of str
        Poses that break a constraint of the cell, with the one that is broken most. The ways
        between them are not looked at: a list that is scored need not be in order.
    off_target : tuple of str
        Poses that do not bring the tool point to the target, with the distance.
    """

    indices: Indices
    sigma: list[tuple[str, str, float]]
    problem: str
    not_feasible: tuple[str, ...]
    off_target: tuple[str, ...]


def score_poses(cell: Cell, poses: PoseList) -> Score:
    """Indices and predicted standard deviations of any pose list."""
    model = cell.model()
    linear = model.linearise(poses.postures)
    white = linear.white_jacobian
    problem = _what_is_hidden(model, white)
    sigma: list[tuple[str, str, float]] = []
    if not problem:
        weighted = cell.config.measurement.weighted
        covariance = covariance_of(model, poses.postures, weighted=weighted)
        sigma = displayed(model, np.sqrt(np.diag(covariance)))
    verdicts = cell.checker.check(poses.postures)
    broken = [
        f"{poses.names[i]}: {verdicts.says(i)}" for i in np.flatnonzero(~verdicts.feasible).tolist()
    ]
    off = off_target(cell, poses.names, poses.postures, ON_TARGET_M)
    return Score(evaluate(regressor(linear), white), sigma, problem, tuple(broken), tuple(off))


def _what_is_hidden(model: CalibrationModel, white: FloatArray) -> str:
    """What whitened blocks ``(N, m, p)`` cannot identify, in words; empty where they can."""
    if white[..., 0].size < model.p:
        return f"{len(white)} poses give {white[..., 0].size} equations for {model.p} parameters"
    try:
        check_identifiable(white.reshape(-1, model.p), model.names, model.nuisance)
    except NotIdentifiableError as error:
        return error.message
    return ""
