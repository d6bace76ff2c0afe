"""Inverse kinematics of arms on slides: those of the arm, at stations of what carries it.

A rail, a gantry or a lift leaves a pose as many freedoms as it has axes. They are cut at stations
along each slide, and where the reference posture has them; at each the arm is solved for in all
its branches. Poses that no station takes inside the limits, but almost, are iterated to with the
slides free.
"""

from __future__ import annotations

import itertools

import numpy as np

from calib.robots.bounds import LIMIT_TOLERANCE, Bounds
from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import DampedIteration, InverseKinematics, InverseSolutions
from calib.se3 import FloatArray

STATION_OF_REACH = 1.0 / 3.0
"""Largest step between two stations, of the arm's reach: what an arm takes at a pose it takes
from several of them."""

_MOST_STATIONS = {1: 12, 2: 5}
"""Of one slide, by how many there are; :data:`_OF_MORE` of each of three and more. Long rails have
larger steps: the time is that of the arm times the stations."""

_OF_MORE = 3

_NEAR_BY = 0.05
"""Share of the reach by which a station may miss a pose that another place on the slides takes: an
arm that is stretched out to it reaches it from a short piece of a rail only."""


class OnSlides:
    """Every branch of the arm at stations of the slides that carry it.

    Parameters
    ----------
    chain : SerialChain
        With its slides.
    arm : InverseKinematics
        Of ``chain.arm``.
    """

    def __init__(self, chain: SerialChain, arm: InverseKinematics) -> None:
        self._chain, self._arm, self._freely = chain, arm, DampedIteration(chain)

    def stations(self, bounds: Bounds, near: FloatArray) -> FloatArray:
        """Values of the slides ``(K, slides)`` [m] that are tried: first those of the reference."""
        slides = self._chain.slides
        lower, upper, wanted = bounds.lower[:slides], bounds.upper[:slides], near[:slides]
        most = _MOST_STATIONS.get(slides, _OF_MORE)
        steps = np.ceil((upper - lower) / (STATION_OF_REACH * max(self._chain.reach_m, 1e-3)))
        counts = np.clip(steps + 1, 2, most).astype(int).tolist()
        each = [np.linspace(a, b, c) for a, b, c in zip(lower, upper, counts, strict=True)]
        tried = np.array(list(itertools.product(*each)))
        if not ((wanted >= lower - LIMIT_TOLERANCE) & (wanted <= upper + LIMIT_TOLERANCE)).all():
            return tried
        others = np.abs(tried - wanted).max(axis=1) > LIMIT_TOLERANCE
        return np.vstack([wanted, tried[others]])

    def solve(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray, every_turn: bool = False
    ) -> InverseSolutions:
        """Postures inside bounds: see :meth:`InverseKinematics.solve`."""
        slides, count = self._chain.slides, len(T_base_tip)
        stations = self.stations(bounds, near)
        # an arm that has gone along sees the pose come back by as much
        poses = np.broadcast_to(T_base_tip, (len(stations), count, 4, 4)).copy()
        poses[..., :3, 3] -= (stations @ self._chain.slide_directions)[:, None]
        arm = self._arm.solve(
            poses.reshape(-1, 4, 4), bounds.behind(slides), near[slides:], every_turn
        )
        station, pose = np.divmod(arm.pose, max(count, 1))
        postures, inside = np.hstack([stations[station], arm.postures]), arm.inside
        gaps = np.where(np.isnan(arm.gap_m), np.inf, arm.gap_m).reshape(len(stations), count)
        gap_m = gaps.min(axis=0)
        reached = np.zeros(count, dtype=bool)
        reached[pose[inside]] = True
        near_by = np.flatnonzero(~reached & (gap_m <= _NEAR_BY * self._chain.reach_m))
        if len(near_by):
            more, of, gap_m[near_by] = self._freely.some(T_base_tip[near_by], bounds, near)
            postures, pose = np.vstack([postures, more]), np.concatenate([pose, near_by[of]])
            inside = np.concatenate([inside, bounds.coupled_fit(more)])
        order = np.argsort(pose, kind="stable")
        return InverseSolutions(
            postures[order],
            pose[order],
            inside[order],
            np.where(np.isinf(gap_m), np.nan, gap_m),
            near,
            bounds,
            self._chain,
        )
