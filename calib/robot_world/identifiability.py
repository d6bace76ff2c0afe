"""Whether the motion of a set of poses identifies X and Z.

The rotations identify X and Z exactly when ``mean R_A ⊗ R_B`` has a single largest singular value:
a second one belongs to another X that fits as well. ``√(2 (s_1 - s_2))`` measures how far the poses
are from that: it is the root mean square angle by which the common axis tilts from pose to pose, as
far as A and B agree on it. It vanishes where all rotations between poses are

* about one axis, or there are none: X is free in a continuum;
* about one axis or half turns at right angles to it: X is free by half a turn, since a half turn
  does not show the direction of its axis.

With noise on both sides A and B agree by chance, too, by some ``σ / N^¼`` if σ is the residual
rotation about one axis. The rotations must be orthonormal to rounding: a scale enters the singular
values in the first order.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib import se3
from calib.errors import NotIdentifiableError
from calib.robot_world.algebra import (
    apply_matrix,
    conjugate,
    left_matrix,
)
from calib.robot_world.closed_form import assemble
from calib.robot_world.estimate import residuals
from calib.robot_world.pairs import PairSets
from calib.se3 import BoolArray, FloatArray

TILT_TOLERANCE_RAD = 1e-5
"""Tilt of the common axis that counts as none: above the rounding of a file with six decimals."""

CHANCE_FACTOR = 7.0
"""Square of the tilt, over σ²/√N, that noise on both sides makes by chance in one of a thousand
sets of poses without any; ``(N / (N - 2))²`` times that where poses are few. By simulation of
rotations about one axis, of none, and of half turns, with 3 to 100 poses."""

MISFIT_FACTOR = 3.0
"""Residual rotation, in units of that of the closed form, beyond which a method has failed: a
method may trade rotation for translation, but the rotations alone bound what is reasonable."""

MISFIT_FLOOR_RAD = 1e-6
"""Residual rotation that is never a misfit: above the rounding of any method."""

TRANSLATION_MISFIT_FACTOR = 10.0
"""The same for the residual translation. The methods that solve for everything at once trade it
for rotation by a factor of a few; Eq. 19 of Li et al. 2010 loses it altogether where the target
stays in one place of the camera's view (every touch-up), since the scale of R_Z is then free."""

MISFIT_FLOOR = 1e-8
"""Residual translation, as part of the root mean square translation, that is never a misfit."""

_ABOVE_TILT = 3.0
"""Rotation about an axis, in units of the tilt or of the residuals, from which the message counts
it as one: rotation that merely makes up the tilt, or the noise, is of its own size."""

_FAR_ENOUGH = 2.0
"""Bound of the tilt, over what is enough, from which on its value does not matter."""

_SAME_PLACE_M = 1e-6
"""Movement that counts as none when the message says what is free."""


_FEW = 5
"""Pairs up to which it is often their number that hides the motion."""

_NONE_FREE = 1e-9

_REMEDIES = {
    "no rotation": "add poses that turn the flange about two axes, by 30 deg or more",
    "one axis": "add poses that turn the flange about another axis, by 30 deg or more",
    "half turns": "add poses that turn the flange about another axis, by less than half a turn",
}
"""What to do where the motion falls short."""

Other = tuple[str, FloatArray, FloatArray]
"""In words how X is turned, then X and Z ``(4, 4)``."""


@dataclass(frozen=True, eq=False)
class Motion:
    """What the rotations of T sets of pose pairs tell."""

    pairs: PairSets
    tilt_rad: FloatArray
    """(T,): root mean square tilt of the common axis, or where that is more than enough, some bound
    below it; as far as A and B agree."""
    residual_rad: FloatArray
    """(T,): root mean square residual rotation angle of the closed form of the rotations."""
    residual_m: FloatArray
    """(T,): root mean square residual translation with these rotations, the translations solved
    for."""
    rank_deficient: BoolArray
    degenerate: BoolArray
    """rank_deficient, degenerate (T,): no tilt; none that stands out of the noise."""

    @cached_property
    def turn_rad(self) -> FloatArray:
        """Root mean square rotation ``(T, 2)`` [rad] about the main axis, and about the next one.

        The smaller of what A and B show.
        """
        return np.minimum(_turns(self.pairs.A), _turns(self.pairs.B))

    @cached_property
    def turned_rad(self) -> FloatArray:
        """Root mean square rotation ``(T,)`` [rad] from the mean, from 0 to 1.2 for any rotations.

        ``|mean R|²`` is the mean over all i, j of ``1 + 2 cos`` of the angle between R_i and R_j.
        The smaller of what A and B show.
        """
        means = (self.pairs.mean_R_A, self.pairs.mean(self.pairs.R_B))
        square = [0.5 * (3.0 - (mean * mean).sum(axis=(0, 1))) for mean in means]
        return np.asarray(np.sqrt(np.clip(np.minimum(*square), 0.0, None)))

    @cached_property
    def moved_m(self) -> FloatArray:
        """Root mean square distance ``(T,)`` of the origins from their mean, A's and B's."""
        return np.where(self.pairs.moves, self.pairs.size, 0.0)

    @cached_property
    def misfit(self) -> FloatArray:
        """Residual of the closed form, in parts of the motion ``(T,)``.

        The larger of rotation's and translation's, or that of rotation alone where nothing fixes X.
        """
        turned, moved = self.turned_rad, np.where(self.degenerate, 0.0, self.moved_m)
        of_turn = np.where(
            turned > 0.0, self.residual_rad / np.where(turned > 0.0, turned, 1.0), 0.0
        )
        of_move = np.where(moved > 0.0, self.residual_m / np.where(moved > 0.0, moved, 1.0), 0.0)
        return np.maximum(of_turn, of_move)

    def is_misfit(self, angle_rms: FloatArray, distance_rms: FloatArray) -> BoolArray:
        """Whether a method failed in the sets ``(T,)``, by the residuals that it leaves."""
        largest_rad = MISFIT_FACTOR * self.residual_rad + MISFIT_FLOOR_RAD
        largest_m = TRANSLATION_MISFIT_FACTOR * self.residual_m + MISFIT_FLOOR * self.pairs.size
        return np.asarray((angle_rms > largest_rad) | (distance_rms > largest_m))


