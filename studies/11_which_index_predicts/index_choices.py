"""Sets chosen from one pool by each criterion, and the error that they leave over the box."""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.identification.prediction import tool_motion
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import cone_pool
from posedesign.selection import largest_deviation, mean_deviation, select
from posedesign.selection.indices import PER_MRAD_AND_MM
from studies.box_cells import box_postures, study_cell
from studies.tool_errors import Experiment, ToolErrors, interval, simulate_errors, simulated_arm

CRITERIA = ("I", "G", "A", "D", "E", "C_G", "cond_2", "O1", "O2", "O3", "O4", "O5")
OF_THE_REGRESSOR = ("C_G", "cond_2")
"""As the paper has them, rows in metres; the others take rows over their noise."""


class Chooser:
    """A pool of one arm that is chosen from.

    Parameters
    ----------
    problem : str
    settings : dict
        The study's TOML.
    """

    def __init__(self, problem: str, settings: dict[str, Any]) -> None:
        own = settings["chosen"]
        arm, configurations = (settings["problems"][problem][k] for k in ("arm", "configurations"))
        self._settings, self._seed = own, settings["seed"]
        self.cell = study_cell(arm, settings["smallest_singular_value"])
        self.box = box_postures(self.cell, settings["arms"][arm])
        tilt, rng = float(np.deg2rad(own["tilt_deg"])), np.random.default_rng(settings["seed"])
        self.pool = cone_pool(self.cell, tilt, own["candidates"], rng, configurations)
        self.model = self.cell.model()
        self.motion = tool_motion(self.model, self.box)
        self._linear = self.pool.linearise(self.model)

    def choose(self, name: str, poses: int) -> IntArray:
        """Rows of the pool."""
        white = PER_MRAD_AND_MM * self._linear.white_jacobian
        blocks = self._linear.jacobian if name in OF_THE_REGRESSOR else white
        criterion = {"I": mean_deviation(self.motion), "G": largest_deviation(self.motion)}
        return select(
            blocks, poses, criterion.get(name, name), starts=self._settings["starts"]
        ).indices

    def random(self, poses: int) -> float:
        """Predicted error of a random set [m]: the median of a few."""
        rng = np.random.default_rng([self._seed, 3, poses])
        found = []
        for _ in range(self._settings["random_sets"]):
            rows = rng.choice(len(self.pool), poses, replace=False)
            C = Experiment.of(self.model, self.pool.take(rows)).covariance
            variance = np.trace(
                self.motion @ C @ np.swapaxes(self.motion, -1, -2), axis1=1, axis2=2
            )
            found.append(np.sqrt(variance.mean()))
        return float(np.median(found))

    def errors(self, rows: IntArray, trials: int, stream: int) -> ToolErrors:
        """Simulated."""
        pool = self.pool.take(rows)
        arm = simulated_arm(self.cell, pool, self.cell.measurement)
        rng = np.random.default_rng([self._seed, 4, stream])
        return simulate_errors(arm, Experiment.of(self.model, pool), self.box, trials, rng)


def chosen(
    problem: str,
    settings: dict[str, Any],
    *,
    trials: int | None = None,
    criteria: tuple[str, ...] = CRITERIA,
    counts: tuple[int, ...] | None = None,
) -> list[dict[str, Any]]:
    """A row for each criterion and number of poses; the errors against those of I."""
    chooser, rows = Chooser(problem, settings), []
    for poses in counts or settings["chosen"]["poses"]:
        best: ToolErrors | None = None
        random_m = chooser.random(poses)
        for name in criteria:
            stream = 100 * poses + CRITERIA.index(name)
            taken = chooser.choose(name, poses)
            errors = chooser.errors(taken, trials or settings["chosen"]["trials"], stream)
            best = best or errors
            rows.append({"problem": problem} | _row(name, poses, errors, best, random_m))
    return rows


def _row(
    name: str, poses: int, errors: ToolErrors, best: ToolErrors, random_m: float
) -> dict[str, Any]:
    low, high = errors.rms_interval_m
    times_low, times_high = interval(_times(errors, best))
    return {
        "criterion": name,
        "poses": poses,
        "predicted_rms_mm": 1e3 * errors.predicted_rms_m,
        "rms_mm": 1e3 * errors.rms_m,
        "rms_low_mm": 1e3 * low,
        "rms_high_mm": 1e3 * high,
        "median_of_trials_mm": 1e3 * float(np.median(errors.of_trials_m)),
        "worst_mm": 1e3 * errors.worst_m,
        "predicted_worst_mm": 1e3 * errors.predicted_worst_m,
        "times_I": errors.rms_m / best.rms_m,
        "times_I_low": times_low,
        "times_I_high": times_high,
        "predicted_times_I": errors.predicted_rms_m / best.predicted_rms_m,
        "random_predicted_rms_mm": 1e3 * random_m,
    }


def _times(errors: ToolErrors, best: ToolErrors) -> FloatArray:
    """Bootstrap samples ``(B,)`` of the ratio; the trials of the two sets are independent."""
    if errors is best:
        return np.ones(2)
    own, other = (np.sqrt(e.resampled.mean(axis=1)) for e in (errors, best))
    return np.asarray(own / np.roll(other, 1))  # both were resampled by the same draws
