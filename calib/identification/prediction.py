"""How accurately a calibrated arm will stand, what a correction can carry, what error to expect.

A plan tells the covariance of what it identifies (:func:`calib.identification.covariance_of`).
What an arm will do with it somewhere else follows from how its tool point moves with each
parameter there: ``J C Jᵀ``. It is the accuracy that the noise of the measurement leaves; what the
model does not describe comes on top.

Everything that was identified goes into corrected commands; a kinematic description holds joint
frames alone, and mastering the zeros of joints. What of the errors has no place there is not simply
left out: within the volume that the arm works in, the values that the correction does have can take
up a part of it. Compliance, say, turns joints by nearly the same angle all over a small box, which
zero offsets can hold. With the mean x and the covariance C of all parameters that were identified,
f(q, x) where the tool point is and f_R(q, x_R) where a controller with the values x_R takes it to
be, the expected square of the error at a posture q is, to the first order in what is not known
(J = df/dx),

    E² = tr(J C Jᵀ) + |f(q, x) - f_R(q, x_R)|²,

the mean of a squared distance from a fixed point. The values that are best for a correction
minimise the mean of the second term, computed as it stands and not linearised, over the postures.

The base is placed anew for each correction and each drawn arm, as by an operator who teaches the
user frame again: rigid motions of all points alike count neither as an error nor as a part of it
that is carried. It is the arm's own accuracy, in the frame that the targets are found in with it:
where the base stands in the world, and the zero of the first joint, are no part of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.identification.result import SIZES
from calib.model import CalibrationModel, Setup
from calib.model.context import MeasurementContext
from calib.se3 import BoolArray, FloatArray, project_to_rotation, skew

PLACED_BASE = (
    "accuracy of the arm itself: the base is placed anew, as by teaching the user frame again, so "
    "where it stands in the world and the zero of joint 1 are no part of it"
)
"""Meaning of an error of the tool point over a volume, in words."""

Against = Literal["base", "target"]


def predict_accuracy(
    model: CalibrationModel,
    covariance: ArrayLike,
    q: ArrayLike,
    setup: Setup | None = None,
    *,
    x: ArrayLike | None = None,
    against: Against = "base",
) -> FloatArray:
    """Covariance of the position of the tool point in base axes, ``(N, 3, 3)`` [m²].

    Against the base: of the parameters of arm and tool; where the targets are is of no account.
    What the targets take up is not free, and counts as known. Where they are identified with the
    arm nothing tells where the base is in the world, nor the zero of joint 1: the base is then the
    arm's own, turned about joint 1 as the targets were found.

    Against a target: of where the tool point goes as seen from the target as identified. What
    moves both alike does not count; points given by their distance from the target are reached as
    accurately as this.

    Parameters
    ----------
    covariance : array_like (p, p)
        Of all its parameters [SI].
    q : array_like (N, n)
        Postures [rad].
    setup : Setup, optional
        Tool and payload at each; the first of each by default.
    x : array_like (p,), optional
        Parameters to predict at; the nominal ones by default.
    against : {"base", "target"}
        The target is that of ``setup``.
    """
    C = _checked(covariance, model)
    J = tool_motion(model, q, setup, x=x, against=against)
    return np.asarray(J @ C @ np.swapaxes(J, -1, -2))


def _checked(covariance: ArrayLike, model: CalibrationModel) -> FloatArray:
    """A covariance ``(p, p)`` of all parameters of a model."""
    C = np.asarray(covariance, dtype=float)
    if C.shape != (model.p, model.p):
        raise InputError(
            f"the model has {model.p} parameters, the covariance has shape {C.shape}",
            name="covariance",
        )
    if not np.isfinite(C).all():
        raise InputError(
            "the covariance is not finite: the measurements do not identify all parameters",
            hint="measure other or more poses, or leave parameters out",
            name="covariance",
        )
    return C


def tool_motion(
    model: CalibrationModel,
    q: ArrayLike,
    setup: Setup | None = None,
    *,
    x: ArrayLike | None = None,
    against: Against = "base",
) -> FloatArray:
    """How the tool point moves with the parameters, ``(N, 3, p)`` in base axes [m per unit].

    Zero for parameters that are of no account, see :func:`predict_accuracy`, which takes the same
    arguments. These are the functions of the parameters whose deviations poses are chosen by.
    """
    motion = model.linearise(np.asarray(q, dtype=float), x, setup).motion[:, :3]
    J = np.ascontiguousarray(motion.transpose(2, 1, 0))
    J[:, :, ~_counts(model, against)] = 0.0
    return J


def placed_anew(motion: FloatArray, points: FloatArray) -> FloatArray:
    """Displacements ``(K, 3, p)`` of points ``(K, 3)`` less their best common rigid motion."""
    rows = motion.reshape(3 * len(points), -1)
    rigid = rigid_motions(points)
    return np.asarray(rows - rigid @ (rigid.T @ rows)).reshape(motion.shape)


def _counts(model: CalibrationModel, against: Against) -> BoolArray:
    """Which parameters ``(p,)`` move the tool; not those of targets, nor of instruments."""
    if against not in get_args(Against):
        raise InputError(f"unknown {against!r}", hint='one of "base", "target"', name="against")
    counts = [
        not b.nuisance or bool(b.tools) or (against == "target" and bool(b.targets))
        for b in model.parameters
        for _ in b.names
    ]
    return np.array(counts, dtype=bool)


ALIKE = 0.01
"""Part of the expected square by which values may be worse than the very best ones, where that
brings them nearer to the values as identified: over a small box different sets of values do nearly
the same, and some of them lie far off."""

_STEPS = 30
_STILL = 1e-6
"""Gain of a step, relative to what is lost, at which the iteration ends."""

_UNSEEN = 1e-9
"""Singular value, relative to the largest, of a combination that moves no point."""


@dataclass(frozen=True, eq=False)
class ErrorToExpect:
    """Error of the tool point at each of K postures."""

    unknown_m: FloatArray
    """(K,): standard deviation (of the distance) that the identification leaves, and the deviation
    of the arm from pose to pose [m]."""
    lost_m: FloatArray  # (K,): distance that is known, and that the correction does not carry [m]

    @property
    def points_m(self) -> FloatArray:
        """Root of the expected square at each posture ``(K,)`` [m]."""
        return np.asarray(np.hypot(self.unknown_m, self.lost_m))

    @property
    def rms_m(self) -> float:
        """Root of its mean over the postures [m]."""
        return float(np.sqrt(np.mean(self.points_m**2)))

    @property
    def worst_m(self) -> float:
        """The largest over the postures [m]."""
        return float(self.points_m.max())

    @property
    def lost_rms_m(self) -> float:
        """What is not carried, in the root mean square [m]."""
        return float(np.sqrt(np.mean(self.lost_m**2)))


@dataclass(frozen=True, eq=False)
class Carried:
    """Values of an arm's parameters ``(p,)`` [SI] and their covariance, as of a correction."""

    model: CalibrationModel
    x: FloatArray
    covariance: FloatArray


