"""Random sets of poses: what each index says of them, and the error that they leave."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from calib.identification import covariance_of, identify_batch, tool_motion
from calib.model import Setup, simulate
from calib.model.measurements import Measurements
from calib.se3 import FloatArray, IntArray
from posedesign.candidates import CandidatePoses, cone_candidates
from posedesign.selection import condition_inf, evaluate
from studies.intervals import rank_correlation
from studies.tool_errors import (
    RESAMPLES,
    RESAMPLING_SEED,
    box_postures,
    interval,
    simulated_arm,
    study_cell,
    tool_errors,
)

SMALLER_IS_BETTER = {
    "I: predicted error, mean over the box": True,
    "G: predicted error, worst point": True,
    **dict.fromkeys(("A", "C_G", "C_G, rows over noise", "cond_2"), True),
    **dict.fromkeys(("D", "E", "O1", "O2", "O3", "O4", "O5", "number of poses"), False),
}
"""The indices, and whether a small one is good; E and O3 are the same order."""

HALVES = "simulation, half against half"
"""Beside them: how well one half of the trials ranks the sets as the other half does."""


@dataclass(frozen=True, eq=False)
class Sets:
    """Sets of poses of one kind."""

    indices: dict[str, FloatArray]  # (S,): by name
    error_m: FloatArray
    worst_m: FloatArray
    """error_m, worst_m (S,): root mean square over the box, and at its worst point [m]."""
    halves_m: FloatArray  # (2, S): the first of each half of the trials


class Bank:
    """A pool of one arm, every pose of which is touched up many times.

    Each set of poses takes the touch-ups of its own, in an order of its own: its trials are new
    combinations, at the cost of identification alone.
    """

    def __init__(self, problem: str, settings: dict[str, Any], trials: int) -> None:
        own, seed = settings["ranked"], settings["seed"]
        arm, configurations = (settings["problems"][problem][k] for k in ("arm", "configurations"))
        self._rng = np.random.default_rng([seed, 2])
        self.cell = study_cell(arm, settings["smallest_singular_value"])
        self.box = box_postures(self.cell, settings["arms"][arm])
        tilt, rng = float(np.deg2rad(own["tilt_deg"])), np.random.default_rng(seed)
        pool = cone_candidates(self.cell, tilt, own["candidates"], rng, configurations)
        few = min(len(pool), own["candidates"])
        self.pool: CandidatePoses = pool.take(rng.choice(len(pool), few, replace=False))
        self.model = self.cell.model()
        self.motion = tool_motion(self.model, self.box)
        self.truth = simulated_arm(self.cell, self.pool, self.cell.measurement)
        self.linear = self.pool.linearise(self.model)
        R_base = self.cell.robot.fk(self.cell.base_posture)[:3, :3]
        cosine = np.clip(self.pool.orientations[:, :, 2] @ R_base[:, 2], -1.0, 1.0)
        self.tilt_deg = np.rad2deg(np.arccos(cosine))
        self.trials = trials
        parts = [
            simulate(self.truth.model, self.truth.values, self.pool.postures, self._rng, trials=k)
            for k in _parts(trials, own["at_once"])
        ]
        self.touched = np.concatenate([part.postures for part in parts])  # shape (T, N, n)

    def sets(self, kind: str, settings: dict[str, Any], count: int) -> Sets:
        """So many sets of a kind: ``same`` or ``mixed`` numbers of poses and tilts."""
        drawn = [self._draw(kind, settings["ranked"]) for _ in range(count)]
        squares = [self._squares(rows) for rows in drawn]
        said = [self._indices(rows) for rows in drawn]
        half = self.trials // 2
        return Sets(
            {name: np.array([one[name] for one in said]) for name in said[0]},
            np.array([np.sqrt(s.mean()) for s in squares]),
            np.array([np.sqrt(s.mean(axis=0).max()) for s in squares]),
            np.array([[np.sqrt(s[:half].mean()), np.sqrt(s[half:].mean())] for s in squares]).T,
        )

    def _draw(self, kind: str, own: dict[str, Any]) -> IntArray:
        if kind == "same":
            count, tilt_deg = own["same_poses"], own["same_tilt_deg"]
        else:
            count = int(self._rng.integers(own["fewest_poses"], own["most_poses"] + 1))
            tilt_deg = self._rng.uniform(own["least_tilt_deg"], own["tilt_deg"])
        allowed = np.flatnonzero(self.tilt_deg <= tilt_deg)
        return self._rng.choice(allowed, count, replace=False)

    def _squares(self, rows: IntArray) -> FloatArray:
        """Squared errors ``(T, K)`` [m²] over the box."""
        order = self._rng.permuted(np.tile(np.arange(self.trials), (len(rows), 1)), axis=1).T
        postures = self.touched[order, rows]
        data = Measurements(postures, Setup.of(len(rows)), self.model.targets)
        found = identify_batch(self.model, data)
        found = found[np.isfinite(found).all(axis=1)]
        errors = tool_errors(self.truth, self.model, found, self.box)
        return np.asarray((errors**2).sum(axis=-1))

    def _indices(self, rows: IntArray) -> dict[str, float]:
        white = self.linear.white_jacobian[rows]
        found = evaluate(self.linear.jacobian[rows], white)
        C = covariance_of(self.model, self.pool.postures[rows])
        variance = np.trace(self.motion @ C @ np.swapaxes(self.motion, -1, -2), axis1=1, axis2=2)
        return {
            "I: predicted error, mean over the box": float(np.sqrt(variance.mean())),
            "G: predicted error, worst point": float(np.sqrt(variance.max())),
            "A": found.a,
            "D": found.d,
            "E": found.e,
            "C_G": found.c_g,
            "C_G, rows over noise": condition_inf(white),
            "cond_2": found.cond_2_g,
            **{f"O{k}": getattr(found, f"o{k}") for k in range(1, 6)},
            "number of poses": float(len(rows)),
        }


def _parts(trials: int, at_once: int) -> list[int]:
    whole, rest = divmod(trials, at_once)
    return [at_once] * whole + [rest] * (rest > 0)


def correlations(sets: Sets) -> list[dict[str, Any]]:
    """Spearman's rank correlation of each index with the error: 1 where it ranks as the error does.

    With intervals by bootstrap over the sets. An index that is the same for all has none.
    """
    columns = {
        name: (values if SMALLER_IS_BETTER[name] else -values, sets.error_m)
        for name, values in sets.indices.items()
    }
    columns[HALVES] = (sets.halves_m[0], sets.halves_m[1])
    rng = np.random.default_rng(RESAMPLING_SEED)
    count = len(sets.error_m)
    resampled = rng.integers(count, size=(RESAMPLES, count))
    rows = []
    for name, (index, error) in columns.items():
        if np.ptp(index) == 0.0:
            continue
        low, high = interval(rank_correlation(index[resampled], error[resampled]))
        both = rank_correlation(index, error)
        rows.append({"index": name, "rho": float(both), "low": low, "high": high})
    return rows
