"""A request for the best poses, and the objective that it comes to for a model."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.errors import InputError, NotIdentifiableError, near_names
from calib.identification import ExpectedError, check_identifiable
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Linearisation
from calib.model.parameters import Unit
from calib.se3 import FloatArray
from posedesign.candidates import CandidatePoses
from posedesign.files import LARGEST_NUMBER, LEAST_POSITIVE, usable
from posedesign.planning.loop import regressor
from posedesign.planning.pose_plan import displayed
from posedesign.selection import (
    CRITERIA,
    PER_MRAD_AND_MM,
    Candidates,
    Criterion,
    criterion_by_name,
    largest_deviation,
    mean_deviation,
    shortened,
    wanted_deviations,
)

TCP, TCP_WORST, SIGMA = "tcp", "tcp-worst", "sigma"

OBJECTIVES = {
    TCP: "rms error of the tool point where the arm will work, in the mean (I-optimality)",
    TCP_WORST: "the same where it is largest (G-optimality)",
    f"{SIGMA}:NAME": "standard deviation of one parameter, such as sigma:zero_offset.joint_2",
    **CRITERIA,
}
"""Criteria by name, and what is made small or large."""

IN_MM = 1e3
"""Functions of the tool point give mm."""

BY_REGRESSOR = ("C_G", "cond_2")
"""Criteria of the numbers that Watanabe et al. 2006 identify, with nothing known beforehand."""

_BY_NUISANCE = ("D", "A", "E")

MOST_POSES = 1000
"""More than a thousand touch-ups is a slip of the keyboard."""

USUAL_POSES = 27
"""As many as the grid of Watanabe et al. 2006 has."""

ROBUST = ("none", "average", "worst")


@dataclass(frozen=True, eq=False)
class PlanObjective:
    """What is to be reached, and on which blocks."""

    criterion: Criterion
    limit: float | None = None  # value to be reached, as the criterion is shown
    unit: str = ""  # of values as they are shown; empty where they have none
    known: FloatArray | None = None
    """(K, p): rows of what is known before any pose, as the blocks are scaled; None for nothing."""
    arms: PriorArms | None = None  # that it is for; None where it is of the model alone

    def blocks(self, linear: Linearisation) -> FloatArray:
        """Blocks ``(N, m, p)`` that the criterion is of."""
        name = self.criterion.name
        if name in BY_REGRESSOR:
            return regressor(linear)
        white = linear.white_jacobian if self.arms is None else self.arms.blocks(linear)
        return PER_MRAD_AND_MM * white if name in CRITERIA else white

    def of_pool(
        self, model: CalibrationModel, pool: CandidatePoses, x: FloatArray | None = None
    ) -> FloatArray:
        """Blocks of a pool ``(N, m, p)``, shortened where a pose has more rows than parameters."""
        return pool.blocks(model, lambda linear: shortened(self.blocks(linear)), x)

    def value_of(self, linear: Linearisation) -> float:
        """The criterion of a set of poses, as it is shown."""
        return self.criterion.shown(self.cost_of_blocks(self.blocks(linear)))

    def cost_of_blocks(self, blocks: FloatArray) -> float:
        """The cost of a set of poses, of their blocks ``(N, m, p)``."""
        pool = Candidates(blocks, self.known)
        return self.criterion.on(pool).cost(np.arange(pool.N))

    def words(self, value: float) -> str:
        if self.criterion.name == SIGMA:
            return f"{value:.4g} times the deviation wanted"
        return f"{self.criterion.name} {self.amount(value)}"

    def amount(self, value: float) -> str:
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
        return self.criterion.name not in BY_REGRESSOR


def objective_of(request: Request, arms: PriorArms, functions: FloatArray) -> PlanObjective:
    """The objective of a request.

    ``functions`` (K, 3, p): displacements of the tool point by each parameter where the arm will
    work. Raises InputError: no such criterion or parameter, or a request that does not go with it.
    """
    model = arms.model
    objective = replace(_objective_of(request, model, functions), arms=arms)
    known = arms.known_rows
    if not (len(known) and objective.weighted):
        return objective
    units = PER_MRAD_AND_MM if objective.criterion.name in CRITERIA else 1.0
    return replace(objective, known=units * known)


def _objective_of(request: Request, model: CalibrationModel, box: FloatArray) -> PlanObjective:
    if request.wants_sigma:
        wanted = _wanted(model, request.sigma_m, request.sigma_rad)
        return PlanObjective(wanted_deviations(wanted, model.p), 1.0)
    if request.accuracy_m is not None:
        return PlanObjective(_tcp_worst(box), IN_MM * request.accuracy_m, "mm")
    return replace(_by_name(request, model, box), limit=request.threshold)


def _by_name(request: Request, model: CalibrationModel, box: FloatArray) -> PlanObjective:
    name = request.criterion.strip()
    key = name.lower()
    if key == TCP:
        return PlanObjective(mean_deviation(IN_MM * box, TCP, OBJECTIVES[TCP]), None, "mm")
    if key == TCP_WORST:
        return PlanObjective(_tcp_worst(box), None, "mm")
    if key.partition(":")[0] == SIGMA:
        return _one_parameter(name.partition(":")[2].strip(), model)
    known = next((criterion for criterion in CRITERIA if criterion.lower() == key), None)
    if known is None:
        raise InputError(
            f"there is no criterion {name[:40]!r}",
            hint=near_names(name, list(OBJECTIVES)),
            name="criterion",
        )
    if known == "C_G" and model.rows > model.p:
        raise InputError(
            "C_G is of the entries of every row, and pictures of a board are chosen by their "
            "information",
            hint="take tcp, tcp-worst, sigma:NAME, D, A, E or cond_2; the loop goes by C_G",
            name="criterion",
        )
    robot = np.flatnonzero(~model.nuisance)
    interest = robot.tolist() if known in _BY_NUISANCE and 0 < len(robot) < model.p else None
    return PlanObjective(criterion_by_name(known, model.p, request.count or 1, interest))


def _tcp_worst(box: FloatArray) -> Criterion:
    return largest_deviation(IN_MM * box, TCP_WORST, OBJECTIVES[TCP_WORST])


def _one_parameter(name: str, model: CalibrationModel) -> PlanObjective:
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
    return PlanObjective(mean_deviation(row, f"{SIGMA}:{name}", title), None, unit)


def _wanted(model: CalibrationModel, sigma_m: float | None, sigma_rad: float | None) -> FloatArray:
    """Largest standard deviation ``(p,)`` of each parameter [SI]; infinite where any will do."""
    limits: dict[Unit, float | None] = {"m": sigma_m, "rad": sigma_rad}
    given = [limits.get(unit) for unit in model.units]
    wanted = np.array([np.inf if limit is None else limit for limit in given])
    if np.isinf(wanted).all():
        raise InputError(
            "no accuracy is wanted of anything that is identified",
            hint="give `wanted_sigma_mm`, `wanted_sigma_deg`, or both",
            name="wanted",
        )
    return wanted


@dataclass(frozen=True, eq=False)
class Accuracy:
    """What a number of poses promises."""

    poses: int
    value: float  # of the criterion, as it is shown
    sigma: FloatArray  # (p,): standard deviations of the parameters [SI]
    tcp_m: float
    tcp_worst_m: float
    """tcp_m, tcp_worst_m: root mean square error of the tool point where the arm will work, in the
    mean and where it is largest [m]."""
    expected: ExpectedError | None = None
    """The same mean with its range over arms; None where nothing is told, or it was not asked."""


def accuracy_of(
    objective: PlanObjective,
    arms: PriorArms,
    functions: FloatArray,
    linear: Linearisation,
    own: Linearisation | None = None,
    *,
    over_arms: bool = True,
) -> Accuracy:
    """Predict what postures leave: of parameters, criterion, tool point at ``functions`` (K, 3, p).

    ``linear``: of the model of the arms. ``own``: of the model that the objective is of, where that
    is another one. ``over_arms``: draw arms for the range of the error.
    """
    blocks, count = arms.blocks(linear), len(linear.white_jacobian)
    measured, counted = (arms, blocks), (arms, blocks)
    if own is not None:
        counted = PriorArms(own.model), own.white_jacobian
    if not all(
        is_told(np.vstack([told.reshape(-1, of.model.p), of.known_rows]), of.model)
        for of, told in {id(of): (of, told) for of, told in (measured, counted)}.values()
    ):
        unknown = np.full(counted[0].model.p, np.inf)
        return Accuracy(count, objective.criterion.shown(np.inf), unknown, np.inf, np.inf)
    squares = np.sum((functions @ arms.covariance(blocks)) * functions, axis=(1, 2))
    return Accuracy(
        count,
        objective.value_of(linear if own is None else own),
        np.sqrt(np.diag(counted[0].covariance(counted[1]))),
        float(np.sqrt(squares.mean())),
        float(np.sqrt(squares.max())),
        arms.expected_error(blocks, functions) if over_arms else None,
    )


def is_told(rows: FloatArray, model: CalibrationModel) -> bool:
    """Return True if rows ``(M, p)`` tell all parameters of a model apart."""
    if len(rows) < model.p:
        return False
    try:
        check_identifiable(rows, model.names, model.nuisance)
    except NotIdentifiableError:
        return False
    return True


@dataclass(frozen=True)
class Request:
    """What is wanted.

    ``method``: of :data:`posedesign.selection.METHODS`. ``count``: poses; None: the fewest that
    reach what is wanted. ``criterion``: of :data:`OBJECTIVES`, or ``sigma:NAME`` for one parameter.
    ``accuracy_m``: largest root mean square error of the tool point over the task box [m].
    ``sigma_m``, ``sigma_rad``: largest standard deviation of each parameter that is a length, and
    of each that is an angle. ``threshold``: value of the criterion to be reached. ``validation``:
    poses to choose besides, for a test. ``refine``: turn the tool at the chosen poses, off the
    pool, for as long as that helps. ``robust``: ``"none"``: choose for the robot as described;
    ``"average"``, ``"worst"``: for what is known of it before measuring. ``time_s``: what a round
    through the poses may take; it decides how many, in place of ``count``. ``beside``: how many
    poses fewer and more a choice is compared with. ``budget_s``: what standing at the poses and
    ``moving_s`` for each may take, in place of ``count``.
    """

    method: str = "exchange"
    count: int | None = USUAL_POSES
    criterion: str = "tcp"
    accuracy_m: float | None = None
    sigma_m: float | None = None
    sigma_rad: float | None = None
    threshold: float | None = None
    validation: int = 0
    refine: bool = False
    robust: str = "none"
    time_s: float | None = None
    beside: int = 1
    budget_s: float | None = None
    moving_s: float = 0.0

    def __post_init__(self) -> None:
        for name, value in (
            ("the target accuracy", self.accuracy_m),
            ("a wanted standard deviation", self.sigma_m),
            ("a wanted standard deviation", self.sigma_rad),
            ("the threshold", self.threshold),
            ("the time", self.time_s),
        ):
            if value is not None and not usable(value) >= LEAST_POSITIVE:
                raise InputError(
                    f"{name} is not above zero and finite",
                    hint=f"give a number from {LEAST_POSITIVE:g} to {LARGEST_NUMBER:g}",
                    name="wanted",
                    value=value,
                    bound=(LEAST_POSITIVE, LARGEST_NUMBER),
                )
        if self.count is not None and not 1 <= self.count <= MOST_POSES:
            raise InputError(
                f"{self.count} poses", hint=f"ask for 1 to {MOST_POSES}, or auto", name="poses"
            )
        if not 0 <= self.validation <= MOST_POSES:
            raise InputError(
                f"{self.validation} poses for validation",
                hint=f"ask for 0 to {MOST_POSES}",
                name="validation",
            )
        if self.robust not in ROBUST:
            raise InputError(
                f"there is no robustness {self.robust[:40]!r}",
                hint="one of " + ", ".join(ROBUST),
                name="robust",
            )
        if self.count is None and self.budget_s is None and not self.has_limit:
            raise InputError(
                "auto takes the fewest poses that reach an accuracy, and none is given",
                hint="give `target_accuracy` 0.2mm, `wanted_sigma_mm` or `threshold`, or a number "
                "of poses",
                name="poses",
            )

    @property
    def has_limit(self) -> bool:
        return self.accuracy_m is not None or self.threshold is not None or self.wants_sigma

    @property
    def wants_sigma(self) -> bool:
        """Whether standard deviations of all parameters are what is wanted."""
        return self.sigma_m is not None or self.sigma_rad is not None
