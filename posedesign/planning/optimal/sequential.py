"""The next best poses, given what has been measured, and when to stop.

What the touch-ups so far tell is kept as rows of information at the parameters that they give;
poses are then chosen by what they add. Each further pose is predicted to lower the error of the
tool point over the task box by so much: once that is less than a pose is worth, it is time to stop.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.errors import ConvergenceError, InputError, NotIdentifiableError, near_names
from calib.identification import IdentificationResult, check_identifiable, identify
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Linearisation
from calib.model.measurements import Measurements
from calib.model.parameters import Unit
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import (
    CandidatePoses,
    away_from_singularities,
    candidates_of,
    functions_over_work,
)
from posedesign.cell import Cell
from posedesign.cell.reference import reference_of
from posedesign.motion import Router
from posedesign.planning.loop import told_by
from posedesign.planning.optimal.choose import (
    as_pose_set,
    chosen_with_way,
    no_clear_way,
)
from posedesign.planning.optimal.request import Request, is_told, objective_of
from posedesign.planning.optimal.result import NextPoses
from posedesign.selection import select, shortened

_NUMBERED = re.compile(r"P0*([0-9]{1,6})", re.ASCII)

LEAST_GAIN = 0.02
"""Part of the error of the tool point by which a pose has to lower it to be worth its time. After
n poses one more of the same kind gains 1 / (2 n): with .02 one goes on to about 25."""

BELIEVABLE_CHANCE = 0.05
"""Probability below which residuals are not put down to the noise given, which is then scaled."""

ENOUGH_TO_JUDGE = 5
"""Equations left over, at least, before the noise is judged by the residuals."""

BEFORE_MEASURING: dict[Unit, float] = {
    "rad": np.deg2rad(1.0),
    "m": 0.01,
    "px": 30.0,
    "1": 0.3,
    "rad/Nm": 5e-5,
}
"""Standard deviations that are taken for known of parameters without a prior while what is measured
does not identify everything."""


def plan_next(
    cell: Cell,
    data: Measurements,
    count: int,
    *,
    kinds: Sequence[str] = (),
    criterion: str = "tcp",
    least_gain: float = LEAST_GAIN,
    accuracy_m: float | None = None,
) -> NextPoses:
    """Choose the poses to measure next.

    Parameters
    ----------
    data : Measurements
        What was measured so far; where one target is touched it may have another name there.
    count : int
        Poses to choose.
    kinds : sequence of str
        Names that its kinds are indices into; by default all are of the cell's.
    criterion : str
        As of a plan; what is predicted is the error of the tool point in any case.
    least_gain : float
        Part of the error by which a pose has to lower it to be worth its time.
    accuracy_m : float, optional
        Error [m] at which to stop, in place of ``least_gain``.

    Raises
    ------
    InputError
        A target, a tool or a kind that the cell does not measure, or no such criterion.
    UnreachableError
        The robot can take none of the candidates.
    """
    check_touch_up_cell(cell)
    _check_gain(least_gain)
    pool = candidates_of(away_from_singularities(cell))
    arms = reference_of(cell)
    told = told_by(cell, arms.model, pool.postures, pool.of)
    if told is not arms.model:
        arms = PriorArms(told)
    if cell.is_plain:
        if len(data.targets) != 1 or data.observed is not None:
            raise InputError(
                "the next poses are planned for touch-ups of one target, as the cell has it, and "
                "there are " + ", ".join(data.targets),
                hint="describe the others as further [[target]] of the cell, or leave out their "
                "rows",
                name="touchups.csv",
            )
        data = replace(data, targets=arms.model.targets)
    else:
        data = _in_words_of(arms.model, data, kinds)
    identified, why_not = _identified(cell, arms.model, data)
    x = arms.model.nominal if identified is None else identified.values
    measured = arms.model.linearise(data.postures, x, data.setup)
    before = arms.known_rows
    if identified is None:
        before = _and_before_measuring(arms.model, before)
    request = Request(count=count, criterion=criterion)
    found = _next_poses(cell, pool, request, arms, x, measured, before)
    noise = 1.0  # what the residuals say of the noise given, where there are enough of them
    if identified is not None and identified.degrees_of_freedom >= ENOUGH_TO_JUDGE:
        noise = identified.noise_scale if identified.chance < BELIEVABLE_CHANCE else 1.0
    return replace(
        found,
        identified=identified,
        why_not=why_not,
        noise_scale=noise,
        poses=replace(found.poses, first=_last_number(data.names) + 1),
        tcp_m=noise * found.tcp_m,
        least_gain=least_gain,
        accuracy_m=accuracy_m,
    )


def plan_next_views(
    cell: Cell,
    taken: FloatArray,
    count: int,
    *,
    criterion: str = "tcp",
    least_gain: float = LEAST_GAIN,
    accuracy_m: float | None = None,
) -> NextPoses:
    """Choose the poses to take pictures of a board at, after those that were taken.

    What they tell is that of the camera, board and lens of the cell: no picture is read.

    Parameters
    ----------
    taken : array (N, n)
        Postures at which pictures with the board were taken [rad].
    count, criterion, least_gain, accuracy_m
        As of :func:`plan_next`; the error is that of what the camera sees.

    Raises
    ------
    InputError
        A cell without pictures of a board, or no such criterion.
    UnreachableError
        The robot can take none of the candidates.
    """
    if not cell.sees_board:
        raise InputError(
            "the next poses are planned for touch-ups and for pictures of a board, and this cell "
            f"has a {cell.config.measurement.kind}",
            hint='set measurement.kind = "board", or plan all poses at once',
            name="measurement.kind",
        )
    _check_gain(least_gain)
    arms = reference_of(cell)
    model = arms.model
    measured = model.linearise(taken)
    why_not, before = "", arms.known_rows
    told = np.vstack([measured.white_jacobian.reshape(-1, model.p), before])
    try:
        check_identifiable(told, model.names, model.nuisance)
    except NotIdentifiableError as error:
        why_not = _shortened(error.message)
        before = _and_before_measuring(model, before)
    pool = candidates_of(away_from_singularities(cell))
    request = Request(count=count, criterion=criterion)
    return replace(
        _next_poses(cell, pool, request, arms, model.nominal, measured, before),
        why_not=why_not,
        least_gain=least_gain,
        accuracy_m=accuracy_m,
        things=("picture", "what the camera sees"),
    )


def _and_before_measuring(model: CalibrationModel, known: FloatArray) -> FloatArray:
    """Rows ``(K, p)`` of what is known, and of what is taken for known of all without a prior."""
    taken = np.diag([1.0 / BEFORE_MEASURING[unit] for unit in model.units])
    return np.vstack([known, taken[np.isinf(model.prior)]])


def _check_gain(least_gain: float) -> None:
    if not 0.0 < least_gain < 1.0:
        raise InputError(
            f"a least gain of {least_gain:g}",
            hint="give a part of the error between 0 and 1, such as 0.02",
            name="least_gain",
        )


def _shortened(message: str) -> str:
    return message[:197] + "..." if len(message) >= 200 else message


def _in_words_of(model: CalibrationModel, data: Measurements, kinds: Sequence[str]) -> Measurements:
    """Measurements with targets, tools and kinds as a model lists them."""
    known = [kind.name for kind in model.measurements]
    strange = next((name for name in kinds if name not in known), None)
    if strange is not None:
        raise InputError(
            f"the cell measures no {strange}", hint=near_names(strange, known), name="kind"
        )
    found = data.with_labels(model.targets, model.tools)
    if kinds:
        place = np.array([known.index(name) for name in kinds], dtype=np.intp)
        found = replace(found, setup=replace(found.setup, kind=place[found.setup.kind]))
    return found


def _next_poses(
    cell: Cell,
    pool: CandidatePoses,
    request: Request,
    arms: PriorArms,
    x: FloatArray,
    measured: Linearisation,
    before: FloatArray,
) -> NextPoses:
    """Poses after those that were measured, the one that gains most first.

    Poses that cannot be had are dropped. ``before`` are rows of what is known beforehand.
    """
    model, count = arms.model, request.count or 1
    functions, words = functions_over_work(cell, model)
    objective, of = objective_of(request, arms, functions), np.arange(model.p)
    of_criterion = before
    if not objective.weighted and cell.config.parameters.planned is None and not cell.is_hand_eye:
        # condition numbers are of the paper's parameters, with nothing known of them beforehand
        paper = cell.model()
        of = np.array([model.names.index(name) for name in paper.names], dtype=np.intp)
        objective = objective_of(request, PriorArms(paper), functions[..., of])
        of_criterion = np.zeros((0, paper.p))
        if not is_told(measured.white_jacobian[..., of].reshape(-1, paper.p), paper):
            of_criterion = _and_before_measuring(paper, of_criterion)
    known = np.vstack([arms.blocks(measured).reshape(-1, model.p), before])

    def told_by_each(pool: CandidatePoses) -> FloatArray:
        return pool.blocks(model, lambda linear: shortened(arms.blocks(linear)), x)

    def choose(pool: CandidatePoses, few: int) -> IntArray:
        blocks, white = objective.of_pool(model, pool, x)[..., of], told_by_each(pool)
        # what was known before measuring, in the rows that the criterion is of
        scale = np.sqrt((blocks**2).sum() / (white[..., of] ** 2).sum())
        measured_rows = objective.blocks(measured)[..., of].reshape(-1, len(of))
        there = np.vstack([measured_rows, scale * of_criterion])
        found = select(blocks, few, objective.criterion, known=there, starts=1, bound=False)
        return _best_first(white, found.indices, known, functions)

    pool, rows, route, dropped = chosen_with_way(Router.of_cell(cell), pool, count, choose)
    if not len(rows):
        raise no_clear_way(dropped[0])
    chosen, done = pool.take(rows), len(measured.white_jacobian)
    return NextPoses(
        objective=objective,
        measured=done,
        identified=None,
        why_not="",
        noise_scale=1.0,
        poses=replace(as_pose_set(chosen).and_dropped(dropped), first=done + 1),
        route=route,
        tcp_m=_errors(told_by_each(chosen), known, functions),
        box_words=words,
        least_gain=LEAST_GAIN,
        accuracy_m=None,
    )


def _last_number(names: Sequence[str]) -> int:
    """Largest number that a name like P07 ends in, and no less than the number of names."""
    numbers = [int(found[1]) for name in names if (found := _NUMBERED.fullmatch(name))]
    return max([len(names), *numbers])


def check_touch_up_cell(cell: Cell) -> None:
    """Refuse a cell in which nothing is touched up."""
    if cell.is_hand_eye:
        raise InputError(
            "the next poses are planned for touch-ups, and this cell has a camera calibrated",
            hint='set measurement.kind = "touch-up", or plan all poses at once',
            name="measurement.kind",
        )


def _identified(
    cell: Cell, model: CalibrationModel, data: Measurements
) -> tuple[IdentificationResult | None, str]:
    """What the touch-ups give, or why they do not yet."""
    section = cell.config.parameters
    try:
        return identify(
            model, data, method=section.method, loss=section.loss_given or "least-squares"
        ), ""
    except (InputError, NotIdentifiableError, ConvergenceError) as error:
        return None, _shortened(error.message)


def _best_first(blocks: FloatArray, rows: IntArray, known: FloatArray, box: FloatArray) -> IntArray:
    """Chosen candidates in the order in which they gain most."""
    left, order = list(rows.tolist()), []
    rows_known = known
    while left:
        errors = [_errors(blocks[[i]], rows_known, box)[-1] for i in left]
        best = left.pop(int(np.argmin(errors)))
        order.append(best)
        rows_known = np.vstack([rows_known, blocks[best]])
    return np.array(order, dtype=np.intp)


def _errors(blocks: FloatArray, known: FloatArray, box: FloatArray) -> FloatArray:
    """Error of the tool point [m] by what is known, then with each block besides ``(k + 1,)``."""
    p = known.shape[1]
    errors = []
    R = np.asarray(np.linalg.qr(np.vstack([known, np.zeros((p, p))]), mode="r"))
    for block in (None, *blocks):
        if block is not None:
            R = np.asarray(np.linalg.qr(np.vstack([R, block]), mode="r"))
        half = np.linalg.solve(R.T, box.reshape(-1, p).T)
        errors.append(np.sqrt((half**2).sum() / len(box)))
    return np.array(errors)
