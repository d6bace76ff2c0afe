"""A block with only some of its parameters free."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.errors import InputError, near_names
from calib.model.context import ArmErrors, MeasurementContext, Setup
from calib.model.parameters.base import ParameterBlock
from calib.se3 import FloatArray


class Part(ParameterBlock):
    """Some of the parameters of another block; the others stay at their nominal values.

    Parameters
    ----------
    whole : ParameterBlock
    names : sequence of str
        Those that stay free, in the order of the block.
    """

    def __init__(self, whole: ParameterBlock, names: Sequence[str]) -> None:
        strange = [name for name in names if name not in whole.names]
        if strange:
            raise InputError(
                f"there is no parameter {strange[0]!r}",
                hint=near_names(strange[0], whole.names),
                name=strange[0],
            )
        self.whole = whole
        wanted = set(names)
        self._kept = [k for k, name in enumerate(whole.names) if name in wanted]
        self.names = tuple(whole.names[k] for k in self._kept)
        self.units = tuple(whole.units[k] for k in self._kept)
        self.prior = whole.prior[self._kept]
        self.nuisance = whole.nuisance
        self.beyond_chain = whole.beyond_chain
        self.tools, self.targets = whole.tools, whole.targets

    @property
    def nominal(self) -> FloatArray:
        """See :meth:`ParameterBlock.nominal`."""
        return self.whole.nominal[self._kept]

    def _all(self, values: FloatArray) -> FloatArray:
        """Values ``(size of the whole, S)``."""
        nominal = self.whole.nominal[:, None]
        every = np.broadcast_to(nominal, (len(nominal), values.shape[1])).copy()
        every[self._kept] = values
        return every

    def displace(self, values: FloatArray, errors: ArmErrors, q: FloatArray, setup: Setup) -> None:
        """See :meth:`ParameterBlock.displace`."""
        self.whole.displace(self._all(values), errors, q, setup)

    def move(self, values: FloatArray, view: MeasurementContext, out: FloatArray) -> None:
        """See :meth:`ParameterBlock.move`."""
        every = np.zeros((self.whole.size, *out.shape[1:]))
        self.whole.move(self._all(values), view, every)
        out[...] = every[self._kept]

    def scaling(self, values: FloatArray) -> FloatArray:
        """See :meth:`ParameterBlock.scaling`."""
        return self.whole.scaling(self._all(values[:, None])[:, 0])[self._kept]
