"""The scale of B's translations: one more linear unknown, by which they fit those of A.

A tag of another size than was said, a board with other squares, millimetres read as centimetres
and a wrong focal length multiply the translations of B, as a robot in another unit does those of
A. The rotations do not change, and with few poses that look at one place X and Z take up most of
it: residuals say little. With s beside X and Z the translations say ``R_A p_X + p_A - s R_Z p_B -
p_Z = 0``, linear in p_X, p_Z and s. Multiplied by any number the same equation holds with other
lengths of A, p_X and p_Z, so that the pairs tell the ratio of the two scales alone: lengths of A
are taken as true.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from calib import se3
from calib.batch_last import columns_of, turn, turn_back
from calib.chance import student_tail
from calib.robot_world.accuracy import judged, widening
from calib.robot_world.adjustment import adjust
from calib.robot_world.algebra import apply_matrix, least_squares
from calib.robot_world.closed_form import assemble
from calib.robot_world.errors_of_pairs import ErrorModel
from calib.robot_world.estimate import Fit
from calib.robot_world.methods.maximum_likelihood import with_estimated_noise
from calib.robot_world.noise import Noise
from calib.robot_world.pairs import PairSets
from calib.robot_world.sequence import LEVEL, UNKNOWN
from calib.robot_world.sizes import estimated_model
from calib.se3 import BoolArray, FloatArray

WRONG = 1e-2
"""Distance of the scale from 1 that matters: a printed target is as long as it should be to some
thousandths."""

_ONE_AXIS = 0.8
"""Length of the mean of unit vectors along the lines of sight, below which there is no axis of the
camera that all of them are near to: 37 deg."""

_ROUNDS = 12
"""Steps of the scale; three or four are usual."""

_SETTLED = 1e-3
"""Step in standard deviations that counts as none."""

_LARGEST_STEP = 1.0
"""Largest step of the logarithm of the scale."""

_LARGEST = 1e5
"""Scale beyond which, and below whose inverse, there is none to start from: more than mm for m."""

_UNSEEN = 1e-10
"""Part of the scale's rows that X and Z do not take up, below which nothing is left of it."""


_RUNS, _FEWEST_IN_RUN = 8, 2
"""Runs of pairs that are left out one after the other, and pairs in each."""

_LEAST = 1e-300
"""Length of derivatives that are none."""


@dataclass(frozen=True, eq=False)
class Scale:
    """By what the translations of B have to be multiplied, estimated together with X and Z."""

    value: float
    sigma: float
    """value, sigma: the factor and its standard deviation; infinite where the pairs do not tell
    it."""
    X: FloatArray
    Z: FloatArray  # X, Z (4, 4): the likeliest ones with it [m], lengths of A being true
    covariance: FloatArray | None
    """(13, 13): of X and Z, as :attr:`RobotWorldResult.covariance`, and of the factor; None where
    the pairs do not tell it."""
    freedom: int  # degrees of freedom of the residuals that it comes from

    @property
    def is_told(self) -> bool:
        """Whether the pairs tell the scale at all."""
        return self.sigma < UNKNOWN * self.value

    @property
    def sigmas(self) -> float:
        """How far the factor is from 1, in standard deviations of its logarithm."""
        return abs(float(np.log(self.value))) * self.value / self.sigma

    @property
    def probability(self) -> float:
        """Of a factor as far from 1 by chance, by Student's distribution."""
        return 2.0 * float(student_tail(self.sigmas, max(self.freedom, 1)))

    @property
    def is_named(self) -> bool:
        """Whether it is told to be another than 1."""
        return self.is_told and self.probability < LEVEL

    @property
    def is_one(self) -> bool:
        """Whether it is told to be 1, as closely as matters."""
        return max(abs(self.value - 1.0), self.sigma) < WRONG and not self.is_named

    @property
    def in_words(self) -> str:
        """How far it is from 1, in words."""
        return (
            f"translations of B fit those of A multiplied by {self.value:.5g} ± {self.sigma:.2g}, "
            f"{self.sigmas:.0f} standard deviations from 1"
        )

    def times(self, factor: float) -> Scale:
        """The scale of pairs that these came from by a factor."""
        covariance = self.covariance
        if covariance is not None:
            unit = np.append(np.ones(12), factor)
            covariance = covariance * np.outer(unit, unit)
        sigma = self.sigma * factor
        return replace(self, value=self.value * factor, sigma=sigma, covariance=covariance)


def scaled(pairs: PairSets, factor: FloatArray | float) -> PairSets:
    """Pairs with the translations of B multiplied by a factor for each set ``(T,)``."""
    B = pairs.B.copy()
    B[..., :3, 3] *= np.reshape(factor, (-1, 1, 1))
    return PairSets(pairs.A, B, tentative=pairs.tentative)


