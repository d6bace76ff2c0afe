"""What a choice of poses comes to, and how good it is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from calib.identification import IdentificationResult
from calib.identification.prior_arms import PriorArms
from calib.model import CalibrationModel, Setup
from calib.se3 import FloatArray
from calib.shown import Shown
from posedesign.motion.route import Route
from posedesign.planning.optimal.refinement import SCENARIOS
from posedesign.planning.optimal.request import TCP, TCP_WORST, Accuracy, PlanObjective, Request
from posedesign.planning.pose_plan import (
    Planned,
    PoseSet,
    displayed,
    not_checked_words,
)
from posedesign.selection import Fewest, Indices, Selection

SEEN_RMS = "what the camera sees, rms over the picture [mm]"


@dataclass(frozen=True, eq=False, repr=False)
class OptimalPlan(Planned):
    """Poses chosen out of a pool, and the way through them.

    ``selection``: of the postures of the pool. ``fewest``: where the number of poses was left open.
    ``poses``: the poses chosen, refined where that was asked for; those of the whole pool where
    what is wanted is out of reach. ``route``: their order, and what lies between them; None where
    they are out of reach. ``pool_words``: the pool in words. ``pool_size``, ``tried``: poses of the
    pool that the robot can take, of how many. ``indices``: of the poses chosen. ``of_pool``: of the
    poses before they were refined; the same where they were not. ``others``: one pose fewer and one
    more, out of the pool, where there are such. ``box_words``: the task box in words.
    ``not_checked``: what planning did not look at (:attr:`.Cell.not_checked`). ``arms``: those that
    it is for. ``validation``: poses that are kept
    out of the fit. ``left_out``: candidates of the pool that were left out because no clear way to
    them is known, or to others like them. ``left_out_for``: what is in the way to one of them.
    ``unused``: targets of the cell that no pose is of, because others tell more of the arm.
    ``alone``: error of the tool point [m] of as many poses, or as much time, of each target alone.
    ``scale``: what a known length would buy, in words.
    """

    request: Request
    objective: PlanObjective
    selection: Selection
    fewest: Fewest | None
    poses: PoseSet
    route: Route | None
    pool_words: str
    pool_size: int
    tried: int
    indices: Indices
    model: CalibrationModel
    accuracy: Accuracy
    of_pool: Accuracy
    others: tuple[Accuracy, ...]
    box_words: str
    arms: PriorArms
    validation: PoseSet | None = None
    validation_route: Route | None = None
    left_out: int = 0
    left_out_for: str = ""
    not_checked: tuple[str, ...] = ()
    setup: Setup | None = None
    unused: tuple[str, ...] = ()
    alone: Mapping[str, float] = field(default_factory=dict)
    scale: str = ""

    @property
    def reached(self) -> bool:
        """Whether what is wanted is reached; True where nothing was."""
        if self.fewest is not None:
            return self.fewest.reached and not self.dropped
        within = self.route is not None and self._is_within(self.accuracy.value)
        return within and not self.dropped

    @property
    def dropped(self) -> tuple[str, ...]:
        """Why poses that were asked for cannot be had, one reason each."""
        of_validation = () if self.validation is None else self.validation.dropped
        return (*self.poses.dropped, *of_validation)

    def _is_within(self, value: float) -> bool:
        limit = self.objective.limit
        if limit is None:
            return bool(np.isfinite(self.accuracy.sigma).all())
        cost = self.objective.criterion.cost_of
        return bool(cost(value) <= cost(limit) * (1.0 + 1e-9))

    @property
    def is_refined(self) -> bool:
        """Whether poses were turned off the pool."""
        return self.accuracy is not self.of_pool

    @property
    def cycle_time_s(self) -> float | None:
        """Predicted time of one round [s]; None where there is no way, or no speed is known."""
        if self.route is None or not np.isfinite(self.route.cycle_time_s):
            return None
        return self.route.cycle_time_s

    @property
    def remarks(self) -> list[str]:
        """What a user should know of the choice, in words."""
        said = []
        if self.selection.duplicates:
            said.append(
                f"{self.selection.duplicates} candidates tell the same as others, and were "
                "offered once"
            )
        if self.unused:
            said.append(
                f"no pose is of {', '.join(self.unused)}: those few would not even place it, and "
                "poses of the others tell more of the arm"
            )
        if self.left_out:
            said.append(
                f"{self.left_out} candidates were left out because no clear motion to them is "
                f"known, or to others like them ({self.left_out_for}): what is proven is of the "
                "rest of the pool"
            )
        return said

    @property
    def bound_words(self) -> str:
        """What is proven of the choice, in words."""
        found = self.selection
        if not np.isfinite(found.efficiency):
            return "no bound is known"
        side = "below" if found.criterion.smaller_is_better else "above"
        over = (
            ""
            if self.request.robust == "none"
            else f", in the {self.request.robust} of the robots,"
        )
        return (
            f"proven: no {found.count} poses of the pool{over} are {side} "
            f"{self.objective.words(found.bound)}"
            + f" (efficiency {found.efficiency:.3f})"
            * (found.count == self.accuracy.poses)
        )

    @property
    def verdict(self) -> str:
        """How good the poses are, and what is proven of them."""
        if self.fewest is not None:
            said = self._fewest_words(self.fewest)
        else:
            in_time, took = self.request.time_s, self.cycle_time_s
            said = f"{len(self.poses.kept)} poses, "
            if in_time is not None and took is not None:
                said += f"{took / 60.0:.1f} of {in_time / 60.0:.3g} min, "
            said += self.objective.words(self.accuracy.value)
            if self.request.robust != "none":
                said += (
                    f" as described, {self.objective.words(self.selection.value)} in the "
                    f"{self.request.robust} of {SCENARIOS} robots"
                )
            if self.decides:
                said += f" ({self.decides} decides)"
            if self.is_refined:
                # the proof is of the pool: what was turned off it may be below the bound
                said += (
                    ", turned off the pool, which the proof does not cover; chosen out of it: "
                    f"{self.objective.words(self.of_pool.value)}, {self.bound_words}"
                )
            else:
                said += f"; {self.bound_words}"
            if not self.reached and self.objective.limit is not None:
                said = f"not reached: {said}"
                if not self.request.wants_sigma:
                    said += f"; {self.objective.amount(self.objective.limit)} is wanted"
        if self.dropped:
            said += f"; {len(self.dropped)} pose(s) dropped: {self.dropped[0]}"
        return said

    @property
    def message(self) -> str:
        return self.verdict + not_checked_words(self.not_checked)

    def _fewest_words(self, fewest: Fewest) -> str:
        count = fewest.selection.count
        value = self.objective.words(fewest.selection.value)
        decides = f" ({self.decides} decides)" * bool(self.decides)
        wanted = (
            ""
            if self.request.wants_sigma
            else f", {self.objective.amount(fewest.wanted)} is wanted"
        )
        if not fewest.reached:
            every = f"all {count} poses of the pool give"
            if not fewest.selection.criterion.falls_with_poses:
                every = "the best found in the pool is"
            times = f": each would have to be measured {fewest.times} times" * bool(fewest.times)
            return (
                f"out of reach: {every} {value}{wanted}{decides}{times}; or widen the "
                "pool ([pool] and variations.largest_deg), or make room around the base pose"
            )
        said = f"{count} poses reach {value}{wanted}{decides}"
        if fewest.fewer is not None:
            less = self.objective.amount(fewest.fewer.value)
            said += f"; {fewest.fewer.count} were found to reach {less} only"
        if fewest.at_least >= count:
            return said + "; proven: fewer cannot"
        return said + f"; proven: fewer than {fewest.at_least} cannot"

    @property
    def decides(self) -> str:
        """Name of the parameter whose deviation is the largest part of that wanted; or empty."""
        if not self.request.wants_sigma or not np.isfinite(self.accuracy.sigma).all():
            return ""
        return self.model.names[int(np.argmax(self.accuracy.sigma / self._wanted))]

    @property
    def _wanted(self) -> FloatArray:
        """Standard deviations wanted ``(p,)`` [SI]; infinite where any will do."""
        limits = {"m": self.request.sigma_m, "rad": self.request.sigma_rad}
        return np.array([limits.get(unit) or np.inf for unit in self.model.units])

    def sigma_rows(self) -> list[dict[str, object]]:
        """Predicted deviation of each parameter, beside that of one pose fewer and more."""
        shown = displayed(self.model, self.accuracy.sigma)
        rows: list[dict[str, object]] = [
            {"parameter": name, "predicted sigma": _or_none(sigma), "unit": unit}
            for name, unit, sigma in shown
        ]
        if np.isfinite(self.model.prior).any():
            before = displayed(self.model, self.model.prior)
            for row, (_, _, prior) in zip(rows, before, strict=True):
                row["before measuring"] = _or_none(prior)
        if self.request.wants_sigma:
            wanted = displayed(self.model, self._wanted)
            for row, (_, _, limit) in zip(rows, wanted, strict=True):
                row["wanted"] = _or_none(limit)
        for other in () if self.is_refined else self.others:
            for row, (_, _, sigma) in zip(rows, displayed(self.model, other.sigma), strict=True):
                row[f"with {other.poses} poses"] = _or_none(sigma)
        return rows

    def accuracy_rows(self) -> list[dict[str, object]]:
        """What the criterion and the tool point come to with one pose fewer, these, one more."""
        ordered = sorted((self.of_pool, *self.others), key=lambda a: a.poses)
        labelled = [(f"{a.poses}", a) for a in ordered]
        if self.is_refined:
            labelled.append((f"{self.accuracy.poses}, refined", self.accuracy))
        # one of the columns that are there anyway may be the criterion
        own = () if self.objective.criterion.name in (TCP, TCP_WORST) else (self.objective.title,)
        rms, worst = "expected error [mm]", "where it is largest [mm]"
        if self.model.measurement.name == "board":
            rms, worst = SEEN_RMS, "the same at its worst [mm]"
        return [
            {
                "poses": label,
                **{title: _or_none(a.value) for title in own},
                rms: _or_none(1e3 * a.tcp_m),
                worst: _or_none(1e3 * a.tcp_worst_m),
            }
            for label, a in labelled
        ]


def _or_none(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


@dataclass(frozen=True, eq=False, repr=False)
class NextPoses(Shown):
    """Poses to measure next, and what they promise."""

    objective: PlanObjective
    measured: int  # touch-ups so far
    identified: IdentificationResult | None
    """What they give; None while they do not identify everything."""
    why_not: str  # why they do not, in words
    noise_scale: float  # by which the noise given is multiplied in what is predicted
    poses: PoseSet  # the next ones, the one that gains most first
    route: Route
    tcp_m: FloatArray
    """(k + 1,): root mean square error of the tool point over the box [m]: now, and after each
    further pose."""
    box_words: str
    least_gain: float
    accuracy_m: float | None  # error at which to stop
    things: tuple[str, str] = ("touch-up", "tool point")  # what is measured, and whose error it is

    @property
    def worth(self) -> int:
        """How many of the poses are worth their time."""
        if self.why_not:
            return len(self.tcp_m) - 1
        gains = -np.diff(self.tcp_m) / self.tcp_m[:-1]
        enough = gains < self.least_gain
        if self.accuracy_m is not None:
            enough = self.tcp_m[:-1] <= self.accuracy_m
        return int(np.argmax(enough)) if enough.any() else len(gains)

    @property
    def dropped(self) -> tuple[str, ...]:
        return self.poses.dropped

    @property
    def headline(self) -> str:
        return self.message

    @property
    def message(self) -> str:
        lost = f"; {len(self.dropped)} pose(s) dropped: {self.dropped[0]}" if self.dropped else ""
        return self._advice + lost

    @property
    def _advice(self) -> str:
        now, best = 1e3 * self.tcp_m[0], 1e3 * self.tcp_m[-1]
        thing, whose = self.things
        done = f"{self.measured} {thing}{'s' * (self.measured > 1)}"
        if self.why_not:
            verb = "does" if self.measured == 1 else "do"
            return f"go on: {done} {verb} not yet identify everything ({self.why_not})"
        said = f"{whose} known to {now:.4g} mm rms over {self.box_words} after {done}"
        if self.worth == 0:
            why = f"the next pose would gain less than {100 * self.least_gain:g} %"
            if self.accuracy_m is not None:
                why = f"{1e3 * self.accuracy_m:.4g} mm is reached"
            return f"stop: {said}; {why}"
        count = len(self.tcp_m) - 1
        more = "one more is" if count == 1 else f"{count} more are"
        return f"go on: {said}; {more} predicted to bring it to {best:.4g} mm"

    def rows(self) -> list[dict[str, object]]:
        rows: list[dict[str, object]] = []
        rms = "expected error [mm]"
        if self.things[0] == "picture":
            rms = SEEN_RMS
        for k, value in enumerate(self.tcp_m):
            gain = 1.0 - value / self.tcp_m[k - 1] if k else np.nan
            rows.append(
                {
                    f"{self.things[0]}s": self.measured + k,
                    "pose": self.poses.names[k - 1] if k else "",
                    rms: 1e3 * float(value),
                    "gain [%]": 100.0 * float(gain) if k else None,
                }
            )
        return rows