def examine(pairs: PairSets) -> Motion:
    """Measure the motion of T sets of pose pairs."""
    residual_rad, residual_m = pairs.left_by_rotations_first
    # two rotations always fit: nothing stands out of them
    N, free = pairs.N, max(pairs.N - 2.0, _NONE_FREE)
    variance = residual_rad**2 * N / (3.0 * free)
    by_chance = CHANCE_FACTOR * (N / free) ** 2 * variance / np.sqrt(N)
    enough = np.maximum(np.sqrt(by_chance), TILT_TOLERANCE_RAD)
    tilt = _tilt(pairs, enough)
    rank_deficient = tilt < TILT_TOLERANCE_RAD
    return Motion(pairs, tilt, residual_rad, residual_m, rank_deficient, tilt < enough)


def not_identifiable(motion: Motion, A: FloatArray, B: FloatArray) -> NotIdentifiableError:
    """Error that names what one set of pairs ``(N, 4, 4)``, found degenerate, leaves free."""
    kind = _class_of(motion)
    if kind == "no rotation":
        parameters, combinations = _without_rotation(A, B)
    elif kind == "one axis":
        axis = _common_axis(A)
        parameters = [
            f"translation of X along the common axis {axis}",
            "rotation of X about it",
        ]
        combinations = [
            f"all rotations between the poses are about the axis {axis} of the flange",
            "Z takes up the one, and the rotations do not show the other",
        ]
    else:
        parameters = ["rotation of X by half a turn"]
        combinations = [
            "all rotations between the poses are about one axis or half turns at right angles to "
            "it, so X turned by half a turn fits them as well"
        ]
    if not motion.rank_deficient[0]:
        combinations.append(
            f"whatever else the poses turn ({np.degrees(motion.tilt_rad[0]):.2g} deg) does not "
            f"stand out of the residuals ({np.degrees(motion.residual_rad[0]):.2g} deg) of "
            f"{motion.pairs.N} pairs"
        )
    return NotIdentifiableError(parameters, combinations, hint=_remedy(kind, motion))


def _remedy(kind: str, motion: Motion) -> str:
    """What to do where the motion falls short, or the number of pairs."""
    if motion.rank_deficient[0] or motion.pairs.N > _FEW:
        return _REMEDIES[kind]
    return f"{_REMEDIES[kind]}; {motion.pairs.N} pairs hardly tell motion from noise"


def half_turns(pairs: PairSets, motion: Motion, R_X: FloatArray) -> tuple[Other, ...]:
    """Other X and Z that fit the rotations of one degenerate set, where they are a finite number.

    Other than the rotation R_X ``(3, 3)`` of X; none where X is free in a continuum. If R_X fits,
    so does ``C R_X`` with any rotation C that commutes with all rotations between the poses.
    Matrices that do are a linear space, spanned by the singular vectors of
    :func:`~calib.robot_world.algebra.kronecker_mean` next to the first. Besides the identity it
    holds symmetric ones where there is a choice of half turns, about their eigenvectors.
    """
    if _class_of(motion) != "half turns":
        return ()
    _, values, Vt = np.linalg.svd(pairs.kronecker_mean[0])
    limit = max(_ABOVE_TILT * float(motion.tilt_rad[0]), TILT_TOLERANCE_RAD)
    near = np.flatnonzero(np.sqrt(np.clip(2.0 * (values[0] - values), 0.0, None)) < limit)
    commuting = Vt[near].reshape(-1, 3, 3) @ R_X.T
    # unequal weights, so that no two eigenvalues of the sum agree by chance
    weights = 1.0 / (1.0 + np.arange(len(near)))
    mixed = np.einsum("k,kij->ij", weights, commuting + np.swapaxes(commuting, -1, -2))
    found = []
    largest_rad = MISFIT_FACTOR * float(motion.residual_rad[0]) + MISFIT_FLOOR_RAD
    for axis in np.linalg.eigh(mixed)[1].T:
        turned = (2.0 * np.outer(axis, axis) - np.eye(3)) @ R_X[None]
        R_A, R_B = pairs.A[..., :3, :3], pairs.B[..., :3, :3]
        mean = (R_A @ turned[:, None] @ np.swapaxes(R_B, -1, -2)).mean(axis=1)
        X, Z = assemble(pairs, turned, se3.project_to_rotation(mean))
        error = residuals(pairs.A, pairs.B, X, Z)[0, :, :3]
        if np.sqrt((error**2).sum(axis=-1).mean()) <= largest_rad:
            text = f"X turned by half a turn about the axis {direction(axis)} of the flange"
            found.append((text, X[0], Z[0]))
    return tuple(found)


