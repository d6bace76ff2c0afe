"""How a kind of measurement sees the tool and its target, and how well.

Every kind is a function of the pose of the tool against its target: of where the tool point is in
the target's axes, and for some of how the tool is turned in them. Arrays have the posture last,
see :mod:`calib.model.context`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from copy import copy
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import along, cross, matrices_of, turn, turn_back
from calib.errors import InputError
from calib.model.context import MeasurementContext
from calib.se3 import (
    FloatArray,
    inverse_left_jacobian,
    rigid,
    rotation_exp,
    rotation_log,
    transform,
)

UNKNOWN_SIGMA = 1e-4
"""Standard deviation that a kind of unknown noise is given to start with [m, rad]."""


class Measurement(ABC):
    """One way of measuring, with its noise.

    Parameters
    ----------
    sigma : float, array_like or None
        Standard deviation of each row in the axes of the noise [m, rad]; one number means the
        same for all. None: it is estimated from the residuals.

    Attributes
    ----------
    name : str
        In the field's words, as in files.
    rows : int
        Equations m that one measurement gives.
    turns : int
        How many of them, at the end, are angles [rad].
    reads : bool
        Whether something is read off. Otherwise the arm is moved until the tool meets the
        target, and what is read is zero.
    sees_rotation : bool
        Whether it depends on the orientation of the tool.
    is_distance : bool
        Whether what is read is a length, with a zero of its own.
    sigma : array (m,)
    estimated : bool
        Whether the noise is to be estimated.
    found : bool
        Whether it was found from residuals, and not given.
    unit : str
        Of the rows that are no angles.
    arm_sigma : tuple of two floats, or None
        Standard deviations of where the arm stops about where it says: along each axis of the base
        [m] and about each [rad]. All measurements of a stop share the deviation, see
        :mod:`calib.model.deviation`. None: the arm stops where it says.
    """

    name: str
    rows: int
    unit: Literal["m", "px"] = "m"
    turns: int = 0
    reads: bool = True
    sees_rotation: bool = False
    is_distance: bool = False
    sigma: FloatArray
    estimated: bool
    found: bool = False
    arm_sigma: tuple[float, float] | None = None

    def __init__(self, sigma: ArrayLike | None) -> None:
        self.estimated = sigma is None
        self.sigma = check_sigma(UNKNOWN_SIGMA if sigma is None else sigma, self.rows)

    @property
    def mean_sigma_m(self) -> float:
        """Root mean square of the noise over the rows that are lengths [m]."""
        lengths = self.sigma[: self.rows - self.turns]
        return float(np.sqrt(np.mean(lengths**2)))

    def with_noise(self, scale: ArrayLike) -> Measurement:
        """Return the same kind with its noise times a factor, one for all or one for each row.

        The deviation of the arm is a part of the noise, and grows by the mean square of the
        factors.
        """
        other = copy(self)
        other.sigma = self.sigma * np.asarray(scale, dtype=float)
        if self.arm_sigma is not None:
            shift, turn = np.sqrt(np.mean(np.square(scale))) * np.array(self.arm_sigma)
            other.arm_sigma = float(shift), float(turn)
        return other

    def with_deviation(self, arm_sigma: tuple[float, float] | None) -> Measurement:
        """Return the same kind of an arm that stops elsewhere than it says by so much [m, rad]."""
        other = copy(self)
        other.arm_sigma = arm_sigma
        return other

    def of_unknown_noise(self) -> Measurement:
        """The same kind with its noise to be estimated, from the one that it has."""
        other = copy(self)
        other.estimated = True
        return other

    def of_found_noise(self) -> Measurement:
        """The same kind, its noise being that of residuals: estimated once, then as if given."""
        other = copy(self)
        other.estimated, other.found = False, True
        return other

    @abstractmethod
    def predict(self, view: MeasurementContext) -> FloatArray:
        """What is read ``(m, S)``."""

    def difference(self, predicted: FloatArray, observed: FloatArray) -> FloatArray:
        """Rows ``(m, S)`` by which a reading is off another: those of a residual."""
        return np.asarray(predicted - observed)

    @abstractmethod
    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """Rows ``(p, m, S)`` for twists ``(p, 6, S)`` of the tool against its target.

        The derivative of :meth:`difference` where that is ``rows`` (m, S). There are only the
        first three rows of a twist for kinds that see no rotation.
        """

    def differentiate_reading(self, label: str, view: MeasurementContext) -> FloatArray | None:
        """Rows ``(k, m, S)`` by the values of ``view.errors.readings[label]``.

        None where this kind does not read by them.
        """
        return None

    def whiten(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """Rows ``(..., m, S)`` divided by the noise: unit variance, uncorrelated."""
        return np.asarray(rows / self.sigma[:, None])

    def whiten_derivative(
        self, J: FloatArray, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """Derivative ``(p, m, S)`` of the whitened ``rows`` (m, S), from that of the rows.

        Where the axes of the noise do not turn with the arm it is whitened as the rows are.
        """
        return self.whiten(J, view)

    def colour(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """The inverse of :meth:`whiten`: draws of unit variance as noise of the rows."""
        return np.asarray(rows * self.sigma[:, None])

    def disturb(self, readings: FloatArray, noise: FloatArray) -> FloatArray:
        """Readings ``(m, S)`` off by rows of noise, such that :meth:`difference` gives these."""
        return np.asarray(readings + noise)

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        """What of vectors ``(..., 3, S)`` in base axes the arm has to bring to nothing.

        Nothing, for kinds that are read off.
        """
        return np.zeros_like(vector)


class Contact(Measurement):
    """A kind that moves the arm until tool and target meet: what is read is zero."""

    reads = False

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        return vector

    @abstractmethod
    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """Displacement ``(3, S)`` [m] of the tool point, in base axes, that shows as these rows."""


def check_sigma(sigma: ArrayLike, count: int) -> FloatArray:
    """Standard deviations ``(count,)`` [m], one number meaning the same in every axis."""
    given = np.asarray(sigma, dtype=float)
    if given.ndim == 0:
        given = np.full(count, float(given))
    if given.shape != (count,):
        raise InputError(f"the noise needs {count} numbers, {given.size} were given", name="noise")
    bad = ~(np.isfinite(given) & (given > 0))
    if bad.any():
        raise InputError(
            f"a noise of {given[bad][0] * 1e3:g} mm cannot be used: it must be above zero",
            hint="give the standard deviation of a single measurement in each axis",
            name="noise",
            value=float(given[bad][0]),
            bound=0.0,
        )
    return given


class TouchUp(Contact):
    """All three coordinates of the tool point meet the target (visual or with a pin).

    What is measured is zero: the rows are Eq. 4 of [Watanabe2006]_, ``e_i = p_i - p_M``, in the
    axes of the target: those of the base for a point. The noise is that of bringing the point
    there, in the axes of the camera (V, H, D).

    Parameters
    ----------
    sigma : float, array_like (3,) or None
        Standard deviations [m] along x, y, z of the axes of the noise.
    axes : array_like (3, 3), optional
        These axes in the tool's: ``R_tool_noise``, of a camera that is not mounted along the axes
        of the tool. By default the tool's own.
    """

    name = "touch-up"
    rows = 3
    sees_rotation = True

    def __init__(self, sigma: ArrayLike | None, axes: ArrayLike | None = None) -> None:
        super().__init__(sigma)
        self._axes: FloatArray | None = None
        if axes is not None:
            self._axes = rigid(transform(axes, np.zeros(3)), "axes")[:3, :3]

    def predict(self, view: MeasurementContext) -> FloatArray:
        return view.in_target(view.error)

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        return view.in_target(motion[..., :3, :])

    def whiten(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return turn_back(self._columns(view) / self.sigma[:, None, None], view.out_of_target(rows))

    def whiten_derivative(
        self, J: FloatArray, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        # d(Rᵀe) = Rᵀ(de - w x e)
        moved = motion[:, :3] - cross(motion[:, 3:], view.error)
        return turn_back(self._columns(view) / self.sigma[:, None, None], moved)

    def colour(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return view.in_target(turn(self._columns(view), rows * self.sigma[:, None]))

    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return view.out_of_target(rows)

    def _columns(self, view: MeasurementContext) -> FloatArray:
        """Columns, then rows, ``(3, 3, S)`` of the axes of the noise in the base."""
        if self._axes is None:
            return view.tool
        return np.asarray(np.tensordot(self._axes.T, view.tool, axes=1))


class ViewLine(Contact):
    """Only that the target lies on the view line is measured: two coordinates across it.

    Section 2.1 and Fig. 10 of [Watanabe2006]_. The view line runs along the tool's z through the
    tool point, so the position of the tool point along z cannot be identified. Noise is along the
    tool's x and y, the camera's V and H.
    """

    name = "view-line"
    rows = 2
    sees_rotation = True

    def predict(self, view: MeasurementContext) -> FloatArray:
        error = view.error
        return np.stack([along(view.tool[k], error) for k in range(2)])

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        # the axes turn with the tool: d(Rᵀe) = Rᵀ(de - w x e)
        moved = motion[:, :3] - cross(motion[:, 3:], view.error)
        return np.stack([along(view.tool[k], moved) for k in range(2)], axis=1)

    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        # across the line; the arm is taken to hold its depth
        return np.asarray(view.tool[0] * rows[0] + view.tool[1] * rows[1])


class PlaneContact(Contact):
    """The tool point is brought into contact with a plane: the target's z = 0."""

    name = "plane"
    rows = 1

    def predict(self, view: MeasurementContext) -> FloatArray:
        return along(view.target[2], view.error)[None]

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        return along(view.target[2], motion[:, :3])[:, None]

    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return np.asarray(view.target[2] * rows[0])

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        return np.asarray(view.target[2] * along(view.target[2], vector)[..., None, :])


