"""Types of the values of a ``cell.toml``: units, bounds, and what a table of keys is."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from posedesign.files import LARGEST_NUMBER, LEAST_POSITIVE


def _is_not_tiny(value: float) -> float:
    if value < LEAST_POSITIVE:
        raise ValueError(f"should be at least {LEAST_POSITIVE:g}")
    return value


_NOT_TINY = AfterValidator(_is_not_tiny)

Finite = Annotated[
    float, Field(strict=True, ge=-LARGEST_NUMBER, le=LARGEST_NUMBER, allow_inf_nan=False)
]
Positive = Annotated[
    float,
    Field(strict=True, gt=0, le=LARGEST_NUMBER, allow_inf_nan=False),
    _NOT_TINY,
]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
NotNegative = Annotated[float, Field(strict=True, ge=0, le=1e6, allow_inf_nan=False)]
Length = Annotated[float, Field(strict=True, ge=-1e6, le=1e6, allow_inf_nan=False)]
"""[mm]; a kilometre is no robot cell."""
Vector = tuple[Length, Length, Length]
Variation = Annotated[float, Field(strict=True, ge=0, lt=180, allow_inf_nan=False)]
"""[deg]; zero holds an angle."""
Step = Annotated[float, Field(strict=True, ge=0.1, lt=180, allow_inf_nan=False)]
"""[deg]; finer steps would be rounds without end."""
VariationVector = tuple[Variation, Variation, Variation]
Noise = Annotated[float, Field(strict=True, gt=0, le=1e3, allow_inf_nan=False), _NOT_TINY]
"""[mm, deg]"""
NoiseVector = tuple[Noise, Noise, Noise]
PerJoint = NotNegative | tuple[NotNegative, ...]
"""One number for all joints, or one for each."""
Line = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f-\x9f\u2028\u2029]*$")]
"""Text that stays on one line and does not steer a terminal."""

Name = Annotated[Line, Field(min_length=1, max_length=40)]
Size = Annotated[float, Field(strict=True, gt=0, le=1e6, allow_inf_nan=False), _NOT_TINY]
"""[mm]"""
Pixels = Annotated[int, Field(strict=True, gt=0, le=100_000)]

BoxSteps = Annotated[int, Field(strict=True, ge=1, le=25)]
"""Points along an axis of a box: 25 along each are fifteen thousand postures to find."""


class Section(BaseModel):
    """A table of the file; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=False)
