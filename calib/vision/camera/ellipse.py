"""Measurement of a circular target in an image: where it is, and how long its long axis.

The contour is found by thresholds, its edge to a fraction of a pixel along the normals of a first
ellipse, and the ellipse of least squares goes through those edges, outliers left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.se3 import FloatArray
from calib.vision.camera.conic import (
    ellipse_axes,
    ellipse_of_axes,
    ellipse_points,
    fit_robust,
    is_sound,
)
from calib.vision.camera.edges import find_candidates, find_edges
from calib.vision.camera.rendering import GreyImage

Status = Literal["ok", "no target", "touches the edge", "poor fit", "several"]

LARGEST_RMS_PX = 0.2
"""Rms distance of the edges from the ellipse above which it is no ellipse: four times that at a
noise of two grey levels in two hundred. What hides a part of the rim leaves more."""

LEAST_SHARE = 0.75
"""Share of the rim that must be seen. With less, one side of the ellipse hangs on the other, and
the edge of what hides the rest is taken for rim: ellipses were off by half their size at 0.65."""

_REFINEMENTS = 2
"""Passes of the subpixel edges: the first starts half a pixel off, the second at their noise."""

_EDGE_FLOOR_PX = 0.1
"""Edges nearer than that to the ellipse are never outliers."""


@dataclass(frozen=True, eq=False)
class EllipseMeasurement:
    """What is measured of a circular target in an image."""

    center_px: FloatArray
    """(2,): centre of the ellipse, x to the right and y down from the left upper corner of the
    image. It is not quite where the middle of the circle is seen: :func:`circle_center_bias`."""
    long_axis_px: float
    short_axis_px: float  # long_axis_px, short_axis_px: whole lengths of the axes
    angle_rad: float  # direction of the long axis from x towards y, in (-pi/2, pi/2]
    rms_px: float
    """Rms distance of the edges that were kept from the ellipse; 0 where no image was looked at."""
    status: Status
    """The numbers are NaN with ``"no target"``, ``"touches the edge"`` and ``"several"``."""
    message: str  # the status in a sentence

    @property
    def is_ok(self) -> bool:
        """Whether the measurement can be used."""
        return self.status == "ok"

    @property
    def vhs_px(self) -> FloatArray:
        """V (down), H (to the right) and size s ``(3,)``: the data of [Watanabe2006]_, sec. 2.1."""
        return np.array([self.center_px[1], self.center_px[0], self.long_axis_px])

    @property
    def ellipse(self) -> FloatArray:
        """The ellipse as :mod:`calib.vision.camera.conic` writes it ``(5,)`` [px]."""
        return ellipse_of_axes(
            self.center_px, self.long_axis_px, self.short_axis_px, self.angle_rad
        )

    @classmethod
    def from_ellipse(
        cls,
        ellipse: FloatArray,
        rms_px: float,
        status: Status = "ok",
        message: str = "the target is measured",
    ) -> EllipseMeasurement:
        """Measurement of an ellipse ``(5,)`` [px]."""
        long, short, angle = ellipse_axes(ellipse)
        return cls(
            ellipse[:2].copy(), float(long), float(short), float(angle), rms_px, status, message
        )

    @classmethod
    def failed(cls, status: Status, message: str) -> EllipseMeasurement:
        """Outcome without numbers."""
        nan = float("nan")
        return cls(np.full(2, nan), nan, nan, nan, nan, status, message)


def measure_ellipse(
    image: GreyImage,
    *,
    dark: bool = True,
    smallest_px: float = 10.0,
    near_px: FloatArray | None = None,
) -> EllipseMeasurement:
    """Find the circular target in an image and measure it.

    Parameters
    ----------
    image : ndarray (height, width) of uint8
    dark : bool
        Whether the circle is darker than the plate about it.
    smallest_px : float
        Short axis below which nothing is taken for a target.
    near_px : ndarray (2,), optional
        Where the target is expected: of several the nearest is measured. Unless given, several are
        an outcome of their own.
    """
    whole, cut = find_candidates(image, dark=dark, smallest_px=smallest_px)
    if not whole:
        if cut:
            x, y = cut[0][:2]
            return EllipseMeasurement.failed(
                "touches the edge", f"the target near ({x:.0f}, {y:.0f}) px is cut by the edge"
            )
        kind = "dark" if dark else "light"
        return EllipseMeasurement.failed(
            "no target", f"no {kind} ellipse of {smallest_px:g} px or more in the image"
        )
    if near_px is not None:
        whole.sort(key=lambda e: float(np.linalg.norm(e[:2] - near_px)))
    elif len(whole) > 1:
        places = ", ".join(f"({e[0]:.0f}, {e[1]:.0f})" for e in whole)
        return EllipseMeasurement.failed("several", f"{len(whole)} targets, at {places} px")
    return _refined(image, whole[0], dark)


def _refined(image: GreyImage, ellipse: FloatArray, dark: bool) -> EllipseMeasurement:
    size = np.array(image.shape[::-1])
    for _ in range(_REFINEMENTS):
        rim = ellipse_points(ellipse, 16)
        if not is_sound(ellipse) or (rim < 0.0).any() or (rim > size).any():
            return EllipseMeasurement.failed(
                "touches the edge", "a part of the target's rim is outside the image"
            )
        edges = find_edges(image, ellipse, dark=dark)
        if edges.share < LEAST_SHARE:
            return _poor(ellipse, np.nan, edges.share)
        fit = fit_robust(edges.points[edges.found], ellipse, _EDGE_FLOOR_PX)
        ellipse = fit.ellipse
    share = float(fit.kept.sum() / len(edges.found))
    if not is_sound(ellipse) or fit.rms_px > LARGEST_RMS_PX or share < LEAST_SHARE:
        return _poor(ellipse, fit.rms_px, share)
    return EllipseMeasurement.from_ellipse(
        ellipse, fit.rms_px, message=f"{share:.0%} of the rim, {fit.rms_px:.3f} px rms"
    )


def _poor(ellipse: FloatArray, rms_px: float, share: float) -> EllipseMeasurement:
    message = f"an ellipse fits {share:.0%} of the rim"
    if np.isfinite(rms_px):
        message += f" with {rms_px:.2f} px rms"
    return EllipseMeasurement.from_ellipse(
        ellipse,
        rms_px,
        "poor fit",
        f"{message}; {LEAST_SHARE:.0%} and {LARGEST_RMS_PX:g} px are needed",
    )
