"""Motions that something is in the way of, by a rule in place of bodies."""

from collections.abc import Callable

import numpy as np

from posedesign.constraints import MotionChecker
from posedesign.constraints.space import MotionVerdicts


class Blocked(MotionChecker):
    """Motions that a rule of their ends ``(W, n)`` [rad] says a wall is in the way of."""

    def __init__(self, rule: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> None:
        super().__init__((), np.inf)
        object.__setattr__(self, "rule", rule)
        object.__setattr__(self, "asked", [])

    def check(self, start: np.ndarray, end: np.ndarray, *, far: bool = False) -> MotionVerdicts:
        self.asked.append(len(start))
        hit, none = self.rule(start, end), np.zeros(len(start))
        return MotionVerdicts(~hit, none, none, tuple("a wall" if h else "" for h in hit))
