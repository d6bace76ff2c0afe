"""How the picture moves when the tip moves: Eq. 2 of Watanabe et al. 2006.

Measured by small moves of the arm tip along its own axes. The camera is rigid on the tip, so it
holds at every pose of the arm; and as the arm moves in metres, it tells the camera, too: how it is
turned on the tip, its focal length in pixels, and how large the target is. Nothing of that has to
be known before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, project_to_rotation
from calib.vision.camera.conic import ellipse_vhs
from calib.vision.touch_up.drive import Drive, shifted


@dataclass(frozen=True)
class Relation:
    """Where in the image the target is to be, and how large: section 2.1 of [Watanabe2006]_.

    It is the tip of a virtual pin: the place before the lens at which a target is seen so. A view
    is compared with it by the three numbers ``e = (dV, dH, ds)`` of :meth:`error`, which the paper
    has as ``(V - V0, H - H0, 1/s - 1/s0)``.
    """

    center_px: tuple[float, float]
    """H0 and V0: to the right and down from the left upper corner of the image."""
    size_px: float  # s0: long axis of the target's ellipse

    def __post_init__(self) -> None:
        if not (np.isfinite([*self.center_px, self.size_px]).all() and self.size_px > 0.0):
            raise InputError(
                f"the target cannot be designated to be {self.size_px} px large at "
                f"{self.center_px} px",
                hint="give a place in the image and a size above zero",
                name="relation",
            )

    def error(self, ellipses: FloatArray, bias: FloatArray | float = 0.0) -> FloatArray:
        """How far views ``(..., 5)`` [px] are from the relation, ``(..., 3)`` [px].

        ``bias`` ``(..., 3)`` is taken off V, H and s first.

        ``(V - V0) s0/s``, ``(H - H0) s0/s`` and ``s0 (s0/s - 1)``. By Eq. 1 the distance of the
        target is proportional to 1/s, so these three are *linear* in the place of the target
        before the lens, however far off it is: the factor ``s/s0`` that Eq. 2 has in the Jacobian,
        for a Jacobian measured at s0 and used at s, is here taken out of the data. ``s0²`` turns
        the paper's 1/s into pixels.
        """
        vhs = ellipse_vhs(ellipses) - bias
        ratio = self.size_px / vhs[..., 2]
        right, down = self.center_px
        out = np.empty(vhs.shape)
        out[..., 0] = (vhs[..., 0] - down) * ratio
        out[..., 1] = (vhs[..., 1] - right) * ratio
        out[..., 2] = self.size_px * (ratio - 1.0)
        return out


_LEAST_RESPONSE_PX = 1.0
"""Response to a move below which its direction is lost in the noise of the picture."""

SQUARE = 0.04
"""Part by which responses down and across the picture may differ: pixels are squares, and an arm
with usual errors shows them so within a hundredth."""

CORNER = np.deg2rad(2.0)
"""Angle by which the sides of the picture may be off right angles: four times what an arm with
usual errors makes of them. With an axis of the wrong sign, of another robot or next to a
singularity they are farther off."""

ORTHOGONAL = np.deg2rad(5.0)
"""The same of the way along which the size grows: noise, and the middle of the picture, which may
be a few hundredths of the focal length beside the axis of the lens."""


@dataclass(frozen=True, eq=False)
class ImageJacobian:
    """Derivatives of the relation's error by the place of the tip."""

    matrix: FloatArray
    """(3, 3): by x, y, z of the tip [px/m]; rows V, H and size, as :meth:`Relation.error` has
    them."""
    relation: Relation

    def shift(self, error: FloatArray, *, view_line: bool = False) -> FloatArray:
        """Shift of the tip ``(..., 3)`` [m] in its own axes that takes errors ``(..., 3)`` away.

        Eq. 3; the sign is that of the error, measured less designated. For a view line the size is
        left as it is, and the shift is the smallest that takes V and H away.
        """
        if view_line:
            return np.asarray(-error[..., :2] @ np.linalg.pinv(self.matrix[:2]).T)
        return np.asarray(-np.linalg.solve(self.matrix, error[..., None])[..., 0])

    def updated(self, shift_m: FloatArray, change: FloatArray) -> ImageJacobian:
        """The same where a shift of the tip ``(3,)`` [m] changed the error by ``(3,)`` [px].

        It then says so of that shift, and what it said of those across it stays [Broyden1965]_.

        References
        ----------
        .. [Broyden1965] C. G. Broyden, A class of methods for solving nonlinear simultaneous
           equations, Mathematics of Computation 19.
        """
        missed = (change - self.matrix @ shift_m) / (shift_m @ shift_m)
        return replace(self, matrix=self.matrix + np.outer(missed, shift_m))

    @property
    def distance_m(self) -> float:
        """Distance of the target from the lens in the designated relation [m]."""
        return float(self.relation.size_px / -(self.matrix[2] @ self.R_tip_camera[:, 2]))

    @property
    def focal_px(self) -> float:
        """Focal length [px]."""
        across = np.linalg.norm(self.matrix[:2], axis=1)
        return float(across.mean() * self.distance_m)

    @property
    def diameter_m(self) -> float:
        """Diameter of the target's circle [m], by Eq. 1."""
        return self.relation.size_px * self.distance_m / self.focal_px

    @cached_property
    def R_tip_camera(self) -> FloatArray:
        """Axes of the camera on the tip ``(3, 3)``: x right, y down, z along the view."""
        # the target moves against the camera: the rows point against the camera's axes
        rows = -self.matrix[[1, 0]] / np.linalg.norm(self.matrix[[1, 0]], axis=1, keepdims=True)
        # the view line, along which V and H stay, is known far better than where the size grows
        view = np.cross(rows[0], rows[1])
        return project_to_rotation(np.column_stack([*rows, view / np.linalg.norm(view)]))

    def flaw(self) -> str:
        """Why no camera that an arm carries sees this, in words; empty where one does."""
        lengths = np.linalg.norm(self.matrix, axis=1)
        if not np.isfinite(lengths).all() or lengths.min() <= 0.0:
            return "the picture does not follow the arm"
        rows = -self.matrix[[1, 0, 2]] / lengths[[1, 0, 2], None]
        if np.linalg.det(rows) <= 0.0:
            return "the picture is mirrored, or an axis of the arm has the wrong sign"
        off = np.arcsin(np.abs([rows[0] @ rows[1], rows[1] @ rows[2], rows[2] @ rows[0]]))
        if (off > [CORNER, ORTHOGONAL, ORTHOGONAL]).any():
            return (
                f"the axes of the picture are {np.rad2deg(off.max()):.0f} deg off right angles: is "
                "it this robot, in these joint signs?"
            )
        if abs(lengths[0] / lengths[1] - 1.0) > SQUARE:
            return (
                "the picture moves more along one side than along the other: are its pixels "
                "squares, and is it this robot?"
            )
        return ""


