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
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import (
    CandidatePoses,
    away_from_singularities,
    candidates_of,
    functions_over_work,
)
from posedesign.candidates.building import with_kept
from posedesign.candidates.limits import dwell_of, limits_of
from posedesign.cell import Cell
from posedesign.cell.reference import reference_of
from posedesign.motion import Router
from posedesign.motion.route import Route
from posedesign.planning.loop import (
    arms_told_by,
    check_base_pose,
    identification_jacobian,
    told_by,
)
from posedesign.planning.optimal.outlook import length_advice
from posedesign.planning.optimal.refinement import (
    SCENARIOS,
    blocks_of_robots,
    draw_parameters,
    refine,
)
from posedesign.planning.optimal.request import (
    BY_REGRESSOR,
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
    Indices,
    Selection,
    evaluate,
    mean_deviation,
    select,
    select_fewest,
    shortened,
)
from posedesign.selection.criterion import over_scenarios
from posedesign.selection.select import STARTS, TOLERANCE

MANY_PARAMETERS = 40
"""Parameters from which a choice is searched from fewer starts, and its bound sharpened less."""

FEWER_STARTS, ROUGHER = 2, 1e-2
"""Those starts, and the part that the bound is sharpened to: of 90 parameters a third start, and a
bound ten times as sharp, gain half a per cent, each in the time of all else."""

ATTEMPTS = 6
"""How often poses are chosen while no clear way leads to some of them."""

MANY_LOST = 0.1
"""Largest share of the chosen poses that is left out alone where no clear way leads to them. Of the
next choice as many would be lost: it is made of postures that a way is known to."""

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


def way_through(router: Router, poses: CandidatePoses) -> Route:
    """The way through poses; only which are stuck, where they are so many that others are chosen.

    An order of poses of which many have no way takes longest to be looked for.
    """
    stuck = Route((), router.stuck(poses.postures))
    return stuck if _are_many(stuck, len(poses)) else router.route(poses.postures, poses.loads)


