"""Inverse kinematics of arms with external axes: those of the arm, at stations of these.

A rail, a gantry, a lift or a positioner leaves a pose as many freedoms as it has axes. They are cut
at stations along each, and where the reference posture has them; at each the arm is solved for in
all its branches. Poses that no station takes inside the limits, but almost, are iterated to with
the external axes free.
"""

from __future__ import annotations

import itertools

import numpy as np

from calib.robots.bounds import LIMIT_TOLERANCE, Bounds
from calib.robots.chain import SerialChain
from calib.robots.inverse.solutions import DampedIteration, InverseKinematics, InverseSolutions
from calib.se3 import BoolArray, FloatArray, IntArray

STATION_OF_REACH = 1.0 / 3.0
"""Largest step between two stations, of the arm's reach: what an arm takes at a pose it takes
from several of them."""

STATION_RAD = np.deg2rad(30.0)
"""The same of an axis that turns: what stands beside a table comes by once in a turn."""

_MOST_STATIONS = {1: 12, 2: 5}
"""Of one axis, by how many there are; :data:`_OF_MORE` of each of three and more. Long rails have
larger steps: the time is that of the arm times the stations."""

_OF_MORE = 3

_TURNS_WHERE_NONE = {1: 12, 2: 10}
"""Of each axis that turns, by how many there are, for poses that none of these stations takes: what
is fixed to a table goes out of reach in a quarter of a turn. :data:`_TURNS_OF_MORE` of three."""

_TURNS_OF_MORE = 5

_NEAR_BY = 0.05
"""Share of the reach by which a station may miss a pose that another place of the axes takes: an
arm that is stretched out to it reaches it from a short piece of a rail only."""


class OnExternalAxes:
    """Every branch of the arm at stations of the axes that move it; ``arm`` is its solver."""

    def __init__(self, chain: SerialChain, arm: InverseKinematics) -> None:
        self._chain, self._arm, self._freely = chain, arm, DampedIteration(chain)

    def stations(self, bounds: Bounds, near: FloatArray, most_turns: int = 0) -> FloatArray:
        """Values of the axes ``(K, count)`` [rad, m] that are tried: first the reference's.

        ``most_turns``: of axes that turn, in place of the usual number.
        """
        count = self._chain.external.count
        lower, upper, wanted = bounds.lower[:count], bounds.upper[:count], near[:count]
        most = _MOST_STATIONS.get(count, _OF_MORE)
        step_m = STATION_OF_REACH * max(self._chain.reach_m, 1e-3)
        slides = self._chain.external.slides_of(count)
        steps = np.ceil((upper - lower) / np.where(slides, step_m, STATION_RAD))
        largest = np.where(slides, most, max(most, most_turns))
        counts = np.clip(steps + 1, 2, largest).astype(int).tolist()
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
        stations = self.stations(bounds, near)
        postures, pose, inside, gap_m = self._at(stations, T_base_tip, bounds, near, every_turn)
        reached = np.zeros(len(T_base_tip), dtype=bool)
        reached[pose[inside]] = True
        left = np.flatnonzero(~reached)
        turning = self._chain.external.positioner
        finer = self.stations(bounds, near, _TURNS_WHERE_NONE.get(turning, _TURNS_OF_MORE))
        if len(left) and len(finer) > len(stations):
            more, of, good, gap_m[left] = self._at(
                finer, T_base_tip[left], bounds, near, every_turn
            )
            postures, pose = np.vstack([postures, more[good]]), np.append(pose, left[of[good]])
            inside = np.append(inside, good[good])
            reached[left[of[good]]] = True
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

    def _at(
        self,
        stations: FloatArray,
        T_base_tip: FloatArray,
        bounds: Bounds,
        near: FloatArray,
        every_turn: bool,
    ) -> tuple[FloatArray, IntArray, BoolArray, FloatArray]:
        """Postures ``(S, n)`` at stations, their poses, which are inside, and gaps ``(N,)`` [m]."""
        first, count = self._chain.external.count, len(T_base_tip)
        poses = self._chain.at_rest(T_base_tip, stations[:, None])
        arm = self._arm.solve(
            poses.reshape(-1, 4, 4), bounds.behind(first), near[first:], every_turn
        )
        station, pose = np.divmod(arm.pose, max(count, 1))
        gaps = np.where(np.isnan(arm.gap_m), np.inf, arm.gap_m).reshape(len(stations), count)
        postures = np.hstack([stations[station], arm.postures])
        return postures, pose, arm.inside, gaps.min(axis=0)
