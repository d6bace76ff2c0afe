"""Iterates of Hirsh, DeSouza and Kak 2001, and what they say of each claim of the paper.

The library counts the cycles of the form with consistent signs without walking; this walks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np

from calib import se3
from calib.robot_world import METHODS, PairSets, Problems, random_problems
from calib.robot_world.algebra import apply_matrix, conjugate, left_matrix, right_matrix
from calib.robot_world.methods import hirsh
from calib.se3 import FloatArray, IntArray
from studies.intervals import share

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])
"""The paper's first guess of Z."""


@dataclass(frozen=True, eq=False)
class Views:
    """T problems of N views: the pairs as measured, and the true z ``(T, 4)``."""

    pairs: PairSets
    z: FloatArray

    def first(self, count: int, problems: int | None = None) -> Views:
        """The same problems with the first views alone, or the first problems of them."""
        A, B = (T[:problems, :count] for T in (self.pairs.A, self.pairs.B))
        return Views(PairSets(A, B), self.z[:problems])

    @cached_property
    def mean(self) -> FloatArray:
        """M ``(T, 4, 4)``, by which x gives the average of its z, and its transpose the reverse."""
        return _products(*self.pairs.quaternions).mean(axis=1)


def draw(rng: np.random.Generator, trials: int, views: int, cone_deg: float) -> Problems:
    """Problems without noise."""
    return random_problems(rng, trials, views, cone_deg or None)


def exact(problems: Problems) -> Views:
    """The views of Fig. 3."""
    return Views(problems.pairs, se3.quaternion_from_rotation(problems.Z[:, :3, :3]))


def noisy(rng: np.random.Generator, problems: Problems, noise_deg: float) -> Views:
    """The views of Fig. 4: every camera pose turned by one angle about an axis of its own."""
    axis = rng.normal(size=(*problems.B.shape[:2], 3))
    axis *= np.radians(noise_deg) / np.linalg.norm(axis, axis=-1, keepdims=True)
    B = problems.B.copy()
    B[..., :3, :3] = B[..., :3, :3] @ se3.rotation_exp(axis)
    return Views(PairSets(problems.A, B), exact(problems).z)


def any_guess(rng: np.random.Generator, trials: int) -> FloatArray:
    """First guesses ``(T, 4)``, uniform over all orientations."""
    guess = rng.normal(size=(trials, 4))
    return guess / np.linalg.norm(guess, axis=-1, keepdims=True)


def error(z: FloatArray, truth: FloatArray) -> FloatArray:
    """The paper's error ``(T,)`` [rad]: the angle between quaternions as vectors of four numbers.

    Half the rotation angle; q and -q are one rotation, so it is at most π/2. By the sine, which
    keeps the digits that the paper's cosine loses near zero.
    """
    along = (z * truth).sum(axis=-1)
    across = np.linalg.norm(z - along[:, None] * truth, axis=-1)
    return np.asarray(np.arctan2(across, np.abs(along)))


def walk(views: Views, cycles: IntArray, guess: FloatArray) -> FloatArray:
    """Errors ``(K, T)`` after some numbers of cycles, with the signs of the pairs consistent.

    Cycle by cycle, ``z <- M Mᵀ z``, normalised: both averages of the paper.
    """
    step = views.mean @ np.swapaxes(views.mean, -1, -2)
    out, z = [], np.broadcast_to(guess, views.z.shape)
    for k in range(int(cycles.max()) + 1):
        if k in cycles:
            out.append(error(z, views.z))
        z = apply_matrix(step, z)
        z = z / np.linalg.norm(z, axis=-1, keepdims=True)
    return np.array(out)


def walk_by_squaring(views: Views, powers: int, guess: FloatArray) -> FloatArray:
    """Errors ``(powers, T)`` after 1, 2, 4, 8, ... cycles: the same walk with longer and longer
    steps, for workspaces that need thousands of them."""
    step = views.mean @ np.swapaxes(views.mean, -1, -2)
    out = []
    for _ in range(powers):
        z = apply_matrix(step, np.broadcast_to(guess, views.z.shape))
        out.append(error(z / np.linalg.norm(z, axis=-1, keepdims=True), views.z))
        step = step @ step
        step = step / np.linalg.norm(step, axis=(-2, -1), keepdims=True)
    return np.array(out)


def walk_as_printed(views: Views, limit: int, guess: FloatArray) -> Iterator[FloatArray]:
    """Estimates z ``(T, 4)`` after 0, 1, 2, ... cycles as printed: every scalar part made >= 0."""
    a = se3.quaternion_from_rotation(views.pairs.A[..., :3, :3])
    b = se3.quaternion_from_rotation(views.pairs.B[..., :3, :3])
    forward = _products(a, b)
    backward = np.swapaxes(forward, -1, -2)
    z = np.broadcast_to(guess, views.z.shape)
    yield z
    for _ in range(limit):
        x = _average(apply_matrix(backward, z[:, None]))
        z = _average(apply_matrix(forward, x[:, None]))
        yield z


def _products(a: FloatArray, b: FloatArray) -> FloatArray:
    """Matrices ``(T, N, 4, 4)`` of ``z = a x b*``."""
    return left_matrix(a) @ right_matrix(conjugate(b))


def _average(quaternions: FloatArray) -> FloatArray:
    """Normalised mean ``(T, 4)`` of ``(T, N, 4)`` with scalar parts >= 0; items 1 and 4 of 2.2."""
    mean = np.where(quaternions[..., :1] < 0.0, -quaternions, quaternions).mean(axis=1)
    size = np.linalg.norm(mean, axis=-1, keepdims=True)
    return np.where(size > 1e-12, mean / np.maximum(size, 1e-12), IDENTITY)


