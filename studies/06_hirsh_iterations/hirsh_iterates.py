"""Iterates of Hirsh, DeSouza and Kak 2001, walked through as the paper has them.

The library counts the cycles of the form with consistent signs without walking; this walks.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib import se3
from calib.robot_world import PairSets, Problems, random_problems
from calib.robot_world.algebra import apply_matrix, conjugate, left_matrix, right_matrix
from calib.se3 import FloatArray, IntArray

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
