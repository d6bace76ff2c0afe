"""Inverse kinematics of six-axis arms whose wrist has an offset.

Axes 2 and 3 are parallel and axes 4 and 5 meet, but axis 6 does not pass through their point: the
CRX of FANUC, the HC of Yaskawa, the CRB 15000 of ABB. Such arms have no closed form. But joint 6 at
an angle fixes that point and the direction of axis 5. Joints 1 to 3 follow from the point, in four
branches, and a branch is an answer where its axis 4 encloses with axis 5 the angle it should
([Abbes2024]_ seeks that angle of joint 6 on a CRX).

The product of the four misses has no square root left in it. Times its denominators it is a
trigonometric polynomial of degree 8 in joint 6. Samples of it, of complex branches too, give its
coefficients, and these all of its zeros at once: at most 16, none lost between the steps of a
search. Where the point comes close to axis 1, several zeros are almost one while joint 1 turns by
any angle between them. There the branches are followed along joint 1 and along joint 6.

.. [Abbes2024] M. Abbes, G. Poisson, Geometric approach for inverse kinematics of the FANUC CRX
   collaborative robot, Robotics 13 (2024) 91.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from calib.robots.bounds import TURN, Bounds
from calib.robots.chain import SerialChain
from calib.robots.inverse.closed_form import polished, tips_apart
from calib.robots.inverse.ideal import ideals
from calib.robots.inverse.solutions import InverseKinematics
from calib.se3 import FloatArray, IntArray, inverse, skew

_DEGREE = 8
_SAMPLES = 2 * _DEGREE + 4
_FIRST_SAMPLE_RAD = 0.1234
"""No round angle: there arms stand above their base, and a branch has no angle of joint 1."""

_GRID = 128
"""Angles of joint 6 at which the wrist's point is looked at for its place alone."""

_NEAR_CIRCLE, _OF_OTHER_ARM = 0.01, 0.05
"""Distance from the unit circle within which a root may be a zero: double ones lose half their
digits, six together five sixths. Those of a slightly different arm may have left it."""

_LARGEST_SLOPE_STEP = 0.05
"""Step [rad] towards a zero by the slope above which the slope says nothing."""

_MISS = 0.02
"""Cosine by which axes 4 and 5 of a branch may miss their angle before it is closed in on. Joint 6
loses half its digits where two branches merge, three quarters where four do, and more of an arm
that is a little off the one that is solved."""

_EXACT_MISS, _SAME_ZERO = 1e-10, 1e-4
"""The same of a branch at an exact zero, and of others that have the same zero: a double one is
good to half the digits of a simple one."""

_NEAR_BY = 2e-3
"""The same of a branch that may be about to merge with another one."""

_ABOVE_BASE = 2e-3
"""Distance of the wrist's point from axis 1, of the arm's length, below which joints 1 and 6
are swept."""

_SWEEP = 48
_TURNS_OF_JOINT_1 = TURN * np.arange(-1, _SWEEP + 1) / _SWEEP
"""Angles of joint 1 there, the first and the last one twice."""

_BESIDE = 0.1 * 1.5 ** -np.arange(40.0)
_BESIDE = np.concatenate([-_BESIDE, _BESIDE[::-1]])
"""Angles of joint 6 there [rad], from the one nearest to axis 1. Joint 1 hardly turns between them,
and several zeros are too near to each other for the polynomial."""

_PARALLEL = 1e-9
"""Sine below which axes of a description are parallel, and gap [m] below which they meet."""

_SHORT_M = 1e-3
"""Length of a link, or offset of the wrist, below which the arm is of another kind."""

_LEAST = 1e-14
"""Of the largest coefficient of a polynomial, which is rounded to 1e-16 of it."""

_TINY = 1e-300
"""Takes the place of a length that is zero [m]."""

Numbers = NDArray[Any]
"""Real ones, or those of complex branches."""


