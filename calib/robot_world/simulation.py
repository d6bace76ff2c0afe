"""Random problems A X = Z B with a known answer, for Monte Carlo studies and tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from calib import se3
from calib.robot_world.noise import Noise, perturb
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

_REACH_M = 0.5
"""Half the side of the cube that the flange moves in."""

_CAMERA_OFFSET_M = 0.3
_TARGET_OFFSET_M = 1.0
"""Largest coordinates of the camera in the flange frame, and of the target in the base frame."""


@dataclass(frozen=True, eq=False)
class Problems:
    """T problems without noise: ``A X = Z B`` holds to rounding.

    Attributes
    ----------
    A, B : ndarray (T, N, 4, 4)
        Transforms of the pairs [m].
    X, Z : ndarray (T, 4, 4)
        The answer [m].
    """

    A: FloatArray
    B: FloatArray
    X: FloatArray
    Z: FloatArray

    @property
    def pairs(self) -> PairSets:
        """A and B as the methods take them."""
        return PairSets(self.A, self.B)


def random_problems(
    rng: np.random.Generator, trials: int, pairs: int, cone_deg: float | None = None
) -> Problems:
    """Draw problems: X and Z of any orientation, poses of any orientation or in a cone.

    Parameters
    ----------
    rng : numpy.random.Generator
        Source of randomness.
    trials, pairs : int
        T and N.
    cone_deg : float, optional
        The rotations of A are about axes uniform over the sphere, by angles uniform in plus and
        minus this; without it they are uniform over all orientations.

    Returns
    -------
    Problems
        With ``B = Z⁻¹ A X``. Flange in a cube of 1 m, camera within 0.3 m of it and target within
        1 m of the base along each axis.
    """
    X = se3.transform(_any_rotation(rng, trials), _box(rng, _CAMERA_OFFSET_M, (trials, 3)))
    Z = se3.transform(_any_rotation(rng, trials), _box(rng, _TARGET_OFFSET_M, (trials, 3)))
    shape = (trials, pairs)
    if cone_deg is None:
        R = _any_rotation(rng, trials * pairs).reshape(*shape, 3, 3)
    else:
        axis = rng.normal(size=(*shape, 3))
        axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
        R = se3.rotation_exp(axis * np.radians(_box(rng, cone_deg, (*shape, 1))))
    A = se3.transform(R, _box(rng, _REACH_M, (*shape, 3)))
    return Problems(A, se3.inverse(Z)[:, None] @ A @ X[:, None], X, Z)


def add_noise(
    rng: np.random.Generator, A: FloatArray, B: FloatArray, noise: Noise
) -> tuple[FloatArray, FloatArray]:
    """A and B ``(..., N, 4, 4)`` as measured, with independent noise on the sides that have it."""
    found = []
    for T, root in zip((A, B), noise.roots(A, B), strict=True):
        if root is None:
            found.append(T)
        else:
            white = rng.normal(size=(*T.shape[:-2], 6)).reshape(-1, 6, 1)
            found.append(perturb(T, (root @ white).reshape(*T.shape[:-2], 6)))
    return found[0], found[1]


def _any_rotation(rng: np.random.Generator, count: int) -> FloatArray:
    return np.asarray(Rotation.random(count, rng=rng).as_matrix())


def _box(rng: np.random.Generator, half_side: float, shape: tuple[int, ...]) -> FloatArray:
    return rng.uniform(-half_side, half_side, shape)
