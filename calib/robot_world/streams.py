"""Poses of an arm and of a camera with clocks of their own: X, Z and the offset of the clocks.

What the camera saw at its time s was at the time ``s - offset`` of the arm. The offset may change
at a steady rate. Poses of the arm are interpolated at these times, so that at any offset there is a
problem of pairs, ``A(s - offset) X = Z B``. A moving arm tells the offset: a delay leaves residuals
along its motion. So the offset is one more unknown of the maximum of the likelihood, and its
uncertainty is in the covariance of X and Z.

Where to start is found by the residuals of the closed form at many offsets, and by the correlation
of angular speeds, which are the same for both up to the offset (Furrer et al. 2017). Starts that
lead elsewhere are told by their likelihoods. Neighbours in time are no independent measurements:
variances are those of batches of neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calib import se3
from calib.chance import chi2_quantile
from calib.errors import ConvergenceError, InputError, NotIdentifiableError
from calib.judgement import Finding
from calib.robot_world.adjustment import linear_rows
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.estimate import Estimate
from calib.robot_world.methods import robust
from calib.robot_world.noise import Noise, PairCovariances, difference
from calib.robot_world.pairs import FEWEST_PAIRS, PairSets
from calib.robot_world.results import RobotWorldResult
from calib.robot_world.sizes import estimated_model
from calib.robot_world.solver import solve
from calib.se3 import BoolArray, FloatArray, IntArray
from calib.shown import Shown

MOST_SAMPLES = 3000
"""Samples of the camera that the estimate rests on, evenly spread: neighbours tell little more."""

LARGEST_OFFSET_S = 1.0
"""Offset of the clocks that is looked for by default, to either side."""

_FEW_SAMPLES = 300
"""Samples by which starts are told apart."""

_SCANNED, _SCAN_SAMPLES = 101, 80
"""Offsets that are tried in closed form, and samples of the camera that each is tried on."""

_STARTS = 4
"""Offsets that the likelihood is maximised from."""

_GRID_S, _WINDOW_S = 0.01, 0.1
"""Steps of time in which angular speeds are correlated, and time over which they are means."""

_SHRUNK = (1.0, 0.5, 0.25, 0.1, 0.03)
"""Parts of a step that are tried until one makes the clock likelier."""

_STALLED = 1e-6
_STEPS = 25
_LARGEST_STEP_S = 0.1
_ARRIVED = 1e-2
"""Last step, in standard deviations of the offset."""

_LONGEST_GAP = 20.0
"""Time between two poses of the arm, in median ones, across which none is interpolated."""

_LEAST_JITTER_S, _MOST_JITTER_S, _JITTERS = 1e-5, 0.1, 120
"""Standard deviations of stamps that are tried, in equal ratios."""

_JITTER_SHOWN = 10.0
"""Twice the logarithm of the likelihood that a jitter has to gain."""

_ROUNDS = 3
"""Rounds of noise, and clock by it."""

_SHARE_OF_A = 1e-4
"""Part of the noise that A has in all directions, so that its covariance is regular."""

_UNKNOWN_S = 100.0
"""Standard deviation of an offset that nothing tells."""

_NEAR_S = 2e-3
"""Time to either side over which motion is asked for, at least."""

_RATE_SHOWN = 13.8
"""Twice the logarithm of the likelihood that a rate of the clocks has to gain."""

_AS_LIKELY = 13.8
"""The same by which another offset has to be less likely not to be in doubt."""

_FEWEST = 10
"""Samples of the camera within the time of the arm."""

_BATCHES = 10
"""Batches of neighbours. An arm is off in a pattern of its poses, which changes as slowly as it
moves: the more batches, the shorter they are against it."""


@dataclass(frozen=True, eq=False)
class PoseStream:
    """Poses at rising times of one clock."""

    times: FloatArray  # (M,) [s]
    T: FloatArray  # (M, 4, 4) [m]

    @classmethod
    def of(cls, times: ArrayLike, T: ArrayLike, name: str) -> PoseStream:
        """Check times and poses, and sort them.

        Rows whose pose is not a number are left out, and all but the first of equal times.

        Raises
        ------
        InputError
            Times are not as many as the poses, or fewer than three.
        """
        t, poses = np.asarray(times, dtype=float), np.asarray(T, dtype=float)
        if t.ndim != 1 or poses.shape != (len(t), 4, 4):
            raise InputError(
                f"{name} has times {t.shape} and poses {poses.shape}",
                hint="give times (M,) and poses (M, 4, 4)",
                name=name,
            )
        good = np.isfinite(t) & np.isfinite(poses).all(axis=(1, 2))
        t, poses = t[good], poses[good]
        t, first = np.unique(t, return_index=True)  # stamps that jitter may overtake each other
        poses = poses[first]
        if len(t) < FEWEST_PAIRS:
            raise InputError(f"{name} has {len(t)} poses", hint="give three or more", name=name)
        return cls(t, se3.rigid(poses, name))

    @cached_property
    def middle_s(self) -> float:
        """Middle of the times."""
        return float(0.5 * (self.times[0] + self.times[-1]))

    def at(self, times: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Return poses ``(N, 4, 4)`` at times by interpolation, and where there are any ``(N,)``.

        Along a turn about one axis and a line, between neighbours no farther apart than usual.
        """
        k = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(self.times) - 2)
        span = self.times[k + 1] - self.times[k]
        share = (times - self.times[k]) / span
        inside = (share >= 0.0) & (share <= 1.0) & (span <= self._longest_s)
        share = np.clip(share, 0.0, 1.0)
        turn = np.einsum("nji,njk->nik", self.T[k, :3, :3], self.T[k + 1, :3, :3])
        R = self.T[k, :3, :3] @ se3.rotation_exp(share[:, None] * se3.rotation_log(turn))
        place = self.T[k, :3, 3] + share[:, None] * (self.T[k + 1, :3, 3] - self.T[k, :3, 3])
        return se3.transform(R, place), inside

    @cached_property
    def step_s(self) -> float:
        """Time between two poses, median."""
        return float(np.median(np.diff(self.times)))

    @property
    def _longest_s(self) -> float:
        return _LONGEST_GAP * self.step_s

    def angular_speeds(self, times: FloatArray) -> FloatArray:
        """Return angular speeds ``(n,)`` [rad/s] about times, over a window; NaN outside."""
        half = max(_WINDOW_S, 2.0 * self.step_s) / 2.0
        (ahead, inside), (behind, before) = self.at(times + half), self.at(times - half)
        turn = np.einsum("nji,njk->nik", behind[:, :3, :3], ahead[:, :3, :3])
        return np.where(inside & before, se3.rotation_angle(turn) / (2.0 * half), np.nan)


