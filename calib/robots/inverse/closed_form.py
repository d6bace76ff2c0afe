"""Inverse kinematics in closed form, for six-axis arms with a known decomposition.

The solver is EAIK (Ostermeier et al.): spherical wrists, three parallel axes and their kin, every
branch in a few microseconds.

Arms with axes 2 to 4 parallel, where axis 6 is parallel to them, on which closed forms stumble.

Such an arm (that of Universal Robots) has two angles for the turn about one direction there: the
arm's own, about axes 2 to 4, and joint 6. Exactly there it moves with its tip at rest.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from calib.robots.bounds import TURN, Bounds
from calib.robots.chain import SerialChain
from calib.robots.inverse.eaik_arm import PARALLEL, ZEROS, EaikArm
from calib.robots.inverse.folds import both_sides
from calib.robots.inverse.ideal import ideals
from calib.robots.inverse.solutions import (
    CLOSURE_TOLERANCE,
    InverseKinematics,
    pose_error,
    stepped,
)
from calib.se3 import BoolArray, FloatArray, IntArray, rotation_log

_POLISHING = 12
"""Steps: those that arrive take three to eight."""

SAME_POSTURE_RAD = 1e-6
"""Answers that differ by less in every joint are one posture: what closes to 1e-11 at a hundredth
of a singular value is as exact as that."""

_NEAR_MISS = 1e-4, 10.0, 0.02
"""Least-squares answers of an ideal arm miss by less [m, rad] where the true one may have an
answer: rounding where EAIK's digits suffer, times what the arms are apart by, and at most."""

_WENT_FAR_RAD = 0.02
"""Step from a start to the posture that it closes in on that is worth looking on its other side."""

_CHECKED_AT_ONCE = 2048
"""Answers compared with their poses at once: their frames stay in the cache of a core."""


