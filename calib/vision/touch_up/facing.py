"""How a round target is turned, from the ellipses that it was seen as."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from calib.robots import Robot
from calib.se3 import FloatArray, transform
from calib.vision.camera import Camera, circle_image
from calib.vision.camera.conic import ellipse_vhs
from calib.vision.touch_up.jacobian import ImageJacobian

LARGEST_RMS_PX = 0.2
"""Rms by which half axes of the ellipses may differ from those of a circle: ten times their noise
and what a lens bends. A target that is not round, or a wrist that turns the other way, is far off.
"""

_START_TILTS = np.deg2rad([0.0, 25.0, 50.0])
_START_SIDES = 8


@dataclass(frozen=True, eq=False)
class Facing:
    """The face of a target.

    Attributes
    ----------
    normal : array (3,)
        Unit vector out of it, in base axes.
    sigma_rad : float
        Larger of the two standard deviations of its direction, from the residuals.
    rms_px : float
        What is left of the half axes.
    flaw : str
        Why the ellipses are not those of one flat circle; empty where they are.
    """

    normal: FloatArray
    sigma_rad: float
    rms_px: float
    flaw: str


@dataclass(frozen=True, eq=False)
class TiltBias:
    """What a tilt does to the ellipse of a circle, where the tilt is known.

    The centre of the ellipse is not the image of the middle, and the long axis is a little longer
    than Eq. 1 has it: the near half is seen larger. At 45 deg a circle of 20 mm seen from 350 mm is
    off by as much as the paper's Table 3.

    Attributes
    ----------
    robot : Robot
        Nominal: its orientation is right to a tenth of a degree.
    jacobian : ImageJacobian
        Of which the focal length, the distance and the diameter of the target are taken.
    normal : array (3,)
        Of the target, in base axes.
    """

    robot: Robot
    jacobian: ImageJacobian
    normal: FloatArray

    def __call__(self, q: FloatArray) -> FloatArray:
        """Of postures ``(K, n)`` [rad], ellipse less middle and size ``(K, 3)`` [px]: V, H, s.

        Nothing where the circle shows its back.
        """
        R = self.robot.fk(q)[:, :3, :3] @ self.jacobian.R_tip_camera
        place = np.array([0.0, 0.0, self.jacobian.distance_m])
        faces = _faces(np.einsum("nji,j->ni", R, self.normal), place)
        seen = circle_image(camera_of(self.jacobian), self.jacobian.diameter_m, faces)
        right, down = self.jacobian.relation.center_px
        off = ellipse_vhs(seen) - [down, right, self.jacobian.relation.size_px]
        return np.asarray(np.nan_to_num(off))


def find_normal(jacobian: ImageJacobian, R_base_tip: FloatArray, ellipses: FloatArray) -> Facing:
    """Normal of a target seen in the designated relation from orientations ``(N, 3, 3)``.

    The half axes of the ellipses ``(N, 5)`` [px] against those of the circle's image. One picture
    has two answers; the turns between several leave one.
    """
    R_base_camera = R_base_tip @ jacobian.R_tip_camera
    camera = camera_of(jacobian)
    place = np.array([0.0, 0.0, jacobian.distance_m])
    towards = -R_base_camera[0, :, 2]
    across = np.linalg.svd(towards[None])[2][1:]

    def normals(x: FloatArray) -> FloatArray:
        n = towards + x @ across
        return np.asarray(n / np.linalg.norm(n))

    def missed(x: FloatArray) -> FloatArray:
        in_camera = np.einsum("nji,j->ni", R_base_camera, normals(x))
        seen = circle_image(camera, jacobian.diameter_m, _faces(in_camera, place))
        # a face turned away is seen as nothing: as far off as an ellipse can be
        off = np.where(np.isnan(seen), 0.0, seen)[:, 2:] - ellipses[:, 2:]
        return np.asarray(off.ravel())

    starts = [np.zeros(2)]
    for tilt in _START_TILTS[1:]:
        angle = np.arange(_START_SIDES) * 2.0 * np.pi / _START_SIDES
        starts += list(np.tan(tilt) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
    best = min(starts, key=lambda x: float((missed(x) ** 2).sum()))
    fit = least_squares(missed, best, method="lm", x_scale=0.1)
    mirrored = least_squares(missed, -fit.x, method="lm", x_scale=0.1)
    fit = min(fit, mirrored, key=lambda f: float(f.cost))
    rms = float(np.sqrt(np.mean(fit.fun**2)))
    J = np.asarray(fit.jac)
    sigma = float(rms * np.sqrt(1.0 / max(np.linalg.eigvalsh(J.T @ J)[0], 1e-300)))
    flaw = ""
    if not rms <= LARGEST_RMS_PX:
        flaw = (
            "the pictures are not those of a flat circle seen from the arm's orientations: "
            f"{rms:.1f} px are left over"
        )
    return Facing(normals(fit.x), sigma, rms, flaw)


def camera_of(jacobian: ImageJacobian) -> Camera:
    """The camera as it was found: an ideal lens, its axis through the place of the relation."""
    right, down = jacobian.relation.center_px
    size = (2 * int(np.ceil(right)), 2 * int(np.ceil(down)))
    return Camera(*size, jacobian.focal_px, principal_px=(right, down))


def _faces(normals: FloatArray, place: FloatArray) -> FloatArray:
    """Poses ``(N, 4, 4)`` at a place ``(3,)`` whose z axes are ``(N, 3)``."""
    aside = np.where(np.abs(normals[:, :1]) < 0.9, [[1.0, 0.0, 0.0]], [[0.0, 1.0, 0.0]])
    y = np.cross(normals, aside)
    y /= np.linalg.norm(y, axis=1, keepdims=True)
    R = np.stack([np.cross(y, normals), y, normals], axis=-1)
    return transform(R, np.tile(place, (len(normals), 1)))
