"""What measurements are taken from: points, frames and planes around the arm."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model.context import ArmErrors, MeasurementContext, Setup
from calib.model.parameters.base import ParameterBlock, prior_of
from calib.model.parameters.frames import AroundArm, points_as_frames
from calib.model.parameters.links import AXES
from calib.se3 import FloatArray, transform


class TargetPoints(AroundArm):
    """The points touched, in the base frame: the p_M of [Watanabe2006]_, one or several.

    Parameters
    ----------
    positions_m : array_like (K, 3)
        Nominal positions [m] in the base frame.
    labels : sequence of str
        Name of each target, as in the data.
    free : bool
        Whether they are to be identified. Surveyed targets are not, and then even the offset of
        the first joint can be.
    prior_m : float, optional
        Standard deviation known before measuring.
    """

    def __init__(
        self,
        positions_m: ArrayLike,
        labels: Sequence[str] = ("T1",),
        free: bool = True,
        prior_m: float | None = None,
    ) -> None:
        places = points_as_frames(
            positions_m, labels, "each target needs three finite numbers", "target"
        )
        super().__init__(labels, places, "xyz" if free else "", prior_m)


class TargetFrame(AroundArm):
    """A frame that poses and points are measured in: of a tracker, a measuring arm, a camera.

    Parameters
    ----------
    T_base_target : array_like (4, 4)
        Nominal pose in the base frame [m].
    label : str
    free : sequence of str
        Of x, y, z, rx, ry, rz; all by default.
    prior_m, prior_rad : float, optional
    """

    def __init__(
        self,
        T_base_target: ArrayLike,
        label: str = "tracker",
        free: Sequence[str] = AXES,
        prior_m: float | None = None,
        prior_rad: float | None = None,
    ) -> None:
        super().__init__([label], np.asarray(T_base_target)[None], free, prior_m, prior_rad)


class TargetPlane(AroundArm):
    """A plane that the tool point touches: its height along its normal and its two tilts.

    Parameters
    ----------
    point_m : array_like (3,)
        A point of the nominal plane in the base frame [m].
    normal : array_like (3,)
        Normal in the base frame, of any length.
    label : str
    free : bool
        Whether it is to be identified.
    """

    def __init__(
        self, point_m: ArrayLike, normal: ArrayLike, label: str = "plane", free: bool = True
    ) -> None:
        z = np.asarray(normal, dtype=float)
        length = float(np.linalg.norm(z)) if z.shape == (3,) else 0.0
        if not (np.isfinite(length) and length > 0):
            raise InputError("the normal of a plane needs a direction", name="target")
        z = z / length
        x = np.eye(3)[int(np.argmin(np.abs(z)))]
        x = x - z * (z @ x)
        x /= np.linalg.norm(x)
        T = transform(np.column_stack([x, np.cross(z, x), z]), point_m)
        super().__init__([label], T[None], ("z", "rx", "ry") if free else ())

    @property
    def nominal(self) -> FloatArray:
        """Zero: the plane as described."""
        return np.zeros(self.size)

    def _six(self, values: FloatArray) -> FloatArray:
        six = np.zeros((1, 6, values.shape[1]))
        six[0, self._axes] = values
        height = six[0, 2].copy()
        six[0, :3] = self.T_nominal[0, :3, 3, None] + self.T_nominal[0, :3, 2, None] * height
        return six

    def _shift(self, frame: int, axis: int) -> FloatArray:
        return np.asarray(self.T_nominal[0, :3, axis])


class LengthOffsets(ParameterBlock):
    """What a wire or a ball bar shows more than the distance: the zero of its reading.

    Parameters
    ----------
    labels : sequence of str
        Targets that it is measured from.
    prior_m : float, optional
        Standard deviation known before measuring.
    """

    nuisance = True
    beyond_chain = ""

    def __init__(self, labels: Sequence[str], prior_m: float | None = None) -> None:
        self.labels = self.measured_from = tuple(labels)
        self.names = tuple(f"length.{label}" for label in labels)
        self.units = tuple("m" for _ in self.names)
        self.prior = prior_of(prior_m, len(self.names))

    @property
    def nominal(self) -> FloatArray:
        """Zero: the length as shown."""
        return np.zeros(self.size)

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        """See :meth:`ParameterBlock.displace`."""
        errors.lengths |= dict(zip(self.labels, values, strict=True))

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`: as if the tool point went outwards."""
        _, away = view.distance()
        for label, row in zip(self.labels, out, strict=True):
            shown = view.is_distance & (view.setup.target == view.targets.index(label))
            mask = view.tiled(shown.astype(np.intp), 1)
            row[:3] = away if mask is None else mask * away
