"""Where the estimate over pixels starts: a lens, the board in each picture, then A X = Z B."""

from __future__ import annotations

import cv2
import numpy as np

from calib import se3
from calib.errors import ConvergenceError, InputError
from calib.lens import DISTORTION, Lens, LensName
from calib.se3 import BoolArray, FloatArray

FEWEST_POINTS = 6
"""Points of a board from which its place in a picture is taken: four fit any."""

_MOST_PICTURES = 40
"""Pictures that the lens to start from is found with: more only take longer."""

_USUAL_FOCAL = 1.2
"""Focal length over the longer side of the image where nothing says more: 45 deg wide."""


def start_lens(
    name: LensName, size_px: tuple[int, int], points: FloatArray, pixels: FloatArray
) -> Lens:
    """A lens from pictures of a board alone (Zhang, IEEE TPAMI 22, 2000), by OpenCV.

    Points ``(K, 3)`` [m] and pixels ``(N, K, 2)``, NaN where a point was not seen.

    Its higher terms of distortion are zero: pictures may say nothing of them. It is one of usual
    focal length and without distortion where they say nothing of it at all.
    """
    seen = np.asarray(np.isfinite(pixels).all(axis=-1))
    rich = np.flatnonzero(seen.sum(axis=1) >= FEWEST_POINTS)
    some = rich[np.unique(np.linspace(0, len(rich) - 1, _MOST_PICTURES).astype(int))]
    focal = _USUAL_FOCAL * max(size_px)
    K = np.array([[focal, 0, size_px[0] / 2], [0, focal, size_px[1] / 2], [0, 0, 1.0]])
    usual = Lens.from_opencv(name, size_px, K, np.zeros(len(DISTORTION[name])))
    objects = [points[seen[i]].astype(np.float32).reshape(1, -1, 3) for i in some]
    images = [(pixels[i, seen[i]] - 0.5).astype(np.float32).reshape(1, -1, 2) for i in some]
    ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-10)
    try:
        if name == "fisheye":
            flags = cv2.fisheye.CALIB_RECOMPUTE_EXTRINSIC + cv2.fisheye.CALIB_FIX_SKEW
            flags += cv2.fisheye.CALIB_FIX_K3 + cv2.fisheye.CALIB_FIX_K4
            start = np.eye(3), np.zeros(4)  # where it is written to
            found = cv2.fisheye.calibrate(
                [o.astype(float) for o in objects],
                [i.astype(float) for i in images],
                size_px,
                *start,
                flags=flags,
                criteria=ends,
            )
        else:
            found = cv2.calibrateCamera(
                objects,
                images,
                size_px,
                np.eye(3),
                np.zeros(5),
                flags=cv2.CALIB_FIX_K3,
                criteria=ends,
            )
        terms = np.ravel(found[2]).astype(float)[: len(DISTORTION[name])]
        lens = Lens.from_opencv(name, size_px, np.asarray(found[1], dtype=float), terms)
    except (cv2.error, InputError):  # pictures that Zhang's method cannot do with
        return usual
    return lens if 0.1 < lens.values[0] / max(size_px) < 50.0 else usual


def board_poses(lens: Lens, points: FloatArray, pixels: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Poses ``T_camera_board`` ``(N, 4, 4)`` [m] and in which pictures there is one, ``(N,)``.

    Of the two poses that a plane is seen in (IPPE) the one that fits better, refined.

    Raises
    ------
    ConvergenceError
        No picture shows enough of the board.
    """
    rays = lens.rays(pixels)
    seen = np.asarray(np.isfinite(rays).all(axis=-1))
    poses = np.tile(np.eye(4), (len(pixels), 1, 1))
    found = seen.sum(axis=1) >= FEWEST_POINTS
    for i in np.flatnonzero(found).tolist():
        own, ray = points[seen[i]], np.ascontiguousarray(rays[i, seen[i]])
        flat = bool(np.ptp(own[:, 2]) == 0.0)
        how = cv2.SOLVEPNP_IPPE if flat else cv2.SOLVEPNP_SQPNP
        ok, turn, place = cv2.solvePnP(own, ray, np.eye(3), None, flags=how)
        if ok and np.isfinite(place).all():
            turn, place = cv2.solvePnPRefineLM(own, ray, np.eye(3), None, turn, place)
            poses[i] = se3.transform(se3.rotation_exp(turn[:, 0]), place[:, 0])
        found[i] = ok and np.isfinite(poses[i]).all() and poses[i, 2, 3] > 0
    if not found.any():
        raise ConvergenceError(
            f"no picture shows {FEWEST_POINTS} points of the board",
            hint="is the board the one that is described?",
        )
    return poses, found