@dataclass(frozen=True, eq=False, repr=False)
class StreamResult(Shown):
    """X, Z and the offset of the clocks."""

    pairs: RobotWorldResult
    """The answer of the pairs at the offset that was found, as of the method ``ml-robust``."""
    offset_s: float
    """Time by which the clock of the camera is later, in the middle of its times."""
    sigma_offset_s: float
    rate: float
    """By how much it is faster, as a share; 0 where the streams show none."""
    sigma_rate: float
    covariance: FloatArray
    """(12, 12): of X and Z as of :attr:`RobotWorldResult.covariance`, the offset unknown."""
    jitter_s: float  # standard deviation of the camera's stamps; 0 where none is shown
    times: FloatArray  # (n,): of the samples of the camera that the pairs are of [s]
    findings: tuple[Finding, ...]

    @property
    def X(self) -> FloatArray:
        """Transform ``(4, 4)`` from what the camera stream is of to the flange."""
        return self.pairs.X

    @property
    def Z(self) -> FloatArray:
        """Transform ``(4, 4)`` to the base."""
        return self.pairs.Z

    @property
    def is_ok(self) -> bool:
        """Return True if pairs and clock are to be trusted."""
        grave = any(one.grade == "not to be trusted" for one in self.findings)
        return self.pairs.status == "ok" and not grave

    @property
    def headline(self) -> str:
        return (
            f"clocks {1e3 * self.offset_s:.2f} +- {1e3 * self.sigma_offset_s:.2g} ms apart, "
            f"{self.pairs.headline}"
        )

    def rows(self) -> list[dict[str, object]]:
        """One row: the offset and the rate."""
        return [
            {
                "offset_ms": 1e3 * self.offset_s,
                "sigma_offset_ms": 1e3 * self.sigma_offset_s,
                "rate_ppm": 1e6 * self.rate,
                "sigma_rate_ppm": 1e6 * self.sigma_rate,
                "jitter_ms": 1e3 * self.jitter_s,
                "samples": len(self.times),
            }
        ]