def _are_many(route: Route, count: int) -> bool:
    """Return True if the lost poses are too many of ``count`` to choose only those anew."""
    return len(route.lost) > MANY_LOST * count


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
        plain = way_through(router, chosen)
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
        route = way_through(router, pool.take(rows))
        if not route.lost:
            break
        why = next(iter(route.lost.values()))
        again = attempt + _are_many(route, few)
        others = without_unreached(router, pool, rows[list(route.lost)], again)
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
        check_base_pose(cell)
        self._take(reference_of(cell), cell.model())
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

    def _take(self, arms: PriorArms, paper: CalibrationModel) -> None:
        """Plan for arms: what they do where they will work, and what the criterion is of.

        Condition numbers and standard deviations wanted of all parameters are of the numbers that
        ``paper`` has, with nothing known beforehand.
        """
        criterion = self._request.criterion.strip().lower()
        of_paper = criterion in {name.lower() for name in BY_REGRESSOR}
        self._arms, self._for = arms, arms
        if (of_paper or self._request.wants_sigma) and paper is not arms.model:
            self._for = PriorArms(paper)
        self._model = self._for.model
        self._functions, self._work_words = functions_over_work(self._cell, arms.model)
        own = self._functions
        if self._for is not arms:
            own = np.zeros((0, 3, self._model.p))  # neither is of the tool point
        self._objective = objective_of(self._request, self._for, own)

    def _take_told(self, postures: FloatArray, of: IntArray) -> None:
        """Plan for what poses of observations ``(N,)`` tell, which are all that there are."""
        paper = told_by(self._cell, self._cell.model_for(of), postures, of)
        self._take(arms_told_by(self._cell, postures, of), paper)

    def run(self) -> OptimalPlan:
        self._advance("looking for postures", 0.0)
        pool = with_kept(self._cell, candidates_of(self._cell), self._kept, self._kept_of)
        told = told_by(self._cell, self._arms.model, pool.postures, pool.of)
        if told is not self._arms.model:
            self._take(PriorArms(told), told)
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
                route = way_through(self._router, chosen)
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
        self._take_told(left.postures, left.of)
        return left

    def _others_than(
        self, pool: CandidatePoses, selection: Selection, route: Route, attempt: int
    ) -> CandidatePoses | None:
        """The pool without poses that no clear way leads to; None where too few would be left."""
        lost = selection.indices[list(route.lost)]
        again = attempt + _are_many(route, len(selection.indices))
        others = without_unreached(self._router, pool, lost, again, len(self._kept))
        if len(others) * self._rows < self._for.must_be_told:
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
        for arms in dict.fromkeys((self._for, self._arms)):
            white = pool.white(arms.model).reshape(-1, arms.model.p)
            told = np.vstack([white, arms.known_rows])
            check_identifiable(told, arms.model.names, arms.model.nuisance)
        count, validation = self._request.count, self._request.validation
        if count is None:
            return
        rows = self._rows
        if count * rows < self._for.must_be_told:
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
                pool,
                blocks,
                criterion,
                count,
                request.budget_s,
                threshold=threshold,
                starts=STARTS if first else 1,
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
        bound: bool = True,
    ) -> Selection:
        """So many poses, or as many as a time is enough for, within the limits of the cell."""
        costs, tolerance = None, TOLERANCE
        if self._model.p > MANY_PARAMETERS:
            starts, tolerance = min(starts, FEWER_STARTS), ROUGHER
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
            tolerance=tolerance,
            bound=bound,
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
        drawn = draw_parameters(self._model, SCENARIOS, rng)
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
            if len(rows) * self._rows < self._for.must_be_told and not dropped:
                self._refuse_few(len(rows), self._rows)
            if len(rows) * self._rows < self._for.must_be_told:
                raise no_clear_way(dropped[-1])
        of_pool = accuracy = self._accuracy(as_they_were)
        if not np.array_equal(chosen.postures, as_they_were.postures):
            accuracy = self._accuracy(chosen)
        if fewest is None and not np.isfinite(accuracy.sigma).all():
            white = self._arms.blocks(chosen.linearise(self._arms.model))
            count, m, p = white.shape
            if count * m < self._arms.must_be_told:
                self._refuse_few(count, m)
            told = np.vstack([white.reshape(-1, p), self._arms.known_rows])
            check_identifiable(told, self._arms.model.names, self._arms.model.nuisance)
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
            indices=self._indices(chosen),
            model=self._model,
            accuracy=accuracy,
            of_pool=of_pool,
            others=() if route is None else self._others(pool, selection, fewest),
            alone={} if route is None or fewest is not None else self._alone(pool),
            box_words=self._work_words,
            arms=self._arms,
            scale=""
            if route is None
            else length_advice(self._cell, self._arms, self._functions, chosen.postures, chosen.of),
            not_checked=self._cell.not_checked,
            setup=(chosen if route is None else chosen.take(route.order)).setup(self._arms.model),
        )
        if route is None or not self._request.validation:
            return plan
        self._advance("poses for validation", 0.9)
        left = pool.take(np.setdiff1d(np.arange(len(pool)), selection.indices))
        return self._with_validation(plan, left, chosen)

    def _indices(self, chosen: CandidatePoses) -> Indices:
        """Indices of poses, of the numbers that the loop of the paper is judged by."""
        told = self._for.model
        if self._for is self._arms:
            told = told_by(self._cell, self._cell.model_for(chosen.of), chosen.postures, chosen.of)
        linear = chosen.linearise(told)
        return evaluate(identification_jacobian(linear), linear.white_jacobian)

    def _with_validation(
        self, plan: OptimalPlan, left: CandidatePoses, chosen: CandidatePoses
    ) -> OptimalPlan:
        """The plan with poses for validation out of what is left, and the way through them."""
        count, why = self._request.validation, self._why
        arms = self._arms
        told = arms.blocks(chosen.linearise(arms.model)).reshape(-1, arms.model.p)
        known = np.vstack([np.sqrt(PART_OF_PLAN) * told, arms.known_rows])

        def choose(pool: CandidatePoses, few: int) -> IntArray:
            blocks = pool.blocks(arms.model, lambda linear: shortened(arms.blocks(linear)))
            criterion = mean_deviation(self._functions)
            return select(blocks, few, criterion, known=known, starts=1, bound=False).indices

        route, dropped = None, [why] * count
        if len(left):
            left, rows, route, dropped = chosen_with_way(self._router, left, count, choose, why)
            left = left.take(rows)
        poses = as_pose_set(left).and_dropped(dropped)
        return replace(plan, validation=replace(poses, letter="V"), validation_route=route)

    def _refuse_few(self, count: int, m: int) -> None:
        p = self._for.must_be_told
        raise InputError(
            f"{count} poses give {count * m} equations for {p} parameters",
            hint=f"ask for {-(-p // m)} poses or more",
            name="poses",
        )

    def _accuracy(self, chosen: CandidatePoses, *, over_arms: bool = True) -> Accuracy:
        own = None if self._for is self._arms else chosen.linearise(self._model)
        linear = chosen.linearise(self._arms.model)
        return accuracy_of(
            self._objective, self._arms, self._functions, linear, own, over_arms=over_arms
        )

    def _others(
        self, pool: CandidatePoses, selection: Selection, fewest: Fewest | None
    ) -> tuple[Accuracy, ...]:
        """Accuracy of a pose fewer and of one more, or of less and of more time.

        Poses are left out of the choice, and taken in besides; where limits or the time decide what
        goes together, the choice is made anew.
        """
        found: list[Accuracy] = []
        beside, pool_section = self._request.beside, self._cell.config.pool
        if not beside:
            return ()
        blocks, criterion = self._blocks_and_criterion(pool)
        anew = self._request.budget_s is not None or pool_section.limit
        known, chosen = self._objective.known, selection.indices
        for sign in (-1, 1):
            count = selection.count + sign * beside
            least = max(-(-self._for.must_be_told // self._rows), len(self._kept))
            try:
                if anew or pool_section.repeats != 1:
                    budget_s = self._request.budget_s
                    time_s = None if budget_s is None else budget_s + sign * BESIDE_S
                    asked = None if budget_s is not None else count
                    rows = self._select(pool, blocks, criterion, asked, time_s, starts=1).indices
                elif fewest is not None and fewest.fewer is not None and sign < 0:
                    rows = fewest.fewer.indices
                elif not least <= count <= len(pool):
                    continue
                elif sign < 0:
                    kept, few = list(range(len(self._kept))), blocks[chosen]
                    left = select(few, count, criterion, known=known, keep=kept, bound=False)
                    rows = chosen[left.indices]
                else:
                    kept = chosen.tolist()
                    rows = select(
                        blocks, count, criterion, "greedy", known=known, keep=kept, bound=False
                    ).indices
            except CalibError:  # limits that as many poses cannot keep, or too little is told
                continue
            found.append(self._accuracy(pool.take(rows), over_arms=False))
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
                alone._take_told(part.postures, part.of)
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
