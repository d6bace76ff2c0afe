"""What the postures of a pool touch: one target or several, each with its own view."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError
from calib.se3 import BoolArray, FloatArray, IntArray
from posedesign.cell import Cell
from posedesign.constraints import Checker

APART_M = 1e-6
"""Targets nearer to each other are one: far below what a pin could be set on."""

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
    touches, an index into the targets. ``targets_m`` (K, 3): [m], in the base frame.
    """
    kept = np.zeros(len(postures), dtype=bool)
    there = np.isfinite(postures).all(axis=1)
    for k, checker in enumerate(checkers_of(cell, targets_m)):
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
