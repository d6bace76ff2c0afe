"""The measuring set-up: where the tool point sits on the flange, where the targets stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.parameters.base import ArmErrors, ArmView, ParameterBlock
from calib.se3 import FloatArray

_AXES = "xyz"


class ToolPoint(ParameterBlock):
    """The tool point in the tip frame: tip of the (virtual) pin, ball, or point on the view line.

    The p_VT of [Watanabe2006]_.

    Parameters
    ----------
    position_m : array_like (3,)
        Nominal position [m] in tip axes.
    free : str
        Axes of the tip frame along which it is to be identified, a part of ``"xyz"``. A view line
        says nothing of the position along itself: give ``"xy"`` there.
    """

    unit = "m"
    nuisance = True

    def __init__(self, position_m: ArrayLike, free: str = _AXES) -> None:
        self._position = np.asarray(position_m, dtype=float)
        if self._position.shape != (3,) or not np.isfinite(self._position).all():
            raise InputError("the tool point needs three finite numbers", name="tool")
        if sorted(set(free)) != sorted(free) or not set(free) <= set(_AXES):
            raise InputError(
                f"free axes of the tool point {free!r} are no part of xyz", name="tool"
            )
        self._columns = [_AXES.index(axis) for axis in free]
        self.names = tuple(f"tool.{axis}" for axis in free)

    @property
    def position_m(self) -> FloatArray:
        """Nominal position ``(3,)`` [m] in tip axes, free or not."""
        return self._position

    @property
    def nominal(self) -> FloatArray:
        """Nominal position along the free axes [m]."""
        return self._position[self._columns]

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray) -> None:
        """See :meth:`ParameterBlock.displace`."""
        tool = np.broadcast_to(self._position, (*values.shape[:-1], 3)).copy()
        tool[..., self._columns] = values
        errors.tool = tool

    def motion(self, view: ArmView) -> FloatArray:
        """See :meth:`ParameterBlock.motion`."""
        columns = view.state.R_base_tip[..., self._columns]
        return np.concatenate([columns, np.zeros_like(columns)], axis=-2)


class TargetPoints(ParameterBlock):
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
    """

    unit = "m"
    nuisance = True

    def __init__(
        self, positions_m: ArrayLike, labels: Sequence[str] = ("T1",), free: bool = True
    ) -> None:
        self._positions = np.atleast_2d(np.asarray(positions_m, dtype=float))
        if self._positions.shape != (len(labels), 3) or not np.isfinite(self._positions).all():
            raise InputError("each target needs three finite numbers", name="target")
        self.labels = tuple(labels)
        if len(set(self.labels)) != len(self.labels):
            raise InputError("two targets have the same name", name="target", hint="rename one")
        self._free = free
        self.names = tuple(f"target.{label}.{axis}" for label in labels for axis in _AXES if free)

    @property
    def positions_m(self) -> FloatArray:
        """Nominal positions ``(K, 3)`` [m] in the base frame."""
        return self._positions

    @property
    def nominal(self) -> FloatArray:
        """Nominal positions, target by target, ``(3 K,)`` [m]; empty where they are not free."""
        return self._positions.ravel() if self._free else np.zeros(0)

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray) -> None:
        """See :meth:`ParameterBlock.displace`."""
        shape = (*values.shape[:-1], len(self.labels), 3)
        errors.targets = (
            values.reshape(shape) if self._free else np.broadcast_to(self._positions, shape)
        )

    def motion(self, view: ArmView) -> FloatArray:
        """See :meth:`ParameterBlock.motion`."""
        if not self._free:
            return np.zeros((*view.point.shape[:-1], 6, 0))
        out = np.zeros((*view.point.shape[:-1], 6, len(self.labels), 3))
        touched = view.target[:, None] == np.arange(len(self.labels))  # (N, K)
        for axis in range(3):
            out[..., axis, :, axis] = -1.0 * touched
        return out.reshape(*view.point.shape[:-1], 6, self.size)
