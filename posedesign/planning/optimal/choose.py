"""From a request to poses: pool, choice, refinement, way, and what they promise.

Poses of validation are kept out of the fit, to test what comes out of it. They are chosen like the
others, from what is left of the pool, by how much they would tell of the tool point over the task
box on top of a little of what the plan tells: what goes wrong there shows in them.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import replace

import numpy as np

from calib.errors import CalibError, InputError
from calib.identification import check_identifiable
from calib.model import CalibrationModel
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import (
    CandidatePoses,
    away_from_singularities,
    candidates_of,
    functions_over_box,
)
from posedesign.candidates.building import with_kept
from posedesign.candidates.limits import dwell_of, limits_of
from posedesign.cell import Cell
from posedesign.motion import Router
from posedesign.motion.route import Route
from posedesign.planning.loop import check_base_pose, identification_jacobian, told_by
from posedesign.planning.optimal.refinement import (
    SCENARIOS,
    blocks_of_robots,
    draw_parameters,
    refine,
    robustness,
)
from posedesign.planning.optimal.request import (
    Accuracy,
    Request,
    accuracy_of,
    objective_of,
)
from posedesign.planning.optimal.result import OptimalPlan
from posedesign.planning.pose_plan import PoseSet
from posedesign.selection import (
    Criterion,
    Fewest,
    Selection,
    evaluate,
    mean_deviation,
    select,
    select_fewest,
)
from posedesign.selection.criterion import over_scenarios
from posedesign.selection.select import STARTS

ATTEMPTS = 6
"""How often poses are chosen while no clear way leads to some of them."""

TURNED_BACK = 3
"""How often those of the refined poses that no clear way leads to are turned back to what they
were, before all are."""

MOST_ALONE = 4
"""Targets of which it is said what each is worth by itself."""

BESIDE_S = 120.0
"""Of a plan for a given time: what as much more, and less, would buy."""


Advance = Callable[[str, float], None]

PART_OF_PLAN = 0.01
"""Part of the plan's information that is taken for known. Without any, fewer validation poses than
parameters could not be judged; with all, nothing that they tell would count."""


def refined_with_way(
    router: Router,
    chosen: CandidatePoses,
    refine: Callable[[CandidatePoses], CandidatePoses],
) -> tuple[CandidatePoses, Route]:
    """Poses refined as far as a clear way leads to them then, and the way.

    Those that were given come back where no way leads through them either; the route then says to
    which.
    """
    if not router.reached(chosen.postures).all():  # in doubt; and refinement takes long
        plain = router.route(chosen.postures, chosen.loads)
        if plain.lost:
            return chosen, plain
    refined = refine(chosen)
    route = router.route(refined.postures, chosen.loads)
    if not route.lost:
        return refined, route
    plain = router.route(chosen.postures, chosen.loads)
    if plain.lost:
        return chosen, plain
    q, R = refined.postures.copy(), refined.orientations.copy()
    for _ in range(TURNED_BACK):
        back = list(route.lost)
        q[back], R[back] = chosen.postures[back], chosen.orientations[back]
        route = router.route(q, chosen.loads)
        if not route.lost:
            return replace(refined, postures=q, orientations=R), route
    return chosen, plain


def without_unreached(
    router: Router, pool: CandidatePoses, lost: IntArray, attempt: int, kept: int = 0
) -> CandidatePoses:
    """The pool without postures that no clear way leads to, and those that may share their fate.

    At first those alone; then all but such as :meth:`.Router.reached` knows a way to: most straight
    from the base posture, over which there is a way from each to each.

    ``lost``: rows of the pool. ``attempt``: how often others have been left out before. ``kept``:
    how many of the first postures stay in any case, if they are not lost.
    """
    keep = router.reached(pool.postures) if attempt else np.ones(len(pool), dtype=bool)
    keep[:kept] = True
    keep[lost] = False
    return pool.take(keep)


def reached_of(router: Router, poses: CandidatePoses, route: Route) -> tuple[IntArray, Route]:
    """Rows of poses that a clear way leads to, and the route through them."""
    rows = np.arange(len(poses))
    while route.lost:
        rows = np.delete(rows, list(route.lost))
        route = router.route(poses.postures[rows], poses.loads[rows])
    return rows, route


def chosen_with_way(
    router: Router,
    pool: CandidatePoses,
    count: int,
    choose: Callable[[CandidatePoses, int], IntArray],
    why: str = "",
) -> tuple[CandidatePoses, IntArray, Route, list[str]]:
    """Choose until clear ways lead to all, and leave out what none leads to.

    ``choose``: rows of so many of a pool. ``why``: of poses that this pool is short of. Returns the
    pool that is left, the rows that are reached, the route through them, and why others are not.
    """
    for attempt in range(ATTEMPTS):
        few = min(count, len(pool)) if attempt or why else count
        rows = choose(pool, few)
        route = router.route(pool.postures[rows], pool.loads[rows])
        if not route.lost:
            break
        why = next(iter(route.lost.values()))
        others = without_unreached(router, pool, rows[list(route.lost)], attempt)
        if attempt == ATTEMPTS - 1 or not len(others):
            break
        pool = others
    dropped = [*route.lost.values(), *[why] * (count - few)]
    reached, route = reached_of(router, pool.take(rows), route)
    return pool, rows[reached], route, dropped


def no_clear_way(why: str) -> InputError:
    """The error where poses are left that no clear way leads to."""
    return InputError(
        f"no clear way leads to some of the poses: {why}",
        hint="move the base posture to the side of the target that has room, or what is in the way",
        name="base_pose",
    )


def silent(what: str, part: float) -> None:
    """No progress is shown."""


class Planning:
    """One planning run."""

    def __init__(
        self,
        cell: Cell,
        request: Request,
        advance: Advance,
        keep: FloatArray,
        keep_of: IntArray,
    ) -> None:
        self._cell, self._request, self._advance = cell, request, advance
        self._kept, self._kept_of = keep, keep_of
        self._why, self._dropped, self._unused = "", list[str](), list[str]()
        # what is wrong with it is wrong with the task box about it, too
        check_base_pose(cell, of_pool=True)
        self._take(cell.model())
        self._rows = cell.rows(self._model)
        if self._objective.weighted and not cell.config.measurement.weighted:
            raise InputError(
                "what an unweighted estimate needs cannot be chosen pose by pose",
                hint="set measurement.weighted = true",
                name="measurement.weighted",
            )
        if cell.sees_board and request.robust != "none":
            raise InputError(
                "robots that are not as described are tried by touching, and this cell takes "
                "pictures of a board",
                hint="leave robust out: measurement.arm_three_sigma_mm and _deg say what the arm "
                "is off",
                name="robust",
                value=request.robust,
            )
        self._cell = away_from_singularities(cell)
        self._router = Router.of_cell(cell)

    def _take(self, model: CalibrationModel) -> None:
        """Plan for a model: what of it counts over the task box."""
        self._model = model
        self._box, self._box_words = functions_over_box(self._cell, model)
        self._objective = objective_of(self._request, model, self._box)

    def run(self) -> OptimalPlan:
        self._advance("looking for postures", 0.0)
        pool = with_kept(self._cell, candidates_of(self._cell), self._kept, self._kept_of)
        told = told_by(self._cell, self._model, pool.postures, pool.of)
        if told is not self._model:
            self._take(told)
        self._check_pool(pool)
        whole = len(pool)
        for attempt in range(ATTEMPTS):
            self._advance("choosing poses", 0.2 + 0.6 * attempt / ATTEMPTS)
            selection, fewest = self._choose(pool, first=attempt == 0)
            while not np.isfinite(selection.value) and fewest is None:
                others = self._without_a_target(pool, selection)
                if others is None:
                    break
                pool, whole = others, whole - len(pool) + len(others)
                selection, fewest = self._choose(pool, first=attempt == 0)
            if fewest is not None and not fewest.reached:
                return self._result(pool, selection, fewest, pool.take(selection.indices), None)
            chosen = pool.take(selection.indices)
            if self._request.refine:
                self._advance("refining", 0.6)
                chosen, route = refined_with_way(self._router, chosen, self._refined)
            else:
                route = self._router.route(chosen.postures, chosen.loads)
            if not route.lost or attempt == ATTEMPTS - 1:
                break
            others = self._others_than(pool, selection, route, attempt)
            if others is None:
                break
            pool = others
        plan = self._result(pool, selection, fewest, chosen, route)
        return replace(
            plan,
            left_out=whole - len(pool),
            left_out_for=self._why,
            unused=tuple(self._unused),
        )

    def _without_a_target(
        self, pool: CandidatePoses, selection: Selection
    ) -> CandidatePoses | None:
        """The pool without the target that fewest of the chosen poses are of; None for the last.

        Where a choice tells too little of one target to place it, its poses are better spent on the
        others: what is to be told is of the arm.
        """
        if pool.cell is None:
            return None
        of = pool.names_of_targets
        names, counts = np.unique(of, return_inverse=True)
        if len(names) == 1 or len(self._kept):
            return None
        fewest = int(np.argmin(np.bincount(counts[selection.indices], minlength=len(names))))
        self._unused.append(str(names[fewest]))
        left = pool.take(counts != fewest)
        self._take(told_by(self._cell, self._cell.model_for(left.of), left.postures, left.of))
        return left

    def _others_than(
        self, pool: CandidatePoses, selection: Selection, route: Route, attempt: int
    ) -> CandidatePoses | None:
        """The pool without poses that no clear way leads to; None where too few would be left."""
        lost = selection.indices[list(route.lost)]
        others = without_unreached(self._router, pool, lost, attempt, len(self._kept))
        if len(others) * self._rows < self._model.p:
            return None
        self._why = next(iter(route.lost.values()))
        of_own = [i for i in route.lost if i < len(self._kept)]
        self._dropped += [f"was to be kept: {route.lost[i]}" for i in of_own]
        self._kept = np.delete(self._kept, of_own, axis=0)
        self._kept_of = np.delete(self._kept_of, of_own)
        return others

    def _refined(self, chosen: CandidatePoses) -> CandidatePoses:
        """Those that are kept are the first of the pool, and so of the choice."""
        fixed = len(self._kept)
        return refine(self._cell, self._model, self._objective, chosen, fixed=fixed)

    def _check_pool(self, pool: CandidatePoses) -> None:
        """Refuse what this pool cannot give, before anything is chosen."""
        white = pool.white(self._model)
        names, nuisance = self._model.names, self._model.nuisance
        told = np.vstack([white.reshape(-1, self._model.p), self._model.known_rows])
        check_identifiable(told, names, nuisance)
        count, validation = self._request.count, self._request.validation
        if count is None:
            return
        rows = self._rows
        if count * rows < self._model.p:
            self._refuse_few(count, rows)
        if validation and count + validation > len(pool):
            raise InputError(
                f"{count} poses and {validation} for validation of {len(pool)} candidates",
                hint="ask for fewer, or raise pool.candidates",
                name="validation",
            )

    def _choose(self, pool: CandidatePoses, *, first: bool) -> tuple[Selection, Fewest | None]:
        """The best of the pool; what the whole of it cannot give is refused at the first choice."""
        objective, request = self._objective, self._request
        blocks, criterion = self._blocks_and_criterion(pool)
        if request.count is None and request.budget_s is None:
            if self._cell.config.pool.limit or self._cell.config.pool.repeats != 1:
                raise InputError(
                    "the fewest poses are looked for without limits and repeats",
                    hint="give a number of poses, or minutes; or leave out pool.limit and "
                    "pool.repeats",
                    name="pool.limit",
                )
            limit = 1.0 if objective.limit is None else objective.limit
            fewest = select_fewest(
                blocks,
                criterion,
                limit,
                known=objective.known,
                names=self._model.names,
                keep=range(len(self._kept)),
            )
            return fewest.selection, fewest
        count = request.count
        if count is not None and not first:
            count = min(count, len(pool))
        try:
            threshold = objective.limit if first else None
            found = self._select(
                pool, blocks, criterion, count, request.budget_s, threshold=threshold
            )
        except InputError as error:
            raise self._in_own_words(error) from error
        return found, None

    def _select(
        self,
        pool: CandidatePoses,
        blocks: FloatArray,
        criterion: Criterion,
        count: int | None,
        budget_s: float | None,
        *,
        threshold: float | None = None,
        starts: int = STARTS,
    ) -> Selection:
        """So many poses, or as many as a time is enough for, within the limits of the cell."""
        costs = None
        if budget_s is not None:
            costs = dwell_of(self._cell, pool) + self._request.moving_s
        return select(
            blocks,
            count,
            criterion,
            self._request.method,
            costs=costs,
            budget=budget_s,
            constraints=limits_of(self._cell, pool),
            repeats=self._cell.config.pool.repeats,
            known=self._objective.known,
            names=self._model.names,
            threshold=threshold,
            keep=range(len(self._kept)),
            starts=starts,
        )

    def _in_own_words(self, error: InputError) -> InputError:
        """A refused threshold of deviations: in what the user gave, and not in parts of it."""
        if error.name != "threshold" or not self._request.wants_sigma:
            return error
        return InputError(
            f"no {self._request.count} poses of this pool reach the deviations wanted: those of "
            f"the best are proven not to be below {error.bound:.4g} times them",
            hint="take more poses (`poses` auto: as many as it takes), or a wider pool",
            name="threshold",
            value=error.value,
            bound=error.bound,
        )

    def _blocks_and_criterion(self, pool: CandidatePoses) -> tuple[FloatArray, Criterion]:
        """Of the robot as described, or of several as it may be."""
        objective, robust = self._objective, self._request.robust
        if robust == "none":
            return objective.of_pool(self._model, pool), objective.criterion
        rng = np.random.default_rng(SCENARIOS)
        drawn = draw_parameters(self._cell, self._model, SCENARIOS, rng)
        blocks = blocks_of_robots(self._model, objective, pool, drawn)
        stacked = np.moveaxis(blocks, 0, 1).reshape(len(pool), -1, self._model.p)
        return stacked, over_scenarios(objective.criterion, SCENARIOS, worst=robust == "worst")

    def _result(
        self,
        pool: CandidatePoses,
        selection: Selection,
        fewest: Fewest | None,
        chosen: CandidatePoses,
        route: Route | None,
    ) -> OptimalPlan:
        as_they_were, dropped = pool.take(selection.indices), list(self._dropped)
        if route is not None:
            missing = (self._request.count or len(chosen)) - len(chosen)
            dropped += [*route.lost.values(), *[self._why] * missing]
            rows, route = reached_of(self._router, chosen, route)
            chosen, as_they_were = chosen.take(rows), as_they_were.take(rows)
            route = replace(route, dwell_s=dwell_of(self._cell, chosen))
            if len(rows) * self._rows < self._model.p and not dropped:
                self._refuse_few(len(rows), self._rows)
            if len(rows) * self._rows < self._model.p:
                raise no_clear_way(dropped[-1])
        linear = chosen.linearise(self._model)
        blocks, white = identification_jacobian(linear), linear.white_jacobian
        of_pool = accuracy = self._accuracy(as_they_were)
        if not np.array_equal(chosen.postures, as_they_were.postures):
            accuracy = self._accuracy(chosen)
        if fewest is None and not np.isfinite(accuracy.sigma).all():
            count, m, p = white.shape
            if count * m < p:
                self._refuse_few(count, m)
            told = np.vstack([white.reshape(-1, p), self._model.known_rows])
            check_identifiable(told, self._model.names, self._model.nuisance)
        self._advance("one pose more or fewer", 0.8)
        plan = OptimalPlan(
            request=self._request,
            objective=self._objective,
            selection=selection,
            fewest=fewest,
            poses=as_pose_set(chosen).and_dropped(dropped),
            route=route,
            pool_words=pool.summary(),
            pool_size=len(pool),
            tried=pool.tried,
            indices=evaluate(blocks, white),
            model=self._model,
            accuracy=accuracy,
            of_pool=of_pool,
            others=() if route is None else self._others(pool, selection, fewest),
            alone={} if route is None or fewest is not None else self._alone(pool),
            box_words=self._box_words,
            robustness=None
            if route is None or self._cell.is_hand_eye
            else robustness(self._cell, self._model, self._objective, chosen),
            not_checked=self._cell.not_checked,
            setup=(chosen if route is None else chosen.take(route.order)).setup(self._model),
        )
        if route is None or not self._request.validation:
            return plan
        self._advance("poses for validation", 0.9)
        left = pool.take(np.setdiff1d(np.arange(len(pool)), selection.indices))
        return self._with_validation(plan, left, white)

    def _with_validation(
        self, plan: OptimalPlan, left: CandidatePoses, white: FloatArray
    ) -> OptimalPlan:
        """The plan with poses for validation out of what is left, and the way through them."""
        count, why = self._request.validation, self._why
        known = np.sqrt(PART_OF_PLAN) * white.reshape(-1, self._model.p)

        def choose(pool: CandidatePoses, few: int) -> IntArray:
            told, criterion = pool.white(self._model), mean_deviation(self._box)
            return select(told, few, criterion, known=known, starts=1, bound=False).indices

        route, dropped = None, [why] * count
        if len(left):
            left, rows, route, dropped = chosen_with_way(self._router, left, count, choose, why)
            left = left.take(rows)
        poses = as_pose_set(left).and_dropped(dropped)
        return replace(plan, validation=replace(poses, letter="V"), validation_route=route)

    def _refuse_few(self, count: int, m: int) -> None:
        p = self._model.p
        raise InputError(
            f"{count} poses give {count * m} equations for {p} parameters",
            hint=f"ask for {-(-p // m)} poses or more",
            name="poses",
        )

    def _accuracy(self, chosen: CandidatePoses) -> Accuracy:
        return accuracy_of(self._model, self._objective, self._box, chosen.linearise(self._model))

    def _others(
        self, pool: CandidatePoses, selection: Selection, fewest: Fewest | None
    ) -> tuple[Accuracy, ...]:
        """What the best choices of a pose fewer and one more promise, or of less and more time."""
        found = []
        blocks, criterion = self._blocks_and_criterion(pool)
        beside, budget_s = self._request.beside, self._request.budget_s
        for sign in (-1, 1) if beside else ():
            count, time_s = None, None
            if budget_s is None:
                count = selection.count + sign * beside
                if not max(-(-self._model.p // self._rows), len(self._kept)) <= count <= len(pool):
                    continue
            else:
                time_s = budget_s + sign * BESIDE_S
            if fewest is not None and fewest.fewer is not None and count == fewest.fewer.count:
                other = fewest.fewer
            else:
                try:
                    other = self._select(pool, blocks, criterion, count, time_s, starts=1)
                except InputError:  # limits that as many poses cannot keep, or no time left
                    continue
            found.append(self._accuracy(pool.take(other.indices)))
        return tuple(found)

    def _alone(self, pool: CandidatePoses) -> dict[str, float]:
        """Error of the tool point [m] if each target were the only one, for as much, by its name.

        Infinite where it could not tell everything by itself.
        """
        if pool.cell is None or not self._request.beside:
            return {}
        of = pool.names_of_targets
        names = list(dict.fromkeys(of.tolist()))
        if not 1 < len(names) <= MOST_ALONE:
            return {}
        found = {}
        for name in names:
            part, alone = pool.take(of == name), copy(self)
            try:
                model = self._cell.model_for(part.of)
                alone._take(told_by(self._cell, model, part.postures, part.of))
                blocks, criterion = alone._blocks_and_criterion(part)
                request = self._request
                chosen = alone._select(
                    part, blocks, criterion, request.count, request.budget_s, starts=1
                )
                found[name] = alone._accuracy(part.take(chosen.indices)).tcp_m
            except CalibError:  # too few poses, or limits that this one cannot keep
                found[name] = np.inf
        return found


def as_pose_set(pool: CandidatePoses) -> PoseSet:
    """The postures of a pool as poses of a plan."""
    return PoseSet.of_chosen(pool.postures, pool.orientations, pool.labels)
