"""Frames of the measuring set-up: on the tool, and around the arm.

A frame is a place and a rotation: ``R = R_nominal exp(r)`` with the rotation vector r in its own
axes. Points are frames without a rotation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from calib.batch_last import columns_of, cross, product, turn
from calib.errors import InputError
from calib.model.context import ArmErrors, Feature, MeasurementContext, Setup
from calib.model.parameters.base import ParameterBlock, Unit, prior_of, priors_of_units
from calib.model.parameters.links import AXES
from calib.se3 import (
    FloatArray,
    check_transforms,
    frame_about,
    right_jacobian,
    rotation_exp,
    rotation_log,
    transform,
)


class Frames(ParameterBlock):
    """Frames with free axes; subclasses say where they sit.

    Parameters
    ----------
    labels : sequence of str
        Names of the frames.
    T_nominal : array_like (K, 4, 4)
        In the tip frame or in the base frame [m].
    free : sequence of str
        Axes to identify, of x, y, z, rx, ry, rz; the same for all frames.
    """

    nuisance = True
    beyond_chain = ""
    side: ClassVar[Literal["tool", "target"]]
    """What they are, and the first part of the names."""

    def __init__(
        self,
        labels: Sequence[str],
        T_nominal: ArrayLike,
        free: Sequence[str],
        prior_m: float | None = None,
        prior_rad: float | None = None,
    ) -> None:
        kind = self.side
        self.T_nominal = check_transforms(T_nominal, kind)
        self.labels = tuple(labels)
        if len(set(self.labels)) != len(self.labels):
            raise InputError(f"two {kind}s have the same name", name=kind, hint="rename one")
        if len(set(free)) != len(free) or not set(free) <= set(AXES):
            raise InputError(
                f"free axes of the {kind} {' '.join(free)!r} are no part of {' '.join(AXES)}",
                name=kind,
            )
        self._axes = [AXES.index(axis) for axis in free]
        self._turns = any(axis >= 3 for axis in self._axes)
        stems = [kind if label == kind else f"{kind}.{label}" for label in self.labels]
        self.names = tuple(f"{stem}.{axis}" for stem in stems for axis in free)
        self.units = tuple("m" if axis < 3 else "rad" for axis in self._axes) * len(self.labels)
        self.prior = priors_of_units(self.units, prior_m, prior_rad)
        if kind == "tool":
            self.tools = self.labels
        else:
            self.targets = self.labels

    @property
    def nominal(self) -> FloatArray:
        """Nominal places [m], and no rotation; frame by frame ``(size,)``."""
        six = np.zeros((len(self.labels), 6))
        six[:, :3] = self.T_nominal[:, :3, 3]
        return np.asarray(six[:, self._axes].ravel())

    @property
    def positions_m(self) -> FloatArray:
        """Nominal places ``(K, 3)`` [m], free or not."""
        return np.asarray(self.T_nominal[:, :3, 3])

    def poses(self, values: ArrayLike) -> FloatArray:
        """Poses ``(K, 4, 4)`` of the frames at values ``(size,)``."""
        six = self._six(np.asarray(values, dtype=float)[:, None])[..., 0]
        R = self.T_nominal[:, :3, :3] @ rotation_exp(six[:, 3:])
        return transform(R, six[:, :3])

    def values_at(self, T: FloatArray, k: int, values: FloatArray) -> FloatArray:
        """Values ``(size,)`` with frame k at a pose ``(4, 4)``, as far as its axes are free."""
        out = values.copy()
        six = np.append(T[:3, 3], rotation_log(self.T_nominal[k, :3, :3].T @ T[:3, :3]))
        each = len(self._axes)
        out[k * each : (k + 1) * each] = six[self._axes]
        return out

    def _six(self, values: FloatArray) -> FloatArray:
        """Place [m] in the parent's axes and rotation vector of each frame, ``(K, 6, S)``."""
        six = np.zeros((len(self.labels), 6, values.shape[1]))
        six[:, :3] = self.T_nominal[:, :3, 3, None]
        six[:, self._axes] = values.reshape(len(self.labels), -1, values.shape[1])
        return six

    def features(self, values: FloatArray) -> list[Feature]:
        """The frames at values ``(size, S)``."""
        six, found = self._six(values), []
        for k, T in enumerate(self.T_nominal):
            R = T[:3, :3]
            columns: FloatArray | None
            if self._turns:
                columns = columns_of(R @ rotation_exp(six[k, 3:].T))
            else:
                columns = None if (np.eye(3) == R).all() else R.T[:, :, None]
            found.append(Feature(six[k, :3], columns))
        return found

    def _turning(self, values: FloatArray, k: int, columns: FloatArray) -> FloatArray:
        """Axes ``(3, 3, S)`` about which frame k turns for each number of its rotation vector."""
        six = self._six(values)[k]
        return product(columns, columns_of(right_jacobian(six[3:].T)))

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        placed = errors.tools if self.side == "tool" else errors.targets
        placed += self.features(values)

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`: the tool against targets goes the other way."""
        on_tool, setup = self.side == "tool", view.setup
        index, labels = (setup.tool, view.tools) if on_tool else (setup.target, view.targets)
        axes, sign = (view.tool, 1.0) if on_tool else (view.target, -1.0)
        per_frame = out.reshape(len(self.labels), len(self._axes), *out.shape[1:])
        for frame, (label, rows) in enumerate(zip(self.labels, per_frame, strict=True)):
            mask = view.tiled(index, labels.index(label))
            about = sign * self._turning(values, frame, axes) if self._turns else None
            for k, axis in enumerate(self._axes):
                if about is None or axis < 3:
                    shift = self._shift(frame, axis)[:, None]
                    rows[k, :3] = view.walk.tip[axis] if on_tool else -shift
                else:
                    if not on_tool:  # a tool turns about its own origin, which stays
                        rows[k, :3] = cross(about[axis - 3], view.error)
                    rows[k, 3:] = about[axis - 3][: rows.shape[1] - 3]
            if mask is not None:
                rows *= mask

    def _shift(self, frame: int, axis: int) -> FloatArray:
        """Direction in the base ``(3,)`` in which a frame goes for one of its first numbers."""
        return np.asarray(np.eye(3)[axis])


class OnTool(Frames):
    """Frames that the tip carries."""

    side = "tool"


class AroundArm(Frames):
    """Frames that measurements are taken from."""

    side = "target"


def points_as_frames(places: ArrayLike, labels: Sequence[str], what: str, name: str) -> FloatArray:
    """Poses ``(K, 4, 4)`` of points ``(K, 3)``."""
    p = np.atleast_2d(np.asarray(places, dtype=float))
    if p.shape != (len(labels), 3) or not np.isfinite(p).all():
        raise InputError(f"each {what} needs three finite numbers", name=name)
    return transform(np.eye(3), p)


class ToolFrame(OnTool):
    """A frame on the tip: where the tracker's target, the gripper or the camera is.

    Parameters
    ----------
    T_tip_tool : array_like (4, 4)
        Nominal pose in the tip frame [m].
    free : sequence of str
        Of x, y, z, rx, ry, rz; all by default.
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
    free : str
        Axes of the tip frame along which they are to be identified, a part of ``"xyz"``.
    """

    def __init__(
        self,
        positions_m: ArrayLike,
        labels: Sequence[str],
        free: str = "xyz",
        prior_m: float | None = None,
    ) -> None:
        places = points_as_frames(positions_m, labels, "tool point", "tool")
        super().__init__(labels, places, free, prior_m)


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
    """

    def __init__(
        self, position_m: ArrayLike, free: str = "xyz", prior_m: float | None = None
    ) -> None:
        super().__init__(position_m, ["tool"], free, prior_m)

    @property
    def position_m(self) -> FloatArray:
        """Nominal position ``(3,)`` [m] in tip axes, free or not."""
        return np.asarray(self.positions_m[0])


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
        self._places = points_as_frames(positions_m, labels, "point of the body", "tool")[:, :3, 3]
        self.tools = tuple(labels)
        if len(set(self.tools)) != len(self.tools):
            raise InputError("two tools have the same name", name="tool", hint="rename one")
        nominal = np.eye(4) if T_tip_body is None else np.asarray(T_tip_body, dtype=float)
        self.T_nominal = check_transforms(nominal[None], "tool")[0]
        self.names = tuple(f"tool.{name}.{axis}" for axis in AXES)
        self.units: tuple[Unit, ...] = ("m",) * 3 + ("rad",) * 3
        self.prior = priors_of_units(self.units, prior_m, prior_rad)

    @property
    def nominal(self) -> FloatArray:
        """Nominal place [m], and no rotation."""
        return np.append(self.T_nominal[:3, 3], np.zeros(3))

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        columns = columns_of(self.T_nominal[:3, :3] @ rotation_exp(values[3:].T))
        errors.tools += [
            Feature(values[:3] + turn(columns, place[:, None]), columns) for place in self._places
        ]

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        about = product(view.tool, columns_of(right_jacobian(values[3:].T)))
        for label, place in zip(self.tools, self._places, strict=True):
            mask = view.tiled(view.setup.tool, view.tools.index(label))
            share = 1.0 if mask is None else mask
            out[:3, :3] += share * view.walk.tip
            out[3:, :3] += share * cross(about, turn(view.tool, place[:, None]))
            out[3:, 3:] += share * about[:, : out.shape[1] - 3]


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
    """

    def __init__(
        self,
        positions_m: ArrayLike,
        labels: Sequence[str] = ("T1",),
        free: bool = True,
        prior_m: float | None = None,
    ) -> None:
        places = points_as_frames(positions_m, labels, "target", "target")
        super().__init__(labels, places, "xyz" if free else "", prior_m)


class TargetFrame(AroundArm):
    """A frame that poses and points are measured in: of a tracker, a measuring arm, a camera.

    Parameters
    ----------
    T_base_target : array_like (4, 4)
        Nominal pose in the base frame [m].
    free : sequence of str
        Of x, y, z, rx, ry, rz; all by default.
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
        T = transform(frame_about(z / length), point_m)
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
    """What a wire or a ball bar shows more than the distance: the zero that its reading has."""

    nuisance = True
    beyond_chain = ""

    def __init__(self, labels: Sequence[str], prior_m: float | None = None) -> None:
        self.labels = self.measured_from = tuple(labels)
        self.names = tuple(f"length.{label}" for label in labels)
        self.units = tuple("m" for _ in self.names)
        self.prior = prior_of(prior_m, len(self.names))

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        errors.lengths |= dict(zip(self.labels, values, strict=True))

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`: as if the tool point went outwards."""
        _, away = view.distance()
        for label, row in zip(self.labels, out, strict=True):
            shown = view.is_distance & (view.setup.target == view.targets.index(label))
            mask = view.tiled(shown.astype(np.intp), 1)
            row[:3] = away if mask is None else mask * away
