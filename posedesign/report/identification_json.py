"""What pages and figures need of an identification.json, checked as it is read."""

from __future__ import annotations

from pydantic import BaseModel, model_validator


class Residual(BaseModel):
    """What an identification.json has of a measurement."""

    pose: str
    mm: float
    target: str | None = None
    leave_one_out_mm: float | None = None
    weight: float | None = None
    outlier: bool = False


class Parameter(BaseModel):
    """What it has of a parameter, in the unit that it says."""

    name: str
    value: float
    unit: str
    sigma: float | None = None
    change: float | None = None
    low: float | None = None
    high: float | None = None


class FittedModel(BaseModel):
    """What it has of a model; one that was refused has no parameters."""

    name: str
    message: str = ""
    parameters: list[Parameter] = []
    residuals: list[Residual] = []
    rms_mm: float | None = None
    leave_one_out_rms_mm: float | None = None
    expected_box_mm: float | None = None
    noise_scale: float | None = None


class Source(BaseModel):
    """What was identified from."""

    file: str = ""


class NamedFinding(BaseModel):
    """What explains the residuals by name."""

    text: str


class IdentificationFile(BaseModel):
    """What a page and a figure need of an identification.json."""

    models: list[FittedModel]
    joints: list[str] = []
    recommended: str | None = None
    reason: str | None = None
    warnings: list[str] = []
    findings: list[NamedFinding] = []
    data: Source = Source()

    @model_validator(mode="after")
    def _has_its_choice(self) -> IdentificationFile:
        if self.recommended is not None and (self.chosen is None or not self.chosen.residuals):
            raise ValueError(f"nothing is said of the recommended model {self.recommended[:40]}")
        return self

    @property
    def chosen(self) -> FittedModel | None:
        """The recommended model."""
        return next((model for model in self.models if model.name == self.recommended), None)
