"""From the name of a criterion to what is minimised, and what a number of poses promises."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.errors import InputError, NotIdentifiableError, near_names
from calib.identification import check_identifiable
from calib.model import CalibrationModel, Linearisation
from calib.model.parameters import Unit
from calib.se3 import FloatArray
from posedesign.planning.loop import regressor
from posedesign.planning.optimal.request import Request
from posedesign.planning.pose_plan import displayed
from posedesign.selection import (
    CRITERIA,
    PER_MRAD_AND_MM,
    Candidates,
    Criterion,
    criterion_by_name,
    largest_deviation,
    mean_deviation,
    wanted_deviations,
)

TCP, TCP_WORST, SIGMA = "tcp", "tcp-worst", "sigma"

GOALS = {
    TCP: "rms error of the tool point, in the mean over the task box (I-optimality)",
    TCP_WORST: "the same where it is largest (G-optimality)",
    f"{SIGMA}:NAME": "standard deviation of one parameter, such as sigma:zero_offset.joint_2",
    **CRITERIA,
}
"""Criteria by name, and what is made small or large."""

IN_MM = 1e3
"""Functions of the tool point give mm."""

_BY_REGRESSOR = ("C_G", "cond_2")
_BY_NUISANCE = ("D", "A", "E")


@dataclass(frozen=True, eq=False)
class Goal:
    """What is to be reached, and on which blocks.

    ``limit``: value to be reached, as the criterion is shown. ``unit``: of values as they are
    shown; empty where they have none.
    """

    criterion: Criterion
    limit: float | None = None
    unit: str = ""

    def blocks(self, linear: Linearisation) -> FloatArray:
        """Blocks ``(N, m, p)`` that the criterion is of."""
        name = self.criterion.name
        if name in _BY_REGRESSOR:
            return regressor(linear)
        white = linear.white_jacobian
        return PER_MRAD_AND_MM * white if self._by_mrad_and_mm else white

    def value_of(self, linear: Linearisation) -> float:
        """The criterion of a set of poses, as it is shown."""
        return self.criterion.shown(self.cost_of_blocks(self.blocks(linear)))

    def cost_of_blocks(self, blocks: FloatArray) -> float:
        """The cost of a set of poses, of their blocks ``(N, m, p)``."""
        pool = Candidates(blocks)
        return self.criterion.on(pool).cost(np.arange(pool.N))

    @property
    def _by_mrad_and_mm(self) -> bool:
        return self.criterion.name in CRITERIA and self.criterion.name not in _BY_REGRESSOR

    def words(self, value: float) -> str:
        """A value as people read it."""
        if self.criterion.name == SIGMA:
            return f"{value:.4g} times the deviation wanted"
        return f"{self.criterion.name} {self.amount(value)}"

    def amount(self, value: float) -> str:
        """A value as people read it, without the name of the criterion."""
        return f"{value:.4g} {self.unit}".rstrip()

    @property
    def title(self) -> str:
        """Name and unit, of a column."""
        if self.criterion.name == SIGMA:
            return "deviation over that wanted"
        return self.criterion.name + f" [{self.unit}]" * bool(self.unit)

    @property
    def weighted(self) -> bool:
        """Whether the criterion is of what the noise leaves."""
        return self.criterion.name not in _BY_REGRESSOR


def goal_of(request: Request, model: CalibrationModel, box: FloatArray) -> Goal:
    """The goal of a request.

    ``box`` (K, 3, p): how the tool point moves with the parameters over the task box. Raises
    InputError: no such criterion or parameter, or a request that does not go with it.
    """
    if request.wants_sigma:
        wanted = _wanted(model, request.sigma_m, request.sigma_rad)
        title = "largest standard deviation over that wanted"
        return Goal(_named(wanted_deviations(wanted, model.p), SIGMA, title), 1.0)
    if request.accuracy_m is not None:
        return Goal(_tcp_worst(box), IN_MM * request.accuracy_m, "mm")
    return replace(_by_name(request, model, box), limit=request.threshold)


def _by_name(request: Request, model: CalibrationModel, box: FloatArray) -> Goal:
    name = request.criterion.strip()
    key = name.lower()
    if key == TCP:
        return Goal(mean_deviation(IN_MM * box, TCP, GOALS[TCP]), None, "mm")
    if key == TCP_WORST:
        return Goal(_tcp_worst(box), None, "mm")
    if key.partition(":")[0] == SIGMA:
        return _one_parameter(name.partition(":")[2].strip(), model)
    known = [criterion for criterion in CRITERIA if criterion.lower() == key]
    if not known:
        raise InputError(
            f"there is no criterion {name[:40]!r}",
            hint=near_names(name, list(GOALS)),
            name="criterion",
        )
    robot = np.flatnonzero(~model.nuisance)
    interest = robot.tolist() if known[0] in _BY_NUISANCE and 0 < len(robot) < model.p else None
    return Goal(criterion_by_name(known[0], model.p, request.count or 1, interest))


def _tcp_worst(box: FloatArray) -> Criterion:
    return largest_deviation(IN_MM * box, TCP_WORST, GOALS[TCP_WORST])


def _one_parameter(name: str, model: CalibrationModel) -> Goal:
    if not name:
        raise InputError(
            f"{SIGMA} is the standard deviation of one parameter, and none is named",
            hint=f"give one, such as {SIGMA}:{model.names[0]}",
            name="criterion",
        )
    if name not in model.names:
        raise InputError(
            f"there is no parameter {name[:60]!r}",
            hint=near_names(name, model.names),
            name="criterion",
        )
    k = model.names.index(name)
    row = np.zeros((1, 1, model.p))
    _, unit, row[0, 0, k] = displayed(model, np.ones(model.p))[k]
    title = f"standard deviation of {name}"
    return Goal(mean_deviation(row, f"{SIGMA}:{name}", title), None, unit)


def _wanted(model: CalibrationModel, sigma_m: float | None, sigma_rad: float | None) -> FloatArray:
    """Largest standard deviation ``(p,)`` of each parameter [SI]; infinite where any will do."""
    limits: dict[Unit, float | None] = {"m": sigma_m, "rad": sigma_rad}
    given = [limits.get(unit) for unit in model.units]
    wanted = np.array([np.inf if limit is None else limit for limit in given])
    if np.isinf(wanted).all():
        raise InputError(
            "no accuracy is wanted of anything that is identified",
            hint="give --wanted-sigma-mm, --wanted-sigma-deg, or both",
            name="wanted",
        )
    return wanted


def _named(criterion: Criterion, name: str, title: str) -> Criterion:
    criterion.name, criterion.title = name, title
    return criterion


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What a number of poses promises.

    ``value``: of the criterion, as it is shown. ``sigma`` (p,): standard deviations of the
    parameters [SI]. ``tcp_m``, ``tcp_worst_m``: root mean square error of the tool point over the
    task box, in the mean and where it is largest [m].
    """

    poses: int
    value: float
    sigma: FloatArray
    tcp_m: float
    tcp_worst_m: float


