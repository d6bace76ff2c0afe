"""What was measured: the postures at which touch-ups were done."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.errors import InputError
from calib.se3 import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class TouchUps:
    """Postures at which the tool point stood on a target.

    Attributes
    ----------
    postures : array (..., N, n)
        Joint values as the controller showed them [rad], URDF signs. A leading dimension holds
        Monte Carlo trials of the same plan.
    target : array (N,)
        Index into ``labels`` of the target touched.
    labels : tuple of str
        Names of the targets.
    """

    postures: FloatArray
    target: IntArray
    labels: tuple[str, ...] = ("T1",)

    def __post_init__(self) -> None:
        if self.postures.ndim < 2 or self.postures.shape[-2] != len(self.target):
            raise InputError(
                f"{len(self.target)} targets for postures of shape {self.postures.shape}",
                name="touch-ups",
            )
        if not np.isfinite(self.postures).all():
            raise InputError("a joint value is not a finite number", name="touch-ups")
        if self.target.size and not (
            0 <= self.target.min() <= self.target.max() < len(self.labels)
        ):
            raise InputError("a target index has no name", name="touch-ups")

    @property
    def count(self) -> int:
        """Number of touch-ups N."""
        return len(self.target)