class ClosedForm(InverseKinematics):
    """Every branch of a six-axis arm in closed form."""

    poses_at_once = 100_000

    def __init__(self, chain: SerialChain, solver: EaikArm, ideal: SerialChain) -> None:
        super().__init__(chain)
        self._solver, self._ideal = solver, ideal
        self._parallel = has_parallel_arm(ideal)
        least, times, most = _NEAR_MISS
        self._near_miss = min(least + times * tips_apart(chain, ideal), most)

    @classmethod
    def of(cls, chain: SerialChain) -> ClosedForm | None:
        """Return the solver for a chain, or None where its geometry has no closed form.

        A chain whose frames are but rounded, or slightly off (a calibrated arm), is solved through
        the nearest ideal one whose closed form finds all: see :mod:`calib.robots.inverse.ideal`.
        """
        if chain.n != 6:
            return None
        for ideal in (chain, *ideals(chain)):
            for zero in ZEROS:
                solver = EaikArm(ideal, zero)
                if solver.known and _finds_all(ideal, solver):
                    return cls(chain, solver, ideal)
        return None

    def some(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        count = len(T_base_tip)
        postures, pose = self._solver.branches(T_base_tip)
        miss = compare(self._ideal, postures, T_base_tip, pose)
        if miss.straight.any():
            postures, pose = self._mend(postures, pose, miss.straight, T_base_tip, near)
            miss = compare(self._ideal, postures, T_base_tip, pose)
        exact, near_by = miss.below(CLOSURE_TOLERANCE), miss.below(self._near_miss)
        gap_m = np.full(count, np.inf)
        # of least-squares answers, which keep the orientation: what closes in gives some of it up
        np.minimum.at(gap_m, pose, np.where(exact, 0.0, miss.distance))
        if self._ideal is not self._chain:
            exact = np.zeros(len(pose), dtype=bool)  # for the ideal arm only
        # the others are at the end of the reach, or at its limits; or there is nothing better
        inexact = np.flatnonzero(~exact & (near_by | (gap_m > 0)[pose]))
        postures, pose = (
            self._with_polished(postures, pose, exact, inexact, near_by, T_base_tip)
            if len(inexact)
            else (postures[exact], pose[exact])
        )
        gap_m[pose] = 0.0
        gap_m[np.isinf(gap_m)] = np.nan
        return postures, pose, gap_m

    def _mend(
        self,
        postures: FloatArray,
        pose: IntArray,
        straight: BoolArray,
        T_base_tip: FloatArray,
        near: FloatArray,
    ) -> tuple[FloatArray, IntArray]:
        """Answers with a straight wrist solved again, those of each pose still together."""
        rows = np.flatnonzero(straight)
        q, of, placed = postures[rows], pose[rows], [0, 1, 2]
        if self._parallel:
            # on the line joint 6 is free: as EAIK has it, and as the reference has it
            q, of, placed = np.tile(q, (2, 1)), np.tile(of, 2), [0, 5]
            q[len(rows) :, 5] = near[5]
        # EAIK gives one or both ways to bend joint 5: take each place of the arm once
        known = np.column_stack([of, np.round(q[:, placed], 9)])
        once = np.unique(known, axis=0, return_index=True)[1]
        q, of = q[once], of[once]
        if self._parallel:
            mended, source = solve_parallel_arm(self._ideal, q, T_base_tip[of])
        else:
            mended, source = solve_straight_wrist(self._ideal, q, T_base_tip[of], near)
        mended, of = each_once(mended, of[source])
        pose = np.concatenate([pose[~straight], of])
        order = np.argsort(pose, kind="stable")
        return np.concatenate([postures[~straight], mended])[order], pose[order]

    def _with_polished(
        self,
        postures: FloatArray,
        pose: IntArray,
        exact: BoolArray,
        inexact: IntArray,
        near_by: BoolArray,
        T_base_tip: FloatArray,
    ) -> tuple[FloatArray, IntArray]:
        """Return exact answers and what inexact ones close in on, each once.

        Most poses that EAIK has no exact answer for are out of reach and stay so. But on arms
        without a spherical wrist it loses poses with a straight one, and comes close; and all that
        an ideal arm answers misses a little.
        """
        start, of = postures[inexact], pose[inexact]
        touched = np.zeros(len(T_base_tip), dtype=bool)
        touched[of] = True
        q, of = polished(self._chain, start, of, T_base_tip, near_by[inexact])
        mixed = exact & touched[pose]
        if mixed.any():
            q, of = np.concatenate([postures[mixed], q]), np.concatenate([pose[mixed], of])
            q, of = each_once(q, of)
        alone = exact & ~touched[pose]
        pose = np.concatenate([pose[alone], of])
        order = np.argsort(pose, kind="stable")
        return np.concatenate([postures[alone], q])[order], pose[order]


def polished(
    chain: SerialChain,
    start: FloatArray,
    of: IntArray,
    T_base_tip: FloatArray,
    near_by: BoolArray,
) -> tuple[FloatArray, IntArray]:
    """Return what starts ``(S, n)`` close in on, each once, those of each pose together.

    Where two starts of a pose close in on one posture, or one goes far or nowhere, two branches
    merge nearby: both are sought from those that are ``near_by`` ``(S,)`` their poses ``of``
    ``(S,)``. Postures ``(K, n)`` [rad] and their poses ``(K,)``, in ascending order.
    """
    q, arrived = _closed_in(chain, start, T_base_tip[of])
    order = np.lexsort((~arrived, of))  # the first of equals has arrived
    q, start, of = q[order], start[order], of[order]
    arrived, near_by = arrived[order], near_by[order]
    again = repeated(q, of)
    far = np.abs(q - start).max(axis=1) > _WENT_FAR_RAD
    doubtful = near_by & (far | again | ~arrived)
    arrived &= ~again
    if not doubtful.any():
        return q[arrived], of[arrived]
    rows = np.tile(of[doubtful], 2)
    starts = both_sides(chain, start[doubtful], T_base_tip[of[doubtful]])
    more, closed = _closed_in(chain, starts, T_base_tip[rows])
    return each_once(
        np.concatenate([q[arrived], more[closed]]), np.concatenate([of[arrived], rows[closed]])
    )


def _closed_in(
    chain: SerialChain, q: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Return postures ``(S, n)`` stepped towards their poses, and which have arrived."""
    free = np.full(chain.n, np.inf)
    q, left = stepped(chain, q, T_wanted, -free, free, _POLISHING)
    arrived = np.ones(len(q), dtype=bool)
    if len(left):
        arrived[left] = compare(chain, q[left], T_wanted, left).below(CLOSURE_TOLERANCE)
    return q, arrived


_TRIED = 64
"""Random postures of which each has to be among the answers to its own pose."""

_NOT_SINGULAR = 0.05
"""Smallest singular value of postures that are tried."""


def _finds_all(chain: SerialChain, solver: EaikArm) -> bool:
    """Return True if random postures of a chain are among the exact answers to their own poses."""
    q = _some_postures(chain)
    state = chain.forward(q)
    clear = chain.smallest_singular_values(state) > _NOT_SINGULAR
    q, T = q[clear], state.T_base_tip[clear]
    answers, pose = solver.branches(T)
    exact = compare(chain, answers, T, pose).below(CLOSURE_TOLERANCE)
    off = np.remainder(answers - q[pose] + np.pi, TURN) - np.pi
    own = exact & (np.abs(off).max(axis=1) < SAME_POSTURE_RAD)
    return len(np.unique(pose[own])) == len(q)


def tips_apart(chain: SerialChain, other: SerialChain) -> float:
    """Return the largest distance [m, rad] between the tips of two arms in the same postures."""
    q = _some_postures(chain)
    return float(np.abs(pose_error(chain, q, other.forward(q).T_base_tip)).max())


def _some_postures(chain: SerialChain) -> FloatArray:
    return np.random.default_rng(0).uniform(-np.pi, np.pi, (_TRIED, chain.n))


def each_once(postures: FloatArray, pose: IntArray) -> tuple[FloatArray, IntArray]:
    """Return postures ``(S, n)`` ordered by their poses ``(S,)``, each once."""
    order = np.argsort(pose, kind="stable")
    postures, pose = postures[order], pose[order]
    fresh = ~repeated(postures, pose)
    return postures[fresh], pose[fresh]


class Miss(NamedTuple):
    """How far postures miss their poses, ``(S,)`` each."""

    distance: FloatArray  # [m]
    angle: FloatArray  # [rad], exact where it is small
    straight: BoolArray  # whether axes 4 and 6 are one line, or nearly so

    def below(self, bound: float) -> BoolArray:
        """Which are off by less [m, rad]."""
        return np.asarray(np.maximum(self.distance, self.angle) < bound)


def compare(
    chain: SerialChain, postures: FloatArray, T_base_tip: FloatArray, pose: IntArray
) -> Miss:
    """How far postures ``(S, n)`` miss the poses ``(N, 4, 4)`` that they are for, by ``(S,)``."""
    wanted = np.ascontiguousarray(T_base_tip[:, :3].transpose(2, 1, 0)).reshape(12, -1)
    distance, angle, cosine = np.empty((3, len(postures)))
    for start in range(0, len(postures), _CHECKED_AT_ONCE):
        part = slice(start, start + _CHECKED_AT_ONCE)
        walk = chain.walk(np.ascontiguousarray(postures[part].T))
        off = np.take(wanted, pose[part], axis=1)
        off[:9] -= walk.tip.reshape(9, -1)
        off[9:] -= walk.p_base_tip
        off *= off
        # |R - R'| is sqrt(2) times the angle where it is small, without the cost of a logarithm
        angle[part] = np.sqrt(0.5 * off[:9].sum(axis=0))
        distance[part] = np.sqrt(off[9:].sum(axis=0))
        cosine[part] = (chain.axes_of(walk, 3) * chain.axes_of(walk, 5)).sum(axis=0)
    return Miss(distance, angle, 1.0 - cosine**2 < STRAIGHT_WRIST**2)


_FEW = 40
"""Postures of which each is held against each other at once."""

_EARLIER = np.tri(_FEW, k=-1, dtype=bool)


def repeated(postures: FloatArray, pose: IntArray) -> BoolArray:
    """Whether an earlier posture of the same pose is the same, full turns aside: ``(S,)``.

    Postures ``(S, n)`` [rad] of poses ``(S,)`` in ascending order.
    """
    count = len(postures)
    if count <= _FEW:
        off = postures[:, None] - postures
        off -= TURN * np.rint(off * (1.0 / TURN))
        same = (np.abs(off, out=off).max(axis=2) < SAME_POSTURE_RAD) & (pose[:, None] == pose)
        return np.asarray((same & _EARLIER[:count, :count]).any(axis=1))
    first = np.searchsorted(pose, pose)
    same = np.zeros(count, dtype=bool)
    for back in range(1, int((np.arange(count) - first).max(initial=0)) + 1):
        later = np.flatnonzero(np.arange(count) - back >= first)
        for angle in postures.T[::-1]:  # few are left after two or three joints
            apart = np.remainder(angle[later] - angle[later - back] + np.pi, 2.0 * np.pi) - np.pi
            later = later[np.abs(apart) < SAME_POSTURE_RAD]
        same[later] = True
    return same


STRAIGHT_WRIST = 1e-5
"""Sine of the angle between axes 4 and 6 below which the wrist is solved again. EAIK's own answers
are wrong below 3e-7 and good to 1e-10 from 3e-6 on."""


def solve_straight_wrist(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray, near: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Joints 4 to 6 of ``(S, 6)`` anew where axes 4 and 6 are one line, or nearly so.

    EAIK sets q4 = q6 = 0 there, whatever the roll of the pose. The direction of axis 6 gives q4 and
    q5; q6 is the turn then left over, which makes up for the rounding of q4. On the line itself
    only the sum (or difference) of q4 and q6 is given, and they share the way from ``near``.

    Postures ``(K, 6)``, joint 5 bent either way, or straight where axis 6 is on the line, and the
    row ``(K,)`` that each comes from. Exact for a wrist whose axis 5 is perpendicular to its
    neighbours.
    """
    q = postures.copy()
    q[:, 3], q[:, 5] = near[3], near[5]
    state = chain.forward(q)
    a4, a5, a6 = (state.axes[:, j] for j in (3, 4, 5))
    way = np.sign(_dot(a4, a6))[:, None]  # of axis 6, along or against axis 4
    x = np.cross(a5, way * a4)  # where axis 6 goes as joint 5 turns
    q[:, 4] -= np.arctan2(_dot(a6, x), _dot(a6, way * a4))  # straight
    R_error = T_wanted[:, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2)
    a6_wanted = (R_error @ a6[..., None])[..., 0]
    off_x, off_y = _dot(a6_wanted, x), _dot(a6_wanted, np.cross(a4, x))
    off = np.hypot(off_x, off_y)
    on_line = off < 0.1 * CLOSURE_TOLERANCE
    bend, turn = np.arctan2(off, np.abs(_dot(a6_wanted, a4))), np.arctan2(off_y, off_x)
    on, beside = np.flatnonzero(on_line), np.flatnonzero(~on_line)
    source, straight = np.concatenate([on, beside, beside]), np.zeros(len(on))
    q = q[source]
    q[:, 3] += np.concatenate([straight, turn[beside], turn[beside] + np.pi])
    q[:, 4] += np.concatenate([straight, bend[beside], -bend[beside]])
    state = chain.forward(q)
    left_over = rotation_log(T_wanted[source, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    roll = _dot(left_over, state.axes[:, 5])
    shared = np.where(on_line[source], roll / 2.0, 0.0)
    q[:, 3] += way[source, 0] * shared
    q[:, 5] += roll - shared
    return q, source


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.sum(a * b, axis=-1))


_TINY = 1e-30
"""Takes the place of a product of lengths that is zero [m²]."""


def has_parallel_arm(chain: SerialChain) -> bool:
    """Whether axes 2 to 4 are parallel and each later axis is perpendicular to the one before."""
    a = chain.forward(np.zeros(chain.n)).axes
    parallel = np.abs(np.cross(a[1], a[2:4])).max() < PARALLEL
    return bool(parallel and abs(a[3] @ a[4]) < PARALLEL and abs(a[4] @ a[5]) < PARALLEL)


def solve_parallel_arm(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Joints 2 to 6 of ``(S, 6)`` anew where axis 6 is parallel to axes 2 to 4, or nearly so.

    Off that line the direction of axis 6 tells how far the arm has turned (either way) and joint
    5, and joint 6 makes up for its rounding; what is left is a triangle for joints 2 to 4. On the
    line joint 6 is free: it is kept, or turned until the triangle closes. For arms for which
    :func:`has_parallel_arm`. Postures ``(K, 6)`` [rad], stretched towards the pose where that is
    out of reach, and the row ``(K,)`` that each comes from.
    """
    turns, bend, roll, source, line = _wrist(chain, postures, T_wanted)
    q = np.zeros((len(source), 6))
    q[:, 0], q[:, 4], q[:, 5] = postures[source, 0], bend, roll
    at_zero = chain.forward(q)
    n = at_zero.axes[:, 1]
    way = np.sign(np.sum(at_zero.axes[:, 1:4] * n[:, None], axis=-1))  # of axes 2 to 4
    q[:, 1] = turns
    state = chain.forward(q)
    o2, o3, o4 = (at_zero.origins[:, j] for j in (1, 2, 3))
    upper, fore = across(o3 - o2, n), across(o4 - o3, n)
    a6, o6 = state.axes[:, 5], state.origins[:, 5]
    centre = across(o6 + T_wanted[source, :3, 3] - state.p_base_tip - o2, n)
    offset = across(state.origins[:, 3] - o6, n)
    l2, l3 = np.linalg.norm(upper, axis=1), np.linalg.norm(fore, axis=1)
    more = np.where(line, _into_reach(centre, offset, n, np.abs(l2 - l3), l2 + l3), 0.0)
    turns, q[:, 5] = turns + more, roll - more * np.sign(_dot(a6, n))
    goal = centre + rotated(offset, n, more)
    cosine = (_dot(goal, goal) - l2**2 - l3**2) / (2.0 * l2 * l3)
    elbow = np.arccos(np.clip(cosine, -1.0, 1.0))
    found = []
    for side in (1.0, -1.0):
        q3 = side * elbow - angle_about(upper, fore, n)
        q2 = angle_about(upper + rotated(fore, n, q3), goal, n)
        posture = q.copy()
        posture[:, 1:4] = np.column_stack([q2, q3, turns - q2 - q3]) * way
        found.append(posture)
    return np.concatenate(found), np.tile(source, 2)


def _wrist(
    chain: SerialChain, postures: FloatArray, T_wanted: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, IntArray, BoolArray]:
    """Turn of the arm about axis 2, joints 5 and 6 [rad], their rows, and which are on the line."""
    q = np.zeros_like(postures)
    q[:, 0] = postures[:, 0]
    state = chain.forward(q)
    n, a5, a6 = (state.axes[:, j] for j in (1, 4, 5))
    wanted = T_wanted[:, :3, :3] @ (np.swapaxes(state.R_base_tip, -1, -2) @ a6[..., None])
    wanted = wanted[..., 0]  # axis 6
    off = across(wanted, n)
    size = np.linalg.norm(off, axis=1)
    line: BoolArray = size < 0.1 * CLOSURE_TOLERANCE
    a5_wanted = np.cross(n, off / np.where(line, 1.0, size)[:, None])
    ahead = angle_about(a5, a5_wanted, n)
    on, beside = np.flatnonzero(line), np.flatnonzero(~line)
    source = np.concatenate([on, beside, beside])
    turns = np.concatenate([np.zeros(len(on)), ahead[beside], ahead[beside] + np.pi])
    n, a5, a6, wanted = n[source], a5[source], a6[source], wanted[source]
    bend = angle_about(rotated(a6, n, turns), wanted, rotated(a5, n, turns))
    q = q[source]
    q[:, 1], q[:, 4] = turns, bend
    q[: len(on), 5] = postures[on, 5]
    state = chain.forward(q)
    left_over = rotation_log(T_wanted[source, :3, :3] @ np.swapaxes(state.R_base_tip, -1, -2))
    share = np.arange(len(source)) < len(on)
    turns = turns + np.where(share, _dot(left_over, n), 0.0)
    roll = q[:, 5] + np.where(share, 0.0, _dot(left_over, state.axes[:, 5]))
    return turns, bend, roll, source, share


def _into_reach(
    centre: FloatArray, offset: FloatArray, n: FloatArray, least: FloatArray, most: FloatArray
) -> FloatArray:
    """Smallest turn (S,) [rad] of an offset about n that brings its end into reach.

    Of offsets ``(S, 3)`` from centres ``(S, 3)``, across n [m]. Least and most ``(S,)``: distances
    that the end may have [m]; where no turn does, it comes as near as it can.
    """
    sides = _dot(centre, centre) + _dot(offset, offset)
    twice = 2.0 * np.linalg.norm(centre, axis=1) * np.linalg.norm(offset, axis=1)
    nearest, farthest = (
        np.arccos(np.clip((d**2 - sides) / np.maximum(twice, _TINY), -1.0, 1.0))
        for d in (least, most)
    )
    angle = angle_about(centre, offset, n)
    size = np.abs(angle)
    wanted = np.clip(size, farthest, nearest)
    return np.asarray(np.where(wanted == size, 0.0, np.copysign(wanted, angle) - angle))


def across(v: FloatArray, n: FloatArray) -> FloatArray:
    """The part of vectors (S, 3) across unit vectors."""
    return np.asarray(v - _dot(v, n)[:, None] * n)


def angle_about(a: FloatArray, b: FloatArray, n: FloatArray) -> FloatArray:
    """Angle (S,) [rad] about n from a to b."""
    return np.asarray(np.arctan2(_dot(n, _cross(a, b)), _dot(a, b)))


def rotated(v: FloatArray, n: FloatArray, angle: FloatArray) -> FloatArray:
    """Vectors (S, 3) turned about unit vectors by angles (S,) [rad]."""
    along = _dot(v, n)[:, None] * n
    turned = np.cos(angle)[:, None] * (v - along) + np.sin(angle)[:, None] * _cross(n, v)
    return np.asarray(along + turned)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    (ax, ay, az), (bx, by, bz) = a.T, b.T
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=1)
