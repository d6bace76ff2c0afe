"""What was measured: postures, what was read at them, and how each measurement was set up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from calib.errors import InputError, near_names
from calib.model.context import Setup
from calib.se3 import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Measurements:
    """N measurements of a robot, of any mixture of kinds.

    Attributes
    ----------
    postures : array (..., N, n)
        Joint values as the controller showed them [rad], URDF signs. A leading dimension holds
        Monte Carlo trials of the same plan.
    setup : Setup
        Kind, tool, target and payload of each.
    targets : tuple of str
        Names that ``setup.target`` has indices into.
    tools : tuple of str
        Names that ``setup.tool`` has indices into.
    observed : array (..., N, m) or None
        What was read [m, rad, px], as :meth:`CalibrationModel.predict` has it; None where the arm
        was moved until tool and target met. Rows that ``setup.seen`` says were not read count for
        nothing, whatever stands in them.
    names : tuple of str
        Of the poses; measurements of one pose share a name. ``P01`` onwards by default.
    """

    postures: FloatArray
    setup: Setup
    targets: tuple[str, ...] = ("T1",)
    tools: tuple[str, ...] = ("tool",)
    observed: FloatArray | None = None
    names: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("postures", "observed"):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, np.asarray(given, dtype=float))
        count = self.setup.count
        if self.postures.ndim < 2 or self.postures.shape[-2] != count:
            raise InputError(
                f"{count} targets for postures of shape {self.postures.shape}",
                name="measurements",
            )
        if not np.isfinite(self.postures).all():
            raise InputError("a joint value is not a finite number", name="measurements")
        for index, labels, what in (
            (self.setup.target, self.targets, "target"),
            (self.setup.tool, self.tools, "tool"),
        ):
            if index.max(initial=0) >= max(len(labels), 1):
                raise InputError(f"a {what} index has no name", name="measurements")
        if self.observed is not None:
            if self.observed.shape[:-1] != self.postures.shape[:-1]:
                raise InputError(
                    f"readings of shape {self.observed.shape} for postures of shape "
                    f"{self.postures.shape}",
                    name="measurements",
                )
            self._check_readings(self.observed)
        if not self.names:
            object.__setattr__(self, "names", tuple(f"P{i + 1:02d}" for i in range(count)))
        if len(self.names) != count:
            raise InputError(f"{len(self.names)} names for {count} measurements", name="names")

    def _check_readings(self, observed: FloatArray) -> None:
        if self.setup.seen is not None:
            observed = np.where(self.setup.seen, observed, 0.0)
            object.__setattr__(self, "observed", observed)
        if not np.isfinite(observed).all():
            raise InputError("a reading is not a finite number", name="measurements")

    @property
    def count(self) -> int:
        """Number of measurements N."""
        return self.setup.count

    @property
    def target(self) -> IntArray:
        """Index into ``targets`` of each measurement ``(N,)``."""
        return self.setup.target

    @property
    def pose(self) -> IntArray:
        """Index of the pose that each measurement belongs to, ``(N,)``."""
        index = {name: i for i, name in enumerate(dict.fromkeys(self.names))}
        return np.array([index[name] for name in self.names], dtype=np.intp)

    @cached_property
    def groups(self) -> IntArray:
        """Group ``(N,)`` of each measurement: those of one pose, and those at one posture.

        They share what a model leaves out of the arm, whatever they are called, and have to be left
        out together. Of many trials the postures of the first one count.
        """
        n = self.postures.shape[-1]
        first = self.postures.reshape(-1, self.count, n)[:1].reshape(self.count, n)
        return repeated_together(self.pose, first)

    def at_stops(self) -> Measurements:
        """Return the same with each group as one stop of the arm, whose deviation it shares."""
        return replace(self, setup=replace(self.setup, stop=self.groups))

    def __getitem__(self, rows: IntArray | slice) -> Measurements:
        """Some of the measurements, with the labels of all."""
        names = tuple(np.array(self.names, dtype=object)[rows])
        observed = None if self.observed is None else self.observed[..., rows, :]
        postures = self.postures[..., rows, :]
        return Measurements(postures, self.setup[rows], self.targets, self.tools, observed, names)

    def with_labels(self, targets: Sequence[str], tools: Sequence[str]) -> Measurements:
        """The same with other lists of names, each measurement of the names that it had."""
        found = []
        for what, index, own, names in (
            ("target", self.setup.target, self.targets, list(targets)),
            ("tool", self.setup.tool, self.tools, list(tools)),
        ):
            used = np.unique(index).tolist()
            strange = next((own[k] for k in used if own[k] not in names), None)
            if strange is not None:
                raise InputError(
                    f"there is no {what} {strange!r}", hint=near_names(strange, names), name=what
                )
            place = np.zeros(len(own), dtype=np.intp)
            place[used] = [names.index(own[k]) for k in used]
            found.append(place[index])
        setup = replace(self.setup, target=found[0], tool=found[1])
        return replace(self, setup=setup, targets=tuple(targets), tools=tuple(tools))

    def trials(self, which: int | slice | None) -> Measurements:
        """Some trials of many; None makes one trial of a single set."""
        postures = self.postures[which]
        observed = self.observed
        if observed is not None and observed.ndim == self.postures.ndim:
            observed = observed[which]
        return replace(self, postures=postures, observed=observed)

    def repeated(self, trials: int) -> Measurements:
        """One set as so many trials, all the same."""
        observed = self.observed
        if observed is not None:
            observed = np.broadcast_to(observed, (trials, *observed.shape))
        return replace(
            self,
            postures=np.broadcast_to(self.postures, (trials, *self.postures.shape)),
            observed=observed,
        )


def touch_ups(
    postures: ArrayLike,
    target: ArrayLike = 0,
    targets: Sequence[str] = ("T1",),
    names: Sequence[str] = (),
) -> Measurements:
    """Touch-ups: postures ``(..., N, n)`` [rad] at which the tool point stood on a target.

    By index ``(N,)`` into ``targets``; the first for all by default.
    """
    q = np.asarray(postures, dtype=float)
    count = len(np.atleast_1d(target)) if np.ndim(target) else (q.shape[-2] if q.ndim > 1 else 1)
    setup = Setup.of(count, target=target)
    return Measurements(q, setup, tuple(targets), names=tuple(names))


SAME_POSTURE_RAD = float(np.deg2rad(0.1))
"""Difference in every joint up to which two postures are one: touching a point again turns joints
by hundredths of a degree, and another posture of a plan by degrees."""


def repeated_together(pose: IntArray, postures: FloatArray) -> IntArray:
    """Groups ``(N,)``, counted from zero, of measurements of one pose or at one posture.

    Of poses by their index ``(N,)``, and postures ``(N, n)`` [rad].
    """
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    same = same_posture(postures)
    width = int(pose.max(initial=-1)) + 1
    link = coo_array(
        (np.ones(len(pose)), (pose, width + same)),
        shape=(width + int(same.max(initial=-1)) + 1,) * 2,
    )
    label = connected_components(link, directed=False)[1][pose]
    return np.asarray(np.unique(label, return_inverse=True)[1].ravel(), dtype=np.intp)


def same_posture(postures: FloatArray) -> IntArray:
    """Index ``(N,)`` of the posture that each one repeats within ``SAME_POSTURE_RAD``.

    All of a group are that close to one of them. They are not chained: an arm that is measured
    while it moves slowly would otherwise be in one posture all along.
    """
    distinct, back = np.unique(postures, axis=0, return_inverse=True)
    first, bound = np.arange(len(distinct)), SAME_POSTURE_RAD
    # whoever has another near it has one near it in each joint: mostly nobody
    order = np.argsort(distinct, axis=0)
    gap = np.diff(np.take_along_axis(distinct, order, axis=0), axis=0) <= bound
    near = np.zeros(distinct.shape, dtype=bool)
    none = np.zeros((1, distinct.shape[1]), dtype=bool)
    np.put_along_axis(near, order, np.vstack([gap, none]) | np.vstack([none, gap]), axis=0)
    free = np.asarray(near.all(axis=1))
    if free.any():
        from scipy.spatial import KDTree  # takes as long to import as the rest of a small command

        tree = KDTree(distinct)
        for i in np.flatnonzero(free).tolist():
            if free[i]:
                same = np.array(tree.query_ball_point(distinct[i], bound, p=np.inf))
                same = same[free[same]]
                first[same], free[same] = i, False
    return np.asarray(first[back.ravel()])
