"""Sections of a ``cell.toml`` about what is identified, and from what."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from calib.identification.losses import Loss
from posedesign.cell.schema_types import (
    Name,
    Noise,
    NoiseVector,
    NotNegative,
    Positive,
    Section,
    Size,
    Vector,
)

Word = Literal[
    "zero_offsets",
    "geometry",
    "compliance",
    "bearings",
    "lost_motion",
    "scale",
    "harmonics",
    "priors",
]
"""What a model may free of the arm; ``priors`` holds all of it to what is known beforehand."""


class ParameterSection(Section):
    """What is identified besides the set-up, and how: each list of ``models`` is one to try."""

    zero_offsets: tuple[str, ...] | None = None
    tool_axes: Annotated[str, Field(pattern=r"^x?y?z?$")] | None = None
    models: Annotated[tuple[tuple[Word, ...], ...], Field(min_length=1, max_length=20)] = (
        ("zero_offsets",),
        ("zero_offsets", "compliance"),
        ("geometry",),
        ("geometry", "compliance"),
        ("geometry", "priors"),
        ("geometry", "compliance", "priors"),
    )
    tune_priors: bool = True
    harmonics: Annotated[tuple[Positive, ...], Field(min_length=1)] = (1.0, 2.0)
    lost_motion_nm: Positive = 10.0
    prior_offset_deg: Positive = 1.0
    prior_length_mm: Positive = 0.5
    prior_angle_deg: Positive = 0.1
    prior_harmonic_deg: Positive = 0.02
    prior_compliance_urad_nm: Positive = 50.0
    method: Literal["gauss-newton", "newton-raphson"] = "gauss-newton"
    loss: Literal["auto", "least-squares", "huber", "cauchy", "student-t", "graduated"] = "auto"

    @property
    def loss_given(self) -> Loss | None:
        """The loss; None where it is to be found which suits the residuals."""
        return None if self.loss == "auto" else self.loss

    @model_validator(mode="after")
    def _models_differ(self) -> ParameterSection:
        sets = [frozenset(model) for model in self.models]
        for model in self.models:
            if not set(model) - {"priors"} or len(set(model)) != len(model):
                raise ValueError("each of models lists what it frees, once")
        if len(set(sets)) != len(sets):
            raise ValueError("two of models free the same")
        return self


class NoiseSection(Section):
    """Noise of a further kind of measurement, in the axes of its instrument."""

    kind: Literal["touch-up", "view-line", "plane", "point", "pose", "camera-pose", "distance"]
    three_sigma_mm: Noise | NoiseVector
    three_sigma_deg: Noise | NoiseVector | None = None

    @model_validator(mode="after")
    def _has_angles(self) -> NoiseSection:
        if (self.three_sigma_deg is not None) != self.kind.endswith("pose"):
            verb = "needs" if self.kind.endswith("pose") else "has no"
            raise ValueError(f"a {self.kind} {verb} three_sigma_deg")
        return self


class PayloadSection(Section):
    """Something else that the flange carries in some of the measurements."""

    name: Name
    mass_kg: NotNegative
    com_mm: Vector


class KnownDistanceSection(Section):
    """A distance between two targets that is known from elsewhere."""

    targets: tuple[Name, Name]
    length_mm: Size
    three_sigma_mm: Noise = 0.03