STANDSTILL_RAD = 1e-9
"""Change of z in a cycle below which the printed form has settled: in the narrowest cone, where it
is slowest, a run that is 1e-4 away still moves by 1e-7."""


def speed(views: Views, tolerance_rad: float) -> dict[str, Any]:
    """Cycles to the tolerance, counted and predicted from the rate (σ2/σ1)²."""
    counted = hirsh.cycles(views.pairs, tolerance_rad)
    predicted = hirsh.predicted_cycles(views.pairs, tolerance_rad)
    ratio = np.ceil(predicted) / np.maximum(counted, 1)
    return {
        "cycles": dict(zip(("q25", "median", "q75", "q99"), _quartiles(counted), strict=True)),
        "predicted_median": float(np.median(np.ceil(predicted))),
        "ratio": dict(zip(("q25", "median", "q75", "q99"), _quartiles(ratio), strict=True)),
        "not_converged": share(counted >= hirsh.CYCLE_LIMIT),
    }


def _quartiles(values: FloatArray | IntArray) -> list[float]:
    return [float(q) for q in np.quantile(values, [0.25, 0.5, 0.75, 0.99])]


ENDS = ("arrived", "settled elsewhere", "wandering", "undecided")
"""How a run of the printed form stands after a number of cycles. It is wandering where it neither
arrives nor settles though the form with consistent signs has arrived; undecided where that has not
either."""


def ends_of(views: Views, limit: int, tolerance_rad: float, guess: FloatArray) -> IntArray:
    """Index into :data:`ENDS` ``(T,)`` of the printed form."""
    z = last = np.broadcast_to(guess, views.z.shape)
    for new in walk_as_printed(views, limit, guess):
        last, z = z, new
    arrived = error(z, views.z) <= tolerance_rad
    still = np.linalg.norm(z - last, axis=-1) <= STANDSTILL_RAD
    in_time = walk(views, np.array([limit]), guess)[0] <= tolerance_rad
    return np.select([arrived, still, in_time], [0, 1, 2], 3)


def as_printed(views: Views, limit: int, tolerance_rad: float) -> dict[str, Any]:
    """Shares of the ends of the printed form, from the identity, without noise.

    ``of_decided`` is what arrives of the runs that are not undecided.
    """
    ends = ends_of(views, limit, tolerance_rad, IDENTITY)
    found: dict[str, Any] = {name: share(ends == k) for k, name in enumerate(ENDS)}
    decided = ends[ends < ENDS.index("undecided")]
    found["of_decided"] = share(decided == 0) if len(decided) else None
    return found | {"cycles": limit, "problems": len(ends)}


def from_many_guesses(
    rng: np.random.Generator, views: Views, guesses: int, limit: int, tolerance_rad: float
) -> dict[str, Any]:
    """The printed form from several random guesses for each problem.

    The paper advises another guess where one has failed, and says that any will do.
    """
    count = max(1, views.pairs.T // guesses)
    repeated = np.repeat(np.arange(count), guesses)
    every = Views(PairSets(views.pairs.A[repeated], views.pairs.B[repeated]), views.z[repeated])
    ends = ends_of(every, limit, tolerance_rad, any_guess(rng, len(repeated)))
    arrived = (ends == 0).reshape(count, guesses)
    return {
        "arrived": share(arrived.ravel()),
        "problems": count,
        "all_guesses_arrive": share(arrived.all(axis=1)),
        "no_guess_arrives": share(~arrived.any(axis=1)),
    }


def more_views(views: Views, counts: list[int], tolerance_rad: float) -> list[dict[str, Any]]:
    """In how many problems more of the same views take fewer cycles."""
    cycles = {n: hirsh.cycles(views.first(n).pairs, tolerance_rad) for n in counts}
    return [
        {
            "few": few,
            "many": many,
            "faster": share(cycles[many] < cycles[few]),
            "slower": share(cycles[many] > cycles[few]),
        }
        for few, many in pairwise(counts)
    ]


def floor(views: Views, noise_deg: float) -> dict[str, Any]:
    """Error at which the iteration ends under noise, against the line of the noise itself.

    In the paper's measure a turn by 1 deg is .0087 rad; were its line at .0175 rad, the whole
    angle, more would be below it.
    """
    Z = METHODS["hirsh"].run(views.pairs, None).Z
    end = error(se3.quaternion_from_rotation(Z[:, :3, :3]), views.z)
    line = np.radians(noise_deg) / 2.0
    return {
        "median_rad": float(np.median(end)),
        "mean_rad": float(end.mean()),
        "q25_rad": float(np.quantile(end, 0.25)),
        "q75_rad": float(np.quantile(end, 0.75)),
        "below_line": share(end < line),
        "below_twice_the_line": share(end < 2.0 * line),
    }


def in_a_second(views: Views, tolerance_rad: float, computer: dict[str, float]) -> dict[str, Any]:
    """Share of the problems that a computer of the time solves within a second."""
    a_view = computer["operations_a_view"] * computer["clocks_an_operation"]
    cycles_a_second = computer["hertz"] / (a_view * views.pairs.N)
    return {
        "cycles_a_second": cycles_a_second,
        "in_time": share(hirsh.cycles(views.pairs, tolerance_rad) <= cycles_a_second),
    }