class Point(Measurement):
    """Place of a point of the tool in the frame of a tracker or a measuring arm.

    Where the noise grows with the distance from the instrument, at the origin of its frame, that
    is added in quadrature to the constant part. It is taken at the place that is predicted; how it
    changes with the parameters counts for nothing, since residuals are a millionth of the distance.

    Parameters
    ----------
    sigma : float, array_like (3,) or None
        Standard deviations [m] along the axes of the instrument; one number where noise grows.
    along_per_m, across_per_m : float
        Standard deviation that each metre of distance adds along the line of sight, and across it
        in each direction: for a tracker the latter is that of its angles [rad].
    """

    name = "point"
    rows = 3

    def __init__(
        self, sigma: ArrayLike | None, along_per_m: float = 0.0, across_per_m: float = 0.0
    ) -> None:
        super().__init__(sigma)
        self._growth = np.array([along_per_m, across_per_m], dtype=float)
        if not (np.isfinite(self._growth).all() and (self._growth >= 0.0).all()):
            raise InputError("noise that grows by less than nothing a metre", name="noise")
        if self._growth.any() and np.ptp(self.sigma) > 0.0:
            raise InputError(
                "noise that grows with the distance has one constant part for all axes",
                hint="give one number, or leave the growth out",
                name="noise",
            )

    def predict(self, view: MeasurementContext) -> FloatArray:
        return view.in_target(view.error)

    def with_noise(self, scale: ArrayLike) -> Measurement:
        # noise that grows has one factor, the mean square
        if not self._growth.any():
            return super().with_noise(scale)
        factor = float(np.sqrt(np.mean(np.square(scale))))
        grown = copy(self)
        grown._growth = factor * self._growth
        return Measurement.with_noise(grown, factor)

    def whiten(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return self._scaled(rows, view, inverse=True)

    def colour(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        return self._scaled(rows, view, inverse=False)

    def _scaled(self, rows: FloatArray, view: MeasurementContext, *, inverse: bool) -> FloatArray:
        """Rows times the root of their covariance, or over it: along the sight and across."""
        if not self._growth.any():
            return super().whiten(rows, view) if inverse else super().colour(rows, view)
        place = view.in_target(view.error)
        away = np.sqrt(along(place, place))
        sight = place / np.maximum(away, np.finfo(float).tiny)
        deviation = np.hypot(self.sigma[0], self._growth[:, None] * away)
        lengthways, across = 1.0 / deviation if inverse else deviation
        share = along(sight, rows)[..., None, :] * (lengthways - across)
        return np.asarray(across * rows + share * sight)

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        # velocities are those against the turning frame
        return view.in_target(motion[:, :3])


class PoseReading(Measurement):
    """A pose that is read: place, then rotation vector.

    Residuals of the rotation are the turn from what was read to what is predicted, in the axes of
    the instrument.
    """

    rows = 6
    turns = 3
    sees_rotation = True

    def difference(self, predicted: FloatArray, observed: FloatArray) -> FloatArray:
        from scipy.spatial.transform import Rotation

        # by quaternions: a tenth of the time that matrices take
        shown, read = (Rotation.from_rotvec(rows[3:].T) for rows in (predicted, observed))
        return np.concatenate([predicted[:3] - observed[:3], (shown * read.inv()).as_rotvec().T])

    def disturb(self, readings: FloatArray, noise: FloatArray) -> FloatArray:
        R = rotation_exp(noise[3:].T) @ rotation_exp(readings[3:].T)
        return np.concatenate([readings[:3] + noise[:3], rotation_log(R).T])


class Pose(PoseReading):
    """Pose of the tool in the frame of a tracker; noise is along and about its axes [m, rad]."""

    name = "pose"

    def predict(self, view: MeasurementContext) -> FloatArray:
        vector = rotation_log(matrices_of(view.in_target(view.tool))).T
        return np.concatenate([view.in_target(view.error), vector])

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        turned = _log_derivative(view.in_target(motion[:, 3:]), rows)
        return np.concatenate([view.in_target(motion[:, :3]), turned], axis=1)


class CameraPose(PoseReading):
    """Pose of the target as a camera on the tool sees it; noise is along and about its axes."""

    name = "camera-pose"

    def predict(self, view: MeasurementContext) -> FloatArray:
        target = np.broadcast_to(view.target, view.tool.shape)
        vector = rotation_log(matrices_of(turn_back(view.tool, target))).T
        return np.concatenate([turn_back(view.tool, -view.error), vector])

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        # the target goes against the tool
        place = cross(motion[:, 3:], view.error) - motion[:, :3]
        turned = _log_derivative(turn_back(view.tool, -motion[:, 3:]), rows)
        return np.concatenate([turn_back(view.tool, place), turned], axis=1)


class Distance(Measurement):
    """Distance of the tool point from the target: a ball bar, or a wire."""

    name = "distance"
    rows = 1
    is_distance = True

    def predict(self, view: MeasurementContext) -> FloatArray:
        length = view.distance()[0].copy()
        for label, more in view.errors.lengths.items():
            mask = view.tiled(view.setup.target, view.targets.index(label))
            length += more if mask is None else mask * more
        return length[None]

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        return along(view.distance()[1], motion[:, :3])[:, None]


def _log_derivative(turning: FloatArray, rows: FloatArray) -> FloatArray:
    """Change ``(p, 3, S)`` of residual rotation vectors for turns ``(p, 3, S)`` of the prediction.

    Both in the axes of the instrument.
    """
    J = inverse_left_jacobian(rows[3:].T).transpose(1, 2, 0)  # rows, columns, S
    out = np.empty(turning.shape)
    for k in range(3):
        out[:, k] = along(J[k], turning)
    return out
