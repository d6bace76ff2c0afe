"""The poses to measure next, what each promises, and whether it is worth its time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.identification import IdentificationResult
from calib.se3 import FloatArray
from posedesign.motion.route import Route
from posedesign.planning.optimal.objective import Goal
from posedesign.planning.pose_plan import PoseSet


@dataclass(frozen=True, eq=False)
class NextPoses:
    """Poses to measure next, and what they promise.

    ``measured``: touch-ups so far. ``identified``: what they give; None while they do not identify
    everything. ``why_not``: why they do not, in words. ``noise_scale``: by which the noise given is
    multiplied in what is predicted. ``poses``: the next ones, the one that gains most first.
    ``tcp_m`` (k + 1,): root mean square error of the tool point over the box [m]: now, and after
    each further pose. ``accuracy_m``: error at which to stop.
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
    def dropped(self) -> tuple[str, ...]:
        """Why poses that were asked for cannot be had, one reason each."""
        return self.poses.dropped

    @property
    def message(self) -> str:
        """What to do, in one line."""
        lost = f"; {len(self.dropped)} pose(s) dropped: {self.dropped[0]}" if self.dropped else ""
        return self._advice + lost

    @property
    def _advice(self) -> str:
        now, best = 1e3 * self.tcp_m[0], 1e3 * self.tcp_m[-1]
        done = f"{self.measured} touch-up{'s' * (self.measured > 1)}"
        if self.identified is None:
            verb = "does" if self.measured == 1 else "do"
            return f"go on: {done} {verb} not yet identify everything ({self.why_not})"
        said = f"tool point known to {now:.4g} mm rms over {self.box_words} after {done}"
        if self.worth == 0:
            why = f"the next pose would gain less than {100 * self.least_gain:g} %"
            if self.accuracy_m is not None:
                why = f"{1e3 * self.accuracy_m:.4g} mm is reached"
            return f"stop: {said}; {why}"
        count = len(self.tcp_m) - 1
        more = "one more is" if count == 1 else f"{count} more are"
        return f"go on: {said}; {more} predicted to bring it to {best:.4g} mm"

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