def solve_streams(
    robot: PoseStream,
    camera: PoseStream,
    *,
    largest_offset_s: float = LARGEST_OFFSET_S,
    estimate_scale: bool = False,
) -> StreamResult:
    """Solve ``A(s - offset) X = Z B(s)`` for X, Z and the offset of the clocks.

    Parameters
    ----------
    robot, camera : PoseStream
        A and B as of :func:`calib.robot_world.solve`, each by its own clock.
    largest_offset_s : float
        Offset that is looked for, about that at which angular speeds agree best and about 0.
    estimate_scale : bool
        As of :func:`calib.robot_world.solve`.

    Raises
    ------
    InputError
        The streams have no time in common.
    NotIdentifiableError
        The motion does not identify X and Z.
    ConvergenceError
        The search has not arrived.
    """
    few, problem = _Streams(robot, camera, _FEW_SAMPLES), _Streams(robot, camera, MOST_SAMPLES)
    tried = []
    for start in problem.starts(largest_offset_s):
        with suppress(ConvergenceError, InputError):
            tried.append(few.refined(np.array([start])))
    if not tried:
        raise ConvergenceError(
            "no offset of the clocks was found",
            hint="do both streams show the same motion? say how far the clocks may be apart",
        )
    likeliest = min(tried, key=lambda one: one.unlikely)
    others = [
        one
        for one in tried
        if abs(one.clock[0] - likeliest.clock[0]) > 5.0 * likeliest.sigma[0]
        and one.unlikely - likeliest.unlikely < _AS_LIKELY * likeliest.alike
    ]
    best = problem.refined(likeliest.clock)
    with_rate = problem.refined(np.array([best.clock[0], 0.0]))
    has_rate = best.unlikely - with_rate.unlikely > _RATE_SHOWN * with_rate.alike
    # a rate leaves residuals as jitter does: what it explains is no jitter
    chosen, noise = problem.with_jitter(with_rate if has_rate else best)
    return problem.result(chosen, noise, others, largest_offset_s, estimate_scale=estimate_scale)


@dataclass(frozen=True, eq=False)
class _Noise:
    """Noise of the samples of the camera."""

    sigma: FloatArray  # (2,): of rotation and translation [rad, m]
    jitter_s: float  # of their stamps


@dataclass(frozen=True, eq=False)
class _At:
    """End of the search for the clock."""

    clock: FloatArray  # (1,) or (2,): offset [s], and rate
    sigma: FloatArray
    unlikely: float  # minus twice the logarithm of the likelihood, but for a constant
    alike: float  # variance of the score over that of independent samples
    moves: FloatArray  # (12, k): of X and Z by the clock
    covariance: FloatArray  # (k, k): of the clock