def by_rotations_first(pairs: PairSets) -> FloatArray:
    """Factors ``(T,)`` by least squares of the translations, with the rotations in closed form.

    1 where there is none. The equations are solved for 1/s, whose coefficients are translations of
    A: those of B have most of the noise, which would make s too small as coefficients.
    """
    R_A, p_A = pairs.A[..., :3, :3], pairs.A[..., :3, 3]
    q = apply_matrix(pairs.rotations[1][:, None], pairs.B[..., :3, 3])
    rows = np.concatenate([R_A, p_A[..., None]], axis=-1)
    rows = (rows - rows.mean(axis=1, keepdims=True)).reshape(pairs.T, -1, 4)
    right = (q - q.mean(axis=1, keepdims=True)).reshape(pairs.T, -1)
    inverse = least_squares(rows, right)[:, 3]
    sound = (inverse > 1.0 / _LARGEST) & (inverse < _LARGEST)
    return np.where(sound, 1.0 / np.where(sound, inverse, 1.0), 1.0)


def likeliest(pairs: PairSets, kept: PairSets, used: BoolArray, noise: Noise | None) -> Scale:
    """Estimate the scale of one set with X and Z, weighted as the noise says.

    Of all pairs; those kept are the ones used ``(N,)``, with the rotations to start from. The noise
    is of the pairs with the scale corrected, or else as the residuals show it.
    """
    weights = used[None].astype(float)
    log_scale = float(np.log(by_rotations_first(kept)[0]))
    R_X, R_Z = kept.rotations
    X, Z = assemble(scaled(kept, np.exp(log_scale)), R_X, R_Z)
    for _ in range(_ROUNDS):
        fit = _with_column(scaled(pairs, np.exp(log_scale)), X, Z, weights, noise)
        X, Z = fit.X, fit.Z
        own, whole = _not_taken_up(fit.jacobian[:, :, 0].reshape(13, -1))
        information = float(own @ own)
        told = information > _UNSEEN * whole
        if not told:
            break
        step = -float(own @ fit.white[:, 0].reshape(-1)) / information
        log_scale += float(np.clip(step, -_LARGEST_STEP, _LARGEST_STEP))
        if step**2 * information < _SETTLED**2:
            break
    value = float(np.exp(log_scale))
    freedom = 6 * int(used.sum()) - 13
    excess = 1.0 if noise is None else float(judged(fit.cost, freedom)[1][0])
    if not told:
        return Scale(1.0, np.inf, X[0], Z[0], None, freedom)
    covariance = _joint(fit, used, excess, known=noise is not None)
    unit = np.append(np.ones(12), value)
    covariance *= np.outer(unit, unit)
    return Scale(value, float(np.sqrt(covariance[12, 12])), X[0], Z[0], covariance, freedom)


@lru_cache(maxsize=1)  # of the same pairs by one method after the other
def likeliest_of_all(pairs: PairSets) -> Scale:
    """Estimate the scale of one set of which all pairs are used, and the noise of B with it."""
    return likeliest(pairs, pairs, np.ones(pairs.N, dtype=bool), None)


def _joint(fit: Fit, used: BoolArray, excess: float, *, known: bool) -> FloatArray:
    """Covariance ``(13, 13)``, by the noise or by runs of pairs, whatever is larger."""
    joint = fit.covariance[0] * excess**2
    # what more the scale's own deviation is moves X and Z along with it
    along = joint[12] / joint[12, 12]
    more = max(_by_runs(fit, used) ** 2 - joint[12, 12], 0.0)
    joint = joint + more * np.outer(along, along)
    alone = replace(fit, jacobian=fit.jacobian[:12], information=fit.information[:, :12, :12])
    factor = widening(alone, used[None], np.array([excess]), noise_known=known)[0]
    factor = np.append(factor, 1.0)
    return np.asarray(joint * np.outer(factor, factor))


def _by_runs(fit: Fit, used: BoolArray) -> float:
    """Standard deviation of the last unknown, by leaving out runs of pairs (jackknife).

    Errors of a robot are alike from pose to pose, and look like those of a scale where the poses
    show little of it: the white rows know nothing of that. 0 where the pairs are too few.
    """
    J, white = fit.jacobian[:, :, 0][..., used], fit.white[:, 0][:, used]
    runs = np.array_split(np.arange(int(used.sum())), _RUNS)
    if len(runs[-1]) < _FEWEST_IN_RUN:
        return 0.0
    size = np.sqrt((J**2).sum(axis=(1, 2)))
    J = J / np.where(size > 0.0, size, 1.0)[:, None, None]
    own = [J[..., run].reshape(13, -1) for run in runs]
    information = np.array([rows @ rows.T for rows in own])
    gradient = np.array(
        [rows @ white[:, run].reshape(-1) for rows, run in zip(own, runs, strict=True)]
    )
    rest = information.sum(axis=0) - information
    without = -(np.linalg.pinv(rest, hermitian=True) @ (gradient.sum(axis=0) - gradient)[..., None])
    last = without[:, 12, 0] / size[12]
    return float(np.sqrt((_RUNS - 1) / _RUNS * ((last - last.mean()) ** 2).sum()))


