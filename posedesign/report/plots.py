"""Pictures of plans and results: what they promise, what is left over, how far methods differ.

:func:`plot` draws any result. The commands write the same figures beside their tables, and a page
has them from there.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import singledispatch
from typing import TYPE_CHECKING

import numpy as np

from calib.errors import InputError
from calib.identification import IdentificationResult
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Setup
from calib.one_thread import one_numpy_thread
from calib.robot_world import RobotWorldResult
from calib.se3 import FloatArray
from posedesign.candidates import box_of_cell, functions_over_work
from posedesign.cell import Cell
from posedesign.cell.task_box import BoxAccuracy, predict_box
from posedesign.planning.optimal import NextPoses, OptimalPlan
from posedesign.planning.pose_plan import PosePlan
from posedesign.report import figures
from posedesign.selection import shortened

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from posedesign.identification.file import IdentificationFile

SINGULAR = 1e12
"""Condition of the normalised information from which on poses do not suffice."""


@singledispatch
def plot(result: object) -> Figure:
    """Draw a result; a notebook shows the figure that is returned.

    Plans: predicted standard deviations against the number of poses. Identifications: residuals by
    pose. A X = Z B: residuals by pair. The accuracy over a box: a map of it. Next poses: the error
    of the tool point after each.

    Raises InputError: there is no figure of such a thing.
    """
    raise InputError(
        f"there is no figure of a {type(result).__name__}",
        hint="plans and results have one",
        name="result",
    )


@plot.register(PosePlan)
@plot.register(OptimalPlan)
def _plot_plan(result: PosePlan | OptimalPlan) -> Figure:
    figure = figure_of_sigmas(result.model, result.postures, result.setup)
    if figure is None:
        raise InputError(
            "these poses do not tell the parameters: there is nothing to draw",
            hint="plan more poses",
            name="result",
        )
    return figure


@plot.register(NextPoses)
def _plot_next_poses(result: NextPoses) -> Figure:
    figure = figures.new_figure()
    error = {"with each further pose": 1e3 * result.tcp_m}
    figures.error_by_poses(figure, error, _TOOL_POINT, first=0)
    return figure


@plot.register(BoxAccuracy)
def _plot_box(result: BoxAccuracy) -> Figure:
    figure = figures.new_figure(3.4)
    figures.error_over_box(figure, result.points_m, result.rms_m)
    return figure


@plot.register(IdentificationResult)
def _plot_identification(result: IdentificationResult) -> Figure:
    figure = figures.new_figure(3.2)
    left = {result.model: 1e3 * np.array(result.distances_m)}
    figures.residuals_by_pose(figure, result.poses, left, result.outliers)
    return figure


@plot.register(RobotWorldResult)
def _plot_robot_world(result: RobotWorldResult) -> Figure:
    figure = figures.new_figure(5.0)
    names = [str(k + 1) for k in range(len(result.used))]
    for part, values, unit in zip(
        figures.rows_of(figure, (1.0, 1.0)),
        (1e3 * result.residual_translation_m, np.rad2deg(result.residual_rotation_rad)),
        ("mm", "deg"),
        strict=True,
    ):
        figures.residuals_by_pose(part, names, {result.method: values}, ~result.used, unit)
    return figure


@one_numpy_thread
def figure_of_plan(
    cell: Cell, arms: PriorArms, q: FloatArray, setup: Setup | None = None
) -> Figure | None:
    """Expected error of the tool point by the number of poses, and over the task box.

    Of poses for a camera, the standard deviations of X and Z. What has no finite number is left
    out; None where nothing has.

    ``q`` (N, n): postures in the order of the visit [rad]. ``setup``: what is measured at each.
    """
    model = arms.model
    if cell.is_hand_eye:
        return figure_of_sigmas(model, q, setup, {"tool": "X", "target": "Z", "lens": "lens"})
    box, words = box_of_cell(cell)
    blocks = arms.blocks(model.linearise(q, setup=setup))
    functions, where = functions_over_work(cell, model)
    first, best = errors_of_fewer(blocks, functions, arms.known_rows)
    if not np.isfinite(first[-1:]).all():  # nor is there an error over the box
        return None
    found = predict_box(cell, arms, blocks, box)
    over_box = bool(np.isfinite(found.rms_m).any())
    figure = figures.new_figure(6.6 if over_box else 3.4)
    top, *more = figures.rows_of(figure, [1.0] * (1 + over_box))
    error = {"the first poses of the tour": 1e3 * first, "the best of these poses": 1e3 * best}
    figures.error_by_poses(top, error, _TOOL_POINT)
    top.suptitle(f"over {where}", fontsize=10)
    for bottom in more:
        figures.error_over_box(bottom, found.points_m, found.rms_m)
        bottom.suptitle(f"over {words}", fontsize=10)
    return figure


_TOOL_POINT = "error of the tool point,\nrms, expected [mm]"


def figure_of_sigmas(
    model: CalibrationModel,
    q: FloatArray,
    setup: Setup | None = None,
    called: Mapping[str, str] | None = None,
) -> Figure | None:
    """Predicted standard deviations against the number of poses, lengths and angles apart.

    None where these poses tell none.

    ``q`` (N, n): [rad]. ``called``: what to call tool and targets.
    """
    white = model.linearise(q, setup=setup).white_jacobian
    of = np.array([name.rpartition(".")[0] for name in model.names])
    units = np.array(model.units)
    kinds = [kind for kind in _KINDS if kind[0] in model.units]
    shown = []
    for unit, title, factor in kinds:
        error = {}
        for thing in dict.fromkeys(of[units == unit].tolist()):
            rows = np.eye(model.p)[(units == unit) & (of == thing)]
            label = (called or {}).get(thing.partition(".")[0], thing)
            error[label] = factor * errors_of_fewer(white, rows[None])[0]
        if any(np.isfinite(values).any() for values in error.values()):
            shown.append((title, error))
    if not shown:
        return None
    figure = figures.new_figure(3.0 * len(shown))
    parts = figures.rows_of(figure, [1.0] * len(shown))
    for part, (title, error) in zip(parts, shown, strict=True):
        figures.error_by_poses(part, error, title)
    return figure


_KINDS = (
    ("m", "standard deviation, axes\ntogether, predicted [mm]", 1e3),
    ("rad", "standard deviation, axes\ntogether, predicted [deg]", float(np.rad2deg(1.0))),
    ("px", "standard deviation, focal lengths\nand centre together [px]", 1.0),
)


def errors_of_fewer(
    white: FloatArray, functions: FloatArray, known: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Error [SI] of the first poses of a tour, and of the best of all of it.

    ``white`` (N, m, p): whitened blocks. ``functions`` (K, r, p): how what is asked for moves with
    the parameters, at K places. ``known`` (k, p): rows of what is known beforehand. Returns
    ``first`` and ``best`` (N,), root mean square over the places, for 1, 2, .. N poses; NaN where
    they do not suffice. The best are found by leaving out, one after the other, the pose that is
    missed least.
    """
    white = shortened(white)
    blocks = np.einsum("nmp,nmq->npq", white, white)
    before = np.zeros(blocks.shape[1:]) if known is None else known.T @ known
    wanted = np.einsum("kip,kiq->pq", functions, functions) / len(functions)
    first = _error(before + np.cumsum(blocks, axis=0), wanted)
    best = np.full(len(white), np.nan)
    left = np.arange(len(white))
    best[-1:] = first[-1:]
    while len(left) > 1 and np.isfinite(best[len(left) - 1]):
        missed = _missed(white[left], before + blocks[left].sum(axis=0), wanted)
        left = np.delete(left, int(np.argmin(missed)))
        best[len(left) - 1] = _error((before + blocks[left].sum(axis=0))[None], wanted)[0]
    return first, best


