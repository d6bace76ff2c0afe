"""From a wish to poses: pool, choice, refinement, way, and what they promise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.errors import InputError, NotIdentifiableError
from calib.identification import check_identifiable
from calib.model import CalibrationModel
from calib.se3 import FloatArray
from posedesign.cell import Cell
from posedesign.indices import evaluate
from posedesign.optimal.goal import Goal, goal_of
from posedesign.optimal.pool_of_cell import functions_over_box, pool_of, with_kept
from posedesign.optimal.refinement import refine
from posedesign.optimal.result import Accuracy, OptimalPlan
from posedesign.optimal.robust import (
    SCENARIOS,
    blocks_of_robots,
    draw_parameters,
    robustness,
)
from posedesign.optimal.validation import choose_validation
from posedesign.optimal.wish import Wish
from posedesign.planner import check_base_pose, regressor
from posedesign.pools import Pool
from posedesign.pose_plan import PoseSet
from posedesign.route import Route, Router
from posedesign.selection import Criterion, Fewest, Selection, select, select_fewest
from posedesign.selection.criteria.scenarios import OverScenarios

ATTEMPTS = 10
"""How often poses that no clear way leads to are left out of the pool and others are chosen."""

Advance = Callable[[str, float], None]


def _silent(what: str, part: float) -> None:
    """No progress is shown."""


def plan_optimal(
    cell: Cell,
    wish: Wish,
    advance: Advance = _silent,
    *,
    keep: FloatArray | None = None,
) -> OptimalPlan:
    """Choose the best poses of the cell's pool, or the fewest that reach what is wanted.

    Parameters
    ----------
    cell : Cell
    wish : Wish
    advance : callable, optional
        Called with what is being done and the part of all work that is done.
    keep : ndarray (k, n), optional
        Postures [rad] that are to be among the chosen, as they are; they touch the target.

    Raises
    ------
    InputError
        A wish that cannot be met by this cell, such as a threshold that no choice reaches.
    UnreachableError
        The base pose itself cannot be taken, or no candidate.
    NotIdentifiableError
        The whole pool cannot identify some of the parameters, which are named.
    """
    kept = np.zeros((0, cell.robot.n)) if keep is None else np.asarray(keep, dtype=float)
    return _Planning(cell, wish, advance, kept).run()


def plan_fewest(
    cell: Cell,
    sigma_m: float | None = None,
    sigma_rad: float | None = None,
    advance: Advance = _silent,
) -> OptimalPlan:
    """Choose the fewest poses whose predicted standard deviations are as small as wanted.

    Parameters
    ----------
    cell : Cell
    sigma_m, sigma_rad : float, optional
        Largest standard deviation of each parameter that is a length [m], and of each that is an
        angle [rad]; at least one of the two.
    advance : callable, optional

    Raises
    ------
    InputError
        Nothing is wanted, or the cell's estimate is not weighted by its noise.
    """
    if sigma_m is None and sigma_rad is None:
        raise InputError(
            "no accuracy is wanted of anything that is identified",
            hint="give --wanted-sigma-mm, --wanted-sigma-deg, or both",
            name="wanted",
        )
    wish = Wish(count=None, criterion="sigma", sigma_m=sigma_m, sigma_rad=sigma_rad)
    return plan_optimal(cell, wish, advance)


class _Planning:
    """One planning run."""

    def __init__(self, cell: Cell, wish: Wish, advance: Advance, keep: FloatArray) -> None:
        self._cell, self._wish, self._advance = cell, wish, advance
        self._kept = keep
        self._model = cell.model()
        self._box, self._box_words = functions_over_box(cell, self._model)
        self._goal = goal_of(wish, self._model, self._box)
        if self._goal.weighted and not cell.config.measurement.weighted:
            raise InputError(
                "what an unweighted estimate needs cannot be chosen pose by pose",
                hint="set measurement.weighted = true",
                name="measurement.weighted",
            )
        check_base_pose(cell)
        self._router = Router.of_cell(cell)

    def run(self) -> OptimalPlan:
        """Pool, choice, refinement, way."""
        self._advance("looking for postures", 0.0)
        pool = with_kept(self._cell, pool_of(self._cell), self._kept)
        self._check_seen(pool)
        why = ""
        for attempt in range(ATTEMPTS):
            self._advance("choosing poses", 0.2 + 0.6 * attempt / ATTEMPTS)
            selection, fewest = self._choose(pool)
            if fewest is not None and not fewest.reached:
                return self._result(pool, selection, fewest, pool.take(selection.indices), None)
            chosen = pool.take(selection.indices)
            if self._wish.refine:
                self._advance("refining", 0.6)
                fixed = len(self._kept)  # they are the first of the pool, and so of the choice
                chosen = refine(self._cell, self._model, self._goal, chosen, fixed=fixed)
            route = self._router.route(chosen.postures)
            if not route.lost:
                return self._result(pool, selection, fewest, chosen, route)
            why = next(iter(route.lost.values()))
            if min(route.lost) < len(self._kept):
                break
            kept = np.ones(len(pool), dtype=bool)
            kept[selection.indices[list(route.lost)]] = False
            pool = pool.take(kept)
        raise InputError(
            f"no clear way leads to some of the poses: {why}",
            hint="move the base posture to the side of the target that has room, or what is in "
            "the way",
            name="base_pose",
        )

    def _check_seen(self, pool: Pool) -> None:
        white = pool.white(self._model)
        names, nuisance = self._model.names, self._model.nuisance
        check_identifiable(white.reshape(-1, self._model.p), names, nuisance)

    def _choose(self, pool: Pool) -> tuple[Selection, Fewest | None]:
        goal, wish = self._goal, self._wish
        blocks, criterion = self._blocks_and_criterion(pool)
        if wish.count is None:
            limit = 1.0 if goal.limit is None else goal.limit
            fewest = select_fewest(
                blocks,
                criterion,
                limit,
                names=self._model.names,
                keep=range(len(self._kept)),
            )
            return fewest.selection, fewest
        found = select(
            blocks,
            wish.count,
            criterion,
            wish.method,
            names=self._model.names,
            threshold=goal.limit,
            keep=range(len(self._kept)),
        )
        return found, None

    def _blocks_and_criterion(self, pool: Pool) -> tuple[FloatArray, Criterion]:
        """Of the robot as described, or of several as it may be."""
        goal, robust = self._goal, self._wish.robust
        if robust == "none":
            return goal.blocks(pool.linearise(self._model)), goal.criterion
        rng = np.random.default_rng(SCENARIOS)
        drawn = draw_parameters(self._cell, self._model, SCENARIOS, rng)
        blocks = blocks_of_robots(self._model, goal, pool, drawn)
        stacked = np.moveaxis(blocks, 0, 1).reshape(len(pool), -1, self._model.p)
        return stacked, OverScenarios(goal.criterion, SCENARIOS, worst=robust == "worst")

    def _result(
        self,
        pool: Pool,
        selection: Selection,
        fewest: Fewest | None,
        chosen: Pool,
        route: Route | None,
    ) -> OptimalPlan:
        linear = chosen.linearise(self._model)
        blocks, white = regressor(linear), linear.white_jacobian
        of_pool = self._accuracy(pool.take(selection.indices))
        accuracy = self._accuracy(chosen) if self._wish.refine else of_pool
        if fewest is None and not np.isfinite(accuracy.sigma).all():
            self._refuse_too_few(white)
        self._advance("one pose more or fewer", 0.8)
        plan = OptimalPlan(
            wish=self._wish,
            goal=self._goal,
            selection=selection,
            fewest=fewest,
            poses=as_pose_set(chosen),
            route=route,
            pool_words=pool.summary(),
            pool_size=len(pool),
            tried=pool.tried,
            indices=evaluate(blocks, white),
            model=self._model,
            accuracy=accuracy,
            of_pool=of_pool,
            others=() if route is None else self._others(pool, selection, fewest),
            box_words=self._box_words,
            robustness=None
            if route is None or self._cell.is_hand_eye
            else robustness(self._cell, self._model, self._goal, chosen),
        )
        if route is None or not self._wish.validation:
            return plan
        self._advance("poses for validation", 0.9)
        found = choose_validation(self._model, pool, selection, self._box, self._wish.validation)
        found_route = self._router.route(found.postures)
        return replace(plan, validation=as_pose_set(found), validation_route=found_route)

    def _refuse_too_few(self, white: FloatArray) -> None:
        """Say which parameters the chosen poses leave open."""
        count, m, p = white.shape
        if count * m < p:
            raise InputError(
                f"{count} poses give {count * m} equations for {p} parameters",
                hint="ask for more poses",
                name="poses",
            )
        check_identifiable(white.reshape(-1, p), self._model.names, self._model.nuisance)

    def _accuracy(self, chosen: Pool) -> Accuracy:
        """What poses promise, from their blocks."""
        return accuracy_of(self._model, self._goal, self._box, chosen)

    def _others(
        self, pool: Pool, selection: Selection, fewest: Fewest | None
    ) -> tuple[Accuracy, ...]:
        """What the best choices of one pose fewer and one more promise."""
        found = []
        blocks, criterion = self._blocks_and_criterion(pool)
        for count in (selection.count - 1, selection.count + 1):
            if not max(1, len(self._kept)) <= count <= len(pool):
                continue
            if fewest is not None and fewest.fewer is not None and count == fewest.fewer.count:
                other = fewest.fewer
            else:
                keep = range(len(self._kept))
                other = select(blocks, count, criterion, self._wish.method, starts=1, keep=keep)
            found.append(self._accuracy(pool.take(other.indices)))
        return tuple(found)


def accuracy_of(model: CalibrationModel, goal: Goal, box: FloatArray, chosen: Pool) -> Accuracy:
    """What postures promise: parameters, criterion, tool point over the box ``(K, 3, p)``."""
    linear = chosen.linearise(model)
    covariance = _covariance(linear.white_jacobian, model)
    if covariance is None:
        unknown = np.full(model.p, np.inf)
        return Accuracy(len(chosen), goal.criterion.shown(np.inf), unknown, np.inf, np.inf)
    squares = np.einsum("krp,pq,krq->k", box, covariance, box, optimize=True)
    return Accuracy(
        len(chosen),
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


def as_pose_set(pool: Pool) -> PoseSet:
    """The postures of a pool as poses of a plan."""
    return PoseSet.of_chosen(pool.postures, pool.orientations)
