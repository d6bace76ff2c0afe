"""Plans of the best poses: so many, the fewest that will do, or as many as there is time for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from calib.errors import InputError
from calib.one_thread import one_blas_thread
from calib.se3 import FloatArray, IntArray
from posedesign.cell import Cell
from posedesign.planning.optimal.choose import BESIDE_S, Advance, Planning, silent
from posedesign.planning.optimal.request import BY_REGRESSOR, MOST_POSES, Request
from posedesign.planning.optimal.result import OptimalPlan
from posedesign.planning.tellable import check_tellable

MOVING_S = 3.0
"""First guess of what a move takes, where the number of poses is decided by the time."""

TRIED_COUNTS = 6
"""Numbers of poses that are planned with, until one more would take too long; three are seen."""


@one_blas_thread
def plan_optimal(
    cell: Cell,
    request: Request,
    advance: Advance = silent,
    *,
    keep: FloatArray | None = None,
    keep_of: IntArray | None = None,
) -> OptimalPlan:
    """Choose the best poses of the cell's pool, or the fewest that reach what is wanted.

    Parameters
    ----------
    advance : callable, optional
        Called with what is being done and the part of all work that is done.
    keep : ndarray (k, n), optional
        Postures [rad] that are to be among the chosen, as they are; they touch the target.
    keep_of : ndarray (k,), optional
        Index of the cell's observation that each of them is of; the first by default.

    Raises
    ------
    InputError
        A request that cannot be met by this cell, such as a threshold that no choice reaches.
    UnreachableError
        The base pose itself cannot be taken, or no candidate.
    NotIdentifiableError
        The whole pool cannot identify some of the parameters, which are named.
    """
    of_paper = request.criterion.strip().lower() in {name.lower() for name in BY_REGRESSOR}
    if cell.config.parameters.planned is not None or of_paper or request.wants_sigma:
        check_tellable(cell)  # elsewhere priors hold what no pose tells
    kept = np.zeros((0, cell.robot.n)) if keep is None else np.asarray(keep, dtype=float)
    of = np.zeros(len(kept), dtype=np.intp) if keep_of is None else keep_of

    def planned(**changes: object) -> OptimalPlan:
        asked = replace(request, time_s=None, **changes)  # type: ignore[arg-type]
        plan = Planning(cell, asked, advance, kept, of).run()
        return replace(plan, request=replace(asked, time_s=request.time_s))

    if request.time_s is None:
        return planned()
    if _stands_differ(cell):
        return _plan_in_budget(cell, request.time_s, planned)
    return _plan_in_time(cell, request, request.time_s, len(kept), planned)


Plan = Callable[..., OptimalPlan]
"""Plans with changes of a request."""


def _plan_in_time(
    cell: Cell, request: Request, time_s: float, kept: int, planned: Plan
) -> OptimalPlan:
    """The best of as many poses as a round has time for, by the route through them.

    The number is looked for by the time that a pose takes in the plans before. It is compared with
    what two minutes more, and two less, would buy.
    """
    model = cell.model()
    least = max(-(-model.p // cell.rows(model)), kept, 1)
    fits, too_many, each = 0, MOST_POSES + 1, 0.0
    count = max(least, min(MOST_POSES, int(time_s / (cell.config.plan.dwell_s + MOVING_S))))
    for _ in range(TRIED_COUNTS):
        plan = planned(count=count, refine=False, validation=0, beside=0)
        _check_timed(cell, plan)
        taken_s = plan.cycle_time_s or 0.0
        each = taken_s / count
        if taken_s <= time_s:
            fits = count
        elif count == least:
            what = f"{least} poses, the fewest that can tell all parameters, take"
            raise _too_little(time_s, what, taken_s, "plan.dwell_s")
        else:
            too_many = count
        count = min(max(int(time_s / each), fits + 1, least), too_many - 1, MOST_POSES)
        if count <= fits:
            break
    fits, beside = max(fits, least), max(1, round(BESIDE_S / each))
    final = planned(count=fits, beside=beside)
    if final.cycle_time_s is not None and final.cycle_time_s <= time_s:
        return final
    return planned(count=fits, beside=beside, refine=False)  # refined poses may lie farther apart


def _stands_differ(cell: Cell) -> bool:
    """Whether the arm stands longer at poses of some targets than of others."""
    usual = cell.config.plan.dwell_s
    each = {usual if t.dwell_s is None else t.dwell_s for t in cell.config.targets}
    return not cell.is_hand_eye and len(each) > 1


def _too_little(time_s: float, what: str, taken_s: float, dwell: str) -> InputError:
    return InputError(
        f"{time_s / 60.0:.3g} min are not enough: {what} {taken_s / 60.0:.3g} min",
        hint=f"allow more time, or take a smaller {dwell}",
        name="time",
    )


def _plan_in_budget(cell: Cell, time_s: float, planned: Plan) -> OptimalPlan:
    """The best poses that a round has time for, where some take longer than others.

    Each costs the time to stand there and a share of the moving time, as the plan before had it.
    """
    best, moving_s, budget_s = None, MOVING_S, time_s
    for _ in range(TRIED_COUNTS):
        costs = {"count": None, "moving_s": moving_s, "budget_s": budget_s}
        plan = planned(**costs, refine=False, validation=0, beside=0)
        _check_timed(cell, plan)
        taken_s = plan.cycle_time_s or 0.0
        if taken_s <= time_s:
            if best is not None and len(plan.postures) <= len(best.postures):
                break
            best = plan
        else:
            budget_s = min(budget_s, time_s) - (taken_s - time_s) / TRIED_COUNTS
        route = plan.route
        if route is not None and len(route.order):
            moving_s = route.moving_s / len(route.order)
    if best is None:
        raise _too_little(time_s, "the best poses for it take", taken_s, "dwell_s")
    asked = best.request
    final = planned(count=None, moving_s=asked.moving_s, budget_s=asked.budget_s)
    late = final.cycle_time_s is None or final.cycle_time_s > time_s
    return best if late else final


def _check_timed(cell: Cell, plan: OptimalPlan) -> None:
    if plan.cycle_time_s is None:
        raise InputError(
            f"nothing is known of the speeds of {cell.robot.name}: no time can be kept",
            hint="give a number of poses, or the joints' velocity limits in the description",
            name="time",
        )


@one_blas_thread
def plan_fewest(
    cell: Cell,
    sigma_m: float | None = None,
    sigma_rad: float | None = None,
    advance: Advance = silent,
) -> OptimalPlan:
    """Choose the fewest poses whose predicted standard deviations are as small as wanted.

    Parameters
    ----------
    sigma_m, sigma_rad : float, optional
        Largest standard deviation of each parameter that is a length [m], and of each that is an
        angle [rad]; at least one of the two.

    Raises
    ------
    InputError
        Nothing is wanted, or the cell's estimate is not weighted by its noise.
    """
    if sigma_m is None and sigma_rad is None:
        raise InputError(
            "no accuracy is wanted of anything that is identified",
            hint="give `wanted_sigma_mm`, `wanted_sigma_deg`, or both",
            name="wanted",
        )
    request = Request(count=None, criterion="sigma", sigma_m=sigma_m, sigma_rad=sigma_rad)
    return plan_optimal(cell, request, advance)