@dataclass(frozen=True, eq=False)
class _Streams:
    """Two streams, and how many samples of the camera count."""

    robot: PoseStream
    camera: PoseStream
    most: int

    @cached_property
    def _samples(self) -> IntArray:
        """Samples of the camera that the estimate rests on."""
        return _spread(len(self.camera.times), self.most)

    def pairs(
        self, clock: FloatArray, samples: IntArray | None = None
    ) -> tuple[PairSets, FloatArray]:
        """Pairs at a clock, and their times.

        Raises
        ------
        InputError
            Too few samples lie within the times of the arm.
        """
        own = self._samples if samples is None else samples
        times = self.camera.times[own]
        A, inside = self.robot.at(self._shifted(times, clock))
        if inside.sum() < _FEWEST:
            raise InputError(
                f"{int(inside.sum())} poses of the camera are of times that the arm has",
                hint="are both clocks in seconds, and do the streams overlap?",
                name="camera_stream",
                value=int(inside.sum()),
                bound=_FEWEST,
            )
        return PairSets(A[inside][None], self.camera.T[own][inside][None]), times[inside]

    def _shifted(self, times: FloatArray, clock: FloatArray) -> FloatArray:
        """Times of the arm at which the camera saw what it has at its times."""
        rate = clock[1] if len(clock) > 1 else 0.0
        return np.asarray(times - clock[0] - rate * (times - self.camera.middle_s))

    def starts(self, largest_s: float) -> list[float]:
        """Offsets to start from, the best first."""
        centres = [0.0, self._by_speeds()]
        costs: dict[float, float] = {}
        samples = _spread(len(self.camera.times), _SCAN_SAMPLES)
        for centre in centres:
            if any(abs(centre - other) < largest_s / 4.0 for other in costs):
                continue
            for offset in (centre + np.linspace(-largest_s, largest_s, _SCANNED)).tolist():
                costs[offset] = self._cost(offset, samples)
        offsets = np.array(sorted(costs))
        cost = np.array([costs[offset] for offset in offsets.tolist()])
        if not np.isfinite(cost).any():
            self.pairs(np.array([centres[1]]))  # says what is wrong
            raise NotIdentifiableError(
                ["X and Z"], ["the arm hardly turns while the camera sees"], hint=""
            )
        around = np.concatenate([[np.inf], cost, [np.inf]])
        lowest = (cost <= around[:-2]) & (cost <= around[2:]) & np.isfinite(cost)
        order = np.argsort(np.where(lowest, cost, np.inf))[: min(_STARTS, int(lowest.sum()))]
        return [float(offsets[i]) for i in order]

    @cached_property
    def _share_within(self) -> float:
        """Share of the camera's samples that can be within the times of the arm."""
        robot, camera = (float(np.ptp(stream.times)) for stream in (self.robot, self.camera))
        return min(robot / camera, 1.0)

    def _cost(self, offset: float, samples: IntArray) -> float:
        """Logarithm of the median residuals of the closed form at an offset."""
        try:
            pairs, _ = self.pairs(np.array([offset]), samples)
        except InputError:
            return float("inf")
        if 0.5 * self._share_within * len(samples) > pairs.N:
            return float("inf")  # what hardly overlaps fits by chance
        X, Z = pairs.rotations_first
        if not np.isfinite(X).all():
            return float("inf")
        gap = pairs.A @ X[:, None] - Z[:, None] @ pairs.B
        turn = np.sqrt((gap[0, :, :3, :3] ** 2).sum(axis=(1, 2)))
        place = np.sqrt((gap[0, :, :3, 3] ** 2).sum(axis=1))
        tiny = np.finfo(float).tiny
        return float(np.log(np.median(turn) + tiny) + np.log(np.median(place) + tiny))

    def _by_speeds(self) -> float:
        """Offset at which the angular speeds of both streams agree best, over all that overlap."""
        each = []
        for stream in (self.robot, self.camera):
            grid = np.arange(stream.times[0], stream.times[-1], _GRID_S)
            speed = stream.angular_speeds(grid)
            known = np.isfinite(speed)
            if known.sum() < _FEWEST:
                return 0.0
            level = float(np.median(speed[known]))
            each.append((grid[0], np.where(known, speed - level, 0.0)))
        (first_A, a), (first_B, b) = each
        from scipy.signal import correlate

        agreement = correlate(b, a, mode="full", method="fft")
        shared = correlate(np.ones(len(b)), np.ones(len(a)), mode="full", method="fft")
        agreement = np.where(shared > 0.3 * min(len(a), len(b)), agreement, -np.inf)
        lag = int(np.argmax(agreement)) - (len(a) - 1)
        return float(first_B - first_A + lag * _GRID_S)

    def refined(self, clock: FloatArray, noise: _Noise | None = None) -> _At:
        """Climb to the likeliest clock from a start, by a noise or by what the residuals show."""
        at = self._judged(clock, noise)
        for _ in range(_STEPS):
            step, moved = at
            length = float(np.abs(step / moved.sigma).max())
            if length < _ARRIVED:
                return moved
            limit = np.array([_LARGEST_STEP_S, 1e-2])[: len(step)]
            step = np.clip(step, -limit, limit)
            for shrink in _SHRUNK:
                again = self._judged(moved.clock + shrink * step, noise)
                if again[1].unlikely < moved.unlikely + _STALLED:
                    break
            else:
                return moved
            at = again
        raise ConvergenceError("the offset of the clocks has not converged")

    def with_jitter(self, at: _At) -> tuple[_At, _Noise | None]:
        """The likeliest clock with stamps that jitter, where the residuals show that they do."""
        noise: _Noise | None = None
        for _ in range(_ROUNDS):
            again = self._shown(at.clock, noise)
            if again is None:
                break
            noise = again
            at = self.refined(at.clock, noise)
        return at, noise

    def _shown(self, clock: FloatArray, noise: _Noise | None) -> _Noise | None:
        """Noise of the samples, and jitter of their stamps; None where none is shown.

        A jitter leaves residuals along the motion, as large as the arm is fast: the part of the
        white rows along the motion is held against the other five.
        """
        pairs, times = self.pairs(clock)
        found = robust.estimate(pairs, self._covariances(times, clock, noise))
        sizes = found.sigma[:, 0] if noise is None and found.sigma is not None else None
        sigma = noise.sigma if noise is not None else sizes
        if sigma is None:
            raise ValueError("the noise is estimated where none is given")
        model = estimated_model(pairs, sigma[:, None])
        white, _, C = self._white(pairs, found, model, times, clock)
        r, c = white.reshape(-1, 6), C[:, 0].reshape(-1, 6)
        square = np.maximum((c**2).sum(axis=1), np.finfo(float).tiny)
        along = (c * r).sum(axis=1) ** 2 / square
        free = (6.0 * len(r) - 13.0) / (6.0 * len(r))
        rest = float(((r**2).sum(axis=1) - along).sum()) / (5.0 * len(r) * free)

        def unlikely(jitter: FloatArray) -> FloatArray:
            """Minus twice the log-likelihood of variances ``(k,)`` of stamps [s²]."""
            both = rest + jitter[:, None] * square
            return np.asarray((np.log(both) + along / free / both).sum(axis=1))

        tried = np.geomspace(_LEAST_JITTER_S, _MOST_JITTER_S, _JITTERS) ** 2
        values = unlikely(tried)
        best = int(np.argmin(values))
        if float(unlikely(np.zeros(1))[0]) - values[best] < _JITTER_SHOWN:
            return None
        return _Noise(sigma * np.sqrt(rest), float(np.sqrt(tried[best])))

    def _covariances(
        self, times: FloatArray, clock: FloatArray, noise: _Noise | None
    ) -> PairCovariances | None:
        """Covariances of the pairs by stamps that jitter, as an error of A along its motion."""
        if noise is None:
            return None
        near = max(self.robot.step_s, _NEAR_S)
        (ahead, _), (behind, _) = (
            self.robot.at(self._shifted(times, clock) + side * near) for side in (1.0, -1.0)
        )
        moved = noise.jitter_s * difference(ahead, behind) / (2.0 * near)
        own = np.repeat(noise.sigma, 3) ** 2
        A = moved[:, :, None] * moved[:, None, :] + _SHARE_OF_A * np.diag(own)
        return PairCovariances(A=A, B=np.diag(own))

    def _judged(self, clock: FloatArray, noise: _Noise | None) -> tuple[FloatArray, _At]:
        """The step of Newton's method at a clock, and what is known there."""
        pairs, times = self.pairs(clock)
        given = self._covariances(times, clock, noise)
        found = robust.estimate(pairs, given)
        model: ErrorModel
        if given is not None:
            model = given.model(pairs)
        elif found.sigma is not None:
            model = estimated_model(pairs, found.sigma)
        else:
            raise ValueError("the noise is estimated where none is given")
        white, J, C = self._white(pairs, found, model, times, clock)
        covariance = np.linalg.pinv((J.T @ J), hermitian=True)
        moves = -covariance @ (J.T @ C)
        across = C + J @ moves
        # where nothing moves the clock is unknown, and stays
        least = np.diag(np.array([_UNKNOWN_S, 1.0])[: len(clock)] ** -2.0)
        information = across.T @ across + least
        step = np.asarray(-np.linalg.solve(information, across.T @ white.ravel()), dtype=float)
        inverse = np.linalg.inv(information)
        scores = _batches(across, white)
        own = np.asarray(inverse @ (scores.T @ scores) @ inverse, dtype=float)
        alike = max(float(own[0, 0] / inverse[0, 0]), 1.0)
        if alike == 1.0:  # never surer than by independent samples
            own = np.asarray(inverse, dtype=float)
        # as if all samples were within the time of the arm, so that offsets can be compared; one
        # that is left out counts as one at the bound
        out = 1.0 - float(found.used(pairs.N).mean())
        bound = float(chi2_quantile(1.0 - robust.CHANCE, 6))
        if noise is None and found.sigma is not None:
            unlikely = 6.0 * float(np.log(found.sigma[:, 0]).sum()) + out * bound
        else:
            unlikely = float((white**2).sum()) / len(times) + out * bound
        unlikely *= len(self._samples)
        at = _At(clock, np.sqrt(np.diag(own)), unlikely, alike, moves, own)
        return step, at

    def _white(
        self,
        pairs: PairSets,
        found: Estimate,
        model: ErrorModel,
        times: FloatArray,
        clock: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """White rows ``(6 n,)``, and derivatives by X and Z ``(6 n, 12)`` and by the clock."""
        used = found.used(pairs.N)[0]
        white, J = linear_rows(pairs, model, found.X, found.Z)
        near = max(self.robot.step_s, _NEAR_S)
        ends = []
        for side in (-1.0, 1.0):
            A, _ = self.robot.at(self._shifted(times, clock) - side * near)
            moved, _ = linear_rows(PairSets(A[None], pairs.B), model, found.X, found.Z)
            ends.append(moved[:, 0, used])
        along = (ends[1] - ends[0]) / (2.0 * near)  # (6, n), by the offset
        by_clock = [along, along * (times[used] - self.camera.middle_s)][: len(clock)]
        return (
            white[:, 0, used].T.ravel(),
            J[:, :, 0, used].transpose(2, 1, 0).reshape(-1, 12),
            np.stack([one.T.ravel() for one in by_clock], axis=1),
        )

    def result(
        self,
        at: _At,
        noise: _Noise | None,
        others: Sequence[_At],
        largest_s: float,
        *,
        estimate_scale: bool,
    ) -> StreamResult:
        pairs, times = self.pairs(at.clock)
        given = self._covariances(times, at.clock, noise)
        known: Noise | Literal["B"] = "B" if given is None else given
        solved = solve(pairs.A[0], pairs.B[0], "ml-robust", known, estimate_scale=estimate_scale)
        own = solved.covariance
        covariance = np.full((12, 12), np.nan) if own is None else own
        covariance = covariance + at.moves @ at.covariance @ at.moves.T
        findings = []
        if others:
            said = ", ".join(f"{1e3 * one.clock[0]:.1f}" for one in others)
            findings.append(
                Finding(
                    f"the offset of the clocks is in doubt: {said} ms fits as well as "
                    f"{1e3 * at.clock[0]:.1f} ms",
                    np.nan,
                )
            )
        if at.sigma[0] > largest_s / 4.0:
            findings.append(Finding("the motion does not tell the offset of the clocks", np.nan))
        rate = (float(at.clock[1]), float(at.sigma[1])) if len(at.clock) > 1 else (0.0, np.nan)
        return StreamResult(
            solved,
            float(at.clock[0]),
            float(at.sigma[0]),
            *rate,
            covariance,
            0.0 if noise is None else noise.jitter_s,
            times,
            tuple(findings),
        )


def _batches(across: FloatArray, white: FloatArray) -> FloatArray:
    """Sums of the scores of the clock over batches of neighbours ``(b, k)``.

    These are independent where neighbours are alike, and as large as the residuals are there: those
    of a camera whose stamps jitter are large where the arm moves fast.
    """
    scores = (across * white[:, None]).reshape(len(white) // 6, 6, -1).sum(axis=1)
    count = max(min(len(scores) // 4, _BATCHES), 2)
    return np.array([part.sum(axis=0) for part in np.array_split(scores, count)])


def _spread(count: int, most: int) -> IntArray:
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))
