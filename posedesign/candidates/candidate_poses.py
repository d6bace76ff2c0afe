"""Postures to choose from, with what each of them touches: one target or several."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.errors import InputError, near_names
from calib.model import CalibrationModel, Linearisation, Setup
from calib.model.parameters import TargetPoints
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.cell import Cell
from posedesign.constraints import Checker
from posedesign.selection import shortened

APART_M = 1e-6
"""Targets nearer to each other are one: far below what a pin could be set on."""

_NUMBERS = 4_000_000
"""Of Jacobians at once: 32 MB."""

FARTHEST_M = 100.0
"""Coordinates beyond this are millimetres: no arm reaches there."""


def offset_targets(cell: Cell, offsets_mm: ArrayLike) -> FloatArray:
    """Targets ``(K, 3)`` [m] at offsets ``(K, 3)`` [mm], base axes, from the target of a cell."""
    name, hint = "offsets_mm", "give x, y and z of each in mm"
    offsets = _shaped(offsets_mm, name, hint)
    return _checked(cell.target_m + offsets / 1e3, name, hint)


def targets_of(
    cell: Cell, targets_m: ArrayLike | None, names: Sequence[str] | None
) -> tuple[FloatArray, tuple[str, ...]]:
    """Targets ``(K, 3)`` [m] and their names; by default that of the cell, or T1, T2, ...

    Raises InputError: they are no points, two are the same, one lies inside an obstacle, or the
    names do not belong to them.
    """
    given = cell.target_m if targets_m is None else targets_m
    name, hint = "targets_m", "give x, y and z of each in metres"
    targets = _checked(_shaped(given, name, hint), name, hint)
    if names is None:
        several = tuple(f"T{k + 1}" for k in range(len(targets)))
        names = (cell.config.target.name,) if targets_m is None else several
    if len(names) != len(targets) or len(set(names)) != len(names):
        raise InputError(
            f"{len(targets)} targets need as many names, each its own: {', '.join(names)}",
            name="target_names",
        )
    if cell.obstacles:
        inside = cell.scene.inside(targets)
        for name, body in zip(names, inside.tolist(), strict=True):
            if body >= 0:
                raise InputError(
                    f"the target {name} lies inside the obstacle {cell.obstacles[body].name!r}",
                    hint="a target sits on its fixture, not in it",
                    name="targets_m",
                )
    return targets, tuple(names)


def checkers_of(cell: Cell, targets_m: FloatArray) -> list[Checker]:
    """The constraints of a cell for each of ``(K, 3)`` targets [m]: what a camera is to see."""
    if cell.config.camera is None:
        return [cell.checker] * len(targets_m)
    return [
        cell.checker
        if np.array_equal(target, cell.target_m)
        else replace(cell, target_m=target).checker
        for target in targets_m
    ]


def feasible(
    cell: Cell, postures: FloatArray, target: IntArray, targets_m: FloatArray
) -> BoolArray:
    """Whether postures keep every constraint of a cell, ``(N,)``.

    ``postures`` (N, n): [rad]; where they are NaN the answer is no. ``target`` (N,): what each
    touches, an index into the targets, or the observations of the cell. ``targets_m`` (K, 3): [m],
    in the base frame.
    """
    kept = np.zeros(len(postures), dtype=bool)
    there = np.isfinite(postures).all(axis=1)
    parts = cell.parts
    several = len(parts) == len(targets_m) > 1
    checkers = [part.checker for part in parts] if several else checkers_of(cell, targets_m)
    for k, checker in enumerate(checkers):
        rows = np.flatnonzero(there & (target == k))
        kept[rows] = checker.check(postures[rows], every=False).feasible
    return kept


def _shaped(given: ArrayLike, name: str, hint: str) -> FloatArray:
    points = np.atleast_2d(np.asarray(given, dtype=float))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise InputError(f"targets have shape {points.shape}, not (K, 3)", hint=hint, name=name)
    return points


def _checked(targets: FloatArray, name: str, hint: str) -> FloatArray:
    if not (np.abs(targets) <= FARTHEST_M).all():  # NaN is refused, too
        raise InputError("a target is out of any arm's reach, or no number", hint=hint, name=name)
    apart = np.linalg.norm(targets[:, None] - targets, axis=-1) + np.eye(len(targets))
    if (apart < APART_M).any():
        raise InputError("two targets are the same point", hint="give it once", name=name)
    return targets


@dataclass(frozen=True, eq=False)
class CandidatePoses:
    """Postures that keep every constraint of a cell, no two of them the same."""

    postures: FloatArray  # (N, n) [rad]
    orientations: FloatArray  # (N, 3, 3): of the tip, in the base frame
    target: IntArray  # (N,): what each touches, or looks at: an index into the targets
    targets_m: FloatArray  # (K, 3): targets [m] in the base frame
    target_names: tuple[str, ...]  # their labels in a model
    tried: int  # poses, or postures, that were looked at
    description: str  # how they were made, in words
    cell: Cell | None = None
    """Whose observations ``target`` is an index into, where a pose may be of several, or of several
    tools."""

    def __len__(self) -> int:
        return len(self.postures)

    def tools_m(self, otherwise: FloatArray) -> FloatArray:
        """Point of the tool that each posture touches with ``(N, 3)`` [m], in the tip frame."""
        if self.cell is None:
            return np.broadcast_to(otherwise, (len(self), 3))
        return np.array([part.tool_m for part in self.cell.parts])[self.target]

    @property
    def touched_m(self) -> FloatArray:
        """Place of what each posture touches, ``(N, 3)`` [m] in the base frame."""
        return np.asarray(self.targets_m[self.target])

    @property
    def of(self) -> IntArray:
        """Index of the cell's observation that each posture is of, ``(N,)``."""
        return self.target if self.cell is not None else np.zeros(len(self), dtype=np.intp)

    @property
    def loads(self) -> IntArray:
        """Index ``(N,)`` of what the flange carries at each posture: 0 for the tool alone."""
        if self.cell is None:
            return np.zeros(len(self), dtype=np.intp)
        names = list(dict.fromkeys(seen.payload for seen in self.cell.observations))
        each = np.array([names.index(seen.payload) for seen in self.cell.observations])
        return np.asarray(each[self.target])

    @property
    def labels(self) -> list[Mapping[str, str]]:
        """What each posture is of, by column of a list of poses; nothing where all are of one."""
        if self.cell is None or len(self.cell.observations) == 1:
            return []
        each = [seen.labels for seen in self.cell.observations]
        return [each[k] for k in self.target]

    @property
    def names_of_targets(self) -> NDArray[np.object_]:
        """Name of the target that each posture is of, ``(N,)``."""
        seen = None if self.cell is None else [each.target for each in self.cell.observations]
        return np.array(seen or self.target_names, dtype=object)[self.target]

    @property
    def of_each(self) -> IntArray:
        return np.bincount(self.target, minlength=len(self.targets_m))

    def take(self, rows: ArrayLike) -> CandidatePoses:
        """Some of the postures, in the order given: indices, or booleans ``(N,)``."""
        index = np.asarray(rows)
        index = np.flatnonzero(index) if index.dtype == bool else index.astype(np.intp)
        return replace(
            self,
            postures=self.postures[index],
            orientations=self.orientations[index],
            target=self.target[index],
        )

    def target_points(self, *, free: bool = True, prior_m: float | None = None) -> TargetPoints:
        """The targets as a model takes them, see :class:`~calib.model.parameters.TargetPoints`."""
        return TargetPoints(self.targets_m, self.target_names, free, prior_m)

    def setup(self, model: CalibrationModel) -> Setup:
        """Which target of a model each posture touches: by name, or the only one of both."""
        if self.cell is not None:
            return self.cell.setup(model, self.postures, self.target)
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

    def linearise(self, model: CalibrationModel, x: FloatArray | None = None) -> Linearisation:
        """What a model makes of the postures, at its nominal parameters or others ``(p,)``."""
        return model.linearise(self.postures, x, self.setup(model))

    def white(self, model: CalibrationModel, x: FloatArray | None = None) -> FloatArray:
        """Blocks ``(N, m, p)`` over the noise: what a selection chooses among.

        Shortened where a pose has more rows than there are parameters.
        """
        return self.blocks(model, lambda linear: shortened(linear.white_jacobian), x)

    def rows(self, model: CalibrationModel) -> int:
        """Rows of the block of a posture: of all that is measured there at once."""
        return model.rows if self.cell is None else self.cell.rows(model)

    def blocks(
        self,
        model: CalibrationModel,
        of: Callable[[Linearisation], FloatArray],
        x: FloatArray | None = None,
    ) -> FloatArray:
        """What is made of the postures ``(N, ...)``, of some at a time where they have many rows.

        The points of a board are two rows each: those of thousands of poses would fill the memory.
        """
        at_once = max(1, _NUMBERS // (self.rows(model) * model.p))
        parts = [
            of(self.take(np.arange(first, min(first + at_once, len(self)))).linearise(model, x))
            for first in range(0, max(len(self), 1), at_once)
        ]
        if len(parts) == 1:
            return parts[0]
        rows = max(part.shape[1] for part in parts)  # those of fewer are filled up with zeros
        return np.concatenate(
            [np.pad(part, ((0, 0), (0, rows - part.shape[1]), (0, 0))) for part in parts]
        )

    def summary(self) -> str:
        said = f"{self.description}: {len(self)} postures from {self.tried} tried"
        if len(self.targets_m) == 1:
            return said
        each = zip(self.target_names, self.of_each.tolist(), strict=True)
        return f"{said}; " + ", ".join(f"{name} {count}" for name, count in each)
