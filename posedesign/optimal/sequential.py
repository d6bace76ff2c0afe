"""The next best poses, given what has been measured, and when to stop.

What the touch-ups so far tell is kept as rows of information at the parameters that they give;
poses are then chosen by what they add. Each further pose is predicted to lower the error of the
tool point over the task box by so much: once that is less than a pose is worth, it is time to stop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import CalibError, ConvergenceError, InputError, NotIdentifiableError
from calib.identification import identify
from calib.identification.result import IdentificationResult
from calib.measurement import Measurements
from calib.model import CalibrationModel
from calib.parameters import TargetPoints
from calib.parameters.base import Unit
from calib.se3 import FloatArray, IntArray
from posedesign.cell import Cell
from posedesign.optimal.goal import Goal, goal_of
from posedesign.optimal.planning import as_pose_set
from posedesign.optimal.pool_of_cell import functions_over_box, pool_of
from posedesign.optimal.wish import Wish
from posedesign.pose_plan import PoseSet
from posedesign.route import Route, Router
from posedesign.selection import select

LEAST_GAIN = 0.02
"""Part of the error of the tool point by which a pose has to lower it to be worth its time. After
n poses one more of the same kind gains 1 / (2 n): with .02 one goes on to about 25."""

BELIEVABLE_CHANCE = 0.05
"""Probability below which residuals are not put down to the noise given, which is then scaled."""

ENOUGH_TO_JUDGE = 5
"""Equations left over, at least, before the noise is judged by the residuals."""

BEFORE_MEASURING: dict[Unit, float] = {"rad": np.deg2rad(1.0), "m": 0.01}
"""Standard deviations that are taken for known while the touch-ups do not identify everything."""


@dataclass(frozen=True, eq=False)
class NextPoses:
    """Poses to measure next, and what they promise.

    Attributes
    ----------
    goal : Goal
    measured : int
        Touch-ups so far.
    identified : IdentificationResult or None
        What they give; None while they do not identify everything.
    why_not : str
        Why they do not, in words.
    noise_scale : float
        By which the noise given is multiplied in what is predicted.
    poses : PoseSet
        The next ones, the one that gains most first.
    route : Route
    tcp_m : ndarray (k + 1,)
        Root mean square error of the tool point over the box [m]: now, and after each further pose.
    box_words : str
    least_gain : float
    accuracy_m : float or None
        Error at which to stop.
    """

    goal: Goal
    measured: int
    identified: IdentificationResult | None
    why_not: str
    noise_scale: float
    poses: PoseSet
    route: Route
    tcp_m: FloatArray
    box_words: str
    least_gain: float
    accuracy_m: float | None

    @property
    def worth(self) -> int:
        """How many of the poses are worth their time."""
        if self.identified is None:
            return len(self.tcp_m) - 1
        gains = -np.diff(self.tcp_m) / self.tcp_m[:-1]
        enough = gains < self.least_gain
        if self.accuracy_m is not None:
            enough = self.tcp_m[:-1] <= self.accuracy_m
        return int(np.argmax(enough)) if enough.any() else len(gains)

    @property
    def message(self) -> str:
        """What to do, in one line."""
        now, best = 1e3 * self.tcp_m[0], 1e3 * self.tcp_m[-1]
        if self.identified is None:
            return (
                f"go on: {self.measured} touch-ups do not yet identify everything ({self.why_not})"
            )
        said = f"tool point known to {now:.4g} mm rms over {self.box_words} after {self.measured}"
        if self.worth == 0:
            why = f"the next pose would gain less than {100 * self.least_gain:g} %"
            if self.accuracy_m is not None:
                why = f"{1e3 * self.accuracy_m:.4g} mm is reached"
            return f"stop: {said} touch-ups; {why}"
        count = len(self.tcp_m) - 1
        return f"go on: {said}; {count} more are predicted to bring it to {best:.4g} mm"

    def rows(self) -> list[dict[str, object]]:
        """The error after each further pose."""
        rows: list[dict[str, object]] = []
        for k, value in enumerate(self.tcp_m):
            gain = 1.0 - value / self.tcp_m[k - 1] if k else np.nan
            rows.append(
                {
                    "touch-ups": self.measured + k,
                    "pose": self.poses.names[k - 1] if k else "",
                    "TCP rms over the box [mm]": 1e3 * float(value),
                    "gain [%]": 100.0 * float(gain) if k else None,
                }
            )
        return rows


def plan_next(
    cell: Cell,
    data: Measurements,
    count: int,
    *,
    criterion: str = "tcp",
    least_gain: float = LEAST_GAIN,
    accuracy_m: float | None = None,
) -> NextPoses:
    """Choose the poses to measure next.

    Parameters
    ----------
    cell : Cell
    data : Measurements
        The touch-ups so far, of one target.
    count : int
        Poses to choose.
    criterion : str
        As of a plan; what is predicted is the error of the tool point in any case.
    least_gain : float
        Part of the error by which a pose has to lower it to be worth its time.
    accuracy_m : float, optional
        Error [m] at which to stop, in place of ``least_gain``.

    Raises
    ------
    InputError
        Another kind of measurement, several targets, or no such criterion.
    UnreachableError
        The robot can take none of the candidates.
    """
    if cell.is_hand_eye or len(data.targets) != 1 or data.observed is not None:
        raise InputError(
            "the next poses are planned for touch-ups of one target",
            hint="leave out the rows of other targets and kinds",
            name="touchups.csv",
        )
    if not 0.0 < least_gain < 1.0:
        raise InputError(f"a least gain of {least_gain:g}", hint="give a part, such as 0.02")
    model = cell.model(targets=TargetPoints([cell.target_m], data.targets))
    identified, why_not = _identified(cell, model, data)
    x = model.nominal if identified is None else identified.values
    known = model.linearise(data.postures, x, data.setup).white_jacobian.reshape(-1, model.p)
    if identified is None:
        sizes = np.array([BEFORE_MEASURING[unit] for unit in model.units])
        known = np.vstack([known, np.diag(1.0 / sizes)])
    box, box_words = functions_over_box(cell, model)
    goal = goal_of(Wish(count=count, criterion=criterion), model, box)
    pool = pool_of(cell)
    linear = model.linearise(pool.postures, x, pool.setup(model))
    blocks = goal.blocks(linear)
    scale = np.median(np.abs(blocks[blocks != 0.0]) / np.abs(linear.white_jacobian[blocks != 0.0]))
    found = select(blocks, count, goal.criterion, known=scale * known, starts=1, bound=False)
    rows = _best_first(linear.white_jacobian, found.indices, known, box)
    errors = _errors(linear.white_jacobian[rows], known, box)
    noise = _noise_scale(identified)
    chosen = pool.take(rows)
    route = Router.of_cell(cell).route(chosen.postures)
    return NextPoses(
        goal,
        len(data.postures),
        identified,
        why_not,
        noise,
        as_pose_set(chosen),
        route,
        noise * errors,
        box_words,
        least_gain,
        accuracy_m,
    )


def _identified(
    cell: Cell, model: CalibrationModel, data: Measurements
) -> tuple[IdentificationResult | None, str]:
    """What the touch-ups give, or why they do not yet."""
    section = cell.config.parameters
    try:
        return identify(model, data, method=section.method, loss=section.loss), ""
    except (InputError, NotIdentifiableError, ConvergenceError) as error:
        return None, _first_words(error)


def _first_words(error: CalibError) -> str:
    return error.message if len(error.message) < 200 else error.message[:197] + "..."


def _noise_scale(identified: IdentificationResult | None) -> float:
    """What the residuals say of the noise given, where there are enough of them."""
    if identified is None or identified.degrees_of_freedom < ENOUGH_TO_JUDGE:
        return 1.0
    return identified.noise_scale if identified.chance < BELIEVABLE_CHANCE else 1.0


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