def _not_taken_up(J: FloatArray) -> tuple[FloatArray, float]:
    """Last of rows ``(13, 6 N)`` of derivatives less what the others explain, and its square."""
    others = J[:12] / np.maximum(np.linalg.norm(J[:12], axis=1, keepdims=True), _LEAST)
    explained = least_squares(others.T[None], J[12][None])[0] @ others
    return J[12] - explained, float(J[12] @ J[12])


def _with_column(
    pairs: PairSets, X: FloatArray, Z: FloatArray, weights: FloatArray, noise: Noise | None
) -> Fit:
    """The likeliest X and Z of one set at its scale, with the logarithm of that as 13th column."""
    if noise is None:
        fit, sigma = with_estimated_noise(pairs, X, Z, weights)
        model = estimated_model(pairs, sigma)
    else:
        model = noise.model(pairs)
        fit = adjust(pairs, model, X, Z, weights=weights)
    white = scale_column(pairs, model, fit.X, fit.Z)[None] * np.sqrt(weights)
    jacobian = np.concatenate([fit.jacobian, white])
    rows = jacobian[:, :, 0].reshape(13, -1)
    return replace(fit, jacobian=jacobian, information=(rows @ rows.T)[None])


def scale_column(pairs: PairSets, model: ErrorModel, X: FloatArray, Z: FloatArray) -> FloatArray:
    """Derivatives ``(6, 1, N)`` of the white rows of one set by the logarithm of B's scale.

    They are what the true translations of B are turned to: by A, X and Z where B has noise.
    """
    return _white_of(pairs, model, X, Z, lambda q, R_Z: q)


def depth_columns(
    pairs: PairSets, model: ErrorModel, X: FloatArray, Z: FloatArray
) -> Mapping[str, FloatArray]:
    """Derivatives ``(6, 1, N)`` of the white rows of one set by a scale of the depth alone.

    A wrong focal length makes what a camera sees too near or too far, and leaves it where it is
    across the line of sight. By the words for what is seen: the target as B has it, or as its
    inverse does. Only where all lines of sight are near to one axis of the camera.
    """
    found = {}
    for name, inverse in (("B", False), ("the inverse of B", True)):
        seen = turn_back(pairs.R_B, -pairs.p_B) if inverse else pairs.p_B
        length = np.linalg.norm(seen, axis=0)
        axis = (seen / np.where(length > 0.0, length, 1.0)).mean(axis=1)
        if np.linalg.norm(axis) < _ONE_AXIS:
            continue
        axis = axis / np.linalg.norm(axis)

        def depth(
            q: FloatArray, R_Z: FloatArray, axis: FloatArray = axis, inverse: bool = inverse
        ) -> FloatArray:
            p = turn_back(R_Z, q)
            p = turn_back(pairs.R_B, p) if inverse else p
            along = axis[:, None] * (axis @ p)
            return turn(R_Z, turn(pairs.R_B, along) if inverse else along)

        found[name] = _white_of(pairs, model, X, Z, depth)
    return found


def _white_of(
    pairs: PairSets,
    model: ErrorModel,
    X: FloatArray,
    Z: FloatArray,
    change: Callable[[FloatArray, FloatArray], FloatArray],
) -> FloatArray:
    """White rows ``(6, 1, N)`` of a change of the true translations of B.

    Translations ``(3, N)`` are in the axes of the base; Z turns those of B into them.
    """
    R_Z, p_X, p_Z = columns_of(Z[:, :3, :3]), X[:, :3, 3].T, Z[:, :3, 3].T
    m = turn(pairs.R_A, p_X)
    q = m + pairs.p_A - p_Z if model.on_B else turn(R_Z, pairs.p_B)
    q = change(q, pairs.spread(R_Z))
    column = np.concatenate([np.zeros_like(q), -q])
    return model.at(m, R_Z).whiten(column).reshape(6, 1, -1)


def moved(scale: Scale, X: FloatArray, Z: FloatArray) -> tuple[float, float]:
    """Largest turn [rad] and shift [m] of X and Z ``(4, 4)`` to those with the scale."""
    pairs_of = ((scale.X, X), (scale.Z, Z))
    turned = max(float(se3.rotation_angle(a[:3, :3] @ b[:3, :3].T)) for a, b in pairs_of)
    return turned, max(float(np.linalg.norm(a[:3, 3] - b[:3, 3])) for a, b in pairs_of)
