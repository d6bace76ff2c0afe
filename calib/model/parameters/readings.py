"""Parameters of what reads: the values of a lens, the errors of a printed board."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, near_names
from calib.lens import LINEAR, Lens
from calib.model.context import ArmErrors, MeasurementContext, Setup, reading_label
from calib.model.parameters.base import ParameterBlock, Unit, prior_of
from calib.se3 import FloatArray

USUAL_SHIFT = 0.3
"""Standard deviation of what a term of distortion shifts the corner of the picture by, as a share
of its distance from the middle."""

USUAL_BELOW = 0.3
"""Standard deviation of the factors of a denominator of distortion."""


class ReadingParameters(ParameterBlock):
    """Values that an instrument reads by; they move nothing.

    Parameters
    ----------
    reading : str
        Label under which a kind of measurement looks for them.
    values : array_like (k,)
        Nominal values of all of them.
    names, units : sequence of str
        Of all k; the label goes before the names.
    free : sequence of str, optional
        Names of those to identify; all by default.
    """

    nuisance = True
    beyond_chain = ""

    def __init__(
        self,
        reading: str,
        values: ArrayLike,
        names: Sequence[str],
        units: Sequence[Unit],
        free: Sequence[str] | None = None,
        prior: float | FloatArray | None = None,
    ) -> None:
        self.reading = reading
        self.values = np.asarray(values, dtype=float)
        wanted = list(names) if free is None else list(free)
        for name in wanted:
            if name not in names:
                raise InputError(
                    f"{reading} has no {name!r}", hint=near_names(name, tuple(names)), name=name
                )
        self._free = [k for k, name in enumerate(names) if name in wanted]
        self.names = tuple(f"{reading}.{names[k]}" for k in self._free)
        self.units = tuple(units[k] for k in self._free)
        every = prior_of(prior, len(names))
        self.prior = every[self._free]

    @property
    def nominal(self) -> FloatArray:
        return self.values[self._free]

    def all_values(self, values: FloatArray) -> FloatArray:
        """All values ``(k, S)`` from those of the parameters ``(size, S)``."""
        every = np.repeat(self.values[:, None], values.shape[1], axis=1)
        every[self._free] = values
        return every

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        errors.readings[self.reading] = self.all_values(values)

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """Nothing moves: see :meth:`calib.model.measurements.Measurement.differentiate_reading`."""

    def picked(self, rows: FloatArray) -> FloatArray:
        return rows[self._free]


class LensParameters(ReadingParameters):
    """Focal lengths, principal point and distortion of a camera."""

    def __init__(
        self,
        lens: Lens,
        label: str = "camera",
        free: Sequence[str] | None = None,
        prior: float | FloatArray | None = None,
    ) -> None:
        px: Unit = "px"
        one: Unit = "1"
        units = [px] * len(LINEAR) + [one] * len(lens.distortion)
        super().__init__(
            reading_label("lens", label, "camera"), lens.values, lens.names, units, free, prior
        )
        self.lens, self.label = lens, label

    @classmethod
    def usual(cls, lens: Lens, label: str = "camera") -> LensParameters:
        """All values of a lens, its distortion known to be of a usual size.

        What a lens of long focal length does not show of its higher terms would have no bounds
        otherwise. Factors of a denominator stand against those above it, and many of both show the
        same: they are said to be small, so that one of these is found.
        """
        edge = float(np.hypot(lens.width_px, lens.height_px)) / 2.0 / lens.values[0]
        if lens.name == "fisheye":
            edge = float(np.arctan(edge))
        powers = {"k1": 2, "k2": 4, "k3": 6, "k4": 8, "p1": 1, "p2": 1}
        prior = [USUAL_SHIFT / edge ** powers[n] if n in powers else np.inf for n in lens.names]
        below = np.isin(lens.names, ("k4", "k5", "k6")) & (lens.name == "rational")
        return cls(lens, label, prior=np.where(below, USUAL_BELOW, prior))


class BoardErrors(ReadingParameters):
    """What a printed board is off its description.

    ``scale``: how much larger it is, as a share of its size. ``bend_x``, ``bend_y``: by how much
    its left and right edges, and its upper and lower ones, lie behind its middle [m], as parabolas.
    """

    def __init__(
        self,
        label: str = "board",
        free: Sequence[str] = ("scale",),
        prior: float | FloatArray | None = None,
    ) -> None:
        names: tuple[str, ...] = ("scale", "bend_x", "bend_y")
        super().__init__(
            reading_label("board", label, "board"), np.zeros(3), names, ("1", "m", "m"), free, prior
        )
