"""Postures to choose from, with what each of them touches."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, near_names
from calib.model import CalibrationModel, Linearisation, Setup
from calib.model.parameters import TargetPoints
from calib.se3 import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Pool:
    """Postures that keep every constraint of a cell, no two of them the same.

    ``postures`` (N, n): [rad]. ``orientations`` (N, 3, 3): of the tip, in the base frame.
    ``target`` (N,): what each touches, or looks at: an index into the targets. ``targets_m`` (K,
    3): targets [m] in the base frame. ``target_names``: their labels in a model. ``tried``: poses,
    or postures, that were looked at. ``description``: how the pool was made, in words. Raises
    InputError: the shapes do not go together.
    """

    postures: FloatArray
    orientations: FloatArray
    target: IntArray
    targets_m: FloatArray
    target_names: tuple[str, ...]
    tried: int
    description: str

    def __post_init__(self) -> None:
        count, targets = len(self.postures), len(self.targets_m)
        for name, shape, wanted in (
            ("orientations", self.orientations.shape, (count, 3, 3)),
            ("target", self.target.shape, (count,)),
            ("targets_m", self.targets_m.shape, (targets, 3)),
            ("target_names", (len(self.target_names),), (targets,)),
        ):
            if shape != wanted:
                raise InputError(
                    f"a pool of {count} postures and {targets} targets has {name} of shape "
                    f"{shape}, not {wanted}",
                    name=name,
                )
        if count and not 0 <= self.target.min() <= self.target.max() < targets:
            raise InputError(f"indices of {targets} targets go from 0 up", name="target")

    def __len__(self) -> int:
        return len(self.postures)

    @property
    def touched_m(self) -> FloatArray:
        """Place of what each posture touches, ``(N, 3)`` [m] in the base frame."""
        return np.asarray(self.targets_m[self.target])

    @property
    def of_each(self) -> IntArray:
        """Number of postures of each target, ``(K,)``."""
        return np.bincount(self.target, minlength=len(self.targets_m))

    def take(self, rows: ArrayLike) -> Pool:
        """The pool of some of the postures, in the order given: indices, or booleans ``(N,)``.

        Raises InputError: an index that is none of the pool's.
        """
        index = np.asarray(rows)
        if index.dtype == bool:
            if index.shape != (len(self),):
                raise InputError(f"a pool of {len(self)} takes as many booleans", name="rows")
            index = np.flatnonzero(index)
        whole = index.astype(np.intp)
        if index.ndim != 1 or not np.array_equal(index, whole):
            raise InputError("rows of a pool are whole numbers in one row", name="rows")
        if len(whole) and not -len(self) <= whole.min() <= whole.max() < len(self):
            raise InputError(
                f"rows of a pool of {len(self)} go from 0 to {len(self) - 1}", name="rows"
            )
        return replace(
            self,
            postures=self.postures[whole],
            orientations=self.orientations[whole],
            target=self.target[whole],
        )

    def target_points(self, *, free: bool = True, prior_m: float | None = None) -> TargetPoints:
        """The targets as a model takes them, see :class:`~calib.model.parameters.TargetPoints`."""
        return TargetPoints(self.targets_m, self.target_names, free, prior_m)

    def setup(self, model: CalibrationModel) -> Setup:
        """Which target of a model each posture touches: by name, or the only one of both.

        Raises InputError: the model has no target of that name.
        """
        if len(self.targets_m) == len(model.targets) == 1:
            return Setup.of(len(self), target=self.target)
        for name in self.target_names:
            if name not in model.targets:
                raise InputError(
                    f"the model has no target {name!r}, which the pool touches",
                    hint=near_names(name, model.targets) or "build it with pool.target_points()",
                    name=name,
                )
        index = np.array([model.targets.index(name) for name in self.target_names], dtype=np.intp)
        return Setup.of(len(self), target=index[self.target])

    def linearise(self, model: CalibrationModel) -> Linearisation:
        """What a model makes of the postures at its nominal parameters."""
        return model.linearise(self.postures, setup=self.setup(model))

    def white(self, model: CalibrationModel) -> FloatArray:
        """Blocks ``(N, m, p)`` over the noise: what a selection chooses among."""
        return self.linearise(model).white_jacobian

    def summary(self) -> str:
        """How many postures of what, in words."""
        said = f"{self.description}: {len(self)} postures from {self.tried} tried"
        if len(self.targets_m) == 1:
            return said
        each = zip(self.target_names, self.of_each.tolist(), strict=True)
        return f"{said}; " + ", ".join(f"{name} {count}" for name, count in each)