def accuracy_of(
    model: CalibrationModel, goal: Goal, box: FloatArray, linear: Linearisation
) -> Accuracy:
    """What postures promise: parameters, criterion, tool point over the box ``(K, 3, p)``."""
    count = len(linear.white_jacobian)
    covariance = _covariance(linear.white_jacobian, model)
    if covariance is None:
        unknown = np.full(model.p, np.inf)
        return Accuracy(count, goal.criterion.shown(np.inf), unknown, np.inf, np.inf)
    squares = np.einsum("krp,pq,krq->k", box, covariance, box, optimize=True)
    return Accuracy(
        count,
        goal.value_of(linear),
        np.sqrt(np.diag(covariance)),
        float(np.sqrt(squares.mean())),
        float(np.sqrt(squares.max())),
    )


def _covariance(white: FloatArray, model: CalibrationModel) -> FloatArray | None:
    """Covariance ``(p, p)`` of blocks; None where they do not identify everything."""
    rows = white.reshape(-1, model.p)
    if len(rows) < model.p:
        return None
    try:
        check_identifiable(rows, model.names, model.nuisance)
    except NotIdentifiableError:
        return None
    length = np.linalg.norm(rows, axis=0)
    R = np.linalg.inv(np.linalg.qr(rows / length, mode="r")) / length[:, None]
    return np.asarray(R @ R.T)