def _missed(white: FloatArray, information: FloatArray, wanted: FloatArray) -> FloatArray:
    """Growth ``(N,)`` of the mean square error without each block of the information ``(p, p)``."""
    scale = 1.0 / np.sqrt(np.diag(information))
    C = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    moved = white @ C
    rest = np.eye(white.shape[1]) - moved @ np.swapaxes(white, 1, 2)
    values, vectors = np.linalg.eigh(rest)
    seen = np.swapaxes(vectors, 1, 2) @ moved
    growth = np.einsum("nmp,pq,nmq->nm", seen, wanted, seen, optimize=True)
    return np.asarray((growth / np.maximum(values, 1.0 / SINGULAR)).sum(axis=1))


def _error(information: FloatArray, wanted: FloatArray) -> FloatArray:
    """Root mean square error ``(N,)`` by information ``(N, p, p)``; NaN where singular."""
    scale = np.sqrt(np.maximum(np.diagonal(information, axis1=1, axis2=2), 1e-300))
    values, vectors = np.linalg.eigh(information / (scale[:, :, None] * scale[:, None, :]))
    known = values[:, 0] * SINGULAR > values[:, -1]
    out = np.full(len(information), np.nan)
    half = vectors[known] / np.sqrt(values[known])[:, None, :] / scale[known][:, :, None]
    out[known] = np.sqrt(np.einsum("npk,pq,nqk->n", half, wanted, half, optimize=True))
    return out


def figure_of_identification(
    content: IdentificationFile, q_deg: FloatArray | None
) -> Figure | None:
    """Residuals by pose and by joint, before and after; None where no model is recommended.

    ``q_deg`` (N, n): postures that were measured at [deg], of slides [mm].
    """
    chosen = content.chosen
    if chosen is None:
        return None
    both = dict.fromkeys((content.models[0].name, chosen.name))
    models = [model for model in content.models if model.name in both]
    left = {model.name: np.array([row.mm for row in model.residuals]) for model in models}
    names = [row.pose for row in chosen.residuals]
    if any(len(v) != len(names) or not np.isfinite(v).all() for v in left.values()):
        return None
    by_joint = q_deg is not None and q_deg.shape == (len(names), len(content.joints))
    figure = figures.new_figure(6.0 if by_joint else 3.4)
    top, bottom = figures.rows_of(figure, (3.0, 2.0)) if by_joint else (figure, None)
    outliers = np.array([row.outlier for row in chosen.residuals])
    figures.residuals_by_pose(top, names, left, outliers)
    if bottom is not None and q_deg is not None:
        figures.residuals_by_joint(bottom, content.joints, q_deg, left, content.external)
    return figure
