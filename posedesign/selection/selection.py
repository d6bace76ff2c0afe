"""What a choice of poses out of a pool consists of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.se3 import FloatArray, IntArray

REACHED, OUT_OF_REACH = "reached", "out of reach"


@dataclass(frozen=True, eq=False)
class Selection:
    """Poses chosen out of a pool, and how well they determine the parameters.

    Attributes
    ----------
    indices : ndarray of int (n,)
        Into the pool, ascending; all of it where the wanted deviations are out of reach.
    sigma : ndarray (p,)
        Standard deviations with these poses, in the units of the blocks; infinite where they do
        not determine all parameters.
    wanted : ndarray (p,)
        Largest standard deviations asked for; infinite where any will do.
    status : str
        ``"reached"`` or ``"out of reach"``.
    indices_of_fewer, sigma_of_fewer : ndarray (n - 1,), (p,)
        The best choice found of one pose fewer, which does not reach what is wanted. The same as
        those above where already the whole pool does not.
    """

    indices: IntArray
    sigma: FloatArray
    wanted: FloatArray
    status: str
    indices_of_fewer: IntArray
    sigma_of_fewer: FloatArray

    @property
    def reached(self) -> bool:
        """Whether all standard deviations are as small as wanted."""
        return self.status == REACHED

    @property
    def count(self) -> int:
        """Number of poses."""
        return len(self.indices)

    @property
    def value(self) -> float:
        """Largest standard deviation over the wanted one: at most 1 where these are reached."""
        return largest_share(self.sigma, self.wanted)

    @property
    def value_of_fewer(self) -> float:
        """The same with one pose fewer."""
        return largest_share(self.sigma_of_fewer, self.wanted)

    @property
    def tightest(self) -> int:
        """Index of the parameter that decides."""
        limited = np.flatnonzero(np.isfinite(self.wanted))
        return int(limited[np.argmax(self.sigma[limited] / self.wanted[limited])])

    @property
    def message(self) -> str:
        """The outcome in a sentence."""
        if self.reached:
            less = f"one pose fewer would leave {self.value_of_fewer:.3g} of it"
            if np.isinf(self.value_of_fewer):
                less = "one pose fewer would not determine all parameters"
            return (
                f"{self.count} poses reach {self.value:.3g} of the largest deviation wanted; {less}"
            )
        if np.isinf(self.value):
            return f"all {self.count} poses together do not determine all parameters"
        # n-fold repetition of every pose divides each deviation by the root of n
        times = int(np.ceil(self.value**2))
        return (
            f"all {self.count} poses together leave {self.value:.3g} times the deviation wanted: "
            f"each of them would have to be measured {times} times"
        )


def largest_share(sigma: FloatArray, wanted: FloatArray) -> float:
    """Largest of the standard deviations ``(p,)`` over those wanted, where any are."""
    limited = np.isfinite(wanted)
    return float(np.max(sigma[limited] / wanted[limited]))
