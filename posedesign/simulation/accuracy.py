"""Accuracy against condition: what a lower condition number buys, by simulation.

The pose sets are those that the loop passes through on its way to the widest angles: each is what
the loop would return for some threshold. Each set is touched up many times with fresh noise; the
recordings go into the identification (by touch-up, weighted and not, and by view line only) and
into every AX=ZB solver, and the identified robot measures distances on a plate of known pitch: the
test of section 3.4 of Watanabe et al. 2006.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from calib.chance import spread_interval
from calib.errors import CalibError, ConvergenceError, InputError, UnreachableError
from calib.identification import DISPLAY, covariance_of, identify_batch
from calib.model import CalibrationModel, Setup, simulate
from calib.model.parameters import TargetPoints
from calib.robot_world import PAPER_METHODS, solve_batch_by_each
from calib.se3 import FloatArray, apply, inverse, rotation_angle
from calib.vision.camera import Observer
from calib.vision.touch_up import Drive, ImageJacobian, Loop, SimulatedArms, TrueCell, touch_up
from posedesign.cell import Cell, touching_poses
from posedesign.cell.models import make_touch_up, noise_of_kind
from posedesign.constraints import Checker, nearest_postures
from posedesign.planning import PosePlan, Round, check_not_hand_eye, check_plain, plan
from posedesign.simulation.rehearsal import SimulatedRobot

if TYPE_CHECKING:
    import pandas as pd

PLATE_POINTS = 5
PLATE_PITCH_M = 0.1
"""The plate of section 3.4 of Watanabe et al. 2006: 5 x 5 targets, 100 mm apart."""


@dataclass(frozen=True, eq=False)
class PlateTest:
    """The plate as seen by one robot after another: section 3.4 and Fig. 11 of the paper."""

    postures: FloatArray
    """(T, 25, n): joint values with the tool point on each point of the plate, a trial a row
    [rad]."""

    @classmethod
    def measure(cls, robot: SimulatedRobot, rng: np.random.Generator, trials: int) -> PlateTest:
        """Touch up every point of a plate around the target, the tool held as at the base pose.

        Raises UnreachableError: the arm cannot reach all of the plate.
        """
        cell = robot.cell
        points = points_around(cell, robot.target_m)
        q = plate_postures(cell, robot.target_m)
        # each point is a target of its own, touched once
        labels = [f"plate{i}" for i in range(len(points))]
        targets = TargetPoints(points, labels)
        model = CalibrationModel(
            cell.robot,
            [*(b for b in robot.model.parameters if not isinstance(b, TargetPoints)), targets],
            make_touch_up(cell.config, cell.T_tip_camera[:3, :3]),
        )
        is_target = np.array([name.startswith("target.") for name in robot.model.names])
        values = np.concatenate([robot.values[~is_target], targets.nominal])
        setup = Setup.of(len(points), target=np.arange(len(points)))
        try:
            return cls(simulate(model, values, q, rng, trials=trials, setup=setup).postures)
        except ConvergenceError as error:
            raise UnreachableError(f"the test plate cannot be touched: {error.message}") from error

    @classmethod
    def by_sight(
        cls,
        cell: Cell,
        truth: TrueCell,
        observer: Observer,
        jacobian: ImageJacobian,
        loop: Loop,
        rng: np.random.Generator,
        trials: int = 1,
    ) -> PlateTest:
        """Touch up every point of a plate around the target by what a simulated camera sees.

        ``cell``: with camera and target as they were found: where the arm is sent. ``truth``: with
        one target, in the middle of the plate, which lies across the camera of the base pose.
        ``trials``: how often the plate is measured. Raises UnreachableError: a point cannot be
        reached, or was not touched.
        """
        found = plate_postures(cell, cell.target_m)
        R = cell.robot.fk(cell.base_posture)[:3, :3]
        targets = np.tile(truth.T_base_target, (len(found), 1, 1))
        targets[:, :3, 3] += _plate_points() @ R.T
        every = np.tile(targets, (trials, 1, 1))
        q = np.tile(found, (trials, 1))
        arms = SimulatedArms(
            replace(truth, T_base_target=every), observer, len(q), rng, cell.base_posture
        )
        approach = np.deg2rad(cell.config.touch_up.approach_deg)
        done = touch_up(Drive(cell.robot, arms, approach), q, jacobian, loop)
        if not done.touched.all():
            worst = int(np.argmin(done.touched))
            raise UnreachableError(
                f"point {worst % len(found) + 1} of the test plate was not touched up: "
                f"{done.reasons[worst]}",
                hint="the plate test needs 400 mm around the target",
            )
        return cls(done.q.reshape(trials, len(found), -1))

    def worst_error(self, model: CalibrationModel, x: FloatArray) -> FloatArray:
        """Largest error of a distance between two points of one row or column.

        ``model``: the robot that turns joint values into positions. ``x`` (p,) or (T, p): its
        parameters. Returns ``(T, 4)`` [m], for distances of 1, 2, 3 and 4 pitches.
        """
        grid = model.view(self.postures, x).tool_points.reshape(-1, PLATE_POINTS, PLATE_POINTS, 3)
        worst = np.zeros((len(grid), PLATE_POINTS - 1))
        for a, b in combinations(range(PLATE_POINTS), 2):
            apart = b - a
            for first, second in ((grid[:, a], grid[:, b]), (grid[:, :, a], grid[:, :, b])):
                length = np.linalg.norm(first - second, axis=-1)
                error = np.abs(length - apart * PLATE_PITCH_M).max(axis=-1)
                worst[:, apart - 1] = np.maximum(worst[:, apart - 1], error)
        return worst


def points_around(cell: Cell, middle: FloatArray) -> FloatArray:
    """Points of a plate ``(25, 3)`` [m] about a point, in the plane across the tool."""
    return np.asarray(middle + _plate_points() @ cell.robot.fk(cell.base_posture)[:3, :3].T)


def plate_postures(cell: Cell, middle: FloatArray) -> FloatArray:
    """Postures ``(25, n)`` [rad] that touch a plate, the tool held as at the base pose."""
    points = points_around(cell, middle)
    rotation = cell.robot.fk(cell.base_posture)[:3, :3]
    poses = touching_poses(np.broadcast_to(rotation, (len(points), 3, 3)), cell.tool_m, points)
    limits = Checker(cell.robot, margin=cell.margin)  # the plate is thought of, not there
    found = nearest_postures(limits, poses, cell.base_posture)
    if not found.feasible.all():
        worst = int(np.argmin(found.feasible))
        raise UnreachableError(
            f"point {worst + 1} of the test plate cannot be touched: {found.reasons[worst]}",
            hint="the plate test needs 400 mm around the target",
        )
    return found.q


def _plate_points() -> FloatArray:
    """Points of the plate ``(25, 3)`` [m] about its centre, in its own plane z = 0."""
    steps = PLATE_PITCH_M * (np.arange(PLATE_POINTS) - (PLATE_POINTS - 1) / 2.0)
    x, y = np.meshgrid(steps, steps, indexing="ij")
    return np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)


class _Arm(NamedTuple):
    """An arm of the study, and a plate as it touches it, if it can."""

    cell: Cell
    robot: SimulatedRobot
    plate: PlateTest | None


IDENTIFIED_ARM = ", identified arm"
"""Ends the name of a solver that was given the arm as identified, not as the controller has it."""

FEWEST_DRAWS = 10
"""As many data sets a pose set as the paper took."""

Advance = Callable[[str, float], None]


@dataclass(frozen=True)
class Finding:
    """What the draws of one pose set gave for one quantity by one estimator."""

    truth: str
    """``deflecting``: reducers give way under gravity, which constant offsets cannot follow.
    ``rigid``: the model that is identified is the true one."""
    d_w_deg: float
    d_p_deg: float
    d_r_deg: float  # d_w_deg, d_p_deg, d_r_deg: variation of the pose set
    poses: int
    c_g: float
    cond_2_g: float
    estimator: str
    """``touch-up weighted``, ``touch-up unweighted``, ``view line``, ``uncalibrated``, or a solver,
    with ``, identified arm`` where A was computed with the identified offsets."""
    quantity: str
    unit: str
    predicted_sigma: float  # from the covariance, before any draw; NaN where there is none
    spread: float
    spread_low: float
    spread_high: float
    """spread, spread_low, spread_high: standard deviation over the draws with its 95 % interval;
    NaN for errors that have no sign."""
    error_median: float
    error_p95: float  # error_median, error_p95: of the absolute error against the truth
    draws: int
    failed: int  # draws, failed: draws, and how many of them gave no answer


@dataclass(frozen=True)
class AccuracyStudy:
    """All findings, and what could not be studied."""

    findings: tuple[Finding, ...]
    plan: PosePlan  # the loop that the pose sets are from
    draws: int
    seed: int
    notes: tuple[str, ...]

    @property
    def truth(self) -> str:
        """The truth that the cell describes, which is studied first."""
        return self.findings[0].truth

    @property
    def leading_parameter(self) -> str:
        """The parameter whose scatter is shown: the first that is identified."""
        return self.plan.model.names[0]

    def frame(self) -> pd.DataFrame:
        """The findings as a table, a row each."""
        import pandas as pd

        return pd.DataFrame([finding.__dict__ for finding in self.findings])


def accuracy_study(
    cell: Cell, *, draws: int = 50, seed: int = 1, progress: Advance | None = None
) -> AccuracyStudy:
    """Run the study on a cell.

    ``cell``: its threshold plays no part: the loop goes on to the widest angles. ``draws``: noise
    draws a pose set, at least ten. ``progress``: called with what is being done and the part of the
    work that is done. Raises InputError: fewer than ten draws. CalibError: what planning,
    simulation or identification raise.
    """
    if draws < FEWEST_DRAWS:
        raise InputError(
            f"{draws} draws are too few to see a spread",
            hint=f"take at least {FEWEST_DRAWS}",
            name="draws",
            value=draws,
            bound=FEWEST_DRAWS,
        )
    check_not_hand_eye(cell, "the study")
    check_plain(cell, "the study")
    history = plan(to_the_widest(cell))
    sets = improving_rounds(history)
    if not sets:
        raise InputError(
            "no pose set of this cell identifies the parameters", hint=history.advice, name="cell"
        )
    arms, notes = list[_Arm](), dict[str, None]()
    for k, own in enumerate(truths(cell)):
        robot, plate = SimulatedRobot.of(own), None
        try:
            plate = PlateTest.measure(robot, np.random.default_rng([seed, k]), draws)
        except CalibError as error:
            notes[f"plate test left out: {error.message}"] = None
        arms.append(_Arm(own, robot, plate))
    findings: list[Finding] = []
    for done, (turn, postures) in enumerate(sets):
        if progress is not None:
            progress(f"D = {'/'.join(f'{d:g}' for d in turn.variation_deg)} deg", done / len(sets))
        # a seed for each set: a set added or left out changes no other
        rng = np.random.default_rng([seed, len(arms), done])
        for arm in arms:
            for errors in _errors(arm, postures, draws, rng, notes):
                findings.append(_finding(arm.cell, turn, len(postures), *errors))
    return AccuracyStudy(tuple(findings), history, draws, seed, tuple(notes))


def improving_rounds(history: PosePlan) -> list[tuple[Round, FloatArray]]:
    """The rounds that the loop would have returned for some threshold, with their postures."""
    chosen: list[tuple[Round, FloatArray]] = []
    best = float("inf")
    for turn, poses in zip(history.rounds, history.history, strict=True):
        if turn.c_g < best:
            best = turn.c_g
            chosen.append((turn, poses.kept))
    return chosen


def truths(cell: Cell) -> list[Cell]:
    """The cell as it is, and where its robot deflects also with a rigid one.

    The rigid robot tells the noise apart from what constant offsets leave out.
    """
    if not cell.deflects:
        return [cell]
    return [cell, replace(cell, config=cell.config.changed(truth={"deflection": False}))]


def to_the_widest(cell: Cell) -> Cell:
    """The cell with a threshold that no set reaches: the loop goes on to the widest angles."""
    # 1 is the value of C_G for orthogonal columns
    return replace(cell, config=cell.config.changed(plan={"condition_threshold": 1.0}))


ESTIMATORS: tuple[tuple[str, str, bool], ...] = (
    ("touch-up weighted", "touch-up", True),
    ("touch-up unweighted", "touch-up", False),
    ("view line", "view-line", True),
)
"""Identifications of a pose set: name, measurement, and whether rows are weighted by its noise."""


_Errors = tuple[str, str, str, FloatArray, float]
"""Estimator, quantity, unit, errors of the draws ``(T,)``, and what is predicted of them; NaN for
errors that have no sign."""


def _errors(
    arm: _Arm, postures: FloatArray, draws: int, rng: np.random.Generator, notes: dict[str, None]
) -> Iterator[_Errors]:
    """Everything that is done with one pose set on one arm; what cannot be is noted."""
    cell, recorded = arm.cell, {}
    for kind in ("touch-up", "view-line"):
        measurement = noise_of_kind(cell, kind)
        robot = SimulatedRobot.of(cell, measurement)
        touched = robot.touch_up(postures, rng, trials=draws)
        recorded[kind] = robot, cell.model(measurement=measurement), touched
    identified: dict[tuple[str, bool], FloatArray] = {}
    for name, kind, weighted in ESTIMATORS:
        robot, model, touched = recorded[kind]
        try:
            values = identify_batch(model, touched, weighted=weighted)
            covariance = covariance_of(model, postures, weighted=weighted)
        except CalibError as error:
            notes[f"{name} left out: {error.message}"] = None
            continue
        identified[kind, weighted] = values
        truth, sigma = effective_truth(robot, model), np.sqrt(np.diag(covariance))
        for k, (parameter, unit) in enumerate(zip(model.names, model.units, strict=True)):
            label, factor = DISPLAY[unit]
            off = factor * (values[:, k] - truth[k])
            yield name, parameter, label, off, factor * float(sigma[k])
        yield from _on_plate(name, arm.plate, model, values)
    yield from _on_plate("uncalibrated", arm.plate, cell.model(), cell.model().nominal)
    kind = cell.observations[0].kind
    _, model, touched = recorded[kind]
    A, B = arm.robot.camera_poses(touched.postures, rng)
    yield from _of_solvers("", arm.robot, A, B, draws)
    own = identified.get((kind, kind == "view-line" or cell.config.measurement.weighted))
    if own is None:
        notes["AX = ZB with the identified arm left out: it was not identified"] = None
        return
    good = np.isfinite(own).all(axis=1)
    A = model.view(touched.postures[good], own[good]).T_base_tip
    yield from _of_solvers(IDENTIFIED_ARM, arm.robot, A, B[good], draws)


def _on_plate(
    estimator: str, plate: PlateTest | None, model: CalibrationModel, values: FloatArray
) -> Iterator[_Errors]:
    if plate is not None:
        worst = 1e3 * plate.worst_error(model, values)
        for k, column in enumerate(worst.T):
            yield estimator, f"plate distance {100 * (k + 1)} mm", "mm", column, np.nan
        yield estimator, "plate distance worst", "mm", worst.max(axis=1), np.nan


def _of_solvers(
    suffix: str, robot: SimulatedRobot, A: FloatArray, B: FloatArray, draws: int
) -> Iterator[_Errors]:
    X_shown = robot.T_shown_tip @ robot.T_tip_camera
    Z_shown = robot.T_shown_base @ robot.T_base_target
    for solver, found in solve_batch_by_each(A, B, PAPER_METHODS).items():
        for letter, estimate, true in (("X", found.X, X_shown), ("Z", found.Z, Z_shown)):
            error = inverse(true) @ estimate
            angle, shift = np.full((2, draws), np.nan)
            ok = np.flatnonzero(found.ok)
            angle[ok] = np.rad2deg(rotation_angle(error[ok, :3, :3]))
            shift[ok] = 1e3 * np.linalg.norm(error[ok, :3, 3], axis=-1)
            yield solver + suffix, f"{letter} rotation", "deg", angle, np.nan
            yield solver + suffix, f"{letter} translation", "mm", shift, np.nan


def _finding(
    cell: Cell,
    turn: Round,
    poses: int,
    estimator: str,
    quantity: str,
    unit: str,
    error: FloatArray,
    predicted: float,
) -> Finding:
    """Spread and size of errors ``(T,)``; signed ones have a spread about their own mean."""
    good = error[np.isfinite(error)]
    signed = np.isfinite(predicted)
    spread = float(np.std(good, ddof=1)) if signed and len(good) > 1 else np.nan
    median, p95 = np.quantile(np.abs(good), [0.5, 0.95]) if len(good) else (np.nan, np.nan)
    truth = "deflecting" if cell.deflects else "rigid"
    sets = (truth, *turn.variation_deg, poses, turn.c_g, turn.cond_2_g)
    spreads = (spread, *spread_interval(spread, len(good)))
    answers = len(error), len(error) - len(good)
    return Finding(
        *sets, estimator, quantity, unit, predicted, *spreads, float(median), float(p95), *answers
    )


def effective_truth(robot: SimulatedRobot, model: CalibrationModel) -> FloatArray:
    """What an identification of constant offsets is held against, ``(p,)`` [SI].

    Tool point and target in the frames that measurements can show (see
    :attr:`SimulatedRobot.T_shown_base`); offsets including the deflection at the base pose, for an
    arm that deflects has no other constant offset. What is left, a bias that no number of draws
    removes, is the part of the deflection that changes from pose to pose.
    """
    cell = robot.cell
    offsets = robot.joint_errors(cell.base_posture[None])[0]
    shown = {
        "tool": apply(robot.T_shown_tip, robot.tool_m),
        "target": apply(robot.T_shown_base, robot.target_m),
    }
    truth = []
    for name in model.names:
        kind, _, rest = name.partition(".")
        if kind == "zero_offset":
            truth.append(offsets[cell.robot.joint_names.index(rest)])
        else:
            truth.append(shown[kind]["xyz".index(rest[-1])])
    return np.array(truth)


def pick(findings: Sequence[Finding], truth: str, estimator: str, quantity: str) -> list[Finding]:
    """Findings of one kind, by falling C_G."""
    wanted = (truth, estimator, quantity)
    chosen = [f for f in findings if (f.truth, f.estimator, f.quantity) == wanted]
    return sorted(chosen, key=lambda f: -f.c_g)
