"""Knowledge of a camera or a target from elsewhere: ``prior.toml``.

A section for each frame, by its name::

    [camera]                     # a drawing of the mount
    position_mm = [0.0, 52.0, 38.5]
    sigma_mm = 0.5
    wpr_deg = [0.0, 0.0, 90.0]
    sigma_deg = 0.5

    [target]                     # a height measured by rule, and a plane that is level
    position_mm = [0.0, 0.0, 12.0]
    sigma_mm = [inf, inf, 0.3]
    z_axis = [0.0, 0.0, 1.0]
    sigma_deg = 0.2

Places and turns are in the axes of the parent: of the flange for what is on it, of the base for
what stands around.
"""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from calib.errors import CalibError, FileFormatError
from calib.robot_world.network.prior import FramePrior, prior_of_axis
from calib.se3 import rotation_from_wpr, transform
from posedesign.files import read_bytes_bounded

_LARGEST_BYTES = 100_000

_Three = Annotated[
    list[Annotated[float, Field(ge=-1e6, le=1e6)]], Field(min_length=3, max_length=3)
]
_Sigma = Annotated[float, Field(gt=0.0)]
_Sigmas = _Sigma | Annotated[list[_Sigma], Field(min_length=3, max_length=3)]


class _Section(BaseModel):
    """Knowledge of one frame."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=True)

    position_mm: _Three | None = None
    sigma_mm: _Sigmas | None = None
    wpr_deg: _Three | None = None
    sigma_deg: _Sigmas | None = None
    x_axis: _Three | None = None
    y_axis: _Three | None = None
    z_axis: _Three | None = None

    def priors(self, name: str) -> list[FramePrior]:
        """Return what is known, place and turn apart."""
        found = []
        if self.position_mm is not None:
            sigma = 1e-3 * np.asarray(self.sigma_mm, dtype=float)
            place = 1e-3 * np.array(self.position_mm)
            found.append(FramePrior(name, transform(np.eye(3), place), sigma_m=sigma))
        if self.wpr_deg is not None:
            R = rotation_from_wpr(np.radians(self.wpr_deg))
            turn = np.radians(np.asarray(self.sigma_deg, dtype=float))
            if found:  # as one, so that it can be started from
                T = transform(R, found[0].T[:3, 3])
                return [FramePrior(name, T, found[0].sigma_m, turn)]
            found.append(FramePrior(name, transform(R, np.zeros(3)), sigma_rad=turn))
        for axis in "xyz":
            direction = getattr(self, f"{axis}_axis")
            if direction is not None:
                turn = float(np.radians(np.max(np.asarray(self.sigma_deg, dtype=float))))
                found.append(prior_of_axis(name, axis, direction, turn))
        return found

    def problem(self) -> str:
        """Return what is missing beside what; empty where nothing is."""
        turned = self.wpr_deg or self.x_axis or self.y_axis or self.z_axis
        for given, sigma, what in (
            (self.position_mm, self.sigma_mm, "position_mm and sigma_mm"),
            (turned, self.sigma_deg, "wpr_deg, x_axis, y_axis or z_axis, and sigma_deg"),
        ):
            if (given is None) != (sigma is None):
                return f"lacks one of {what}"
        if self.position_mm is None and turned is None:
            return "says nothing"
        return ""


def read_priors(path: Path) -> tuple[FramePrior, ...]:
    """Read a ``prior.toml``.

    Raises
    ------
    FileFormatError
        Naming file, section and key.
    """
    data = read_bytes_bounded(path, most_bytes=_LARGEST_BYTES)
    try:
        raw: dict[str, Any] = tomllib.loads(data.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"is no valid TOML: {error}", path=path, hint="mend the line"
        ) from error
    found: list[FramePrior] = []
    for name, section in raw.items():
        if not isinstance(section, dict):
            raise FileFormatError(
                f"{name} stands in no section",
                path=path,
                hint="write [camera] or [target] above it",
            )
        try:
            known = _Section.model_validate(section)
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(str(part) for part in (name, *first["loc"][:1]))
            said = (
                "is unknown" if first["type"] == "extra_forbidden" else f"is wrong: {first['msg']}"
            )
            raise FileFormatError(
                said,
                path=path,
                key=key,
                hint="known: " + ", ".join(_Section.model_fields),
            ) from error
        if problem := known.problem():
            raise FileFormatError(problem, path=path, key=name, hint="give both")
        try:
            found += known.priors(name)
        except CalibError as error:
            raise FileFormatError(error.message, path=path, key=name) from error
    if not found:
        raise FileFormatError("says nothing of any frame", path=path, hint="write a section")
    return tuple(found)