class Expectation:
    """What an identification says of the error that corrections leave at given postures.

    Parameters
    ----------
    model : CalibrationModel
        As much of the arm as was identified.
    x : array (r,)
        Mean of its parameters [SI].
    covariance : array (r, r)
    q : array (K, n)
        Postures [rad] at which the arm will work.
    setup : Setup, optional
        Tool and payload at each; the first of each by default.
    deviation : tuple of two floats
        Standard deviations of where the arm stops, along and about each axis [m, rad]: no
        correction takes them away.

    Attributes
    ----------
    jacobian : array (3 K, r)
        Displacements of the tool point by each parameter, the base placed anew [m per unit].
    """

    def __init__(
        self,
        model: CalibrationModel,
        x: FloatArray,
        covariance: FloatArray,
        q: FloatArray,
        setup: Setup | None = None,
        deviation: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.model, self.x, self.covariance = model, x, _checked(covariance, model)
        self.q, self.setup = q, setup
        view = model.view(q, x, setup)
        self.points = view.tool_points
        self._deviated2 = deviated_m2(view, deviation)
        self._rigid = rigid_motions(self.points)
        self.jacobian = self._moved(model, x, np.eye(3))
        squares = np.sum((self.jacobian @ covariance) * self.jacobian, axis=1)  # diagonal of J C Jᵀ
        self._unknown2 = np.maximum(squares.reshape(len(q), 3).sum(axis=1), 0.0)

    def of(self, model: CalibrationModel, x: FloatArray) -> ErrorToExpect:
        """Error of an arm whose controller has the parameters ``(p,)`` of a model [SI]."""
        lost = self.displaced(model, x)[0].reshape(-1, 3)
        return ErrorToExpect(
            np.sqrt(self._unknown2 + self._deviated2), np.linalg.norm(lost, axis=1)
        )

    def carried(self, model: CalibrationModel, free: BoolArray) -> Carried:
        """The best values of a correction's parameters.

        By the method of Gauss and Newton, from the values as identified. What makes no difference
        at these postures, or hardly any (``ALIKE``), stays there.

        Parameters
        ----------
        model : CalibrationModel
            With the parameters that the correction has.
        free : array (p,) of bool
            Which of them may take up what others would have to carry.
        """
        size = np.array([SIZES[unit].natural for unit in model.units])[free]
        start = part_of(self.model, self.x, self.covariance, model)
        taken = _shared(self.model, model)
        x = best = start.x
        least, gain = np.inf, taken
        for _ in range(_STEPS):
            off, R = self.displaced(model, x)
            moved = self._moved(model, x, R)
            J = moved[:, free] * size
            solve = self._least_change(J, off + J @ ((x - start.x)[free] / size))
            if off @ off >= least:
                break
            still = least - off @ off < _STILL * least
            best, least = x, float(off @ off)
            gain = taken.copy()
            gain[free] += size[:, None] * (solve @ (self.jacobian - moved @ taken))
            if still:
                break
            x = start.x.copy()
            x[free] += size * (solve @ (off + J @ ((best - start.x)[free] / size)))
        return Carried(model, best, gain @ self.covariance @ gain.T)

    def _least_change(self, J: FloatArray, off: FloatArray) -> FloatArray:
        """Ridge inverse ``(p, 3 K)``: the most damping whose loss is within ``ALIKE``."""
        if not J.size:
            return J.T
        U, s, Vt = np.linalg.svd(J, full_matrices=False)
        kept = s > _UNSEEN * s.max(initial=0.0)
        U, s, Vt = U[:, kept], s[kept], Vt[kept]
        if not s.size:
            return np.zeros_like(J.T)
        parts2 = (U.T @ off) ** 2
        least = float(off @ off - parts2.sum() + self._unknown2.sum())
        allowed = ALIKE * max(least, 0.0)

        def more(damping: float) -> float:
            return float(np.sum(parts2 * (damping**2 / (s**2 + damping**2)) ** 2))

        low, high = 1e-9 * s.max(), 1e9 * s.max()
        for _ in range(100):
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if more(middle) <= allowed else (low, middle)
        return np.asarray(Vt.T @ ((s / (s**2 + low**2))[:, None] * U.T))

    def displaced(self, model: CalibrationModel, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Where the tool point is less where a model takes it to be, and the turn of its base.

        ``(3 K,)`` [m] and ``(3, 3)``: the base of the model is placed by the finite motion that is
        best for it, of which :func:`rigid_motions` are the derivatives. Where values differ much, a
        turn to the first order only would be an error of its own.
        """
        points = model.view(self.q, x, self.setup).tool_points
        taken, real = points - points.mean(axis=0), self.points - self.points.mean(axis=0)
        R = project_to_rotation(real.T @ taken)
        return (real - taken @ R.T).reshape(-1), R

    def _moved(self, model: CalibrationModel, x: FloatArray, R: FloatArray) -> FloatArray:
        """Displacements ``(3 K, p)`` by each parameter, the base turned and placed anew."""
        moved = R @ tool_motion(model, self.q, self.setup, x=x)
        moved = moved.reshape(3 * len(self.q), model.p)
        return np.asarray(moved - self._rigid @ (self._rigid.T @ moved))


def deviated_m2(view: MeasurementContext, deviation: tuple[float, float]) -> FloatArray:
    """Return the mean square ``(K,)`` [m²] of the tool point by the deviation of the arm.

    A shift moves it by as much along each axis, a turn about the tip across the lever.
    """
    shift, turn = deviation
    lever = view.point - view.walk.p_base_tip
    return np.asarray(3.0 * shift**2 + 2.0 * turn**2 * np.sum(lever**2, axis=0))


def part_of(
    model: CalibrationModel, x: FloatArray, covariance: FloatArray, part: CalibrationModel
) -> Carried:
    """A correction with its parameters as identified ``(r,)`` [SI], others as described."""
    taken = _shared(model, part)
    values = np.where(taken.any(axis=1), taken @ x, part.nominal)
    return Carried(part, values, taken @ covariance @ taken.T)


def _shared(model: CalibrationModel, part: CalibrationModel) -> FloatArray:
    """1 where a parameter of a part is one of a model, else 0: ``(p, r)``."""
    same = np.array([[own == name for name in model.names] for own in part.names], dtype=float)
    return same.reshape(part.p, model.p)


def rigid_motions(points: FloatArray) -> FloatArray:
    """Orthonormal displacements ``(3 K, r)`` of points ``(K, 3)`` by the motions of a rigid body.

    There are six, or fewer where the points lie on a line, or are fewer than three.
    """
    turned = -skew(points - points.mean(axis=0))
    shifted = np.broadcast_to(np.eye(3), turned.shape)
    U, s, _ = np.linalg.svd(
        np.concatenate([shifted, turned], axis=-1).reshape(-1, 6), full_matrices=False
    )
    return np.asarray(U[:, s > _UNSEEN * s[0]])
