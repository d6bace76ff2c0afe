"""What sits on the tip: frames and points of the tool."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.model.parameters.frames import OnTool, points_as_frames
from calib.model.parameters.links import AXES
from calib.se3 import FloatArray


class ToolFrame(OnTool):
    """A frame on the tip: where the tracker's target, the gripper or the camera is.

    Parameters
    ----------
    T_tip_tool : array_like (4, 4)
        Nominal pose in the tip frame [m].
    label : str
    free : sequence of str
        Of x, y, z, rx, ry, rz; all by default.
    prior_m, prior_rad : float, optional
    """

    def __init__(
        self,
        T_tip_tool: ArrayLike,
        label: str = "tool",
        free: Sequence[str] = AXES,
        prior_m: float | None = None,
        prior_rad: float | None = None,
    ) -> None:
        super().__init__([label], np.asarray(T_tip_tool)[None], free, prior_m, prior_rad)


class ToolPoints(OnTool):
    """Points on the tip: reflectors, or what a measuring arm probes.

    Parameters
    ----------
    positions_m : array_like (K, 3)
        Nominal places [m] in tip axes.
    labels : sequence of str
    free : str
        Axes of the tip frame along which they are to be identified, a part of ``"xyz"``.
    prior_m : float, optional
    """

    def __init__(
        self,
        positions_m: ArrayLike,
        labels: Sequence[str],
        free: str = "xyz",
        prior_m: float | None = None,
    ) -> None:
        places = points_as_frames(
            positions_m, labels, "each tool point needs three finite numbers", "tool"
        )
        super().__init__(labels, places, _letters(free), prior_m)


class ToolPoint(ToolPoints):
    """The tool point in the tip frame: tip of the (virtual) pin, ball, or point on the view line.

    The p_VT of [Watanabe2006]_.

    Parameters
    ----------
    position_m : array_like (3,)
        Nominal position [m] in tip axes.
    free : str
        Axes of the tip frame along which it is to be identified, a part of ``"xyz"``. A view line
        says nothing of the position along itself: give ``"xy"`` there.
    prior_m : float, optional
        Standard deviation known before measuring.
    """

    def __init__(
        self, position_m: ArrayLike, free: str = "xyz", prior_m: float | None = None
    ) -> None:
        position = np.asarray(position_m, dtype=float)
        if position.shape != (3,) or not np.isfinite(position).all():
            raise InputError("the tool point needs three finite numbers", name="tool")
        super().__init__([position], ["tool"], free, prior_m)

    @property
    def position_m(self) -> FloatArray:
        """Nominal position ``(3,)`` [m] in tip axes, free or not."""
        return np.asarray(self.positions_m[0])


def _letters(free: str) -> str:
    if sorted(set(free)) != sorted(free) or not set(free) <= set("xyz"):
        raise InputError(f"free axes of the tool point {free!r} are no part of xyz", name="tool")
    return free