def turned_by_translations(pairs: PairSets, others: tuple[Other, ...]) -> PairSets:
    """One set with the rotations in closed form that the translations fit best, of some choice."""
    X, Z = pairs.rotations_first
    choice = [(X[0], Z[0]), *((X, Z) for _, X, Z in others)]
    left_m = [float(pairs.residual_rms(X[None], Z[None])[1][0]) for X, Z in choice]
    X, Z = choice[int(np.argmin(left_m))]
    turned = PairSets(pairs.A, pairs.B)
    turned.rotations = X[None, :3, :3], Z[None, :3, :3]
    return turned


def _class_of(motion: Motion) -> str:
    """What is the matter with the first set, found degenerate."""
    tilt_rad, noise_rad = float(motion.tilt_rad[0]), float(motion.residual_rad[0])
    least_rad = max(TILT_TOLERANCE_RAD, _ABOVE_TILT * max(tilt_rad, noise_rad))
    main_rad, next_rad = motion.turn_rad[0]
    if main_rad < least_rad:
        return "no rotation"
    return "one axis" if next_rad < least_rad else "half turns"


def _without_rotation(A: FloatArray, B: FloatArray) -> tuple[list[str], list[str]]:
    """What is free, and why, where the poses differ by no rotation."""
    free = ["translation of X", "rotation of X"]
    if min(np.ptp(T[:, :3, 3], axis=0).max() for T in (A, B)) < _SAME_PLACE_M:
        return free, ["all poses are the same, so Z takes up any change of X"]
    return free, [
        "the poses differ by translations only, so Z takes up any translation of X",
        "no rotation shows in which direction X is turned",
    ]


def _turns(T: FloatArray) -> FloatArray:
    """Root mean square rotation ``(T, 2)`` [rad] about the main axis and about the next one.

    The quaternions of orientations that differ by rotations about one axis lie in a plane, so the
    eigenvalues of ``mean q qᵀ`` after the first are mean squares of sines of half the angles.
    """
    q = se3.quaternion_from_rotation(T[..., :3, :3])
    mean_square = np.linalg.eigvalsh(np.swapaxes(q, -1, -2) @ q / q.shape[1])
    half_sine = np.sqrt(np.clip(mean_square[:, [2, 1]], 0.0, 1.0))
    return np.asarray(2.0 * np.arcsin(half_sine))


def _tilt(pairs: PairSets, enough: FloatArray) -> FloatArray:
    """Root mean square angle ``(T,)`` [rad] by which the common axis tilts from pose to pose.

    The sum of the squares of all singular values but the first bounds the second from above, and
    the tilt from below. Where that bound is enough it will do: most sets of poses are far from any
    doubt.
    """
    K, first = pairs.kronecker_mean, pairs.leading[2]
    others = np.clip((K * K).sum(axis=(1, 2)) - first**2, 0.0, None)
    tilt = np.sqrt(2.0 * np.clip(first - np.sqrt(others), 0.0, None))
    doubtful = ~(tilt > _FAR_ENOUGH * enough)
    if doubtful.any():
        values = np.linalg.svd(K[doubtful], compute_uv=False)
        tilt[doubtful] = np.sqrt(2.0 * (values[:, 0] - values[:, 1]))
    return np.asarray(tilt)


def _common_axis(A: FloatArray) -> str:
    """The axis of the rotations of one set ``(N, 4, 4)``, in the frame that A maps from."""
    q = se3.quaternion_from_rotation(A[:, :3, :3])
    _, vectors = np.linalg.eigh(q.T @ q)
    axis = apply_matrix(left_matrix(conjugate(vectors[:, 3])), vectors[:, 2])[1:]
    return direction(axis)


def direction(axis: FloatArray) -> str:
    """A unit vector ``(3,)`` as text, with its largest component positive."""
    axis = axis * np.sign(axis[np.abs(axis).argmax()]) / np.linalg.norm(axis)
    return "(" + ", ".join(f"{value:.3g}" for value in axis.round(3) + 0.0) + ")"
