"""Touch-up: the arm is moved until its tool point meets the target; the joints are the result."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import along, cross, turn, turn_back
from calib.model.context import MeasurementContext
from calib.model.measurements.base import Contact
from calib.se3 import FloatArray, rigid, transform


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

    Raises
    ------
    InputError
        A noise that is not above zero, or axes that are no rotation.
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
        """See :meth:`Measurement.predict`: the error itself."""
        return view.in_target(view.error)

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`."""
        return view.in_target(motion[..., :3, :])

    def whiten(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.whiten`: turned into camera axes, then divided."""
        return turn_back(self._columns(view) / self.sigma[:, None, None], view.out_of_target(rows))

    def whiten_derivative(
        self, J: FloatArray, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.whiten_derivative`: ``d(Rᵀe) = Rᵀ(de - w x e)``."""
        moved = motion[:, :3] - cross(motion[:, 3:], view.error)
        return turn_back(self._columns(view) / self.sigma[:, None, None], moved)

    def colour(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.colour`."""
        return view.in_target(turn(self._columns(view), rows * self.sigma[:, None]))

    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Contact.lift`."""
        return view.out_of_target(rows)

    def _columns(self, view: MeasurementContext) -> FloatArray:
        """Columns, then rows, ``(3, 3, S)`` of the axes of the noise in the base."""
        if self._axes is None:
            return view.tool
        return np.asarray(np.tensordot(self._axes.T, view.tool, axes=1))


class ViewLine(Contact):
    """Only that the target lies on the view line is measured: two coordinates across it.

    Section 2.1 and Fig. 10 of [Watanabe2006]_. The view line runs along the tool's z through the
    tool point, so the position of the tool point along z cannot be identified.

    Parameters
    ----------
    sigma : float, array_like (2,) or None
        Standard deviations [m] along the tool's x and y (the camera's V and H).
    """

    name = "view-line"
    rows = 2
    sees_rotation = True

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`: the error across the view line."""
        error = view.error
        return np.stack([along(view.tool[k], error) for k in range(2)])

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`.

        The axes turn with the tool: ``d(Rᵀe) = Rᵀ(de - w x e)``.
        """
        moved = motion[:, :3] - cross(motion[:, 3:], view.error)
        return np.stack([along(view.tool[k], moved) for k in range(2)], axis=1)

    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Contact.lift`: across the line; the arm is taken to hold its depth."""
        return np.asarray(view.tool[0] * rows[0] + view.tool[1] * rows[1])


class PlaneContact(Contact):
    """The tool point is brought into contact with a plane: the target's z = 0.

    Parameters
    ----------
    sigma : float or None
        Standard deviation [m] along the normal.
    """

    name = "plane"
    rows = 1

    def predict(self, view: MeasurementContext) -> FloatArray:
        """See :meth:`Measurement.predict`: the height over the plane."""
        return along(view.target[2], view.error)[None]

    def differentiate(
        self, motion: FloatArray, view: MeasurementContext, rows: FloatArray
    ) -> FloatArray:
        """See :meth:`Measurement.differentiate`."""
        return along(view.target[2], motion[:, :3])[:, None]

    def lift(self, rows: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Contact.lift`: along the normal."""
        return np.asarray(view.target[2] * rows[0])

    def gap(self, vector: FloatArray, view: MeasurementContext) -> FloatArray:
        """See :meth:`Contact.gap`: along the normal."""
        return np.asarray(view.target[2] * along(view.target[2], vector)[..., None, :])
