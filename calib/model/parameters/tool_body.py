"""A body on the tip with points whose places on it are known: reflectors on a plate."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import columns_of, cross, product, turn
from calib.errors import InputError
from calib.model.context import ArmErrors, Feature, MeasurementContext, Setup
from calib.model.parameters.base import ParameterBlock, prior_of
from calib.model.parameters.frames import points_as_frames
from calib.model.parameters.links import AXES
from calib.se3 import FloatArray, check_transforms, right_jacobian, rotation_exp


class ToolBody(ParameterBlock):
    """Points on the tip that keep their distances: six parameters place them all.

    The body is at (x, y, z) in the tip frame, turned by ``R = R_nominal exp(r)`` with the rotation
    vector r = (rx, ry, rz) in its own axes, which are those of each point as well.

    Parameters
    ----------
    positions_m : array_like (K, 3)
        Places of the points on the body [m], in its own axes.
    labels : sequence of str
        Names of the points.
    T_tip_body : array_like (4, 4), optional
        Nominal pose in the tip frame [m].
    name : str
        Of the body, in the names of its parameters.
    prior_m, prior_rad : float, optional
        Standard deviations of place and rotation known before measuring.
    """

    nuisance = True
    beyond_chain = ""

    def __init__(
        self,
        positions_m: ArrayLike,
        labels: Sequence[str],
        T_tip_body: ArrayLike | None = None,
        name: str = "body",
        prior_m: float | None = None,
        prior_rad: float | None = None,
    ) -> None:
        message = "each point of the body needs three finite numbers"
        self._places = points_as_frames(positions_m, labels, message, "tool")[:, :3, 3]
        self.tools = tuple(labels)
        if len(set(self.tools)) != len(self.tools):
            raise InputError("two tools have the same name", name="tool", hint="rename one")
        nominal = np.eye(4) if T_tip_body is None else np.asarray(T_tip_body, dtype=float)
        self.T_nominal = check_transforms(nominal[None], "tool")[0]
        self.names = tuple(f"tool.{name}.{axis}" for axis in AXES)
        self.units = ("m",) * 3 + ("rad",) * 3
        self.prior = np.concatenate([prior_of(prior_m, 3), prior_of(prior_rad, 3)])

    @property
    def nominal(self) -> FloatArray:
        """Nominal place [m], and no rotation."""
        return np.append(self.T_nominal[:3, 3], np.zeros(3))

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        """See :meth:`ParameterBlock.displace`."""
        columns = columns_of(self.T_nominal[:3, :3] @ rotation_exp(values[3:].T))
        errors.tools += [
            Feature(values[:3] + turn(columns, place[:, None]), columns) for place in self._places
        ]

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`."""
        about = product(view.tool, columns_of(right_jacobian(values[3:].T)))
        for label, place in zip(self.tools, self._places, strict=True):
            mask = view.tiled(view.setup.tool, view.tools.index(label))
            share = 1.0 if mask is None else mask
            out[:3, :3] += share * view.walk.tip
            out[3:, :3] += share * cross(about, turn(view.tool, place[:, None]))
            out[3:, 3:] += share * about[:, : out.shape[1] - 3]