@dataclass(frozen=True, eq=False)
class MeasuredJacobian:
    """What came of measuring a Jacobian: itself, or why there is none."""

    jacobian: ImageJacobian | None
    reason: str = ""
    status: str = "touched"


def measure_jacobian(
    drive: Drive, q: FloatArray, relation: Relation, step_m: float, *, both_ways: bool = False
) -> MeasuredJacobian:
    """Measure the Jacobian by moves of the tip from a posture ``(n,)`` [rad] along x, y and z.

    One arm ends where it began. Both ways are six moves in place of three: twice the baseline.
    """
    first = np.zeros(1, dtype=np.intp)
    T = drive.robot.fk(q)
    seen = []
    steps = [*np.eye(3), *(-np.eye(3))] if both_ways else [np.zeros(3), *np.eye(3)]
    for axis in steps:
        reason = drive.to_pose(first, q[None], shifted(T, step_m * axis)[None])[0]
        if reason:
            return MeasuredJacobian(None, reason, "no posture")
        view = drive.arms.look(first)
        if view.reasons[0]:
            return MeasuredJacobian(None, view.reasons[0], "lost")
        seen.append(relation.error(view.ellipses)[0])
    drive.to_posture(first, q[None])
    if both_ways:
        rows = (np.array(seen[:3]) - seen[3:]) / (2.0 * step_m)
    else:
        rows = (np.array(seen[1:]) - seen[0]) / step_m
    if (np.abs(rows[:, :2]).max(axis=0) * step_m < _LEAST_RESPONSE_PX).any():
        return MeasuredJacobian(None, "the picture does not follow the arm", "unmoved")
    return MeasuredJacobian(ImageJacobian(rows.T, relation))