class _Branches(NamedTuple):
    """Joints 1 to 3 of all branches at K angles, and what their axes 4 miss by.

    Arrays ``(2, sides, K)``: both elbows, and one or both sides of the shoulder.
    """

    turn_1: tuple[Numbers, Numbers]  # (sides, K): cosine and sine
    turn_23: tuple[Numbers, Numbers]  # of the forearm about axis 2
    p: tuple[Numbers, Numbers]  # (sides, K): from axis 2 to the wrist's point, across axis 2
    miss: Numbers


class OffsetWrist(InverseKinematics):
    """Every branch of a six-axis arm with parallel axes 2 and 3, and axes 4 and 5 that meet."""

    poses_at_once = 512  # their companion matrices are 2 MB

    def __init__(self, chain: SerialChain, ideal: SerialChain, meeting: FloatArray) -> None:
        super().__init__(chain)
        exact = tips_apart(chain, ideal) < _PARALLEL
        self._near_circle = _NEAR_CIRCLE if exact else _OF_OTHER_ARM
        self._exact_miss = _EXACT_MISS if exact else 0.0  # zeros of another arm tell less
        zero = ideal.forward(np.zeros(6))
        beside = np.linalg.svd(zero.axes[1][None])[2][1]
        # axes of the frame in which axis 2 is the third
        self._F = np.vstack([beside, np.cross(zero.axes[1], beside), zero.axes[1]])
        self._axes, self._origins = zero.axes @ self._F.T, zero.origins @ self._F.T
        self._meeting = self._F @ meeting
        self._from_tip = inverse(zero.T_base_tip)
        self._from_tip[:, :3] = self._from_tip[:, :3] @ self._F.T
        # parts of a vector (9, 3): along axis 1, across it, and that a quarter turn farther
        a1 = self._axes[0]
        along = np.outer(a1, a1)
        self._about_1 = np.concatenate([along, np.eye(3) - along, skew(a1)])
        self._upper = (self._origins[2] - self._origins[1])[:2]
        self._fore = (self._meeting - self._origins[2])[:2]
        self._l2, self._l3 = float(np.hypot(*self._upper)), float(np.hypot(*self._fore))
        # parts of the wrist's point and of axis 5 that stay as joint 6 turns back, or go along with
        # its cosine or its sine: (2, 3, 3)
        a6 = self._axes[5]
        moved = np.stack([self._meeting - self._origins[5], self._axes[4]])
        stays = (moved @ a6)[:, None] * a6
        self._turning = np.stack([stays, moved - stays, np.cross(moved, a6)], axis=1)
        from_6 = np.cross(self._meeting - self._origins[5], self._axes[5])
        self._offset = float(np.linalg.norm(from_6))
        # without an offset of the shoulder, turned by half a turn it puts axis 4 on the same line
        one, other = self._sides(*np.random.default_rng(0).uniform(-1.0, 1.0, (2, 3, 20)))[1]
        self._mirrored = bool(np.allclose(one, other, rtol=1e-9))
        steps = [*chain.placements[:, :3, 3], chain.T_link_tip[:3, 3]]
        self._stretched_m = float(np.linalg.norm(steps, axis=1).sum())
        self._back = [_turning_back(a) for a in (self._axes[0], self._axes[1], self._axes[3])]
        self._grid = TURN * np.arange(_GRID) / _GRID

    @classmethod
    def of(cls, chain: SerialChain) -> OffsetWrist | None:
        """The solver for a chain, or None where its axes lie otherwise.

        A chain whose frames are slightly off is solved through its ideal: see
        :mod:`calib.robots.inverse.ideal`.
        """
        if chain.n != 6:
            return None
        for ideal in (chain, *ideals(chain)):
            zero = ideal.forward(np.zeros(6))
            a, o = zero.axes, zero.origins
            normal = np.cross(a[3], a[4])
            if (
                np.linalg.norm(np.cross(a[1], a[2])) > _PARALLEL
                or np.linalg.norm(np.cross(a[0], a[1])) < 0.1
                or np.linalg.norm(normal) < 0.1
                or np.linalg.norm(np.cross(a[4], a[5])) < 0.1
            ):
                continue
            along, gap, _ = np.linalg.solve(np.column_stack([a[3], normal, -a[4]]), o[4] - o[3])
            solver = cls(chain, ideal, o[3] + along * a[3])
            lengths = solver._l2, solver._l3, solver._offset
            if abs(gap) < _PARALLEL and min(lengths) > _SHORT_M:
                return solver
        return None

    def some(
        self, T_base_tip: FloatArray, bounds: Bounds, near: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        q, of = self._every_branch(T_base_tip)
        answered = np.zeros(len(T_base_tip), dtype=bool)
        answered[of] = True
        lost = np.flatnonzero(~answered)
        gap_m = np.zeros(len(T_base_tip))
        if len(lost):
            with np.errstate(over="ignore", invalid="ignore"):
                gap_m[lost] = self._gap(T_base_tip[lost])
        return q, of, gap_m

    def _every_branch(self, T_base_tip: FloatArray) -> tuple[FloatArray, IntArray]:
        """Postures ``(S, 6)`` of poses ``(N, 4, 4)`` in any turn, and their poses ``(S,)``."""
        # farther than all lengths in a row nothing is reached, and numbers overflow at last
        within = np.flatnonzero(np.abs(T_base_tip[:, :3, 3]).max(axis=1) <= self._stretched_m)
        G = self._moved(T_base_tip)
        polynomial, low = self._polynomial(G[within])
        row, angle = _zeros(polynomial, self._near_circle)
        pose = within[row]
        start, at, miss = self._from_joint_6(G[pose], angle)
        of, near_by = pose[at], miss < _NEAR_BY
        low = within[low]
        if len(low):
            above, at = self._above_base(G[low])
            start, of = np.concatenate([start, above]), np.concatenate([of, low[at]])
            near_by = np.concatenate([near_by, np.ones(len(above), dtype=bool)])
        start = self._with_wrist(start, G[of])
        return polished(self._chain, start, of, T_base_tip, near_by)

    def _moved(self, T_base_tip: FloatArray) -> FloatArray:
        """What joints 1 to 6 do to the tip at zero, ``(N, 3, 4)``, in the frame of axis 2."""
        return np.asarray(self._F @ (T_base_tip @ self._from_tip)[:, :3])

    def _wrist(self, G: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The wrist's point and the direction of axis 5 ``(3, K)`` at angles ``(K,)`` of joint 6.

        Of motions ``(K, 3, 4)``.
        """
        W, b = self._turned_back(angle)
        W = (G[..., :3] @ W[..., None])[..., 0] + G[..., 3]
        return W.T, (G[..., :3] @ b[..., None])[..., 0].T

    def _around(self, G: FloatArray, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The same ``(3, N K)`` of each of N motions at each of K angles of joint 6."""
        W, b = self._turned_back(angle)
        R = G[..., :3].transpose(1, 0, 2)
        return (R @ W.T + G[..., 3].T[..., None]).reshape(3, -1), (R @ b.T).reshape(3, -1)

    def _turned_back(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The wrist's point and axis 5 of the arm at zero, ``(K, 3)``, seen from its tip."""
        turns = np.stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)], axis=1)
        W, b = turns @ self._turning  # (2, K, 3)
        return W + self._origins[5], b

    def _shoulder(self, W: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Parts ``(9, K)`` of the wrist's point about axis 1, and the equation of joint 1.

        ``A cos - B sin = C``, which keeps the place along axis 2: arrays (K,).
        """
        parts = self._about_1 @ (W - self._origins[0][:, None])
        return parts, parts[5], parts[8], self._meeting[2] - self._origins[0][2] - parts[2]

    def _from_axis_1(self, W: FloatArray) -> FloatArray:
        """Squared distance [m²] of the wrist's point from axis 1, along and across axis 2."""
        _, A, B, _ = self._shoulder(W)
        return A * A + B * B

    def _branches(
        self,
        W: FloatArray,
        b: FloatArray,
        root: Callable[[Numbers], Numbers],
        *,
        one_side: bool = False,
    ) -> _Branches:
        """Both elbows of both sides of the shoulder, or of one.

        The square root of what is negative is as root has it.
        """
        parts, A, B, C = self._shoulder(W)
        square = A * A + B * B
        D = root(square - C * C)
        D = D[None] if one_side else np.stack([D, -D])
        with np.errstate(divide="ignore", invalid="ignore"):
            turn_1 = (A * C + B * D) / square, (A * D - B * C) / square
        return self._elbows(parts, b, turn_1, root)

    def _elbows(
        self,
        parts: FloatArray,
        b: FloatArray,
        turn_1: tuple[Numbers, Numbers],
        root: Callable[[Numbers], Numbers],
    ) -> _Branches:
        """Both branches of joints 2 and 3 with joint 1 at turns ``(sides, K)``."""
        cosine, sine = turn_1
        o1, o2 = self._origins[:2]
        x, y = (
            parts[k] + parts[k + 3] * cosine - parts[k + 6] * sine + (o1[k] - o2[k]) for k in (0, 1)
        )
        parts = self._about_1 @ b
        vx, vy, vz = (parts[k] + parts[k + 3] * cosine - parts[k + 6] * sine for k in range(3))
        f, (a4x, a4y, a4z) = self._fore, self._axes[3]
        l2, l3, right = self._l2**2, self._l3**2, self._axes[3] @ self._axes[4]
        square = x * x + y * y
        K = (square + l3 - l2) / 2.0
        S = root(square * l3 - K * K)
        S = np.stack([S, -S])
        # the forearm turned, times the distance
        fx, fy = K * x - S * y, K * y + S * x
        with np.errstate(divide="ignore", invalid="ignore"):
            size = 1.0 / (square * l3)
            c, s = (fx * f[0] + fy * f[1]) * size, (fy * f[0] - fx * f[1]) * size
            miss = c * (a4x * vx + a4y * vy) + s * (a4x * vy - a4y * vx) + (a4z * vz - right)
        return _Branches(turn_1, (c, s), (x, y), miss)

    def _polynomial(self, G: FloatArray) -> tuple[NDArray[np.complex128], IntArray]:
        """Coefficients ``(N, degree + 1)`` of the polynomial: see :func:`_zeros`.

        And the rows ``(K,)`` whose wrist's point may come as close to axis 1 as
        :data:`_ABOVE_BASE`.

        A general six-axis arm has at most 16 postures (E. J. F. Primrose, Mechanism and Machine
        Theory 21 (1986) 509-512), so that degree 8 is what is to be expected. With mirrored sides
        the product is a square, and one side of degree 4 has the same zeros.
        """
        W, b = self._around(G, _FIRST_SAMPLE_RAD + TURN * np.arange(_SAMPLES) / _SAMPLES)
        square, sides = self._sides(W, b, one_side=self._mirrored)
        # the point goes round a circle about axis 6, and half a step on it from the next sample
        close = _ABOVE_BASE * (self._l2 + self._l3) + self._offset * np.pi / _SAMPLES
        low = np.flatnonzero(square.reshape(len(G), _SAMPLES).min(axis=1) < close**2)
        product = sides.prod(axis=0)
        degree = _DEGREE // 2 if self._mirrored else _DEGREE
        samples = np.nan_to_num(product.real, posinf=0.0, neginf=0.0).reshape(len(G), _SAMPLES)
        found = np.fft.fft(samples, axis=1)[:, : degree + 1]
        found *= np.exp(-1j * _FIRST_SAMPLE_RAD * np.arange(degree + 1)) / _SAMPLES
        found[:, 1:] *= 2.0
        return np.asarray(found), low

    def _sides(
        self, W: FloatArray, b: FloatArray, *, one_side: bool = False
    ) -> tuple[FloatArray, Numbers]:
        """Squared distance [m²] from axis 1 ``(K,)``, and products of the misses of both elbows.

        One product of each side of the shoulder, ``(sides, K)``.
        """
        square = self._from_axis_1(W)
        _, _, (x, y), miss = self._branches(W, b, _complex_root, one_side=one_side)
        return square, miss[0] * miss[1] * (x * x + y * y) * square

    def _from_joint_6(
        self, G: FloatArray, angle: FloatArray
    ) -> tuple[FloatArray, IntArray, FloatArray]:
        """Postures ``(S, 6)`` without joints 4 and 5, their rows of K, and what they miss by.

        Those that may be answers. Where joint 6 is exact for one branch it is for all that have an
        answer there: others that come close have theirs at another zero.
        """
        branches = self._branches(*self._wrist(G, angle), _real_root)
        miss = np.abs(branches.miss).reshape(4, -1)
        best = np.fmin.reduce(miss, axis=0)
        which, at = np.nonzero(miss < np.where(best < self._exact_miss, _SAME_ZERO, _MISS))
        return self._postures(branches, which, at, angle[at]), at, miss[which, at]

    def _postures(
        self, branches: _Branches, which: IntArray, at: IntArray, joint_6: FloatArray
    ) -> FloatArray:
        """Postures ``(S, 6)`` of the branches ``(S,)``, counted on, at indices ``(S,)`` of K."""
        elbow, side = np.divmod(which, len(branches.p[0]))
        (c, s), f = (v[elbow, side, at] for v in branches.turn_23), self._fore
        x, y, cosine, sine = (v[side, at] for v in (*branches.p, *branches.turn_1))
        ux, uy = x - (c * f[0] - s * f[1]), y - (s * f[0] + c * f[1])
        q = np.zeros((len(joint_6), 6))
        q[:, 0] = np.arctan2(sine, cosine)
        q[:, 1] = np.arctan2(uy, ux) - np.arctan2(self._upper[1], self._upper[0])
        way = np.sign(self._axes[2][2])  # of axis 3, along or against axis 2
        q[:, 2] = way * (np.arctan2(s, c) - q[:, 1])
        q[:, 5] = joint_6
        return q

    def _with_wrist(self, q: FloatArray, G: FloatArray) -> FloatArray:
        """Postures with joints 4 and 5, by where axes 5 and 6 point in motions ``(S, 3, 4)``."""
        q = q.copy()
        turns = q[:, 0], q[:, 1] + np.sign(self._axes[2][2]) * q[:, 2]
        wanted = np.empty((len(q), 3, 2))
        wanted[..., 0], wanted[..., 1] = self._turned_back(q[:, 5])[1], self._axes[5]
        wanted = G[..., :3] @ wanted
        for angle, back in zip(turns, self._back, strict=False):
            wanted = _rotations(back, angle) @ wanted  # as the forearm sees them
        a4, a5, a6 = self._axes[3:]
        q[:, 3] = _angles(a4, a5, wanted[..., 0])
        wanted = _rotations(self._back[2], q[:, 3]) @ wanted
        q[:, 4] = _angles(a5, a6, wanted[..., 1])
        return q

    def _above_base(self, G: FloatArray) -> tuple[FloatArray, IntArray]:
        """Starts where the wrist's point comes so close to axis 1 that joint 1 can be any angle."""
        square = self._from_axis_1(self._around(G, self._grid)[0]).reshape(len(G), _GRID)
        before, after = np.roll(square, 1, axis=1), np.roll(square, -1, axis=1)
        row, k = np.nonzero((square <= before) & (square < after))
        low, mid, high = before[row, k], square[row, k], after[row, k]
        angle = self._grid[k] + 0.5 * TURN / _GRID * (low - high) / (low - 2.0 * mid + high)
        square = self._from_axis_1(self._wrist(G[row], angle)[0])
        close = square < (_ABOVE_BASE * (self._l2 + self._l3)) ** 2
        if not close.any():
            return np.empty((0, 6)), np.empty(0, dtype=np.intp)
        row, G, angle = row[close], G[row[close]], angle[close]

        def over_joint_1(at: IntArray, turn: FloatArray) -> tuple[FloatArray, _Branches]:
            return self._at_joint_1(G[at], angle[at], turn)

        def over_joint_6(at: IntArray, beside: FloatArray) -> tuple[FloatArray, _Branches]:
            joint_6 = angle[at] + beside
            return joint_6, self._branches(*self._wrist(G[at], joint_6), _real_root)

        found = [
            self._swept(over_joint_1, _TURNS_OF_JOINT_1, len(row)),
            self._swept(over_joint_6, _BESIDE, len(row)),
        ]
        return (
            np.concatenate([q for q, _ in found]),
            np.concatenate([row[at] for _, at in found]),
        )

    def _swept(
        self,
        branches: Callable[[IntArray, FloatArray], tuple[FloatArray, _Branches]],
        grid: FloatArray,
        count: int,
    ) -> tuple[FloatArray, IntArray]:
        """Postures ``(K, 6)`` at the zeros, and almost zeros, of branches over a grid ``(S,)``.

        ``branches`` has joint 6 and the branches of cases ``(K,)`` at values ``(K,)`` of the grid.
        Also returns which of the ``count`` cases each posture belongs to, ``(K,)``.
        """
        size = len(grid)
        cases, values = np.repeat(np.arange(count), size), np.tile(grid, count)
        miss = branches(cases, values)[1].miss.reshape(-1, size)
        low, mid, high = (np.roll(miss, shift, axis=1).ravel() for shift in (1, 0, -1))
        least = (np.abs(mid) <= np.abs(low)) & (np.abs(mid) <= np.abs(high))
        found = np.flatnonzero(least | (mid * high <= 0.0))
        which, case = np.divmod(found // size, count)
        q = []
        for step in _parabola_zeros(low[found], mid[found], high[found]):
            joint_6, there = branches(case, np.interp(found % size + step, np.arange(size), grid))
            q.append(self._postures(there, which, np.arange(len(found)), joint_6))
        return np.concatenate(q), np.tile(case, len(q))

    def _at_joint_1(
        self, G: FloatArray, near: FloatArray, turn: FloatArray
    ) -> tuple[FloatArray, _Branches]:
        """Joint 6 ``(K,)`` [rad] that leaves the wrist's point to joint 1 at ``turn`` ``(K,)``.

        The angle nearest to ``near`` ``(K,)`` of motions ``(K, 3, 4)``; and both elbows there. The
        equation of joint 1 is ``c0 + c1 cos + c2 sin = 0`` in joint 6: three samples give it.
        """
        cosine, sine = np.cos(turn), np.sin(turn)
        samples = np.asarray(TURN * np.arange(3) / 3.0)
        _, *equation = self._shoulder(self._around(G, samples)[0])
        A, B, C = (v.reshape(-1, 3) for v in equation)
        values = A * cosine[:, None] - B * sine[:, None] - C
        c0 = values.mean(axis=1)
        c1, c2 = (values @ part / 1.5 for part in (np.cos(samples), np.sin(samples)))
        middle, size = np.arctan2(c2, c1), np.maximum(np.hypot(c1, c2), _TINY)
        half = np.arccos(np.clip(-c0 / size, -1.0, 1.0))
        # of the two angles the one on the side of near
        angle = middle + np.copysign(half, np.sin(near - middle))
        W, b = self._wrist(G, angle)
        parts, *_ = self._shoulder(W)
        return angle, self._elbows(parts, b, (cosine[None], sine[None]), _real_root)

    def _gap(self, T_base_tip: FloatArray) -> FloatArray:
        """Distance [m] from the wrist's point to where joints 1 to 3 can bring it, at best.

        NaN where they reach it at some angle of joint 6, but axis 5 does not follow, and for arms
        whose axes 1 and 2 are not at right angles.
        """
        if abs(self._axes[0][2]) > _PARALLEL:
            return np.full(len(T_base_tip), np.nan)
        W = self._around(self._moved(T_base_tip), self._grid)[0]
        _, A, B, C = self._shoulder(W)
        size = np.hypot(A, B)
        beside = np.maximum(np.abs(C) - size, 0.0)
        far = np.hypot(*self._branches(W, W, _real_root).p)
        short = np.maximum(far - self._l2 - self._l3, abs(self._l2 - self._l3) - far)
        sides = np.hypot(np.maximum(short, 0.0), beside).reshape(2, -1, _GRID)
        gap = np.fmin(*sides).min(axis=1)
        return np.where(gap > 0.0, gap, np.nan)


def _parabola_zeros(low: FloatArray, mid: FloatArray, high: FloatArray) -> list[FloatArray]:
    """Zeros between -1 and 1 of parabolas through values at -1, 0 and 1, or the nearest to them."""
    a, b = (low + high) / 2.0 - mid, (high - low) / 2.0
    half = -(b + np.copysign(_real_root(b * b - 4.0 * a * mid), b)) / 2.0
    with np.errstate(divide="ignore", invalid="ignore"):
        zeros = half / a, mid / half
    return [np.clip(np.nan_to_num(x), -1.0, 1.0) for x in zeros]


def _turning_back(axis: FloatArray) -> FloatArray:
    """Rotations about a unit vector by an angle, back: parts (3, 9) by 1, cosine and sine."""
    along = np.outer(axis, axis)
    return np.stack([along, np.eye(3) - along, -skew(axis)]).reshape(3, 9)


def _rotations(parts: FloatArray, angle: FloatArray) -> FloatArray:
    """Rotations ``(K, 3, 3)`` of parts by 1, cosine and sine of angles ``(K,)`` [rad]."""
    turns = np.stack([np.ones(len(angle)), np.cos(angle), np.sin(angle)], axis=1)
    return np.asarray((turns @ parts).reshape(-1, 3, 3))


def _angles(n: FloatArray, a: FloatArray, v: FloatArray) -> FloatArray:
    """Angles ``(K,)`` [rad] about a unit vector n from a to vectors ``(K, 3)``."""
    return np.asarray(np.arctan2(v @ np.cross(n, a), v @ (a - (n @ a) * n)))


def _complex_root(x: Numbers) -> Numbers:
    return np.asarray(np.sqrt(x.astype(complex)))


def _real_root(x: Numbers) -> Numbers:
    """The root of what a rounding may have brought below zero."""
    return np.asarray(np.sqrt(np.maximum(x, 0.0)))


def _zeros(c: Numbers, near_circle: float) -> tuple[IntArray, FloatArray]:
    """Zeros of polynomials ``Re sum c_k exp(i k x)`` with ``(N, degree + 1)``, almost zeros too.

    Eigenvalues of the companion matrix of the polynomial in ``z = exp(i x)``: zeros lie on the
    unit circle, and leave it in pairs where they cease to exist. Rows of the N, and x [rad].
    """
    degree = c.shape[1] - 1
    p = np.concatenate([c[:, :0:-1].conj(), 2.0 * c[:, :1].real, c[:, 1:]], axis=1)
    least = _LEAST * np.abs(p).max(axis=1)
    p[:, -1] = np.where(np.abs(p[:, -1]) > least, p[:, -1], np.where(least > 0, least, 1.0))
    companion = np.zeros((len(c), 2 * degree, 2 * degree), dtype=complex)
    companion[:, np.arange(1, 2 * degree), np.arange(2 * degree - 1)] = 1.0
    companion[:, 0] = -p[:, -2::-1] / p[:, -1:]
    z = np.linalg.eigvals(companion)
    row, k = np.nonzero(np.abs(np.abs(z) - 1.0) < near_circle)
    x = np.angle(z[row, k])
    p = c[row]
    slopes = p * 1j * np.arange(degree + 1)
    value, slope = _value(p, x), _value(slopes, x)
    step = np.where(np.abs(value) < _LARGEST_SLOPE_STEP * np.abs(slope), value / slope, 0.0)
    return row, x - step


def _value(c: Numbers, x: FloatArray) -> FloatArray:
    """Value ``(K,)`` of ``Re sum c_k exp(i k x)``, of coefficients ``(K, degree + 1)``."""
    z = np.exp(1j * x)
    total = c[:, -1]
    for k in range(c.shape[1] - 2, -1, -1):
        total = total * z + c[:, k]
    return np.asarray(total.real)
