"""Sections of a ``cell.toml`` about visual touch-up: its loop, its target, its simulated camera."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StrictBool, model_validator

from posedesign.cell.schema_types import Finite, Name, NotNegative, Section, Size, Vector

Count = Annotated[int, Field(strict=True, ge=1, le=100)]
ShareOfLight = Annotated[float, Field(strict=True, ge=-1, le=1)]


class TouchUpSection(Section):
    """The loop of visual touch-up.

    ``approach_deg``: the last movement of every stop, more than the lost motion of a reducer (one
    arc minute is 0.017 deg); 0 for none. ``shown_within_deg``: how far joints may be shown off what
    was commanded, by rounding, width of fine positions, and lost motion where encoders see it.
    ``correct_tilt``: take off what the tilt of the target does to its ellipse. ``repeats``:
    touch-ups that the noise is measured by; 0 to take that of the file. ``inch_deg``: how far the
    arm turns about the target to find camera and target.
    """

    center_px: Annotated[float, Field(strict=True, ge=1e-3, le=50)] = 0.1
    size_px: Annotated[float, Field(strict=True, ge=1e-3, le=50)] = 0.05
    iterations: Count = 10
    farthest_mm: Annotated[float, Field(strict=True, ge=1, le=1000)] = 100.0
    looks: Count = 1
    approach_deg: Annotated[float, Field(strict=True, ge=0, le=5)] = 0.2
    shown_within_deg: Annotated[float, Field(strict=True, ge=1e-3, le=2)] = 0.1
    correct_tilt: StrictBool = True
    repeats: Annotated[int, Field(strict=True, ge=0, le=100)] = 10
    inch_deg: Annotated[float, Field(strict=True, ge=2, le=40)] = 15.0


class TargetSection(Section):
    """The point that is touched; where the tool point stands at the base pose by default.

    Radius, plate and cross are those of the round target that a camera sees; the cross is length
    and width of its bars.
    """

    name: Name = "T1"
    position_mm: Vector | None = None
    normal: Vector | None = None
    radius_mm: NotNegative = 0.0
    plate_mm: tuple[Size, Size] | None = None
    cross_mm: tuple[Size, Size] | None = None
    dark: StrictBool = True

    @model_validator(mode="after")
    def _has_direction(self) -> TargetSection:
        if self.normal is not None and max(map(abs, self.normal)) < 1e-6:
            raise ValueError("normal has no direction")
        return self


class ImagingSection(Section):
    """How the simulated camera takes pictures: grey levels of 255, pixels, shares of the light.

    ``gradient`` is the change of the light across and down the picture, ``vignetting`` its loss in
    the corners, ``distortion`` OpenCV's k1, k2, p1, p2, k3.
    """

    noise_grey: NotNegative = 2.0
    blur_px: NotNegative = 1.0
    gradient: tuple[ShareOfLight, ShareOfLight] = (0.0, 0.0)
    vignetting: ShareOfLight = 0.0
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0, 0.0)
    vibration_mm: NotNegative = 0.002
