"""What a choice of poses out of a pool consists of, and how far it is from the best there is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray, IntArray
from posedesign.selection.criteria import Criterion
from posedesign.selection.relaxation import Relaxation

PROVEN = 0.9995
"""Efficiency from which a choice is called the best there is."""


@dataclass(frozen=True, eq=False)
class Selection:
    """Poses chosen out of a pool.

    ``indices`` (n,): into the pool, ascending, with those that were kept. ``criterion``: what they
    were chosen by. ``value``: of the choice, as the criterion is known; see ``criterion.title``.
    ``bound``: what no choice of as many poses can be better than; NaN where it was not asked for.
    ``efficiency``: in terms of information, 0 to 1: .97 proves that no choice of less than .97 n
    poses can be as good. Of condition numbers the bound over the value. ``covariance`` (p, p):
    predicted, in the units of the blocks; infinite where not all is identified. ``relaxation``:
    where the bound is from. ``values_of_starts``: what each start came to. ``duplicates``:
    candidates that are there more than once, and were offered once.
    """

    indices: IntArray
    criterion: Criterion
    value: float
    bound: float
    efficiency: float
    covariance: FloatArray
    relaxation: Relaxation | None
    values_of_starts: tuple[float, ...]
    duplicates: int

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.indices)

    @property
    def sigma(self) -> FloatArray:
        """Predicted standard deviations ``(p,)``, in the units of the blocks."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))

    @property
    def status(self) -> str:
        """``"best"`` (proven), ``"bounded"``, ``"no bound"`` or ``"not identifiable"``."""
        if not np.isfinite(self.sigma).all():
            return "not identifiable"
        if np.isnan(self.efficiency):
            return "no bound"
        return "best" if self.efficiency >= PROVEN else "bounded"

    @property
    def message(self) -> str:
        """The outcome in a sentence."""
        name = self.criterion.name
        text = f"{self.count} poses: {name} {self.value:.4g}"
        if self.status == "not identifiable":
            return f"{self.count} poses do not determine all parameters"
        if np.isfinite(self.efficiency):
            side = "below" if self.criterion.smaller_is_better else "above"
            text += (
                f"; proven: none of {self.count} is {side} {self.bound:.4g} "
                f"(efficiency {self.efficiency:.3f})"
            )
        if self.duplicates:
            text += f"; {self.duplicates} candidates are there more than once and were offered once"
        return text


@dataclass(frozen=True, eq=False)
class Fewest:
    """The fewest poses that reach a value.

    ``selection``: the poses; where the value is out of reach, the best that was found. ``fewer``:
    the best choice found of one pose fewer, which does not reach it. ``wanted``: the value asked
    for. ``at_least``: proven: fewer poses than that cannot reach it.
    """

    selection: Selection
    fewer: Selection | None
    wanted: float
    reached: bool
    at_least: int

    @property
    def message(self) -> str:
        """The outcome in a sentence."""
        found, name = self.selection, self.selection.criterion.name
        if not self.reached:
            if not np.isfinite(found.value) or found.status == "not identifiable":
                return f"all {found.count} poses together do not determine all parameters"
            return (
                f"out of reach: the best that the pool gives is {name} {found.value:.4g} with "
                f"{found.count} poses, {self.wanted:.4g} is wanted" + self._times()
            )
        text = f"{found.count} poses reach {name} {found.value:.4g} ({self.wanted:.4g} wanted)"
        if self.fewer is not None:
            text += f"; {self.fewer.count} were found to reach {self.fewer.value:.4g} only"
        if self.at_least >= found.count:
            return text + "; proven: fewer cannot"
        return text + f"; proven: fewer than {self.at_least} cannot"

    def _times(self) -> str:
        """How often all poses would have to be measured: variances fall with the number."""
        criterion = self.selection.criterion
        if not criterion.falls_with_poses:
            return ""
        ratio = criterion.cost_of(self.selection.value) / criterion.cost_of(self.wanted)
        return f": each of them would have to be measured {int(np.ceil(ratio))} times"
