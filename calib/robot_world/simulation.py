"""Random problems A X = Z B with a known answer, for Monte Carlo studies and tests."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib import se3
from calib.errors import InputError, one_line
from calib.robot_world.noise import Noise, check_noise, check_noise_given, is_number, perturb
from calib.robot_world.pairs import PairSets
from calib.se3 import FloatArray

_REACH_M = 0.5
"""Half the side of the cube that the flange moves in."""

_MOST_DRAWN = 10_000_000
"""Trials or pairs beyond any study, and beyond the memory."""

_CAMERA_OFFSET_M = 0.3
_TARGET_OFFSET_M = 1.0
"""Largest coordinates of the camera in the flange frame, and of the target in the base frame."""


@dataclass(frozen=True, eq=False)
class Problems:
    """T problems without noise: ``A X = Z B`` holds to rounding."""

    A: FloatArray
    B: FloatArray  # A, B (T, N, 4, 4): transforms of the pairs [m]
    X: FloatArray
    Z: FloatArray  # X, Z (T, 4, 4): the answer [m]

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
    check_generator(rng)
    for name, count in (("trials", trials), ("pairs", pairs)):
        if not is_number(count) or count != int(count) or not 0 < count < _MOST_DRAWN:
            raise InputError(
                f"{name} is {one_line(count)}, not a number from 1 to {_MOST_DRAWN:.0e}", name=name
            )
    if cone_deg is not None and not (is_number(cone_deg) and cone_deg >= 0.0):
        raise InputError(f"cone_deg is {one_line(cone_deg)}, not an angle", name="cone_deg")
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
    check_generator(rng)
    check_noise_given(noise)
    A, B = se3.check_transforms(A, "A"), se3.check_transforms(B, "B")
    if A.ndim < 3 or A.shape != B.shape:
        raise InputError(f"A has shape {A.shape} and B has {B.shape}, not both (..., N, 4, 4)")
    check_noise(noise, A.shape[-3])
    found = []
    for T, root in zip((A, B), noise.roots(A, B), strict=True):
        if root is None:
            found.append(T)
        else:
            white = rng.normal(size=(*T.shape[:-2], 6)).reshape(-1, 6, 1)
            found.append(perturb(T, (root @ white).reshape(*T.shape[:-2], 6)))
    return found[0], found[1]


def check_generator(rng: object) -> None:
    """Refuse what is no source of random numbers."""
    if not isinstance(rng, np.random.Generator):
        raise InputError(
            f"rng is {one_line(rng)}, no generator of random numbers",
            hint="give np.random.default_rng(seed)",
            name="rng",
        )


def _any_rotation(rng: np.random.Generator, count: int) -> FloatArray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.random(count, rng=rng).as_matrix())


def _box(rng: np.random.Generator, half_side: float, shape: tuple[int, ...]) -> FloatArray:
    return rng.uniform(-half_side, half_side, shape)
